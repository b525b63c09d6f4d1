// Fits clouds to the mask of their image, with the same result as the Python module
// psgn_jax.prediction.silhouette, up to rounding. Pixels are pairs [column, row].

import { project } from "./framing.js";

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const squared = (a, b) => (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2;
const average = values => values.reduce((a, b) => a + b, 0) / values.length;

/**
 * The clouds of an image (arrays of coordinates) fitted to the mask of the network's input, and the camera that sees
 * them: { clouds, camera }. The last argument is the content of network.json. If the photo was placed, the elevation, size and
 * position from which the first cloud fits best replace those of its camera, and thin parts become thin in depth.
 */
export function fit(clouds, given, placed, { camera, image_size, fit: rule }) {
  const inside = reduced(given, image_size, rule), { mask, stride } = inside;
  const intrinsics = camera.intrinsics.map((row, i) => row.map(v => i < 2 ? v / stride : v));
  let { extrinsics } = camera;
  if (mask.includes(1) && placed) extrinsics = cameraOf(clouds[0], inside, intrinsics, extrinsics);
  const one = points => {
    const seen = project(points, intrinsics, extrinsics), pixels = seen.map(p => p.slice(0, 2)), depth = seen.map(p => p[2]);
    const front = depth.map(z => z > 1e-3), start = pixels.map(pixel => intoMask(pixel, inside));
    const outside = start.filter((pixel, i) => front[i] && pixel !== pixels[i]).length;
    if (!mask.includes(1) || outside > rule.most_outside * pixels.length || !points.every(Number.isFinite)) return points;
    const moved = cover(start, inside), result = Float32Array.from(points);
    const layers = withoutTails(moved, placed ? thinned(moved, depth, inside, intrinsics[0][0]) : depth, rule);
    moved.forEach(([column, row], i) => {
      if (!front[i]) return;
      const z = layers[i], x = (column - intrinsics[0][2]) / intrinsics[0][0] * z, y = (row - intrinsics[1][2]) / intrinsics[1][1] * z;
      const local = [x, y, z].map((v, axis) => v - extrinsics[axis][3]);
      for (let axis = 0; axis < 3; axis++) result[3 * i + axis] = local.reduce((sum, v, k) => sum + v * extrinsics[k][axis], 0);
    });
    return result;
  };
  return { clouds: clouds.map(one), camera: { ...camera, extrinsics } };
}

/** The mask at every `stride`-th pixel, so that there are about rule.columns columns, and the nearest pixel on it. */
function reduced(mask, [fullHeight, fullWidth], rule) {
  const stride = Math.max(1, Math.floor(fullWidth / rule.columns)), first = Math.floor(stride / 2);
  const [rows, columns] = [fullHeight, fullWidth].map(size => [...Array(size).keys()].filter(i => i % stride === first));
  const kept = rows.flatMap(y => columns.map(x => mask[y * fullWidth + x])), width = columns.length, height = rows.length;
  return { rule, stride, mask: kept, width, height, nearest: nearestPixels(kept, width, height) };
}

/** For each pixel the index of the nearest one that is on: first within its row, then over the rows. */
function nearestPixels(on, width, height) {
  const beside = new Int32Array(width * height).fill(-1), result = new Int32Array(width * height);
  for (let start = 0; start < beside.length; start += width) {
    for (let x = 0, last = -1; x < width; x++) beside[start + x] = last = on[start + x] ? x : last;
    for (let x = width - 1, last = -1; x >= 0; x--) {
      if (on[start + x]) last = x;
      const left = beside[start + x];
      if (last >= 0 && (left < 0 || last - x < x - left)) beside[start + x] = last;
    }
  }
  const filled = Array.from({ length: height }, (_, y) => y).filter(y => beside[y * width] >= 0);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      let least = Infinity;
      for (const row of filled) {
        const column = beside[row * width + x], distance = (column - x) ** 2 + (row - y) ** 2;
        if (distance < least) [least, result[y * width + x]] = [distance, row * width + column];
      }
    }
  }
  return result;
}

const cellOf = ([column, row], { width, height }) =>
  clamp(Math.floor(row), 0, height - 1) * width + clamp(Math.floor(column), 0, width - 1);
const within = ([column, row], { width, height }) => column >= 0 && row >= 0 && column < width && row < height;
const centreOf = (index, width) => [index % width + 0.5, Math.floor(index / width) + 0.5];

/** The pixel itself if it is on the mask, else in the nearest pixel of the mask. */
function intoMask(pixel, inside) {
  const cell = cellOf(pixel, inside), target = inside.nearest[cell];
  if (target === cell && within(pixel, inside)) return pixel;
  return centreOf(target, inside.width).map((centre, axis) => clamp(pixel[axis], centre - inside.rule.half, centre + inside.rule.half));
}

