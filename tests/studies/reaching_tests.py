"""Which tests reach which expression? Found by one run of the tests over a copy in which those expressions report.

Each expression asked about is replaced by one that first writes down the test under way, in child processes too.
What a fixture of a module or session reaches counts for every test that uses the fixture. A constant of a module has
been read before any test starts: every function that names it, and every function of its file, reports in its place.
So does every function of a folder for what stands in a compiled one, which cannot report.
"""

import ast
import contextlib
import json
import os
import re
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from clock import since

LONGEST_TEST_S = 60  # of one test; a test that takes longer takes no part
_REPORTER = """
import os
_seen = set()
def reached(*places):
    test = os.environ.get("TESTBENCH_REACHING", "")
    for place in places:
        if test and (place, test) not in _seen:
            _seen.add((place, test))
            with open(os.environ["TESTBENCH_REACHED"], "a", encoding="utf-8") as file:
                file.write(f"{place}\\t{test}\\n")
"""
Span = tuple[int, int, int, int]


def span(node: ast.AST) -> Span:
    """Return line and column of the start and of the end of an expression."""
    return node.lineno, node.col_offset, node.end_lineno, node.end_col_offset  # type: ignore[attr-defined]


class _Reporting(ast.NodeTransformer):
    """Let expressions at ``places`` report, and functions that use a constant report in its place."""

    def __init__(self, places: dict[Span, str], constants: dict[str, list[str]], whole_file: list[str]) -> None:
        self.places, self.constants, self.whole_file = places, constants, whole_file

    @staticmethod
    def _call(places: list[str]) -> ast.expr:
        text = f"__import__('testbench_reached').reached({', '.join(map(repr, places))})"
        return ast.parse(text, mode="eval").body

    def generic_visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, (ast.JoinedStr, ast.Import, ast.ImportFrom, ast.pattern)):
            return node
        place = self.places.get(span(node)) if isinstance(node, ast.expr) else None
        node = super().generic_visit(node)
        if place is not None and isinstance(node, ast.expr):
            return ast.Subscript(ast.Tuple([self._call([place]), node], ast.Load()), ast.Constant(1), ast.Load())
        return node

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> ast.AST:
        if _is_compiled(node):
            return node
        used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        used |= {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
        told = self.whole_file + [place for name in used for place in self.constants.get(name, [])]
        self.generic_visit(node)
        if told:
            node.body.insert(1 if ast.get_docstring(node) else 0, ast.Expr(self._call(sorted(set(told)))))
        return node

    visit_FunctionDef = _function
    visit_AsyncFunctionDef = _function


def _is_compiled(node: ast.AST) -> bool:
    """Say whether a function is compiled by numba, or by the testbench's own decorator for it."""
    return isinstance(node, ast.FunctionDef) and any(
        re.match(r"compiled|intrinsic|numba\.", ast.unparse(decorator)) for decorator in node.decorator_list
    )


def constant_of(module: ast.Module, at: Span) -> list[str] | None:
    """Return the names that an expression read on import is bound to; None of one within a function."""
    for node in ast.walk(module):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            body = node.body if isinstance(node.body, list) else [node.body]
            if span(body[0])[:2] <= at[:2] and at[2:] <= span(body[-1])[2:]:
                return None
    names: list[str] = []
    for node in ast.walk(module):
        if isinstance(node, ast.stmt) and span(node)[:2] <= at[:2] and at[2:] <= span(node)[2:]:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            names += [n.id for t in targets if t is not None for n in ast.walk(t) if isinstance(n, ast.Name)]
            names += [node.name] if isinstance(node, (ast.FunctionDef, ast.ClassDef)) else []
    return names


def let_report(tree: Path, package: str, asked: dict[str, dict[Span, str]]) -> None:
    """Rewrite the files of ``package`` in ``tree`` so that expressions report: ``asked`` is file -> span -> name."""
    modules = {
        str(p.relative_to(tree)): ast.parse(p.read_text(encoding="utf-8")) for p in (tree / package).rglob("*.py")
    }
    constants: dict[str, list[str]] = defaultdict(list)
    within: dict[str, dict[Span, str]] = defaultdict(dict)
    of_file: dict[str, list[str]] = defaultdict(list)
    has_kernels = {path for path, module in modules.items() if any(_is_compiled(node) for node in module.body)}
    for path, places in asked.items():
        for at, place in places.items():
            names = constant_of(modules[path], at)
            if path in has_kernels:
                for other in modules:
                    if Path(other).parent == Path(path).parent:
                        of_file[other].append(place)
            elif names is None:
                within[path][at] = place
            else:
                of_file[path].append(place)
                for name in names:
                    constants[name].append(place)
    for path, module in modules.items():
        new = _Reporting(within[path], constants, of_file[path]).visit(module)
        (tree / path).write_text(ast.unparse(ast.fix_missing_locations(new)), encoding="utf-8")
    (tree / "testbench_reached.py").write_text(_REPORTER, encoding="utf-8")


class _TooLong(BaseException):
    pass


class _Watch:
    """Say which test or fixture is under way, and keep how each test ends, after how long with all that it needs."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.failed: set[str] = set()
        self.fixtures: dict[str, list[str]] = {}
        self.made_in: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        def stop(*_: Any) -> None:
            raise _TooLong

        os.environ["TESTBENCH_REACHING"] = item.nodeid
        found = getattr(item, "_fixtureinfo", None)
        known = found.name2fixturedefs.items() if found else ()
        self.fixtures[item.nodeid] = [f"{name}@{defined[-1].baseid}" for name, defined in known]
        signal.signal(signal.SIGALRM, stop)
        signal.alarm(LONGEST_TEST_S)
        try:
            return (yield)
        finally:
            signal.alarm(0)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        before, begun = os.environ["TESTBENCH_REACHING"], time.monotonic()
        os.environ["TESTBENCH_REACHING"] = name = f"{fixturedef.argname}@{fixturedef.baseid}"
        try:
            return (yield)
        finally:
            os.environ["TESTBENCH_REACHING"] = before
            self.made_in[name] = since(begun, time.monotonic)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            self.seconds[report.nodeid] = report.duration
        if report.outcome != "passed":  # one that is skipped can tell nothing either
            self.failed.add(report.nodeid)


def watch(files: list[str], out: Path) -> None:
    """Run the tests of some files in the working folder, and write test -> seconds and the places that it reaches."""
    os.environ["TESTBENCH_REACHED"] = str(out.with_suffix(".reached"))
    Path(os.environ["TESTBENCH_REACHED"]).write_text("", encoding="utf-8")
    seen = _Watch()
    pytest.main(["-q", "-m", "not slow", "-p", "no:cacheprovider", *files], plugins=[seen])
    places: dict[str, set[str]] = defaultdict(set)
    for row in Path(os.environ["TESTBENCH_REACHED"]).read_text(encoding="utf-8").splitlines():
        place, _, by = row.partition("\t")
        places[by].add(place)
    rows = {}
    for test, own_s in seen.seconds.items():
        if test not in seen.failed:
            needs = seen.fixtures.get(test, [])
            reached = places[test].union(*(places[f] for f in needs))
            rows[test] = [round(own_s + sum(seen.made_in.get(f, 0.0) for f in needs), 3), sorted(reached)]
    out.write_text(json.dumps(rows), encoding="utf-8")


def in_child(folder: Path, run: Callable[[], int | None], log: Path, timeout_s: float) -> int | None:
    """Return what ``run`` returns in a forked child that works in ``folder``, None after a while.

    What is imported already need not be imported again; the child's own children end with it.
    """
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        status = 99
        try:
            os.setsid()
            os.chdir(folder)
            file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(file, stream)
            sys.path.insert(0, str(folder))
            os.environ["PYTHONPATH"] = f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
            sys.dont_write_bytecode = True
            os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
            status = int(run() or 0)
        finally:
            sys.stdout.flush()
            os._exit(status)
    end = time.monotonic() + timeout_s
    ended = 0
    while not ended and time.monotonic() < end:
        time.sleep(0.02)
        ended, raw = os.waitpid(pid, os.WNOHANG)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    if not ended:
        os.waitpid(pid, 0)
        return None
    return os.waitstatus_to_exitcode(raw)
