"""Linearise the simulator about a trimmed flight, elastic modes included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft import Aircraft
from testbench.aircraft.airframe import station_rows
from testbench.channels import CONTROLS
from testbench.constants import FT_M
from testbench.errors import ChannelError, nearest
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import Executive
from testbench.record import FlightRecord, FloatArray

_RIGID = ("u", "v", "w", "p", "q", "r", "phi", "theta", "h")
_STEP = {"u": 0.05, "v": 0.05, "w": 0.05, "p": 1e-2, "q": 1e-2, "r": 1e-2, "phi": 1e-3, "theta": 1e-3, "h": 1.0}
_DERIVATIVES = (
    ("accelerations/udot-ft_sec2", FT_M),
    ("accelerations/vdot-ft_sec2", FT_M),
    ("accelerations/wdot-ft_sec2", FT_M),
    ("accelerations/pdot-rad_sec2", 1.0),
    ("accelerations/qdot-rad_sec2", 1.0),
    ("accelerations/rdot-rad_sec2", 1.0),
    ("velocities/phidot-rad_sec", 1.0),
    ("velocities/thetadot-rad_sec", 1.0),
    ("velocities/h-dot-fps", FT_M),
)
_FOURTH_ORDER = {-2: 1.0 / 12.0, -1: -8.0 / 12.0, 1: 8.0 / 12.0, 2: -1.0 / 12.0}  # weights of central differences
_SECOND_ORDER = {-1: -0.5, 1: 0.5}
_SERVOS = {"de": "elevator", "da": "aileron", "dr": "rudder"}


@dataclass(frozen=True, eq=False)
class LinearModel:
    """xdot = A x + B u, y = C x + D u for deviations from trim, SI.

    Attributes:
        A, B, C, D: (n, n), (n, m), (p, n), (p, m).
        states, inputs, outputs: names; inputs are control channels (deflection reached) or commands (``de_cmd``).
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def poles(self) -> NDArray[np.complex128]:
        """Return the eigenvalues of A, rad/s."""
        return np.asarray(np.linalg.eigvals(self.A), np.complex128)

    def frequency_response(
        self, omega_rad_s: FloatArray, outputs: Sequence[str], inputs: Sequence[str]
    ) -> NDArray[np.complex128]:
        """Return C (jw - A)^-1 B + D at ``omega_rad_s`` (k,) for the named channels, shape (k, p, m)."""
        rows = [_index(o, self.outputs) for o in outputs]
        columns = [_index(i, self.inputs) for i in inputs]
        eye = np.eye(len(self.states))
        X = np.linalg.solve(
            1j * np.asarray(omega_rad_s)[:, None, None] * eye - self.A, self.B[None, :, columns].astype(complex)
        )
        return np.asarray(self.C[rows] @ X + self.D[np.ix_(rows, columns)], np.complex128)

    def subsystem(self, states: Sequence[str]) -> LinearModel:
        """Return the model of ``states`` alone, the others held at zero."""
        i = [_index(s, self.states) for s in states]
        return LinearModel(
            self.A[np.ix_(i, i)], self.B[i], self.C[:, i], self.D, tuple(states), self.inputs, self.outputs
        )

    def longitudinal(self, symmetric: Sequence[int] = ()) -> LinearModel:
        """Return the longitudinal motion: u, w, q, theta, h and the modes numbered ``symmetric`` (from 1)."""
        modal = [f"{kind}_{i}" for kind in ("eta", "etadot") for i in symmetric]
        return self.subsystem(["u", "w", "q", "theta", "h", *modal])

    def to_control(self) -> object:
        """Return the model as a python-control state space with named signals."""
        import control

        return control.ss(self.A, self.B, self.C, self.D, states=self.states, inputs=self.inputs, outputs=self.outputs)


