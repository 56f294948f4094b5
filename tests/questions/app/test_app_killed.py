"""A server of the app that is killed and started again: its address, its commands and their work go on."""

import json
import os
import signal
import subprocess
import sys
import time
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from drawn_sets import SMALL

import testbench as tb

ASKED = ["dataset", "small.toml", "--out", "results/set", "--workers", "1"]


def begun(folder: Path, cache: Path) -> tuple[subprocess.Popen[str], str]:
    """Start the app in a folder; return it and its address."""
    words = [sys.executable, "-m", "testbench", "app", str(folder), "--port", "0"]
    place = os.environ | {"XDG_CACHE_HOME": str(cache)}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=place)
    assert process.stdout is not None
    return process, process.stdout.readline().split()[1]


def asked(address: str, path: str, given: Any = None) -> Any:
    """Return what the app answers to GET, or to POST of an object."""
    parts = urlsplit(address)
    connection = HTTPConnection(parts.netloc, timeout=60)
    body = None if given is None else json.dumps(given)
    headers = {} if given is None else {"Origin": f"http://{parts.netloc}"}
    connection.request("GET" if given is None else "POST", f"{parts.path}{path}", body, headers)
    return json.loads(connection.getresponse().read())


@pytest.mark.slow  # two servers and some hundred flights
def test_what_a_killed_server_had_begun_goes_on_under_the_next(tmp_path):
    """Killed after a first part: what was flown is kept, and the same command ends with the same bytes."""
    bench, cache = tmp_path / "bench", tmp_path / "cache"
    bench.mkdir()
    (bench / "small.toml").write_text(SMALL.replace("flights = 60", "flights = 200"), encoding="utf-8")
    first, address = begun(bench, cache)
    look = {"campaign": "results/set", "first": 0}
    try:
        asked(address, "ask", ASKED)
        journal = bench / "results" / "set" / ".testbench" / "new" / ".drawing" / "parts.jsonl"
        while not (journal.exists() and journal.stat().st_size):
            time.sleep(0.05)
        before = asked(address, "show/campaign", look)["finished"]
        assert 0 < before < 200
    finally:
        first.send_signal(signal.SIGKILL)
        first.wait()
    second, again = begun(bench, cache)
    try:
        assert urlsplit(again).path == urlsplit(address).path
        (job,) = asked(again, "jobs")
        assert (job["words"], job["status"]) == (ASKED, 1)
        told = asked(again, "show/campaign", look)
        assert told["finished"] >= before
        assert told["command"] == ASKED
        for _ in range(600):  # what the killed server left may still hold the folder, and says so until it ends
            number = asked(again, "ask", told["command"])["number"]
            while (job := asked(again, "jobs")[number])["status"] is None:
                time.sleep(0.2)
            if job["status"] == 0:
                break
            time.sleep(1.0)
        assert asked(again, "show/campaign", look)["finished"] == 200
    finally:
        second.terminate()
        second.wait()
    tb.draw_dataset(bench / "small.toml", tmp_path / "straight", workers=1)
    for name in ("flights.h5", "truth_test.h5"):
        assert (bench / "results" / "set" / name).read_bytes() == (tmp_path / "straight" / name).read_bytes()
