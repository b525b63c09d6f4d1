// The photo with its mask, and the tools Snap, Brush and Fill for pointer, finger and keys.

import { HINT, region } from "./segment.js";

const HISTORY = 12;
const OBJECT = 1, BACK = 2; // kinds of strokes
const VEIL = [18, 24, 40, 165], EDGE = [255, 176, 32, 255], STROKES = { [OBJECT]: [52, 199, 123, 190], [BACK]: [235, 78, 78, 190] };

export class Editor {
  /** onchange(): the mask has changed. snap(photo, hints): resolves to a mask, or null. */
  constructor(canvas, { onchange, snap }) {
    Object.assign(this, { canvas, onchange, snap, tool: "snap", adding: true, size: 24, photo: null });
    this.overlay = document.createElement("canvas");
    this.history = [];
    this.cursor = null;
    this.listen();
  }

  /** Shows a photo with a mask (all zeros: none yet). */
  open(photo, mask) {
    this.photo = photo;
    for (const canvas of [this.canvas, this.overlay]) {
      canvas.width = photo.width;
      canvas.height = photo.height;
    }
    this.canvas.style.aspectRatio = `${photo.width} / ${photo.height}`;
    this.canvas.style.setProperty("--ratio", photo.width / photo.height);
    this.mask = mask;
    this.strokes = new Uint8Array(mask.length);
    this.drawnStrokes = false;
    this.history = [];
    this.cursor = null;
    this.redraw();
  }

  /** Share of the photo that the mask covers. */
  get share() {
    let sum = 0;
    for (const m of this.mask) sum += m;
    return sum / this.mask.length;
  }

  remember() {
    this.history.push([this.mask.slice(), this.strokes.slice()]);
    if (this.history.length > HISTORY) this.history.shift();
  }

  undo() {
    if (!this.history.length) return false;
    [this.mask, this.strokes] = this.history.pop();
    this.changed();
    return true;
  }

  /** Replaces the mask and discards the strokes. */
  replace(mask) {
    this.remember();
    this.mask = mask;
    this.strokes = new Uint8Array(mask.length);
    this.changed();
  }

  invert() {
    this.replace(this.mask.map(m => 1 - m));
  }

  clear() {
    this.replace(new Uint8Array(this.mask.length));
  }

  changed() {
    this.redraw();
    this.onchange();
  }

  // --- strokes ---------------------------------------------------------------------------------

  radius() { // of the brush in pixels of the photo
    return Math.max(1, this.size / 2 * this.photo.width / Math.max(1, this.canvas.clientWidth));
  }

  dab(x, y, adding) {
    const { width, height } = this.photo, r = this.radius();
    const left = Math.max(0, Math.floor(x - r)), right = Math.min(width, Math.ceil(x + r) + 1);
    const top = Math.max(0, Math.floor(y - r)), bottom = Math.min(height, Math.ceil(y + r) + 1);
    for (let row = top; row < bottom; row++) {
      for (let column = left; column < right; column++) {
        if ((column + 0.5 - x) ** 2 + (row + 0.5 - y) ** 2 > r * r) continue;
        const i = row * width + column;
        this.strokes[i] = adding ? OBJECT : BACK;
        if (this.tool === "brush") this.mask[i] = +adding;
      }
    }
    this.redraw([left - 3, top - 3, right + 3, bottom + 3]);
  }

  line(from, to, adding) {
    const steps = Math.max(1, Math.ceil(Math.hypot(to[0] - from[0], to[1] - from[1]) / Math.max(1, this.radius() / 2)));
    for (let k = 1; k <= steps; k++) {
      this.dab(from[0] + (to[0] - from[0]) * k / steps, from[1] + (to[1] - from[1]) * k / steps, adding);
    }
  }

  fill(x, y, adding) {
    const { width, height } = this.photo;
    const column = Math.min(width - 1, Math.max(0, Math.floor(x))), row = Math.min(height - 1, Math.max(0, Math.floor(y)));
    this.remember();
    const found = region(this.photo, column, row, this.size);
    for (let i = 0; i < found.length; i++) {
      if (!found[i]) continue;
      this.mask[i] = +adding;
      this.strokes[i] = adding ? OBJECT : BACK;
    }
    this.changed();
  }

  async finish() {
    if (this.tool === "brush") {
      this.changed();
      return;
    }
    this.drawnStrokes = false;
    const { photo, strokes } = this;
    const hints = this.mask.map((m, i) => strokes[i] === OBJECT ? HINT.object : strokes[i] === BACK ? HINT.back : m);
    if (!this.mask.includes(1)) { // no mask yet: the object is near the strokes
      for (let i = 0; i < hints.length; i++) if (hints[i] === HINT.maybeBack) hints[i] = HINT.maybeObject;
      this.frame(hints);
    }
    const mask = await this.snap(photo, hints);
    if (this.photo !== photo || strokes !== this.strokes) return; // another photo, or undone
    if (mask) {
      for (let i = 0; i < mask.length; i++) if (strokes[i]) mask[i] = +(strokes[i] === OBJECT);
      this.mask = mask;
    }
    this.changed();
  }

