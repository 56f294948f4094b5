"""The pages in a real browser: tables sort by mouse and keyboard, text stays text, the first screen has its figure."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from browsers import Tab

from testbench.page.html import Picture
from testbench.page.page import Page
from testbench.page.tables import Column, Table
from testbench.questions.run.page import run_page

pytestmark = pytest.mark.drawn

HOSTILE = "<script>alert(1)</script> & \"double\" 'single' </title><img src=x onerror=alert(2)>"
SVG = (
    "data:image/svg+xml;base64,"
    "PHN2ZyB4bWxucz0iaHR0cDovL3d3dy53My5vcmcvMjAwMC9zdmciIHdpZHRoPSI4MDAiIGhlaWdodD0iMzAwIi8+"  # 800 by 300, empty
)
PICTURE = Picture("one", "One <b>figure</b>", "Read it & see.", SVG, SVG)
TABLE = Table(
    "mixed",
    "Mixed",
    "Every way in which a number is written.",
    (Column("name", "name"), Column("size", "size", "m/s"), Column("text", "as text"), Column("free", "free")),
    (
        ("b10", 2.0e-7, "12 %", "pear"),
        ("b9", -30.0, "1.2e-3", "Apple"),
        ("a", None, "–", None),
        ("c", 400.0, "0.4 ± 0.1", "fig"),
        ("d", 5.0, "−7 rad/s²", "orange"),
        ("mean", 9.0, "99", "all"),
    ),
    total=True,
)


def analysis(answer: list[str], tables: list[Table], pictures: list[Picture] | None = None) -> str:
    source = f"{HOSTILE}.ulg", f"</pre></details>{HOSTILE}"
    return Page(kicker="k", title=HOSTILE, answer=answer, tables=tables, source=source).html(pictures or [])


@pytest.fixture
def show(tab: Tab, tmp_path: Path) -> Callable[..., Any]:
    """Return a function that opens a page."""

    def show(text: str, opened: bool = True) -> Any:
        file = tmp_path / "report.html"
        file.write_text(text, encoding="utf-8")
        page = tab.show(file.as_uri())
        if opened:
            page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        return page

    return show


def names(page: Any) -> str:
    return " ".join(page.locator("#table-mixed tbody th").all_inner_texts())


def click(page: Any, head: str) -> str:
    page.get_by_role("button", name=head).click()
    return names(page)


def test_a_click_sorts_by_size_a_second_turns_it_round_and_a_third_undoes_it(show) -> None:
    page = show(analysis(["a"], [TABLE]))
    before = names(page)
    head = page.locator("#table-mixed thead th", has_text="size")
    assert click(page, "size m/s") == "b9 b10 d c a mean"
    assert head.get_attribute("aria-sort") == "ascending"
    assert click(page, "size m/s") == "c d b10 b9 a mean"
    assert head.get_attribute("aria-sort") == "descending"
    assert click(page, "size m/s") == before == "b10 b9 a c d mean"
    assert head.get_attribute("aria-sort") is None


def test_numbers_inside_texts_sort_as_numbers_and_words_as_words(show) -> None:
    page = show(analysis(["a"], [TABLE]))
    assert click(page, "as text") == "d b9 c b10 a mean"
    assert click(page, "free") == "b9 c d b10 a mean"
    assert page.locator("[aria-sort]").count() == 1
    assert click(page, "name") == "a b9 b10 c d mean"


def test_the_keyboard_sorts(show) -> None:
    page = show(analysis(["a"], [TABLE]))
    page.get_by_role("button", name="size m/s").focus()
    page.keyboard.press("Enter")
    assert names(page).startswith("b9 b10")
    page.keyboard.press("Space")
    assert names(page).startswith("c d")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "as text"


def test_a_button_neither_moves_nor_widens_its_column(show, browser) -> None:
    text = analysis(["a"], [TABLE])
    context = browser.new_context(java_script_enabled=False, viewport={"width": 1280, "height": 900})
    plain, live = context.new_page(), show(text)
    plain.goto(live.url)
    for summary in plain.locator("summary").all():
        summary.click()
    assert plain.locator("button").count() == 0
    boxes = [p.locator("#table-mixed table").bounding_box() for p in (plain, live)]
    context.close()
    assert boxes[0]["width"] == pytest.approx(boxes[1]["width"], abs=1.0)  # px
    assert boxes[0]["height"] == pytest.approx(boxes[1]["height"], abs=2.0)  # px


def test_texts_from_scenarios_and_logs_stay_texts(show, make_result) -> None:
    base = make_result()
    source = base.source.model_copy(update={"title": HOSTILE, "question": HOSTILE})
    flights = tuple(replace(f, name=f"{f.name} {HOSTILE}") for f in base.flights)
    model = replace(base.cases[0].model, advice=(HOSTILE,), settings={HOSTILE: HOSTILE})
    cases = (replace(base.cases[0], model=model, suite=HOSTILE), *base.cases[1:])
    hostile = replace(
        base, name=HOSTILE, title=HOSTILE, question=HOSTILE, source=source, flights=flights, cases=cases
    )  # fmt: skip
    page = show(run_page(hostile).html([PICTURE]))
    assert page.locator("h1").inner_text() == HOSTILE
    assert page.title() == HOSTILE
    assert page.locator("img[src=x]").count() == 0
    assert page.locator("script").count() == 1
    assert page.locator("body").inner_text().count("onerror=alert(2)") > 5
    page = show(analysis([HOSTILE], [replace(TABLE, title=HOSTILE, rows=((HOSTILE, 1.0, HOSTILE, ""),) * 2)]))
    assert page.locator("#table-mixed tbody th").first.inner_text() == HOSTILE
    assert page.locator("script").count() == 1


def test_a_script_that_slips_in_does_not_run(show, browser, tmp_path) -> None:
    text = analysis(["a"], [TABLE]).replace("<h1>", "<script>document.title = 'run'</script><h1 onclick='1'>")
    (tmp_path / "slipped.html").write_text(text, encoding="utf-8")
    context = browser.new_context()
    page = context.new_page()
    page.goto((tmp_path / "slipped.html").as_uri())
    assert page.title() == HOSTILE
    assert page.locator("thead button").count() == 4
    context.close()


def test_a_long_answer_leaves_room_for_its_figure_on_the_first_screen(show) -> None:
    sentences = [f"{k}: " + "words " * 20 for k in range(12)]
    page = show(analysis(sentences, [], [PICTURE]), opened=False)
    image = page.locator(".picture img").bounding_box()
    assert image["y"] + image["height"] < 900.0
    assert page.locator(".answer li.lead").inner_text().startswith("0: words")
    assert [int(k) for k in re.findall(r"(\d+): words", page.locator("body").inner_text())] == [0, 1, 2]
    page.get_by_text("9 more").click()
    assert [int(k) for k in re.findall(r"(\d+): words", page.locator("body").inner_text())] == list(range(12))


def test_on_paper_the_buttons_are_plain_heads(show) -> None:
    page = show(analysis(["a"], [TABLE]))
    page.emulate_media(media="print")
    mark = page.locator("thead button").first.evaluate("e => getComputedStyle(e, '::after').display")
    assert mark == "none"
