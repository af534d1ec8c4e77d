"use strict";
// The page of a motion: the player, tables of the shown time, and plots.

(() => {
  const $ = name => document.getElementById(name);
  const data = JSON.parse($("data").textContent), arm = Arm.made(data.arm);
  const tracks = { planned: Arm.track(data.planned, arm.joints) };
  if (data.executed) tracks.executed = Arm.track(data.executed, arm.joints);
  const small = value => { // a deviation, with two digits however small it is
    if (value === 0 || Math.abs(value) >= 0.01) return decimals(value, value ? 3 : 0);
    const [digits, power] = value.toExponential(1).replace("-", "−").split("e");
    return `${digits}·10${[...power.replace("-", "−")].map(c => (c === "−" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("")}`;
  };
  const marked = (element, colour, ...words) => {
    element.append(Object.assign(document.createElement("i"), { className: colour }), ...words);
    return element;
  };
  const cells = data.arm.joints.map((name, i) => {
    const row = $("joints").tBodies[0].insertRow(), head = row.appendChild(document.createElement("th"));
    head.scope = "row";
    marked(head, `c${i % 7}`, name);
    return [row.insertCell(), row.insertCell(), ...(data.executed ? [row.insertCell()] : [])];
  });
  const nearest = (data.clearance?.kinds || []).map((kind, i) => {
    const line = $("nearest").appendChild(document.createElement("li")), output = document.createElement("output");
    marked(line, `c${i}`, `${kind} (margin ${decimals(1e3 * data.clearance.least[i], 1)} mm): `, output);
    return output;
  });

  /** Write the nearest pair of shapes of each kind, and return the one with the least room. */
  const writeNearest = track => {
    const distances = track.values("clearance", player.shown.time);
    if (!distances) return null;
    const found = track.nearest(player.shown.time).map((k, i) =>
      ({ ...data.clearance.pairs[k], distance: distances[i], room: distances[i] - data.clearance.least[i] }));
    found.forEach(({ names, distance }, i) => { nearest[i].textContent = `${names.join(" and ")}, ${decimals(1e3 * distance, 1)} mm`; });
    return found.reduce((a, b) => (b.room < a.room ? b : a));
  };
  const write = (now, planned) => {
    const { per, units } = data.arm;
    cells.forEach((row, i) => {
      row[0].textContent = `${decimals(per[i] * now.q[i], 2)}${units[i]}`;
      row[1].textContent = `${decimals(per[i] * now.dq[i], 2)}${units[i]}/s`;
      if (row[2]) row[2].textContent = `${small(per[i] * (now.q[i] - planned.q[i]))}${units[i]}`;
    });
    $("tool").textContent = now.tool.map(v => decimals(1e3 * v, 2)).join(", ");
    $("speed-now").textContent = decimals(1e3 * Arm.length(now.velocity), 1);
    if (data.executed) $("off").textContent = small(1e3 * Arm.length(Arm.minus(now.tool, planned.tool)));
    drawPlots();
    return writeNearest(tracks[player.shown.track]);
  };

  const player = Player($, data, arm, tracks, window, write);
  const drawPlots = Plots([...document.querySelectorAll("canvas.plot")], $("joint"), data, arm, tracks, player);

  /** For checks: what is shown, in numbers. */
  const canvas = $("canvas");
  window.optikView = Object.assign(player, {
    project: point => { const [u, v] = player.camera.project(point); return [u * canvas.clientWidth, v * canvas.clientHeight]; },
  });
})();
