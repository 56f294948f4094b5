"""The app: what it takes and refuses by http, and the journeys of its users in a browser."""

import json
import os
from collections.abc import Iterator
from http.client import HTTPConnection
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from drawn_sets import SMALL
from studies.reliability.small import GAP
from two_flights import RECORD, write_results_of
from writers import G0, THROW, elevator, short_period

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.core.paths import SCENARIOS
from testbench.page.serve import serving
from testbench.questions.app.ask import Job, Workbench
from testbench.questions.exercise.ask import start

pytestmark = pytest.mark.drawn


@pytest.fixture(autouse=True)
def kept(tmp_path_factory, monkeypatch) -> Path:
    """Where servers keep their address and commands."""
    folder = tmp_path_factory.mktemp("kept")
    monkeypatch.setattr("testbench.questions.app.ask.kept_in", lambda kind: folder / kind)
    return folder / "app"


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Any]:
    """A running app in an empty folder, with its address as ``at``."""
    with Workbench(tmp_path) as bench, serving(bench.answer, 0, bench.take) as server:
        Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        bench.port = server.server_port
        bench.at = f"http://127.0.0.1:{bench.port}{bench.home}"
        yield bench
        server.shutdown()


def asked(bench: Any, path: str, body: bytes | None = None, origin: str | None = "") -> tuple[int, bytes]:
    """Return status and answer of GET, or of POST where there is a body; ``origin`` is the app's own if empty."""
    connection = HTTPConnection("127.0.0.1", bench.port, timeout=60)
    stated = f"http://127.0.0.1:{bench.port}" if origin == "" else origin
    headers = {} if stated is None or body is None else {"Origin": stated}
    connection.request("GET" if body is None else "POST", path, body, headers)
    answer = connection.getresponse()
    return answer.status, answer.read()


def flight(folder: Path) -> Path:
    """Write the log of a short flight with two doublets, whose short period answers: a table with names and units."""
    t = np.arange(0.0, 35.0, 0.02)
    q, theta, az = short_period(t)
    file = folder / "my flight.csv"
    columns = np.column_stack([t, q / DEG_RAD, theta / DEG_RAD, -THROW * elevator(t) / DEG_RAD, az / G0])
    names = "time [s],q [deg/s],theta [deg],de [deg],az [g]"
    np.savetxt(file, columns, delimiter=",", header=names, comments="", fmt="%.9g")
    return file


def fits(page: Any) -> None:
    """Check that nothing of the page is wider than a screen, whatever that one's width."""
    for width in (400, 800, 1280, 1600):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.set_viewport_size({"width": 400, "height": 800})


def test_what_cannot_be_a_log_or_started_is_said_and_nothing_hangs(bench):
    (bench.folder / "logs").mkdir()
    os.mkfifo(bench.folder / "logs" / "pipe.csv")
    (bench.folder / "logs" / "zero.csv").symlink_to("/dev/zero")
    for name in ("pipe.csv", "zero.csv"):
        assert asked(bench, f"{bench.home}logs/{name}", b"1") == (
            200, json.dumps({"log": f"logs/{name.replace('.', '_2.')}"}).encode(),
        )  # fmt: skip
    for name in ("CON", "a:b.csv", "a%0ab.csv", "a."):
        assert asked(bench, f"{bench.home}logs/{name}", b"1")[0] == 404
    status, answer = asked(bench, f"{bench.home}logs/{'x' * 300}", b"1")
    assert (status, b"File name too long" in answer) == (507, True)
    for body in (b"[" * 100_000, b'["check", "a\\u0000b"]'):
        assert asked(bench, f"{bench.home}ask", body)[0] == 400
    for number, word in enumerate(("\ud800", "x" * 200_000)):
        assert asked(bench, f"{bench.home}ask", json.dumps(["check", word]).encode())[0] == 200
        events = asked(bench, f"{bench.home}jobs/{number}")[1]
        assert b"error: the command cannot be started" in events
        assert b"event: end" in events


