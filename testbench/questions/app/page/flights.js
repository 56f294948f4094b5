// Flights: logs come in, their timeline, channels laid over each other, spectra, settings that differ, and the replay.
// The address holds which records (r), which channels (c), what is at 0 s (z), what is in sight (from, to), and the page of
// what was identified from it (v).
const flight = { met: new Map(), cuts: null, shown: [], replay: null };
const CUTS = 0.5; // s, the least that a cut may last

async function take(files, path, identify) {
  const logs = path ? [path.startsWith("-") ? `./${path}` : path] : [];
  for (const file of files) {
    const kept = await send(`logs/${encodeURIComponent(file.name)}`, file, part => say(`${file.name}: ${Math.round(100 * part)} % sent`));
    logs.push(kept.log);
  }
  if (!logs.length) throw new Error("a log must be dropped, chosen or named first");
  if (identify) {
    const end = await ask(["identify", ...logs, "--out", "results"]);
    const whole = `results/${logs[0].split("/").pop().replace(/\.[^.]*$/, "")}/whole.nc`, there = logs.length === 1 && (await listed("records")).some(r => r.path === whole);
    return end.pages[0] && (there ? go("flights", { r: [whole], v: end.pages[0] }) : open(end.pages[0]));
  }
  const stem = log => log.split("/").pop().replace(/\.[^.]*$/, "").replace(/[^\w.-]+/g, "_");
  const found = [];
  for (const log of logs) { // one after the other: each takes a core
    const end = await ask(["import", log, "--out", `results/${stem(log)}_log`]);
    const template = end.printed.match(/--describe (\S+\.toml)/);
    if (end.status && template) at("said").append(" ", press("Describe it", () => describe(log, template[1]).catch(failed), "main"));
    if (!end.status) found.push(`results/${stem(log)}_log/whole.nc`);
  }
  if (found.length) { say(""); flight.met.clear(); go("flights", { r: found }); }
}
async function describe(log, file) { // a table without names gets a file that says which column is what
  const end = await ask(["import", log, "--describe", file]);
  if (!end.status) await edit(file);
}
at("look").addEventListener("click", () => take([], at("file").textContent, false).catch(failed));
at("drop").addEventListener("submit", event => {
  event.preventDefault();
  take(at("files").files, at("path").value.trim(), event.submitter?.value === "identify").catch(failed);
});
addEventListener("dragover", event => { event.preventDefault(); document.body.classList.add("over"); });
addEventListener("dragleave", event => { if (!event.relatedTarget) document.body.classList.remove("over"); });
addEventListener("drop", event => {
  event.preventDefault();
  document.body.classList.remove("over");
  take(event.dataTransfer.files, "", false).catch(failed);
});

const wanted = () => {
  const values = place()[1];
  const number = key => values.has(key) && Number.isFinite(+values.get(key)) ? +values.get(key) : null;
  const sight = flight.moving ?? [number("from"), number("to")]; // the address follows a pan when it rests
  return { r: values.getAll("r"), c: values.getAll("c"), z: values.get("z") ?? "log", v: values.get("v"), from: sight[0], to: sight[1], page: values.get("page") };
};
function change(values, keep) {
  const next = { ...wanted(), ...values };
  if ("from" in values) { clearTimeout(flight.later); flight.moving = null; }
  go("flights", next, keep);
}

views.set("flights", async () => {
  const want = wanted();
  await choices(want.r);
  if (!want.r.length) { at("flight").replaceChildren(); return; }
  const first = !flight.met.size;
  for (const r of want.r) if (!flight.met.has(r)) flight.met.set(r, await show("record", { record: r }));
  const same = String(flight.shown) === String(want.r);
  flight.shown = want.r;
  if (!same || first || !at("plot")) head(want.r.map(r => flight.met.get(r)));
  await plot();
  if (want.v) await digest(at("verdict"), want.v, () => change({ v: null })); else at("verdict").replaceChildren();
});

async function choices(chosen) {
  const all = await listed("records"), groups = Map.groupBy ? Map.groupBy(all, r => r.of) : all.reduce((m, r) => m.set(r.of, [...(m.get(r.of) ?? []), r]), new Map());
  const focus = document.activeElement?.value;
  at("records").replaceChildren(...[...groups].map(([of, records]) => make("div", {}, make("h2", {}, of.replace(/^results\//, "").replace(/_log$/, "")), ...records.map(r => {
    const box = make("input", { type: "checkbox", value: r.path, checked: chosen.includes(r.path) });
    return make("label", {}, box, r.name === "whole" ? "whole log" : r.name);
  }))));
  if (focus) [...at("records").querySelectorAll("input")].find(b => b.value === focus)?.focus();
  if (!all.length) at("records").append(make("p", { className: "hint" }, "None yet. Drop a log: ULog, DataFlash, a table or a MAT file."));
}
at("records").addEventListener("change", event => {
  const { r } = wanted(), path = event.target.value;
  change({ r: event.target.checked ? [...r, path] : r.filter(p => p !== path), from: null, to: null });
});