function cover(start, inside) {
  const { mask, width, height, rule } = inside, on = [...mask.keys()].filter(i => mask[i]);
  const far = Math.max(rule.far, Math.sqrt(on.length / start.length)) ** 2;
  let pixels = start;
  for (let round = 0; round < rule.rounds; round++) {
    const owner = new Int32Array(width * height).fill(-1), total = pixels.map(() => [0, 0, 0]);
    pixels.forEach((pixel, i) => { if (within(pixel, inside)) owner[cellOf(pixel, inside)] = i; });
    const nearest = nearestPixels(owner.map(i => +(i >= 0)), width, height);
    for (const i of on) {
      const centre = centreOf(i, width), point = owner[nearest[i]];
      if (squared(pixels[point], centre) <= far) continue;
      total[point] = [total[point][0] + centre[0], total[point][1] + centre[1], total[point][2] + 1];
    }
    pixels = pixels.map((pixel, i) => total[i][2] ? pixel.map((v, axis) => v + rule.step * (total[i][axis] / total[i][2] - v)) : pixel);
  }
  return pixels;
}

/** Depths near the mean of their neighbours: at most rule.deepest half widths of the mask from it. */
function thinned(pixels, depth, { mask, width, height, rule }, focal) {
  const outside = nearestPixels(mask.map(on => 1 - on), width, height);
  const gaps = Array.from(outside, (other, i) => Math.sqrt(squared(centreOf(i, width), centreOf(other, width))));
  return depth.map((z, i) => {
    const cell = cellOf(pixels[i], { width, height }), column = cell % width, row = Math.floor(cell / width);
    let half = 0;
    for (let y = Math.max(0, row - 2); y <= Math.min(height - 1, row + 2); y++) {
      for (let x = Math.max(0, column - 2); x <= Math.min(width - 1, column + 2); x++) half = Math.max(half, gaps[y * width + x]);
    }
    const near = depth.filter((_, j) => squared(pixels[i], pixels[j]) <= Math.max(rule.narrowest, half) ** 2);
    const middle = average(near), most = rule.deepest * half * middle / focal;
    return clamp(z, middle - most, middle + most);
  });
}

function withoutTails(pixels, depth, rule) {
  const near = pixels.map(a => [...pixels.keys()].filter(j => squared(a, pixels[j]) < rule.neighbourhood ** 2));
  const kept = near.map((others, i) => {
    const count = compare => others.filter(compare).length >= rule.tail * others.length;
    return count(j => depth[j] < depth[i]) && count(j => depth[j] > depth[i]);
  });
  return depth.map((z, i) => {
    const layers = near[i].filter(j => kept[j]).map(j => depth[j]);
    return layers.length ? clamp(z, Math.min(...layers), Math.max(...layers)) : z;
  });
}

function cameraOf(points, inside, intrinsics, extrinsics) {
  const { mask, width, rule } = inside, on = [...mask.keys()].filter(i => mask[i]), focal = intrinsics[0][0];
  const sample = Array.from({ length: rule.samples }, (_, k) => centreOf(on[Math.ceil((k + 0.5) / rule.samples * on.length) - 1], width));
  const middle = [0, 1, 2].map(axis => average(Array.from(points).filter((_, i) => i % 3 === axis)));
  const seenBy = camera => camera.map(r => r[0] * middle[0] + r[1] * middle[1] + r[2] * middle[2] + r[3]);
  const start = seenBy(extrinsics);
  const pairs = camera => {
    const pixels = project(points, intrinsics, camera), target = pixels.map(pixel => intoMask(pixel, inside));
    const partner = sample.map(at => pixels.reduce((a, b) => squared(b, at) < squared(a, at) ? b : a));
    return { pixels, target, partner };
  };
  const resized = camera => {
    const { pixels, target, partner } = pairs(camera), sides = [[pixels, target], [partner, sample]];
    const mean = side => [0, 1].map(axis => average(sides.map(pair => average(pair[side].map(pixel => pixel[axis])))));
    const from = mean(0), to = mean(1);
    const sum = other => sides.reduce((all, pair) => all + average(pair[0].map((a, i) =>
      (a[0] - from[0]) * other(pair, i, 0) + (a[1] - from[1]) * other(pair, i, 1))), 0);
    const product = sum((pair, i, axis) => pair[1][i][axis] - to[axis]);
    const square = sum((pair, i, axis) => pair[0][i][axis] - from[axis]);
    const scale = clamp(product / Math.max(square, 1e-6), 0.8, 1.25), now = seenBy(camera), depth = now[2] / scale;
    const moved = [0, 1].map(k => {
      const pixel = scale * (intrinsics[k].reduce((all, v, i) => all + v * now[i], 0) / now[2] - from[k]) + to[k];
      return (pixel - intrinsics[k][2]) / focal * depth;
    });
    return camera.map((r, k) => [r[0], r[1], r[2], r[3] + [...moved, depth][k] - now[k]]);
  };
  const tried = rule.elevations.map(degrees => {
    const c = Math.cos(degrees * Math.PI / 180), s = Math.sin(degrees * Math.PI / 180), [right, down, ahead] = extrinsics;
    const turned = [right, down.map((v, i) => c * v - s * ahead[i]), ahead.map((v, i) => s * down[i] + c * v)];
    const camera = resized(turned.map((r, k) => [r[0], r[1], r[2], start[k] - r[0] * middle[0] - r[1] * middle[1] - r[2] * middle[2]]));
    const { pixels, target, partner } = pairs(camera);
    return { camera, cost: average(pixels.map((p, i) => squared(p, target[i]))) + average(sample.map((p, i) => squared(p, partner[i]))) };
  });
  return resized(resized(tried.reduce((a, b) => b.cost < a.cost ? b : a).camera));
}
