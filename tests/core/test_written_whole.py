"""A file is there whole or not at all; a MAT file has the same bytes at every time of day."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from scipy.io import loadmat

from testbench.core.errors import DiskError, WriteError
from testbench.core.files import mat_bytes, write_file


def test_text_bytes_and_what_a_function_writes_arrive_and_leave_nothing_else(tmp_path):
    folder = tmp_path / "new" / "folder"
    assert write_file(folder / "a", "α\n").read_bytes() == "α\n".encode()
    assert write_file(folder / "b", b"\x00\n").read_bytes() == b"\x00\n"
    assert write_file(folder / "c", lambda part: part.write_text("x")).read_text() == "x"
    assert sorted(p.name for p in folder.iterdir()) == ["a", "b", "c"]


def test_what_fails_half_way_leaves_the_file_as_it_was(tmp_path):
    file = write_file(tmp_path / "a", "before")

    def half(part):
        part.write_text("half")
        raise OSError(28, "No space left on device")

    law = f"the disk must have room for '{file}', got: No space left on device; free space"
    with pytest.raises(DiskError, match=re.escape(law)) as error:
        write_file(file, half, "law", "free space")
    assert error.value.exit_status == 3
    assert file.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_file_where_a_folder_should_be_is_said(tmp_path):
    write_file(tmp_path / "a", "")
    with pytest.raises(WriteError, match=r"results must go to a folder .*a/b': .*; give another folder"):
        write_file(tmp_path / "a" / "b", "")


def test_a_mat_file_holds_no_time_of_day(tmp_path, monkeypatch):
    content = {"x": np.arange(3.0), "words": "a"}
    first = mat_bytes(content, "numbers", oned_as="column")
    monkeypatch.setattr(time, "asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    assert mat_bytes(content, "numbers", oned_as="column") == first
    assert first[:116].decode().rstrip() == "MATLAB 5.0 MAT-file, written by flight-testbench, numbers"
    file = write_file(tmp_path / "x.mat", first)
    np.testing.assert_array_equal(loadmat(file)["x"], np.arange(3.0)[:, None])
