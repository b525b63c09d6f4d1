// A view of the model: the image with the model over it through the record's camera, or a free 3D view.

import { add, apply, cross, dot, meshesOf, sub, times, transposed } from "./geometry.js";
import { clipMatrix, orbitCamera, rayThrough, recordCamera } from "./camera.js";
import { beginDrag, drawHandles, handleAt, handlesOf } from "./handles.js";
import { Renderer, edgeStrips, groundStrips, triangles } from "./render.js";

const START = { turn: 0.7, tilt: 0.42, distance: 5.2, target: [0, 0, 0.3] };
const FINGER = 20, MOUSE = 10, STILL = 4;

/** The geometry that both views draw; rebuilt if the model or the selection has changed. */
export class Scene {
  update(editor) {
    const { study, selected } = editor, stamp = [study.at, study.version, selected].join();
    if (stamp === this.stamp) return this;
    this.stamp = stamp;
    this.meshes = meshesOf(study.model);
    this.triangles = triangles(this.meshes);
    this.edges = edgeStrips(this.meshes, selected);
    this.ground = groundStrips(study.model);
    return this;
  }
}

export class View {
  /** `record`: whether the view shows the image; `editor`: the state and the actions of the page. */
  constructor(root, record, editor) {
    Object.assign(this, { root, record, editor, pointers: new Map(), orbit: { ...START }, zoom: 1, pan: [0, 0] });
    this.top = root.querySelector("canvas.top");
    this.image = root.querySelector("img");
    this.renderer = new Renderer(root.querySelector("canvas.solid"));
    this.renderer.onrestored = () => editor.redraw();
    this.listen();
    new ResizeObserver(() => editor.redraw()).observe(root);
  }

  reset() {
    Object.assign(this, { orbit: { ...START }, zoom: 1, pan: [0, 0] });
    this.editor.redraw();
  }

  /** The camera, for a canvas with `dense` pixels per CSS pixel. */
  camera(dense = 1) {
    const { clientWidth: w, clientHeight: h } = this.root;
    if (!this.record) return orbitCamera(this.orbit, w * dense, h * dense);
    const { scale, corner } = this.frame(w, h);
    return recordCamera(this.editor.study.cases[this.editor.study.at], scale * dense, corner.map(c => c * dense));
  }

  /** Scale and upper left corner of the image. */
  frame(w, h) {
    const { width, height } = this.editor.study.cases[this.editor.study.at], scale = Math.min(w / width, h / height) * this.zoom;
    return { scale, corner: [(w - width * scale) / 2 + this.pan[0], (h - height * scale) / 2 + this.pan[1]], width, height };
  }

  draw(scene) {
    const { editor, top, root } = this, dense = Math.min(window.devicePixelRatio || 1, 2);
    const w = Math.max(1, root.clientWidth), h = Math.max(1, root.clientHeight);
    for (const canvas of [top, this.renderer.canvas]) {
      if (canvas.width !== Math.round(w * dense)) canvas.width = Math.round(w * dense);
      if (canvas.height !== Math.round(h * dense)) canvas.height = Math.round(h * dense);
    }
    if (this.record) {
      const { scale, corner, width, height } = this.frame(w, h);
      Object.assign(this.image.style, { left: `${corner[0]}px`, top: `${corner[1]}px`, width: `${width * scale}px`, height: `${height * scale}px` });
    }
    const camera = this.camera(dense), style = this.record ? editor.overlay : "solid";
    const grid = !this.record || editor.grid;
    const matrix = clipMatrix(camera, w * dense, h * dense);
    this.renderer.draw({ ...scene, grid }, matrix, style, this.record ? 0.62 : 1);
    const context = top.getContext("2d");
    context.setTransform(dense, 0, 0, dense, 0, 0);
    context.clearRect(0, 0, w, h);
    if (editor.outline) editor.outline.draw(context, editor.study.model, this.camera());
    else drawHandles(context, this.handles(), this.over);
  }

  handles() {
    const { editor } = this, part = editor.part;
    if (!part || editor.outline || (this.record && editor.overlay === "off")) return [];
    return handlesOf(editor.study.model, part, editor.mode, this.camera());
  }

  /** The nearest part under a pixel: { number, copy, point }; null if there is none. */
  pick(pixel) {
    const ray = rayThrough(this.camera(), pixel);
    let best = null, least = Infinity;
    for (const { number, copy, vertices, faces } of meshesOf(this.editor.study.model)) {
      for (const face of faces) {
        const t = meetTriangle(ray, ...face.map(i => vertices[i]));
        if (t > 0.01 && t < least) { least = t; best = { number, copy, point: add(ray.origin, times(ray.direction, t)) }; }
      }
    }
    return best;
  }

  // --- pointer -----------------------------------------------------------------------------------

