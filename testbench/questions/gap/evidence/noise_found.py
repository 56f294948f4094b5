"""How large is the noise really? Nobody knows that of a logger to the 2 % at which chi-square tells a gap from none.

The noise is what no motion does: its scales are estimated beside re-tuned coefficients, an unknown motion of free size
and a slow drift of every instrument (:mod:`testbench.inference.linear`), so that what the model lacks does not count
as noise. The suite with these scales takes the place of the one that was stated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.linear import Grams, Linearised, fewer, sized
from testbench.inference.parameters import NOISE_SPREAD, Source
from testbench.inference.unknown import pulses
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.sensors import SensorSuite

_KAPPAS = (1e-4, 1e-3, 1e-2, 0.1, 1.0)
_DRIFT_S = 1.0  # between the knots of an instrument's drift: slower than any noise, quicker than any wander
_SURE = 3.0  # standard errors by which a scale differs from 1 before it is spoken of


@dataclass(frozen=True)
class NoiseFound:
    """Noise as the records show it: channel -> (true over stated standard deviation, standard error)."""

    scales: Mapping[str, tuple[float, float]]

    def corrected(self, suite: SensorSuite) -> SensorSuite:
        """Return a suite with the noise that was found; the quantisation of a sensor stays."""
        sensors = []
        for sensor in suite.sensors:
            scale = self.scales.get(sensor.channel, (1.0, 0.0))[0]
            quantised = sensor.quantum**2 / 12.0
            square = scale**2 * (sensor.noise_std**2 + quantised) - quantised
            sensors.append(replace(sensor, noise_std=math.sqrt(max(square, (0.01 * sensor.noise_std) ** 2))))
        return replace(suite, sensors=tuple(sensors))

    def differs(self, other: NoiseFound) -> bool:
        """Return whether another estimate has a channel that differs by more than the errors of both."""
        return any(
            abs(math.log(other.scales[n][0] / s)) > _SURE * math.hypot(e / s, other.scales[n][1] / other.scales[n][0])
            for n, (s, e) in self.scales.items()
        )

    @property
    def sentence(self) -> str:
        """What differs from what is stated, in words; empty if nothing does."""
        off = {n: s for n, (s, e) in self.scales.items() if abs(math.log(s)) > _SURE * e / s}
        if not off:
            return ""
        values, errors = np.array([self.scales[n] for n in off]).T
        mean = float(np.exp(np.mean(np.log(values))))
        if len(off) == len(self.scales) and np.all(np.abs(np.log(values / mean)) < _SURE * errors / values):
            return f"the noise of every channel is {mean:.2f} times what is stated; it is judged by what was found"
        told = ", ".join(f"{n} {s:.2f}" for n, s in off.items())
        return f"the noise differs from what is stated, times {told}; the records are judged by what was found"


def find_noise(
    believed: Believed,
    records: Sequence[FlightRecord],
    source: Source = "stated",
    model: Believed | None = None,
) -> NoiseFound:
    """Return the noise of the channels that are compared, as measured records show it.

    Args:
        believed: in still air.
        records: that a gap is named from.
        source: where the stated noise comes from; noise that was simulated here is taken as stated.
        model: the believed aircraft with an effect, if one was found; ``believed`` if not given.

    Raises:
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the commands.
    """
    point = Hypothesis.at(believed, model or believed, tuple(records))
    p = len(believed.outputs)
    grams = []
    for record, left, tangents in zip(
        records, point.by_record(point.exact), point.by_record(point.tangents), strict=True
    ):
        there = believed.at(record)
        unknown = [pulses(there.linear, believed.outputs, there.condition.V_m_s, record), _drifts(believed, record)]
        taken = believed.taken(record)
        U = np.concatenate(unknown, axis=2) / believed.noise_std[:, None]
        U -= np.where(taken[:, :, None], U, 0.0).sum(axis=0) / np.maximum(taken.sum(axis=0), 1)[:, None]
        grams.append(Grams.made(Linearised(left, -tangents, fewer(U, taken), taken)))
    spread = np.full(p, NOISE_SPREAD[source])
    mean, begin = -point.deviations * point.prior_std, None
    best = None
    for kappa in _KAPPAS:
        found = sized(grams, mean, point.prior_std, spread, kappa, begin)
        begin = found.scales
        if best is None or found.log_density > best.log_density:
            best = found
    assert best is not None
    errors = best.scales * best.log_errors
    return NoiseFound(dict(zip(believed.outputs, zip(best.scales.tolist(), errors.tolist(), strict=True), strict=True)))


def _drifts(believed: Believed, record: FlightRecord) -> FloatArray:
    """Return slow drifts of sensors (n, p, p knots): hats a second apart, as high as the channel's own motion."""
    t = record.t_s - record.t_s[0]
    knots = np.arange(0.0, t[-1] + _DRIFT_S, _DRIFT_S)
    hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - knots) / _DRIFT_S)
    out = np.zeros((len(t), len(believed.outputs), len(believed.outputs) * len(knots)))
    for i, name in enumerate(believed.outputs):
        values = record[name]
        out[:, i, i * len(knots) : (i + 1) * len(knots)] = float(np.nanstd(values)) * hats
    return out
