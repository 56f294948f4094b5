"""One plane of motion while it flies: its derivatives so far, and whether it answers as the believed aircraft would.

A run begins where a control moves beyond its noise and ends some seconds after it has come to rest. Within runs the
derivatives are those of recursive Fourier-transform regression
(:class:`testbench.estimators.parametric.recursive_fourier.InFlight`), all runs of a condition together.

Whether a run is answered as believed is told by :mod:`testbench.inference.multiple_models`, from the undisturbed flight
before it on. What a run finds of the aircraft is believed in the next one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from testbench.core.channels import channel
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.recursive_fourier import InFlight
from testbench.estimators.settings import RecursiveFourier
from testbench.evaluation.derivatives import dimensional_derivatives, true_parameters
from testbench.inference.form import ALPHA_RAD, FORM_STD
from testbench.inference.multiple_models import AT_REST, Watched, Weighed
from testbench.information.targets import needed_parameters
from testbench.logs.manoeuvres import FACTOR, NOISE_QUANTILE, SMALLEST, WINDOW_S
from testbench.questions.live.belief import LEAST_FORM, Believed, Expected, by_airspeed, structure_of
from testbench.questions.live.careful import Careful, Run
from testbench.questions.plan.result import Point

QUIET_S, LEAD_S, TAIL_S, LONGEST_S = 5.0, 1.0, 3.0, 40.0
"""Undisturbed flight that trim and noise are taken from; what counts before and after a movement; the longest run."""
LOST_S = 1.0  # of samples, beyond which a run has ended
DOUBTED = 0.01
"""Probability that a run is answered as believed, from which on it is said not to be."""
_FEWEST = 8  # drawn aircraft that the uncertainty is known by
_QUIETEST = 2e-4  # rad, rad/s: noise of an instrument that seems to have none
_NOTHING = 1e3
"""Standard errors over the value at which nothing is known of a derivative."""
SPEED_LAG_S = 0.1
_FRAME = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta")
_CAUGHT_UP = 150
"""Samples that the bank takes in an update: those of the quiet flight before a run come as it begins."""
_LEAK_S = 20.0  # of a flow angle that is integrated


@dataclass(frozen=True)
class Estimate:
    """One derivative so far."""

    # name, value: of the structure, SI
    name: str
    value: float
    std: float  # standard error; residuals may be coloured
    half: float  # half width of the 95 % interval
    believed: float | None  # value before the flight; None if nobody said
    wanted: float  # standard error that is wanted; 0 if none is
    reached: bool  # whether it is as small as that
    more_s: float | None = None  # in manoeuvres like those so far until it is; None before each control was moved


class Plane:
    """A plane of motion that is followed.

    Args:
        name: "longitudinal" or "lateral".
        sources: control -> channel that tells what it did, a deflection or a command.
        lags_s: control -> lag of the servo behind a command, s.
        believed: the aircraft where it flies.
        wanted: derivative -> wanted standard error relative to its value; "" for all others.
        dt_s: of the even clock.
        integrated: whether the flow angle is integrated from rates and forces, as nobody measures it.
        speed: whether the airspeed is measured.
        noise: channel -> standard deviation of its white noise of late.
    """

    def __init__(
        self, name: str, sources: Mapping[str, str], lags_s: Mapping[str, float], believed: Believed,
        wanted: Mapping[str, float], dt_s: float, integrated: bool, speed: bool, noise: Callable[[str], float],
    ) -> None:  # fmt: skip
        self.noise = noise
        self.name, self.sources, self.lags_s, self.dt_s = name, dict(sources), lags_s, dt_s
        self.believed, self.integrated, self.speed, self.wanted = believed, integrated, speed, wanted
        controls = tuple(sources)
        self.structure = structure_of(
            name, believed.at, (*controls, "V") if name == "longitudinal" and speed else controls
        )
        values = believed.values(self.structure)
        self.before = dict(zip(self.structure.parameter_names, values[0].tolist(), strict=True))
        self.expected, self._drawn = Expected.of(self.structure, values, dt_s), len(values) - 1
        self._first = self.expected
        self.targets = needed_parameters(name, controls, False, ())
        settings = RecursiveFourier(band_hz=(0.1, min(2.0, 0.2 / dt_s)), step_hz=0.04)
        self.regression = InFlight(self.structure, settings, dt_s)
        self._quiet: deque[FloatArray] = deque(maxlen=max(8, round(QUIET_S / dt_s)))
        self._spreads: dict[str, list[float]] = {c: [] for c in controls}
        self._recent: deque[FloatArray] = deque(maxlen=max(2, round(WINDOW_S / dt_s) + 1))
        self._lead: deque[FloatArray] = deque(maxlen=self._quiet.maxlen)
        self._run: list[FloatArray] = []
        self._known: list[FloatArray] = []
        self._valid: list[FloatArray] = []
        self._trim: FloatArray | None = None
        self._surface: FloatArray | None = None
        self._angle = 0.0
        self._still_s, self._said = 0.0, ""
        self._watched: Watched | None = None
        self._waiting: list[Any] = []
        self._parts: list[tuple[FloatArray, NDArray[np.bool_], FloatArray, FloatArray]] = []
        self.runs: list[Run] = []
        self.active, self._lost_s, self._learnt = False, 0.0, False
        self._flown_s = 0.0
        self._ended: dict[str, float] = {}  # derivative -> standard error when the last run ended

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that it needs."""
        extra = {"longitudinal": ("az",), "lateral": ("ay",)}[self.name] if self.integrated else ()
        angle = self.structure.states[0]
        states = tuple(s for s in self.structure.states if not (self.integrated and s == angle))
        return (*states, *extra, *(("V",) if self.speed else ()), *self.sources.values())

    def take(self, block: FlightRecord) -> bool:
        """Take the next samples; return whether a run has ended with them."""
        part = block.select(self.channels)
        m = len(self.sources)
        rows = np.hstack([part.data[:, :-m], self._reached(part.data[:, -m:])])
        known = kinematics(self.name, self.believed, block)
        ended = False
        least = self._least()
        for k, row in enumerate(rows):
            self._ended_s = float(part.t_s[k])
            self._lost_s = 0.0 if part.valid[k].all() else self._lost_s + self.dt_s
            if self._lost_s > LOST_S:  # what comes then is another flight
                for memory in (self._quiet, self._lead, self._recent):
                    memory.clear()
                ended |= self._end()
                continue
            self._recent.append(row)
            moving = self._moves(least)
            self._still_s = 0.0 if moving else self._still_s + self.dt_s
            if moving and not self.active and len(self._quiet) >= (self._recent.maxlen or 0):
                self._begin()
            if self.active:
                self._run.append(row)
                self._known.append(known[k])
                self._valid.append(part.valid[k])
                if self._still_s > TAIL_S or len(self._run) * self.dt_s > LONGEST_S:
                    ended |= self._end()
            elif moving:
                self._quiet.clear()
                self._lead.clear()
            else:
                self._quiet.append(row)
                self._lead.append(known[k])
        if self.active:
            self._feed()
        return ended

    def _end(self) -> bool:
        """End the run, if there is one; return whether there was."""
        if not self.active:
            return False
        self._feed(every=True)
        self._flown_s += self._elapsed_s
        fit = self.regression.fit()
        stds = [] if fit is None else np.sqrt(np.diag(fit.corrected)).tolist()
        self._ended = dict(zip(self.regression.names, stds, strict=False))
        self.active = False
        self._quiet.clear()
        self._lead.clear()
        self._learn()
        if self._parts:
            V0, data = self.regression.place[0], [np.concatenate(part) for part in zip(*self._parts, strict=True)]
            t: FloatArray = self.dt_s * np.arange(len(data[0]), dtype=np.float64)
            record = FlightRecord(t, (*self.structure.states, *self.structure.inputs), data[0], "measured", data[1])
            number = len(self.regression.places) - 1
            self.runs.append(Run(number, self._ended_s - t[-1], V0, record, data[2], data[3], bool(self._said)))
        return True

    @property
    def _elapsed_s(self) -> float:
        return max(len(self._run) * self.dt_s - LEAD_S, self.dt_s) if self.active else 0.0

    @property
    def so_far(self) -> Expected:
        """The aircraft at what is found so far, and as believed where nothing is."""
        fit, params = self.regression.fit(), self.expected.params.copy()
        if fit is not None:
            params[self.regression.free] = fit.step
        return replace(self.expected, params=params)

    def told(self, found: Careful) -> None:
        """Let what a careful estimate made of runs stand in the place of what was made of them in flight."""
        self.regression.take_instead(found.numbers, np.array(found.values), np.array(found.covariance))
        fit = self.regression.fit()
        if fit is not None and not self.active and not any(run.doubted for run in self.runs):
            self.expected, self._learnt = self._first.given(self.regression.free, fit.step, fit.corrected), True

    def expect(self, believed: Believed) -> None:
        """Take more of the aircraft that may be flying, unless a run has told already which it is."""
        values = believed.values(self.structure)
        self._first, self._drawn = Expected.of(self.structure, values, self.dt_s), len(values) - 1
        if not self._learnt:
            self.expected = self._first

    def _learn(self) -> None:
        """Let the next run be expected of what this one found, unless it was not the response expected."""
        if self._watched is not None and not self._said:
            self.expected, self._learnt = self.expected.learnt(*self._watched.learnt()), True

    def _reached(self, u: FloatArray) -> FloatArray:
        """Return deflections (b, m) behind the servos."""
        lags = np.array([self.lags_s.get(c, 0.0) for c in self.sources])
        if not lags.any():
            return u
        x = u[0] if self._surface is None else self._surface
        keep = np.where(lags > 0.0, np.exp(-self.dt_s / np.maximum(lags, 1e-9)), 0.0)
        out = np.empty_like(u)
        for k, command in enumerate(u):
            x = keep * x + (1.0 - keep) * command
            out[k] = x
        self._surface = x
        return out

    def _least(self) -> FloatArray:
        """Return the spread (m,) over a short time beyond which each control moves."""
        noise = [float(np.quantile(x[-2000:], NOISE_QUANTILE)) if len(x) > 10 else 0.0 for x in self._spreads.values()]
        return np.maximum(FACTOR * np.array(noise), [SMALLEST[channel(c).unit] for c in self._spreads])

    def _moves(self, least: FloatArray) -> bool:
        spread = np.ptp(np.array(self._recent)[:, -len(self.sources) :], axis=0)
        if len(self._recent) == self._recent.maxlen:
            for seen, x in zip(self._spreads.values(), spread.tolist(), strict=True):
                if len(seen) < 4000:
                    seen.append(x)
        return bool(np.any(spread > least))

    def _begin(self) -> None:
        quiet = np.array(self._quiet)
        self._trim, self._parts = quiet.mean(axis=0), []
        states = len(self.structure.states)
        lead = quiet[-round(LEAD_S / self.dt_s) :]
        self._angle, self._slow_V, self._done = 0.0, 0.0, 0
        self._run = [*lead]
        self._known = [*self._lead][-len(lead) :]
        self._valid = [np.ones(quiet.shape[1], bool)] * len(lead)
        self._y: FloatArray = np.zeros((0, states))
        self._acting = np.array([self.noise(source) for source in self.sources.values()])
        self._said, self._watched = "", self._watching(quiet - self._trim)
        self.regression.begin()
        self.active, self._still_s = True, 0.0

    def _feed(self, every: bool = False) -> None:
        """Give what is new in the run to the regression and, ``every`` sample or so many, to the bank."""
        new = np.array(self._run[self._done :])
        if not len(new):
            return
        assert self._trim is not None
        valid, m = np.array(self._valid[self._done :], bool), len(self.sources)
        if not valid.any(axis=0).all():  # a channel that the link drops is waited for
            return
        z = new - self._trim
        first = z.shape[1] - m - self.speed
        states, ok = z[:, :first], valid[:, :first]
        if self.integrated:
            states, ok = self._with_angle(states, ok)
        speed = self._smooth_speed(z[:, first]) if self.speed else np.zeros(len(z))
        inputs, sound = np.where(np.abs(z[:, -m:]) > AT_REST * self._acting, z[:, -m:], 0.0), valid[:, -m:]
        if "V" in self.structure.inputs:
            inputs, sound = np.column_stack([inputs, speed]), np.column_stack([sound, valid[:, first]])
        V0 = float(self._trim[first]) if self.speed else self.believed.at.V
        ratio = np.maximum((V0 + speed) / self.believed.at.V, 0.2)
        known = np.array(self._known[self._done :])
        t: FloatArray = self.dt_s * (self._done + np.arange(len(new), dtype=np.float64))
        names = (*self.structure.states, *self.structure.inputs)
        block = FlightRecord(t, names, np.hstack([states, inputs]), "measured", np.hstack([ok, sound]))
        self.regression.add(block, self._scales(ratio), known)
        self._parts.append((block.data, block.valid, known, ratio))
        self._y = np.vstack([self._y, states])
        away = self._y[:, 0] if self.name == "longitudinal" else np.zeros(1)
        self.regression.place = V0, float(away.mean()), float(np.mean(away**2))
        if self._watched is not None:
            later = slice(self._lead_taken if not self._done else 0, None)
            read = list(self._watched.bank.read)
            turned = known - self._known[0] + self.expected.by_speed(states, inputs, ratio)
            both = np.hstack([inputs, turned])
            more = both[later], states[later][:, read], ok[later][:, read]
            self._waiting = [np.vstack(part) for part in zip(self._waiting, more, strict=True)]
            at_once = len(self._waiting[0]) if every else _CAUGHT_UP
            self._watched.take(*(x[:at_once] for x in self._waiting))
            self._waiting = [x[at_once:] for x in self._waiting]
        self._done += len(new)

    def _smooth_speed(self, V: FloatArray) -> FloatArray:
        """Return airspeed through a short lag: noise of it would stand for changes of dynamic pressure."""
        keep, out, x = np.exp(-self.dt_s / SPEED_LAG_S), np.empty(len(V)), self._slow_V
        for k, value in enumerate(V):
            x = keep * x + (1.0 - keep) * value
            out[k] = x
        self._slow_V = x
        return out

    def _scales(self, ratio: FloatArray) -> FloatArray:
        """Return the factors (b, n, f) by which airspeed over that of the trim, (b,), changes what derivatives do.

        Forces and moments go with dynamic pressure, those by rates with airspeed; the flow angle turns by force over
        airspeed. So the values are those at trim, however the speed has changed.
        """
        turn = np.where(np.array(self.structure.states) == self.structure.states[0], 1.0, 0.0)[:, None]
        out: FloatArray = ratio[:, None, None] ** (by_airspeed(self.regression.names) - turn)
        return out

    def believed_at(self, point: Point) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (f,) that are estimated as they are believed at a point of a plan.

        Beside them what theirs at the trim are times, if they go with dynamic pressure alone.
        """
        told = dimensional_derivatives(point.model, point.trimmed)
        values = true_parameters(self.structure.meaning, told, point.V_m_s)
        names = self.regression.names
        scales = (point.V_m_s / self.believed.at.V) ** by_airspeed(names)
        return np.array([values.get(n, 0.0) for n in names]), scales

    def _with_angle(self, z: FloatArray, valid: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return states with the flow angle integrated from rates and forces, z being deviations from trim."""
        at = self.believed.at
        if self.name == "longitudinal":
            q, az = z.T
            rate, others = q + az / at.V, z[:, :1]
        else:
            p, r, phi, ay = z.T
            rate = (ay + at.g * np.cos(at.theta) * phi) / at.V + np.sin(at.alpha) * p - np.cos(at.alpha) * r
            others = z[:, :3]
        keep = np.exp(-self.dt_s / _LEAK_S)
        angle, x = np.empty(len(rate)), self._angle
        for k, value in enumerate(rate):
            x = keep * x + self.dt_s * value
            angle[k] = x
        self._angle = x
        return np.column_stack([angle, others]), np.column_stack([valid.all(axis=1), valid[:, : others.shape[1]]])

    def estimates(self) -> tuple[Estimate, ...]:
        """Return the derivatives so far; none if the data do not decide them yet."""
        fit = self.regression.fit()
        if fit is None:
            return ()
        std = np.sqrt(np.diag(fit.corrected))
        away = self._y[:, 0].mean() / ALPHA_RAD if len(self._y) else 0.0
        form = float(np.hypot(FORM_STD["alpha"] * away, LEAST_FORM))
        freedom = max(2.0 * len(self.regression.lines) * float(np.mean(fit.weights)) - len(std) / 2.0, 1.0)
        out = []
        for name, value, error in zip(self.regression.names, fit.step.tolist(), std.tolist(), strict=True):
            if error > _NOTHING * max(abs(value), abs(self.before.get(name) or 0.0)):
                continue  # its control has not moved
            believed = self.before.get(name) or None
            share = self.wanted.get(name, self.wanted.get("", 0.0)) if name in self.targets else 0.0
            goal = share * abs(believed if believed else value)
            reached = error <= goal
            more_s = None if reached or not goal else self._more_s(self._ended.get(name, np.inf) / goal)
            error = float(np.hypot(error, form * abs(value)))
            half = float(student.ppf(0.975, freedom)) * error
            out.append(Estimate(name, value, error, half, believed, goal, reached, more_s))
        return tuple(out)

    def _more_s(self, times: float) -> float | None:
        """Return the time in manoeuvres until a standard error is reached that is so many ``times`` smaller.

        Information grows by as much with each as it did so far; within one it comes with its steps.
        """
        if (
            not self._flown_s
            or not np.isfinite(times)
            or not {c for r in self.runs for c in r.moved} >= {*self.sources}
        ):
            return None
        return max(self._flown_s * (times**2 - 1.0) - self._elapsed_s, 0.0)

    def _watching(self, quiet: FloatArray) -> Watched | None:
        """Return the bank of filters, which has flown the undisturbed flight (n, channels) before a run."""
        self._lead_taken = 0
        if self._drawn < _FEWEST or not len(self.expected.directions):
            return None
        n, m = len(self.structure.states), len(self.sources)
        read = tuple(range(1 if self.integrated else 0, n))
        states, inputs = quiet[:, : len(read)], quiet[:, -m:]
        noise = np.maximum([self.noise(self.structure.states[i]) for i in read], _QUIETEST)
        if "V" in self.structure.inputs:
            inputs = np.column_stack([inputs, self._smooth_speed(quiet[:, -m - 1])])
        watched = Watched(self.expected.bank(self.believed, read, noise, self._acting, states, inputs), len(inputs))
        self._waiting = [np.hstack([inputs, np.zeros((len(inputs), n))]), states, np.ones(states.shape, bool)]
        self._slow_V, self._lead_taken = 0.0, len(self._run)
        return watched

    def weighed(self) -> tuple[Weighed, ...]:
        """Return whether the run is answered as believed, and by what it is explained else; () if nothing is told."""
        return self._watched.weigh() if self.active and self._watched is not None else ()

    def unexpected(self, weighed: Sequence[Weighed]) -> Weighed | None:
        """Return what explains a run that is not answered as believed, once, and again if it is another thing."""
        if not weighed or weighed[0].probability > DOUBTED:
            return None
        most = max(weighed[1:], key=lambda w: w.probability)
        if self._said and (most.probability < 1.0 - DOUBTED or self._said == f"{most.kind} {most.at}"):
            return None
        self._said = f"{most.kind} {most.at}"
        return most

    def name_of(self, weighed: Weighed) -> str:
        """Return the control or the state of an explanation; "" if it is of none."""
        if weighed.at < 0:
            return ""
        return self.structure.states[weighed.at] if weighed.kind == "reads" else self.structure.inputs[weighed.at]