  pixel(event) {
    const box = this.top.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  listen() {
    const { top } = this;
    top.addEventListener("pointerdown", event => this.down(event));
    top.addEventListener("pointermove", event => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) top.addEventListener(name, event => this.up(event, name === "pointercancel"));
    top.addEventListener("pointerleave", () => { this.over = null; this.editor.redraw(); });
    top.addEventListener("contextmenu", event => event.preventDefault());
    top.addEventListener("dblclick", () => this.editor.outline && this.editor.finishOutline());
    top.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY * 0.0012), this.pixel(event));
    }, { passive: false });
  }

  down(event) {
    const { editor, top } = this, pixel = this.pixel(event);
    top.focus({ preventScroll: true });
    editor.study.touch();
    top.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, pixel);
    if (this.pointers.size > 1) { this.cancelDrag(); return; }
    this.from = pixel;
    this.still = true;
    if (editor.outline || event.button > 0) return;
    const handle = handleAt(this.handles(), pixel, event.pointerType === "touch" ? FINGER : MOUSE);
    const visible = !this.record || editor.overlay !== "off";
    this.hit = handle || !visible ? null : this.pick(pixel);
    if (handle) this.beginDrag(handle, pixel);
    else if (this.hit && this.hit.number === editor.selected && this.hit.copy === 0) {
      this.beginDrag(event.shiftKey ? { kind: "move", axis: 2 } : { kind: "slide" }, pixel, this.hit.point);
    }
  }

  beginDrag(handle, pixel, grabbed) {
    const { editor } = this, { model } = editor.study;
    this.before = JSON.stringify(model.parts[editor.selected]);
    this.key = `drag ${performance.now()}`;
    this.active = handle;
    this.drag = beginDrag({ model: JSON.parse(JSON.stringify(model)), number: editor.selected, handle, camera: this.camera(), pixel, snap: editor.snap, grabbed });
  }

  cancelDrag() {
    if (this.drag && !this.still) this.editor.study.undo();
    this.drag = this.active = null;
  }

  move(event) {
    const { editor } = this, pixel = this.pixel(event), before = this.pointers.get(event.pointerId);
    if (editor.outline) {
      editor.outline.cursor = editor.outline.meet(editor.study.model, this.camera(), pixel);
      editor.redraw();
    }
    if (!before) {
      const over = handleAt(this.handles(), pixel, MOUSE);
      if (over?.kind !== this.over?.kind || over?.axis !== this.over?.axis || over?.sign !== this.over?.sign) editor.redraw();
      this.over = over;
      this.top.style.cursor = editor.outline ? "crosshair" : over ? "grab" : "";
      return;
    }
    if (this.pointers.size === 2) return this.pinch(event.pointerId, pixel);
    this.pointers.set(event.pointerId, pixel);
    if (this.still && Math.hypot(pixel[0] - this.from[0], pixel[1] - this.from[1]) < STILL) return;
    this.still = false;
    const by = [pixel[0] - before[0], pixel[1] - before[1]];
    if (this.drag) {
      const part = this.drag(pixel);
      if (part) editor.study.edit(model => { model.parts[editor.selected] = part; }, this.key);
    } else if (this.record || event.shiftKey || event.buttons > 1) this.panBy(by);
    else if (!editor.outline) this.turnBy(by[0] * 0.009, by[1] * 0.007);
  }

  up(event, cancelled) {
    const { editor } = this, alone = this.pointers.size === 1 && this.pointers.has(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (!alone) return;
    const clicked = this.still && !cancelled && event.button === 0;
    if (clicked && editor.outline) {
      if (editor.outline.click(editor.study.model, this.camera(), this.pixel(event))) editor.finishOutline();
      else editor.outlineChanged();
    } else if (clicked && (!this.drag || this.active.kind === "slide")) editor.select(this.hit ? this.hit.number : this.drag ? editor.selected : -1);
    this.drag = this.active = this.hit = null;
    editor.study.settle();
    editor.redraw();
  }

  pinch(id, pixel) {
    const [a, b] = [...this.pointers.values()], before = Math.hypot(a[0] - b[0], a[1] - b[1]), old = this.pointers.get(id);
    this.pointers.set(id, pixel);
    const [c, d] = [...this.pointers.values()];
    this.panBy([(pixel[0] - old[0]) / 2, (pixel[1] - old[1]) / 2]);
    this.zoomBy(Math.hypot(c[0] - d[0], c[1] - d[1]) / (before || 1), [(c[0] + d[0]) / 2, (c[1] + d[1]) / 2]);
    this.still = false;
  }

  // --- moving the view -----------------------------------------------------------------------------

  turnBy(turn, tilt) {
    if (this.record) return;
    this.orbit.turn -= turn;
    this.orbit.tilt = Math.min(1.56, Math.max(-0.6, this.orbit.tilt + tilt));
    this.editor.redraw();
  }

  zoomBy(factor, [x, y] = [this.root.clientWidth / 2, this.root.clientHeight / 2]) {
    if (this.record) {
      const zoom = Math.min(8, Math.max(0.4, this.zoom * factor)), { clientWidth: w, clientHeight: h } = this.root, share = zoom / this.zoom;
      this.pan = [(x - w / 2) * (1 - share) + this.pan[0] * share, (y - h / 2) * (1 - share) + this.pan[1] * share];
      this.zoom = zoom;
    } else this.orbit.distance = Math.min(14, Math.max(0.6, this.orbit.distance / factor));
    this.editor.redraw();
  }

  panBy([x, y]) {
    if (this.record) this.pan = [this.pan[0] + x, this.pan[1] + y];
    else {
      const { rotation, focal } = this.camera(), scale = this.orbit.distance / focal[0];
      this.orbit.target = sub(this.orbit.target, apply(transposed(rotation), [x * scale, y * scale, 0])).map(c => Math.min(2, Math.max(-2, c)));
    }
    this.editor.redraw();
  }

  /** Looks along an axis of the object. */
  lookFrom(side) {
    const turn = this.editor.study.model.turn * Math.PI / 180;
    Object.assign(this.orbit, { front: { turn, tilt: 0.02 }, side: { turn: turn + Math.PI / 2, tilt: 0.02 }, top: { turn, tilt: 1.56 } }[side]);
    this.editor.redraw();
  }
}

function meetTriangle({ origin, direction }, a, b, c) {
  const e = sub(b, a), f = sub(c, a), p = cross(direction, f), det = dot(e, p);
  if (Math.abs(det) < 1e-12) return -1;
  const s = sub(origin, a), u = dot(s, p) / det, q = cross(s, e), v = dot(direction, q) / det;
  return u < 0 || v < 0 || u + v > 1 ? -1 : dot(f, q) / det;
}
