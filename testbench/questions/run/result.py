"""What a run finds: flights and their records, the truth beside them, and each case of suite and estimator."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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


def _damping(pole: complex) -> float:
    return -pole.real / abs(pole) if pole != 0.0 else math.nan


OF_MODES: tuple[tuple[str, Callable[[complex], float]], ...] = (("wn, rad/s", abs), ("zeta", _damping))


def found_of(result: RunResult) -> dict[str, Any]:
    """Return what a run found, a number that is not finite as None.

    ``figures``: case -> name -> number; ``poles``: case -> outputs -> [real, imaginary], rad/s, upper half plane;
    ``true``: name -> number, of the modes of the aircraft, if the truth is asked for; ``failed``: case -> why
    it gave no model, if one did.
    """
    out: dict[str, Any] = {"figures": {}, "poles": {}}
    if result.failed:
        out["failed"] = {cell.label: cell.reason for cell in result.failed}
    for case in result.cases:
        out["figures"][case.label] = {name: finite(value) for name, value in _figures(case).items()}
        out["poles"][case.label] = {
            outputs: [
                [p.real, p.imag] for p in sorted(poles[poles.imag >= 0.0].tolist(), key=lambda p: (abs(p), p.real))
            ]
            for outputs, poles in case.model.poles().items()
        }
    if result.truth is not None:
        modes = result.truth.modes.items()
        out["true"] = {f"{mode} {name}": finite(value(s)) for mode, s in modes for name, value in OF_MODES}
    return out


def finite(value: float | None) -> float | None:
    """Return a number, None if it is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def _figures(case: Case) -> dict[str, float | None]:
    """Return the scalars of one case: prediction, modes and parameters, these with standard error and truth beside."""
    e = case.evaluation
    out: dict[str, float | None] = {"warning": float(case.model.status != "good")}
    for k, output in enumerate(case.model.outputs):
        out[f"validation MRSE of {output}, %"] = float(e.validation.mrse_percent[k])
        out[f"validation fit of {output}, %"] = float(e.validation.fit_percent[k])
    out["validation MRSE, %"] = e.validation.mrse_mean
    out["identification MRSE, %"] = e.identification.mrse_mean
    sets = len({match.outputs for match in e.poles})
    for match in e.poles:
        of = f" ({match.outputs})" if sets > 1 else ""
        for name, value in OF_MODES:
            out[f"{match.name}{of} {name}"] = None if match.found is None else value(match.found)
    for p in e.parameters:
        if p.free:
            out[p.name], out[f"{p.name}, std"] = p.value, p.std
            if p.true is not None:
                out[f"{p.name}, true"] = p.true
    return out
