"""The believed aircraft and sensors, flown through the commands of a measured record.

Whatever flies a model raises FlightAborted, LimitError or TrimError where it does not survive the commands, and
RecordError of a record that holds no command or too little quiet flight; in this room that is said here alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft import Aircraft, Amendment, ScaleCoefficient
from testbench.core.channels import CONTROLS
from testbench.core.errors import LimitError, ModelError, RecordError, ScenarioError
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.effects import Effect
from testbench.effects.base import MetGust, grown_by, in_place, moved_by, raised
from testbench.flight import FlightCondition, LinearModel, Manoeuvre, TrimmedFlight
from testbench.flight.air import Air, Gust
from testbench.flight.batch.jobs import Simulator
from testbench.flight.simulate import commands as absolute_commands
from testbench.inference.linear import prewhitened
from testbench.inputs.signal import InputSignal
from testbench.line import flown_already
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import (
    DRIFT_OVER_S,
    commands,
    key_of_start,
    left_out,
    moves_on,
    not_compared,
    starts_freely,
    surface_noise,
)
from testbench.questions.gap.flights import Flyer, Wanted, flights, linear_models, made, trims
from testbench.questions.gap.priors import PRIORS, priors_of
from testbench.questions.gap.starts import Directions, FreeStart, Start, record_key, start_of
from testbench.sensors import SensorSuite
from testbench.sensors.sensor import responses

LATERAL_OUTPUTS = ("beta", "p", "r", "phi", "psi", "ay")  # that tell of the lateral motion alone
STEPS = 3  # that starts are brought to rest by
# Prior standard deviations: below NEAR one step is enough, below CLOSE none is flown. The start is taken out of
# residuals to first order, and within 0.1 deg or 0.3 % of the airspeed no more is left of it.
NEAR, CLOSE = 0.3, 0.05
NO_SERVO_RAD_S = 1e3  # corner frequency of a servo that a recorded surface passes: none at the rates of records
NOTHING = 1e-9  # a coefficient of a foreign model that is smaller is what differences leave of zero


@dataclass(frozen=True, eq=False)
class Believed:
    """What is believed of a flight: aircraft, sensor suite and the condition that the manoeuvres start from.

    ``whiten`` serves if turbulence colours the residuals: it takes a record and residuals (n, outputs) in units of
    the noise and returns as many, each white with variance one; it must be linear. ``gusts`` are those that single
    records met: every other record is predicted in still air. ``simulator`` "jsbsim" flies nothing in batches.
    Records that say so (:mod:`starts`) were flown from another condition or with another load: whatever is asked of
    a record is answered by :meth:`at`, whose ``start`` that is. ``free_starts`` are those of the records that do
    not begin at trim, by their keys (:func:`.windows.begin_freely`). ``off_trim`` are by how little those that
    begin at trim may be off it, by :func:`.starts.record_key` (:func:`.windows.nearly_trimmed`). ``surface_noise``
    is that of the recorded surfaces that drive the model in place of commands (:mod:`.drive`): control -> standard
    deviation. ``begins`` are the start parameters (k,), by the same keys as ``free_starts``, that starts are sought
    from, in place of the origins; with ``begins_there`` flights begin there, as differences between neighbours want
    it. ``over_time`` are effects that grow during the flight: (aircraft, sensors, time after take-off) -> both;
    where a record does not say when it was flown, nothing has grown. ``elsewhere`` are effects that move the
    condition: condition of a record -> the one that it was really flown from. ``condition`` is moved by them
    already, by ``higher_m`` in height; the limits of the height go along. ``later`` are effects with their values
    that begin in flight: they act in records that say so. ``surfaces`` are the controls whose recorded surfaces are
    channels as all others are, as their commands drive the model. ``colour`` is the correlation of the noise from
    sample to sample, by channel; 0 of those that it does not name: residuals are freed of it.

    Raises:
        ScenarioError: the suite has no channel to compare, or one without any noise.
    """

    aircraft: Aircraft
    suite: SensorSuite
    condition: FlightCondition
    rate_hz: float
    whiten: Callable[[FlightRecord, FloatArray], FloatArray] | None = None
    gusts: tuple[MetGust, ...] = ()
    simulator: Simulator = "auto"
    free_starts: Mapping[str, FreeStart] = field(default_factory=dict)
    off_trim: Mapping[str, FreeStart] = field(default_factory=dict)
    start: Start | None = None
    surface_noise: Mapping[str, float] = field(default_factory=dict)
    begins: Mapping[str, FloatArray] = field(default_factory=dict)
    begins_there: bool = False
    over_time: tuple[partial[tuple[Aircraft, SensorSuite]], ...] = ()
    elsewhere: tuple[partial[FlightCondition], ...] = ()
    higher_m: float = 0.0
    later: tuple[tuple[Effect, Mapping[str, float]], ...] = ()
    surfaces: tuple[str, ...] = ()
    colour: Mapping[str, float] = field(default_factory=dict)
    _by_start: dict[Start, Believed] = field(default_factory=dict, init=False, repr=False)
    _begun: dict[str, list[tuple[FloatArray, float]]] = field(default_factory=dict, init=False, repr=False)
    _aimed: dict[tuple[str, int], FloatArray] = field(default_factory=dict, init=False, repr=False)
    _readings: dict[tuple[str, bytes], FloatArray] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not _outputs(self.suite):
            got = "; ".join((", ".join(self.suite.channels), *not_compared(self.suite)))
            raise ScenarioError([f"a suite must have a channel that is compared, got {got}"])
        if silent := _silent(self.suite, self.surfaces):
            raise ScenarioError(
                [
                    "every sensor that is compared must have noise_std or quantum > 0, as residuals are weighed by "
                    f"its noise, got none for {', '.join(silent)} in suite '{self.suite.name}'"
                ]
            )

    @cached_property
    def trimmed(self) -> TrimmedFlight:
        """The believed equilibrium."""
        return made(trims([self.flyer])[0])

    def at(self, record: FlightRecord) -> Believed:
        """Return the belief in the condition, and with the load, that a record says it was flown from.

        Effects, nuisances and sensors are the same: the load comes on top, and what has grown by then. Its trim and
        linear model are made once.

        Raises:
            RecordError: what the record says is no start.
            ModelError: the belief is that at another start already.
        """
        start = start_of(record)
        if start is not None and not self.over_time:  # then it does not matter when that was
            start = replace(start, at_s=self.start.at_s if self.start is not None else None)
        if start is not None and not self.later:
            start = replace(start, changed=self.start is not None and self.start.changed)
        here = self.start or (None if self.elsewhere else Start(self.condition))
        if start is None or start == here:
            return self
        if self.start is not None:
            raise ModelError(f"a belief about flights from {self.start} cannot be asked about one from {start}")
        if start not in self._by_start:
            aircraft, suite = start.loaded(replace(self.aircraft, rate_hz=self.rate_hz), self.suite)
            there = replace(
                self, aircraft=aircraft, suite=suite, condition=start.condition, start=start, elsewhere=(), higher_m=0.0
            )
            for moved in self.elsewhere:
                there = there._moved(moved)
            there = there if start.at_s is None else there.after(start.at_s)
            self._by_start[start] = there.begun_later() if start.changed else there
        return self._by_start[start]

    def begun_later(self) -> Believed:
        """Return the belief with what begins in flight."""
        out = replace(self, later=())
        for effect, values in self.later:
            out = out.with_effect(effect, values)
        return out

    def after(self, at_s: float) -> Believed:
        """Return the belief with what has grown so many s after take-off."""
        aircraft, suite = self.aircraft, self.suite
        for grown in self.over_time:
            aircraft, suite = grown(replace(aircraft, rate_hz=self.rate_hz), suite, at_s)
        return replace(self, aircraft=aircraft, suite=suite, over_time=())

    def at_each(self, records: Sequence[FlightRecord]) -> list[Believed]:
        """Return :meth:`at` of several records, each condition and load once."""
        return list({id(there): there for there in map(self.at, records)}.values())

    def with_effect(self, effect: Effect, values: Mapping[str, float]) -> Believed:
        """Return the belief with one effect of the library added, or with all parts of one that is put together."""
        if effect.parts:
            out, rest = self, dict(values)
            for part in effect.parts:
                own = {p.name: rest.pop(f"{part.name}.{p.name}") for p in part.parameters}
                out = out.with_effect(part, own)
            return out
        if effect.later:
            return replace(self, later=(*self.later, (replace(effect, later=False), dict(values))))
        if effect.over_time is not None:
            return replace(self, over_time=(*self.over_time, partial(grown_by, effect, dict(values))))
        aircraft, suite = effect.amend(replace(self.aircraft, rate_hz=self.rate_hz), self.suite, values)
        aircraft = in_place(aircraft, len(self.aircraft.amendments), effect)
        gusts = self.gusts if effect.met is None else (*self.gusts, effect.met(values))
        out = replace(self, aircraft=aircraft, suite=suite, gusts=gusts)
        return out if effect.elsewhere is None else out._moved(partial(moved_by, effect, dict(values)))

    def _moved(self, moved: partial[FlightCondition]) -> Believed:
        """Return the belief in the condition that an effect moves this one to."""
        condition = moved(self.condition)
        higher_m = self.higher_m + condition.h_m - self.condition.h_m
        return replace(self, condition=condition, higher_m=higher_m, elsewhere=(*self.elsewhere, moved))

    def with_nuisances(self, nuisances: Mapping[str, float]) -> Believed:
        """Return the belief with nuisances at these values: coefficients multiplied by them."""
        changes = tuple(ScaleCoefficient(name, f) for name, f in nuisances.items())
        amendment = Amendment("tuning", "re-tuned coefficients", changes)
        return replace(self, aircraft=self.aircraft.amended(amendment))

    def priors_of(self, records: Sequence[FlightRecord]) -> Mapping[str, float]:
        """Return the nuisances of hypotheses about these records, see :func:`priors_of`: those that the aircraft has.

        An aircraft without a rudder has no Cn_dr, and what is zero stays zero however it is scaled. Where nothing but
        lateral motion is read, longitudinal coefficients would show in turns alone: only a lateral misfit could move
        them, far from anything that is believed. A surface tells of no coefficient.
        """
        read = tuple(n for n in self.outputs if n not in LATERAL_OUTPUTS and n not in self.surfaces)
        known = {n: d for n, d in priors_of(records, self.aircraft).items() if read or n not in PRIORS}
        if self.aircraft.adapter is None:
            return {n: d for n, d in known.items() if f'"aero/coefficient/{n}"' in self.aircraft.xml}
        without = {c for c in CONTROLS if c not in self.aircraft.controls}
        known = {n: d for n, d in known.items() if n.partition("_")[2] not in without}
        return {n: d for n, d in known.items() if abs(self.aircraft.coefficient(n)) > NOTHING}

    def predict(self, record: FlightRecord) -> FloatArray:
        """Return what the believed sensors would have read on this record, (n, outputs), without noise, from JSBSim.

        The measured commands, as deviations from the quiet flight before them, are held from sample to sample and added
        to the believed trim.
        """
        at = self.begun(record)
        if at is not None:
            return self.read_from(record, at)
        there = self.at(record)
        return there._read(there.flown(record, there.needed))

    def free_start_of(self, record: FlightRecord) -> FreeStart | None:
        """Return what the start of a record is made of; None for one that begins at trim."""
        if not starts_freely(record):
            return None
        key = key_of_start(record)
        if key not in self.free_starts:
            raise RecordError("the start of a window must be known before it is flown; call windows.begin_freely")
        return self.free_starts[key]

    def begun(self, record: FlightRecord, steps: int = STEPS) -> FloatArray | None:
        """Return the start parameters (k,) that suit this model best on a record; None if it begins at trim.

        Steps of Gauss-Newton on the tangents of its start, as long as they suit it better, from where ``begins`` says
        or from the origin, whichever suits it better.
        """
        free = self.free_start_of(record)
        if free is None:
            return None
        key = key_of_start(record)
        if self.begins_there and key in self.begins:
            return self.begins[key]
        tried = self._begun.setdefault(key, [])
        while len(tried) <= steps:
            x = self.next_start(record, len(tried))
            cost = math.inf if x is None else self.cost_of_start(record, x)
            if not tried and x is not free.origin:  # where its neighbour began may be far from where it does
                there = self.cost_of_start(record, free.origin)
                x, cost = (free.origin, there) if there < cost else (x, cost)
            if x is None or (tried and not cost < tried[-1][1]):
                # it rests, or the tangents are those of another model, and lead astray
                tried += [tried[-1]] * (steps + 1 - len(tried))
                break
            near = bool(tried) and _farthest(free, x, tried[-1][0]) < NEAR
            tried.append((x, cost))
            if near:
                tried += [tried[-1]] * (steps + 1 - len(tried))
        return tried[steps][0]

    def next_start(self, record: FlightRecord, steps: int) -> FloatArray | None:
        """Return the start parameters (k,) that are flown next by ``begun``.

        None if so many steps are made already, or another one would be too small to be flown.
        """
        free, key = self.free_start_of(record), key_of_start(record)
        assert free is not None
        tried = self._begun.get(key, [])
        if len(tried) > steps:
            return None
        if not tried:
            return self.begins.get(key, free.origin)
        if (key, len(tried)) not in self._aimed:
            self._aimed[key, len(tried)] = self.better_start(record, tried[-1][0])
        x = self._aimed[key, len(tried)]
        return None if _farthest(free, x, tried[-1][0]) < CLOSE else x

    def begun_at(self, records: Sequence[FlightRecord]) -> Mapping[str, FloatArray]:
        """Return where this model begins in each of the records that start freely, by their keys."""
        free = [r for r in records if starts_freely(r)]
        return {key_of_start(r): x for r in free if (x := self.begun(r)) is not None}

    def better_starts(self, records: Sequence[FlightRecord]) -> Mapping[str, FloatArray]:
        """Return starts, by their keys, one step on from where flights begin; empty if none is left that suits better.

        A step that does not suit a record better is not taken there.
        """
        here = dict(self.begun_at(records))
        free = {r: f for r in records if (f := self.free_start_of(r)) is not None}
        aimed = {r: self.better_start(r, here[key_of_start(r)]) for r in free}
        moved = {r: x for r, x in aimed.items() if _farthest(free[r], x, here[key_of_start(r)]) >= CLOSE}
        flights([self.wanted_to_read(r, x) for r, x in moved.items()])
        cost = self.cost_of_start
        better = {key_of_start(r): x for r, x in moved.items() if cost(r, x) < cost(r, here[key_of_start(r)])}
        return {**here, **better} if better else {}

    def beginning(self, starts: Mapping[str, FloatArray], there: bool = False) -> Believed:
        """Return the belief whose starts are sought from others, or lie there."""
        return replace(self, begins=starts, begins_there=there) if starts else self

    def cost_of_start(self, record: FlightRecord, x: FloatArray) -> float:
        """Return what is minimised over the parameters ``x`` (k,) of a start: chi-square and the price of the prior.

        Infinite where the flight does not survive, but for the origin.
        """
        free = self.free_start_of(record)
        assert free is not None
        try:
            r = self.over_noise(record, record.columns(self.outputs) - self.read_from(record, x))
        except (FlightAborted, LimitError):
            if x is free.origin:
                raise
            return float("inf")
        return float(np.sum(r**2) + np.sum(((x - free.centre) / free.std) ** 2))

    def better_start(self, record: FlightRecord, x: FloatArray) -> FloatArray:
        """Return the start parameters (k,) that a step of Gauss-Newton from ``x`` (k,) leads to."""
        free = self.free_start_of(record)
        assert free is not None
        left = record.columns(self.outputs) - self.read_from(record, x) + free.shift(x)
        return free.moved(x, self._directions(record, free).best(self.over_noise(record, left)))

    def _directions(self, record: FlightRecord, free: FreeStart) -> Directions:
        return free.directions(
            partial(self.over_noise, record), (self.whiten, self.noise_std.tobytes() + self.colours.tobytes())
        )

    def read_from(self, record: FlightRecord, at: FloatArray) -> FloatArray:
        """Return what :meth:`predict` does, of a record that starts freely with parameters ``at`` (k,)."""
        key = record_key(record), at.tobytes()
        if key not in self._readings:
            there = self.at(record)
            self._readings[key] = there._read(there.flown(record, there.needed, at=at))
        return self._readings[key]

    def check_commands(self, record: FlightRecord) -> None:
        """Refuse a record whose commands, about the trim of the belief, leave the range of a control.

        The trim that the commands of a record that starts freely belong to is not known: there controls stop at their
        ends.
        """
        if starts_freely(record):
            return
        names, u = commands(record)
        there = self.at(record)
        for i, (name, noise) in enumerate((n, surface_noise(record).get(n, 0.0)) for n in names):
            if noise > 0.0:  # which may lie beyond the end of a travel that the surface reached
                control, trim = there.aircraft.controls[name], there.trimmed.controls[name]
                within = np.clip(u[:, i], control.low - trim, control.full - trim)
                u[:, i] = np.where(np.abs(u[:, i] - within) <= CRITERIA.stirs * noise, within, u[:, i])
        signal = InputSignal(np.arange(len(u), dtype=np.float64) * record.dt_s, u, names)
        absolute_commands(there.aircraft, there.trimmed, Manoeuvre("measured commands", signal, 0.0))

    def flown(
        self,
        record: FlightRecord,
        channels: tuple[str, ...] | None = None,
        air: Air | None = None,
        at: FloatArray | None = None,
    ) -> FlightRecord:
        """Return the truth of that flight at the record's sample times: ``channels``, or all there are.

        ``air`` is flown through in place of the still air, or the gust, that the record is believed to have met. ``at``
        (k,) are the parameters of a free start, those that suit this model best if not given.
        """
        found = flights([self.wanted(record, channels, air, at)])[0]
        there = self.at(record)
        return flown_already(there.aircraft, there.trimmed, "measured commands", 1.0 / record.dt_s, found)

    def wanted(
        self,
        record: FlightRecord,
        channels: tuple[str, ...] | None = None,
        air: Air | None = None,
        at: FloatArray | None = None,
    ) -> Wanted:
        """Return what :meth:`flown` flies, to be asked for together with others."""
        gust = self.gust_in(record)
        air = Air(gust=gust) if air is None and gust is not None else air
        free, flyer = self.free_start_of(record), self.at(record).flyer
        if free is None:
            names, frames = _held(record, self.rate_hz)
            return Wanted(flyer, names, frames, 1.0 / record.dt_s, channels, air)
        at = self.begun(record) if at is None else at
        assert at is not None
        at = at + self._moved_trim(record, free)
        (names, u), offsets = commands(record), free.offsets(at)
        more = tuple(n for n in offsets if n not in names)
        names, u = (*names, *more), np.hstack([u, np.zeros((len(u), len(more)))])
        u = u + np.array([offsets.get(n, 0.0) for n in names])
        frames = at_frames(names, u, record, self.rate_hz, free.began(at))
        return Wanted(flyer, names, frames, 1.0 / record.dt_s, channels, air, free.start(at))

    def _moved_trim(self, record: FlightRecord, free: FreeStart) -> FloatArray:
        """Return by how much a start (k,) is told from another trim, where an effect that began in flight moves that.

        The aircraft did not wait for that trim: it is where it was, and so are its commands.
        """
        there = self.at(record)
        if not self.later or there.start is None or not there.start.changed:
            return np.zeros(len(free.names))
        before, after = replace(self, later=()).at(record).trimmed, there.trimmed
        angles = {n: getattr(before, n) - getattr(after, n) for n in ("alpha", "beta", "phi", "theta")}
        moved = angles | {n: before.controls[n] - value for n, value in after.controls.items()}
        return np.array([moved.get(n, 0.0) for n in free.names])

    def wanted_to_read(self, record: FlightRecord, at: FloatArray | None = None) -> Wanted:
        """Return what :meth:`predict` flies, likewise."""
        return self.wanted(record, self.at(record).needed, at=at)

    def gust_in(self, record: FlightRecord) -> Gust | None:
        """Return the gust that this very record met, if any."""
        key = record_key(record) if self.gusts else ""
        met = [g for g in self.gusts if g.record == key]
        if len(met) > 1:
            raise ModelError(f"a record can hold one gust, got {len(met)} in {met[0].manoeuvre}; leave all but one out")
        return met[0].gust if met else None

    def _read(self, truth: FlightRecord) -> FloatArray:
        """Return what sensors without noise make of a truth (n, outputs), logged at the suite's rate.

        The same as ``SensorSuite.measure`` of sensors that have no noise, without drawing any.
        """
        ideal = self._compared.ideal
        if any(s.rate_hz is not None for s in ideal.sensors):
            return ideal.measure(truth, 0).columns(self.outputs)
        stride = self.suite.check_log_rate(1.0 / truth.dt_s)
        felt = responses(ideal.sensors, truth)
        return np.take(felt[::stride], [ideal.channels.index(n) for n in self.outputs], axis=1)

    @property
    def linear(self) -> LinearModel:
        """The aircraft linearised about trim, all amendments in it."""
        return made(linear_models([self.flyer])[0])

    @cached_property
    def flyer(self) -> Flyer:
        """What flies."""
        return Flyer.of(raised(self.aircraft, self.higher_m), self.condition, self.rate_hz, self.simulator)

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Channels of the suite that are compared: all but commands, other surfaces and those left out."""
        return _outputs(self.suite, self.surfaces)

    @cached_property
    def colours(self) -> FloatArray:
        """Correlation of the noise of each output from sample to sample (outputs,)."""
        return np.array([self.colour.get(n, 0.0) for n in self.outputs])

    @property
    def noise_std(self) -> FloatArray:
        """Standard deviation of one sample of each output, what its bias wanders by within a manoeuvre in it, SI."""
        return self._compared.noise_std

    @property
    def needed(self) -> tuple[str, ...]:
        """The true channels that the suite's outputs are made of."""
        return self._compared.needed

    @cached_property
    def _compared(self) -> _Compared:
        return _compared(self.suite, self.surfaces)

    def residuals(self, record: FlightRecord) -> FloatArray:
        """Return measured minus predicted in units of the noise, each channel about its own mean, (n, outputs).

        The mean is taken out because sensor biases and trim offsets are unknown; invalid samples are set to zero. What
        an unknown start would change is taken out, too.
        """
        left, free = record.columns(self.outputs) - self.predict(record), self.free_start_of(record)
        if free is not None:
            at = self.begun(record)
            assert at is not None
            left = left + free.shift(at)
        return self.in_noise_units(record, left)

    def lost(self, record: FlightRecord) -> float:
        """Return the degrees of freedom that the unknown start of a record takes."""
        start = self._unknown_of(record)
        return 0.0 if start is None else self._directions(record, start).lost

    def _unknown_of(self, record: FlightRecord) -> FreeStart | None:
        """Return what is unknown of the start of a record, be it how well it is trimmed.

        A filter in turbulence takes the latter out by itself.
        """
        known = self.off_trim if self.whiten is None else {}
        return self.free_start_of(record) or known.get(record_key(record))

    def taken(self, record: FlightRecord) -> NDArray[np.bool_]:
        """Return which samples (n, outputs) of a record were taken."""
        return record.valid[:, [record.channels.index(n) for n in self.outputs]]

    def in_noise_units(self, record: FlightRecord, difference: FloatArray) -> FloatArray:
        """Return ``difference`` (n, outputs) over the noise, about its mean over the valid samples of the record.

        If the start of the record is unknown, what it would change is taken out (:mod:`.starts`).
        """
        r, start = self.over_noise(record, difference), self._unknown_of(record)
        return r if start is None else self._directions(record, start).taken_out(r)

    def over_noise(self, record: FlightRecord, difference: FloatArray) -> FloatArray:
        """Return the same, what a start would change left in."""
        valid = self.taken(record)
        r = difference / self.noise_std
        mean = (r * valid).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
        r = prewhitened((r - mean) * valid, self.colours, valid)
        if self.whiten is not None:
            return self.whiten(record, r)
        if not self.colours.any():
            return r
        one = prewhitened(valid.astype(float), self.colours, valid)  # what a bias is then
        return np.asarray(r - one * (np.sum(one * r, axis=0) / np.maximum(np.sum(one**2, axis=0), 1e-12)))


