// Draws a cloud as shaded spheres on a canvas. Pointer, finger and arrow keys rotate it; wheel, pinch,
// + and - zoom.

const START = { turn: 0, tilt: 20 * Math.PI / 180, zoom: 1 };
const SPRITE = 48, BALL = 0.024, SHADOW = 8; // the shadow is drawn at an eighth of the size
const HEIGHT = [[43, 62, 140], [40, 132, 168], [76, 178, 128], [206, 200, 78], [240, 128, 60]];

const sprites = new Map();
function sprite(colour, fog) {
  const key = colour.map(c => c >> 3).join() + fog;
  let made = sprites.get(key);
  if (made) return made;
  made = document.createElement("canvas");
  made.width = made.height = SPRITE;
  const context = made.getContext("2d"), half = SPRITE / 2, far = fog * 0.1;
  const tone = (factor, white) => `rgb(${colour.map(v => {
    const lit = Math.min(255, v * factor + 255 * white);
    return Math.round(lit + (236 - lit) * far);
  }).join()})`;
  const light = context.createRadialGradient(half * 0.68, half * 0.58, 1, half, half, half);
  light.addColorStop(0, tone(1.12, 0.2));
  light.addColorStop(0.35, tone(1.03, 0.03));
  light.addColorStop(0.8, tone(0.74, 0));
  light.addColorStop(1, tone(0.5, 0));
  context.fillStyle = light;
  context.beginPath();
  context.arc(half, half, half - 0.5, 0, 7);
  context.fill();
  if (sprites.size > 4000) sprites.clear();
  sprites.set(key, made);
  return made;
}

function ramp(stops, t) {
  const at = Math.min(Math.max(t, 0), 1) * (stops.length - 1), i = Math.min(at | 0, stops.length - 2);
  return stops[i].map((c, k) => Math.round(c + (at - i) * (stops[i + 1][k] - c)));
}

export class Viewer {
  constructor(canvas) {
    this.canvas = canvas;
    this.view = { ...START };
    this.colouring = "photo";
    this.cloud = null;
    this.pointers = new Map();
    this.turning = false;
    this.listen();
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  /** Shows { points, colours }, or nothing. */
  show(cloud) {
    this.cloud = cloud;
    this.redraw();
  }

  reset() {
    this.turning = false;
    this.view = { ...START };
    this.redraw();
  }

  /** Turns slowly by itself until it is touched. */
  setTurning(on) {
    this.turning = on;
    this.last = 0;
    if (on) requestAnimationFrame(now => this.step(now));
    this.onturning?.(on);
  }

  step(now) {
    if (!this.turning) return;
    if (this.last) this.view.turn += Math.min(now - this.last, 100) * 0.0004;
    this.last = now;
    this.draw();
    requestAnimationFrame(next => this.step(next));
  }

  redraw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.draw(); });
  }

  draw() {
    const { canvas, cloud, view } = this, dense = Math.min(window.devicePixelRatio || 1, 2);
    const w = Math.max(1, Math.round(canvas.clientWidth * dense)), h = Math.max(1, Math.round(canvas.clientHeight * dense));
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const context = canvas.getContext("2d");
    const sky = context.createLinearGradient(0, 0, 0, h);
    sky.addColorStop(0, "#fbfbfd");
    sky.addColorStop(1, "#e7eaf0");
    context.fillStyle = sky;
    context.fillRect(0, 0, w, h);
    if (!cloud) return;
    const { points, colours } = cloud, count = points.length / 3;
    const [ct, st] = [Math.cos(view.turn), Math.sin(view.turn)], [cp, sp] = [Math.cos(view.tilt), Math.sin(view.tilt)];
    const { middle, radius } = this.extent(), distance = 4.4;
    const size = Math.min(w, h * 1.2) * 0.45 * view.zoom * (distance - 0.6) / radius;
    const project = (x, y, z) => { // +x to the viewer, +y right, +z up
      const a = x * ct - y * st, right = x * st + y * ct, up = z - middle;
      const near = a * cp + up * sp, scale = size / (distance - near);
      return [w / 2 + right * scale, h * 0.48 - (up * cp - a * sp) * scale, near, scale];
    };
    this.drawShadow(context, w, h, points, project, Math.abs(sp));
    const drawn = new Array(count);
    for (let i = 0; i < count; i++) drawn[i] = [i, ...project(points[3 * i], points[3 * i + 1], points[3 * i + 2])];
    drawn.sort((a, b) => a[3] - b[3]);
    for (const [i, x, y, near, scale] of drawn) {
      const colour = this.colouring === "photo"
        ? [colours[3 * i], colours[3 * i + 1], colours[3 * i + 2]] : ramp(HEIGHT, points[3 * i + 2] / (2 * middle || 1));
      const fog = Math.max(0, Math.min(5, Math.round(2.5 - 2.5 * near))), reach = BALL * scale;
      context.drawImage(sprite(colour, fog), x - reach, y - reach, 2 * reach, 2 * reach);
    }
  }

  /** The shadow of the points on the ground, blurred by drawing it at a smaller size. */
  drawShadow(context, w, h, points, project, slope) {
    const small = this.shadow ??= document.createElement("canvas");
    small.width = Math.ceil(w / SHADOW);
    small.height = Math.ceil(h / SHADOW);
    const ground = small.getContext("2d");
    ground.fillStyle = "#27304a";
    for (let i = 0; i < points.length; i += 3) {
      const [x, y, , scale] = project(points[i], points[i + 1], 0), reach = 0.07 * scale / SHADOW;
      ground.beginPath();
      ground.ellipse(x / SHADOW, y / SHADOW, reach, reach * Math.max(0.15, slope), 0, 0, 7);
      ground.fill();
    }
    context.globalAlpha = 0.13;
    context.drawImage(small, 0, 0, small.width * SHADOW, small.height * SHADOW);
    context.globalAlpha = 1;
  }

  /** Half the height of the cloud, and the largest distance of a point from (0, 0, that height). */
  extent() {
    const { points } = this.cloud;
    let top = 0, radius = 0;
    for (let i = 2; i < points.length; i += 3) top = Math.max(top, points[i]);
    for (let i = 0; i < points.length; i += 3) radius = Math.max(radius, Math.hypot(points[i], points[i + 1], points[i + 2] - top / 2));
    return { middle: top / 2, radius: radius || 1 };
  }

  rotate(turn, tilt) {
    this.setTurning(false);
    this.view.turn += turn;
    this.view.tilt = Math.min(1.55, Math.max(-1.55, this.view.tilt + tilt));
    this.redraw();
  }

  zoom(factor) {
    this.view.zoom = Math.min(8, Math.max(0.4, this.view.zoom * factor));
    this.redraw();
  }

  listen() {
    const { canvas, pointers } = this;
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", event => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const spread = () => {
        const [a, b] = [...pointers.values()];
        return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
      };
      const old = spread();
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      if (old) this.zoom(spread() / old);
      else this.rotate((event.clientX - before[0]) * 0.01, (event.clientY - before[1]) * 0.008);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.0012));
    }, { passive: false });
    canvas.addEventListener("keydown", event => {
      const keys = {
        ArrowLeft: () => this.rotate(-0.12, 0), ArrowRight: () => this.rotate(0.12, 0),
        ArrowUp: () => this.rotate(0, -0.1), ArrowDown: () => this.rotate(0, 0.1),
        "+": () => this.zoom(1.15), "=": () => this.zoom(1.15), "-": () => this.zoom(1 / 1.15), Home: () => this.reset(),
      };
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }
}
