"""Design scenarios: the targets, the sensors and the limits. The design finds the input."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.scenario.air import CALM_RMS_M_S, LOWEST_M, AirSpec
from testbench.core.scenario.base import FlownInAir, ManoeuvreLimits, SuiteName
from testbench.core.scenario.inputs import Control, Input
from testbench.core.schema import Names, NonNegative, Positive, Strict

_LONGITUDINAL, _LATERAL = {"de", "thr"}, {"da", "dr"}

FEWEST = 5
"""Flights from which errors are counted."""


class DesignTargets(Strict):
    """The targets, with their wanted standard errors.

    ``parameters`` gives derivatives of the linearised aircraft (M_alpha, Z_de, ...) with the wanted error in percent of
    the true value; ``modes`` names modes; their natural frequency is wanted to ``wn_percent`` and their damping ratio
    to ``zeta``. All else that is unknown is estimated too: the derivatives of the rigid motion and those named in
    ``also_unknown``.
    """

    parameters: dict[str, Positive] = {}
    modes: Names = ()
    wn_percent: Positive = 2.0
    zeta: Positive = 0.02
    also_unknown: Names = ()

    @model_validator(mode="after")
    def _something(self) -> DesignTargets:
        if not self.parameters and not self.modes:
            raise ValueError("a design needs a target: give targets.parameters or targets.modes")
        return self


class DesignLimits(ManoeuvreLimits):
    """The limits of the manoeuvre; omitted ones are those of the aircraft. Changes are relative to trim."""

    onset_margin_m_s: NonNegative = 1.0


class DesignScenario(FlownInAir):
    """One design: aircraft, condition, sensor suites, controls that may move, targets, limits.

    The input is designed for the first suite; the others show what it would tell them. ``duration_s`` is the longest
    manoeuvre, the undisturbed flight of ``start_s`` before the input included.

    ``draws`` is how many aircraft are drawn from the uncertainty that the aircraft states of its coefficients, else
    from what handbooks reach; the design is judged over them. If it is left out, 20 are drawn of an aircraft that
    states one and for ``robust``, else none.
    ``robust`` chooses input and amplitude for the worst of them.

    ``realise`` is how often the best design is flown and identified, so that its errors are promised and realised; 0:
    not at all. The air is that of ``[air]``; if that is left out, light turbulence. In turbulence
    amplitudes are lowered until the next flight meets a limit with ``breach_percent``.

    ``input`` is an input of your own, its clock beginning after ``start_s``: it is judged in place of a search. Its
    amplitude is lowered where that of a search would be, never raised; ``shortest_step_s`` does not bind it.
    """

    unnamed: ClassVar[str] = "design"
    checked_by: ClassVar[str] = "testbench.questions.design.check:check"

    suites: Annotated[tuple[SuiteName, ...], Field(min_length=1, strict=False)]
    controls: Annotated[tuple[Control, ...], Field(min_length=1, strict=False)]
    duration_s: Annotated[float, Field(gt=0.0, le=600.0)]
    start_s: Positive = 2.0
    by: Literal["pilot", "autopilot"] = "autopilot"
    shortest_step_s: Positive | None = None
    criterion: Literal["worst", "D", "A", "E"] = "worst"
    allow_above_onset: bool = False
    draws: Annotated[int, Field(ge=0)] | None = None
    robust: bool = False
    realise: Annotated[int, Field(ge=0)] = 20
    breach_percent: Annotated[float, Field(gt=0.0, lt=50.0)] = 5.0
    targets: DesignTargets
    limits: DesignLimits = DesignLimits()
    input: Annotated[tuple[Input, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _robust_over_some(self) -> DesignScenario:
        if self.robust and self.draws == 0:
            raise ValueError("robust = true chooses the input over drawn aircraft: draws >= 1 must hold, got 0")
        return self

    @model_validator(mode="after")
    def _input_on_the_controls(self) -> DesignScenario:
        for i, entry in enumerate(self.input):
            if entry.control not in self.controls:
                raise ValueError(
                    f"input[{i}].control must be one of the controls of the design, {', '.join(self.controls)}, got "
                    f"'{entry.control}'"
                )
        return self

    @model_validator(mode="after")
    def _enough_flights(self) -> DesignScenario:
        if 0 < self.realise < FEWEST:
            raise ValueError(
                f"realise >= {FEWEST} flights must hold, or 0 for none, got {self.realise}: fewer say nothing of errors"
            )
        return self

    @model_validator(mode="after")
    def _one_plane_and_room(self) -> DesignScenario:
        controls = set(self.controls)
        if len(controls) < len(self.controls):
            raise ValueError(f"controls must differ, got {', '.join(self.controls)}")
        if controls & _LONGITUDINAL and controls & _LATERAL:
            raise ValueError(
                f"the controls of a design must move one plane, de and thr or da and dr, got "
                f"{', '.join(self.controls)}; make two designs"
            )
        if self.duration_s <= self.start_s + self.shortest_s:
            raise ValueError(
                f"start_s + shortest_step_s < duration_s must hold, got {self.start_s:g} + {self.shortest_s:g} and "
                f"{self.duration_s:g} s; lengthen the manoeuvre"
            )
        return self

    @property
    def plane(self) -> Literal["longitudinal", "lateral"]:
        """The motion that the controls move."""
        return "longitudinal" if set(self.controls) <= _LONGITUDINAL else "lateral"

    @property
    def expected_air(self) -> AirSpec:
        """The air that is expected: as given, else that of a calm morning."""
        if "air" in self.model_fields_set:
            return self.air
        height = None if self.condition.h_m >= LOWEST_M else LOWEST_M
        return AirSpec(turbulence_rms_m_s=CALM_RMS_M_S, height_m=height)

    @property
    def shortest_s(self) -> float:
        """Shortest step that can be held, s: as given, else 1 s for a pilot and 0.1 s for an autopilot (estimates)."""
        return self.shortest_step_s or (1.0 if self.by == "pilot" else 0.1)
