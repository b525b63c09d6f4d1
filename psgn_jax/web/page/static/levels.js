// The object in the file of a mask, by the rule of the Python module psgn_jax.data.mask_levels.

import { PhotoError } from "./framing.js";
import { resize } from "./resample.js";

const SIDE = 512, LEAST_AREA = 0.001, FEW = 16, STEP = 0.02, OUTSIDE = 0.1, LEAST_SHARE = 2e-4, MANY = 64;
const NEAR = 0.25, OFF = 0.5, MOST_BETWEEN = 0.17, MOST_DIFFERENT = 0.12, BLURS = [2, 4, 8, 16, 32];
const LEAST_TRANSPARENT = 0.005;
const ACCEPTED = "expected white on the object, black elsewhere";
const largest = values => values.reduce((a, b) => Math.max(a, b)), smallest = values => values.reduce((a, b) => Math.min(a, b));
const sum = values => values.reduce((a, b) => a + b, 0);

/** Colours at regular distances, at most SIDE a side: { pixels: [[r, g, b], ...], w, h }. */
function sample(colour, width, height) {
  const [w, h] = [Math.min(width, SIDE), Math.min(height, SIDE)];
  const along = (i, n, all) => Math.floor((i + 0.5) * all / n);
  return { w, h, pixels: Array.from({ length: w * h }, (_, i) => colour(along(Math.floor(i / w), h, height) * width + along(i % w, w, width))) };
}

/** The numbers of the pixels' levels, and the levels' colours. */
function numbered(pixels) {
  const numbers = new Map(), levels = [];
  const codes = pixels.map(pixel => {
    const code = (pixel[0] << 16) + (pixel[1] << 8) + pixel[2];
    if (!numbers.has(code)) numbers.set(code, levels.push(pixel) - 1);
    return numbers.get(code);
  });
  return { codes, levels };
}

/** The smallest and the largest values in windows of `side` pixels, which end at the border. */
function extremes(values, w, h, side) {
  const reach = side >> 1, pass = (from, pick, step, index, size) => from.map((_, i) => {
    const at = index(i), found = [];
    for (let k = Math.max(-reach, -at); k <= Math.min(reach, size - 1 - at); k++) found.push(from[i + k * step]);
    return pick(found);
  });
  return [smallest, largest].map(pick => pass(pass(values, pick, 1, i => i % w, w), pick, w, i => Math.floor(i / w), h));
}

/** Calls act(one, other) for all neighbours in different levels, in both orders. */
function neighbours(codes, w, act) {
  codes.forEach((code, i) => {
    for (const j of [...(i % w ? [i - 1] : []), ...(i >= w ? [i - w] : [])]) {
      if (codes[j] === code) continue;
      act(code, codes[j]);
      act(codes[j], code);
    }
  });
}

const apart = (one, other) => largest(one.map((v, c) => Math.abs(v - other[c])));
const light = ([r, g, b]) => 0.299 * r + 0.587 * g + 0.114 * b;

/** The place of a colour between two, 0 to 1, and its distance from their line. */
function between(colour, low, high) {
  const axis = high.map((v, c) => v - low[c]), moved = colour.map((v, c) => v - low[c]);
  const place = sum(moved.map((v, c) => v * axis[c])) / sum(axis.map(v => v * v));
  return [place, largest(moved.map((v, c) => Math.abs(v - place * axis[c]))) / largest(axis.map(Math.abs))];
}

/** The share of pixels between the levels; 0 if they are those of soft edges. */
function shareBetween(places, w, h) {
  const place = places.map(([v]) => v), inside = place.map(v => +(v > 0.5)), [lowest, highest] = extremes(place, w, h, 5);
  const near = places.map(([v, off], i) => Math.abs(v - inside[i]) <= NEAR && off <= OFF);
  const unclear = near.flatMap((v, i) => !v && (lowest[i] > NEAR || highest[i] < 1 - NEAR) ? [i] : []), on = sum(inside);
  if (unclear.length <= MOST_BETWEEN * Math.min(on, inside.length - on)) return 0;
  const picture = Uint8Array.from(inside, v => 255 * v);
  const differences = BLURS.map(factor => {
    const size = [Math.ceil(w / factor), Math.ceil(h / factor)], small = resize(picture, w, h, 1, ...size, [0, 0, w, h]);
    const soft = resize(small, ...size, 1, w, h, [0, 0, ...size]);
    return sum(unclear.map(i => Math.max(Math.abs(soft[i] / 255 - place[i]), places[i][1]))) / unclear.length;
  });
  return smallest(differences) > MOST_DIFFERENT ? near.filter(v => !v).length / near.length : 0;
}

