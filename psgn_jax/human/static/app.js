// The page: tools, keys, cases, files. `study` has the state; the two views draw it.

import { about, add, anglesOf, clamp, copiesOf, multiply, objText, rotation } from "./geometry.js";
import { LIMITS, Study } from "./study.js";
import { lowestPoint } from "./handles.js";
import { Inspector, partName } from "./inspector.js";
import { Outline } from "./outline.js";
import { Scene, View } from "./view.js";

const $ = id => document.getElementById(id);
const each = (selector, act) => document.querySelectorAll(selector).forEach(act);

const study = new Study(JSON.parse($("data").textContent));
const editor = {
  study, selected: -1, mode: "move", snap: true, overlay: "wireframe", grid: true, outline: null,
  get part() { return study.model.parts[this.selected] ?? null; },

  redraw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = null;
      scene.update(this);
      views.forEach(view => view.draw(scene));
    });
  },

  select(number) {
    study.settle();
    this.selected = number;
    this.show();
  },

  /** Changes the selected part; see `Study.edit` for `key`. */
  editPart(change, key = null) {
    const number = this.selected;
    if (number >= 0) study.edit(model => change(model.parts[number]), key && `${number} ${key}`);
  },

  insert(part, message) {
    if (study.model.parts.length >= LIMITS.parts) return this.complain(`A model can have at most ${LIMITS.parts} parts.`);
    study.edit(model => model.parts.push(part));
    this.select(study.model.parts.length - 1);
    this.say(message ?? `${partName(part, this.selected)} added.`);
  },

  toggleMirror(axis) {
    const { mirror } = this.part;
    this.editPart(part => { part.mirror = ["x", "y"].filter(a => mirror.includes(a) !== (a === axis)).join(""); });
    this.say(this.part.mirror.includes(axis) ? "Mirrored." : "Mirror copy removed.");
  },

  outlineChanged() {
    this.say(`${this.outline.points.length} points.`);
    this.show();
  },

  finishOutline() {
    try {
      const part = this.outline.part();
      this.outline = null;
      this.insert(part);
    } catch (error) { this.complain(error.message); }
    this.show();
  },

  say(text) {
    $("problem").hidden = true;
    $("status").textContent = text;
    $("status").classList.remove("gone");
    clearTimeout(this.fading);
    this.fading = setTimeout(() => $("status").classList.add("gone"), 2500);
  },

  complain(text) {
    $("problem").textContent = text;
    $("problem").hidden = false;
  },

  show() {
    if (this.selected >= study.model.parts.length) this.selected = -1;
    each("[data-mode]", b => b.setAttribute("aria-pressed", b.dataset.mode === this.mode));
    each("[data-add]", b => b.setAttribute("aria-pressed", b.dataset.add === "outline" && !!this.outline));
    $("snap").setAttribute("aria-pressed", this.snap);
    $("undo").disabled = !study.entry.undo.length;
    $("redo").disabled = !study.entry.redo.length;
    inspector.show();
    showCases();
    this.redraw();
  },
};

const scene = new Scene();
const views = [new View($("image-view").querySelector(".stage"), true, editor), new View($("free-view").querySelector(".stage"), false, editor)];
const inspector = new Inspector(editor);

// --- cases -------------------------------------------------------------------------------------

function showCases() {
  const { at, cases, entries } = study;
  $("case-name").textContent = `${cases[at].name} of ${cases.length}`;
  $("previous").disabled = at === 0;
  $("next").disabled = at === cases.length - 1;
  $("done").textContent = entries[at].done ? "Mark as not done" : at < cases.length - 1 ? "Done, next case" : "Done";
  [...$("strip").children].forEach((button, i) => {
    button.setAttribute("aria-current", i === at);
    button.className = entries[i].done ? "done" : entries[i].model.parts.length ? "begun" : "";
    button.setAttribute("aria-label", `${cases[i].name}${entries[i].done ? ", done" : entries[i].model.parts.length ? ", begun" : ""}`);
  });
  showClock();
}

function open(at) {
  study.settle();
  study.at = Math.min(cases.length - 1, Math.max(0, at));
  study.version++;
  study.touch();
  Object.assign(editor, { selected: -1, outline: null });
  $("picture").src = cases[study.at].image;
  $("strip").children[study.at]?.scrollIntoView({ block: "nearest", inline: "nearest" });
  views.forEach(view => view.reset());
  study.save();
  editor.show();
}

const { cases } = study;
cases.forEach((item, i) => {
  const button = document.createElement("button"), picture = document.createElement("img"), name = document.createElement("span");
  button.type = "button";
  picture.src = item.image;
  picture.alt = "";
  name.textContent = i + 1;
  button.append(picture, name);
  button.addEventListener("click", () => open(i));
  $("strip").append(button);
});

