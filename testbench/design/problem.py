"""The design problem, and how one input is judged: at its largest admissible amplitude, by what it tells.

Spectral energy of an input: the share that reaches each mode, and what each sensor shows of it.

Mode i receives the share of the energy of an input U(w) that lies inside the mode's half-power band. What a sensor sees
of mode i is the term R_i / (jw - s_i), with its conjugate, of the partial-fraction expansion of the linear model. The
energy of that term in the band over the energy of the sensor's noise there is the signal-to-noise ratio of the mode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Control, Input
from testbench.design.candidates import Candidate, sampled, scaled
from testbench.design.limits import Envelope, Prediction, limit_words
from testbench.flight.linear_model import EXCITED_DB, LinearModel, ModalForm, half_power_band
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.fisher import Criterion, Experiment, accuracy, cost
from testbench.information.targets import Targets
from testbench.inputs.signal import frequency_below, total_energy

_POINTS = 33  # frequencies per band
_QUIET = 0.01  # of a sensor's noise that is left when it is taken away
_FREE = 1e9  # times a limit


@dataclass(frozen=True, eq=False)
class SpectralEnergy:
    """What one input does to each mode."""

    #: modes, sensors: names
    modes: tuple[str, ...]
    sensors: tuple[str, ...]
    share: FloatArray  #: (modes,) share of the input's energy in each half-power band
    snr_db: FloatArray  #: (modes, sensors) energy of the mode's response over that of the noise, in its band
    #: (m,) per control the frequency below which 95 % of its energy lies, rad/s; NaN for one at rest
    below_95: FloatArray

    def seen(self, mode: str) -> tuple[str, float]:
        """Return the sensor that shows a mode best, and its signal-to-noise ratio in dB."""
        row = self.snr_db[self.modes.index(mode)]
        return self.sensors[int(np.argmax(row))], float(row.max())

    def excited(self, mode: str) -> bool:
        """Return whether some sensor shows the mode at least EXCITED_DB above its noise."""
        return self.seen(mode)[1] >= EXCITED_DB


@dataclass(frozen=True, eq=False)
class ModeBands:
    """The modes of an aircraft seen by sensors, ready for many inputs of one length and rate.

    Args:
        model: linear model whose states span the modes.
        modes: name -> pole, rad/s.
        inputs: (m,) channels of the input among the model's.
        noise: sensor channel -> standard deviation of one sample, and its sample time in s.
        dt_s: sample time of the input, s.
        samples: number of them.
    """

    model: LinearModel
    modes: Mapping[str, complex]
    inputs: Sequence[str]
    noise: Mapping[str, tuple[float, float]]
    dt_s: float
    samples: int
    bands: tuple[tuple[float, float], ...] = field(init=False)
    _omega: FloatArray = field(init=False, repr=False)  # (modes, points)
    _phase: NDArray[np.complex128] = field(init=False, repr=False)  # (modes points, samples + 1)
    _H: NDArray[np.complex128] = field(init=False, repr=False)  # (modes, points, sensors, m)
    _floor: FloatArray = field(init=False, repr=False)  # (modes, sensors)

    def __post_init__(self) -> None:
        modal = ModalForm(self.model, tuple(self.noise), self.inputs)
        T = self.samples * self.dt_s
        bands, omegas, responses, floors = [], [], [], []
        for pole in self.modes.values():
            low, high = half_power_band(pole, T)
            omega = np.linspace(low, high, _POINTS)
            bands.append((low, high))
            omegas.append(omega)
            responses.append(modal.response(pole, omega, T))
            floors.append([std**2 * T * dt * (high - low) / np.pi for std, dt in self.noise.values()])
        omega = np.stack(omegas)
        phase = np.exp(-1j * np.outer(omega.ravel(), self.dt_s * np.arange(self.samples + 1)))
        for name, value in (
            ("bands", tuple(bands)),
            ("_omega", omega),
            ("_phase", phase / (1j * omega.ravel()[:, None])),
            ("_H", np.stack(responses)),
            ("_floor", np.array(floors)),
        ):
            object.__setattr__(self, name, value)

    def _in_bands(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return energies in each band: of the input (modes,) and of each mode at each sensor (modes, sensors)."""
        zero = np.zeros((1, u.shape[1]))
        jumps = np.diff(u, axis=0, prepend=zero, append=zero)
        at = np.flatnonzero(np.any(jumps != 0.0, axis=1))
        phase = self._phase if 2 * at.size > len(jumps) else self._phase[:, at]
        moved = jumps if 2 * at.size > len(jumps) else jumps[at]
        U = (phase @ moved).reshape(*self._omega.shape, -1)
        Y = np.einsum("kfsm,kfm->kfs", self._H, U)
        given = np.trapezoid(np.sum(np.abs(U) ** 2, axis=2), self._omega, axis=1) / np.pi
        seen = np.trapezoid(np.abs(Y) ** 2, self._omega[:, :, None], axis=1) / np.pi
        return given, seen

    def snr_db(self, u: FloatArray) -> FloatArray:
        """Return the signal-to-noise ratio (modes, sensors) of an input (samples, m), dB."""
        _, seen = self._in_bands(u)
        return np.asarray(10.0 * np.log10(np.maximum(seen, 1e-300) / self._floor))

    def analyse(self, u: FloatArray) -> SpectralEnergy:
        """Return the spectral energy of one input (samples, m), deviation from trim, held."""
        given, seen = self._in_bands(u)
        energy = total_energy(u, self.dt_s)
        below = np.full(u.shape[1], np.nan)
        moving = energy > 0.0
        if moving.any():
            below[moving] = frequency_below(u[:, moving], self.dt_s)
        return SpectralEnergy(
            tuple(self.modes),
            tuple(self.noise),
            given / max(float(energy.sum()), 1e-300),
            10.0 * np.log10(np.maximum(seen, 1e-300) / self._floor),
            below,
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """The design problem."""

    #: experiment, prediction: the aircraft seen through its sensors, and its limits
    experiment: Experiment
    prediction: Prediction
    targets: Targets  #: quantities with their wanted errors
    criterion: Criterion  #: what the design minimises
    controls: tuple[Control, ...]  #: (m,) controls that move
    duration_s: float  #: of the manoeuvre
    start_s: float  #: undisturbed flight before the input
    shortest_s: float  #: shortest step that can be flown
    band_hz: tuple[float, float]  #: band of the targets
    by_hand: bool  #: a pilot flies
    seed: int = 0  #: of random starts
    #: the modes that candidates are screened for by spectral energy; None: by information alone
    bands: ModeBands | None = None
    #: the structure of the experiment, driven by deflections: without servos
    deflected: AircraftStructure | None = None
    #: control -> time constant of its servo, of those that have one
    servo_lag_s: Mapping[str, float] = field(default_factory=dict)
    #: (k, k) information of the parameters that earlier flights gave; None: nothing is known but the model
    known: FloatArray | None = None

    @property
    def rate_hz(self) -> float:
        """Rate of the inputs, Hz."""
        return 1.0 / self.experiment.dt_s

    @property
    def envelope(self) -> Envelope:
        """The limits, as a flown record is held against them."""
        return self.prediction.envelope

    def sampled(self, specs: Sequence[Input]) -> FloatArray:
        """Return the samples (n, m) of scenario entries."""
        return sampled(specs, self.controls, self.duration_s, self.rate_hz)

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
    """One input at its largest admissible amplitude, and what it tells."""

    #: family, words: which signal
    family: str
    words: str
    specs: tuple[Input, ...]  #: scenario entries that fly it
    controls: tuple[Control, ...]  #: (m,) controls that move
    u: FloatArray  #: (samples, m) what is commanded, deviation from trim
    limit: str  #: the limit that binds
    cost: float  #: the criterion, in wanted errors; 1 or less reaches them. It counts what earlier flights gave.
    #: (t,) predicted errors of the targets by this flight alone: standard errors, and what they are off by if that is
    #: known
    errors: FloatArray
    information: FloatArray  #: (k, k) Fisher information
    end_s: float  #: when the last input ends, s
    duration_s: float  #: when the record ends, s
    #: (k,) what the estimates of the parameters are off by without any noise; None: not asked
    off: FloatArray | None = None

    @property
    def peak(self) -> FloatArray:
        """(m,) largest command either side of trim, rad (1 for the throttle)."""
        return np.asarray(np.abs(self.u).max(axis=0))

    @property
    def candidate(self) -> Candidate:
        """The same input as a candidate, to be scaled."""
        return Candidate(self.family, self.words, self.specs, self.u)


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
    end = problem.duration_s if duration_s is None else duration_s
    return _told(problem, entry.candidate, entry.factor, entry.limit, end)


def rescaled(problem: Problem, design: Design, factor: float, limit: str | None = None) -> Design:
    """Return a design at ``factor`` times its amplitude, bound by another limit if one is given."""
    return _told(problem, design.candidate, factor, design.limit if limit is None else limit, design.duration_s)


def seen_in(problem: Problem, design: Design) -> Design:
    """Return a design as it is, commands unchanged, as another problem judges it."""
    return rescaled(problem, design, 1.0)


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


def _told(problem: Problem, candidate: Candidate, factor: float, limit: str, duration_s: float) -> Design:
    specs = candidate.specs if factor == 1.0 else scaled(candidate.specs, factor)
    u = problem.sampled(specs)
    M = problem.until(duration_s).information(u)
    moving = np.flatnonzero(np.any(u != 0.0, axis=1))
    end_s = float(moving[-1] + 1) / problem.rate_hz if moving.size else 0.0
    errors = problem.targets.errors(accuracy(M))
    head = candidate.family, candidate.words, specs, problem.controls, u, limit
    return Design(*head, problem.cost_of(M), errors, M, end_s, duration_s)


def total_errors(problem: Problem, design: Design, headline: FloatArray | None = None) -> FloatArray:
    """Return the standard errors (t,) of the targets after a flight, what was known before included.

    Args:
        problem: of the design.
        design: that is flown.
        headline: (t,) errors of this flight alone to plan with; those of the design if not given.

    Where headline errors h exceed those of the information, s, the covariance C of the flight grows by K diag(h^2 -
    s^2) K', K = C J' (J C J')^-1, J the targets by the parameters: the least that gives the targets the errors h.
    """
    M, known, targets = design.information, problem.known, problem.targets
    alone = design.errors if headline is None else headline
    if known is None:
        return alone
    own = accuracy(M)
    more = alone**2 - targets.errors(own) ** 2
    if not (np.all(np.isfinite(own.std)) and np.all(np.isfinite(more))):
        return targets.errors(accuracy(known))
    J, C = targets.jacobian, own.covariance
    L = C @ J.T @ np.linalg.pinv(J @ C @ J.T) * np.sqrt(np.maximum(more, 0.0))
    felt = M @ L  # (C + L L')^-1 = M - M L (1 + L' M L)^-1 L' M
    own_wider = M - felt @ np.linalg.solve(np.eye(L.shape[1]) + L.T @ felt, felt.T)
    return targets.errors(accuracy(0.5 * (own_wider + own_wider.T) + known))


# --- what keeps the error from falling further ------------------------------------------------------------------------


@dataclass(frozen=True)
class Obstacle:
    """What a design would reach without one of its obstacles."""

    words: str  #: what is taken away
    cost: float  #: the criterion without it, in wanted errors


@dataclass(frozen=True)
class Obstacles:
    """Everything that was tried, the most helpful first, and how many flights of the same input would be enough."""

    tried: tuple[Obstacle, ...]
    flights: int


def obstacles(problem: Problem, design: Design) -> Obstacles:
    """Return what the same input would tell if one sensor had no noise, or one limit were not there.

    Each sensor in turn gets a hundredth of its noise. If a limit is taken away, the next one binds. Several flights of
    one input add up their information: what scatters falls as the root of their number, what the estimates are off by
    stays.
    """
    experiment = problem.experiment
    out = []
    for i, sensor in enumerate(experiment.sensors):
        M = experiment.with_less_noise(i, _QUIET).information(design.u)
        less = problem.cost_off(M, design.off)
        out.append(Obstacle(f"the noise of {sensor.channel}", less))
    prediction = problem.prediction
    deviation = prediction.response(design.u)
    high = np.maximum(deviation.max(axis=0), 1e-150)
    low = np.minimum(deviation.min(axis=0), -1e-150)
    rooms = np.minimum(prediction.high / high, prediction.low / low)
    binding = prediction.names.index(design.limit) if design.limit in prediction.names else int(np.argmin(rooms))
    others = np.delete(rooms, binding)
    gain = min(max(float(others.min()) if others.size else _FREE, 1.0), _FREE)
    words = f"the limit on {limit_words(prediction.names[binding]).removeprefix('the ')}"
    off = None if design.off is None else gain * design.off
    out.append(Obstacle(words, problem.cost_off(gain**2 * design.information, off)))
    return Obstacles(tuple(sorted(out, key=lambda o: o.cost)), _flights(problem, design))


def _flights(problem: Problem, design: Design) -> int:
    """Return how many flights together reach the wanted errors; 0 if none do, or if earlier ones count, too."""
    alone = problem.cost_of(design.information)
    if not np.isfinite(alone) or problem.known is not None:
        return 0
    off = np.zeros(len(design.information)) if design.off is None else design.off
    stays = float(np.max(np.abs(problem.targets.gradient @ off)))
    if stays >= 1.0:
        return 0
    return max(1, ceil(alone**2 / (1.0 - stays**2) * (1.0 - 1e-9)))