def test_without_the_token_or_from_another_page_nothing_is_said_or_taken(bench):
    home = bench.home
    assert asked(bench, home)[0] == 200
    for path in (
        "/",
        "/x" + home,
        home[:-2] + "/",
        "/jobs",
        home + "nothing",
        home + "jobs/0",
        home + "results/../logs",
    ):
        assert asked(bench, path)[0] == 404, path
    for origin in (None, "http://evil.example", "null"):
        assert asked(bench, f"{home}logs/a.csv", b"1", origin)[0] == 403, origin
    for path in ("/logs/a.csv", f"{home}logs/..", f"{home}logs/.hidden", f"{home}logs/a/b", f"{home}ask/run", home):
        assert asked(bench, path, b"1")[0] == 404, path
    assert not list(bench.folder.iterdir())
    for body in (b"", b"{}", b"[]", b"[1]", b"\xff", b'["run", ""]', b'["run\\u0000"]'):
        assert asked(bench, f"{home}ask", body)[0] == 400, body
    for words in (["rm"], ["app"], ["live"], ["sitl"], ["--help"], ["-v", "run"]):
        status, said = asked(bench, f"{home}ask", json.dumps(words).encode())
        assert status == 400
        assert "a command must be one of" in json.loads(said)["error"]
    assert bench.jobs == []


def test_a_log_is_kept_as_it_was_sent_and_never_over_another(bench):
    names = [
        json.loads(asked(bench, f"{bench.home}logs/a.csv", body)[1])["log"] for body in (b"1" * 300_000, b"2", b"2")
    ]
    assert names == ["logs/a.csv", "logs/a_2.csv", "logs/a_2.csv"]
    assert (bench.folder / "logs" / "a.csv").read_bytes() == b"1" * 300_000
    assert sorted(p.name for p in (bench.folder / "logs").iterdir()) == ["a.csv", "a_2.csv"]


def test_a_command_is_followed_to_its_end(bench):
    started = json.loads(asked(bench, f"{bench.home}ask", b'["import", "./-o", "--out", "results/-o_log"]')[1])
    assert started["command"] == "testbench import ./-o --out results/-o_log"
    events = asked(bench, f"{bench.home}jobs/0")[1].decode()
    end = json.loads(events.split("event: end\ndata: ")[1])
    assert (end["status"], end["pages"]) == (2, [])
    assert "error: a log must be a file that exists" in events
    assert json.loads(asked(bench, f"{bench.home}jobs")[1]) == [end]


def test_a_file_of_a_question_is_changed_and_no_other(bench):
    file = bench.folder / "mine.toml"
    file.write_text("old", encoding="utf-8")
    (bench.folder / "notes.txt").write_text("mine", encoding="utf-8")
    given = {"file": "mine.toml", "text": "title = 'ä'\n"}
    assert json.loads(asked(bench, f"{bench.home}show/text", json.dumps(given).encode())[1]) == {"text": "old"}
    assert json.loads(asked(bench, f"{bench.home}save", json.dumps(given).encode())[1]) == {"text": given["text"]}
    assert file.read_text("utf-8") == given["text"]
    for name in ("notes.txt", "new.toml", "../mine.toml", "", None):
        assert asked(bench, f"{bench.home}save", json.dumps(given | {"file": name}).encode())[0] == 400, name
    assert (bench.folder / "notes.txt").read_text("utf-8") == "mine"


def test_a_new_server_has_the_address_and_the_commands_of_the_one_before(tmp_path, kept):
    with Workbench(tmp_path) as first:
        first.jobs += [Job(("run", "a"), [(0.5, "Report: results/a/report.html")], 1.0, 2.5, 0), Job(("gap", "b"))]
        first._keep()
    (file,) = kept.iterdir()
    assert file.stat().st_mode & 0o077 == 0  # the token is for its user alone
    with Workbench(tmp_path) as second:
        assert second.home == first.home
        told = [job.told(k) for k, job in enumerate(second.jobs)]
        assert [(t["command"], t["status"]) for t in told] == [("testbench run a", 0), ("testbench gap b", 1)]
        assert (told[0]["pages"], told[0]["lasted"]) == (["results/a/report.html"], 1.5)
        assert "interrupted" in second.jobs[1].lines[-1][1]
    for content in ("{}", "[]", "null", "x", '{"token": "../x", "jobs": []}', '{"token": 5, "jobs": 5}'):
        file.write_text(content, encoding="utf-8")
        with Workbench(tmp_path) as third:
            assert third.home != first.home
            assert third.jobs == []


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RecordError, match="a folder to work in must exist"):
        Workbench(tmp_path / "nowhere")


