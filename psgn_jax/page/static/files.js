// Clouds as files, equal to those that psgn_jax.prediction.export writes.

const FRAME = "frame: right-handed, +z up, +y image right, +x to the camera; unit: bounding hemisphere";

function rows(points, line) {
  const out = [];
  for (let i = 0; i < points.length; i += 3) out.push(line(i, points[i].toFixed(6), points[i + 1].toFixed(6), points[i + 2].toFixed(6)));
  return out;
}

/** One line `x y z` for each point. */
export const xyz = points => rows(points, (_, x, y, z) => `${x} ${y} ${z}\n`).join("");

/** Vertices with colours, and one element of points. */
export function obj(points, colours) {
  const level = i => (colours[i] / 255).toFixed(4);
  const lines = rows(points, (i, x, y, z) => `v ${x} ${y} ${z} ${level(i)} ${level(i + 1)} ${level(i + 2)}`);
  return [`# ${FRAME}`, ...lines, `p ${lines.map((_, i) => i + 1).join(" ")}`, ""].join("\n");
}

/** Binary, little-endian: float x, y, z and uchar red, green, blue. */
export function ply(points, colours) {
  const count = points.length / 3;
  const head = new TextEncoder().encode([
    "ply", "format binary_little_endian 1.0", `comment ${FRAME}`, `element vertex ${count}`,
    ..."xyz".split("").map(name => `property float ${name}`),
    ...["red", "green", "blue"].map(name => `property uchar ${name}`), "end_header", "",
  ].join("\n"));
  const bytes = new Uint8Array(head.length + 15 * count), view = new DataView(bytes.buffer);
  bytes.set(head);
  for (let i = 0, at = head.length; i < count; i++, at += 15) {
    for (let k = 0; k < 3; k++) view.setFloat32(at + 4 * k, points[3 * i + k], true);
    for (let k = 0; k < 3; k++) bytes[at + 12 + k] = colours[3 * i + k];
  }
  return bytes;
}

/** Format -> [function of points and colours, media type]. */
export const FORMATS = {
  ply: [ply, "application/octet-stream"],
  obj: [obj, "text/plain"],
  xyz: [xyz, "text/plain"],
};
