"""Three kinds of new user in the browser, every step counted: ``make new-users``.

    log         a student with a log: from the file to derivatives
    aircraft    an engineer with an aircraft of their own in a folder: from it to cards to print
    campaign    who runs campaigns: runs watched as they come, stopped, and gone on with

Each starts at the page that `testbench app` opens, in a folder that holds nothing but what they bring. A step is one
click, choice or line that is typed; what is waited for is no step. Writes results/app/new_users.csv: user, step, what
was done, s from it until what it shows was there, what that was; and results/app/replies.csv: of designs, how long a
reply takes while an input is dragged, ms from the page's request to what it has drawn, over 40 moves. With
``--pictures FOLDER`` every view is photographed at 400, 800, 1280 and 1600 px, light and dark.
"""

import argparse
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from browsers import launched
from clock import since
from flown_logs import LOGS, fly
from smallest import results, sized
from tables import write_rows

from testbench.core.paths import AIRCRAFT_MODELS, SCENARIOS
from testbench.page.serve import serving
from testbench.questions.app.ask import Workbench

STEPS, REPLIES = ("user", "step", "done", "s", "shown"), ("design", "targets", "moves", "median_ms", "worst_ms")
DESIGNS = ("taurus_short_period", "eolo_short_period", "eolo_modes")
MOVES = 40
WIDTHS = (400, 800, 1280, 1600)  # px
LONG_MS = 240_000


class User:
    """One who uses the page, and what each of their steps took."""

    def __init__(self, kind: str, page: Any) -> None:
        self.kind, self.page, self.rows = kind, page, list[tuple[str, int, str, str, str]]()

    def step(self, done: str, act: Callable[[], Any], shown: Any) -> None:
        """Take a step and wait for what it shows."""
        begun = time.monotonic()
        act()
        shown.first.wait_for(timeout=LONG_MS)
        lasted = since(begun, time.monotonic)
        text = " ".join((shown.first.inner_text() or "").split())[:90]
        self.rows.append((self.kind, len(self.rows) + 1, done, f"{lasted:.1f}", text))
        print(*self.rows[-1], sep="; ", flush=True)


def button(page: Any, name: str) -> Any:
    """Return the button of this name."""
    return page.get_by_role("button", name=name, exact=True)


def log_to_derivatives(user: User, folder: Path) -> None:
    """A PX4 log of a simulated flight is identified as it is."""
    page, (name, make) = user.page, LOGS["px4"]
    (folder / name).write_bytes(make(1, fly(1)))
    choose = page.get_by_label("Drop logs anywhere")
    user.step("choose the log", lambda: choose.set_input_files(folder / name), button(page, "Identify"))
    user.step("Identify", button(page, "Identify").click, page.locator("#verdict figure.table"))


def aircraft_to_card(user: User, folder: Path) -> None:
    """An aircraft lies in the folder, aircraft/mine; its name is in the list."""
    page = user.page
    shutil.copytree(AIRCRAFT_MODELS / "taurus", folder / "aircraft" / "mine")
    draw, judge, plan = (button(page, n) for n in ("Draw an input", "Run the full design", "Plan it, with cards"))
    user.step("Design", page.get_by_role("link", name="Design").click, draw)
    user.step("choose the aircraft", lambda: page.get_by_label("of", exact=True).select_option("mine"), draw)
    user.step("Draw an input", draw.click, page.locator("#verdict-input:not(:empty)"))
    user.step("Run the full design", judge.click, page.locator("#design-answer .answer li"))
    user.step("Plan it, with cards", plan.click, page.get_by_role("link", name="Cards to print"))


def campaign_watched(user: User, folder: Path) -> None:
    """A campaign of 300 runs is stopped while they come, and gone on with."""
    page = user.page
    text = (SCENARIOS / "campaign" / "taurus_scatter.toml").read_text(encoding="utf-8")
    (folder / "mine.toml").write_text(text.replace("runs = 24", "runs = 300"), encoding="utf-8")
    asked, counts = button(page, "campaign run mine.toml"), page.locator("#counts")
    user.step("Board", page.get_by_role("link", name="Board").click, asked)
    user.step("campaign run mine.toml", asked.click, button(page, "Ask"))
    user.step("Ask", button(page, "Ask").click, page.locator("#table tbody tr"))
    user.step("Stop", button(page, "Stop").click, counts.filter(has_text="not at work"))
    user.step("Resume", button(page, "Resume").click, counts.filter(has_text="300 of 300"))


