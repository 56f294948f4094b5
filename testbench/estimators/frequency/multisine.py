"""Frequency responses at the lines of periodic excitation: no leakage, noise and nonlinear distortion told apart.

R. Pintelon and J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., Wiley 2012, chapters 2 to 4
(section numbers from memory).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, doubt, note
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.frequency.response import FrequencyResponse, interval_factor
from testbench.estimators.model import ComplexArray, check_records

_EXCITED = 0.01  # a line counts as excited from 1 % of the amplitude of the largest line on
_STANDS_OUT = 5.0  # and if it stands this many standard deviations above the noise
_RANK = 1e-6  # smallest singular value of the inputs at a line, of the largest, that still tells them apart
_NEIGHBOURS = 5  # detection lines averaged into one level of distortion
_OTHER_PHASES = 0.3  # rad, root mean square; records closer than this repeat each other
_BENT = 0.05  # share of nonlinear distortion in the response from which on it is a doubt (judgement)
_TRANSIENT = 3.0  # first period against the others, in units of their noise power


class _Experiment(NamedTuple):
    """One record: spectra (P, f, d) of its whole periods, and the number of samples of one."""

    Z: ComplexArray
    samples: int


class _Lines(NamedTuple):
    """The lines at which the ``used`` inputs are excited, those that ``others`` excite, and the rad/s of all (f,)."""

    omega: FloatArray
    excited: NDArray[np.intp]
    used: list[int]
    others: NDArray[np.intp] | None = None


def estimate_multisine_response(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    period_s: float,
    drop_periods: int = 1,
    lines_hz: Sequence[float] | None = None,
) -> FrequencyResponse:
    """Return H at the excited lines of a periodic excitation, from whole periods: H = Y U^+ of the averaged spectra.

    The output error is V = Y - H U. Its scatter from period to period is noise. The part that does not scatter is
    nonlinear distortion if it appears at lines that are not excited (even lines from even, odd lines from odd
    nonlinearity) or differs among records with different phases. Both are given as variances of H (E|dH|^2); their sum
    makes the random error. Several inputs need at least as many records as inputs, with phases that tell them apart at
    every line; for inputs on lines of their own see :func:`estimate_interleaved_responses`.

    Args:
        records: measured records of the same excitation, or of realisations with other phases.
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        period_s: period, s: a whole number of samples.
        drop_periods: periods left out at the start of each record, in which the transient decays.
        lines_hz: excited frequencies, multiples of 1/period; found in the inputs if not given.

    Returns:
        The response. Its diagnostics hold ``distortion_source`` ("detection lines", "realisations" or "not separable"),
        ``periods`` by record; ``interval_factor``: random errors to either side that hold 95 %; and by output
        ``odd_distortion`` and ``even_distortion``: (frequency rad/s, power) at the lines that are not excited, noise
        taken off.

    Raises:
        EstimationError: a period that is not a whole number of samples, fewer than two whole periods without gaps, no
            excited line, inputs that cannot be told apart, or records against those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    experiments, omega = _experiments(records, inputs, outputs, period_s, drop_periods)
    m = len(inputs)
    if lines_hz is None:
        lines = np.flatnonzero(_excited(experiments, m).any(axis=1))
    else:
        lines = _lines(lines_hz, period_s, omega.size)
    if not lines.size:
        raise EstimationError("a multisine must excite at least one line, but the inputs show none above their noise")
    at = _Lines(omega, lines, list(range(m)))
    return _at_lines(experiments, at, tuple(inputs), tuple(outputs), records[0].dt_s)


