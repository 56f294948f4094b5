"""Tangents: derivatives of flights by all parameters at once, by differences whose steps the flights choose.

    D_j = (y(x + h_j) - y(x - h_j)) / 2 h_j,    h_j = c STEPS_j,    error of D_j: |D_j - D_j+1|

with c what is large for the parameter. The difference of two rungs of this ladder holds what the larger step cuts off,
which falls as h^2, and what rounding leaves of the smaller one, which grows as 1/h (Ridders 1982, Adv. Eng. Software 4,
75). Each channel of each parameter takes the rung where that difference is least, as rounding is not the same in all:
a height is the difference of radii, which doubles hold to 1e-9 m. All points of all parameters fly in one batch.

Why not dual numbers: they double the registers and more than double the arithmetic for every direction, need a second
form of every operation, table, filter and trim, and a second check of each against JSBSim. They give what differences
leave at 1e-6 (median of a channel's largest derivative, taurus and eolo) to 1e-12, which no noise of a sensor would
show. They are silent at a kink: both sides of a rate limit have a derivative, the flight in between has none. And they
do not serve the models that only JSBSim flies, for which differences give the same numbers. Who wants them has them
from JAX (as_jax): of a flight of 2 s of taurus, six take 66 ms once they are compiled, which takes 13 s; differences
with their check 120 ms, trims and records included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import AIRCRAFT_KEYS, varied
from testbench.core.blas import on_one_thread
from testbench.core.channels import channel
from testbench.core.differences import Ends, ends, slope
from testbench.core.errors import LimitError, ModelError, Refusal, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.batch.check import least_range
from testbench.flight.batch.fly import fly_jobs
from testbench.flight.batch.jobs import Job, Simulator, Tally
from testbench.flight.batch.trim import trim_many
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.simulate import Manoeuvre, aborted

STEPS = (1e-2, 1e-3, 1e-4, 1e-5)
"""The ladder, in shares of what is large for a parameter."""
_SEEN = 1e-3  # of a channel's range, made by a change that is large: what is less counts as no effect
_SURE = 1e-2  # of the largest derivative in a channel: more is said
_ROUNDING = 5.0  # times what rounding can do, as the smallest step shows it, that the gap of two sides must exceed
_CONDITION = {"V_m_s": "V_m_s", "h_m": "h_m", "gamma_rad": "gamma_rad"}
_START = ("alpha", "beta", "theta", "phi")
_LARGE_H_M, _LARGE_CG_CHORDS, _LARGE_PERCENT = 1000.0, 1.0, 100.0


Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FlightParameter:
    """What a flight is differentiated by.

    Attributes:
        name: a key of :func:`tangents`, or any name if ``change`` is given.
        value: where the derivative is taken, in the parameter's own unit.
        large: a change that is large for it; steps are shares of it.
        change: takes the aircraft and a value, and returns the aircraft with it; None for a key.

    Example:
        >>> import testbench as tb
        >>> tb.FlightParameter("aircraft.mass_percent", value=5.0, large=100.0).value
        5.0
    """

    name: str
    value: float
    large: float
    change: Callable[[Aircraft, float], Aircraft] | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.large) and self.large > 0.0):
            raise LimitError(
                f"a parameter needs a finite value and large > 0, got {self.value:g} and {self.large:g} for {self.name}"
            )


@dataclass(frozen=True, eq=False)
class Tangents:
    """Derivatives of one flight.

    Attributes:
        truth: the flight at the parameters' values.
        parameters: what it is differentiated by, p.
        derivatives: (n, m, p) of the m channels of ``truth``, SI per unit of each parameter.
        errors: (m, p) estimated greatest error of them over the samples.
        steps: (m, p) used for them, in units of each parameter.
        central: (p,) True where both sides flew; else the difference is one-sided.
        checked: False if steps and errors were found on another flight, and the differences are forward.
        flights: that it took.
        flown_by: "batch" or "jsbsim".
        notes: what is to be known of them, in sentences; none if nothing is.
    """

    truth: FlightRecord
    parameters: tuple[FlightParameter, ...]
    derivatives: FloatArray
    errors: FloatArray
    steps: FloatArray
    central: tuple[bool, ...]
    checked: bool
    flights: int
    flown_by: str
    notes: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in their order."""
        return tuple(x.name for x in self.parameters)

    def of(self, channel: str, parameter: str) -> FloatArray:
        """Return the derivative (n,) of a channel by a parameter.

        Raises:
            LimitError: there is no such channel or parameter.
        """
        for name, known, what in ((channel, self.truth.channels, "channel"), (parameter, self.names, "parameter")):
            if name not in known:
                raise LimitError(f"the tangents have no {what} '{name}'{nearest(name, known)}")
        return self.derivatives[:, self.truth.channels.index(channel), self.names.index(parameter)]

    @property
    def relative_errors(self) -> FloatArray:
        """The errors (m, p) over the largest derivative of each channel; 0 where a parameter has no effect."""
        size = np.maximum(np.max(np.abs(self.derivatives), axis=0, initial=0.0), self.errors)
        return np.divide(self.errors, size, out=np.zeros_like(size), where=_affected(self.truth, size, self.parameters))


