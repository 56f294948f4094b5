"""The descriptions of what a command was given: a file, a folder that import wrote, or a log, which is imported."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from testbench.core.errors import RecordError

_LAW = "what is identified must be a log, a folder that testbench import wrote, or a description (.toml, or packaged)"


def descriptions_of(path: Path, out: Path) -> list[Path]:
    """Return the descriptions of recorded flights that ``path`` stands for; what is imported of a log goes to ``out``.

    Raises:
        RecordError: it is none, cannot be read, or holds nothing that can be identified.
    """
    from testbench.questions.files import find

    if path.is_dir():
        return _in_folder(path)
    files = _of_log(path, out) if path.is_file() and path.suffix.lower() != ".toml" else []
    return files or [find(path, "identify", _LAW)]


def _in_folder(folder: Path) -> list[Path]:
    """Return the descriptions that lie in a folder, as import writes one for each motion.

    Raises:
        RecordError: there is none.
    """
    from testbench.core.paths import find_scenario
    from testbench.core.record import load_record
    from testbench.core.store import settle
    from testbench.questions import BY_COMMAND
    from testbench.questions.files import kinds_of
    from testbench.questions.importing.ask import UNUSABLE, WHOLE

    found = [p for p in sorted(settle(folder).glob("*.toml")) if BY_COMMAND["identify"] in kinds_of(p)]
    if found:
        return found
    whole = folder / f"{WHOLE}.nc"
    unusable = load_record(whole).provenance.get(UNUSABLE, ()) if whole.is_file() else ()
    if unusable:
        raise RecordError(_nothing(folder, unusable))
    packaged = find_scenario(Path("records", folder))
    if packaged.is_file():  # a folder of results may have its name
        return [packaged]
    raise RecordError(
        f"a folder to identify must hold a description of records (.toml), got '{folder}' without one; `testbench "
        "import LOG --out FOLDER` writes one"
    )


def _nothing(path: Path, unusable: Sequence[str]) -> str:
    """Return what is said of a log of which import left out every recipe."""
    return f"'{path}' must hold a flight that can be identified, got none: {'; '.join(unusable)}"


def _of_log(log: Path, out: Path) -> list[Path]:
    """Return the descriptions that import writes of a log.

    Raises:
        RecordError: the log cannot be read, or nothing in it can be identified.
    """
    from testbench.core.store import ResultFolder, folder_in
    from testbench.questions.importing.ask import import_log, write_import

    with ResultFolder(folder_in(out, log.stem)) as place:
        imported = import_log(log)
        paths = write_import(imported, place)
    files = [path for path in paths if path.suffix == ".toml"]
    if not files and imported.unusable:
        raise RecordError(_nothing(log, imported.unusable))
    if not files:
        raise RecordError(
            f"'{log}' must hold a control that moves and what answers it, got none that can be identified; testbench "
            f"import {log} shows what it holds"
        )
    return files
