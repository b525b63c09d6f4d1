// Frames photos for a network and normalises its points, with the same results as the Python module
// psgn_jax.data.framing. Photos are { rgb, width, height }, with three bytes per pixel; masks are
// Uint8Array with 1 on the object. `about` is the content of network.json.

import { partners, sum } from "./draws.js";
import { resize } from "./resample.js";

/** An error whose message is for the user. */
export class PhotoError extends Error {}

/** 1 where the alpha of an image of four bytes per pixel is above a level; a loop, because every stroke begins with it. */
export function opaqueIn(rgba, level = 127) {
  const mask = new Uint8Array(rgba.length / 4);
  for (let i = 0; i < mask.length; i++) mask[i] = rgba[4 * i + 3] > level;
  return mask;
}

/** The object in an alpha channel, as by psgn_jax.prediction.masks: what is opaque or, of a glass, also what is faint. */
export function visibleIn(rgba) {
  const opaque = opaqueIn(rgba), faint = opaqueIn(rgba, 25);
  return sum(opaque) < 0.2 * sum(faint) ? faint : opaque;
}

/** Whether width x height has the proportions of the other size, up to one pixel or 1 %. */
export const sameProportions = (width, height, otherWidth, otherHeight) =>
  Math.abs(width * otherHeight / otherWidth - height) <= Math.max(1, 0.01 * height);

/** Whether a photo is framed like the training images: 4:3, with their grey along its border. */
function isFramed({ rgb, width, height }, { view_size: [viewHeight, viewWidth], background }) {
  if (!sameProportions(width, height, viewWidth, viewHeight)) return false;
  const border = [];
  for (let x = 0; x < width; x++) border.push(x, (height - 1) * width + x);
  for (let y = 0; y < height; y++) border.push(y * width, (y + 1) * width - 1);
  const grey = border.filter(i => [0, 1, 2].every(c => Math.abs(rgb[3 * i + c] - background) <= 1));
  return grey.length / border.length > 0.97;
}

/** [top, bottom, left, right] of a mask; bottom and right are excluded. */
function boxOf(mask, width) {
  const rows = [mask.indexOf(1), mask.lastIndexOf(1)].map(i => Math.floor(i / width));
  if (rows[1] < 0) throw new PhotoError("The mask is empty: paint over the object first.");
  const columns = new Uint8Array(width);
  for (let i = rows[0] * width; i < (rows[1] + 1) * width; i++) columns[i % width] |= mask[i];
  return [rows[0], rows[1] + 1, columns.indexOf(1), columns.lastIndexOf(1) + 1];
}

/** Scale and shift that place a box by the rule in an image of the rule's size: (column, row) becomes scale * (column, row) + shift. */
function ruleMove([top, bottom, left, right], rule) {
  const wide = right - left, high = bottom - top, power = rule.box_power;
  if (Math.max(wide, high) < rule.smallest_box) {
    throw new PhotoError(`The object is ${wide} x ${high} pixels; its longer side must have at least ${rule.smallest_box}.`);
  }
  const scale = ((wide / rule.box_width) ** power + (high / rule.box_height) ** power) ** (-1 / power);
  const row = rule.middle_row + rule.middle_row_per_width * wide * scale;
  return { scale, shift: [rule.middle_column - scale * (left + right) / 2, row - scale * (top + bottom) / 2] };
}

/** What the network sees of a photo: { rgb, mask, toView, placed }; `toView` maps the photo's pixels there, `placed` is false if it was framed already. */
export function place(photo, mask, about) {
  const { width, height } = photo, [viewHeight, viewWidth] = about.image_size, box = boxOf(mask, width), placed = !isFramed(photo, about);
  const toView = { scale: [viewWidth / width, viewHeight / height], shift: [0, 0] };
  if (placed) {
    const { scale, shift } = ruleMove(box, about.framing), factor = [viewWidth / about.view_size[1], viewHeight / about.view_size[0]];
    Object.assign(toView, { scale: factor.map(f => f * scale), shift: factor.map((f, i) => f * shift[i]) });
  }
  const view = move(photo, mask, toView, viewWidth, viewHeight, about.background);
  if (!view.mask.includes(1)) throw new PhotoError("The object is too thin: no pixel of it remains at the network's size.");
  return { ...view, toView, placed };
}

function move(photo, mask, { scale, shift }, outWidth, outHeight, grey) {
  const low = [0, 1].map(i => -shift[i] * (1 / scale[i]));
  const high = [outWidth, outHeight].map((size, i) => low[i] + size * (1 / scale[i]));
  const first = low.map(Math.floor), [width, height] = high.map((v, i) => Math.ceil(v) - first[i]);
  if (width * height > 2e8) throw new PhotoError("The object is too large and too thin to be framed.");
  const region = new Uint8Array(4 * width * height); // colour times mask, and the mask
  for (let y = Math.max(first[1], 0); y < Math.min(first[1] + height, photo.height); y++) {
    for (let x = Math.max(first[0], 0); x < Math.min(first[0] + width, photo.width); x++) {
      const from = y * photo.width + x, to = 4 * ((y - first[1]) * width + x - first[0]);
      if (mask[from]) region.set([photo.rgb[3 * from], photo.rgb[3 * from + 1], photo.rgb[3 * from + 2], 255], to);
    }
  }
  const box = [low[0] - first[0], low[1] - first[1], high[0] - first[0], high[1] - first[1]];
  const small = resize(region, width, height, 4, outWidth, outHeight, box);
  const rgb = new Uint8Array(3 * outWidth * outHeight).fill(grey), inside = new Uint8Array(outWidth * outHeight);
  for (let i = 0; i < inside.length; i++) {
    const alpha = small[4 * i + 3];
    if (alpha <= 127) continue;
    inside[i] = 1;
    for (let c = 0; c < 3; c++) rgb[3 * i + c] = Math.min(255, Math.trunc(255 * small[4 * i + c] / alpha));
  }
  return { rgb, mask: inside };
}

