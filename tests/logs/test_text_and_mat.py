"""Text and MAT files of many shapes: what is read of them, and one clear error where they cannot be tables."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from testbench.core.door import VARIABLE
from testbench.core.errors import RecordError, SizeError
from testbench.logs.mat import Opaque, _matrix, mat_variables
from testbench.logs.tables import read_table
from testbench.logs.text import TextForm


def table(tmp_path, text, kind="csv", **options):
    path = tmp_path / "f.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(path, kind, form=TextForm(**options))


@pytest.mark.parametrize(
    ("text", "options", "names", "units"),
    [
        ('"Force","Fs",\n1,400,\n2,,\n', {}, ("Force", "Fs"), ("", "")),
        ("a,b\n1,2,\n3,4,\n", {}, ("a", "b"), ("", "")),
        ("a [m/s],b (deg)\n1,2\n3,4\n", {}, ("a", "b"), ("m/s", "deg")),
        ("\ufeffa,b\r\n1,2\r\n3,4\r\n", {}, ("a", "b"), ("", "")),
        ("1,2\n3,4\n", {}, ("", ""), ("", "")),
        ("made by hand\n\na,b\ns,rad\n1,2\n3,4\n", {}, ("a", "b"), ("s", "rad")),
        ("# a b\n1 2\n# a remark\n3 4\n", {"kind": "text"}, ("a", "b"), ("", "")),
        ("Date: today\n2 variables and 2 values each\n\n  a   b\n  S RAD\n --- ---\n 1 2\n 3 4\n", {"kind": "text"},
         ("a", "b"), ("S", "RAD")),
        ("10;20\n1;2\n3;4\n", {"delimiter": ";", "skip_rows": 1}, ("", ""), ("", "")),
        ("a\tb\n1\t2\n3\t4", {"delimiter": "\t"}, ("a", "b"), ("", "")),
        ("7,8\n1,2\n3,4\n", {"header": "none", "skip_rows": 1}, ("", ""), ("", "")),
        ("t,de\n\xb0,x\n1,2\n3,4\n".encode("latin-1"), {}, ("t", "de"), ("°", "x")),
        ('"a, of b",c\n1,2\n3,4\n', {}, ("a, of b", "c"), ("", "")),
        ("# 25 50\n% a b\n1 2\n3 4\n", {"kind": "text"}, ("a", "b"), ("", "")),
        ("a,b,c\ns,-,-\n1,2,\n3,,5\n,,\n,,\n", {}, ("a", "b", "c"), ("s", "-", "-")),
        ("nan,1\n3,4\n", {}, ("", ""), ("", "")),
    ],
)  # fmt: skip
def test_headers_of_text_files(tmp_path, text, options, names, units):
    found = table(tmp_path, text, **options)
    assert found.names == names
    assert found.units == units
    first = {'"': 2.0 if "Force" in str(text) else 3.0}.get(str(text)[0], 3.0)
    assert np.array_equal(found.numbers(1), [np.nan if str(text).startswith("nan") else 1.0, first], equal_nan=True)
    assert found.place(0).endswith(f"line {found.lines[0]}")


def test_text_columns_that_are_not_used_do_no_harm(tmp_path):
    found = table(tmp_path, "date,a,b,note\n2020-01-01 12:00,1,2,\n2020-01-01 12:01,3,4,stall\n")
    assert np.array_equal(found.numbers("a"), [1.0, 3.0])
    assert found.cell("note", 1) == "stall"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n3\n", r"every row must have 2 cells, got 1 in line 3 of .*f\.csv"),
        ("a,b\n1,2\n3,4,5\n", r"every row must have 2 cells, got 3 in line 3"),
        ("a,b\n", "rows of numbers, got none in its first 1 rows, of which the last reads 'a,b'"),
        ("\n\n", "holds nothing but blank lines"),
        ("t,q\n", "has a header only, 't,q'"),
        ("only words\nand more words\n", "got none .* the last reads 'and more words'; check format and delimiter"),
        (b"a,b\n1,2\n\x00\x01", "must be text"),
    ],
)
def test_text_files_that_cannot_be_tables(tmp_path, text, message):
    with pytest.raises(RecordError, match=message):
        table(tmp_path, text)


def test_columns_by_name_and_number(tmp_path):
    found = table(tmp_path, "t,alpha,q,q\n1,2,3,4\n")
    assert found.index("alpha") == found.index(2) == 1
    with pytest.raises(RecordError, match=r"column 5 must exist in '.*f\.csv', which has 4 columns"):
        found.index(5)
    with pytest.raises(RecordError, match="called 'alfa', got 0; did you mean 'alpha'"):
        found.index("alfa")
    with pytest.raises(RecordError, match="called 'q', got 2"):
        found.index("q")
    with pytest.raises(RecordError, match="give numbers, counted from 1"):
        table(tmp_path, "1,2\n3,4\n").index("t")


def test_mat_files_of_several_shapes(tmp_path):
    from scipy.io import savemat

    matrix = np.arange(12.0).reshape(4, 3)
    path = tmp_path / "m.mat"
    savemat(path, {"data": matrix, "dt": 0.1, "label": "x"})
    assert np.array_equal(read_table(path, "mat").numbers(3), matrix[:, 2])
    savemat(path, {"one": matrix, "two": matrix + 1})
    with pytest.raises(RecordError, match="give variable = one of one, two"):
        read_table(path, "mat")
    assert np.array_equal(read_table(path, "mat", "two").numbers(1), matrix[:, 0] + 1)
    with pytest.raises(RecordError, match="variable 'tow', got none; did you mean 'two'"):
        read_table(path, "mat", "tow")
    savemat(path, {"flight": {"t": matrix[:, 0], "q": matrix[:, 1], "pilot": "A"}, "other": matrix})
    assert np.array_equal(read_table(path, "mat", "flight").numbers("q"), matrix[:, 1])
    savemat(path, {"t": matrix[:, 0], "q": matrix[:, 1], "short": [1.0, 2.0], "w": 1j * matrix[:, 0]})
    assert read_table(path, "mat").names == ("t", "q")


@pytest.mark.parametrize("compressed", [False, True])
def test_mat_numbers_agree_with_an_independent_reader(compressed, tmp_path):
    from scipy.io import loadmat, savemat

    rng = np.random.default_rng(2)
    kinds = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", "?")
    content = {f"x{i}": (100 * rng.random(30)).astype(kind) for i, kind in enumerate(kinds)}
    others = {
        "words": "ä text",
        "cells": np.array([1, "a"], object),
        "empty": np.zeros((0, 0)),
        "cube": np.zeros((2, 2, 2)),
    }
    savemat(tmp_path / "m.mat", {**content, **others}, do_compression=compressed, oned_as="row")
    found, expected = read_table(tmp_path / "m.mat", "mat"), loadmat(tmp_path / "m.mat")
    assert set(found.names) == set(content)
    for name in content:
        assert np.array_equal(found.numbers(name), expected[name].ravel().astype(float)), name


def test_mat_of_a_big_endian_machine(tmp_path):
    def element(kind: int, content: bytes) -> bytes:
        return struct.pack(">II", kind, len(content)) + content + bytes(-len(content) % 8)

    numbers = struct.pack(">6d", 0.0, 0.1, 0.2, 5.0, -6.0, 7.5)
    flags, shape = struct.pack(">II", 6, 0), struct.pack(">ii", 3, 2)
    matrix = element(6, flags) + element(5, shape) + struct.pack(">HH4s", 1, 1, b"x") + element(9, numbers)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI"
    (tmp_path / "m.mat").write_bytes(head + element(14, matrix))
    found = read_table(tmp_path / "m.mat", "mat")
    assert np.array_equal(found.numbers(1), [0.0, 0.1, 0.2])
    assert np.array_equal(found.numbers(2), [5.0, -6.0, 7.5])


def test_a_mat_file_damaged_anywhere_never_ends_the_process(tmp_path):
    from scipy.io import savemat

    flight = {"t": np.arange(5.0), "q": np.arange(5.0), "note": "abc"}
    savemat(tmp_path / "m.mat", {"flight": flight, "cells": np.array([1, "a"], object)})
    whole = (tmp_path / "m.mat").read_bytes()
    rng = np.random.default_rng(9)
    messages = []
    for _ in range(400):  # compiled readers crash on about one such file in a hundred
        content = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            content[place] = rng.choice([0, 1, 255])
        (tmp_path / "bad.mat").write_bytes(content)
        try:
            read_table(tmp_path / "bad.mat", "mat", "flight")
        except RecordError as error:
            messages.append(str(error))
    assert len(messages) > 50
    assert all("bad.mat" in message and "\n" not in message for message in messages)


def test_a_broken_mat_file_of_version_7_3_is_said_to_be_incomplete(tmp_path):
    (tmp_path / "m.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(RecordError, match=r"must be a complete MAT file, but it is damaged"):
        read_table(tmp_path / "m.mat", "mat")


@pytest.mark.parametrize("parts", [2, 3, 4, 5])
def test_an_object_is_named_by_its_class_where_its_element_is_whole(parts):
    def element(kind: int, content: bytes) -> bytes:
        return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)

    texts = [b"flight", b"MCOS", b"timeseries", b"12345678"]
    data = element(6, struct.pack("<II", 17, 0)) + b"".join(element(1, text) for text in texts[: parts - 1])
    name, value = _matrix(memoryview(data), "<", lambda size: None)
    assert (name, value) == (("flight", Opaque("timeseries")) if parts > 3 else ("", None))


def test_a_compressed_element_is_refused_before_it_is_unpacked_whole(monkeypatch):
    packed = zlib.compress(struct.pack("<II", 14, 0) + bytes(100_000_000), 1)
    whole = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed
    monkeypatch.setenv(VARIABLE, "0.02")
    tracemalloc.start()
    try:
        with pytest.raises(SizeError, match="unpacks to"):
            mat_variables(whole)
        assert tracemalloc.get_traced_memory()[1] < 60e6  # pieces of 17 MB
    finally:
        tracemalloc.stop()
