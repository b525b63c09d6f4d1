// The handles of the selected part: arrows that move it, rings that turn it, squares that set its size.

import { about, add, anglesOf, apply, clamp, copiesOf, extent, multiply, placed, rotation, sub, times, toObject, toWorld, unit } from "./geometry.js";
import { alongAxis, meetPlane, project, rayThrough } from "./camera.js";
import { AXES } from "./render.js";
import { LIMITS } from "./study.js";

const LONG = 74, RING = 64, UNIT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

/** The object's axes in the frame of the record. */
const axesOf = model => UNIT.map(axis => apply(rotation([0, 0, model.turn]), axis));

/** Handles of a part in a view: { kind, axis, sign, path, at }, in pixels of the canvas. */
export function handlesOf(model, part, mode, camera) {
  const centre = toWorld(model, part.at), [x, y, depth] = project(camera, centre), perPixel = depth / camera.focal[0];
  if (!(depth > 0.1)) return [];
  const see = p => project(camera, p).slice(0, 2), axes = axesOf(model);
  if (mode === "move") {
    const arrows = axes.map((axis, k) => ({ kind: "move", axis: k, path: [[x, y], see(add(centre, times(axis, LONG * perPixel)))] }));
    return [...arrows, { kind: "slide", at: [x, y] }];
  }
  if (mode === "turn") {
    return axes.map((axis, k) => {
      const [u, v] = [axes[(k + 1) % 3], axes[(k + 2) % 3]];
      const path = Array.from({ length: 49 }, (_, i) => {
        const angle = 2 * Math.PI * i / 48;
        return see(add(centre, times(add(times(u, Math.cos(angle)), times(v, Math.sin(angle))), RING * perPixel)));
      });
      return { kind: "turn", axis: k, path };
    });
  }
  const own = rotation(part.turn);
  return [0, 1, 2].flatMap(k => [1, -1].map(sign => {
    const out = apply(own, UNIT[k]), reach = part.size[k] / 2 * sign;
    return { kind: "size", axis: k, sign, at: see(toWorld(model, add(part.at, times(out, reach)))) };
  }));
}

export function drawHandles(context, handles, active) {
  context.lineCap = context.lineJoin = "round";
  const isActive = h => active && active.kind === h.kind && active.axis === h.axis && active.sign === h.sign;
  for (const handle of handles) {
    const tone = handle.axis === undefined ? "#ff9800" : `rgb(${AXES[handle.axis].join()})`;
    if (handle.path) {
      for (const [colour, width] of [["rgba(255,255,255,.85)", 6], [tone, isActive(handle) ? 4.5 : 3]]) {
        context.strokeStyle = colour;
        context.lineWidth = width;
        context.beginPath();
        handle.path.forEach((p, i) => context[i ? "lineTo" : "moveTo"](...p));
        context.stroke();
      }
    }
    if (handle.kind === "move") arrowHead(context, handle.path, tone, isActive(handle));
    if (handle.at) {
      const reach = isActive(handle) ? 8 : 6.5;
      context.fillStyle = tone;
      context.strokeStyle = "#fff";
      context.lineWidth = 2;
      context.beginPath();
      if (handle.kind === "slide") context.arc(...handle.at, reach, 0, 7);
      else context.roundRect(handle.at[0] - reach, handle.at[1] - reach, 2 * reach, 2 * reach, 3);
      context.fill();
      context.stroke();
    }
  }
}

function arrowHead(context, [from, to], tone, active) {
  const way = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(...way) || 1, [dx, dy] = way.map(c => c / length);
  const reach = Math.min(active ? 9 : 7.5, length / 2);
  context.fillStyle = tone;
  context.strokeStyle = "#fff";
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(to[0] + dx * reach, to[1] + dy * reach);
  context.lineTo(to[0] - dy * reach * 0.85 - dx * 3, to[1] + dx * reach * 0.85 - dy * 3);
  context.lineTo(to[0] + dy * reach * 0.85 - dx * 3, to[1] - dx * reach * 0.85 - dy * 3);
  context.closePath();
  context.fill();
  context.stroke();
}

/** The handle at a pixel, or null; `reach` is larger for fingers. */
export function handleAt(handles, [x, y], reach) {
  let best = null, least = reach;
  for (const handle of handles) {
    const points = handle.path ?? [handle.at];
    for (let i = 0; i < points.length; i++) {
      const gap = i ? toSegment([x, y], points[i - 1], points[i]) : Math.hypot(x - points[0][0], y - points[0][1]);
      // All arrows begin at the round handle, which has priority there.
      const far = handle.kind === "move" && i === 0 ? Infinity : handle.kind === "slide" ? gap - 5 : gap;
      if (far < least) { least = far; best = handle; }
    }
  }
  return best;
}

function toSegment([x, y], [ax, ay], [bx, by]) {
  const dx = bx - ax, dy = by - ay, t = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), s = Math.min(1, Math.max(0, t));
  return Math.hypot(x - ax - s * dx, y - ay - s * dy);
}

// --- drags -----------------------------------------------------------------------------------

/** Begins a drag; returns a function from a pixel to the changed part, or to null if the pixel gives none.
 *  `grabbed`: the point of the part under the pointer, when the part itself, not a handle, is dragged. */
