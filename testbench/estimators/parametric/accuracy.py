"""The accuracy of estimates: information, correction for coloured residuals, and undecided unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.parametric.advice import null_directions
from testbench.estimators.parametric.sensitivities import Sensitivities, believed_alone, in_blocks, square_root
from testbench.estimators.residuals import Colour, corrected_covariance, ljung_box
from testbench.estimators.shortfall import shortfall

WHITENESS_LAGS = 20
_ROUNDING = 1e-9  # residuals below this share of an output's size say nothing about noise


class Accuracy(NamedTuple):
    """Covariances (k, k) for residuals taken as white and corrected for their colour; condition of the scaled J."""

    plain: FloatArray
    corrected: FloatArray
    condition: float


def accuracy(
    residuals: Sequence[FloatArray],
    sensitivities: Callable[[], Iterable[Sensitivities]],
    R: FloatArray,
    prior_weight: FloatArray,
    moving: NDArray[np.bool_],
    names: Sequence[str],
    alone: NDArray[np.bool_] | None = None,
) -> Accuracy:
    """Return the covariances of unknowns whose residuals have covariance R.

    Args:
        residuals: per record (N, p); zero where not valid.
        sensitivities: called two or three times; gives those of each record, zero where not valid.
        R: (p, p) covariance of the residuals.
        prior_weight: (k,) one over the standard deviation of the prior, 0 without one.
        moving: (k,) False for unknowns on a bound, which get zero variance.
        names: (k,) names of the unknowns.
        alone: (k,) unknowns that only one record feels; none if not given.

    Raises:
        EstimationError: no output feels an unknown or a combination of them; they are named.
    """
    k = moving.size
    alone = np.zeros(k, bool) if alone is None else alone
    whiten = np.linalg.inv(np.linalg.cholesky(R))
    believed = np.flatnonzero((prior_weight > 0.0) & ~alone)

    def parts() -> Iterator[tuple[Iterable[FloatArray], NDArray[np.intp]]]:
        for v, s in zip(residuals, sensitivities(), strict=True):
            rows = chain(in_blocks(v, s, whiten), believed_alone(s.columns, prior_weight, alone))
            yield rows, np.append(s.columns, k)
        yield [np.diag(np.append(prior_weight[believed], 0.0))], np.append(believed, k)

    J = square_root(parts(), np.append(alone, False))[:, :-1][:, moving]
    size = np.sqrt(np.sum(J**2, axis=0))
    lost = null_directions(J, size, [name for name, m in zip(names, moving, strict=True) if m])
    if lost:
        raise EstimationError(
            f"these data do not tell {lost} apart, or do not show them: not identifiable; fix or leave out some of "
            "them, or fly an input that moves them"
        )
    scaled = np.linalg.qr(J / size, mode="r")
    inverse = np.linalg.inv(scaled) / size[:, None]
    plain = np.zeros((k, k))
    plain[np.ix_(moving, moving)] = inverse @ inverse.T
    corrected = coloured_covariance(residuals, sensitivities, R, plain, prior_weight)
    return Accuracy(plain, corrected, float(np.linalg.cond(scaled)))


def coloured_covariance(
    residuals: Sequence[FloatArray],
    sensitivities: Callable[[], Iterable[Sensitivities]],
    R: FloatArray,
    plain: FloatArray,
    prior_weight: FloatArray,
) -> FloatArray:
    """Return the covariance (k, k) of unknowns whose residuals are as coloured as these, weighed by their covariance R.

    Args:
        residuals: per record (N, p); zero where not valid.
        sensitivities: gives those of each record, zero where not valid.
        R: (p, p) covariance of the residuals.
        plain: (k, k) covariance of the unknowns if the residuals were white.
        prior_weight: (k,) one over the standard deviation of the prior, 0 without one.
    """
    colour, inverse, score = Colour.of(residuals), np.linalg.inv(R), np.zeros_like(plain)
    for s in sensitivities():
        score[np.ix_(s.columns, s.columns)] += colour.score(inverse @ s.values)
    wider = np.sqrt(shortfall(residuals, sensitivities, R, plain, colour))
    noise = corrected_covariance(plain, 0.5 * (score + score.T)) * np.outer(wider, wider)
    return np.asarray(noise + plain @ np.diag(prior_weight**2) @ plain)


def correlations(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix; rows of zero variance are zero."""
    std = np.sqrt(np.diag(covariance))
    inverse = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0.0)
    return np.asarray(covariance * np.outer(inverse, inverse))


def whiteness(
    residuals: Sequence[FloatArray], valid: Sequence[NDArray[np.bool_]], size: FloatArray, R: FloatArray
) -> FloatArray:
    """Return per output the probability that white residuals are as correlated as the worst record's; 1 for rounding.

    Args:
        residuals: per record (N, p).
        valid: per record (N, p), which of them count.
        size: (p,) standard deviation of the outputs.
        R: (p, p) covariance of the residuals.
    """
    out = np.ones(size.size)
    for o in np.flatnonzero(np.sqrt(np.diag(R)) > _ROUNDING * size):
        tests = []
        for v, good in zip(residuals, valid, strict=True):
            counting = v[good[:, o], o]
            if counting.size >= 8:
                tests.append(ljung_box(counting, min(WHITENESS_LAGS, counting.size // 4)))
        out[o] = min(1.0, min(tests, default=1.0) * len(tests))  # Bonferroni: the worst of several records
    return out
