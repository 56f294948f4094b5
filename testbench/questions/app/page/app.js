// The workbench: views by the address, commands with what they print, the board. What is chosen stands in the address,
// so that a reload and a second tab show the same.
const at = id => document.getElementById(id);
const make = (name, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
};
const press = (text, act, kind = "") => {
  const button = make("button", { type: "button", className: kind }, text);
  button.addEventListener("click", () => act(button));
  return button;
};
const say = (text, wrong) => { at("said").textContent = text; at("said").className = wrong ? "wrong" : ""; };
const failed = error => say(error.message, true);
const told = value => value == null || Number.isNaN(value) ? "–" : typeof value !== "number" ? String(value)
  : (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e5) ? value.toExponential(2) : String(+value.toPrecision(4))).replaceAll("-", "−");
const shell = words => words.map(w => /^[\w@%+=:,./-]+$/.test(w) ? w : `'${w.replaceAll("'", "'\\''")}'`).join(" ");
const link = path => path.split("/").map(encodeURIComponent).join("/");
const ink = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// --- the server -------------------------------------------------------------------------------------------------------

function send(path, body, progress) {
  return new Promise((done, refuse) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    request.upload.onprogress = event => progress && progress(event.loaded / event.total);
    request.onerror = () => refuse(new Error("the server is gone; start testbench app again"));
    request.onload = () => {
      let found = {};
      try { found = JSON.parse(request.responseText); } catch { found = { error: request.responseText.trim() }; }
      if (found.error) refuse(new Error(found.error)); else done(found);
    };
    request.send(body);
  });
}
const show = (what, given) => send(`show/${what}`, JSON.stringify(given));
async function listed(what) {
  try { return await (await fetch(what)).json(); } catch { throw new Error("the server is gone; start testbench app again"); }
}

// --- the address ------------------------------------------------------------------------------------------------------

const views = new Map(); // name -> what is done when it is shown, with the rest of the address
const place = () => {
  const [view, rest] = location.hash.slice(1).split("?");
  return [views.has(view) ? view : "flights", new URLSearchParams(rest)];
};
function go(view, values = {}, keep = false) {
  const words = new URLSearchParams();
  for (const [key, value] of Object.entries(values)) for (const each of [value].flat()) if (each !== "" && each != null) words.append(key, each);
  const address = `#${view}${String(words) && `?${words}`}`;
  if (keep) history.replaceState(null, "", address); else if (location.hash === address) turn(); else location.hash = address;
}
function turn() {
  const [view, values] = place();
  for (const section of document.querySelectorAll("[data-view]")) section.hidden = section.dataset.view !== view;
  for (const a of document.querySelectorAll("header nav a")) a.hash === `#${view}` ? a.setAttribute("aria-current", "page") : a.removeAttribute("aria-current");
  if (values.has("page")) read(values.get("page")); else at("page").hidden = true;
  Promise.resolve(views.get(view)(values)).catch(failed);
}
function read(page) {
  at("page").hidden = false;
  if (at("frame").dataset.page !== page) { at("frame").dataset.page = page; at("frame").src = link(page); }
  at("page-link").textContent = page; at("page-link").href = link(page);
}
function open(page) { // beside what is shown
  const [view, values] = place();
  values.set("page", page);
  history.pushState(null, "", `#${view}?${values}`);
  read(page);
  at("page").scrollIntoView({ behavior: "smooth" });
}
at("page-close").addEventListener("click", () => {
  const [view, values] = place();
  values.delete("page");
  history.pushState(null, "", `#${view}${String(values) && `?${values}`}`);
  at("page").hidden = true;
});

// --- commands ---------------------------------------------------------------------------------------------------------

const jobs = new Map(), STOPPED = 143; // number -> its box; the exit status of what was stopped
async function ask(words) { // start a command; what it is once it has ended
  const job = await send("ask", JSON.stringify(words));
  say(`$ ${job.command}`);
  const ended = await follow({ ...job, asked: true });
  say(`done: ${job.command}`);
  if (ended.status) say(ended.printed.trim().split("\n").pop() || `${job.command} ended with ${ended.status}`, ended.status !== STOPPED);
  return ended;
}
const busy = () => { const n = [...jobs.values()].filter(j => j.at).length; at("busy").textContent = n ? `(${n} at work)` : ""; };

