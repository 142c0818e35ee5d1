// The field as triangles in the colours of its values: by WebGL, or by the processor where there is no fast WebGL.
//
// A drawing is { positions (x, y, z), values (codes), indices, matrix, range: [low, high] in codes, palette (256 × RGB),
// opacity, shaded }. Both painters draw the same picture into their canvas.

const VERTEX = `
attribute vec3 place; attribute float value;
uniform mat4 matrix; uniform vec2 range;
varying float share; varying vec3 at;
void main() { share = (value - range.x) / (range.y - range.x); at = place; gl_Position = matrix * vec4(place, 1.0); }`;
const SHADING = `
  if (shaded > 0.0) {
    vec3 n = normalize(cross(dFdx(at), dFdy(at)));
    colour *= 0.72 + 0.28 * abs(dot(n, normalize(vec3(0.35, 0.5, -0.8))));
  }`;
const FRAGMENT = (derivatives) => `
${derivatives ? "#extension GL_OES_standard_derivatives : enable" : ""}
precision highp float;
uniform sampler2D palette; uniform float opacity; uniform float shaded;
varying float share; varying vec3 at;
void main() {
  vec3 colour = texture2D(palette, vec2((clamp(share, 0.0, 1.0) * 255.0 + 0.5) / 256.0, 0.5)).rgb;
  ${derivatives ? SHADING : ""}
  gl_FragColor = vec4(colour * opacity, opacity);
}`;

/** The painter for a canvas. */
export function painterFor(canvas) {
  return MeshPainter.make(canvas) || new PlainPainter(canvas);
}

// WebGL by software is several times slower than the plain painter.
function hasFastWebGL() {
  const gl = document.createElement("canvas").getContext("webgl");
  if (!gl) return false;
  const facts = gl.getExtension("WEBGL_debug_renderer_info");
  const renderer = gl.getParameter(facts ? facts.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer);
}

class MeshPainter {
  static make(canvas) {
    if (!hasFastWebGL()) return null;
    const gl = canvas.getContext("webgl", { alpha: true, antialias: true, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension("OES_element_index_uint")) return null;
    const painter = new MeshPainter();
    Object.assign(painter, { gl, canvas, sent: new Map() });
    painter.set(Boolean(gl.getExtension("OES_standard_derivatives")));
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () =>
      painter.set(Boolean(gl.getExtension("OES_standard_derivatives"))),
    );
    return painter;
  }