export function beginDrag({ model, number, handle, camera, pixel, snap, grabbed }) {
  const part = JSON.parse(JSON.stringify(model.parts[number])), centre = toWorld(model, part.at), axes = axesOf(model);
  const near = 8 * project(camera, centre)[2] / camera.focal[0];
  const help = { part, model, number, near: snap ? near : 0 };
  if (handle.kind === "turn") return turning(help, handle.axis, axes[handle.axis], centre, camera, pixel, snap);
  if (handle.kind === "slide") {
    const point = grabbed ?? centre, start = meetPlane(rayThrough(camera, pixel), point, UNIT[2]);
    return to => {
      const now = start && meetPlane(rayThrough(camera, to), point, UNIT[2]);
      return now && moved(help, sub(toObject(model, now), toObject(model, start)), [0, 1]);
    };
  }
  const own = handle.kind === "size" ? apply(rotation(part.turn), UNIT[handle.axis]) : UNIT[handle.axis];
  const axis = apply(rotation([0, 0, model.turn]), own), point = grabbed ?? centre;
  const start = alongAxis(rayThrough(camera, pixel), point, axis);
  return to => {
    const now = start === null ? null : alongAxis(rayThrough(camera, to), point, axis);
    if (now === null) return null;
    if (handle.kind === "size") return resized(help, handle, own, now - start);
    return moved(help, times(own, now - start), [handle.axis]);
  };
}

function moved({ part, model, number, near }, by, along) {
  const at = add(part.at, by), draft = { ...part, at: at.map(c => clamp(c, -LIMITS.at, LIMITS.at)) };
  for (const k of along) draft.at[k] += snapOf(draft, model, number, k, near);
  return draft;
}

function resized({ part, model, number, near }, { axis, sign }, own, by) {
  const make = size => ({
    ...part, size: part.size.map((s, k) => k === axis ? size : s),
    at: add(part.at, times(own, sign * (size - part.size[axis]) / 2)),
  });
  let size = clamp(part.size[axis] + sign * by, 0.005, LIMITS.size);
  const straight = own.findIndex(c => Math.abs(c) > 0.9999);
  if (straight >= 0) {
    const upper = Math.sign(own[straight]) * sign > 0, side = upper ? "high" : "low";
    const shift = nearest(extent(placed(make(size)))[side][straight], levels(model, number, straight), near);
    size = clamp(size + (upper ? shift : -shift), 0.005, LIMITS.size);
  }
  return make(size);
}

function turning({ part }, k, axis, centre, camera, pixel, snap) {
  const angleAt = to => {
    const hit = meetPlane(rayThrough(camera, to), centre, axis), [x, y] = project(camera, centre);
    const facing = sub(rayThrough(camera, [x, y]).origin, centre), way = unit(facing);
    const open = way[0] * axis[0] + way[1] * axis[1] + way[2] * axis[2];
    if (hit && Math.abs(open) > 0.25) return arc(hit, centre, axis);
    return Math.atan2(to[1] - y, to[0] - x) * (open > 0 ? -1 : 1); // the ring is seen edge-on
  };
  const start = angleAt(pixel), before = rotation(part.turn);
  return to => {
    let angle = (angleAt(to) - start) * 180 / Math.PI;
    if (snap) angle = 5 * Math.round(angle / 5);
    const turned = multiply(about(UNIT[k], angle * Math.PI / 180), before);
    return { ...part, turn: anglesOf(turned).map(a => Math.round(a * 1e6) / 1e6 + 0) };
  };
}

function arc(point, centre, axis) {
  const u = unit(Math.abs(axis[2]) > 0.9 ? [axis[2], 0, -axis[0]] : [-axis[1], axis[0], 0]);
  const v = [axis[1] * u[2] - axis[2] * u[1], axis[2] * u[0] - axis[0] * u[2], axis[0] * u[1] - axis[1] * u[0]];
  const d = sub(point, centre), on = w => d[0] * w[0] + d[1] * w[1] + d[2] * w[2];
  return Math.atan2(on(v), on(u));
}


// --- snapping ----------------------------------------------------------------------------------

/** Coordinates along an axis to which a part snaps: the ground, and the sides of the other parts. */
function levels(model, number, k) {
  const list = k === 2 ? [0] : [];
  model.parts.forEach((other, i) => {
    if (i === number) return;
    const { low, high } = extent(placed(other));
    for (const [sx, sy] of copiesOf(other)) {
      const sign = [sx, sy, 1][k];
      list.push(sign * low[k], sign * high[k]);
    }
  });
  return list;
}

/** The shift from a value to the nearest level within `near`, or 0. */
function nearest(value, list, near) {
  let best = 0, least = near;
  for (const level of list) {
    if (Math.abs(level - value) < least) { least = Math.abs(level - value); best = level - value; }
  }
  return best;
}

function snapOf(part, model, number, k, near) {
  if (!near) return 0;
  const { low, high } = extent(placed(part)), list = levels(model, number, k);
  const shifts = [nearest(low[k], list, near), nearest(high[k], list, near), k < 2 ? nearest(part.at[k], [0], near) : 0].filter(Boolean);
  return shifts.sort((a, b) => Math.abs(a) - Math.abs(b))[0] ?? 0;
}

/** Height of the lowest point of a part. */
export const lowestPoint = part => extent(placed(part)).low[2];
