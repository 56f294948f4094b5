// Exercises: one is begun by its command, read here, its records are looked into under Flights, and its answers are
// checked by the command that knows them. The address holds which one is open (of).
views.set("exercises", async values => {
  const { catalogue, begun } = await listed("exercises"), of = values.get("of");
  const chosen = at("exercise").value;
  at("exercise").replaceChildren(...catalogue.map(e => new Option(`${e.title} (level ${e.level}, ${e.minutes} min)`, e.name, false, e.name === chosen)));
  const open = begun.find(e => e.folder === of);
  const links = begun.map(e => { const a = make("a", { href: `#exercises?of=${encodeURIComponent(e.folder)}` }, `${e.title}: ${e.student}`); if (e === open) a.setAttribute("aria-current", "page"); return make("li", {}, a); });
  at("begun").replaceChildren(...links.length ? [make("ul", {}, ...links)] : [make("p", { className: "hint" }, "There is none in this folder yet.")], ...open ? [exercise(open)] : []);
});
at("begin").addEventListener("click", async () => {
  const student = at("student").value.trim(), name = at("exercise").value;
  if (!student) { at("student").focus(); say("whose version it is must be said: a name or number", true); return; }
  const folder = `${name}_${student.replace(/[^A-Za-z0-9._-]+/g, "_")}`;
  try {
    const end = await ask(["exercise", "start", name, "--student", student, "--out", folder]);
    if (!end.status) go("exercises", { of: folder });
  } catch (error) { failed(error); }
});

function exercise(e) {
  const form = make("form"), rows = e.questions.map(q => {
    const label = make("label", { htmlFor: `answer-${q.key}` }, q.text, make("span", { className: "hint" }, q.options ? "" : q.unit === "1" ? " without unit" : ` in ${q.unit}`));
    const field = q.options ? make("select", { id: `answer-${q.key}` }, new Option("not answered", ""), ...Object.entries(q.options).map(([word, means]) => new Option(`${word}: ${means}`, word, false, word === q.given)))
      : make("input", { type: "text", id: `answer-${q.key}`, inputMode: "decimal", autocomplete: "off", value: q.given ?? "" });
    field.name = q.key;
    return make("p", {}, label, make("br"), field);
  });
  const said = make("pre", { tabIndex: 0, hidden: true }), text = make("iframe", { title: `Text of ${e.title}`, src: `exercises/${link(e.page)}` });
  said.setAttribute("role", "status"); said.setAttribute("aria-label", "Result of the checker");
  form.append(make("h2", {}, "Your answers"), ...rows, make("div", { className: "row" }, make("button", { type: "submit", className: "main" }, "Save and check")), said);
  form.addEventListener("submit", async event => {
    event.preventDefault();
    try {
      await send("save/answers", JSON.stringify({ exercise: e.folder, answers: Object.fromEntries(new FormData(form)) }));
      said.hidden = false; said.textContent = "checking …";
      said.textContent = (await ask(["exercise", "check", e.folder])).printed.trim();
    } catch (error) { failed(error); }
  });
  const records = e.records.length ? [make("div", { className: "row" }, press(`Inspect its ${e.records.length === 1 ? "record" : `${e.records.length} records`}`, () => go("flights", { r: e.records.slice(0, 12) })))] : [];
  return make("article", {}, make("h2", {}, `${e.title}: the version of ${e.student}`), ...records, make("div", { className: "pair" }, text, form));
}
