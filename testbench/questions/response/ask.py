"""Frequency responses of recorded flights, all records of a description together."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.core.errors import located
from testbench.core.record import FlightRecord
from testbench.estimators.frequency.response import FrequencyResponse
from testbench.estimators.frequency.window_bias import response_with_bias
from testbench.estimators.prepare import prepared
from testbench.questions.identify.scenario import RecordDescription


def frequency_responses(
    description: RecordDescription, records: Sequence[FlightRecord], window_s: Sequence[float]
) -> FrequencyResponse:
    """Return the frequency responses of recorded flights, prepared as the description says, all records together.

    Each has beside its random error what its windows do to it.

    Raises:
        TestbenchError: with the file of the description that it comes from.
    """
    with located(description.file, "identification"):
        ready = [prepared(r, description.trim_s, description.preparation) for r in records]
        inputs, outputs = description.identification.inputs, description.outputs
        return response_with_bias(ready, inputs, outputs, window_s=window_s)
