// Design: an input drawn by hand, what it does and tells while it is dragged, the whole question, and from its answer a
// plan with cards. All numbers are the server's. The address holds the design (of, or aircraft, control, suite, V), the
// record's length (T), how many aircraft are drawn (d), and the input (i).
const design = { key: "", met: null, entries: [], busy: false, wanted: null, explorers: {}, most: 0, rest: 0 };
const PATTERNS = { pulse: [1], doublet: [1, -1], 3211: [3, -2, 1, -1], 211: [2, -1, 1], 123: [1, -2, 3] };
const SIGNALS = [["doublet", "doublet"], ["3211", "3-2-1-1"], ["211", "2-1-1"], ["123", "1-2-3"], ["pulse", "pulse"], ["multistep", "multistep"], ["sweep", "sweep"], ["multisine", "multisine"]];
const FIELDS = { // of each signal: key, words, step of its field
  pulse: [["width_s", "width, s"]], doublet: [["period_s", "period, s"]], 3211: [["step_s", "step, s"]], 211: [["step_s", "step, s"]], 123: [["step_s", "step, s"]],
  multistep: [], sweep: [["f_start_hz", "from, Hz"], ["f_end_hz", "to, Hz"], ["sweep_s", "for, s"]], multisine: [["f_min_hz", "from, Hz"], ["f_max_hz", "to, Hz"], ["period_s", "period, s"]],
};
const SHORTEST = 0.02; // s

const amplitudeKey = entry => entry.control === "thr" ? "amplitude_percent" : "amplitude_deg";
const tidy = (v, digits) => +v.toFixed(digits);
const steps = entry => entry.signal === "multistep" ? entry.pattern.map(p => p * entry.step_s)
  : (PATTERNS[entry.signal] ?? []).map(p => p * ({ pulse: entry.width_s, doublet: entry.period_s / 2 }[entry.signal] ?? entry.step_s));
function setStep(entry, k, seconds) { // the k-th step lasts so long; what a signal shares among its steps goes along
  const d = tidy(Math.max(SHORTEST, seconds), 2);
  if (entry.signal === "multistep") entry.pattern[k] = tidy(Math.sign(entry.pattern[k]) * d / entry.step_s, 4);
  else if (entry.signal === "pulse") entry.width_s = d;
  else if (entry.signal === "doublet") entry.period_s = tidy(2 * d, 2);
  else entry.step_s = tidy(Math.max(SHORTEST, d / Math.abs(PATTERNS[entry.signal][k])), 3);
}
function signal(entry, kind) { // the same control and amplitude with another signal, about as long
  const had = steps(entry), lasts = had.reduce((a, d) => a + Math.abs(d), 0) || design.met.duration_s / 4, left = design.met.duration_s - design.met.start_s;
  const next = { signal: kind, control: entry.control, start_s: entry.start_s ?? 0, [amplitudeKey(entry)]: entry[amplitudeKey(entry)] };
  const unit = (PATTERNS[kind] ?? []).reduce((a, d) => a + Math.abs(d), 0);
  if (kind === "multistep") Object.assign(next, { step_s: 1, pattern: (had.length ? had : [0.5, -0.5]).map(d => tidy(d, 3)) });
  else if (kind === "pulse") next.width_s = tidy(lasts / 2, 2);
  else if (kind === "doublet") next.period_s = tidy(lasts, 2);
  else if (unit) next.step_s = tidy(lasts / unit, 3);
  else if (kind === "sweep") Object.assign(next, { f_start_hz: 0.2, f_end_hz: 2, sweep_s: tidy(left - next.start_s, 2) });
  else Object.assign(next, { f_min_hz: 0.2, f_max_hz: 2, period_s: tidy(left - next.start_s, 2) });
  return next;
}

// --- which design -----------------------------------------------------------------------------------------------------

const posed = values => {
  const given = {}, words = { of: "of", aircraft: "aircraft", control: "control", suite: "suite" };
  for (const [key, name] of Object.entries(words)) if (values.get(key)) given[name] = values.get(key);
  for (const [key, name] of [["V", "V_m_s"], ["T", "duration_s"]]) if (Number.isFinite(parseFloat(values.get(key)))) given[name] = +values.get(key);
  return given;
};
const address = () => Object.fromEntries(place()[1]);
function renew(values) { go("design", { ...address(), ...values }, true); }

