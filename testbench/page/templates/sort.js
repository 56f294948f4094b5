"use strict";
// The heads of tables become buttons: rising, falling, as it was. What is missing and the row of totals stay last.
(() => {
  const superscripts = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const missing = text => ["", "–", "-", "—", "nan"].includes(text.toLowerCase());
  function number(text) {
    const plain = text.replaceAll("−", "-").replace(/10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/, (_, power) =>
      "10" + [...power].map(c => c === "⁻" ? "-" : superscripts.indexOf(c)).join(""));
    const found = /^[<>≤≥≈~±+]?\s*(-?(?:inf|\d+(?:\.\d+)?|\.\d+))(?:\s*[·×]\s*10(-?\d+)|e([+-]?\d+))?(.*)$/i.exec(plain);
    if (!found || !/^\s*(%|±.*|\+-.*|[a-zµ°/²³·]{0,8})$/i.test(found[4])) return NaN;
    const size = /inf/i.test(found[1]) ? Infinity * (found[1][0] === "-" ? -1 : 1) : Number(found[1]);
    return size * 10 ** Number(found[2] ?? found[3] ?? 0);
  }
  for (const table of document.querySelectorAll("figure.table table:not(.sheet)")) {
    const body = table.tBodies[0], heads = [...table.tHead.rows[table.tHead.rows.length - 1].cells];
    const rows = [...body.rows].filter(row => !row.classList.contains("total"));
    const totals = [...body.rows].filter(row => row.classList.contains("total"));
    if (rows.length < 2) continue;
    heads.forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.title = "Sort by this column";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const order = { ascending: "descending", descending: "" }[head.ariaSort] ?? "ascending";
        for (const other of heads) other.removeAttribute("aria-sort");
        if (order) head.setAttribute("aria-sort", order);
        const items = rows.map(row => ({ row, text: row.cells[column].textContent.trim() }));
        const present = items.filter(item => !missing(item.text));
        for (const item of present) item.value = number(item.text);
        const numeric = present.every(item => !Number.isNaN(item.value));
        const sign = order === "descending" ? -1 : 1;
        if (order) present.sort((a, b) => sign * (numeric ? (a.value > b.value) - (a.value < b.value)
          : a.text.localeCompare(b.text, "en", { numeric: true })));
        const last = order ? items.filter(item => missing(item.text)) : [];
        body.append(...(order ? [...present, ...last] : items).map(item => item.row), ...totals);
      });
    });
  }
})();
