"""Servos between commands and surfaces, as part of a structure: lag or second order, rate limit, an unknown delay.

An autopilot logs what it asked for. What acts on the aircraft follows that command,

    tau d(delta)/dt = delta_cmd(t - T) - delta,    |d(delta)/dt| <= R,

or with a natural frequency and a damping ratio. A structure behind servos has the states of its base, then those of the
servos, and the same inputs, which are commands. tau and T may be parameters: an unknown delay is the Pade approximation
of second order, within 1 % up to w T = 1.5; a known one is exact (``delays_s`` of the methods).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.hold import said_of_hold
from testbench.estimators.model import check_records
from testbench.estimators.parametric.likelihood import held_inputs
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, ModelStructure, Parameter
from testbench.estimators.structured import Fitted, Servo

START_LAGS_S = (0.02, 0.05, 0.1, 0.2)
"""Lags to try before a search, s: small servos of models to large hydraulic ones."""
_START_DELAY_S = 0.03
_LEAST_S, _MOST_S = 2e-3, 2.0  # bounds of an estimated lag or delay
Settings = TypeVar("Settings", bound=Fitted)
SUBSTEPS = 5
"""Runge-Kutta steps per sample that a rate limit needs: it bends the surface's path within a sample."""


@dataclass(frozen=True)
class _Link:
    """One servo: index and name of its input, what it is, and the indices of its parameters behind the base's."""

    index: int
    name: str
    servo: Servo
    lag: int | None
    delay: int | None

    @property
    def states(self) -> tuple[str, ...]:
        """Names of its states, in order."""
        out = (f"{self.name}_delay", f"{self.name}_delaydot") if self.delay is not None else ()
        if self.servo.wn_rad_s is not None:
            return (*out, f"{self.name}_servo", f"{self.name}_servodot")
        return (*out, f"{self.name}_servo") if self.lag is not None else out

    def rows(self, values: AnyArray) -> tuple[list[AnyArray], AnyArray]:
        """Return the rates of its states and the surface, as rows (..., states + 1) over states and command.

        Args:
            values: (..., s) parameters of all servos.
        """
        size = len(self.states) + 1

        def unit(i: int) -> AnyArray:
            out = np.zeros((*values.shape[:-1], size), values.dtype)
            out[..., i] = 1.0
            return out

        signal, rates, at = unit(size - 1), [], 0
        if self.delay is not None:
            T = values[..., self.delay, None]
            rates += [unit(1), 12.0 / T**2 * (signal - unit(0)) - 6.0 / T * unit(1)]
            signal, at = signal - T * unit(1), 2
        if self.servo.wn_rad_s is not None and self.servo.zeta is not None:
            wn = self.servo.wn_rad_s
            rates += [unit(at + 1), wn**2 * (signal - unit(at)) - 2.0 * self.servo.zeta * wn * unit(at + 1)]
            signal = unit(at)
        elif self.lag is not None:
            rates.append((signal - unit(at)) / values[..., self.lag, None])
            signal = unit(at)
        return rates, signal


@dataclass(frozen=True, eq=False, kw_only=True)
class _BehindServos(ModelStructure):
    """What structures behind servos share."""

    base: ModelStructure
    links: tuple[_Link, ...]

    @property
    def meaning(self) -> str:
        """That of the base."""
        return self.base.meaning

    @property
    def must_move(self) -> tuple[str, ...]:
        """Inputs of the base that must move."""
        return self.base.must_move

    @property
    def followers(self) -> tuple[str, ...]:
        """States of the servos, which commands alone drive."""
        return self.states[len(self.base.states) :]

    @property
    def begun(self) -> tuple[str, ...]:
        """Those of the base, and all of the servos."""
        return (*self.base.begun, *self.followers)

    def initial_state(self, record: FlightRecord, measured: bool = True) -> FloatArray:
        """Return where the states (n,) begin: those of the base as it has them, the servos at rest."""
        rest = self.at_rest(record.columns(self.inputs)[0])
        return np.concatenate([self.base.initial_state(record, measured), rest])

    def at_rest(self, u: FloatArray) -> FloatArray:
        """Return the states of the servos where the commands (m,) have been constant."""
        out = [[0.0 if s.endswith("dot") else u[link.index] for s in link.states] for link in self.links]
        return np.array([value for part in out for value in part], float)

    @property
    def limited(self) -> bool:
        """Whether a servo has a rate limit."""
        return any(link.servo.rate_limit_deg_s is not None for link in self.links)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the servos' parameters that are estimated."""
        return tuple(p.name for p in self.parameters[len(self.base.parameters) :] if p.free)


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearBehindServos(_BehindServos, LinearStructure):
    """A linear structure behind servos without rate limits."""

    base: LinearStructure

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        k, n, lead = len(self.base.parameters), len(self.base.states), np.shape(params)[:-1]
        s, values = self.base.matrices(params[..., :k]), params[..., k:]
        total, m, p = len(self.states), len(self.inputs), len(self.outputs)
        kind = np.result_type(s.A, params)
        A, B = np.zeros((*lead, total, total), kind), np.zeros((*lead, total, m), kind)
        C, D = np.zeros((*lead, p, total), kind), np.array(np.broadcast_to(s.D, (*lead, p, m)), kind)
        A[..., :n, :n], B[..., :n, :], C[..., :, :n] = s.A, s.B, s.C
        at = n
        for link in self.links:
            rates, surface = link.rows(values)
            own, j = slice(at, at + len(rates)), link.index
            for i, row in enumerate(rates):
                A[..., at + i, own], B[..., at + i, j] = row[..., :-1], row[..., -1]
            A[..., :n, own] = s.B[..., :, j, None] * surface[..., None, :-1]
            C[..., :, own] = s.D[..., :, j, None] * surface[..., None, :-1]
            B[..., :n, j], D[..., :, j] = s.B[..., :, j] * surface[..., -1:], s.D[..., :, j] * surface[..., -1:]
            at += len(rates)
        bx = np.zeros((*lead, total), kind)
        bx[..., :n] = s.bx
        return Matrices(A, B, C, D, bx, s.by)