/** The object in four bytes per pixel: { mask, with 1 on it, and doubt, a sentence or "" }. */
export function objectIn(rgba, width, height) {
  const count = width * height, opaque = i => rgba[4 * i + 3] > 127, rgb = i => [rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]];
  let colour = rgb, clear = 0;
  for (let i = 0; i < count; i++) clear += rgba[4 * i + 3] < 128;
  if (clear >= LEAST_TRANSPARENT * count) {
    const shown = sample(i => (opaque(i) ? rgb(i) : null), width, height).pixels.filter(Boolean), { levels } = numbered(shown);
    const labelled = levels.length > 1 && levels.length <= FEW && levels.every(level => largest(level));
    colour = labelled ? i => (opaque(i) ? rgb(i) : [0, 0, 0]) : i => Array(3).fill(rgba[4 * i + 3]);
  }
  const { pixels, w, h } = sample(colour, width, height), { codes, levels } = numbered(pixels);
  if (levels.length === 1) throw new PhotoError(largest(levels[0]) ? `The mask covers the whole image; ${ACCEPTED}.` : `The mask is empty; ${ACCEPTED}.`);
  const counts = levels.map(() => 0), area = levels.map(() => 0), pairs = levels.map(() => 0), sharp = levels.map(() => 0);
  const [lowest, highest] = extremes(codes, w, h, 3), all = levels.flat(), step = STEP * (largest(all) - smallest(all));
  codes.forEach((code, i) => { counts[code]++; area[code] += lowest[i] === highest[i]; });
  neighbours(codes, w, (one, other) => { pairs[one]++; sharp[one] += apart(levels[one], levels[other]) > step; });
  const own = levels.map((_, i) => area[i] >= LEAST_AREA * codes.length && (levels.length <= FEW || sharp[i] >= 0.5 * pairs[i]));
  const lights = levels.map(light), mine = own.flatMap((v, i) => v ? [i] : []);
  const one = mine[0] ?? lights.indexOf(smallest(lights)), distance = levels.map(level => apart(level, levels[one]));
  const [low, high] = [one, mine[1] ?? distance.indexOf(largest(distance))].sort((a, b) => lights[a] - lights[b]).map(i => levels[i]);
  if (levels.length <= FEW) levels.forEach((level, i) => {
    const [place, off] = between(level, low, high);
    own[i] ||= (place < -OUTSIDE || place > 1 + OUTSIDE || off > OUTSIDE) && counts[i] >= LEAST_SHARE * codes.length;
  });
  const kept = own.flatMap((v, i) => v ? [i] : []), of = test => kept.filter(i => test(String(levels[i])));
  const outline = levels.every(([r, g, b]) => r === g && g === b) ? "255,255,255" : "224,224,192"; // of PASCAL VOC
  const [voids, empty] = [of(name => name === outline), of(name => name === "0,0,0")], rest = kept.filter(i => !voids.includes(i) && !empty.includes(i));
  if (voids.length === 1 && empty.length === 1 && rest.length === 1 && counts[voids[0]] <= 2 * counts[rest[0]]) {
    const beside = levels.map(() => 0);
    neighbours(codes, w, (a, b) => { if (a === rest[0]) beside[b]++; });
    if (beside[empty[0]] < 0.2 * beside[voids[0]]) {
      const wanted = String(levels[rest[0]]);
      return { mask: Uint8Array.from({ length: count }, (_, i) => +(String(colour(i)) === wanted)), doubt: " A white outline in the mask was taken as no part of the object." };
    }
  }
  const share = shareBetween(pixels.map(pixel => between(pixel, low, high)), w, h), refused = share || kept.length > 2;
  if (refused && levels.length > MANY) throw new PhotoError(`The mask looks like a photograph; ${ACCEPTED}.`);
  if (refused) throw new PhotoError(`The mask has ${levels.length} colours; expected two, for the object and the rest.`);
  const mask = new Uint8Array(count), border = [];
  for (let i = 0; i < count; i++) mask[i] = between(colour(i), low, high)[0] > 0.5;
  for (let x = 0; x < width; x++) border.push(mask[x], mask[count - 1 - x]);
  for (let y = 1; y < height - 1; y++) border.push(mask[y * width], mask[(y + 1) * width - 1]);
  const covered = sum(border) / border.length, inverted = covered >= 0.9 || covered >= 0.5 && sum(mask) >= 0.85 * count;
  return { mask: inverted ? mask.map(v => 1 - v) : mask, doubt: inverted ? " The mask covered the border: it was inverted." : "" };
}
