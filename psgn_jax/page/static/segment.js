// Finds objects in photos: a plain background, a region of one colour, and GrabCut (Rother,
// Kolmogorov, Blake, "GrabCut", SIGGRAPH 2004) with strokes that mark object and background.

import { reduce, resize } from "./resample.js";
import { cut, directions } from "./maxflow.js";

const SEARCH_SIDE = 512; // `plain` works on a copy of at most this many pixels per side
const CUT_SIDE = 280; // the same for GrabCut
const SMALLEST = 0.0005, LARGEST = 0.97; // share of the photo that an object may cover
const COMPONENTS = 5, ROUNDS = 5, GAMMA = 50, BAND = 0.03, LEAST = 0.02;

/** Hints to GrabCut, one byte per pixel. */
export const HINT = { maybeBack: 0, maybeObject: 1, back: 2, object: 3 };

function small(photo, side) {
  const factor = Math.ceil(Math.max(photo.width, photo.height) / side);
  if (factor === 1) return photo;
  const { data, width, height } = reduce(photo.rgb, photo.width, photo.height, 3, factor, factor);
  return { rgb: data, width, height };
}

/** A mask at another size, with smooth edges if it is enlarged. */
export function resizeMask(mask, width, height, outWidth, outHeight) {
  if (width === outWidth && height === outHeight) return mask;
  const levels = resize(mask.map(m => 255 * m), width, height, 1, outWidth, outHeight);
  return levels.map(level => +(level > 127));
}

/** Whether the area of a mask is within the limits for an object. */
export function isPlausible(mask, smallest = SMALLEST) {
  let sum = 0;
  for (const m of mask) sum += m;
  return sum >= smallest * mask.length && sum <= LARGEST * mask.length;
}

function quantile(sorted, q) {
  const at = q * (sorted.length - 1), low = Math.floor(at);
  return sorted[low] + (at - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

/**
 * The pixels that differ from a background of one colour, or null if there is none.
 * As psgn_jax.data.masks.plain, but without its branch for JPEGs with an unshaded background.
 */
export function plain(photo) {
  const { rgb, width, height } = photo, border = [];
  for (let x = 0; x < width; x++) border.push(x, (height - 1) * width + x);
  for (let y = 1; y < height - 1; y++) border.push(y * width, y * width + width - 1);
  const colour = [0, 1, 2].map(c => {
    const values = border.map(i => rgb[3 * i + c]).sort((a, b) => a - b);
    return Math.trunc(quantile(values, 0.5));
  });
  const deviation = (of, i) => Math.max(...[0, 1, 2].map(c => Math.abs(of[3 * i + c] - colour[c])));
  const spread = quantile(border.map(i => deviation(rgb, i)).sort((a, b) => a - b), 0.97);
  if (spread <= 1) return Uint8Array.from({ length: width * height }, (_, i) => +(deviation(rgb, i) > 2));
  if (spread > 12) return null;
  const copy = small(photo, SEARCH_SIDE), w = copy.width, h = copy.height;
  const near = Uint8Array.from({ length: w * h }, (_, i) => +(deviation(copy.rgb, i) <= Math.min(2 * spread + 4, 24)));
  const starts = [];
  for (let i = 0; i < w * h; i++) {
    const x = i % w, y = (i - x) / w;
    if (near[i] && (x === 0 || y === 0 || x === w - 1 || y === h - 1)) starts.push(i);
  }
  const outside = connected(near, starts, w, h), mask = new Uint8Array(w * h);
  for (let y = 0; y < h; y++) {
    for (let x = 0; x < w; x++) { // the majority of nine pixels
      let count = 0;
      for (let dy = -1; dy <= 1; dy++) {
        for (let dx = -1; dx <= 1; dx++) {
          const row = Math.min(h - 1, Math.max(0, y + dy)), column = Math.min(w - 1, Math.max(0, x + dx));
          count += !outside[row * w + column];
        }
      }
      mask[y * w + x] = +(count > 4);
    }
  }
  return resizeMask(mask, w, h, width, height);
}

function connected(passable, starts, width, height) {
  const reached = new Uint8Array(width * height), stack = [];
  for (const i of starts) if (!reached[i]) { reached[i] = 1; stack.push(i); }
  while (stack.length) {
    const i = stack.pop(), x = i % width;
    const visit = j => { if (passable[j] && !reached[j]) { reached[j] = 1; stack.push(j); } };
    if (x > 0) visit(i - 1);
    if (x < width - 1) visit(i + 1);
    if (i >= width) visit(i - width);
    if (i < width * (height - 1)) visit(i + width);
  }
  return reached;
}

/** The connected region around column x, row y whose colours differ by at most `tolerance` from the colour there. */
export function region(photo, x, y, tolerance) {
  const { rgb, width, height } = photo, start = y * width + x;
  const passable = new Uint8Array(width * height);
  for (let i = 0; i < passable.length; i++) {
    let far = 0;
    for (let c = 0; c < 3; c++) far = Math.max(far, Math.abs(rgb[3 * i + c] - rgb[3 * start + c]));
    passable[i] = +(far <= tolerance);
  }
  return connected(passable, [start], width, height);
}

/** Hints without strokes: a band along the border is background, all other pixels may be object. */
export function bandHints(width, height) {
  const hints = new Uint8Array(width * height).fill(HINT.maybeObject);
  const down = Math.max(1, Math.round(BAND * height)), across = Math.max(1, Math.round(BAND * width));
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      if (y < down || x < across || y >= height - down || x >= width - across) hints[y * width + x] = HINT.back;
    }
  }
  return hints;
}

