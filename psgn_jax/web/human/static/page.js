// The page: models of the cases, two views of the open one, and files.

const each = (selector, act) => document.querySelectorAll(selector).forEach(act);
const copy = value => JSON.parse(JSON.stringify(value));
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

const FORMAT = "psgn human study", KEY = `psgn-human-${data.id}`, HISTORY = 200, IDLE = 60_000, MOST_PARTS = 200;
const COLOURS = [[94, 139, 214], [232, 150, 88], [104, 178, 130], [205, 112, 135], [150, 128, 206], [82, 172, 184], [214, 181, 84]];
const AXES = ["#de484c", "#2ea057", "#3970e2"], UNITS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// --- geometry --------------------------------------------------------------------------------------

const ROUND = 24, RINGS = 12; // corners of a circle; rings of a sphere from pole to pole

const add = (a, b, scale = 1) => a.map((v, k) => v + scale * b[k]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const apply = (matrix, v) => matrix.map(row => dot(row, v));
const multiply = (a, b) => a.map(row => [0, 1, 2].map(k => dot(row, b.map(r => r[k]))));

/** Rz(c) Ry(b) Rx(a) of three angles in degrees. */
function rotation(degrees) {
  const [a, b, c] = degrees.map(d => d * Math.PI / 180), { cos, sin } = Math;
  const x = [[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]];
  const y = [[cos(b), 0, sin(b)], [0, 1, 0], [-sin(b), 0, cos(b)]];
  const z = [[cos(c), -sin(c), 0], [sin(c), cos(c), 0], [0, 0, 1]];
  return multiply(z, multiply(y, x));
}

/** The angles of a rotation in degrees: the inverse of `rotation`. */
function anglesOf(m) {
  const upright = Math.abs(m[2][0]) > 0.9999999;
  const angles = upright
    ? [Math.atan2(-m[1][2], m[1][1]), -Math.sign(m[2][0]) * Math.PI / 2, 0]
    : [Math.atan2(m[2][1], m[2][2]), Math.asin(-m[2][0]), Math.atan2(m[1][0], m[0][0])];
  return angles.map(angle => Math.round(angle * 180 / Math.PI * 1e4) / 1e4);
}

/** The primitive of a part inside the cube of edge 1: { corners, faces }; faces are counter-clockwise from outside. */
function unitMesh({ kind, taper, sides }) {
  const ring = (count, act) => Array.from({ length: count }, (_, i) => act(i));
  if (kind === "sphere") {
    const corners = ring(RINGS + 1, i => Math.PI * i / RINGS).flatMap(polar => ring(ROUND, j => {
      const angle = 2 * Math.PI * j / ROUND;
      return [Math.sin(polar) * Math.cos(angle) / 2, Math.sin(polar) * Math.sin(angle) / 2, Math.cos(polar) / 2];
    }));
    const at = (i, j) => i * ROUND + j % ROUND;
    return { corners, faces: ring(RINGS, i => ring(ROUND, j => [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])).flat() };
  }
  const count = kind === "prism" ? sides : ROUND;
  let section = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
  if (kind !== "box") {
    section = ring(count, i => [Math.cos(Math.PI / 2 + 2 * Math.PI * i / count), Math.sin(Math.PI / 2 + 2 * Math.PI * i / count)]);
    const ends = [0, 1].map(k => section.map(p => p[k])).map(values => [Math.min(...values), Math.max(...values)]);
    section = section.map(p => p.map((v, k) => (v - ends[k][0]) / (ends[k][1] - ends[k][0]) - 0.5));
  }
  const n = section.length, corners = [...section.map(p => [...p, -0.5]), ...section.map(([x, y]) => [taper * x, taper * y, 0.5])];
  const walls = ring(n, i => [i, (i + 1) % n, n + (i + 1) % n, n + i]);
  return { corners, faces: [...walls, ring(n, i => n - 1 - i), ring(n, i => n + i)] };
}

const toWorld = (model, p) => add(apply(rotation([0, 0, model.turn]), p), [model.x, model.y, 0]);
const ownCorners = (part, corners) => {
  const turn = rotation(part.turn);
  return corners.map(v => add(apply(turn, v.map((c, k) => c * part.size[k])), part.at));
};

/** All parts with their symmetric copies, in the frame of the record: { number, corners, faces }. */
function meshesOf(model) {
  const turn = rotation([0, 0, model.turn]);
  return model.parts.flatMap((part, number) => {
    const { corners, faces } = unitMesh(part), own = ownCorners(part, corners);
    const signs = (part.mirror.includes("y") ? [1, -1] : [1]).flatMap(y => (part.mirror.includes("x") ? [1, -1] : [1]).map(x => [x, y]));
    return signs.map(([x, y]) => ({
      number,
      corners: own.map(v => add(apply(turn, [x * v[0], y * v[1], v[2]]), [model.x, model.y, 0])),
      faces: x * y > 0 ? faces : faces.map(face => [...face].reverse()),
    }));
  });
}

/** [column, row, depth] of a point; a camera is { k: [fx, skew, cx, fy, cy], rotation, shift }. */
function project({ k, rotation: turn, shift }, point) {
  const [x, y, z] = add(apply(turn, point), shift);
  return [(k[0] * x + k[1] * y) / z + k[2], k[3] * y / z + k[4], z];
}

// --- the models ------------------------------------------------------------------------------------

const emptyEntry = () => ({ seconds: 0, done: false, model: { turn: 0, x: 0, y: 0, parts: [] }, undo: [], redo: [] });
const state = { entries: data.cases.map(emptyEntry), at: 0, selected: -1, mode: "move", active: -Infinity };
const entry = () => state.entries[state.at], model = () => entry().model, selected = () => model().parts[state.selected];

/** Changes the model in one step of undo; while a handle is dragged, the step was begun before. */
function edit(change, begun = false) {
  if (!begun) begin();
  change(model());
  for (const part of model().parts) {
    part.at = part.at.map(v => clamp(v, -4, 4));
    part.size = part.size.map(v => clamp(v, 0.005, 8));
  }
  show();
}

function begin() {
  entry().undo = [...entry().undo, JSON.stringify(model())].slice(-HISTORY);
  entry().redo = [];
}

function step(from, to) {
  if (!entry()[from].length) return;
  entry()[to].push(JSON.stringify(model()));
  entry().model = JSON.parse(entry()[from].pop());
  show();
}

function insert(part) {
  if (model().parts.length >= MOST_PARTS) return complain(`A model can have at most ${MOST_PARTS} parts.`);
  edit(({ parts }) => { state.selected = parts.push(part) - 1; });
}

const newPart = kind => ({
  kind, size: [0.4, 0.4, 0.4], at: [0, 0, 0.2], turn: kind === "prism" ? [90, 0, 90] : [0, 0, 0], mirror: "", taper: kind === "cone" ? 0 : 1, sides: 3,
});

const actions = {
  undo: () => step("undo", "redo"),
  redo: () => step("redo", "undo"),
  duplicate: () => selected() && insert({ ...copy(selected()), at: add(selected().at, [0.05, 0.05, 0]) }),
  delete: () => selected() && edit(({ parts }) => { parts.splice(state.selected, 1); state.selected = -1; }),
  ground: () => selected() && edit(() => {
    selected().at[2] -= Math.min(...ownCorners(selected(), unitMesh(selected()).corners).map(v => v[2]));
  }),
  done: () => {
    entry().done = !entry().done;
    if (entry().done && state.at < data.cases.length - 1) open(state.at + 1);
    else show();
  },
  save: () => {
    const href = URL.createObjectURL(new Blob([savedModels(solidsOf)], { type: "application/json" })), link = make("a", { href, download: "human.json" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(href), 1000);
  },
};

// --- files -----------------------------------------------------------------------------------------

/** Corners of all parts and copies of a model, for the score. */
const solidsOf = model => meshesOf(model).map(({ corners }) => corners.map(corner => corner.map(v => +v.toFixed(7))));

/** The text of a file: times, the models, and their `solids`. */
function savedModels(solids) {
  const cases = state.entries.map(({ seconds, done, model }, i) => (
    { case: data.cases[i].name, seconds, done, parts: model.parts.length, solids: solids(model), model: JSON.stringify(model) }
  ));
  return JSON.stringify({ format: FORMAT, version: 2, study: data.id, cases }) + "\n";
}

/** Replaces all models by those of a text that this page has saved. */
function restore(text) {
  const saved = JSON.parse(text);
  if (saved.format !== FORMAT || saved.study !== data.id) throw new Error("it belongs to another study");
  const entries = data.cases.map((_, i) => {
    const { seconds, done, model } = saved.cases[i], read = JSON.parse(model);
    const numbers = meshesOf(read).flatMap(mesh => mesh.corners.flat());
    if (!numbers.every(Number.isFinite)) throw new Error(`the model of case ${i + 1} is damaged`);
    return { ...emptyEntry(), seconds, done, model: read };
  });
  Object.assign(state, { entries, selected: -1 });
}

function keep() {
  try {
    localStorage.setItem(KEY, savedModels(() => []));
    $("status").textContent = "Saved in this browser";
  } catch {
    $("status").textContent = "This browser cannot keep your work: press Save all before you leave";
  }
}

function complain(text) {
  $("problem").textContent = text;
  $("problem").hidden = false;
}

// --- views -----------------------------------------------------------------------------------------

/** The path through some pixels. */
function outline(pixels, closed = true) {
  const path = new Path2D();
  pixels.forEach(([x, y]) => path.lineTo(x, y));
  if (closed) path.closePath();
  return path;
}

/** A view of the model: over the image, by the camera of the record, or from any side. */
class View {
  constructor(canvas, overImage) {
    Object.assign(this, { canvas, overImage, image: new Image(), orbit: { turn: 40, tilt: 24, distance: 5.2 }, drag: null });
    this.image.addEventListener("load", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(canvas);
    canvas.addEventListener("pointerdown", event => this.down(event));
    canvas.addEventListener("pointermove", event => { if (this.drag) this.drag(add(this.pixel(event), this.start, -1)); });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { this.drag = null; });
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.orbit.distance = clamp(this.orbit.distance * Math.exp(event.deltaY * 0.001), 2, 20);
      this.draw();
    }, { passive: false });
  }

  pixel(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  camera() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (this.overImage) {
      const { width, height, intrinsics: k, extrinsics: e } = data.cases[state.at], s = Math.min(w / width, h / height);
      const [left, top] = [(w - s * width) / 2, (h - s * height) / 2];
      const rows = [0, 4, 8].map(r => e.slice(r, r + 4));
      return { k: [s * k[0], s * k[1], s * k[2] + left, s * k[4], s * k[5] + top], rotation: rows.map(r => r.slice(0, 3)), shift: rows.map(r => r[3]), box: [left, top, s * width, s * height] };
    }
    const [azimuth, elevation] = [this.orbit.turn, this.orbit.tilt].map(d => d * Math.PI / 180), focal = 1.75 * Math.min(w, h);
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
    const forward = [-Math.cos(elevation) * Math.cos(azimuth), -Math.cos(elevation) * Math.sin(azimuth), -Math.sin(elevation)];
    const turn = [right, cross(forward, right), forward]; // right, down, forward
    return { k: [focal, 0, w / 2, focal, h / 2], rotation: turn, shift: add([0, 0, this.orbit.distance], apply(turn, [0, 0, 0.3]), -1) };
  }

  /** The faces that are seen from their front, the farthest first: { number, path, depth, shade }. */
  faces(camera) {
    return meshesOf(model()).flatMap(({ number, corners, faces }) => {
      const seen = corners.map(corner => project(camera, corner));
      return faces.flatMap(face => {
        const path = face.map(i => seen[i]), depth = path.reduce((sum, p) => sum + p[2], 0) / path.length;
        const area = path.reduce((sum, p, i) => sum + p[0] * path[(i + 1) % path.length][1] - p[1] * path[(i + 1) % path.length][0], 0);
        if (area >= -1e-3 || path.some(p => p[2] < 0.1)) return [];
        const [a, b, c] = [0, 1 / 3, 2 / 3].map(share => corners[face[Math.floor(share * face.length)]]);
        const normal = cross(add(b, a, -1), add(c, a, -1));
        const shade = 0.72 + 0.28 * dot(normal, [0.45, 0.3, 0.84]) / (Math.hypot(...normal) || 1);
        return [{ number, path, depth, shade, round: path.length < 5 && faces.length > 20 }];
      });
    }).sort((p, q) => q.depth - p.depth);
  }

  /** Handles of the selected part: { axis, from, to, way }; `way` is how a unit along the axis moves on the canvas. */
  handles(camera) {
    const part = selected();
    if (!part) return [];
    const own = state.mode === "move" ? UNITS : UNITS.map(unit => apply(rotation(part.turn), unit)), centre = toWorld(model(), part.at);
    const from = project(camera, centre), length = 0.1 * from[2];
    return own.map((direction, axis) => {
      const world = apply(rotation([0, 0, model().turn]), direction), near = project(camera, add(centre, world, 0.01));
      return { axis, own: direction, from, to: project(camera, add(centre, world, length)), way: [0, 1].map(k => (near[k] - from[k]) / 0.01) };
    });
  }

  down(event) {
    const pixel = this.start = this.pixel(event), camera = this.camera(), near = p => Math.hypot(p[0] - pixel[0], p[1] - pixel[1]) < (event.pointerType === "touch" ? 22 : 12);
    this.canvas.setPointerCapture(event.pointerId);
    const handle = this.handles(camera).find(({ to }) => near(to));
    const context = this.canvas.getContext("2d"), at = pixel.map(v => v * (window.devicePixelRatio || 1));
    const hit = this.faces(camera).findLast(({ path }) => context.isPointInPath(outline(path), ...at));
    const orbit = { ...this.orbit };
    if (handle) {
      this.drag = dragged(handle);
    } else if (hit) {
      state.selected = hit.number;
    } else {
      state.selected = -1;
      this.drag = this.overImage ? null : ([right, down]) => {
        Object.assign(this.orbit, { turn: orbit.turn - 0.4 * right, tilt: clamp(orbit.tilt + 0.4 * down, -89, 89) });
        this.draw();
      };
    }
    show();
  }

  draw() {
    const { canvas } = this, dense = window.devicePixelRatio || 1, context = canvas.getContext("2d"), camera = this.camera();
    canvas.width = canvas.clientWidth * dense;
    canvas.height = canvas.clientHeight * dense;
    context.scale(dense, dense);
    context.lineJoin = "round";
    if (this.overImage && this.image.complete) context.drawImage(this.image, ...camera.box);
    const line = (path, colour, width = 1, closed = false) => {
      Object.assign(context, { strokeStyle: colour, lineWidth: width });
      context.stroke(outline(path, closed));
    };
    const ground = (points, colour, width) => line(points.map(p => project(camera, p)), colour, width);
    if ($("grid").checked) {
      for (let i = -5; i <= 5; i++) {
        for (const ends of [[[i / 5, -1, 0], [i / 5, 1, 0]], [[-1, i / 5, 0], [1, i / 5, 0]]]) ground(ends.map(p => toWorld(model(), p)), "rgba(80, 92, 120, .35)");
      }
      UNITS.forEach((unit, k) => ground([[0, 0, 0], unit.map(v => v * [1.15, 1.15, 0.25][k])].map(p => toWorld(model(), p)), AXES[k], 2));
      ground(Array.from({ length: 73 }, (_, i) => [Math.cos(i * Math.PI / 36), Math.sin(i * Math.PI / 36), 0]), "rgba(80, 92, 120, .6)");
    }
    const style = this.overImage ? $("overlay").value : "solid";
    for (const { number, path, shade, round } of style === "off" ? [] : this.faces(camera)) {
      const chosen = number === state.selected, colour = COLOURS[number % COLOURS.length].map(c => Math.round(c * shade)).join();
      context.fillStyle = `rgba(${colour}, ${style === "lines" ? 0.12 : this.overImage ? 0.75 : 1})`;
      context.fill(outline(path));
      line(path, chosen ? "#ff9800" : `rgba(30, 41, 66, ${round ? 0.25 : 0.8})`, chosen && !round ? 2 : 1, true);
    }
    for (const { axis, from, to } of this.handles(camera)) {
      line([from, to], AXES[axis], 3);
      context.fillStyle = AXES[axis];
      context.beginPath();
      context.arc(to[0], to[1], 6, 0, 7);
      context.fill();
    }
  }
}

