// Draws clouds as shaded spheres, the nearest last. Used by the page of psgn_jax.viewing and by the
// browser page.

const START = { turn: 0, tilt: 20 * Math.PI / 180, zoom: 1 }, SPRITE = 48, RADIUS = 0.028;
const DISTANCE = 3.6, MIDDLE = 0.27, FOCAL = 400 / 192; // the camera of the training images, which looks at this height

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

export class CloudView {
  /** Shows a cloud on each canvas, all from the same side. */
  constructor(canvases) {
    Object.assign(this, { canvases, clouds: [], view: { ...START }, spinning: false });
    for (const canvas of canvases) {
      new ResizeObserver(() => this.redraw()).observe(canvas);
      this.listen(canvas);
    }
  }

  /** clouds: { points, colours } for each canvas, three numbers for each point; null = nothing. */
  show(clouds) {
    this.clouds = clouds;
    this.redraw();
  }

  reset() {
    Object.assign(this, { view: { ...START }, spinning: false });
    this.redraw();
  }

  /** Turns slowly, or no longer. */
  spin(on) {
    let last = performance.now();
    const step = now => {
      if (!this.spinning) return;
      this.view.turn += Math.min(now - last, 100) * 0.0005;
      last = now;
      this.redraw();
      requestAnimationFrame(step);
    };
    if (on && !this.spinning) requestAnimationFrame(step);
    this.spinning = on;
  }

  redraw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = null;
      this.canvases.forEach((canvas, i) => this.draw(canvas, this.clouds[i]));
    });
  }

  draw(canvas, cloud) {
    const dense = window.devicePixelRatio || 1, context = canvas.getContext("2d");
    const w = canvas.width = Math.round(canvas.clientWidth * dense), h = canvas.height = Math.round(canvas.clientHeight * dense);
    if (!cloud) return;
    const { points, colours } = cloud, count = points.length / 3, focal = h * FOCAL * this.view.zoom;
    const size = RADIUS * Math.sqrt(1024 / Math.max(count, 256)) * focal, { turn, tilt } = this.view;
    const balls = Array.from({ length: count }, (_, i) => { // +x to the viewer, +y right, +z up
      const [x, y, z] = [points[3 * i], points[3 * i + 1], points[3 * i + 2] - MIDDLE];
      const near = Math.cos(turn) * x - Math.sin(turn) * y, right = Math.sin(turn) * x + Math.cos(turn) * y;
      const depth = DISTANCE - near * Math.cos(tilt) - z * Math.sin(tilt);
      return { i, depth, x: w / 2 + focal * right / depth, y: h / 2 - focal * (z * Math.cos(tilt) - near * Math.sin(tilt)) / depth };
    }).filter(({ depth }) => depth > 0.3).sort((a, b) => b.depth - a.depth);
    const far = balls[0]?.depth, span = Math.max(far - balls.at(-1)?.depth, 1e-6);
    for (const { i, depth, x, y } of balls) {
      const reach = size / depth, fog = 4 - Math.round(4 * (far - depth) / span), colour = [0, 1, 2].map(k => colours[3 * i + k]);
      context.drawImage(sprite(colour, fog), x - reach, y - reach, 2 * reach, 2 * reach);
    }
  }

  rotate(turn, tilt) {
    this.view.turn += turn;
    this.view.tilt = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.view.tilt + tilt));
    this.redraw();
  }

  zoom(factor) {
    this.view.zoom = Math.min(8, Math.max(0.3, this.view.zoom * factor));
    this.redraw();
  }

  /** A pointer turns, two fingers or the wheel zoom; keys do both. */
  listen(canvas) {
    const pointers = new Map(), spread = () => {
      const [a, b] = [...pointers.values()];
      return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
    };
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", event => {
      const before = pointers.get(event.pointerId), old = spread();
      if (!before) return;
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      if (old) this.zoom(spread() / old);
      else this.rotate((event.clientX - before[0]) * 0.01, (event.clientY - before[1]) * 0.01);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.001));
    }, { passive: false });
    const keys = {
      ArrowLeft: () => this.rotate(-0.1, 0), ArrowRight: () => this.rotate(0.1, 0), ArrowUp: () => this.rotate(0, -0.1),
      ArrowDown: () => this.rotate(0, 0.1), "+": () => this.zoom(1.1), "-": () => this.zoom(1 / 1.1), Home: () => this.reset(),
    };
    canvas.addEventListener("keydown", event => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }
}
