"use strict";
// The picture: capsules, boxes, planes and lines by WebGL 2, seen by a camera that goes around a point. Up stays up.

const Draw = (() => {
  const { minus, plus, cross, dot, unit } = Arm;
  const LIGHT = `#version 300 es
    precision highp float;
    in vec3 normal; in vec3 place; in vec3 tint;
    uniform vec3 eye, up; uniform float alpha, plain;
    out vec4 colour;
    void main() {
      vec3 n = normalize(normal), to_eye = normalize(eye - place);
      if (dot(n, to_eye) < 0.0) n = -n;
      float light = 0.42 + 0.24 * (0.5 + 0.5 * dot(n, up)) + 0.40 * dot(n, to_eye);
      colour = vec4(tint * mix(light, 1.0, plain), alpha);
    }`;
  // A capsule is one mesh: a direction and the end that it belongs to. A sphere has equal ends.
  const CAPSULE = `#version 300 es
    layout(location = 0) in vec4 shape; layout(location = 1) in vec3 a; layout(location = 2) in vec3 b;
    layout(location = 3) in float radius; layout(location = 4) in vec3 colour;
    uniform mat4 camera;
    out vec3 normal; out vec3 place; out vec3 tint;
    void main() {
      vec3 z = b - a; float size = length(z);
      z = size > 1e-9 ? z / size : vec3(0.0, 0.0, 1.0);
      vec3 x = normalize(cross(z, abs(z.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0)));
      normal = shape.x * x + shape.y * cross(z, x) + shape.z * z;
      place = mix(a, b, shape.w) + radius * normal; tint = colour;
      gl_Position = camera * vec4(place, 1.0);
    }`;
  const MESH = `#version 300 es
    layout(location = 0) in vec3 at; layout(location = 1) in vec3 facing;
    uniform mat4 camera; uniform vec3 paint;
    out vec3 normal; out vec3 place; out vec3 tint;
    void main() { normal = facing; place = at; tint = paint; gl_Position = camera * vec4(at, 1.0); }`;
  // A line is a quad of constant width in pixels for each segment, cut where it passes behind the eye.
  const LINE = `#version 300 es
    layout(location = 0) in vec2 corner; layout(location = 1) in vec3 a; layout(location = 2) in vec3 b;
    uniform mat4 camera; uniform vec2 viewport; uniform float width;
    const float NEAR = 1e-4;
    void main() {
      vec4 p = camera * vec4(a, 1.0), q = camera * vec4(b, 1.0);
      if (p.w < NEAR && q.w < NEAR) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
      if (p.w < NEAR) p = mix(p, q, (NEAR - p.w) / (q.w - p.w));
      else if (q.w < NEAR) q = mix(q, p, (NEAR - q.w) / (p.w - q.w));
      vec2 along = (q.xy / q.w - p.xy / p.w) * viewport;
      along = length(along) > 1e-9 ? normalize(along) : vec2(1.0, 0.0);
      vec4 end = corner.x < 0.5 ? p : q;
      vec2 shift = vec2(-along.y, along.x) * corner.y + along * (2.0 * corner.x - 1.0) * 0.5;
      end.xy += shift * width / viewport * end.w;
      end.z -= 2e-4 * end.w;
      gl_Position = end;
    }`;
  const PAINT = `#version 300 es
    precision highp float;
    uniform vec4 paint; out vec4 colour;
    void main() { colour = paint; }`;

  /** The mesh of a capsule: rings from one pole to the other, the equator once for each end. */
  const capsuleMesh = (around = 28, rings = 8) => {
    const rows = [], points = [], triangles = [];
    for (let k = 0; k <= rings; k++) rows.push([-Math.PI / 2 + k * Math.PI / 2 / rings, 0]);
    for (let k = 0; k <= rings; k++) rows.push([k * Math.PI / 2 / rings, 1]);
    for (const [latitude, end] of rows) for (let i = 0; i <= around; i++) {
      const turn = 2 * Math.PI * i / around, c = Math.cos(latitude);
      points.push(c * Math.cos(turn), c * Math.sin(turn), Math.sin(latitude), end);
    }
    for (let r = 0; r + 1 < rows.length; r++) for (let i = 0; i < around; i++) {
      const k = r * (around + 1) + i;
      triangles.push(k, k + 1, k + around + 2, k, k + around + 2, k + around + 1);
    }
    return { points: new Float32Array(points), triangles: new Uint16Array(triangles) };
  };

  /** Two directions that are perpendicular to a direction and to each other. */
  const across = z => {
    const k = z.map(Math.abs).indexOf(Math.min(...z.map(Math.abs)));
    const x = unit(cross(z, [0, 1, 2].map(i => Number(i === k))));
    return [x, cross(z, x)];
  };

  /** A camera that looks at a point from an azimuth and an elevation [rad] and a distance [m]. */
  const camera = up => {
    const [x, y] = across(up);
    const see = {
      target: [0, 0, 0], azimuth: 0, elevation: 0.4, distance: 3, aspect: 1, matrix: new Float32Array(16),
      /** Azimuth of a direction. */
      towards: d => Math.atan2(dot(d, y), dot(d, x)),
      get back() {
        const c = Math.cos(see.elevation);
        return plus(plus(up.map(v => v * Math.sin(see.elevation)), x, c * Math.cos(see.azimuth)), y, c * Math.sin(see.azimuth));
      },
      get eye() { return plus(see.target, see.back, see.distance); },
      /** Half of the picture's height over the distance; a narrow picture opens wider, so that its width holds as much. */
      get opening() { return 0.32 / Math.min(1, see.aspect); },
      get right() { return unit(cross(up, see.back)); },
      get above() { return cross(see.back, see.right); },
      /** Fill the matrix (column after column) from base frame to clip space. */
      update() {
        const near = 0.01 * see.distance, far = 60 * see.distance, f = 1 / see.opening, eye = see.eye;
        const rows = [see.right, see.above, see.back].map(r => [...r, -dot(r, eye)]);
        const deep = [(far + near) / (near - far), 2 * far * near / (near - far)];
        for (let c = 0; c < 4; c++) {
          see.matrix[4 * c] = f / see.aspect * rows[0][c];
          see.matrix[4 * c + 1] = f * rows[1][c];
          see.matrix[4 * c + 2] = deep[0] * rows[2][c] + (c === 3 ? deep[1] : 0);
          see.matrix[4 * c + 3] = -rows[2][c];
        }
      },
      /** Where a point is in the picture, (0, 0) at its upper left and (1, 1) at its lower right; null behind the eye. */
      project(p) {
        const [u, v, , w] = [0, 1, 2, 3].map(r => [0, 1, 2, 3].reduce((s, c) => s + see.matrix[4 * c + r] * (c < 3 ? p[c] : 1), 0));
        return w > 0 ? [0.5 + 0.5 * u / w, 0.5 - 0.5 * v / w] : null;
      },
    };
    return see;
  };

  const compiled = (gl, vertex, fragment) => {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const places = {};
    return { use: () => gl.useProgram(program), at: name => places[name] ??= gl.getUniformLocation(program, name) };
  };

  /** Bind attributes of a buffer: [place, numbers, first] of each, `step` numbers a vertex or an instance. */
  const bind = (gl, buffer, step, parts, divisor) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const [place, count, first] of parts) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, count, gl.FLOAT, false, 4 * step, 4 * first);
      gl.vertexAttribDivisor(place, divisor);
    }
  };

  /** What draws on a canvas; null where the browser has no WebGL 2. */
  const on = canvas => {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) return null;
    const solid = compiled(gl, CAPSULE, LIGHT), mesh = compiled(gl, MESH, LIGHT), line = compiled(gl, LINE, PAINT);
    const capsule = capsuleMesh();
    const buffer = (values, target = gl.ARRAY_BUFFER) => {
      const made = gl.createBuffer();
      gl.bindBuffer(target, made);
      gl.bufferData(target, values, gl.STATIC_DRAW);
      return made;
    };
    const fill = (made, values) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, made.buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.DYNAMIC_DRAW);
    };

    /** Capsules: rows of a, b, radius and colour. */
    const capsules = () => {
      const made = { buffer: gl.createBuffer(), array: gl.createVertexArray(), count: 0 };
      gl.bindVertexArray(made.array);
      bind(gl, buffer(capsule.points), 4, [[0, 4, 0]], 0);
      bind(gl, made.buffer, 10, [[1, 3, 0], [2, 3, 3], [3, 1, 6], [4, 3, 7]], 1);
      buffer(capsule.triangles, gl.ELEMENT_ARRAY_BUFFER);
      gl.bindVertexArray(null);
      made.set = rows => { fill(made, rows.flat(Infinity)); made.count = rows.length; };
      made.draw = () => {
        gl.bindVertexArray(made.array);
        gl.drawElementsInstanced(gl.TRIANGLES, capsule.triangles.length, gl.UNSIGNED_SHORT, 0, made.count);
      };
      return made;
    };

    /** Triangles with normals: rows of a point and a normal. */
    const triangles = () => {
      const made = { buffer: gl.createBuffer(), array: gl.createVertexArray(), count: 0 };
      gl.bindVertexArray(made.array);
      bind(gl, made.buffer, 6, [[0, 3, 0], [1, 3, 3]], 0);
      gl.bindVertexArray(null);
      made.set = rows => { fill(made, rows.flat(Infinity)); made.count = rows.length; };
      made.draw = () => { gl.bindVertexArray(made.array); gl.drawArrays(gl.TRIANGLES, 0, made.count); };
      return made;
    };

    /** Lines: lists of points; one that is not a number ends a line. */
    const lines = () => {
      const made = { buffer: gl.createBuffer(), array: gl.createVertexArray(), count: 0 };
      gl.bindVertexArray(made.array);
      bind(gl, buffer(new Float32Array([0, -1, 0, 1, 1, -1, 1, 1])), 2, [[0, 2, 0]], 0);
      bind(gl, made.buffer, 6, [[1, 3, 0], [2, 3, 3]], 1);
      gl.bindVertexArray(null);
      made.set = several => {
        const rows = [];
        for (const points of several) for (let k = 0; k + 1 < points.length; k++) {
          const ends = [...points[k], ...points[k + 1]];
          if (ends.every(Number.isFinite)) rows.push(...ends);
        }
        fill(made, rows);
        made.count = rows.length / 6;
      };
      made.draw = () => { gl.bindVertexArray(made.array); gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, made.count); };
      return made;
    };
    return { gl, solid, mesh, line, capsules, triangles, lines };
  };

  return { on, camera, across, minus, capsuleMesh };
})();
