"""Recursive equation error: estimates and their errors over time, in the time and in the frequency domain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from testbench.core.advice import Advised, doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.model import ComplexArray
from testbench.estimators.regression.data import BIAS, RegressionData, check_terms
from testbench.estimators.regression.diagnostics import noisy_terms
from testbench.estimators.regression.equation_error import block, equation_error
from testbench.estimators.regression.frequency import band_lines, check_band, complex_fit

_DECIDED = 1e-10  # eigenvalue ratio of the scaled information below which the data do not decide the terms yet
_CHUNK = 4096


@dataclass(frozen=True, eq=False, kw_only=True)
class RecursiveResult(Advised):
    """Estimates over time, at those times at which the data up to then decide them.

    Attributes:
        target: signal that is explained.
        terms: (k,) names.
        t_s: (m,) times of the estimates, s.
        params: (m, k) estimates from the data up to each time.
        std: (m, k) their standard errors.
        std_plain: (m, k) the same as if residuals were white (time domain) or all lines independent (frequency domain).
        memory_s: time constant of the forgetting, -dt / ln(forgetting), s; infinite without.
        advice: what is doubtful; ``status`` follows from it.
    """

    target: str
    terms: tuple[str, ...]
    t_s: FloatArray
    params: FloatArray
    std: FloatArray
    std_plain: FloatArray
    memory_s: float
    advice: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("t_s", "params", "std", "std_plain"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.all(np.isfinite(array)):
                raise EstimationError(f"{name} must be finite, got NaN or infinity")
            array.setflags(write=False)
            object.__setattr__(self, name, array)


def recursive_least_squares(
    data: RegressionData, target: str, terms: Sequence[str], *, bias: bool = True, forgetting: float = 1.0
) -> RecursiveResult:
    """Fit target = sum of parameter x term to the data up to each sample, older samples weighing less.

    With weights w = forgetting^age: theta = A^-1 sum w x y, A = sum w x x', in information form, so that no initial
    covariance has to be guessed; plain covariance s^2 A^-1 A_2 A^-1, A_2 = sum w^2 x x',
    s^2 = sum w v^2 / (sum w - trace(A^-1 A_2)). Without forgetting the last estimate is that of ``equation_error``.
    ``std`` is the plain error times the ratio of corrected to plain error of the whole record (which a computation in
    flight does not know yet).

    Args:
        data: signals of one record.
        target: signal to explain.
        terms: signals and products of their powers.
        bias: add a constant, called "1".
        forgetting: weight of a sample against the next, 0 < forgetting <= 1.

    Raises:
        EstimationError: forgetting against the law above, a memory too short for the terms, or against
            ``equation_error``.
        ChannelError: a signal is not there.
    """
    memory = _memory(forgetting, data.dt_s)
    whole = equation_error(data, target, terms, bias=bias)
    ratio = np.divide(whole.std_corrected, whole.std_plain, out=np.ones(len(whole.terms)), where=whole.std_plain > 0.0)
    k = len(whole.terms)
    part = block(data, target, whole.terms)
    size = np.linalg.norm(part.X, axis=0)
    times, params, stds = [], [], []
    for rows, sums in _sums(np.column_stack([part.X / size, part.y]), part.used.astype(float), forgetting):
        A, c, A2 = sums.first[:, :k, :k], sums.first[:, :k, k], sums.second[:, :k, :k]
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", A), 1e-300))
        eigen = np.linalg.eigvalsh(A / (scale[:, :, None] * scale[:, None, :]))
        ready = (eigen[:, 0] > _DECIDED * eigen[:, -1]) & (sums.samples**2 >= 2 * k * sums.samples2)
        A, c, A2 = A[ready], c[ready], A2[ready]
        inverse = np.linalg.inv(A)
        theta = np.linalg.solve(A, c[:, :, None])[:, :, 0]
        lost = np.einsum("nij,nji->n", inverse, A2)
        rest = sums.first[ready, k, k] - np.einsum("ni,ni->n", c, theta)
        s2 = np.maximum(rest, 0.0) / np.maximum(sums.samples[ready] - lost, 1e-300)
        variance = np.einsum("nij,njk,nki->ni", inverse, A2, inverse) * s2[:, None]
        times.append(data.t_s[rows][ready])
        params.append(theta / size)
        stds.append(np.sqrt(np.maximum(variance, 0.0)) / size)
    t = np.concatenate(times)
    std = [s * ratio for s in stds]
    return _result(target, whole.terms, t, params, std, stds, memory, data.t_s, whole.advice)


class _Sums(NamedTuple):
    first: FloatArray  # (c, k + 1, k + 1) sum w z z', z the terms and the target
    second: FloatArray  # (c, k + 1, k + 1) sum w^2 z z'
    samples: FloatArray  # (c,) sum w
    samples2: FloatArray  # (c,) sum w^2


def _sums(z: FloatArray, used: FloatArray, forgetting: float) -> Iterator[tuple[slice, _Sums]]:
    """Yield, chunk by chunk, the weighted sums after each sample."""
    d = z.shape[1]
    carry = np.zeros(2 * d * d + 2)
    fade = np.concatenate([np.full(d * d, forgetting), np.full(d * d, forgetting**2), [forgetting, forgetting**2]])
    for start in range(0, len(z), _CHUNK):
        rows = slice(start, min(start + _CHUNK, len(z)))
        outer = np.einsum("ni,nj->nij", z[rows], z[rows]).reshape(-1, d * d)
        add = np.column_stack([outer, outer, used[rows], used[rows]])
        if forgetting == 1.0:
            total = carry + np.cumsum(add, axis=0)
        else:
            total = np.empty_like(add)
            for i, row in enumerate(add):
                carry = fade * carry + row
                total[i] = carry
        carry = total[-1]
        yield (
            rows,
            _Sums(
                total[:, : d * d].reshape(-1, d, d),
                total[:, d * d : 2 * d * d].reshape(-1, d, d),
                total[:, -2],
                total[:, -1],
            ),
        )


def recursive_frequency(
    data: RegressionData,
    target: str,
    terms: Sequence[str],
    *,
    band_hz: tuple[float, float],
    step_hz: float,
    update_s: float,
    forgetting: float = 1.0,
) -> RecursiveResult:
    """Fit the transforms of the data up to each update, recursively: F(t) = forgetting F(t - dt) + x(t) exp(-j w t).

    E. A. Morelli, "Real-Time Parameter Estimation in the Frequency Domain", Journal of Guidance, Control, and Dynamics
    23(5), 2000. A straight line through all data up to then is removed by running sums. Without forgetting, and if
    an update falls on the last sample, the last estimate is that of ``frequency_equation_error`` with the same lines.

    Args:
        data: signals of one record; samples that were not taken are interpolated.
        target: signal to explain.
        terms: signals and products of their powers; no constant.
        band_hz: lowest and highest frequency, 0 < low < high <= Nyquist frequency.
        step_hz: distance of the lines.
        update_s: time between estimates; counted back from the last sample.
        forgetting: weight of a sample against the next, 0 < forgetting <= 1.

    Raises:
        EstimationError: settings against the laws above, or data that never decide the terms.
        ChannelError: a signal is not there.
    """
    names = check_terms([term for term in terms if term != BIAS])
    dt = data.dt_s
    memory = _memory(forgetting, dt)
    if not update_s >= dt:
        raise EstimationError(f"update_s must be at least the sample time {dt:g} s, got {update_s}")
    lines = band_lines(*check_band(band_hz, dt), step_hz)
    block(data, target, names)  # the target must not be among the terms
    t = data.t_s - data.t_s[0]
    columns = np.column_stack([np.ones(len(data)), t, data.matrix(names), data[target]])
    stride = round(update_s / dt)
    ends = np.arange(len(data), 0, -stride)[::-1]
    F = np.zeros((lines.size, columns.shape[1]), np.complex128)
    M = np.zeros((2, columns.shape[1]))  # weighted sums of (1, t) times every column
    span, done = 0.0, 0
    times, params, stds, plain = [], [], [], []
    for end in ends:
        rows = slice(done, int(end))
        age = np.arange(int(end) - done)[::-1]
        w, fade = forgetting**age, forgetting ** (int(end) - done)
        F = fade * F + (np.exp(-2j * np.pi * np.outer(lines, t[rows])) * w) @ columns[rows]
        M = fade * M + (columns[rows, :2] * w[:, None]).T @ columns[rows]
        span, done = fade * span + float(np.sum(w)) * dt, int(end)
        flat = _detrended(F, M) * dt
        weight = np.full(lines.size, min(1.0, step_hz * span))
        if weight.sum() < len(names) or not _decided(flat[:, :-1]):
            continue
        fit = complex_fit(flat[:, :-1], flat[:, -1], weight)
        times.append(data.t_s[int(end) - 1])
        params.append(fit.theta[None])
        stds.append(np.sqrt(np.diag(fit.covariance))[None])
        plain.append(fit.std_plain[None])
    return _result(
        target, names, np.array(times), params, stds, plain, memory, data.t_s[ends - 1], noisy_terms([data], names)
    )


def _detrended(F: ComplexArray, M: FloatArray) -> ComplexArray:
    """Return the transforms of terms and target less straight lines, from those of 1, t, terms and target."""
    line = np.linalg.lstsq(M[:, :2], M[:, 2:], rcond=None)[0]
    return np.asarray(F[:, 2:] - F[:, :2] @ line)


def _decided(X: ComplexArray) -> bool:
    parts = np.vstack([X.real, X.imag])
    size = np.linalg.norm(parts, axis=0)
    if not np.all(size > 0.0):
        return False
    s = np.linalg.svd(parts / size, compute_uv=False)
    return bool(s[-1] ** 2 > _DECIDED * s[0] ** 2)


def _memory(forgetting: float, dt_s: float) -> float:
    if not 0.0 < forgetting <= 1.0:
        raise EstimationError(f"0 < forgetting <= 1 must hold, got {forgetting}")
    return np.inf if forgetting == 1.0 else float(-dt_s / np.log(forgetting))


def _result(
    target: str,
    terms: tuple[str, ...],
    t_s: FloatArray,
    params: Sequence[FloatArray],
    std: Sequence[FloatArray],
    std_plain: Sequence[FloatArray],
    memory_s: float,
    tried_s: FloatArray,
    advice: tuple[str, ...] = (),
) -> RecursiveResult:
    """Return the result, or say why there is none."""
    if not t_s.size:
        raise EstimationError(
            f"the data never decide the terms {', '.join(terms)} within a memory of {memory_s:g} s; "
            "raise forgetting, excite more or leave terms out"
        )
    advice += approximate("quiet regression", "for a single record the")
    after = int(np.sum(tried_s >= t_s[0]))
    if t_s.size < after:
        said = (
            f"{target}: from {t_s[0]:g} s on, {100 * (1 - t_s.size / after):.0f} % of the times have no estimate, "
            "because the samples in memory do not decide the terms; raise forgetting or excite throughout"
        )
        advice += (doubt("weakly_identifiable", said),)
    return RecursiveResult(
        target=target,
        terms=terms,
        t_s=t_s,
        params=np.vstack(params),
        std=np.vstack(std),
        std_plain=np.vstack(std_plain),
        memory_s=memory_s,
        advice=advice,
    )