/** Drags a handle: moves along its axis, resizes the part and leaves its other side, or turns it by the way across the axis. */
function dragged({ axis, own, way }) {
  const before = copy(selected()), length = Math.hypot(...way), { mode } = state;
  begin();
  return ([right, down]) => {
    const along = (right * way[0] + down * way[1]) / Math.max(length, 30) ** 2, unit = length > 15 ? way.map(v => v / length) : [0, 1];
    edit(() => {
      const part = selected();
      if (mode === "move") part.at = add(before.at, own, along);
      if (mode === "size") {
        part.size[axis] = Math.max(0.005, before.size[axis] + along);
        part.at = add(before.at, own, (part.size[axis] - before.size[axis]) / 2);
      }
      if (mode === "turn") {
        const angle = Math.round(0.5 * (unit[1] * right - unit[0] * down));
        part.turn = anglesOf(multiply(rotation(before.turn), rotation(UNITS[axis].map(v => v * angle))));
      }
    }, true);
  };
}

// --- panels ----------------------------------------------------------------------------------------

const DIRECTIONS = ["front", "right", "up"];
const fields = []; // [input, read, write]
function field(parent, label, read, write, options = {}) {
  const input = make("input", { type: "number", step: "any", ariaLabel: label, ...options });
  input.addEventListener("change", () => {
    if (input.value !== "" && input.checkValidity()) edit(() => write(+input.value));
    else show();
  });
  parent.append(input);
  fields.push([input, read]);
}

