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
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import chi2, t

from testbench.aircraft import Aircraft
from testbench.core.errors import EstimationError, Refusal
from testbench.core.processes import cores, processes, spread
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.air import AirSpec
from testbench.core.scenario.base import Preparation
from testbench.estimators.prepare import prepared
from testbench.flight import TrimmedFlight
from testbench.flight.air import Air, air_of
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.information.fisher import accuracy
from testbench.information.targets import Targets
from testbench.line import manoeuvre_of
from testbench.questions.design.flown import Envelope, Flown, fly_all
from testbench.questions.design.identified import Identified
from testbench.questions.design.problem import Design, Problem, misled, rescaled
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
    "curvature": "curvature: at this amplitude the aircraft is not linear",
    "equations": "what the estimator's equations leave out of sensors, servos and commands between samples",
    "bias": "a bias that linear theory does not have",
    "scatter": "scatter that linear theory does not have",
}
"""What an error is made of -> in words."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of the targets over flights.

    Attributes:
        errors: (n, t) estimate less truth.
        stated: (n, t) standard errors that the estimator stated.
        failed: why flights gave no estimate.
    """

    errors: FloatArray
    stated: FloatArray
    failed: tuple[str, ...]

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
    """One design, flown and identified.

    Attributes:
        promised: (t,) errors by information, and by what the estimates are off by without noise.
        found: over the flights.
        differs: (t,) whether the flights contradict the promise.
        causes: per target, cause -> mean square error that it makes; without flights that could tell, empty.
    """

    promised: FloatArray
    found: Errors
    differs: np.ndarray
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
    """Where designs are flown and identified: aircraft, air, sensors, estimator, truth.

    Attributes:
        aircraft, trimmed: what flies.
        problem: its design problem.
        targets: whose values are true.
        suite: what senses.
        identified: the estimator.
        air: expected.
        h_m: height of the flight, m.
        seed: of noise and air.
        simulator, tally: see :mod:`testbench.flight.batch.jobs`.
    """

    aircraft: Aircraft
    trimmed: TrimmedFlight
    problem: Problem
    targets: Targets
    suite: SensorSuite
    identified: Identified
    air: AirSpec
    h_m: float
    seed: int
    simulator: Simulator
    tally: Tally

    @property
    def moves(self) -> bool:
        """Whether the air of one flight differs from that of the next."""
        return self.air.turbulence_rms_m_s > 0.0

    def airs(self, first: int, n: int) -> list[Air | None]:
        """Return the air of ``n`` flights, from number ``first`` on."""
        return [air_of(self.air, self.h_m, self.seed + i) for i in range(first, first + n)]

    def flown_as(self, flown: Sequence[Flown], designs: Mapping[int, Design], envelope: Envelope) -> list[Flown]:
        """Return flown designs, those of ``designs`` (by number) at the amplitudes of these, flown in still air."""
        out = list(flown)
        flights = fly_all(self.aircraft, self.trimmed, list(designs.values()), envelope, self.simulator, self.tally)
        for (i, design), flight in zip(designs.items(), flights, strict=True):
            out[i] = replace(out[i], design=design, record=flight.record, tightest=flight.tightest)
        return out

    def fly(self, design: Design, airs: Sequence[Air | None]) -> list[FlightRecord | str]:
        """Return the truth of a design's flights through several airs; why, of one that did not end well."""
        return self.fly_each([design], airs)[0]

    def fly_each(
        self,
        designs: Sequence[Design],
        airs: Sequence[Air | None],
        channels: Sequence[str] | None = None,
        fewest: int | None = None,
    ) -> list[list[FlightRecord | str]]:
        """Return the truth of several designs' flights, each through the same airs; why, of one that did not end well.

        Args:
            designs: what is flown.
            airs: one flight in each.
            channels: of the records; what the sensors need if not given.
            fewest: flights that are worth a batch; as :mod:`testbench.flight.batch.fly` has it, or any number where
                something has been flown in batches before, if not given.
        """
        from testbench.flight.batch.fly import FEWEST, fly_jobs

        rate = self.trimmed.rate_hz
        needed = [name for s in self.suite.sensors for name in s.needs] if channels is None else channels
        wanted = tuple(dict.fromkeys(needed))
        flown = [manoeuvre_of(d.family, d.specs, d.duration_s, 0.0, rate) for d in designs]
        jobs = [Job(self.aircraft, self.trimmed, m, self.problem.rate_hz, wanted, air) for m in flown for air in airs]
        fewest = (1 if self.tally.batch else FEWEST) if fewest is None else fewest
        out: list[FlightRecord | str] = []
        for found in fly_jobs(jobs, self.simulator, self.tally, fewest):
            if isinstance(found, Refusal):
                out.append(found.message)
            elif found.outcome == "aborted":
                out.append(f"the flight ends early: {found.reason}")
            else:
                out.append(found)
        n = len(airs)
        return [out[i * n : (i + 1) * n] for i in range(len(designs))]

    def estimate(
        self, truths: Sequence[FlightRecord | str], suite: SensorSuite, first: int, say: Callable[[int], None]
    ) -> Errors:
        """Sense and identify flights; number ``first`` is that of the noise of the first one."""

        def one(i: int) -> tuple[FloatArray, FloatArray] | str:
            try:
                return self._estimated(truths[i], suite, first + i)
            except Refusal as error:
                return error.message

        found: list[tuple[FloatArray, FloatArray] | str] = []
        step = _BLOCK * cores()
        with processes(cores()):
            for begin in range(0, len(truths), step):
                say(begin + 1)
                found += spread([partial(one, i) for i in range(begin, min(begin + step, len(truths)))])
        good = [f for f in found if not isinstance(f, str)]
        failed = tuple(f for f in found if isinstance(f, str))
        errors, stated = (np.array([f[k] for f in good]).reshape(-1, len(self.targets.names)) for k in (0, 1))
        return Errors(errors, stated, failed)

    def _estimated(self, truth: FlightRecord | str, suite: SensorSuite, number: int) -> tuple[FloatArray, FloatArray]:
        """Return errors and stated standard errors (t,) of the targets from one flight."""
        if isinstance(truth, str):
            raise EstimationError(truth)
        record = prepared(suite.measure(truth, self.seed + number), self.problem.start_s, Preparation())
        with np.errstate(all="ignore"):  # a search may pass values at which it overflows, and turns back
            params, covariance = self.identified.estimate(record)
        value = self.targets.at(self.identified.structure, params)
        if not np.all(np.isfinite(value)):
            raise EstimationError("a mode of the estimate has no frequency")
        jacobian = self.targets.slopes(self.identified.structure, params)
        stated = np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", jacobian, covariance, jacobian), 0.0))
        return value - self.targets.values, stated

    def realised(self, design: Design, n: int, say: Callable[[str], None]) -> Realised:
        """Return the errors of a design over ``n`` flights.

        Args:
            design: at the amplitude that is flown.
            n: flights.
            say: called with a few words as the flights are identified.
        """
        found = self.errors(design, 0, n, say)
        return Realised(design.errors, found, found.departs(design.errors))

    def certain(self, design: Design, n: int, first: Realised, say: Callable[[str], None]) -> Realised:
        """Return the same with more flights where they contradict the promise, and with causes.

        More flights are not worth their time where many give no estimate.
        """
        found, differs = first.found, first.differs
        if np.any(differs) and len(found.failed) <= _LOST * n:
            found = found.and_(self.errors(design, n, MORE * n, say))
        if found.n < _FEWEST:
            return Realised(design.errors, found, differs)
        return Realised(design.errors, found, differs, self._causes(design, found, differs))

    def errors(self, design: Design, first: int, n: int, say: Callable[[str], None] = lambda text: None) -> Errors:
        """Return the errors over ``n`` flights, the first with number ``first`` of noise and air."""
        truths = self.fly(design, self.airs(first, n)) if self.moves else self.fly(design, self.airs(0, 1)) * n
        return self.estimate(truths, self.suite, first, _counting(say, "identify flight", n))

    def _causes(self, design: Design, found: Errors, differs: np.ndarray) -> tuple[dict[str, float], ...]:
        """Return what each cause makes of the mean square error of each target.

        What bends the estimates grows with the amplitude, what the equations leave out does not.
        """
        targets = self.problem.targets
        still = replace(self.problem.experiment, turbulence=None)
        alone = replace(self.problem, experiment=still).until(design.duration_s).information(design.u)
        noise = targets.errors(accuracy(alone)) ** 2
        random = targets.errors(accuracy(design.information)) ** 2
        (small, _), (whole, _) = self.off([rescaled(self.problem, design, _SMALL, design.limit), design])
        off, little = (np.zeros(noise.size) if d.off is None else targets.jacobian @ d.off for d in (whole, small))
        bends = (off - little) / (1.0 - _SMALL)
        square, mean = found.rms**2, found.bias**2
        known = random + off**2
        more = np.where(differs, np.maximum(square - known, 0.0), 0.0)
        bias = np.minimum(more, np.maximum(mean - off**2, 0.0))
        parts = (noise, np.maximum(random - noise, 0.0), bends**2, (off - bends) ** 2, bias, more - bias)
        return tuple(dict(zip(CAUSES, (float(x[k]) for x in parts), strict=True)) for k in range(noise.size))

    def off(self, designs: Sequence[Design]) -> list[tuple[Design, FloatArray | None]]:
        """Return designs that tell what their estimates are off by without any noise, and that (k,).

        None if a flight does not end well.
        """
        records = replace(self, air=AirSpec()).fly_each(designs, [None])
        out: list[tuple[Design, FloatArray | None]] = []
        for design, (truth,) in zip(designs, records, strict=True):
            by = None if isinstance(truth, str) else self._off(design, truth)
            out.append((design if by is None else misled(self.problem, design, by), by))
        return out

    def _off(self, design: Design, truth: FlightRecord) -> FloatArray | None:
        problem = self.problem
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


def repeats(n: int) -> int:
    """Return how many flights seek one cause, or fly another aircraft, beside ``n`` of the believed one."""
    return max(min(n, _AT_LEAST), round(_REPEATS * n))


def without_noise(suite: SensorSuite) -> SensorSuite:
    """Return a suite that is not random, with all else that its files say."""

    def one(sensor: Sensor) -> Sensor:
        return replace(sensor, **{k: v for k, v in _RANDOM.items() if hasattr(sensor, k)})

    return replace(suite, sensors=tuple(one(s) for s in suite.sensors))


def _counting(say: Callable[[str], None], words: str, n: int) -> Callable[[int], None]:
    def count(i: int) -> None:
        say(f"{words} {i} of {n}")

    return count