views.set("design", async values => {
  const there = await listed("designs"), given = posed(values), fresh = !given.of;
  at("design").replaceChildren(new Option("a new one of an aircraft", ""), ...there.designs.map(d => new Option(`${d.of}${d.title ? `: ${d.title}` : ""}`, d.of, false, d.of === given.of)));
  for (const [id, list, chosen] of [["aircraft", there.aircraft, given.aircraft], ["suite", ["", ...there.suites], given.suite]]) {
    const known = chosen && !list.includes(chosen) ? [chosen, ...list] : list;
    at(id).replaceChildren(...known.map(n => new Option(n || "a suite that fits", n, false, n === chosen)));
  }
  if (given.control) at("control").value = given.control;
  if (given.V_m_s) at("speed").value = given.V_m_s;
  at("new-design").hidden = !fresh;
  if (fresh && !given.aircraft) { at("drawn").replaceChildren(make("p", { className: "hint" }, "Choose a design, or an aircraft and its control.")); design.key = ""; return; }
  const key = JSON.stringify(given);
  if (key === design.key) { ours(values); return; }
  say("trim and linearise …");
  const met = await show("design", given);
  say("");
  Object.assign(design, { key, given, met, drawn: null });
  design.entries = met.input;
  ours(values);
});
at("design").addEventListener("change", () => go("design", at("design").value ? { of: at("design").value } : {}));
at("draw").addEventListener("click", () => go("design", { aircraft: at("aircraft").value, control: at("control").value, suite: at("suite").value, V: at("speed").value }));

function ours(values) { // the input of the address, or that of the design
  if (values.get("i")) { try { design.entries = JSON.parse(values.get("i")); } catch { /* it begins anew */ } }
  board();
  if (values.get("v")) digest(at("design-answer"), values.get("v"), () => renew({ v: "" })).catch(failed);
}

// --- the board that is drawn on ---------------------------------------------------------------------------------------

