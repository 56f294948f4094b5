"""The page in a real browser: what it computes is what the testbench computes, and every control works."""

import json
import socket
import urllib.error
import urllib.request
from dataclasses import replace
from functools import cache
from threading import Thread

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError, ScenarioError
from testbench.evaluation.modes import modes_of
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.information.fisher import accuracy
from testbench.information.targets import needed_parameters
from testbench.inputs import build
from testbench.page.serve import HOST, Answer, serving
from testbench.page.words import MOST_WORDS
from testbench.questions.plan.scenario import PlanScenario
from testbench.questions.run.scenario import Scenario
from testbench.questions.studio import ask as studio
from testbench.questions.studio.page import studio_page
from testbench.sensors import load_suite

pytestmark = pytest.mark.drawn

SPEEDS = {"taurus": (12.0, 14.0), "eolo": (16.0, 18.0)}


@pytest.fixture(scope="module")
def data():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(studio, "SPEEDS", SPEEDS)
        return studio.studio_models()


@pytest.fixture(scope="module")
def file(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("studio") / "studio.html"
    path.write_text(studio_page(data), encoding="utf-8")
    return path


@pytest.fixture
def page(tab, file):
    """The page at a fresh start."""
    page = tab.show(file.as_uri(), height=1000)
    settle(page)
    return page


def settle(page):
    """Wait until what was changed has been drawn: two frames."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done))))")


def choose(page, **values):
    """Move controls as a user does; ranges by their value."""
    for name, value in values.items():
        if page.locator(f"#{name}").evaluate("e => e.tagName") == "SELECT":
            page.select_option(f"#{name}", value)
        else:
            page.locator(f"#{name}").evaluate(
                "(e, v) => { e.value = v; e.dispatchEvent(new Event('input', { bubbles: true })); }", str(value)
            )
    settle(page)


def until(page, holds):
    """Wait for what the page works out a moment later; its security policy forbids playwright's own way."""
    for _ in range(200):
        if holds(shown(page)):
            return
        page.wait_for_timeout(50)
    pytest.fail("the page never got there")


def shown(page):
    return page.evaluate("window.studio")


def test_the_page_is_whole_and_holds_no_address(data, file):
    text = file.read_text("utf-8")
    assert "http:" not in text
    assert "https:" not in text
    assert text.count("</script") == 3
    assert set(data["aircraft"]) == {"b1", "eolo", "taurus"}
    json.dumps(data, allow_nan=False)


def test_an_unknown_aircraft_is_refused():
    with pytest.raises(ScenarioError, match="did you mean 'taurus'"):
        studio.studio_models(["taurs"])


def test_it_answers_on_this_machine_only_and_with_one_page():
    with serving({"/": Answer(b"<p>page</p>")}.get, 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        assert server.server_address[0] == HOST == "127.0.0.1"
        address = f"http://{HOST}:{server.server_port}"
        assert urllib.request.urlopen(f"{address}/", timeout=5).read() == b"<p>page</p>"
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{address}/etc/passwd", timeout=5)
        server.shutdown()


def test_a_port_that_is_taken_is_said():
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LimitError, match=f"port {port} .*choose another with --port"), serving({}.get, port):
            pass
    with pytest.raises(LimitError, match="port 70000"), serving({}.get, 70000):
        pass


CHOICES = {
    "doublet": {"family": "doublet", "step": 0.8, "amplitude": 3},
    "2-1-1": {"family": "211", "step": 0.3},
    "3-2-1-1": {"family": "3211", "step": 0.35, "amplitude": 1.5},
    "1-2-3": {"family": "123", "step": 0.4},
    "pulse": {"family": "pulse", "step": 0.5},
    "step": {"family": "step", "duration": 6},
    "sweep": {"family": "sweep", "low": 0.2, "high": 1.2, "period": 7},
    "multisine": {"family": "multisine", "lines": 5, "period": 6},
}
SUITES = {"taurus": "taurus_8hz", "eolo": "eolo_full"}


@cache
def posed(name, control, suite, condition):
    """Return what the testbench would estimate of an aircraft in a condition."""
    aircraft = load_aircraft(name)
    trimmed = trim(aircraft, condition)
    linear, plane = linearise(aircraft, trimmed), studio.PLANES[control]
    return studio._problem(aircraft, trimmed, linear, modes_of(linear, aircraft, plane), control, suite)


def expected(page, tmp_path, name, control, suite, factors=None):
    """Relative errors, as the testbench computes them, of the rigid derivatives that the page's scenario would tell."""
    found = shown(page)
    path = tmp_path / "studio.toml"
    path.write_text(found["scenario"], encoding="utf-8")
    scenario = Scenario.load(path)  # no fault
    manoeuvre, plane = scenario.manoeuvre[0], studio.PLANES[control]
    problem = posed(name, control, suite, FlightCondition(scenario.condition.V_m_s, scenario.condition.h_m))
    u = build(manoeuvre.input, manoeuvre.duration_s, problem.rate_hz).u[:, 0]
    assert np.max(np.abs(np.array(found["u"]) - u)) < 1e-9 * DEG_RAD
    experiment = problem.experiment
    names, structure = experiment.structure.parameter_names, experiment.structure
    rigid = [names.index(p) for p in needed_parameters(plane, (control,), False, ())]
    if factors is not None:
        there = structure.true.copy()
        there[rigid] *= 1.0 + factors[: len(rigid)]
        at = structure.matrices(there)
        free = replace(structure, A0=at.A, B0=at.B, C0=at.C, D0=at.D, true=there)
        experiment = replace(experiment, structure=free)
    # ours is an experiment of another length
    base_hz = problem.rate_hz / problem.experiment.stride
    experiment = replace(experiment, samples=round(manoeuvre.duration_s * base_hz))
    known = accuracy(experiment.information(u[:, None])[np.ix_(rigid, rigid)])
    return {names[i]: s / abs(structure.true[i]) for i, s in zip(rigid, known.std, strict=True)}


def compared(page, errors):
    page_says = {row["name"]: row["relative"] for row in shown(page)["errors"]}
    assert len(errors) >= 4
    for parameter, error in errors.items():
        assert page_says[parameter] == pytest.approx(error, rel=1e-6), parameter


@pytest.mark.parametrize(("name", "families"), [("taurus", CHOICES), ("eolo", ("3-2-1-1", "sweep", "multisine"))])
def test_signal_and_errors_are_those_of_the_testbench(page, tmp_path, name, families):
    choose(page, aircraft=name)
    for family in families:
        choose(page, suite=SUITES[name], **CHOICES[family])
        compared(page, expected(page, tmp_path, name, "de", load_suite(SUITES[name])))


@pytest.mark.parametrize(
    ("name", "control", "suite"),
    [("eolo", "da", "eolo_gap_lateral"), ("eolo", "thr", "eolo_gap"), ("taurus", "dr", "eolo_alpha_beta")],
)
def test_every_control_has_its_motion(page, tmp_path, name, control, suite):
    choose(page, aircraft=name)
    choose(page, control=control)
    choose(page, suite=suite, family="doublet", step=0.5, amplitude=2)
    seen = load_suite(suite)
    if name == "taurus":  # the rate of its simulation, 240 Hz, is no multiple of 100 Hz
        assert "of another aircraft" in page.locator("#suite option:checked").text_content()
        (tmp_path / "suites").mkdir()
        (tmp_path / "suites" / "studio_suite.toml").write_text(shown(page)["suite"], encoding="utf-8")
        seen = load_suite(tmp_path / "suites" / "studio_suite.toml")
        assert seen.rate_hz == 80.0
    compared(page, expected(page, tmp_path, name, control, seen))


def test_edited_sensors_count_and_are_written(page, tmp_path):
    choose(page, aircraft="eolo", suite="eolo_alpha")
    before = {r["name"]: r["relative"] for r in shown(page)["errors"]}
    page.click("summary")
    for channel, what, value in (("q", "0", "1.5"), ("alpha", "1", "80"), ("theta", "2", "40")):
        page.fill(f"#edits input[data-channel='{channel}'][data-what='{what}']", value)
        page.keyboard.press("Tab")
    settle(page)
    assert 'suites = ["studio_suite"]' in shown(page)["scenario"]
    (tmp_path / "suites").mkdir()
    (tmp_path / "suites" / "studio_suite.toml").write_text(shown(page)["suite"], encoding="utf-8")
    suite = load_suite(tmp_path / "suites" / "studio_suite.toml")
    read = {s.channel: s for s in suite.sensors}
    assert np.hypot(read["q"].noise_std, read["q"].quantum / np.sqrt(12.0)) == pytest.approx(1.5 * DEG_RAD, rel=1e-9)
    assert (read["alpha"].lag_s, read["theta"].delay_s) == (0.08, 0.04)
    compared(page, expected(page, tmp_path, "eolo", "de", suite))
    page.fill("#edits input[data-channel='q'][data-what='0']", "0")
    page.keyboard.press("Tab")
    assert "noise above zero" in page.locator("#said").text_content()
    page.click("#as-sold")
    settle(page)
    assert {r["name"]: r["relative"] for r in shown(page)["errors"]} == before


@pytest.mark.slow
def test_the_errors_if_the_model_is_wrong_are_those_of_the_wrong_models(page, data, tmp_path):
    choose(page, aircraft="eolo", suite="eolo_alpha", family="doublet", off_model=20)
    until(page, lambda found: "ranges" in found)
    ranges = shown(page)["ranges"]
    each = [
        expected(page, tmp_path, "eolo", "de", load_suite("eolo_alpha"), 0.2 * np.array(draw)) for draw in data["draws"]
    ]
    for name in each[0]:
        found = sorted(e[name] for e in each)
        at = [found[int(share * (len(found) - 1) + 0.5)] for share in (0.1, 0.9)]
        assert ranges[name] == pytest.approx(at, rel=1e-6)
    assert page.locator("#errors tbody tr").first.locator(".range").text_content().endswith("%")
    choose(page, off_model=0)
    until(page, lambda found: "ranges" in found and found["ranges"]["M_q"][0] == found["ranges"]["M_q"][1])
    row = next(r for r in shown(page)["errors"] if r["name"] == "M_q")
    assert shown(page)["ranges"]["M_q"][0] == pytest.approx(row["relative"], rel=1e-9)


def test_what_was_done_is_undone_and_done_again(page):
    choose(page, aircraft="taurus", family="doublet")
    page.wait_for_timeout(600)
    before = shown(page)
    choose(page, amplitude=4)
    page.wait_for_timeout(600)
    after = shown(page)
    page.keyboard.press("Control+z")
    settle(page)
    assert shown(page)["u"] == before["u"] != after["u"]
    page.click("#redo")
    settle(page)
    assert shown(page)["u"] == after["u"]
    assert page.locator("#redo").is_disabled()
    for _ in range(20):
        page.keyboard.press("Control+z")
    settle(page)
    assert page.locator("#undo").is_disabled()
    assert page.locator("#aircraft").input_value() == "eolo"


def test_keys_and_wheel_shape_the_input(page):
    choose(page, aircraft="taurus", family="doublet", step=1.0, amplitude=2)
    page.locator("#handle").focus()
    for key in ("ArrowRight", "ArrowUp", "ArrowUp"):
        page.keyboard.press(key)
        settle(page)
    assert (page.locator("#step").input_value(), page.locator("#amplitude").input_value()) == ("1.05", "2.2")
    page.locator("#signal svg").hover()
    page.mouse.wheel(0, -100)
    settle(page)
    assert page.locator("#amplitude").input_value() == "2.3"
    page.locator("#duration").focus()
    page.locator("#duration").hover()
    before = float(page.locator("#duration").input_value())
    page.mouse.wheel(0, -100)
    settle(page)
    assert float(page.locator("#duration").input_value()) == before + 1
    page.locator("#signal svg").hover()
    page.mouse.wheel(0, -100)
    settle(page)
    assert page.locator("#amplitude").input_value() == "2.3"  # the handle is not chosen: the page scrolls


@pytest.mark.parametrize(("name", "control", "family"), [("eolo", "de", "3211"), ("taurus", "da", "sweep")])
def test_the_plan_is_one_that_can_be_planned(page, tmp_path, name, control, family):
    choose(page, aircraft=name)
    choose(page, control=control, family=family)
    if "studio_suite" in shown(page)["plan"]:
        (tmp_path / "suites").mkdir()
        (tmp_path / "suites" / "studio_suite.toml").write_text(shown(page)["suite"], encoding="utf-8")
    with page.expect_download() as waiting:
        page.click("#plan")
    waiting.value.save_as(tmp_path / "studio_plan.toml")
    scenario = PlanScenario.load(tmp_path / "studio_plan.toml")
    assert scenario.aircraft == name
    assert scenario.manoeuvre[0].input[0].control == control


def test_every_slider_moves_by_keyboard_and_changes_what_is_said(page):
    choose(page, aircraft="taurus")
    for family, ids in (("3211", ("speed", "amplitude", "step", "duration")), ("sweep", ("low", "high", "period"))):
        choose(page, family=family)
        for name in ids:
            before = page.locator(f"#{name}-is").text_content(), shown(page)
            page.locator(f"#{name}").focus()
            page.keyboard.press("ArrowRight")
            settle(page)
            assert page.locator(f"#{name}-is").text_content() != before[0]
            assert shown(page)["errors"] != before[1]["errors"]
    choose(page, family="multisine")
    page.locator("#lines").focus()
    page.keyboard.press("ArrowLeft")
    settle(page)
    assert page.locator("#lines-is").text_content().startswith("10,")


def test_a_sensor_less_makes_errors_larger_and_none_is_said(page):
    choose(page, aircraft="eolo", suite="eolo_alpha")
    before = {r["name"]: r["relative"] for r in shown(page)["errors"]}
    first = page.locator("#answer").text_content().split(". ")[0]
    assert "parameters" in first
    assert len(first.split()) <= MOST_WORDS
    page.uncheck("#sensors input[value='alpha']")
    settle(page)
    after = {r["name"]: r["relative"] for r in shown(page)["errors"]}
    assert all(after[n] >= before[n] for n in before)
    assert after["Z_alpha"] > 1.1 * before["Z_alpha"]
    assert '"alpha"' not in shown(page)["scenario"].split("outputs")[1]
    for channel in ("V", "q", "theta"):
        page.uncheck(f"#sensors input[value='{channel}']")
    settle(page)
    assert "there is no information" in page.locator("#answer").text_content()


def test_a_mode_to_find_as_well_costs_accuracy(page):
    choose(page, aircraft="eolo", suite="eolo_five_accelerometers")
    before = {r["name"]: r["relative"] for r in shown(page)["errors"]}
    page.select_option("#mode", index=1)
    settle(page)
    after = {r["name"]: r["relative"] for r in shown(page)["errors"]}
    assert {"omega_1", "zeta_1"} <= after.keys() - before.keys()
    assert all(after[n] >= before[n] * (1 - 1e-9) for n in before)


def test_the_handle_is_dragged(page):
    choose(page, aircraft="taurus", family="doublet", step=1.0, amplitude=2)
    box = page.locator("#handle").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 20, steps=3)
    page.mouse.up()
    settle(page)
    assert float(page.locator("#step").input_value()) > 1.5
    assert float(page.locator("#amplitude").input_value()) < 1.8


