"""Bring the coefficients of a model to rest within their priors: step, fly, repeat."""

from __future__ import annotations

from testbench.questions.gap.search.hypothesis import SHORTENED, Hypothesis

MAX_ROUNDS = 14
AT_REST = 0.1  # the rounds end when another one promises to lower chi-square by less
KEPT = 0.9  # share of a promised gain that a step must reach for its tangents to be kept


def retune(base: Hypothesis) -> Hypothesis:
    """Re-tune the nuisances of the model of ``base`` until they rest; return the best point.

    It uses tangents of linear predictions first and flown ones then. Tangents of a linearisation about trim may rest a
    few units of chi-square too high, which a false effect would gain.
    """
    here = _rest(base)
    return _rest(here.afresh(True), flown=True)


def _rest(here: Hypothesis, flown: bool = False) -> Hypothesis:
    """Take steps until they rest; where tangents have failed, take them anew, ``flown`` or from linear predictions."""
    for _ in range(MAX_ROUNDS):
        left, nuisances = here.tuned(here.exact)
        if here.chi2 - float(left @ left) < AT_REST:
            break
        there = None
        for share in SHORTENED:
            moved = here.moved(here.model, here.nuisances + share * (here.towards(nuisances) - here.nuisances))
            if moved is not None and moved.chi2 < here.chi2:
                kept = share == 1.0 and not _broken(here.chi2, float(left @ left), moved.chi2)
                there = moved if kept else moved.afresh(flown)
                break
        if there is None:
            break
        here = there
    return here


def _broken(before: float, promised: float, flown: float) -> bool:
    """Return whether a step gained so much less than linear predictions promised that new tangents are needed.

    Its arguments are chi-square before the step (infinite if not known, as for the first step), as promised, and as
    flown. With old tangents, re-tuning may swing about the best point for all its rounds.
    """
    return before - flown < KEPT * (before - promised)
