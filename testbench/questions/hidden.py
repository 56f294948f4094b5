"""What really flies in place of what is believed: ``[hidden]`` of a gap scenario, and the cases of a data set.

It is told in the words of the library of effects, or of effects that are brought: JSBSim flies the aircraft with each
of them at the values that are given, its sensors read with theirs. What the library has no word for is a
:class:`Truth`, code of the user's own. What names an effect gets the records alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Discriminator, Field, Tag

from testbench.aircraft import Aircraft
from testbench.core import bring
from testbench.core.errors import ModelError, Refusal, ScenarioError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import AircraftName, FlownAt
from testbench.core.scenario.base import Manoeuvre as Entry
from testbench.core.schema import Positive, Strict
from testbench.effects import Effect, catalogue
from testbench.effects.base import grown_by, in_place, raised
from testbench.flight import FlightCondition, TrimmedFlight, load_aircraft, trim
from testbench.flight.air import Air, Gust
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.line import fly_and_measure
from testbench.questions.gap import brought
from testbench.questions.gap.starts import Start
from testbench.sensors import SensorSuite


@dataclass(frozen=True)
class Truth:
    """What really flies, in code of one's own: ``truth = "FILE.py:NAME"``. Each function may be left out.


    Example:
        >>> from dataclasses import replace
        >>> def amend(aircraft, suite, at_s):
        ...     sensors = (replace(s, scale=1.1) if s.channel == "alpha" else s for s in suite.sensors)
        ...     return aircraft, replace(suite, sensors=tuple(sensors))
        >>> TRUTH = Truth(amend=amend)
    """

    # (aircraft, sensors, s after take-off) -> both as they really are; neither argument is changed
    amend: Callable[[Aircraft, SensorSuite, float], tuple[Aircraft, SensorSuite]] | None = None
    # (controls, commands (frames, m) as deviations from trim, frame time in s, s after take-off) -> what reaches the
    # servos, of the same shape. Commands are recorded as they were issued.
    send: Callable[[Sequence[str], FloatArray, float, float], FloatArray] | None = None
    read: Callable[[FlightRecord], FlightRecord] | None = None  # measured record -> what is recorded in its place


_Noise = Annotated[
    Annotated[Positive, Tag("number")] | Annotated[dict[str, Positive], Tag("table")],
    Discriminator(lambda given: "table" if isinstance(given, Mapping) else "number"),
]


class HiddenEffect(Strict):
    """One effect of the true aircraft, with a value for each of its parameters: ``lag_rad_s = 12.0``.

    ``effect`` is a name of the library, or ``FILE.py:NAME``; each further key is a parameter of it, in the unit and
    within the bounds of the library. ``manoeuvre`` is the one that meets a gust; the first if not given.
    """

    model_config = ConfigDict(extra="allow")

    effect: Annotated[str, Field(min_length=1)]
    manoeuvre: str | None = None

    @property
    def values(self) -> dict[str, Any]:
        """Parameter -> value, as the file has them."""
        return dict(self.model_extra or {})


class Hidden(Strict):
    """The true aircraft of simulated records; an empty table: the a-priori model.

    ``effects`` act together, each with its values. ``aircraft`` and ``wings`` fly in place of the believed ones.
    ``noise`` is the real noise of the sensors over that of the suite: one number, or one for each channel that has
    another. ``truth`` is code of one's own, ``FILE.py:NAME``, that acts on what the effects have made.
    """

    effects: Annotated[tuple[HiddenEffect, ...], Field(strict=False)] = ()
    aircraft: AircraftName | None = None
    wings: Literal["flexible", "rigid"] | None = None
    noise: _Noise = 1.0
    truth: str | None = None

    def faults(self, asked: FlownAt, suite: SensorSuite, names: Sequence[str]) -> list[str]:
        """Return every law that the table breaks, with its key; no code of a user's is run.

        Args:
            asked: the scenario.
            suite: as believed.
            names: of the manoeuvres.
        """
        file = asked.file
        try:
            flown = load_aircraft(self.aircraft or asked.aircraft, self.wings or asked.wings)
        except Refusal as error:
            return [f"{'hidden.aircraft' if self.aircraft else 'aircraft'}: {error.message}"]
        out = _made(self, suite, flown, file, run=False)[1]
        for i, entry in enumerate(self.effects):
            if entry.manoeuvre is not None and entry.manoeuvre not in names:
                fault = f"unknown manoeuvre '{entry.manoeuvre}'{nearest(entry.manoeuvre, names)}"
                out.append(f"hidden.effects[{i}].manoeuvre: {fault}")
        for channel in self.noise if isinstance(self.noise, dict) else ():
            if channel not in suite.channels:
                out.append(f"hidden.noise: unknown channel '{channel}'{nearest(channel, suite.channels)}")
        if self.truth is not None:
            try:
                path, attribute = bring.find(self.truth, file, brought.FOLDER)
                bring.declared(path).need(attribute)
            except ScenarioError as error:
                out += [f"hidden.truth: {fault}" for fault in error.faults]
        return out

    def real(self, asked: FlownAt, suite: SensorSuite) -> Real:
        """Return what flies in place of what a scenario believes; files that are named are run.

        Raises:
            ScenarioError: an effect or its values break a law, or what is brought is neither an effect nor a Truth.
        """
        file, flown = asked.file, load_aircraft(self.aircraft or asked.aircraft, self.wings or asked.wings)
        acting, faults = _made(self, suite, flown, file, run=True)
        if faults:
            raise ScenarioError([f"{file}, {fault}" if file else fault for fault in faults])
        noise = self.noise if isinstance(self.noise, dict) else dict.fromkeys(suite.channels, self.noise)
        return Real(flown, acting, Truth() if self.truth is None else _own(self.truth, file), noise)


@dataclass(frozen=True)
class Acting:
    """An effect that really acts, its values (SI), and the manoeuvre that meets it if it is a gust ("": the first)."""

    effect: Effect
    values: Mapping[str, float]
    manoeuvre: str = ""


@dataclass(frozen=True, eq=False)
class Real:
    """What really flies."""

    aircraft: Aircraft  # before anything acts on it
    effects: tuple[Acting, ...] = ()  # that act, in this order
    truth: Truth = field(default_factory=Truth)  # that acts on what they have made
    noise: Mapping[str, float] = field(default_factory=dict)  # channel -> real noise over that of the suite

    def from_(self, start: Start, suite: SensorSuite) -> tuple[Aircraft, SensorSuite, FlightCondition]:
        """Return aircraft, sensors and condition as they really are where ``start`` is believed.

        Raises:
            ModelError: the aircraft cannot have an effect; RecordError: it cannot carry the load.
        """
        aircraft, sensors = start.loaded(self.aircraft, suite)
        condition, at_s = start.condition, start.at_s or 0.0
        for acting in self.effects:
            effect, values = acting.effect, acting.values
            if effect.over_time is not None:
                aircraft, sensors = grown_by(effect, values, aircraft, sensors, at_s)
                continue
            known = len(aircraft.amendments)
            aircraft, sensors = effect.amend(aircraft, sensors, values)
            aircraft = in_place(aircraft, known, effect)
            condition = condition if effect.elsewhere is None else effect.elsewhere(condition, values)
        aircraft = raised(aircraft, condition.h_m - start.condition.h_m)
        if self.truth.amend is not None:
            aircraft, sensors = self.truth.amend(aircraft, sensors, at_s)
        return aircraft, _noisier(sensors, self.noise), condition

    def gust_in(self, name: str, first: bool) -> Gust | None:
        """Return the gust that a manoeuvre meets, if any; ``first``: it is the first one."""
        for acting in self.effects:
            if acting.effect.met is not None and (acting.manoeuvre == name or (first and not acting.manoeuvre)):
                return acting.effect.met(acting.values).gust
        return None


def _noisier(suite: SensorSuite, factors: Mapping[str, float]) -> SensorSuite:
    sensors = (replace(s, noise_std=factors.get(s.channel, 1.0) * s.noise_std) for s in suite.sensors)
    return replace(suite, sensors=tuple(sensors))


def _made(
    hidden: Hidden, suite: SensorSuite, aircraft: Aircraft, file: Path | None, run: bool
) -> tuple[tuple[Acting, ...], list[str]]:
    """Return the effects of a table, of those that are brought only if their files may ``run``, and all faults."""
    acting, faults, known = [], [], catalogue(suite)
    for i, entry in enumerate(hidden.effects):
        key, name = f"hidden.effects[{i}]", entry.effect
        if wrong := brought.faults([name], suite, file):
            faults += [f"{key}.effect: {fault}" for fault in wrong]
            continue
        if bring.is_brought(name) and not run:
            continue
        effect = brought.load_effect(*bring.find(name, file, brought.FOLDER)) if bring.is_brought(name) else known[name]
        effect = effect.sized(aircraft)
        wrong = [f"{key}{fault}" for fault in value_faults(effect, entry.values)]
        if not wrong:
            acting.append(Acting(effect, {n: float(v) for n, v in entry.values.items()}, entry.manoeuvre or ""))
            try:
                effect.amend(aircraft, suite, acting[-1].values)
            except ModelError as error:
                wrong = [f"{key}.effect: {error.message}"]
        faults += wrong
    return tuple(acting), faults


def value_faults(effect: Effect, values: Mapping[str, Any]) -> list[str]:
    """Return every law that values of an effect's parameters break, each with its key: ``.lag_rad_s: must be ...``."""
    names, out = [p.name for p in effect.parameters], []
    for name in values:
        if name not in names:
            out.append(f".{name}: unknown parameter of {effect.name}{nearest(name, names)}")
    for p in effect.parameters:
        x = values.get(p.name)
        if x is None:
            out.append(f".{p.name}: the key is required and missing")
        elif isinstance(x, bool) or not isinstance(x, int | float) or not p.low <= x <= p.high:
            unit = "" if p.unit == "1" else f" {p.unit}"
            out.append(f".{p.name}: must be {p.low:g} to {p.high:g}{unit}, got {x!r}")
    return out


