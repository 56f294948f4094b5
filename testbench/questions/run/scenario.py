"""The scenario of a run: what is flown, sensed and identified. Keys carry their units."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from testbench.core.scenario.base import FlownInAir, Manoeuvre, Preparation, SuiteName
from testbench.estimators.identification import Identification


class Experiment(FlownInAir):
    """What is flown and sensed, and how records are prepared: common to runs and comparisons."""

    manoeuvre: Annotated[tuple[Manoeuvre, ...], Field(min_length=1, strict=False)]
    suites: Annotated[tuple[SuiteName, ...], Field(min_length=1, strict=False)]
    preparation: Preparation = Preparation()
    identification: Identification


class Scenario(Experiment):
    """One experiment: aircraft, condition, manoeuvres, sensor suites, estimators.

    ``seeds`` counts repetitions with noise, and in turbulence flights, of their own. With more than one the answer is
    an interval over all of them; records, models and tables show the first.
    """

    checked_by: ClassVar[str] = "testbench.questions.run.check:check"
    noted_by: ClassVar[str] = "testbench.questions.run.check:notes"

    seeds: Annotated[int, Field(ge=1, le=1000)] = 1

    @model_validator(mode="after")
    def _uses_and_names(self) -> Scenario:
        uses = [m.use for m in self.manoeuvre]
        if "split" not in uses and not {"identification", "validation"} <= set(uses):
            raise ValueError(
                "manoeuvres must include use = 'identification' and 'validation', or one with use = 'split'"
            )
        names = [m.name for m in self.manoeuvre]
        if len(set(names)) != len(names):
            raise ValueError(f"manoeuvre names must differ, got {', '.join(names)}")
        return self
