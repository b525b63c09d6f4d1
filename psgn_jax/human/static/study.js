// The models of all cases: edits with undo, the time spent, saving in the browser and as a file.

import { KINDS, clamp, crossesItself, signedArea } from "./geometry.js";

export const LIMITS = { at: 4, least: 0.002, size: 8, parts: 200, corners: 64, sides: 12 };
const FORMAT = "psgn human study", HISTORY = 200, IDLE = 60;

export const emptyModel = () => ({ turn: 0, x: 0, y: 0, parts: [] });

function limit(part) {
  part.at = part.at.map(c => clamp(c, -LIMITS.at, LIMITS.at));
  part.size = part.size.map(c => clamp(c, LIMITS.least, LIMITS.size));
}
const copy = value => JSON.parse(JSON.stringify(value));
const tidy = value => JSON.parse(JSON.stringify(value, (_, v) => typeof v === "number" ? Math.round(v * 1e5) / 1e5 : v));

export class Study {
  /** `data` is what `psgn human` wrote into the page: the study's id and its cases. */
  constructor(data) {
    this.id = data.id;
    this.cases = data.cases;
    this.key = `psgn-human-${data.id}`;
    this.entries = data.cases.map(() => ({ seconds: 0, done: false, model: emptyModel(), undo: [], redo: [] }));
    this.at = 0;
    this.version = 0;
    this.active = -Infinity;
  }

  get entry() { return this.entries[this.at]; }
  get model() { return this.entry.model; }

  /** Changes the model. Consecutive edits with the same `key` are undone in one step. */
  edit(change, key = null) {
    const entry = this.entry, before = JSON.stringify(entry.model);
    change(entry.model);
    entry.model.parts.forEach(limit);
    if (JSON.stringify(entry.model) === before) return;
    if (key === null || key !== this.last) {
      entry.undo.push(before);
      if (entry.undo.length > HISTORY) entry.undo.shift();
    }
    entry.redo = [];
    this.last = key;
    this.changed();
  }

  /** The next edit is a new step of undo. */
  settle() { this.last = null; }

  undo() { this.step(this.entry.undo, this.entry.redo); }
  redo() { this.step(this.entry.redo, this.entry.undo); }
  step(from, to) {
    if (!from.length) return;
    to.push(JSON.stringify(this.model));
    this.entry.model = JSON.parse(from.pop());
    this.settle();
    this.changed();
  }

  changed() {
    this.version++;
    this.touch();
    this.onchange?.();
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.save(), 250);
  }

  // --- time ------------------------------------------------------------------------------------

  /** Notes that the person has done something. */
  touch() { this.active = performance.now(); }

  /** Adds seconds to the open case, unless the page is hidden or was not used for a minute; returns whether it did. */
  tick(seconds) {
    const works = !document.hidden && performance.now() - this.active < 1000 * IDLE;
    if (works) this.entry.seconds += seconds;
    return works;
  }

  // --- storage and files -----------------------------------------------------------------------

  toJSON() {
    return {
      format: FORMAT, version: 1, study: this.id,
      cases: this.cases.map((item, i) => {
        const { seconds, done, model } = this.entries[i];
        return { case: item.name, seconds: Math.round(seconds), done, ...tidy(model) };
      }),
    };
  }

  save() {
    clearTimeout(this.waiting);
    if (this.stale) return; // another window saves this study
    try {
      localStorage.setItem(this.key, JSON.stringify({ ...this.toJSON(), open: this.at }));
      this.onsaved?.(true);
    } catch {
      this.onsaved?.(false);
    }
  }

  /** Restores what this browser has saved; returns whether there was anything. */
  restore() {
    let text = null;
    try { text = localStorage.getItem(this.key); } catch { return false; }
    if (!text) return false;
    try {
      this.read(text);
      const open = JSON.parse(text).open;
      if (Number.isInteger(open) && open >= 0 && open < this.cases.length) this.at = open;
    } catch { return false; }
    return true;
  }

  /** Replaces all models by those of a file. Throws an `Error` with one sentence if the file cannot be used for this study. */
  read(text) {
    let value;
    try { value = JSON.parse(text); } catch { throw new Error("This file is not JSON; expected one that this page has saved."); }
    const fail = why => { throw new Error(`This file cannot be used: ${why}.`); };
    if (value?.format !== FORMAT || value.version !== 1) fail("it was not saved by this page");
    if (value.study !== this.id) fail("it belongs to another study");
    if (!Array.isArray(value.cases) || value.cases.length !== this.cases.length) fail(`expected ${this.cases.length} cases`);
    const entries = value.cases.map((item, i) => {
      if (item?.case !== this.cases[i].name) fail(`case ${i + 1} has another name`);
      return { seconds: finite(item.seconds, 0, 1e8) ? item.seconds : 0, done: item.done === true, model: modelOf(item, fail), undo: [], redo: [] };
    });
    this.entries.forEach((old, i) => {
      entries[i].undo = old.model.parts.length ? [...old.undo, JSON.stringify(old.model)] : [];
    });
    this.entries = entries;
    this.settle();
    this.version++;
  }
}

const finite = (v, low, high) => typeof v === "number" && v >= low && v <= high;

function modelOf(item, fail) {
  for (const [name, reach] of [["turn", 360], ["x", 2], ["y", 2]]) if (!finite(item[name], -reach, reach)) fail(`${name} of ${item.case} is wrong`);
  if (!Array.isArray(item.parts) || item.parts.length > LIMITS.parts) fail(`${item.case} needs 0 to ${LIMITS.parts} parts`);
  const parts = item.parts.map((part, i) => {
    const wrong = partProblem(part);
    if (wrong) fail(`${wrong} of part ${i + 1} of ${item.case} is wrong`);
    const { kind, size, at, turn, mirror, taper, sides, outline } = part;
    return copy({ kind, size, at, turn, mirror, taper, sides, outline });
  });
  return { turn: item.turn, x: item.x, y: item.y, parts };
}

/** The name of the first invalid field of a part, or "". */
export function partProblem(part) {
  const three = (v, low, high) => Array.isArray(v) && v.length === 3 && v.every(c => finite(c, low, high));
  if (!KINDS.includes(part?.kind)) return "kind";
  if (!three(part.size, LIMITS.least, LIMITS.size)) return "size";
  if (!three(part.at, -LIMITS.at, LIMITS.at)) return "at";
  if (!three(part.turn, -360, 360)) return "turn";
  if (!["", "x", "y", "xy"].includes(part.mirror)) return "mirror";
  if (!finite(part.taper, 0, 1)) return "taper";
  if (!Number.isInteger(part.sides) || !finite(part.sides, 3, LIMITS.sides)) return "sides";
  return part.kind === "outline" ? outlineProblem(part.outline) : Array.isArray(part.outline) && !part.outline.length ? "" : "outline";
}

function outlineProblem(outline) {
  const good = Array.isArray(outline) && outline.length >= 3 && outline.length <= LIMITS.corners
    && outline.every(p => Array.isArray(p) && p.length === 2 && p.every(c => finite(c, -0.5, 0.5)));
  return good && !crossesItself(outline) && signedArea(outline) > 1e-6 ? "" : "outline";
}
