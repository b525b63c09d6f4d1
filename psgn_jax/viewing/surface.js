// A textured surface, drawn by WebGL 2. Used by the page of psgn_jax.viewing.

const VERTEX = `#version 300 es
layout(location = 0) in vec3 vertex;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 place;
uniform mat4 camera;
uniform mat3 turn;
out vec3 facing;
out vec2 at;
void main() { gl_Position = vec4(vertex, 1) * camera; facing = normal * turn; at = place; }`;

// Soft light from the upper left, which hardly changes the colours of a side that faces the camera.
const FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D image;
in vec3 facing;
in vec2 at;
out vec4 colour;
void main() {
  float light = dot(normalize(facing), normalize(vec3(-.5, -.75, -.6)));
  colour = vec4(texture(image, at).rgb * (.8 + .26 * light), 1);
}`;

/** Draws surfaces { vertices, normals, uv, faces, picture }; `gl` is null where the browser has no WebGL 2. */
export class SurfacePainter {
  constructor() {
    this.canvas = document.createElement("canvas");
    const gl = this.gl = this.canvas.getContext("webgl2");
    if (!gl) return;
    this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.useProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
    this.buffers = [0, 1, 2, 3].map(() => gl.createBuffer());
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  load(surface) {
    const { gl, buffers } = this, { vertices, normals, uv, faces, picture } = surface;
    [[vertices, 3, gl.FLOAT], [normals, 3, gl.BYTE], [uv, 2, gl.UNSIGNED_SHORT]].forEach(([values, size, type], i) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[i]);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, size, type, type !== gl.FLOAT, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[3]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    this.loaded = surface;
  }

  /** Draws a surface, whose picture has been loaded, into a context as large as its canvas. */
  paint(context, { k: [fx, skew, cx, fy, cy], rows: [a, b, c] }, surface) {
    const { gl, program, canvas } = this, { canvas: goal } = context, { clientWidth: w, clientHeight: h } = goal;
    if (this.loaded !== surface) this.load(surface);
    if (canvas.width !== goal.width || canvas.height !== goal.height) Object.assign(canvas, { width: goal.width, height: goal.height });
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.viewport(0, 0, goal.width, goal.height);
    const middle = apply([c], [0, 0, MIDDLE])[0], near = Math.max(middle - 4, 0.02 * middle), far = middle + 4;
    const across = c.map((z, i) => (2 / w) * (fx * a[i] + skew * b[i] + cx * z) - z), up = c.map((z, i) => z - (2 / h) * (fy * b[i] + cy * z));
    const depth = c.map((z, i) => ((far + near) * z - (i === 3) * 2 * far * near) / (far - near));
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "camera"), false, [...across, ...up, ...depth, ...c]);
    gl.uniformMatrix3fv(gl.getUniformLocation(program, "turn"), false, [a, b, c].flatMap(row => row.slice(0, 3)));
    gl.drawElements(gl.TRIANGLES, surface.faces.length, gl.UNSIGNED_SHORT, 0);
    context.drawImage(canvas, 0, 0, w, h);
  }
}
