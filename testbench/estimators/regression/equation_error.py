"""Equation error in the time domain: linear least squares with errors that count the colour of the residuals.

E. A. Morelli, V. Klein, "Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data", Journal of
Guidance, Control, and Dynamics 20(1), 1997; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.regression.data import BIAS, RegressionData, check_terms, factors
from testbench.estimators.regression.diagnostics import advise, diagnose, refuse_deficient
from testbench.estimators.regression.result import RegressionResult

_CONFLICT = 3.0  # standard deviations between prior and data worth mentioning


class Block(NamedTuple):
    """One record's part of a regression; rows that are not used are zero in X and y, so that lags stay lags."""

    X: FloatArray  # (n, k)
    y: FloatArray  # (n,)
    used: NDArray[np.bool_]  # (n,)


def equation_error(
    data: RegressionData | Sequence[RegressionData],
    target: str,
    terms: Sequence[str],
    *,
    bias: bool = True,
    prior: Mapping[str, tuple[float, float]] | None = None,
    finite_record: bool = True,
) -> RegressionResult:
    """Fit target = sum of parameter x term by ordinary least squares over all records.

    theta = (X'X)^-1 X'y, plain covariance s^2 (X'X)^-1 with s^2 = v'v / (N - k), v = y - X theta. The corrected
    covariance is (X'X)^-1 [sum_i x(i) sum_j R(i - j) x(j)'] (X'X)^-1, R(l) = sum_i v(i) v(i + l) / N the
    autocorrelation of the residuals at all lags within a record (Morelli and Klein 1997). It counts the colour of
    residuals from noise and from effects left out, not the bias of noisy terms (which the advice estimates). As printed
    it comes out low, because the fit takes the terms' share out of the residuals: by 6 to 14 % of the error in a record
    of 12 s with 0.3 Hz motion, and for the constant, which takes all of their mean, by half. ``finite_record`` makes
    up for that: exactly for white residuals, and for others as far as they are level over the frequencies of the terms.

    A sample is used if target and terms were all really sampled.

    Args:
        data: signals of one or several records (see ``regression_data``).
        target: signal to explain, e.g. "CZ" or "qdot".
        terms: signals and products of their powers, e.g. "alpha", "alpha^2", "alpha*q_hat".
        bias: add a constant, called "1".
        prior: term -> (value, standard deviation), known beforehand (mixed estimation: H. Theil, A. S. Goldberger,
            1961): theta = (X'X + s^2 c W)^-1 (X'y + s^2 c W theta_0), W the inverse of the prior's variances, s^2
            and the mean ratio c >= 1 of corrected to plain variance from the data alone. A prior may decide what the
            data cannot.
        finite_record: make up for the part that the fit takes out of the residuals; False for the formula as printed.

    Raises:
        EstimationError: no record, terms that repeat or cannot be read, too few samples, terms that do not move or that
            are linear combinations of each other (named), or a prior against the laws above.
        ChannelError: a signal is not there.
    """
    records = as_records(data)
    names = (*check_terms([t for t in terms if t != BIAS]), *((BIAS,) if bias else ()))
    weight, value = _prior(prior or {}, names)
    blocks = [block(record, target, names) for record in records]
    X, y = stack(blocks)
    require_samples(len(y), names, target)
    refuse_deficient(X, names, weight)
    theta, plain, covariance, conflict = _solve(blocks, X, y, weight, value, finite_record)
    v = y - X @ theta
    about = y - y.mean() if bias else y
    energy = float(about @ about)
    std_plain, std = np.sqrt(np.diag(plain)), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    diagnostics = diagnose(X, names)
    rms = float(np.sqrt(v @ v / len(y)))
    r2 = 1.0 - float(v @ v) / energy if energy > 0.0 else 0.0
    found = advise(records, target, names, theta, std, r2, diagnostics)
    found += tuple(
        doubt(
            "prior_conflict",
            f"{name}: data and prior differ by {far:.1f} standard deviations of their difference; check the units and "
            "sign of the prior, or look for effects that are missing",
        )
        for name, far in zip(names, conflict, strict=True)
        if far > _CONFLICT
    )
    lag_products = autocorrelation(blocks, theta)
    return RegressionResult(
        target=target,
        terms=names,
        params=theta,
        covariance=covariance,
        std_plain=std_plain,
        std_corrected=std,
        r2=r2,
        residual_rms=rms,
        autocorrelation=lag_products / lag_products[0] if lag_products[0] > 0.0 else np.eye(1, lag_products.size)[0],
        vif=diagnostics.vif,
        correlation=diagnostics.correlation,
        condition=diagnostics.condition,
        samples=len(y),
        dt_s=records[0].dt_s,
        recipe=records[0].recipe,
        settings={
            "bias": bias,
            "prior": {k: list(v) for k, v in (prior or {}).items()},
            "finite_record": finite_record,
            "records": len(records),
        },
        advice=found,
    )