const title = (parent, textContent) => parent.append(make("span", { textContent }));

title($("object"), "Turn, place");
field($("object"), "Direction of the object, degrees", () => model().turn, v => { model().turn = v; }, { min: -360, max: 360 });
for (const [k, name] of ["x", "y"].entries()) {
  field($("object"), `Middle of the object, ${DIRECTIONS[k]}`, () => model()[name], v => { model()[name] = v; }, { min: -2, max: 2 });
}
for (const [name, text, low, high] of [["at", "Position", -4, 4], ["size", "Size", 0.005, 8], ["turn", "Turn", -360, 360]]) {
  title($("numbers"), text);
  DIRECTIONS.forEach((direction, k) => {
    field($("numbers"), `${text}, ${direction}`, () => selected()?.[name][k], v => { selected()[name][k] = v; }, { min: low, max: high });
  });
}
title($("numbers"), "Top, sides");
field($("numbers"), "Size of the top, 0 to 1", () => selected()?.taper, v => { selected().taper = v; }, { min: 0, max: 1 });
field($("numbers"), "Sides of a prism", () => selected()?.sides, v => { selected().sides = v; }, { min: 3, max: 12, step: 1 });

function show() {
  const { cases } = data, { at, entries } = state, part = selected();
  for (const [input, read] of fields) if (input !== document.activeElement || !input.value) input.value = +(read() ?? 0).toFixed(4);
  $("case-name").textContent = `${cases[at].name} of ${cases.length}`;
  $("undo").disabled = !entry().undo.length;
  $("redo").disabled = !entry().redo.length;
  $("done").textContent = entry().done ? "Mark as not done" : at < cases.length - 1 ? "Done, next case" : "Done";
  $("part").hidden = !part;
  each("[data-mode]", button => button.setAttribute("aria-pressed", button.dataset.mode === state.mode));
  each("[data-mirror]", box => { box.checked = !!part?.mirror.includes(box.dataset.mirror); });
  $("parts").replaceChildren(...model().parts.map(({ kind, mirror }, number) => {
    const swatch = make("i"), copies = mirror ? ` × ${2 ** mirror.length}` : "";
    const button = make("button", { ariaPressed: number === state.selected }, swatch, `${number + 1} ${kind}${copies}`);
    swatch.style.background = `rgb(${COLOURS[number % COLOURS.length]})`;
    button.addEventListener("click", () => { state.selected = number; show(); });
    return make("li", {}, button);
  }));
  [...$("strip").children].forEach((button, i) => {
    button.setAttribute("aria-current", i === at);
    button.className = entries[i].done ? "done" : "";
  });
  $("problem").hidden = true;
  showClock();
  views.forEach(view => view.draw());
  keep();
}