def estimate_interleaved_responses(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    period_s: float,
    drop_periods: int = 1,
) -> dict[str, FrequencyResponse]:
    """Return input -> its response at the lines that it alone excites (orthogonal multisines: one record will do).

    Args and errors as in :func:`estimate_multisine_response`; each input must have lines of its own.
    """
    experiments, omega = _experiments(records, inputs, outputs, period_s, drop_periods)
    excited = _excited(experiments, len(inputs))
    out: dict[str, FrequencyResponse] = {}
    for j, name in enumerate(inputs):
        lines = np.flatnonzero(excited[:, j] & (excited.sum(axis=1) == 1))
        if not lines.size:
            raise EstimationError(
                f"interleaved multisines need lines that one input alone excites, got none for '{name}'; "
                "use estimate_multisine_response with one record per input"
            )
        used = [j, *range(len(inputs), len(inputs) + len(outputs))]
        alone = [_Experiment(e.Z[:, :, used], e.samples) for e in experiments]
        others = np.flatnonzero(excited.any(axis=1) & ~excited[:, j])
        out[name] = _at_lines(alone, _Lines(omega, lines, [0], others), (name,), tuple(outputs), records[0].dt_s)
    return out


def _experiments(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], period_s: float, drop: int
) -> tuple[list[_Experiment], FloatArray]:
    """Return the spectra of the periods of each record, and the frequencies (f,) of all lines in rad/s."""
    data = check_records(records, inputs, outputs)
    dt = records[0].dt_s
    samples = round(period_s / dt)
    if samples < 4 or abs(period_s / dt - samples) > 1e-4 or drop < 0:
        raise EstimationError(
            f"period_s must be a whole number (>= 4) of samples of {dt:g} s and drop_periods >= 0, got "
            f"{period_s / dt:.6g} samples and {drop}; resample the record or correct the period"
        )
    out = []
    for record, (u, y) in zip(records, data, strict=True):
        z = np.hstack([u, y])
        count = len(z) // samples
        valid: NDArray[np.bool_] = np.asarray(record.select([*inputs, *outputs]).valid.all(axis=1), bool)
        kept = [i for i in range(drop, count) if valid[i * samples : (i + 1) * samples].all()]
        if len(kept) < 2:
            raise EstimationError(
                f"a record must hold at least 2 whole periods of {period_s:g} s without gaps after the {drop} dropped, "
                f"got {len(kept)}; record longer, or use windowed spectra"
            )
        Z = np.fft.rfft(np.stack([z[i * samples : (i + 1) * samples] for i in kept]), axis=1) / samples
        out.append(_Experiment(np.asarray(Z, np.complex128), samples))
    return out, np.asarray(2.0 * np.pi * np.fft.rfftfreq(samples, dt), np.float64)


def _lines(lines_hz: Sequence[float], period_s: float, size: int) -> NDArray[np.intp]:
    lines = np.asarray(lines_hz, np.float64) * period_s
    whole = np.unique(np.round(lines).astype(np.intp))
    if np.any(np.abs(lines - np.round(lines)) > 1e-4) or np.any(whole < 1) or np.any(whole >= size):
        raise EstimationError(
            f"lines_hz must be multiples of 1/period = {1.0 / period_s:g} Hz between it and the Nyquist frequency, got "
            f"{', '.join(f'{f:g}' for f in lines_hz)}"
        )
    return whole


def _excited(experiments: list[_Experiment], m: int) -> NDArray[np.bool_]:
    """Return which lines (f, m) each input excites in any record; the mean and the Nyquist line never count."""
    out = np.zeros((experiments[0].Z.shape[1], m), bool)
    for Z, samples in experiments:
        U = Z[:, :, :m]
        size = np.abs(U.mean(axis=0))
        noise = np.sqrt(np.var(U, axis=0, ddof=1) / len(U))
        size[0] = 0.0
        if samples % 2 == 0:
            size[-1] = 0.0
        out |= (size > _EXCITED * size.max(axis=0)) & (size > _STANDS_OUT * noise)
    return out


