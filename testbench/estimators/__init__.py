"""Estimators: measured records in, identified model out; one file per method, all named in :data:`METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord
from testbench.estimators.settings import (
    DsrE,
    EquationError,
    Equivalent,
    Estimator,
    FilterError,
    KalmanFilter,
    OutputError,
    PredictionError,
    Srivc,
    Subspace,
    TransferFunctions,
)

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel

__all__ = ["METHODS", "estimate"]

METHODS = {
    "dsr_e": "subspace identification DSR_e: one state-space model from all inputs to all outputs",
    "moesp": "subspace identification PO-MOESP: orthogonal projection on past inputs and outputs",
    "n4sid": "subspace identification N4SID: oblique projection on past inputs and outputs",
    "cva": "subspace identification CVA: canonical correlations of past and future",
    "dsr": "subspace identification DSR: Di Ruscio's deterministic and stochastic realisation",
    "ssarx": "subspace identification SSARX: a long ARX predictor first; consistent in closed loop",
    "pbsid_opt": "subspace identification PBSID-opt: states from a long ARX predictor; consistent in closed loop",
    "prediction_error": "discrete state-space model by prediction errors, started from a subspace estimate",
    "transfer_function": "least squares (ARX): one transfer function per output, from one input",
    "srivc": "continuous-time transfer functions by refined instrumental variables",
    "equivalent": "low-order equivalent model with delay, fitted to the frequency response",
    "equation_error": "a model structure by least squares on its state equations",
    "output_error": "a model structure by maximum likelihood for measurement noise",
    "filter_error": "a model structure by maximum likelihood for process and measurement noise (turbulence)",
    "ekf": "a model structure by an extended Kalman filter with its parameters as states",
    "ukf": "a model structure by an unscented Kalman filter with its parameters as states",
}
"""Method name in a scenario -> what it is."""

Runner = Callable[
    [Any, Sequence[FlightRecord], Sequence[str], Sequence[str], Sequence[FlightRecord]], "IdentifiedModel"
]


def estimate(
    spec: Estimator,
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    validation: Sequence[FlightRecord] = (),
) -> IdentifiedModel:
    """Run the estimator that a scenario names.

    Args:
        spec: entry ``identification.estimators`` of a scenario.
        records: measured records to identify from, as deviations from trim (see ``prepare``).
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        validation: measured records that a method may choose its structure by.

    Raises:
        EstimationError: the data cannot support the estimate, or the method is not in :data:`METHODS`.
        ChannelError: a record lacks a channel.
    """
    if not outputs:
        raise EstimationError("an estimate needs at least one output channel, got none; name outputs or add sensors")
    run = _RUNNERS.get(type(spec))
    if run is None:
        method = str(getattr(spec, "method", spec))
        raise EstimationError(f"the method must be one of the table, got '{method}'{nearest(method, METHODS)}")
    return run(spec, records, inputs, outputs, validation)


def _settings(spec: Any, *left_out: str) -> dict[str, Any]:
    """Return the fields of an entry that are arguments of its method."""
    return {name: getattr(spec, name) for name in type(spec).model_fields if name not in {"label", *left_out}}


def _dsr_e(spec: DsrE, records: Any, inputs: Any, outputs: Any, _: Any) -> IdentifiedModel:
    from testbench.estimators.subspace import dsr_e

    return dsr_e.estimate(records, inputs, outputs, **_settings(spec, "method"))


def _subspace(spec: Subspace, records: Any, inputs: Any, outputs: Any, _: Any) -> IdentifiedModel:
    from testbench.estimators.subspace import family

    return family.estimate(records, inputs, outputs, **_settings(spec))


def _transfer_function(
    spec: TransferFunctions, records: Any, inputs: Any, outputs: Any, validation: Any
) -> IdentifiedModel:
    from testbench.estimators import transfer_function

    return transfer_function.estimate(records, inputs, outputs, validation=validation, **_settings(spec, "method"))


def _srivc(spec: Srivc, records: Any, inputs: Any, outputs: Any, validation: Any) -> IdentifiedModel:
    from testbench.estimators import srivc

    return srivc.estimate(records, inputs, outputs, validation=validation, **_settings(spec, "method"))


def _equivalent(spec: Equivalent, records: Any, inputs: Any, outputs: Any, _: Any) -> IdentifiedModel:
    import numpy as np

    from testbench.estimators.frequency.equivalent import fit_equivalent
    from testbench.estimators.frequency.spectra import estimate_frequency_response

    response = estimate_frequency_response(records, inputs, outputs, window_s=spec.window_s)
    band = None if spec.band_hz is None else (2.0 * np.pi * spec.band_hz[0], 2.0 * np.pi * spec.band_hz[1])
    return fit_equivalent(response, band_rad_s=band, **_settings(spec, "method", "window_s", "band_hz"))


def _prediction_error(spec: PredictionError, records: Any, inputs: Any, outputs: Any, _: Any) -> IdentifiedModel:
    from testbench.estimators import prediction_error
    from testbench.estimators.subspace import dsr_e, family

    first: dict[str, Any] = {
        "past_horizon": spec.past_horizon,
        "future_horizon": spec.future_horizon,
        "order": spec.order,
        "direct_feedthrough": spec.direct_feedthrough,
        "stable": True,
    }
    if spec.start == "dsr_e":
        start = dsr_e.estimate(records, inputs, outputs, **first)
    else:
        start = family.estimate(records, inputs, outputs, method=spec.start, **first)
    return prediction_error.estimate(
        records,
        start,
        disturbances=spec.disturbances,
        direct_feedthrough=spec.direct_feedthrough,
        offsets=spec.offsets,
        max_iterations=spec.max_iterations,
    )


def _structured(
    spec: EquationError | OutputError | FilterError | KalmanFilter, records: Any, inputs: Any, outputs: Any, _: Any
) -> IdentifiedModel:
    from testbench.estimators.parametric import equation_error, filter_error, output_error
    from testbench.estimators.parametric.kalman import ekf, ukf
    from testbench.estimators.parametric.structures.build import build
    from testbench.estimators.structured import Structured

    structure = build(spec, inputs, outputs, records)
    methods: dict[str, Any] = {
        "equation_error": equation_error.estimate,
        "output_error": output_error.estimate,
        "filter_error": filter_error.estimate,
        "ekf": ekf.estimate,
        "ukf": ukf.estimate,
    }
    settings = _settings(spec, "method", *Structured.model_fields)
    settings |= {"delays_s": dict(spec.delays_s), "held": spec.held}
    if spec.method != "equation_error" and all(s in r for s in structure.states for r in records):
        try:
            first = equation_error.estimate(records, structure, delays_s=dict(spec.delays_s), held=spec.held)
        except EstimationError:
            pass  # the structure's own start must do; what the data do not decide, the method itself says
        else:
            found = {name: value for name, value in first.values.items() if name not in spec.start}
            structure = structure.with_parameters(found)
    model: IdentifiedModel = methods[spec.method](records, structure, **settings)
    return model


_RUNNERS: dict[type, Runner] = {
    DsrE: _dsr_e,
    Subspace: _subspace,
    TransferFunctions: _transfer_function,
    Srivc: _srivc,
    Equivalent: _equivalent,
    PredictionError: _prediction_error,
    EquationError: _structured,
    OutputError: _structured,
    FilterError: _structured,
    KalmanFilter: _structured,
}
