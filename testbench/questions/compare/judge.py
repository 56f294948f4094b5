"""How far identified models are from the truth: predictions, modes and parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.metrics import mrse_percent
from testbench.evaluation.parameters import true_parameters
from testbench.evaluation.poles import match_poles
from testbench.questions.compare.prediction import LaggedStructure, aircraft_poles
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
