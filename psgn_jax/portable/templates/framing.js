// Frames photos for a network and normalises its points, with the same results as the Python module
// psgn_jax.data.framing. Photos are { rgb, width, height }, with three bytes per pixel; masks are
// Uint8Array with 1 on the object. `about` is the content of network.json.

import { areaAverage, reduce, resize } from "./resample.js";

/** An error whose message is for the user. */
export class PhotoError extends Error {}

/** Whether width x height has the proportions of the other size, up to one pixel or 1 %. */
export function sameProportions(width, height, otherWidth, otherHeight) {
  return Math.abs(width * otherHeight / otherWidth - height) <= Math.max(1, 0.01 * height);
}

/** Whether a photo is framed like the training images: 4:3, with their grey along its border. */
export function isFramed(photo, about) {
  const { rgb, width, height } = photo, [viewHeight, viewWidth] = about.view_size;
  if (!sameProportions(width, height, viewWidth, viewHeight)) return false;
  let near = 0, count = 0;
  const look = (x, y) => {
    let off = 0;
    for (let c = 0; c < 3; c++) off = Math.max(off, Math.abs(rgb[3 * (y * width + x) + c] - about.background));
    near += off <= 1;
    count++;
  };
  for (let x = 0; x < width; x++) { look(x, 0); look(x, height - 1); }
  for (let y = 0; y < height; y++) { look(0, y); look(width - 1, y); }
  return near / count > 0.97;
}

/** [top, bottom, left, right] of a mask; bottom and right are excluded. */
export function boxOf(mask, width, height) {
  let top = height, bottom = 0, left = width, right = 0;
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      if (!mask[y * width + x]) continue;
      if (y < top) top = y;
      bottom = y + 1;
      if (x < left) left = x;
      if (x >= right) right = x + 1;
    }
  }
  if (!bottom) throw new PhotoError("The mask is empty: paint the object first.");
  return [top, bottom, left, right];
}

/** Scale and shift that place a box by the rule: (column, row) becomes scale * (column, row) + shift. */
export function ruleMove([top, bottom, left, right], rule) {
  const wide = right - left, high = bottom - top, power = rule.box_power;
  const scale = ((wide / rule.box_width) ** power + (high / rule.box_height) ** power) ** (-1 / power);
  const row = rule.middle_row + rule.middle_row_per_width * wide * scale;
  return {
    scale: [scale, scale],
    shift: [rule.middle_column - scale * (left + right) / 2, row - scale * (top + bottom) / 2],
  };
}

/**
 * The framed view of a photo, 192x256 pixels: { rgb, mask, toView, placed }. `toView` maps photo
 * pixels to view pixels; `placed` is false if the photo was framed already.
 */
export function place(photo, mask, about) {
  const { width, height } = photo, [viewHeight, viewWidth] = about.view_size;
  const box = boxOf(mask, width, height), placed = !isFramed(photo, about);
  let move = { scale: [viewWidth / width, viewHeight / height], shift: [0, 0] };
  if (placed) {
    const wide = box[3] - box[2], high = box[1] - box[0], least = about.framing.smallest_box;
    if (Math.max(wide, high) < least) {
      throw new PhotoError(`The object is ${wide} x ${high} pixels; its longer side must have at least ${least}.`);
    }
    move = ruleMove(box, about.framing);
  }
  const view = moveImage(photo, mask, move, viewWidth, viewHeight, about.background);
  if (!view.mask.includes(1)) throw new PhotoError("The object is too thin: no pixel of it remains at the network's size.");
  return { ...view, toView: move, placed };
}

function moveImage(photo, mask, move, outWidth, outHeight, grey) {
  const factor = move.scale.map(s => 1 / s);
  const low = [0, 1].map(i => -move.shift[i] * factor[i]);
  const high = [outWidth, outHeight].map((size, i) => (size - move.shift[i]) * factor[i]);
  const first = low.map(Math.floor), last = high.map(Math.ceil);
  // Only pixels on the mask count. Four channels: colour times mask, and the mask.
  const width = last[0] - first[0], height = last[1] - first[1];
  if (width * height > 2e8) throw new PhotoError("The object is too large and too thin to be framed.");
  const region = new Uint8Array(4 * width * height);
  const top = Math.max(first[1], 0), bottom = Math.min(last[1], photo.height);
  const left = Math.max(first[0], 0), right = Math.min(last[0], photo.width);
  for (let y = top; y < bottom; y++) {
    for (let x = left; x < right; x++) {
      const from = y * photo.width + x;
      if (!mask[from]) continue;
      const to = 4 * ((y - first[1]) * width + x - first[0]);
      for (let c = 0; c < 3; c++) region[to + c] = photo.rgb[3 * from + c];
      region[to + 3] = 255;
    }
  }
  const box = [low[0] - first[0], low[1] - first[1], high[0] - first[0], high[1] - first[1]];
  const small = resize(region, width, height, 4, outWidth, outHeight, box);
  const rgb = new Uint8Array(3 * outWidth * outHeight).fill(grey), inside = new Uint8Array(outWidth * outHeight);
  for (let i = 0; i < inside.length; i++) {
    const alpha = small[4 * i + 3];
    if (alpha <= 127) continue;
    inside[i] = 1;
    for (let c = 0; c < 3; c++) {
      const value = small[4 * i + c];
      rgb[3 * i + c] = alpha === 255 ? value : Math.min(255, Math.trunc(255 * value / alpha));
    }
  }
  return { rgb, mask: inside };
}

