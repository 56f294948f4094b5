"""Stepwise regression by partial F, as a baseline that studies compare with.

V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 5. The package chooses terms by evidence
(:mod:`testbench.estimators.regression.orthogonal`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.core.advice import doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.regression.data import BIAS, RegressionData, check_terms
from testbench.estimators.regression.equation_error import (
    as_records,
    block,
    equation_error,
    require_samples,
    stack,
)
from testbench.estimators.regression.result import RegressionResult

_SPAN = 1e-6  # a candidate with less than this share of its length outside the chosen terms is one of them
_F = 12.0  # P(F(1, inf) > 12) = 5.3e-4 per candidate
_DONE = 1e-24  # share of the target's energy that is rounding


def stepwise(
    data: RegressionData | Sequence[RegressionData],
    target: str,
    candidates: Sequence[str],
    *,
    f_in: float = _F,
    f_out: float = _F,
    correct_colour: bool = True,
) -> RegressionResult:
    """Choose terms by stepwise regression: the best one enters, then any that no longer matters leaves.

    The candidate with the largest partial correlation with what is left of the target enters if its partial
    F = (theta / std)^2 after entry is at least ``f_in``; then terms whose partial F falls below ``f_out`` leave, the
    weakest first. With white residuals and 12 a candidate without effect enters with probability 5e-4. Coloured
    residuals make this F too large, often 3 to 10 times, and let noise in: with ``correct_colour`` terms leave in the
    end by an F of errors corrected for the colour. (Not before: what still lacks terms leaves residuals as coloured as
    the motion.)

    Args:
        data: signals of one or several records.
        target: signal to explain.
        candidates: terms, e.g. from ``polynomial_terms``; a constant is always in.
        f_in: partial F to enter.
        f_out: partial F to stay, at most ``f_in``.
        correct_colour: let terms leave by corrected errors in the end.

    Raises:
        EstimationError: f_out > f_in or negative, no candidate that enters, or against ``equation_error``.
        ChannelError: a signal is not there.
    """
    if not 0.0 <= f_out <= f_in:
        raise EstimationError(f"0 <= f_out <= f_in must hold, got {f_out} and {f_in}")
    records, names, X, y = _prepare(data, target, candidates)
    search = _Steps(records, target)
    free = _enter(search, names, X, y, f_in)
    while free is not None:
        search.add(free)
        search.prune(f_out, correct_colour=False)
        if frozenset(search.chosen) in search.visited:  # a term that left has come back
            break
        search.visited.add(frozenset(search.chosen))
        free = _enter(search, names, X, y, f_in)
    if correct_colour:
        search.prune(f_out, correct_colour=True)
    if search.result is None:
        raise EstimationError(
            f"none of the {len(names)} candidates explains '{target}' at a partial F of {f_in:g}; "
            "lower f_in, offer other candidates or excite more"
        )
    return _with_collinear(search.result, names, X, y)


class _Steps:
    """Terms chosen so far, and their regression."""

    def __init__(self, records: list[RegressionData], target: str) -> None:
        self.records, self.target = records, target
        self.chosen: list[str] = []
        self.visited: set[frozenset[str]] = set()
        self.result: RegressionResult | None = None

    def _fit(self) -> None:
        self.result = equation_error(self.records, self.target, self.chosen) if self.chosen else None

    def add(self, term: str) -> None:
        """Let one term in."""
        self.chosen.append(term)
        self._fit()

    def prune(self, f_out: float, *, correct_colour: bool) -> None:
        """Let terms out, the weakest first, until all have a partial F of ``f_out``."""
        while self.result is not None:
            F = _partial_f(self.result, correct_colour)
            weakest = min(self.chosen, key=lambda term: F[term])
            if F[weakest] >= f_out:
                return
            self.chosen.remove(weakest)
            self._fit()


def _enter(search: _Steps, names: Sequence[str], X: FloatArray, y: FloatArray, f_in: float) -> str | None:
    """Return the candidate with the largest partial F if that is at least ``f_in``.

    With the parts orthogonal to the chosen terms, F = (N - n) g / (v'v - g), g = (x'v)^2 / x'x what it takes from v'v.
    """
    rest, outside, free = _residuals(X, y, [names.index(c) for c in search.chosen])
    left = [i for i in range(len(names)) if names[i] not in search.chosen and free[i]]
    energy = float(rest @ rest)
    parameters = len(search.chosen) + 2
    if not left or energy <= _DONE * float((y - y.mean()) @ (y - y.mean())) or len(y) < 2 * parameters:
        return None
    gain = np.sum(outside[:, left] * rest[:, None], axis=0) ** 2 / np.sum(outside[:, left] ** 2, axis=0)
    best = int(np.argmax(gain))
    enough = (len(y) - parameters) * float(gain[best]) >= f_in * (energy - float(gain[best]))
    return names[left[best]] if enough else None


def _prepare(
    data: RegressionData | Sequence[RegressionData], target: str, candidates: Sequence[str]
) -> tuple[list[RegressionData], tuple[str, ...], FloatArray, FloatArray]:
    records = as_records(data)
    names = check_terms([term for term in candidates if term != BIAS])
    X, y = stack([block(record, target, names) for record in records])
    require_samples(len(y), ("one", BIAS), target)
    if not np.ptp(y) > 0.0:
        raise EstimationError(f"target '{target}' never moves in these records: there is nothing to explain")
    return records, names, X, y


def _residuals(X: FloatArray, y: FloatArray, chosen: Sequence[int]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the target and all candidates less their parts in the chosen terms, and which candidates are free."""
    basis = np.linalg.qr(
        np.column_stack([np.ones(len(y)), X[:, list(chosen)] / np.linalg.norm(X[:, list(chosen)], axis=0)])
    )[0]
    centred = np.linalg.norm(X - X.mean(axis=0), axis=0)
    outside = X - basis @ (basis.T @ X)
    outside = outside - basis @ (basis.T @ outside)
    rest = y - basis @ (basis.T @ y)
    return rest, outside, np.linalg.norm(outside, axis=0) > _SPAN * centred


def _partial_f(result: RegressionResult, correct_colour: bool) -> dict[str, float]:
    std = result.std_corrected if correct_colour else result.std_plain
    out = np.full(len(std), np.inf)
    np.divide(result.params, std, out=out, where=std > 0.0)
    return dict(zip(result.terms, (out**2).tolist(), strict=True))


def _with_collinear(result: RegressionResult, names: Sequence[str], X: FloatArray, y: FloatArray) -> RegressionResult:
    """Return the result, in doubt where candidates stand for chosen terms as well."""
    chosen = [names.index(term) for term in result.terms if term != BIAS]
    _, _, free = _residuals(X, y, chosen)
    collinear = [name for i, name in enumerate(names) if i not in chosen and not free[i]]
    if not collinear:
        return result
    said = f"{', '.join(collinear)}: the data cannot tell them from the chosen terms"
    return replace(result, advice=(*result.advice, doubt("collinear_terms", said)))