// --- mixtures of Gaussians in RGB ------------------------------------------------------------------

class Mixture {
  /** Fits a Gaussian to the listed pixels of each label from 0 to `COMPONENTS` - 1. */
  constructor(rgb, pixels, labels) {
    this.parts = [];
    for (let k = 0; k < COMPONENTS; k++) {
      const sum = [0, 0, 0], square = new Float64Array(9);
      let count = 0;
      for (let n = 0; n < pixels.length; n++) {
        if (labels[n] !== k) continue;
        const at = 3 * pixels[n];
        count++;
        for (let a = 0; a < 3; a++) {
          sum[a] += rgb[at + a];
          for (let b = 0; b < 3; b++) square[3 * a + b] += rgb[at + a] * rgb[at + b];
        }
      }
      if (!count) continue;
      const mean = sum.map(s => s / count);
      const m = Array.from(square, (s, i) => s / count - mean[Math.floor(i / 3)] * mean[i % 3]);
      for (let a = 0; a < 3; a++) m[4 * a] += 0.5; // never singular
      const minors = [0, 1, 2].map(a => [0, 1, 2].map(b => {
        const [r, s] = [0, 1, 2].filter(v => v !== a), [t, u] = [0, 1, 2].filter(v => v !== b);
        return (m[3 * r + t] * m[3 * s + u] - m[3 * r + u] * m[3 * s + t]) * ((a + b) % 2 ? -1 : 1);
      }));
      const determinant = m[0] * minors[0][0] + m[1] * minors[0][1] + m[2] * minors[0][2];
      const inverse = minors.flatMap((_, a) => [0, 1, 2].map(b => minors[b][a] / determinant));
      const weight = -Math.log(count / pixels.length) + 0.5 * Math.log(determinant);
      this.parts.push({ k, mean, inverse, weight });
    }
  }

  /** Cost of a pixel under the best component, and the number of that component. */
  cost(rgb, pixel) {
    let least = Infinity, best = 0;
    for (const { k, mean, inverse: v, weight } of this.parts) {
      const a = rgb[3 * pixel] - mean[0], b = rgb[3 * pixel + 1] - mean[1], c = rgb[3 * pixel + 2] - mean[2];
      const cost = weight + 0.5 * (a * (v[0] * a + 2 * v[1] * b + 2 * v[2] * c) + b * (v[4] * b + 2 * v[5] * c) + c * c * v[8]);
      if (cost < least) { least = cost; best = k; }
    }
    return { cost: least, part: best };
  }
}

/** Labels by k-means. The first centre starts at the mean, each further one at the pixel farthest from all previous centres. */
function clusters(rgb, pixels) {
  const far = (i, [r, g, b]) => (rgb[3 * i] - r) ** 2 + (rgb[3 * i + 1] - g) ** 2 + (rgb[3 * i + 2] - b) ** 2;
  const mean = list => [0, 1, 2].map(c => list.reduce((sum, i) => sum + rgb[3 * i + c], 0) / list.length);
  const centres = [mean(pixels)], labels = new Uint8Array(pixels.length);
  const least = Float64Array.from(pixels, i => far(i, centres[0]));
  while (centres.length < COMPONENTS) {
    let at = 0;
    for (let n = 0; n < pixels.length; n++) if (least[n] > least[at]) at = n;
    const i = pixels[at];
    centres.push([rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]]);
    for (let n = 0; n < pixels.length; n++) least[n] = Math.min(least[n], far(pixels[n], centres.at(-1)));
  }
  for (let round = 0; round < 8; round++) {
    const sums = centres.map(() => [0, 0, 0, 0]);
    for (let n = 0; n < pixels.length; n++) {
      const i = pixels[n];
      let best = 0;
      for (let k = 1; k < COMPONENTS; k++) if (far(i, centres[k]) < far(i, centres[best])) best = k;
      labels[n] = best;
      for (let c = 0; c < 3; c++) sums[best][c] += rgb[3 * i + c];
      sums[best][3]++;
    }
    sums.forEach((sum, k) => { if (sum[3]) centres[k] = [0, 1, 2].map(c => sum[c] / sum[3]); });
  }
  return labels;
}

/** Mixture of the given pixels, labelled by the mixture `before` of the previous round, or by k-means. */
function fit(rgb, pixels, before) {
  const labels = before ? Uint8Array.from(pixels, i => before.cost(rgb, i).part) : clusters(rgb, pixels);
  return new Mixture(rgb, pixels, labels);
}

