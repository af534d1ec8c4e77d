"use strict";
// The player: the picture, the time with its controls, and the camera by mouse, touch and keys. `$` finds elements by name.

/** Text of a number with a fixed count of decimals, without a sign if it is 0; a dash for NaN. */
const decimals = (value, digits) => {
  if (Number.isNaN(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
};

/**
 * Play motions (`tracks` by name) of an arm. The control `which` names the shown one, and `beside` the one beside it: by
 * default `planned`, as lines. `keys` is the target of key events; `drawn` is called before each picture with the states of
 * both, and returns the nearest pair of shapes.
 */
const Player = ($, data, arm, tracks, keys, drawn = () => null) => {
  const canvas = $("canvas"), picture = Picture(canvas, $("labels"), data, arm, tracks), camera = picture.camera;
  const shown = { time: 0, playing: false, before: 0, frame: 0, get track() { return $("which")?.value || "planned"; } };
  const second = () => ($("beside") ? $("beside").value : "planned");
  const ends = () => ($("beside") ? [shown.track, second()] : Object.keys(tracks)).map(name => tracks[name]?.end || 0);
  const end = () => Math.max(...ends());

  const describe = ({ q, dq }) => {
    const poses = arm.frames(q);
    return { q, dq, poses, tool: Arm.origin(poses[arm.n + 1]), velocity: arm.velocity(poses, dq) };
  };
  const state = (time, name = shown.track) => describe(tracks[name].at(time));
  const draw = () => {
    shown.frame = 0;
    const now = state(shown.time), other = tracks[second()] && second() !== shown.track ? state(shown.time, second()) : now;
    $("clock").textContent = `${decimals(shown.time, 3)} s of ${decimals(end(), 3)} s`;
    $("time").max = end();
    $("time").value = shown.time;
    $("time").setAttribute("aria-valuetext", $("clock").textContent);
    const pair = drawn(now, other), poses = other === now ? null : other.poses;
    picture.draw(now.poses, { [$("beside") ? "second" : "ghost"]: poses, pair });
  };
  const ask = () => { shown.frame ||= requestAnimationFrame(draw); };

  // ---- time

  const seek = time => {
    shown.time = Math.min(end(), Math.max(0, time));
    ask();
  };
  const play = on => {
    shown.playing = on;
    $("play").textContent = on ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", on);
    if (!on) return;
    if (shown.time >= end()) shown.time = 0;
    shown.before = performance.now();
    requestAnimationFrame(tick);
  };
  const tick = instant => {
    if (!shown.playing) return;
    let next = shown.time + Math.max(0, instant - shown.before) / 1e3 * Number($("speed").value);
    shown.before = instant;
    if (next >= end() && $("loop").checked) next = 0;
    seek(next);
    if (next >= end()) play(false); else requestAnimationFrame(tick);
  };
  $("time").addEventListener("input", event => { play(false); seek(Number(event.target.value)); });
  $("play").addEventListener("click", () => play(!shown.playing));
  for (const name of ["which", "beside"]) $(name)?.addEventListener("change", () => seek(shown.time));
  $("magnify")?.addEventListener("change", event => { picture.magnify(Number(event.target.value)); ask(); });
  $("reset").addEventListener("click", () => { picture.fit(); ask(); });

  // ---- the camera

  const fingers = new Map();
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
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    zoom(Math.exp(0.0012 * event.deltaY));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { picture.fit(); ask(); });

  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const actions = {
    " ": () => play(!shown.playing), k: () => play(!shown.playing), r: () => { picture.fit(); ask(); },
    Home: () => seek(0), End: () => seek(end()), "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1 / 0.9),
  };
  keys.addEventListener("keydown", event => {
    const { target, key } = event, arrow = arrows[key];
    if (event.ctrlKey || event.altKey || event.metaKey || target.matches("select, summary, input[type=checkbox]")) return;
    if (key === " " && target.matches("button")) return; // the button acts by itself
    if (arrow && target === canvas) { turn(12 * arrow[0], 12 * arrow[1]); ask(); }
    else if (arrow && arrow[0]) { play(false); seek(shown.time + arrow[0] * (event.shiftKey ? 0.1 : 0.01)); }
    else if (actions[key]) actions[key]();
    else return;
    event.preventDefault();
  });

  // ---- start, size and colours

  const begin = () => {
    $("without").hidden = picture.build();
    picture.magnify(Number($("magnify")?.value || 1));
    ask();
  };
  $("spacing").textContent = picture.spacing >= 1 ? `${picture.spacing} m` : `${Math.round(1e3 * picture.spacing)} mm`;
  canvas.addEventListener("webglcontextlost", event => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", begin);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { picture.theme(); ask(); });
  const host = canvas.getRootNode().host || document.documentElement;
  for (const printing of [true, false]) addEventListener(printing ? "beforeprint" : "afterprint", () => { // paper is white
    host.classList.toggle("printing", printing);
    picture.theme();
    draw();
  });
  let touched = false;
  for (const name of ["pointerdown", "wheel", "keydown"]) canvas.addEventListener(name, () => { touched = true; });
  new ResizeObserver(() => {
    camera.aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight);
    if (!touched) picture.fit();
    ask();
  }).observe(canvas);
  begin();
  return { shown, state, seek, play, draw, ask, camera, get end() { return end(); } };
};
