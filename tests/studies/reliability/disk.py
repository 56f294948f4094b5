"""A disk that is full at 50 sizes: a command that finds no room for a file says so, and leaves nothing half-written.

A limit of the size of a file fails in the same calls as a full disk, and needs no rights to mount.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from fuzz import inputs
from studies.reliability.cases import Row, go_on
from test_full_disk import with_room

COUNT = 50
COMMANDS = ("import", "export", "plan")
LARGEST = {"import": 60_000, "export": 30_000, "plan": 200_000}
"""Bytes: the sizes lie evenly between 0 and these, which are near those of the largest files that are written."""


def words(command: str, place: Path) -> list[str]:
    """Return a command whose input lies in ``place`` and whose results go to its folder ``out``."""
    out = str(place / "out")
    if command == "plan":
        return ["plan", "show", "taurus_63", "-o", out]
    if command == "export":
        inputs.record().save(place / "r.nc")
        return ["export", str(place / "r.nc"), "--to", "csv", "-o", f"{out}/r.csv"]
    suffix, content = inputs.logs(place)["ulog"]
    (place / f"log{suffix}").write_bytes(content)
    return ["import", str(place / f"log{suffix}"), "-o", out]


def trial(command: str, size: int) -> tuple[str, str]:
    """Run a command that finds no room beyond ``size`` bytes in a file, and look at what it said and left."""
    with TemporaryDirectory() as name:
        place = Path(name)
        wanted = words(command, place)
        before = {p: p.read_bytes() for p in place.rglob("*") if p.is_file()}

        def act() -> None:
            import sys

            sys.argv = ["testbench", *wanted]
            from testbench import cli

            cli.main()

        status, said = with_room(size, act)
        errors = [line for line in said.splitlines() if line.startswith("error: ")]
        left = [p for p in place.rglob("*") if p.is_file() and p not in before]
        half = [p.name for p in left if p.suffix == ".part" or p.stat().st_size == size]
        if half:
            return "half-written", ", ".join(half)
        if status == 0:
            return "had room", ""
        if status == 3 and len(errors) == 1 and "must have room" in errors[0] and "Traceback" not in said:
            return "refused in one line", errors[0]
        return "crashed", f"status {status}: {said[-200:]}"


def disk(count: int = COUNT) -> list[Row]:
    """Run each command at ``count`` sizes."""
    names = [f"{command} {int(size)}" for command in COMMANDS for size in np.linspace(0, LARGEST[command], count)]

    def run(due: Sequence[str]) -> Iterator[tuple[str, str, str]]:
        for name in due:
            command, size = name.split(" ")
            yield (name, *trial(command, int(size)))

    return go_on("disk", names, run)
