"""Multisines: sums of harmonics of one period, with phases that make the peak small.

M. R. Schroeder, IEEE Trans. Information Theory 16, 1970; several controls at once with orthogonal ones: E. A. Morelli,
Journal of Aircraft 49(1), 2012.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from testbench.core.door import NUMBER, require_room
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Multisine
from testbench.inputs.multistep import end_fault, sample_count

SAMPLES_PER_CYCLE = 10
"""The least number of samples per cycle of the highest harmonic, as for the sweep."""
_HARMONIC = 1000  # bytes of a harmonic while its phase is sought
_OVERSAMPLING = 16  # grid points per cycle of the highest harmonic on which the peak is minimised
_DOUBLINGS = (2, 3, 4, 5, 6)  # the norms that approach the peak have the exponents 2 ** (1 + doublings)


def harmonics(spec: Multisine) -> tuple[int, ...]:
    """Return the numbers of the harmonics of ``1 / period_s`` that the multisine holds.

    Raises:
        ScenarioError: no harmonic lies between ``f_min_hz`` and ``f_max_hz``, or ``powers`` has another length.
    """
    require_room(
        f"a multisine of {spec.f_max_hz * spec.period_s:g} harmonics",
        _HARMONIC * spec.f_max_hz * spec.period_s / spec.stride,
        "shorten its period or lower f_max_hz",
    )
    low = int(np.ceil(spec.f_min_hz * spec.period_s - 1e-9))
    high = int(np.floor(spec.f_max_hz * spec.period_s + 1e-9))
    numbers = tuple(range(max(low, 1), high + 1))[spec.first :: spec.stride]
    if not numbers:
        raise ScenarioError(
            f"a multisine needs a harmonic of 1 / period_s = {1.0 / spec.period_s:g} Hz from f_min_hz to f_max_hz, "
            f"got {spec.f_min_hz:g} to {spec.f_max_hz:g} Hz with first = {spec.first}, stride = {spec.stride}; "
            "widen the band or lengthen the period"
        )
    if spec.powers and len(spec.powers) != len(numbers):
        raise ScenarioError(
            f"powers must have one entry per harmonic, {len(numbers)}, got {len(spec.powers)}; "
            "leave it out for equal power"
        )
    if spec.powers and not any(spec.powers):
        raise ScenarioError("at least one entry of powers must be above zero, got none")
    return numbers


@lru_cache(maxsize=256)
def phases(numbers: tuple[int, ...], powers: tuple[float, ...] = ()) -> FloatArray:
    """Return phases (k,) of the harmonics that make the relative peak factor small, starting and ending at zero.

    From Schroeder's phases, the 2n-norm of sum sqrt(2 P_k) cos(k t + phase_k) is minimised for n = 2, 4, ... in turn
    (P. Guillaume et al., IEEE Trans. Instrumentation and Measurement 40(6), 1991); the whole is then shifted in time
    to a zero crossing.
    """
    from scipy.optimize import minimize

    k = np.array(numbers)
    P = np.array(powers) if powers else np.ones(k.size)
    P = P / P.sum()
    amplitude = np.sqrt(2.0 * P)
    start = -2.0 * np.pi * np.array([np.sum((j - np.arange(j)) * P[:j]) for j in range(k.size)])
    points = int(2 ** np.ceil(np.log2(_OVERSAMPLING * k[-1])))

    def wave(phase: FloatArray) -> FloatArray:
        spectrum = np.zeros(points // 2 + 1, complex)
        spectrum[k] = 0.5 * points * amplitude * np.exp(1j * phase)
        return np.fft.irfft(spectrum, points)

    def norm(phase: FloatArray, doublings: int) -> tuple[float, FloatArray]:
        x = wave(phase)
        peak = np.abs(x).max()
        ratio = x / peak
        # With n = 2 ** doublings, ratio ** (2 n - 1) = ratio ratio^2 ratio^4 ... : np.power takes ten times as long.
        odd, square = ratio.copy(), ratio * ratio
        for _ in range(doublings):
            odd *= square
            square *= square
        mean = np.mean(square)
        value = peak * mean ** (0.5 / 2**doublings)
        # d value / d x_i, then back through x = sum a cos(k t + phase) by one transform
        slope = value / (mean * points * peak) * odd
        transform = np.fft.rfft(slope)[k]
        return float(value), np.asarray(amplitude * (np.conj(transform) * 1j * np.exp(1j * phase)).real)

    best = start
    if k.size > 1:
        phase = start
        for doublings in _DOUBLINGS:
            phase = minimize(norm, phase, args=(doublings,), jac=True, method="L-BFGS-B", options={"maxiter": 200}).x
            if np.ptp(wave(phase)) < np.ptp(wave(best)):
                best = phase
    out = np.asarray(best + k * _zero_crossing(k, amplitude, best, wave(best)))
    out.setflags(write=False)
    return out


def _zero_crossing(k: np.ndarray, amplitude: FloatArray, phase: FloatArray, x: FloatArray) -> float:
    """Return the angle 0 <= t < 2 pi of the upward zero crossing where the wave is least steep."""
    from scipy.optimize import brentq

    def value(t: float) -> float:
        return float(amplitude @ np.cos(k * t + phase))

    up = np.flatnonzero((x <= 0.0) & (np.roll(x, -1) > 0.0))
    step = 2.0 * np.pi / x.size
    gentle = up[np.argmin(np.roll(x, -1)[up] - x[up])]
    return float(brentq(value, gentle * step, (gentle + 1) * step, xtol=1e-14))


def multisine(spec: Multisine, duration_s: float, rate_hz: float) -> FloatArray:
    """Return ``periods`` periods of the multisine, peak amplitude as given; (n,), unit of the amplitude in SI.

    Raises:
        ScenarioError: a law of :func:`harmonics`, a period that is no whole number of samples, a harmonic above a
            tenth of the rate, or an end after the manoeuvre.
    """
    faults = []
    per_period = spec.period_s * rate_hz
    if abs(per_period - round(per_period)) > 1e-6 * per_period:
        faults.append(
            f"period_s must be a whole number of samples at {rate_hz:g} Hz, so that its lines stay lines, got "
            f"{spec.period_s:g} s = {per_period:g} samples; take {round(per_period) / rate_hz:.6g} s"
        )
    if spec.f_max_hz > rate_hz / SAMPLES_PER_CYCLE * (1.0 + 1e-9):
        faults.append(
            f"f_max_hz <= rate / {SAMPLES_PER_CYCLE} = {rate_hz / SAMPLES_PER_CYCLE:g} Hz must hold for a held "
            f"multisine, got {spec.f_max_hz:g} Hz at {rate_hz:g} Hz; lower it or simulate faster"
        )
    end = spec.start_s + spec.periods * spec.period_s
    if end > duration_s + 1e-6 / rate_hz:
        faults.append(end_fault(end, duration_s))
    if faults:
        raise ScenarioError(faults)
    numbers = harmonics(spec)
    require_room(
        f"a period of {per_period:g} samples with {len(numbers)} harmonics",
        NUMBER * per_period * len(numbers),
        "shorten it or lower f_max_hz",
    )
    k = np.array(numbers)
    P = np.array(spec.powers) if spec.powers else np.ones(k.size)
    t = np.arange(round(per_period)) / per_period * 2.0 * np.pi
    period = np.cos(np.outer(t, k) + phases(numbers, spec.powers)) @ np.sqrt(P)
    period *= spec.amplitude / np.abs(period).max()
    u = np.zeros(sample_count(duration_s, rate_hz))
    first = sample_count(spec.start_s, rate_hz)
    part = np.tile(period, spec.periods)[: u.size - first]
    u[first : first + part.size] = part
    return u
