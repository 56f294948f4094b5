"""Studies and benchmarks at their smallest: with TESTBENCH_SMALLEST=FOLDER each does its first unit of work alone.

``TESTBENCH_SMALLEST=build/smallest make benchmarks`` shows in seconds for each that all of them still run. What they
write goes to FOLDER, so that no committed table is written over, and no law of speed is judged: it holds at full size.

What a study wrote into a folder of results/ is listed in that folder's manifest as it ends, so that `testbench results
FOLDER --verify` says whether it is still what was written. `python tests/smallest.py` lists what git keeps there as it
is. Several studies share a folder, so that the manifest tells sums alone; results/README.md tells the command of each.
"""

import atexit
import os
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[1]
SMALLEST = os.environ.get("TESTBENCH_SMALLEST", "")
BY_HAND = "README.md"


def sized(full: T, smallest: T) -> T:
    """Return how much a study does: all of it, or the least that shows that it runs."""
    return smallest if SMALLEST else full


def results(*parts: str) -> Path:
    """Return the place of a result below results/, its folder made; what is written there will be listed."""
    path = _place("results", *parts)
    folder = path.parent if path.suffix else path
    if folder.name != "results":  # which is a folder of results, and none itself
        _listed_at_the_end(folder)
    return path


@cache
def _listed_at_the_end(folder: Path) -> None:
    # Compared with what was there before: a file's own time may lie a tick of the kernel before any clock read here.
    before = _seen(folder)

    def end() -> None:
        if not hasattr(sys, "last_type"):  # of a study that failed nothing is a result
            written(folder, (path for path, seen in _seen(folder).items() if before.get(path) != seen))

    atexit.register(end)


def _seen(folder: Path) -> dict[Path, tuple[int, int, int]]:
    files = ((path, path.stat()) for path in folder.iterdir() if path.is_file())
    return {path: (stat.st_ino, stat.st_mtime_ns, stat.st_size) for path, stat in files}


def written(folder: Path, files: Iterable[Path]) -> None:
    """List files in the manifest of their folder as they are, beside those that are listed."""
    from testbench.core.store import ResultFolder

    if found := [path for path in files if path.name != BY_HAND]:
        with ResultFolder(folder, adds=True, sealed=True) as place:
            for path in found:
                (place.new / path.name).write_bytes(path.read_bytes())


def build(*parts: str) -> Path:
    """Return the place below build/ of what a study keeps to go on from, its folder made."""
    return _place("build", *parts)


def _place(*parts: str) -> Path:
    path = ROOT.joinpath(SMALLEST, *parts)
    (path.parent if path.suffix else path).mkdir(parents=True, exist_ok=True)
    return path


if __name__ == "__main__":
    kept = subprocess.run(
        ["git", "ls-files", "-z", "results/*/*"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    paths = [ROOT / name for name in kept.stdout.split("\0") if name]
    for each in sorted({path.parent for path in paths} - {ROOT / "results" / "figures"}):
        if "reproduction" not in each.parts and ".testbench" not in each.parts:
            written(each, (path for path in paths if path.parent == each))