def kinematics(plane: str, believed: Believed, block: FlightRecord) -> FloatArray:
    """Return what turns the states (b, n) beside the linear equations about the trim: frame, gravity and inertia.

    alphadot: g (cos(alpha) cos(theta) cos(phi) + sin(alpha) sin(theta)) / V - tan(beta) (p cos(alpha) + r sin(alpha));
    betadot: what p sin(alpha) - r cos(alpha) + g cos(theta) sin(phi) / V adds to its linear form;
    moments: the gyroscopic ones, with J the product of inertia. What is not measured is taken as at the trim; constants
    do not matter.
    """
    at, m = believed.at, believed.aircraft.mass
    rest = {"V": at.V, "alpha": at.alpha, "theta": at.theta}
    full = {n: block[n] if n in block else np.full(len(block), rest.get(n, 0.0)) for n in _FRAME}
    V, alpha, beta, p, q, r, phi, theta = full.values()
    V = np.maximum(V, 0.2 * at.V)
    if plane == "longitudinal":
        turn = -np.tan(beta) * (p * np.cos(alpha) + r * np.sin(alpha))
        fall = at.g * (np.cos(alpha) * np.cos(theta) * np.cos(phi) + np.sin(alpha) * np.sin(theta)) / V
        return np.column_stack([turn + fall, ((m.Izz - m.Ixx) * p * r - m.Ixz * (p**2 - r**2)) / m.Iyy])
    turn = p * (np.sin(alpha) - np.sin(at.alpha)) - r * (np.cos(alpha) - np.cos(at.alpha))
    fall = at.g * (np.cos(theta) * np.sin(phi) / V - np.cos(at.theta) * phi / at.V)
    a = m.Ixz * p * q - (m.Izz - m.Iyy) * q * r
    c = -(m.Iyy - m.Ixx) * p * q - m.Ixz * q * r
    det = m.Ixx * m.Izz - m.Ixz**2
    return np.column_stack(
        [turn + fall, (m.Izz * a + m.Ixz * c) / det, (m.Ixz * a + m.Ixx * c) / det, np.zeros(len(p))]
    )
