"""The door: what is no file is refused at once, size comes before content, and nothing nests or unfolds without end."""

from __future__ import annotations

import os
import socket
import time

import pytest

from testbench.aircraft.geometry.read import read_plan
from testbench.core import door
from testbench.core.door import (
    KINDS,
    VARIABLE,
    Kind,
    checked,
    read_bytes,
    read_json,
    read_text,
    read_toml,
    read_xml,
    sha256,
)
from testbench.core.errors import RecordError, ScenarioError, SizeError
from testbench.questions.exercise.roster import students_of
from testbench.questions.export.matrices import load_matrices
from testbench.questions.identify.pool.prior import prior_of_file
from testbench.questions.importing.ask import import_log


@pytest.fixture
def strange(tmp_path):
    """Things of the file system that are no files, by what they are."""
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    return tmp_path


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes as files are of POSIX")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pipe.toml", "a pipe, not a file"),
        ("zero.toml", "a device, not a file"),
        ("folder.toml", "Is a directory"),
        ("none.toml", "No such file"),
        ("loop.toml", "Too many levels of symbolic links"),
        ("a\0b.toml", "null byte"),
    ],
)
def test_what_is_no_file_is_refused_in_one_line_at_once(strange, name, words):
    began = time.monotonic()
    for read in (
        read_toml,
        *(lambda p, f=f: f(p, "model") for f in (read_bytes, read_text, read_json, read_xml, sha256)),
    ):
        with pytest.raises(RecordError, match=words) as caught:
            read(strange / name)
        assert "\n" not in str(caught.value)
    assert time.monotonic() - began < 1.0


def test_a_socket_is_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("s")
        with pytest.raises(RecordError, match="a socket, not a file"):
            checked(tmp_path / "s", "key")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_larger_than_its_kind_may_be_is_not_read(tmp_path, monkeypatch, kind):
    path = tmp_path / "f"
    path.write_bytes(b"0" * 2000)
    monkeypatch.setitem(door.KINDS, kind, Kind(KINDS[kind].words, min(KINDS[kind].most, 1000.0)))
    monkeypatch.setenv(VARIABLE, "1e-6")
    with pytest.raises(RecordError, match=r"0\.001 MB|of memory"):
        read_bytes(path, kind)


def test_a_log_that_memory_has_no_room_for_is_not_read(tmp_path):
    path = tmp_path / "flight.ulg"
    path.touch()
    os.truncate(path, 2 * 10**9)
    with pytest.raises(SizeError, match=VARIABLE):
        read_bytes(path, "log")


def test_what_says_no_size_is_read_to_its_limit_only(monkeypatch):
    monkeypatch.setitem(door.KINDS, "key", Kind("file", 10.0))
    with pytest.raises(RecordError, match="more than"):
        read_bytes(door.Path("/proc/self/maps"), "key")


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (lambda p: read_json(p, "model"), "[" * 200_000),
        (lambda p: read_json(p, "model"), "{"),
        (lambda p: read_xml(p, "JSBSim model"), "<a>" * 100_000 + "</a>" * 100_000),
        (lambda p: read_xml(p, "JSBSim model"), "<a>"),
        (lambda p: read_xml(p, "definitions"), '<!DOCTYPE a [<!ENTITY x "y"><!ENTITY z "&x;&x;">]><a>&z;</a>'),
        (read_toml, "a = " + "[" * 5000),
        (read_toml, "a = " + "9" * 5000),
        (read_toml, "a ="),
        (load_matrices, "[" * 100_000),
    ],
)
def test_what_nests_unfolds_or_ends_early_is_one_line(tmp_path, read, text):
    path = tmp_path / "f"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((RecordError, ScenarioError)) as caught:
        read(path)
    assert "f" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["pipe.toml", "zero.toml"])
@pytest.mark.parametrize("ask", [load_matrices, import_log, read_plan, prior_of_file, students_of])
def test_what_asks_for_a_file_refuses_devices_and_pipes(strange, ask, name):
    with pytest.raises((RecordError, ScenarioError)):
        ask(strange / name if ask is not students_of else str(strange / name))


def test_text_is_read_with_line_ends_of_any_system(tmp_path):
    (tmp_path / "f").write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    assert read_text(tmp_path / "f", "roster", "utf-8-sig") == "a\nb\nc\n"
    (tmp_path / "f").write_bytes(b"\xff\xfe")
    with pytest.raises(RecordError, match="not UTF-8"):
        read_text(tmp_path / "f", "roster")
