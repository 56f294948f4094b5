"""The design problem, and how one input is judged: at its largest admissible amplitude, by what it tells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Control, Input
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.fisher import Criterion, Experiment, accuracy, cost
from testbench.information.targets import Targets
from testbench.questions.design.candidates import Candidate, sampled
from testbench.questions.design.prediction import Prediction
from testbench.questions.design.spectral_energy import ModeBands


@dataclass(frozen=True, eq=False)
class Problem:
    """The design problem.

    Attributes:
        experiment, prediction: the aircraft seen through its sensors, and its limits.
        targets: quantities with their wanted errors.
        criterion: what the design minimises.
        controls: (m,) controls that move.
        duration_s: of the manoeuvre.
        start_s: undisturbed flight before the input.
        shortest_s: shortest step that can be flown.
        band_hz: band of the targets.
        by_hand: a pilot flies.
        seed: of random starts.
        bands: the modes that candidates are screened for by spectral energy; None: by information alone.
        deflected: the structure of the experiment, driven by deflections: without servos.
        servo_lag_s: control -> time constant of its servo, of those that have one.
        known: (k, k) information of the parameters that earlier flights gave; None: nothing is known but the model.
    """

    experiment: Experiment
    prediction: Prediction
    targets: Targets
    criterion: Criterion
    controls: tuple[Control, ...]
    duration_s: float
    start_s: float
    shortest_s: float
    band_hz: tuple[float, float]
    by_hand: bool
    seed: int = 0
    bands: ModeBands | None = None
    deflected: AircraftStructure | None = None
    servo_lag_s: Mapping[str, float] = field(default_factory=dict)
    known: FloatArray | None = None

    @property
    def rate_hz(self) -> float:
        """Rate of the inputs, Hz."""
        return 1.0 / self.experiment.dt_s

    def until(self, duration_s: float) -> Experiment:
        """Return the experiment that ends after a time, or with the manoeuvre."""
        experiment = self.experiment
        if duration_s < self.duration_s:
            return experiment.until(round(duration_s / experiment.dt_s / experiment.stride))
        return experiment

    def cost_of(self, M: FloatArray, factor: float = 1.0) -> float:
        """Return the criterion of an input with information M (k, k) flown at ``factor`` times its amplitude.

        What earlier flights gave is added. It does not grow with the amplitude.
        """
        if self.known is None:
            return cost(M, self.targets.gradient, self.criterion) / factor
        return cost(factor**2 * M + self.known, self.targets.gradient, self.criterion)

    def cost_off(self, M: FloatArray, off: FloatArray | None) -> float:
        """Return the same if estimates from M alone are off by ``off`` (k,) besides; those before dilute it."""
        if off is None or self.known is None:
            return self.cost_of(with_off(M, off))
        total = M + self.known
        return cost(with_off(total, np.asarray(np.linalg.solve(total, M @ off))), self.targets.gradient, self.criterion)


@dataclass(frozen=True, eq=False)
class Design:
    """One input at its largest admissible amplitude, and what it tells.

    Attributes:
        family, words: which signal.
        specs: scenario entries that fly it.
        controls: (m,) controls that move.
        u: (samples, m) what is commanded, deviation from trim.
        limit: the limit that binds.
        cost: the criterion, in wanted errors; 1 or less reaches them. It counts what earlier flights gave.
        errors: (t,) predicted errors of the targets by this flight alone: standard errors, and what they are off by if
            that is known.
        information: (k, k) Fisher information.
        end_s: when the last input ends, s.
        duration_s: when the record ends, s.
        off: (k,) what the estimates of the parameters are off by without any noise; None: not asked.
    """

    family: str
    words: str
    specs: tuple[Input, ...]
    controls: tuple[Control, ...]
    u: FloatArray
    limit: str
    cost: float
    errors: FloatArray
    information: FloatArray
    end_s: float
    duration_s: float
    off: FloatArray | None = None

    @property
    def peak(self) -> FloatArray:
        """(m,) largest command either side of trim, rad (1 for the throttle)."""
        return np.asarray(np.abs(self.u).max(axis=0))


class Screened(NamedTuple):
    """A candidate with its cost at the largest admissible amplitude, that factor, the limit that binds, and the
    signal-to-noise ratio (dB) of the mode that it shows worst, at the sensor that shows this mode best.
    """

    cost: float
    candidate: Candidate
    factor: float
    limit: str
    snr_db: float = float("nan")


def by_energy(problem: Problem, candidate: Candidate) -> Screened:
    """Return a candidate at its largest admissible amplitude, judged by spectral energy alone; its cost is inf."""
    factor, limit = problem.prediction.largest_factor(candidate.u)
    snr = float("nan")
    if problem.bands is not None:
        snr = float(problem.bands.snr_db(candidate.u).max(axis=1).min() + 20.0 * np.log10(factor))
    return Screened(float("inf"), candidate, factor, limit, snr)


def by_information(problem: Problem, entry: Screened) -> Screened:
    """Return a screened candidate with its cost at its largest admissible amplitude."""
    M = problem.experiment.information(entry.candidate.u)
    return entry._replace(cost=problem.cost_of(M, entry.factor))


def judge(problem: Problem, candidate: Candidate) -> Screened:
    """Return a candidate at its largest admissible amplitude, judged by spectral energy and by information."""
    return by_information(problem, by_energy(problem, candidate))


def design_of(problem: Problem, entry: Screened, duration_s: float | None = None) -> Design:
    """Return a candidate as a design, its entries scaled to the largest admissible amplitude.

    The record ends after ``duration_s``, or with the manoeuvre of the problem.
    """
    specs = entry.candidate.scaled(entry.factor)
    u = sampled(specs, problem.controls, problem.duration_s, problem.rate_hz)
    end = problem.duration_s if duration_s is None else duration_s
    return _told(problem, entry.candidate.family, entry.candidate.words, specs, u, entry.limit, end)


def rescaled(problem: Problem, design: Design, factor: float, limit: str) -> Design:
    """Return a design at ``factor`` times its amplitude, bound by another limit."""
    specs = Candidate(design.family, design.words, design.specs, design.u).scaled(factor)
    u = sampled(specs, problem.controls, problem.duration_s, problem.rate_hz)
    return _told(problem, design.family, design.words, specs, u, limit, design.duration_s)


def seen_in(problem: Problem, design: Design) -> Design:
    """Return a design as it is, commands unchanged, as another problem judges it."""
    u = sampled(design.specs, problem.controls, problem.duration_s, problem.rate_hz)
    return _told(problem, design.family, design.words, design.specs, u, design.limit, design.duration_s)


def misled(problem: Problem, design: Design, off: FloatArray) -> Design:
    """Return a design that tells of estimates that are off by ``off`` (k,), parameters, without any noise.

    Errors and criterion are those of the mean square M^-1 + off off', M the information; the criterion counts earlier
    flights, too.
    """
    M, targets = design.information, problem.targets
    by = targets.jacobian @ off
    variance = targets.errors(accuracy(M))
    return replace(design, cost=problem.cost_off(M, off), errors=np.hypot(variance, by), off=off)


def best_share(problem: Problem, design: Design, off: FloatArray) -> float:
    """Return the share of a design's amplitude at which its criterion is least, if ``off`` (k,) grows with it.

    Sensitivities grow with the amplitude, what bends with its square.
    """
    shares = np.geomspace(1.0, 0.1, 24)
    costs = [problem.cost_off(r**2 * design.information, r * off) for r in shares]
    return float(shares[int(np.argmin(costs))])


def with_off(M: FloatArray, off: FloatArray | None) -> FloatArray:
    """Return the inverse of M^-1 + off off' (Sherman and Morrison); M if it is not known."""
    if off is None:
        return M
    felt = M @ off
    return np.asarray(M - np.outer(felt, felt) / (1.0 + float(off @ felt)))


def _told(
    problem: Problem, family: str, words: str, specs: tuple[Input, ...], u: FloatArray, limit: str, duration_s: float
) -> Design:
    M = problem.until(duration_s).information(u)
    moving = np.flatnonzero(np.any(u != 0.0, axis=1))
    return Design(
        family,
        words,
        specs,
        problem.controls,
        u,
        limit,
        problem.cost_of(M),
        problem.targets.errors(accuracy(M)),
        M,
        float(moving[-1] + 1) / problem.rate_hz if moving.size else 0.0,
        duration_s,
    )
