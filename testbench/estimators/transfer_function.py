"""Transfer functions by least squares: one per output, from one input, at the rate of the log.

In the manner of the Taurus paper (sections VI and VII): the number of poles is given, several numbers of zeros are
tried, and the candidate that predicts the validation records best is kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.errors import EstimationError
from testbench.estimators.hankel import triangle, window_starts, windows
from testbench.estimators.model import ComplexArray, IdentifiedModel, check_records, continuous_poles
from testbench.estimators.state_space import check_sample_time, description, free_run, unit_circle
from testbench.record import FlightRecord, FloatArray

_NEAR_PEAK = 0.3  # a pole within this share of the input's spectral peak may be the input's
_PART_OF_NYQUIST = 0.5  # a pole above this share of the Nyquist frequency is hardly sampled
_DEFICIENT = 1e-10  # condition of the scaled regression beyond which it counts as rank deficient
_SILENT = 1e-6  # equation error below this share of an output is rounding: no doubt about its poles


@dataclass(frozen=True, eq=False, kw_only=True)
class TransferFunctionModel(IdentifiedModel):
    """y[k] = - a1 y[k-1] ... - an y[k-n] + b1 u[k-1] + ... + bn u[k-n], for each output by itself.

    Attributes:
        numerators: (p, n) coefficients b1 ... bn; those after the zeros that were asked for are zero.
        denominators: (p, n + 1) coefficients 1, a1 ... an.
    """

    numerators: FloatArray
    denominators: FloatArray

    def __post_init__(self) -> None:
        p, n = len(self.outputs), np.shape(self.denominators)[-1] - 1
        for name, shape in (("numerators", (p, n)), ("denominators", (p, n + 1))):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got shape {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the free-run outputs (N, p); the initial conditions of each output fit its valid samples best.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
        """
        check_sample_time(record, self.dt_s)
        u, part = record.columns(self.inputs), record.select(self.outputs)
        columns = [
            _simulate(b, a, u, part.data[:, [i]], part.valid[:, [i]])
            for i, (b, a) in enumerate(zip(self.numerators, self.denominators, strict=True))
        ]
        return np.hstack(columns)

    def poles(self) -> dict[str, ComplexArray]:
        """Return the continuous-time poles ln(z)/dt in rad/s of each output's transfer function."""
        return {
            name: continuous_poles(np.roots(a).astype(np.complex128), self.dt_s)[0]
            for name, a in zip(self.outputs, self.denominators, strict=True)
        }

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return B(z) / A(z) at z = exp(j w dt), shape (k, p, 1).

        Raises:
            EstimationError: a frequency lies above the Nyquist frequency pi/dt, or on a pole of the model.
        """
        z = unit_circle(omega_rad_s, self.dt_s)
        below = np.stack([np.polyval(a, z) for a in self.denominators], axis=1)
        if np.any(below == 0.0):
            raise EstimationError("the frequency response is infinite at a pole; choose frequencies off the poles")
        above = np.stack([np.polyval(b, z) for b in self.numerators], axis=1)
        return np.asarray((above / below)[:, :, None], dtype=np.complex128)

    def to_dict(self) -> dict[str, Any]:
        """Return names, sample time, coefficients by output, settings, status and advice as JSON values."""
        return {
            **description(self),
            "numerators": dict(zip(self.outputs, self.numerators.tolist(), strict=True)),
            "denominators": dict(zip(self.outputs, self.denominators.tolist(), strict=True)),
        }

    def to_control(self) -> Any:
        """Return the model as ``control.TransferFunction`` (p outputs, one input) with signal names."""
        import control

        above = [[b.tolist()] for b in self.numerators]
        below = [[a.tolist()] for a in self.denominators]
        return control.tf(above, below, self.dt_s, inputs=list(self.inputs), outputs=list(self.outputs))


class _Fit(NamedTuple):
    """One candidate for one output, in SI units."""

    b: FloatArray
    a: FloatArray
    errors: FloatArray
    condition: float
    equation_error: float
    rows: int
    taken: float  # share of the output's samples that were really taken, where interpolated ones had to serve; else 1


def estimate(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    poles: int,
    zeros: Sequence[int],
    validation: Sequence[FlightRecord] = (),
) -> TransferFunctionModel:
    """Fit one transfer function per output by linear least squares on the equation error (ARX) and choose its zeros.

    For n poles and nz zeros, y[k] = - a1 y[k-1] ... - an y[k-n] + b1 u[k-1] + ... + b_(nz+1) u[k-nz-1]: a numerator of
    nz + 1 coefficients after one sample of delay. These are nz zeros of the discrete transfer function off the origin,
    and n - 1 - nz at z = 0. The number of zeros in the continuous sense has no exact discrete analogue: sampling a
    system with n poles gives n - 1 discrete zeros as a rule, whatever its continuous ones.

    The regression uses measured past values, so that every record brings its own initial conditions. Noise on these
    past values biases the coefficients: a noisy ARX puts poles too far from the unit circle (too much damping, too
    high a frequency), the more so the faster the log. Low-pass filtering and decimation to some ten samples a period
    help.

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: the one input channel.
        outputs: (p,) output channels.
        poles: n >= 1 of each transfer function.
        zeros: candidates nz, each 0 <= nz < n.
        validation: measured records that choose among the candidates, by 100 (1 - ||y - y_free|| / ||y - mean(y)||).

    Returns:
        The model. Its diagnostics hold, by output, ``zeros`` (chosen), ``fit_percent`` (candidate -> fit),
        ``standard_errors`` (of a1 ... an, then of b1 ..., for white equation errors; free of bias they are not),
        ``condition`` of the scaled regression, ``equation_error_percent``, ``rows`` of the regression,
        ``poles_without_continuous_counterpart`` (discrete z), and ``input_peak_rad_s``.

    Raises:
        EstimationError: more than one input, settings against the laws above, too few samples, or records against
            those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    _check_settings(inputs, poles, zeros)
    check_records(records, inputs, outputs)
    check_records([*records, *validation], inputs, outputs)
    judges = list(validation) or list(records)
    chosen, fits, table = {}, {}, {}
    for name in outputs:
        chosen[name], fits[name], table[name] = _choose_zeros(records, judges, inputs[0], name, poles, zeros)
    dt = records[0].dt_s
    peak = _spectral_peak(records, inputs[0], dt)
    discrete = {name: continuous_poles(np.roots(fit.a).astype(np.complex128), dt)[1] for name, fit in fits.items()}
    advice = _advice(fits, discrete, peak, dt, inputs[0], judged=bool(validation))
    return TransferFunctionModel(
        method="transfer_function",
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        dt_s=dt,
        settings={"poles": poles, "zeros": list(zeros)},
        diagnostics={
            "zeros": chosen,
            "fit_percent": table,
            **_regressions(fits),
            "poles_without_continuous_counterpart": discrete,
            "input_peak_rad_s": peak,
        },
        status="warning" if advice else "good",
        advice=advice,
        numerators=np.array([fit.b for fit in fits.values()]),
        denominators=np.array([fit.a for fit in fits.values()]),
    )


