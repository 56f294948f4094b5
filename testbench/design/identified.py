"""What a design is identified by: the table ``identification`` of the scenario that it writes.

The design predicts the errors of the linearised aircraft whose chosen derivatives are free and whose other numbers are
those believed. That very structure is written as equations, so that the targets are estimated and nothing else.
Commands pass the servos that the aircraft is believed to have; deflections that the suite senses drive it themselves.
Outputs pass the lags of their sensors, and a delay as (1 - T s / 2) / (1 + T s / 2). They have offsets of their own,
and initial states are free where nothing elastic moves. In still air output error estimates. In turbulence it is filter
error, whose process noise lies on the velocities through the air: a gust of Dryden's form changes them like white
noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.schema import parse
from testbench.estimators import estimate
from testbench.estimators.identification import Identification
from testbench.estimators.parametric.likelihood import held_inputs
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.starts import of_servos
from testbench.estimators.parametric.structures.build import build
from testbench.estimators.settings import FilterError
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.fisher import start_responses
from testbench.sensors import Sensor, SensorSuite

STRUCTURE = "designed_for"
"""Name of the structure in the scenario."""
_OWN = 0.03  # share of an offset that no initial state explains, from which both can be estimated
_NOTHING = 1e-12  # of the largest entry: left of a zero after differences
_TRUE = "motion_"  # before the name of a state whose sensor shows it late
_SAME = 1e-6  # by which a linearised output that is a state departs from it
Terms = dict[str, float]
"""An entry of a matrix: product of parameters ("" for a constant) -> its factor."""


@dataclass(frozen=True, eq=False)
class Identified:
    """The estimator of a design.

    Attributes:
        structure: the linearised aircraft driven by deflections; gives the order of the parameters.
        table: the table ``identification``.
        asked: the same, read.
    """

    structure: AircraftStructure
    table: Mapping[str, Any]
    asked: Identification

    @property
    def words(self) -> str:
        """The method, in words."""
        return str(self.asked.estimators[0].method).replace("_", " ")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Channels that drive it."""
        return self.asked.inputs

    def estimate(self, record: FlightRecord) -> tuple[FloatArray, FloatArray]:
        """Return estimates (k,) and their stated covariance (k, k), from a prepared record.

        Raises:
            EstimationError: no estimate.
        """
        outputs = tuple(n for n in record.channels if n not in self.inputs)
        entry = self.asked.estimators[0]
        if isinstance(entry, FilterError):  # whether there is any turbulence is not asked of every flight
            entry = entry.model_copy(update={"against_none": False})
        model: Any = estimate(entry, [record], self.inputs, outputs)
        at = [model.structure.parameter_names.index(name) for name in self.structure.parameter_names]
        if not np.all(np.isfinite(model.params[at])):
            raise EstimationError("the estimate is not finite")
        return model.params[at], model.covariance[np.ix_(at, at)]

    def modelled(self, record: FlightRecord) -> FloatArray:
        """Return the outputs (N, p) that its model has at the believed parameters, driven by a prepared record."""
        entry: Any = of_servos(self.asked.estimators[0])
        structure = build(entry, self.inputs, self.structure.outputs, [record])
        held, _ = held_inputs(structure.inputs, entry.held, [record])
        u, start = record.columns(structure.inputs), np.zeros(len(structure.states))
        return respond(structure, structure.values, (), u, Sampling(record.dt_s, held), start).y