@dataclass(frozen=True, eq=False, kw_only=True)
class BehindServos(_BehindServos):
    """Any structure behind servos, of which some may have rate limits."""

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return dx/dt, shape (..., n)."""
        n = len(self.base.states)
        surfaces, rates = self._followed(x, u, params)
        inner = self.base.derivative(x[..., :n], surfaces, params[..., : len(self.base.parameters)])
        lead = np.broadcast_shapes(inner.shape[:-1], *(rate.shape for rate in rates))
        return np.concatenate(
            [np.broadcast_to(inner, (*lead, n)), *(np.broadcast_to(rate, lead)[..., None] for rate in rates)], axis=-1
        )

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return y, shape (..., p)."""
        surfaces, _ = self._followed(x, u, params)
        return self.base.output(x[..., : len(self.base.states)], surfaces, params[..., : len(self.base.parameters)])

    def _followed(self, x: AnyArray, u: AnyArray, params: AnyArray) -> tuple[AnyArray, list[AnyArray]]:
        """Return the surfaces (..., m) and the rate of every state of the servos."""
        at, values = len(self.base.states), params[..., len(self.base.parameters) :]
        columns: list[AnyArray] = [u[..., j] for j in range(u.shape[-1])]
        out: list[AnyArray] = []
        for link in self.links:
            rates, surface = link.rows(values)
            own = [x[..., at + i] for i in range(len(rates))] + [u[..., link.index]]
            found: list[Any] = [sum(row[..., i] * part for i, part in enumerate(own)) for row in rates]
            if link.servo.rate_limit_deg_s is not None:
                limit = link.servo.rate_limit_deg_s * DEG_RAD
                found[-1] = np.where(np.abs(found[-1].real) > limit, np.copysign(limit, found[-1].real), found[-1])
            moved: Any = sum(surface[..., i] * part for i, part in enumerate(own))
            columns[link.index] = moved
            out += found
            at += len(rates)
        return np.stack(np.broadcast_arrays(*columns), axis=-1), out


@dataclass(frozen=True, eq=False, kw_only=True)
class _Wire(LinearStructure):
    """Outputs that are the inputs: what a servo alone moves."""

    def matrices(self, params: AnyArray) -> Matrices:
        m, lead = len(self.inputs), np.shape(params)[:-1]
        none, eye = np.zeros((*lead, 0, m)), np.broadcast_to(np.eye(m), (*lead, m, m))
        return Matrices(
            np.zeros((*lead, 0, 0)), none, np.zeros((*lead, m, 0)), eye, np.zeros((*lead, 0)), np.zeros((*lead, m))
        )


def behind_servos(structure: ModelStructure, servos: Mapping[str, Servo]) -> Any:
    """Return the structure behind servos; itself if none has states.

    Parameters of a servo are named after its control: ``tau_de`` (lag, s) and, if it is to be estimated, ``T_de``
    (delay, s).

    Args:
        structure: whose inputs are commands.
        servos: input -> its servo.

    Raises:
        EstimationError: a servo belongs to what is no input, or a throttle has a rate limit in degrees.
    """
    links: list[_Link] = []
    parameters: list[Parameter] = []
    for name, servo in servos.items():
        if name not in structure.inputs:
            raise EstimationError(
                f"a servo belongs to an input of the structure ({', '.join(structure.inputs)}), got '{name}'"
                f"{nearest(name, structure.inputs)}"
            )
        control = name.removesuffix("_cmd")
        if control == "thr" and servo.rate_limit_deg_s is not None:
            raise EstimationError("rate_limit_deg_s belongs to a surface, got one of 'thr'; leave it out")
        lag = delay = None
        if servo.delay_s == "estimate":
            delay = len(parameters)
            parameters.append(Parameter(f"T_{control}", _START_DELAY_S, True, _LEAST_S, _MOST_S))
        if servo.lag_s is not None:
            lag, free = len(parameters), servo.lag_s == "estimate"
            value = START_LAGS_S[1] if servo.lag_s == "estimate" else servo.lag_s
            bounds = (_LEAST_S, _MOST_S) if free else (-np.inf, np.inf)
            parameters.append(Parameter(f"tau_{control}", value, free, *bounds))
        link = _Link(structure.inputs.index(name), control, servo, lag, delay)
        links += [link] if link.states else []
    if not links:
        return structure
    limited = any(link.servo.rate_limit_deg_s is not None for link in links)
    linear = isinstance(structure, LinearStructure) and not limited
    return (LinearBehindServos if linear else BehindServos)(
        name=structure.name,
        states=(*structure.states, *(s for link in links for s in link.states)),
        inputs=structure.inputs,
        outputs=structure.outputs,
        parameters=(*structure.parameters, *parameters),
        base=structure,  # type: ignore[arg-type]
        links=tuple(links),
    )


