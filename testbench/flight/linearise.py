"""Linearise the simulator about a trimmed flight, elastic modes included."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft, Memory
from testbench.aircraft.airframe import station_rows
from testbench.core.channels import CONTROLS
from testbench.core.constants import FT_M
from testbench.core.errors import ChannelError, ModelError
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import ACCELERATIONS, Executive
from testbench.flight.law import HOLD, Law, law_along, with_law
from testbench.flight.linear_model import ENGINE, LAW, SERVO, LinearModel, index_of
from testbench.flight.trim import place_at_trim

_MANIFOLD = "propulsion/engine/map-pa"
_THROTTLE, _AIRSPEED = 0.02, 0.01  # kicks: of full throttle, and of the speed
_FRAME_S = 0.02
_RIGID = ("u", "v", "w", "p", "q", "r", "phi", "theta", "h")
_STEP = {"u": 0.05, "v": 0.05, "w": 0.05, "p": 1e-2, "q": 1e-2, "r": 1e-2, "phi": 1e-3, "theta": 1e-3, "h": 1.0}
_DERIVATIVES = (
    *ACCELERATIONS,
    ("velocities/phidot-rad_sec", 1.0),
    ("velocities/thetadot-rad_sec", 1.0),
    ("velocities/h-dot-fps", FT_M),
)
_FOURTH_ORDER = {-2: 1.0 / 12.0, -1: -8.0 / 12.0, 1: 8.0 / 12.0, 2: -1.0 / 12.0}  # weights of central differences
_SECOND_ORDER = {-1: -0.5, 1: 0.5}
_STUCK = 1e-6  # deflection per command below which a control does not turn
_NO_FEEDBACK = 1e-9  # deflection per unit of a state, less than differences of one number with itself leave
_SURFACES = ("de", "da", "dr")


def linearise(aircraft: Named[Aircraft], trimmed: TrimmedFlight) -> LinearModel:
    """Return the linear model about trim by fourth-order central differences of JSBSim's own equations.

    States: body velocities, rates, phi, theta, h, eta and etadot of every mode, those that amendments bring with them,
    and the speed of propellers (all engines alike) with the manifold pressure of piston engines; those that are
    governed or behind a gas generator are at their equilibrium throughout. Inputs: the deflections de, da, dr and thr,
    and the commands de_cmd, da_cmd, dr_cmd, which pass through the servo lags first (further states, through which a
    feedback to a command passes too), or are the deflections where there is no servo. Outputs: every channel of the
    simulator, and those of the wing stations.

    With its own control law the aircraft has the states of that, too: see :mod:`testbench.flight.law`. Those before the
    servos, taken alone (``subsystem``), are the aircraft without it.

    Example:
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> linear = tb.linearise(taurus, tb.trim(taurus, tb.FlightCondition(12.0, 100.0)))
        >>> linear.A.shape[0] == len(linear.states)
        True
    """
    aircraft = obtain(Aircraft, aircraft)
    point = _Point.of(aircraft, trimmed)
    at = point.layout.trim_of(trimmed)
    model = point.layout.model(point.values(point.layout.points(at)))
    if point.engine:
        model = with_engine(model, point.fdm, point.back, at)
    if not aircraft.under_law:
        return model
    return with_law(model, Law.of(Executive(aircraft, trimmed.rate_hz, trimmed.condition), trimmed))


def linearise_along(
    aircraft: Aircraft, trimmed: TrimmedFlight, flown: FlightRecord, states: Sequence[str]
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return the linear models about the states that a flight went through, by central differences of second order.

    Args:
        aircraft: the aircraft that flew.
        trimmed: where it began.
        flown: truth of the flight with every channel, n samples.
        states: those wanted, k of them, as :func:`linearise` names and orders them; the others follow the flight. A
            feedback to a servo that is not wanted acts at once.

    Returns A (n, k, k), C (n, p, k), and the names of the p outputs: those of :func:`linearise`.
    """
    point = _Point.of(aircraft, trimmed)
    A, C, outputs = along(point.layout, flown, [s for s in states if not s.startswith(LAW)], point.values)
    if aircraft.under_law:
        A, C = law_along(A, C, states, Law.of(Executive(aircraft, trimmed.rate_hz, trimmed.condition), trimmed))
    return A, C, outputs