@on_one_thread
def tangents(
    jobs: Sequence[Job],
    parameters: Sequence[str | FlightParameter],
    held: bool = False,
    checked: int | None = None,
    simulator: Simulator = "auto",
) -> list[Tangents]:
    """Return the derivatives of flights by all parameters, with an estimate of their error.

    ``coefficient.NAME`` is a factor on a coefficient, taken at 1; ``aircraft.mass_percent``, ``.Iyy_percent``,
    ``.cg_x_m`` and their like are changes, taken at 0. ``condition.V_m_s``, ``.h_m`` and ``.gamma_rad`` need a trim of
    its own at every point, ``start.alpha``, ``.beta``, ``.theta`` and ``.phi`` (rad) one that is held.
    ``property.NAME`` and what no key names are given as a :class:`FlightParameter`.

    A checked flight takes 8 p + 1 flights of p parameters, any other p + 1. The error of a parameter whose flights have
    a kink at its value, where no step helps, is as large as the two sides are apart, and a note says so.

    Args:
        jobs: flights that are differentiated; they differ in their manoeuvres alone.
        parameters: keys, or parameters of your own.
        held: all points start from the trim of the jobs; else each is trimmed at its condition.
        checked: so many flights, the first ones, choose their steps and check them; the others take forward differences
            by the steps found there. All are checked if not given.
        simulator: see :func:`testbench.fly_many`. Where JSBSim flies, it flies all points of a flight.

    Raises:
        LimitError, ModelError, TrimError: the flight cannot begin, or a parameter cannot be moved either way; or jobs
            differ in more than their manoeuvres.
        FlightAborted: it leaves its limits.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> t = np.arange(round(5.0 * taurus.rate_hz)) / taurus.rate_hz
        >>> pulse = tb.Manoeuvre("pulse", tb.InputSignal(t, np.deg2rad(1.0) * (t < 1.0)[:, None], ("de",)))
        >>> trimmed = tb.trim(taurus, tb.FlightCondition(12.0, 100.0))
        >>> found = tb.tangents([tb.Job(taurus, trimmed, pulse, 60.0, ("q",))], ["coefficient.Cm_q"])
        >>> found[0].derivatives.shape, bool(found[0].relative_errors.max() < 1e-4)
        ((421, 1, 1), True)
    """
    if not jobs:
        return []
    first = jobs[0]
    for job in jobs:
        if any(getattr(job, name) is not getattr(first, name) for name in ("aircraft", "trimmed", "air", "start")) or (
            (job.log_rate_hz, job.channels) != (first.log_rate_hz, first.channels)
        ):
            raise LimitError(
                "flights that are differentiated together must have one aircraft, trim, air and log, and differ in "
                f"their manoeuvres alone; '{job.manoeuvre.name}' differs: give it to tangents by itself"
            )
    wanted = tuple(_parameter(x, first, held) for x in parameters)
    if not wanted or len({x.name for x in wanted}) < len(wanted):
        names = ", ".join(x.name for x in wanted)
        raise LimitError(f"parameters must be one or more that differ, got {names or 'none'}")
    points = _Points(first, wanted, held, simulator)
    manoeuvres = [job.manoeuvre for job in jobs]
    if checked is not None and checked < 1:
        raise LimitError(f"checked >= 1 must hold, as steps are chosen on a flight that is checked, got {checked}")
    count = len(manoeuvres) if checked is None else min(checked, len(manoeuvres))
    out = [_checked(points, m) for m in manoeuvres[:count]]
    if count == len(manoeuvres):
        return [x for x, _ in out]
    known = [rungs for _, rungs in out]
    return [*(x for x, _ in out), *_forward(points, manoeuvres[count:], known)]