def identified_by(
    structure: AircraftStructure, suite: SensorSuite, servo_lag_s: Mapping[str, float], samples: int, moves: bool
) -> Identified:
    """Return the estimator of a design.

    Args:
        structure: driven by deflections.
        suite: what senses; a control that it does not sense is driven by its command.
        servo_lag_s: control -> time constant of its servo; none for one without.
        samples: of the suite in the record.
        moves: whether turbulence is expected.
    """
    inputs = [c if c in suite.channels else f"{c}_cmd" for c in structure.inputs]
    free = starts_free(structure)
    late = {s.channel: _late_s(s, suite) for s in suite.sensors if s.channel in structure.outputs}
    late = {name: times for name, times in late.items() if any(times)}
    named = [f"{_TRUE}{s}" if s in late else s for s in structure.states]
    # the noise of a sensed deflection turns the aircraft in the model's flight, and not in the real one
    felt = ("u", "v", "w") if all(i.endswith("_cmd") for i in inputs) else ("u", "v", "w", "p", "q", "r")
    shaken = [n for n, s in zip(named, structure.states, strict=True) if s in felt]
    air = {"process_noise": shaken, "process_noise_model": "diagonal"}
    entry: dict[str, Any] = {
        **({"method": "filter_error", **air} if moves else {"method": "output_error", "starts": 1}),
        "structure": STRUCTURE,
        "outputs": list(structure.outputs),
        "initial_states": "free" if free else "zero",
        "output_biases": _offsets(structure, samples / suite.rate_hz, free),
    }
    servos = {i: {"lag_s": servo_lag_s[c]} for i, c in zip(inputs, structure.inputs, strict=True) if c in servo_lag_s}
    servos = {i: servo for i, servo in servos.items() if i.endswith("_cmd")}
    still = {i: {"ignore": True} for i in inputs if i.endswith("_cmd") and i not in servos}
    if servos or still:
        entry["servo"] = {**servos, **still}
    equations = _equations(structure, named, inputs, late)
    table = {"inputs": inputs, "structures": {STRUCTURE: equations}, "estimators": [entry]}
    asked, faults = parse(Identification, table, None)
    if asked is None or faults:
        raise EstimationError("; ".join(faults))
    return Identified(structure, table, asked)


def starts_free(structure: AircraftStructure) -> bool:
    """Return whether initial states are estimated: not those of elastic modes, which no sensor tells apart."""
    return not any(s.startswith("eta") for s in structure.states)


def _offsets(structure: AircraftStructure, duration_s: float, free: bool) -> list[str]:
    """Return the outputs whose offset is not what an initial state does: not that of the height."""
    if not free:
        return list(structure.outputs)
    n = max(20, round(duration_s * 10.0))
    felt = start_responses(structure, n, duration_s / n)  # (n, p, states)
    columns = felt.reshape(-1, felt.shape[2])
    size = np.linalg.norm(columns, axis=0)
    Q, _ = np.linalg.qr(columns[:, size > 0.0] / size[size > 0.0])
    out = []
    for i, name in enumerate(structure.outputs):
        offset = np.zeros(felt.shape[:2])
        offset[:, i] = 1.0
        left = offset.ravel() - Q @ (Q.T @ offset.ravel())
        if np.linalg.norm(left) > _OWN * np.linalg.norm(offset):
            out.append(name)
    return out


def _late_s(sensor: Sensor, suite: SensorSuite) -> tuple[float, float]:
    """Return lag and delay of a sensor, s; zero where their pole lies beyond the Nyquist frequency of the suite."""
    fastest = np.pi * suite.rate_hz
    lag, delay = sensor.lag_s, sensor.delay_s
    return lag if lag * fastest > 1.0 else 0.0, delay if delay * fastest > 2.0 else 0.0


