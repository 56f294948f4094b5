"""Recorded surfaces freed of noise, as far as the motion tells it.

Where a recorded surface u drives the believed model G, its noise is in the regressor: least squares of y - G(theta) u,
however well it is weighed, takes a control for weaker than it is (errors in variables; W. A. Fuller, Measurement Error
Models, 1987, chapter 1). The noise is white and of known size, so the residual of the believed model tells its
likeliest course s, by the smoother that belongs to the filter that whitens residuals (A. E. Bryson and M. Frazier,
1963). The model is then driven by u + s, and what s changes in the flight of the believed model is taken out of what
was measured: the residual stays what it was, and what an effect or a coefficient changes is uncorrelated with it.
"""

from __future__ import annotations

from collections.abc import Sequence

from testbench.core.record import FlightRecord
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import AirFound, filter_in
from testbench.questions.gap.evidence.commanded import surface_noise
from testbench.questions.gap.evidence.gust_filter import FlightFilter


def smoothed(believed: Believed, air: AirFound, records: Sequence[FlightRecord]) -> list[FlightRecord]:
    """Return records whose surfaces, where noisy ones drive the model, are what the motion says that they were.

    Args:
        believed: model, without any filter of residuals.
        air: that was flown through.
        records: measured.

    Raises:
        FlightAborted, LimitError: the believed aircraft does not survive what was recorded.
    """
    if not believed.surface_noise:
        return list(records)
    known = filter_in(believed, air)
    return [_smoothed(believed, known, record) for record in records]


def _smoothed(believed: Believed, known: FlightFilter, record: FlightRecord) -> FlightRecord:
    stirring = {f"{c}_cmd": c for c in surface_noise(record) if believed.surface_noise.get(c)}
    if not stirring:
        return record
    outputs, predicted = believed.outputs, believed.predict(record)
    left = believed.over_noise(record, record.columns(outputs) - predicted)
    errors = known.surface_errors(record, left)
    out = record.with_columns({n: record[n] + errors[c] for n, c in stirring.items()})
    measured = record.columns(outputs) + believed.predict(out) - predicted
    return out.with_columns(dict(zip(outputs, measured.T, strict=True)))