@dataclass(frozen=True, eq=False)
class _Points:
    """Everything that flights at points of the parameters have in common."""

    job: Job
    parameters: tuple[FlightParameter, ...]
    held: bool
    simulator: Simulator
    trims: dict[tuple[bytes, Simulator], tuple[Aircraft, TrimmedFlight | Refusal]] = field(default_factory=dict)

    @property
    def at(self) -> FloatArray:
        return np.array([x.value for x in self.parameters])

    @property
    def large(self) -> FloatArray:
        return np.array([x.large for x in self.parameters])

    def started(
        self, points: Sequence[FloatArray], simulator: Simulator
    ) -> list[tuple[Aircraft, TrimmedFlight | Refusal]]:
        """Return aircraft and trim of each point (p,); the trims that are new are found together."""
        new: dict[tuple[bytes, Simulator], tuple[Aircraft, FlightCondition]] = {}
        trimmed = self.job.trimmed
        for x in points:
            key = x.tobytes(), simulator
            if key in self.trims or key in new:
                continue
            values = {p.name: float(v) for p, v in zip(self.parameters, x, strict=True)}
            try:
                aircraft = self._changed(values)
            except ModelError as error:
                self.trims[key] = self.job.aircraft, error
                continue
            if self.held:
                moved = {n.partition(".")[2]: v for n, v in values.items() if n.startswith("start.")}
                self.trims[key] = aircraft, replace(trimmed, **moved)  # type: ignore[arg-type]
            else:
                moved = {n.partition(".")[2]: v for n, v in values.items() if n.startswith("condition.")}
                new[key] = aircraft, replace(trimmed.condition, **moved)
        fly = [a for a, _ in new.values()]
        blowing = [self.job.air] * len(fly)
        for (key, (aircraft, _)), found in zip(
            new.items(), trim_many(fly, [c for _, c in new.values()], trimmed.rate_hz, blowing, simulator), strict=True
        ):
            self.trims[key] = aircraft, found
        return [self.trims[x.tobytes(), simulator] for x in points]

    def _changed(self, values: Mapping[str, float]) -> Aircraft:
        keys = {p.name: values[p.name] for p in self.parameters if p.change is None}
        aircraft = varied(self.job.aircraft, keys, "tangents", "parameters that a flight is differentiated by")
        for p in self.parameters:
            if p.change is not None:
                aircraft = p.change(aircraft, values[p.name])
        return aircraft

    def fly(self, asked: Sequence[tuple[Manoeuvre, FloatArray]]) -> tuple[list[FlightRecord | Refusal], str, str]:
        """Fly each manoeuvre at its point; return what came of each, what flew all of them, and why not a batch.

        Where one of them is left to JSBSim, it flies all: what it and a batch differ by, 1e-10 of a range, is as large
        as what a small step makes.
        """
        told = Tally()
        flown = self._fly(asked, self.simulator, told)
        if not told.jsbsim:
            return flown, "batch", ""
        reason = max(told.reasons, key=lambda r: told.reasons[r])
        if told.batch:
            flown = self._fly(asked, "jsbsim", Tally())
        return flown, "jsbsim", reason

    def _fly(
        self, asked: Sequence[tuple[Manoeuvre, FloatArray]], simulator: Simulator, told: Tally
    ) -> list[FlightRecord | Refusal]:
        starts = self.started([x for _, x in asked], simulator)
        out: list[FlightRecord | Refusal | None] = [None] * len(asked)
        jobs, places = [], []
        for i, ((manoeuvre, _), (aircraft, trimmed)) in enumerate(zip(asked, starts, strict=True)):
            if isinstance(trimmed, Refusal):
                out[i] = trimmed
            else:
                jobs.append(replace(self.job, aircraft=aircraft, trimmed=trimmed, manoeuvre=manoeuvre))
                places.append(i)
        for i, record in zip(places, fly_jobs(jobs, simulator, told, fewest=1), strict=True):
            out[i] = record
        return [x for x in out if x is not None]

    def centre(self, flown: FlightRecord | Refusal, manoeuvre: Manoeuvre) -> FlightRecord:
        """Return the flight that is differentiated.

        Raises:
            TestbenchError: it could not begin, or ended before its time.
        """
        if isinstance(flown, Refusal):
            raise flown
        if flown.outcome == "aborted":
            raise aborted(flown, self.job.aircraft.name, manoeuvre.name, self.job.log_rate_hz)
        return flown


