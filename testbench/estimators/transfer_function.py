"""Transfer functions by least squares: one per output, from one input, at the rate of the log.

In the manner of the Taurus paper (sections VI and VII): the number of poles is given, several numbers of zeros are
tried, and the candidate that predicts the validation records best is kept.

TransferFunctionModel: transfer functions in discrete time, one per output, from one input, each with its delay.

Warnings about poles of transfer functions that the input, the sampling or the noise put where they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from testbench.core.advice import Advice, AdviceList
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.continuous import shifted
from testbench.estimators.hankel import triangle, window_starts, windows
from testbench.estimators.model import ComplexArray, IdentifiedModel, check_records, continuous_poles
from testbench.estimators.residuals import ljung_box
from testbench.estimators.settings import TransferFunctions
from testbench.estimators.state_space import Series, check_sample_time, description, free_run, unit_circle

# --- warnings about poles of transfer functions that the input, the sampling or the noise put where they are ----------


NEAR_PEAK = 0.3  # a pole within this share of the input's spectral peak may be the input's
PART_OF_NYQUIST = 0.5  # a pole above this share of the Nyquist frequency is hardly sampled
TAIL = 0.005  # share of the input's energy below and above the band that is called excited
VAGUE = 0.1  # a frequency known to 10 % or better is the data's, wherever the input peaks


def spectral_density(records: Sequence[FlightRecord], given: str) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (k,) in rad/s and the input's energy density there, means removed, all records summed."""
    size = 8 * max(len(r) for r in records)
    density = np.sum([np.abs(np.fft.rfft(r[given] - r[given].mean(), size)) ** 2 for r in records], axis=0)
    return np.asarray(2.0 * np.pi * np.fft.rfftfreq(size, records[0].dt_s), np.float64), np.asarray(density, np.float64)


def spectral_peak(records: Sequence[FlightRecord], given: str) -> float:
    """Return where, in rad/s, the input's energy density is largest."""
    omega, density = spectral_density(records, given)
    return float(omega[int(np.argmax(density))])


def excited_band(records: Sequence[FlightRecord], inputs: Sequence[str]) -> tuple[float, float]:
    """Return the band (low, high) in rad/s outside of which no input has more than 0.5 % of its energy on either side.

    The lowest of the inputs' low ends and the highest of their high ends.
    """
    ends = []
    for given in inputs:
        omega, density = spectral_density(records, given)
        share = np.cumsum(density) / np.sum(density)
        ends.append((omega[np.searchsorted(share, TAIL)], omega[np.searchsorted(share, 1.0 - TAIL)]))
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))


def question_poles(
    output: str, omega_rad_s: FloatArray, known: FloatArray, records: Sequence[FlightRecord], inputs: Sequence[str]
) -> list[Advice]:
    """Return a sentence for each reason to doubt that the data put the poles of ``output`` where they are.

    Args:
        output: name of the output.
        omega_rad_s: (k,) magnitudes of its poles.
        known: (k,) relative standard errors of these; infinite where the method gives none that can be trusted.
        records: what was identified from.
        inputs: (m,) input channels.
    """
    out = AdviceList()
    nyquist = np.pi / records[0].dt_s
    for given in inputs:
        peak = spectral_peak(records, given)
        near = omega_rad_s[(np.abs(omega_rad_s - peak) <= NEAR_PEAK * peak) & (known > VAGUE)]
        if near.size:
            out.doubt(
                "poles_at_input_peak",
                f"{output}: poles at {_list(near)} rad/s lie within {100 * NEAR_PEAK:.0f} % of the peak of the "
                f"spectrum of {given} ({peak:.2f} rad/s): their place should follow from the data, not from the input; "
                "check with an input of another spectrum",
            )
    fast = omega_rad_s > PART_OF_NYQUIST * nyquist
    if fast.any():
        out.doubt(
            "beyond_nyquist",
            f"{output}: poles at {_list(omega_rad_s[fast])} rad/s lie above half the Nyquist frequency "
            f"({nyquist:.2f} rad/s): such poles come from noise and from holding the input; log faster or use "
            "fewer poles",
        )
    low, high = excited_band(records, inputs)
    outside = ((omega_rad_s < low) | (omega_rad_s > high)) & ~fast
    if outside.any():
        out.doubt(
            "outside_band",
            f"{output}: poles at {_list(omega_rad_s[outside])} rad/s lie outside the band {low:.2f} to {high:.2f} "
            "rad/s that holds 99 % of the input's energy: they depend on the structure and the noise more than on the "
            "data; excite that band or use fewer poles",
        )
    return out


