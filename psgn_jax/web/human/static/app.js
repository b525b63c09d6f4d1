// The page: models of the cases, two views of the open one, and files.

const KINDS = ["box", "cylinder", "cone", "sphere", "prism"], MODES = ["move", "turn", "size"];
const FORMAT = "psgn human study", KEY = `psgn-human-${data.id}`, HISTORY = 200, IDLE = 60_000, MOST_PARTS = 200;
const COLOURS = [[94, 139, 214], [232, 150, 88], [104, 178, 130], [205, 112, 135], [150, 128, 206], [82, 172, 184], [214, 181, 84]];
const LIMITS = { at: [-4, 4], size: [0.005, 8], turn: [-360, 360] }; // units, units and degrees
const AXES = ["#de484c", "#2ea057", "#3970e2"], UNITS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// --- geometry --------------------------------------------------------------------------------------
const ROUND = 24, RINGS = 12; // corners of a circle; rings of a sphere from pole to pole

const add = (a, b, scale = 1) => a.map((v, k) => v + scale * b[k]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const list = (count, act) => Array.from({ length: count }, (_, i) => act(i));

/** Rz(c) Ry(b) Rx(a) of three angles in degrees. */
const rotation = angles => new DOMMatrix().rotate(...angles);

/** The angles of a rotation in degrees: the inverse of `rotation`. */
function anglesOf({ m11, m12, m13, m22, m23, m32, m33 }) {
  const upright = Math.abs(m13) > 0.9999999;
  const angles = upright
    ? [Math.atan2(-m32, m22), -Math.sign(m13) * Math.PI / 2, 0]
    : [Math.atan2(m23, m33), Math.asin(-m13), Math.atan2(m12, m11)];
  return angles.map(angle => Math.round(angle * 180 / Math.PI * 1e4) / 1e4);
}

/** The primitive of a part inside the cube of edge 1: { corners, faces }; faces are counter-clockwise from outside. */
function unitMesh({ kind, taper, sides }) {
  const count = { box: 4, prism: sides }[kind] ?? ROUND, first = kind === "box" ? Math.PI / 4 : Math.PI / 2;
  const circle = list(count, i => first + 2 * Math.PI * i / count).map(angle => [Math.cos(angle), Math.sin(angle)]);
  const ends = [0, 1].map(k => circle.map(p => p[k])).map(values => [Math.min(...values), Math.max(...values)]);
  const section = circle.map(p => p.map((v, k) => (v - ends[k][0]) / (ends[k][1] - ends[k][0]) - 0.5));
  const rings = kind === "sphere" // [scale of the section, height] from bottom to top
    ? list(RINGS + 1, i => [Math.sin(Math.PI * i / RINGS), -Math.cos(Math.PI * i / RINGS) / 2])
    : [[1, -0.5], [taper, 0.5]];
  const corners = rings.flatMap(([scale, z]) => section.map(([x, y]) => [scale * x, scale * y, z]));
  const at = (ring, i) => ring * count + i % count, last = rings.length - 1;
  const walls = list(last, ring => list(count, i => [at(ring, i), at(ring, i + 1), at(ring + 1, i + 1), at(ring + 1, i)])).flat();
  return { corners, faces: [...walls, list(count, i => at(0, count - 1 - i)), list(count, i => at(last, i))] };
}

/** From the unit cube of a part to the directions of the object, and from these to the frame of the record. */
const fromUnit = ({ at, turn, size }) => new DOMMatrix().translate(...at).rotate(...turn).scale(...size);
const fromObject = ({ turn, x, y }) => new DOMMatrix().translate(x, y).rotate(0, 0, turn);
const toWorld = (model, p) => apply(rowsOf(fromObject(model)), p);

/** All parts with their symmetric copies, in the frame of the record: { number, corners, faces }. */
function meshesOf(model) {
  return model.parts.flatMap((part, number) => {
    const { corners, faces } = unitMesh(part), signs = axis => part.mirror.includes(axis) ? [1, -1] : [1];
    return signs("y").flatMap(y => signs("x").map(x => {
      const rows = rowsOf(fromObject(model).scale(x, y, 1).multiply(fromUnit(part)));
      return { number, corners: corners.map(v => apply(rows, v)), faces: x * y > 0 ? faces : faces.map(face => [...face].reverse()) };
    }));
  });
}

// --- the models ------------------------------------------------------------------------------------
const emptyEntry = () => ({ seconds: 0, done: false, model: { turn: 0, x: 0, y: 0, parts: [] }, undo: [], redo: [] });
const state = { entries: data.cases.map(emptyEntry), at: 0, selected: -1, mode: "move", active: -Infinity };
let kept = ""; // the text in this browser, as far as this tab knows
const entry = () => state.entries[state.at], model = () => entry().model, selected = () => model().parts[state.selected];

/** Changes the model in one step of undo; while a handle is dragged, the step was begun before. */
function edit(change, begun = false) {
  if (!begun) begin();
  change(model());
  for (const part of model().parts) for (const key of ["at", "size"]) part[key] = part[key].map(v => clamp(v, ...LIMITS[key]));
  show();
}

function begin() {
  entry().undo = [...entry().undo, structuredClone(model())].slice(-HISTORY);
  entry().redo = [];
}

function step(from, to) {
  if (!entry()[from].length) return;
  entry()[to].push(model());
  entry().model = entry()[from].pop();
  show();
}

function insert(part) {
  if (model().parts.length < MOST_PARTS) edit(({ parts }) => { state.selected = parts.push(part) - 1; });
  else $("problem").textContent = `A model can have at most ${MOST_PARTS} parts.`;
}

const actions = {
  undo: () => step("undo", "redo"),
  redo: () => step("redo", "undo"),
  duplicate: () => selected() && insert({ ...structuredClone(selected()), at: add(selected().at, [0.05, 0.05, 0]) }),
  delete: () => selected() && edit(({ parts }) => { parts.splice(state.selected, 1); state.selected = -1; }),
  ground: () => selected() && edit(() => {
    const rows = rowsOf(fromUnit(selected()));
    selected().at[2] -= Math.min(...unitMesh(selected()).corners.map(v => apply(rows, v)[2]));
  }),
  done: () => {
    entry().done = !entry().done;
    if (entry().done && state.at < data.cases.length - 1) open(state.at + 1);
    else show();
  },
  save: () => save("human.json", savedModels(true)),
};
for (const mode of MODES) actions[mode] = () => { state.mode = mode; show(); };
for (const kind of KINDS) actions[kind] = () => insert({
  kind, size: [0.4, 0.4, 0.4], at: [0, 0, 0.2], turn: kind === "prism" ? [90, 0, 90] : [0, 0, 0], mirror: "", taper: kind === "cone" ? 0 : 1, sides: 3,
});

// --- files -----------------------------------------------------------------------------------------
/** The text of a file: times, the models and, for the score, the corners of all their parts and copies. */
function savedModels(withSolids) {
  const cases = state.entries.map(({ seconds, done, model }, i) => {
    const meshes = withSolids ? meshesOf(model) : [];
    const solids = meshes.map(({ corners }) => corners.map(corner => corner.map(v => +v.toFixed(7))));
    return { case: data.cases[i].name, seconds, done, parts: model.parts.length, solids, model: JSON.stringify(model) };
  });
  return JSON.stringify({ format: FORMAT, version: 1, study: data.id, cases }) + "\n";
}

/** Replaces all models by those of a text that this page has saved. */
function restore(text) {
  const saved = JSON.parse(text);
  if (saved.format !== FORMAT || saved.study !== data.id) throw new Error("it belongs to another study");
  if (saved.version !== 1) throw new Error(`its version is ${saved.version}, this page reads 1`);
  const entries = data.cases.map((_, i) => {
    const { seconds, done, model } = saved.cases[i], read = JSON.parse(model);
    const numbers = meshesOf(read).flatMap(mesh => mesh.corners.flat());
    if (!numbers.every(Number.isFinite)) throw new Error(`the model of case ${i + 1} is damaged`);
    const old = state.entries[i], same = JSON.stringify(old.model) === model; // then undo stays
    return { ...(same ? old : emptyEntry()), seconds, done, model: read };
  });
  Object.assign(state, { entries, selected: -1 });
}

/** Writes only what was changed here: another tab may have changed more. */
function keep() {
  const text = savedModels(false);
  try {
    if (text !== kept) localStorage.setItem(KEY, text);
    kept = text;
    $("status").textContent = "Saved in this browser";
  } catch {
    $("status").textContent = "This browser cannot keep your work: press Save all before you leave";
  }
}

// --- views -----------------------------------------------------------------------------------------
/** A view of the model: over the image, by the camera of the record, or from any side. */
class View extends TurnedView {
  constructor(canvas, overImage) {
    super([canvas], null, { turn: -40, tilt: 24, zoom: 0.75 });
    Object.assign(this, { canvas, overImage, image: new Image() });
    this.image.addEventListener("load", () => this.redraw());
  }

  camera() {
    if (!this.overImage) return super.camera(this.canvas);
    const { clientWidth: w, clientHeight: h } = this.canvas, { width, height, intrinsics: k, extrinsics: e } = data.cases[state.at];
    const s = Math.min(w / width, h / height), left = (w - s * width) / 2, top = (h - s * height) / 2;
    const rows = [0, 4, 8].map(r => e.slice(r, r + 4)), box = [left, top, s * width, s * height];
    return { k: [s * k[0], s * k[1], s * k[2] + left, s * k[4], s * k[5] + top], rows, box };
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
    const turned = rowsOf(rotation(state.mode === "move" ? [0, 0, 0] : part.turn));
    return UNITS.map((unit, axis) => {
      const own = apply(turned, unit), along = length => project(camera, toWorld(model(), add(part.at, own, length)));
      const from = along(0), near = along(0.01);
      return { axis, own, from, to: along(0.1 * from[2]), way: [0, 1].map(k => (near[k] - from[k]) / 0.01) };
    });
  }

  /** A pointer drags a handle, or selects a part, or selects none and turns the view. */
  grab(event) {
    document.activeElement.blur(); // a number that is being typed is of the part selected so far
    const pixel = [event.offsetX, event.offsetY], camera = this.camera(), reach = event.pointerType === "touch" ? 22 : 12;
    const handle = this.handles(camera).find(({ to }) => Math.hypot(to[0] - pixel[0], to[1] - pixel[1]) < reach);
    if (handle) return dragged(handle);
    const context = this.canvas.getContext("2d"), at = pixel.map(v => v * (window.devicePixelRatio || 1));
    const hit = this.faces(camera).findLast(({ path }) => context.isPointInPath(pathThrough(path, true), ...at));
    state.selected = hit?.number ?? -1;
    show();
    return hit ? () => {} : super.grab();
  }

  draw() {
    const context = this.cleared(this.canvas), camera = this.camera();
    Object.assign(context, { lineCap: "round", lineJoin: "round" });
    if (this.overImage && this.image.complete) context.drawImage(this.image, ...camera.box);
    const line = (path, colour, width = 1, closed = false) => {
      Object.assign(context, { strokeStyle: colour, lineWidth: width });
      context.stroke(pathThrough(path, closed));
    };
    const ground = (points, colour, width) => line(points.map(p => project(camera, p)), colour, width);
    if ($("grid").checked) {
      for (let i = -5; i <= 5; i++) {
        for (const ends of [[[i / 5, -1, 0], [i / 5, 1, 0]], [[-1, i / 5, 0], [1, i / 5, 0]]]) ground(ends.map(p => toWorld(model(), p)), "rgba(80, 92, 120, .35)");
      }
      UNITS.forEach((unit, k) => ground([[0, 0, 0], unit.map(v => v * [1.15, 1.15, 0.25][k])].map(p => toWorld(model(), p)), AXES[k], 2));
      ground(list(73, i => [Math.cos(i * Math.PI / 36), Math.sin(i * Math.PI / 36), 0]), "rgba(80, 92, 120, .6)");
    }
    const style = this.overImage ? $("overlay").value : "solid";
    for (const { number, path, shade, round } of style === "off" ? [] : this.faces(camera)) {
      const chosen = number === state.selected, colour = COLOURS[number % COLOURS.length].map(c => Math.round(c * shade)).join();
      context.fillStyle = `rgba(${colour}, ${style === "lines" ? 0.12 : this.overImage ? 0.75 : 1})`;
      context.fill(pathThrough(path));
      line(path, chosen ? "#ff9800" : `rgba(30, 41, 66, ${round ? 0.25 : 0.8})`, chosen && !round ? 2 : 1, true);
    }
    for (const { axis, from, to } of this.handles(camera)) {
      line([from, to], AXES[axis], 3);
      line([to, [to[0] + 0.01, to[1]]], AXES[axis], 12); // a disc
    }
  }
}

/** Drags a handle: moves along its axis, resizes the part and leaves its other side, or turns it by the way across the axis. */
function dragged({ axis, own, way }) {
  const before = structuredClone(selected()), length = Math.hypot(...way), { mode, selected: number } = state;
  let right = 0, down = 0;
  begin();
  return (moreRight, moreDown) => {
    if (state.selected !== number || !selected()) return; // deleted or let go by a key
    right += moreRight;
    down += moreDown;
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
        part.turn = anglesOf(rotation(before.turn).multiply(rotation(UNITS[axis].map(v => v * angle))));
      }
    }, true);
  };
}

