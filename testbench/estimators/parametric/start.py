"""Where a method that fits a structure starts: the structure of its entry, with values from equation error.

Output and filter error look for start values by themselves, from Python too (see ``starts``).
"""

from __future__ import annotations

from collections.abc import Sequence

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.parametric import equation_error
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures.build import build
from testbench.estimators.structured import Structured

_BY_THEMSELVES = ("equation_error", "output_error", "filter_error")


def started(
    entry: Structured, records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str]
) -> ModelStructure:
    """Return the structure of an entry; equation error gives its start values where all its states are measured.

    Values that the entry's ``start`` names stay.

    Args:
        entry: of a scenario.
        records: prepared records.
        inputs: (m,) input channels of the identification.
        outputs: (p,) output channels of the identification.

    Raises:
        EstimationError: see :func:`.structures.build.build`.
    """
    structure: ModelStructure = build(entry, inputs, outputs, records)
    if getattr(entry, "method", "") in _BY_THEMSELVES or not all(s in r for s in structure.states for r in records):
        return structure
    try:
        first = equation_error.estimate(records, structure, delays_s=dict(entry.delays_s), held=entry.held)
    except EstimationError:
        return structure  # its own start must do; what the data do not decide, the method itself says
    return structure.with_parameters({name: v for name, v in first.values.items() if name not in entry.start})
