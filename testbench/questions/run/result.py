"""What a run finds: flights and their records, the truth beside them, and each case of suite and estimator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from testbench.core.advice import ranked
from testbench.estimators.cells import FailedCell
from testbench.estimators.identification import estimator_name
from testbench.evaluation.truth import Truth
from testbench.line import Case, Flight
from testbench.page.shown import Shown
from testbench.questions.run.findings import alpha_findings, error_findings, sampling_findings
from testbench.questions.run.scenario import Scenario
from testbench.questions.run.seeds import Repeats
from testbench.questions.run.seeds_answer import seeds_findings
from testbench.sensors import SensorSuite

if TYPE_CHECKING:
    from testbench.questions.identify.scenario import RecordDescription


@dataclass(frozen=True, eq=False)
class RunResult(Shown, page="testbench.questions.run.page:run_page"):
    """Everything a run found. ``table`` and ``findings`` are made from it; nothing is stored twice.

    ``questions`` are values of recorded flights that are hardly meant, in words. ``failed`` are the suites and
    estimators that gave no model. ``repeats`` has the errors over all seeds, if there are several.
    """

    name: str
    title: str
    question: str
    source: Scenario | RecordDescription
    seed: int
    flights: tuple[Flight, ...]
    cases: tuple[Case, ...]
    truth: Truth | None = None
    suites: tuple[SensorSuite, ...] = ()
    reference: Mapping[str, Any] = field(default_factory=dict)
    questions: tuple[str, ...] = ()
    failed: tuple[FailedCell, ...] = ()
    repeats: Repeats | None = None

    @cached_property
    def table(self) -> Any:
        """Pandas DataFrame, one row per suite, estimator, data set and output: MRSE and fit in percent."""
        import pandas as pd

        rows = [
            {
                "suite": c.suite,
                "estimator": estimator_name(c.estimator),
                "data": data,
                "output": o,
                "mrse_percent": m,
                "fit_percent": f,
            }
            for c in self.cases
            for data, scores in (
                ("identification", c.evaluation.identification),
                ("validation", c.evaluation.validation),
            )
            for o, m, f in zip(c.model.outputs, scores.mrse_percent, scores.fit_percent, strict=True)
        ]
        return pd.DataFrame(rows)

    @cached_property
    def findings(self) -> tuple[str, ...]:
        """The answer in a few sentences; the last are what is wrong or doubtful with each model, as advice."""
        out = [*self.questions]
        if self.repeats is None:
            out += alpha_findings(self.cases)
        else:
            out += seeds_findings(self.repeats, {s.name: s.channels for s in self.suites})
        out += error_findings(self.cases)
        if self.truth is not None:
            identification = next(f for f in self.flights if f.use != "validation")
            out += sampling_findings(self.cases, self.truth.modes, identification, self.source.preparation.lowpass_hz)
            out += [e.sentence for e in self.truth.excitation]
        for case in self.cases:
            out += [a.about(case.label) for a in ranked(case.model.advice) if a.severity != "note"]
        return tuple(out)