function follow(job) {
  const box = make("article"), lines = make("pre", { className: "printed", tabIndex: 0 }), found = make("div", { className: "found" });
  const state = make("p", {}, "at work …"), row = make("div", { className: "row" }), bar = make("progress", { hidden: true, max: 1 });
  state.setAttribute("role", "status"); bar.setAttribute("aria-label", `Progress of ${job.command}`);
  lines.setAttribute("aria-label", `Output of ${job.command}, ${job.number + 1}`); lines.setAttribute("role", "region");
  const stop = press("Stop", () => send(`stop/${job.number}`, "").catch(failed));
  row.append(stop, bar);
  box.append(make("h2", {}, make("code", {}, job.command)), state, row, found, lines);
  at("jobs").prepend(box);
  jobs.set(job.number, { at: true, words: job.words });
  busy();
  const begun = job.begun * 1000, clock = setInterval(() => { if (box.dataset.stage) state.textContent = `${box.dataset.stage} … ${seconds((Date.now() - begun) / 1000)}`; }, 500);
  return new Promise(done => {
    const events = new EventSource(`jobs/${job.number}`);
    events.onopen = () => { lines.textContent = ""; };
    events.onmessage = event => {
      const [second, line] = JSON.parse(event.data);
      if (line.startsWith("... ")) stage(box, found, bar, line.slice(4), second);
      else { lines.textContent += `${line}\n`; lines.scrollTop = lines.scrollHeight; }
    };
    events.onerror = () => { box.dataset.stage = ""; state.textContent = "the server is gone; what was finished is in results/"; };
    events.addEventListener("end", event => {
      events.close(); clearInterval(clock);
      const ended = JSON.parse(event.data), took = seconds(ended.lasted);
      box.dataset.stage = "";
      state.textContent = ended.status === 0 ? `done in ${took}` : `ended with exit status ${ended.status} after ${took}`;
      state.className = ended.status === 0 ? "" : "wrong";
      jobs.set(job.number, { at: false, words: job.words });
      busy();
      stop.remove(); bar.hidden = true;
      const here = make("div");
      for (const page of ended.pages) row.append(press(`Show ${page}`, () => digest(here, page).catch(failed), "main"));
      lines.after(here);
      if (job.asked && ended.pages.length === 1 && place()[0] === "work") digest(here, ended.pages[0]).catch(failed);
      // What keeps its work goes on where it stood: a campaign or a data set from its store, a search for a gap from its fits.
      if (ended.status) row.append(press(["campaign", "dataset", "gap"].includes(job.words[0]) ? "Resume" : "Again", () => ask(resumed(job.words)).catch(failed)));
      if (!row.children.length || row.children.length === 1) row.append(press("Ask again", () => { at("words").value = shell(job.words); at("words").focus(); }));
      done({ ...ended, printed: lines.textContent });
    });
  });
}
const resumed = words => words[0] === "campaign" && words[1] === "run" ? ["campaign", "resume", ...words.slice(2)] : words;
const seconds = s => s < 60 ? `${s.toFixed(0)} s` : `${Math.floor(s / 60)} min ${Math.round(s % 60)} s`;

