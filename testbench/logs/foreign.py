"""Files that are not what their name says: what they are, told by their first bytes, and what to do about it."""

from __future__ import annotations

import re
from pathlib import Path

from testbench.core.errors import RecordError

HEAD = 4000  # bytes at the beginning of a file that tell what it is

_MAGIC = {"netcdf": (b"CDF\x01", b"CDF\x02", b"CDF\x05"), "parquet": (b"PAR1",), "mat": (b"MATLAB 5.0", b"MATLAB 7.3")}
_HDF5 = b"\x89HDF\r\n\x1a\n"
_SUFFIX = {"netcdf": ".nc", "parquet": ".parquet", "mat": ".mat"}
_NAMES = {"netcdf": "a NetCDF file", "parquet": "a Parquet file", "mat": "a MAT file of MATLAB"}
_POSITIONS = "they hold positions and speeds, no rates or controls: give the flight log"
_OTHERS = (
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook (.xls)", "save the sheet as CSV"),
    (b"\x1f\x8b", "compressed by gzip", "unpack it (gunzip) and give what is in it"),
    (b"BZh", "compressed by bzip2", "unpack it (bunzip2) and give what is in it"),
    (b"\xfd7zXZ", "compressed by xz", "unpack it (unxz) and give what is in it"),
    (b"\x28\xb5\x2f\xfd", "compressed by zstd", "unpack it (unzstd) and give what is in it"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", "unpack it and give the table in it"),
    (b"Rar!", "a RAR archive", "unpack it and give the table in it"),
    (b"%PDF", "a PDF document", "give the data that it was made from"),
    (b"SQLite format 3", "an SQLite database", "export the table of the flight as CSV"),
    (b"\x89PNG", "a picture (PNG)", "give the data that it was made from"),
    (b"\xff\xd8\xff", "a picture (JPEG)", "give the data that it was made from"),
    (b"ULog", "a ULog of PX4, which needs no description", "name it .ulg and give it to `testbench import`"),
    (b"\xa3\x95", "an ArduPilot log, which needs no description", "name it .bin and give it to `testbench import`"),
    (b"\x93NUMPY", "an array of NumPy", "save it as CSV with a header, or with scipy.io.savemat"),
    (b"#ROSBAG", "a bag of ROS, which needs no description", "name it .bag and give it to `testbench import`"),
    (b"\x89MCAP", "a recording of ROS 2, which needs no description", "give it to `testbench import` as .mcap"),
    (
        b"H Product:Blackbox",
        "a blackbox of Betaflight or iNav, which needs no description",
        "give it to `testbench import`",
    ),
    (b"\xb5b", "messages of a u-blox receiver (UBX)", _POSITIONS),
    (b"MDF     ", "an MDF measurement (.mf4)", "export its channels as CSV or MAT"),
    (b"ARROW1", "a Feather (Arrow) file", "save it as Parquet: pandas.read_feather(f).to_parquet(g)"),
)


TELEMETRY = re.compile(rb"\x00[\x03-\x07].{6}[\xfd\xfe]", re.DOTALL)
"""The beginning of a telemetry log: microseconds since 1970, of the years 1997 to 2041, and the head of a message."""


def refuse_foreign(path: Path, head: bytes, kind: str) -> None:
    """Refuse a file whose first bytes say that it is of another format than ``kind``.

    Args:
        path: the file, for the message.
        head: its first :data:`HEAD` bytes.
        kind: "csv", "text", "mat", "parquet" or "netcdf", or "" for a file whose suffix says nothing.

    Raises:
        RecordError: says what the file is and what to do.
    """
    what = _foreign(head, kind)
    if what:
        wanted = {"csv": "a table as text", "text": "a table as text", "": "a flight log"}.get(kind) or _NAMES[kind]
        raise RecordError(f"'{path}' must be {wanted}, but it is {what[0]}; {what[1]}")


def looks_like_text(head: bytes) -> bool:
    """Say whether the first bytes of a file are plain text."""
    return not re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", head)


def _foreign(head: bytes, kind: str) -> tuple[str, str] | None:
    """Return what the file is and what to do, None if its first bytes fit ``kind`` or say nothing."""
    for name, magics in _MAGIC.items():
        if head.startswith(magics) and name != kind:
            return _NAMES[name], f'name it {_SUFFIX[name]}, or describe it with format = "{name}"'
    if head.startswith(_HDF5) and kind not in ("netcdf", "mat"):
        return "an HDF5 file", "name it .h5, or .mat if MATLAB wrote it"
    if head.startswith(b"PK\x03\x04"):
        if b"xl/" in head or b"[Content_Types].xml" in head:
            return "an Excel workbook (.xlsx)", "save the sheet as CSV"
        if b"mimetypeapplication/vnd.oasis" in head:
            return "an OpenDocument spreadsheet (.ods)", "save the sheet as CSV"
        return "a ZIP archive", "unpack it and give the table in it"
    for magic, what, fix in _OTHERS:
        if head.startswith(magic):
            return what, fix
    if head[8:12] == b".FIT":
        return "a recording of a watch (FIT)", _POSITIONS
    if TELEMETRY.match(head):
        return "telemetry of MAVLink, which needs no description", "name it .tlog and give it to `testbench import`"
    return _foreign_text(head, kind)


def _foreign_text(head: bytes, kind: str) -> tuple[str, str] | None:
    text = head.decode("utf-8-sig", "replace").lstrip()
    lower = text[:500].lower()
    if text.startswith("version https://git-lfs.github.com/spec"):
        return "a pointer of Git LFS, not the file itself", "run `git lfs pull` in its repository"
    if re.match(r"(<!--.*?-->\s*)?<(!doctype html|html|head|body)\b", lower, re.DOTALL):
        return "a web page (HTML)", "download the file itself: a page to sign in or of an error was saved in its place"
    if text.startswith(("{\\rtf",)):
        return "a text document (RTF)", "save the table as CSV"
    if re.match(r"[{\[]\s*[\"{\[\]}]", text) or re.match(r"\[\s*-?\d+(\.\d+)?\s*,", text):
        return "JSON", "save it as CSV: pandas.read_json(f).to_csv(g, index=False)"
    if re.match(r"\$(g[nplabq]|pubx)\w{3},", lower):
        return ("sentences of a receiver (NMEA)", _POSITIONS)
    if re.match(r"a[a-z0-9]{3}.*\r?\nh[fopc]dte", lower):
        return "the log of a glider (IGC)", _POSITIONS
    if lower.startswith("<?xml") or (re.match(r"<[a-z_][\w:.-]*[\s>]", lower) and re.search(r"</|/>|<!", text)):
        if "<configuration" in lower or "paparazzi" in lower:
            return "the message definitions of a Paparazzi log", "give the .data file that lies beside it"
        return "XML", "export the table as CSV"
    binary = kind in _SUFFIX and bool(head) and not head.startswith((*_MAGIC[kind], _HDF5))
    if binary and looks_like_text(head):
        return "text", "name it .csv or .txt"
    return None