function showClock() {
  const seconds = Math.round(study.entry.seconds);
  $("clock").textContent = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
}

// --- actions -------------------------------------------------------------------------------------

function newPart(kind) {
  const prism = kind === "prism";
  return {
    kind, size: [0.4, 0.4, 0.4], at: [0, 0, 0.2], turn: prism ? [90, 0, 90] : [0, 0, 0],
    mirror: "", taper: kind === "cone" ? 0 : 1, sides: 3, outline: [],
  };
}

function duplicate() {
  if (!editor.part) return;
  const part = JSON.parse(JSON.stringify(editor.part));
  part.at = add(part.at, [0.05, 0.05, 0]);
  editor.insert(part, "Duplicated.");
}

function remove() {
  if (!editor.part) return;
  const { selected } = editor;
  study.edit(model => model.parts.splice(selected, 1));
  editor.select(-1);
  editor.say("Deleted.");
}

/** Turns symmetric copies into separate parts. A mirrored primitive is a rotated one, except for an outline: its corners are mirrored. */
function split() {
  const { part } = editor;
  if (!part?.mirror) return;
  const parts = copiesOf(part).map(signs => mirrored(part, signs));
  if (study.model.parts.length + parts.length - 1 > LIMITS.parts) return editor.complain(`A model can have at most ${LIMITS.parts} parts.`);
  study.edit(model => model.parts.splice(editor.selected, 1, ...parts));
  editor.show();
  editor.say(`${parts.length} separate parts.`);
}

/** The reflection S of a part: S R v = (S R M) (M v), where M mirrors x of the part itself. */
function mirrored(part, [sx, sy]) {
  const made = JSON.parse(JSON.stringify({ ...part, mirror: "" })), flip = sx * sy < 0 ? -1 : 1;
  made.at = [sx * part.at[0], sy * part.at[1], part.at[2]];
  const turned = multiply(multiply([sx, 0, 0, 0, sy, 0, 0, 0, 1], rotation(part.turn)), [flip, 0, 0, 0, 1, 0, 0, 0, 1]);
  made.turn = anglesOf(turned).map(a => Math.round(a * 1e5) / 1e5 + 0);
  if (flip < 0) made.outline = made.outline.map(([u, v]) => [-u, v]).reverse();
  return made;
}

function toGround() {
  if (!editor.part) return;
  editor.editPart(part => { part.at[2] -= lowestPoint(part); });
  editor.say("On the ground.");
}

function startOutline(plane) {
  const depth = editor.part ? editor.part.at["xyz".indexOf(plane)] : 0;
  editor.outline = new Outline(plane, depth);
  editor.show();
}

function cancelOutline() {
  editor.outline = null;
  editor.show();
}

function undo(back) {
  if (back) study.undo();
  else study.redo();
  editor.show();
  editor.say(back ? "Undone." : "Redone.");
}

/** Moves, turns or resizes the selected part by one step of the arrow keys. */
function nudge(axis, sign, large) {
  const key = `nudge ${editor.mode} ${axis}`, far = large ? 5 : 1;
  editor.editPart(part => {
    if (editor.mode === "move") part.at[axis] = clamp(part.at[axis] + 0.01 * sign * far, -LIMITS.at, LIMITS.at);
    else if (editor.mode === "size") part.size[axis] = clamp(part.size[axis] + 0.01 * sign * far, 0.005, LIMITS.size);
    else {
      const unit = [0, 1, 2].map(k => +(k === axis)), turned = multiply(about(unit, sign * far * Math.PI / 180), rotation(part.turn));
      part.turn = anglesOf(turned);
    }
  }, key);
}

// --- files -----------------------------------------------------------------------------------------