// --- GrabCut -----------------------------------------------------------------------------------

/** The mask that GrabCut finds, or null if no pixel is left for the object or the background. Deterministic. */
export function grabCut(photo, hints) {
  const copy = small(photo, CUT_SIDE), { rgb, width, height } = copy, count = width * height;
  const given = smallHints(hints, photo, copy);
  const wide = width + 2, step = directions(wide);
  const links = smoothness(copy, wide, step);
  let inside = Uint8Array.from(given, hint => hint & 1), objects, backs;
  for (let round = 0; round < ROUNDS; round++) {
    const object = [], back = [];
    for (let i = 0; i < count; i++) (inside[i] ? object : back).push(i);
    if (!object.length || !back.length) return null;
    objects = fit(rgb, object, objects);
    backs = fit(rgb, back, backs);
    const terminal = new Float64Array(wide * (height + 2));
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const i = y * width + x, hint = given[i];
        terminal[(y + 1) * wide + x + 1] = hint === HINT.object ? 1e4 : hint === HINT.back ? -1e4
          : backs.cost(rgb, i).cost - objects.cost(rgb, i).cost;
      }
    }
    const side = cut(wide, height + 2, links.map(link => link.slice()), terminal);
    const now = inside.map((_, i) => side[(Math.floor(i / width) + 1) * wide + i % width + 1]);
    let changed = 0, size = 0;
    for (let i = 0; i < count; i++) {
      changed += now[i] !== inside[i];
      size += now[i];
    }
    if (round && size < LEAST * count) break; // the object would vanish: keep the previous mask
    inside = now;
    if (changed < count / 5000) break;
  }
  inside = largeParts(inside, given, width, height);
  return resizeMask(inside, width, height, photo.width, photo.height);
}

function smallHints(hints, photo, copy) {
  if (copy === photo) return hints;
  // A hint `object` or `back` on any of its pixels decides a reduced pixel; `object` is stronger.
  // Without such a hint, the majority of its pixels decides between `maybeObject` and `maybeBack`.
  const rank = [0, 1, 2, 3], factor = Math.ceil(Math.max(photo.width, photo.height) / CUT_SIDE);
  const out = new Uint8Array(copy.width * copy.height), votes = new Int32Array(out.length);
  for (let y = 0; y < photo.height; y++) {
    for (let x = 0; x < photo.width; x++) {
      const hint = hints[y * photo.width + x], i = Math.floor(y / factor) * copy.width + Math.floor(x / factor);
      if (hint >= HINT.back) out[i] = Math.max(out[i], rank[hint]);
      else votes[i] += hint ? 1 : -1;
    }
  }
  return out.map((hint, i) => hint || +(votes[i] > 0));
}

function smoothness({ rgb, width, height }, wide, step) {
  const links = step.map(() => new Float64Array(wide * (height + 2)));
  const difference = (i, j) => {
    let sum = 0;
    for (let c = 0; c < 3; c++) sum += (rgb[3 * i + c] - rgb[3 * j + c]) ** 2;
    return sum;
  };
  const visit = action => {
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        for (const [d, dx, dy] of [[4, 1, 0], [5, -1, 1], [6, 0, 1], [7, 1, 1]]) {
          if (x + dx < 0 || x + dx >= width || y + dy >= height) continue;
          action(y * width + x, (y + dy) * width + x + dx, (y + 1) * wide + x + 1, d, dx && dy);
        }
      }
    }
  };
  let sum = 0, pairs = 0;
  visit((i, j) => { sum += difference(i, j); pairs++; });
  const beta = sum ? pairs / (2 * sum) : 0;
  visit((i, j, at, d, diagonal) => {
    const weight = GAMMA * Math.exp(-beta * difference(i, j)) / (diagonal ? Math.SQRT2 : 1);
    links[d][at] = weight;
    links[7 - d][at + step[d]] = weight;
  });
  return links;
}

/** Removes parts smaller than a tenth of the largest one, unless a stroke marks them. */
function largeParts(inside, given, width, height) {
  const parts = [], seen = new Uint8Array(inside.length);
  for (let i = 0; i < inside.length; i++) {
    if (!inside[i] || seen[i]) continue;
    const part = connected(inside, [i], width, height);
    let size = 0, asked = false;
    for (let j = 0; j < part.length; j++) {
      if (!part[j]) continue;
      seen[j] = 1;
      size++;
      asked ||= given[j] === HINT.object;
    }
    parts.push({ part, size, asked });
    if (parts.length > 400) return inside; // noise: nothing is removed
  }
  const most = Math.max(0, ...parts.map(p => p.size)), out = new Uint8Array(inside.length);
  for (const { part, size, asked } of parts) {
    if (asked || size >= most / 10) for (let j = 0; j < part.length; j++) out[j] |= part[j];
  }
  return out;
}
