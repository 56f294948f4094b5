"""What is wrong where commands drive the model is wrong where recorded surfaces drive it.

What turns a surface otherwise than believed (a servo, an interconnect, a feedback) moves the aircraft. Re-tuned
coefficients imitate that, and so may an effect that acts elsewhere. The recorded surface has it all, so that nothing is
left for them to imitate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.core.errors import LimitError, RecordError, TrimError
from testbench.core.record import FlightAborted, FlightRecord
from testbench.questions.gap import tell
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.drive import driven
from testbench.questions.gap.evidence.air import AirFound, in_air
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.evidence.smoothed import smoothed
from testbench.questions.gap.parameters import WrongParameter
from testbench.questions.gap.search.fit import EffectFit, fit
from testbench.questions.gap.search.gauss_newton import retune
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.screening import screen


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
    there = _surfaces_drive(paths, believed, records, air) if parameters else None
    if there is None:
        return tuple(parameters)
    measured = there.measured()

    def off(p: WrongParameter) -> bool:
        return p.name in measured and (measured[p.name][0] - 1.0) / (p.factor - 1.0) * p.deviations > CRITERIA.off

    return tuple(p for p in parameters if off(p))


def named_beside(
    naming: Naming,
    paths: Sequence[JudgedPath],
    believed: Believed,
    records: Mapping[str, FlightRecord],
    air: AirFound,
) -> Naming:
    """Return ``naming`` without names that no recorded surface shows and that explain nothing where surfaces drive.

    If nothing is named then, and no effect of the path that differs could be fitted, it is that path that is not
    explained, whatever coefficients imitate of it.

    Args:
        naming: what is named where commands drive.
        paths: judged by their recorded surfaces.
        believed: the model that commands drive, in still air.
        records: those that named, with commands and surfaces, by name.
        air: what was heard.
    """
    differ = [p for p in paths if p.outcome == "differs"]
    beside = [f for f in naming.ranking if f.effect.name in naming.names and not any(p.told(f.effect) for p in differ)]
    there = _surfaces_drive(paths, believed, records, air) if beside and differ else None
    gone = [] if there is None else [f for f in beside if f.effect.met is None and not _explains(f, there)]
    names = tuple(n for n in naming.names if all(f.effect.name != n for f in gone))
    if gone:
        kept = [f for f in naming.ranking if f.effect.name in names]
        outcome = "set" if len(names) > 1 else "named" if names else "unexplained"
        naming = replace(naming, outcome=outcome, names=names, sentence=tell.imitates(gone, kept, differ))
    searched = {e.name for f in naming.ranking if f.flown for e in f.effect.singles}
    alone = [p for p in differ if searched.isdisjoint(p.effects)]
    if naming.outcome == "no gap" and alone:
        return replace(naming, outcome="unexplained", sentence=tell.path_alone(alone))
    return naming


def _explains(named: EffectFit, there: Hypothesis) -> bool:
    """Return whether an effect gains more than noise, or cannot be seen, where surfaces drive."""
    screened = screen(there, named.effect)
    if not screened.seen:
        return True
    begin = np.array(list(named.values.values()))
    found = fit(replace(screened, starts=(begin, *screened.starts)), there.chi2, 0.0, 1)
    return found is None or found.gain > named.threshold


def _surfaces_drive(
    paths: Sequence[JudgedPath], believed: Believed, records: Mapping[str, FlightRecord], air: AirFound
) -> Hypothesis | None:
    """Return the believed model, re-tuned, driven by recorded surfaces; None if no path differs or none can drive."""
    if all(p.outcome not in ("differs", "unexplained") for p in paths):
        return None
    try:
        by = driven(believed, records, {}, "surface")
        there = in_air(by.believed, air)
        return retune(Hypothesis.at(there, there, tuple(smoothed(there, air, list(by.records.values())))))
    except (FlightAborted, LimitError, RecordError, TrimError):
        return None  # surfaces were not recorded in all, or the model turns one by what it measures