function showClock() {
  const { seconds } = entry();
  $("clock").textContent = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
}

function open(at) {
  Object.assign(state, { at, selected: -1 });
  views[0].image.src = data.cases[at].image;
  show();
}

// --- start -----------------------------------------------------------------------------------------

const views = [new View($("image-view"), true), new View($("free-view"), false)];
data.cases.forEach(({ name, image }, i) => {
  const button = make("button", {}, make("img", { src: image, alt: name }));
  button.addEventListener("click", () => open(i));
  $("strip").append(button);
});
for (const [id, act] of Object.entries(actions)) $(id).addEventListener("click", act);
each("[data-add]", button => button.addEventListener("click", () => insert(newPart(button.dataset.add))));
each("[data-mode]", button => button.addEventListener("click", () => { state.mode = button.dataset.mode; show(); }));
each("[data-mirror]", box => box.addEventListener("change", () => edit(() => {
  selected().mirror = ["x", "y"].filter(axis => document.querySelector(`[data-mirror=${axis}]`).checked).join("");
})));
for (const id of ["overlay", "grid"]) $(id).addEventListener("change", show);
$("open").addEventListener("change", async () => {
  try {
    restore(await $("open").files[0].text());
    show();
  } catch (error) {
    complain(`This file cannot be used: ${error.message}.`);
  }
  $("open").value = "";
});
for (const name of ["pointerdown", "keydown"]) addEventListener(name, () => { state.active = performance.now(); }, true);
setInterval(() => {
  if (document.hidden || performance.now() - state.active > IDLE) return;
  entry().seconds++;
  showClock();
}, 1000);
addEventListener("keydown", event => {
  if (event.target.matches("input[type=number], select")) return;
  const letter = event.key.toLowerCase(), mode = { m: "move", t: "turn", s: "size" }[letter];
  const act = event.ctrlKey || event.metaKey
    ? { z: event.shiftKey ? actions.redo : actions.undo, d: actions.duplicate, s: actions.save }[letter]
    : mode ? () => { state.mode = mode; show(); } : { g: actions.ground, delete: actions.delete, escape: () => { state.selected = -1; show(); } }[letter];
  if (!act) return;
  event.preventDefault();
  act();
});

try {
  const saved = localStorage.getItem(KEY);
  if (saved) restore(saved);
} catch { /* what this browser has kept is not usable */ }
open(0);
addEventListener("pagehide", keep);
globalThis.human = { state, views, insert, meshesOf, model, toWorld, project };