def _list(omega: FloatArray) -> str:
    return ", ".join(f"{w:.2f}" for w in omega)


# --- the discrete model -----------------------------------------------------------------------------------------------


_TURNS = 12  # of least squares and filter: short periods settle in six


@dataclass(frozen=True, eq=False, kw_only=True)
class TransferFunctionModel(IdentifiedModel):
    """y[k] = - a1 y[k-1] ... - an y[k-n] + b1 u[k-1-d] + ... + bn u[k-n-d], for each output by itself."""

    numerators: FloatArray  # (p, n) coefficients b1 ... bn; those after the zeros that were asked for are zero.
    # (p, n + 1) coefficients 1, a1 ... an; zeros last where an output has fewer poles than others.
    denominators: FloatArray
    delays: tuple[int, ...] = ()  # (p,) whole samples d beyond the one that every output is late; none if not given

    def __post_init__(self) -> None:
        object.__setattr__(self, "delays", tuple(int(d) for d in self.delays) or (0,) * len(self.outputs))
        if len(self.delays) != len(self.outputs) or min(self.delays, default=0) < 0:
            raise EstimationError(f"delays must be one whole number >= 0 per output, got {self.delays}")
        p, n = len(self.outputs), np.shape(self.denominators)[-1] - 1
        for name, shape in (("numerators", (p, n)), ("denominators", (p, n + 1))):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got {array_found(array)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def simulate(self, record: FlightRecord, which: NDArray[np.bool_] | None = None) -> FloatArray:
        """Return the free-run outputs (N, p); the initial conditions of each output fit its valid samples best.

        Args:
            record: inputs and outputs.
            which: (p,) the outputs that are asked for; all by default.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
        """
        check_sample_time(record, self.dt_s)
        u, part = record.columns(self.inputs), record.select(self.outputs)
        columns = [
            simulate_one(b, a, d, u, part.data[:, [i]], part.valid[:, [i]])
            for i, (b, a, d) in enumerate(zip(self.numerators, self.denominators, self.delays, strict=True))
            if which is None or which[i]
        ]
        return np.hstack(columns)

    def poles(self) -> dict[str, ComplexArray]:
        """Return the continuous-time poles ln(z)/dt in rad/s of each output's transfer function."""
        return {
            name: continuous_poles(discrete_poles(a), self.dt_s)[0]
            for name, a in zip(self.outputs, self.denominators, strict=True)
        }

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return B(z) / A(z) z^-d at z = exp(j w dt), shape (k, p, 1).

        Raises:
            EstimationError: a frequency lies above the Nyquist frequency pi/dt, or on a pole of the model.
        """
        z = unit_circle(omega_rad_s, self.dt_s)
        below = np.stack([np.polyval(a, z) for a in self.denominators], axis=1)
        if np.any(below == 0.0):
            raise EstimationError("the frequency response is infinite at a pole; choose frequencies off the poles")
        above = np.stack([np.polyval(b, z) / z**d for b, d in zip(self.numerators, self.delays, strict=True)], axis=1)
        return np.asarray((above / below)[:, :, None], dtype=np.complex128)

    def to_dict(self) -> dict[str, Any]:
        """Return names, sample time, coefficients by output, settings, status and advice as JSON values."""
        return {
            **description(self),
            "numerators": dict(zip(self.outputs, self.numerators.tolist(), strict=True)),
            "denominators": dict(zip(self.outputs, self.denominators.tolist(), strict=True)),
            "delays": dict(zip(self.outputs, self.delays, strict=True)),
        }

    def to_control(self) -> Any:
        """Return the model as ``control.TransferFunction`` (p outputs, one input) with signal names."""
        import control

        above = [[b.tolist()] for b in self.numerators]
        below = [[[*a.tolist(), *[0.0] * d]] for a, d in zip(self.denominators, self.delays, strict=True)]
        return control.tf(above, below, self.dt_s, inputs=list(self.inputs), outputs=list(self.outputs))


def discrete_poles(a: FloatArray) -> ComplexArray:
    """Return the roots of 1 + a1 / z + ... + an / z^n, without zeros that only fill up the array."""
    return np.roots(np.trim_zeros(a, "b")).astype(np.complex128)


def in_free_run(model: TransferFunctionModel, records: Sequence[FlightRecord]) -> TransferFunctionModel:
    """Return the model whose coefficients minimise the errors of the free run, where the search converges.

    Least squares of the equation on data filtered by 1 / A, in turns with A (K. Steiglitz and L. E. McBride, IEEE
    Transactions on Automatic Control 10, 1965): noise on the outputs does not bias its end. Poles outside the unit
    circle are mirrored into it. Initial states are left to the filter, samples that are not valid to their last value.
    """
    above, below = model.numerators.copy(), model.denominators.copy()
    for i, output in enumerate(model.outputs):
        num, den = np.flatnonzero(above[i]), 1 + np.flatnonzero(below[i, 1:])
        a = below[i]
        for _ in range(_TURNS):
            a = _inside(a)
            rows, right = [], []
            for record in records:
                u, y = record[model.inputs[0]], record[output]
                u, y = (lfilter([1.0], a, x - x[0]) for x in (shifted(u, model.delays[i]), y))
                one = lfilter([1.0], a, np.ones(len(y)))
                first = len(a) - 1
                late = [np.concatenate([np.zeros(k), -y[:-k]])[first:] for k in den]
                given = [np.concatenate([np.zeros(k + 1), u[: -(k + 1)]])[first:] for k in num]
                rows.append(np.stack([*late, *given, one[first:]], axis=1))
                right.append(y[first:])
            X = np.vstack(rows)
            size = np.maximum(np.sqrt(np.sum(X**2, axis=0)), 1e-300)
            found = np.linalg.lstsq(X / size, np.concatenate(right), rcond=1e-10)[0] / size
            a = np.zeros_like(a)
            a[0], a[den] = 1.0, found[: len(den)]
        below[i] = _inside(a)
        above[i, num] = found[len(den) : len(den) + len(num)]
    return replace(model, numerators=above, denominators=below)


def _inside(a: FloatArray) -> FloatArray:
    """Return the polynomial with roots outside the unit circle mirrored into it."""
    z = discrete_poles(a)
    z = np.where(np.abs(z) > 1.0, 1.0 / np.conj(np.where(z == 0.0, 1.0, z)), z)
    out = np.zeros_like(a)
    out[: len(z) + 1] = np.real(np.poly(z))
    return out


def simulate_one(b: FloatArray, a: FloatArray, delay: int, u: FloatArray, y: FloatArray, valid: Any) -> FloatArray:
    """Return the free run (N, 1) of one transfer function, in observer form: x[k+1] = A x + B u, y = x_1.

    The input (N, 1) comes ``delay`` samples late; before the record it holds its first value.
    """
    n = b.size
    A = np.zeros((n, n))
    A[:, 0] = -a[1:]
    A[:-1, 1:] = np.eye(n - 1)
    late = shifted(u[:, 0], delay)[:, None]
    return free_run(A, b[:, None], np.eye(1, n), np.zeros((1, 1)), Series(late, y, valid))


# --- transfer functions by least squares ------------------------------------------------------------------------------


__all__ = ["TransferFunctionModel", "estimate"]

_DEFICIENT = 1e-10  # condition of the scaled regression beyond which it counts as rank deficient
_SILENT = 1e-6  # equation error below this share of an output is rounding: no doubt about its poles
_TIE = 1e-7  # per cent; fits closer than this differ by rounding
_WHITE = 0.01  # Ljung-Box probability below which equation errors count as coloured


class _Fit(NamedTuple):
    """One candidate for one output, in SI units."""

    b: FloatArray
    a: FloatArray
    delay: int
    covariance: FloatArray
    white: float  # Ljung-Box probability of the equation errors
    condition: float
    equation_error: float
    rows: int
    taken: float  # share of the output's samples that were really taken, where interpolated ones had to serve; else 1


def estimate(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    settings: TransferFunctions,
    validation: Sequence[FlightRecord] = (),
) -> TransferFunctionModel:
    """Fit one transfer function per output by linear least squares on the equation error (ARX) and choose its zeros.

    For n poles, nz zeros and d samples of delay, y[k] = - a1 y[k-1] ... - an y[k-n] + b1 u[k-1-d] + ... +
    b_(nz+1) u[k-nz-1-d]: a numerator of nz + 1 coefficients after one sample of delay and d more. These are nz zeros
    of the discrete transfer function off the origin, and n - 1 - nz at z = 0. The number of zeros in the continuous
    sense has no exact discrete analogue: sampling a system with n poles gives n - 1 discrete zeros as a rule, whatever
    its continuous ones.

    The regression uses measured past values, so that every record brings its own initial conditions. Noise on these
    past values biases the coefficients: a noisy ARX puts poles too far from the unit circle (too much damping, too high
    a frequency), and more so the faster the log. Low-pass filtering and decimation to about ten samples a period help.

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: the one input channel.
        outputs: (p,) output channels.
        settings: the candidates.
        validation: measured records that choose among the candidates, by 100 (1 - ||y - y_free|| / ||y - mean(y)||).

    Returns:
        The model. Its diagnostics hold, by output, ``zeros``, ``poles``, ``delay_samples`` (chosen), ``fit_percent``
        (number of zeros -> best fit), ``standard_errors`` and ``covariance`` (of a1 ... an, then of b1 ...): the usual
        ones where the Ljung-Box test lets the equation errors pass as white at 1 % (``white_probability``), else those
        of W. K. Newey and K. D. West (Econometrica 55(3), 1987), which tell the scatter; a bias they do not tell,
        ``condition`` of the scaled regression, ``equation_error_percent``, ``rows`` of the regression,
        ``poles_without_continuous_counterpart`` (discrete z), and ``input_peak_rad_s``.

    Raises:
        EstimationError: more than one input, settings against the laws above, too few samples, or records against
            those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    if len(inputs) != 1:
        raise EstimationError(
            f"a transfer function has one input, got {len(inputs)} ({', '.join(inputs)}); "
            "name one, or use dsr_e for several inputs"
        )
    orders = (settings.poles,) if isinstance(settings.poles, int) else settings.poles
    candidates = sorted({(n, nz, d) for n in orders for nz in settings.zeros for d in settings.delay_samples if nz < n})
    check_records(records, inputs, outputs)
    check_records([*records, *validation], inputs, outputs)
    judges = list(validation) or list(records)
    chosen, fits, table = {}, {}, {}
    for name in outputs:
        chosen[name], fits[name], table[name] = _choose(records, judges, inputs[0], name, candidates)
    dt = records[0].dt_s
    discrete = {name: continuous_poles(discrete_poles(fit.a), dt)[1] for name, fit in fits.items()}
    advice = _advice(fits, discrete, records, inputs, judged=bool(validation))
    order = max(n for n, _, _ in candidates)
    return TransferFunctionModel(
        method="transfer_function",
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        dt_s=dt,
        settings={
            "poles": settings.poles if isinstance(settings.poles, int) else list(settings.poles),
            "zeros": list(settings.zeros),
            "delay_samples": list(settings.delay_samples),
        },
        diagnostics={
            "zeros": {name: nz for name, (_, nz, _) in chosen.items()},
            "poles": {name: n for name, (n, _, _) in chosen.items()},
            "delay_samples": {name: d for name, (_, _, d) in chosen.items()},
            "fit_percent": table,
            **_regressions(fits),
            "poles_without_continuous_counterpart": discrete,
            "input_peak_rad_s": spectral_peak(records, inputs[0]),
        },
        advice=advice,
        numerators=np.array([np.pad(fit.b, (0, order - fit.b.size)) for fit in fits.values()]),
        denominators=np.array([np.pad(fit.a, (0, order + 1 - fit.a.size)) for fit in fits.values()]),
        delays=tuple(fit.delay for fit in fits.values()),
    )


def _choose(
    records: Sequence[FlightRecord],
    judges: Sequence[FlightRecord],
    given: str,
    output: str,
    candidates: list[tuple[int, int, int]],
) -> tuple[tuple[int, int, int], _Fit, dict[int, float]]:
    """Return the candidate that predicts ``judges`` best (the smallest of equals), its fit, best fit in % by zeros."""
    trials = {c: _regress(records, given, output, *c) for c in candidates}
    percent = {c: _fit_percent(trial, judges, given, output) for c, trial in trials.items()}
    highest = max(percent.values())
    best = next(c for c in candidates if percent[c] >= highest - _TIE)
    table: dict[int, float] = {}
    for (_, nz, _), value in percent.items():
        table[nz] = max(value, table.get(nz, -np.inf))
    return best, trials[best], table


def _late(record: FlightRecord, given: str, output: str, delay: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return (input ``delay`` samples earlier, output) as (N - delay, 2), and which of them were taken."""
    pair = record.select([given, output])
    z, valid = pair.data, pair.valid
    cut = len(z) - delay
    late = np.column_stack([z[:cut, 0], z[delay:, 1]])
    return late, np.column_stack([valid[:cut, 0], valid[delay:, 1]])


def _regress(records: Sequence[FlightRecord], given: str, output: str, n: int, nz: int, delay: int) -> _Fit:
    """Return the least-squares fit for one output and one candidate, from the rows that :func:`_rows` picks."""
    R = np.zeros((0, n + nz + 2))
    unknowns = n + nz + 1
    pairs = [_late(record, given, output, delay) for record in records]
    bridged = all("prepared" in r.provenance for r in records)
    places, taken = _rows([valid for _, valid in pairs], bridged, output, n, 2 * unknowns)
    count = sum(starts.size for starts in places)
    pick = np.r_[2 * np.arange(n - 1, -1, -1) + 1, 2 * np.arange(n - 1, n - nz - 2, -1), 2 * n + 1]
    for (z, _), starts in zip(pairs, places, strict=True):
        for _, rows in windows(z, starts, n + 1):
            R = triangle(R, rows[:, pick])
    size = np.sqrt(np.sum(R**2, axis=0))
    if size[-1] == 0.0 or not np.all(size[:-1] > 0.0):
        raise EstimationError(
            f"output '{output}' and input '{given}' must move to be modelled, but one of them is zero"
        )
    U, s, Vt = np.linalg.svd(R[:unknowns, :-1] / size[:-1], full_matrices=False)
    keep = s > np.finfo(float).eps * max(count, unknowns) * s[0]
    inverse = (Vt[keep].T / s[keep]) / size[:-1, None]
    theta = inverse @ (U[:, keep].T @ R[:unknowns, -1])
    rest = float(np.linalg.norm(R[:, -1] - R[:, :-1] @ theta))
    covariance, white = _covariance(pairs, places, n, pick, theta, inverse)
    b = np.concatenate([theta[n:], np.zeros(n - 1 - nz)])
    a = np.concatenate([[1.0], -theta[:n]])
    condition = float(s[0] / s[-1]) if s[-1] > 0.0 else np.inf
    return _Fit(b, a, delay, covariance, white, condition, rest / float(size[-1]), count, taken)


def _covariance(
    pairs: list[tuple[FloatArray, NDArray[np.bool_]]],
    places: list[NDArray[np.intp]],
    n: int,
    pick: NDArray[np.intp],
    theta: FloatArray,
    inverse: FloatArray,
) -> tuple[FloatArray, float]:
    """Return the covariance of theta with ``inverse`` inverse' = (P'P)^-1, and how likely its errors are white.

    Coloured errors e go with the past outputs among the regressors, so that it is the products of both whose sum over
    lags counts: (P'P)^-1 [sum_l w_l sum_k (P_k e_k)(P_(k+l) e_(k+l))'] (P'P)^-1 with w_l falling to zero (Newey, West).
    """
    errors, scores = [], []
    for (z, _), starts in zip(pairs, places, strict=True):
        for _, rows in windows(z, starts, n + 1):
            P = rows[:, pick[:-1]]
            errors.append(rows[:, pick[-1]] - P @ theta)
            scores.append((P * errors[-1][:, None]) @ inverse)
    count = sum(e.size for e in errors)
    free = count - theta.size
    longest = max(errors, key=len)
    white = ljung_box(longest, max(1, min(20, longest.size // 5))) if longest.size >= 10 else 1.0
    plain = inverse @ inverse.T * (sum(float(e @ e) for e in errors) / free)
    if white >= _WHITE:
        return plain, white
    lags = int(np.ceil(1.5 * longest.size ** (1.0 / 3.0))) + n
    S = np.zeros((inverse.shape[1],) * 2)
    for g in scores:
        for lag in range(min(lags, len(g) - 1) + 1):
            cross = (1.0 - lag / (lags + 1.0)) * (g[: len(g) - lag].T @ g[lag:])
            S += cross if lag == 0 else cross + cross.T
    return inverse @ S @ inverse.T * (count / free), white


def _regressions(fits: Mapping[str, _Fit]) -> dict[str, Any]:
    """Return what the regressions tell of themselves, by output."""
    return {
        "standard_errors": {name: np.sqrt(np.diag(fit.covariance)) for name, fit in fits.items()},
        "covariance": {name: fit.covariance for name, fit in fits.items()},
        "white_probability": {name: fit.white for name, fit in fits.items()},
        "condition": {name: fit.condition for name, fit in fits.items()},
        "equation_error_percent": {name: 100.0 * fit.equation_error for name, fit in fits.items()},
        "rows": {name: fit.rows for name, fit in fits.items()},
    }


def _rows(
    masks: list[NDArray[np.bool_]], bridged: bool, output: str, n: int, least: int
) -> tuple[list[NDArray[np.intp]], float]:
    """Return where the rows of the regression begin in each record, and the share of the output that was sampled.

    Rows free of invalid samples are used. A sensor slower than the log leaves none: then, and only on records whose
    gaps ``prepare`` has bridged, all rows serve, and the share that was really sampled is returned (else 1).
    """
    # y[k] and its past, but of u the past only
    clean = [np.intersect1d(window_starts(v[:, 1], n + 1), window_starts(v[:, 0], n)) for v in masks]
    count = sum(starts.size for starts in clean)
    if count >= least:
        return clean, 1.0
    every = [window_starts(np.ones(len(v), bool), n + 1) for v in masks]
    if sum(starts.size for starts in every) >= least and bridged:
        return every, float(np.mean(np.concatenate(masks)[:, 1]))
    raise EstimationError(
        f"least squares of output '{output}' needs at least twice as many samples as its {least // 2} coefficients, "
        f"got {count} rows free of invalid samples; give more data or fewer poles, or bridge the gaps with prepare"
    )


def _fit_percent(fit: _Fit, records: Sequence[FlightRecord], given: str, output: str) -> float:
    """Return 100 (1 - ||y - y_free|| / ||y - mean(y)||) over all valid samples, each record about its own mean."""
    error, size = 0.0, 0.0
    for record in records:
        pair = record.select([given, output])
        y, valid = pair.data[:, [1]], pair.valid[:, [1]]
        if valid.any():
            error += float(np.sum((y - simulate_one(fit.b, fit.a, fit.delay, pair.data[:, [0]], y, valid))[valid] ** 2))
            size += float(np.sum((y[valid] - y[valid].mean()) ** 2))
    if size == 0.0:
        raise EstimationError(f"output '{output}' must move in the validation records to choose among numbers of zeros")
    return 100.0 * (1.0 - float(np.sqrt(error / size)))


def _advice(
    fits: dict[str, _Fit],
    discrete: dict[str, ComplexArray],
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    *,
    judged: bool,
) -> tuple[Advice, ...]:
    """Return what is doubtful and what to do about it, in sentences."""
    out = AdviceList()
    if not judged:
        out.note(
            "structure_not_judged",
            "the number of zeros was chosen on the records it was fitted to, which favours more zeros; "
            "give validation records",
        )
    for name, fit in fits.items():
        if fit.taken < 1.0:
            out.doubt(
                "interpolated",
                f"{name}: only {100 * fit.taken:.0f} % of its samples were taken, because the sensor is slower "
                "than the log, and the others were interpolated; do not trust poles near the sensor's rate; "
                "decimate to that rate",
            )
        if fit.condition > 1.0 / _DEFICIENT:
            out.doubt(
                "not_told_apart",
                f"{name}: the regression is rank deficient (condition {fit.condition:.1e}): "
                "the data hold fewer poles than asked for; lower poles, decimate or excite a wider band",
            )
        if discrete[name].size:
            z = ", ".join(f"{z.real:.3g}" for z in discrete[name])
            out.doubt(
                "no_continuous_counterpart",
                f"{name}: discrete poles at {z} have no continuous counterpart: they model noise, not the "
                "aircraft; use fewer poles",
            )
        if fit.equation_error < _SILENT:
            continue
        if fit.white < _WHITE:
            out.doubt(
                "coloured_residuals",
                f"{name}: the equation errors are coloured (Ljung-Box probability {fit.white:.1e}), as noise on "
                "the output makes them; the coefficients are biased, and their standard errors do not show it; "
                "low-pass and decimate, or use an output-error method",
            )
        poles = continuous_poles(discrete_poles(fit.a), records[0].dt_s)[0]
        omega = np.asarray(np.unique(np.round(np.abs(poles), 12)), np.float64)
        out += question_poles(name, omega, np.full(omega.size, np.inf), records, inputs)
    return tuple(out)