def test_too_large_an_amplitude_breaks_a_limit_in_words(page):
    choose(page, aircraft="eolo", family="pulse", step=3, amplitude=25)
    assert "breaks the limit of α" in page.locator("#answer").text_content()


def test_an_input_is_kept_and_compared(page):
    choose(page, aircraft="taurus", family="doublet")
    page.click("#pin")
    before = page.locator("#errors tbody tr").first.locator(".number").nth(1).text_content()
    choose(page, family="3211")
    row = page.locator("#errors tbody tr").first
    assert row.locator(".kept").text_content() == before
    assert row.locator(".number").nth(1).text_content() != before
    assert page.locator("#signal .kept").count() == 1
    page.click("#pin")
    settle(page)
    assert page.locator("#signal .kept").count() == 0


def test_the_address_holds_the_state_and_nonsense_in_it_is_survived(page, file):
    choose(page, aircraft="taurus", family="211", step=0.7, amplitude=3)
    wanted, address = shown(page), page.url
    page.goto("about:blank")
    page.goto(address)
    settle(page)
    assert shown(page) == wanted
    for odd in (
        "#aircraft=b2&V=abc&step=-5&amplitude=1e9&lines=7&suite=%3Cimg%3E",
        "#family=__proto__",
        "#V=",
        "#off=,,",
    ):
        page.goto("about:blank")
        page.goto(file.as_uri() + odd)
        settle(page)
        assert shown(page)["errors"]
        assert page.locator("img").count() == 0


def test_the_scenario_is_downloaded(page, tmp_path):
    with page.expect_download() as waiting:
        page.click("#download")
    waiting.value.save_as(tmp_path / waiting.value.suggested_filename)
    assert Scenario.load(tmp_path / "studio.toml").aircraft == "eolo"
    page.click("#link")
    settle(page)
    assert page.locator("#said").text_content()


def test_it_fits_a_narrow_screen_and_is_labelled(page):
    page.set_viewport_size({"width": 400, "height": 800})
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    unlabelled = "[...document.querySelectorAll('input, select')].filter(e => !e.labels.length && !e.ariaLabel).length"
    assert page.evaluate(unlabelled) == 0


def test_only_what_holds_no_control_is_a_picture(page):
    assert page.locator("svg[role=img]").count() > 0
    assert page.locator("svg[role=img] [tabindex]").count() == 0
    assert page.locator("svg[role=group] #handle").count() == 1