function head(met) {
  const main = met[0], several = met.length > 1, box = at("flight");
  flight.cuts = null; flight.replay = null;
  const channels = new Map(met.flatMap(m => m.channels).map(c => [c.name, c.label]));
  box.replaceChildren();
  box.append(make("h2", {}, met.map(m => m.name).join(" · ")));
  box.append(make("p", { className: "hint" }, met.map(m => `${told(m.end_s - m.begin_s)} s at ${told(m.rate_hz)} Hz${m.log.format ? `, ${m.log.format}` : ""}`).join(" · ")));
  if (!several && main.log.stretches) timeline(main, box);
  if (!several && main.log.stretches) questions(main, box);
  const chips = make("div", { className: "chips", role: "group", ariaLabel: "Channels" });
  for (const [name, label] of channels) {
    const b = press(label.split(",")[0], () => {
      const have = picked(), next = have.includes(name) ? have.filter(n => n !== name) : [...channels.keys()].filter(n => n === name || have.includes(n));
      change({ c: next.length ? next : [name] });
    });
    b.dataset.channel = name; b.title = label; chips.append(b);
  }
  const row = make("div", { className: "row" });
  if (several) {
    const align = make("select", {}, ...[["log", "the start of each record"], ["flight", "take-off"], ["manoeuvre", "the first manoeuvre"]].map(([v, t]) => new Option(t, v, false, v === wanted().z)));
    align.onchange = () => change({ z: align.value, from: null, to: null });
    row.append(make("label", {}, "0 s is ", align));
    if (met.filter(m => m.settings).length > 1) row.append(press("Settings that differ", () => settings(met).catch(failed)));
  }
  const control = make("select", {}, ...met[0].controls.map(n => new Option(channels.get(n).split(",")[0], n)));
  row.append(press("Spectra of the visible part", () => spectra(control.value).catch(failed)));
  if (control.options.length) row.append(make("label", {}, "coherence with ", control));
  row.append(press("Replay in 3D", () => replay(main).catch(failed)));
  const report = main.folder && main.log.format ? `${main.folder}/report.html` : "";
  if (report) row.append(press("Contents of the log", () => open(report)));
  box.append(chips, make("div", { id: "plot" }), row, make("div", { id: "spectra" }), make("div", { id: "replay" }), make("div", { id: "settings" }), make("div", { id: "verdict" }));
}
const picked = () => {
  const met = flight.shown.map(r => flight.met.get(r)), c = wanted().c.filter(n => met.some(m => m.channels.some(k => k.name === n)));
  return c.length ? c : met[0].first;
};

let asked = 0;
async function plot() {
  const c = picked(), { r, z } = wanted(), mine = ++asked;
  for (const b of at("flight").querySelectorAll("[data-channel]")) b.setAttribute("aria-pressed", String(c.includes(b.dataset.channel)));
  const key = JSON.stringify([r, c, z, flight.met.get(r[0])?.log.manoeuvres]);
  if (at("plot").dataset.key === key) return aim();
  const json = await show("channels", { records: r, channels: c, align: z });
  if (mine !== asked) return;
  at("plot").dataset.key = key;
  const [fig, explorer] = figure(at("plot"), json);
  at("plot").classList.toggle("alone", r.length === 1);
  const { from, to } = wanted();
  let before = from != null && to != null ? [from, to] : null;
  fig.addEventListener("range", event => {
    if (flight.explorer !== explorer) return;
    flight.range = event.detail; sight();
    const same = String(before) === String(explorer.range); // a first drawing that comes late moves nothing
    before = explorer.range;
    if (same) return;
    flight.moving = explorer.range == null ? [null, null] : event.detail.map(v => +v.toFixed(3));
    clearTimeout(flight.later);
    flight.later = setTimeout(() => { if (place()[0] === "flights") change({}, true); flight.moving = null; }, 300); // it stays after a reload
  });
  fig.addEventListener("cursor", event => {
    if (at("cursor")) at("cursor").style.left = `${share(event.detail)}%`;
    if (flight.replay && !flight.replay.playing) flight.replay.at(event.detail);
  });
  flight.explorer = explorer;
  explorer.range = before;
  flight.range = explorer.range ?? [flight.met.get(r[0]).begin_s, flight.met.get(r[0]).end_s];
  sight();
}

function aim() { // show what the address says, as after a step back
  const { from, to } = wanted(), now = flight.explorer.range;
  if (from == null || to == null) { if (now) flight.explorer.whole(); } else if (!now || Math.abs(now[0] - from) + Math.abs(now[1] - to) > 2e-3) flight.explorer.show(from, to);
}