function board() {
  const { met } = design, box = at("drawn");
  design.explorers = {}; design.scale = null;
  const surface = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  surface.classList.add("surface"); surface.setAttribute("role", "group"); surface.setAttribute("aria-label", "The input over time; its steps and amplitude are dragged, or moved by the arrow keys");
  surface.id = "surface";
  const several = make("button", { type: "button", id: "over" }, `Over ${met.draws} drawn aircraft`);
  several.setAttribute("aria-pressed", String(Boolean(place()[1].get("d"))));
  several.addEventListener("click", () => { const on = !place()[1].get("d"); renew({ d: on ? met.draws : "" }); several.setAttribute("aria-pressed", String(on)); compute(true); });
  box.replaceChildren(
    make("h2", {}, met.title),
    make("p", { className: "hint" }, `${met.aircraft}, ${told(met.V_m_s)} m/s at ${told(met.h_m)} m, seen by ${met.suite}. The first ${told(met.start_s)} s of ${told(met.duration_s)} s are undisturbed.`),
    make("div", { className: "row values", id: "values" }), surface,
    make("p", { id: "verdict-input" }),
    make("div", { className: "row" }, press("Run the full design", () => whole(true).catch(failed), "main"), press("Search for the best", () => whole(false).catch(failed)), several, make("code", { className: "hint", id: "design-command" })),
    make("div", { id: "design-answer" }),
    make("div", { className: "pair" }, make("div", { id: "errors-drawn" }), make("div", { id: "limits-drawn" })),
    make("div", { className: "pair" }, make("div", { id: "response-drawn" }), make("div", { id: "spectrum-drawn" })));
  at("verdict-input").setAttribute("role", "status");
  fields();
  new ResizeObserver(() => draw()).observe(surface);
  compute(true);
}
function fields() {
  const row = at("values"), { met, entries } = design, focus = document.activeElement?.id;
  row.replaceChildren();
  const field = (id, words, value, act, step = "any", min = "") => {
    const input = make("input", { type: "number", id, value: tidy(value, 4), step, min });
    input.onchange = () => { if (Number.isFinite(input.valueAsNumber)) act(input.valueAsNumber); changed(); };
    const label = make("label", {}, words); label.htmlFor = id;
    row.append(make("span", {}, label, " ", input));
  };
  entries.forEach((entry, n) => {
    const own = n ? `-${n}` : "", control = met.controls.find(c => c.name === entry.control);
    const kind = make("select", { id: `signal${own}` }, ...SIGNALS.map(([v, t]) => new Option(t, v, false, v === entry.signal)));
    if (!SIGNALS.some(([v]) => v === entry.signal)) kind.append(new Option(entry.signal, entry.signal, true, true));
    kind.setAttribute("aria-label", `signal${own}`);
    kind.onchange = () => { entries[n] = signal(entry, kind.value); changed(); };
    row.append(kind);
    if (met.controls.length > 1) {
      const which = make("select", {}, ...met.controls.map(c => new Option(c.label, c.name, false, c.name === entry.control)));
      which.setAttribute("aria-label", `control${own}`);
      which.onchange = () => { const before = amplitudeKey(entry), a = entry[before]; delete entry[before]; entry.control = which.value; entry[amplitudeKey(entry)] = a; changed(); };
      row.append(which);
    }
    field(`amplitude${own}`, `${control.label}, ${control.unit}`, entry[amplitudeKey(entry)], v => { entry[amplitudeKey(entry)] = v; }, "0.1");
    field(`start${own}`, "from, s", entry.start_s ?? 0, v => { entry.start_s = Math.max(0, v); }, "0.1", 0);
    for (const [key, words] of FIELDS[entry.signal] ?? []) field(`${key}${own}`, words, entry[key], v => { entry[key] = Math.max(SHORTEST, v); }, "0.05", SHORTEST);
    if (entry.signal === "multistep") {
      entry.pattern.forEach((p, k) => field(`step${own}-${k}`, `step ${k + 1}, s`, p * entry.step_s, v => { if (v) entry.pattern[k] = v / entry.step_s; }, "0.05"));
      row.append(press("+ step", () => { entry.pattern.push(tidy(-entry.pattern.at(-1), 4)); changed(); }));
      if (entry.pattern.length > 1) row.append(press("− step", () => { entry.pattern.pop(); changed(); }));
    }
  });
  field("record", "record, s", met.duration_s, v => { if (v > met.start_s) go("design", { ...address(), T: v, i: JSON.stringify(entries) }); }, "1", 1);
  if (met.controls.length > entries.length) row.append(press("+ signal", () => { const c = met.controls.find(m => !entries.some(e => e.control === m.name)) ?? met.controls[0], e = { signal: "doublet", control: c.name, start_s: 0, period_s: 1 }; e[amplitudeKey(e)] = tidy(c.most / 4, 1); entries.push(e); changed(); }));
  if (entries.length > 1) row.append(press("− signal", () => { entries.pop(); changed(); }));
  if (focus) at(focus)?.focus();
}
function changed(dragged) { // the input is another: it is drawn, computed, and kept in the address
  if (!dragged) fields();
  draw(); compute(!dragged);
}

