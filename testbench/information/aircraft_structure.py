"""The linearised aircraft as a parametric structure: its derivatives and modal quantities as parameters.

    dx/dt = A(params) x + B(params) u,    y = C0 x + D0 u + P (dx/dt - A0 x - B0 u)

A0 to D0 come from linearising the simulator at the flown condition. P (p, n) says which accelerations an output holds:
an accelerometer feels every force derivative as the aircraft does. A derivative, M_alpha say, is a direction in A: an
acceleration times a variable, in the stability axes of the trim as in the derivative tables. An elastic mode i has its
frequency omega_i and damping zeta_i, in flight at this condition with the couplings to other states held, and its
generalised force derivatives, Q1_alpha say.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft import Aircraft
from testbench.aircraft.airframe import station_rows
from testbench.core.errors import ChannelError, EstimationError, nearest
from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, Parameter
from testbench.evaluation.modes import elastic_modes
from testbench.flight import TrimmedFlight
from testbench.flight.linear_model import LAW, PLANE_STATES, LinearModel
from testbench.sensors import Sensor

Plane = Literal["longitudinal", "lateral"]
_AXES = {"longitudinal": "XZM", "lateral": "YLN"}
_VARIABLES = {"longitudinal": ("V", "alpha", "q", "de", "thr"), "lateral": ("beta", "p", "r", "da", "dr")}
_ACCELERATIONS = {"ax": "u", "ay": "v", "az": "w", "pdot": "p", "qdot": "q", "rdot": "r"}
_MOVED = 1e-9  # of an output's unit per unit of a state or input: less is rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class AircraftStructure(LinearStructure):
    """The linearised aircraft with chosen derivatives free; see the module's docstring."""

    # A0, B0, C0, D0: the matrices at the parameters' true values
    A0: FloatArray
    B0: FloatArray
    C0: FloatArray
    D0: FloatArray
    P: FloatArray  # (p, n) accelerations in each output
    # per parameter (k,) the matrix (n, n + m) that it multiplies in [A, B]; zero for frequencies and damping ratios,
    # which ``modal`` names
    directions: FloatArray
    # (index of omega, index of zeta, row of the mode's velocity, column of its displacement) per mode
    modal: tuple[tuple[int, int, int, int], ...]
    true: FloatArray  # (k,) the parameters that give A0 and B0

    @property
    def moved(self) -> NDArray[np.bool_]:
        """(p,) whether a state or an input moves an output: those of the other motion are rounding."""
        return np.asarray(np.abs(np.hstack([self.C0, self.D0])).max(axis=1) > _MOVED)

    @property
    def followers(self) -> tuple[str, ...]:
        """The servos, which commands alone drive; they come last."""
        return tuple(s for s in self.states if s.startswith("servo_"))

    def at(self, params: FloatArray) -> AircraftStructure:
        """Return the same aircraft with other true parameters (k,)."""
        s = self.matrices(params)
        named = tuple(replace(p, value=x) for p, x in zip(self.parameters, params.tolist(), strict=True))
        return replace(self, A0=s.A, B0=s.B, C0=s.C, D0=s.D, true=params, parameters=named)

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        n = len(self.states)
        change = np.einsum("...k,kij->...ij", params - self.true, self.directions)
        for omega, zeta, row, column in self.modal:
            w, z = params[..., omega], params[..., zeta]
            change[..., row, column] += -(w**2) - self.A0[row, column]
            change[..., row, row] += -2.0 * z * w - self.A0[row, row]
        output = np.einsum("pn,...nj->...pj", self.P, change)
        shape = change.shape[:-2]
        return Matrices(
            self.A0 + change[..., :n],
            self.B0 + change[..., n:],
            self.C0 + output[..., :n],
            self.D0 + output[..., n:],
            np.zeros((*shape, n), change.dtype),
            np.zeros((*shape, len(self.outputs)), change.dtype),
        )


def parameter_names(controls: Sequence[str], plane: Plane, modes: Collection[int]) -> tuple[str, ...]:
    """Return the names of all parameters of an aircraft with these controls, in one plane with these modes (from 1)."""
    controls = [v for v in _VARIABLES[plane][3:] if v in controls]
    variables = (*_VARIABLES[plane][:3], *controls)
    rigid = [f"{axis}_{v}" for axis in _AXES[plane] for v in variables]
    elastic = []
    for i in modes:
        elastic += [f"omega_{i}", f"zeta_{i}", *(f"Q{i}_{v}" for v in variables)]
        elastic += [f"{axis}_eta{i}" for axis in _AXES[plane]]
    return (*rigid, *elastic)


