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
  // At once, for a page that is printed before all is drawn: RFC 1951 inside gzip without a name (RFC 1952).
  const inflateNow = text => {
    const from = bytesOf(text.trim()), out = new Uint8Array(new DataView(from.buffer).getUint32(from.length - 4, true));
    let next = 10, held = 0, count = 0, end = 0;
    const bits = n => {
      while (count < n) { held |= from[next++] << count; count += 8; }
      const found = held & ((1 << n) - 1);
      held >>>= n; count -= n;
      return found;
    };
    const codesOf = lengths => { // of each length the number of codes, and the symbols in the order of their codes
      const counts = new Uint16Array(16), places = new Uint16Array(17), symbols = new Uint16Array(lengths.length);
      for (const length of lengths) if (length) counts[length]++;
      for (let k = 1; k < 16; k++) places[k + 1] = places[k] + counts[k];
      lengths.forEach((length, symbol) => { if (length) symbols[places[length]++] = symbol; });
      return { counts, symbols };
    };
    const read = ({ counts, symbols }) => {
      for (let length = 1, code = 0, first = 0, index = 0; ; length++) {
        code |= bits(1);
        const here = counts[length];
        if (code - first < here) return symbols[index + code - first];
        index += here; first = (first + here) << 1; code <<= 1;
      }
    };
    const series = (begin, groups, step) => { // bases and numbers of extra bits of lengths and distances
      const found = [];
      for (let k = 0, base = begin; k < groups; k++) { const extra = k < 2 * step ? 0 : Math.floor(k / step) - 1; found.push([base, extra]); base += 1 << extra; }
      return found;
    };
    const sizes = [...series(3, 28, 4), [258, 0]], distances = series(1, 30, 2);
    const fixed = [codesOf([...Array(144).fill(8), ...Array(112).fill(9), ...Array(24).fill(7), ...Array(8).fill(8)]), codesOf(Array(30).fill(5))];
    const dynamic = () => {
      const many = bits(5) + 257, far = bits(5) + 1, few = bits(4) + 4, small = Array(19).fill(0), lengths = [];
      for (let k = 0; k < few; k++) small[[16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15][k]] = bits(3);
      const codes = codesOf(small);
      while (lengths.length < many + far) {
        const symbol = read(codes);
        if (symbol < 16) lengths.push(symbol);
        else if (symbol === 16) lengths.push(...Array(3 + bits(2)).fill(lengths.at(-1)));
        else lengths.push(...Array(symbol === 17 ? 3 + bits(3) : 11 + bits(7)).fill(0));
      }
      return [codesOf(lengths.slice(0, many)), codesOf(lengths.slice(many))];
    };
    for (let last = 0; !last;) {
      last = bits(1);
      const kind = bits(2);
      if (kind === 0) {
        held = count = 0;
        const size = from[next] | from[next + 1] << 8;
        out.set(from.subarray(next + 4, next + 4 + size), end);
        next += 4 + size; end += size;
        continue;
      }
      const [literals, backward] = kind === 1 ? fixed : dynamic();
      for (let symbol = read(literals); symbol !== 256; symbol = read(literals)) {
        if (symbol < 256) { out[end++] = symbol; continue; }
        const [size, more] = sizes[symbol - 257], length = size + bits(more), [distance, rest] = distances[read(backward)], back = distance + bits(rest);
        for (let k = 0; k < length; k++, end++) out[end] = out[end - back];
      }
    }
    return out;
  };
  const inflate = text => new Response(new Blob([bytesOf(text.trim())]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();

  const unpack = async text => JSON.parse(new TextDecoder().decode(await inflate(text)));
  const look = JSON.parse(document.getElementById("look").textContent);

  const runScript = content => {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(content);
    document.head.append(script);
  };
  const library = inflate(document.getElementById("plotly").textContent).then(content => { if (!window.Plotly) runScript(content); });

  // ---------------------------------------------------------------- boards

  const merge = (into, from) => {
    for (const [key, value] of Object.entries(from)) {
      into[key] = isObject(value) ? merge(isObject(into[key]) ? into[key] : {}, value) : value;
    }
    return into;
  };

  // A deep copy with the light theme's colours replaced by those of the theme that the page has now.
  const themed = (value, style) => {
    if (typeof value === "string") return Object.hasOwn(look.variables, value) ? style.getPropertyValue(look.variables[value]).trim() : value;
    if (Array.isArray(value)) return typeof value[0] === "number" && typeof value.at(-1) === "number" ? value.slice() : value.map(item => themed(item, style));
    if (isObject(value)) return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, themed(item, style)]));
    return value;
  };

  const frame = style => ({
    template: themed(look.template, style),
    font: { family: getComputedStyle(document.body).fontFamily },
    showlegend: false, // the board has one for all its figures
    dragmode: mouse ? "zoom" : false, // a finger that drags wants to scroll the page
  });
  // Buttons are named one by one: a new one of the library that talks to a server does not come by itself.
  const config = layout => ({ responsive: true, displaylogo: false, scrollZoom: false, displayModeBar: mouse ? "hover" : false,
    showSendToCloud: false, plotlyServerURL: "", toImageButtonOptions: { format: "svg" },
    modeBarButtons: [layout.scene ? ["orbitRotation", "zoom3d", "resetCameraDefault3d", "toImage"] : ["zoom2d", "pan2d", "resetScale2d", "toImage"]] });

  const logarithm = matrix => matrix.map(row => row.map(value => (value === null ? null : Math.log10(Math.max(value, 1e-12)))));

  // The library follows the window; a plot's place also changes where a scroll bar appears or its column gets narrower.
  const fitted = new ResizeObserver(entries => {
    if (printing()) return;
    for (const { target } of entries) if (target.clientWidth && target._fullLayout && Math.abs(target._fullLayout.width - target.clientWidth) > 1) Plotly.Plots.resize(target);
  });

  // ---------------------------------------------------------------- legends

  const STROKES = { dash: "7 4", dot: "2 3", dashdot: "7 3 2 3" };
  const MARKS = { square: "■", diamond: "◆", "triangle-up": "▲", cross: "✚", star: "★", x: "✖", "x-thin": "×", pentagon: "⬟" };
  const plain = text => new DOMParser().parseFromString(text, "text/html").body.textContent; // names are escaped for Plotly

  const drawn = (name, attributes, text = "") => {
    const found = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) if (value !== undefined) found.setAttribute(key, value);
    found.textContent = text;
    return found;
  };

  // The first line, marker and area of every name among the traces and shapes that are shown.
  const entriesOf = figures => {
    const entries = new Map();
    const keep = (name, parts) => entries.set(name, { ...parts, ...entries.get(name) });
    for (const { data, layout } of figures) {
      for (const { name, showlegend, type, mode = "", line = {}, marker = {}, fill, fillcolor, colorscale } of data) {
        if (!name || showlegend === false) continue;
        const color = line.color || marker.color, ring = marker.line || {};
        if (type === "heatmap" || type === "bar" || fill) keep(name, { area: fillcolor || marker.color || colorscale[0][1] });
        if (mode.includes("lines") && !fill) keep(name, { line: { stroke: color, "stroke-dasharray": STROKES[line.dash] } });
        if (mode.includes("markers")) keep(name, { marker: { symbol: marker.symbol || "circle", color: marker.color || ring.color || color, ring } });
      }
      for (const { name, showlegend, type, fillcolor, line } of layout.shapes || []) {
        if (showlegend) keep(name, type === "rect" ? { area: fillcolor } : { line: { stroke: line.color, "stroke-dasharray": STROKES[line.dash] } });
      }
    }
    return entries;
  };

  const swatch = ({ area, line, marker }) => {
    const found = drawn("svg", { class: line ? "key line" : "key", viewBox: line ? "0 0 30 12" : "8 0 14 12", "aria-hidden": "true" });
    if (area) found.append(drawn("rect", { x: 8, y: 0.5, width: 14, height: 11, fill: area, stroke: "currentColor", "stroke-width": 0.3 }));
    if (line) found.append(drawn("line", { x1: 0, x2: 30, y1: 6, y2: 6, "stroke-width": 2.5, ...line }));
    if (marker) {
      const { symbol, color, ring } = marker, open = symbol.endsWith("-open");
      if (MARKS[symbol]) found.append(drawn("text", { x: 15, y: 10, "text-anchor": "middle", fill: color }, MARKS[symbol]));
      else found.append(drawn("circle", { cx: 15, cy: 6, r: 4, fill: open ? "none" : color, stroke: open ? color : ring.color, "stroke-width": 1.6 }));
    }
    return found;
  };

  class BoardView {
    constructor(board) {
      this.board = board;
      this.state = JSON.parse(board.dataset.state);
      this.figures = null;
      for (const select of board.querySelectorAll("[data-control]")) {
        select.addEventListener("change", () => {
          this.state[select.dataset.control] = select.value;
          this.tell();
          this.ready().then(() => this.draw());
        });
      }
      this.tell();
    }

    get drawn() { return this.figures !== null; }

    // Its data and the library, fetched from the page once; then it is drawn.
    ready() {
      this.coming ||= Promise.all([unpack(this.board.querySelector("script").textContent), library]).then(([figures]) => {
        if (this.drawn) return;
        this.figures = figures;
        this.draw();
      });
      return this.coming;
    }

    // The same without a pause, for print.
    now() {
      this.figures ||= JSON.parse(new TextDecoder().decode(inflateNow(this.board.querySelector("script").textContent)));
      this.draw();
    }

    // The choices, in words: for print, where no control is.
    tell() {
      for (const item of this.board.querySelectorAll("[data-when]")) item.hidden = !fits(JSON.parse(item.dataset.when), this.state);
      const said = [...this.board.querySelectorAll("[data-control]")].filter(select => !select.closest("[hidden]"))
        .map(select => `${select.previousElementSibling.textContent}: ${select.selectedOptions[0].textContent}`);
      const place = this.board.querySelector(".chosen");
      if (place) place.textContent = said.join("; ");
    }

    draw() {
      const style = getComputedStyle(document.documentElement);
      const shown = this.figures.map(figure => this.at(figure, style));
      for (const { data, layout } of shown) {
        const place = document.getElementById(layout.meta.id);
        if (layout.height) place.style.height = `${layout.height}px`;
        if (printing()) Object.assign(layout, { width: place.clientWidth, height: place.clientHeight }); // paper is not resized
        Plotly.react(place, data, layout, config(layout));
        fitted.observe(place);
      }
      this.board.querySelector(".legend").replaceChildren(...[...entriesOf(shown)].map(([name, parts]) => {
        const item = document.createElement("li");
        item.append(swatch(parts), plain(name));
        return item;
      }));
    }

    // A figure at the reader's choices.
    at(figure, style) {
      const data = figure.data.filter(({ meta }) => fits(meta?.when, this.state)).map(trace => {
        const found = themed(trace, style), { at, look, log10 } = trace.meta || {};
        if (look && fits(at, this.state)) merge(found, themed(look, style));
        if (log10) found.z = logarithm(found.customdata);
        return found;
      });
      const layout = merge(frame(style), themed(figure.layout, style));
      for (const variant of figure.layout.meta.variants || []) if (fits(variant.when, this.state)) merge(layout, themed(variant.layout, style));
      layout.uirevision = layout.scene ? "camera" : JSON.stringify(this.state);
      if (layout.scene) layout.dragmode = "orbit";
      return { data, layout };
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
  const arm = document.getElementById("arm");
  let armDrawn = false;
  const drawArm = ([text, data]) => {
    if (armDrawn) return;
    armDrawn = true;
    const script = document.createElement("script");
    script.textContent = text;
    document.head.append(script);
    optikArm(arm, JSON.parse(data));
  };
  // One after another, from the top, so that the page answers in between.
  const drawAll = async () => {
    for (const board of boards) {
      await board.ready().catch(error => console.error(board.board.id, error)); // the others are drawn all the same
      if (board === boards[0]) performance.mark("first plot");
      await new Promise(resolve => setTimeout(resolve));
    }
    if (arm) drawArm(await unpack(arm.querySelector("script").textContent));
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
    if (boards.length && !window.Plotly) runScript(inflateNow(document.getElementById("plotly").textContent));
    boards.forEach(board => board.now());
    if (arm && !armDrawn) drawArm(JSON.parse(new TextDecoder().decode(inflateNow(arm.querySelector("script").textContent))));
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    unfolded.forEach(details => (details.open = false));
    redraw();
  });
  dark.addEventListener("change", redraw);
})();
