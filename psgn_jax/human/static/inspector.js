// The list of parts, and the numbers of the selected part and of the object.

import { COLOURS } from "./render.js";
import { LIMITS, partProblem } from "./study.js";

const $ = id => document.getElementById(id);
const AXIS_NAMES = ["front", "right", "up"], LETTERS = ["x", "y", "z"];
const ROWS = [["at", "Position", 0.01], ["turn", "Turn", 5], ["size", "Size", 0.01]];
export const KIND_NAMES = { box: "Box", cylinder: "Cylinder", cone: "Cone", sphere: "Sphere", prism: "Prism", outline: "Outline" };

export const partName = (part, number) => `${KIND_NAMES[part.kind]} ${number + 1}`;

function field(label, step, limits) {
  const input = document.createElement("input");
  Object.assign(input, { type: "number", step: "any", min: limits[0], max: limits[1] });
  input.dataset.step = step;
  input.setAttribute("aria-label", label);
  return input;
}

function element(tag, text, name = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = name;
  return made;
}

export class Inspector {
  constructor(editor) {
    this.editor = editor;
    this.build();
    this.listen();
  }

  build() {
    const limits = { at: [-LIMITS.at, LIMITS.at], turn: [-360, 360], size: [LIMITS.least, LIMITS.size] };
    const heads = () => AXIS_NAMES.map((name, k) => element("b", name, LETTERS[k]));
    $("fields").append(element("span", ""), ...heads());
    this.inputs = {};
    for (const [name, title, step] of ROWS) {
      this.inputs[name] = AXIS_NAMES.map(axis => field(name === "turn" ? `${title} about ${axis}, degrees` : `${title}, ${axis}`, step, limits[name]));
      $("fields").append(element("span", title), ...this.inputs[name]);
    }
    this.middle = ["x", "y"].map((name, k) => field(`Middle of the object, ${AXIS_NAMES[k]}`, 0.01, [-2, 2]));
    $("middle").append(element("span", "Middle"), ...this.middle);
  }

  listen() {
    const { editor } = this;
    for (const [name] of ROWS) {
      this.inputs[name].forEach((input, k) => this.number(input, `${name} ${k}`, value => editor.editPart(part => { part[name][k] = value; }, `${name} ${k}`)));
    }
    this.middle.forEach((input, k) => this.number(input, `middle ${k}`, value => editor.study.edit(model => { model["xy"[k]] = value; }, `middle ${k}`)));
    const turn = value => editor.study.edit(model => { model.turn = value; }, "direction");
    $("direction").addEventListener("input", () => turn(+$("direction").value));
    $("direction").addEventListener("change", () => editor.study.settle());
    this.number($("direction-number"), "direction", turn);
    $("taper").addEventListener("input", () => editor.editPart(part => { part.taper = +$("taper").value; }, "taper"));
    $("taper").addEventListener("change", () => editor.study.settle());
    this.number($("sides"), "sides", value => editor.editPart(part => { part.sides = Math.round(value); }, "sides"));
    $("corners").addEventListener("change", () => this.readCorners());
    for (const button of document.querySelectorAll("[data-mirror]")) button.addEventListener("click", () => editor.toggleMirror(button.dataset.mirror));
  }

  /** Applies a number while it is typed or stepped; these edits are one step of undo until the field is left. */
  number(input, key, change) {
    input.addEventListener("input", () => { if (input.value !== "" && input.checkValidity()) change(+input.value); });
    input.addEventListener("change", () => { this.editor.study.settle(); this.show(true); });
    input.addEventListener("blur", () => { this.editor.study.settle(); this.show(true); });
    input.addEventListener("keydown", event => {
      const sign = { ArrowUp: 1, ArrowDown: -1 }[event.key], step = +input.dataset.step;
      if (!sign || !step) return;
      event.preventDefault();
      const value = +input.value + sign * step * (event.shiftKey ? 5 : 1);
      change(Math.min(+input.max, Math.max(+input.min, Math.round(value * 1e4) / 1e4)));
      input.value = shown(Math.min(+input.max, Math.max(+input.min, value)));
    });
  }

  readCorners() {
    const { editor } = this, corners = $("corners").value.trim().split(/\n+/).map(line => line.trim().split(/[\s,;]+/).map(Number));
    const draft = { ...editor.part, outline: corners };
    if (partProblem(draft)) editor.complain("These corners are not an outline; expected 3 to 64 lines of two numbers from -0.5 to 0.5, counter-clockwise and without crossings.");
    else editor.editPart(part => { part.outline = corners; });
    this.show();
  }

  /** Shows the state; with `force` also in the field that has the focus. */
  show(force = false) {
    const { editor } = this, { model } = editor.study, { part, selected } = editor;
    this.list(model, selected);
    $("numbers").hidden = !part || !!editor.outline;
    $("drawing").hidden = !editor.outline;
    $("direction-hint").hidden = !!model.parts.length;
    $("hint").hidden = !!model.parts.length || !!editor.outline;
    const put = (input, value) => { if (force || input !== document.activeElement) input.value = shown(value); };
    put($("direction-number"), model.turn);
    $("direction").value = model.turn;
    this.middle.forEach((input, k) => put(input, model["xy"[k]]));
    if (!part) return;
    $("part-title").textContent = partName(part, selected);
    for (const [name] of ROWS) this.inputs[name].forEach((input, k) => put(input, part[name][k]));
    $("taper-row").hidden = part.kind === "sphere";
    $("taper").value = part.taper;
    $("taper-value").textContent = `${Math.round(100 * part.taper)} %`;
    $("sides-row").hidden = part.kind !== "prism";
    put($("sides"), part.sides);
    $("corners-row").hidden = part.kind !== "outline";
    if (part.kind === "outline" && $("corners") !== document.activeElement) $("corners").value = part.outline.map(p => p.map(shown).join(" ")).join("\n");
    for (const button of document.querySelectorAll("[data-mirror]")) button.setAttribute("aria-pressed", part.mirror.includes(button.dataset.mirror));
    $("split").disabled = !part.mirror;
  }

  list(model, selected) {
    const stamp = JSON.stringify([selected, this.editor.study.at, model.parts.map(p => [p.kind, p.mirror])]);
    if (stamp === this.listed) return;
    this.listed = stamp;
    const focused = $("parts").contains(document.activeElement);
    $("parts").replaceChildren(...model.parts.map((part, number) => {
      const item = document.createElement("li"), button = document.createElement("button"), swatch = document.createElement("i");
      swatch.style.background = `rgb(${COLOURS[number % COLOURS.length].join()})`;
      button.type = "button";
      button.setAttribute("aria-pressed", number === selected);
      button.append(swatch, partName(part, number));
      const copies = 2 ** part.mirror.length;
      if (copies > 1) button.append(element("span", `× ${copies}`));
      button.addEventListener("click", () => this.editor.select(number));
      item.append(button);
      return item;
    }));
    if (focused) $("parts").querySelector("[aria-pressed=true]")?.focus();
  }
}

const shown = value => String(Math.round(value * 1000) / 1000);