def aircraft_structure(
    model: LinearModel,
    trimmed: TrimmedFlight,
    plane: Plane,
    modes: Collection[int],
    inputs: Sequence[str],
    outputs: Sequence[str] | Mapping[str, Mapping[str, float]],
    free: Sequence[str],
) -> AircraftStructure:
    """Return the linearised aircraft with the parameters ``free``, at their true values.

    Args:
        model: of :func:`testbench.flight.linearise`, servos included.
        trimmed: where it was linearised.
        plane: which motion; the other one is left out.
        modes: numbers (from 1) of the elastic modes that belong to the plane.
        inputs: commands (``de_cmd``: the servo is part of the model) or deflections.
        outputs: channels of the linear model; or each with the channels that it is a mixture of, and their weights.
        free: names of the parameters.

    Raises:
        EstimationError: a parameter is not one of :func:`parameter_names`.
        ChannelError: an input or output is not in the linear model.
    """
    model = model.with_quick_engines()
    known = parameter_names(model.inputs, plane, modes)
    for name in free:
        if name not in known:
            raise EstimationError(
                f"a parameter of the {plane} motion must be one of {', '.join(known)}; got "
                f"'{name}'{nearest(name, known)}"
            )
    for name, names in (*((i, model.inputs) for i in inputs), *((o, model.outputs) for o in outputs)):
        if name not in names:
            raise ChannelError(f"the linear model has no channel '{name}'{nearest(name, names)}")
    servos = [f"servo_{c}" for c in _VARIABLES[plane][3:] if f"servo_{c}" in model.states and f"{c}_cmd" in inputs]
    modal = [f"{kind}_{i}" for kind in ("eta", "etadot") for i in modes]
    law = [s for s in model.states if s.startswith(f"{LAW}{plane}")] if servos else []
    states = [*PLANE_STATES[plane], *modal, *law, *servos]
    at = [model.states.index(s) for s in states]
    columns = [model.inputs.index(i) for i in inputs]
    rows = [model.outputs.index(o) for o in outputs]
    A0, B0 = model.A[np.ix_(at, at)], model.B[np.ix_(at, columns)]
    basis = _Basis(states, list(inputs), trimmed.condition.V_m_s, trimmed.alpha)
    directions, true = np.zeros((len(free), len(states), len(states) + len(inputs))), np.zeros(len(free))
    for k, name in enumerate(free):
        axis, variable = name.rsplit("_", 1)
        if axis in ("omega", "zeta"):
            row = states.index(f"etadot_{variable}")
            omega = math.sqrt(max(-A0[row, states.index(f"eta_{variable}")], 1e-12))
            true[k] = omega if axis == "omega" else -A0[row, row] / (2.0 * omega)
            continue
        direction = np.outer(basis.row(axis), basis.column(variable))
        directions[k] = direction
        true[k] = basis.value(np.hstack([A0, B0]), axis, variable)
    pairs = []
    for i in modes:
        if f"omega_{i}" in free or f"zeta_{i}" in free:
            if not (f"omega_{i}" in free and f"zeta_{i}" in free):
                raise EstimationError(f"omega_{i} and zeta_{i} go together as parameters of mode {i}; name both")
            where = (list(free).index(f"omega_{i}"), list(free).index(f"zeta_{i}"))
            pairs.append((*where, states.index(f"etadot_{i}"), states.index(f"eta_{i}")))
    P = np.zeros((len(outputs), len(states)))
    mixtures = outputs if isinstance(outputs, Mapping) else {output: {output: 1.0} for output in outputs}
    for j, mixture in enumerate(mixtures.values()):
        for name, weight in mixture.items():
            if (state := _rate_of(name)) in states:
                P[j, states.index(state)] += weight
    return AircraftStructure(
        name=f"{plane} linearised aircraft",
        states=tuple(states),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        parameters=tuple(Parameter(name, value) for name, value in zip(free, true.tolist(), strict=True)),
        A0=A0,
        B0=B0,
        C0=model.C[np.ix_(rows, at)],
        D0=model.D[np.ix_(rows, columns)],
        P=P,
        directions=directions,
        modal=tuple(pairs),
        true=true,
    )