def as_records(data: RegressionData | Sequence[RegressionData]) -> list[RegressionData]:
    """Return the records as a list after checking that there are some, of one sample time.

    Raises:
        EstimationError: no record, or different sample times.
    """
    records = [data] if isinstance(data, RegressionData) else list(data)
    if not records:
        raise EstimationError("a regression needs at least one record, got none")
    steps = [record.dt_s for record in records]
    if max(steps) - min(steps) > 0.01 * min(steps):
        raise EstimationError(
            f"records must share one sample time, got {min(steps):g} to {max(steps):g} s; resample them"
        )
    return records


def block(record: RegressionData, target: str, names: Sequence[str]) -> Block:
    """Return a record's rows, zero where something was not sampled.

    Raises:
        EstimationError: the target is among the terms.
        ChannelError: a signal is not there.
    """
    if any(name == target for term in names for name, _ in factors(term)):
        raise EstimationError(f"the target must not explain itself, got '{target}' among the terms; leave it out")
    used = record.sampled([target, *names])
    return Block(record.matrix(names) * used[:, None], record[target] * used, used)


def stack(blocks: Sequence[Block]) -> tuple[FloatArray, FloatArray]:
    """Return the rows that are used, of all records."""
    return np.vstack([b.X[b.used] for b in blocks]), np.concatenate([b.y[b.used] for b in blocks])


def require_samples(count: int, names: Sequence[str], target: str) -> None:
    """Check that there are at least twice as many samples as parameters.

    Raises:
        EstimationError: there are fewer.
    """
    if count < 2 * len(names):
        raise EstimationError(
            f"least squares of '{target}' needs at least twice as many samples as its {len(names)} parameters, "
            f"got {count} with all signals sampled; give more data or fewer terms"
        )