function download(name, text, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

async function openFile(file) {
  try {
    if (file.size > 20e6) throw new Error("This file is larger than 20 MB; expected one that this page has saved.");
    study.read(await file.text());
    study.save();
    editor.select(-1);
    editor.say("Opened.");
  } catch (error) { editor.complain(error.message); }
}

// --- wiring ------------------------------------------------------------------------------------------

study.onchange = () => editor.show();
study.onsaved = good => {
  $("saved").textContent = good ? "Saved in this browser" : "This browser cannot save your work: press Save all before you leave";
};
const actions = {
  previous: () => open(study.at - 1), next: () => open(study.at + 1),
  undo: () => undo(true), redo: () => undo(false),
  snap: () => { editor.snap = !editor.snap; editor.show(); },
  ground: toGround, duplicate, delete: remove, split,
  finish: () => editor.finishOutline(), cancel: cancelOutline,
  help: () => $("about").showModal(),
  "save-json": () => { download("human.json", JSON.stringify(study, null, 1) + "\n", "application/json"); editor.say("Saved: human.json"); },
  "save-obj": () => {
    const name = cases[study.at].name.toLowerCase().replace(/\W+/g, "-");
    download(`${name}.obj`, objText(study.model, cases[study.at].name), "text/plain");
    editor.say(`Saved: ${name}.obj`);
  },
  done: () => {
    study.entry.done = !study.entry.done;
    study.changed();
    if (study.entry.done && study.at < cases.length - 1) open(study.at + 1);
  },
};
for (const [id, act] of Object.entries(actions)) $(id).addEventListener("click", act);
each("[data-add]", button => button.addEventListener("click", () => {
  if (button.dataset.add !== "outline") editor.insert(newPart(button.dataset.add));
  else if (editor.outline) cancelOutline();
  else startOutline(document.querySelector("[name=plane]:checked").value);
}));
each("[data-mode]", button => button.addEventListener("click", () => { editor.mode = button.dataset.mode; editor.show(); }));
each("[data-look]", button => button.addEventListener("click", () => views[1].lookFrom(button.dataset.look)));
each("[data-reset]", button => button.addEventListener("click", () => views[+button.dataset.reset].reset()));
each("[name=overlay]", input => input.addEventListener("change", () => { editor.overlay = input.value; editor.redraw(); }));
each("[name=plane]", input => input.addEventListener("change", () => startOutline(input.value)));
$("grid").addEventListener("change", () => { editor.grid = $("grid").checked; editor.redraw(); });
$("open").addEventListener("change", () => {
  const [file] = $("open").files;
  if (file) openFile(file);
  $("open").value = "";
});
for (const name of ["pointerdown", "keydown", "input"]) addEventListener(name, () => study.touch(), true);
addEventListener("pagehide", () => study.save());
document.addEventListener("visibilitychange", () => document.hidden && study.save());
addEventListener("storage", event => {
  if (event.key !== study.key) return;
  study.stale = true;
  editor.complain("This study is open in another window. This window no longer saves your work; reload it to continue here.");
});
let seconds = 0;
setInterval(() => {
  if (!study.tick(1)) return;
  showClock();
  if (++seconds % 10 === 0) study.save();
}, 1000);

const STEPS = { ArrowLeft: [1, -1], ArrowRight: [1, 1], ArrowUp: [2, 1], ArrowDown: [2, -1], PageUp: [0, -1], PageDown: [0, 1] };
views.forEach(view => view.top.addEventListener("keydown", event => {
  const step = STEPS[event.key], zoom = { "+": 1.15, "=": 1.15, "-": 1 / 1.15 }[event.key];
  if (event.ctrlKey || event.metaKey || (!step && !zoom)) return;
  event.preventDefault();
  if (zoom) view.zoomBy(zoom);
  else if (editor.part && !event.altKey) nudge(...step, event.shiftKey);
  else view.turnBy(step[0] === 1 ? -0.1 * step[1] : 0, step[0] === 2 ? 0.08 * step[1] : 0);
}));

const typing = target => target.matches("input:not([type=radio]):not([type=checkbox]):not([type=range]), textarea");
addEventListener("keydown", event => {
  if ($("about").open || typing(event.target)) return;
  const control = event.ctrlKey || event.metaKey, letter = event.key.toLowerCase();
  const act = control
    ? { z: () => undo(!event.shiftKey), y: () => undo(false), d: duplicate, s: actions["save-json"] }[letter]
    : event.altKey ? null : {
      m: () => { editor.mode = "move"; editor.show(); }, t: () => { editor.mode = "turn"; editor.show(); }, s: () => { editor.mode = "size"; editor.show(); },
      g: toGround, delete: remove, backspace: editor.outline ? () => { editor.outline.points.pop(); editor.redraw(); } : remove,
      escape: () => editor.outline ? cancelOutline() : editor.select(-1),
      ...(editor.outline && !event.target.matches("button") ? { enter: () => editor.finishOutline() } : {}),
    }[letter];
  if (!act) return;
  event.preventDefault();
  act();
});

if (!views[0].renderer.gl) editor.complain("This browser cannot draw with WebGL; open the page in a current Firefox, Chrome, Edge or Safari.");
const restored = study.restore();
open(study.at);
if (restored) editor.say("Continuing where you left off.");
else $("about").showModal();
globalThis.human = { study, editor, views };
