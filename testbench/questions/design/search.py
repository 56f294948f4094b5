"""The search for an input: screen every family, refine the best, design switching signals and line powers.

Every candidate is judged at the largest admissible amplitude that the linearised aircraft predicts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.information.fisher import accuracy
from testbench.questions.design.candidates import candidates
from testbench.questions.design.problem import Design, Problem, Screened, by_energy, by_information, design_of
from testbench.questions.design.refine import designed_multisine, designed_switching, refined

_UPPER, _LEAST = 0.4, 5  # share of each family, and least number, whose information is computed
_REFINED = 3  # families whose free times are refined


def screen(problem: Problem, progress: Callable[[int], None] | None = None) -> list[Screened]:
    """Return every candidate of every family, best first.

    All are judged by spectral energy: the signal-to-noise ratio of the mode that a candidate shows worst, at the sensor
    that shows this mode best. The best of each family are then judged by information; the others rank behind them.

    Raises:
        EstimationError: no signal of any family fits.
    """
    families: dict[str, list[Screened]] = {}
    for count, candidate in enumerate(
        candidates(
            problem.controls,
            problem.duration_s,
            problem.shortest_s,
            problem.band_hz,
            problem.rate_hz,
            problem.by_hand,
            problem.start_s,
        ),
        1,
    ):
        families.setdefault(candidate.family, []).append(by_energy(problem, candidate))
        if progress is not None:
            progress(count)
    if not families:
        raise EstimationError(
            f"no signal fits into duration_s = {problem.duration_s:g} with steps of at least {problem.shortest_s:g} s; "
            "lengthen the manoeuvre or shorten the shortest step"
        )
    out = []
    for members in families.values():
        upper = max(_LEAST, round(_UPPER * len(members))) if problem.bands is not None else len(members)
        members = sorted(members, key=lambda s: -s.snr_db)
        out += [by_information(problem, entry) if i < upper else entry for i, entry in enumerate(members)]
    return sorted(out, key=lambda s: s.cost)


def best_of_families(ranked: list[Screened]) -> dict[str, Screened]:
    """Return family -> its best candidate, best family first."""
    best: dict[str, Screened] = {}
    for entry in ranked:
        best.setdefault(entry.candidate.family, entry)
    return best


def search(
    problem: Problem, progress: Callable[[str], None] | None = None, ranked: list[Screened] | None = None
) -> list[Design]:
    """Return the best of every family, the designed switching signal and the designed multisine, best first.

    Args:
        problem: the design problem.
        progress: called with a few words as each stage begins.
        ranked: what :func:`screen` found, if that has been done.

    Raises:
        EstimationError: no signal of any family fits, or none tells anything of some target.
    """
    say = progress or (lambda text: None)
    if ranked is None:
        say("screen every family")
        ranked = screen(problem)
    best = best_of_families(ranked)
    if not np.isfinite(ranked[0].cost):
        raise EstimationError(_untold(problem, ranked))
    say("refine the best by information")
    for family in list(best)[:_REFINED]:
        best[family] = refined(problem, best[family])
    designed = [design_of(problem, entry) for entry in best.values() if np.isfinite(entry.cost)]
    say("design a switching signal")
    designed += designed_switching(problem, ranked)
    if not problem.by_hand:
        say("design a multisine")
        designed += designed_multisine(problem, best.get("multisine"))
    return sorted(designed, key=lambda d: d.cost)


def _with_known(problem: Problem, entry: Screened) -> FloatArray:
    M = problem.experiment.information(entry.candidate.u)
    return M if problem.known is None else M + problem.known


def _untold(problem: Problem, ranked: list[Screened]) -> str:
    """Return the error that says which targets no candidate tells."""
    lost: set[str] = set(problem.targets.names)
    for entry in ranked:
        errors = problem.targets.errors(accuracy(_with_known(problem, entry)))
        lost &= {n for n, e in zip(problem.targets.names, errors, strict=True) if not np.isfinite(e)}
        if not lost:
            break
    which = f"anything of {', '.join(sorted(lost))}" if lost else "all targets apart from one another"
    return (
        f"a design needs a signal that tells all targets, but through the sensors "
        f"{', '.join(problem.experiment.structure.outputs)} no signal of any family on {', '.join(problem.controls)} "
        f"tells {which}; leave targets out, or add sensors or controls"
    )