def _prior(prior: Mapping[str, tuple[float, float]], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return inverse variances (zero without prior) and values, (k,) each."""
    weight, value = np.zeros(len(names)), np.zeros(len(names))
    for term, (mean, std) in prior.items():
        if term not in names:
            raise EstimationError(f"a prior must be on a term, got one on '{term}'; the terms are {', '.join(names)}")
        if not (np.isfinite(mean) and 0.0 < std < np.inf):
            raise EstimationError(f"a prior is (value, standard deviation > 0), got {mean}, {std} for '{term}'")
        weight[names.index(term)], value[names.index(term)] = 1.0 / std**2, mean
    return weight, value


class _Solution(NamedTuple):
    theta: FloatArray
    plain: FloatArray  # (k, k)
    corrected: FloatArray  # (k, k)
    conflict: FloatArray  # (k,) distance of data and prior in standard deviations of their difference; 0 without prior


def _solve(
    blocks: Sequence[Block],
    X: FloatArray,
    y: FloatArray,
    weight: FloatArray,
    value: FloatArray,
    finite_record: bool,
) -> _Solution:
    """Return estimates and covariances; the residuals of the data alone, unique at any rank, tell noise and colour."""
    n, k = X.shape
    size = np.linalg.norm(X, axis=0)
    size[size == 0.0] = 1.0  # only a prior can hold such a term
    Z = X / size
    U, s, Vt = np.linalg.svd(Z, full_matrices=False)
    keep = s > np.finfo(float).eps * max(n, k) * s[0]
    inverse = Vt[keep].T / s[keep]
    theta = inverse @ (U[:, keep].T @ y)
    theta = theta + inverse @ (U[:, keep].T @ (y - Z @ theta))  # one step of refinement
    v = y - Z @ theta
    rank = int(keep.sum())
    s2 = float(v @ v) / (n - rank)
    S = coloured(blocks, theta / size, size)
    H = inverse @ inverse.T
    scale = np.outer(size, size)
    corrected = H @ S @ H
    if finite_record and rank == k:
        factor = _finite_record(blocks, size, inverse)
        corrected = corrected * np.sqrt(np.outer(factor, factor))
        S = (Z.T @ Z) @ corrected @ (Z.T @ Z)
    conflict = np.zeros(k)
    if weight.any():
        W, goal = weight / size**2, value * size
        if rank == k:
            apart = np.abs(theta - goal)[W > 0.0]
            conflict[W > 0.0] = apart / np.sqrt(np.diag(corrected)[W > 0.0] + 1.0 / W[W > 0.0])
        rho = max(float(np.trace(H @ S)) / rank, s2)
        A = Z.T @ Z
        H = np.linalg.inv(A + rho * np.diag(W))
        theta = H @ (Z.T @ y + rho * W * goal)
        corrected = H @ (S + rho**2 * np.diag(W)) @ H
    return _Solution(theta / size, s2 * H / scale, 0.5 * (corrected + corrected.T) / scale, conflict)


def coloured(blocks: Sequence[Block], theta: FloatArray, size: FloatArray) -> FloatArray:
    """Return sum_i sum_j x(i) R(i - j) x(j)' (k, k) over the records, x divided by ``size``.

    R is a convolution kernel, so the double sum is one over frequencies of transforms padded to twice the length.
    """
    R = autocorrelation(blocks, theta)
    length = _padded(blocks)
    kernel = np.zeros(length)
    kernel[: R.size] = R
    kernel[length - R.size + 1 :] = R[1:][::-1]
    power = np.fft.rfft(kernel).real * _both_sides(length)
    out = np.zeros((len(size), len(size)))
    for b in blocks:
        F = np.fft.rfft(b.X / size, length, axis=0)
        out += np.real(np.conj(F).T @ (F * power[:, None])) / length
    return out


def _finite_record(blocks: Sequence[Block], size: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return (k,) by how much the corrected variances come out low because k parameters were fitted.

    The fit takes the share p(f) = sum_j |U_j(f)|^2 / N out of the residuals' spectrum, U the orthonormal terms: for
    white noise E S_v(f) = S (1 - p(f)). The variance of a parameter is a mean of the spectrum with weights W(f), so
    that sum W / sum W (1 - p) makes it unbiased for noise that is level over what W covers.
    """
    length = _padded(blocks)
    total = sum(int(b.used.sum()) for b in blocks)
    sides = _both_sides(length)
    share = np.zeros(sides.size)
    W = np.zeros((sides.size, len(size)))
    for b in blocks:
        F = np.fft.rfft(b.X / size, length, axis=0) @ inverse
        share += np.sum(np.abs(F) ** 2, axis=1) / total
        W += np.abs(F @ inverse.T) ** 2 * sides[:, None]
    return np.asarray(np.sum(W, axis=0) / np.sum(W * (1.0 - share)[:, None], axis=0))


def _padded(blocks: Sequence[Block]) -> int:
    return 1 << (2 * max(len(b.y) for b in blocks) - 1).bit_length()


def _both_sides(length: int) -> FloatArray:
    """Return how often each line of a real transform counts in a sum over positive and negative frequencies."""
    out = np.full(length // 2 + 1, 2.0)
    out[[0, -1]] = 1.0
    return out


def autocorrelation(blocks: Sequence[Block], theta: FloatArray) -> FloatArray:
    """Return R(l) = sum of v(i) v(i + l) within records / N, (n,) of the longest record, N the samples used."""
    length = _padded(blocks)
    power = np.zeros(length // 2 + 1)
    for b in blocks:
        v = np.where(b.used, b.y - b.X @ theta, 0.0)
        power += np.abs(np.fft.rfft(v, length)) ** 2
    total = np.fft.irfft(power, length)[: max(len(b.y) for b in blocks)]
    return np.asarray(total / sum(int(b.used.sum()) for b in blocks))