def replies(page: Any, at: str, design: str) -> tuple[str, int, int, str, str]:
    """Drag the amplitude of a design's first input, and return how long replies take, without drawn aircraft."""
    page.goto("about:blank")
    page.goto(f"{at}#design?of={design}")
    page.locator("#verdict-input:not(:empty)").wait_for(timeout=LONG_MS)
    page.locator("#response-drawn").scroll_into_view_if_needed()  # figures are made when they come near
    page.locator("#response-drawn .u-over").first.wait_for(timeout=LONG_MS)
    found = page.evaluate("""async moves => {
        const took = [], key = amplitudeKey(design.entries[0]), first = design.entries[0][key];
        for (let k = 0; k < moves; k++) {
          while (design.busy) await new Promise(requestAnimationFrame);
          design.entries[0][key] = first * (0.5 + k / moves);
          const begun = performance.now();
          changed(true);
          while (design.busy) await new Promise(requestAnimationFrame);
          took.push(performance.now() - begun);
        }
        return [took, design.found.errors.length];
    }""", sized(MOVES, 3))  # fmt: skip
    took = np.array(found[0])
    return design, found[1], len(took), f"{np.median(took):.0f}", f"{took.max():.0f}"


def photographed(page: Any, at: str, folder: Path, views: dict[str, str]) -> None:
    """Write a picture of every view at every width, light and dark."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, view in views.items():
        for width in WIDTHS:
            for scheme in ("light", "dark"):
                page.emulate_media(color_scheme=scheme)
                page.set_viewport_size({"width": width, "height": 900})
                page.goto("about:blank")
                page.goto(f"{at}#{view}")
                page.wait_for_timeout(1500)
                wide = page.evaluate("document.documentElement.scrollWidth")
                assert wide <= width, f"{name} is {wide} px wide on {width} px"
                page.screenshot(path=folder / f"{name}_{width}_{scheme}.png", full_page=True)


@contextmanager
def _served(bench: Workbench) -> Iterator[Any]:
    """Serve what a browser works with."""
    with serving(bench.answer, 0, bench.take) as server:
        Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield server
        server.shutdown()


def main() -> None:
    """Let every user work, and drag."""
    from playwright.sync_api import sync_playwright

    given = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    given.add_argument("--pictures", type=Path)
    pictures = given.parse_args().pictures
    steps, told = list[Any](), list[Any]()
    every = {"log": log_to_derivatives, "aircraft": aircraft_to_card, "campaign": campaign_watched}
    journeys = sized(every, {"aircraft": aircraft_to_card})
    with sync_playwright() as p:
        browser = launched(p)
        for kind, journey in journeys.items():
            with TemporaryDirectory() as work, Workbench(Path(work)) as bench, _served(bench) as server:
                at, page = f"http://127.0.0.1:{server.server_port}{bench.home}", browser.new_context().new_page()
                page.goto(at)
                user = User(kind, page)
                journey(user, bench.folder)
                steps += user.rows
                if pictures is not None:
                    here = page.url.partition("#")[2]
                    photographed(page, at, pictures, {kind: here, f"{kind}_board": "board", f"{kind}_work": "work"})
        with TemporaryDirectory() as work, Workbench(Path(work)) as bench, _served(bench) as server:
            page = browser.new_context().new_page()
            for design in sized(DESIGNS, DESIGNS[:1]):
                told.append(replies(page, f"http://127.0.0.1:{server.server_port}{bench.home}", design))
                print(*told[-1], sep="; ", flush=True)
        browser.close()
    write_rows(results("app", "new_users.csv"), STEPS, steps)
    write_rows(results("app", "replies.csv"), REPLIES, told)


if __name__ == "__main__":
    main()
