"""Figures that are explored, in a real browser: mouse, keys, switches, what is left without a script or on paper."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import Tab

from testbench.page.explore import View
from testbench.page.figure import Chart, Curve, Panel, Plate
from testbench.page.html import picture
from testbench.page.page import COMPUTED, Page

pytestmark = pytest.mark.drawn

HOSTILE = "</script><script>document.title = 'run'</script> \" onload='1' <img src=x>"
MOST_BYTES = 1_500_000
MOST_MS = 1000.0


def plate(views: list[View], name: str = "one") -> Plate:
    chart = Chart([[Panel(draws=[Curve(x=[0.0, 1.0], y=[0.0, 1.0])])]])
    return Plate(name, "A figure", "Its caption.", chart, views)


def flight(seconds: float = 20.0, rate: float = 50.0, channels: int = 3, name: str = "model") -> list[View]:
    t = np.arange(round(seconds * rate)) / rate
    panels = []
    for k in range(channels):
        measured = np.sin(0.5 * t + k)
        curves = [Curve(name="measured", x=t, y=measured), Curve(name=name, x=t, y=measured + 0.25, colour="#0072B2")]
        panels.append(Panel(y=f"y{k}, m", x="t, s", draws=curves))
    return [View(name="first", panels=panels, reference="measured"), View(name="second", panels=panels[:1])]


def html(*plates: Plate) -> str:
    page = Page(kicker="k", title="t", question="q", answer=["it is"], plates=plates, packages=COMPUTED)
    return page.html([picture(p) for p in plates])


@pytest.fixture
def show(tab: Tab, tmp_path: Path) -> Callable[..., Any]:
    def show(text: str, **size: int) -> Any:
        file = tmp_path / "report.html"
        file.write_text(text, encoding="utf-8")
        return tab.show(file.as_uri(), **size)

    return show


def ranges(page: Any) -> list[list[float]]:
    return page.evaluate(
        "document.querySelector('figure').explorer.plots.map(u => [u.scales.x.min, u.scales.x.max])"
    )  # fmt: skip


def ready(page: Any) -> None:
    page.wait_for_selector("figure[data-ready]", timeout=5000)


def test_all_channels_zoom_and_move_together_by_mouse_and_by_buttons(show) -> None:
    page = show(html(plate(flight())))
    ready(page)
    whole = ranges(page)
    assert whole == [[0.0, pytest.approx(19.98)]] * 3
    box = page.locator(".u-over").first.bounding_box()
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 40, steps=5)
    page.mouse.up()
    zoomed = ranges(page)
    assert zoomed[0] == pytest.approx([5.0, 10.0], abs=0.1)
    assert zoomed[1] == zoomed[0] == zoomed[2]
    page.get_by_role("button", name="move right").click()
    assert ranges(page)[2] == pytest.approx([zoomed[0][0] + 1.25, zoomed[0][1] + 1.25], abs=0.05)
    page.get_by_role("button", name="show all").click()
    assert ranges(page) == whole
    page.mouse.dblclick(box["x"] + 50, box["y"] + 40)
    assert ranges(page) == whole


def linked(seconds: float, link: str) -> list[View]:
    return [View(name="only", panels=flight(seconds)[0].panels, link=link)]


def test_figures_over_one_flight_zoom_together_and_those_over_another_do_not(show) -> None:
    clocks = {"one": (20.0, "a"), "two": (10.0, "a"), "three": (20.0, "b")}
    page = show(html(*(plate(linked(*clock), name) for name, clock in clocks.items())))
    ready(page)
    figures = page.locator("figure")
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    for k in range(3):
        figures.nth(k).scroll_into_view_if_needed()
        figures.nth(k).locator(".u-over").first.wait_for()

    def shown() -> list[list[float]]:
        return page.evaluate(
            "[...document.querySelectorAll('figure')].map(f => f.explorer.plots[1].scales.x)"
            ".map(x => [x.min, x.max])"
        )  # fmt: skip

    whole = shown()
    figures.nth(0).get_by_role("button", name="zoom in").click()
    zoomed = shown()
    assert zoomed[0][1] - zoomed[0][0] < 19.0
    assert zoomed[1] == zoomed[0]
    assert zoomed[2] == whole[2]
    figures.nth(1).get_by_role("button", name="show all").click()
    assert shown() == whole


def test_the_cursor_reads_the_same_time_in_every_channel(show) -> None:
    page = show(html(plate(flight())))
    ready(page)
    box = page.locator(".u-over").first.bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 40)
    texts = page.locator(".explore output").all_inner_texts()
    assert len({text.split(":")[0] for text in texts}) == 1
    time = float(texts[0].split()[1].rstrip(":"))
    assert time == pytest.approx(10.0, abs=0.1)
    values = [float(part.split()[-1].replace("−", "-")) for part in texts[1].split(": ")[1].split("; ")]
    assert values == pytest.approx([np.sin(0.5 * time + 1), np.sin(0.5 * time + 1) + 0.25], abs=1e-3)


def test_the_keyboard_reaches_everything_and_does_it(show) -> None:
    page = show(html(plate(flight())))
    ready(page)
    reached = []
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.textContent || document.activeElement.className"))
    for wanted in ("+", "residuals", "as drawn", "y2, m", "measured", "model", "Provenance"):
        assert any(wanted in text for text in reached), wanted
    page.locator(".plot").first.focus()
    page.keyboard.press("+")
    assert ranges(page)[1] == pytest.approx([5.0, 15.0], abs=0.1)
    page.keyboard.press("Shift+ArrowRight")
    assert ranges(page)[1] == pytest.approx([7.5, 17.5], abs=0.1)
    page.keyboard.press("ArrowRight")
    assert page.locator(".explore output").nth(2).inner_text().startswith("t 12.")
    page.keyboard.press("0")
    assert ranges(page)[0] == [0.0, pytest.approx(19.98)]


def test_channels_models_residuals_and_views_switch(show) -> None:
    page = show(html(plate(flight())))
    ready(page)
    page.get_by_role("button", name="y1, m").click()
    assert page.locator(".plot").count() == 2
    page.get_by_role("button", name="residuals").click()
    shown = page.evaluate("document.querySelector('figure').explorer.plots[0].data.slice(1)")
    assert len(shown) == 1
    assert shown[0] == pytest.approx([0.25] * len(shown[0]), abs=1e-6)
    page.get_by_role("button", name="residuals").click()
    page.get_by_role("button", name="model", exact=True).click()
    assert page.evaluate("document.querySelector('figure').explorer.plots[0].data.length") == 2
    page.locator(".bar select").select_option("second")
    assert page.locator(".plot").count() == 1
    page.get_by_role("button", name="show the figure as drawn").click()
    assert page.locator("picture img").is_visible()


def test_without_a_script_and_on_paper_the_drawn_figure_stands(show, browser) -> None:
    page = show(html(plate(flight())))
    context = browser.new_context(java_script_enabled=False)
    plain = context.new_page()
    plain.goto(page.url)
    assert plain.locator("picture img").is_visible()
    context.close()
    ready(page)
    assert not page.locator("picture img").is_visible()
    page.emulate_media(media="print")
    assert page.locator("picture img").is_visible()
    assert not page.locator(".explore").is_visible()


def test_hostile_names_stay_names(show) -> None:
    page = show(html(plate(flight(name=HOSTILE))))
    ready(page)
    assert page.title() == "t"
    assert page.locator("script").count() == 1
    assert page.locator("img[src=x]").count() == 0
    assert HOSTILE in page.locator(".keys").inner_text()


def test_signs_in_a_plane_are_read_and_zoomed_in_both_directions(show) -> None:
    poles = Curve(name="found", x=np.array([-3.0, -3.0, -1.0]), y=np.array([-2.0, 2.0, 0.5]), marker="o")
    true = Curve(name="true", x=np.array([-1.1]), y=np.array([0.5]), marker="+")
    panel = Panel(y="Im s, rad/s", x="Re s, rad/s", draws=[true, poles], y_range=(-3.0, 3.0))
    page = show(html(plate([View(name="all", panels=[panel], plane=True)])))
    ready(page)
    where = page.evaluate(
        "(() => { const u = document.querySelector('figure').explorer.plots[0], b = u.over.getBoundingClientRect();"
        "return [b.x + u.valToPos(-3, 'x'), b.y + u.valToPos(2, 'y')]; })()"
    )
    page.mouse.move(*where)
    assert page.locator(".explore output").inner_text() == "found: −3.000, 2.000"
    page.get_by_role("button", name="zoom in").click()
    low, high = page.evaluate(
        "(u => [u.scales.y.min, u.scales.y.max])(document.querySelector('figure').explorer.plots[0])"
    )
    assert (low, high) == (pytest.approx(-1.5), pytest.approx(1.5))


def test_ten_minutes_at_100_hz_are_a_small_page_that_answers_at_once(show) -> None:
    text = html(plate(flight(600.0, 100.0, channels=8)), plate(flight(600.0, 100.0, channels=8), "two"))
    assert len(text.encode()) < MOST_BYTES
    page = show(text)
    ready(page)
    assert float(page.locator("figure[data-ready]").first.get_attribute("data-ready")) < MOST_MS
    assert "lowest and highest of every" in page.locator(".hint").first.inner_text()


@pytest.mark.parametrize("width", [400, 800, 1280])
def test_nothing_is_wider_than_the_screen(show, width) -> None:
    page = show(html(plate(flight())), width=width)
    ready(page)
    assert page.evaluate("document.documentElement.scrollWidth") == width


ZOOMED = """
async () => {
  const start = performance.now();
  document.querySelector('figure').explorer.zoom(0.5);
  await new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)));
  const axes = document.querySelector('figure').explorer.plots.flatMap(u => u.axes);
  return [performance.now() - start, Math.min(...axes.map(a => a._values.filter(v => v).length))];
}
"""


@pytest.mark.sampled(2)
@pytest.mark.parametrize("low", [0.0049250909, 0.0995665065, 0.3, 7.77e-8])
def test_logarithmic_axes_zoom_at_once_from_any_beginning_and_keep_numbers(show, low: float) -> None:
    x = np.geomspace(0.1232, 50.27, 300)
    curve = Curve(name="model", x=x, y=np.geomspace(1.2752, low, 300))
    panel = Panel(y="magnitude, deg/deg", x="frequency, rad/s", draws=[curve], log_x=True, log_y=True)
    page = show(html(plate([View(name="only", panels=[panel])])))
    ready(page)
    found = [page.evaluate(ZOOMED) for _ in range(8)]
    assert max(ms for ms, _ in found) < MOST_MS
    assert min(numbers for _, numbers in found) >= 1
