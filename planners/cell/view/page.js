"use strict";
// The page: time, controls, keys, tables and the plot of the joints.

(() => {
  const $ = name => document.getElementById(name);
  const data = JSON.parse($("data").textContent), arm = Arm.made(data.arm);
  const tracks = { planned: Arm.track(data.planned, arm.n) };
  if (data.executed) tracks.executed = Arm.track(data.executed, arm.n);
  const end = Math.max(...Object.values(tracks).map(track => track.end));
  const canvas = $("canvas"), picture = Picture(canvas, $("labels"), data, arm, tracks);
  const number = (value, digits) => {
    const text = value.toFixed(digits);
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
  };
  const small = value => { // a deviation, with two digits however small it is
    if (value === 0 || Math.abs(value) >= 0.01) return number(value, value ? 3 : 0);
    const [digits, power] = value.toExponential(1).replace("-", "−").split("e");
    return `${digits}·10${[...power.replace("-", "−")].map(c => (c === "−" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("")}`;
  };
  const shown = { time: 0, playing: false, track: data.executed ? "executed" : "planned", before: 0, frame: 0 };

  // ---- the state at a time

  const state = (time, name = shown.track) => {
    const { q, dq } = tracks[name].at(time), poses = arm.frames(q);
    return { q, dq, poses, tool: Arm.origin(poses[arm.n + 1]), velocity: arm.velocity(poses, dq) };
  };

  const cells = data.arm.joints.map((name, i) => {
    const row = $("joints").tBodies[0].insertRow(), head = row.appendChild(document.createElement("th"));
    head.scope = "row";
    head.append(Object.assign(document.createElement("i"), { className: `c${i % 7}` }), name);
    return [row.insertCell(), row.insertCell(), ...(data.executed ? [row.insertCell()] : [])];
  });

  const write = (now, planned) => {
    const { per, units } = data.arm;
    cells.forEach((row, i) => {
      row[0].textContent = `${number(per[i] * now.q[i], 2)}${units[i]}`;
      row[1].textContent = `${number(per[i] * now.dq[i], 2)}${units[i]}/s`;
      if (row[2]) row[2].textContent = `${small(per[i] * (now.q[i] - planned.q[i]))}${units[i]}`;
    });
    $("tool").textContent = now.tool.map(v => number(1e3 * v, 2)).join(", ");
    $("speed-now").textContent = number(1e3 * Arm.length(now.velocity), 1);
    if (data.executed) $("off").textContent = small(1e3 * Arm.length(Arm.minus(now.tool, planned.tool)));
    $("clock").textContent = `${number(shown.time, 3)} s of ${number(end, 3)} s`;
    $("time").value = shown.time;
    $("time").setAttribute("aria-valuetext", $("clock").textContent);
  };

  const draw = () => {
    shown.frame = 0;
    const planned = state(shown.time, "planned"), now = shown.track === "planned" ? planned : state(shown.time);
    write(now, planned);
    plot.draw();
    picture.draw(now.poses, shown.track === "planned" ? null : planned.poses);
  };
  const ask = () => { shown.frame ||= requestAnimationFrame(draw); };

  // ---- time

  const seek = time => {
    shown.time = Math.min(end, Math.max(0, time));
    ask();
  };
  const play = on => {
    shown.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", on);
    if (!on) return;
    if (shown.time >= end) shown.time = 0;
    shown.before = performance.now();
    requestAnimationFrame(tick);
  };
  const tick = instant => {
    if (!shown.playing) return;
    let next = shown.time + Math.max(0, instant - shown.before) / 1e3 * Number($("speed").value);
    shown.before = instant;
    if (next >= end && $("loop").checked) next = 0;
    seek(next);
    if (next >= end) play(false); else requestAnimationFrame(tick);
  };
  $("time").max = end;
  $("time").addEventListener("input", event => { play(false); seek(Number(event.target.value)); });
  $("play").addEventListener("click", () => play(!shown.playing));
  $("which")?.addEventListener("change", event => { shown.track = event.target.value; ask(); });
  $("magnify")?.addEventListener("change", event => { picture.magnify(Number(event.target.value)); ask(); });
  $("reset").addEventListener("click", () => { picture.fit(); ask(); });

  // ---- the camera, by mouse, touch and keys

  const camera = picture.camera, fingers = new Map();
  const turn = (dx, dy) => {
    camera.azimuth -= 0.008 * dx;
    camera.elevation = Math.min(1.55, Math.max(-1.55, camera.elevation + 0.008 * dy));
  };
  const shift = (dx, dy) => {
    const scale = 2 * camera.opening * camera.distance / canvas.clientHeight;
    camera.target = Arm.plus(Arm.plus(camera.target, camera.right, -scale * dx), camera.above, scale * dy);
  };
  const zoom = factor => {
    camera.distance = Math.min(50 * picture.reach, Math.max(0.02 * picture.reach, camera.distance * factor));
    ask();
  };
  const apart = () => { const [a, b] = fingers.values(); return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", event => {
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => {
    const finger = fingers.get(event.pointerId);
    if (!finger) return;
    const dx = event.clientX - finger.x, dy = event.clientY - finger.y, before = fingers.size === 2 ? apart() : 0;
    Object.assign(finger, { x: event.clientX, y: event.clientY });
    if (fingers.size === 2) {
      shift(dx / 2, dy / 2);
      zoom(before / Math.max(1, apart()));
    } else if (event.shiftKey || event.buttons & 2) shift(dx, dy);
    else turn(dx, dy);
    ask();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => fingers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("wheel", event => { event.preventDefault(); zoom(Math.exp(0.0012 * event.deltaY)); }, { passive: false });
  canvas.addEventListener("dblclick", () => { picture.fit(); ask(); });

  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const keys = {
    " ": () => play(!shown.playing), k: () => play(!shown.playing), r: () => { picture.fit(); ask(); },
    Home: () => seek(0), End: () => seek(end), "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1 / 0.9),
  };
  addEventListener("keydown", event => {
    const { target, key } = event, arrow = arrows[key];
    if (event.ctrlKey || event.altKey || event.metaKey || target.matches("select, summary, input[type=checkbox]")) return;
    if (target === $("play") && key === " ") return; // the button plays by itself
    if (arrow && target === canvas) { turn(12 * arrow[0], 12 * arrow[1]); ask(); }
    else if (arrow && arrow[0]) { play(false); seek(shown.time + arrow[0] * (event.shiftKey ? 0.1 : 0.01)); }
    else if (keys[key]) keys[key]();
    else return;
    event.preventDefault();
  });

  // ---- the plot of the joints

  const plot = (() => {
    const board = $("plot"), drawing = board.getContext("2d"), edge = { left: 46, right: 8, top: 8, bottom: 20 };
    const curves = order => Object.entries(tracks).map(([name, track]) => ({ name, track, values: order ? track.dq : track.q }));
    const round = (low, high) => {
      const raw = (high - low) / 4, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find(m => m * power >= raw) * power;
      return Array.from({ length: 12 }, (_, k) => (Math.ceil(low / step) + k) * step).filter(v => v <= high + 1e-9 * step);
    };
    const curvesOn = (drawing, width, height, order, paint) => { // all but the time that is shown
      let low = order ? 0 : Infinity, high = order ? 0 : -Infinity;
      for (const { values } of curves(order)) values.forEach((v, k) => {
        low = Math.min(low, v * data.arm.per[k % arm.n]);
        high = Math.max(high, v * data.arm.per[k % arm.n]);
      });
      const room = high - low > 1e-9 ? 0.05 * (high - low) : 1;
      low -= room;
      high += room;
      const x = t => edge.left + (width - edge.left - edge.right) * t / (end || 1);
      const y = v => height - edge.bottom - (height - edge.top - edge.bottom) * (v - low) / (high - low);
      drawing.font = "11px system-ui, sans-serif";
      drawing.fillStyle = paint("muted");
      drawing.strokeStyle = paint("line");
      drawing.textAlign = "right";
      for (const v of round(low, high)) {
        drawing.strokeRect(edge.left, y(v), width - edge.left - edge.right, 0);
        drawing.fillText(String(Number(v.toPrecision(6))).replace("-", "−"), edge.left - 5, y(v) + 4);
      }
      drawing.textAlign = "center";
      for (const t of round(0, end || 1)) drawing.fillText(`${Number(t.toPrecision(6))} s`, Math.min(x(t), width - 20), height - 5);
      for (const { name, track, values } of curves(order)) for (let i = 0; i < arm.n; i++) {
        drawing.beginPath();
        drawing.strokeStyle = paint(`c${i % 7}`);
        drawing.lineWidth = 1.5;
        drawing.setLineDash(data.executed && name === "planned" ? [5, 4] : []);
        for (let k = 0; k < track.count; k++) drawing.lineTo(x(track.t[k]), y(values[arm.n * k + i] * data.arm.per[i]));
        drawing.stroke();
      }
    };
    const still = document.createElement("canvas"); // what does not change with time is drawn once
    let drawn = "";
    const draw = () => {
      const ratio = devicePixelRatio, width = board.clientWidth, height = board.clientHeight, order = Number($("order").value);
      const style = getComputedStyle(board), paint = name => style.getPropertyValue(`--${name}`);
      const wanted = [ratio, width, height, order, paint("ink")].join();
      for (const canvas of wanted === drawn ? [] : [board, still]) {
        canvas.width = Math.round(width * ratio);
        canvas.height = Math.round(height * ratio);
      }
      if (wanted !== drawn) {
        const under = still.getContext("2d");
        under.scale(ratio, ratio);
        curvesOn(under, width, height, order, paint);
        drawn = wanted;
      }
      if (!width || !height) return;
      const x = ratio * (edge.left + (width - edge.left - edge.right) * shown.time / (end || 1));
      drawing.clearRect(0, 0, board.width, board.height);
      drawing.drawImage(still, 0, 0);
      drawing.fillStyle = paint("ink");
      drawing.fillRect(x - 0.5 * ratio, ratio * edge.top, ratio, ratio * (height - edge.top - edge.bottom));
    };
    const to = event => {
      const box = board.getBoundingClientRect();
      play(false);
      seek(end * (event.clientX - box.left - edge.left) / (box.width - edge.left - edge.right));
    };
    board.addEventListener("pointerdown", event => { board.setPointerCapture(event.pointerId); to(event); });
    board.addEventListener("pointermove", event => { if (event.buttons) to(event); });
    $("order").addEventListener("change", ask);
    return { draw };
  })();

  // ---- start

  const begin = () => {
    const there = picture.build();
    $("without").hidden = there;
    picture.magnify(Number($("magnify")?.value || 1));
    ask();
  };
  $("spacing").textContent = picture.spacing >= 1 ? `${picture.spacing} m` : `${Math.round(1e3 * picture.spacing)} mm`;
  canvas.addEventListener("webglcontextlost", event => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", begin);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { picture.theme(); ask(); });
  let touched = false;
  for (const name of ["pointerdown", "wheel", "keydown"]) canvas.addEventListener(name, () => { touched = true; });
  new ResizeObserver(() => {
    camera.aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight);
    if (!touched) picture.fit();
    ask();
  }).observe(canvas);
  begin();

  /** For checks: what is shown, in numbers. */
  window.optikView = {
    state, seek, play, draw, camera, end, shown,
    project: point => { const [u, v] = camera.project(point); return [u * canvas.clientWidth, v * canvas.clientHeight]; },
  };
})();
