// The mask of the object in a photo: from a file, or found like find_mask of psgn_jax.prediction.masks with the method "network".

import { sum } from "./draws.js";
import { PhotoError } from "./framing.js";
import { LANCZOS, resize } from "./resample.js";

export const MIN_SIDE = 16;
const LEAST_TRANSPARENT = 0.005, LEAST_AREA = 0.001, FEWEST = 64; // shares of the pixels; pixels
const ACCEPTED = "expected white on the object, black elsewhere";
const limited = (value, least, most) => Math.min(Math.max(value, least), most);

/** The object in the file of a mask, four bytes per pixel: what is opaque, or else the brighter one of two levels: { mask, with 1 on it, and doubt, a sentence or "" }. */
export function objectIn(rgba, width, height) {
  const count = width * height, alpha = Uint8Array.from({ length: count }, (_, i) => rgba[4 * i + 3]);
  const clear = alpha.filter(level => level < 128).length >= LEAST_TRANSPARENT * count;
  const light = i => Math.round(0.299 * rgba[4 * i] + 0.587 * rgba[4 * i + 1] + 0.114 * rgba[4 * i + 2]);
  const levels = clear ? alpha : Uint8Array.from({ length: count }, (_, i) => light(i)), counts = new Uint32Array(256);
  levels.forEach(level => { counts[level]++; });
  const low = counts.findIndex(n => n), high = counts.findLastIndex(n => n), place = level => (level - low) / (high - low);
  if (low === high) throw new PhotoError(high ? `The mask covers the whole image; ${ACCEPTED}.` : `The mask is empty; ${ACCEPTED}.`);
  const between = counts.filter((n, level) => n >= Math.max(FEWEST, LEAST_AREA * count) && Math.abs(place(level) - 0.5) < 0.4);
  if (between.length) throw new PhotoError(`The mask has more than two levels, as labels or a photograph; ${ACCEPTED}.`);
  const mask = levels.map(level => +(place(level) > 0.5)), border = [];
  for (let x = 0; x < width; x++) border.push(mask[x], mask[count - 1 - x]);
  for (let y = 1; y < height - 1; y++) border.push(mask[y * width], mask[(y + 1) * width - 1]);
  const covered = sum(border) / border.length, inverted = covered >= 0.9 || covered >= 0.5 && sum(mask) >= 0.85 * count;
  return { mask: inverted ? mask.map(v => 1 - v) : mask, doubt: inverted ? " The mask covered the border: it was inverted." : "" };
}

/** Values in [0, 1], or 0 and 1, resized: 1 where they exceed .5. */
function enlarged(values, width, height, outWidth, outHeight) {
  const levels = Uint8Array.from(values, v => Math.round(255 * v));
  return resize(levels, width, height, 1, outWidth, outHeight, [0, 0, width, height]).map(level => +(level > 127));
}

/** The part nearest to the middle of probabilities, or at `at` ([column, row]): 1 on its pixels. */
function partOf(p, side, at, { joined, least_part: leastPart, reach }) {
  const parts = new Int32Array(p.length), areas = [0], middle = at ? at.map(v => v - 0.5) : [(side - 1) / 2, (side - 1) / 2];
  p.forEach((value, start) => {
    if (value <= joined || parts[start]) return;
    const waiting = [start], number = areas.push(0) - 1;
    parts[start] = number;
    while (waiting.length) {
      const i = waiting.pop(), x = i % side, y = (i - x) / side;
      areas[number] += p[i] > 0.5;
      for (let v = Math.max(y - 1, 0); v <= Math.min(y + 1, side - 1); v++) {
        for (let u = Math.max(x - 1, 0); u <= Math.min(x + 1, side - 1); u++) {
          const j = v * side + u;
          if (p[j] <= joined || parts[j]) continue;
          parts[j] = number;
          waiting.push(j);
        }
      }
    }
  });
  const largest = areas.reduce((a, b) => Math.max(a, b));
  let nearest = Infinity, chosen = -1;
  p.forEach((value, i) => {
    const away = Math.hypot(i % side - middle[0], Math.floor(i / side) - middle[1]);
    const allowed = at ? away <= reach * side : areas[parts[i]] >= leastPart * largest;
    if (value > 0.5 && allowed && away < nearest) [nearest, chosen] = [away, parts[i]];
  });
  return Uint8Array.from(parts, number => +(number === chosen));
}