def _own(name: str, file: Path | None) -> Truth:
    """Return the truth of a user's file, whose errors name their line.

    Raises:
        ScenarioError: the file cannot be run, or what it names is no Truth.
    """
    path, attribute = bring.find(name, file, brought.FOLDER)
    found = bring.load(path, attribute)
    if not isinstance(found, Truth):
        raise ScenarioError(f"{path.name}:{attribute} must be a Truth, got {type(found).__name__}")

    def guarded(function: Any, what: str) -> Any:
        return None if function is None else brought.Guarded(function, path, f"{what} of '{attribute}'")

    return Truth(guarded(found.amend, "amend"), guarded(found.send, "send"), guarded(found.read, "read"))


@dataclass(frozen=True, eq=False)
class Commands:
    """One manoeuvre, as the on-board computer issues it."""

    name: str  # of the manoeuvre
    controls: tuple[str, ...]  # "de", "thr", ..
    u: FloatArray  # (n, controls) deviations from trim at the rate of the log, each held to the next
    settle_s: float  # flight at trim before the first one
    seed: int  # of the sensors' noise
    start: Start  # what is believed of the condition, load and time that it starts from
    air: Air | None = None  # that it flies through, if it meets no hidden gust; still air if None


def fly_hidden(
    real: Real,
    suite: SensorSuite,
    flights: Iterable[Commands],
    rate_hz: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> dict[str, FlightRecord]:
    """Fly what is hidden through manoeuvres; return name -> measured record, whose provenance does not tell of it.

    Args:
        real: what flies.
        suite: as believed.
        flights: the manoeuvres.
        rate_hz: frames a second; the aircraft's own if not given.
        progress: called with a few words as each manoeuvre begins.

    Raises:
        TrimError, FlightAborted, LimitError: it cannot fly the manoeuvres.
    """
    real = replace(real, aircraft=replace(real.aircraft, rate_hz=rate_hz or real.aircraft.rate_hz))
    starts: dict[Start, tuple[Aircraft, SensorSuite, TrimmedFlight]] = {}
    out: dict[str, FlightRecord] = {}
    for commands in flights:
        if progress:
            progress(f"fly {commands.name}")
        if commands.start not in starts:
            aircraft, sensors, condition = real.from_(commands.start, suite)
            starts[commands.start] = aircraft, sensors, trim(aircraft, condition, real.aircraft.rate_hz)
        aircraft, sensors, trimmed = starts[commands.start]
        u = np.repeat(commands.u, round(trimmed.rate_hz / suite.rate_hz), axis=0)
        gust, send = real.gust_in(commands.name, not out), real.truth.send
        sent = u if send is None else send(commands.controls, u, 1.0 / trimmed.rate_hz, commands.start.at_s or 0.0)
        signal = InputSignal(np.arange(len(u)) / trimmed.rate_hz, sent, commands.controls)
        manoeuvre = Manoeuvre(commands.name, signal, commands.settle_s)
        air = commands.air if gust is None else Air(gust=gust, seed=commands.seed)
        flight = fly_and_measure(Job(aircraft, trimmed, manoeuvre, suite.rate_hz, air=air), [sensors], commands.seed)
        measured = replace(flight.measured[sensors.name], provenance={"manoeuvre": commands.name})
        if send is not None:
            measured = as_issued(measured, u, commands.controls, trimmed, commands.settle_s)
        out[commands.name] = measured if real.truth.read is None else real.truth.read(measured)
    return out


def as_issued(
    record: FlightRecord, u: FloatArray, controls: Sequence[str], trimmed: TrimmedFlight, settle_s: float
) -> FlightRecord:
    """Return a record with the commands as they were issued, ``u`` (frames, m), not as they reached the servos."""
    data = record.data.copy()
    frames = round(settle_s * trimmed.rate_hz)
    issued = np.concatenate([np.zeros((frames, u.shape[1])), u, u[-1:]])[:: round(trimmed.rate_hz * record.dt_s)]
    for i, name in enumerate(controls):
        if f"{name}_cmd" not in record:
            continue  # of a suite that reads surfaces only
        data[:, record.channels.index(f"{name}_cmd")] = trimmed.controls[name] + issued[: len(record), i]
    for name in ("de", "dr"):
        if name not in controls and f"{name}_cmd" in record:  # a feedback moves it all the same
            data[:, record.channels.index(f"{name}_cmd")] = trimmed.controls[name]
    return replace(record, data=data)


def issued(
    suite: SensorSuite,
    condition: FlightCondition,
    manoeuvres: Sequence[Entry],
    seed: int,
    starts: Mapping[str, Start] | None = None,
) -> list[Commands]:
    """Return what is commanded in the manoeuvres of a scenario, for :func:`fly_hidden`.

    Commands are issued at the rate of the suite's log and held, as an on-board computer does. ``starts`` are those of
    manoeuvres that do not begin from ``condition`` without a load.
    """
    out = []
    for i, spec in enumerate(manoeuvres):
        built = build(spec.input, spec.duration_s, suite.rate_hz)
        start = (starts or {}).get(spec.name, Start(condition))
        out.append(Commands(spec.name, built.channels, built.u, spec.settle_s, seed + i, start))
    return out