def along(
    layout: Layout, flown: FlightRecord, states: Sequence[str], values: Callable[[Points], FloatArray]
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return what :func:`linearise_along` does, from the ``values`` at points that any simulator gives."""
    n, brought = len(layout.states), [m.name for m in layout.memories]
    servos = [s.removeprefix(SERVO) for s in states if s.startswith(SERVO)]
    wanted = [s for s in states if not s.startswith(SERVO)]
    moving = [index_of(s, layout.states) for s in wanted if s not in brought]
    if len(wanted) - len(moving) not in (0, len(brought)):
        raise ChannelError(f"states of amendments must be wanted all or none, got {wanted} of {brought}")
    variables = (*wanted, *servos)
    rows = [*moving, *range(n, n + len(layout.outputs) + len(brought))]
    at = {name: flown[name] for name in (*layout.states, *layout.inputs)}
    found = values(beside(at, variables, _SECOND_ORDER))
    by_sample = found.reshape(len(found), len(flown), -1).transpose(1, 0, 2)
    slopes = layout.slopes(by_sample, variables, _SECOND_ORDER)[:, rows]
    A, C = layout.joined(slopes[:, : len(moving)], slopes[:, len(moving) :], servos)
    return A, C, layout.outputs


Points = Mapping[str, FloatArray]
"""State or input -> its value at each of several points (points,), SI; what is not given is 0."""


def beside(at: Points, names: Sequence[str], weights: Mapping[int, float]) -> Points:
    """Return the points from which differences are taken about each of ``at``, of each variable in turn.

    Args:
        at: n points.
        names: variables.
        weights: multiple of a variable's step -> weight of the value there in the derivative times the step.
    """
    n, count = len(next(iter(at.values()))), len(weights)
    out = {s: np.repeat(x[:, None], len(names) * count, axis=1) for s, x in at.items()}
    for i, name in enumerate(names):
        values = out.setdefault(name, np.zeros((n, len(names) * count)))
        for j, k in enumerate(weights):
            values[:, i * count + j] += k * _step(name)
    return {s: x.ravel() for s, x in out.items()}


@dataclass(frozen=True, eq=False)
class Layout:
    """What a linear model of an aircraft is made of."""

    states: tuple[str, ...]  #: of the rigid body and its modes
    inputs: tuple[str, ...]  #: control channels
    outputs: tuple[str, ...]  #: channels of the simulator, and those of wing stations
    stations: FloatArray  #: (channels of stations, channels of the simulator) weights
    memories: tuple[Memory, ...]  #: states that amendments bring with them
    servos: Mapping[str, float]  #: surface that a servo moves -> its corner frequency, rad/s

    @classmethod
    def of(cls, aircraft: Aircraft, channels: Sequence[str], servos: Mapping[str, float]) -> Layout:
        """Lay out an aircraft.

        Args:
            aircraft: what flies.
            channels: those of the simulator.
            servos: surface that a servo moves -> its corner frequency, rad/s.
        """
        elastic = aircraft.flown_modes()
        modes = range(1, (len(elastic) if elastic else 0) + 1)
        states = (*_RIGID, *(f"eta_{i}" for i in modes), *(f"etadot_{i}" for i in modes))
        names, rows = station_rows(aircraft.flown_stations(), elastic)
        weights = np.array([[row.get(c, 0.0) for c in channels] for row in rows])
        stations = weights.reshape(len(rows), len(channels))
        inputs = tuple(n for n in CONTROLS if n in aircraft.controls)
        return cls(states, inputs, (*channels, *names), stations, aircraft.memories, servos)

    def trim_of(self, trimmed: TrimmedFlight) -> dict[str, float]:
        """Return states and inputs at a trim."""
        return {n: trimmed.state[n] for n in self.states} | dict(trimmed.controls)

    @property
    def _variables(self) -> tuple[str, ...]:
        return (*self.states, *(m.name for m in self.memories), *self.inputs)

    def points(self, at: Mapping[str, float]) -> Points:
        """Return the points that :meth:`model` needs the values of, about ``at``."""
        return beside({n: np.array([x]) for n, x in at.items()}, self._variables, _FOURTH_ORDER)

    def model(self, values: FloatArray) -> LinearModel:
        """Return the linear model.

        Args:
            values: (state derivatives + channels + what memories follow, points) at :meth:`points`.
        """
        servos = tuple(u for u in self.inputs if u in self.servos)
        direct = tuple(u for u in self.inputs if u in _SURFACES and u not in self.servos)
        memories = tuple(m.name for m in self.memories)
        slopes = self.slopes(values, self._variables, _FOURTH_ORDER)
        n, first = len(self.states), len(self.states) + len(memories)
        own, columns = first + len(servos), [*range(first), *(first + self.inputs.index(u) for u in servos)]
        A, C = self.joined(slopes[:n, columns], slopes[n:, columns], servos)
        B, D = np.zeros((own, len(self.inputs) + len(servos))), slopes[n:, first:][: len(self.outputs)]
        B[:n, : len(self.inputs)] = slopes[:n, first:]
        B[own - len(servos) :, len(self.inputs) :] = np.diag([self.servos[u] for u in servos])
        D = np.hstack([D, np.zeros((len(D), len(servos)))])
        states = (*self.states, *memories, *(f"{SERVO}{u}" for u in servos))
        names = (*self.inputs, *(f"{u}_cmd" for u in servos))
        for k, memory in enumerate(self.memories):
            told: FloatArray = memory.rate_rad_s * slopes[n + len(self.outputs) + k, first:]
            for u, by in zip(self.inputs, told.tolist(), strict=True):
                if u not in servos:
                    B[n + k, names.index(u)] = by
                elif memory.commanded:
                    B[n + k, names.index(f"{u}_cmd")] = by
        if direct:
            i = [self.inputs.index(u) for u in direct]
            B, D, names = np.hstack([B, B[:, i]]), np.hstack([D, D[:, i]]), (*names, *(f"{u}_cmd" for u in direct))
        return LinearModel(A, B, C, D, states, names, self.outputs)

    def slopes(self, values: FloatArray, names: Sequence[str], weights: Mapping[int, float]) -> FloatArray:
        """Return the derivatives of all state derivatives, all outputs and all that is followed, in this order.

        Args:
            values: (..., state derivatives + channels + what memories follow, points) at the points of :func:`beside`.
            names: k of them.
            weights: as there.

        Returns (..., states + outputs + memories, k).
        """
        parts = values.reshape(*values.shape[:-1], len(names), len(weights))
        slopes = sum(w * parts[..., k] for k, w in enumerate(weights.values())) / np.array([_step(n) for n in names])
        first, last = len(self.states), slopes.shape[-2] - len(self.memories)
        of_stations = self.stations @ slopes[..., first:last, :]
        return np.concatenate([slopes[..., :last, :], of_stations, slopes[..., last:, :]], axis=-2)

    def joined(self, moving: FloatArray, shown: FloatArray, servos: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return A (..., k, k) and C (..., outputs, k) of states, memories and servos from slopes by them.

        While time stands still a servo is where its command is, and what is fed back to the command moves it at once,
        z = K x. In flight it comes behind the servo's lag: ż = rate (K x - z).

        Args:
            moving: (..., states, k) of the state derivatives.
            shown: (..., outputs + memories, k) of the outputs and of what the memories follow.
            servos: the last of the k.
        """
        n, p, size = moving.shape[-2], len(self.outputs), moving.shape[-1]
        first = size - len(servos)
        memories = self.memories if n < first else ()
        followed = shown[..., p : p + len(memories), :].copy()
        settled = [i for i, memory in enumerate(memories) if memory.settles]
        of_states = followed[..., settled, :n].copy()
        for i, memory in enumerate(memories):
            followed[..., i, n + i] = 0.0  # its own offset is not what it follows
            if memory.commanded:
                followed[..., i, first:] = 0.0  # the command itself, which is no state
        moving, shown = moving.copy(), shown[..., :p, :].copy()
        for slopes in (moving, shown, followed):  # by a state alone, what follows it held
            slopes[..., :n] -= slopes[..., [n + i for i in settled]] @ of_states
        K = np.zeros((*moving.shape[:-2], len(servos), size))
        for i, u in enumerate(servos):
            reached = shown[..., self.outputs.index(u), :]
            direct = reached[..., first + i]
            turns = np.abs(direct) > _STUCK
            fed = reached[..., :first] / np.where(turns, direct, 1.0)[..., None]
            K[..., i, :first] = np.where(turns[..., None] & (np.abs(fed) > _NO_FEEDBACK), fed, 0.0)
        A = np.zeros((*moving.shape[:-2], size, size))
        A[..., :n, :] = moving - moving[..., first:] @ K
        followed -= followed[..., first:] @ K
        for i, memory in enumerate(memories):
            A[..., n + i, :] = memory.rate_rad_s * followed[..., i, :]
            A[..., n + i, n + i] -= memory.rate_rad_s
        for i, u in enumerate(servos):
            A[..., first + i, :] = self.servos[u] * K[..., i, :]
            A[..., first + i, first + i] = -self.servos[u]
        return A, shown - shown[..., first:] @ K


@dataclass(frozen=True, eq=False)
class _Point:
    """JSBSim ready to be evaluated wherever it is put."""

    fdm: Executive
    layout: Layout
    back: TrimmedFlight

    @classmethod
    def of(cls, aircraft: Aircraft, trimmed: TrimmedFlight) -> _Point:
        fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        if len(fdm.propellers):
            place_at_trim(fdm, trimmed)
        if fdm.mode_count:
            fdm.set("modal/static-ic", 0.0)
        lags = {u: aircraft.servo_of(u) for u in _SURFACES if u in aircraft.controls}
        servos = {u: fdm.get(lag) for u, lag in lags.items() if lag is not None and fdm.has(lag)}
        servos = dict.fromkeys(aircraft.under_law, HOLD * trimmed.rate_hz) | servos
        return cls(fdm, Layout.of(aircraft, fdm.channels, servos), trimmed)

    @property
    def engine(self) -> bool:
        """Whether the speed of its propellers is a state."""
        return self.fdm.propellers.free and "thr" in self.layout.inputs

    def values(self, points: Points) -> FloatArray:
        """Return the state derivatives, all channels and what the memories follow (rows, points)."""
        each = zip(*(x.tolist() for x in points.values()), strict=True)
        return np.column_stack([self._derivatives(dict(zip(points, x, strict=True))) for x in each])

    def _derivatives(self, at: Mapping[str, float]) -> FloatArray:
        """Return the state derivatives, all channels and what the memories follow at one point."""
        fdm = self.fdm
        fdm.command({n: at[n] for n in CONTROLS if n in fdm.command_nodes})
        fdm.place_state(at)
        modes = range(1, fdm.mode_count + 1)
        for i in modes:
            fdm.set(f"modal/eta-{i}", at[f"eta_{i}"])
            fdm.set(f"modal/etadot-{i}", at[f"etadot_{i}"])
        for memory in self.layout.memories:
            fdm.set(memory.start, at.get(memory.name, 0.0))
        fdm.evaluate(held=self.engine)
        rigid = [fdm.get(name) * factor for name, factor in _DERIVATIVES]
        modal = [at[f"etadot_{i}"] for i in modes] + [fdm.get(f"modal/etaddot-{i}") for i in modes]
        channels = fdm.read() | {
            "psi": 0.0
        }  # no state is a heading: read, it jumps by a turn where it begins, at north
        return np.array([*rigid, *modal, *channels.values(), *(fdm.get(m.follows) for m in self.layout.memories)])


def _step(name: str) -> float:
    if name in _STEP:
        return _STEP[name]
    return 1e-2 if name.startswith("etadot") else 1e-3


# --- propellers and piston engines as states --------------------------------------------------------------------------


def with_engine(model: LinearModel, fdm: Executive, trimmed: TrimmedFlight, at: Mapping[str, float]) -> LinearModel:
    """Return a linear model with the states of the propellers, all engines alike, after its own.

    Args:
        model: with the propellers held.
        fdm: where it was made.
        trimmed: about which it was made.
        at: states and inputs there.

    Raises:
        ModelError: the engine is at rest and nothing moves it.
    """
    bench = _Engine(fdm, trimmed, at)
    names = ENGINE if fdm.has(_MANIFOLD) else ENGINE[:1]
    k = len(names)
    by_engine, rows, C = bench.by_itself(k, model.outputs)
    n = len(model.states)
    A = np.zeros((n + k, n + k))
    A[:n, :n], A[n:, n:] = model.A, by_engine
    A[[model.states.index(s) for s in ("u", "v", "w", "p", "q", "r")], n:] = rows
    B = np.vstack([model.B, np.zeros((k, model.B.shape[1]))])
    for name in ("u", "v", "w", "p", "q", "r"):
        A[n:, model.states.index(name)] = bench.by(name, k)
    if "thr" in model.inputs:
        B[n:, model.inputs.index("thr")] = bench.by("thr", k)
    return LinearModel(A, B, np.hstack([model.C, C]), model.D, (*model.states, *names), model.inputs, model.outputs)


class _Engine:
    """The engines of an executive at trim, moved and brought back."""

    def __init__(self, fdm: Executive, trimmed: TrimmedFlight, at: Mapping[str, float]) -> None:
        self._fdm, self._trimmed, self._at = fdm, trimmed, dict(at)
        self._manifold = fdm.node(_MANIFOLD) if fdm.has(_MANIFOLD) else None

    def _place(self, change: Mapping[str, float] | None = None) -> None:
        at = {**self._at, **{n: self._at[n] + d for n, d in (change or {}).items()}}
        fdm = self._fdm
        fdm.command({n: at[n] for n in fdm.command_nodes})
        fdm.place_state(at)
        fdm.evaluate(held=True)

    def _state(self, k: int) -> FloatArray:
        speed = float(self._fdm.propellers.speeds().mean())
        pressure = self._manifold.get_double_value() if self._manifold is not None else 0.0
        return np.array([speed, pressure][:k])

    def _rate(self, k: int) -> FloatArray:
        """Return the rates of change of the states (k,), from a frame so short that they hardly move."""
        before = self._state(k)
        self._fdm.propellers.glance()
        return (self._state(k) - before) / self._fdm.propellers.GLANCE_S

    def _home(self) -> None:
        """Bring the engines back to their equilibrium at trim."""
        self._place()
        self._fdm.propellers.settle()

    def by(self, name: str, k: int) -> FloatArray:
        """Return the derivative (k,) of the engines' rates by a state or input of the aircraft."""
        step, rates = _step(name), []
        for sign in (1.0, -1.0):
            self._home()
            self._place({name: sign * step})
            rates.append(self._rate(k))
        self._home()
        return np.asarray((rates[0] - rates[1]) / (2.0 * step))

    def by_itself(self, k: int, outputs: tuple[str, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the derivatives by the states of the engines: of their rates (k, k), of the six accelerations
        (6, k), and of the outputs (p, k)."""
        kicks = ({"u": _AIRSPEED * self._at["u"]}, {"thr": _THROTTLE if self._at["thr"] < 0.5 else -_THROTTLE})[:k]
        columns: list[list[FloatArray]] = [[], [], [], []]
        for kick in kicks:
            pair = []
            for sign in (1.0, -1.0):
                self._home()
                self._place({n: sign * d for n, d in kick.items()})
                self._fdm.propellers.glance(_FRAME_S)
                self._place()
                channels = self._fdm.read() | {"psi": 0.0}
                forces = np.array([self._fdm.get(n) * f for n, f in ACCELERATIONS])
                state = self._state(k)
                pair.append((state, self._rate(k), forces, np.array([channels.get(o, 0.0) for o in outputs])))
            up, down = pair
            for kept, higher, lower in zip(columns, up, down, strict=True):
                kept.append(higher - lower)
        self._home()
        Z, rates, accelerations, read = (np.column_stack(c) for c in columns)
        scale = np.abs(Z).max(axis=1)
        if not np.all(scale > 0.0) or np.linalg.cond(Z / scale[:, None]) > 1e8:
            raise ModelError(
                f"the engine of {self._fdm.aircraft.name} must answer to throttle and airspeed, but its speed stays; "
                "it is not running"
            )
        inverse = np.linalg.inv(Z)
        return rates @ inverse, accelerations @ inverse, read @ inverse
