"""How large is the noise really? Nobody knows that of a logger to the 2 % at which chi-square tells a gap from none.

The noise is what no motion does: its scales are estimated beside re-tuned coefficients, an unknown motion of free size,
turbulence and a slow drift of every instrument (:mod:`testbench.inference.linear`), so that neither what the model
lacks nor a gust counts as noise. The suite with these scales takes the place of the one that was stated.

Nor is it white: filters and averages of a logger let a sample depend on the one before. The noise of a channel is an
autoregressive process of first order. Its coefficient a, the colour, comes to rest where the prewhitened noise e that
is expected beside all else is white, sum E[e_t e_(t-1)] = 0 (the expectation of R. H. Shumway and D. S. Stoffer, An
approach to time series smoothing and forecasting using the EM algorithm, 1982).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.air import LOWEST_M
from testbench.inference.linear import Grams, Linearised, expected, fewer, prewhitened, sized
from testbench.inference.parameters import NOISE_SPREAD, Source
from testbench.inference.unknown import deflections, pulses
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import listen
from testbench.questions.gap.evidence.gust_filter import COMPONENT, FORMING, GustModel
from testbench.questions.gap.search.point import Point, retune
from testbench.sensors import SensorSuite

_KAPPAS: tuple[float, ...] = (1e-3, 1e-2, 0.03, 0.1, 0.3)
_PART_S = 1.5  # of a record
_MOST_PARTS = 16  # of all records, which tell a scale to 2 %: better than any source of it
_GUST_SHARE = 0.5  # between changes of the gust, of the time constant of the quickest motion
_RMS_M_S = 1.0  # of turbulence, to begin with, where no quiet flight shows it: of less, colour would take what is left
_FINER = 2.0  # steps of the size of an unknown motion, once it is about right
_DRIFT_S = 1.0  # between the knots of an instrument's drift: slower than any noise, quicker than any wander
_SURE = 3.0  # standard errors by which a scale differs from 1 before it is spoken of, a colour from 0 before it is one
_COLOURED = 0.1  # of a sample's variance comes a hundredth from the one before: less is not spoken of
_MOST = 0.95  # colour: beyond it noise is a drift
_PRIORS = 2.0  # prior standard deviations of a scale: beyond, a motion counts as noise, and the colour is its own
_ROUNDS = 15
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
    point = retune(Point.at(believed, model or believed, tuple(records)))
    tuned = point.model.with_nuisances(point.by_name)
    of, lefts, columns = [], point.by_record(point.exact), point.by_record(-point.tangents)
    every = [(i, part) for i, record in enumerate(records) for part in _parts(record)]
    heard = listen(believed, records)
    stirred = heard.moves or not heard.quiet_s  # quiet flight, where there is any, tells best whether there are gusts
    unknown = [_Unknown(tuned, record, stirred) for record in records]
    for i, at in [every[k] for k in np.unique(np.linspace(0, len(every) - 1, _MOST_PARTS).round().astype(int))]:
        taken = believed.taken(records[i])[at]
        of.append((lefts[i][at], columns[i][at], fewer(unknown[i].within(at), taken), *unknown[i].own(at), taken))
    p, std = len(believed.outputs), point.prior_std
    colour, spread, mean = np.zeros(p), np.full(p, NOISE_SPREAD[source]), -point.deviations * std
    count = np.sum([taken.sum(axis=0) for *_, taken in of], axis=0)
    kappas, begin, white = _KAPPAS, None, np.zeros(p, dtype=bool)
    rms = np.full(3, heard.rms_m_s if heard.moves else _RMS_M_S)
    for _ in range(_ROUNDS):
        blocks = []
        for left, T, U, starts, gusts, taken in of:
            own = np.concatenate([starts, rms[_component_of(gusts)] * gusts], axis=2)
            y, X, own = (prewhitened(values, colour, taken) for values in (left, T, own))
            blocks.append(Linearised(y, X, U.prewhitened(colour, taken), taken, own))
        grams, tried = [Grams.made(block) for block in blocks], []
        for kappa in kappas:  # beside the unknown motion whose size is most probable
            tried.append((sized(grams, mean, std, spread, kappa, begin), kappa))
            begin = tried[-1][0].scales
        best, kappa = max(tried, key=lambda one: one[0].log_density)
        rests = kappas is not _KAPPAS and kappa not in (kappas[0], kappas[-1])
        kappas, begin = (kappa,) if rests else (kappa / _FINER, kappa, kappa * _FINER), best.scales
        products, squares, gust, told = np.zeros(p), np.zeros(p), np.zeros(3), np.zeros(3)
        around = zip(blocks, of, expected(grams, begin, kappa, mean, std), strict=True)
        for block, (*_, starts, gusts, _), (found, Sigma) in around:
            k, q = block.columns.shape[2], block.all_own.shape[2]
            met = slice(k + starts.shape[2], k + q)
            np.add.at(gust, _component_of(gusts), found[met] ** 2)
            np.add.at(told, _component_of(gusts), 1.0 - np.diag(Sigma)[met])
            for c in range(p):
                moved = block.unknown.response[c, :, : len(found) - k - q]
                Z = np.concatenate([block.columns[:, c], block.all_own[:, c], moved], axis=1)
                counts = block.taken[:, c]
                Z = np.where(counts[:, None], Z, 0.0)
                e, spreads = np.where(counts, block.residual[:, c] - Z @ found, 0.0), Z @ Sigma
                squares[c] += e @ e + np.sum(spreads * Z)
                products[c] += e[1:] @ e[:-1] + np.sum(spreads[1:] * Z[:-1])
        correlation, before = products / np.maximum(squares, 1e-12), colour
        colour = np.clip(colour + (1.0 - colour**2) * correlation, -_MOST, _MOST)
        white |= np.log(begin) > _PRIORS * spread
        colour = np.where(~white & (np.abs(colour) * np.sqrt(count) > _SURE), colour, 0.0)
        rms = rms * np.sqrt(gust / np.maximum(told, 1e-12))
        if np.max(np.abs(colour - before)) < _AT_REST:
            break
    each = zip(believed.outputs, best.scales.tolist(), (best.scales * best.log_errors).tolist(), strict=True)
    known = {n: float(a) for n, a in zip(believed.outputs, colour, strict=True) if a}
    return NoiseFound({n: (s, e) for n, s, e in each}, known)


def _component_of(gusts: FloatArray) -> NDArray[np.int_]:
    """Return the component of the gust, u, v or w, of each column."""
    changes = (gusts.shape[2] - len(COMPONENT)) // 3
    return np.array([*COMPONENT, *[0, 1, 2] * changes][: gusts.shape[2]], dtype=int)


def _parts(record: FlightRecord) -> list[slice]:
    """Return parts of a record, each with an unknown start: sums over all that is unknown grow by its cube."""
    n, long = len(record), max(1, round(_PART_S / record.dt_s))
    ends = [*range(long, n - long // 2, long), n]
    return [slice(a, b) for a, b in pairwise([0, *ends])]


class _Unknown:
    """What moves the aircraft or its instruments, and is no noise; of size 1, in units of the noise.

    Pulses of acceleration and deflections of controls (:mod:`testbench.inference.unknown`), turbulence of rms 1
    m/s, and drifts of instruments and states at the start of a part as large as the motion that was measured.
    """

    def __init__(self, tuned: Believed, record: FlightRecord, stirred: bool) -> None:
        self._stirred = stirred
        there, outputs = tuned.at(record), tuned.outputs
        self._dt_s, V, n = record.dt_s, there.condition.V_m_s, len(record)
        pushes = [pulses(there.linear, outputs, V, record)]
        for control in there.linear.inputs:
            if control not in outputs and (sent := f"{control}_cmd") in record:
                size = float(np.nanstd(record[sent]))
                pushes.append(np.stack(deflections(there.linear, outputs, control, size, n, self._dt_s), axis=2))
        self._pulses = np.concatenate(pushes, axis=2) / tuned.noise_std[:, None]
        self._first = np.argmax(np.any(self._pulses != 0.0, axis=1), axis=0)
        self._motion = np.maximum(np.array([float(np.nanstd(record[c])) for c in outputs]) / tuned.noise_std, 1.0)
        calm = replace(there, whiten=None, colour={}, surface_noise={})
        air = GustModel.at_trim(calm, max(there.condition.h_m, LOWEST_M), self._dt_s)
        F, H, Q = air.F[0], air.H[0], air.Q[0]
        quickest = np.max(np.abs(np.log(np.linalg.eigvals(F[: air.moving, : air.moving]))))  # rad a sample
        self._stride = max(2, round(_GUST_SHARE / float(quickest)))
        driven = []
        for component in range(3):
            of = air.moving + np.flatnonzero(np.array(COMPONENT) == component)
            values, turn = np.linalg.eigh(Q[np.ix_(of, of)])
            driven.append(Q[:, of] @ turn[:, -1] * np.sqrt(self._stride / values[-1]))
        forming = slice(air.moving, air.moving + FORMING)
        begun = np.zeros((len(F), FORMING))
        stationary = solve_discrete_lyapunov(F[forming, forming], Q[forming, forming])
        begun[forming] = np.linalg.cholesky(stationary + 1e-12 * np.eye(FORMING))
        x = np.column_stack([np.eye(len(F))[:, : air.moving], begun, *driven])
        most = min(n, 2 * round(_PART_S / self._dt_s))
        response = np.empty((most, len(outputs), x.shape[1]))
        for k in range(most):
            response[k] = H @ x
            x = F @ x
        starts, self._met, self._driven = np.split(response, [air.moving, air.moving + FORMING], axis=2)
        moved = np.sqrt(np.mean(starts**2, axis=0))  # (p, states)
        self._starts = starts / np.maximum(np.max(moved / self._motion[:, None], axis=0), 1e-12)

    def within(self, part: slice) -> FloatArray:
        """Return what each but turbulence does to the channels in a part of the record, (n, p, m)."""
        n, begun = part.stop - part.start, (part.start <= self._first) & (self._first < part.stop)
        t = np.arange(n) * self._dt_s
        knots = np.arange(0.0, t[-1] + _DRIFT_S, _DRIFT_S)
        hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - knots) / _DRIFT_S)
        drifts = np.einsum("tk,ic->tick", hats, np.diag(self._motion)).reshape(n, len(self._motion), -1)
        return np.concatenate([self._pulses[part][:, :, begun], drifts], axis=2)

    def own(self, part: slice) -> tuple[FloatArray, FloatArray]:
        """Return what states at the start of a part, and what each change of turbulence of rms 1 m/s, do in it."""
        n, driven = part.stop - part.start, self._driven
        if not self._stirred:
            return self._starts[:n], driven[:n, :, :0]
        begun = [np.concatenate([np.zeros_like(driven[:k]), driven[: n - k]]) for k in range(1, n, self._stride)]
        return self._starts[:n], np.concatenate([self._met[:n], *begun], axis=2)