const SIDE = { left: 46, right: 14, top: 16, bottom: 26 };
function draw() {
  const svg = at("surface"), { met, entries, found } = design, wide = svg.clientWidth, tall = svg.clientHeight;
  if (!wide) return;
  const T = met.duration_s - met.start_s, ends = entries.map(e => met.controls.find(c => c.name === e.control));
  if (!design.held) design.scale = Math.max(...entries.map((e, n) => Math.min(1.15 * ends[n].most, 2.2 * Math.abs(e[amplitudeKey(e)] || 1))), 1e-3);
  const span = design.held ? design.span : design.span = Math.min(T, Math.max(1, ...entries.map(e => 1.6 * ((e.start_s ?? 0) + steps(e).reduce((a, d) => a + Math.abs(d), 0)) || T)));
  const x = t => SIDE.left + (wide - SIDE.left - SIDE.right) * t / span, middle = (tall - SIDE.bottom + SIDE.top) / 2;
  const y = v => middle - (tall - SIDE.top - SIDE.bottom) / 2 * v / design.scale;
  const focus = document.activeElement?.dataset?.handle;
  const part = (name, set, text) => { const e = document.createElementNS("http://www.w3.org/2000/svg", name); for (const [k, v] of Object.entries(set)) e.setAttribute(k, v); if (text != null) e.textContent = text; return e; };
  const out = [part("line", { x1: SIDE.left, x2: wide - SIDE.right, y1: y(0), y2: y(0) })];
  const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find(s => span / s <= Math.max(3, wide / 90)) ?? 100;
  for (let t = 0; t <= span + 1e-9; t += step) out.push(part("line", { x1: x(t), x2: x(t), y1: SIDE.top, y2: tall - SIDE.bottom }), part("text", { x: x(t), y: tall - 8, "text-anchor": "middle" }, `${tidy(t, 2)}${t + step > span ? " s" : ""}`));
  for (const c of new Set(ends)) for (const sign of [1, -1]) if (c.most <= design.scale) out.push(part("line", { class: "limit", x1: SIDE.left, x2: wide - SIDE.right, y1: y(sign * c.most), y2: y(sign * c.most) }));
  for (const v of [design.scale / 1.15, 0, -design.scale / 1.15]) out.push(part("text", { x: SIDE.left - 6, y: y(v) + 4, "text-anchor": "end" }, told(tidy(v, 1))));
  out.push(part("text", { x: 4, y: 12 }, ends[0].unit));
  for (const [control, points] of Object.entries(found?.signal ?? {})) if (points.some(p => p[1])) out.push(part("path", { d: `M${points.filter(p => p[0] <= span + 1e-6).map(([t, v]) => `${x(t).toFixed(1)},${y(v).toFixed(1)}`).join("L")}`, "data-control": control }));
  entries.forEach((entry, n) => {
    const key = amplitudeKey(entry), from = entry.start_s ?? 0, lengths = steps(entry), unit = ends[n].unit;
    const handle = (name, words, cx, cy, value, way, move) => {
      const c = part("circle", { cx, cy, r: 8, tabindex: 0, role: "slider", class: way === "y" ? "height" : "", "data-handle": name, "aria-label": words, "aria-valuenow": tidy(value, 2), "aria-valuetext": `${tidy(value, 2)} ${way === "y" ? unit : "s"}`, "aria-orientation": way === "y" ? "vertical" : "horizontal", "aria-valuemin": way === "y" ? -ends[n].most : 0, "aria-valuemax": way === "y" ? ends[n].most : tidy(T, 2) });
      c.addEventListener("keydown", event => {
        const k = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 }[event.key];
        if (!k) return;
        event.preventDefault(); move(value + k * (way === "y" ? 0.1 : 0.05) * (event.shiftKey ? 10 : 1)); changed();
      });
      c.addEventListener("pointerdown", event => {
        event.preventDefault(); c.focus(); design.held = true;
        const box = svg.getBoundingClientRect();
        const go = e => { move(way === "y" ? (middle - (e.clientY - box.top)) / ((tall - SIDE.top - SIDE.bottom) / 2) * design.scale : (e.clientX - box.left - SIDE.left) / (wide - SIDE.left - SIDE.right) * span); changed(true); };
        const end = () => { removeEventListener("pointermove", go); design.held = false; changed(); };
        addEventListener("pointermove", go); addEventListener("pointerup", end, { once: true });
      });
      out.push(c);
    };
    const amplitude = entry[key], first = Math.abs(lengths[0] ?? Math.min(span, T) / 4) / 2, sense = Math.sign(lengths[0] ?? 1);
    const own = entries.length > 1 ? ` of signal ${n + 1}` : "";
    handle(`start ${n}`, `start${own}, s`, x(from), y(0), from, "x", v => { entry.start_s = tidy(Math.max(0, Math.min(T - SHORTEST, v)), 2); });
    let ended = from;
    lengths.forEach((d, k) => {
      const begun = ended; ended += Math.abs(d);
      handle(`step ${n} ${k}`, `end of step ${k + 1}${own}, s`, x(ended), y(0), ended, "x", v => setStep(entry, k, v - begun));
    });
    handle(`amplitude ${n}`, `amplitude${own}, ${unit}`, x(from + first), y(sense * amplitude), amplitude, "y", v => { entry[key] = tidy(Math.max(-ends[n].most, Math.min(ends[n].most, sense * v)), 1) || 0.1; });
  });
  svg.setAttribute("viewBox", `0 0 ${wide} ${tall}`);
  svg.replaceChildren(...out);
  if (focus) svg.querySelector(`[data-handle="${focus}"]`)?.focus();
}

// --- what the server says of it ---------------------------------------------------------------------------------------

