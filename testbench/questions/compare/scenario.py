"""Comparison scenarios: the same flights through several sensor suites, inputs and estimators."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.scenario.base import SuiteName
from testbench.core.schema import Names, Positive, Strict
from testbench.estimators.identification import Estimator, Identification, estimator_name
from testbench.questions.run.scenario import Experiment

BEST_CASE = "best case"
"""Label of maximum likelihood with the linearised aircraft's own equations and the noise of its instruments."""


class CompareIdentification(Identification):
    """Inputs, outputs and estimators of every suite.

    ``outputs`` left empty means every channel of a suite that is not a control. ``best_case`` adds an estimator that
    knows the aircraft's equations and the noise of its instruments, and starts at the truth. It finds the derivatives
    alone by maximum likelihood and weights the noise of measured inputs as it passes through the aircraft. It shows
    what the sensors allow, and the prediction by information is a prediction of its errors. Without any estimator the
    comparison is by information alone.
    """

    best_case: bool = False
    estimators: Annotated[tuple[Estimator, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _labels(self) -> CompareIdentification:
        names = self.labels
        if len(set(names)) != len(names):
            raise ValueError(f"labels of estimators must differ, got {', '.join(names)}; give each a label")
        return self

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the estimators in tables, the best case last."""
        names = tuple(estimator_name(e) for e in self.estimators)
        return (*names, BEST_CASE) if self.best_case else names


class CompareTargets(Strict):
    """The quantities compared besides prediction: modes, and derivatives of the linearised aircraft.

    If they are left empty, the mode is the fast rigid one of the plane (short period or Dutch roll), and the parameters
    are those that shape it.
    """

    modes: Names = ()
    parameters: Names = ()


class Placement(Strict):
    """Search for the best stations along the wing.

    Stations are those of the aircraft's mode shapes every ``step_m`` along the span, on both wings, or those that the
    aircraft lists. An accelerometer is like the first of a wing in ``accelerometer_suite``, a strain gauge like the
    first in ``strain_suite``. They are added to the sensors of the comparison's first suite and flown with its first
    input. ``modes`` are the targets: the volume of their error ellipsoid ("D") or the largest of their errors
    ("worst"), in units of ``wn_percent`` and ``zeta``.
    """

    accelerometers: Annotated[int, Field(ge=0, le=12)] = 0
    strain_gauges: Annotated[int, Field(ge=0, le=12)] = 0
    modes: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    criterion: Literal["D", "worst"] = "D"
    stations: Literal["span", "listed"] = "span"
    step_m: Positive = 0.1
    accelerometer_suite: SuiteName = "eolo_ten_accelerometers"
    strain_suite: SuiteName = "eolo_strain"
    wn_percent: Positive = 2.0
    zeta: Positive = 0.02

    @model_validator(mode="after")
    def _something(self) -> Placement:
        if self.accelerometers + self.strain_gauges == 0:
            raise ValueError("a placement needs sensors to place: give accelerometers or strain_gauges")
        return self


class CompareScenario(Experiment):
    """One comparison. All other suites are compared with the first one.

    Manoeuvres of use "identification" are alternatives, and each is compared by itself. Those of use "validation" judge
    them all. ``seeds`` counts the repetitions, each with noise of its own, the same for all suites.
    """

    unnamed: ClassVar[str] = "comparison"
    checked_by: ClassVar[str] = "testbench.questions.compare.check:check"
    noted_by: ClassVar[str] = "testbench.questions.run.check:notes"

    seeds: Annotated[int, Field(ge=3, le=1000)] = 12
    test: Literal["wilcoxon", "t"] = "wilcoxon"
    level: Annotated[float, Field(gt=0.0, le=0.2)] = 0.05
    identification: CompareIdentification
    targets: CompareTargets = CompareTargets()
    placement: Placement | None = None

    @model_validator(mode="after")
    def _uses_and_names(self) -> CompareScenario:
        uses = [m.use for m in self.manoeuvre]
        if "split" in uses:
            raise ValueError("use = 'split' must not occur in a comparison: give identification and validation flights")
        if "identification" not in uses:
            raise ValueError("manoeuvres must include one with use = 'identification'")
        if self.identification.labels and "validation" not in uses:
            raise ValueError("manoeuvres must include one with use = 'validation', which judges the models")
        for what, names in (("manoeuvre", [m.name for m in self.manoeuvre]), ("suite", list(self.suites))):
            if len(set(names)) != len(names):
                raise ValueError(f"{what} names must differ, got {', '.join(names)}")
        if len(self.suites) < 2 and self.placement is None:
            raise ValueError("a comparison needs at least two suites, or a [placement]; got one suite")
        return self

    @property
    def plane(self) -> Literal["longitudinal", "lateral"]:
        """The motion that the inputs move."""
        controls = {name.removesuffix("_cmd") for name in self.identification.inputs}
        return "longitudinal" if controls <= {"de", "thr"} else "lateral"
