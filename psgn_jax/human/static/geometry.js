// Vectors, rotations, and primitives as meshes. psgn_jax.human.solids builds the same meshes.

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const clamp = (v, low, high) => Math.min(high, Math.max(low, v));
export const unit = a => times(a, 1 / (Math.hypot(...a) || 1));

/** Matrices are 9 numbers, row by row. */
export const apply = (m, v) => [0, 3, 6].map(r => m[r] * v[0] + m[r + 1] * v[1] + m[r + 2] * v[2]);
export const transposed = m => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
export function multiply(a, b) {
  return [0, 3, 6].flatMap(r => [0, 1, 2].map(c => a[r] * b[c] + a[r + 1] * b[c + 3] + a[r + 2] * b[c + 6]));
}

/** The rotation about an axis, a unit vector, by an angle in radians. */
export function about([x, y, z], angle) {
  const c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  return [
    c + x * x * d, x * y * d - z * s, x * z * d + y * s,
    x * y * d + z * s, c + y * y * d, y * z * d - x * s,
    x * z * d - y * s, y * z * d + x * s, c + z * z * d,
  ];
}

/** Rz Ry Rx of three angles in degrees. */
export function rotation(degrees) {
  const [x, y, z] = degrees.map(d => d * Math.PI / 180);
  return multiply(about([0, 0, 1], z), multiply(about([0, 1, 0], y), about([1, 0, 0], x)));
}

/** The angles of a rotation, in degrees: the inverse of `rotation`. */
export function anglesOf(m) {
  const upright = Math.abs(m[6]) > 0.9999999;
  const all = upright
    ? [Math.atan2(-m[5], m[4]), -Math.sign(m[6]) * Math.PI / 2, 0]
    : [Math.atan2(m[7], m[8]), Math.asin(-m[6]), Math.atan2(m[3], m[0])];
  return all.map(a => a * 180 / Math.PI);
}

// --- polygons --------------------------------------------------------------------------------

const area = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
const FLAT = 1e-12;

function isEar(polygon, left, at) {
  const n = left.length, corners = [left[(at + n - 1) % n], left[at], left[(at + 1) % n]];
  const [a, b, c] = corners.map(i => polygon[i]);
  if (!(area(a, b, c) > FLAT)) return false;
  return left.every(i => corners.includes(i)
    || area(a, b, polygon[i]) < 0 || area(b, c, polygon[i]) < 0 || area(c, a, polygon[i]) < 0);
}

