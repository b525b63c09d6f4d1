// An outline: points that are clicked in a plane of the object, and then extruded.

import { crossesItself, normalised, signedArea, sub, toObject, toWorld, triangulate } from "./geometry.js";
import { meetPlane, project, rayThrough } from "./camera.js";
import { LIMITS } from "./study.js";

/** Plane -> its normal, the two coordinates in it, and the angles that turn the part's z axis to the normal. */
const PLANES = {
  x: { normal: [1, 0, 0], along: [1, 2], turn: [90, 0, 90] },
  y: { normal: [0, 1, 0], along: [0, 2], turn: [90, 0, 0] },
  z: { normal: [0, 0, 1], along: [0, 1], turn: [0, 0, 0] },
};
const CLOSE = 12, THICK = 0.08;

export class Outline {
  /** `depth`: coordinate of the plane along its normal, in the object's frame. */
  constructor(plane, depth) {
    Object.assign(this, PLANES[plane], { plane, depth, points: [], cursor: null });
  }

  /** Where the ray through a pixel meets the plane, in the object's frame. */
  meet(model, camera, pixel) {
    const point = toWorld(model, this.normal.map(c => c * this.depth));
    const normal = sub(toWorld(model, this.normal), toWorld(model, [0, 0, 0]));
    const hit = meetPlane(rayThrough(camera, pixel), point, normal);
    return hit && toObject(model, hit).map(c => Math.min(2, Math.max(-2, c)));
  }

  /** Adds a point; returns whether the click closed the outline. */
  click(model, camera, pixel) {
    const first = this.points[0] && project(camera, toWorld(model, this.points[0]));
    if (this.points.length > 2 && Math.hypot(first[0] - pixel[0], first[1] - pixel[1]) < CLOSE) return true;
    const hit = this.meet(model, camera, pixel);
    if (hit && this.points.length < LIMITS.corners) this.points.push(hit);
    return false;
  }

  /** The extruded part. Throws an `Error` with one sentence if the points are not an outline. */
  part() {
    return extrudedPart(this.points.map(p => this.along.map(k => p[k])), (u, v) => {
      const at = [0, 0, 0];
      at[this.along[0]] = u;
      at[this.along[1]] = v;
      at["xyz".indexOf(this.plane)] = this.depth;
      return at;
    }, this.turn);
  }

  draw(context, model, camera) {
    const see = p => project(camera, toWorld(model, p)), path = [...this.points, ...(this.cursor ? [this.cursor] : [])].map(see);
    context.lineJoin = "round";
    for (const [colour, width] of [["rgba(255,255,255,.9)", 5], ["#ff9800", 2.5]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      path.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](x, y));
      context.stroke();
    }
    this.points.map(see).forEach(([x, y], i) => {
      context.fillStyle = i ? "#ff9800" : "#fff";
      context.strokeStyle = i ? "#fff" : "#ff9800";
      context.lineWidth = 2.5;
      context.beginPath();
      context.arc(x, y, i ? 4.5 : 6.5, 0, 7);
      context.fill();
      context.stroke();
    });
  }
}

/** A part from corners in a plane; `place` maps the middle of their bounding box to a position. */
export function extrudedPart(corners, place, turn, thickness = THICK) {
  if (corners.length < 3) throw new Error("An outline needs at least three points.");
  if (corners.length > LIMITS.corners) throw new Error(`An outline can have at most ${LIMITS.corners} points.`);
  if (crossesItself(corners)) throw new Error("The outline crosses itself; draw it without crossings.");
  const ordered = signedArea(corners) < 0 ? [...corners].reverse() : corners;
  const spans = [0, 1].map(k => ordered.map(p => p[k])).map(values => [Math.min(...values), Math.max(...values)]);
  const [width, height] = spans.map(([low, high]) => high - low);
  if (width < 0.005 || height < 0.005) throw new Error("The outline is too narrow; draw it wider.");
  const outline = normalised(ordered).map(p => p.map(c => Math.round(c * 1e5) / 1e5));
  if (crossesItself(outline) || !triangulate(outline)) throw new Error("The outline has points that are too near each other.");
  return {
    kind: "outline", size: [width, height, thickness], at: place(...spans.map(([low, high]) => (low + high) / 2)),
    turn: [...turn], mirror: "", taper: 1, sides: 3, outline,
  };
}