def surfaces(structure: Any, record: FlightRecord, held: NDArray[np.bool_]) -> FlightRecord:
    """Return the record with the surfaces that the servos of a structure make of its commands, under the same names.

    Args:
        structure: behind servos; the values of its parameters count.
        record: its inputs are commands; it begins with commands that have been constant.
        held: (m,) inputs that are held between samples.
    """
    k = len(structure.base.parameters)
    wire = _Wire(name="servos", states=(), inputs=structure.inputs, outputs=structure.inputs, parameters=())
    own: Any = replace(
        structure, states=structure.followers, outputs=structure.inputs, base=wire, parameters=structure.parameters[k:]
    )
    u = record.columns(structure.inputs)
    y = respond(own, own.values, (), u, Sampling(record.dt_s, held, 2 * SUBSTEPS), structure.at_rest(u[0])).y
    return record.with_columns({name: y[:, j] for j, name in enumerate(structure.inputs)})


def by_surfaces(
    records: Sequence[FlightRecord],
    structure: Any,
    settings: Settings,
    run: Callable[[list[FlightRecord], Any, Settings], ParametricModel],
) -> ParametricModel:
    """Return the estimate of a structure behind known servos, from the surfaces that they make of the commands.

    Args:
        records: with the commands.
        structure: behind servos; the values of their parameters count.
        settings: of the method.
        run: the method; it estimates the base from records with surfaces.
    """
    check_records(records, structure.must_move, structure.outputs)
    holding, recognised = held_inputs(structure.inputs, settings.held, records)
    k, tail = len(structure.base.parameters), len(structure.parameters) - len(structure.base.parameters)
    driven = {link.index for link in structure.links}
    still = [name for j, name in enumerate(structure.inputs) if holding[j] and j not in driven]
    base = replace(structure.base, parameters=structure.parameters[:k])
    flown = [surfaces(structure, record, holding) for record in records]
    model = run(flown, base, settings.model_copy(update={"held": tuple(still)}))
    x, u = model.operating_point
    servos = tuple(replace(p, free=False) for p in structure.parameters[k:])
    return replace(
        model,
        structure=replace(structure, parameters=(*structure.parameters[:k], *servos)),
        params=np.concatenate([model.params, structure.values[k:]]),
        covariance=np.pad(model.covariance, ((0, tail), (0, tail))),
        covariance_plain=np.pad(model.covariance_plain, ((0, tail), (0, tail))),
        held=tuple(holding.tolist()),
        operating_point=(np.concatenate([x, structure.at_rest(u)]), u),
        settings={**model.settings, **said_of_hold(recognised)},
        substeps=max(model.substeps, SUBSTEPS),
    )


def none_shows(
    structure: ModelStructure, names: Sequence[str], at_bound: NDArray[np.bool_], params: FloatArray
) -> NDArray[np.bool_]:
    """Return (k,) which of the estimates are lags or delays that ended at the least there is: none shows.

    A servo may well be quicker than the data can tell. Its time then ends at a bound that no one has set, which says
    nothing against the other estimates.

    Args:
        structure: with servos, or without.
        names: (k,) of all that was estimated, parameters of the structure first.
        at_bound: (k,) whether the search ended there.
        params: (n,) parameters of the structure at its end.
    """
    least = {n for n, value in zip(structure.parameter_names, params, strict=True) if value <= 1.001 * _LEAST_S}
    times = set(structure.unknown) if isinstance(structure, _BehindServos) else set()
    return np.array([bool(b) and n in times & least for n, b in zip(names, at_bound, strict=True)], dtype=bool)


def in_front(structure: ModelStructure) -> bool:
    """Return whether servos lie between the inputs and the aircraft of a structure."""
    return isinstance(structure, _BehindServos)


def servos_of(servos: Mapping[str, Servo], inputs: Sequence[str]) -> dict[str, Servo]:
    """Return the servos of these inputs that are not ignored."""
    return {name: servo for name, servo in servos.items() if name in inputs and not servo.ignore}
