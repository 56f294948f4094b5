"""Where a method that fits a structure starts: the structure of its entry, with values from equation error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.parametric import equation_error
from testbench.estimators.parametric.servo import START_LAGS_S, SUBSTEPS, in_front
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures.build import build
from testbench.estimators.structured import Structured


def of_servos(entry: Any) -> Any:
    """Return an entry whose known delays of servos stand among its delays, and whose steps are fine enough for them.

    Raises:
        EstimationError: equation error is asked to estimate a servo, which it takes as known; or a delay stands twice.
    """
    servos = {name: servo for name, servo in entry.servo.items() if not servo.ignore}
    for name, servo in servos.items():
        limited = servo.rate_limit_deg_s is not None
        able = ("output_error",) if limited else ("output_error", "filter_error")
        if "estimate" in (servo.lag_s, servo.delay_s) and entry.method not in able:
            raise EstimationError(
                f"{entry.method} takes the servo of '{name}'{' with its rate limit' if limited else ''} as known; give "
                f"lag_s and delay_s as numbers, or let {' or '.join(able)} estimate them"
            )
        if servo.delay_s and name in entry.delays_s:
            raise EstimationError(f"the delay of '{name}' stands in delays_s and in its servo; give it once")
    known = {n: float(s.delay_s) for n, s in servos.items() if s.delay_s != "estimate" and s.delay_s > 0.0}
    changes: dict[str, Any] = {"delays_s": {**entry.delays_s, **known}} if known else {}
    if hasattr(entry, "substeps") and any(s.rate_limit_deg_s is not None for s in servos.values()):
        changes["substeps"] = max(entry.substeps, SUBSTEPS)
    return entry.model_copy(update=changes) if changes else entry


def started(
    entry: Structured, records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str]
) -> ModelStructure:
    """Return the structure of an entry; equation error gives its start values where all its states are measured.

    Values that the entry's ``start`` names stay. Lags that are to be estimated start from the one, of some, with which
    equation error leaves least.

    Args:
        entry: of a scenario.
        records: prepared records.
        inputs: (m,) input channels of the identification.
        outputs: (p,) output channels of the identification.

    Raises:
        EstimationError: see :func:`.structures.build.build`.
    """
    structure: ModelStructure = build(entry, inputs, outputs, records)
    measured = structure.states[: len(structure.states) - len(structure.followers)]
    if getattr(entry, "method", "") == "equation_error" or not all(s in r for s in measured for r in records):
        return structure
    delays = {name: delay for name, delay in entry.delays_s.items() if name in structure.inputs}
    first = None
    for values in _lags(structure, entry):
        try:
            tried = equation_error.estimate(
                records, structure.with_parameters(values), delays_s=delays, held=entry.held
            )
        except EstimationError:
            continue  # its own start must do; what the data do not decide, the method itself says
        left = float(np.sum(np.log(np.maximum(tried.diagnostics["residual_std"], 1e-300))))
        if first is None or left < first[0]:
            first = left, tried
    if first is None:
        return structure
    return structure.with_parameters({name: v for name, v in first[1].values.items() if name not in entry.start})


def _lags(structure: Any, entry: Structured) -> list[dict[str, float]]:
    """Return the values of unknown lags to try; one set without any if there are none."""
    unknown = structure.unknown if in_front(structure) else ()
    names = [name for name in unknown if name.startswith("tau_") and name not in entry.start]
    return [dict.fromkeys(names, lag) for lag in START_LAGS_S] if names else [{}]  # one servo is much like another
