// Views that a user turns, and clouds in them: shaded spheres, the nearest last. Used by the pages of psgn_jax.viewing and psgn_jax.web.

const START = { turn: 0, tilt: 20, zoom: 1 }, RADIUS = 0.028, SPRITE = 48; // degrees; radius of a sphere, pixels of its picture
const DISTANCE = 3.6, MIDDLE = 0.27, FOCAL = 400 / 192; // the camera of the training images, which looks at this height

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** The three rows [a, b, c, shift] of a DOMMatrix, and the point to which they map a point. */
const rowsOf = m => [[m.m11, m.m21, m.m31, m.m41], [m.m12, m.m22, m.m32, m.m42], [m.m13, m.m23, m.m33, m.m43]];
const apply = (rows, v) => rows.map(row => dot(row, v) + row[3]);

/** [column, row, depth] of a point; a camera is { k: [fx, skew, cx, fy, cy], rows }. */
function project({ k, rows }, point) {
  const [x, y, z] = apply(rows, point);
  return [(k[0] * x + k[1] * y) / z + k[2], k[3] * y / z + k[4], z];
}

/** The colour between stops for a value from 0 to 1. */
export function ramp(stops, value) {
  const at = clamp(value, 0, 1) * (stops.length - 1), low = Math.min(Math.floor(at), stops.length - 2);
  return stops[low].map((c, k) => c + (at - low) * (stops[low + 1][k] - c));
}

/** The path through some pixels. */
export function pathThrough(pixels, closed = false) {
  const path = new Path2D();
  pixels.forEach(([x, y]) => path.lineTo(x, y));
  if (closed) path.closePath();
  return path;
}

/** Saves a file. */
export function save(name, content) {
  const href = URL.createObjectURL(new Blob([content])), link = Object.assign(document.createElement("a"), { href, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(href), 10000);
}

/** Canvases that show their scenes from the same side, and turn slowly while a box is checked; subclasses have `draw(canvas, index)`. */
class TurnedView {
  constructor(canvases, turning, start = START) {
    Object.assign(this, { canvases, turning, start, view: { ...start }, last: 0 });
    turning?.addEventListener("change", () => this.redraw());
    for (const canvas of canvases) {
      new ResizeObserver(() => this.redraw()).observe(canvas);
      this.listen(canvas);
    }
  }

  reset() {
    Object.assign(this.view, this.start);
    if (this.turning) this.turning.checked = false;
    this.redraw();
  }

  redraw() {
    this.waiting ??= requestAnimationFrame(now => {
      const passed = Math.min(now - this.last, 100); // milliseconds
      Object.assign(this, { waiting: null, last: now });
      if (this.turning?.checked) this.change(0.03 * passed, 0); // asks for the next frame
      this.canvases.forEach((canvas, i) => this.draw(canvas, i));
    });
  }

  /** The context of a canvas, emptied, with the resolution of the screen; its unit is the CSS pixel. */
  cleared(canvas) {
    const dense = window.devicePixelRatio || 1, context = canvas.getContext("2d");
    canvas.width = Math.round(canvas.clientWidth * dense);
    canvas.height = Math.round(canvas.clientHeight * dense);
    context.scale(dense, dense);
    return context;
  }

  /** The camera that sees points of the project's frame (+x to the viewer, +y right, +z up) from the side of this view. */
  camera(canvas) {
    const { clientWidth: w, clientHeight: h } = canvas, { turn, tilt, zoom } = this.view, focal = Math.min(h, 0.75 * w) * FOCAL * zoom;
    const turned = new DOMMatrix().rotate(0, tilt, 0).rotate(0, 0, turn).translate(0, 0, -MIDDLE);
    const matrix = new DOMMatrix().translate(0, 0, DISTANCE).rotate(90, 90, 0).multiply(turned); // to right, down and forward
    return { k: [focal, 0, w / 2, focal, h / 2], rows: rowsOf(matrix) };
  }

  /** Turns and tilts by angles in degrees, and enlarges by a factor. */
  change(turn, tilt, factor = 1) {
    const { view } = this;
    view.turn += turn;
    view.tilt = clamp(view.tilt + tilt, -90, 90);
    view.zoom = clamp(view.zoom * factor, 0.3, 8);
    this.redraw();
  }

  /** What the moves of a pointer do that has just been pressed. */
  grab() {
    return (right, down) => this.change(0.6 * right, 0.6 * down);
  }

  /** A pointer turns, two fingers or the wheel zoom; keys do both. */
  listen(canvas) {
    const pointers = new Map(), spread = () => {
      const [a, b] = [...pointers.values()];
      return b ? Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY) : 0;
    };
    let drag;
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      if (!pointers.size) drag = this.grab(event);
      pointers.set(event.pointerId, event);
    });
    canvas.addEventListener("pointermove", event => {
      const before = pointers.get(event.pointerId), old = spread();
      if (!before) return;
      pointers.set(event.pointerId, event);
      if (old) this.change(0, 0, spread() / old);
      else drag(event.clientX - before.clientX, event.clientY - before.clientY);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.change(0, 0, Math.exp(-event.deltaY * 0.001));
    }, { passive: false });
    const keys = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, -6], ArrowDown: [0, 6], "+": [0, 0, 1.1], "-": [0, 0, 1 / 1.1] };
    canvas.addEventListener("keydown", event => {
      if (event.ctrlKey || event.metaKey || event.key !== "Home" && !keys[event.key]) return;
      event.preventDefault();
      if (event.key === "Home") this.reset();
      else this.change(...keys[event.key]);
    });
  }
}