// --- the timeline -----------------------------------------------------------------------------------------------------

const share = x => { const m = flight.met.get(flight.shown[0]); return Math.max(0, Math.min(100, 100 * (x - m.begin_s) / (m.end_s - m.begin_s || 1))); };
function sight() {
  if (!at("window") || !flight.range) return;
  const [a, b] = flight.range.map(share);
  at("window").style.left = `${a}%`; at("window").style.width = `${Math.max(0.3, b - a)}%`;
}
function timeline(m, box) {
  const line = make("div", { className: "timeline", id: "timeline", role: "group", ariaLabel: "Timeline: kinds of flight, and manoeuvres that are cut out" });
  for (const s of m.log.stretches) {
    const b = press(s.kind, () => change({ from: s.start_s, to: s.end_s }), `stretch${s.flown ? " flown" : ""}`);
    b.style.left = `${share(s.start_s)}%`; b.style.width = `${share(s.end_s) - share(s.start_s)}%`;
    b.title = `${s.kind}, ${told(s.start_s)} to ${told(s.end_s)} s${s.mode ? `, ${s.mode}` : ""}${s.why ? `: ${s.why}` : ""}`;
    b.setAttribute("aria-label", b.title);
    line.append(b);
  }
  line.append(make("div", { className: "window", id: "window" }), make("div", { className: "cursor", id: "cursor" }));
  const row = make("div", { className: "row", id: "cuts" });
  box.append(line, row);
  flight.cuts = m.log.manoeuvres.filter(c => c.cut_s).map(c => [...c.cut_s]);
  const off = m.log.manoeuvres.filter(c => !c.cut_s);
  cuts(m, line, row, off, false);
}
function cuts(m, line, row, off, changed) {
  const focus = document.activeElement?.dataset?.edge;
  for (const e of line.querySelectorAll(".cut, .edge")) e.remove();
  for (const c of off) {
    const e = make("div", { className: "cut off", title: `${c.controls.join(", ")} moves: ${c.reason}` });
    e.style.left = `${share(c.start_s)}%`; e.style.width = `${share(c.end_s) - share(c.start_s)}%`;
    line.append(e);
  }
  const again = () => cuts(m, line, row, off, true);
  const held = (k, side, by) => { // move an edge, or with side 2 all of a cut, by so many seconds
    const c = flight.cuts[k];
    const room = side === 2 ? [m.begin_s - c[0], m.end_s - c[1]] : side ? [c[0] + CUTS - c[1], m.end_s - c[1]] : [m.begin_s - c[0], c[1] - CUTS - c[0]];
    by = Math.min(room[1], Math.max(room[0], by));
    if (side !== 1) c[0] += by;
    if (side !== 0) c[1] += by;
    again();
  };
  const drag = (e, k, side) => e.addEventListener("pointerdown", event => {
    event.preventDefault();
    let last = event.clientX;
    const move = to => { const by = (to.clientX - last) / line.clientWidth * (m.end_s - m.begin_s); last = to.clientX; held(k, side, by); };
    addEventListener("pointermove", move);
    addEventListener("pointerup", () => removeEventListener("pointermove", move), { once: true });
  });
  const keys = (e, k, side) => e.addEventListener("keydown", event => {
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (way) held(k, side, way * (event.shiftKey ? 1 : 0.1));
    else if (event.key === "Delete" || event.key === "Backspace") { flight.cuts.splice(k, 1); again(); }
    else if (event.key === "Enter") change({ from: flight.cuts[k][0], to: flight.cuts[k][1] });
    else return;
    event.preventDefault();
  });
  flight.cuts.forEach((c, k) => {
    const body = make("div", { className: "cut", tabIndex: 0, role: "button", title: `cut ${k + 1}: ${c[0].toFixed(2)} to ${c[1].toFixed(2)} s; drag or arrows move it, Delete takes it away, Enter shows it` }, String(k + 1));
    body.setAttribute("aria-label", body.title); body.dataset.edge = `${k} 2`;
    body.style.left = `${share(c[0])}%`; body.style.width = `${share(c[1]) - share(c[0])}%`;
    body.addEventListener("dblclick", () => change({ from: c[0], to: c[1] }));
    drag(body, k, 2); keys(body, k, 2); line.append(body);
    [0, 1].forEach(side => {
      const edge = make("div", { className: "edge", tabIndex: 0, role: "slider" });
      const values = { label: `${side ? "end" : "start"} of cut ${k + 1}, s`, valuemin: m.begin_s, valuemax: m.end_s, valuenow: c[side].toFixed(2) };
      for (const [name, value] of Object.entries(values)) edge.setAttribute(`aria-${name}`, value);
      edge.dataset.edge = `${k} ${side}`; edge.style.left = `${share(c[side])}%`;
      drag(edge, k, side); keys(edge, k, side); line.append(edge);
    });
  });
  if (focus) line.querySelector(`[data-edge="${focus}"]`)?.focus();
  const base = without(m.command, "--cut"), words = [...base, ...flight.cuts.flatMap(c => ["--cut", `${+c[0].toFixed(3)}:${+c[1].toFixed(3)}`])];
  row.replaceChildren(press("Cut the visible part", () => { if (flight.range) { flight.cuts.push([...flight.range].map((v, i) => i ? Math.min(v, m.end_s) : Math.max(v, m.begin_s))); flight.cuts.sort((a, b) => a[0] - b[0]); again(); } }));
  if (changed && base[0] === "import" && flight.cuts.length) row.append(press("Apply these cuts", () => redo(words), "main"), make("code", { className: "hint" }, `testbench ${shell(words)}`));
  if (changed) row.append(press("As found", () => { flight.cuts = m.log.manoeuvres.filter(c => c.cut_s).map(c => [...c.cut_s]); cuts(m, line, row, off, false); }));
  const structure = make("select", {}, new Option("structure as described", ""), new Option("let the records choose", "--choose"));
  structure.setAttribute("aria-label", "Structure of the model");
  if (!changed && m.descriptions.some(d => d.chooses)) row.append(structure);
  if (!changed) for (const { name: d, chooses } of m.descriptions) row.append(press(`Edit ${d.replace(/\.toml$/, "").split("_").pop()}`, () => edit(`${m.folder}/${d}`).catch(failed)), press(`Identify ${d.replace(/\.toml$/, "").split("_").pop()}`, async () => {
    const end = await ask(["identify", `${m.folder}/${d}`, ...chooses && structure.value ? [structure.value] : [], "--out", "results"]).catch(failed);
    if (end?.pages[0]) { at("verdict").dataset.page = ""; change({ v: end.pages[0] }); at("verdict").scrollIntoView({ behavior: "smooth" }); }
  }, "main"));
  sight();
}
const without = (words, option) => words.filter((w, k) => w !== option && words[k - 1] !== option);
async function redo(words) { // the same import with other options: the flight is shown anew
  try {
    const end = await ask(words);
    if (end.status) return;
    flight.met.clear(); flight.shown = [];
    turn();
  } catch (error) { failed(error); }
}
function questions(m, box) {
  if (!m.log.questions.length) return;
  const asks = make("div", { className: "asks" });
  for (const q of m.log.questions) {
    const row = make("p", {}, q.asks, " ");
    for (const words of q.answers) row.append(press(words.join(" "), () => redo([...m.command, ...words]), "main"), " ");
    row.append(press("It is as read", () => { row.remove(); if (!asks.children.length) asks.remove(); }));
    asks.append(row);
  }
  box.append(asks);
}

