// A campaign or a data set while it is flown: runs as lines over parallel axes, limits and names that choose among them,
// and each run by a click. What a run is called, how many flights it has and where these lie, the server says.
const campaign = { name: "" };
const anew = name => Object.assign(campaign, { name, rows: new Map(), axes: null, limits: new Map(), named: new Map(), chosen: null, next: 0, records: {} });
const MOST_ROWS = 200, MOST_NAMES = 12; // of the table, and of what runs are counted by

views.set("campaigns", async values => {
  const names = await listed("campaigns"), of = values.get("of");
  const coming = atWork().map(j => outOf(j.words)).find(n => !names.includes(n)); // its store is not there yet
  const name = names.includes(of) ? of : of === coming && coming ? "" : names[0] ?? "";
  at("campaign").replaceChildren(...names.map(n => new Option(n.replace(/^results\//, "").replace(/^campaign_/, ""), n, false, n === name)));
  at("campaign").onchange = () => go("campaigns", { of: at("campaign").value });
  clearTimeout(campaign.timer);
  if (coming) campaign.timer = setTimeout(() => { if (place()[0] === "campaigns") listed("campaigns").then(found => found.includes(coming) ? go("campaigns", { of: coming }) : turn()).catch(failed); }, 700);
  if (!name) {
    at("runs").replaceChildren(make("p", {}, coming ? "The workers start …" : "None yet: under Work run campaign run FILE, such as campaign/taurus_scatter, or dataset FILE --out FOLDER."));
    return;
  }
  if (campaign.name !== name) anew(name);
  await look();
});
const outOf = words => { // the folder that a command flies runs into; "" if it flies none
  const given = words.map((w, k) => ["--out", "-o"].includes(w) ? words[k + 1] : w.match(/^--out=(.*)/)?.[1]).find(w => w)?.replace(/^\.\//, "").replace(/\/+$/, "");
  if (words[0] === "campaign" && ["run", "resume"].includes(words[1])) return `${given ?? "results"}/campaign_${(words[2] ?? "").split("/").pop().replace(/\.toml$/, "")}`;
  return words[0] === "dataset" && !["score", "check"].includes(words[1]) ? given ?? "" : "";
};
const atWork = () => [...jobs.entries()].map(([number, j]) => ({ number, ...j })).filter(j => j.at && outOf(j.words));
async function look() {
  const found = await show("campaign", { campaign: campaign.name, first: campaign.next ?? 0 });
  const fresh = found.rows.filter(r => !campaign.rows.has(r.run));
  for (const r of fresh) campaign.rows.set(r.run, r);
  campaign.next = found.next ?? campaign.next;
  const { total, finished, unit } = found, mine = atWork().find(j => outOf(j.words) === campaign.name);
  const failed_ = found.failed ? `, ${found.failed} ${unit === "run" ? "failed" : "attempts failed"}` : "";
  at("counts").textContent = `${finished} of ${total} ${unit}s${failed_}${mine ? pace(mine.number, finished, total, unit) : finished < total ? found.stopped ? ", stopped by its rule" : ", not at work" : ""}`;
  at("done").max = total || 1; at("done").value = finished;
  at("stop").hidden = !mine; at("resume").hidden = Boolean(mine) || finished === total || !found.command.length;
  at("sheet").hidden = !found.sheet.startsWith("results/"); at("sheet").onclick = () => open(found.sheet);
  at("stop").onclick = () => send(`stop/${mine.number}`, "").catch(failed);
  at("resume").onclick = () => { ask(resumed(found.command)).catch(failed); setTimeout(turn, 800); };
  Object.assign(campaign.records, found.records); campaign.per_run = found.per_run;
  if (fresh.length || !at("axes")) coordinates();
  if (place()[0] === "campaigns" && (mine || !found.whole)) campaign.timer = setTimeout(() => look().catch(failed), found.whole ? 1000 : 0);
}
function pace(job, finished, total, unit) {
  const now = Date.now(), from = campaign.from?.job === job ? campaign.from : campaign.from = { job, time: now, finished };
  const rate = (finished - from.finished) / ((now - from.time) / 1000);
  return rate > 0 && finished < total ? `, ${told(+rate.toPrecision(2))} ${unit}s/s, ${seconds((total - finished) / rate)} left` : "";
}

const values = (row, name) => { const v = name in row.inputs ? row.inputs[name] : row.figures[name]; return typeof v === "number" && Number.isFinite(v) ? v : null; };
const namesOf = row => row.because ? { ...row.names, "failed because": row.because } : row.names;
const inside = row => [...campaign.named].every(([of, name]) => namesOf(row)[of] === name) && [...campaign.limits].every(([name, [a, b]]) => { const v = values(row, name); return v != null && v >= a && v <= b; });
const brief = name => name.replace(/^[^:]*: /, "");

function names() {
  const count = new Map();
  for (const row of campaign.rows.values()) for (const [name, v] of [...Object.entries(row.inputs), ...Object.entries(row.figures)]) if (typeof v === "number") {
    const held = count.get(name) ?? [v, v]; count.set(name, [Math.min(held[0], v), Math.max(held[1], v)]);
  }
  return new Map([...count].filter(([, [a, b]]) => b > a));
}
function coordinates() {
  const box = at("runs"), extents = names();
  if (!extents.size) { box.replaceChildren(make("p", { className: "hint" }, "No run has finished yet.")); return; }
  const inputs = new Set([...campaign.rows.values()].flatMap(r => Object.keys(r.inputs)));
  if (!campaign.axes) {
    const own = [...extents.keys()].filter(n => inputs.has(n)), out = [...extents.keys()].filter(n => !inputs.has(n) && !/, (true|std)$|^true:/.test(n));
    campaign.axes = [...own.slice(0, 5), ...out.slice(0, 8 - Math.min(5, own.length))];
  }
  if (!at("axes")) {
    const canvas = make("canvas", { id: "lines", tabIndex: 0 });
    canvas.setAttribute("role", "img"); canvas.setAttribute("aria-label", "Runs as lines over parallel axes; limits can be set in numbers below");
    box.replaceChildren(
      make("div", { id: "named" }),
      make("p", { className: "hint" }, `${campaign.per_run > 1 ? `Counted and drawn are draws, each of ${campaign.per_run} flights. ` : ""}Drag along an axis to choose among them, click beside a limit to remove it; click a line for its results.`),
      make("div", { className: "coordinates" }, canvas),
      make("div", { className: "row", id: "axes" }),
      make("div", { className: "sides" }, make("div", { id: "detail" }, make("p", { className: "hint" }, "A line, or a button in the table, shows one here.")), make("div", {}, make("div", { className: "row", id: "cross" }), make("div", { id: "scatter" }), make("div", { className: "scroll", id: "table", tabIndex: 0, role: "region", ariaLabel: "Runs" }))),
    );
    pointer(canvas);
    new ResizeObserver(() => lines()).observe(canvas);
  }
  axes(extents); cross(extents); refresh();
}
function named() { // how many runs there are of each level, split or reason: a click chooses them, and counts those alone
  const groups = new Map(), box = at("named"), held = document.activeElement?.dataset?.named;
  for (const row of campaign.rows.values()) for (const [of, name] of Object.entries(namesOf(row))) {
    const counts = groups.get(of) ?? groups.set(of, new Map()).get(of), others = [...campaign.named].every(([key, n]) => key === of || namesOf(row)[key] === n);
    counts.set(name, (counts.get(name) ?? 0) + (others ? 1 : 0));
  }
  box.replaceChildren(...[...groups].filter(([of, counts]) => counts.size > 1 || of === "failed because").map(([of, counts]) => make("div", { className: "chips", role: "group", ariaLabel: of }, make("span", { className: "hint" }, of),
    ...[...counts].sort((a, b) => b[1] - a[1]).slice(0, MOST_NAMES).map(([name, n]) => {
      const button = press(`${name}: ${n}`, () => { if (campaign.named.get(of) === name) campaign.named.delete(of); else campaign.named.set(of, name); refresh(); });
      button.setAttribute("aria-pressed", String(campaign.named.get(of) === name)); button.dataset.named = `${of} ${name}`;
      return button;
    }))));
  if (held) [...box.querySelectorAll("button")].find(b => b.dataset.named === held)?.focus();
}
function axes(extents) {
  const row = at("axes");
  if (row.contains(document.activeElement)) return; // what is being typed stays
  row.replaceChildren();
  const add = make("select", {}, new Option("add an axis", ""), ...[...extents.keys()].filter(n => !campaign.axes.includes(n)).map(n => new Option(n, n)));
  add.setAttribute("aria-label", "Add an axis");
  add.onchange = () => { campaign.axes.push(add.value); add.blur(); coordinates(); };
  for (const name of campaign.axes) {
    const held = campaign.limits.get(name) ?? extents.get(name) ?? [0, 1], field = make("span", { className: "row" }, make("label", {}, brief(name)));
    held.forEach((v, i) => {
      const input = make("input", { type: "number", step: "any", value: +v.toPrecision(5), size: 7 });
      input.style.width = "6.5rem"; input.setAttribute("aria-label", `${i ? "most" : "least"} of ${name}`);
      input.onchange = () => { const l = [...(campaign.limits.get(name) ?? extents.get(name))]; l[i] = +input.value; campaign.limits.set(name, l); refresh(); };
      field.append(input);
    });
    field.append(press("×", () => { campaign.axes = campaign.axes.filter(n => n !== name); campaign.limits.delete(name); coordinates(); }));
    field.lastChild.setAttribute("aria-label", `take away the axis ${name}`);
    row.append(field);
  }
  row.append(add);
  if (campaign.limits.size) row.append(press("All runs", b => { campaign.limits.clear(); campaign.named.clear(); b.blur(); coordinates(); }, "main"));
}
function refresh() { named(); lines(); table(); points(); }

// --- parallel coordinates ---------------------------------------------------------------------------------------------

function layout(canvas) {
  const w = canvas.clientWidth, h = canvas.clientHeight, extents = names(), n = campaign.axes.length, pad = [Math.min(70, w * 0.09), 34, 22];
  const x = k => n < 2 ? w / 2 : pad[0] + k * (w - 2 * pad[0]) / (n - 1);
  const y = (name, v) => { const [a, b] = extents.get(name) ?? [0, 1]; return h - pad[2] - (v - a) / (b - a || 1) * (h - pad[1] - pad[2]); };
  const back = (name, py) => { const [a, b] = extents.get(name) ?? [0, 1]; return a + (h - pad[2] - py) / (h - pad[1] - pad[2]) * (b - a); };
  return { w, h, extents, x, y, back, top: pad[1], bottom: h - pad[2] };
}
function lines() {
  const canvas = at("lines");
  if (!canvas?.clientWidth) return;
  const ratio = devicePixelRatio || 1, l = layout(canvas), g = canvas.getContext("2d");
  canvas.width = l.w * ratio; canvas.height = l.h * ratio; g.scale(ratio, ratio);
  const path = row => {
    g.beginPath();
    let drawn = false;
    campaign.axes.forEach((name, k) => { const v = values(row, name); if (v == null) { drawn = false; return; } g[drawn ? "lineTo" : "moveTo"](l.x(k), l.y(name, v)); drawn = true; });
    g.stroke();
  };
  const all = [...campaign.rows.values()], chosen = all.filter(inside), [accent, wrong] = [ink("--accent"), ink("--wrong")];
  g.lineWidth = 1; g.strokeStyle = ink("--line");
  for (const row of all) if (!inside(row)) path(row);
  g.globalAlpha = Math.max(0.12, Math.min(0.8, 40 / chosen.length));
  for (const row of chosen) { g.strokeStyle = row.failed ? wrong : accent; path(row); }
  g.globalAlpha = 1;
  if (campaign.rows.has(campaign.chosen)) { g.strokeStyle = ink("--warn"); g.lineWidth = 3; path(campaign.rows.get(campaign.chosen)); }
  g.font = "12px system-ui, sans-serif"; g.fillStyle = ink("--ink");
  campaign.axes.forEach((name, k) => {
    const x = l.x(k), [a, b] = l.extents.get(name) ?? [0, 1];
    g.strokeStyle = ink("--quiet"); g.lineWidth = 1;
    g.beginPath(); g.moveTo(x, l.top); g.lineTo(x, l.bottom); g.stroke();
    const held = campaign.limits.get(name);
    if (held) { g.fillStyle = ink("--warn"); g.globalAlpha = 0.45; g.fillRect(x - 6, l.y(name, held[1]), 12, Math.max(2, l.y(name, held[0]) - l.y(name, held[1]))); g.globalAlpha = 1; g.fillStyle = ink("--ink"); }
    g.textAlign = k === 0 ? "left" : k === campaign.axes.length - 1 ? "right" : "center";
    const at = k === 0 ? 2 : k === campaign.axes.length - 1 ? l.w - 2 : x, room = (l.w / campaign.axes.length - 8) * 1.05;
    let text = brief(name);
    while (text.length > 4 && g.measureText(text).width > room) text = `${text.slice(0, -2)}…`.replace("……", "…");
    g.fillText(text, at, 13);
    g.textAlign = "center"; g.fillStyle = ink("--quiet");
    const short = v => told(l.w < 80 * campaign.axes.length ? +v.toPrecision(2) : v); // side by side on a narrow screen
    g.fillText(short(b), Math.max(24, Math.min(l.w - 24, x)), l.top - 6); g.fillText(short(a), Math.max(24, Math.min(l.w - 24, x)), l.h - 6);
    g.fillStyle = ink("--ink");
  });
}
function pointer(canvas) {
  let begun = null;
  const near = event => { const l = layout(canvas); return campaign.axes.map((name, k) => [Math.abs(l.x(k) - event.offsetX), name]).sort((a, b) => a[0] - b[0])[0]; };
  canvas.addEventListener("pointerdown", event => { const [d, name] = near(event); begun = { y: event.offsetY, x: event.offsetX, name: d < 22 ? name : null }; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", event => {
    if (!begun?.name || Math.abs(event.offsetY - begun.y) < 4) return;
    const l = layout(canvas), ends = [begun.y, event.offsetY].map(y => l.back(begun.name, Math.max(l.top, Math.min(l.bottom, y)))).sort((a, b) => a - b);
    campaign.limits.set(begun.name, ends); begun.moved = true; refresh();
  });
  canvas.addEventListener("pointerup", event => {
    if (begun?.moved) axes(names());
    else if (begun?.name && campaign.limits.delete(begun.name)) { axes(names()); refresh(); }
    else pick(event);
    begun = null;
  });
  const pick = event => { // the line that passes nearest
    const l = layout(canvas);
    let best = null, least = 9;
    for (const row of campaign.rows.values()) if (inside(row)) for (let k = 1; k < campaign.axes.length; k++) {
      const [a, b] = [k - 1, k].map(i => values(row, campaign.axes[i])), [x0, x1] = [l.x(k - 1), l.x(k)];
      if (a == null || b == null || event.offsetX < x0 || event.offsetX > x1) continue;
      const ya = l.y(campaign.axes[k - 1], a), yb = l.y(campaign.axes[k], b), d = Math.abs(ya + (yb - ya) * (event.offsetX - x0) / (x1 - x0 || 1) - event.offsetY);
      if (d < least) { least = d; best = row.run; }
    }
    choose(best);
  };
}

// --- scatter, table, one run ------------------------------------------------------------------------------------------

function cross(extents) {
  const row = at("cross");
  if (row.children.length && row.dataset.known === String(extents.size)) return;
  row.dataset.known = String(extents.size);
  const last = campaign.axes.length - 1, picks = [0, last].map(k => make("select", {}, ...[...extents.keys()].map(n => new Option(n, n, false, n === campaign.axes[k]))));
  picks.forEach((p, k) => { p.style.maxWidth = "100%"; p.setAttribute("aria-label", k ? "Upward axis of the scatter" : "Axis to the right of the scatter"); p.onchange = points; });
  row.replaceChildren(picks[1], make("span", {}, "over"), picks[0]);
  row.picks = picks;
}
function points() {
  const [across, up] = at("cross").picks.map(p => p.value), all = [...campaign.rows.values()].filter(r => values(r, across) != null && values(r, up) != null);
  const packed = v => btoa(String.fromCharCode(...new Uint8Array(Float32Array.from(v).buffer)));
  const chosen = campaign.limits.size || campaign.named.size;
  const of = (rows, name, colour, marker) => ({ rows: rows.sort((a, b) => values(a, across) - values(b, across)), name, colour, marker, width: 1.3 });
  const groups = [of(all.filter(r => !inside(r)), "others", "quiet", "+"), of(all.filter(r => inside(r) && !r.failed), chosen ? "chosen" : "runs", "#0072B2", "o"), of(all.filter(r => inside(r) && r.failed), "failed", "#CC79A7", "v"), of(all.filter(r => r.run === campaign.chosen), "this run", "#D55E00", "D")].filter(g => g.rows.length);
  const holder = at("scatter"), key = JSON.stringify([across, up, groups.map(g => g.rows.map(r => r.run))]);
  if (holder.dataset.key === key || !groups.length) return;
  holder.dataset.key = key;
  figure(holder, {
    x: groups.map(g => packed(g.rows.map(r => values(r, across)))),
    views: [{ name: "runs", plane: true, panels: [{ title: brief(up), x: brief(across), curves: groups.map((g, k) => ({ name: g.name, x: k, y: packed(g.rows.map(r => values(r, up))), colour: g.colour, width: g.width, marker: g.marker })) }] }],
  });
}
function table() {
  const chosen = [...campaign.rows.values()].filter(inside);
  const rows = chosen.slice(-MOST_ROWS).reverse().map(row => make("tr", { className: row.run === campaign.chosen ? "chosen" : "" },
    make("th", { scope: "row" }, press(row.name, () => choose(row.run))), make("td", {}, row.failed ? "failed" : "done"),
    ...campaign.axes.map(n => make("td", { className: "number" }, told(values(row, n))))));
  const heads = ["run", "state", ...campaign.axes.map(brief)].map(t => make("th", { scope: "col" }, t));
  at("table").replaceChildren(make("p", { className: "hint" }, `${chosen.length} of ${campaign.rows.size} runs${chosen.length > MOST_ROWS ? `, the last ${MOST_ROWS} shown` : ""}.`), make("table", {}, make("thead", {}, make("tr", {}, ...heads)), make("tbody", {}, ...rows)));
}
function choose(run) {
  const row = campaign.rows.get(run), box = at("detail");
  campaign.chosen = row ? run : null;
  box.replaceChildren();
  if (row) {
    const list = make("dl", { tabIndex: 0, ariaLabel: `Results of ${row.name}` }), add = (what, value) => list.append(make("dt", {}, what), make("dd", {}, value));
    if (row.seed != null) add("seed", String(row.seed));
    if (row.reason) add("why", row.reason);
    for (const [of, name] of Object.entries(row.names)) if (of !== "state") add(of, name);
    for (const [name, v] of Object.entries(row.inputs)) add(name, told(v));
    for (const [name, v] of Object.entries(row.figures)) {
      if (/, (true|std)$/.test(name)) continue;
      const [truth, std] = ["true", "std"].map(k => row.figures[`${name}, ${k}`]);
      add(name, `${told(v)}${std == null ? "" : ` ± ${told(std)}`}${truth == null ? "" : `, true ${told(truth)}`}`);
    }
    const own = campaign.records[run] ?? [];
    box.append(make("h2", {}, `${row.name[0].toUpperCase()}${row.name.slice(1)}${row.failed ? ", failed" : ""}`), list);
    if (own.length) box.append(press("Its time histories", () => go("flights", { r: own })));
  }
  refresh();
}
turn();