/** The values of an array whose rows have this many elements, with the elements of each row in reverse order. */
export const mirrored = (values, width, channels) =>
  values.map((_, i) => values[i - i % (width * channels) + (width - 1 - Math.floor(i / channels) % width) * channels + i % channels]);

/** The mean of a cloud and that of the mirror image, as by psgn_jax.prediction.refine: of matched points. */
export function meanWithMirror(points, other) {
  if (!points.every(Number.isFinite) || !other.every(Number.isFinite)) throw new Error("The network's weights are damaged.");
  const back = other.map((v, i) => i % 3 === 1 ? -v : v), result = Float32Array.from(points);
  partners(points, back, 1e-6).forEach((i, j) => {
    for (let k = 0; k < 3; k++) result[3 * i + k] = (points[3 * i + k] + back[3 * j + k]) / 2;
  });
  return result;
}

const squaredGap = (points, i, j) =>
  (points[3 * i] - points[3 * j]) ** 2 + (points[3 * i + 1] - points[3 * j + 1]) ** 2 + (points[3 * i + 2] - points[3 * j + 2]) ** 2;

/** Which points lie apart from all others: their fourth nearest neighbour is at more than 5 times the median of this distance, or of those above 0 if it is 0. */
export function findOutliers(points) {
  const count = points.length / 3, least = new Float64Array(5); // squared distances to the point itself and four neighbours
  const gaps = Float64Array.from({ length: count }, (_, i) => {
    least.fill(Infinity);
    for (let j = 0; j < count; j++) {
      const square = squaredGap(points, i, j);
      if (square < least[4]) least.fill(square, 4).sort();
    }
    return Math.sqrt(least[4]);
  });
  const middle = sorted => (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2, sorted = gaps.slice().sort();
  const median = middle(sorted) || middle(sorted.filter(gap => gap > 0)) || 0;
  return Array.from(gaps, gap => gap > 5 * median);
}

/** Clouds in normal form, { points, scale, shift }: lowest point at z = 0, radius 1; outliers do not count. */
export function normalForm(points, outlier) {
  const axes = [0, 1, 2].map(k => points.filter((_, i) => i % 3 === k && !outlier[Math.floor(i / 3)]));
  const [[lowX, highX], [lowY, highY], [lowZ]] = axes.map(values => [Math.min(...values), Math.max(...values)]);
  const shift = [(lowX + highX) / 2, (lowY + highY) / 2, lowZ];
  const scale = Math.max(...Array.from(axes[0], (x, i) => Math.hypot(x - shift[0], axes[1][i] - shift[1], axes[2][i] - shift[2]))) || 1;
  return { points: Float32Array.from(points, (v, i) => (v - shift[i % 3]) / scale), scale, shift };
}

/** [column, row, depth] of each point. */
export const project = (points, k, extrinsics) => Array.from({ length: points.length / 3 }, (_, i) => {
  const [x, y, z] = extrinsics.map(r => r[0] * points[3 * i] + r[1] * points[3 * i + 1] + r[2] * points[3 * i + 2] + r[3]);
  return [...k.slice(0, 2).map(row => (row[0] * x + row[1] * y + row[2] * z) / (z > 1e-3 ? z : 1)), z];
});

const RADIUS = 0.04, DEPTH_TOLERANCE = 0.08, UNSEEN = 150;

/** Three bytes for each point: the colour of the view at the point, or at the nearest visible point. */
export function coloursFromView(points, view, about) {
  const [height, width] = about.view_size, [h, w] = about.image_size, { intrinsics, extrinsics } = about.camera;
  const k = intrinsics.map((row, i) => row.map(v => v * [width / w, height / h, 1][i]));
  const colours = new Uint8Array(points.length).fill(UNSEEN), nearest = new Float64Array(width * height).fill(Infinity);
  const pixels = project(points, k, extrinsics).map(([column, row, depth]) => [Math.floor(column), Math.floor(row), depth]);
  for (const [column, row, depth] of pixels) {
    if (!(depth > 1e-3)) continue;
    const reach = k[0][0] * RADIUS / depth, most = Math.min(64, Math.trunc(reach)) + 1;
    for (let y = Math.max(0, row - most); y <= Math.min(height - 1, row + most); y++) {
      for (let x = Math.max(0, column - most); x <= Math.min(width - 1, column + most); x++) {
        if ((x - column) ** 2 + (y - row) ** 2 <= reach * reach) nearest[y * width + x] = Math.min(nearest[y * width + x], depth);
      }
    }
  }
  const seen = pixels.flatMap(([column, row, depth], i) => {
    const within = column >= 0 && row >= 0 && column < width && row < height, at = Math.floor(row * h / height) * w + Math.floor(column * w / width);
    if (!(depth > 1e-3) || !within || !view.mask[at] || depth > nearest[row * width + column] + DEPTH_TOLERANCE) return [];
    colours.set(view.rgb.subarray(3 * at, 3 * at + 3), 3 * i);
    return [i];
  });
  if (seen.length) pixels.forEach((_, i) => {
    const j = seen.reduce((a, b) => squaredGap(points, i, b) < squaredGap(points, i, a) ? b : a); // itself, if it is seen
    colours.copyWithin(3 * i, 3 * j, 3 * j + 3);
  });
  return colours;
}
