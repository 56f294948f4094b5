"""Choosing the terms of a regression: multivariate orthogonal functions, and evidence for how many of them stay.

E. A. Morelli, "Global Nonlinear Aerodynamic Modeling Using Multivariate Orthogonal Functions", Journal of Aircraft
32(2), 1995; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from testbench.core.advice import doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.regression.data import BIAS, RegressionData, check_terms
from testbench.estimators.regression.equation_error import as_records, block, equation_error, require_samples
from testbench.estimators.regression.result import RegressionResult
from testbench.estimators.residuals import autoregression

_SPAN = 1e-6  # a candidate with less than this share of its length outside the chosen terms is one of them
_DONE = 1e-24  # share of the target's energy that is rounding
_MOST = 60  # terms


@dataclass(frozen=True, eq=False, kw_only=True)
class StructureSearch:
    """Terms that were chosen among candidates.

    Attributes:
        result: regression on the chosen terms and a constant. Its errors hold as if the terms had been given; they do
            not count that the terms were chosen on the same data.
        candidates: terms that could be chosen.
        collinear: candidates that are linear combinations of chosen ones.
    """

    result: RegressionResult
    candidates: tuple[str, ...]
    collinear: tuple[str, ...] = ()


def orthogonal_functions(
    data: RegressionData | Sequence[RegressionData], target: str, candidates: Sequence[str]
) -> StructureSearch:
    """Choose the terms of a regression by orthogonal functions and evidence, see :func:`choose`.

    Args:
        data: signals of one or several records.
        target: signal to explain.
        candidates: terms, e.g. from ``polynomial_terms``; a constant is always in.

    Raises:
        EstimationError: no candidate has the evidence of the data, or against ``equation_error``.
        ChannelError: a signal is not there.
    """
    records = as_records(data)
    names = check_terms([term for term in candidates if term != BIAS])
    blocks = [block(record, target, names) for record in records]
    parts = [(np.ones((int(b.used.sum()), 1)), b.X[b.used], b.y[b.used]) for b in blocks]
    y = np.concatenate([p[2] for p in parts])
    require_samples(len(y), ("one", BIAS), target)
    if not np.ptp(y) > 0.0:
        raise EstimationError(f"target '{target}' never moves in these records: there is nothing to explain")
    chosen = choose(parts)
    if not chosen:
        raise EstimationError(
            f"none of the {len(names)} candidates has the evidence of the data for '{target}'; offer other candidates "
            "or excite more"
        )
    result = equation_error(records, target, [names[i] for i in chosen])
    X = np.vstack([p[1] for p in parts])
    basis = np.linalg.qr(np.column_stack([np.ones(len(y)), X[:, chosen] / np.linalg.norm(X[:, chosen], axis=0)]))[0]
    outside = X - basis @ (basis.T @ X)
    free = np.linalg.norm(outside, axis=0) > _SPAN * np.linalg.norm(X - X.mean(axis=0), axis=0)
    collinear = tuple(name for i, name in enumerate(names) if i not in chosen and not free[i])
    if collinear:
        are = "are linear combinations" if collinear[1:] else "is a linear combination"
        said = (
            f"in these data {', '.join(collinear)} {are} of the chosen terms {', '.join(result.terms)}, and the data "
            "cannot tell them apart; excite them separately"
        )
        result = replace(result, advice=(*result.advice, doubt("collinear_terms", said)))
    worth = approximate("quiet structure search", "standard errors do not count that terms were chosen, and the")
    return StructureSearch(result=replace(result, advice=result.advice + worth), candidates=names, collinear=collinear)


def orthogonal_order(X: FloatArray, y: FloatArray, most: int = _MOST) -> tuple[list[int], list[float]]:
    """Return candidates (columns of X) in the order in which they lower the fit error, and that error after each.

    Every candidate is orthogonalised by modified Gram-Schmidt to the functions p_j that are already chosen; the one
    that takes most from the fit error, (p_j'y)^2 / p_j'p_j, is next. Each function is one candidate less its part along
    those before, so that n functions span n candidates. (Morelli orthogonalises in a fixed order and ranks afterwards,
    so that a kept function may bring in other candidates.)

    Args:
        X: (n, m) candidates, less their parts along what is always there.
        y: (n,) target, likewise.
        most: steps at most.

    Returns:
        Columns, and v'v before the first and after each of them.
    """
    length = np.linalg.norm(X, axis=0)
    P = X / np.where(length > 0.0, length, 1.0)
    rest, closed = y.copy(), length <= 0.0
    order: list[int] = []
    Q = np.empty((len(y), 0))
    errors = [float(rest @ rest)]
    while len(order) < min(X.shape[1], most, len(y) // 2 - 1) and errors[-1] > _DONE * errors[0]:
        size = np.linalg.norm(P, axis=0)
        open_ = (size > _SPAN) & ~closed
        if not open_.any():
            break
        best = int(np.argmax(np.where(open_, (P.T @ rest) ** 2 / np.where(open_, size**2, 1.0), -1.0)))
        p = P[:, best] - Q @ (Q.T @ P[:, best])  # twice is enough for orthogonality to rounding
        p /= np.linalg.norm(p)
        rest = rest - p * float(p @ rest)
        P = P - np.outer(p, p @ P)
        Q = np.column_stack([Q, p])
        order.append(best)
        closed[best] = True
        errors.append(float(rest @ rest))
    return order, errors


def choose(parts: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> list[int]:
    """Return which candidates stay, by evidence.

    With n of m candidates, v'v the fit error and N_e independent samples of the residuals, -2 log of the posterior
    probability of a set of terms is, by Laplace's approximation and with all numbers of terms equally probable before,

        N_e log v'v + n log N_e + 2 log (m over n)

    (G. Schwarz, Annals of Statistics 6, 1978; J. Chen and Z. Chen, Biometrika 95, 2008). The last term pays for the
    choice among many candidates, of which the best one looks good by chance. N_e = N / (S(0) / var v), S the spectrum
    of the residuals where all are taken: residuals at a high sample rate hang together, and N of them say less. The
    predicted squared error counts neither and needs a bound that somebody has to give.

    The best number of orthogonal functions is taken; then terms leave whose loss raises the evidence, the weakest
    first.

    Args:
        parts: of each record, what is always there (n_r, f), candidates (n_r, m) and target (n_r,).
    """
    F, X, y = (np.concatenate(x) for x in zip(*parts, strict=True))
    basis = np.linalg.qr(F / np.linalg.norm(F, axis=0))[0]
    length = np.linalg.norm(X, axis=0)
    for _ in range(2):
        X, y = X - basis @ (basis.T @ X), y - basis @ (basis.T @ y)
    X = np.where(np.linalg.norm(X, axis=0) > _SPAN * length, X, 0.0)
    N, m = X.shape
    order, errors = orthogonal_order(X, y)
    least = max(_DONE * errors[0], 1e-300)
    v = y - X[:, order] @ np.linalg.lstsq(X[:, order], y, rcond=None)[0]
    ends = np.cumsum([len(p[2]) for p in parts])[:-1]
    independent = _independent(np.split(v, ends)) if errors[-1] > least else float(N)

    def score(error: float, n: int) -> float:
        among = gammaln(m + 1) - gammaln(n + 1) - gammaln(m - n + 1)
        return float(independent * np.log(max(error, least)) + n * np.log(independent) + 2.0 * among)

    best = int(np.argmin([score(e, n) for n, e in enumerate(errors)]))
    chosen, now = order[:best], score(errors[best], best)
    while chosen:
        theta, inverse, error = least_squares(X[:, chosen], y)
        loss = theta**2 / np.diag(inverse)
        weakest = int(np.argmin(loss))
        without = score(error + float(loss[weakest]), len(chosen) - 1)
        if without > now:
            break
        chosen, now = chosen[:weakest] + chosen[weakest + 1 :], without
    return sorted(chosen)


def least_squares(X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the parameters (k,), (X'X)^-1 (k, k), and v'v."""
    size = np.linalg.norm(X, axis=0)
    U, s, Vt = np.linalg.svd(X / size, full_matrices=False)
    theta = Vt.T @ ((U.T @ y) / s)
    v = y - (X / size) @ theta
    theta = theta + Vt.T @ ((U.T @ v) / s)  # one step of refinement
    v = y - (X / size) @ theta
    return theta / size, (Vt.T / s**2) @ Vt / np.outer(size, size), float(v @ v)


def _independent(residuals: Sequence[FloatArray]) -> float:
    """Return the number of independent samples of residuals, N var v / S(0)."""
    model = autoregression([v[:, None] for v in residuals])
    gain = float(1.0 / max(1.0 - model.A.sum(), 1e-3))
    together = np.concatenate(residuals)
    return together.size / max(1.0, gain**2 * float(model.S[0, 0]) / float(np.mean(together**2)))
