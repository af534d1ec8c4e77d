// Draws every board of the page: picks the traces and layouts that fit the reader's choices, in the theme's colours.
(() => {
  "use strict";
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const mouse = matchMedia("(hover: hover) and (pointer: fine)").matches;
  const fits = (when, state) => Object.entries(when || {}).every(([key, values]) => values.includes(state[key]));
  const isObject = value => value !== null && typeof value === "object" && !Array.isArray(value);

  const merge = (into, from) => {
    for (const [key, value] of Object.entries(from)) {
      into[key] = isObject(value) ? merge(isObject(into[key]) ? into[key] : {}, value) : value;
    }
    return into;
  };

  // A deep copy with var(--name) replaced by what the page's style says now.
  const themed = (value, style) => {
    if (typeof value === "string") return value.replace(/var\((--[\w-]+)\)/g, (_, name) => style.getPropertyValue(name).trim());
    if (Array.isArray(value)) return value.map(item => themed(item, style));
    if (isObject(value)) return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, themed(item, style)]));
    return value;
  };

  const frame = style => ({
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: style.getPropertyValue("--ink").trim() },
    margin: { l: 8, r: 12, t: 12, b: 8 },
    showlegend: false,
    hovermode: "closest",
    modebar: { bgcolor: "rgba(0,0,0,0)", color: style.getPropertyValue("--muted").trim(), activecolor: style.getPropertyValue("--ink").trim() },
    hoverlabel: { font: { size: 12 } },
    dragmode: mouse ? "zoom" : false, // a finger that drags wants to scroll the page
  });
  const config = { responsive: true, displaylogo: false, scrollZoom: false, displayModeBar: mouse ? "hover" : false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "tableRotation"] };

  const logarithm = matrix => matrix.map(row => row.map(value => (value === null ? null : Math.log10(Math.max(value, 1e-12)))));

  class BoardView {
    constructor(figure) {
      this.figure = figure;
      Object.assign(this, JSON.parse(figure.querySelector("script[type='application/json']").textContent));
      this.drawn = false;
      for (const select of figure.querySelectorAll("[data-control]")) {
        select.addEventListener("change", () => {
          this.state[select.dataset.control] = select.value;
          this.draw();
        });
      }
      const moving = this.plots.find(plot => plot.frames);
      if (moving) this.player = new Player(this, moving);
    }

    draw() {
      this.drawn = true;
      const style = getComputedStyle(document.documentElement);
      for (const plot of this.plots) {
        const data = (plot.traces || []).filter(entry => fits(entry.when, this.state)).map(entry => this.trace(entry, style));
        const layout = merge(frame(style), themed(plot.layout, style));
        for (const entry of plot.layouts || []) if (fits(entry.when, this.state)) merge(layout, themed(entry.layout, style));
        layout.uirevision = plot.layout.scene ? "camera" : JSON.stringify(this.state);
        if (layout.scene) layout.dragmode = "orbit";
        if (layout.height) document.getElementById(plot.id).style.height = `${layout.height}px`;
        Plotly.react(plot.id, data, layout, config);
      }
      for (const item of this.figure.querySelectorAll("[data-when]")) item.hidden = !fits(JSON.parse(item.dataset.when), this.state);
      if (this.player) this.player.reset();
    }

    trace(entry, style) {
      const trace = themed(entry.trace, style);
      for (const variant of entry.variants || []) if (fits(variant.when, this.state)) merge(trace, themed(variant.patch, style));
      if (trace.meta === "log10") trace.z = logarithm(trace.customdata);
      return trace;
    }
  }

  // Moves the trace marked "moves" through the pictures of the chosen law, at half the real speed.
  class Player {
    constructor(board, plot) {
      this.board = board;
      this.plot = plot;
      this.button = board.figure.querySelector("[data-play]");
      this.slider = board.figure.querySelector("[data-frame]");
      this.output = board.figure.querySelector("[data-time]");
      this.timer = null;
      this.button.addEventListener("click", () => (this.timer ? this.pause() : this.play()));
      this.slider.addEventListener("input", () => { this.pause(); this.show(Number(this.slider.value)); });
    }

    get pictures() { return this.plot.frames.find(entry => fits(entry.when, this.board.state)); }

    reset() {
      this.pause();
      this.slider.max = this.pictures.t.length - 1;
      this.show(Math.min(Number(this.slider.value), this.pictures.t.length - 1));
    }

    show(k) {
      const { t, x, y, z } = this.pictures;
      const moving = document.getElementById(this.plot.id).data.findIndex(trace => trace.meta === "moves");
      this.slider.value = k;
      this.output.textContent = `${t[k].toFixed(2)} s`;
      return Plotly.restyle(this.plot.id, { x: [x[k]], y: [y[k]], z: [z[k]] }, [moving]);
    }

    play() {
      const { t } = this.pictures;
      const last = t.length - 1;
      const from = Number(this.slider.value) >= last ? 0 : t[Number(this.slider.value)];
      const begin = performance.now();
      this.button.textContent = "Pause";
      this.button.setAttribute("aria-pressed", "true");
      const step = now => {
        const at = from + (now - begin) / 2000;
        let k = t.findIndex(value => value > at);
        if (k < 0) k = last + 1;
        this.show(Math.max(0, k - 1));
        if (k > last) this.pause();
        else this.timer = requestAnimationFrame(step);
      };
      this.timer = requestAnimationFrame(step);
    }

    pause() {
      if (this.timer) cancelAnimationFrame(this.timer);
      this.timer = null;
      this.button.textContent = "Play";
      this.button.setAttribute("aria-pressed", "false");
    }
  }

  const boards = [...document.querySelectorAll("figure.board")].map(figure => new BoardView(figure));
  // One after another, from the top, so that the page answers in between.
  const next = () => {
    const board = boards.find(candidate => !candidate.drawn);
    if (!board) return;
    board.draw();
    setTimeout(next);
  };
  next();
  addEventListener("beforeprint", () => boards.filter(board => !board.drawn).forEach(board => board.draw()));
  dark.addEventListener("change", () => boards.filter(board => board.drawn).forEach(board => board.draw()));
})();