// A stage of a command: how far it is if it counts, and how probable explanations are as they are weighed.
function stage(box, found, bar, text, second) {
  const weighed = text.match(/^weighed( to first order)?: (.*)$/), counts = text.match(/(\d+) of (\d+)/);
  box.dataset.stage = weighed ? box.dataset.stage || "weighed" : text;
  if (counts && !weighed) {
    const [k, n] = [+counts[1], +counts[2]], what = text.replace(/\d+/g, "");
    bar.hidden = false; bar.max = n; bar.value = k;
    if (box.counted?.what !== what || k < box.counted.k) box.counted = { what, k, second };
    const rate = (k - box.counted.k) / (second - box.counted.second);
    if (rate > 0 && !text.includes(" left")) box.dataset.stage += `, about ${seconds((n - k) / rate)} left`;
  } else bar.hidden = !weighed || bar.hidden;
  if (!weighed) return;
  const old = new Map([...found.querySelectorAll("i")].map(i => [i.dataset.of, i.style.width]));
  found.replaceChildren(...weighed[1] ? [make("p", { className: "hint" }, "To first order, before any is flown:"), make("span"), make("span")] : []);
  for (const each of weighed[2].split("; ")) {
    const [, name, percent] = each.match(/^(.*) ([\d.]+) %$/) ?? [];
    if (!name) continue;
    const meter = make("i"), size = `${Math.max(0.4, +percent)}%`;
    meter.dataset.of = name; meter.style.width = old.get(name) ?? "0";
    found.append(make("span", {}, name), make("div", { className: "meter" }, meter), make("output", {}, `${percent} %`));
    requestAnimationFrame(() => { meter.style.width = size; });
  }
}

// What a page says, beside the work that asked for it: the answer, one figure at a time, those that hold their numbers as
// plots of their own, and derivatives if there are any.
async function digest(box, page, close) {
  if (box.dataset.page === page) return;
  box.dataset.page = page;
  const answer = await fetch(link(page));
  if (!answer.ok) return box.replaceChildren(make("p", { className: "wrong" }, `${page} is gone`));
  const told = new DOMParser().parseFromString(await answer.text(), "text/html"), figures = [...told.querySelectorAll("figure.picture")];
  const part = element => { for (const e of [element, ...element.querySelectorAll("[id]")]) e.removeAttribute("id"); return document.importNode(element, true); };
  const holder = make("div"), chips = make("div", { className: "chips", role: "group", ariaLabel: "Figures" });
  const name = fig => fig.querySelector("figcaption strong").textContent.replace(/\.$/, "");
  const draw = fig => {
    for (const b of chips.children) b.setAttribute("aria-pressed", String(b.textContent === name(fig)));
    if (fig.dataset.explore) figure(holder, JSON.parse(fig.dataset.explore)); else holder.replaceChildren(part(fig));
  };
  chips.append(...figures.map(fig => press(name(fig), () => draw(fig))));
  const first = figures.find(f => f.id === "figure-time_histories") ?? figures[0], derivatives = told.querySelector("#table-derivatives"), said = told.querySelector(".answer");
  box.replaceChildren(make("h2", {}, told.querySelector("h1").textContent), ...said ? [part(said)] : [], chips, holder,
    ...derivatives ? [part(derivatives)] : [], make("div", { className: "row" }, press("The whole page", () => open(page)), ...further(page), press("Close", () => { box.dataset.page = ""; box.replaceChildren(); close?.(); })));
  if (first) draw(first);
}
// What follows from a result: of a gap the aircraft that it amended, of a design its plan, of a plan the cards to print.
function further(page) {
  const folder = page.replace(/\/[^/]*$/, ""), kind = folder.match(/^results\/(design|gap|plan)_[^/]*$/)?.[1];
  if (kind === "gap") return [press("Look at the amended aircraft", () => show("amended", { gap: folder }).then(found => ask(found.words)).catch(failed), "main")];
  if (kind === "design") return [press("Plan it, with cards", async () => {
    const { words } = await show("plan", { design: folder }), end = await ask(words).catch(failed);
    if (end?.pages[0]) { const [view, values] = place(); values.set("v", end.pages[0]); go(view === "design" ? view : "work", Object.fromEntries(values)); if (view !== "design") go("work"); }
  }, "main")];
  return kind === "plan" ? [make("a", { href: link(`${folder}/cards.pdf`), target: "_blank" }, "Cards to print"), make("a", { href: link(`${folder}/kneeboard.pdf`), target: "_blank" }, "Kneeboard")] : [];
}
function figure(holder, json) { // a plot of numbers: its element, and what explores it
  const fig = make("figure", { className: "live" }, make("picture"));
  fig.dataset.explore = JSON.stringify(json);
  holder.replaceChildren(fig);
  return [fig, explore(fig)];
}