def _index(name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise ChannelError(f"a channel of the linear model must be one of its own, got '{name}'{nearest(name, names)}")
    return list(names).index(name)


def linearise(aircraft: Aircraft, trimmed: TrimmedFlight) -> LinearModel:
    """Return the linear model about trim by fourth-order central differences of JSBSim's own equations.

    States: body velocities, rates, phi, theta, h, and eta and etadot of every mode. Inputs: the deflections de, da, dr
    and thr, and the commands de_cmd, da_cmd, dr_cmd, which pass through the servo lags first (three further states).
    Outputs: every channel of the simulator, and those of the wing stations.
    """
    point = _Point.of(aircraft, trimmed)
    at = {n: trimmed.state[n] for n in point.states} | dict(trimmed.controls)
    slopes = point.slopes(at, (*point.states, *point.inputs), _FOURTH_ORDER)
    n = len(point.states)
    A, B, C, D = slopes[:n, :n], slopes[:n, n:], slopes[n:, :n], slopes[n:, n:]
    servos = {u: point.fdm.get(f"fcs/{_SERVOS[u]}-lag-rad_sec") for u in point.inputs if u in _SERVOS}
    return _with_servos(LinearModel(A, B, C, D, point.states, point.inputs, point.outputs), servos)


def linearise_along(
    aircraft: Aircraft, trimmed: TrimmedFlight, flown: FlightRecord, states: Sequence[str]
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return the linear models about the states that a flight went through, by central differences of second order.

    Args:
        aircraft: the aircraft that flew.
        trimmed: where it began.
        flown: truth of the flight with every channel, n samples.
        states: those wanted, k of them; the others follow the flight.

    Returns A (n, k, k), C (n, p, k), and the names of the p outputs: those of :func:`linearise`.
    """
    point = _Point.of(aircraft, trimmed)
    names = (*point.states, *point.inputs)
    n = len(point.states)
    rows = [*(_index(s, point.states) for s in states), *range(n, n + len(point.outputs))]
    slopes = np.empty((len(flown), len(rows), len(states)))
    for k, values in enumerate(flown.columns(names)):
        at = dict(zip(names, values.tolist(), strict=True))
        slopes[k] = point.slopes(at, states, _SECOND_ORDER)[rows]
    return slopes[:, : len(states)], slopes[:, len(states) :], point.outputs


@dataclass(frozen=True, eq=False)
class _Point:
    """JSBSim ready to be evaluated wherever it is put; ``stations`` weight its channels for the wing stations."""

    fdm: Executive
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    stations: FloatArray

    @classmethod
    def of(cls, aircraft: Aircraft, trimmed: TrimmedFlight) -> _Point:
        fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        modes = range(1, fdm.mode_count + 1)
        if modes:
            fdm.set("modal/static-ic", 0.0)
        states = (*_RIGID, *(f"eta_{i}" for i in modes), *(f"etadot_{i}" for i in modes))
        names, rows = station_rows(aircraft.flown_stations(), aircraft.flown_modes())
        weights = np.array([[row.get(c, 0.0) for c in fdm.channels] for row in rows])
        inputs = tuple(n for n in CONTROLS if n in aircraft.controls)
        return cls(fdm, states, inputs, (*fdm.channels, *names), weights.reshape(len(rows), len(fdm.channels)))

    def slopes(self, at: Mapping[str, float], names: Sequence[str], weights: Mapping[int, float]) -> FloatArray:
        """Return the derivatives of all state derivatives and all outputs, in this order, by the named variables.

        Args:
            at: value of every state and input.
            names: k of them.
            weights: multiple of a variable's step -> weight of the value there in the derivative times the step.

        Returns (states + outputs, k).
        """
        columns = []
        for name in names:
            step = _step(name)
            values = (
                w * _derivatives(self.fdm, {**at, name: at[name] + k * step}, self.states) for k, w in weights.items()
            )
            columns.append(sum(values) / step)
        slopes = np.column_stack(columns)
        return np.vstack([slopes, self.stations @ slopes[len(self.states) :]])


def _step(name: str) -> float:
    if name in _STEP:
        return _STEP[name]
    return 1e-2 if name.startswith("etadot") else 1e-3


def _derivatives(fdm: Executive, at: Mapping[str, float], states: Sequence[str]) -> FloatArray:
    """Return the state derivatives followed by all channels at one point."""
    fdm.command({n: at[n] for n in CONTROLS if n in fdm.command_nodes})
    fdm.place(at["h"], at["theta"], at["phi"], (at["u"], at["v"], at["w"]), (at["p"], at["q"], at["r"]))
    modes = range(1, fdm.mode_count + 1)
    for i in modes:
        fdm.set(f"modal/eta-{i}", at[f"eta_{i}"])
        fdm.set(f"modal/etadot-{i}", at[f"etadot_{i}"])
    fdm.evaluate()
    rigid = [fdm.get(name) * factor for name, factor in _DERIVATIVES]
    modal = [at[f"etadot_{i}"] for i in modes] + [fdm.get(f"modal/etaddot-{i}") for i in modes]
    return np.array([*rigid, *modal, *fdm.read().values()])


def _with_servos(model: LinearModel, lags: Mapping[str, float]) -> LinearModel:
    """Append first-order servos, one state each, driven by the commands."""
    n, k = len(model.states), len(lags)
    columns = [model.inputs.index(u) for u in lags]
    lag = np.diag(list(lags.values()))
    A = np.block([[model.A, model.B[:, columns]], [np.zeros((k, n)), -lag]])
    B = np.block([[model.B, np.zeros((n, k))], [np.zeros((k, len(model.inputs))), lag]])
    C = np.hstack([model.C, model.D[:, columns]])
    D = np.hstack([model.D, np.zeros((len(model.outputs), k))])
    return LinearModel(
        A,
        B,
        C,
        D,
        (*model.states, *(f"servo_{u}" for u in lags)),
        (*model.inputs, *(f"{u}_cmd" for u in lags)),
        model.outputs,
    )