def test_flights_are_chosen_overlaid_and_cut_by_keyboard_on_a_narrow_screen(bench, browser):
    """What is chosen stands in the address; a cut is moved by keys; a reload shows the same; nothing is fetched."""
    write_results_of(bench.folder)
    fitted = '[[identification.estimators]]\nmethod = "output_error"\nstructure = "short_period"\n'
    (bench.folder / RECORD).with_name("first_longitudinal.toml").write_text(fitted, encoding="utf-8")
    context = browser.new_context(viewport={"width": 400, "height": 800})
    outside: list[str] = []
    context.on("request", lambda r: r.url.startswith((bench.at, "data:")) or outside.append(r.url))
    page = context.new_page()
    page.on("pageerror", lambda e: outside.append(str(e)))
    page.goto(bench.at)
    page.get_by_label("whole log").press("Space")
    page.get_by_role("button", name="cruise, 10 to 39.98 s").press("Enter")
    page.get_by_label("Structure of the model").select_option("let the records choose")
    page.get_by_role("button", name="Identify longitudinal").press("Enter")
    page.get_by_text("first_longitudinal.toml --choose --out results").first.wait_for()
    edge = page.get_by_role("slider", name="end of cut 1")
    edge.press("Shift+ArrowLeft")
    assert float(edge.get_attribute("aria-valuenow")) == 24.0
    page.get_by_role("button", name="V", exact=True).press("Enter")
    page.wait_for_url("**c=de&c=q&z=log&from=10&to=39.98")
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.reload()
    page.locator("#plot .u-over").nth(1).wait_for()
    assert page.evaluate("flight.explorer.range") == [10.0, 39.98]
    page.get_by_label("other", exact=True).press("Space")
    page.get_by_role("button", name="first").wait_for()
    assert page.get_by_label("Channels").locator("[aria-pressed=true]").all_inner_texts() == ["δe", "q"]
    assert page.locator("#plot .u-over").count() == 2
    assert outside == []
    context.close()


@pytest.mark.slow  # it starts three commands
def test_a_dropped_log_is_cut_anew_and_identified_by_keyboard(bench, browser, tmp_path_factory):
    """From a file to its timeline, an edge moved, the import with that cut; a second tab and a reload show the same."""
    log = flight(tmp_path_factory.mktemp("elsewhere"))
    context = browser.new_context(viewport={"width": 400, "height": 800})
    outside: list[str] = []
    context.on("request", lambda r: r.url.startswith((bench.at, "data:")) or outside.append(r.url))
    page = context.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.goto(bench.at)
    page.get_by_role("button", name="Look into it").press("Enter")
    page.get_by_text("a log must be dropped, chosen or named first").wait_for()
    page.get_by_label("Drop logs anywhere").set_input_files(log)
    page.get_by_role("button", name="Look into it").press("Enter")
    page.get_by_text("testbench import 'logs/my flight.csv' --out results/my_flight_log").first.wait_for()
    page.get_by_role("button", name="manoeuvre").first.wait_for(timeout=60_000)
    edge = page.get_by_role("slider", name="end of cut 1")
    before = float(edge.get_attribute("aria-valuenow"))
    edge.press("Shift+ArrowLeft")
    assert float(edge.get_attribute("aria-valuenow")) == pytest.approx(before - 1.0)
    page.get_by_role("button", name="Apply these cuts").press("Enter")
    page.get_by_role("button", name="As found").wait_for(state="detached", timeout=60_000)
    assert float(edge.get_attribute("aria-valuenow")) == pytest.approx(before - 1.0, abs=0.01)
    assert bench.jobs[-1].words[-2] == "--cut"
    page.get_by_role("button", name="Spectra").press("Enter")
    page.locator("#spectra .u-over").first.wait_for()
    page.get_by_role("button", name="Replay in 3D").press("Enter")
    page.get_by_text("0.0 s: roll").wait_for()
    page.locator("#plot .plot").first.press("ArrowRight")
    page.get_by_text("0.0 s: roll").wait_for(state="detached")  # it goes with the cursor
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert page.get_by_label("Structure of the model").count() == 0  # without airspeed there is none to fit
    page.get_by_role("button", name="Identify longitudinal").press("Enter")
    page.get_by_text("all outputs predicted well").first.wait_for(timeout=120_000)
    page.locator("#verdict figure").first.scroll_into_view_if_needed()  # it is drawn when it comes near
    page.locator("#verdict .u-over").first.wait_for()
    page.get_by_role("button", name="Poles found").press("Enter")
    page.get_by_text("Im s, rad/s").wait_for()
    fits(page)
    page.reload()
    second = context.new_page()
    second.goto(page.url)
    for tab in (page, second):
        tab.locator("#plot .u-over").first.wait_for()
        tab.get_by_text("all outputs predicted well").first.wait_for()
        tab.get_by_role("link", name="Work").press("Enter")
        assert tab.get_by_role("article").count() == 3
    second.get_by_role("link", name="Board").press("Enter")
    second.get_by_role("link", name="my flight.csv: contents").press("Enter")
    assert "my flight" in second.frame_locator("#frame").locator("h1").inner_text()
    assert (outside, wrong) == ([], [])
    context.close()


