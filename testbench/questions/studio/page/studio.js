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
  const NAMES = { alpha: "α", beta: "β", theta: "θ", phi: "φ", psi: "ψ", az: "a_z", ay: "a_y", ax: "a_x", de: "δe", da: "δa", dr: "δr", thr: "δt" };
  const UNITS = { alpha: "deg", q: "deg/s", theta: "deg", V: "m/s", beta: "deg", p: "deg/s", r: "deg/s", phi: "deg" };
  const VIEWS = { longitudinal: ["alpha", "q", "theta", "V"], lateral: ["beta", "p", "r", "phi"] }; // as in ask.py
  const CONTROLS = { de: "elevator", da: "aileron", dr: "rudder", thr: "throttle" };
  const SI = { deg: DEG, "deg/s": DEG, "%": 0.01 }; // SI value of one unit; 1 for the others
  const ANGLES = /^(alpha|beta|theta|phi|psi|gamma|de|da|dr)(_cmd)?$/, RATES = /^[pqr]$/;
  const LINES = Object.keys(data.phases).map(Number).sort((a, b) => a - b);
  const RANGES = ["speed", "amplitude", "step", "low", "high", "lines", "period", "duration", "off_model"];
  const WELL = 0.05, POORLY = 0.3; // relative standard errors that words and bars turn at
  const state = {
    aircraft: "eolo" in data.aircraft ? "eolo" : Object.keys(data.aircraft)[0], V: null, suite: null, off: [], mode: "",
    control: "de", family: "3211", amplitude: 2, step: 0.25, low: 0.1, high: 1, lines: 12, period: 8, duration: 10,
    off_model: 15, edits: {}, // of the chosen suite: channel -> [noise, lag in s, delay in s], noise in SI units
  };
  let kept = null, prepared = null, preparedFor = "";

  const aircraft = () => data.aircraft[state.aircraft];
  const point = () => aircraft().points[state.V];
  const axis = () => point().axes[state.control];
  const unit = () => (state.control === "thr" ? "%" : "°");
  const scale = () => (state.control === "thr" ? 0.01 : DEG); // of the amplitude
  const most = () => Math.round(aircraft().full[state.control] / scale() * 10) / 10;
  const unitOf = (c) => (ANGLES.test(c) ? "deg" : RATES.test(c) ? "deg/s" : /^(V|u|v|w|hdot|Vg|v_)/.test(c) ? "m/s" : /^a[xyz]/.test(c) ? "m/s²" : /^(thr)/.test(c) ? "%" : /^(h|north|east)$/.test(c) ? "m" : "SI");
  const suite = () => {
    const given = axis().suites[state.suite];
    return { ...given, sensors: given.sensors.map((s) => {
      const edit = state.edits[s.channel];
      return edit ? { ...s, sigma: edit[0], lag_s: edit[1], delay_s: edit[2] } : s;
    }) };
  };
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
    const speeds = Object.keys(aircraft().points).sort((a, b) => a - b);
    if (!speeds.includes(state.V)) {
      const usual = aircraft().design_V_m_s;
      state.V = speeds.reduce((a, b) => (Math.abs(b - usual) < Math.abs(a - usual) ? b : a));
    }
    if (!Object.hasOwn(point().axes, state.control)) state.control = Object.keys(point().axes)[0];
    const suites = Object.keys(axis().suites);
    if (!suites.includes(state.suite)) { state.suite = suites[0]; state.off = []; state.edits = {}; }
    for (const c of Object.keys(state.edits)) if (!axis().suites[state.suite].sensors.some((x) => x.channel === c)) delete state.edits[c];
    if (!Object.hasOwn(axis().groups, state.mode) || state.mode === "rigid") state.mode = "";
    state.amplitude = Math.min(state.amplitude, most());
    const length = core.length({ ...state, start: START }, state.duration);
    state.duration = Math.min(30, Math.max(state.duration, Math.ceil(START + length + 1)));
    if (state.family === "sweep" && state.high <= state.low) state.high = Math.round((state.low + 0.1) * 10) / 10;
  }

  function showControls() {
    const speeds = Object.keys(aircraft().points).sort((a, b) => a - b);
    fill($("aircraft"), Object.keys(data.aircraft).map((n) => [n, n]), state.aircraft);
    $("aircraft").title = aircraft().title;
    $("speed").max = speeds.length - 1;
    $("speed").disabled = speeds.length < 2;
    $("speed").value = speeds.indexOf(state.V);
    fill($("control"), Object.keys(point().axes).map((c) => [c, CONTROLS[c]]), state.control);
    fill($("suite"), Object.keys(axis().suites).map((n) => [n, aircraft().borrowed.includes(n) ? `${n} (of another aircraft)` : n]), state.suite);
    $("sensors").innerHTML = suite().sensors.map((s) => `<label><input type="checkbox" value="${escape(s.channel)}"${state.off.includes(s.channel) ? "" : " checked"}>${escape(label(s.channel))}</label>`).join("");
    showEdits();
    const modes = Object.keys(axis().groups).filter((n) => n !== "rigid");
    fill($("mode"), [["", modes.length ? "nothing else" : "nothing else: no elastic mode"], ...modes.map((n) => [n, n])], state.mode);
    $("mode").disabled = !modes.length;
    fill($("family"), FAMILIES, state.family);
    $("amplitude").max = most();
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
      speed: `${state.V} m/s`, amplitude: `${sig(state.amplitude)}${unit()}`, step: `${sig(state.step)} s`, low: `${sig(state.low)} Hz`,
      high: `${sig(state.high)} Hz`, lines: `${state.lines}, to ${sig(state.lines / state.period)} Hz`, period: `${state.period} s`,
      duration: `${state.duration} s`, off_model: `${state.off_model} %`,
    };
    for (const id of RANGES) { $(`${id}-is`).textContent = text[id]; $(id).setAttribute("aria-valuetext", text[id]); }
  }

  // One row a sensor: its noise with quantisation, lag and delay, each in the unit that people use.
  function showEdits() {
    $("edits").querySelector("tbody").innerHTML = suite().sensors.map((s) => {
      const u = unitOf(s.channel), values = [s.sigma / (SI[u] ?? 1), 1000 * s.lag_s, 1000 * s.delay_s];
      const cells = ["noise", "lag", "delay"].map((what, i) => `<td><input type="number" min="0" step="any" data-channel="${escape(s.channel)}" data-what="${i}" value="${sig(values[i], 4)}" aria-label="${what} of ${escape(s.channel)}"></td>`);
      return `<tr><th scope="row">${escape(label(s.channel))}, ${u}</th>${cells.join("")}</tr>`;
    }).join("");
  }

  function edited(input) {
    const { channel, what } = input.dataset, s = suite().sensors.find((x) => x.channel === channel), value = Number(input.value);
    const refused = !Number.isFinite(value) || input.value.trim() === "" || value < 0 || (what === "0" && value === 0);
    input.setAttribute("aria-invalid", String(refused));
    if (refused) { say(what === "0" ? "a sensor must have noise above zero" : "lag and delay must be zero or more"); return; }
    const edit = [s.sigma, s.lag_s, s.delay_s];
    edit[what] = what === "0" ? value * (SI[unitOf(channel)] ?? 1) : value / 1000;
    state.edits = { ...state.edits, [channel]: edit };
    say("");
    changed(false);
  }

  // --- undo -----------------------------------------------------------------------------------------------------------

  const past = [], future = [];
  let last = null, lastAt = 0;

  // What is changed again within half a second is one step: a slider that is dragged.
  function remember() {
    const now = JSON.stringify(state), at = performance.now();
    if (now === last) return;
    if (last !== null && (at - lastAt > 500 || !past.length)) past.push(last);
    lastAt = at; last = now; future.length = 0;
    showUndo();
  }

  function travel(from, to, words) {
    if (!from.length) return;
    to.push(last);
    last = from.pop();
    lastAt = 0;
    Object.assign(state, JSON.parse(last));
    say(words);
    changed(true);
  }

  const undo = () => travel(past, future, "undone"), redo = () => travel(future, past, "done again");
  function showUndo() { $("undo").disabled = !past.length; $("redo").disabled = !future.length; }

  function listen() {
    for (const id of ["aircraft", "control", "suite", "mode", "family"]) {
      $(id).addEventListener("change", () => {
        state[id] = $(id).value;
        if (id === "suite" || id === "aircraft") { state.off = []; state.edits = {}; }
        changed(true);
      });
    }
    $("edits").addEventListener("change", (event) => edited(event.target));
    $("as-sold").addEventListener("click", () => { state.edits = {}; say("the sensors are those of the suite again"); changed(true); });
    $("undo").addEventListener("click", undo);
    $("redo").addEventListener("click", redo);
    document.addEventListener("keydown", (event) => {
      if (!(event.ctrlKey || event.metaKey) || event.target.matches("input[type=number]")) return;
      const key = event.key.toLowerCase();
      if (key === "z" && !event.shiftKey) undo(); else if (key === "y" || (key === "z" && event.shiftKey)) redo(); else return;
      event.preventDefault();
    });
    // A wheel turns the slider that has been chosen, and none that the pointer merely passes while the page scrolls.
    $("choice").addEventListener("wheel", (event) => {
      const slider = event.target;
      if (slider.type !== "range" || slider !== document.activeElement) return;
      event.preventDefault();
      if (event.deltaY < 0) slider.stepUp(); else slider.stepDown();
      slider.dispatchEvent(new Event("input", { bubbles: true }));
    }, { passive: false });
    for (const id of RANGES) {
      $(id).addEventListener("input", () => {
        const v = Number($(id).value);
        if (id === "speed") state.V = Object.keys(aircraft().points).sort((a, b) => a - b)[v];
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
      give("studio.toml", scenario());
      say(`studio.toml: fly it with testbench run studio.toml${ownSuite() ? "; put studio_suite.toml beside it into suites/" : ""}`);
      if (ownSuite()) give("studio_suite.toml", suiteText());
    });
    $("plan").addEventListener("click", () => {
      give("studio_plan.toml", plan());
      say(`studio_plan.toml: change what is yours, then testbench plan studio_plan.toml${ownSuite() ? "; put studio_suite.toml beside it into suites/" : ""}`);
      if (ownSuite()) give("studio_suite.toml", suiteText());
    });
    $("link").addEventListener("click", async () => {
      try { await navigator.clipboard.writeText(location.href); say("link copied"); } catch { say("the address bar holds the link"); }
    });
    window.addEventListener("hashchange", () => { if (read()) changed(true, false); });
    window.matchMedia("(max-width: 520px)").addEventListener("change", draw);
  }

  function give(name, text) {
    const a = document.createElement("a");
    a.href = URL.createObjectURL(new Blob([text], { type: "application/toml" }));
    a.download = name;
    a.click();
    setTimeout(() => URL.revokeObjectURL(a.href), 1000);
  }

  const say = (text) => { $("said").textContent = text; };

  // --- the state in the address ---------------------------------------------------------------------------------------

  function write() {
    const edits = Object.entries(state.edits).map(([c, e]) => [c, ...e].join(":")).join(",");
    const entries = Object.entries({ ...state, edits }).map(([k, v]) => [k, Array.isArray(v) ? v.join(",") : String(v)]);
    history.replaceState(null, "", `#${new URLSearchParams(entries)}`);
  }

  // Numbers outside a slider's range are brought into it, unknown names fall back to what exists.
  function read() {
    const given = new URLSearchParams(location.hash.slice(1));
    if (![...given].length) return false;
    if (Object.hasOwn(data.aircraft, given.get("aircraft"))) state.aircraft = given.get("aircraft");
    if (Object.hasOwn(CALLED, given.get("family"))) state.family = given.get("family");
    for (const id of ["V", "control", "suite", "mode"]) if (given.has(id)) state[id] = given.get(id);
    state.edits = {};
    for (const entry of (given.get("edits") ?? "").split(",")) {
      const [channel, ...values] = entry.split(":"), [noise, lag, delay] = values.map(Number);
      if (values.length === 3 && noise > 0 && lag >= 0 && delay >= 0 && noise + lag + delay < Infinity && channel !== "__proto__") state.edits[channel] = [noise, lag, delay];
    }
    if (given.has("off")) state.off = given.get("off").split(",").filter(Boolean);
    for (const id of ["amplitude", "step", "low", "high", "period", "duration", "off_model"]) {
      const v = given.has(id) ? Number(given.get(id)) : NaN;
      if (Number.isFinite(v)) state[id] = Math.min(Math.max(v, Number($(id).min)), id === "amplitude" ? 100 : Number($(id).max));
    }
    if (LINES.includes(Number(given.get("lines")))) state.lines = Number(given.get("lines"));
    return true;
  }

  // --- computing ------------------------------------------------------------------------------------------------------

  const chosen = () => ({ ...state, amplitude: state.amplitude * scale(), start: START });

  const asked = (p) => [...p.groups.rigid, ...(state.mode ? p.groups[state.mode] : [])];

  function analysis() {
    const p = axis(), s = suite(), parameters = asked(p);
    const key = JSON.stringify([state.aircraft, state.V, state.control, state.suite, state.edits, sensors(), state.mode, state.duration]);
    if (key !== preparedFor) { prepared = core.prepare(p, s, sensors(), parameters, state.duration); preparedFor = key; }
    const u = core.input(chosen(), state.duration, s.rate_hz, data.phases);
    return { u, dt: prepared.dt, scale: scale(), unit: unit(), parameters, plane: p.plane, trim: point().trim, ...core.analyse(prepared, u) };
  }

  // Standard errors relative to the values of the model, of parameters and of the modes that follow from them.
  function errorsOf(result, p = axis()) {
    const C = result.covariance, rows = [];
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

  // The same errors of parameters where the aircraft is not the model: each rigid derivative drawn with the stated
  // standard deviation. Row name -> the tenth and ninetieth percentile of the errors, relative to the model's values.
  function elsewhere(u) {
    const p = axis(), s = suite(), parameters = asked(p), moved = p.groups.rigid, found = new Map();
    for (const draw of data.draws) {
      const factors = new Map(moved.map((name, k) => [name, draw[k] * state.off_model / 100]));
      const model = core.moved(p, s, factors), r = core.analyse(core.prepare(model.axis, model.suite, sensors(), parameters, state.duration), u);
      for (const row of errorsOf({ ...r, parameters }, p).slice(0, parameters.length)) found.set(row.name, [...(found.get(row.name) ?? []), row.relative]);
    }
    const at = (sorted, share) => sorted[Math.round(share * (sorted.length - 1))];
    return new Map([...found].map(([name, all]) => { const sorted = all.sort((a, b) => a - b); return [name, [at(sorted, 0.1), at(sorted, 0.9)]]; }));
  }

  function words() {
    const length = { sweep: `from ${sig(state.low)} to ${sig(state.high)} Hz in ${state.period} s`, multisine: `of ${state.lines} lines in ${state.period} s`, step: "" }[state.family] ?? (state.family === "pulse" ? `of ${sig(state.step)} s` : `of ${sig(state.step)} s steps`);
    return `${CALLED[state.family]}${length ? ` ${length}` : ""}, ${sig(state.amplitude)}${unit()}`;
  }

  // --- drawing --------------------------------------------------------------------------------------------------------

  const W = 560;

  // Pixels of the text of a drawing: a narrow screen has larger ones, which the style sheet says.
  function textSize(id) {
    const place = $(id);
    if (!place.firstElementChild) place.innerHTML = "<svg></svg>";
    return parseFloat(getComputedStyle(place.firstElementChild).fontSize);
  }

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

  const held = (u, dt, scale) => {
    const xs = [], ys = [];
    u.forEach((v, k) => {
      if (k === 0 || v !== u[k - 1]) { if (k > 0) { xs.push(k * dt); ys.push(u[k - 1] / scale); } xs.push(k * dt); ys.push(v / scale); }
    });
    xs.push(u.length * dt); ys.push(u[u.length - 1] / scale);
    return [xs, ys];
  };

  function drawSignal(result) {
    const H = 210, top = Math.max(state.amplitude, ...(comparable() ? [...kept.u].map((v) => Math.abs(v) / kept.scale) : [])) * 1.25;
    const x = (t) => 46 + (W - 54) * t / state.duration, y = (v) => 20 + (H - 52) * (top - v) / (2 * top);
    let body = frame(H, x, y, ticks(0, state.duration), ticks(-top, top, 4), "time, s", `${CONTROLS[state.control]} command, ${unit() === "°" ? "deg" : "%"}`);
    if (comparable()) body += `<path class="kept" d="${path(...held(kept.u, kept.dt, kept.scale), x, y)}"/>`;
    body += `<path class="curve" d="${path(...held(result.u, result.dt, result.scale), x, y)}"/>`;
    if (!NEEDS[state.family]) {
      const words = `step ${sig(state.step)} s, amplitude ${sig(state.amplitude)}${unit()}`;
      body += `<circle class="handle" id="handle" cx="${x(START + firstStep())}" cy="${y(state.amplitude)}" r="8" tabindex="0" role="slider" aria-label="Step length and amplitude: arrow keys" aria-valuenow="${state.step}" aria-valuemin="0.05" aria-valuemax="3" aria-valuetext="${words}"><title>drag, or arrow keys, or wheel: step length and amplitude</title></circle>`;
    }
    const focused = document.activeElement?.id === "handle";
    $("signal").innerHTML = svg(H, body, `${CONTROLS[state.control]} command: ${words()}`);
    if (focused) $("handle")?.focus();
    drag();
  }

  const comparable = () => kept && kept.unit === unit(); // degrees and percent share no axis

  const firstStep = () => state.step * ({ 3211: 3, 211: 2 }[state.family] ?? 1);

  function drag() {
    const handle = $("handle");
    if (!handle) return;
    handle.addEventListener("pointerdown", (event) => {
      const box = $("signal").querySelector("svg").getBoundingClientRect(), scale = W / box.width, H = 210;
      const seconds = state.duration, top = state.amplitude * 1.25, ratio = firstStep() / state.step;
      handle.focus();
      const move = (e) => {
        const t = ((e.clientX - box.left) * scale - 46) / (W - 54) * seconds, v = top - ((e.clientY - box.top) * scale - 20) / (H - 52) * 2 * top;
        shape((t - START) / ratio, v);
      };
      const stop = () => { window.removeEventListener("pointermove", move); window.removeEventListener("pointerup", stop); };
      window.addEventListener("pointermove", move);
      window.addEventListener("pointerup", stop);
      event.preventDefault();
    });
    const by = (steps, amplitudes) => shape(state.step + 0.05 * steps, state.amplitude + 0.1 * amplitudes);
    const keys = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1], PageDown: [0, -10], PageUp: [0, 10] };
    handle.addEventListener("keydown", (event) => {
      if (!Object.hasOwn(keys, event.key)) return;
      event.preventDefault();
      by(...keys[event.key]);
    });
    $("signal").querySelector("svg").addEventListener("wheel", (event) => {
      if (document.activeElement !== handle) return; // the page scrolls
      event.preventDefault();
      const way = event.deltaY + event.deltaX < 0 ? 1 : -1;
      by(...(event.shiftKey ? [way, 0] : [0, way]));
    }, { passive: false });
  }

  // Take a step length and an amplitude, rounded and inside what the sliders hold.
  function shape(step, amplitude) {
    state.step = +Math.min(3, Math.max(0.05, Math.round(step / 0.05) * 0.05)).toFixed(2);
    state.amplitude = +Math.min(most(), Math.max(0.1, Math.round(amplitude * 10) / 10)).toFixed(1);
    changed(false);
  }

  function drawSpectrum(result) {
    const H = 290, size = textSize("spectrum"), row1 = 1.2 * size, top = 22 + 3 * row1, modes = Object.entries(axis().modes), low = 0.1, high = Math.max(60, ...modes.map(([, [a, b]]) => 1.5 * Math.hypot(a, b)));
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
      const at = x(wn), wide = 0.525 * size * name.length, cut = at + 3 + wide > W - 4, from = cut ? W - 4 - wide : at + 3;
      let row = ends.findIndex((end) => end < from);
      if (row < 0) row = ends.length;
      ends[row] = from + wide + 6;
      body += `<line class="mode" x1="${at}" x2="${at}" y1="${22 + row1 * row}" y2="${H - 32}"/><text class="name" x="${cut ? W - 4 : from}" y="${30 + row1 * row}"${cut ? ' text-anchor="end"' : ""}>${escape(name)}</text>`;
    });
    $("spectrum").innerHTML = svg(H, body, `Energy spectrum of the ${words()}`);
  }

  const short = (name) => name.replace(/\b(a?)symmetric wing /, (_, a) => (a ? "asym. " : "")).replace(" and tail-boom bending", "").replace(" and tail-boom torsion", "/boom").replace(" and symmetric wing torsion", "/torsion").replace(/\bsymmetric /, "");

  function drawResponse(result) {
    const drawn = VIEWS[result.plane], other = kept && kept.plane === result.plane ? kept : null;
    const each = 105, H = each * drawn.length + 34, limits = aircraft().limits, broken = [];
    const x = (t) => 46 + (W - 54) * t / state.duration;
    let body = "";
    drawn.forEach((name, i) => {
      const scale = UNITS[name].startsWith("deg") ? 1 / DEG : 1;
      const curve = (r) => Array.from(r.views[i], (v) => (v + (r.trim[name] ?? 0)) * scale);
      const mine = curve(result), others = other ? curve(other) : [];
      let low = Math.min(...mine, ...others), high = Math.max(...mine, ...others);
      const middle = (low + high) / 2, half = Math.max((high - low) / 2 * 1.15, 1e-3 * Math.abs(middle), 1e-4);
      low = middle - half; high = middle + half;
      const top = each * i + 18, y = (v) => top + (each - 30) * (high - v) / (high - low);
      body += ticks(low, high, 4).map((t) => `<line class="axis" x1="46" x2="${W - 8}" y1="${y(t)}" y2="${y(t)}"/><text x="41" y="${y(t) + 4}" text-anchor="end">${sig(t)}</text>`).join("");
      body += `<text class="name" x="46" y="${top - 5}">${label(name)}, ${UNITS[name]}</text>`;
      for (const bound of limits[name] ?? []) {
        const b = bound * scale;
        if (b > low && b < high) body += `<line class="limit" x1="46" x2="${W - 8}" y1="${y(b)}" y2="${y(b)}"/>`;
      }
      if (limits[name] && (Math.min(...mine) < limits[name][0] * scale || Math.max(...mine) > limits[name][1] * scale)) broken.push(name);
      const xs = mine.map((_, k) => k * result.dt);
      if (other) body += `<path class="kept" d="${path(others.map((_, k) => k * kept.dt).filter((t) => t <= state.duration), others, x, y)}"/>`;
      body += `<path class="curve" d="${path(xs, mine, x, y)}"/>`;
    });
    body += ticks(0, state.duration).map((t) => `<text x="${x(t)}" y="${H - 16}" text-anchor="middle">${sig(t)}</text>`).join("");
    body += `<text x="${W - 8}" y="${H - 2}" text-anchor="end">time, s</text>`;
    $("response").innerHTML = svg(H, body, "Predicted response");
    return broken;
  }

  // A picture has no parts that keys reach: what holds a handle is a group.
  const svg = (H, body, title) => `<svg viewBox="0 0 ${W} ${H}" role="${body.includes("tabindex") ? "group" : "img"}" aria-label="${escape(title)}">${body}</svg>`;

  const percent = (r) => (Number.isFinite(r) ? (r >= 10 ? "over 1000 %" : `${sig(100 * r)} %`) : "not told");

  const percentOf = (rows, name) => { const r = (rows ?? []).find((x) => x.name === name); return r ? percent(r.relative) : "–"; };

  function drawErrors(rows, before) {
    const widest = 100, width = (r) => (Number.isFinite(r) ? Math.min(100, Math.max(2, 100 * Math.log10(Math.max(r, 1e-3) / 1e-3) / Math.log10(widest / 1e-1))) : 100);
    $("errors").classList.toggle("comparing", Boolean(kept));
    $("errors").querySelector("tbody").innerHTML = rows.map((r) => `<tr><th scope="row">${escape(r.name)}</th><td class="number true">${sig(r.value)}</td><td class="number">${percent(r.relative)}</td><td class="number range"></td><td class="bars"><i class="${r.relative > POORLY ? "poor" : ""}" style="width:${width(r.relative)}%"></i></td><td class="number kept">${percentOf(before, r.name)}</td></tr>`).join("");
  }

  function answer(rows, broken, energy) {
    const own = rows.filter((r) => axis().parameters.includes(r.name)), worst = own.reduce((a, b) => (b.relative > a.relative ? b : a));
    const well = own.filter((r) => r.relative <= WELL).length;
    let text; // what is found comes first
    if (!Number.isFinite(worst.relative)) text = sensors().length ? "These sensors and this input do not separate all parameters." : "Without a sensor there is no information.";
    else if (well === own.length) text = `All ${own.length} parameters are known to 5 % or better, the worst, ${worst.name}, to ${percent(worst.relative)}.`;
    else text = `${well} of ${own.length} parameters ${well === 1 ? "is" : "are"} known to 5 % or better; the worst is ${worst.name} with a standard error of ${percent(worst.relative)}.`;
    text += ` One ${words()} at ${state.V} m/s on the ${CONTROLS[state.control]}, seen by ${sensors().map(label).join(", ") || "no sensor"}. ${energy}`;
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
    const shares = Object.entries(axis().modes).map(([name, pole]) => {
      const [a, b] = core.band(pole, state.duration), n = 200, low = Math.max(a, 1e-6);
      const omegas = Array.from({ length: n + 1 }, (_, i) => low + (b - low) * i / n), d = core.spectrum(result.u, result.dt, omegas);
      let sum = 0;
      for (let i = 0; i < n; i++) sum += (d[i] + d[i + 1]) / 2 * (b - low) / n;
      return `${short(name)} ${sig(100 * sum / total, 2)}\u00a0%`;
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
    window.studio = { u: [...result.u], errors: rows, scenario: scenario(), plan: plan(), suite: suiteText() }; // for those who want the numbers
    later(result.u);
  }

  // What the figures are worth if the model is wrong takes a moment: it waits until nothing moves any more.
  let soon = null;
  function later(u) {
    clearTimeout(soon);
    soon = setTimeout(() => {
      const ranges = elsewhere(u);
      $("errors").querySelectorAll("tbody tr").forEach((row) => {
        const range = ranges.get(row.querySelector("th").textContent);
        if (range) row.querySelector(".range").textContent = `${percent(range[0]).replace(" %", "")} to ${percent(range[1])}`;
      });
      window.studio.ranges = Object.fromEntries(ranges);
    }, 250);
  }

  let waiting = false;
  function changed(controls, keepAddress = true) {
    settle();
    remember();
    if (controls) showControls(); else { $("duration").value = state.duration; $("step").value = state.step; $("amplitude").value = state.amplitude; $("high").value = state.high; showValues(); }
    if (keepAddress) write();
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
    showUndo();
  }

  // --- scenario, plan and suite as files -------------------------------------------------------------------------------

  // Edited sensors, and those of another aircraft that sample at a rate that suits this one, go into a file of their own.
  const ownSuite = () => Object.keys(state.edits).length > 0 || aircraft().borrowed.includes(state.suite);
  const suiteName = () => (ownSuite() ? "studio_suite" : state.suite);

  // The suite's text with the figures that were edited; noise and quantisation keep their ratio.
  function suiteText() {
    const given = new Map(axis().suites[state.suite].sensors.map((s) => [s.channel, s]));
    return aircraft().texts[state.suite].split("\n[[sensor]]\n").map((block) => {
      const channel = /^channel = "(.*)"$/m.exec(block)?.[1], edit = state.edits[channel];
      if (!edit || !given.has(channel)) return block;
      const factor = edit[0] / given.get(channel).sigma;
      return block
        .replace(/^(noise_std|quantum) = (.*)$/gm, (_, key, value) => `${key} = ${Number(value) * factor}`)
        .replace(/^lag_s = .*$/m, `lag_s = ${edit[1]}`)
        .replace(/^delay_s = .*$/m, `delay_s = ${edit[2]}`)
        .replace(/^source = "/m, 'source = "noise, lag and delay edited in the studio; before: ');
    }).join("\n[[sensor]]\n");
  }

  const float = (v) => (Number.isInteger(v) ? v.toFixed(1) : String(v));
  const amplitudeOf = (control, value) => (control === "thr" ? `amplitude_percent = ${value.toFixed(2)}` : `amplitude_deg = ${value.toFixed(2)}`);

  function input() {
    const s = state;
    const keys = {
      step: [], pulse: [`width_s = ${s.step.toFixed(3)}`], doublet: [`period_s = ${(2 * s.step).toFixed(3)}`],
      sweep: [`f_start_hz = ${s.low.toFixed(3)}`, `f_end_hz = ${s.high.toFixed(3)}`, `sweep_s = ${s.period.toFixed(3)}`],
      multisine: [`f_min_hz = ${(0.9 / s.period).toFixed(6)}`, `f_max_hz = ${((s.lines + 0.1) / s.period).toFixed(6)}`, `period_s = ${s.period.toFixed(3)}`],
    }[s.family] ?? [`step_s = ${s.step.toFixed(3)}`];
    return ["[[manoeuvre.input]]", `signal = "${s.family}"`, `control = "${s.control}"`, amplitudeOf(s.control, s.amplitude), `start_s = ${START.toFixed(1)}`, ...keys];
  }

  const predicted = () => errorsOf(analysis()).map((r) => `#   ${r.name}: ${percent(r.relative)}`);
  const toml = (text) => JSON.stringify(String(text)).replace(/\u007f/g, "\\u007f");

  function plan() {
    const s = state;
    const head = aircraft().plan
      .replace(/^speeds_m_s = .*$/m, `speeds_m_s = [${float(Number(s.V))}]`)
      .replace(/^suite = .*$/m, `suite = ${toml(suiteName())}`);
    return [
      head.trimEnd(), "",
      "# Made in the studio. Predicted standard errors of one run, still air, offsets unknown:",
      ...predicted(),
      "[[manoeuvre]]", `name = ${toml(`${CONTROLS[s.control]} ${CALLED[s.family]}`)}`,
      `duration_s = ${s.duration.toFixed(1)}`, "settle_s = 2.0", "repeats = 3",
      ...input(),
    ].join("\n") + "\n";
  }

  function scenario() {
    const s = state, seen = sensors(), judge = Math.min(s.amplitude, s.control === "thr" ? 10 : 2);
    const rates = new Set(suite().sensors.map((x) => x.every));
    const estimator = rates.size > 1
      ? ['method = "transfer_function"', "poles = 4", "zeros = [0, 1, 2, 3]"]
      : ['method = "dsr_e"', "order = 5", "past_horizon = 40", "future_horizon = 40"];
    return [
      "# Made in the studio. Predicted standard errors, one flight, offsets unknown:",
      ...predicted(),
      `title = ${toml(`Studio: ${words().replace("°", " deg")}`)}`,
      `aircraft = ${toml(aircraft().name)}`,
      "seed = 1",
      `suites = [${toml(suiteName())}]`,
      "",
      "[condition]",
      `V_m_s = ${Number(s.V).toFixed(2)}`,
      `h_m = ${aircraft().h_m.toFixed(1)}`,
      "",
      "[simulation]",
      `log_rate_hz = ${suite().rate_hz.toFixed(1)}`,
      "",
      "[[manoeuvre]]",
      'name = "studio"',
      'use = "identification"',
      `duration_s = ${s.duration.toFixed(1)}`,
      ...input(),
      "",
      "[[manoeuvre]]",
      'name = "doublet to judge"',
      'use = "validation"',
      "duration_s = 10.0",
      "[[manoeuvre.input]]",
      'signal = "doublet"',
      `control = "${s.control}"`,
      amplitudeOf(s.control, judge),
      "start_s = 1.0",
      "period_s = 2.0",
      "",
      "[identification]",
      `inputs = ["${suite().input}"]`,
      `outputs = [${seen.map((c) => `"${c}"`).join(", ")}]`,
      "[[identification.estimators]]",
      ...estimator,
    ].join("\n") + "\n";
  }

  read();
  settle();
  listen();
  changed(true);
})();
