"""Damaged files of every kind that the door knows: each is read, or refused in words; nonsense is refused."""

import tempfile
from pathlib import Path

from fuzz.kinds import examples
from fuzz.nonsense import cases
from fuzz.test_mutated_files import mutant
from studies.reliability.cases import Row, go_on
from studies.reliability.scenarios import LONGEST_S, run_cases

from testbench.core.door import KINDS
from testbench.core.errors import Refusal

COUNT = 3000


def kinds(count: int = COUNT) -> list[Row]:
    """Read mutants of an example of every kind, each kind in turn."""
    names = [f"{list(KINDS)[k % len(KINDS)]} {20_000 + k // len(KINDS)}" for k in range(count)]
    with tempfile.TemporaryDirectory(prefix="reliability_") as place:
        valid = examples(Path(place))

        def judged(name: str, folder: Path) -> tuple[str, str]:
            kind, _, seed = name.rpartition(" ")
            try:
                valid[kind].tried(mutant(valid[kind], kind, int(seed)), folder)
            except Refusal as error:
                return "refused", str(error)
            return "read", ""

        return go_on("kinds", names, lambda due: run_cases(due, judged, LONGEST_S))


def nonsense() -> list[Row]:
    """Give each of the nonsensical values and files that the tests know."""
    with tempfile.TemporaryDirectory(prefix="reliability_") as place:
        meant = cases(Path(place))

        def judged(name: str, folder: Path) -> tuple[str, str]:
            try:
                meant[name](folder)
            except Refusal as error:
                return "refused", str(error)
            return "accepted", ""

        return go_on("nonsense", list(meant), lambda due: run_cases(due, judged, LONGEST_S))
