// Minimum cuts on a grid of pixels with eight neighbours each: Boykov and Kolmogorov, "An
// Experimental Comparison of Min-Cut/Max-Flow Algorithms" (PAMI 2004). Two trees grow from source
// and sink until they touch; the flow along the path between them is subtracted from the capacities.

const FREE = 0, SOURCE = 1, SINK = 2;
const NONE = -1, TERMINAL = 8, ORPHAN = 9; // in place of a direction to the parent

/** Offsets of the eight neighbours of a cell in a grid of this width; the opposite of direction d is 7 - d. */
export const directions = width => [-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1];

/**
 * Cuts a grid in two at the least cost.
 *
 * @param width, height of the grid. Its outermost cells must have no capacities.
 * @param capacity eight Float64Array: of each cell to its neighbour in that direction; modified.
 * @param terminal Float64Array: capacity from the source minus that to the sink; modified.
 * @returns Uint8Array, 1 where a cell stays with the source.
 */
export function cut(width, height, capacity, terminal) {
  const count = width * height, step = directions(width);
  const tree = new Uint8Array(count), parent = new Int8Array(count).fill(NONE);
  const stamp = new Int32Array(count), distance = new Int32Array(count);
  const queue = new Int32Array(count + 1), queued = new Uint8Array(count);
  let head = 0, tail = 0, time = 0;
  const orphans = [];

  const activate = i => {
    if (queued[i]) return;
    queued[i] = 1;
    queue[tail] = i;
    tail = (tail + 1) % queue.length;
  };
  for (let i = 0; i < count; i++) {
    if (!terminal[i]) continue;
    tree[i] = terminal[i] > 0 ? SOURCE : SINK;
    parent[i] = TERMINAL;
    distance[i] = 1;
    activate(i);
  }
  // Residual capacity between `i` and its neighbour, in the direction in which the tree of `i` grows.
  const outward = (i, d) => tree[i] === SOURCE ? capacity[d][i] : capacity[7 - d][i + step[d]];

  function grow(i) { // returns the direction to a neighbour in the other tree, or NONE
    for (let d = 0; d < 8; d++) {
      if (!(outward(i, d) > 0)) continue;
      const j = i + step[d];
      if (tree[j] === FREE) {
        tree[j] = tree[i];
        parent[j] = 7 - d;
        stamp[j] = stamp[i];
        distance[j] = distance[i] + 1;
        activate(j);
      } else if (tree[j] !== tree[i]) {
        return d;
      } else if (stamp[j] <= stamp[i] && distance[j] > distance[i] + 1) {
        parent[j] = 7 - d;
        stamp[j] = stamp[i];
        distance[j] = distance[i] + 1;
      }
    }
    return NONE;
  }

  function augment(i, d) { // along the path through the arc from `i` in direction d
    const j = i + step[d];
    const [s, t, middle] = tree[i] === SOURCE ? [i, j, d] : [j, i, 7 - d];
    let most = capacity[middle][s], at = s;
    for (; parent[at] !== TERMINAL; at += step[parent[at]]) {
      most = Math.min(most, capacity[7 - parent[at]][at + step[parent[at]]]);
    }
    most = Math.min(most, terminal[at]);
    for (at = t; parent[at] !== TERMINAL; at += step[parent[at]]) most = Math.min(most, capacity[parent[at]][at]);
    most = Math.min(most, -terminal[at]);

    capacity[middle][s] -= most;
    capacity[7 - middle][t] += most;
    const orphan = k => { parent[k] = ORPHAN; orphans.push(k); };
    for (at = s; parent[at] !== TERMINAL;) {
      const up = parent[at], next = at + step[up];
      capacity[up][at] += most;
      capacity[7 - up][next] -= most;
      if (!(capacity[7 - up][next] > 0)) orphan(at);
      at = next;
    }
    terminal[at] -= most;
    if (!(terminal[at] > 0)) orphan(at);
    for (at = t; parent[at] !== TERMINAL;) {
      const up = parent[at], next = at + step[up];
      capacity[7 - up][next] += most;
      capacity[up][at] -= most;
      if (!(capacity[up][at] > 0)) orphan(at);
      at = next;
    }
    terminal[at] += most;
    if (!(terminal[at] < 0)) orphan(at);
  }

  function originDistance(start) { // steps to the terminal, or Infinity if the path does not reach it
    let at = start, steps = 0;
    for (;;) {
      if (stamp[at] === time) { steps += distance[at]; break; }
      const up = parent[at];
      steps++;
      if (up === TERMINAL) { stamp[at] = time; distance[at] = 1; break; }
      if (up === ORPHAN || up === NONE) return Infinity;
      at += step[up];
    }
    for (let k = start, left = steps; stamp[k] !== time; k += step[parent[k]]) {
      stamp[k] = time;
      distance[k] = left--;
    }
    return steps;
  }

  function adopt(i) {
    let best = NONE, least = Infinity;
    for (let d = 0; d < 8; d++) {
      const j = i + step[d];
      if (tree[j] !== tree[i] || parent[j] === NONE) continue;
      const inward = tree[i] === SOURCE ? capacity[7 - d][j] : capacity[d][i];
      if (!(inward > 0)) continue;
      const steps = originDistance(j);
      if (steps < least) { least = steps; best = d; }
    }
    if (best !== NONE) {
      parent[i] = best;
      stamp[i] = time;
      distance[i] = least + 1;
      return;
    }
    for (let d = 0; d < 8; d++) {
      const j = i + step[d];
      if (tree[j] !== tree[i] || parent[j] === NONE) continue;
      if ((tree[i] === SOURCE ? capacity[7 - d][j] : capacity[d][i]) > 0) activate(j);
      if (parent[j] !== TERMINAL && parent[j] !== ORPHAN && j + step[parent[j]] === i) {
        parent[j] = ORPHAN;
        orphans.push(j);
      }
    }
    tree[i] = FREE;
    parent[i] = NONE;
  }

  while (head !== tail) {
    const i = queue[head];
    if (tree[i] !== FREE) {
      const d = grow(i);
      if (d !== NONE) { // `i` stays in the queue: it may have more paths
        time++;
        augment(i, d);
        while (orphans.length) adopt(orphans.pop());
        continue;
      }
    }
    head = (head + 1) % queue.length;
    queued[i] = 0;
  }
  return tree.map(t => +(t === SOURCE));
}
