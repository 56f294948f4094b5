"""How large is the noise really? Nobody knows that of a logger to the 2 % at which chi-square tells a gap from none.

The noise is what no motion does: its scales are estimated beside re-tuned coefficients, an unknown motion of free size
and a slow drift of every instrument (:mod:`testbench.inference.linear`), so that what the model lacks does not count
as noise. The suite with these scales takes the place of the one that was stated.

Nor is it white: filters and averages of a logger let a sample depend on the one before. The noise of a channel is an
autoregressive process of first order. Its coefficient a, the colour, comes to rest where the prewhitened noise e that
is expected beside all else is white, sum E[e_t e_(t-1)] = 0 (the expectation of R. H. Shumway and D. S. Stoffer, An
approach to time series smoothing and forecasting using the EM algorithm, 1982).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.linear import Grams, Linearised, expected, fewer, prewhitened, sized
from testbench.inference.parameters import NOISE_SPREAD, Source
from testbench.inference.unknown import pulses
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.search.point import Point
from testbench.sensors import SensorSuite

_KAPPAS: tuple[float, ...] = (1e-4, 1e-3, 1e-2, 0.1, 1.0)
_DRIFT_S = 1.0  # between the knots of an instrument's drift: slower than any noise, quicker than any wander
_SURE = 3.0  # standard errors by which a scale differs from 1 before it is spoken of, a colour from 0 before it is one
_COLOURED = 0.1  # of a sample's variance comes a hundredth from the one before: less is not spoken of
_MOST = 0.95  # colour: beyond it noise is a drift
_PRIORS = 2.0  # prior standard deviations of a scale: beyond, gusts count as noise, and the colour is theirs
_ROUNDS = 6
_AT_REST = 0.01  # of the colour


@dataclass(frozen=True)
class NoiseFound:
    """Noise as the records show it."""

    scales: Mapping[str, tuple[float, float]]  # channel -> (true over stated standard deviation, standard error)
    # channel -> correlation from sample to sample; 0 of those that it does not name
    colour: Mapping[str, float] = field(default_factory=dict)

    def corrects(self, believed: Believed) -> Believed:
        """Return the belief with the noise that was found."""
        return replace(believed, suite=self.corrected(believed.suite), colour=self.colour)

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
        """Return whether another estimate has a channel that differs by more than the errors of both.

        Scales that differ by less than the prior of noise that was measured leaves open are found beside every
        hypothesis.
        """
        if any(abs(self.colour.get(n, 0.0) - other.colour.get(n, 0.0)) > _COLOURED for n in self.scales):
            return True
        return any(
            abs(math.log(other.scales[n][0] / s))
            > max(NOISE_SPREAD["measured"], _SURE * math.hypot(e / s, other.scales[n][1] / other.scales[n][0]))
            for n, (s, e) in self.scales.items()
        )

    @property
    def sentence(self) -> str:
        """What differs from what is stated, in words; empty if nothing does."""
        coloured = {n: a for n, a in self.colour.items() if abs(a) > _COLOURED}
        told = ", ".join(f"{n} {a:.2f}" for n, a in coloured.items())
        correlated = f"the noise is correlated from sample to sample ({told})" if told else ""
        off, scaled = {n: s for n, (s, e) in self.scales.items() if abs(math.log(s)) > _SURE * e / s}, ""
        if off:
            values, errors = np.array([self.scales[n] for n in off]).T
            mean = float(np.exp(np.mean(np.log(values))))
            scaled = f"differs from the stated noise by factors of {', '.join(f'{n} {s:.2f}' for n, s in off.items())}"
            if len(off) == len(self.scales) and np.all(np.abs(np.log(values / mean)) < _SURE * errors / values):
                scaled = f"of every channel is {mean:.2f} times the stated noise"
            scaled = f"the noise {scaled}; the estimated noise is used"
        return "; ".join(x for x in (scaled, correlated) if x)


def find_noise(
    believed: Believed, records: Sequence[FlightRecord], source: Source = "stated", model: Believed | None = None
) -> NoiseFound:
    """Return the noise of the channels that are compared, as measured records show it.

    ``source`` is that of the stated noise; ``model`` is the believed aircraft with an effect, if one was found.
    """
    point = Point.at(believed, model or believed, tuple(records))
    parts = []
    for record, left, tangents in zip(
        records, point.by_record(point.exact), point.by_record(point.tangents), strict=True
    ):
        there = believed.at(record)
        unknown = [pulses(there.linear, believed.outputs, there.condition.V_m_s, record), _drifts(believed, record)]
        taken = believed.taken(record)
        U = np.concatenate(unknown, axis=2) / believed.noise_std[:, None]
        U -= np.where(taken[:, :, None], U, 0.0).sum(axis=0) / np.maximum(taken.sum(axis=0), 1)[:, None]
        parts.append((left, -tangents, fewer(U, taken), taken))
    p, std = len(believed.outputs), point.prior_std
    colour, spread, mean = np.zeros(p), np.full(p, NOISE_SPREAD[source]), -point.deviations * std
    count = np.sum([taken.sum(axis=0) for *_, taken in parts], axis=0)
    kappas, begin = _KAPPAS, None
    for _ in range(_ROUNDS):
        blocks = [
            Linearised(
                prewhitened(left, colour, taken), prewhitened(T, colour, taken), U.prewhitened(colour, taken), taken
            )
            for left, T, U, taken in parts
        ]
        grams, tried = [Grams.made(block) for block in blocks], []
        for kappa in kappas:  # beside the unknown motion whose size is most probable
            tried.append((sized(grams, mean, std, spread, kappa, begin), kappa))
            begin = tried[-1][0].scales
        best, kappa = max(tried, key=lambda one: one[0].log_density)
        kappas, begin = (kappa,), best.scales
        products, squares = np.zeros(p), np.zeros(p)
        for block, (found, Sigma) in zip(blocks, expected(grams, begin, kappa, mean, std), strict=True):
            r = len(found) - block.columns.shape[2]
            for c in range(p):
                Z = np.concatenate([block.columns[:, c], block.unknown.response[c, :, :r]], axis=1)
                counts = block.taken[:, c]
                Z = np.where(counts[:, None], Z, 0.0)
                e, spreads = np.where(counts, block.residual[:, c] - Z @ found, 0.0), Z @ Sigma
                squares[c] += e @ e + np.sum(spreads * Z)
                products[c] += e[1:] @ e[:-1] + np.sum(spreads[1:] * Z[:-1])
        correlation, before = products / np.maximum(squares, 1e-12), colour
        colour = np.clip(colour + (1.0 - colour**2) * correlation, -_MOST, _MOST)
        likely = np.abs(np.log(begin)) <= _PRIORS * spread  # what is far more than the noise moves
        colour = np.where(likely & (np.abs(colour) * np.sqrt(count) > _SURE), colour, 0.0)
        if np.max(np.abs(colour - before)) < _AT_REST:
            break
    each = zip(believed.outputs, best.scales.tolist(), (best.scales * best.log_errors).tolist(), strict=True)
    known = {n: float(a) for n, a in zip(believed.outputs, colour, strict=True) if a}
    return NoiseFound({n: (s, e) for n, s, e in each}, known)


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
