"use strict";
(() => {
  const data = JSON.parse(document.getElementById("models").textContent);
  const $ = (id) => document.getElementById(id);
  const DEG = Math.PI / 180, START = 1;
  const FAMILIES = [
    ["doublet", "doublet"], ["211", "2-1-1"], ["3211", "3-2-1-1"], ["123", "1-2-3"], ["pulse", "pulse"], ["step", "step"],
    ["sweep", "frequency sweep"], ["multisine", "multisine"],
  ];
  const CALLED = Object.fromEntries(FAMILIES);
  const NEEDS = { sweep: ["low", "high", "period"], multisine: ["lines", "period"], step: [] };
  const NAMES = { alpha: "α", q: "q", theta: "θ", V: "V", az: "a_z", h: "h", u: "u", de: "δe" };
  const UNITS = { alpha: "deg", q: "deg/s", theta: "deg", V: "m/s" };
  const DRAWN = ["alpha", "q", "theta", "V"];
  const VIEWS = ["alpha", "q", "theta", "V", "az", "h"];
  const LINES = Object.keys(data.phases).map(Number).sort((a, b) => a - b);
  const RANGES = ["speed", "amplitude", "step", "low", "high", "lines", "period", "duration"];
  const WELL = 0.05, POORLY = 0.3; // relative standard errors that words and bars turn at
  const state = {
    aircraft: "eolo" in data.aircraft ? "eolo" : Object.keys(data.aircraft)[0], V: null, suite: null, off: [], mode: "",
    family: "3211", amplitude: 2, step: 0.25, low: 0.1, high: 1, lines: 12, period: 8, duration: 10,
  };
  let kept = null, prepared = null, preparedFor = "";

  const point = () => data.aircraft[state.aircraft].points[state.V];
  const suite = () => point().suites[state.suite];
  const sensors = () => suite().sensors.map((s) => s.channel).filter((c) => !state.off.includes(c));
  const sig = (x, n = 3) => (x === 0 ? "0" : Math.abs(x) >= 1e4 || Math.abs(x) < 1e-3 ? x.toExponential(n - 1) : String(+x.toPrecision(n)));
  const escape = (s) => String(s).replace(/[&<>"']/g, (c) => `&#${c.charCodeAt(0)};`);
  const label = (c) => NAMES[c] ?? c;

  // --- controls -------------------------------------------------------------------------------------------------------

  function fill(select, options, value) {
    select.innerHTML = options.map(([v, text]) => `<option value="${escape(v)}">${escape(text)}</option>`).join("");
    select.value = value;
  }

  // Make every choice one that exists: another aircraft has other speeds, suites and modes.
  function settle() {
    const aircraft = data.aircraft[state.aircraft], speeds = Object.keys(aircraft.points).sort((a, b) => a - b);
    if (!speeds.includes(state.V)) {
      const usual = aircraft.design_V_m_s;
      state.V = speeds.reduce((a, b) => (Math.abs(b - usual) < Math.abs(a - usual) ? b : a));
    }
    const suites = Object.keys(point().suites);
    if (!suites.includes(state.suite)) { state.suite = suites[0]; state.off = []; }
    if (!Object.hasOwn(point().groups, state.mode) || state.mode === "rigid") state.mode = "";
    state.amplitude = Math.min(state.amplitude, Math.round(aircraft.full / DEG * 10) / 10);
    const length = core.length({ ...state, start: START }, state.duration);
    state.duration = Math.min(30, Math.max(state.duration, Math.ceil(START + length + 1)));
    if (state.family === "sweep" && state.high <= state.low) state.high = Math.round((state.low + 0.1) * 10) / 10;
  }

  function showControls() {
    const aircraft = data.aircraft[state.aircraft], speeds = Object.keys(aircraft.points).sort((a, b) => a - b);
    fill($("aircraft"), Object.keys(data.aircraft).map((n) => [n, n]), state.aircraft);
    $("aircraft").title = aircraft.title;
    $("speed").max = speeds.length - 1;
    $("speed").disabled = speeds.length < 2;
    $("speed").value = speeds.indexOf(state.V);
    fill($("suite"), Object.keys(point().suites).map((n) => [n, n]), state.suite);
    $("sensors").innerHTML = suite().sensors.map((s) => `<label><input type="checkbox" value="${escape(s.channel)}"${state.off.includes(s.channel) ? "" : " checked"}>${escape(label(s.channel))}</label>`).join("");
    const modes = Object.keys(point().groups).filter((n) => n !== "rigid");
    fill($("mode"), [["", modes.length ? "nothing else" : "nothing else: it is rigid"], ...modes.map((n) => [n, n])], state.mode);
    $("mode").disabled = !modes.length;
    fill($("family"), FAMILIES, state.family);
    $("amplitude").max = Math.round(aircraft.full / DEG * 10) / 10;
    $("lines").max = LINES.length - 1;
    const needs = NEEDS[state.family] ?? ["step"];
    document.querySelectorAll("label[data-for]").forEach((l) => { l.hidden = !needs.includes(l.dataset.for); });
    for (const id of RANGES) {
      if (id === "speed") continue;
      $(id).value = id === "lines" ? LINES.indexOf(state.lines) : state[id];
    }
    showValues();
  }

  function showValues() {
    const text = {
      speed: `${state.V} m/s`, amplitude: `${sig(state.amplitude)}°`, step: `${sig(state.step)} s`, low: `${sig(state.low)} Hz`,
      high: `${sig(state.high)} Hz`, lines: `${state.lines}, to ${sig(state.lines / state.period)} Hz`, period: `${state.period} s`,
      duration: `${state.duration} s`,
    };
    for (const id of RANGES) { $(`${id}-is`).textContent = text[id]; $(id).setAttribute("aria-valuetext", text[id]); }
  }

  function listen() {
    for (const id of ["aircraft", "suite", "mode", "family"]) {
      $(id).addEventListener("change", () => {
        state[id] = $(id).value;
        if (id === "suite") state.off = [];
        changed(true);
      });
    }
    for (const id of RANGES) {
      $(id).addEventListener("input", () => {
        const v = Number($(id).value);
        if (id === "speed") state.V = Object.keys(data.aircraft[state.aircraft].points).sort((a, b) => a - b)[v];
        else state[id] = id === "lines" ? LINES[v] : v;
        changed(false);
      });
    }
    $("sensors").addEventListener("change", (event) => {
      const name = event.target.value;
      state.off = event.target.checked ? state.off.filter((c) => c !== name) : [...state.off, name];
      changed(false);
    });
    $("pin").addEventListener("click", () => {
      kept = kept ? null : { ...analysis(), words: words() };
      $("pin").textContent = kept ? "Forget the kept one" : "Keep to compare";
      say(kept ? "kept; change the input to compare" : "");
      draw();
    });
    $("download").addEventListener("click", () => {
      const a = document.createElement("a");
      a.href = URL.createObjectURL(new Blob([scenario()], { type: "application/toml" }));
      a.download = "studio.toml";
      a.click();
      setTimeout(() => URL.revokeObjectURL(a.href), 1000);
      say("studio.toml: fly it with testbench run studio.toml");
    });
    $("link").addEventListener("click", async () => {
      try { await navigator.clipboard.writeText(location.href); say("link copied"); } catch { say("the address bar holds the link"); }
    });
    window.addEventListener("hashchange", () => { if (read()) changed(true, false); });
  }

  const say = (text) => { $("said").textContent = text; };

  // --- the state in the address ---------------------------------------------------------------------------------------

  function write() {
    const entries = Object.entries(state).map(([k, v]) => [k, Array.isArray(v) ? v.join(",") : String(v)]);
    history.replaceState(null, "", `#${new URLSearchParams(entries)}`);
  }

  // Numbers outside a slider's range are brought into it, unknown names fall back to what exists.
  function read() {
    const given = new URLSearchParams(location.hash.slice(1));
    if (![...given].length) return false;
    if (Object.hasOwn(data.aircraft, given.get("aircraft"))) state.aircraft = given.get("aircraft");
    if (Object.hasOwn(CALLED, given.get("family"))) state.family = given.get("family");
    for (const id of ["V", "suite", "mode"]) if (given.has(id)) state[id] = given.get(id);
    if (given.has("off")) state.off = given.get("off").split(",").filter(Boolean);
    for (const id of ["amplitude", "step", "low", "high", "period", "duration"]) {
      const v = given.has(id) ? Number(given.get(id)) : NaN;
      if (Number.isFinite(v)) state[id] = Math.min(Math.max(v, Number($(id).min)), id === "amplitude" ? 90 : Number($(id).max));
    }
    if (LINES.includes(Number(given.get("lines")))) state.lines = Number(given.get("lines"));
    return true;
  }

  // --- computing ------------------------------------------------------------------------------------------------------

  const chosen = () => ({ ...state, amplitude: state.amplitude * DEG, start: START });

  function analysis() {
    const p = point(), s = suite(), parameters = [...p.groups.rigid, ...(state.mode ? p.groups[state.mode] : [])];
    const key = JSON.stringify([state.aircraft, state.V, state.suite, sensors(), state.mode, state.duration]);
    if (key !== preparedFor) { prepared = core.prepare(p, s, sensors(), parameters, state.duration); preparedFor = key; }
    const u = core.input(chosen(), state.duration, s.rate_hz, data.phases);
    return { u, dt: prepared.dt, parameters, trim: p.trim, ...core.analyse(prepared, u) };
  }

  function errorsOf(result) {
    const p = point(), C = result.covariance, rows = [];
    result.parameters.forEach((name, i) => {
      const value = p.values[p.parameters.indexOf(name)], error = C ? Math.sqrt(C[i][i]) : Infinity;
      rows.push({ name, value, relative: error / Math.abs(value) });
    });
    for (const t of p.targets) {
      if (t.group !== "rigid" && t.group !== state.mode) continue;
      const g = result.parameters.map((n) => t.row[p.parameters.indexOf(n)]);
      let variance = 0;
      if (C) g.forEach((a, i) => g.forEach((b, j) => { variance += a * C[i][j] * b; }));
      rows.push({ name: short(t.name.replace(/^wn of /, "ω of ").replace(/^zeta of /, "ζ of ")), value: t.value, relative: C ? Math.sqrt(variance) / Math.abs(t.value) : Infinity });
    }
    return rows;
  }

  function words() {
    const length = { sweep: `from ${sig(state.low)} to ${sig(state.high)} Hz in ${state.period} s`, multisine: `of ${state.lines} lines in ${state.period} s`, step: "" }[state.family] ?? (state.family === "pulse" ? `of ${sig(state.step)} s` : `of ${sig(state.step)} s steps`);
    return `${CALLED[state.family]}${length ? ` ${length}` : ""}, ${sig(state.amplitude)}°`;
  }

  // --- drawing --------------------------------------------------------------------------------------------------------

  const W = 560;

  function ticks(low, high, most = 5) {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find((m) => m * power >= raw) * power;
    const out = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(+(k * step).toPrecision(12));
    return out;
  }

  const path = (xs, ys, x, y) => xs.map((v, i) => `${i ? "L" : "M"}${x(v).toFixed(1)} ${y(ys[i]).toFixed(1)}`).join("");

  function frame(H, x, y, xTicks, yTicks, xText, yText, left = 46, xFormat = sig) {
    const out = [];
    for (const t of yTicks) out.push(`<line class="axis" x1="${left}" x2="${W - 8}" y1="${y(t)}" y2="${y(t)}"/><text x="${left - 5}" y="${y(t) + 4}" text-anchor="end">${sig(t)}</text>`);
    for (const t of xTicks) out.push(`<line class="axis" x1="${x(t)}" x2="${x(t)}" y1="${H - 32}" y2="${H - 28}"/><text x="${x(t)}" y="${H - 16}" text-anchor="middle">${xFormat(t)}</text>`);
    if (xText) out.push(`<text x="${W - 8}" y="${H - 2}" text-anchor="end">${xText}</text>`);
    out.push(`<text class="name" x="${left}" y="12">${yText}</text>`);
    return out.join("");
  }

  const held = (u, dt) => {
    const xs = [], ys = [];
    u.forEach((v, k) => {
      if (k === 0 || v !== u[k - 1]) { if (k > 0) { xs.push(k * dt); ys.push(u[k - 1] / DEG); } xs.push(k * dt); ys.push(v / DEG); }
    });
    xs.push(u.length * dt); ys.push(u[u.length - 1] / DEG);
    return [xs, ys];
  };

  function drawSignal(result) {
    const H = 210, top = Math.max(state.amplitude, ...(kept ? [...kept.u].map((v) => Math.abs(v) / DEG) : [])) * 1.25;
    const x = (t) => 46 + (W - 54) * t / state.duration, y = (v) => 20 + (H - 52) * (top - v) / (2 * top);
    let body = frame(H, x, y, ticks(0, state.duration), ticks(-top, top, 4), "time, s", "elevator command, deg");
    if (kept) body += `<path class="kept" d="${path(...held(kept.u, kept.dt), x, y)}"/>`;
    body += `<path class="curve" d="${path(...held(result.u, result.dt), x, y)}"/>`;
    if (!NEEDS[state.family]) {
      body += `<circle class="handle" id="handle" cx="${x(START + firstStep())}" cy="${y(state.amplitude)}" r="8"><title>drag: step length and amplitude</title></circle>`;
    }
    $("signal").innerHTML = svg(H, body, `Elevator command: ${words()}`);
    drag();
  }

  const firstStep = () => state.step * ({ 3211: 3, 211: 2 }[state.family] ?? 1);

  function drag() {
    const handle = $("handle");
    if (!handle) return;
    handle.addEventListener("pointerdown", (event) => {
      const box = $("signal").querySelector("svg").getBoundingClientRect(), scale = W / box.width, H = 210;
      const seconds = state.duration, top = state.amplitude * 1.25, ratio = firstStep() / state.step;
      const move = (e) => {
        const t = ((e.clientX - box.left) * scale - 46) / (W - 54) * seconds, v = top - ((e.clientY - box.top) * scale - 20) / (H - 52) * 2 * top;
        state.step = Math.min(3, Math.max(0.05, Math.round((t - START) / ratio / 0.05) * 0.05));
        state.step = +state.step.toFixed(2);
        state.amplitude = Math.min(Number($("amplitude").max), Math.max(0.1, Math.round(v * 10) / 10));
        changed(false);
      };
      const stop = () => { window.removeEventListener("pointermove", move); window.removeEventListener("pointerup", stop); };
      window.addEventListener("pointermove", move);
      window.addEventListener("pointerup", stop);
      event.preventDefault();
    });
  }

  function drawSpectrum(result) {
    const H = 290, top = 64, modes = Object.entries(point().modes), low = 0.1, high = Math.max(60, ...modes.map(([, [a, b]]) => 1.5 * Math.hypot(a, b)));
    const omegas = Array.from({ length: 240 }, (_, i) => low * (high / low) ** (i / 239));
    const density = core.spectrum(result.u, result.dt, omegas), other = kept ? core.spectrum(kept.u, kept.dt, omegas) : [];
    const peak = Math.max(...density, ...other), db = (v) => 10 * Math.log10(Math.max(v / peak, 1e-6));
    const x = (w) => 46 + (W - 54) * Math.log(w / low) / Math.log(high / low), y = (v) => top + (H - top - 32) * -v / 60;
    let body = "";
    modes.forEach(([, pole]) => {
      const [a, b] = core.band(pole, state.duration).map((w) => x(Math.min(Math.max(w, low), high)));
      body += `<rect class="band" x="${a}" y="${top}" width="${Math.max(b - a, 1)}" height="${H - top - 32}"/>`;
    });
    body += frame(H, x, y, [0.1, 0.3, 1, 3, 10, 30, 100, 300].filter((t) => t <= high), [0, -20, -40, -60], "frequency, rad/s", "dB");
    if (kept) body += `<path class="kept" d="${path(omegas, other.map(db), x, y)}"/>`;
    body += `<path class="curve" d="${path(omegas, density.map(db), x, y)}"/>`;
    const ends = []; // where each row of names is taken up to
    modes.map(([name, [a, b]]) => [short(name), Math.hypot(a, b)]).sort((a, b) => a[1] - b[1]).forEach(([name, wn]) => {
      if (wn < low || wn > high) return;
      const at = x(wn), wide = 6.3 * name.length, from = Math.min(at + 3, W - 4 - wide);
      let row = ends.findIndex((end) => end < from);
      if (row < 0) row = ends.length;
      ends[row] = from + wide + 6;
      body += `<line class="mode" x1="${at}" x2="${at}" y1="${22 + 14 * row}" y2="${H - 32}"/><text class="name" x="${from}" y="${30 + 14 * row}">${escape(name)}</text>`;
    });
    $("spectrum").innerHTML = svg(H, body, `Energy spectrum of the ${words()}`);
  }

  const short = (name) => name.replace("symmetric wing ", "").replace(" and tail-boom bending", "").replace(" and symmetric wing torsion", "/torsion").replace("symmetric ", "");

  function drawResponse(result) {
    const each = 105, H = each * DRAWN.length + 34, limits = data.aircraft[state.aircraft].limits, broken = [];
    const x = (t) => 46 + (W - 54) * t / state.duration;
    let body = "";
    DRAWN.forEach((name, row) => {
      const i = VIEWS.indexOf(name), scale = UNITS[name].startsWith("deg") ? 1 / DEG : 1;
      const curve = (r) => Array.from(r.views[i], (v) => (v + (r.trim[name] ?? 0)) * scale);
      const mine = curve(result), others = kept ? curve(kept) : [];
      let low = Math.min(...mine, ...others), high = Math.max(...mine, ...others);
      const middle = (low + high) / 2, half = Math.max((high - low) / 2 * 1.15, 1e-3 * Math.abs(middle), 1e-4);
      low = middle - half; high = middle + half;
      const top = each * row + 18, y = (v) => top + (each - 30) * (high - v) / (high - low);
      body += ticks(low, high, 4).map((t) => `<line class="axis" x1="46" x2="${W - 8}" y1="${y(t)}" y2="${y(t)}"/><text x="41" y="${y(t) + 4}" text-anchor="end">${sig(t)}</text>`).join("");
      body += `<text class="name" x="46" y="${top - 5}">${label(name)}, ${UNITS[name]}</text>`;
      for (const bound of limits[name] ?? []) {
        const b = bound * scale;
        if (b > low && b < high) body += `<line class="limit" x1="46" x2="${W - 8}" y1="${y(b)}" y2="${y(b)}"/>`;
      }
      if (limits[name] && (Math.min(...mine) < limits[name][0] * scale || Math.max(...mine) > limits[name][1] * scale)) broken.push(name);
      const xs = mine.map((_, k) => k * result.dt);
      if (kept) body += `<path class="kept" d="${path(others.map((_, k) => k * kept.dt).filter((t) => t <= state.duration), others, x, y)}"/>`;
      body += `<path class="curve" d="${path(xs, mine, x, y)}"/>`;
    });
    body += ticks(0, state.duration).map((t) => `<text x="${x(t)}" y="${H - 16}" text-anchor="middle">${sig(t)}</text>`).join("");
    body += `<text x="${W - 8}" y="${H - 2}" text-anchor="end">time, s</text>`;
    $("response").innerHTML = svg(H, body, "Predicted response");
    return broken;
  }

  const svg = (H, body, title) => `<svg viewBox="0 0 ${W} ${H}" role="img" aria-label="${escape(title)}">${body}</svg>`;

  const percent = (r) => (Number.isFinite(r) ? (r >= 10 ? "over 1000 %" : `${sig(100 * r)} %`) : "not told");

  const percentOf = (rows, name) => { const r = (rows ?? []).find((x) => x.name === name); return r ? percent(r.relative) : "–"; };

  function drawErrors(rows, before) {
    const widest = 100, width = (r) => (Number.isFinite(r) ? Math.min(100, Math.max(2, 100 * Math.log10(Math.max(r, 1e-3) / 1e-3) / Math.log10(widest / 1e-1))) : 100);
    $("errors").classList.toggle("comparing", Boolean(kept));
    $("errors").querySelector("tbody").innerHTML = rows.map((r) => `<tr><th scope="row">${escape(r.name)}</th><td class="number true">${sig(r.value)}</td><td class="number">${percent(r.relative)}</td><td class="bars"><i class="${r.relative > POORLY ? "poor" : ""}" style="width:${width(r.relative)}%"></i></td><td class="number kept">${percentOf(before, r.name)}</td></tr>`).join("");
  }

  function answer(rows, broken, energy) {
    const own = rows.filter((r) => point().parameters.includes(r.name)), worst = own.reduce((a, b) => (b.relative > a.relative ? b : a));
    const well = own.filter((r) => r.relative <= WELL).length;
    let text = `One ${words()} at ${state.V} m/s, seen by ${sensors().map(label).join(", ") || "no sensor"}: `;
    if (!Number.isFinite(worst.relative)) text += sensors().length ? "these sensors and this input cannot tell all parameters apart." : "nothing can be known.";
    else if (well === own.length) text += `all ${own.length} parameters to 5 % or better, the worst ${worst.name} to ${percent(worst.relative)}.`;
    else text += `${well} of ${own.length} parameters to 5 % or better; the worst is ${worst.name} with a standard error of ${percent(worst.relative)}.`;
    text += ` ${energy}`;
    if (broken.length) text += ` It breaks the limit of ${broken.map(label).join(" and ")}: reduce the amplitude.`;
    const length = core.length({ ...state, start: START }, state.duration);
    if (START + length > state.duration) text += " The input is longer than the record.";
    $("answer").textContent = text;
    $("answer").classList.toggle("poor", broken.length > 0 || 2 * well < own.length);
  }

  // Share of the energy inside each mode's half-power band; the whole integral by Parseval's theorem.
  function energyWords(result) {
    const total = Math.PI * result.u.reduce((a, v) => a + v * v, 0) * result.dt;
    if (!(total > 0)) return "";
    const shares = Object.entries(point().modes).map(([name, pole]) => {
      const [a, b] = core.band(pole, state.duration), n = 200, low = Math.max(a, 1e-6);
      const omegas = Array.from({ length: n + 1 }, (_, i) => low + (b - low) * i / n), d = core.spectrum(result.u, result.dt, omegas);
      let sum = 0;
      for (let i = 0; i < n; i++) sum += (d[i] + d[i + 1]) / 2 * (b - low) / n;
      return `${short(name)} ${sig(100 * sum / total, 2)} %`;
    });
    return `Share of its energy inside each mode's band: ${shares.join("; ")}.`;
  }

  function draw() {
    const result = analysis(), rows = errorsOf(result);
    drawSignal(result);
    drawSpectrum(result);
    const broken = drawResponse(result);
    drawErrors(rows, kept && kept.rows);
    if (kept && !kept.rows) kept.rows = rows;
    answer(rows, broken, energyWords(result));
    window.studio = { u: [...result.u], errors: rows, scenario: scenario() }; // for those who want the numbers
  }

  let waiting = false;
  function changed(controls, keepAddress = true) {
    settle();
    if (controls) showControls(); else { $("duration").value = state.duration; $("step").value = state.step; $("amplitude").value = state.amplitude; $("high").value = state.high; showValues(); }
    if (keepAddress) write();
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  }

  // --- the scenario ---------------------------------------------------------------------------------------------------

  function scenario() {
    const s = state, seen = sensors(), judge = Math.min(s.amplitude, 2);
    const keys = {
      step: [], pulse: [`width_s = ${s.step.toFixed(3)}`], doublet: [`period_s = ${(2 * s.step).toFixed(3)}`],
      sweep: [`f_start_hz = ${s.low.toFixed(3)}`, `f_end_hz = ${s.high.toFixed(3)}`, `sweep_s = ${s.period.toFixed(3)}`],
      multisine: [`f_min_hz = ${(0.9 / s.period).toFixed(6)}`, `f_max_hz = ${((s.lines + 0.1) / s.period).toFixed(6)}`, `period_s = ${s.period.toFixed(3)}`],
    }[s.family] ?? [`step_s = ${s.step.toFixed(3)}`];
    const rates = new Set(suite().sensors.map((x) => x.every));
    const estimator = rates.size > 1
      ? ['method = "transfer_function"', "poles = 4", "zeros = [0, 1, 2, 3]"]
      : ['method = "dsr_e"', "order = 5", "past_horizon = 40", "future_horizon = 40"];
    return [
      "# Made in the studio. Predicted standard errors, one flight, offsets unknown:",
      ...errorsOf(analysis()).map((r) => `#   ${r.name}: ${percent(r.relative)}`),
      `title = "Studio: ${words().replace("°", " deg")}"`,
      `aircraft = "${s.aircraft}"`,
      "seed = 1",
      `suites = ["${s.suite}"]`,
      "",
      "[condition]",
      `V_m_s = ${Number(s.V).toFixed(2)}`,
      `h_m = ${data.aircraft[s.aircraft].h_m.toFixed(1)}`,
      "",
      "[simulation]",
      `log_rate_hz = ${suite().rate_hz.toFixed(1)}`,
      "",
      "[[manoeuvre]]",
      'name = "studio"',
      'use = "identification"',
      `duration_s = ${s.duration.toFixed(1)}`,
      "[[manoeuvre.input]]",
      `signal = "${s.family}"`,
      'control = "de"',
      `amplitude_deg = ${s.amplitude.toFixed(2)}`,
      `start_s = ${START.toFixed(1)}`,
      ...keys,
      "",
      "[[manoeuvre]]",
      'name = "doublet to judge"',
      'use = "validation"',
      "duration_s = 10.0",
      "[[manoeuvre.input]]",
      'signal = "doublet"',
      'control = "de"',
      `amplitude_deg = ${judge.toFixed(2)}`,
      "start_s = 1.0",
      "period_s = 2.0",
      "",
      "[identification]",
      `inputs = ["${suite().input}"]`,
      `outputs = [${seen.filter((c) => suite().moves.includes(c)).map((c) => `"${c}"`).join(", ")}]`,
      "[[identification.estimators]]",
      ...estimator,
    ].join("\n") + "\n";
  }

  read();
  settle();
  listen();
  changed(true);
})();
