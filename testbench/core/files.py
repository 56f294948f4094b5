"""Files that are there whole or not at all, and the same bytes for the same content."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from testbench.core.errors import RecordError


def write_file(
    path: Path,
    content: str | bytes | Callable[[Path], object],
    law: str = "results must go to a folder that can be written to",
    fix: str = "give another folder or free space",
) -> Path:
    """Write a file under another name, rename it to ``path`` and return ``path``; its folder is made if it is missing.

    A process that is killed while it writes leaves the file that was there before, or none.

    Args:
        path: the file.
        content: text, written as UTF-8; bytes; or a function that writes the file whose path it is given.
        law: what must hold, as the error says it.
        fix: what to do, as the error says it.

    Raises:
        RecordError: the file cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            part.touch()  # a folder that cannot be written to shows here, before a library trips over it
            content(part)
        else:
            part.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        part.replace(path)
    except OSError as error:
        raise RecordError(f"{law}, got '{path}': {error.strerror or error}; {fix}") from error
    return path


def mat_bytes(content: Mapping[str, Any], what: str = "", **options: Any) -> bytes:
    """Return variables as a MAT file of version 5.

    scipy writes the time of day into the first 116 bytes, which are text for people; this text takes their place, so
    that the same variables give the same bytes.

    Args:
        content: name -> value, as ``scipy.io.savemat`` takes them.
        what: kind of content, told in the text.
        options: of ``scipy.io.savemat``.
    """
    from io import BytesIO

    from scipy.io import savemat

    buffer = BytesIO()
    savemat(buffer, dict(content), **options)
    text = ", ".join(filter(None, ["MATLAB 5.0 MAT-file, written by flight-testbench", what]))
    return text.ljust(116).encode() + buffer.getvalue()[116:]
