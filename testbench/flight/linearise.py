"""Linearise the simulator about a trimmed flight, elastic modes included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft, Memory
from testbench.aircraft.airframe import station_rows
from testbench.core.channels import CONTROLS
from testbench.core.constants import FT_M
from testbench.core.errors import ChannelError
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.condition import TrimmedFlight
from testbench.flight.engines import with_engine
from testbench.flight.executive import ACCELERATIONS, Executive
from testbench.flight.linear_model import SERVO, LinearModel, index_of
from testbench.flight.trim import place_at_trim

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


def linearise(aircraft: Aircraft, trimmed: TrimmedFlight) -> LinearModel:
    """Return the linear model about trim by fourth-order central differences of JSBSim's own equations.

    States: body velocities, rates, phi, theta, h, eta and etadot of every mode, those that amendments bring with them,
    and the speed of propellers (all engines alike) with the manifold pressure of piston engines; those that are
    governed or behind a gas generator are at their equilibrium throughout. Inputs: the deflections de, da, dr and thr,
    and the commands de_cmd, da_cmd, dr_cmd, which pass through the servo lags first (further states, through which a
    feedback to a command passes too), or are the deflections where there is no servo. Outputs: every channel of the
    simulator, and those of the wing stations.

    Example:
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> linear = tb.linearise(taurus, tb.trim(taurus, tb.FlightCondition(12.0, 100.0)))
        >>> linear.A.shape[0] == len(linear.states)
        True
    """
    point = _Point.of(aircraft, trimmed)
    at = {n: trimmed.state[n] for n in point.states} | dict(trimmed.controls)
    servos, direct = point.servos, tuple(u for u in point.surfaces if u not in point.servos)
    memories = tuple(m.name for m in point.memories)
    slopes = point.slopes(at, (*point.states, *memories, *point.inputs), _FOURTH_ORDER)
    n, first = len(point.states), len(point.states) + len(memories)
    own, columns = first + len(servos), [*range(first), *(first + point.inputs.index(u) for u in servos)]
    A, C = point.joined(slopes[:n, columns], slopes[n:, columns], servos)
    B, D = np.zeros((own, len(point.inputs) + len(servos))), slopes[n:, first:][: len(point.outputs)]
    B[:n, : len(point.inputs)] = slopes[:n, first:]
    B[own - len(servos) :, len(point.inputs) :] = np.diag([point.servo_rate(u) for u in servos])
    D = np.hstack([D, np.zeros((len(D), len(servos)))])
    states = (*point.states, *memories, *(f"{SERVO}{u}" for u in servos))
    names = (*point.inputs, *(f"{u}_cmd" for u in servos))
    if direct:
        i = [point.inputs.index(u) for u in direct]
        B, D, names = np.hstack([B, B[:, i]]), np.hstack([D, D[:, i]]), (*names, *(f"{u}_cmd" for u in direct))
    model = LinearModel(A, B, C, D, states, names, point.outputs)
    return with_engine(model, point.fdm, point.back, at) if point.engine else model


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
    names = (*point.states, *point.inputs)
    n, brought = len(point.states), [m.name for m in point.memories]
    servos = [s.removeprefix(SERVO) for s in states if s.startswith(SERVO)]
    wanted = [s for s in states if not s.startswith(SERVO)]
    moving = [index_of(s, point.states) for s in wanted if s not in brought]
    if len(wanted) - len(moving) not in (0, len(brought)):
        raise ChannelError(f"states of amendments must be wanted all or none, got {wanted} of {brought}")
    variables = (*wanted, *servos)
    rows = [*moving, *range(n, n + len(point.outputs) + len(brought))]
    slopes = np.empty((len(flown), len(rows), len(variables)))
    for k, values in enumerate(flown.columns(names)):
        at = dict(zip(names, values.tolist(), strict=True))
        slopes[k] = point.slopes(at, variables, _SECOND_ORDER)[rows]
    A, C = point.joined(slopes[:, : len(moving)], slopes[:, len(moving) :], servos)
    return A, C, point.outputs


@dataclass(frozen=True, eq=False)
class _Point:
    """JSBSim ready to be evaluated wherever it is put; ``stations`` weight its channels for the wing stations.

    ``memories`` are the states that amendments bring with them.
    """

    fdm: Executive
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    stations: FloatArray
    memories: tuple[Memory, ...]
    back: TrimmedFlight

    @classmethod
    def of(cls, aircraft: Aircraft, trimmed: TrimmedFlight) -> _Point:
        fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        modes = range(1, fdm.mode_count + 1)
        if len(fdm.propellers):
            place_at_trim(fdm, trimmed)
        if modes:
            fdm.set("modal/static-ic", 0.0)
        states = (*_RIGID, *(f"eta_{i}" for i in modes), *(f"etadot_{i}" for i in modes))
        names, rows = station_rows(aircraft.flown_stations(), aircraft.flown_modes())
        weights = np.array([[row.get(c, 0.0) for c in fdm.channels] for row in rows])
        inputs = tuple(n for n in CONTROLS if n in aircraft.controls)
        stations = weights.reshape(len(rows), len(fdm.channels))
        return cls(fdm, states, inputs, (*fdm.channels, *names), stations, aircraft.memories, trimmed)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Inputs that are surfaces."""
        return tuple(u for u in self.inputs if u in _SURFACES)

    @property
    def servos(self) -> tuple[str, ...]:
        """Surfaces that a servo moves."""
        return tuple(u for u in self.surfaces if self.fdm.has(self.fdm.aircraft.servo_of(u)))

    @property
    def engine(self) -> bool:
        """Whether the speed of its propellers is a state."""
        return self.fdm.propellers.free and "thr" in self.inputs

    def servo_rate(self, control: str) -> float:
        """Return the corner frequency of a servo, rad/s."""
        return self.fdm.get(str(self.fdm.aircraft.servo_of(control)))

    def slopes(self, at: Mapping[str, float], names: Sequence[str], weights: Mapping[int, float]) -> FloatArray:
        """Return the derivatives of all state derivatives, all outputs and all that is followed, in this order.

        Args:
            at: value of every state and input; states that amendments bring with them are at rest if not given.
            names: k of them.
            weights: multiple of a variable's step -> weight of the value there in the derivative times the step.

        Returns (states + outputs + memories, k).
        """
        columns = []
        for name in names:
            step = _step(name)
            values = (w * self._derivatives({**at, name: at.get(name, 0.0) + k * step}) for k, w in weights.items())
            columns.append(sum(values) / step)
        slopes = np.column_stack(columns)
        first, last = len(self.states), len(slopes) - len(self.memories)
        return np.vstack([slopes[:last], self.stations @ slopes[first:last], slopes[last:]])

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
        followed = shown[..., p : p + len(memories), :n]
        settled = [i for i, memory in enumerate(memories) if memory.settles]
        moving, shown = moving.copy(), shown[..., :p, :].copy()
        for slopes in (moving, shown):  # by a state alone, what follows it held
            slopes[..., :n] -= slopes[..., [n + i for i in settled]] @ followed[..., settled, :]
        K = np.zeros((*moving.shape[:-2], len(servos), size))
        for i, u in enumerate(servos):
            reached = shown[..., self.outputs.index(u), :]
            direct = reached[..., first + i]
            turns = np.abs(direct) > _STUCK
            fed = reached[..., :first] / np.where(turns, direct, 1.0)[..., None]
            K[..., i, :first] = np.where(turns[..., None] & (np.abs(fed) > _NO_FEEDBACK), fed, 0.0)
        A = np.zeros((*moving.shape[:-2], size, size))
        A[..., :n, :] = moving - moving[..., first:] @ K
        for i, memory in enumerate(memories):
            A[..., n + i, :n] = memory.rate_rad_s * followed[..., i, :]
            A[..., n + i, n + i] = -memory.rate_rad_s
        for i, u in enumerate(servos):
            A[..., first + i, :] = self.servo_rate(u) * K[..., i, :]
            A[..., first + i, first + i] = -self.servo_rate(u)
        return A, shown - shown[..., first:] @ K

    def _derivatives(self, at: Mapping[str, float]) -> FloatArray:
        """Return the state derivatives, all channels and what the memories follow at one point."""
        fdm = self.fdm
        fdm.command({n: at[n] for n in CONTROLS if n in fdm.command_nodes})
        fdm.place(at["h"], at["theta"], at["phi"], (at["u"], at["v"], at["w"]), (at["p"], at["q"], at["r"]))
        modes = range(1, fdm.mode_count + 1)
        for i in modes:
            fdm.set(f"modal/eta-{i}", at[f"eta_{i}"])
            fdm.set(f"modal/etadot-{i}", at[f"etadot_{i}"])
        for memory in self.memories:
            fdm.set(memory.start, at.get(memory.name, 0.0))
        fdm.evaluate(held=self.engine)
        rigid = [fdm.get(name) * factor for name, factor in _DERIVATIVES]
        modal = [at[f"etadot_{i}"] for i in modes] + [fdm.get(f"modal/etaddot-{i}") for i in modes]
        channels = fdm.read() | {
            "psi": 0.0
        }  # no state is a heading: read, it jumps by a turn where it begins, at north
        return np.array([*rigid, *modal, *channels.values(), *(fdm.get(m.follows) for m in self.memories)])


def _step(name: str) -> float:
    if name in _STEP:
        return _STEP[name]
    return 1e-2 if name.startswith("etadot") else 1e-3
