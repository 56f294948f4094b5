"""The frequency sweep: a sine whose frequency rises over time, linearly or exponentially."""

from __future__ import annotations

from typing import Literal

import numpy as np

from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Sweep
from testbench.inputs.multistep import end_fault, sample_count

SAMPLES_PER_CYCLE = 10
"""The least number of samples per cycle: held, such a sine keeps sinc(1/10) = 98 % of its amplitude."""


def swept_sine(
    tau_s: FloatArray,
    f_start_hz: float,
    f_end_hz: float,
    sweep_s: float,
    spacing: Literal["linear", "exponential"] = "exponential",
    fade_s: float = 0.0,
) -> FloatArray:
    """Return the sweep of unit amplitude at the times ``tau_s`` since its start; zero outside 0 <= tau < T.

    sin(phi(tau)) with dphi/dtau = 2 pi f(tau), phi(0) = 0, T = ``sweep_s``:

    - linear: f = f0 + (f1 - f0) tau / T; the energy per Hz is flat.
    - exponential: f = f0 (f1 / f0)^(tau / T); the energy per octave is flat, slow modes get their time.

    Args:
        tau_s: (n,) times, s.
        f_start_hz: f0, Hz.
        f_end_hz: f1 > f0, Hz.
        sweep_s: duration T, s.
        spacing: law of the frequency.
        fade_s: rise and fall of the amplitude, (1 - cos(pi tau / fade)) / 2, at either end; without it the sweep
            ends wherever its phase is, with a jump to zero.

    Raises:
        ScenarioError: not 0 < f0 < f1, or not 0 <= 2 ``fade_s`` <= ``sweep_s``.
    """
    faults = []
    if not 0.0 < f_start_hz < f_end_hz:
        faults.append(f"0 < f_start_hz < f_end_hz must hold for a sweep, got {f_start_hz:g} and {f_end_hz:g} Hz")
    if not 0.0 <= 2.0 * fade_s <= sweep_s:
        faults.append(f"0 <= fade_s <= sweep_s / 2 must hold for a sweep, got {fade_s:g} and {sweep_s / 2.0:g} s")
    if faults:
        raise ScenarioError(faults)
    tau = np.asarray(tau_s, float)
    inside = (tau >= 0.0) & (tau < sweep_s)
    at = tau[inside]
    if spacing == "linear":
        phase = 2.0 * np.pi * (f_start_hz * at + (f_end_hz - f_start_hz) * at**2 / (2.0 * sweep_s))
    else:
        octaves = np.log(f_end_hz / f_start_hz)
        phase = 2.0 * np.pi * f_start_hz * sweep_s / octaves * np.expm1(octaves * at / sweep_s)
    value = np.sin(phase)
    if fade_s > 0.0:
        from_end = np.minimum(at, sweep_s - at)
        value *= 0.5 * (1.0 - np.cos(np.pi * np.minimum(from_end / fade_s, 1.0)))
    u = np.zeros(tau.shape)
    u[inside] = value
    return u


def sweep(spec: Sweep, duration_s: float, rate_hz: float) -> FloatArray:
    """Return the sweep of a scenario, sampled at k / rate and held; (n,), unit of the amplitude in SI.

    The law f_end <= rate / 10 keeps the held sine faithful: at the end of the sweep its fundamental has lost no more
    than 2 % of its amplitude and lags half a sample. The held signal is what the aircraft is flown with, so neither is
    an error of the record.

    Raises:
        ScenarioError: f_end is above a tenth of the rate, the frequencies do not rise, or it ends after the manoeuvre.
    """
    faults = []
    if spec.f_end_hz > rate_hz / SAMPLES_PER_CYCLE * (1.0 + 1e-9):
        faults.append(
            f"f_end_hz <= rate / {SAMPLES_PER_CYCLE} = {rate_hz / SAMPLES_PER_CYCLE:g} Hz must hold for a held sweep, "
            f"got {spec.f_end_hz:g} Hz at {rate_hz:g} Hz; lower it or simulate at "
            f"{SAMPLES_PER_CYCLE * spec.f_end_hz:g} Hz or more"
        )
    end = spec.start_s + spec.sweep_s
    if end > duration_s + 1e-6 / rate_hz:
        faults.append(end_fault(end, duration_s))
    # A sweep that starts and ends on samples must not gain one to the last digit of k / rate - start.
    tau = np.round((np.arange(sample_count(duration_s, rate_hz)) - spec.start_s * rate_hz), 9) / rate_hz
    try:
        unit = swept_sine(tau, spec.f_start_hz, spec.f_end_hz, spec.sweep_s, spec.spacing, spec.fade_s)
    except ScenarioError as error:
        faults.extend(error.faults)
    if faults:
        raise ScenarioError(faults)
    return spec.amplitude * unit
