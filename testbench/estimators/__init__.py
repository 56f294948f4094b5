"""Estimators: measured records in, identified model out; one file per method, all named in :data:`METHODS`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from testbench.errors import EstimationError, nearest
from testbench.record import FlightRecord
from testbench.scenario import DsrE, TransferFunctions

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel

__all__ = ["METHODS", "estimate"]

METHODS = {
    "dsr_e": "subspace identification DSR_e: one state-space model from all inputs to all outputs",
    "transfer_function": "least squares (ARX): one transfer function per output, from one input",
}
"""Method name in a scenario -> what it is."""


def estimate(
    spec: DsrE | TransferFunctions,
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
    if isinstance(spec, DsrE):
        from testbench.estimators import dsr_e

        return dsr_e.estimate(
            records,
            inputs,
            outputs,
            past_horizon=spec.past_horizon,
            future_horizon=spec.future_horizon,
            order=spec.order,
            direct_feedthrough=spec.direct_feedthrough,
        )
    if isinstance(spec, TransferFunctions):
        from testbench.estimators import transfer_function

        return transfer_function.estimate(
            records, inputs, outputs, poles=spec.poles, zeros=spec.zeros, validation=validation
        )
    method = str(getattr(spec, "method", spec))
    raise EstimationError(f"the method must be one of the table, got '{method}'{nearest(method, METHODS)}")