/** A view at the network's image size: { image, mask }, for its inputs with these names. */
export function networkInputs(view, about) {
  const [height, width] = about.view_size, [outHeight, outWidth] = about.image_size;
  if (outHeight === height && outWidth === width) return { image: view.rgb, mask: view.mask };
  const down = Math.floor(height / outHeight), across = Math.floor(width / outWidth);
  if (down * outHeight === height && across * outWidth === width) {
    const levels = view.mask.map(m => 255 * m);
    return {
      image: reduce(view.rgb, width, height, 3, across, down).data,
      mask: reduce(levels, width, height, 1, across, down).data.map(level => +(level > 127)),
    };
  }
  const image = areaAverage(view.rgb, width, height, 3, outWidth, outHeight);
  const mask = areaAverage(view.mask, width, height, 1, outWidth, outHeight);
  return {
    image: Uint8Array.from(image, Math.round),
    mask: Uint8Array.from(mask, level => +(level > 0.5 - 1e-6)),
  };
}

/** A cloud in normal form, { points, scale, shift }: lowest point at z = 0, radius 1. */
export function normalForm(points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i++) {
    low[i % 3] = Math.min(low[i % 3], points[i]);
    high[i % 3] = Math.max(high[i % 3], points[i]);
  }
  const shift = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]];
  let far = 0;
  for (let i = 0; i < points.length; i += 3) {
    far = Math.max(far, Math.hypot(points[i] - shift[0], points[i + 1] - shift[1], points[i + 2] - shift[2]));
  }
  const scale = far || 1;
  return { points: Float32Array.from(points, (v, i) => (v - shift[i % 3]) / scale), scale, shift };
}

const RADIUS = 0.04, DEPTH_TOLERANCE = 0.08, UNSEEN = 150;

/** Colours of the points that are visible in the view, three bytes each; grey for the others. */
export function coloursFromView(points, view, about) {
  const [height, width] = about.view_size, { intrinsics: k, extrinsics: e } = about.camera;
  const count = points.length / 3, colours = new Uint8Array(3 * count).fill(UNSEEN);
  const column = new Float64Array(count), row = new Float64Array(count), depth = new Float64Array(count);
  for (let i = 0; i < count; i++) {
    const [x, y, z] = points.subarray(3 * i, 3 * i + 3);
    const [cx, cy, cz] = e.map(r => r[0] * x + r[1] * y + r[2] * z + r[3]);
    depth[i] = cz;
    column[i] = Math.floor((k[0][0] * cx + k[0][1] * cy + k[0][2] * cz) / cz);
    row[i] = Math.floor((k[1][0] * cx + k[1][1] * cy + k[1][2] * cz) / cz);
  }
  const nearest = new Float64Array(width * height).fill(Infinity);
  for (let i = 0; i < count; i++) {
    if (!(depth[i] > 1e-3)) continue;
    const reach = k[0][0] * RADIUS / depth[i], most = Math.min(64, Math.trunc(reach)) + 1;
    for (let dy = -most; dy <= most; dy++) {
      for (let dx = -most; dx <= most; dx++) {
        const x = column[i] + dx, y = row[i] + dy;
        if (dx * dx + dy * dy > reach * reach || x < 0 || y < 0 || x >= width || y >= height) continue;
        nearest[y * width + x] = Math.min(nearest[y * width + x], depth[i]);
      }
    }
  }
  for (let i = 0; i < count; i++) {
    const inside = column[i] >= 0 && row[i] >= 0 && column[i] < width && row[i] < height;
    if (!(depth[i] > 1e-3) || !inside) continue;
    const at = row[i] * width + column[i];
    if (!view.mask[at] || depth[i] > nearest[at] + DEPTH_TOLERANCE) continue;
    for (let c = 0; c < 3; c++) colours[3 * i + c] = view.rgb[3 * at + c];
  }
  return colours;
}
