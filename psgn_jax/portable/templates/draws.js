// Which clouds of a network with a random input are shown, and how far their points vary, as by psgn_jax.prediction.draws.

export const sum = values => values.reduce((a, b) => a + b, 0);

/** The Chamfer distance of two clouds: the means of the squared distances to the nearest point, added. */
function chamfer(a, b) {
  const ofA = new Float64Array(a.length / 3).fill(Infinity), ofB = new Float64Array(b.length / 3).fill(Infinity);
  for (let i = 0; i < ofA.length; i++) for (let j = 0; j < ofB.length; j++) {
    const square = (a[3 * i] - b[3 * j]) ** 2 + (a[3 * i + 1] - b[3 * j + 1]) ** 2 + (a[3 * i + 2] - b[3 * j + 2]) ** 2;
    if (square < ofA[i]) ofA[i] = square;
    if (square < ofB[j]) ofB[j] = square;
  }
  return sum(ofA) / ofA.length + sum(ofB) / ofB.length;
}

/** The clouds: the first, `samples` - 1 draws that differ among the more typical half, then the other draws. */
export function ranked(clouds, samples, compared) {
  const few = clouds.map(cloud => Float64Array.from({ length: 3 * compared.length }, (_, i) => cloud[3 * compared[Math.floor(i / 3)] + i % 3]));
  const distances = clouds.map(() => new Float64Array(clouds.length));
  for (let i = 0; i < clouds.length; i++) for (let j = 0; j < i; j++) distances[i][j] = distances[j][i] = chamfer(few[i], few[j]);
  const sums = distances.map(sum), order = clouds.map((_, i) => i).slice(1).sort((a, b) => sums[a] - sums[b]);
  const shown = [0], half = order.slice(0, Math.max(order.length >> 1, samples - 1));
  const apart = i => Math.min(...shown.map(j => distances[i][j]));
  while (shown.length < samples) shown.push(half.splice(half.reduce((best, i, at) => apart(i) > apart(half[best]) ? at : best, 0), 1)[0]);
  return [...shown, ...order.filter(i => !shown.includes(i))].map(i => clouds[i]);
}

/** For each point of `other`, the number of its partner in `points`: an auction as in psgn_jax.losses.auction, at most `least` (unit) for each point from the least sum of distances. 0.01 is 1 % of the sum. */
export function partners(points, other, least = 0.01) {
  const n = points.length / 3, [x, y, z] = [0, 1, 2].map(k => Float64Array.from({ length: n }, (_, j) => other[3 * j + k]));
  const price = new Float64Array(n), owner = new Int32Array(n);
  for (let epsilon = 0.05, last = false; !last; epsilon /= 5) {
    if (last = epsilon <= least) epsilon = least;
    owner.fill(-1);
    const waiting = Array.from({ length: n }, (_, i) => i);
    while (waiting.length) {
      const i = waiting.pop(), [a, b, c] = points.subarray(3 * i, 3 * i + 3);
      let best = Infinity, second = Infinity, chosen = 0;
      for (let j = 0; j < n; j++) {
        const value = Math.sqrt((a - x[j]) * (a - x[j]) + (b - y[j]) * (b - y[j]) + (c - z[j]) * (c - z[j])) + price[j];
        if (value < best) [second, best, chosen] = [best, value, j];
        else if (value < second) second = value;
      }
      price[chosen] += second - best + epsilon;
      if (owner[chosen] >= 0) waiting.push(owner[chosen]);
      owner[chosen] = i;
    }
  }
  return owner;
}

/** For each of the first `samples` clouds, how far its points vary: for the first, the mean distance to the partners in the others; partners have the same value. `pause` is awaited between clouds. */
export async function spread([first, ...others], samples, pause) {
  const count = first.length / 3, mean = new Float64Array(count), owners = [];
  for (const other of others) {
    const owner = partners(first, other);
    for (let j = 0; j < count; j++) {
      const i = owner[j];
      mean[i] += Math.hypot(first[3 * i] - other[3 * j], first[3 * i + 1] - other[3 * j + 1], first[3 * i + 2] - other[3 * j + 2]) / others.length;
    }
    owners.push(owner);
    await pause();
  }
  return [mean, ...owners.slice(0, samples - 1).map(owner => Float64Array.from(owner, i => mean[i]))];
}
