"""Files that are not what their name says: the message names what they are and what to do, at each door."""

import gzip
import io
import zipfile

import numpy as np
import pytest
from commands import ends
from scipy.io import savemat

from testbench.core.errors import RecordError
from testbench.questions.importing.ask import import_log
from testbench.questions.importing.template import description_template

TABLE = b"time,de,q\n0.00,1,2\n0.02,1,2\n0.04,1,2\n0.06,1,2\n"
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"


def archive(*names):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as made:
        for name in names:
            made.writestr(name, "x")
    return out.getvalue()


def mat():
    out = io.BytesIO()
    savemat(out, {"t": np.arange(4.0)})
    return out.getvalue()


NONSENSE = [
    ("page.csv", b"<!DOCTYPE html>\n<html><body>Sign in</body></html>", "a web page .* download the file itself"),
    ("page.mat", b"\n<html lang='en'><head>", "a web page"),
    ("page.ulg", b"<!-- saved -->\n<html>", "must be a flight log, but it is a web page"),
    ("book.csv", archive("[Content_Types].xml", "xl/workbook.xml"), "an Excel workbook .* save the sheet as CSV"),
    ("old.csv", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "an old Excel workbook"),
    ("book.xlsx", archive("[Content_Types].xml", "xl/workbook.xml"), "an Excel workbook"),
    ("packed.csv", archive("flight.csv"), "a ZIP archive; unpack it"),
    ("packed.csv.gz", gzip.compress(TABLE), r"compressed by gzip; unpack it \(gunzip\)"),
    ("empty.csv", b"", "is empty|an empty file"),
    ("blank.csv", b"  \n\n\t\n", "nothing but blank lines"),
    ("binary.csv", bytes(range(256)) * 8, "must be text, got binary data at character 1"),
    ("binary.txt", b"time,de\n" + bytes(50), "binary data at character 9"),
    ("header.csv", b"time,de,q\n", "it has a header only, 'time,de,q'; export it again"),
    ("words.csv", b"Dear pilot,\nthe log is lost\n", "must hold rows of numbers, got none .* 'the log is lost'"),
    ("pointer.csv", LFS, "a pointer of Git LFS, not the file itself; run `git lfs pull`"),
    ("pointer.mat", LFS, "a pointer of Git LFS"),
    ("pointer.bin", LFS, "a pointer of Git LFS"),
    ("pointer.parquet", LFS, "a pointer of Git LFS"),
    ("rows.csv", b'[{"t": 0, "q": 1},\n {"t": 1, "q": 2}]', "is JSON; save it as CSV"),
    ("rows.txt", b'{"t": [0, 1], "q": [1, 2]}', "is JSON"),
    ("list.csv", b"[0.1, 0.2, 0.3]", "is JSON"),
    ("tree.csv", b'<?xml version="1.0"?>\n<log><t>0</t></log>', "is XML"),
    ("table.mat", TABLE, r"must be a MAT file of MATLAB, but it is text; name it \.csv"),
    ("table.nc", TABLE, r"must be a NetCDF file, but it is text; name it \.csv"),
    ("table.parquet", TABLE, r"must be a Parquet file, but it is text; name it \.csv"),
    ("mat.csv", mat(), r'is a MAT file of MATLAB; name it \.mat, or describe it with format = "mat"'),
    ("mat.nc", mat(), "must be a NetCDF file, but it is a MAT file"),
    ("classic.csv", b"CDF\x01" + bytes(40), r"a NetCDF file; name it \.nc"),
    ("hdf5.csv", b"\x89HDF\r\n\x1a\n" + bytes(40), r"an HDF5 file; name it \.h5"),
    ("parquet.csv", b"PAR1" + bytes(40), r"a Parquet file; name it \.parquet"),
    ("feather.parquet", b"ARROW1\0\0" + bytes(40), "a Feather .* save it as Parquet"),
    ("print.csv", b"%PDF-1.7\n", "a PDF document"),
    ("base.csv", b"SQLite format 3\0" + bytes(90), "an SQLite database; export the table"),
    ("numpy.csv", b"\x93NUMPY\x01\0" + bytes(90), "an array of NumPy"),
    ("radio.tlog", b"\x00\x06\x0a\x24\x18\x1e\x40\x00\xfd\x09" + bytes(60), "heartbeat of a vehicle, but none came"),
    ("gps.nmea", b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\n" * 9, "sentences of a receiver"),
    ("table.csv.bak", TABLE, r"begins as none of them; if it is a table, name it \.csv or \.txt"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "law"), NONSENSE, ids=[name for name, _, _ in NONSENSE])
def test_the_cause_that_is_named_is_the_cause(name, content, law, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordError, match=law) as error:
        import_log(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)
    if path.suffix in (".csv", ".txt", ".mat", ".nc", ".parquet"):
        with pytest.raises(RecordError, match=law):
            description_template(path)


def test_a_single_column_is_named_and_may_still_be_described(tmp_path):
    for name, content, column in (("a.csv", b"t\n0\n1\n2\n", ", 't'"), ("b.csv", b"1.5\n2.5\n3.5\n", " only;")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordError, match=f"one column only{column.removeprefix(' only')}.* give delimiter"):
            import_log(tmp_path / name)
        assert "[[record]]" in description_template(tmp_path / name)


def test_at_the_command_line_it_is_one_line(tmp_path, monkeypatch, capsys):
    path = tmp_path / "book.csv"
    path.write_bytes(archive("[Content_Types].xml", "xl/workbook.xml"))
    status, said = ends(monkeypatch, capsys, "import", path)
    assert status == 2
    assert "save the sheet as CSV" in " ".join(said)


def test_a_plain_hdf5_file_is_a_table(tmp_path):
    import h5py

    t = np.arange(0.0, 10.0, 0.02)
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file["t"], file["q"] = t, 0.1 * np.sin(t)
    np.testing.assert_allclose(import_log(tmp_path / "f.h5").record["q"], 0.1 * np.sin(t))
