"""The structure that a scenario describes, for the channels and the trim of its records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core import bring
from testbench.core.bring import is_brought, short
from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord
from testbench.estimators.brought import guarded, is_text, place
from testbench.estimators.equations import read_equations
from testbench.estimators.parametric.servo import behind_servos, servos_of
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures import STRUCTURES, Trim
from testbench.estimators.parametric.structures.settings import OUTPUTS
from testbench.estimators.parametric.structures.written import written
from testbench.estimators.structured import Structured


def build(
    spec: Structured, inputs: Sequence[str], outputs: Sequence[str], records: Sequence[FlightRecord]
) -> ModelStructure:
    """Return the ModelStructure of a scenario's entry.

    A structure of the user's own is what the function ``make(inputs, outputs, trim)`` of the file returns: a
    ModelStructure whose inputs and outputs are among those given. ``trim`` is a :class:`~.Trim`, or None where no
    airspeed is known. One from equations as text has those outputs of the identification that it has equations for.

    Args:
        spec: the entry.
        inputs: (m,) input channels of the identification.
        outputs: (p,) output channels of the identification; those that the structure does not have are left out.
        records: prepared records; their provenance says what was removed as trim.

    Raises:
        EstimationError: the structure has none of the outputs, a trim speed is not known, or a parameter, input or
            output is not one of the structure's.
    """
    for name in (*spec.inputs, *spec.servo):
        if name not in inputs:
            raise EstimationError(
                f"inputs and servos of a structure must be among those asked for ({', '.join(inputs)}), got "
                f"'{name}'{nearest(name, inputs)}"
            )
    inputs = spec.inputs or inputs
    if spec.equations is not None or is_text(spec.structure):
        return _with_parameters(spec, _written(spec, tuple(outputs), records), inputs)
    if is_brought(spec.structure):
        structure = _brought(spec, tuple(inputs), tuple(spec.outputs or outputs), records)
        return _with_parameters(spec, structure, inputs)
    possible = OUTPUTS[spec.structure]
    if spec.short:
        possible = tuple(name for name in possible if name not in ("V", "theta", "ax"))
    chosen = spec.outputs or tuple(name for name in outputs if name in possible)
    if not chosen:
        raise EstimationError(
            f"structure '{spec.structure}' has outputs {', '.join(possible)}, but the identification senses "
            f"{', '.join(outputs)}; choose another structure, or sense one of them"
        )
    return _with_parameters(spec, _made(spec, tuple(inputs), chosen, records), inputs)


def _with_parameters(spec: Structured, structure: ModelStructure, inputs: Sequence[str]) -> ModelStructure:
    if set(structure.inputs) - set(inputs):
        raise EstimationError(
            f"structure '{short(spec.structure)}' is driven by {', '.join(structure.inputs)}, but the inputs of the "
            f"identification are {', '.join(inputs)}; name them there"
        )
    structure = behind_servos(structure, servos_of(spec.servo, structure.inputs))
    return structure.with_parameters(
        spec.start, fixed=spec.fixed, free=spec.free, bounds=dict(spec.bounds), prior_std=dict(spec.prior_std)
    )


def _brought(
    spec: Structured, inputs: tuple[str, ...], outputs: tuple[str, ...], records: Sequence[FlightRecord]
) -> ModelStructure:
    """Return what the user's ``make(inputs, outputs, trim)`` makes; trim is None where no airspeed is known."""
    path, attribute = place(spec.structure)
    label = short(spec.structure)
    make = bring.load(path, attribute)
    trim = _known_trim(spec, records)
    made = guarded(path, label, "a ModelStructure", make, inputs, outputs, trim)
    if not isinstance(made, ModelStructure):
        raise EstimationError(f"{label} must return a ModelStructure, got {type(made).__name__}")
    missing = [name for name in made.outputs if name not in outputs]
    if missing or not made.outputs:
        got = ", ".join(made.outputs) or "none"
        raise EstimationError(f"a structure of {label} must have outputs among {', '.join(outputs)}, got {got}")
    return made


