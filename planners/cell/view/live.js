"use strict";
// The served page with a simulated drive: its buttons, and its arm while it runs.

(() => {
  const $ = name => document.getElementById(name), player = window.optikView;
  const send = path => fetch(path, { method: "POST", headers: { "X-Optik": "1" } });
  let runs = null, timer = 0;
  const look = async () => {
    const state = await (await fetch("state")).json();
    if (runs !== null && state.runs !== runs) return location.reload(); // another motion to show
    runs = state.runs;
    $("words").textContent = state.words;
    $("run").disabled = state.running;
    $("halt").disabled = !state.running;
    if (state.q) player.follow(state.t, state.q);
    timer = setTimeout(look, state.running ? 40 : 500);
  };
  const ask = path => send(path).then(() => { clearTimeout(timer); look(); });
  $("run").addEventListener("click", () => { player.play(false); ask("start"); });
  $("halt").addEventListener("click", () => ask("stop"));
  look();
})();