def _parameter(given: str | FlightParameter, job: Job, held: bool) -> FlightParameter:
    """Return what is differentiated by.

    Raises:
        LimitError: a key is none of those known, or asks for another kind of start.
        ModelError: the aircraft has no such coefficient.
    """
    if isinstance(given, FlightParameter) and given.change is not None:
        return given
    name, aircraft = given if isinstance(given, str) else given.name, job.aircraft
    head, _, rest = name.partition(".")
    found: FlightParameter | None = None
    if head == "coefficient" and rest:
        found = FlightParameter(name, 1.0, 1.0)
    elif head == "aircraft" and rest in AIRCRAFT_KEYS:
        length = rest.startswith("cg_")
        found = FlightParameter(name, 0.0, _LARGE_CG_CHORDS * aircraft.geometry.cbar_m if length else _LARGE_PERCENT)
    elif head == "condition" and rest in _CONDITION:
        if held:
            raise LimitError(f"{name} needs a trim of its own at every point: held = False must hold")
        value = getattr(job.trimmed.condition, rest)
        found = FlightParameter(name, value, {"V_m_s": value, "h_m": _LARGE_H_M, "gamma_rad": 1.0}[rest])
    elif head == "start" and rest in _START:
        if not held:
            raise LimitError(f"{name} needs a start that is held: held = True must hold")
        found = FlightParameter(name, getattr(job.trimmed, rest), 1.0)
    elif head == "property" and rest:
        if isinstance(given, str):
            raise LimitError(
                f"{name} must say where its derivative is taken: give tb.FlightParameter('{name}', value, "
                "large), with a change that is large for it"
            )
        found = given
    if found is None:
        known = [f"aircraft.{n}" for n in AIRCRAFT_KEYS]
        known += [f"condition.{n}" for n in _CONDITION] + [f"start.{n}" for n in _START]
        hint = nearest(name, [*known, "coefficient.NAME", "property.NAME"])
        raise LimitError(f"a parameter must be one of the keys, or have a change of its own, got '{name}'{hint}")
    varied(aircraft, {name: found.value}, "tangents", "")  # it has such a coefficient
    return found if isinstance(given, str) else given


@dataclass(frozen=True, eq=False)
class _Rungs:
    """What a checked flight says of forward differences: step (p,) of each parameter, relative error (m, p) by it."""

    steps: FloatArray
    errors: FloatArray


def _aligned(found: FlightRecord | Refusal, centre: FlightRecord) -> FloatArray | None:
    """Return the samples (n, m) of a flight beside the centre, angles without a full turn between; None if it ended."""
    if isinstance(found, Refusal) or len(found) != len(centre):
        return None
    turns = np.round((found.data - centre.data) / (2.0 * np.pi))
    angles = np.array([channel(n).unit == "rad" for n in centre.channels])
    return np.where(angles & (turns != 0.0), found.data - 2.0 * np.pi * turns, found.data)


def _checked(points: _Points, manoeuvre: Manoeuvre) -> tuple[Tangents, _Rungs]:
    """Fly the ladder of every parameter in one batch, and choose."""
    x, p = points.at, len(points.parameters)
    asked = [x]

    def note(some: list[FloatArray]) -> list[FloatArray | None]:
        asked.extend(some)
        return [None] * len(some)

    for share in STEPS:
        ends(note, x, share * points.large, both=True)
    flown, by, reason = points.fly([(manoeuvre, point) for point in asked])
    centre = points.centre(flown[0], manoeuvre)
    data = iter([_aligned(f, centre) for f in flown[1:]])
    ladder = [ends(lambda some: [next(data) for _ in some], x, share * points.large, both=True) for share in STEPS]
    found = [_Ladder.of(points.parameters[k], centre, [rung[k] for rung in ladder]) for k in range(p)]
    for one, k in zip(found, range(p), strict=True):
        if one is None:
            first = next((f for f in flown[1 + 2 * k :: 2 * p] if isinstance(f, Refusal)), None)
            why = f": {first}" if first is not None else ", as its flights end before their time"
            raise LimitError(f"{points.parameters[k].name} cannot be moved from {x[k]:g} to either side{why}")
    good = [one for one in found if one is not None]
    notes = tuple(n for one in good for n in one.notes)
    if by == "jsbsim":
        notes = (f"JSBSim flew {manoeuvre.name} and the flights beside it, as {reason}", *notes)
    made = Tangents(
        centre,
        points.parameters,
        np.stack([one.derivative for one in good], axis=-1),
        np.stack([one.error for one in good], axis=-1),
        np.stack([one.steps for one in good], axis=-1),
        tuple(one.central for one in good),
        True,
        len(asked),
        by,
        notes,
    )
    return made, _Rungs(np.array([one.forward for one in good]), np.stack([one.forward_error for one in good], axis=-1))


