// Draws every board of the page: picks the traces and layouts that fit the reader's choices, in the theme's colours.
(() => {
  "use strict";
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const printing = () => document.documentElement.classList.contains("printing");
  const mouse = matchMedia("(hover: hover) and (pointer: fine)").matches;
  const fits = (when, state) => Object.entries(when || {}).every(([key, values]) => values.includes(state[key]));
  const isObject = value => value !== null && typeof value === "object" && !Array.isArray(value) && !ArrayBuffer.isView(value);

  // ---------------------------------------------------------------- what the page holds compressed

  const bytesOf = text => {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const letters = atob(text), bytes = new Uint8Array(letters.length);
    for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
    return bytes;
  };
  const inflate = text => new Response(new Blob([bytesOf(text.trim())]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();

  // Data as the report has packed it: JSON, then the floats that it refers to, NaN for what is not there.
  const unpack = async text => {
    const content = await inflate(text);
    const length = new DataView(content).getUint32(0, true);
    const floats = new Float32Array(content, 4 + length);
    return JSON.parse(new TextDecoder().decode(new Uint8Array(content, 4, length)), (_, value) => {
      if (!isObject(value) || !value.f32) return value;
      const [first, rows, columns] = value.f32;
      if (columns === undefined) return floats.subarray(first, first + rows);
      const row = k => Array.from(floats.subarray(first + k * columns, first + (k + 1) * columns), v => (Number.isNaN(v) ? null : v));
      return Array.from({ length: rows }, (_, k) => row(k));
    });
  };

  const library = inflate(document.getElementById("plotly").textContent).then(content => {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(content);
    document.head.append(script);
  });

  // ---------------------------------------------------------------- boards

  const merge = (into, from) => {
    for (const [key, value] of Object.entries(from)) {
      into[key] = isObject(value) ? merge(isObject(into[key]) ? into[key] : {}, value) : value;
    }
    return into;
  };

  // A deep copy with var(--name) replaced by what the page's style says now.
  const themed = (value, style) => {
    if (typeof value === "string") return value.replace(/var\((--[\w-]+)\)/g, (_, name) => style.getPropertyValue(name).trim());
    if (Array.isArray(value)) return typeof value[0] === "number" && typeof value.at(-1) === "number" ? value.slice() : value.map(item => themed(item, style));
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
  // Buttons are named one by one: a new one of the library that talks to a server does not come by itself.
  const config = plot => ({ responsive: true, displaylogo: false, scrollZoom: false, displayModeBar: mouse ? "hover" : false,
    showSendToCloud: false, plotlyServerURL: "",
    modeBarButtons: [plot.layout.scene ? ["orbitRotation", "zoom3d", "resetCameraDefault3d", "toImage"] : ["zoom2d", "pan2d", "resetScale2d", "toImage"]] });

  const logarithm = matrix => matrix.map(row => row.map(value => (value === null ? null : Math.log10(Math.max(value, 1e-12)))));

  // The library follows the window; a plot's place also changes where a scroll bar appears or its column gets narrower.
  const fitted = new ResizeObserver(entries => {
    if (printing()) return;
    for (const { target } of entries) if (target.clientWidth && target._fullLayout && Math.abs(target._fullLayout.width - target.clientWidth) > 1) Plotly.Plots.resize(target);
  });

  class BoardView {
    constructor(figure) {
      this.figure = figure;
      this.state = JSON.parse(figure.dataset.state);
      this.plots = null;
      for (const select of figure.querySelectorAll("[data-control]")) {
        select.addEventListener("change", () => {
          this.state[select.dataset.control] = select.value;
          this.tell();
          this.ready().then(() => this.draw());
        });
      }
      this.tell();
    }

    get drawn() { return this.plots !== null; }

    // Its data and the library, fetched from the page once; then it is drawn.
    ready() {
      this.coming ||= Promise.all([unpack(this.figure.querySelector("script").textContent), library]).then(([plots]) => {
        this.plots = plots;
        this.draw();
      });
      return this.coming;
    }

    // The choices, in words: for print, where no control is.
    tell() {
      for (const item of this.figure.querySelectorAll("[data-when]")) item.hidden = !fits(JSON.parse(item.dataset.when), this.state);
      const said = [...this.figure.querySelectorAll("[data-control]")].filter(select => !select.closest("[hidden]"))
        .map(select => `${select.previousElementSibling.textContent}: ${select.selectedOptions[0].textContent}`);
      const place = this.figure.querySelector(".chosen");
      if (place) place.textContent = said.join("; ");
    }

    draw() {
      const style = getComputedStyle(document.documentElement);
      for (const plot of this.plots) {
        const data = (plot.traces || []).filter(entry => fits(entry.when, this.state)).map(entry => this.trace(entry, style));
        const layout = merge(frame(style), themed(plot.layout, style));
        for (const entry of plot.layouts || []) if (fits(entry.when, this.state)) merge(layout, themed(entry.layout, style));
        layout.uirevision = plot.layout.scene ? "camera" : JSON.stringify(this.state);
        if (layout.scene) layout.dragmode = "orbit";
        const place = document.getElementById(plot.id);
        if (layout.height) place.style.height = `${layout.height}px`;
        if (printing()) Object.assign(layout, { width: place.clientWidth, height: place.clientHeight }); // paper is not resized
        Plotly.react(plot.id, data, layout, config(plot));
        fitted.observe(place);
      }
    }

    trace(entry, style) {
      const trace = themed(entry.trace, style);
      for (const variant of entry.variants || []) if (fits(variant.when, this.state)) merge(trace, themed(variant.patch, style));
      if (trace.meta === "log10") trace.z = logarithm(trace.customdata);
      return trace;
    }
  }

  // ---------------------------------------------------------------- tables

  const numberOf = cell => (cell && cell.dataset.value !== undefined ? Number(cell.dataset.value) : NaN);
  const wordsOf = cell => (cell ? cell.textContent.trim() : "");

  // By number where both cells have one, else by words; what is not there stays at the end.
  const compare = (a, b, sign) => {
    const x = numberOf(a), y = numberOf(b);
    if (Number.isNaN(x) !== Number.isNaN(y)) return Number.isNaN(x) ? 1 : -1;
    return sign * (Number.isNaN(x) ? wordsOf(a).localeCompare(wordsOf(b)) : x - y);
  };

  for (const button of document.querySelectorAll("button[data-sort]")) {
    button.addEventListener("click", () => {
      const head = button.closest("th"), body = head.closest("table").tBodies[0], column = Number(button.dataset.sort);
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      for (const other of head.closest("thead").querySelectorAll("[aria-sort]")) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      body.append(...[...body.rows].sort((a, b) => compare(a.cells[column], b.cells[column], sign)));
    });
  }

  // A shadow where a table goes on beyond its edge.
  const edges = box => {
    box.classList.toggle("right", box.scrollLeft + box.clientWidth < box.scrollWidth - 2);
    box.classList.toggle("left", box.scrollLeft > 2);
  };
  const watch = new ResizeObserver(entries => requestAnimationFrame(() => entries.forEach(entry => edges(entry.target.closest(".scroll")))));
  for (const box of document.querySelectorAll(".scroll")) {
    box.addEventListener("scroll", () => edges(box), { passive: true });
    watch.observe(box);
    if (box.firstElementChild) watch.observe(box.firstElementChild);
  }

  // ---------------------------------------------------------------- the page

  const boards = [...document.querySelectorAll("figure.board")].map(figure => new BoardView(figure));
  // The arm that plays motions: its script and its data.
  const drawArm = async place => {
    const [text, data] = JSON.parse(new TextDecoder().decode(await inflate(place.querySelector("script").textContent)));
    const script = document.createElement("script");
    script.textContent = text;
    document.head.append(script);
    optikArm(place, JSON.parse(data));
  };
  // One after another, from the top, so that the page answers in between.
  const drawAll = async () => {
    for (const board of boards) {
      await board.ready();
      if (board === boards[0]) performance.mark("first plot");
      await new Promise(resolve => setTimeout(resolve));
    }
    const arm = document.getElementById("arm");
    if (arm) await drawArm(arm);
    performance.mark("all plots");
  };
  drawAll();

  // Printed: in light colours, with everything unfolded, as wide as the paper.
  const redraw = () => boards.filter(board => board.drawn).forEach(board => board.draw());
  let unfolded = [];
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    unfolded = [...document.querySelectorAll("details:not([open])")];
    unfolded.forEach(details => (details.open = true));
    redraw();
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    unfolded.forEach(details => (details.open = false));
    redraw();
  });
  dark.addEventListener("change", redraw);
})();
