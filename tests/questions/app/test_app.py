"""The app: what it takes and refuses by http, and the journey from a dropped log to the page of its result."""

import json
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from short_flight import DE, Q, T

from testbench.core.errors import RecordError
from testbench.page.serve import serving
from testbench.questions.app.ask import Workbench

pytestmark = pytest.mark.drawn


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
    """Write the log of a short flight with a doublet: a table with names and units."""
    lines = ["time [s],de [deg],q [deg/s]", *(f"{t:.2f},{de:.6f},{q:.6f}" for t, de, q in zip(T, DE, Q, strict=True))]
    file = folder / "my flight.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


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
    for body in (b"", b"{}", b"[]", b"[1]", b"\xff"):
        status, said = asked(bench, f"{home}ask/identify", body)
        assert (status, json.loads(said)) == (400, {"error": "logs must be a JSON list of names"})
    assert bench.jobs == []


def test_a_log_is_kept_as_it_was_sent_and_never_over_another(bench):
    names = [
        json.loads(asked(bench, f"{bench.home}logs/a.csv", body)[1])["log"] for body in (b"1" * 300_000, b"2", b"2")
    ]
    assert names == ["logs/a.csv", "logs/a_2.csv", "logs/a_2.csv"]
    assert (bench.folder / "logs" / "a.csv").read_bytes() == b"1" * 300_000
    assert sorted(p.name for p in (bench.folder / "logs").iterdir()) == ["a.csv", "a_2.csv"]


def test_a_command_is_followed_to_its_end_and_its_words_are_no_options(bench):
    started = json.loads(asked(bench, f"{bench.home}ask/look", b'["-o"]')[1])
    assert started["command"] == "testbench import ./-o --out results/-o_log"
    events = asked(bench, f"{bench.home}jobs/0")[1].decode()
    end = json.loads(events.split("event: end\ndata: ")[1])
    assert (end["status"], end["pages"]) == (2, [])
    assert "error: a log must be a file that exists" in events
    assert json.loads(asked(bench, f"{bench.home}jobs")[1]) == [end]


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RecordError, match="a folder to work in must exist"):
        Workbench(tmp_path / "nowhere")


def test_a_dropped_log_becomes_the_page_of_its_result_by_keyboard(bench, browser, tmp_path_factory):
    """From a file to the page in the frame; a second tab and a reload show the same, and nothing is fetched outside."""
    log = flight(tmp_path_factory.mktemp("elsewhere"))
    context = browser.new_context(viewport={"width": 400, "height": 800})
    outside: list[str] = []
    context.on("request", lambda r: r.url.startswith(bench.at) or outside.append(r.url))
    page = context.new_page()
    wrong: list[str] = []
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.goto(bench.at)
    page.get_by_role("button", name="Identify").press("Enter")
    page.get_by_text("a log must be dropped, chosen or named first").wait_for()
    page.get_by_label("Drop logs here").set_input_files(log)
    page.get_by_role("button", name="Only look").press("Enter")
    page.get_by_text("testbench import 'logs/my flight.csv' --out 'results/my flight_log'").wait_for()
    page.get_by_text("done", exact=True).wait_for(timeout=60_000)
    frame = page.frame_locator("iframe")
    assert "my flight" in frame.locator("h1").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.reload()
    second = context.new_page()
    second.goto(bench.at)
    for tab in (page, second):
        tab.frame_locator("iframe").locator("h1").wait_for()
        assert tab.get_by_role("article").count() == 1
    second.get_by_text("All results of this folder").click()
    second.get_by_role("link").first.wait_for()
    assert (outside, wrong) == ([], [])
    context.close()
