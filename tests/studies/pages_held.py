"""Every kind of page in Chromium: axe-core's faults, words of the answer, bytes, width, keys, and when plots answer.

    python tests/studies/pages_held.py FOLDER AXE.min.js [--pictures FOLDER]

FOLDER holds results of any questions; axe.min.js comes from `npm pack axe-core`. Prints one line per page, writes
screenshots at 400, 800 and 1280 px, light, dark and for print if asked, and ends with 1 if a page has a fault.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from testbench.page.words import MOST_WORDS

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from browsers import launched
from smallest import sized

WIDTHS = (400, 800, 1280)  # px
MOST_BYTES = 1_500_000
MOST_MS = 1000.0  # from opening a page until its first plot answers
SERIOUS = ("serious", "critical")
_UNREACHED = """
() => {
  const all = [...document.querySelectorAll('a[href], button, select, summary, [tabindex="0"]')];
  return all.filter(e => e.checkVisibility() && e.tabIndex < 0).map(e => e.outerHTML.slice(0, 80));
}
"""


def faults_of(page: Any, axe: str, words: bool = True) -> list[str]:
    """Return what is wrong with a page that is open, everything unfolded."""
    lead = page.locator("section.answer li, p#answer").first
    text = lead.inner_text() if lead.count() else ""
    said = (text.split(". ")[0] if page.locator("p#answer").count() else text).split()  # the studio's is one paragraph
    out = [f"the answer has {len(said)} words"] if words and len(said) > MOST_WORDS else []
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    height = page.evaluate("document.body.scrollHeight")
    for y in range(0, height, 700):  # figures are made when they come near
        page.evaluate(f"scrollTo(0, {y})")
        page.wait_for_timeout(20)
    page.wait_for_timeout(100)
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_timeout(50)
        if page.evaluate("document.documentElement.scrollWidth") > width:
            out.append(f"wider than {width} px")
    out += [f"not reached by keys: {text}" for text in page.evaluate(_UNREACHED)]
    page.evaluate(axe)
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        page.wait_for_timeout(50)
        found = page.evaluate("axe.run({ resultTypes: ['violations'] })")["violations"]
        out += [
            f"{scheme}: {v['id']} ({len(v['nodes'])}): {v['nodes'][0]['html'][:120]}"
            for v in found
            if v["impact"] in SERIOUS
        ]
    return out


def answers_after_ms(page: Any) -> float | None:
    """Return how long a page that was just opened took until its first plot answered; None if none is in sight."""
    plots = page.locator("figure[data-explore]")
    if not plots.count():
        return None
    page.evaluate("document.querySelector('figure[data-explore]').closest('details')?.setAttribute('open', '')")
    opened = float(page.evaluate("performance.now()"))
    plots.first.scroll_into_view_if_needed()
    page.wait_for_selector("figure[data-ready]", state="attached")
    ready = float(page.locator("figure[data-ready]").first.get_attribute("data-ready"))
    return ready if ready < opened else ready - opened


def pictures(browser: Any, file: Path, folder: Path) -> None:
    """Write screenshots of a page at all widths, light, dark and for print."""
    stem = file.parent.name
    for width in WIDTHS:
        for scheme in ("light", "dark"):
            context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
            page = context.new_page()
            page.goto(file.resolve().as_uri())
            page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
            for y in range(0, page.evaluate("document.body.scrollHeight"), 700):
                page.evaluate(f"scrollTo(0, {y})")
                page.wait_for_timeout(20)
            page.evaluate("scrollTo(0, 0)")
            page.screenshot(path=folder / f"{stem}_{width}_{scheme}.png", full_page=True)
            if width == WIDTHS[-1] and scheme == "light":
                page.pdf(path=folder / f"{stem}_print.pdf", format="A4")
            context.close()


def main() -> int:
    """Look at every page of a folder."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("axe", type=Path)
    parser.add_argument("--pictures", type=Path)
    given = parser.parse_args()
    files = sorted(f for name in ("report.html", "index.html", "README.html") for f in given.folder.rglob(name))
    files = files[: sized(None, 1)]
    axe, bad = given.axe.read_text(encoding="utf-8"), 0
    with sync_playwright() as p:
        browser = launched(p)
        for file in files:
            context = browser.new_context(viewport={"width": WIDTHS[-1], "height": 900}, bypass_csp=True)
            page = context.new_page()
            page.goto(file.resolve().as_uri())
            ms = answers_after_ms(page)
            found = faults_of(page, axe)
            found += [f"plots answer after {ms:.0f} ms"] if ms is not None and ms > MOST_MS else []
            size = file.stat().st_size
            found += [f"{size} bytes"] if size > MOST_BYTES else []
            plots = "" if ms is None else f", plots answer after {ms:.0f} ms"
            print(f"{file.parent.name}: {size / 1e6:.2f} MB{plots}, {len(found)} faults")
            for text in found:
                print(f"    {text}")
            bad += len(found)
            context.close()
            if given.pictures is not None:
                given.pictures.mkdir(parents=True, exist_ok=True)
                pictures(browser, file, given.pictures)
        browser.close()
    return 1 if bad or not files else 0


if __name__ == "__main__":
    sys.exit(main())