  set(derivatives) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [
      [gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, FRAGMENT(derivatives)],
    ]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    this.at = (name) => gl.getUniformLocation(program, name);
    this.sent = new Map();
    this.buffers = { place: gl.createBuffer(), value: gl.createBuffer(), index: gl.createBuffer() };
    this.texture = gl.createTexture();
    const attribute = (name) => {
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      return place;
    };
    this.attributes = { place: attribute("place"), value: attribute("value") };
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
  }

  clear() {
    const { gl, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  /** Sends an array to a buffer unless it is there already. */
  send(target, name, array) {
    const { gl } = this;
    gl.bindBuffer(target, this.buffers[name]);
    if (this.sent.get(name) !== array) gl.bufferData(target, array, gl.DYNAMIC_DRAW);
    this.sent.set(name, array);
  }

  draw({ positions, values, indices, matrix, range, palette, opacity, shaded }) {
    const { gl } = this;
    this.send(gl.ARRAY_BUFFER, "place", positions);
    gl.vertexAttribPointer(this.attributes.place, 3, gl.FLOAT, false, 0, 0);
    this.send(gl.ARRAY_BUFFER, "value", values);
    gl.vertexAttribPointer(this.attributes.value, 1, gl.UNSIGNED_SHORT, false, 0, 0);
    this.send(gl.ELEMENT_ARRAY_BUFFER, "index", indices);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (this.sent.get("palette") !== palette) {
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, palette);
      for (const way of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
        gl.texParameteri(gl.TEXTURE_2D, way, gl.NEAREST);
      for (const way of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, way, gl.CLAMP_TO_EDGE);
      this.sent.set("palette", palette);
    }
    gl.uniformMatrix4fv(this.at("matrix"), false, matrix);
    gl.uniform2f(this.at("range"), ...range);
    gl.uniform1f(this.at("opacity"), opacity);
    gl.uniform1f(this.at("shaded"), shaded ? 1 : 0);
    (shaded ? gl.enable : gl.disable).call(gl, gl.DEPTH_TEST);
    gl.drawElements(gl.TRIANGLES, indices.length, gl.UNSIGNED_INT, 0);
  }
}

class PlainPainter {
  constructor(canvas) {
    Object.assign(this, { canvas, context: canvas.getContext("2d", { willReadFrequently: true }) });
  }

  clear() {
    this.context.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  draw({ positions, values, indices, matrix, range, palette, opacity, shaded }) {
    const { width, height } = this.canvas;
    const picture = this.context.getImageData(0, 0, width, height);
    const pixels = new Uint32Array(picture.data.buffer);
    const depths = new Float32Array(width * height).fill(Infinity);
    const alpha = Math.round(opacity * 255) << 24;
    const colours = Array.from({ length: shaded ? SHADES : 1 }, (_, shade) =>
      shadedColours(palette, alpha, shaded ? shade / (SHADES - 1) : 1),
    );
    const count = positions.length / 3;
    const shown = new Float32Array(4 * count);
    for (let k = 0; k < count; k++) {
      const [x, y, z] = [positions[3 * k], positions[3 * k + 1], positions[3 * k + 2]];
      const w = matrix[3] * x + matrix[7] * y + matrix[11] * z + matrix[15];
      shown[4 * k] = (((matrix[0] * x + matrix[4] * y + matrix[8] * z + matrix[12]) / w + 1) / 2) * width - 0.5;
      shown[4 * k + 1] = ((1 - (matrix[1] * x + matrix[5] * y + matrix[9] * z + matrix[13]) / w) / 2) * height - 0.5;
      shown[4 * k + 2] = w;
      shown[4 * k + 3] = ((values[k] - range[0]) / (range[1] - range[0])) * 255;
    }
    for (let k = 0; k < indices.length; k += 3) {
      const [a, b, c] = [indices[k], indices[k + 1], indices[k + 2]];
      const shade = shaded ? Math.round(facing(positions, 3 * a, 3 * b, 3 * c) * (SHADES - 1)) : 0;
      fillTriangle(shown, a, b, c, { pixels, depths, colours: colours[shade], width, height });
    }
    this.context.putImageData(picture, 0, 0);
  }
}

const SHADES = 33;
const LIGHT = [0.35, 0.5, -0.8].map((one) => one / Math.hypot(0.35, 0.5, 0.8));

// 256 colours with opacity, darker the less a triangle faces the light, as the shader has them.
function shadedColours(palette, alpha, share) {
  const bright = 0.72 + 0.28 * share;
  return Uint32Array.from(
    { length: 256 },
    (_, k) =>
      alpha |
      (Math.round(bright * palette[3 * k + 2]) << 16) |
      (Math.round(bright * palette[3 * k + 1]) << 8) |
      Math.round(bright * palette[3 * k]),
  );
}

// How much a triangle faces the light: 1 entirely, 0 not at all.
function facing(p, a, b, c) {
  const [ux, uy, uz, vx, vy, vz] = [
    p[b] - p[a],
    p[b + 1] - p[a + 1],
    p[b + 2] - p[a + 2],
    p[c] - p[a],
    p[c + 1] - p[a + 1],
    p[c + 2] - p[a + 2],
  ];
  const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
  return Math.abs(nx * LIGHT[0] + ny * LIGHT[1] + nz * LIGHT[2]) / (Math.sqrt(nx * nx + ny * ny + nz * nz) || 1);
}

function fillTriangle(shown, a, b, c, { pixels, depths, colours, width, height }) {
  const [ax, ay, bx, by, cx, cy] = [
    shown[4 * a],
    shown[4 * a + 1],
    shown[4 * b],
    shown[4 * b + 1],
    shown[4 * c],
    shown[4 * c + 1],
  ];
  const whole = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  if (!whole) return;
  const [x0, x1] = [
    Math.max(0, Math.ceil(Math.min(ax, bx, cx))),
    Math.min(width - 1, Math.floor(Math.max(ax, bx, cx))),
  ];
  const [y0, y1] = [
    Math.max(0, Math.ceil(Math.min(ay, by, cy))),
    Math.min(height - 1, Math.floor(Math.max(ay, by, cy))),
  ];
  for (let y = y0; y <= y1; y++) {
    for (let x = x0; x <= x1; x++) {
      const v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / whole;
      const u = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / whole;
      if (v < -1e-6 || u < -1e-6 || u + v > 1 + 1e-6) continue;
      const at = y * width + x;
      const depth =
        shown[4 * a + 2] + v * (shown[4 * b + 2] - shown[4 * a + 2]) + u * (shown[4 * c + 2] - shown[4 * a + 2]);
      if (depth > depths[at]) continue;
      depths[at] = depth;
      const level =
        shown[4 * a + 3] + v * (shown[4 * b + 3] - shown[4 * a + 3]) + u * (shown[4 * c + 3] - shown[4 * a + 3]);
      pixels[at] = colours[Math.max(0, Math.min(255, Math.round(level)))];
    }
  }
}
