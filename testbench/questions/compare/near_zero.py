"""Quantities whose true value is near zero: their errors are told in their own units, as percent of it say nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from testbench.core.record import FloatArray
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.questions.compare.prediction import Prediction
from testbench.questions.compare.result import Quantity
from testbench.questions.compare.seen import Known

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
