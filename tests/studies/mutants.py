"""Would the tests notice? Small errors are sown into the numerical rooms, one at a time, and each room's tests are run.

    python tests/studies/mutants.py                   # the study: half an hour on an idle machine; goes on if stopped
    python tests/studies/mutants.py --count 60        # the first 60 of the same draw
    python tests/studies/mutants.py --again survived  # those that were alive are tried again, after a test was added

A mutant is one change of one place: + and -, * and /, ** and *, < and <=, == and !=, ``and`` and ``or``, a sign, a
number plus 1, less 1 or 1.5 times as large. Texts, raised errors and annotations are left alone. The draw is even over
the rooms and has a fixed seed. Which tests reach which mutant is found once (reaching_tests.py); a test that fails
without a mutant takes no part. A mutant is killed by the first test that fails, or by one that takes ten times as
long; the quickest tests come first, at most ``LONGEST_S`` seconds of them.

mutants.csv: one row for each mutant with its end: killed, survived, or equivalent with the reason why no test can tell.
A survivor has its reason, too, if somebody has looked at it: a number of which another is as good.
The mutant is sown into a copy of the tree; the tree itself is never changed.
"""

import argparse
import ast
import compileall
import functools
import hashlib
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pytest
from reaching_tests import Span, in_child, let_report, watch
from smallest import build, results, sized
from tables import read_rows, write_rows

ROOT = Path(__file__).resolve().parents[2]
TABLE = results("mutants.csv")
REASONS = Path(__file__).with_name("equivalent_mutants.csv")
SURVIVORS = Path(__file__).with_name("surviving_mutants.csv")
SEED = 34
COUNT = sized(400, 6)
LONGEST_S = 60.0  # of tests for one mutant
# imported once, before the children fork: what the tests need that is not the testbench's own
_LIBRARIES = ("scipy.optimize", "scipy.signal", "scipy.stats", "scipy.integrate", "scipy.io", "pandas", "jsbsim")
ROOMS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # room -> its folders and files, those of its tests
    "aircraft": (("testbench/aircraft",), ("tests/aircraft", "tests/contracts/test_aircraft_contract.py")),
    "flight": (("testbench/flight",), ("tests/flight",)),
    "inputs": (("testbench/inputs",), ("tests/inputs", "tests/design/test_spectral_energy.py")),
    "sensors": (("testbench/sensors",), ("tests/sensors", "tests/contracts/test_suite_contract.py")),
    "estimators": (("testbench/estimators",), ("tests/estimators", "tests/contracts/test_estimator_contract.py")),
    "evaluation": (("testbench/evaluation",), ("tests/evaluation",)),
    "design": (("testbench/design",), ("tests/design", "tests/questions/design")),
    "gap": (("testbench/questions/gap",), ("tests/questions/gap",)),
    "logs": (("testbench/logs",), ("tests/logs", "tests/cases")),
    "information": (("testbench/information",), ("tests/information", "tests/questions/design/test_known.py")),
    "pool": (("testbench/pooling", "testbench/questions/identify/pool"), ("tests/questions/identify",)),
    "plan": (("testbench/questions/plan",), ("tests/questions/plan",)),
    "project": (
        ("testbench/questions/project", "testbench/core/project.py"),
        ("tests/questions/project", "tests/questions/test_campaign_closes.py"),
    ),
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


@functools.cache
def lines_of(path: str) -> list[str]:
    return (ROOT / path).read_text(encoding="utf-8").splitlines()


def source_line(path: str, line: int) -> str:
    return lines_of(path)[line - 1].strip()


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
    """Return ``count`` mutants, room by room in turn; a longer draw begins with a shorter one.

    Each takes its place by a hash of its key: a line that is rewritten changes the draw by its own mutants alone.
    """
    queues = []
    for room, (own, _) in ROOMS.items():
        every = [m for path in files_of(own, "*.py") for m in mutants_of(room, path)]
        one_each = {m.key: m for m in reversed(every)}  # of equal lines the first
        queues.append(sorted(one_each.values(), key=lambda m: hashlib.sha256(f"{SEED} {m.key}".encode()).digest()))
    turns = (queue[k] for k in range(max(map(len, queues))) for queue in queues if k < len(queue))
    return [m for m, _ in zip(turns, range(count), strict=False)]


def files_of(places: Iterable[str], pattern: str) -> list[str]:
    """Return the files in some folders, each folder's in order; a place may be a file."""
    return [
        str(file.relative_to(ROOT))
        for place in places
        for file in sorted((ROOT / place).rglob(pattern)) or [ROOT / place]
    ]


def sown(mutant: Mutant) -> str:
    """Return the file with the change."""
    lines = (ROOT / mutant.path).read_bytes().splitlines(keepends=True)  # columns of ast count bytes
    start = sum(len(x) for x in lines[: mutant.line - 1]) + mutant.column
    end = sum(len(x) for x in lines[: mutant.end[0] - 1]) + mutant.end[1]
    whole = b"".join(lines)
    return (whole[:start] + mutant.text.encode() + whole[end:]).decode()


# which tests reach it, and what they say