def _check_settings(inputs: Sequence[str], poles: int, zeros: Sequence[int]) -> None:
    if len(inputs) != 1:
        raise EstimationError(
            f"a transfer function has one input, got {len(inputs)} ({', '.join(inputs)}); "
            "name one, or use dsr_e for several inputs"
        )
    if poles < 1 or not zeros or not all(0 <= nz < poles for nz in zeros):
        raise EstimationError(
            f"poles >= 1 and 0 <= zeros < poles must hold, got poles = {poles}, zeros = {list(zeros)}"
        )


def _choose_zeros(
    records: Sequence[FlightRecord],
    judges: Sequence[FlightRecord],
    given: str,
    output: str,
    n: int,
    zeros: Sequence[int],
) -> tuple[int, _Fit, dict[int, float]]:
    """Return the number of zeros that predicts ``judges`` best (the lowest of equals), its fit, and every fit in %."""
    trials = {nz: _regress(records, given, output, n, nz) for nz in sorted(set(zeros))}
    percent = {nz: _fit_percent(trial, judges, given, output) for nz, trial in trials.items()}
    best = max(percent, key=lambda nz: percent[nz])
    return best, trials[best], percent


def _regress(records: Sequence[FlightRecord], given: str, output: str, n: int, nz: int) -> _Fit:
    """Return the least-squares fit for one output and one number of zeros, from the rows that :func:`_rows` picks."""
    R = np.zeros((0, n + nz + 2))
    unknowns = n + nz + 1
    places, taken = _rows(records, given, output, n, 2 * unknowns)
    count = sum(starts.size for starts in places)
    pick = np.r_[2 * np.arange(n - 1, -1, -1) + 1, 2 * np.arange(n - 1, n - nz - 2, -1), 2 * n + 1]
    for record, starts in zip(records, places, strict=True):
        for _, rows in windows(record.columns([given, output]), starts, n + 1):
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
    errors = rest / np.sqrt(count - unknowns) * np.sqrt(np.sum(inverse**2, axis=1))
    b = np.concatenate([theta[n:], np.zeros(n - 1 - nz)])
    a = np.concatenate([[1.0], -theta[:n]])
    return _Fit(b, a, errors, float(s[0] / s[-1]) if s[-1] > 0.0 else np.inf, rest / float(size[-1]), count, taken)


def _regressions(fits: Mapping[str, _Fit]) -> dict[str, Any]:
    """Return what the regressions tell of themselves, by output."""
    return {
        "standard_errors": {name: fit.errors for name, fit in fits.items()},
        "condition": {name: fit.condition for name, fit in fits.items()},
        "equation_error_percent": {name: 100.0 * fit.equation_error for name, fit in fits.items()},
        "rows": {name: fit.rows for name, fit in fits.items()},
    }