@pytest.mark.slow  # a campaign takes half a minute
def test_a_campaign_is_watched_stopped_and_resumed(bench, browser):
    """Runs arrive while it flies; a limit on an axis chooses among them; a run is looked at; it is stopped, resumed."""
    text = (SCENARIOS / "campaign" / "taurus_scatter.toml").read_text(encoding="utf-8")
    (bench.folder / "mine.toml").write_text(text.replace("runs = 24", "runs = 300"), encoding="utf-8")
    page = browser.new_context().new_page()
    page.goto(f"{bench.at}#work")
    page.get_by_label("testbench").fill("campaign run mine.toml")
    page.get_by_label("testbench").press("Enter")
    counts = page.locator("#counts")
    page.locator("#table tbody tr").nth(3).wait_for(timeout=60_000)
    page.get_by_role("button", name="Stop").press("Enter")
    counts.filter(has_text="not at work").wait_for(timeout=60_000)
    kept = page.locator("#done").evaluate("e => e.value")
    assert 3 < kept < 300
    page.get_by_role("button", name="Resume").press("Enter")
    counts.filter(has_text="300 of 300 runs").wait_for(timeout=300_000)
    speeds = page.evaluate("[...campaign.rows.values()].map(r => r.inputs['condition.V_m_s'])")
    page.get_by_label("least of condition.V_m_s").fill("12.2")
    page.get_by_label("least of condition.V_m_s").press("Enter")
    chosen = sum(V >= 12.2 for V in speeds)
    page.get_by_text(f"{chosen} of 300 runs.").wait_for()
    page.get_by_role("button", name="run 299").or_(page.locator("#table tbody button").first).first.press("Enter")
    assert "seed" in page.locator("#detail").inner_text()


@pytest.mark.slow  # some hundred flights are drawn
def test_a_data_set_is_watched_stopped_and_resumed_by_keyboard(bench, browser):
    """Draws and failed attempts arrive; those of a level, and the failed, are chosen; a flight is looked at."""
    hard = SMALL.replace("[1.0, 1.2]", "[0.6, 1.2]").replace("flights = 60", "flights = 3000")
    (bench.folder / "hard.toml").write_text(hard, encoding="utf-8")
    context = browser.new_context(viewport={"width": 400, "height": 800})
    page = context.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.goto(f"{bench.at}#board")
    page.get_by_role("button", name="dataset hard.toml --out results/hard").press("Enter")
    page.get_by_label("testbench").press("Enter")
    page.locator("#table tbody tr").nth(3).wait_for(timeout=180_000)
    page.get_by_role("button", name="Stop").press("Enter")
    counts = page.locator("#counts")
    counts.filter(has_text="not at work").wait_for(timeout=60_000)
    kept = page.locator("#done").evaluate("e => e.value")
    assert 0 < kept < 3000
    failed = page.evaluate("[...campaign.rows.values()].filter(r => r.failed).length")
    page.get_by_role("button", name=f"failed: {failed}").press("Enter")
    page.get_by_text(f"{failed} of {int(kept) // 2 + failed} runs.").wait_for()
    page.locator("#table tbody button").first.press("Enter")
    assert "TrimError" in page.locator("#detail").inner_text()
    page.get_by_role("button", name=f"failed: {failed}").press("Enter")
    page.get_by_role("button", name="Resume").press("Enter")
    counts.filter(has_text="3000 of 3000 flights").wait_for(timeout=300_000)
    page.get_by_role("button", name="hidden: ").press("Enter")
    page.locator("#table tbody button").first.press("Enter")
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.get_by_role("button", name="Its time histories").press("Enter")
    page.locator("#plot .u-over").first.wait_for()
    assert "flight" in page.locator("#flight h2").first.inner_text()
    assert [job.words[0] for job in bench.jobs] == ["dataset", "dataset"]
    assert wrong == []
    context.close()