/** Triangles of a simple polygon with counter-clockwise corners, by ear clipping; null if no ear is found. */
export function triangulate(polygon) {
  const left = polygon.map((_, i) => i), faces = [];
  while (left.length > 2) {
    const n = left.length, around = k => [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
    let at = left.findIndex((_, k) => isEar(polygon, left, k));
    if (at >= 0) faces.push(around(at));
    else at = left.findIndex((_, k) => Math.abs(area(...around(k).map(i => polygon[i]))) <= FLAT);
    if (at < 0) return null;
    left.splice(at, 1);
  }
  return faces;
}

/** Whether two edges of a polygon that are not neighbours cross or touch. */
export function crossesItself(polygon) {
  const n = polygon.length, ends = i => [polygon[i], polygon[(i + 1) % n]];
  for (let i = 0; i < n; i++) {
    for (let j = i + 2; j < n; j++) {
      if (i === 0 && j === n - 1) continue;
      const [a, b] = ends(i), [c, d] = ends(j);
      if (area(a, b, c) * area(a, b, d) <= 0 && area(c, d, a) * area(c, d, b) <= 0) return true;
    }
  }
  return false;
}

export const signedArea = polygon => polygon.reduce((sum, p, i) => {
  const q = polygon[(i + 1) % polygon.length];
  return sum + (p[0] * q[1] - p[1] * q[0]) / 2;
}, 0);

/** Moves and scales a polygon into [-1/2, 1/2] x [-1/2, 1/2]. */
export function normalised(polygon) {
  const spans = [0, 1].map(k => {
    const values = polygon.map(p => p[k]);
    return [Math.min(...values), Math.max(...values)];
  });
  return polygon.map(p => p.map((v, k) => (v - spans[k][0]) / (spans[k][1] - spans[k][0]) - 0.5));
}

// --- primitives ------------------------------------------------------------------------------

const ROUND = 32, RINGS = 16; // corners of a circle; rings of a sphere from pole to pole
export const KINDS = ["box", "cylinder", "cone", "sphere", "prism", "outline"];

function regular(sides) {
  return Array.from({ length: sides }, (_, i) => {
    const angle = Math.PI / 2 + 2 * Math.PI * i / sides;
    return [Math.cos(angle), Math.sin(angle)];
  });
}

/** The cross-section of a part, in [-1/2, 1/2] x [-1/2, 1/2]. */
export function crossSection(part) {
  if (part.kind === "box") return [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
  if (part.kind === "outline") return part.outline;
  return normalised(regular(part.kind === "prism" ? part.sides : ROUND));
}

/** A polygon extruded along z from -1/2 to 1/2; the upper end is scaled by `taper`, 0 = a tip. */
function extruded(polygon, taper, isRound) {
  const n = polygon.length, caps = triangulate(polygon) ?? [], tip = taper === 0;
  const vertices = polygon.map(([x, y]) => [x, y, -0.5]);
  if (tip) vertices.push([0, 0, 0.5]);
  else for (const [x, y] of polygon) vertices.push([x * taper, y * taper, 0.5]);
  const faces = caps.map(([a, b, c]) => [a, c, b]), edges = [];
  for (let i = 0; i < n; i++) {
    const j = (i + 1) % n;
    if (tip) faces.push([i, j, n]);
    else faces.push([i, j, n + j], [i, n + j, n + i]);
    edges.push([i, j]);
    if (!tip) edges.push([n + i, n + j]);
    if (!isRound || i % (ROUND / 4) === 0) edges.push([i, tip ? n : n + i]);
  }
  if (!tip) faces.push(...caps.map(face => face.map(i => n + i)));
  return { vertices, faces, edges };
}

function ball() {
  const vertices = [[0, 0, -0.5]], faces = [], edges = [];
  for (let i = 1; i < RINGS; i++) {
    const polar = Math.PI * i / RINGS - Math.PI / 2;
    for (let j = 0; j < ROUND; j++) {
      const angle = 2 * Math.PI * j / ROUND;
      vertices.push([0.5 * Math.cos(polar) * Math.cos(angle), 0.5 * Math.cos(polar) * Math.sin(angle), 0.5 * Math.sin(polar)]);
    }
  }
  vertices.push([0, 0, 0.5]);
  const last = vertices.length - 1, at = (i, j) => 1 + (i - 1) * ROUND + j % ROUND;
  for (let j = 0; j < ROUND; j++) {
    faces.push([0, at(1, j + 1), at(1, j)]);
    for (let i = 1; i < RINGS - 1; i++) {
      faces.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
    }
    faces.push([at(RINGS - 1, j), at(RINGS - 1, j + 1), last]);
    edges.push([at(RINGS / 2, j), at(RINGS / 2, j + 1)]);
  }
  for (let j = 0; j < ROUND; j += ROUND / 4) {
    edges.push([0, at(1, j)], [at(RINGS - 1, j), last]);
    for (let i = 1; i < RINGS - 1; i++) edges.push([at(i, j), at(i + 1, j)]);
  }
  return { vertices, faces, edges };
}

const solids = new Map();
/** The mesh of a part in its own frame, inside the cube of edge 1 about the origin; faces are counter-clockwise from outside. */
export function solid(part) {
  const key = JSON.stringify([part.kind, part.taper, part.sides, part.outline]);
  if (!solids.has(key)) {
    if (solids.size > 500) solids.clear();
    const isRound = part.kind === "cylinder" || part.kind === "cone";
    solids.set(key, part.kind === "sphere" ? ball() : extruded(crossSection(part), part.taper, isRound));
  }
  return solids.get(key);
}

/** Signs of x and y of each symmetric copy of a part; the first is the part itself. */
export function copiesOf(part) {
  const across = part.mirror.includes("x") ? [1, -1] : [1], along = part.mirror.includes("y") ? [1, -1] : [1];
  return along.flatMap(y => across.map(x => [x, y]));
}

/** Corners of a part in the object's frame. */
export function placed(part) {
  const turn = rotation(part.turn);
  return solid(part).vertices.map(v => add(apply(turn, v.map((c, k) => c * part.size[k])), part.at));
}

/** From the object's frame to the frame of the record: turned about the vertical, then moved. */
export const toWorld = (model, p) => add(apply(rotation([0, 0, model.turn]), p), [model.x, model.y, 0]);
export const toObject = (model, p) => apply(rotation([0, 0, -model.turn]), sub(p, [model.x, model.y, 0]));

/** Meshes of a model in the frame of the record, one for each part and symmetric copy. */
export function meshesOf(model) {
  return model.parts.flatMap((part, number) => {
    const { faces, edges } = solid(part), corners = placed(part);
    return copiesOf(part).map(([sx, sy], copy) => ({
      number, copy, part, edges,
      vertices: corners.map(([x, y, z]) => toWorld(model, [sx * x, sy * y, z])),
      faces: sx * sy > 0 ? faces : faces.map(([a, b, c]) => [a, c, b]),
    }));
  });
}

/** Lowest and highest coordinates of points. */
export function extent(points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const p of points) {
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], p[k]);
      high[k] = Math.max(high[k], p[k]);
    }
  }
  return { low, high };
}

/** A model as the text of an OBJ file. */
export function objText(model, name) {
  const lines = [`# ${name}`, "# frame: right-handed, +z up, +y image right, +x to the camera; unit: bounding hemisphere"];
  let first = 1;
  for (const { number, copy, part, vertices, faces } of meshesOf(model)) {
    lines.push(`o ${part.kind}-${number + 1}${copy ? `-copy-${copy}` : ""}`);
    for (const v of vertices) lines.push(`v ${v.map(c => c.toFixed(6)).join(" ")}`);
    for (const f of faces) lines.push(`f ${f.map(i => i + first).join(" ")}`);
    first += vertices.length;
  }
  return lines.join("\n") + "\n";
}
