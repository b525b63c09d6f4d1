// Draws solids and lines with WebGL. Lines are flat strips, because WebGL's own lines are one pixel wide.

import { apply, cross, rotation, sub, toWorld, unit } from "./geometry.js";

export const COLOURS = [[94, 139, 214], [232, 150, 88], [104, 178, 130], [205, 112, 135], [150, 128, 206], [82, 172, 184], [214, 181, 84], [146, 152, 164]];
export const AXES = [[222, 72, 76], [46, 160, 87], [57, 112, 226]];
const SELECTED = [255, 152, 0], EDGE = [30, 41, 66];

const FACE_VERTEX = `attribute vec3 position, normal, colour; uniform mat4 camera; varying vec3 n, c;
void main() { n = normal; c = colour; gl_Position = camera * vec4(position, 1.); }`;
const FACE_FRAGMENT = `precision mediump float; varying vec3 n, c; uniform vec3 sun; uniform float alpha;
void main() {
  vec3 m = normalize(n);
  float light = .62 + .34 * max(dot(m, sun), 0.) + .1 * m.z;
  gl_FragColor = vec4(c * light * alpha, alpha);
}`;
const LINE_VERTEX = `attribute vec3 position, other; attribute float side; attribute vec4 colour;
uniform mat4 camera; uniform vec2 size; uniform float width, lift; varying vec4 c;
void main() {
  vec4 a = camera * vec4(position, 1.), b = camera * vec4(other, 1.);
  if (a.w < .06) a = mix(b, a, (b.w - .06) / max(b.w - a.w, 1e-5));
  vec2 way = (b.xy / max(b.w, .06) - a.xy / max(a.w, .06)) * size;
  way = length(way) > 1e-4 ? normalize(way) : vec2(1., 0.);
  a.xy += vec2(-way.y, way.x) * side * width / size * a.w;
  a.z -= lift * a.w;
  c = colour;
  gl_Position = a;
}`;
const LINE_FRAGMENT = `precision mediump float; varying vec4 c; uniform float alpha;
void main() { gl_FragColor = vec4(c.rgb, 1.) * c.a * alpha; }`;

/** Triangles of a model, nine numbers per corner: position, normal, colour. */
export function triangles(meshes) {
  const out = [];
  for (const mesh of meshes) {
    const colour = COLOURS[mesh.number % COLOURS.length].map(c => c / 255), smooth = smoothNormals(mesh);
    for (const face of mesh.faces) {
      const [a, b, c] = face.map(i => mesh.vertices[i]), flat = unit(cross(sub(b, a), sub(c, a)));
      for (const i of face) out.push(...mesh.vertices[i], ...(smooth && Math.abs(flat[0] * smooth.axis[0] + flat[1] * smooth.axis[1] + flat[2] * smooth.axis[2]) < 0.98 ? smooth.normals[i] : flat), ...colour);
    }
  }
  return new Float32Array(out);
}

/** Normals at the corners of a round part, for smooth shading; null for other parts. */
function smoothNormals({ part, vertices, number }) {
  if (!["sphere", "cylinder", "cone"].includes(part.kind) || number < 0) return null;
  const normals = vertices.map(() => [0, 0, 0]), n = (vertices.length - (part.taper === 0 ? 1 : 0)) / (part.taper === 0 ? 1 : 2);
  const middle = points => points.reduce((s, p) => s.map((c, k) => c + p[k] / points.length), [0, 0, 0]);
  if (part.kind === "sphere") {
    const centre = middle(vertices);
    return { normals: vertices.map(v => unit(sub(v, centre))), axis: [0, 0, 0] };
  }
  const low = middle(vertices.slice(0, n)), high = middle(vertices.slice(n)), axis = unit(sub(high, low));
  vertices.forEach((v, i) => { normals[i] = unit(sub(v, i < n ? low : high)); });
  if (part.taper === 0) normals[n] = axis;
  return { normals, axis };
}

function strip(out, a, b, colour, opacity) {
  const corner = (p, q, side) => out.push(...p, ...q, side, ...colour.map(c => c / 255), opacity);
  corner(a, b, 1); corner(a, b, -1); corner(b, a, 1);
  corner(a, b, 1); corner(b, a, 1); corner(b, a, -1);
}

/** Strips of the edges of a model, eleven numbers per corner. */
export function edgeStrips(meshes, selected) {
  const out = [];
  for (const { edges, vertices, number } of meshes) {
    for (const [i, j] of edges) strip(out, vertices[i], vertices[j], number === selected ? SELECTED : EDGE, number === selected ? 1 : 0.75);
  }
  return new Float32Array(out);
}