@dataclass(frozen=True, eq=False)
class _Compared:
    """What of a suite is compared."""

    noise_std: FloatArray  # (outputs,)
    # the outputs' sensors with everything that is certain (scale, lag, delay, position) and nothing random
    ideal: SensorSuite
    needed: tuple[str, ...]  # the true channels that they are made of


@lru_cache(maxsize=256)
def _outputs(suite: SensorSuite, surfaces: tuple[str, ...] = ()) -> tuple[str, ...]:
    read, without = {*suite.outputs, *surfaces}, left_out(suite)
    return tuple(n for n in suite.channels if n in read and n not in without)


@lru_cache(maxsize=256)
def _silent(suite: SensorSuite, surfaces: tuple[str, ...]) -> tuple[str, ...]:
    noise_std = suite.noise_std
    return tuple(n for n in _outputs(suite, surfaces) if not noise_std[n] > 0.0)


@lru_cache(maxsize=256)
def _compared(suite: SensorSuite, surfaces: tuple[str, ...]) -> _Compared:
    outputs = _outputs(suite, surfaces)
    drift = {s.channel: s.drift_over(DRIFT_OVER_S) for s in suite.sensors}
    noise_std = np.array([float(np.hypot(suite.noise_std[n], drift[n])) for n in outputs])
    ideal = replace(suite, sensors=tuple(s for s in suite.sensors if s.channel in outputs)).without_errors()
    return _Compared(noise_std, ideal, tuple(dict.fromkeys(n for s in ideal.sensors for n in s.needs)))


