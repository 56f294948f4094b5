"""Promised against realised: a design is flown, sensed and identified many times, and its errors are counted.

The flights go through the simulator with all its nonlinearity and the air that is expected, the records through the
suite with all that its files say, and the estimator of the written scenario estimates the targets. If the promised
error s is right, sum e^2 / s^2 of N flights is chi-square with N degrees of freedom. Where it contradicts, the realised
root-mean-square error counts, of twice as many flights. Elsewhere promise and flights are pooled, the promise with the
weight of a few flights, because neither is exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import chi2, t

from testbench.core.errors import EstimationError, Refusal
from testbench.core.processes import cores, processes, spread
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.air import AirSpec
from testbench.core.scenario.base import Preparation
from testbench.design.ensemble import FACTORS, Flier, HeldFlight, Member, Setting, mode_words, with_mode
from testbench.design.identified import Identified
from testbench.design.problem import Design, misled, rescaled, seen_in
from testbench.estimators.prepare import prepared
from testbench.flight.air import Air, air_of
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.information.fisher import accuracy
from testbench.sensors import Sensor, SensorSuite

FALSE_ALARM = 0.01
"""Probability that a right promise is called wrong for some target of a design."""
CHANCE = 0.01
"""Probability that errors of simulated flights, or a flown one as they are, are said to be beyond what is stated."""
INTERVAL = 0.95
"""Probability of the interval about a realised error."""
MORE = 1
"""Further flights, in units of those asked for, that make a realised error that counts more certain: from 20 flights
it is known to 16 %, from 40 to 11 %."""
TRUST = 8
"""Flights that a promise is worth which the flights do not contradict: as many as tell an error to 25 %, by which
promises depart where linear theory holds (judged)."""
_REPEATS = 0.25  # of the flights asked for that another aircraft flies,
_AT_LEAST = 6  # and no fewer than these, or all that are asked for
_LOST = 0.1  # of the flights without an estimate, beyond which the error is not worth knowing better
_SMALL = 0.25  # of the amplitude, at which curvature is a quarter of what it is
_RANDOM: Mapping[str, Any] = {
    "noise_std": 0.0,
    "quantum": 0.0,
    "dropout": 0.0,
    "bias_walk": 0.0,
    "drift_std": 0.0,
    "drift_time_s": None,
}
_BLOCK = 5  # flights that one process identifies between two words of progress
_FEWEST = 3  # estimates below which nothing is said
CAUSES = {
    "noise": "noise of the sensors",
    "air": "turbulence",
    "curvature": "curvature: at this amplitude the aircraft is nonlinear",
    "equations": "properties of sensors, servos and commands between samples that the estimator's equations omit",
    "bias": "a bias beyond linear theory",
    "scatter": "scatter beyond linear theory",
}
"""What an error is made of -> in words."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of the targets over flights."""

    errors: FloatArray  # (n, t) estimate less truth
    stated: FloatArray  # (n, t) standard errors that the estimator stated
    failed: tuple[str, ...]  # why flights gave no estimate

    @property
    def n(self) -> int:
        """Number of estimates."""
        return len(self.errors)

    @property
    def rms(self) -> FloatArray:
        """(t,) root-mean-square errors; NaN without enough estimates."""
        if self.n < _FEWEST:
            return np.full(self.errors.shape[1], np.nan)
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)))

    @property
    def bias(self) -> FloatArray:
        """(t,) mean errors."""
        return np.asarray(self.errors.mean(axis=0)) if self.n else np.full(self.errors.shape[1], np.nan)

    @property
    def claimed(self) -> FloatArray:
        """(t,) root mean square of the standard errors that the estimator stated."""
        return np.asarray(np.sqrt(np.mean(self.stated**2, axis=0))) if self.n else np.full(self.errors.shape[1], np.nan)

    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Return the limits (t,) of the root-mean-square errors, for normal errors: n rms^2 / chi-square."""
        low, high = chi2.ppf([0.5 * (1.0 - INTERVAL), 0.5 * (1.0 + INTERVAL)], max(self.n, 1))
        return self.rms * np.sqrt(self.n / high), self.rms * np.sqrt(self.n / low)

    def lasting(self, k: int) -> float:
        """Return the mean error of target ``k`` if it is no chance (1 %), else 0: no number of runs removes it."""
        if self.n < _FEWEST:
            return 0.0
        e = self.errors[:, k]
        spread = float(e.std(ddof=1)) / math.sqrt(len(e))
        limit = float(t.ppf(1.0 - 0.5 * CHANCE, len(e) - 1))
        return abs(float(e.mean())) if abs(float(e.mean())) > limit * spread else 0.0

    def excess(self, k: int) -> float:
        """Return by how much errors of target ``k`` scatter more than was stated; 1 if by no more than chance.

        If stated errors s are right, the sum of (e - m)^2 / s^2 over n flights is chi-square with n degrees of freedom.
        """
        if self.n < _FEWEST:
            return 1.0
        e = self.errors[:, k] - (float(self.bias[k]) if self.lasting(k) else 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            total = float(np.sum((e / self.stated[:, k]) ** 2))
        if not math.isfinite(total):
            return 1.0
        return math.sqrt(total / self.n) if total > chi2.ppf(1.0 - CHANCE, self.n) else 1.0

    def departs(self, promised: FloatArray) -> np.ndarray:
        """Return for which targets (t,) the errors contradict the promised standard errors, at ``FALSE_ALARM``.

        Too few estimates contradict every promise.
        """
        if self.n < _FEWEST:
            return np.ones(promised.size, bool)
        share = FALSE_ALARM / promised.size
        with np.errstate(all="ignore"):
            ratio = self.n * self.rms**2 / promised**2
        low, high = chi2.ppf([0.5 * share, 1.0 - 0.5 * share], self.n)
        return np.asarray((ratio < low) | (ratio > high) | np.isnan(ratio))

    def and_(self, more: Errors) -> Errors:
        """Return these errors and more of the same."""
        return Errors(
            np.concatenate([self.errors, more.errors]),
            np.concatenate([self.stated, more.stated]),
            (*self.failed, *more.failed),
        )


@dataclass(frozen=True, eq=False)
class Realised:
    """One design, flown and identified."""

    promised: FloatArray  # (t,) errors by information, and by what the estimates are off by without noise
    found: Errors  # over the flights
    differs: np.ndarray  # (t,) whether the flights contradict the promise
    # per target, cause -> mean square error that it makes; without flights that could tell, empty
    causes: tuple[Mapping[str, float], ...] = ()

    @property
    def headline(self) -> FloatArray:
        """(t,) the errors to plan with: realised where they contradict the promise, else pooled with it.

        Infinite where too few flights give an estimate.
        """
        n, rms = self.found.n, np.nan_to_num(self.found.rms, nan=np.inf)
        with np.errstate(all="ignore"):
            pooled = np.sqrt((TRUST * self.promised**2 + n * rms**2) / (TRUST + n))
        return np.where(self.differs, rms, pooled)

    def cause(self, k: int) -> str:
        """Return the cause that makes most of the error of target ``k``; "" if none is known."""
        parts = self.causes[k] if k < len(self.causes) else {}
        return max(parts, key=lambda c: parts[c]) if parts and max(parts.values()) > 0.0 else ""


@dataclass(frozen=True, eq=False)
class Range:
    """Where designs are flown and identified: aircraft, air, sensors, estimator, truth."""

    member: Member  # what flies, with its true targets
    suite: SensorSuite  # what senses
    identified: Identified  # the estimator
    air: AirSpec  # expected
    h_m: float  # height of the flight, m
    seed: int  # of noise and air
    flier: Flier = field(default_factory=Flier)  # what flies

    @property
    def moves(self) -> bool:
        """Whether the air of one flight differs from that of the next."""
        return self.air.turbulence_rms_m_s > 0.0

    def airs(self, first: int, n: int) -> tuple[Air | None, ...]:
        """Return the air of ``n`` flights, from number ``first`` on."""
        return tuple(air_of(self.air, self.h_m, self.seed + i) for i in range(first, first + n))

    def fly(
        self, designs: Sequence[Design], airs: Sequence[Air | None], more: Sequence[str] = ()
    ) -> list[list[FlightRecord | str]]:
        """Return the truth of each design's flights through the same airs; why, of one that did not end well.

        Records have the channels that the sensors need, and ``more``.
        """
        member = self.member
        rate = member.trimmed.rate_hz
        wanted = tuple(dict.fromkeys([*(name for s in self.suite.sensors for name in s.needs), *more]))
        flown = [Manoeuvre.of(d.family, d.specs, d.duration_s, rate) for d in designs]
        head = member.aircraft, member.trimmed
        jobs = [Job(*head, m, member.problem.rate_hz, wanted, air) for m in flown for air in airs]
        out: list[FlightRecord | str] = []
        for found in self.flier.fly(jobs):
            if isinstance(found, Refusal):
                out.append(found.message)
            else:
                out.append(f"the flight ends early: {found.reason}" if found.outcome == "aborted" else found)
        n = len(airs)
        return [out[i * n : (i + 1) * n] for i in range(len(designs))]

    def errors(self, design: Design, first: int, n: int, say: Callable[[str], None] = lambda text: None) -> Errors:
        """Return the errors over ``n`` flights, the first with number ``first`` of noise and air."""
        (truths,) = self.fly([design], self.airs(first, n) if self.moves else self.airs(0, 1))
        truths = truths if self.moves else truths * n

        def one(i: int) -> tuple[FloatArray, FloatArray] | str:
            try:
                return self._estimated(truths[i], first + i)
            except Refusal as error:
                return error.message

        found: list[tuple[FloatArray, FloatArray] | str] = []
        step = _BLOCK * cores()
        with processes(cores()):
            for begin in range(0, n, step):
                say(f"identify flight {begin + 1} of {n}")
                found += spread([partial(one, i) for i in range(begin, min(begin + step, n))])
        good = [f for f in found if not isinstance(f, str)]
        failed = tuple(f for f in found if isinstance(f, str))
        shape = (-1, len(self.member.problem.targets.names))
        errors, stated = (np.array([f[k] for f in good]).reshape(shape) for k in (0, 1))
        return Errors(errors, stated, failed)

    def _estimated(self, truth: FlightRecord | str, number: int) -> tuple[FloatArray, FloatArray]:
        """Return errors and stated standard errors (t,) of the targets from one flight."""
        if isinstance(truth, str):
            raise EstimationError(truth)
        problem, structure = self.member.problem, self.identified.structure
        record = prepared(self.suite.measure(truth, self.seed + number), problem.start_s, Preparation())
        with np.errstate(all="ignore"):  # a search may pass values at which it overflows, and turns back
            params, covariance = self.identified.estimate(record)
        value = problem.targets.at(structure, params)
        if not np.all(np.isfinite(value)):
            raise EstimationError("a mode of the estimate has no frequency")
        jacobian = problem.targets.slopes(structure, params)
        stated = np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", jacobian, covariance, jacobian), 0.0))
        return value - problem.targets.values, stated

    def realised(self, design: Design, n: int, say: Callable[[str], None]) -> Realised:
        """Return the errors of a design over ``n`` flights; ``say`` is called as they are identified."""
        found = self.errors(design, 0, n, say)
        return Realised(design.errors, found, found.departs(design.errors))

    def certain(self, design: Design, n: int, first: Realised, say: Callable[[str], None]) -> Realised:
        """Return the same with more flights where they contradict the promise, and with causes.

        More flights are not worth their time where many give no estimate.
        """
        found, differs = first.found, first.differs
        if np.any(differs) and len(found.failed) <= _LOST * n:
            found = found.and_(self.errors(design, n, MORE * n, say))
        causes = self._causes(design, found, differs) if found.n >= _FEWEST else ()
        return Realised(design.errors, found, differs, causes)

    def _causes(self, design: Design, found: Errors, differs: np.ndarray) -> tuple[dict[str, float], ...]:
        """Return what each cause makes of the mean square error of each target.

        What bends the estimates grows with the amplitude, what the equations leave out does not.
        """
        problem = self.member.problem
        targets = problem.targets
        still = replace(problem.experiment, turbulence=None)
        alone = replace(problem, experiment=still).until(design.duration_s).information(design.u)
        noise = targets.errors(accuracy(alone)) ** 2
        random = targets.errors(accuracy(design.information)) ** 2
        small, whole = self.off([rescaled(problem, design, _SMALL), design])
        off, little = (np.zeros(noise.size) if d.off is None else targets.jacobian @ d.off for d in (whole, small))
        bends = (off - little) / (1.0 - _SMALL)
        square, mean = found.rms**2, found.bias**2
        known = random + off**2
        more = np.where(differs, np.maximum(square - known, 0.0), 0.0)
        bias = np.minimum(more, np.maximum(mean - off**2, 0.0))
        parts = (noise, np.maximum(random - noise, 0.0), bends**2, (off - bends) ** 2, bias, more - bias)
        return tuple(dict(zip(CAUSES, (float(x[k]) for x in parts), strict=True)) for k in range(noise.size))

    def off(self, designs: Sequence[Design]) -> list[Design]:
        """Return designs that tell what their estimates are off by without any noise, where a flight ends well.

        What the sensors show in still air differs from what the estimator's model has at the true parameters: the
        aircraft bends, servos and commands move between samples, sensors lag. To first order, the estimates move by the
        least-squares answer to that difference.
        """
        out = []
        for design, (truth,) in zip(designs, self.fly(designs, [None]), strict=True):
            by = None if isinstance(truth, str) else self._off(design, truth)
            out.append(design if by is None else misled(self.member.problem, design, by))
        return out

    def _off(self, design: Design, truth: FlightRecord) -> FloatArray | None:
        problem = self.member.problem
        try:
            record = prepared(without_noise(self.suite).measure(truth, self.seed), problem.start_s, Preparation())
            difference = record.columns(problem.experiment.structure.outputs) - self.identified.modelled(record)
        except Refusal:
            return None
        whole = np.zeros((problem.experiment.samples, difference.shape[1]))
        n = min(len(whole), len(difference))
        whole[:n] = difference[:n]
        by = problem.until(design.duration_s).misled(design.u, whole)
        return by if np.all(np.isfinite(by)) else None


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """The same commands with one aircraft that is not believed: its fast mode lies lower or higher."""

    factor: float  # natural frequency over the believed one
    what: str  # in words: the mode, and the coefficient with its factor
    predicted: FloatArray | None = None  # (t,) standard errors by information there
    values: FloatArray | None = None  # (t,) true values there
    found: Errors | None = None  # errors of the estimator, which still believes the first aircraft, over flights
    flight: HeldFlight | None = None  # one in still air, held against the limits
    why_not: str = ""  # why nothing can be said; "" otherwise


def elsewhere(
    setting: Setting, range_: Range, design: Design, n: int, say: Callable[[str], None]
) -> tuple[Elsewhere, ...]:
    """Return what a design does over ``n`` flights of each aircraft whose fast mode lies elsewhere."""
    out = []
    for factor in FACTORS:
        what = mode_words(setting.plane, factor)
        say(f"fly it with the {what}")
        try:
            there = with_mode(setting, range_.member, factor)
            targets = there.problem.targets
            if targets.names != range_.member.problem.targets.names:
                raise EstimationError("its modes have other names")
            (flight,) = range_.flier.held([(there, design, None)])
            if isinstance(flight, Refusal):
                raise flight
            found = replace(range_, member=there).errors(design, 0, n)
            seen = seen_in(there.problem, design)
            out.append(Elsewhere(factor, there.words, seen.errors, targets.values, found, flight))
        except Refusal as error:
            out.append(Elsewhere(factor, what, why_not=error.message))
    return tuple(out)


def repeats(n: int) -> int:
    """Return how many flights seek one cause, or fly another aircraft, beside ``n`` of the believed one."""
    return max(min(n, _AT_LEAST), round(_REPEATS * n))


def without_noise(suite: SensorSuite) -> SensorSuite:
    """Return a suite that is not random, with all else that its files say."""

    def one(sensor: Sensor) -> Sensor:
        return replace(sensor, **{k: v for k, v in _RANDOM.items() if hasattr(sensor, k)})

    return replace(suite, sensors=tuple(one(s) for s in suite.sensors))