def seen_by(
    sensors: Sequence[Sensor],
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    linear: LinearModel,
    plane: Plane,
    inputs: Sequence[str],
    free: Sequence[str],
) -> AircraftStructure:
    """Return the linearised aircraft with what the sensors feel, lags and delays apart, as its outputs.

    Raises:
        ChannelError: a sensor's channel is not in the linear model.
    """
    at = dict.fromkeys(linear.outputs, 0.0) | dict(trimmed.state)
    stations = dict(zip(*station_rows(aircraft.flown_stations(), aircraft.flown_modes()), strict=True))
    return aircraft_structure(
        felt_by(sensors, linear, trimmed.state),
        trimmed,
        plane,
        elastic_modes(aircraft, plane),
        inputs,
        {s.channel: stations.get(s.channel) or s.weights(at) for s in sensors},
        free,
    )


def felt_by(sensors: Sequence[Sensor], linear: LinearModel, trim: Mapping[str, float]) -> LinearModel:
    """Return the linear model with the rows of the sensors' channels as the sensors feel them where they sit.

    Raises:
        ChannelError: the linear model lacks a channel.
    """
    C, D = linear.C.copy(), linear.D.copy()
    for sensor in sensors:
        for name in sensor.needs:
            if name not in linear.outputs:
                raise ChannelError(
                    f"the linear model has no channel '{name}', which sensor '{sensor.channel}' needs"
                    + nearest(name, linear.outputs)
                )
        weights = sensor.weights(dict.fromkeys(linear.outputs, 0.0) | dict(trim))
        rows, w = [linear.outputs.index(n) for n in weights], np.array([*weights.values()])
        k = linear.outputs.index(sensor.channel)
        C[k], D[k] = w @ linear.C[rows], w @ linear.D[rows]
    return replace(linear, C=C, D=D)


def _rate_of(channel: str) -> str:
    """Return the state whose derivative a channel holds, for small motion; "" if none."""
    mode = channel.removeprefix("etaddot_")
    return _ACCELERATIONS.get(channel, f"etadot_{mode}" if mode != channel else "")


class _Basis:
    """Unit vectors of accelerations and of variables in the states and inputs of a structure."""

    def __init__(self, states: list[str], inputs: list[str], V: float, alpha: float) -> None:
        self.states, self.inputs, self.V = states, inputs, V
        self.c, self.s = math.cos(alpha), math.sin(alpha)

    def row(self, axis: str) -> FloatArray:
        """Return the state derivatives (n,) that one unit of acceleration along an axis makes."""
        parts = {
            "X": {"u": self.c, "w": self.s},
            "Z": {"u": -self.s, "w": self.c},
            "Y": {"v": 1.0},
            "L": {"p": 1.0},
            "M": {"q": 1.0},
            "N": {"r": 1.0},
        }
        found = parts.get(axis) or {f"etadot_{axis.removeprefix('Q')}": 1.0}
        return np.array([found.get(s, 0.0) for s in self.states])

    def column(self, variable: str) -> FloatArray:
        """Return the gradient (n + m,) of a variable by states and inputs."""
        parts = {
            "V": {"u": self.c, "w": self.s},
            "alpha": {"u": -self.s / self.V, "w": self.c / self.V},
            "beta": {"v": 1.0 / self.V},
        }
        name = variable
        if variable.startswith("eta"):
            name = f"eta_{variable.removeprefix('eta')}"
        elif f"servo_{variable}" in self.states:
            name = f"servo_{variable}"
        elif variable not in self.inputs and f"{variable}_cmd" in self.inputs:
            name = f"{variable}_cmd"
        found = parts.get(variable, {name: 1.0})
        return np.array([found.get(s, 0.0) for s in (*self.states, *self.inputs)])

    def value(self, AB: FloatArray, axis: str, variable: str) -> float:
        """Return the derivative itself: the acceleration per unit of the variable in [A, B] (n, n + m).

        The turning of the frame, V x rate, is no aerodynamic derivative and is subtracted.
        """
        along = {
            "V": {"u": self.c, "w": self.s},
            "alpha": {"u": -self.V * self.s, "w": self.V * self.c},
            "beta": {"v": self.V},
        }
        unit = self.column(variable)
        motion = along.get(variable)
        step = np.array([motion.get(s, 0.0) for s in (*self.states, *self.inputs)]) if motion else np.sign(unit)
        turning = {("Z", "q"): self.V, ("Y", "r"): -self.V * self.c, ("Y", "p"): self.V * self.s}
        return float(self.row(axis) @ AB @ step) - turning.get((axis, variable), 0.0)