def _equations(
    structure: AircraftStructure, named: Sequence[str], inputs: Sequence[str], late: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:
    """Return the equations of a structure as text, with its parameters at their believed values.

    Args:
        structure: the linearised aircraft.
        named: what its states are called.
        inputs: what its inputs are called.
        late: output -> lag and delay of its sensor, s, of those that have some.
    """
    names = (*named, *inputs)
    rates, shown = _terms(structure)
    parameters: dict[str, Any] = dict(zip(structure.parameter_names, structure.true.tolist(), strict=True))
    equations = {f"{s}_dot": _sum(row, names) for s, row in zip(named, rates, strict=True)}
    states, more, outputs = set(structure.states), [], {}
    for i, (name, row) in enumerate(zip(structure.outputs, shown, strict=True)):
        if name not in late:
            if name not in states:
                outputs[name] = _sum(row, names)
                continue
            unit = np.array([s == name for s in names], float)
            if not np.allclose(np.hstack([structure.C0[i], structure.D0[i]]), unit, atol=_SAME):
                raise EstimationError(f"the output {name} must be the state of that name, got {_sum(row, names)}")
            continue
        text, (lag_s, delay_s) = _sum(row, names), late[name]
        if lag_s > 0.0:
            equations[f"{name}_lag_dot"] = f"({text} - {name}_lag)*{1.0 / lag_s:.15g}"
            more.append(f"{name}_lag")
            text = f"{name}_lag"
        if delay_s > 0.0:
            equations[f"{name}_late_dot"] = f"({text} - {name}_late)*{2.0 / delay_s:.15g}"
            more.append(f"{name}_late")
            text = f"2*{name}_late - ({text})"
        outputs[name] = text
    return {
        "title": f"the {structure.name}: deviations from trim, SI units and radians",
        "means": _meaning(structure),
        "states": [*named, *more],
        "inputs": list(inputs),
        "equations": equations,
        "outputs": outputs,
        "parameters": parameters,
    }


def _meaning(structure: AircraftStructure) -> str:
    """Return the packaged structure whose parameters the derivatives are: with elastic modes those with modes held."""
    if any(s.startswith("eta") for s in structure.states):
        return "flexible"
    return "longitudinal" if "w" in structure.states else "lateral_directional"


def _terms(structure: AircraftStructure) -> tuple[list[list[Terms]], list[list[Terms]]]:
    """Return the entries of [A, B] and of [C, D] as sums of products of parameters."""
    base = np.hstack([structure.A0, structure.B0])
    rest = base - np.einsum("k,kij->ij", structure.true, structure.directions)
    small = _NOTHING * np.abs(base).max(axis=1, keepdims=True)
    change: list[list[Terms]] = []
    for i in range(base.shape[0]):
        row: list[Terms] = []
        for j in range(base.shape[1]):
            moved = {
                p: float(d)
                for p, d in zip(structure.parameter_names, structure.directions[:, i, j], strict=True)
                if d != 0.0
            }
            row.append({"": float(rest[i, j]) if abs(rest[i, j]) > small[i, 0] else 0.0, **moved})
        change.append(row)
    for omega, zeta, i, j in structure.modal:
        w, z = structure.parameter_names[omega], structure.parameter_names[zeta]
        change[i][j] = {"": 0.0, f"{w}*{w}": -1.0}
        change[i][i] = {"": 0.0, f"{z}*{w}": -2.0}
    out = []
    output = np.hstack([structure.C0, structure.D0])
    for o in range(output.shape[0]):
        row = []
        for j in range(output.shape[1]):
            entry: Terms = {"": float(output[o, j])}
            for i in np.flatnonzero(structure.P[o]).tolist():
                if set(change[i][j]) - {""}:  # what the parameters change, and the output holds
                    weight = float(structure.P[o, i])
                    entry[""] -= weight * float(base[i, j])
                    for term, factor in change[i][j].items():
                        entry[term] = entry.get(term, 0.0) + weight * factor
            row.append(entry)
        top = max((abs(e[""]) for e in row), default=0.0)
        out.append([{**e, "": e[""] if abs(e[""]) > _NOTHING * max(top, 1e-300) else 0.0} for e in row])
    return change, out


def _sum(row: Sequence[Terms], names: Sequence[str]) -> str:
    """Return a row as the text of a sum over states and inputs."""
    parts = []
    for terms, name in zip(row, names, strict=True):
        inner = [_product(factor, term) for term, factor in terms.items() if factor != 0.0]
        if not inner:
            continue
        text = " + ".join(inner)
        parts.append(name if text == "1" else f"({text})*{name}" if len(inner) > 1 else f"{text}*{name}")
    return " + ".join(parts) if parts else f"0*{names[0]}"


def _product(factor: float, term: str) -> str:
    number = f"{factor:.15g}"
    number = f"({number})" if factor < 0.0 else number
    return number if not term else term if factor == 1.0 else f"{number}*{term}"