def traced(room: str, mutants: list[Mutant], work: Path) -> dict[str, tuple[float, list[str]]]:
    """Return test -> seconds and the mutants that it reaches; test files that are new or have changed are traced."""
    names = {place_of(m) for m in mutants}
    kept = {}
    for name in files_of(ROOMS[room][1], "test_*.py"):
        text = "".join(sorted(names)).encode() + (ROOT / name).read_bytes()
        kept[name] = work / f"{hashlib.sha256(text).hexdigest()[:16]}.json"
    missing = [name for name, at in kept.items() if not at.exists()]
    if missing:
        print(f"tracing {len(missing)} test files of {room}", flush=True)
        asked: dict[str, dict[Span, str]] = {}
        for m in mutants:
            asked.setdefault(m.path, {})[m.line, m.column, *m.end] = place_of(m)
        with tempfile.TemporaryDirectory(dir=work) as tree:
            copy_of_tree(Path(tree))
            let_report(Path(tree), "testbench", asked)
            out = work / f"{room}.json"
            in_child(Path(tree), lambda: watch(missing, out), work / f"{room}.log", 3600.0)
        found = json.loads(out.read_text(encoding="utf-8"))
        for name in missing:
            of_file = {test: row for test, row in found.items() if test.partition("::")[0] == name}
            kept[name].write_text(json.dumps(of_file), encoding="utf-8")
    return {test: row for at in kept.values() for test, row in json.loads(at.read_text(encoding="utf-8")).items()}


def place_of(mutant: Mutant) -> str:
    """Return the name under which the mutated expression reports: other mutants of one expression share it."""
    return f"{mutant.path}:{mutant.key[1]}:{mutant.change.rpartition(' at ')[2]}:{mutant.end[1] - mutant.column}"


def tests_of(mutant: Mutant, tracing: dict[str, tuple[float, list[str]]]) -> list[tuple[float, str]]:
    """Return seconds and name of the tests that reach the mutant, quickest first."""
    chosen: list[tuple[float, str]] = []
    total, place = 0.0, place_of(mutant)
    for s, name in sorted((s, name) for name, (s, places) in tracing.items() if place in places):
        if chosen and total + s > LONGEST_S:
            break
        chosen.append((s, name))
        total += s
    return chosen


def copy_of_tree(folder: Path) -> None:
    """Copy what git knows, and what is new, into ``folder``, and compile it."""
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
    compileall.compile_dir(folder / "testbench", quiet=2)


def end_of(mutant: Mutant, tests: list[tuple[float, str]], tree: Path, log: Path) -> str:
    """Return killed, survived, or not reached."""
    if not tests:
        return "not reached"
    command = ["-x", "-q", "-p", "no:cacheprovider", *(name for _, name in tests)]
    timeout_s = 60.0 + 10.0 * sum(s for s, _ in tests)
    place = tree / mutant.path
    place.write_text(sown(mutant), encoding="utf-8")

    def run(kernels: str) -> int:
        os.environ["NUMBA_CACHE_DIR"] = kernels  # a kernel is kept by its own file: those that it calls may be sown
        return int(pytest.main(command))

    try:
        with tempfile.TemporaryDirectory() as kernels:
            status = in_child(tree, lambda: run(kernels), log, timeout_s)
    finally:
        shutil.copy2(ROOT / mutant.path, place)
    return "survived" if status == 0 else "killed"


def reasons(of: Path = REASONS) -> dict[tuple[str, str, str], str]:
    """Return mutant -> why no test can tell it from what was written, or why a survivor does no harm."""
    return {(r["path"], r["line"], r["change"]): r["reason"] for r in read_rows(of)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument(
        "--rooms", nargs="*", choices=ROOMS, default=sized(list(ROOMS), ["evaluation"]), help="of the draw"
    )
    parser.add_argument("--again", choices=["survived", "not reached"], help="try those that ended so again")
    parser.add_argument("--work", type=Path, default=build("mutants"))
    parser.add_argument("--out", type=Path, default=TABLE)
    asked = parser.parse_args()
    asked.work.mkdir(parents=True, exist_ok=True)
    kept = [r for r in read_rows(asked.out) if r["end"] != asked.again or r["room"] not in asked.rooms]
    done: dict[tuple[str, str, str], str]
    done = {(r["path"], r["line"], r["change"]): r["end"] for r in kept if r["end"] != "equivalent"}
    draw = drawn(asked.count)
    left = [m for m in draw if m.key not in done and m.key not in reasons() and m.room in asked.rooms]
    for library in _LIBRARIES:
        importlib.import_module(library)
    with tempfile.TemporaryDirectory(dir=asked.work) as tree:
        copy_of_tree(Path(tree))
        for room in dict.fromkeys(m.room for m in left):
            tracing = traced(room, [m for m in draw if m.room == room], asked.work)
            for mutant in left:
                if mutant.room == room:
                    tests = tests_of(mutant, tracing)
                    done[mutant.key] = end = end_of(mutant, tests, Path(tree), asked.work / "last.log")
                    print(f"{end:12} {mutant.path}:{mutant.line}: {mutant.change} ({len(tests)} tests)", flush=True)
                    write(asked.out, draw, done)
    write(asked.out, draw, done)


def write(path: Path, draw: list[Mutant], done: dict[tuple[str, str, str], str]) -> None:
    """Write the rows of the draw that have an end, and say how many were killed."""
    why, harmless = reasons(), reasons(SURVIVORS)
    rows = [(m, "equivalent" if m.key in why else done[m.key]) for m in draw if m.key in done or m.key in why]
    said = why | {key: text for key, text in harmless.items() if done.get(key) == "survived"}
    heads = ("room", "path", "line", "change", "end", "reason")
    write_rows(path, heads, ([m.room, *m.key, end, said.get(m.key, "")] for m, end in rows))


if __name__ == "__main__":
    main()