  frame(hints) { // pixels of the border without a stroke are background
    const { width, height } = this.photo, band = Math.max(2, Math.round(0.02 * Math.max(width, height)));
    for (let i = 0; i < hints.length; i++) {
      const x = i % width, y = (i - x) / width;
      const outside = x < band || y < band || x >= width - band || y >= height - band;
      if (outside && hints[i] === HINT.maybeObject) hints[i] = HINT.back;
    }
  }

  // --- drawing ---------------------------------------------------------------------------------

  redraw(box) {
    const { width, height } = this.photo, [left, top, right, bottom] = box ?? [0, 0, width, height];
    const x0 = Math.max(0, left), y0 = Math.max(0, top), x1 = Math.min(width, right), y1 = Math.min(height, bottom);
    if (x1 <= x0 || y1 <= y0) return;
    const image = new ImageData(x1 - x0, y1 - y0), out = new Uint32Array(image.data.buffer);
    const pack = ([r, g, b, a]) => (a << 24 | b << 16 | g << 8 | r) >>> 0;
    const veil = pack(VEIL), edge = pack(EDGE), marks = [0, pack(STROKES[OBJECT]), pack(STROKES[BACK])];
    const reach = Math.max(1, Math.round(1.2 * width / Math.max(1, this.canvas.clientWidth)));
    const { mask, strokes } = this;
    const at = (x, y) => x < 0 || y < 0 || x >= width || y >= height ? 0 : mask[y * width + x];
    for (let y = y0, k = 0; y < y1; y++) {
      for (let x = x0; x < x1; x++, k++) {
        const i = y * width + x;
        if (this.drawnStrokes && strokes[i]) out[k] = marks[strokes[i]];
        else if (!mask[i]) out[k] = veil;
        else if (!at(x - reach, y) || !at(x + reach, y) || !at(x, y - reach) || !at(x, y + reach)) out[k] = edge;
      }
    }
    this.overlay.getContext("2d").putImageData(image, x0, y0);
    const context = this.canvas.getContext("2d");
    context.drawImage(this.photo.bitmap, x0, y0, x1 - x0, y1 - y0, x0, y0, x1 - x0, y1 - y0);
    context.drawImage(this.overlay, x0, y0, x1 - x0, y1 - y0, x0, y0, x1 - x0, y1 - y0);
    if (this.cursor) this.drawCursor(context);
  }

  drawCursor(context) {
    const [x, y] = this.cursor, r = this.tool === "fill" ? this.photo.width / 60 : this.radius();
    for (const [colour, width] of [["#000", 4], ["#fff", 2]]) {
      context.strokeStyle = colour;
      context.lineWidth = width * this.photo.width / Math.max(1, this.canvas.clientWidth);
      context.beginPath();
      context.arc(x, y, r, 0, 7);
      context.stroke();
    }
  }

  // --- input -----------------------------------------------------------------------------------

  listen() {
    const { canvas } = this;
    let last = null, adding = true;
    const place = event => {
      const box = canvas.getBoundingClientRect();
      return [(event.clientX - box.left) / box.width * this.photo.width, (event.clientY - box.top) / box.height * this.photo.height];
    };
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("pointerdown", event => {
      if (!this.photo || last || (event.button !== 0 && event.button !== 2)) return;
      canvas.setPointerCapture(event.pointerId);
      this.cursor = null;
      adding = this.adding !== (event.button === 2 || event.altKey);
      if (this.tool === "fill") {
        this.fill(...place(event), adding);
        return;
      }
      this.remember();
      this.drawnStrokes = this.tool === "snap";
      last = place(event);
      this.dab(...last, adding);
    });
    canvas.addEventListener("pointermove", event => {
      if (!last) return;
      const next = place(event);
      this.line(last, next, adding);
      last = next;
    });
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, () => {
        if (!last) return;
        last = null;
        this.finish();
      });
    }
    canvas.addEventListener("keydown", event => this.key(event));
    canvas.addEventListener("blur", () => {
      if (!this.cursor) return;
      this.cursor = null;
      this.redraw();
    });
  }

  key(event) {
    if (!this.photo || event.ctrlKey || event.metaKey || event.altKey) return;
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const { width, height } = this.photo;
    if (moves[event.key]) {
      const step = width * (event.shiftKey ? 0.06 : 0.015), [dx, dy] = moves[event.key];
      const [x, y] = this.cursor ?? [width / 2, height / 2];
      this.cursor = [Math.min(width - 1, Math.max(0, x + dx * step)), Math.min(height - 1, Math.max(0, y + dy * step))];
      this.redraw();
    } else if (event.key === " " || event.key === "Enter") {
      this.cursor ??= [width / 2, height / 2];
      if (this.tool === "fill") {
        this.fill(...this.cursor, this.adding);
      } else {
        this.remember();
        this.dab(...this.cursor, this.adding);
        this.finish();
      }
    } else {
      return;
    }
    event.preventDefault();
  }
}