// --- panels ----------------------------------------------------------------------------------------
const DIRECTIONS = ["front", "right", "up"];
const fields = []; // [input, the object that has its number, key]

/** Adds a row of number fields to a panel: its title, and [short, label, object, key, limits, step] of each. */
function row(panel, title, ...columns) {
  panel.append(make("span", { textContent: title }));
  for (const [short, ariaLabel, owner, key, [min, max], step = "any"] of columns) {
    const input = make("input", { type: "number", ariaLabel, min, max, step });
    input.addEventListener("change", () => {
      if (input.value !== "" && input.checkValidity()) edit(() => { owner()[key] = +input.value; });
      else show();
    });
    panel.append(make("label", {}, short, input));
    fields.push([input, owner, key]);
  }
}

const middle = ["x", "y"].map((key, k) => [DIRECTIONS[k], `Middle of the object, ${DIRECTIONS[k]}`, model, key, [-2, 2]]);
row($("object"), "Turn, place", ["degrees", "Direction of the object, degrees", model, "turn", LIMITS.turn], ...middle);
for (const [key, title] of [["at", "Position"], ["size", "Size"], ["turn", "Turn"]]) {
  row($("numbers"), title, ...DIRECTIONS.map((direction, k) => [direction, `${title}, ${direction}`, () => selected()?.[key], k, LIMITS[key]]));
}
const sides = ["sides", "Sides of a prism", selected, "sides", [3, 12], 1];
row($("numbers"), "Shape", ["top", "Size of the top, 0 to 1", selected, "taper", [0, 1]], sides);

