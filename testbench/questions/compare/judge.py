"""How far identified models are from the truth: predictions, modes and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.metrics import mrse_percent
from testbench.evaluation.parameters import true_parameters
from testbench.evaluation.poles import match_poles
from testbench.questions.compare.prediction import LaggedStructure, Prediction, aircraft_poles
from testbench.questions.compare.result import Quantity
from testbench.questions.compare.seen import Known


def errors_of(
    known: Known, model: IdentifiedModel, judge: Sequence[FlightRecord], clean: Sequence[FlightRecord]
) -> dict[Quantity, float]:
    """Return the error of every quantity that a model gives: predictions of flights, modes and parameters.

    Args:
        known: the aircraft.
        model: what was identified.
        judge: measured flights that the model predicts.
        clean: the same without noise and biases; the predictions are compared with these.
    """
    out: dict[Quantity, float] = {}
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            predicted = np.vstack([np.asarray(model.simulate(r), float) for r in judge])
        true = np.vstack([r.columns(model.outputs) for r in clean])
        values = mrse_percent(true, predicted)
    except EstimationError:  # the model diverges over the judging flights
        values = np.full(len(model.outputs), np.nan)
    for name, value in zip(model.outputs, values.tolist(), strict=True):
        out[Quantity("prediction", name)] = value if np.isfinite(value) else np.nan
    return out | model_errors(known, model)


def model_errors(known: Known, model: IdentifiedModel) -> dict[Quantity, float]:
    """Return the errors of the wanted modes and parameters that a model gives."""
    return _mode_errors(known, model) | _parameter_errors(known, model)


def _mode_errors(known: Known, model: IdentifiedModel) -> dict[Quantity, float]:
    """Return errors of the wanted modes; the mean over the outputs of a model that has poles output by output."""
    found: dict[Quantity, list[float]] = {}
    own = isinstance(model, ParametricModel) and isinstance(model.structure, LaggedStructure)
    sets = {"": aircraft_poles(cast(ParametricModel, model))} if own else model.poles()
    for names, poles in sets.items():
        for match in match_poles(poles, known.modes, names):
            if match.name not in known.wanted_modes:
                continue
            wn = Quantity("mode", f"wn of {match.name}")
            zeta = Quantity("mode", f"zeta of {match.name}", "")
            found.setdefault(wn, [])
            if match.true.imag != 0.0:
                found.setdefault(zeta, [])
            if match.wn_error_percent is not None and match.zeta_error is not None:
                found[wn].append(match.wn_error_percent)
                if match.true.imag != 0.0:
                    found[zeta].append(match.zeta_error)
    return {q: float(np.mean(values)) if values else float("nan") for q, values in found.items()}


def _parameter_errors(known: Known, model: IdentifiedModel) -> dict[Quantity, float]:
    """Return relative errors of the wanted parameters, for models that have parameters of these names."""
    if not isinstance(model, ParametricModel):
        return {}
    structure = model.structure
    if isinstance(structure, LaggedStructure):
        true = dict(zip(structure.parameter_names, structure.true.tolist(), strict=True))
    else:
        derivatives = dimensional_derivatives(known.linear, known.trimmed)
        true = true_parameters(structure.meaning, derivatives, known.trimmed.condition.V_m_s)
    free = {p.name for p in structure.parameters if p.free}
    return {
        Quantity("parameter", name): 100.0 * (model.values[name] - true[name]) / abs(true[name])
        for name in known.wanted
        if name in free and true.get(name)
    }


# --- quantities whose true value is near zero: their errors are told in their own units, as percent of it say nothing -


PERCENT = "%"
_Errors = TypeVar("_Errors", float, FloatArray)
OwnUnits = Mapping[str, tuple[str, float]]
"""Quantity -> its unit, and the factor from percent of its true value to that unit."""


def near_zero(known: Known, predictions: Mapping[tuple[str, str], Prediction]) -> OwnUnits:
    """Return the quantities whose standard error by information is above 100 % by every input, through every suite.

    Through such sensors the sign of the quantity is not known, whichever suite and input are chosen.
    """
    least: dict[str, float] = {}
    values: dict[str, float] = {}
    for p in predictions.values():
        for name, unit, std, value in zip(p.names, p.units, p.std.tolist(), p.values.tolist(), strict=True):
            if unit == PERCENT and np.isfinite(std):
                least[name] = min(std, least.get(name, np.inf))
                values[name] = value
    unknown = [name for name, std in least.items() if std > 100.0]
    units = {d.name: d.unit for d in dimensional_derivatives(known.linear, known.trimmed)} if unknown else {}
    return {
        name: ("rad/s" if name.startswith("wn of ") else units.get(name, "SI"), abs(values[name]) / 100.0)
        for name in unknown
    }


def predicted_in_own_units(prediction: Prediction, own: OwnUnits) -> Prediction:
    """Return a prediction with the errors of these quantities in their own units."""
    factors = np.array([own[n][1] if n in own else 1.0 for n in prediction.names])
    units = tuple(own[n][0] if n in own else u for n, u in zip(prediction.names, prediction.units, strict=True))
    return replace(prediction, std=prediction.std * factors, units=units)


def errors_in_own_units(errors: Mapping[Quantity, _Errors], own: OwnUnits) -> dict[Quantity, _Errors]:
    """Return errors (numbers or arrays) with those of these quantities in their own units."""
    out: dict[Quantity, _Errors] = {}
    for quantity, error in errors.items():
        if quantity.kind != "prediction" and quantity.unit == PERCENT and quantity.name in own:
            unit, factor = own[quantity.name]
            out[quantity._replace(unit=unit)] = error * factor
        else:
            out[quantity] = error
    return out