// Words of a command as a shell takes them apart.
const apart = text => [...text.matchAll(/'([^']*)'|"([^"]*)"|(\S+)/g)].map(m => m[1] ?? m[2] ?? m[3]);
at("command").addEventListener("submit", event => {
  event.preventDefault();
  const words = apart(at("words").value.trim().replace(/^testbench\s+/, ""));
  if (!words.length) return say("a question must be asked: run, identify, gap, design, campaign run ...", true);
  ask(words).catch(failed);
  if (outOf(words)) setTimeout(() => go("campaigns", { of: outOf(words) }), 300);
});
views.set("work", () => {});

// A file of a question, which is what is asked: structure, estimators, limits. Saved, it is checked as a terminal would.
async function edit(file) {
  at("text").value = (await show("text", { file })).text;
  at("file").textContent = file; at("checked").textContent = ""; at("editor").hidden = false;
  at("look").hidden = !/\[\[channel\]\]/.test(at("text").value); // it describes a record
  at("text").focus(); at("editor").scrollIntoView({ behavior: "smooth" });
  at("save").onclick = async () => {
    try {
      at("checked").textContent = "saved; checking …";
      await send("save", JSON.stringify({ file, text: at("text").value }));
      at("checked").textContent = (await ask(["check", file])).printed.trim();
    } catch (error) { failed(error); }
  };
}
at("editor-close").addEventListener("click", () => { at("editor").hidden = true; });
at("text").addEventListener("keydown", event => { if ((event.ctrlKey || event.metaKey) && event.key === "s") { event.preventDefault(); at("save").click(); } });

// --- the board --------------------------------------------------------------------------------------------------------

const question = kind => kind.split(":")[0];
views.set("board", async () => {
  const board = await listed("board"), kinds = [...new Set(board.results.map(r => question(r.kind)))];
  at("stands").hidden = !board.stands; at("stands").textContent = board.stands;
  const next = board.stands.match(/^Next: testbench (.*)$/m);
  at("next").hidden = !next;
  if (next) { at("next").textContent = `Next: testbench ${next[1]}`; at("next").onclick = () => { ask(apart(next[1])).then(turn).catch(failed); go("work"); }; }
  at("files-to-ask").replaceChildren(...board.files.flatMap(words => [
    press(shell(words), () => { at("words").value = shell(words); go("work"); at("words").focus(); }),
    press(`Edit ${words.at(-1)}`, () => edit(words.at(-1)).catch(failed)),
  ]));
  const only = at("only").value;
  at("only").replaceChildren(new Option("all", ""), ...kinds.map(k => new Option(k, k, false, k === only)));
  const fill = () => {
    at("results").replaceChildren(...board.results.filter(r => !at("only").value || question(r.kind) === at("only").value).map(r => {
      const two = make("input", { type: "checkbox", value: r.folder });
      two.setAttribute("aria-label", `Compare ${r.folder}`);
      const page = make("a", { href: link(`${r.folder}/${r.page}`) }, r.title);
      page.addEventListener("click", event => { if (!event.ctrlKey && !event.metaKey) { event.preventDefault(); open(`${r.folder}/${r.page}`); } });
      return make("tr", {}, make("td", {}, two), make("th", { scope: "row" }, page), make("td", {}, question(r.kind)), make("td", { className: "text" }, r.answer), make("td", {}, r.written));
    }));
    mark();
  };
  const chosen = () => [...at("results").querySelectorAll(":checked")];
  const mark = () => {
    at("compare").disabled = chosen().length !== 2;
    for (const box of at("results").querySelectorAll("input")) box.disabled = chosen().length === 2 && !box.checked;
  };
  at("only").onchange = fill;
  at("results").onchange = mark;
  at("compare").onclick = () => {
    const [a, b] = chosen().map(box => box.value);
    ask(["results", a, b, "--out", `${a}_and_${b.split("/").pop()}`]).then(end => end.pages[0] && open(end.pages[0])).catch(failed);
  };
  fill();
  if (!board.results.length) say("no results yet: drop a log, or ask something under Work");
});
