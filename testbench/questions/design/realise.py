"""Promised against realised: a design is flown, sensed and identified many times, and its errors are counted.

The flights go through the simulator with all its nonlinearity and the air that is expected, the records through the
suite with all that its files say, and the estimator of the written scenario estimates the targets. If the promised
standard error s is right, sum e^2 / s^2 of N flights is chi-square with N degrees of freedom. Where it is not, the
realised root-mean-square error counts, and repeats say where the excess comes from: without turbulence, without the
sensors' systematic errors, and at a fraction of the amplitude with as much less noise, where curvature is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import chi2

from testbench.aircraft import Aircraft
from testbench.core.errors import EstimationError, TestbenchError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.air import LOWEST_M, AirSpec
from testbench.core.scenario.base import Preparation
from testbench.estimators.prepare import prepared
from testbench.flight import TrimmedFlight
from testbench.flight.air import Air, air_of
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.information.targets import Targets
from testbench.line import manoeuvre_of
from testbench.questions.design.identified import Identified
from testbench.questions.design.problem import Design, Problem, rescaled
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import Sensor, SensorSuite

LIGHT_KG = 25.0
"""Mass below which light turbulence is expected if a scenario does not say."""
LIGHT_RMS_M_S = 0.3
"""Vertical rms of that turbulence: a tenth of a wind of 3 m/s at 20 ft (MIL-F-8785C), a calm morning."""
FALSE_ALARM = 0.01
"""Probability that a right promise is called wrong for some target of a design."""
INTERVAL = 0.95
"""Probability of the interval about a realised error."""
MORE = 2
"""Further flights, in units of those asked for, that make a realised error that counts more certain: from 20 flights
it is known to 16 %, from 60 to 9 %."""
_REPEATS = 0.5  # of the flights asked for, by which each cause is sought: ten give its error to 22 %,
_AT_LEAST = 8  # and no fewer than these, or all that are asked for
_SMALL = 0.25  # of the amplitude, at which curvature is a quarter of what it is, or less
_LOST = 0.1  # of the flights without an estimate, beyond which the error is not worth knowing better
_FEWEST = 3  # estimates below which nothing is said
_SYSTEMATIC: Mapping[str, Any] = {
    "bias": 0.0,
    "scale": 1.0,
    "lag_s": 0.0,
    "delay_s": 0.0,
    "dropout": 0.0,
    "bias_walk": 0.0,
    "drift_std": 0.0,
    "drift_time_s": None,
    "recorder": "",
    "clock_offset_s": 0.0,
    "clock_ppm": 0.0,
}
CAUSES = {
    "air": "turbulence, which colours the residuals",
    "sensors": "what the sensors do beside noise: lag, delay, scale, clock, and noise of a measured deflection",
    "curvature": "curvature: at this amplitude the aircraft is not linear",
    "commands": "servo, commands between samples, and what the estimator's equations leave out",
}
"""Cause of an excess -> in words."""


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
        promised: (t,) standard errors of the information.
        found: over the flights.
        differs: (t,) whether the realised error counts.
        causes: per target, cause -> mean square error that it adds, where the realised error is larger; else empty.
    """

    promised: FloatArray
    found: Errors
    differs: np.ndarray
    causes: tuple[Mapping[str, float], ...] = ()

    @property
    def headline(self) -> FloatArray:
        """(t,) the errors to plan with: realised where they contradict the promise, else promised.

        Infinite where too few flights give an estimate.
        """
        return np.where(self.differs, np.nan_to_num(self.found.rms, nan=np.inf), self.promised)

    def cause(self, k: int) -> str:
        """Return the cause that adds most to the error of target ``k``; "" if none is known."""
        parts = self.causes[k] if k < len(self.causes) else {}
        return max(parts, key=lambda c: parts[c]) if parts and max(parts.values()) > 0.0 else ""


