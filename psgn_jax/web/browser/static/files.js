// Clouds as files, equal to those that psgn_jax.prediction.formats writes.

const FRAME = "frame: right-handed, +z up, +y image right, +x to the camera; unit: bounding hemisphere";
const rows = points => Array.from({ length: points.length / 3 }, (_, i) => [0, 1, 2].map(k => points[3 * i + k].toFixed(6)).join(" "));

function obj(points, colours) {
  const lines = rows(points).map((row, i) => `v ${row} ${[0, 1, 2].map(c => (colours[3 * i + c] / 255).toFixed(4)).join(" ")}`);
  return [`# ${FRAME}`, ...lines, `p ${lines.map((_, i) => i + 1).join(" ")}`, ""].join("\n");
}

function ply(points, colours) {
  const count = points.length / 3, properties = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"];
  const head = new TextEncoder().encode(`ply\nformat binary_little_endian 1.0\ncomment ${FRAME}\nelement vertex ${count}\n`
    + properties.map(each => `property ${each}\n`).join("") + "end_header\n");
  const bytes = new Uint8Array(head.length + 15 * count), view = new DataView(bytes.buffer);
  bytes.set(head);
  for (let i = 0, at = head.length; i < count; i++, at += 15) {
    for (let k = 0; k < 3; k++) view.setFloat32(at + 4 * k, points[3 * i + k], true);
    bytes.set(colours.subarray(3 * i, 3 * i + 3), at + 12);
  }
  return bytes;
}

/** Format -> function of points and colours. */
export const FORMATS = { ply, obj, xyz: points => rows(points).join("\n") + "\n" };