@pytest.mark.slow  # a search takes half a minute
def test_probabilities_fill_up_while_a_gap_is_sought(bench, browser):
    page = browser.new_context().new_page()
    page.goto(f"{bench.at}#work")
    page.get_by_label("testbench").fill("gap flexible_wings")
    page.get_by_label("testbench").press("Enter")
    page.get_by_text("To first order, before any is flown").wait_for(timeout=120_000)
    kept = bench.folder / "results" / "gap_flexible_wings" / "search.jsonl"
    while not kept.is_file() or kept.read_text("utf-8").count("\n") < 2:
        page.wait_for_timeout(100)
    page.get_by_role("button", name="Stop").press("Enter")
    page.get_by_role("button", name="Resume").press("Enter")
    page.get_by_text("done in").wait_for(timeout=300_000)
    assert any("fits of the search that was interrupted" in line for _, line in bench.jobs[1].lines)
    assert not kept.exists()
    first = page.locator(".found").first.inner_text().split("\n")
    assert first[0] == "symmetric wing bending"
    assert float(first[1].removesuffix(" %")) > 99.0
    page.get_by_role("heading", name="EOLO: the wings bend").wait_for()
    page.get_by_role("button", name="The whole page").press("Enter")
    assert "the wings bend" in page.frame_locator("#frame").locator("h1").inner_text()


@pytest.mark.slow  # a short search and a survey
def test_from_a_gap_to_the_amended_aircraft_by_keyboard(bench, browser):
    """The file is asked from the board, the answer names what was hidden, and the aircraft that has it is surveyed."""
    (bench.folder / "mine.toml").write_text(GAP, encoding="utf-8")
    context = browser.new_context(viewport={"width": 400, "height": 800})
    page = context.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.goto(f"{bench.at}#board")
    page.get_by_role("button", name="gap mine.toml").press("Enter")
    page.get_by_label("testbench").press("Enter")
    page.get_by_role("heading", name="Thrust above the centre of gravity").wait_for(timeout=300_000)
    fits(page)
    page.get_by_role("button", name="Look at the amended aircraft").press("Enter")
    page.get_by_text("testbench aircraft results/gap_mine/amended/taurus --out results").first.wait_for()
    page.get_by_role("heading", name="Taurus-like").first.wait_for(timeout=300_000)
    fits(page)
    page.get_by_role("button", name="The whole page").first.press("Enter")
    assert "taurus" in page.frame_locator("#frame").locator("h1").inner_text().lower()
    assert [job.words[0] for job in bench.jobs] == ["gap", "aircraft"]
    assert wrong == []
    context.close()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_view_has_a_serious_fault_of_accessibility(bench, browser, scheme):
    """By axe-core (MPL-2.0), which is only used here."""
    found = find_spec("axe_playwright_python")
    if found is None or found.origin is None:
        pytest.skip("axe-core needs axe-playwright-python to be tried")
    axe = Path(found.origin).with_name("axe.min.js").read_text(encoding="utf-8")
    write_results_of(bench.folder)
    start("doublet_length", "ada", "of a test", bench.folder / "ada")
    context = browser.new_context(color_scheme=scheme, bypass_csp=True)
    page = context.new_page()
    for view in (
        f"flights?r={RECORD}",
        "design?of=taurus_short_period",
        "work",
        "campaigns",
        "board",
        "exercises?of=ada",
    ):
        page.goto("about:blank")
        page.goto(f"{bench.at}#{view}")
        page.get_by_role("link", name="Board").wait_for()
        if view.startswith("flights"):
            page.get_by_role("button", name="Spectra").click()
            page.locator("#spectra .u-over").first.wait_for()
            page.get_by_role("button", name="Replay in 3D").click()
        if view.startswith("design"):
            page.locator("#spectrum-drawn .u-over").wait_for(timeout=60_000)
        page.wait_for_timeout(300)
        page.evaluate("text => (0, eval)(text)", axe)
        faults = page.evaluate("axe.run().then(r => r.violations.map(v => [v.impact, v.id]))")
        assert [fault for fault in faults if fault[0] in ("serious", "critical")] == [], view
    context.close()


