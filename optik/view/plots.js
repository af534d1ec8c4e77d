"use strict";
// Plots of a motion's quantities over time with their limits. What does not change with the shown time is drawn once.

const Plots = (boards, joint, data, arm, tracks, player) => {
  const edge = { left: 46, right: 8, top: 8, bottom: 20 };
  const text = value => String(Number(value.toPrecision(6))).replace("-", "−");
  const ticks = (low, high) => {
    const raw = (high - low) / 4, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find(m => m * power >= raw) * power;
    return Array.from({ length: 12 }, (_, k) => (Math.ceil(low / step) + k) * step).filter(v => v <= high + 1e-9 * step);
  };

  /** What a board shows: its quantity's columns with their names, units, factors to these units, and limits in them. */
  const columnsOf = name => {
    if (name === "clearance") return data.clearance.kinds.map((kind, i) =>
      ({ i, name: kind, unit: " mm", factor: 1e3, low: 1e3 * data.clearance.least[i], high: Infinity }));
    const [low, high] = data.limits[name] || [[], []], order = ["", "/s", "/s²", "/s³"][["q", "dq", "ddq", "jerk"].indexOf(name)];
    return data.arm.joints.map((title, i) => {
      const factor = name === "torque" ? 1 : data.arm.per[i];
      const unit = name === "torque" ? (data.arm.prismatic[i] ? " N" : " N·m") : `${data.arm.units[i]}${order}`;
      return { i, name: title, unit, factor, low: factor * (low[i] ?? -Infinity), high: factor * (high[i] ?? Infinity) };
    });
  };

  /** Draw all but the shown time. */
  const drawCurves = (drawing, { name, shown, width, height, paint }) => {
    const series = Object.entries(tracks).filter(([, track]) => track.columns[name]);
    const each = (column, track, use) => {
      const values = track.columns[name], step = values.length / track.count;
      for (let k = 0; k < track.count; k++) use(track.t[k], column.factor * values[step * k + column.i]);
    };
    let low = name === "q" ? Infinity : 0, high = name === "q" ? -Infinity : 0;
    const include = v => { if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); } };
    for (const column of shown) for (const [, track] of series) each(column, track, (t, v) => include(v));
    if (shown.length === 1 || name === "clearance") for (const column of shown) [column.low, column.high].forEach(include);
    const room = high - low > 1e-9 ? 0.05 * (high - low) : 1;
    low -= room;
    high += room;
    const right = width - edge.right, bottom = height - edge.bottom, end = player.end || 1;
    const x = t => edge.left + (right - edge.left) * t / end;
    const y = v => bottom - (bottom - edge.top) * (v - low) / (high - low);
    drawing.font = "11px system-ui, sans-serif";
    drawing.fillStyle = paint("muted");
    drawing.strokeStyle = paint("line");
    drawing.textAlign = "right";
    for (const v of ticks(low, high)) {
      drawing.strokeRect(edge.left, y(v), right - edge.left, 0);
      drawing.fillText(text(v), edge.left - 5, y(v) + 4);
    }
    drawing.textAlign = "center";
    for (const t of ticks(0, end)) drawing.fillText(`${Number(t.toPrecision(6))} s`, Math.min(x(t), width - 20), height - 5);
    const stroke = (column, wide, dash, points) => {
      drawing.beginPath();
      drawing.strokeStyle = paint(`c${column.i % 7}`);
      drawing.lineWidth = wide;
      drawing.setLineDash(dash);
      for (const [t, v] of points) drawing.lineTo(x(t), y(v));
      drawing.stroke();
    };
    const same = shown.every(column => column.low === shown[0].low && column.high === shown[0].high); // else a line is of one joint
    for (const column of shown) {
      const limits = [column.low, column.high].filter(limit => limit >= low && limit <= high && (same || name === "clearance"));
      for (const limit of limits) stroke(column, 1, [1, 3], [[0, limit], [end, limit]]);
      for (const [key, track] of series) {
        const points = [];
        each(column, track, (t, v) => points.push([t, v]));
        stroke(column, 1.5, data.executed && key === "planned" ? [5, 4] : [], points);
      }
    }
  };

  /** The value at the shown time: of the only column, or of the one that is nearest to its limit. */
  const describe = (name, shown) => {
    const track = [tracks[player.shown.track], ...Object.values(tracks)].find(each => each.columns[name]);
    const values = track.values(name, player.shown.time);
    const rows = shown.map(column => {
      const value = column.factor * values[column.i], limit = value < 0 ? column.low : column.high;
      return { ...column, value, share: Number.isFinite(limit) && name !== "q" ? value / limit : NaN };
    });
    const row = rows.length === 1 ? rows[0] : rows.reduce((a, b) => (b.share > (a.share || 0) ? b : a));
    if (!(row.share > 0) && rows.length > 1) return "";
    const digits = Math.abs(row.share - 1) < 0.01 ? 2 : 0; // those that tell it from the limit
    const part = row.share >= 0 ? `, ${decimals(100 * row.share, digits)} % of limit` : "";
    return `${row.name} ${decimals(row.value, 1)}${row.unit}${part}`;
  };

  const plots = boards.map(board => {
    const name = board.dataset.quantity, all = columnsOf(name), output = board.parentElement.querySelector("output");
    const drawing = board.getContext("2d"), still = document.createElement("canvas");
    let drawn = "";
    const chosen = () => (name === "clearance" || joint.value === "" ? all : [all[joint.value]]);
    const draw = () => {
      const ratio = devicePixelRatio, width = board.clientWidth, height = board.clientHeight;
      const style = getComputedStyle(board), paint = colour => style.getPropertyValue(`--${colour}`);
      const wanted = [ratio, width, height, joint.value, player.end, paint("ink")].join();
      if (wanted !== drawn) {
        for (const canvas of [board, still]) {
          canvas.width = Math.round(width * ratio);
          canvas.height = Math.round(height * ratio);
        }
        const under = still.getContext("2d");
        under.scale(ratio, ratio);
        drawCurves(under, { name, shown: chosen(), width, height, paint });
        drawn = wanted;
      }
      if (name !== "clearance") output.textContent = describe(name, chosen());
      if (!width || !height) return;
      const x = ratio * (edge.left + (width - edge.left - edge.right) * player.shown.time / (player.end || 1));
      drawing.clearRect(0, 0, board.width, board.height);
      drawing.drawImage(still, 0, 0);
      drawing.fillStyle = paint("ink");
      drawing.fillRect(x - 0.5 * ratio, ratio * edge.top, ratio, ratio * (height - edge.top - edge.bottom));
    };
    const seek = event => {
      const box = board.getBoundingClientRect();
      player.play(false);
      player.seek(player.end * (event.clientX - box.left - edge.left) / (box.width - edge.left - edge.right));
    };
    board.addEventListener("pointerdown", event => { board.setPointerCapture(event.pointerId); seek(event); });
    board.addEventListener("pointermove", event => { if (event.buttons) seek(event); });
    return draw;
  });
  joint.addEventListener("change", player.ask);
  return () => plots.forEach(draw => draw());
};
