"""Equation error in the frequency domain: complex least squares on finite Fourier transforms over a band.

V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 7; E. A. Morelli, "Real-Time Parameter
Estimation in the Frequency Domain", Journal of Guidance, Control, and Dynamics 23(5), 2000.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testbench.core.advice import Advice, doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.regression.data import BIAS, RegressionData, check_terms
from testbench.estimators.regression.equation_error import (
    advise,
    as_records,
    block,
    diagnose,
    noisy_terms,
    refuse_deficient,
)
from testbench.estimators.regression.result import RegressionResult

_INTERPOLATED = 0.05  # share of samples that were not taken, worth mentioning
_UNEVEN = 3.0  # standard deviations of chance
_CHUNK = 2_000_000


class ComplexFit(NamedTuple):
    """Complex least squares of one set of transforms."""

    theta: FloatArray
    covariance: FloatArray
    std_plain: FloatArray
    r2: float
    rms: float


def frequency_equation_error(
    data: RegressionData | Sequence[RegressionData],
    target: str,
    terms: Sequence[str],
    *,
    band_hz: tuple[float, float],
    step_hz: float | None = None,
) -> RegressionResult:
    """Fit the transform of the target by those of the terms, over a band of frequencies and all records.

    theta = Re(X+ X)^-1 Re(X+ Y), X+ the conjugate transpose, X and Y finite Fourier transforms
    sum_i x(i) exp(-j w t(i)) dt after a straight line was removed from target and terms alike. The band keeps out
    drift, bias and noise beyond the manoeuvre; noise need only be level within it. The covariance is
    s^2 Re(X+ X)^-1, s^2 = v+ v / (2 M - k) the variance of one real or imaginary part, M the lines. Lines closer than
    1 / duration hold no new information: ``covariance`` and ``std_corrected`` count lines as far as they are
    independent, ``std_plain`` counts all.

    Samples that were not taken are interpolated; the advice says how many.

    Args:
        data: signals of one or several records (see ``regression_data``).
        target: signal to explain.
        terms: signals and products of their powers; no constant.
        band_hz: lowest and highest frequency, 0 < low < high <= Nyquist frequency.
        step_hz: distance of the lines; 1 / duration of each record if not given.

    Raises:
        EstimationError: no record, a band against the law above, terms against those of ``equation_error``, or too
            few lines.
        ChannelError: a signal is not there.
    """
    records = as_records(data)
    names = check_terms([term for term in terms if term != BIAS])
    dt = records[0].dt_s
    low, high = check_band(band_hz, dt)
    rows, goals, weights = [], [], []
    for record in records:
        step = 1.0 / (len(record) * dt) if step_hz is None else step_hz
        lines = band_lines(low, high, step)
        block(record, target, names)  # the target must not be among the terms
        columns = detrend(np.column_stack([record.matrix(names), record[target]]), record.t_s)
        F = transform(columns, record.t_s, lines, dt)
        rows.append(F[:, :-1])
        goals.append(F[:, -1])
        weights.append(np.full(lines.size, min(1.0, step * len(record) * dt)))
    X, Y, weight = np.vstack(rows), np.concatenate(goals), np.concatenate(weights)
    parts = np.vstack([X.real, X.imag])
    if 2.0 * weight.sum() < 2 * len(names):
        raise EstimationError(
            f"{low:g} to {high:g} Hz holds {weight.sum():.0f} independent lines of these records, too few for "
            f"{len(names)} parameters (as many are needed); widen the band or give more data"
        )
    refuse_deficient(parts, names, np.zeros(len(names)))
    fit = complex_fit(X, Y, weight)
    found = diagnose(parts, names)
    std = np.sqrt(np.diag(fit.covariance))
    # noise over the whole Nyquist band is no measure of that within this band
    advice = advise([], target, names, fit.theta, std, fit.r2, found)
    taken = float(np.mean(np.concatenate([record.sampled([target, *names]) for record in records])))
    if taken < 1.0 - _INTERPOLATED:
        said = (
            f"{target}: {100 * (1 - taken):.0f} % of the samples were not taken but interpolated, which lowers "
            "amplitudes near the sensors' rates; keep the band well below these rates"
        )
        advice += (doubt("interpolated", said),)
    advice += noisy_terms(records, names)
    advice += _uneven(target, [np.abs(y - x @ fit.theta) ** 2 for x, y in zip(rows, goals, strict=True)], weights)
    return RegressionResult(
        target=target,
        terms=names,
        params=fit.theta,
        covariance=fit.covariance,
        std_plain=fit.std_plain,
        std_corrected=std,
        r2=fit.r2,
        residual_rms=fit.rms,
        autocorrelation=np.zeros(0),
        vif=found.vif,
        correlation=found.correlation,
        condition=found.condition,
        samples=2 * len(Y),
        dt_s=dt,
        domain="frequency",
        band_hz=(low, high),
        recipe=records[0].recipe,
        settings={"step_hz": step_hz, "records": len(records)},
        advice=advice,
    )


def _uneven(target: str, power: Sequence[FloatArray], weights: Sequence[FloatArray]) -> tuple[Advice, ...]:
    """Return advice if the residuals' power differs between the halves of the band by more than chance allows.

    The logarithm of the ratio of two such powers has the variance 1 / m1 + 1 / m2, m the independent lines.
    """
    low = np.concatenate([p[: p.size // 2] for p in power])
    high = np.concatenate([p[p.size // 2 :] for p in power])
    lines = [sum(float(w[: w.size // 2].sum()) for w in weights), sum(float(w[w.size // 2 :].sum()) for w in weights)]
    if min(lines) < 2.0 or not low.mean() > 0.0 or not high.mean() > 0.0:
        return ()
    ratio = float(np.log(low.mean() / high.mean()))
    if abs(ratio) <= _UNEVEN * float(np.sqrt(1.0 / lines[0] + 1.0 / lines[1])):
        return ()
    where = "lower" if ratio > 0.0 else "upper"
    said = (
        f"{target}: residuals are {np.exp(abs(ratio)):.0f} times stronger in the {where} half of the band, where "
        "errors are larger than stated; narrow the band, or look for terms that are missing"
    )
    return (doubt("coloured_residuals", said),)


def check_band(band_hz: tuple[float, float], dt_s: float) -> tuple[float, float]:
    """Return the band as two numbers after checking that 0 < low < high <= Nyquist frequency.

    Raises:
        EstimationError: it is not.
    """
    low, high = float(band_hz[0]), float(band_hz[1])
    nyquist = 0.5 / dt_s
    if not 0.0 < low < high <= nyquist * (1.0 + 1e-9):
        raise EstimationError(
            f"0 < low < high <= Nyquist frequency = {nyquist:g} Hz must hold, got {low:g} and {high:g}"
        )
    return low, high


def band_lines(low_hz: float, high_hz: float, step_hz: float) -> FloatArray:
    """Return the multiples of ``step_hz`` within the band, Hz.

    Raises:
        EstimationError: the step is not positive, or no multiple of it lies in the band.
    """
    if not 0.0 < step_hz < np.inf:
        raise EstimationError(f"step_hz must be positive, got {step_hz}")
    lines = step_hz * np.arange(np.ceil(low_hz / step_hz - 1e-9), np.floor(high_hz / step_hz + 1e-9) + 1)
    if not lines.size:
        raise EstimationError(
            f"{low_hz:g} to {high_hz:g} Hz holds no multiple of {step_hz:g} Hz; widen the band or give a longer record"
        )
    return np.asarray(lines)


def detrend(columns: FloatArray, t_s: FloatArray) -> FloatArray:
    """Return the columns (n, k) less straight lines fitted by least squares."""
    line = np.column_stack([np.ones(t_s.size), (t_s - t_s.mean()) / max(float(np.ptp(t_s)), 1e-300)])
    return np.asarray(columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0])


def transform(columns: FloatArray, t_s: FloatArray, lines_hz: FloatArray, dt_s: float) -> ComplexArray:
    """Return the finite Fourier transforms (lines, k) of the columns (n, k), time counted from the first sample."""
    out = np.zeros((lines_hz.size, columns.shape[1]), np.complex128)
    size = max(1, _CHUNK // max(lines_hz.size, 1))
    for start in range(0, t_s.size, size):
        rows = slice(start, start + size)
        out += np.exp(-2j * np.pi * np.outer(lines_hz, t_s[rows] - t_s[0])) @ columns[rows]
    return np.asarray(out * dt_s)


def complex_fit(X: ComplexArray, Y: ComplexArray, weight: FloatArray) -> ComplexFit:
    """Return complex least squares; ``weight`` (lines,) is how many independent lines each line stands for."""
    k = X.shape[1]
    root = np.sqrt(weight)
    A = np.vstack([X.real, X.imag]) * np.tile(root, 2)[:, None]
    b = np.concatenate([Y.real, Y.imag]) * np.tile(root, 2)
    size = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / size)
    inverse = np.linalg.inv(R)
    theta = inverse @ (Q.T @ b)
    v = b - (A / size) @ theta
    rest, energy = float(v @ v), float(b @ b)
    independent = 2.0 * float(weight.sum())
    covariance = rest / max(independent - k, 1.0) * (inverse @ inverse.T) / np.outer(size, size)
    white = np.linalg.inv(R.T @ R) * rest / max(len(b) - k, 1) / np.outer(size, size)
    rms = float(np.sqrt(rest / weight.sum()))
    return ComplexFit(theta / size, covariance, np.sqrt(np.diag(white)), 1.0 - rest / energy if energy else 0.0, rms)