@dataclass(frozen=True, eq=False)
class _Ladder:
    """What the rungs of one parameter say."""

    derivative: FloatArray  #: (n, m)
    error: FloatArray  #: (m,) greatest over the samples
    steps: FloatArray  #: (m,)
    central: bool  #: both sides flew
    forward: float  #: step of forward differences; negative if only the lower side flies
    forward_error: FloatArray  #: (m,) their error, of the largest derivative in each channel
    notes: tuple[str, ...]  #: sentences

    @classmethod
    def of(cls, parameter: FlightParameter, centre: FlightRecord, rungs: Sequence[Ends]) -> _Ladder | None:
        """Choose the rung of each channel; None if no two neighbours have a side in common that flies."""
        y, h = centre.data, np.array(STEPS) * parameter.large
        chosen: list[tuple[int, bool, FloatArray, FloatArray, FloatArray]] = []
        rounding = np.zeros(y.shape[1])
        for j in range(len(rungs) - 1):
            common = [a is not None and b is not None for a, b in zip(rungs[j], rungs[j + 1], strict=True)]
            if not any(common):
                continue
            (D, far), (E, near) = (_side(rungs[i], common, h[i], y) for i in (j, j + 1))
            ratio = h[j] / h[j + 1]
            smaller = ratio**2 if all(common) else ratio  # by which E is nearer than D where y is smooth
            apart = np.max(np.abs(D - E), axis=0) * smaller / (smaller - 1.0)
            # half the gap between the two sides, extrapolated to no step: nothing of it is left where y is smooth
            kink = np.max(np.abs(ratio * near - far), axis=0) / (ratio - 1.0)
            chosen.append((j, all(common), D, apart, kink))
            gap = np.max(np.abs(near), axis=0)
            rounding = h[j + 1] * np.maximum(apart, gap)  # of the smallest step, which shows more of it than of a kink
        if not chosen:
            return None
        apart = np.stack([c[3] for c in chosen])
        best = np.argmin(apart, axis=0)
        columns = np.arange(y.shape[1])
        derivative = np.stack([c[2] for c in chosen])[best, :, columns].T
        kinks = np.stack([c[4] for c in chosen])
        size = np.maximum(np.max(np.abs(derivative), axis=0), kinks.min(axis=0))  # opposite sides have no mean
        seen = _affected(centre, size[:, None], (parameter,))[:, 0]
        shown = np.stack([np.maximum(_SURE * size, _ROUNDING * rounding / h[c[0] + 1]) for c in chosen])
        larger = slice(None, -1)  # the pair with the smallest step shows both alike
        kinked = seen & np.all(kinks[larger] > shown[larger], axis=0) & (len(chosen) > 1 and all(c[1] for c in chosen))
        error = np.where(kinked, np.maximum(apart.min(axis=0), kinks.min(axis=0)), apart.min(axis=0))
        central = all(chosen[k][1] for k in np.unique(best))
        forward, forward_error = _forward_step(rungs, h, y, derivative, size, seen)
        steps = h[np.array([c[0] for c in chosen])][best]
        notes = _notes(parameter, centre.channels, seen, kinked, error, size, central)
        return cls(derivative, error, steps, central, forward, forward_error, notes)