// --- below the plot ---------------------------------------------------------------------------------------------------

async function spectra(control) {
  const [begin_s, end_s] = flight.explorer?.range ?? [null, null];
  const json = await show("spectra", { records: wanted().r, channels: picked(), control, begin_s, end_s });
  figure(at("spectra"), json);
}
async function replay(m) {
  const motion = await show("motion", { record: m.path });
  flight.replay = new Replay(motion, time => flight.explorer?.cursorAt(time));
  at("replay").replaceChildren(flight.replay.box);
  flight.replay.at(flight.range?.[0] ?? m.begin_s);
}
async function settings(met) {
  const logs = met.filter(m => m.settings), found = await show("settings", { records: logs.map(m => m.path) });
  const both = found.rows.filter(r => r[1] != null && r[2] != null), alone = found.rows.filter(r => r[1] == null || r[2] == null);
  const part = (rows, words) => rows.length ? [make("p", {}, `${rows.length} ${words}`), make("div", { className: "scroll tall", tabIndex: 0, role: "region", ariaLabel: words }, make("table", {},
    make("thead", {}, make("tr", {}, ...["setting", ...found.names].map(t => make("th", { scope: "col" }, t)))),
    make("tbody", {}, ...rows.map(([name, a, b]) => make("tr", {}, make("th", { scope: "row" }, name), make("td", { className: "number" }, told(a)), make("td", { className: "number" }, told(b)))))))] : [];
  at("settings").replaceChildren(make("h2", {}, "Settings of the autopilot"), make("p", {}, `${found.equal} are equal in both.`), ...part(both, "differ"), ...part(alone, "stand in one log only"));
}

listed("jobs").then(found => { for (const job of found) follow(job); }).catch(failed);
addEventListener("hashchange", turn);
addEventListener("popstate", turn);
