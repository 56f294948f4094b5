"""A coefficient that is wrong where commands drive the model is wrong where recorded surfaces drive it.

What turns a surface otherwise than believed (a servo, an interconnect, a feedback) moves the aircraft, and re-tuned
coefficients imitate that. The recorded surface has it all, so that nothing is left for them to imitate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from testbench.core.errors import LimitError, RecordError, TrimError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.drive import driven
from testbench.questions.gap.evidence.air import AirFound, in_air
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.evidence.smoothed import smoothed
from testbench.questions.gap.parameters import WrongParameter
from testbench.questions.gap.search.gauss_newton import retune
from testbench.questions.gap.search.hypothesis import Hypothesis


def borne_out(
    parameters: Sequence[WrongParameter],
    paths: Sequence[JudgedPath],
    believed: Believed,
    records: Mapping[str, FlightRecord],
    air: AirFound,
) -> tuple[WrongParameter, ...]:
    """Return the parameters that are off where surfaces drive, too; all where no path differs or none can drive.

    Args:
        parameters: wrong where commands drive.
        paths: judged by their recorded surfaces.
        believed: the model that commands drive, in still air.
        records: those that named, with commands and surfaces, by name.
        air: what was heard.
    """
    if not parameters or all(p.outcome not in ("differs", "unexplained") for p in paths):
        return tuple(parameters)
    try:
        by = driven(believed, records, {}, "surface")
        there = in_air(by.believed, air)
        measured = retune(
            Hypothesis.at(there, there, tuple(smoothed(there, air, list(by.records.values()))))
        ).measured()
    except (FlightAborted, LimitError, RecordError, TrimError):
        return tuple(parameters)  # surfaces were not recorded in all, or the model turns one by what it measures

    def off(p: WrongParameter) -> bool:
        return p.name in measured and (measured[p.name][0] - 1.0) / (p.factor - 1.0) * p.deviations > CRITERIA.off

    return tuple(p for p in parameters if off(p))
