"use strict";
// The picture: the arm at an instant, a second arm beside it, path, executed path, scene, payload, laser beam, grid and frames.

const Picture = (canvas, labels, data, arm, tracks) => {
  const { numbers, moved, origin, axis, plus, minus, cross, dot, length } = Arm;
  const rows = (text, width) => {
    const flat = numbers(text);
    return Array.from({ length: flat.length / width }, (_, k) => [...flat.subarray(width * k, width * k + width)]);
  };
  const capsules = data.capsules && rows(data.capsules, 8).map(c => ({ link: c[0], a: c.slice(1, 4), b: c.slice(4, 7), r: c[7] }));
  const path = rows(data.path, 3), up = data.up;
  const boxes = rows(data.scene.boxes, 19).map(b => ({ pose: b.slice(0, 16), edges: b.slice(16) }));
  const cylinders = rows(data.scene.cylinders, 7).map(c => ({ a: c.slice(0, 3), b: c.slice(3, 6), r: c[6] }));
  const meshes = data.scene.meshes.map(m => ({
    faces: rows(m.faces, 9).map(t => [t.slice(0, 3), t.slice(3, 6), t.slice(6)]), edges: rows(m.edges, 6).map(e => [e.slice(0, 3), e.slice(3)]),
  }));
  const rounds = rows(data.scene.rounds, 7), planes = rows(data.scene.planes, 6);
  const payload = data.payload;
  const did = data.executed && tracks.executed; // the executed path of the tool, and where the planned tool was at its instants
  const executed = did ? Array.from(did.t, (t, k) => [arm.tool(tracks.planned.at(t).q), arm.tool(did.configuration(k))]) : [];

  // ---- how large everything is

  /** Middles of the arm's bodies and its tool: ends of its capsules, or its joint frames. */
  const armPoints = poses => [...(capsules || []).flatMap(c => [c.a, c.b].map(end => ({ p: moved(poses[c.link], end), r: c.r }))),
    ...(capsules ? poses.slice(-1) : poses).map(T => ({ p: origin(T), r: 0 }))];
  const postures = Object.values(tracks).flatMap(track => Array.from({ length: 25 }, (_, k) => arm.frames(track.at(track.end * k / 24).q)));
  const everywhere = postures.flatMap(armPoints);
  const reach = Math.max(0.05, ...everywhere.map(at => length(at.p)), ...path.map(length).filter(Number.isFinite));
  const corners = box => [0, 1, 2, 3, 4, 5, 6, 7].map(k =>
    moved(box.pose, box.edges.map((e, i) => (k >> i & 1 ? 0.5 : -0.5) * e)));
  const points = [[0, 0, 0], ...path, ...(data.beam || []), ...boxes.flatMap(corners), ...meshes.flatMap(m => m.faces.flat())];
  const seen = [...everywhere, ...postures.map(poses => ({ p: origin(poses[arm.n + 1]), r: 0.1 * reach })), ...points.map(p => ({ p, r: 0 })), ...cylinders.flatMap(c => [c.a, c.b].map(p => ({ p, r: c.r }))),
    ...rounds.flatMap(c => [c.slice(0, 3), c.slice(3, 6)].map(p => ({ p, r: c[6] })))].filter(at => length(at.p) <= 2.5 * reach);

  // ---- the camera

  const camera = Draw.camera(up);
  /** How many points of a path a box hides from the eye. */
  const hidden = (course, eye) => course.filter(p => boxes.some(box => {
    let near = 0, far = 0.999;
    for (let i = 0; i < 3; i++) {
      const side = axis(box.pose, i), from = dot(minus(p, origin(box.pose)), side), along = dot(minus(eye, p), side), half = box.edges[i] / 2;
      const ends = [(-half - from) / along, (half - from) / along].sort((a, b) => a - b);
      near = Math.max(near, ends[0]);
      far = Math.min(far, ends[1]);
    }
    return near < far;
  })).length;
  const fit = () => {
    const course = path.filter(p => p.every(Number.isFinite)); // a row of NaN is between two paths
    const middle = course[course.length >> 1] || [1, 0, 0], level = plus(middle, up, -dot(middle, up));
    const ahead = length(level) > 0.01 * reach ? camera.towards(level) : 0;
    camera.elevation = 0.35;
    camera.target = middle;
    camera.distance = 4 * reach; // of the angles, the first from which most of the path is in sight
    const angles = [0.75, -0.75, 0, 1.5, -1.5, 2.3, -2.3, 3.1].map(turn => ahead + turn);
    const counts = angles.map(angle => { camera.azimuth = angle; return hidden(course, camera.eye); });
    camera.azimuth = angles[counts.indexOf(Math.min(...counts))];
    const views = [camera.right, camera.above, camera.back];
    camera.target = [0, 0, 0];
    for (const view of views) {
      const low = Math.min(...seen.map(({ p, r }) => dot(p, view) - r)), high = Math.max(...seen.map(({ p, r }) => dot(p, view) + r));
      camera.target = plus(camera.target, view, 0.5 * (low + high));
    }
    const wide = camera.opening * camera.aspect;
    const needed = seen.map(({ p, r }) => ({ p: minus(p, camera.target), r })).map(({ p, r }) =>
      r + dot(p, camera.back) + Math.max((Math.abs(dot(p, views[0])) + r) / wide, (Math.abs(dot(p, views[1])) + r) / camera.opening));
    camera.distance = 1.1 * Math.max(0.1 * reach, ...needed);
  };

  // ---- what does not move

  const steps = [1, 2, 5].flatMap(m => [0.001, 0.01, 0.1, 1, 10].map(p => m * p)).sort((a, b) => a - b);
  const spacing = steps.find(s => s >= reach / 10) || 10;
  const foot = Math.min(0, ...(capsules || []).filter(c => !c.link).flatMap(c => [c.a, c.b].map(p => dot(p, up) - c.r)));
  const gridLines = () => { // level, through the base frame or below what stands of the arm below it
    const [x, y] = Draw.across(up), count = Math.ceil(1.3 * reach / spacing), level = up.map(c => c * foot), out = [];
    for (let k = -count; k <= count; k++) for (const [u, v] of [[x, y], [y, x]])
      out.push([-1, 1].map(side => plus(plus(level, u, k * spacing), v, side * count * spacing)));
    return out;
  };
  const square = plane => {
    const normal = plane.slice(3), near = normal.map(c => c * dot(plane.slice(0, 3), normal)), [x, y] = Draw.across(normal);
    return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([i, j]) => plus(plus(near, x, 1.2 * i * reach), y, 1.2 * j * reach));
  };
  const outline = plane => { const c = square(plane); return [...c, c[0]]; };
  const faces = box => {
    const c = corners(box), out = [];
    for (let i = 0; i < 3; i++) for (const side of [0, 1]) {
      const normal = axis(box.pose, i).map(v => (side ? 1 : -1) * v), j = 1 << (i + 1) % 3, k = 1 << (i + 2) % 3, s = side << i;
      for (const corner of [s, s | j, s | j | k, s, s | j | k, s | k]) out.push(c[corner], normal);
    }
    return out;
  };
  const edges = box => {
    const c = corners(box), out = [];
    for (let k = 0; k < 8; k++) for (const bit of [1, 2, 4]) if (!(k & bit)) out.push([c[k], c[k | bit]]);
    return out;
  };
  const rings = c => { // points around both ends of a cylinder, and the directions to them
    const z = minus(c.b, c.a), [x, y] = Draw.across(z.map(v => v / length(z)));
    const out = Array.from({ length: 33 }, (_, k) => plus(plus([0, 0, 0], x, Math.cos(k * Math.PI / 16)), y, Math.sin(k * Math.PI / 16)));
    return { z, out, ends: [c.a, c.b].map(end => out.map(n => plus(end, n, c.r))) };
  };
  const sides = c => {
    const { z, out, ends: [low, high] } = rings(c), down = z.map(v => -v), rows = [];
    for (let k = 0; k < 32; k++) {
      for (const [at, i] of [[low, k], [low, k + 1], [high, k + 1], [low, k], [high, k + 1], [high, k]]) rows.push([at[i], out[i]]);
      rows.push([c.a, down], [low[k], down], [low[k + 1], down], [c.b, z], [high[k], z], [high[k + 1], z]);
    }
    return rows;
  };
  const triad = (pose, size) => [0, 1, 2].map(k => [origin(pose), plus(origin(pose), axis(pose, k), size)]);

  // ---- drawing

  let surface = null, layers = null, colours = {};
  const colour = name => {
    const text = getComputedStyle(canvas).getPropertyValue(`--${name}`).trim();
    return [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16) / 255);
  };
  const theme = () => {
    const names = ["back", "arm", "link", "path", "executed", "planned", "beam", "scene", "edges", "near", "contact", "payload", "before", "zone", "event", "grid",
      "mark", "x", "y", "z"];
    colours = Object.fromEntries(names.map(name => [name, colour(name)]));
  };
  const build = () => {
    surface = Draw.on(canvas);
    if (!surface) return false;
    const { lines, capsules: round, triangles } = surface;
    layers = {
      grid: lines(), path: lines(), executed: lines(), planned: lines(), beam: lines(), before: lines(), zone: lines(), event: lines(), edges: lines(), near: lines(),
      x: lines(), y: lines(), z: lines(), arm: round(), second: round(), marks: round(), rounds: round(),
      solids: triangles(), planes: triangles(),
    };
    layers.grid.set(gridLines());
    layers.path.set([path]);
    layers.beam.set(data.beam ? [data.beam] : []);
    layers.before.set(data.before ? [rows(data.before, 3)] : []);
    layers.zone.set((data.zones || []).map(zone => rows(zone, 3)));
    const size = 0.02 * reach, axes = [[size, 0, 0], [0, size, 0], [0, 0, size]];
    layers.event.set((data.events ? rows(data.events, 3) : []).flatMap(p => axes.map(d => [minus(p, d), p.map((x, k) => x + d[k])])));
    const flat = boxes.flatMap(faces);
    layers.solids.set([...flat.flatMap((v, k) => (k % 2 ? [] : [[v, flat[k + 1]]])), ...cylinders.flatMap(sides),
      ...meshes.flatMap(m => m.faces.flatMap(([a, b, c]) => [a, b, c].map(p => [p, cross(minus(b, a), minus(c, a))])))]);
    layers.planes.set(planes.flatMap(p => { const c = square(p); return [0, 1, 2, 0, 2, 3].map(k => [c[k], p.slice(3)]); }));
    layers.edges.set([...boxes.flatMap(edges), ...cylinders.flatMap(c => rings(c).ends), ...meshes.flatMap(m => m.edges),
      ...planes.map(outline)]);
    return true;
  };

  /** Draw the executed path so many times as far from the planned tool as it was. */
  const magnify = factor => {
    if (surface) layers.executed.set([executed.map(([planned, done]) => plus(planned, minus(done, planned), factor))]);
  };

  /** The capsules of the arm at the poses of its frames; those of a list in another colour. */
  const bodies = (poses, near = [], tint = null) => {
    if (capsules) return capsules.map((c, i) => [moved(poses[c.link], c.a), moved(poses[c.link], c.b), c.r,
      near.includes(i) ? tint : c.link % 2 ? colours.link : colours.arm]);
    const points = poses.map(origin), thin = 0.008 * reach;
    return [...points.slice(1).map((p, k) => [points[k], p, thin, colours.arm]),
      ...points.slice(0, -1).map(p => [p, p, 2 * thin, colours.link])];
  };
  const move = (poses, { ghost, second, pair }) => {
    const tool = poses[arm.n + 1], dot_ = 0.006 * camera.distance, { capsule, kind, object, room } = pair || {};
    colours.pair = room < 0 ? colours.contact : colours.near;
    layers.arm.set(bodies(poses, kind === "own" ? [capsule, object] : [capsule], colours.pair));
    const moving = second ? bodies(second).filter((_, i) => !capsules || capsules[i].link) : [];
    layers.second.set(moving.map(body => [...body.slice(0, 3), colours.executed]));
    layers.rounds.set(rounds.map((r, i) =>
      [r.slice(0, 3), r.slice(3, 6), r[6], kind === "rounds" && object === i ? colours.pair : colours.scene]));
    layers.near.set(kind === "boxes" && boxes[object] ? edges(boxes[object])
      : kind === "cylinders" && cylinders[object] ? rings(cylinders[object]).ends
      : kind === "meshes" && meshes[object] ? meshes[object].edges
      : kind === "planes" ? [outline(planes[object])] : []);
    const marks = [[origin(tool), origin(tool), dot_, colours.mark]];
    if (payload) marks.push([moved(tool, payload.com), moved(tool, payload.com), 1.5 * dot_, colours.payload]);
    for (const p of data.beam || []) marks.push([p, p, dot_, colours.beam]);
    layers.marks.set(marks);
    layers.planned.set(ghost ? [ghost.map(origin)] : []);
    const triads = [triad(poses[0], 0.16 * reach), triad(tool, 0.1 * reach)];
    ["x", "y", "z"].forEach((name, k) => layers[name].set(triads.map(t => t[k])));
  };

  const paintLines = (gl, names, alpha) => {
    const { line } = surface;
    const widths = { grid: 1, edges: 1.5, near: 3, path: 5, executed: 2.5, planned: 2.5, beam: 3, before: 2, zone: 6, event: 3, x: 3, y: 3, z: 3 };
    line.use();
    gl.uniformMatrix4fv(line.at("camera"), false, camera.matrix);
    gl.uniform2f(line.at("viewport"), gl.drawingBufferWidth, gl.drawingBufferHeight);
    for (const name of names) {
      gl.uniform1f(line.at("width"), widths[name] * devicePixelRatio);
      gl.uniform4f(line.at("paint"), ...colours[name === "near" ? "pair" : name], alpha);
      layers[name].draw();
    }
  };
  const paintSolid = (gl, program, names, alpha, plain = 0) => {
    program.use();
    gl.uniformMatrix4fv(program.at("camera"), false, camera.matrix);
    gl.uniform3f(program.at("eye"), ...camera.eye);
    gl.uniform3f(program.at("up"), ...up);
    gl.uniform1f(program.at("alpha"), alpha);
    gl.uniform1f(program.at("plain"), plain);
    if (program === surface.mesh) gl.uniform3f(program.at("paint"), ...colours.scene);
    for (const name of names) layers[name].draw();
  };

  /** Draw the arm at the poses of its frames; beside it `ghost` as lines, `second` as a translucent arm, the nearest `pair`. */
  const draw = (poses, beside = {}) => {
    const ratio = devicePixelRatio, width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    camera.aspect = width / Math.max(1, height);
    camera.update();
    label(poses);
    if (!surface) return;
    const { gl, solid, mesh } = surface, traces = ["before", "path", "zone", "event", "executed", "planned", "beam", "near", "x", "y", "z"];
    move(poses, beside);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...colours.back, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthFunc(gl.LEQUAL);
    paintLines(gl, ["grid"], 1);
    paintSolid(gl, solid, ["arm"], 1);
    paintLines(gl, [...traces, "edges"], 1);
    gl.depthFunc(gl.GREATER); // what stands behind something shines through it
    gl.depthMask(false);
    paintLines(gl, traces, 0.3);
    gl.depthFunc(gl.LEQUAL);
    paintSolid(gl, solid, ["rounds", "second"], 0.5);
    paintSolid(gl, mesh, ["solids"], 0.4);
    paintSolid(gl, mesh, ["planes"], 0.18);
    gl.disable(gl.DEPTH_TEST);
    paintSolid(gl, solid, ["marks"], 1, 1);
  };

  // ---- words in the picture

  const words = [["X", 0], ["Y", 1], ["Z", 2]].map(([text, k]) => [text, () => [0, 1, 2].map(i => (i === k ? 0.18 * reach : 0))]);
  const moves = path.length > 1, closed = moves && !data.beam && Arm.length(Arm.minus(path[0], path[path.length - 1])) < 1e-3 * reach;
  if (moves) words.push([closed ? "start, goal" : "start", () => path[0]]);
  if (data.beam) words.push(["laser unit", () => data.beam[0]], ["spot", () => data.beam[1]]);
  else if (moves && !closed) words.push(["goal", () => path[path.length - 1]]);
  words.push(["tool", poses => origin(poses[arm.n + 1])]);
  if (payload) words.push([payload.words, poses => moved(poses[arm.n + 1], payload.com)]);
  const places = words.map(([text]) => {
    const place = labels.appendChild(document.createElement("span"));
    place.textContent = text;
    return place;
  });
  const label = poses => {
    const taken = []; // by the words before: a word stands above those that it would lie on
    words.forEach(([, point], k) => {
      const at = camera.project(point(poses)), place = places[k];
      place.hidden = !at;
      if (!at) return;
      const { offsetWidth: w, offsetHeight: h } = place, x = Math.min(at[0] * canvas.clientWidth, canvas.clientWidth - w - 8);
      let y = at[1] * canvas.clientHeight;
      while (taken.some(other => Math.abs(other.y - y) < h && x < other.x + other.w && other.x < x + w)) y -= 1;
      taken.push({ x, y, w });
      place.style.translate = `${x}px ${y}px`;
    });
  };

  theme();
  return { build, draw, fit, theme, magnify, camera, spacing, reach, executed };
};
