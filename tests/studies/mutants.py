"""Would the tests notice? Small errors are sown into the numerical rooms, one at a time, and each room's tests are run.

    python tests/studies/mutants.py                   # the study: half an hour on an idle machine; goes on if stopped
    python tests/studies/mutants.py --count 60        # the first 60 of the same draw
    python tests/studies/mutants.py --again survived  # those that were alive are tried again, after a test was added

A mutant is one change of one place: + and -, * and /, ** and *, < and <=, == and !=, ``and`` and ``or``, a sign, a
number plus 1, less 1 or 1.5 times as large. Texts, raised errors and annotations are left alone. The draw is even over
the rooms and has a fixed seed. Which tests reach which line is found once, test file by test file, with coverage.py
(``--trace``; it is not among what the testbench needs). A mutant is killed by the first test that fails, or by one
that takes ten times as long; the quickest tests come first, at most ``LONGEST_S`` seconds of them.

mutants.csv: one row for each mutant with its end: killed, survived, or equivalent with the reason why no test can tell.
The mutant is sown into a copy of the tree; the tree itself is never changed.
"""

from __future__ import annotations

import argparse
import ast
import csv
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "results" / "mutants.csv"
REASONS = Path(__file__).with_name("equivalent_mutants.csv")
SEED = 34
COUNT = 300
LONGEST_S = 90.0  # of tests for one mutant
_FILE_S = 150.0  # for the tests of one file to be traced; a file that takes longer takes no part
ROOMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "aircraft": ("testbench/aircraft", ("tests/aircraft", "tests/contracts/test_aircraft_contract.py")),
    "flight": ("testbench/flight", ("tests/flight",)),
    "inputs": ("testbench/inputs", ("tests/inputs", "tests/questions/design/test_spectral_energy.py")),
    "sensors": ("testbench/sensors", ("tests/sensors", "tests/contracts/test_suite_contract.py")),
    "estimators": ("testbench/estimators", ("tests/estimators", "tests/contracts/test_estimator_contract.py")),
    "evaluation": ("testbench/evaluation", ("tests/evaluation",)),
    "design": ("testbench/questions/design", ("tests/questions/design",)),
    "gap": ("testbench/questions/gap", ("tests/questions/gap",)),
    "logs": ("testbench/logs", ("tests/logs", "tests/cases")),
}
_SWAPS: dict[type, tuple[type, ...]] = {
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.Pow: (ast.Mult,),
    ast.FloorDiv: (ast.Div,), ast.MatMult: (), ast.Mod: (ast.Mult,),
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt,), ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt,),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.And: (ast.Or,), ast.Or: (ast.And,),
}  # fmt: skip
_WORDS = {
    "Add": "+", "Sub": "-", "Mult": "*", "Div": "/", "Pow": "**", "FloorDiv": "//", "Mod": "%", "Lt": "<",
    "LtE": "<=", "Gt": ">", "GtE": ">=", "Eq": "==", "NotEq": "!=", "And": "and", "Or": "or",
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change: of which room, file and line, in words, and the text of the whole expression after it."""

    room: str
    path: str
    line: int
    column: int
    end: tuple[int, int]
    change: str
    text: str

    @property
    def key(self) -> tuple[str, str, str]:
        """Path, line as it stands in the file, change: the same as long as that line is not rewritten."""
        return self.path, source_line(self.path, self.line), self.change


def source_line(path: str, line: int) -> str:
    return (ROOT / path).read_text(encoding="utf-8").splitlines()[line - 1].strip()


# what can be changed


def changes(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Yield each change of one expression in words, with the new expression."""
    if isinstance(node, ast.BinOp):
        for new in _SWAPS.get(type(node.op), ()):
            yield _swap(node.op, new), ast.BinOp(node.left, new(), node.right)
    elif isinstance(node, ast.BoolOp):
        for new in _SWAPS[type(node.op)]:
            yield _swap(node.op, new), ast.BoolOp(new(), node.values)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        for new in _SWAPS.get(type(node.ops[0]), ()):
            yield _swap(node.ops[0], new), ast.Compare(node.left, [new()], node.comparators)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "sign dropped", node.operand
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = node.value
        news = (value + 1, value - 1) if isinstance(value, int) else (value * 1.5 if value else 1.0,)
        for number in news:
            yield f"{value} becomes {number}", ast.Constant(number)


def _swap(old: ast.AST, new: type) -> str:
    return f"{_WORDS[type(old).__name__]} becomes {_WORDS[new.__name__]}"


def places(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions of a module in which an error can be sown: no texts, raised errors or annotations."""
    if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom)):
        return
    if isinstance(node, ast.expr):
        yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from places(child)


def mutants_of(room: str, path: str) -> list[Mutant]:
    """Return every mutant of one file."""
    out = []
    text = (ROOT / path).read_text(encoding="utf-8")
    indents = [len(line) - len(line.lstrip()) for line in text.splitlines()]
    for node in places(ast.parse(text)):
        for change, new in changes(node):
            change += f" at {node.col_offset - indents[node.lineno - 1]}"
            text = f"({ast.unparse(ast.fix_missing_locations(new))})"
            end = (node.end_lineno or node.lineno, node.end_col_offset or 0)
            out.append(Mutant(room, path, node.lineno, node.col_offset, end, change, text))
    return out


def drawn(count: int) -> list[Mutant]:
    """Return ``count`` mutants, room by room in turn; a longer draw begins with a shorter one."""
    queues = []
    for room, (folder, _) in ROOMS.items():
        every = [m for p in sorted((ROOT / folder).rglob("*.py")) for m in mutants_of(room, str(p.relative_to(ROOT)))]
        random.Random(f"{SEED} {room}").shuffle(every)
        queues.append(every)
    turns = (queue[k] for k in range(max(map(len, queues))) for queue in queues if k < len(queue))
    return [m for m, _ in zip(turns, range(count), strict=False)]


def sown(mutant: Mutant) -> str:
    """Return the file with the change."""
    lines = (ROOT / mutant.path).read_bytes().splitlines(keepends=True)  # columns of ast count bytes
    start = sum(len(x) for x in lines[: mutant.line - 1]) + mutant.column
    end = sum(len(x) for x in lines[: mutant.end[0] - 1]) + mutant.end[1]
    whole = b"".join(lines)
    return (whole[:start] + mutant.text.encode() + whole[end:]).decode()


# which tests reach which line


def trace(test_file: str, out: Path) -> None:
    """Run the tests of one file under coverage, and write which lines each reaches and how long it takes."""
    import coverage
    import pytest

    cov = coverage.Coverage(data_file=None, source=[str(ROOT / "testbench")], config_file=False)

    class Tracer:
        seconds: dict[str, float] = {}

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
            cov.switch_context(item.nodeid)
            result = yield
            cov.switch_context("")
            return result  # type: ignore[return-value]

        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration

    tracer = Tracer()
    cov.start()
    try:
        pytest.main(["-q", "-m", "not slow", "-p", "no:cacheprovider", test_file], plugins=[tracer])
    finally:
        cov.stop()
    data = cov.get_data()
    reached: dict[str, dict[int, list[str]]] = {}
    for path in data.measured_files():
        by_line = data.contexts_by_lineno(path)
        reached[str(Path(path).relative_to(ROOT))] = {n: [c for c in tests if c] for n, tests in by_line.items()}
    out.write_text(json.dumps({"seconds": tracer.seconds, "reached": reached}), encoding="utf-8")


def traced(room: str, work: Path) -> dict[str, dict[str, dict]]:
    """Return test file -> what :func:`trace` wrote; what has not been traced yet, or has changed since, is traced."""
    out = {}
    sources = b"".join(p.read_bytes() for p in sorted((ROOT / ROOMS[room][0]).rglob("*.py")))
    for place in ROOMS[room][1]:
        for file in sorted((ROOT / place).rglob("test_*.py")) or [ROOT / place]:
            name = str(file.relative_to(ROOT))
            digest = hashlib.sha256(name.encode() + file.read_bytes() + sources).hexdigest()[:16]
            kept = work / f"{digest}.json"
            if not kept.exists():
                print(f"tracing {name}", flush=True)
                run_tests(ROOT, [sys.executable, __file__, "--trace", name, str(kept)], _FILE_S)
            if not kept.exists():
                print(f"{name} takes longer than {_FILE_S:g} s: its tests take no part", flush=True)
                kept.write_text('{"seconds": {}, "reached": {}}', encoding="utf-8")
            out[name] = json.loads(kept.read_text(encoding="utf-8"))
    return out


def tests_of(mutant: Mutant, tracing: dict[str, dict[str, dict]]) -> list[tuple[float, str]]:
    """Return seconds and name of the tests that reach the line, quickest first; for a constant, those of its file."""
    lines: dict[str, set[str]] = {}
    seconds: dict[str, float] = {}
    for found in tracing.values():
        seconds |= found["seconds"]
        for line, tests in found["reached"].get(mutant.path, {}).items():
            lines.setdefault(line, set()).update(tests)
    tests = lines.get(str(mutant.line)) or set().union(*lines.values())
    chosen, total = [], 0.0
    for s, name in sorted((seconds.get(n, 0.0), n) for n in tests):
        if chosen and total + s > LONGEST_S:
            break
        chosen.append((s, name))
        total += s
    return chosen


# one mutant after another


def run_tests(folder: Path, command: list[str], timeout_s: float) -> int | None:
    """Return the exit status of a command in a tree, None after a while; its children end with it."""
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, cwd=folder, env=environment, stdout=quiet, stderr=quiet, start_new_session=True)
    try:
        return process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        return None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def copy_of_tree(folder: Path) -> None:
    """Copy what git knows, and what is new, into ``folder``."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in listed.stdout.decode().split("\0"):
        if name and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def end_of(mutant: Mutant, tests: list[tuple[float, str]], tree: Path) -> str:
    """Return killed, survived, or not reached."""
    if not tests:
        return "not reached"
    names = [name for _, name in tests]
    timeout_s = 60.0 + 10.0 * sum(s for s, _ in tests)
    place = tree / mutant.path
    place.write_text(sown(mutant), encoding="utf-8")
    try:
        status = run_tests(
            tree, [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *names], timeout_s
        )
    finally:
        shutil.copy(ROOT / mutant.path, place)
    return "survived" if status == 0 else "killed"


def reasons() -> dict[tuple[str, str, str], str]:
    """Return mutant -> why no test can tell it from what was written."""
    with REASONS.open(encoding="utf-8", newline="") as file:
        return {(r["path"], r["line"], r["change"]): r["reason"] for r in csv.DictReader(file)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument(
        "--rooms", nargs="*", choices=ROOMS, default=list(ROOMS), help="those of the draw in these rooms"
    )
    parser.add_argument("--again", choices=["survived", "not reached"], help="try those that ended so again")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "testbench-mutants")
    parser.add_argument("--out", type=Path, default=TABLE)
    parser.add_argument("--trace", nargs=2, metavar=("TESTS", "OUT"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.trace:
        return trace(asked.trace[0], Path(asked.trace[1]))
    asked.work.mkdir(parents=True, exist_ok=True)
    done: dict[tuple[str, str, str], str] = {}
    if asked.out.exists():
        with asked.out.open(encoding="utf-8", newline="") as file:
            done = {(r["path"], r["line"], r["change"]): r["end"] for r in csv.DictReader(file)}
    done = {key: end for key, end in done.items() if end != asked.again and end != "equivalent"}
    draw = drawn(asked.count)
    tracing: dict[str, dict[str, dict[str, dict]]] = {}
    with tempfile.TemporaryDirectory(dir=asked.work) as tree:
        copy_of_tree(Path(tree))
        for mutant in draw:
            if mutant.key in done or mutant.key in reasons() or mutant.room not in asked.rooms:
                continue
            if mutant.room not in tracing:
                tracing[mutant.room] = traced(mutant.room, asked.work)
            end = end_of(mutant, tests_of(mutant, tracing[mutant.room]), Path(tree))
            done[mutant.key] = end
            print(f"{end:12} {mutant.path}:{mutant.line}: {mutant.change}", flush=True)
            write(asked.out, draw, done)
    write(asked.out, draw, done)
    return None


def write(path: Path, draw: list[Mutant], done: dict[tuple[str, str, str], str]) -> None:
    """Write the rows of the draw that have an end, and say how many were killed."""
    why = reasons()
    rows = [(m, "equivalent" if m.key in why else done[m.key]) for m in draw if m.key in done or m.key in why]
    with path.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["room", "path", "line", "change", "end", "reason"])
        out.writerows([m.room, *m.key, end, why.get(m.key, "")] for m, end in rows)


if __name__ == "__main__":
    main()
