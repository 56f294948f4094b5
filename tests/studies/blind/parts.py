"""How often the part that was called was the right one: what was said against where the hidden truth acts."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from studies.blind.cases import Case
from studies.blind.score import judge

from testbench.effects import catalogue, library
from testbench.flight import load_aircraft
from testbench.questions.gap.onset import LATER
from testbench.questions.gap.parts import part_names
from testbench.sensors import load_suite

CALLS = ("one effect", "two effects", "set", "unexplained")
NO_PART = ("nothing", "nothing in turbulence")
# Where kinds act that the library does not hold.
UNSEEN: Mapping[str, str] = {
    "coarse command": "elevator path",
    "damping curved in alpha": "pitching moment",
    "elevator that fades": "pitching moment",
    "frozen attitude": "theta sensor",
    "gyro that saturates on one side": "q sensor",
    "lift of the thrust": "lift",
    "motor with a bent curve": "thrust",
    "sticky vane": "alpha sensor",
    "stuck link": "elevator path",
    "vibration": "structure",
    "wandering attitude": "theta sensor",
}


def called(cases: Iterable[Case], rows: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[int, int, int]]:
    """Return for each kind of call: rows with the right part, with the right effect, and all that were called so.

    Rows of cases with six and two manoeuvres, and of those without the true effect, count alike. A part is right if
    every part that was called is one in which the hidden truth acts, or, of a set, if one of them is.
    """
    by_name = {c.name: c for c in cases}
    found: dict[str, Counter[str]] = {call: Counter() for call in CALLS}
    for name, row in rows.items():
        case = by_name[name.split(", ")[0]]
        if case.stratum in NO_PART or row["outcome"] in ("failed", "no gap") or row["best"] is None:
            continue
        call = call_of(row["names"])
        said = parts_said(row["names"] or [row["best"]])
        true = parts_true(case)
        count = found[call]
        count["all"] += 1
        count["part"] += bool(said & true) if call == "set" else said <= true
        count["effect"] += judge(case, row).verdict in ("right", "in set")
    return {call: (count["part"], count["effect"], count["all"]) for call, count in found.items()}


def parts_true(case: Case) -> set[str]:
    """Return the parts in which what a case hides acts."""
    return {p for kind, right in zip(case.kinds, case.right, strict=True) for p in _true_parts(kind, right)}


def _true_parts(kind: str, right: Iterable[str]) -> set[str]:
    return parts_said(right) or {UNSEEN[kind]}


def parts_said(names: Iterable[str]) -> set[str]:
    """Return the parts in which named effects act.

    A term that no library holds, such as "Cn by beta^3", or a coefficient that is wrong, such as "Cn_dr", acts in the
    paths of the controls in it, and without any in the part that its coefficient is of.
    """
    return {part for name in names for single in name.split(" + ") for part in _part(single)}


def _part(name: str) -> tuple[str, ...]:
    name = name.removesuffix(LATER)
    if name in _LIBRARY:
        return ("air",) if name == "gust" else part_names(_LIBRARY[name])
    coefficient, _, term = name.replace(" by ", "_").partition("_")
    paths = tuple(_PATHS[c] for c in dict.fromkeys(re.findall(r"\b(de|da|dr|thr)\b", term)))
    return paths or (_OF_COEFFICIENT[coefficient],)


_PATHS = {"de": "elevator path", "da": "aileron path", "dr": "rudder path", "thr": "thrust"}
_OF_COEFFICIENT = {"CL": "lift", "CD": "drag", "CY": "fin", "Cl": "wing", "Cm": "pitching moment", "Cn": "fin"}


_LIBRARY = (
    catalogue(load_suite("eolo_gap_lateral"))
    | library(load_suite("eolo_alpha"), load_aircraft("eolo", "rigid"))
    | library(load_suite("eolo_gap"), load_aircraft("taurus"))
)


def call_of(names: Sequence[str]) -> str:
    """Return the kind of call by what is named; several effects at once are one name, "A + B"."""
    if not names:
        return "unexplained"
    return "set" if len(names) > 1 else "two effects" if " + " in names[0] else "one effect"