def _at_lines(
    experiments: list[_Experiment], at: _Lines, inputs: tuple[str, ...], outputs: tuple[str, ...], dt_s: float
) -> FrequencyResponse:
    """Return the response at the excited lines."""
    omega, lines, used, _ = at
    m, p = len(inputs), len(outputs)
    U = np.stack([e.Z[:, lines][:, :, used].mean(axis=0) for e in experiments], axis=1)  # (k, E, m)
    Y = np.stack([e.Z[:, lines, -p:].mean(axis=0) for e in experiments], axis=1)  # (k, E, p)
    size = np.sqrt(np.mean(np.abs(U) ** 2, axis=(0, 1)))
    s = np.linalg.svd(U / size, compute_uv=False)
    if len(experiments) < m or np.any(s[:, -1] < _RANK * s[:, 0]):
        raise EstimationError(
            f"{m} inputs at the same lines need {m} or more records whose phases tell them apart, got "
            f"{len(experiments)}; fly them one after the other, or on lines of their own (interleaved)"
        )
    G = np.linalg.pinv(U / size) / size[:, None]  # (k, m, E)
    H = np.transpose(G @ Y, (0, 2, 1))  # (k, p, m)
    V = Y - U @ np.transpose(H, (0, 2, 1))
    scatter = np.empty(V.shape)  # E|dV|^2 of each record's average
    for i, e in enumerate(experiments):
        error = e.Z[:, lines, -p:] - np.einsum("kpm,lkm->lkp", H, e.Z[:, lines][:, :, used])
        scatter[:, i] = np.var(error, axis=0, ddof=1) / len(e.Z)
    gain = np.abs(G) ** 2
    noise = np.einsum("kme,kep->kpm", gain, scatter)
    distortion, source, found = _distortion(experiments, at, U, V, scatter, H)
    bent = None if distortion is None else np.einsum("kme,kp->kpm", gain, distortion)
    total = noise if bent is None else noise + bent
    periods = np.array([len(e.Z) for e in experiments])
    explained = np.mean(np.abs(Y - V) ** 2, axis=1)
    single = np.mean(scatter * periods[:, None], axis=1)  # noise power of one period
    alone = 1.0 / np.maximum(np.sum(gain, axis=2), 1e-300) / len(experiments)
    part = np.abs(H) ** 2 * alone[:, None, :]
    floor = np.finfo(float).tiny
    advice = _advice(experiments, lines, outputs, bent, noise, H)
    return FrequencyResponse(
        omega_rad_s=omega[lines],
        H=H,
        coherence=explained / np.maximum(explained + single, floor),
        partial_coherence=part / np.maximum(part + single[:, :, None], floor),
        random_error=np.sqrt(0.5 * total) / np.maximum(np.abs(H), floor),
        averages=np.full(lines.size, float(periods.sum())),
        resolution_rad_s=np.full(lines.size, omega[1]),
        noise_variance=noise,
        distortion_variance=bent,
        inputs=inputs,
        outputs=outputs,
        dt_s=dt_s,
        method="multisine",
        diagnostics={
            "distortion_source": source,
            "periods": periods.tolist(),
            "interval_factor": interval_factor(2.0 * float(np.sum(periods - 1))),
            **{key: dict(zip(outputs, values, strict=True)) for key, values in found.items()},
        },
        advice=advice,
    )


def _distortion(
    experiments: list[_Experiment],
    at: _Lines,
    U: ComplexArray,
    V: ComplexArray,
    scatter: FloatArray,
    H: ComplexArray,
) -> tuple[FloatArray | None, str, dict[str, list[Any]]]:
    """Return the distortion's power in the outputs of one record at the excited lines (k, p), and where it comes from.

    Records with other phases come first: they show the distortion at the excited lines themselves.
    """
    count, m, p = len(experiments), U.shape[2], V.shape[2]
    found, levels = _detection(experiments, at, H, p)
    if _realisations(U) == count and count > m:
        spread = np.sum(np.abs(V) ** 2, axis=1) / (count - m)
        return np.maximum(spread - scatter.mean(axis=1), 0.0), "realisations", found
    if levels is not None:
        return levels, "detection lines", found
    return None, "not separable", found


