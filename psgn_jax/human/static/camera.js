// Cameras: { focal: [fx, fy], skew, centre: [cx, cy], rotation, shift }, in pixels of a canvas.
// A point p of the record's frame is rotation p + shift in the camera's frame: x right, y down, z forward.

import { add, apply, cross, dot, times, transposed, unit, sub } from "./geometry.js";

/** The true camera of a record, for an image drawn with this scale at this corner of the canvas. */
export function recordCamera({ intrinsics: k, extrinsics: e }, scale, [left, top]) {
  return {
    focal: [k[0] * scale, k[4] * scale], skew: k[1] * scale, centre: [k[2] * scale + left, k[5] * scale + top],
    rotation: [e[0], e[1], e[2], e[4], e[5], e[6], e[8], e[9], e[10]], shift: [e[3], e[7], e[11]],
  };
}

/** A camera that looks at a target: `turn` is its azimuth from +x, `tilt` its elevation, both in radians. */
export function orbitCamera({ turn, tilt, distance, target }, width, height) {
  const forward = [-Math.cos(tilt) * Math.cos(turn), -Math.cos(tilt) * Math.sin(turn), -Math.sin(tilt)];
  const right = [-Math.sin(turn), Math.cos(turn), 0], focal = 1.75 * Math.min(width, height * 1.15);
  const axes = [...right, ...cross(forward, right), ...forward];
  return {
    focal: [focal, focal], skew: 0, centre: [width / 2, height / 2],
    rotation: axes, shift: add(times(apply(axes, target), -1), [0, 0, distance]),
  };
}

/** [column, row, depth] of a point. */
export function project({ focal, skew, centre, rotation, shift }, point) {
  const [x, y, z] = add(apply(rotation, point), shift);
  return [(focal[0] * x + skew * y) / z + centre[0], focal[1] * y / z + centre[1], z];
}

/** Origin and unit direction of the ray through a pixel. */
export function rayThrough({ focal, skew, centre, rotation, shift }, [column, row]) {
  const y = (row - centre[1]) / focal[1], x = (column - centre[0] - skew * y) / focal[0], back = transposed(rotation);
  return { origin: times(apply(back, shift), -1), direction: unit(apply(back, [x, y, 1])) };
}

/** Where a ray meets the plane through a point; null where it does not. */
export function meetPlane({ origin, direction }, point, normal) {
  const along = dot(direction, normal);
  if (Math.abs(along) < 1e-3) return null;
  const gap = sub(point, origin), t = dot(gap, normal) / along;
  return t > 0.05 && t < 60 ? add(origin, times(direction, t)) : null;
}

/** The coordinate along an axis (a unit vector through a point) nearest to a ray; null where they are almost parallel. */
export function alongAxis({ origin, direction }, point, axis) {
  const w = sub(point, origin), b = dot(axis, direction);
  const d = dot(axis, w), e = dot(direction, w);
  return 1 - b * b < 0.01 ? null : (b * e - d) / (1 - b * b);
}

const NEAR = 0.05, FAR = 60;
/** The matrix from the record's frame to WebGL's clip coordinates, column by column, for a canvas of this size. */
export function clipMatrix({ focal, skew, centre, rotation: r, shift }, width, height) {
  const rows = [0, 3, 6].map((at, k) => [r[at], r[at + 1], r[at + 2], shift[k]]), [x, y, z] = rows;
  const mix = (a, b, c) => [0, 1, 2, 3].map(k => a * x[k] + b * y[k] + c * z[k]);
  const out = [
    mix(2 * focal[0] / width, 2 * skew / width, 2 * centre[0] / width - 1),
    mix(0, -2 * focal[1] / height, 1 - 2 * centre[1] / height),
    mix(0, 0, (FAR + NEAR) / (FAR - NEAR)), z,
  ];
  out[2][3] -= 2 * FAR * NEAR / (FAR - NEAR);
  return new Float32Array([0, 1, 2, 3].flatMap(column => out.map(row => row[column])));
}