/** A box in a photo, [left, top, right, bottom], and the crops that the network sees. */
function crops(box, width, height, margins) {
  if (!box) return [[0, 0, width, height], [[0, 0, width, height]]];
  const [left, top] = box.slice(0, 2).map((v, i) => limited(Math.floor(v), 0, [width, height][i]));
  const [right, bottom] = box.slice(2).map((v, i) => limited(Math.ceil(v), 0, [width, height][i]));
  if (Math.min(right - left, bottom - top) < MIN_SIDE) throw new PhotoError(`The frame needs at least ${MIN_SIDE} pixels of the photo per side.`);
  return [[left, top, right, bottom], margins.map(margin => {
    const more = Math.round(margin * Math.max(right - left, bottom - top));
    return [Math.max(left - more, 0), Math.max(top - more, 0), Math.min(right + more, width), Math.min(bottom + more, height)];
  })];
}

/** Smaller crops around a point, within a crop. */
const windows = ([x, y], [left, top, right, bottom], shares) => shares.map(share => {
  const wide = Math.round(share * (right - left)), high = Math.round(share * (bottom - top));
  const u = limited(Math.round(x - wide / 2), left, right - wide), v = limited(Math.round(y - high / 2), top, bottom - high);
  return [u, v, u + wide, v + high];
});

/**
 * The mask of the object, Uint8Array with 1 on it, and its certainty in [0, 1]. `about` is `mask_network` in network.json,
 * `run` gives the network's probabilities for its input; a box [left, top, right, bottom] or a point [x, y] chooses the object.
 */
export async function findMask({ rgb, width, height }, about, run, { box, point } = {}) {
  const { side, mean, deviation } = about, [inside, seen] = crops(box, width, height, about.margins);
  let best = { mask: new Uint8Array(width * height), certainty: 0 };
  for (const region of [...seen, ...point ? windows(point, seen.at(-1), about.windows) : []]) {
    if (!seen.includes(region) && best.certainty) break;
    const [left, top, right, bottom] = region, wide = right - left, high = bottom - top;
    const small = resize(rgb, width, height, 3, side, side, region, LANCZOS), most = small.reduce((a, b) => Math.max(a, b), 1);
    const input = new Float32Array(3 * side * side).map((_, i) => {
      const channel = Math.floor(i / side / side);
      return (small[3 * (i % (side * side)) + channel] / most - mean[channel]) / deviation[channel];
    });
    let p = await run(input);
    if (box) { // averaged with the mirror image's
      const within = new Uint8Array(wide * high), at = (x, y) => (y - top) * wide + x - left;
      for (let y = inside[1]; y < inside[3]; y++) within.fill(1, at(inside[0], y), at(inside[2], y));
      const mirror = values => values.map((_, i) => values[i - 2 * (i % side) + side - 1]);
      const other = mirror(await run(mirror(input))), allowed = enlarged(within, wide, high, side, side);
      p = p.map((v, i) => (v + other[i]) / 2 * allowed[i]);
    }
    const part = partOf(p, side, point && [(point[0] - left) * side / wide, (point[1] - top) * side / high], about);
    if (!part.includes(1)) continue;
    const own = p.map((v, i) => v * part[i]), on = own.filter(v => v > 0.5), mask = new Uint8Array(width * height);
    const certainty = sum(on) / (on.length + sum(point ? own : p) - sum(on));
    if (certainty <= best.certainty) continue;
    enlarged(own, side, side, wide, high).forEach((v, i) => { mask[(top + Math.floor(i / wide)) * width + left + i % wide] = v; });
    best = { mask, certainty };
  }
  return best;
}
