"""Conditions and what depends on them, of JSBSim's flight control (FGCondition, FGSwitch, FGDistributor)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import reduce

from testbench.flight.batch.program import Op, Untranslated, Value
from testbench.flight.batch.scope import Scope

_COMPARISONS = {
    "==": Op.EQ, "!=": Op.NE, "<": Op.LT, "<=": Op.LE, ">": Op.GT, ">=": Op.GE,
    "eq": Op.EQ, "ne": Op.NE, "lt": Op.LT, "le": Op.LE, "gt": Op.GT, "ge": Op.GE,
    "EQ": Op.EQ, "NE": Op.NE, "LT": Op.LT, "LE": Op.LE, "GT": Op.GT, "GE": Op.GE,
}  # fmt: skip
_LOGIC = {"AND": Op.AND, "OR": Op.OR}


def switch(c: Scope) -> Value:
    """Translate a switch: the value of the first test that passes, of the default if none does."""
    default = c.e.find("default")
    value = (default.get("value") or "").strip() if default is not None else ""
    tests = []  # in JSBSim's order: what one of them reads must be read, whether it passes or not
    for test in c.e.findall("test"):
        text = (test.get("value") or "").strip()
        if text:
            tests.append((condition(c, test), c.parameter_of(text)))
    out = c.parameter_of(value, 0.0)
    for passes, chosen in reversed(tests):
        out = passes.then(chosen, out)
    return c.delayed(out)


def distribute(c: Scope) -> None:
    """Translate a distributor: each case whose test passes sets properties, only the first one if it is exclusive.

    What one case has set is what the test of the next one reads.
    """
    exclusive = (c.e.get("type") or "") == "exclusive"
    done = c.b.constant(0.0)
    for case in c.e.findall("case"):
        test = case.find("test")
        passes = condition(c, test) if test is not None else None
        if passes is not None and exclusive:
            passes, done = passes & done.do(Op.NOT), done | passes
        for pair in case.findall("property"):
            name, value = (pair.text or "").strip(), c.parameter_of(pair.get("value") or "")
            c.write(name, value if passes is None else passes.then(value, c.p.read(name)))


def distributed(e: ET.Element) -> list[str]:
    """Return the properties that a distributor sets."""
    return list(dict.fromkeys((x.text or "").strip() for x in e.findall("case/property")))


def condition(c: Scope, e: ET.Element) -> Value:
    """Return whether a <test> passes: all or any of its lines and of the tests in it.

    Raises:
        Untranslated: it is not a condition.
    """
    logic = _LOGIC.get(e.get("logic") or "AND")
    if logic is None:
        raise Untranslated(f"a test of {c.name} has the logic {e.get('logic')}")
    text = "\n".join([e.text or "", *(inside.tail or "" for inside in e)])
    parts = [_comparison(c, line) for line in text.splitlines() if line.strip()]
    if any(inside.tag != e.tag for inside in e):
        raise Untranslated(f"a test of {c.name} holds a <{next(x.tag for x in e if x.tag != e.tag)}>")
    parts += [condition(c, inside) for inside in e]
    if not parts:
        raise Untranslated(f"a test of {c.name} is empty")
    return reduce(lambda out, part: out.do(logic, part), parts)


def _comparison(c: Scope, line: str) -> Value:
    words = [word.strip() for word in line.strip().split(" ") if word.strip()]  # JSBSim parts them at blanks only
    comparison = _COMPARISONS.get(words[1]) if len(words) == 3 else None
    if comparison is None:
        raise Untranslated(f"a test of {c.name} says {line.strip()}")
    return c.p.read(words[0]).do(comparison, c.parameter_of(words[2]))