const sprites = new Map();
/** A sphere of a colour, paler the larger `fog` is. */
function sprite(colour, fog) {
  const key = colour.map(c => c >> 3).join() + fog;
  if (sprites.has(key)) return sprites.get(key);
  const made = Object.assign(document.createElement("canvas"), { width: SPRITE, height: SPRITE });
  const context = made.getContext("2d"), half = SPRITE / 2, light = context.createRadialGradient(half * 0.68, half * 0.58, 1, half, half, half);
  for (const [at, factor, white] of [[0, 1.12, 0.16], [0.35, 1.02, 0.02], [0.8, 0.74, 0], [1, 0.5, 0]]) {
    const lit = colour.map(c => Math.min(255, c * factor + 255 * white)).map(c => Math.round(c + (255 - c) * 0.09 * fog));
    light.addColorStop(at, `rgb(${lit.join()})`);
  }
  context.fillStyle = light;
  context.arc(half, half, half - 0.5, 0, 7);
  context.fill();
  sprites.set(key, made);
  return made;
}

export class CloudView extends TurnedView {
  /** clouds: { points, colours } for each canvas, three numbers for each point; null = nothing. */
  show(clouds) {
    this.clouds = clouds;
    this.redraw();
  }

  draw(canvas, index) {
    const context = this.cleared(canvas), cloud = this.clouds?.[index], camera = this.camera(canvas);
    if (!cloud) return;
    this.backdrop?.(context, canvas, index); // of subclasses
    const { points, colours } = cloud, count = points.length / 3, size = RADIUS * Math.sqrt(1024 / Math.max(count, 256)) * camera.k[0];
    const balls = Array.from({ length: count }, (_, i) => [i, ...project(camera, points.subarray(3 * i, 3 * i + 3))])
      .filter(ball => ball[3] > 0.3).sort((a, b) => b[3] - a[3]);
    const far = balls[0]?.[3], span = Math.max(far - balls.at(-1)?.[3], 1e-6);
    for (const [i, x, y, depth] of balls) {
      const reach = size / depth, fog = 4 - Math.round(4 * (far - depth) / span), colour = [0, 1, 2].map(k => colours[3 * i + k]);
      context.drawImage(sprite(colour, fog), x - reach, y - reach, 2 * reach, 2 * reach);
    }
  }
}
