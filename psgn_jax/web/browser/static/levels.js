// The object in the file of a mask: what is opaque, or else the brighter one of two levels. The page shows the mask over the photo.

import { sum } from "./draws.js";
import { PhotoError } from "./framing.js";

const LEAST_TRANSPARENT = 0.005, LEAST_AREA = 0.001, FEWEST = 64; // shares of the pixels; pixels
const ACCEPTED = "expected white on the object, black elsewhere";

/** The object in four bytes per pixel: { mask, with 1 on it, and doubt, a sentence or "" }. */
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