def _farthest(free: FreeStart, x: FloatArray, y: FloatArray) -> float:
    """Return how far two starts lie apart in the parameter in which they do most, in prior standard deviations."""
    return float(np.max(np.abs(x - y) / free.std))


@lru_cache(maxsize=128)
def _held(record: FlightRecord, rate_hz: float) -> tuple[tuple[str, ...], bytes]:
    """Return the controls that a record commands, and the bytes of their deviations at every frame.

    The last command acts after the record.
    """
    names, u = commands(record)
    return names, at_frames(names, u, record, rate_hz)


def at_frames(
    names: Sequence[str], u: FloatArray, record: FlightRecord, rate_hz: float, began: Mapping[str, float] | None = None
) -> bytes:
    """Return the bytes of commands (n, m) at every frame: held from sample to sample, or on straight lines.

    What moves on between samples (:func:`.evidence.commanded.moves_on`) lies on straight lines. A surface that drives
    the model is early by what is left of the servo's lag. A control that ``began`` elsewhere is
    commanded there for one frame: a flight begins with servos and engines where the first frame holds them.
    """
    fine = round(rate_hz * record.dt_s)
    out = np.repeat(u[:-1], fine, axis=0)
    frame = np.arange(len(out)) / fine
    for i, name in enumerate(names):
        on = np.repeat(moves_on(record, name, u[:, i])[:-1], fine)
        early = 1.0 / (NO_SERVO_RAD_S * record.dt_s) if name in surface_noise(record) else 0.0
        out[on, i] = np.interp(frame[on] + early, np.arange(len(u)), u[:, i])
    for name, value in (began or {}).items():
        out[0, names.index(name)] += value
    return out.tobytes()