def _written(spec: Structured, outputs: tuple[str, ...], records: Sequence[FlightRecord]) -> ModelStructure:
    """Return the structure of equations as text, for those outputs that it has."""
    equations = spec.equations or read_equations(Path(spec.structure))
    possible = equations.possible_outputs
    chosen = spec.outputs or tuple(name for name in outputs if name in possible)
    name = Path(spec.structure).stem if spec.equations is None else spec.structure
    if not chosen:
        raise EstimationError(
            f"structure '{name}' has outputs {', '.join(possible)}, but the identification senses "
            f"{', '.join(outputs)}; give an equation for one of them under outputs, or sense one"
        )
    structure = written(equations, name, chosen, _known_trim(spec, records))
    for record in records:
        _check_start(structure, record)
    return structure


def _check_start(structure: ModelStructure, record: FlightRecord) -> None:
    """Check that the equations have values and derivatives where a record begins.

    Raises:
        EstimationError: one has not; with the states, inputs and what may be the cause.
    """
    x, u = structure.initial_state(record), record.columns(structure.inputs)[0]
    with np.errstate(all="ignore"):
        j = structure.jacobians(x, u, structure.values)
        f, h = structure.derivative(x, u, structure.values), structure.output(x, u, structure.values)
    rows = [(f"{s}_dot", (f[i], *j.fx[i], *j.fu[i], *j.fp[i])) for i, s in enumerate(structure.states)]
    rows += [(o, (h[i], *j.hx[i], *j.hu[i], *j.hp[i])) for i, o in enumerate(structure.outputs)]
    for name, numbers in rows:
        if not np.all(np.isfinite(numbers)):
            given = (*zip(structure.states, x, strict=True), *zip(structure.inputs, u, strict=True))
            said = ", ".join(f"{n} = {v:.4g}" for n, v in given)
            raise EstimationError(
                f"'{name}' of structure '{structure.name}' must have a finite value and slope where a record begins, "
                f"at {said}; say under initial where states begin, and keep what equations divide by from being "
                'removed as trim (preparation.bias = "none")'
            )


def _made(spec: Structured, inputs: tuple[str, ...], outputs: tuple[str, ...], records: Sequence[FlightRecord]) -> Any:
    factory = STRUCTURES[spec.structure].factory
    if spec.structure == "short_period":
        if len(inputs) != 1:
            raise EstimationError(
                f"structure 'short_period' has one input, got {', '.join(inputs)}; take 'longitudinal' with "
                "short = true"
            )
        return factory(outputs, inputs[0])
    if spec.structure == "roll_yaw_rates":
        return factory(outputs, tuple(name for name in inputs if name != "beta"))
    if spec.structure == "lateral_per_speed":
        return factory(outputs, inputs)
    if spec.structure == "aerodynamic_longitudinal":
        assert spec.airframe is not None
        return factory(spec.airframe, outputs=outputs, controls=tuple(name for name in inputs if name != "thrust"))
    trim = Trim(*_trim(spec, records))
    settings: dict[str, Any] = {"outputs": outputs, "controls": inputs, "accelerometer": spec.accelerometer_m}
    if spec.structure != "lateral_directional" and (spec.short or spec.structure == "flexible"):
        whole = spec.structure == "flexible" and not spec.short and "V" in outputs
        settings["states"] = ("V", "alpha", "q", "theta") if whole else ("alpha", "q")
    if spec.structure == "flexible":
        settings["wn_rad_s"] = [2.0 * np.pi * f for f in spec.modes_hz]
    return factory(trim, **settings)


def _known_trim(spec: Structured, records: Sequence[FlightRecord]) -> Trim | None:
    try:
        return Trim(*_trim(spec, records))
    except EstimationError:
        return None


def _trim(spec: Structured, records: Sequence[FlightRecord]) -> tuple[float, float, float]:
    """Return airspeed, alpha and theta at trim: from the entry, else the means of what was removed from the records."""
    removed = [dict(r.provenance.get("prepared", {}).get("removed", {})) for r in records]

    def mean(name: str) -> float | None:
        values = [part[name] for part in removed if part.get(name)]
        return float(np.mean(values)) if values else None

    V = spec.V_m_s or mean("V")
    if V is None:
        raise EstimationError(
            f"structure '{spec.structure}' needs the trim speed: give V_m_s, or sense V and remove its trim value"
        )
    alpha = mean("alpha") if spec.alpha_deg is None else spec.alpha_deg * DEG_RAD
    theta = mean("theta") if spec.theta_deg is None else spec.theta_deg * DEG_RAD
    alpha = alpha if alpha is not None else theta or 0.0
    return V, alpha, alpha if theta is None else theta