def expected_air(scenario: DesignScenario, aircraft: Aircraft) -> AirSpec:
    """Return the air that a scenario expects: as given, else light turbulence for a light aircraft, else still."""
    if "air" in scenario.model_fields_set or aircraft.mass.mass_kg >= LIGHT_KG:
        return scenario.air
    height = None if scenario.condition.h_m >= LOWEST_M else LOWEST_M
    return AirSpec(turbulence_rms_m_s=LIGHT_RMS_M_S, height_m=height)


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

    def fly(self, design: Design, airs: Sequence[Air | None]) -> list[FlightRecord | str]:
        """Return the truth of a design's flights through several airs; why, of one that did not end well."""
        from testbench.flight.batch.fly import FEWEST, fly_jobs

        rate = self.trimmed.rate_hz
        manoeuvre = manoeuvre_of(design.family, design.specs, design.duration_s, 0.0, rate)
        wanted = tuple(dict.fromkeys(name for s in self.suite.sensors for name in s.needs))
        jobs = [Job(self.aircraft, self.trimmed, manoeuvre, self.problem.rate_hz, wanted, air) for air in airs]
        fewest = 1 if self.tally.batch else FEWEST
        out: list[FlightRecord | str] = []
        for found in fly_jobs(jobs, self.simulator, self.tally, fewest):
            if isinstance(found, TestbenchError):
                out.append(found.message)
            elif found.outcome == "aborted":
                out.append(f"the flight ends early: {found.reason}")
            else:
                out.append(found)
        return out

    def estimate(
        self, truths: Sequence[FlightRecord | str], suite: SensorSuite, first: int, say: Callable[[int], None]
    ) -> Errors:
        """Sense and identify flights; number ``first`` is that of the noise of the first one."""
        errors, stated, failed = [], [], []
        for i, truth in enumerate(truths):
            say(i + 1)
            try:
                if isinstance(truth, str):
                    raise EstimationError(truth)
                record = prepared(suite.measure(truth, self.seed + first + i), self.problem.start_s, Preparation())
                params, covariance = self.identified.estimate(record)
                value = self.targets.at(self.identified.structure, params)
                if not np.all(np.isfinite(value)):
                    raise EstimationError("a mode of the estimate has no frequency")
            except TestbenchError as error:
                failed.append(error.message)
                continue
            errors.append(value - self.targets.values)
            jacobian = self._jacobian(params)
            stated.append(np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", jacobian, covariance, jacobian), 0.0)))
        t = len(self.targets.names)
        return Errors(np.array(errors).reshape(-1, t), np.array(stated).reshape(-1, t), tuple(failed))

    def _jacobian(self, params: FloatArray) -> FloatArray:
        """Return the derivatives (t, k) of the targets at other parameters, by central differences."""
        structure, out = self.identified.structure, []
        for k, value in enumerate(params):
            step = np.zeros(params.size)
            step[k] = 1e-6 * max(abs(value), 1e-6)
            high, low = (self.targets.at(structure, params + sign * step) for sign in (1.0, -1.0))
            out.append((high - low) / (2.0 * step[k]))
        return np.stack(out, axis=1)

    def realised(self, design: Design, n: int, say: Callable[[str], None]) -> Realised:
        """Return the errors of a design over ``n`` flights.

        Args:
            design: at the amplitude that is flown.
            n: flights.
            say: called with a few words as the flights are identified.
        """
        found = self._errors(design, 0, n, say)
        return Realised(design.errors, found, found.departs(design.errors))

    def explained(self, design: Design, n: int, first: Realised, say: Callable[[str], None]) -> Realised:
        """Return the same with more flights where they contradict the promise, and the causes of the excess.

        More flights are not worth their time where many give no estimate.
        """
        if not np.any(first.differs):
            return first
        found = first.found
        if len(found.failed) <= _LOST * n:
            found = found.and_(self._errors(design, n, MORE * n, say))
        larger = first.differs & (np.nan_to_num(found.rms, nan=np.inf) > design.errors)
        if not np.any(larger) or found.n < _FEWEST:
            return Realised(design.errors, found, first.differs)
        parts = self._causes(design, repeats(n), found, say)
        told = tuple(p if big else {} for p, big in zip(parts, larger, strict=True))
        return Realised(design.errors, found, first.differs, told)

    def _errors(self, design: Design, first: int, n: int, say: Callable[[str], None]) -> Errors:
        truths = self.fly(design, self.airs(first, n)) if self.moves else self.fly(design, self.airs(0, 1)) * n
        return self.estimate(truths, self.suite, first, _counting(say, "identify flight", n))

    def _causes(self, design: Design, n: int, found: Errors, say: Callable[[str], None]) -> list[dict[str, float]]:
        """Return what each cause adds to the mean square error of each target, from repeats without it."""
        still = replace(self, air=self.air.model_copy(update={"turbulence_rms_m_s": 0.0}))
        small = rescaled(self.problem, design, _SMALL, design.limit)
        clean = noise_alone(self.suite, self.identified.inputs, 1.0)
        quiet = noise_alone(self.suite, self.identified.inputs, _SMALL)
        squares = [found.rms**2]
        for of, suite, words in (
            (design, self.suite, "without turbulence"),
            (design, clean, "and with noise alone"),
            (small, quiet, "and at a quarter of amplitude and noise"),
        ):
            (truth,) = still.fly(of, still.airs(0, 1))
            again = still.estimate([truth] * n, suite, 0, _counting(say, f"repeat {words}:", n))
            rms = again.rms
            squares.append(np.where(np.isnan(rms), squares[-1], rms**2))
        squares.append(np.minimum(design.errors**2, squares[-1]))
        gains = [np.maximum(a - b, 0.0) for a, b in pairwise(squares)]
        return [dict(zip(CAUSES, (float(g[k]) for g in gains), strict=True)) for k in range(design.errors.size)]


def repeats(n: int) -> int:
    """Return how many flights seek one cause, or fly another aircraft, beside ``n`` of the believed one."""
    return max(min(n, _AT_LEAST), round(_REPEATS * n))


def noise_alone(suite: SensorSuite, inputs: Sequence[str], share: float) -> SensorSuite:
    """Return a suite whose outputs have white noise (``share`` of it) and nothing else, and whose inputs are exact."""

    def one(sensor: Sensor) -> Sensor:
        known = {k: v for k, v in _SYSTEMATIC.items() if hasattr(sensor, k)}
        quiet = 0.0 if sensor.channel in inputs else share
        # noise of quantisation is white where the signal crosses many steps, and is taken so in the information
        std = float(np.hypot(sensor.noise_std, sensor.quantum / np.sqrt(12.0)))
        return replace(sensor, **known, noise_std=quiet * std, quantum=0.0)

    return replace(suite, sensors=tuple(one(s) for s in suite.sensors))


def _counting(say: Callable[[str], None], words: str, n: int) -> Callable[[int], None]:
    def count(i: int) -> None:
        if i == 1 or i % 10 == 0:
            say(f"{words} {i} of {n}")

    return count