def _realisations(U: ComplexArray) -> int:
    """Return how many records of the averaged inputs U (k, E, m) have phases of their own."""
    kept: list[int] = []
    for e in range(U.shape[1]):
        turned = [np.angle(U[:, e] * np.conj(U[:, other])) for other in kept]
        if all(np.sqrt(np.mean(turn**2)) > _OTHER_PHASES for turn in turned):
            kept.append(e)
    return len(kept)


def _detection(
    experiments: list[_Experiment], at: _Lines, H: ComplexArray, p: int
) -> tuple[dict[str, list[Any]], FloatArray | None]:
    """Return the distortion at lines that are not excited, and its level (k, p) at those that are.

    What little of the input reaches these lines is taken off with H interpolated.
    """
    omega, lines, used, others = at
    taken = lines if others is None else np.union1d(lines, others)
    quiet = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), taken)
    found: dict[str, list[Any]] = {"odd_distortion": [], "even_distortion": []}
    if quiet.size < 3:
        return {key: [[]] * p for key in found}, None
    between = np.empty((quiet.size, *H.shape[1:]), np.complex128)
    for i, j in np.ndindex(*H.shape[1:]):
        between[:, i, j] = np.interp(quiet, lines, H[:, i, j])
    power = np.zeros((quiet.size, p))
    for Z, _ in experiments:
        D = Z[:, quiet, -p:] - np.einsum("kpm,lkm->lkp", between, Z[:, quiet][:, :, used])
        power += (np.abs(D.mean(axis=0)) ** 2 - np.var(D, axis=0, ddof=1) / len(D)) / len(experiments)
    levels = np.zeros((lines.size, p))
    for i in range(p):
        smooth = {}
        for key, odd in (("odd_distortion", 1), ("even_distortion", 0)):
            rows = quiet % 2 == odd
            found[key].append((omega[quiet[rows]].tolist(), power[rows, i].tolist()))
            if rows.any():
                width = min(_NEIGHBOURS, int(rows.sum()))
                mean = np.convolve(power[rows, i], np.ones(width) / width, mode="valid")
                centre = np.convolve(quiet[rows], np.ones(width) / width, mode="valid")
                smooth[odd] = np.maximum(np.interp(lines, centre, mean), 0.0)
        for odd in (0, 1):
            rows = lines % 2 == odd
            levels[rows, i] = smooth.get(odd, smooth.get(1 - odd, np.zeros(lines.size)))[rows]
    return found, levels


def _advice(
    experiments: list[_Experiment],
    lines: NDArray[np.intp],
    outputs: tuple[str, ...],
    bent: FloatArray | None,
    noise: FloatArray,
    H: ComplexArray,
) -> tuple[Advice, ...]:
    out = []
    for i, name in enumerate(outputs):
        worst = 0.0
        for Z, _ in experiments:
            Y = Z[:, lines, len(Z[0, 0]) - len(outputs) + i]
            if len(Y) >= 3:
                rest = Y[1:]
                expected = np.sum(np.var(rest, axis=0, ddof=1)) * (1.0 + 1.0 / len(rest))
                got = np.sum(np.abs(Y[0] - rest.mean(axis=0)) ** 2)
                if got > 1e-16 * np.sum(np.abs(Y) ** 2):
                    worst = max(worst, float(got / max(expected, 1e-300)))
        if worst > _TRANSIENT:
            out.append(
                doubt(
                    "transient",
                    f"{name}: the first period that was used differs from the others by {worst:.0f} times their "
                    "noise power: the transient has not decayed; raise drop_periods",
                )
            )
        if bent is not None and np.sum(bent[:, i]) > 10.0 * np.sum(noise[:, i]):
            share = np.sqrt(np.sum(bent[:, i]) / np.sum(np.abs(H[:, i]) ** 2))
            if share > 1e-3:
                said = (
                    f"{name}: nonlinear distortion ({100.0 * share:.1f} % of the response) exceeds the noise: H is the "
                    "best linear approximation at this amplitude; more periods do not help, but other phases do"
                )
                out.append((doubt if share > _BENT else note)("distortion", said))
    return (*out, *approximate("frequency response, multisine"))
