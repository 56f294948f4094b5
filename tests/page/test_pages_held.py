"""What every page keeps, in a browser: it fits screens, keys reach it, and axe-core, where it is, finds no fault."""

import os
from pathlib import Path

import pytest
from studies.pages_held import faults_of

from testbench.page.figure import Chart, Curve, Panel, Plate
from testbench.page.html import picture
from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table

pytestmark = pytest.mark.drawn

NO_AXE = "window.axe = { run: async () => ({ violations: [] }) }"
WIDE = Table(
    "wide", "Wide", "Many columns.", tuple(Column(f"c{k}", f"column {k}") for k in range(30)), ((1.0,) * 30,) * 3
)


@pytest.fixture(scope="module")
def tab(browser, tmp_path_factory):
    """Return a function that opens a page, given as text."""
    page = browser.new_context(bypass_csp=True).new_page()
    file = tmp_path_factory.mktemp("held") / "report.html"

    def tab(text: str):
        file.write_text(text, encoding="utf-8")
        page.goto(file.as_uri())
        return page

    return tab


@pytest.fixture(scope="module")
def axe():
    """Return axe-core, which the environment names; a stand-in that finds nothing where there is none."""
    place = os.environ.get("AXE")
    return Path(place).read_text(encoding="utf-8") if place else NO_AXE


def report(**changes) -> str:
    given = {"kicker": "k", "title": "t", "answer": ["it is", ("doubt", "is it?")], "tables": [WIDE]}
    return Page(**given | {"packages": COMPUTED} | changes).html([])


def test_a_page_keeps_them_all_and_says_that_a_table_scrolls(tab, axe):
    page = tab(report())
    assert faults_of(page, axe) == []
    assert page.locator(".wider").count() == 1


def test_what_is_wrong_is_found(tab, axe):
    long = tab(report(answer=[" ".join(["word"] * 30)]))
    assert faults_of(long, axe) == ["the answer has 30 words"]
    broad = report().replace("</h1>", '</h1><p style="width: 1500px">wide</p><button tabindex="-1">no</button>')
    found = faults_of(tab(broad), axe)
    assert "wider than 400 px" in found
    assert any("not reached by keys" in text for text in found)


def test_links_open_what_they_lead_into_and_print_opens_everything(tab):
    page = tab(report(source=("a.toml", "inside")))
    assert not page.get_by_text("inside").is_visible()
    page.evaluate("location.hash = '#provenance'")
    page.wait_for_function("document.querySelector('#provenance').closest('details').open")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details:not([open])").count() == 0
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.locator("details:not([open])").count() > 0


@pytest.mark.parametrize(("height_in", "tall"), [(4.0, False), (6.0, True), (7.4, True), (8.5, False)])
def test_two_figures_of_more_than_half_a_sheet_share_one_in_print(tab, height_in, tall):
    line = Curve(x=[0.0, 1.0], y=[0.0, 1.0])
    chart = Chart([[Panel(draws=[line])]], size_in=(8.6, height_in))
    drawn = picture(Plate("one", "A figure", "Its caption.", chart))
    assert drawn.tall is tall
    page = tab(Page(kicker="k", title="t", answer=["it is"], packages=COMPUTED).html([drawn]))
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 688, "height": 1000})  # 182 mm
    found = page.evaluate("(b => [b.width, b.height])(document.querySelector('.picture img').getBoundingClientRect())")
    page.emulate_media(media="screen")
    assert found[1] / found[0] == pytest.approx(height_in / 8.6, rel=0.01)
    if tall:
        assert found[1] < 1000.0 * 111.0 / 264.0


def test_a_table_of_many_columns_fits_a_sheet_in_print(tab):
    page = tab(report())
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 688, "height": 1000})
    widths = page.evaluate("[...document.querySelectorAll('table')].map(t => t.getBoundingClientRect().width)")
    page.emulate_media(media="screen")
    assert widths[0] == 0.0  # the whole table stands on the screen alone
    assert len(widths) > 2
    assert all(0.0 < w <= 688.0 for w in widths[1:])
