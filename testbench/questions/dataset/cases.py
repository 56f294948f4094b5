"""Fly cases in which an effect is to be named: the sealed ones of the blind test, then others by the same laws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from testbench.questions.dataset.draws import hash_share
from testbench.questions.dataset.flying import Part, fill, hide
from testbench.questions.dataset.layout import NAMING_SETS, Layout
from testbench.questions.dataset.scenario import DatasetScenario
from testbench.questions.gap.sealed.cases import STRATA, Case, draw_case
from testbench.questions.gap.sealed.flights import condition


def sealed_order(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    """Return (stratum, number) of sealed cases in the order of the blind test: the first of each stratum first."""
    most = max(counts.values(), default=0)
    return [(stratum, i) for i in range(most) for stratum, n in counts.items() if i < n]


def case_of(scenario: DatasetScenario, layout: Layout, number: int) -> tuple[Case, str]:
    """Return draw ``number`` of a data set for naming, and its split.

    Raises:
        LimitError: no draw of this case flies.
    """
    assert scenario.strata is not None
    if number < layout.sealed:
        counts = STRATA if scenario.strata.sealed is None else scenario.strata.sealed
        return draw_case(*sealed_order(counts)[number], scenario.strata.sealed_seed), "test"
    left = number - layout.sealed
    strata = tuple(STRATA)
    case = draw_case(strata[left % len(strata)], left // len(strata), scenario.seed)
    train, validation = scenario.split.train, scenario.split.validation
    share = hash_share([case.aircraft, case.kinds, list(case.sizes), dict(case.factors), case.turbulence_rms_m_s])
    return case, "train" if share * (train + validation) < train else "validation"


def fly_case_part(scenario: DatasetScenario, layout: Layout, first: int, last: int) -> Part:
    """Fly the cases ``first`` to ``last``, the latter not included, by JSBSim: a seed must give the same bytes.

    Raises:
        LimitError: no draw of a case flies.
    """
    parts = [_rows(scenario, layout, number) for number in range(first, last)]
    count = min(last * layout.per_draw, layout.flights) - first * layout.per_draw
    rows = {name: np.concatenate([p[name] for p in parts])[:count] for name in parts[0]}
    return Part(rows, last - first, {})


def _rows(scenario: DatasetScenario, layout: Layout, number: int) -> dict[str, Any]:
    case, split = case_of(scenario, layout, number)
    records = {name: r for which in NAMING_SETS for name, r in case.fly(which).items()}
    out = layout.empty(layout.per_draw)
    for k, name in enumerate(layout.manoeuvres):
        data = records[name].data
        out["readings"][k, : len(data)] = data
        out["samples"][k], out["manoeuvre"][k] = len(data), k
    fill(out, layout, number, case.stratum, case.aircraft, split)
    at = condition(case.aircraft)
    out["V_m_s"][:], out["h_m"][:] = at.V_m_s, at.h_m
    out["turbulence_rms_m_s"][:] = case.turbulence_rms_m_s
    out["truth"][:] = [case.factors[name] for name in layout.figures]
    hide(out, layout, case.kinds, case.sizes)
    return out