function show() {
  const { cases } = data, { at, entries } = state, part = selected();
  for (const [input, owner, key] of fields) {
    if (input !== document.activeElement || !input.value) input.value = +(owner()?.[key] ?? 0).toFixed(4);
  }
  $("case-name").textContent = `${cases[at].name} of ${cases.length}`;
  $("undo").disabled = !entry().undo.length;
  $("redo").disabled = !entry().redo.length;
  $("done").textContent = entry().done ? "Mark as not done" : at < cases.length - 1 ? "Done, next case" : "Done";
  $("part").hidden = !part;
  for (const mode of MODES) $(mode).ariaPressed = mode === state.mode;
  for (const axis of ["x", "y"]) $(`mirror-${axis}`).checked = !!part?.mirror.includes(axis);
  $("parts").replaceChildren(...model().parts.map(({ kind, mirror }, number) => {
    const swatch = make("i", { style: `background: rgb(${COLOURS[number % COLOURS.length]})` });
    const ariaPressed = number === state.selected, onclick = () => { state.selected = number; show(); };
    const copies = mirror ? ` × ${2 ** mirror.length}` : "";
    return make("li", {}, make("button", { ariaPressed, onclick }, swatch, `${number + 1} ${kind}${copies}`));
  }));
  [...$("strip").children].forEach((button, i) => {
    Object.assign(button, { ariaCurrent: i === at, className: entries[i].done ? "done" : "" });
  });
  $("problem").textContent = "";
  showClock();
  views.forEach(view => view.redraw());
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
$("strip").append(...data.cases.map(({ name, image }, i) => make("button", { onclick: () => open(i) }, make("img", { src: image, alt: name }))));
const tool = (id, title) => make("button", { id, title, textContent: id[0].toUpperCase() + id.slice(1) });
$("kinds").append(...KINDS.map(kind => tool(kind, "")));
$("modes").append(...MODES.map(mode => tool(mode, `Key ${mode[0].toUpperCase()}`)));
for (const [id, act] of Object.entries(actions)) $(id).addEventListener("click", act);
for (const axis of ["x", "y"]) $(`mirror-${axis}`).addEventListener("change", () => edit(() => {
  selected().mirror = ["x", "y"].filter(axis => $(`mirror-${axis}`).checked).join("");
}));
for (const id of ["overlay", "grid"]) $(id).addEventListener("change", show);
$("open").addEventListener("change", async () => {
  try {
    restore(await $("open").files[0].text());
    show();
  } catch (error) {
    $("problem").textContent = `This file cannot be used: ${error.message}.`;
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
  const letter = event.key.toLowerCase();
  const act = event.ctrlKey || event.metaKey
    ? { z: event.shiftKey ? actions.redo : actions.undo, d: actions.duplicate, s: actions.save }[letter]
    : { m: actions.move, t: actions.turn, s: actions.size, g: actions.ground, delete: actions.delete, escape: () => { state.selected = -1; show(); } }[letter];
  if (!act) return;
  event.preventDefault();
  act();
});

try {
  const saved = localStorage.getItem(KEY);
  if (saved) restore(saved);
} catch { /* what this browser has kept is not usable; it stays until something is changed here */ }
kept = savedModels(false);
open(0);
addEventListener("pagehide", keep);
globalThis.human = { state, views, insert, meshesOf, model, toWorld, project };
