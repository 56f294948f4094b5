"use strict";
// What is folded opens for a link into it and for print; a table that is wider than the screen says that it scrolls.
(() => {
  const folds = () => [...document.querySelectorAll("details")];
  function reveal() {
    let place = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const target = place;
    for (; place; place = place.parentElement) if (place.tagName === "DETAILS") place.open = true;
    if (target) target.scrollIntoView();
  }
  addEventListener("hashchange", reveal);
  document.addEventListener("click", e => { const a = e.target.closest?.('a[href^="#"]'); if (a && a.hash === location.hash) reveal(); });
  reveal();
  let closed = [];
  addEventListener("beforeprint", () => { closed = folds().filter(d => !d.open); for (const d of closed) d.open = true; });
  addEventListener("afterprint", () => { for (const d of closed) d.open = false; });
  const sections = folds().filter(d => d.classList.contains("fold"));
  if (sections.length > 1) {
    const all = document.createElement("button");
    const name = () => { all.textContent = sections.some(d => !d.open) ? "Open all" : "Fold all"; };
    all.type = "button"; all.className = "all";
    all.addEventListener("click", () => { const open = sections.some(d => !d.open); for (const d of sections) d.open = open; });
    for (const d of sections) d.addEventListener("toggle", name);
    name();
    sections[0].before(all);
  }
  const hint = box => box.parentElement.classList.toggle("wider", box.scrollWidth > box.clientWidth + 2);
  const watch = new ResizeObserver(seen => { for (const s of seen) hint(s.target); });
  for (const box of document.querySelectorAll(".scroll")) watch.observe(box);
})();