// One request at a time: while one is away, only the last of those that came meanwhile is kept. Drawn aircraft take
// longer, and wait until the hand rests.
function compute(rests) {
  design.wanted = { given: design.given, input: structuredClone(design.entries), rests };
  if (!design.busy) next();
}
async function next() {
  const { given, input, rests } = design.wanted, d = +place()[1].get("d");
  design.wanted = null; design.busy = true;
  const begun = performance.now();
  try {
    const found = await show("input", { ...given, input, ...rests && d ? { draws: d } : {} });
    if (given === design.given && at("surface")) {
      found.drawn ??= null;
      Object.assign(design, { found });
      picture(found);
      at("surface").dataset.ms = String(Math.round(performance.now() - begun));
      if (rests && place()[0] === "design") renew({ i: JSON.stringify(input) });
    }
  } catch (error) { const said = at("verdict-input"); if (said) { said.textContent = error.message; said.className = "wrong"; } }
  design.busy = false;
  if (design.wanted) next();
}
function picture(found) {
  draw();
  at("verdict-input").textContent = found.answer + (found.drawn ? ` Of ${found.drawn.judged} drawn aircraft that can be judged it reaches all in ${found.drawn.reached}.` : "");
  at("verdict-input").className = found.reached ? "" : "status-warning";
  const cell = (text, kind = "number") => make("td", { className: kind }, text), head = (...words) => make("thead", {}, make("tr", {}, ...words.map((w, k) => make("th", { scope: "col", className: k ? "number" : "" }, w))));
  const meter = (share, poor) => { const i = make("i", { className: poor ? "poor" : "" }); i.style.width = `${Math.max(1, Math.min(100, share))}%`; return make("td", {}, make("div", { className: "meter" }, i)); };
  const log = r => r == null ? 100 : 50 + 25 * Math.log10(Math.max(r, 0.01)); // half: as wanted; a decade is a quarter
  const over = found.drawn, percent = (row, v) => v == null ? "not told" : `${told(+v.toPrecision(2))}${row.unit && ` ${row.unit}`}`;
  at("errors-drawn").replaceChildren(make("h2", {}, "Expected errors"), scrolled("Expected errors", make("table", {},
    head("wanted", "value", "wanted", "error", "", ...over ? ["median", "worst drawn"] : []),
    make("tbody", {}, ...found.errors.map((row, k) => make("tr", {}, make("th", { scope: "row" }, row.name), cell(told(row.value)), cell(percent(row, row.wanted)), cell(percent(row, row.error)),
      meter(log(row.error == null ? null : row.error / row.wanted), row.error == null || row.error > row.wanted), ...over ? [cell(percent(row, over.median[k])), cell(percent(row, over.worst[k]))] : []))))),
    make("p", { className: "hint" }, "Standard errors by information in the expected air; a bar of half the width is as wanted. A flight adds the nonlinearity of the aircraft and the error of the estimator: run the full design."));
  at("limits-drawn").replaceChildren(make("h2", {}, "Limits"), scrolled("Limits", make("table", {}, head("limit on", "used", ""),
    make("tbody", {}, ...found.limits.map(l => make("tr", {}, make("th", { scope: "row" }, l.name), cell(`${Math.round(100 * l.used)} %`), meter(100 * l.used, l.used > 1)))))));
  for (const name of ["response", "spectrum"]) {
    const holder = at(`${name}-drawn`);
    if (design.explorers[name]) { design.explorers[name].update(found[name]); continue; }
    const inner = make("div");
    holder.replaceChildren(make("h2", {}, name === "response" ? "Response, linearised" : "Spectrum and modes"), inner);
    design.explorers[name] = figure(inner, found[name])[1];
  }
}
const scrolled = (name, table) => make("div", { className: "scroll", tabIndex: 0, role: "region", ariaLabel: name }, table);

// --- the whole question, and a plan ----------------------------------------------------------------------------------

async function whole(own) { // the file of the design is written, and `testbench design` asked
  const given = { ...design.given, ...own ? { input: design.entries } : { input: [] } };
  const asIs = !own && design.given.of && !design.given.duration_s && !design.met.own_input;
  const words = ["design", asIs ? design.given.of : (await send("save/design", JSON.stringify(given))).file, "--out", "results"];
  at("design-command").textContent = `testbench ${shell(words)}`;
  const here = at("design-answer");
  here.replaceChildren(make("p", { className: "hint" }, "at work …"), make("a", { href: "#work" }, "its stages"));
  const end = await ask(words);
  if (!end.pages[0]) { here.replaceChildren(make("p", { className: "wrong" }, end.printed.trim().split("\n").pop())); return; }
  here.dataset.page = "";
  renew({ v: end.pages[0] });
  if (place()[0] === "design") await digest(here, end.pages[0], () => renew({ v: "" }));
}
