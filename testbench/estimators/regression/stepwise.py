"""Choosing the terms of a regression: stepwise regression, and multivariate orthogonal functions.

V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 5; E. A. Morelli, "Global Nonlinear Aerodynamic
Modeling Using Multivariate Orthogonal Functions", Journal of Aircraft 32(2), 1995; A. R. Barron, "Predicted Squared
Error: A Criterion for Automatic Model Selection", 1984.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.advice import doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.coverage import approximate
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


@dataclass(frozen=True, eq=False, kw_only=True)
class StructureSearch:
    """Terms that were chosen among candidates.

    Attributes:
        result: regression on the chosen terms and a constant. Its errors hold as if the terms had been given; they do
            not count that the terms were chosen on the same data.
        candidates: terms that could be chosen.
        entered: terms in the order in which they entered; those that left again are preceded by "-".
        r2: (steps + 1,) coefficient of determination after each step, from none on.
        pse: (steps + 1,) predicted squared error after each step, units of the target squared.
        collinear: candidates that were linear combinations of chosen ones, and so could not be chosen.
    """

    result: RegressionResult
    candidates: tuple[str, ...]
    entered: tuple[str, ...]
    r2: FloatArray
    pse: FloatArray
    collinear: tuple[str, ...] = ()


def stepwise(
    data: RegressionData | Sequence[RegressionData],
    target: str,
    candidates: Sequence[str],
    *,
    f_in: float = _F,
    f_out: float = _F,
    correct_colour: bool = True,
) -> StructureSearch:
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
    search = _Steps(records, target, y)
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
    return _search(search.result, names, search.entered, search.trail, X, y)


class _Steps:
    """Terms chosen so far, their regression and the trail of how they came and went."""

    def __init__(self, records: list[RegressionData], target: str, y: FloatArray) -> None:
        self.records, self.target = records, target
        self.samples, self.bound = len(y), _noise_bound(y, None)
        self.chosen: list[str] = []
        self.entered: list[str] = []
        self.visited: set[frozenset[str]] = set()
        self.result: RegressionResult | None = None
        self.trail = [(0.0, _pse(y, 0, self.bound))]

    def _fit(self) -> None:
        self.result = equation_error(self.records, self.target, self.chosen) if self.chosen else None
        if self.result is not None:
            pse = self.result.residual_rms**2 + self.bound * (len(self.chosen) + 1) / self.samples
            self.trail.append((self.result.r2, pse))

    def add(self, term: str) -> None:
        """Let one term in."""
        self.chosen.append(term)
        self.entered.append(term)
        self._fit()

    def prune(self, f_out: float, *, correct_colour: bool) -> None:
        """Let terms out, the weakest first, until all have a partial F of ``f_out``."""
        while self.result is not None:
            F = _partial_f(self.result, correct_colour)
            weakest = min(self.chosen, key=lambda term: F[term])
            if F[weakest] >= f_out:
                return
            self.chosen.remove(weakest)
            self.entered.append("-" + weakest)
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


def orthogonal_functions(
    data: RegressionData | Sequence[RegressionData],
    target: str,
    candidates: Sequence[str],
    *,
    noise_bound: float | None = None,
) -> StructureSearch:
    """Choose terms by orthogonal functions made from the data, in the order in which they lower the fit error.

    Every candidate is orthogonalised by modified Gram-Schmidt to the constant and to the functions p_j that are already
    chosen; the one that takes most from the fit error, (p_j'y)^2 / p_j'p_j, is next. The predicted squared error
    PSE = v'v / N + sigma_max^2 n / N falls with the first term and rises with the second; the n functions at its
    minimum stay. Since each function is one candidate less its part along those before, the n functions span n
    candidates, and the decomposition into them is exact. (Morelli orthogonalises in a fixed order and ranks
    afterwards, so that a kept function may bring in other candidates.)

    Args:
        data: signals of one or several records.
        target: signal to explain.
        candidates: terms, e.g. from ``polynomial_terms``; a constant is always in.
        noise_bound: sigma_max^2, upper bound on the variance of the residuals for data not used here, units of the
            target squared; the variance of the target if not given, which leaves out whatever takes less than 1 / N of
            it. About 25 times the variance of the noise is customary where that is known.

    Raises:
        EstimationError: noise_bound not positive, no candidate lowers the PSE, or against ``equation_error``.
        ChannelError: a signal is not there.
    """
    records, names, X, y = _prepare(data, target, candidates)
    bound = _noise_bound(y, noise_bound)
    n = len(y)
    length = np.linalg.norm(X - X.mean(axis=0), axis=0)
    P = (X - X.mean(axis=0)) / np.where(length > 0.0, length, 1.0)
    rest = y - y.mean()
    energy = float(rest @ rest)
    order: list[int] = []
    trail = [(0.0, _pse(y, 0, bound))]
    while len(order) < min(len(names), n // 2 - 1) and float(rest @ rest) > _DONE * energy:
        size = np.linalg.norm(P, axis=0)
        open_ = (size > _SPAN) & ~np.isin(np.arange(len(names)), order)
        if not open_.any():
            break
        drop = np.where(open_, (P.T @ rest) ** 2 / np.where(open_, size**2, 1.0), -1.0)
        best = int(np.argmax(drop))
        p = P[:, best] / size[best]
        rest = rest - p * float(p @ rest)
        P = P - np.outer(p, p @ P)
        P = P - np.outer(p, p @ P)  # twice is enough for orthogonality to rounding
        order.append(best)
        trail.append((1.0 - float(rest @ rest) / energy, float(rest @ rest) / n + bound * (len(order) + 1) / n))
    kept = int(np.argmin([pse for _, pse in trail]))
    if kept == 0:
        raise EstimationError(
            f"none of the {len(names)} candidates lowers the predicted squared error of '{target}'; "
            "lower noise_bound, offer other candidates or excite more"
        )
    chosen = [names[i] for i in order[:kept]]
    result = equation_error(records, target, chosen)
    return _search(result, names, [names[i] for i in order], trail, X, y)


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


def _noise_bound(y: FloatArray, given: float | None) -> float:
    if given is not None and not 0.0 < given < np.inf:
        raise EstimationError(f"noise_bound must be positive, got {given}")
    return float(np.var(y)) if given is None else given


def _pse(y: FloatArray, terms: int, bound: float) -> float:
    return float(np.var(y)) + bound * (terms + 1) / len(y)


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


def _search(
    result: RegressionResult,
    names: Sequence[str],
    entered: Sequence[str],
    trail: Sequence[tuple[float, float]],
    X: FloatArray,
    y: FloatArray,
) -> StructureSearch:
    """Return the search with its trail, and the candidates that the chosen terms stand for as well."""
    chosen = [names.index(term) for term in result.terms if term != BIAS]
    _, _, free = _residuals(X, y, chosen)
    collinear = tuple(name for i, name in enumerate(names) if i not in chosen and not free[i])
    if collinear:
        are = "are linear combinations" if collinear[1:] else "is a linear combination"
        said = (
            f"in these data {', '.join(collinear)} {are} of the chosen terms {', '.join(result.terms)}, and the data "
            "cannot tell them apart; excite them separately"
        )
        result = replace(result, advice=(*result.advice, doubt("collinear_terms", said)))
    worth = approximate("quiet structure search", "standard errors do not count that terms were chosen, and the")
    result = replace(result, advice=result.advice + worth)
    return StructureSearch(
        result=result,
        candidates=tuple(names),
        entered=tuple(entered),
        r2=np.array([r2 for r2, _ in trail]),
        pse=np.array([pse for _, pse in trail]),
        collinear=collinear,
    )
