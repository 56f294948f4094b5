"""What a run finds: flights and their records, the truth beside them, and each case of suite and estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.estimators.model import IdentifiedModel
from testbench.evaluation import Evaluation
from testbench.evaluation.answers import alpha_findings, sampling_findings
from testbench.evaluation.bode import zero_order_hold
from testbench.evaluation.excitation import ModeExcitation
from testbench.flight import LinearModel, TrimmedFlight
from testbench.record import FlightRecord, FloatArray
from testbench.scenario import Estimator, Scenario, estimator_name
from testbench.sensors import SensorSuite

if TYPE_CHECKING:
    from testbench.logs.description import RecordDescription


@dataclass(frozen=True, eq=False)
class Flight:
    """One manoeuvre: how its record is used, the truth (None for a recorded flight), and the record of each suite."""

    name: str
    use: str
    truth: FlightRecord | None
    measured: Mapping[str, FlightRecord]
    trim_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Case:
    """One suite and one estimator: the prepared records, the model and its evaluation."""

    suite: str
    estimator: Estimator
    identification: tuple[FlightRecord, ...]
    validation: tuple[FlightRecord, ...]
    model: IdentifiedModel
    evaluation: Evaluation

    @property
    def label(self) -> str:
        """Suite and estimator, in words."""
        return f"{self.suite}, {estimator_name(self.estimator)}"


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of a simulated aircraft: its linear model at trim, its modes, and what the input does to them."""

    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    modes: Mapping[str, complex]
    excitation: tuple[ModeExcitation, ...]

    def response(
        self,
        omega_rad_s: FloatArray,
        outputs: Sequence[str],
        inputs: Sequence[str],
        dt_s: float,
        continuous: bool = False,
    ) -> Any:
        """Return the true response (k, p, m) as a discrete or a ``continuous`` model should have it.

        A command is held from sample to sample, and the hold is part of a discrete model; a measured deflection has
        passed the servo and runs smoothly through its samples, so that no hold belongs to it.
        """
        H = self.linear.frequency_response(omega_rad_s, outputs, inputs)
        if continuous:
            return H
        held = np.array([name.endswith("_cmd") for name in inputs])
        hold = zero_order_hold(omega_rad_s, dt_s)
        return np.where(held, hold[:, None, None] * H, H)


@dataclass(frozen=True, eq=False)
class RunResult:
    """Everything a run found. ``table`` and ``findings`` are made from it; nothing is stored twice."""

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
        """The answer in a few sentences."""
        out = alpha_findings(self.cases)
        if self.truth is not None:
            identification = next(f for f in self.flights if f.use != "validation")
            out += sampling_findings(self.cases, self.truth.modes, identification, self.source.preparation.lowpass_hz)
            out += [e.sentence for e in self.truth.excitation]
        for case in self.cases:
            out += [f"{case.label}: {advice}" for advice in case.model.advice]
        return tuple(out)
