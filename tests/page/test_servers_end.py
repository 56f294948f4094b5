"""Servers end at once by Ctrl-C and by the system, with a page open: no process and no file is left."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from urllib.request import urlopen

import pytest
from killed import whole

from testbench.core.files import write_file
from testbench.core.store import PAGE, ResultFolder

SERVERS = {"studio": ("studio", "eolo", "--port", "0"), "app": ("app", "out", "--port", "0")}


@pytest.mark.sampled(3)  # each is a process that loads everything
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
@pytest.mark.parametrize("words", SERVERS.values(), ids=SERVERS)
def test_a_signal_ends_it_at_once(tmp_path, words, number, status):
    with ResultFolder(tmp_path / "out") as place:
        write_file(place.new / PAGE, '<p class="kicker">flight-testbench: run</p><h1>a</h1>')
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*") if p.is_file()}
    with (
        subprocess.Popen(
            [sys.executable, "-m", "testbench", *words],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as server,
        contextlib.ExitStack() as after,
    ):
        after.callback(server.kill)  # whatever fails below
        address, port = re.search(r"(http://127.0.0.1:(\d+)/\S*)", server.stdout.readline()).groups()
        with urlopen(address, timeout=20) as answer:
            assert answer.status == 200
        with socket.create_connection(("127.0.0.1", int(port))) as waiting:  # a client that asks for nothing
            waiting.sendall(b"GET")
            began = time.monotonic()
            server.send_signal(number)
            said, complained = server.communicate(timeout=20)
            assert time.monotonic() - began < 5.0
    assert (server.returncode, said) == (status, "Ended.\n"), complained
    with pytest.raises(ProcessLookupError):
        os.killpg(server.pid, 0)
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*") if p.is_file()} == before
    assert whole(tmp_path / "out")
