"""Mutated scenarios of every kind are refused in words, or what is read is what the file says; then they are flown."""

import importlib
import shutil
import signal
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from fuzz import inputs, survive
from fuzz.mutations import mistyped, nudged
from fuzz.test_mutated_files import rng_of
from studies.reliability.cases import Row, go_on, in_batches, quiet_main

from testbench.core.errors import Refusal
from testbench.core.paths import SCENARIOS

COUNT, FLOWN, FLIGHT_S, BATCH = 3000, 150, 20, 200
LONGEST_S = 300  # by the clock, of what takes less than a second of processor: other work may have the machine


@cache
def texts() -> dict[str, str]:
    return inputs.scenarios()


def names(count: int = COUNT) -> list[str]:
    """Return names of cases: every file in turn."""
    files = list(texts())
    return [f"{files[k % len(files)]} {10_000 + k // len(files)}" for k in range(count)]


def mutant(name: str) -> str:
    file, _, seed = name.rpartition(" ")
    damage = nudged if int(seed) % 2 else mistyped  # values of another kind, and numbers that may be meant
    return damage(texts()[file], rng_of(file, int(seed)))


def judged(name: str, folder: Path) -> tuple[str, str]:
    """Return what became of a mutant: refused, the same as the original, or read with another value."""
    try:
        asked = inputs.read_scenario(name.rpartition(" ")[0], mutant(name), folder)
    except Refusal as error:
        return "refused", str(error)
    written = tomllib.loads(mutant(name))
    if hasattr(asked, "model_dump"):
        wrong = list(differing(written, asked.model_dump(), ""))
        if wrong:
            return "read wrongly", "; ".join(wrong)
    same = written == tomllib.loads(texts()[name.rpartition(" ")[0]])
    return ("the same" if same else "read as changed"), ""


def differing(written: Any, read_: Any, place: str) -> Iterator[str]:
    """Yield where what was read holds another value than the file; keys that the reader turns into others are left."""
    if isinstance(written, Mapping) and isinstance(read_, Mapping):
        for key, value in written.items():
            if key in read_:
                yield from differing(value, read_[key], f"{place}.{key}")
    elif isinstance(written, list) and isinstance(read_, list | tuple):
        if len(written) != len(read_):
            yield f"{place}: {len(written)} values became {len(read_)}"
        else:
            for k, (a, b) in enumerate(zip(written, read_, strict=True)):
                yield from differing(a, b, f"{place}[{k}]")
    elif isinstance(written, bool | int | float | str) and isinstance(read_, bool | int | float | str):
        as_read = float(written) if type(read_) is float and type(written) is int else written  # to a double's digits
        if isinstance(written, bool) != isinstance(read_, bool) or as_read != read_:
            yield f"{place}: {str(written)[:40]!r} became {str(read_)[:40]!r}"


def run_cases(names: Sequence[str], judge: Callable[[str, Path], tuple[str, str]], longest_s: int, gb: float = 1.0,
              batch: int = BATCH) -> Iterator[tuple[str, str, str]]:  # fmt: skip
    """Yield (name, outcome, said) of cases that run in forked processes, with time and memory watched."""
    survive.LONGEST_S, survive.MOST_KB = longest_s, int(1e6 * gb)
    for some in in_batches(names, batch):
        with tempfile.TemporaryDirectory(prefix="reliability_") as place:
            told = Path(place, "told")

            def case(name: str, folder: Path, told: Path = told) -> None:
                outcome, said = judge(name, folder)
                with told.open("a", encoding="utf-8") as file:
                    file.write("\t".join((name, outcome, " ".join(said.split()))) + "\n")

            broken = survive.broken({name: partial(case, name) for name in some})
            lines = told.read_text(encoding="utf-8").split("\n")[:-1] if told.exists() else []
        found = {n: (o, s) for n, o, s in (line.split("\t", 2) for line in lines)}
        for line in broken:
            name, _, said = line.partition(": ")
            kind = "TooLong" in said or "ended or hung" in said
            found[name] = ("above 1 GB" if said.endswith("GB of memory") else "hung" if kind else "traceback"), said
        for name in some:
            yield (name, *found.get(name, ("lost", "")))


def scenarios(count: int = COUNT) -> list[Row]:
    """Read mutants of all scenarios."""
    return go_on("scenarios", names(count), lambda due: run_cases(due, judged, LONGEST_S))


def flown(read_rows: Sequence[Row], most: int = FLOWN) -> list[Row]:
    """Fly mutants of scenarios to run that were accepted with another value, for at most 20 s of processor each.

    Each has a process of its own: one that is stopped may have been importing.
    """
    accepted = [r["case"] for r in read_rows if r["outcome"] == "read as changed"
                and r["case"].startswith((f"{SCENARIOS.name}/", "campaign/", "ground_tests", "modes/"))]  # fmt: skip

    def run(due: Sequence[str]) -> Iterator[tuple[str, str, str]]:
        for module in ("run.page", "modes.page", "aircraft.flexible.answer", "campaign.load"):
            importlib.import_module(f"testbench.questions.{module}")  # once for all, before they are forked
        yield from run_cases(due, _flown, LONGEST_S, 1.5, 1)

    return go_on("flown", accepted[:most], run)


class _Enough(BaseException):
    """A flight that is long but goes on."""


def _flown(name: str, folder: Path) -> tuple[str, str]:
    path = folder / "a.toml"
    path.write_text(mutant(name), encoding="utf-8")
    out = ["-o", str(folder / "out")]
    match name.split("/"):
        case "campaign", _:
            words = ["check", str(path)]
        case "modes", _:
            words = ["modes", str(path), *out]
        case "ground_tests", test:
            for table in (SCENARIOS / "ground_tests").glob("*.csv"):
                shutil.copy(table, folder)
            words = [
                "aircraft",
                "flexible",
                {"sailplane": "jsbsim:SGS"}.get(test.split(" ")[0], "taurus"),
                str(path),
                *out,
            ]
        case _:
            words = ["run", str(path), *out]

    def enough(*_: object) -> None:
        raise _Enough

    signal.signal(signal.SIGPROF, enough)
    signal.setitimer(signal.ITIMER_PROF, FLIGHT_S, 5.0)  # again, as a library may swallow what is raised
    try:
        status, said = quiet_main(words, folder / "said")
    except _Enough:
        return f"still flying after {FLIGHT_S} s", ""
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    if "Traceback" in said or status not in (0, 2, 3):
        return "traceback", said[-300:]
    return {0: "flown"}.get(status, "refused in flight"), said[-200:]