def _side(of: Ends, common: Sequence[bool], step: float, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the derivative (n, m) by the sides that count, and half the gap between both (0 for one alone)."""
    up, down = (end if use else None for end, use in zip(of, common, strict=True))
    D = slope((up, down), step, lambda: y)
    assert D is not None  # one side counts
    if up is None or down is None:
        return D, np.zeros_like(D)
    return D, (up - 2.0 * y + down) / (2.0 * step)


def _forward_step(
    rungs: Sequence[Ends], h: FloatArray, y: FloatArray, derivative: FloatArray, size: FloatArray, seen: Flags
) -> tuple[float, FloatArray]:
    """Return the step of one-sided differences that are nearest to the derivatives, and how near, relative (m,)."""
    best: tuple[float, float, FloatArray] | None = None
    for (up, down), step in zip(rungs, h, strict=True):
        for end, signed in ((up, step), (down, -step)):
            if end is None or (signed < 0.0 and up is not None):
                continue
            off = np.max(np.abs((end - y) / signed - derivative), axis=0)
            relative = np.divide(off, size, out=np.zeros_like(off), where=seen)
            mean = float(np.mean(np.log(np.maximum(relative[seen], 1e-16)))) if seen.any() else 0.0
            if best is None or mean < best[0]:
                best = mean, float(signed), relative
    assert best is not None  # a rung flew
    return best[1], best[2]


def _affected(truth: FlightRecord, size: FloatArray, parameters: Sequence[FlightParameter]) -> Flags:
    """Return which channels (m, p) a large change of each parameter moves by more than _SEEN of their range."""
    spread = np.maximum(np.ptp(truth.data, axis=0), [least_range(n) for n in truth.channels])
    return np.asarray(size * np.array([x.large for x in parameters]) > _SEEN * spread[:, None])


def _notes(
    parameter: FlightParameter,
    channels: Sequence[str],
    seen: Flags,
    kinked: Flags,
    error: FloatArray,
    size: FloatArray,
    central: bool,
) -> tuple[str, ...]:
    out = []
    at = f"{parameter.name} at {parameter.value:g}"
    relative = np.divide(error, size, out=np.zeros_like(error), where=seen)
    if not seen.any():
        return (f"{at} moves no channel that is logged",)
    if kinked.any():
        k = int(np.argmax(np.where(kinked, relative, -1.0)))
        out.append(
            f"the flight has a kink at {at}: its derivatives to either side differ from their mean by "
            f"{_percent(relative[k])} in {channels[k]}, so that a limit, a switch or the edge of a table lies there"
        )
    unsure = seen & ~kinked & (relative > _SURE)
    if unsure.any():
        k = int(np.argmax(np.where(unsure, relative, -1.0)))
        names = ", ".join(n for n, u in zip(channels, unsure, strict=True) if u)
        out.append(
            f"derivatives of {names} by {at} change with the step, by {_percent(relative[k])} in {channels[k]} at best"
        )
    if not central:
        out.append(f"{at} can be moved to one side only: its differences are one-sided")
    return tuple(out)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _forward(points: _Points, manoeuvres: Sequence[Manoeuvre], known: Sequence[_Rungs]) -> list[Tangents]:
    """Fly forward differences of many flights together, by the steps of those that were checked."""
    x = points.at
    # the step that most of the checked flights found best; the largest error that any of them found
    steps = np.array([sorted(column)[len(column) // 2] for column in np.stack([r.steps for r in known]).T])
    relative = np.max(np.stack([r.errors for r in known]), axis=0)
    asked = [(m, point) for m in manoeuvres for point in (x, *(x + step for step in np.diag(steps)))]
    flown, by, reason = points.fly(asked)
    each, out = len(x) + 1, []
    for i, manoeuvre in enumerate(manoeuvres):
        mine = flown[i * each : (i + 1) * each]
        centre = points.centre(mine[0], manoeuvre)
        columns = []
        for k, found in enumerate(mine[1:]):
            end = _aligned(found, centre)
            if end is None:
                why = f": {found}" if isinstance(found, Refusal) else ""
                raise LimitError(
                    f"{manoeuvre.name} cannot be flown with {points.parameters[k].name} at {x[k] + steps[k]:g}{why}; "
                    "check all flights"
                )
            columns.append((end - centre.data) / steps[k])
        derivatives = np.stack(columns, axis=-1)
        size = np.max(np.abs(derivatives), axis=0)
        notes = (f"JSBSim flew {manoeuvre.name} and the flights beside it, as {reason}",) if by == "jsbsim" else ()
        all_steps = np.broadcast_to(np.abs(steps), size.shape).copy()
        one_sided = (False,) * len(x)
        out.append(
            Tangents(
                centre, points.parameters, derivatives, relative * size, all_steps, one_sided, False, each, by, notes
            )
        )
    return out