def test_an_input_is_drawn_by_keyboard_and_stays_after_a_reload(bench, browser):
    """An edge and the amplitude of a first input are moved by keys; errors follow; the address holds all."""
    context = browser.new_context(viewport={"width": 400, "height": 800})
    outside: list[str] = []
    context.on("request", lambda r: r.url.startswith((bench.at, "data:")) or outside.append(r.url))
    page = context.new_page()
    page.on("pageerror", lambda e: outside.append(str(e)))
    page.goto(f"{bench.at}#design")
    page.get_by_label("of", exact=True).select_option("taurus")
    page.get_by_role("button", name="Draw an input").press("Enter")
    edge = page.get_by_role("slider", name="end of step 1, s")
    edge.wait_for(timeout=60_000)
    page.get_by_text("wanted accuracies; the worst is").wait_for()

    def errors() -> list[str]:
        return page.locator("#errors-drawn tbody td:nth-child(4)").all_inner_texts()

    first, before = errors(), float(edge.get_attribute("aria-valuenow"))
    edge.press("Shift+ArrowRight")
    assert float(edge.get_attribute("aria-valuenow")) == pytest.approx(before + 0.5, abs=0.011)
    assert page.evaluate("document.activeElement.dataset.handle") == "step 0 0"
    page.wait_for_function("() => !design.busy && !design.wanted")
    assert errors() != first
    page.get_by_role("slider", name="amplitude, deg").press("ArrowDown")
    page.get_by_label("δe, deg", exact=True).fill("30")
    page.get_by_label("δe, deg", exact=True).press("Enter")
    page.get_by_text("breaks the limit on").wait_for()
    page.get_by_label("signal", exact=True).select_option("multistep")
    page.get_by_role("button", name="+ step").press("Enter")
    page.wait_for_url("**pattern**")
    page.wait_for_function("() => design.found && !design.busy && design.entries[0].pattern.length === 3")
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    kept = page.evaluate("JSON.stringify(design.entries)")
    page.reload()
    page.get_by_role("slider", name="end of step 3").wait_for(timeout=60_000)
    assert page.evaluate("JSON.stringify(design.entries)") == kept
    page.get_by_role("button", name="Over 20 drawn aircraft").press("Enter")
    page.get_by_role("columnheader", name="worst drawn").wait_for(timeout=120_000)
    fits(page)
    assert outside == []
    context.close()


@pytest.mark.slow  # a design and a plan take half a minute
def test_from_a_drawn_input_to_its_cards(bench, browser):
    """The drawn input is dragged by the pointer, judged by the command, planned, and its cards are there to print."""
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.goto(f"{bench.at}#design?aircraft=taurus")
    edge = page.get_by_role("slider", name="end of step 1, s")
    edge.wait_for(timeout=60_000)
    box, before = edge.bounding_box(), float(edge.get_attribute("aria-valuenow"))
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 140, box["y"] + 5, steps=12)
    page.mouse.up()
    assert float(edge.get_attribute("aria-valuenow")) > before + 0.05
    page.get_by_role("button", name="Run the full design").press("Enter")
    page.get_by_text("testbench design taurus_de_input.toml --out results").first.wait_for()
    page.get_by_role("button", name="Plan it, with cards").press("Enter", timeout=300_000)
    page.get_by_role("link", name="Cards to print").wait_for(timeout=300_000)
    for name in ("Cards to print", "Kneeboard"):
        assert page.request.get(page.get_by_role("link", name=name).evaluate("a => a.href")).body()[:4] == b"%PDF"
    assert [job.words[0] for job in bench.jobs] == ["design", "plan"]
    fits(page)
    drawn = page.evaluate("design.entries[0].period_s")
    for name in ("taurus_de_input.toml", "results/plan_taurus_de_input/taurus_de_input.toml"):
        assert f"period_s = {drawn}" in (bench.folder / name).read_text("utf-8")
    page.reload()
    page.get_by_role("link", name="Cards to print").wait_for()


@pytest.mark.slow  # it starts two commands
def test_an_exercise_is_begun_answered_and_checked_by_keyboard(bench, browser, monkeypatch):
    context = browser.new_context(viewport={"width": 400, "height": 800})
    page = context.new_page()
    page.goto(f"{bench.at}#exercises")
    page.get_by_role("button", name="Begin").press("Enter")
    page.get_by_text("whose version it is must be said").wait_for()
    page.get_by_label("Your name or number").fill("ada")
    page.get_by_label("Exercise", exact=True).select_option("doublet_length")
    page.get_by_role("button", name="Begin").press("Enter")
    page.get_by_role("heading", name="the version of ada").wait_for(timeout=60_000)
    assert "doublet" in page.frame_locator("iframe[title^=Text]").locator("body").inner_text()
    number = page.locator("form input[name]").first
    number.fill("3")
    page.get_by_role("button", name="Save and check").press("Enter")
    page.get_by_text("right, 1 not answered").or_(page.get_by_text("not answered yet")).first.wait_for(timeout=60_000)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.reload()
    assert number.input_value() == "3"
    assert [job.words[:2] for job in bench.jobs] == [("exercise", "start"), ("exercise", "check")]
    context.close()