def _rows(
    records: Sequence[FlightRecord], given: str, output: str, n: int, least: int
) -> tuple[list[NDArray[np.intp]], float]:
    """Return where the rows of the regression begin in each record, and the share of the output that was sampled.

    Rows free of invalid samples are used. A sensor slower than the log leaves none: then, and only on records whose
    gaps ``prepare`` has bridged, all rows serve, and the share that was really sampled is returned (else 1).
    """
    masks = [record.select([given, output]).valid for record in records]
    # y[k] and its past, but of u the past only
    clean = [np.intersect1d(window_starts(v[:, 1], n + 1), window_starts(v[:, 0], n)) for v in masks]
    count = sum(starts.size for starts in clean)
    if count >= least:
        return clean, 1.0
    every = [window_starts(np.ones(len(v), bool), n + 1) for v in masks]
    if sum(starts.size for starts in every) >= least and all("prepared" in r.provenance for r in records):
        return every, float(np.mean(np.concatenate(masks)[:, 1]))
    raise EstimationError(
        f"least squares of output '{output}' needs at least twice as many samples as its {least // 2} coefficients, "
        f"got {count} rows free of invalid samples; give more data or fewer poles, or bridge the gaps with prepare"
    )


def _simulate(b: FloatArray, a: FloatArray, u: FloatArray, y: FloatArray, valid: Any) -> FloatArray:
    """Return the free run (N, 1) of one transfer function, in observer form: x[k+1] = A x + B u, y = x_1."""
    n = b.size
    A = np.zeros((n, n))
    A[:, 0] = -a[1:]
    A[:-1, 1:] = np.eye(n - 1)
    return free_run(A, b[:, None], np.eye(1, n), np.zeros((1, 1)), u, y, valid)


def _fit_percent(fit: _Fit, records: Sequence[FlightRecord], given: str, output: str) -> float:
    """Return 100 (1 - ||y - y_free|| / ||y - mean(y)||) over all valid samples, each record about its own mean."""
    error, size = 0.0, 0.0
    for record in records:
        pair = record.select([given, output])
        y, valid = pair.data[:, [1]], pair.valid[:, [1]]
        if valid.any():
            error += float(np.sum((y - _simulate(fit.b, fit.a, pair.data[:, [0]], y, valid))[valid] ** 2))
            size += float(np.sum((y[valid] - y[valid].mean()) ** 2))
    if size == 0.0:
        raise EstimationError(f"output '{output}' must move in the validation records to choose among numbers of zeros")
    return 100.0 * (1.0 - float(np.sqrt(error / size)))


def _spectral_peak(records: Sequence[FlightRecord], given: str, dt_s: float) -> float:
    """Return where, in rad/s, the input's energy density (mean removed, all records summed) is largest."""
    size = 8 * max(len(r) for r in records)
    density = np.sum([np.abs(np.fft.rfft(r[given] - r[given].mean(), size)) ** 2 for r in records], axis=0)
    return float(2.0 * np.pi * np.fft.rfftfreq(size, dt_s)[int(np.argmax(density))])


def _advice(
    fits: dict[str, _Fit], discrete: dict[str, ComplexArray], peak: float, dt_s: float, given: str, *, judged: bool
) -> tuple[str, ...]:
    """Return what is doubtful and what to do about it, in sentences."""
    out = []
    if not judged:
        out.append(
            "the number of zeros was chosen on the records it was fitted to, which favours more zeros; "
            "give validation records"
        )
    nyquist = np.pi / dt_s
    for name, fit in fits.items():
        if fit.taken < 1.0:
            out.append(
                f"{name}: only {100 * fit.taken:.0f} % of its samples were taken, the sensor is slower than the log; "
                "interpolated ones served in between, so poles near the sensor's rate are not to be trusted; "
                "decimate to its rate"
            )
        if fit.condition > 1.0 / _DEFICIENT:
            out.append(
                f"{name}: the regression is rank deficient (condition {fit.condition:.1e}): "
                "the data hold fewer poles than asked for; lower poles, decimate or excite a wider band"
            )
        if discrete[name].size:
            z = ", ".join(f"{z.real:.3g}" for z in discrete[name])
            out.append(
                f"{name}: discrete poles at {z} have no continuous counterpart: they model noise, not the aircraft; "
                "use fewer poles"
            )
        if fit.equation_error < _SILENT:
            continue
        poles = continuous_poles(np.roots(fit.a).astype(np.complex128), dt_s)[0]
        omega = np.unique(np.round(np.abs(poles), 12))
        near = [w for w in omega if abs(w - peak) <= _NEAR_PEAK * peak]
        fast = [w for w in omega if w > _PART_OF_NYQUIST * nyquist]
        if near:
            out.append(
                f"{name}: poles at {', '.join(f'{w:.2f}' for w in near)} rad/s lie within {100 * _NEAR_PEAK:.0f} % "
                f"of the peak of the spectrum of {given} ({peak:.2f} rad/s): the data, not the input, should decide; "
                "check with an input of another spectrum"
            )
        if fast:
            out.append(
                f"{name}: poles at {', '.join(f'{w:.2f}' for w in fast)} rad/s lie above half the Nyquist frequency "
                f"({nyquist:.2f} rad/s): such poles come from noise and hold; log faster or use fewer poles"
            )
    return tuple(out)