/** The ground in the object's directions: a grid, the axes, and the circle of radius 1 about the origin. */
export function groundStrips(model) {
  const out = [], put = (a, b, colour, opacity) => strip(out, toWorld(model, a), toWorld(model, b), colour, opacity);
  for (let i = -5; i <= 5; i++) {
    if (!i) continue;
    put([i / 5, -1, 0], [i / 5, 1, 0], [80, 92, 120], 0.3);
    put([-1, i / 5, 0], [1, i / 5, 0], [80, 92, 120], 0.3);
  }
  put([-1, 0, 0], [1.15, 0, 0], AXES[0], 0.9);
  put([0, -1, 0], [0, 1.15, 0], AXES[1], 0.9);
  put([0, 0, 0], [0, 0, 0.2], AXES[2], 0.9);
  const circle = k => [Math.cos(2 * Math.PI * k / 72), Math.sin(2 * Math.PI * k / 72), 0];
  for (let k = 0; k < 72; k++) strip(out, circle(k), circle(k + 1), [80, 92, 120], 0.5);
  return new Float32Array(out);
}

export class Renderer {
  constructor(canvas) {
    this.canvas = canvas;
    this.start();
    canvas.addEventListener("webglcontextlost", event => { event.preventDefault(); this.gl = null; });
    canvas.addEventListener("webglcontextrestored", () => { this.start(); this.onrestored?.(); });
  }

  start() {
    const gl = this.gl = this.canvas.getContext("webgl", { alpha: true, antialias: true, premultipliedAlpha: true });
    if (!gl) return;
    this.faces = program(gl, FACE_VERTEX, FACE_FRAGMENT, [["position", 3], ["normal", 3], ["colour", 3]]);
    this.lines = program(gl, LINE_VERTEX, LINE_FRAGMENT, [["position", 3], ["other", 3], ["side", 1], ["colour", 4]]);
    this.buffers = {};
    this.uploaded = {};
  }

  upload(name, array) {
    const { gl } = this;
    if (this.uploaded[name] === array) return;
    this.buffers[name] ??= gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.DYNAMIC_DRAW);
    this.uploaded[name] = array;
  }

  /** Draws { triangles, edges, ground }; `style`: "solid", "wireframe" or "off"; `glass`: opacity of solids. */
  draw(scene, camera, style, glass) {
    const { gl, canvas } = this, { width, height } = canvas;
    if (!gl) return;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const name of ["triangles", "edges", "ground"]) this.upload(name, scene[name]);
    if (style !== "off") {
      gl.colorMask(style === "solid", style === "solid", style === "solid", style === "solid");
      gl.disable(gl.BLEND);
      this.run(this.faces, "triangles", 9, { camera, alpha: glass, sun: SUN });
      gl.colorMask(true, true, true, true);
    }
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    const dense = Math.min(window.devicePixelRatio || 1, 2), size = [width, height];
    if (scene.grid) this.run(this.lines, "ground", 11, { camera, size, width: 1.1 * dense, lift: 0, alpha: 1 });
    if (style !== "off") {
      this.run(this.lines, "edges", 11, { camera, size, width: (style === "solid" ? 1.1 : 1.6) * dense, lift: 0.0012, alpha: 1 });
      gl.depthFunc(gl.GREATER);
      this.run(this.lines, "edges", 11, { camera, size, width: 0.9 * dense, lift: 0.0012, alpha: style === "solid" ? 0.12 : 0.35 });
      gl.depthFunc(gl.LESS);
    }
    gl.depthMask(true);
  }

  run({ handle, attributes, uniforms }, name, stride, values) {
    const { gl } = this;
    gl.useProgram(handle);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    let offset = 0;
    for (const [place, count] of attributes) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, count, gl.FLOAT, false, 4 * stride, 4 * offset);
      offset += count;
    }
    for (const [key, value] of Object.entries(values)) {
      const place = uniforms(key);
      if (key === "camera") gl.uniformMatrix4fv(place, false, value);
      else if (Array.isArray(value)) gl[`uniform${value.length}fv`](place, value);
      else gl.uniform1f(place, value);
    }
    gl.drawArrays(gl.TRIANGLES, 0, this.uploaded[name].length / stride);
    for (const [place] of attributes) gl.disableVertexAttribArray(place);
  }
}

const SUN = unit(apply(rotation([0, 0, 40]), [1, 0.3, 1.6]));

function program(gl, vertex, fragment, fields) {
  const handle = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(handle, shader);
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle) || "WebGL cannot draw here.");
  return { handle, attributes: fields.map(([name, count]) => [gl.getAttribLocation(handle, name), count]), uniforms: name => gl.getUniformLocation(handle, name) };
}
