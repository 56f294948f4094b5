"""The inputs of a manoeuvre: one class per signal, keys with their units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.constants import DEG_RAD, PERCENT
from testbench.schema import NonNegative, Positive, Strict

Control = Literal["de", "da", "dr", "thr"]


class _Input(Strict):
    control: Control
    start_s: NonNegative = 0.0
    amplitude_deg: float | None = None
    amplitude_percent: float | None = None

    @model_validator(mode="after")
    def _amplitude_in_the_control_s_unit(self) -> _Input:
        wanted, other = ("percent", "deg") if self.control == "thr" else ("deg", "percent")
        if getattr(self, f"amplitude_{wanted}") is None or getattr(self, f"amplitude_{other}") is not None:
            raise ValueError(f"control '{self.control}' takes amplitude_{wanted} and not amplitude_{other}")
        return self

    @property
    def amplitude(self) -> float:
        """Amplitude in SI: rad for a surface, 1 for the throttle."""
        if self.amplitude_percent is not None:
            return self.amplitude_percent * PERCENT
        return (self.amplitude_deg or 0.0) * DEG_RAD


class Step(_Input):
    """A step that lasts until the end of the manoeuvre."""

    signal: Literal["step"]


class Pulse(_Input):
    """One rectangular pulse."""

    signal: Literal["pulse"]
    width_s: Positive


class Doublet(_Input):
    """One or several doublets: up for half a period, down for the other half, ``repeats`` times every ``spacing_s``."""

    signal: Literal["doublet"]
    period_s: Positive
    repeats: Annotated[int, Field(ge=1)] = 1
    spacing_s: Positive | None = None


class Multistep3211(_Input):
    """The 3-2-1-1: steps of alternating sign lasting 3, 2, 1 and 1 times ``step_s``."""

    signal: Literal["3211"]
    step_s: Positive


class Multistep(_Input):
    """Any multistep: ``pattern`` gives signed durations in units of ``step_s``; 0 is not allowed."""

    signal: Literal["multistep"]
    step_s: Positive
    pattern: Annotated[tuple[float, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _no_step_of_no_length(self) -> Multistep:
        if any(p == 0.0 for p in self.pattern):
            raise ValueError(
                "every entry of pattern must differ from 0 (its size is the duration, its sign the direction)"
            )
        return self


class Sweep(_Input):
    """A sine whose frequency rises from ``f_start_hz`` to ``f_end_hz``, linearly or exponentially in time."""

    signal: Literal["sweep"]
    f_start_hz: Positive
    f_end_hz: Positive
    sweep_s: Positive
    spacing: Literal["linear", "exponential"] = "exponential"


Input = Annotated[Step | Pulse | Doublet | Multistep3211 | Multistep | Sweep, Field(discriminator="signal")]
