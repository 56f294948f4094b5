// Figures that hold their numbers become plots: zoom, pan, values under the cursor, channels and models on and off.
// Drawn when they come near the screen, so that a long page opens at once. In print the drawn figure stands.
(() => {
  const REACH = 400; // px below the screen at which a plot is made
  const LINKS = new Map(); // link -> plots that share their horizontal axis
  const LIGHTER = { "#0072B2": "#56B4E9", "#56B4E9": "#B5DCF5" }; // on a dark page
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colour = name => ({ ink: css("--ink"), quiet: css("--quiet"), measured: css("--measured") })[name] ?? (dark.matches ? LIGHTER[name] : null) ?? name;
  const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const clock = x => typeof x === "string" ? floats(x) : Float64Array.from({ length: x[2] }, (_, i) => x[0] + i * x[1]);

  function number(value) {
    if (value == null || Number.isNaN(value)) return "–";
    const size = Math.abs(value), text = size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(3) : value.toPrecision(4);
    return text.replaceAll("-", "−");
  }
  function tick(value) {
    if (value == null) return "";
    const size = Math.abs(value);
    return (size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(0) : String(+value.toPrecision(6))).replaceAll("-", "−");
  }
  const decade = v => v != null && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6;
  // Places of a logarithmic axis: multiples of decades; round numbers where hardly any of these are in sight. uPlot's own
  // begin at the end of the axis, and a zoomed axis, which begins anywhere, can take it half a minute.
  function logSplits(u, axis, low, high) {
    const out = [], first = Math.floor(Math.log10(low)), last = Math.floor(Math.log10(high));
    const most = last - first > 12 ? 1 : 9;
    for (let e = first; e <= last; e++) for (let m = 1; m <= most; m++) {
      const v = m * 10 ** e;
      if (v >= low && v <= high) out.push(v);
    }
    if (out.length > 2) return out;
    const raw = (high - low) / 4, base = 10 ** Math.floor(Math.log10(raw)), step = base * [1, 2, 5, 10].find(k => k * base >= raw);
    const round = [];
    for (let k = Math.ceil(low / step); k * step <= high && round.length < 12; k++) round.push(k * step);
    return round;
  }
  function named(splits) {
    const decades = splits.filter(decade).length;
    if (splits.length < 6) return splits;
    return splits.map(v => decade(v) || decades < 2 && (decade(v / 2) || decade(v / 5)) ? v : null);
  }
  function element(tag, className, text) {
    const out = document.createElement(tag);
    if (className) out.className = className;
    if (text !== undefined) out.textContent = text;
    return out;
  }
  function button(text, title, act, pressed) {
    const out = element("button", "", text);
    out.type = "button";
    if (title) { out.title = title; out.setAttribute("aria-label", title); }
    if (pressed !== undefined) out.setAttribute("aria-pressed", String(pressed));
    out.addEventListener("click", () => act(out));
    return out;
  }

  // Curves over one clock stay as they are; of several clocks every point has a row of its own, in order.
  function aligned(curves) {
    const own = curves.map(c => c.xs);
    if (own.every(x => x === own[0])) return [own[0], ...curves.map(c => Array.from(c.ys, y => Number.isNaN(y) ? null : y))];
    const rows = [];
    curves.forEach((c, k) => c.xs.forEach((x, i) => rows.push([x, k, c.ys[i]])));
    rows.sort((a, b) => a[0] - b[0]);
    return [rows.map(r => r[0]), ...curves.map((_, k) => rows.map(r => r[1] === k ? (Number.isNaN(r[2]) ? null : r[2]) : undefined))];
  }
  function extent(values, log) {
    let low = Infinity, high = -Infinity;
    for (const v of values) if (v != null && Number.isFinite(v) && (!log || v > 0)) { if (v < low) low = v; if (v > high) high = v; }
    return low > high ? [log ? 0.1 : 0, 1] : [low, high];
  }
  function padded([low, high], log) {
    if (log) return [low / 1.3, high * 1.3];
    const pad = 0.06 * (high - low || Math.abs(high) || 1);
    return [low - pad, high + pad];
  }
  function sign(u, kind, x, y, size) {
    const c = u.ctx, r = size * devicePixelRatio;
    c.beginPath();
    if (kind === "o") c.arc(x, y, r, 0, 7);
    else if (kind === "s") c.rect(x - r, y - r, 2 * r, 2 * r);
    else {
      const corners = { "D": [[0, -1.3], [1.3, 0], [0, 1.3], [-1.3, 0]], "^": [[0, -1.2], [1.2, 1], [-1.2, 1]], "v": [[0, 1.2], [1.2, -1], [-1.2, -1]] }[kind];
      if (corners) { corners.forEach(([a, b], i) => c[i ? "lineTo" : "moveTo"](x + a * r, y + b * r)); c.closePath(); }
      else { c.moveTo(x - 1.4 * r, y); c.lineTo(x + 1.4 * r, y); c.moveTo(x, y - 1.4 * r); c.lineTo(x, y + 1.4 * r); }
    }
    c.stroke();
  }

  class Figure {
    constructor(figure) {
      this.figure = figure;
      this.data = JSON.parse(figure.dataset.explore);
      this.at = 0; this.off = new Set(); this.shut = new Map(); this.residuals = false; this.plots = []; this.range = null;
      this.box = element("div", "explore");
      figure.querySelector("picture").after(this.box);
      this.bar = element("div", "bar"); this.body = element("div", "panels"); this.keys = element("div", "keys");
      this.note = element("p", "hint");
      this.box.append(this.bar, this.keys, this.body, this.note);
      figure.classList.add("explored");
      this.reserve();
    }
    get view() { return this.data.views[this.at]; }
    get open() { return this.view.panels.filter(p => !this.closed(p)); }
    closed(panel) { return this.shut.get(panel.title) ?? Boolean(panel.hidden); }
    height() {
      if (this.view.plane) return Math.min(440, Math.max(260, this.box.clientWidth * 0.7));
      const n = Math.max(1, this.open.length);
      return n === 1 ? 230 : n < 4 ? 150 : 115;
    }
    reserve() { this.body.style.minHeight = `${this.open.length * (this.height() + 26) + 34}px`; }

    start() {
      this.clocks = this.data.x.map(clock);
      this.decoded = new Map();
      this.fill();
      new ResizeObserver(() => this.resize()).observe(this.body);
      dark.addEventListener("change", () => this.fill());
      this.figure.dataset.ready = String(Math.round(performance.now()));
    }
    curves(panel) {
      if (!this.decoded.has(panel)) this.decoded.set(panel, panel.curves.map(c => ({ ...c, xs: this.clocks[c.x], ys: floats(c.y) })));
      const all = this.decoded.get(panel), ref = this.residuals && all.find(c => c.name === this.view.ref);
      if (!ref) return all;
      return all.filter(c => c !== ref && c.xs === ref.xs).map(c => ({ ...c, ys: c.ys.map((y, i) => y - ref.ys[i]) }));
    }
    fill() { this.controls(); this.draw(); }
    controls() {
      const { views } = this.data, at = document.activeElement?.dataset?.control;
      this.bar.replaceChildren(); this.keys.replaceChildren();
      if (views.length > 1) {
        const label = element("label", "", "Show "), choose = element("select");
        views.forEach((v, i) => choose.append(new Option(v.name, i, false, i === this.at)));
        choose.addEventListener("change", () => { this.at = +choose.value; this.range = null; this.fill(); this.bar.querySelector("select")?.focus(); });
        label.append(choose); this.bar.append(label);
      }
      const zoom = element("span", "group");
      zoom.append(button("+", "zoom in", () => this.zoom(0.5)), button("−", "zoom out", () => this.zoom(2)),
        button("◀", "move left", () => this.pan(-0.25)), button("▶", "move right", () => this.pan(0.25)), button("all", "show all", () => this.whole()));
      this.bar.append(zoom);
      if (this.view.ref) this.bar.append(button("residuals", "", () => { this.residuals = !this.residuals; this.fill(); }, this.residuals));
      if (this.figure.querySelector("img")) this.bar.append(button("as drawn", "show the figure as drawn", b => {
        const on = this.figure.classList.toggle("as-drawn");
        b.setAttribute("aria-pressed", String(on));
        if (!on) this.resize();
      }, this.figure.classList.contains("as-drawn")));
      if (this.view.panels.length > 1) {
        const group = element("span", "group channels");
        for (const p of this.view.panels) group.append(button(p.title, "", () => { this.shut.set(p.title, !this.closed(p)); this.fill(); }, !this.closed(p)));
        this.keys.append(group);
      }
      const named = new Map(this.view.panels.flatMap(p => p.curves).map(c => [c.name, c]));
      const group = element("span", "group");
      for (const [name, c] of named) {
        const b = button("", "", () => { this.off.has(name) ? this.off.delete(name) : this.off.add(name); this.fill(); }, !this.off.has(name));
        b.append(this.sample(c), name); group.append(b);
      }
      this.keys.append(group);
      [...this.box.querySelectorAll("button")].forEach((b, i) => { b.dataset.control = b.textContent + i; });
      if (at) [...this.box.querySelectorAll("button")].find(b => b.dataset.control === at)?.focus();
    }
    sample(c) {
      const canvas = element("canvas", "sample"), k = devicePixelRatio || 1;
      canvas.width = 26 * k; canvas.height = 10 * k;
      const ctx = canvas.getContext("2d");
      ctx.strokeStyle = colour(c.colour); ctx.lineWidth = 2 * k;
      if (c.marker) { ctx.lineWidth = 1.5 * k; sign({ ctx }, c.marker, 13 * k, 5 * k, 3.2); return canvas; }
      ctx.setLineDash((c.dash ?? []).map(d => d * 1.3 * k));
      ctx.beginPath(); ctx.moveTo(0, 5 * k); ctx.lineTo(26 * k, 5 * k); ctx.stroke();
      return canvas;
    }
    draw() {
      for (const u of this.plots) u.destroy();
      LINKS.get(this.link)?.delete(this);
      this.link = this.view.link ?? "";
      if (this.link) LINKS.set(this.link, (LINKS.get(this.link) ?? new Set()).add(this));
      this.plots = []; this.body.replaceChildren(); this.reserve();
      const open = this.open;
      open.forEach((panel, i) => this.panel(panel, i === open.length - 1));
      if (!open.length) this.body.append(element("p", "hint", "Every channel is switched off."));
      const others = this.link ? [...LINKS.get(this.link)].filter(other => other !== this && other.plots.length) : [];
      if (others.length) this.join(others[0].range);
      else if (this.range && this.plots.length) this.move(...this.range, false);
      const stretch = Math.max(0, ...this.view.panels.map(p => p.stretch ?? 0));
      this.note.textContent = "Drag to zoom, Shift and drag to move, double click for all; by keys: + − ← → and 0." +
        (stretch ? ` Drawn: lowest and highest of every ${stretch} samples.` : "");
    }
    panel(panel, last) {
      const head = element("div", "head"), out = element("output"), holder = element("div", "plot");
      head.append(element("strong", "", panel.title + (this.residuals ? ", model less measurement" : "")), out);
      holder.tabIndex = 0; holder.setAttribute("role", "group");
      holder.setAttribute("aria-label", `${panel.title} over ${panel.x}: plus and minus zoom, left and right move the cursor, with Shift the plot, 0 shows all`);
      this.body.append(head, holder);
      const curves = this.curves(panel).filter(c => !this.off.has(c.name));
      const data = curves.length ? aligned(curves) : [[0, 1]];
      const full = extent(data[0], panel.logX), plane = Boolean(this.view.plane);
      if (plane) { const [a, b] = padded(full, false); full[0] = a; full[1] = b; }
      else if (full[0] === full[1]) { full[0] -= 0.5; full[1] += 0.5; }
      const limits = this.residuals ? null : panel.limits, ink = css("--ink"), line = css("--line"), font = "12px system-ui, sans-serif";
      const yRange = (u, low, high) => {
        if (plane) return u.own ?? limits ?? padded(extent(data.slice(1).flat(), false), false);
        if (low == null) return limits ?? (panel.logY ? [0.1, 1] : [0, 1]);
        let [a, b] = padded([low, high], panel.logY);
        if (limits) { a = Math.max(a, limits[0]); b = Math.min(b, limits[1]); if (!(a < b)) [a, b] = limits; }
        return [a, b];
      };
      const filter = (u, splits) => named(splits);
      const axis = log => ({ stroke: ink, font, grid: { stroke: line, width: 1, ...(log ? { filter } : {}) }, ticks: { stroke: line, width: 1, size: 5 }, ...(log ? { splits: logSplits, filter } : {}) });
      const values = (u, splits) => splits.map(tick);
      const u = new uPlot({
        width: Math.max(200, this.body.clientWidth), height: this.height() + (last ? 34 : 0),
        padding: [8, 14, 0, 0], legend: { show: false },
        scales: { x: { time: false, distr: panel.logX ? 3 : 1, range: (u, a, b) => a == null || plane && !u.own ? full : [a, b] }, y: { distr: panel.logY ? 3 : 1, range: yRange } },
        axes: [
          { ...axis(panel.logX), values, size: last ? 24 : 6, ...(last ? { label: panel.x, labelSize: 20, labelFont: font, labelGap: 0 } : { values: () => [] }) },
          { ...axis(panel.logY), values, size: 62, gap: 3 },
        ],
        cursor: {
          y: plane, points: { size: 6 }, drag: { x: true, y: plane, setScale: !plane },
          dataIdx: (u, s, i) => this.nearest(u, s, i, plane),
          bind: { dblclick: () => () => this.whole(), mousedown: (u, t, handler) => e => e.shiftKey ? this.drag(u, e) : handler(e) },
        },
        series: [{}, ...curves.map(c => ({
          label: c.name, stroke: colour(c.colour), width: c.marker ? 1.5 : c.width, dash: (c.dash ?? []).map(d => d * c.width), spanGaps: false,
          points: { show: false }, ...(c.marker ? { paths: () => null } : {}),
        }))],
        hooks: {
          setScale: [(u, key) => { if (key === "x" && !this.moving) this.follow(u, plane); }],
          setCursor: [u => this.point(u, out, curves, panel)],
          setSelect: plane ? [u => this.box2d(u)] : [],
          drawClear: [u => this.under(u, panel)],
          draw: [u => this.over(u, panel, curves, data)],
        },
      }, data, holder);
      u.full = full; u.panel = panel;
      this.plots.push(u);
      holder.addEventListener("keydown", e => this.key(e, u));
      holder.addEventListener("wheel", e => { if (e.ctrlKey) { e.preventDefault(); this.zoom(e.deltaY > 0 ? 1.25 : 0.8); } }, { passive: false });
    }
    nearest(u, s, i, plane) {
      const xs = u.data[0], ys = u.data[s];
      if (plane) {
        let best = null, least = 30 ** 2;
        for (let k = 0; k < xs.length; k++) if (ys[k] != null) {
          const d = (u.valToPos(xs[k], "x") - u.cursor.left) ** 2 + (u.valToPos(ys[k], "y") - u.cursor.top) ** 2;
          if (d < least) { least = d; best = k; }
        }
        return best;
      }
      if (i == null || ys[i] !== undefined) return i;
      for (let d = 1; d < xs.length; d++) {
        if (ys[i - d] !== undefined && i - d >= 0) return i - d;
        if (ys[i + d] !== undefined && i + d < xs.length) return i + d;
      }
      return i;
    }
    point(u, out, curves, panel) {
      const { idx, idxs, left } = u.cursor;
      if (left < 0 || (idx == null && !this.view.plane)) { out.textContent = ""; return; }
      if (this.view.plane) {
        out.textContent = curves.map((c, k) => idxs[k + 1] == null ? "" : `${c.name}: ${number(u.data[0][idxs[k + 1]])}, ${number(u.data[k + 1][idxs[k + 1]])}`).filter(Boolean).join("; ");
        return;
      }
      out.textContent = `${panel.x.split(",")[0]} ${number(u.data[0][idx])}${curves.length ? ": " : ""}` +
        curves.map((c, k) => `${c.name} ${number(u.data[k + 1][idxs[k + 1]])}`).join("; ");
      if (this.pointing) return;
      this.pointing = true;
      const x = u.posToVal(left, "x");
      this.tell("cursor", x);
      for (const other of this.plots) if (other !== u) other.setCursor({ left: other.valToPos(x, "x"), top: 0 });
      this.pointing = false;
    }
    under(u, panel) {
      const c = u.ctx, { left, top, width, height } = u.bbox;
      c.save(); c.beginPath(); c.rect(left, top, width, height); c.clip();
      for (const band of panel.bands ?? []) {
        const [a, b] = band.map(x => u.valToPos(x, "x", true));
        c.fillStyle = css("--soft"); c.fillRect(a, top, b - a, height);
      }
      if (this.view.plane) {
        c.strokeStyle = css("--quiet"); c.lineWidth = 1;
        for (const [x, y] of [[u.valToPos(0, "x", true), null], [null, u.valToPos(0, "y", true)]]) {
          c.beginPath(); c.moveTo(x ?? left, y ?? top); c.lineTo(x ?? left + width, y ?? top + height); c.stroke();
        }
      }
      c.restore();
    }
    over(u, panel, curves, data) {
      const c = u.ctx, k = devicePixelRatio, { left, top, width, height } = u.bbox;
      c.save(); c.beginPath(); c.rect(left, top, width, height); c.clip();
      c.font = `${11 * k}px system-ui, sans-serif`; c.textBaseline = "top"; c.textAlign = "left";
      let free = -Infinity;
      for (const [x, name] of [...(panel.marks ?? [])].sort((a, b) => a[0] - b[0])) {
        const at = u.valToPos(x, "x", true);
        c.strokeStyle = c.fillStyle = css("--quiet"); c.lineWidth = k; c.setLineDash([2 * k, 3 * k]);
        c.beginPath(); c.moveTo(at, top); c.lineTo(at, top + height); c.stroke(); c.setLineDash([]);
        if (name && at > free && at >= left && at <= left + width) {
          c.save(); c.translate(at + 2 * k, top + height - (name.length > 2 ? 3 : 14) * k); if (name.length > 2) c.rotate(-Math.PI / 2); c.fillText(name, 0, 0); c.restore();
          free = at + 14 * k;
        }
      }
      curves.forEach((curve, s) => {
        if (!curve.marker) return;
        c.strokeStyle = colour(curve.colour); c.lineWidth = 1.5 * k; c.setLineDash([]);
        data[0].forEach((x, i) => { if (data[s + 1][i] != null) sign(u, curve.marker, u.valToPos(x, "x", true), u.valToPos(data[s + 1][i], "y", true), curve.marker === "+" ? 5 : 4); });
      });
      c.restore();
    }
    follow(u, plane) {
      const { min, max } = u.scales.x;
      if (min == null) return;
      const all = min <= u.full[0] && max >= u.full[1];
      if (plane) return;
      this.range = all ? null : [min, max];
      this.move(min, max, true, u);
    }
    tell(what, detail) { this.figure.dispatchEvent(new CustomEvent(what, { detail })); }
    cursorAt(x) { // as if the pointer stood there
      const u = this.plots[0];
      if (u) u.setCursor({ left: Math.max(0, Math.min(u.over.clientWidth - 1, u.valToPos(x, "x"))), top: 0 });
    }
    show(low, high) {
      this.range = [low, high]; // what is drawn later is drawn so
      this.change(() => [low, high]);
    }
    move(min, max, tell, from) {
      this.moving = true;
      for (const u of this.plots) if (u !== from) u.setScale("x", { min, max });
      this.moving = false;
      this.tell("range", [min, max]);
      if (tell && this.link) for (const other of LINKS.get(this.link)) if (other !== this) other.join(this.range);
    }
    join(range) { // take the range of a linked figure, as far as there is anything in it to show
      const full = this.plots[0]?.full;
      if (!full || range && (range[0] >= full[1] || range[1] <= full[0])) return;
      this.range = range && [...range];
      this.move(...(range ?? full), false);
    }
    limited(u, min, max) {
      const [a, b] = u.full;
      if (this.view.plane) return [min, max];
      if (max - min >= b - a) return [a, b];
      if (min < a) return [a, a + max - min];
      return max > b ? [b - (max - min), b] : [min, max];
    }
    change(f) {
      const u = this.plots[0];
      if (!u) return;
      const log = u.panel.logX, to = log ? Math.log : x => x, from = log ? Math.exp : x => x;
      const fullest = u.full; u.full = fullest.map(to);
      const next = this.limited(u, ...f(to(u.scales.x.min), to(u.scales.x.max))).map(from);
      u.full = fullest;
      this.range = next;
      this.move(...next, true);
    }
    zoom(times) {
      const u = this.plots[0];
      if (!u) return;
      if (this.view.plane) {
        const { min, max } = u.scales.y, half = 0.5 * times * (max - min), middle = 0.5 * (max + min);
        u.own = [middle - half, middle + half]; u.setScale("y", { min: u.own[0], max: u.own[1] });
      }
      this.change((a, b) => { const m = 0.5 * (a + b), h = 0.5 * times * (b - a); return [m - h, m + h]; });
    }
    pan(share) { this.change((a, b) => [a + share * (b - a), b + share * (b - a)]); }
    whole() {
      this.range = null;
      for (const u of this.plots) { u.own = null; if (this.view.plane) u.setScale("y", { min: null, max: null }); }
      const u = this.plots[0];
      if (u) this.move(...u.full, true);
      this.range = null;
    }
    box2d(u) {
      const { left, top, width, height } = u.select;
      if (width < 4 || height < 4) return;
      const x = [left, left + width].map(v => u.posToVal(v, "x")), y = [top + height, top].map(v => u.posToVal(v, "y"));
      u.own = y; u.setScale("x", { min: x[0], max: x[1] }); u.setScale("y", { min: y[0], max: y[1] });
      u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    }
    drag(u, e) {
      e.preventDefault();
      let last = e.clientX;
      const go = m => { const share = (last - m.clientX) / u.over.clientWidth; last = m.clientX; if (share) this.pan(share); };
      addEventListener("mousemove", go);
      addEventListener("mouseup", () => removeEventListener("mousemove", go), { once: true });
    }
    key(e, u) {
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      const way = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
      if (way && e.shiftKey) this.pan(0.25 * way);
      else if (way) {
        const wide = u.over.clientWidth, at = u.cursor.left < 0 ? 0.5 * wide : u.cursor.left;
        u.setCursor({ left: Math.min(wide - 1, Math.max(0, at + 0.01 * way * wide)), top: 0.5 * u.over.clientHeight });
      } else if (this.view.plane && (e.key === "ArrowUp" || e.key === "ArrowDown")) {
        const tall = u.over.clientHeight, y = u.cursor.left < 0 ? 0.5 * tall : u.cursor.top;
        u.setCursor({ left: Math.max(0, u.cursor.left), top: Math.min(tall - 1, Math.max(0, y + (e.key === "ArrowUp" ? -0.02 : 0.02) * tall)) });
      } else if (e.key === "+" || e.key === "=") this.zoom(0.5);
      else if (e.key === "-" || e.key === "−") this.zoom(2);
      else if (e.key === "0" || e.key === "Home") this.whole();
      else return;
      e.preventDefault();
    }
    update(data) { // other numbers of the same panels, as while an input is dragged: nothing is built anew
      const named = view => JSON.stringify(view.panels.map(p => [p.title, p.curves.map(c => c.name)])), before = named(this.view);
      this.data = data; this.decoded?.clear();
      if (!this.clocks) return; // it is drawn when it comes near
      this.clocks = data.x.map(clock);
      if (named(this.view) !== before) { this.fill(); return; }
      this.open.forEach((panel, i) => {
        const u = this.plots[i], curves = this.curves(panel).filter(c => !this.off.has(c.name));
        const next = curves.length ? aligned(curves) : [[0, 1]];
        u.full = extent(next[0], panel.logX); u.setData(next);
      });
      if (this.range) this.move(...this.range, false);
    }
    resize() {
      const width = this.body.clientWidth;
      if (width > 0) this.plots.forEach((u, i) => { if (u.width !== width) u.setSize({ width, height: this.height() + (i === this.plots.length - 1 ? 34 : 0) }); });
    }
  }

  const near = new IntersectionObserver(seen => {
    for (const s of seen) if (s.isIntersecting) { near.unobserve(s.target); s.target.explorer.start(); }
  }, { rootMargin: `${REACH}px` });
  window.explore = figure => {
    figure.explorer = new Figure(figure);
    near.observe(figure);
    return figure.explorer;
  };
  document.querySelectorAll("figure[data-explore]").forEach(window.explore);
})();
