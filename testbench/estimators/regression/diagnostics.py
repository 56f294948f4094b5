"""Whether the data can decide the terms of a regression: excitation, collinearity, and noise in the terms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testbench.core.advice import Advice, doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.regression.data import BIAS, RegressionData, factors
from testbench.estimators.regression.smoothing import noise_level

_STILL = 1e-12  # a term that moves less than this share of its size does not move
_DEFICIENT = 1e-9  # singular values below this share of the largest are zero: rounding of centred terms
_VIF = 10.0  # customary limit (Montgomery, Peck, Vining, Introduction to Linear Regression Analysis)
_SHARE = 0.1  # entries of a null vector below this are not part of the dependence
_ATTENUATION = 0.02  # bias from noise in a term worth mentioning
_NOISY = 0.01  # noise over motion of a term that biases a regression over a band by more than its errors
_T = 2.0
_LEAST = 16
_R2 = 0.5


class Diagnostics(NamedTuple):
    """Collinearity of the terms."""

    vif: FloatArray  # (k,)
    correlation: FloatArray  # (k', k') without the constant
    condition: float


def _centred(X: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the terms without the constant, centred if there is one, scaled to unit length."""
    keep = [i for i, name in enumerate(names) if name != BIAS]
    Z = X[:, keep]
    if len(keep) < len(names):
        Z = Z - Z.mean(axis=0)
    size = np.linalg.norm(Z, axis=0)
    return np.asarray(Z / np.where(size > 0.0, size, 1.0))


def diagnose(X: FloatArray, names: Sequence[str]) -> Diagnostics:
    """Return variance inflation factors, correlations and the condition number of the terms."""
    Z = _centred(X, names)
    vif = np.ones(len(names))
    keep = [i for i, name in enumerate(names) if name != BIAS]
    if not keep:
        return Diagnostics(vif, np.zeros((0, 0)), 1.0)
    _, s, Vt = np.linalg.svd(Z, full_matrices=False)
    floor = max(float(s[0]) * np.finfo(float).eps, np.finfo(float).tiny)
    s = np.maximum(s, floor)  # finite where only a prior decides
    vif[keep] = np.sum((Vt.T / s) ** 2, axis=1)
    return Diagnostics(vif, Z.T @ Z, float(s[0] / s[-1]))


def refuse_deficient(X: FloatArray, names: Sequence[str], weight: FloatArray) -> None:
    """Check that data and prior decide every term; ``weight`` (k,) is positive where there is a prior.

    Raises:
        EstimationError: names the terms that do not move, or that are linear combinations of each other.
    """
    free = [i for i in range(len(names)) if weight[i] == 0.0]
    with_bias = BIAS in names
    for i in free:
        column = X[:, i]
        moved = float(np.ptp(column)) if with_bias else float(np.max(np.abs(column)))
        if names[i] != BIAS and moved <= _STILL * float(np.max(np.abs(column))):
            what = "never moves in these records" if with_bias else "is zero throughout these records"
            raise EstimationError(
                f"term '{names[i]}' {what}: its effect is not identifiable; excite it, leave it out, or give a prior"
            )
    chosen = [names[i] for i in free]
    Z = _centred(X[:, free], chosen)
    if Z.shape[1] < 2:
        return
    _, s, Vt = np.linalg.svd(Z, full_matrices=False)
    if s[-1] > _DEFICIENT * s[0]:
        return
    null = Vt[s <= _DEFICIENT * s[0]]
    moving = [name for name in chosen if name != BIAS]
    tied = [name for name, share in zip(moving, np.max(np.abs(null), axis=0), strict=True) if share > _SHARE]
    raise EstimationError(
        f"terms must be linearly independent, but {', '.join(tied)} depend on each other "
        f"(condition number {s[0] / max(float(s[-1]), 1e-300):.1e}); leave one out, excite them separately, "
        "or give a prior"
    )


def advise(
    records: Sequence[RegressionData],
    target: str,
    names: Sequence[str],
    theta: FloatArray,
    std: FloatArray,
    r2: float,
    found: Diagnostics,
) -> tuple[Advice, ...]:
    """Return what is doubtful about a fit and what to do about it, in sentences."""
    out = []
    moving = [name for name in names if name != BIAS]
    for i, name in enumerate(names):
        if found.vif[i] > _VIF:
            row = np.abs(found.correlation[moving.index(name)]) - np.eye(len(moving))[moving.index(name)]
            partner = moving[int(np.argmax(row))]
            out.append(
                doubt(
                    "collinear_terms",
                    f"{name}: nearly a combination of the other terms (variance inflation {found.vif[i]:.0f}, most "
                    f"like {partner}, correlation {row.max():.3f}), so that its estimate depends on theirs; excite "
                    "them separately, fix one by a prior or leave one out",
                )
            )
    for i, name in enumerate(names):
        if name != BIAS and abs(theta[i]) < _T * std[i]:
            out.append(
                doubt(
                    "weakly_identifiable",
                    f"{name}: {theta[i]:.3g} is within two standard errors ({std[i]:.2g}) of zero: these data do not "
                    "decide it; excite it more or leave it out",
                )
            )
    biased = False
    for name, share in _attenuation(records, names, found).items():
        if share > _ATTENUATION:
            out.append(
                doubt(
                    "noisy_terms",
                    f"{name}: noise in the signal draws its estimate towards zero by about {100 * min(share, 1.0):.0f} "
                    "%; smooth the record first or regress in the frequency domain over the band of the manoeuvre",
                )
            )
            biased = True
    if biased:
        out.extend(approximate("regression", "standard errors do not count noise in the terms, and"))
    if r2 < _R2:
        out.append(
            doubt(
                "little_explained",
                f"{target}: the terms explain {100 * max(r2, 0.0):.0f} % of it; look for terms that are missing, "
                "or for more excitation",
            )
        )
    return tuple(out)


def noisy_terms(records: Sequence[RegressionData], names: Sequence[str]) -> tuple[Advice, ...]:
    """Return, for a regression over a band, how far its errors can be believed if a term holds much noise."""
    for name in names:
        if len(factors(name)) != 1 or factors(name)[0][1] != 1:
            continue
        for record in records:
            y = record[name][record.sampled([name])]
            if y.size >= _LEAST and noise_level(y) > _NOISY * float(np.std(y)):
                of = f"noise in {name} biases the estimates, standard errors do not count it, and the"
                return tuple(doubt("noisy_terms", said) for said in approximate("regression", of))
    return ()


def _attenuation(records: Sequence[RegressionData], names: Sequence[str], found: Diagnostics) -> dict[str, float]:
    """Return the share by which white noise in plain signals biases their own estimates: VIF x noise / variance."""
    out = {}
    for i, name in enumerate(names):
        if name == BIAS or len(factors(name)) != 1 or factors(name)[0][1] != 1:
            continue
        noise, spread, count = 0.0, 0.0, 0
        for record in records:
            y = record[name][record.sampled([name])]
            if y.size >= _LEAST:
                noise += y.size * noise_level(y) ** 2
                spread += y.size * float(np.var(y))
                count += y.size
        if count and spread > 0.0:
            out[name] = float(found.vif[i]) * noise / spread
    return out
