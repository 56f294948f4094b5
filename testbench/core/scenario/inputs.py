"""The inputs of a manoeuvre: one class per signal, keys with their units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.schema import NonNegative, Positive, Strict

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


class Pilot(Strict):
    """How a pilot flies a step: rise time, scatter of its time, and least length.

    ``jitter_s`` is the standard deviation of every edge but the first; the scatter is the same for the same ``seed``.
    """

    rise_s: NonNegative = 0.0
    jitter_s: NonNegative = 0.0
    shortest_s: NonNegative = 0.0
    seed: Annotated[int, Field(ge=0)] = 0


class _Stepped(_Input):
    pilot: Pilot | None = None


class Step(_Stepped):
    """A step that lasts until the end of the manoeuvre."""

    signal: Literal["step"]


class Pulse(_Stepped):
    """One rectangular pulse."""

    signal: Literal["pulse"]
    width_s: Positive


class Doublet(_Stepped):
    """One or several doublets: up for half a period, down for the other half, ``repeats`` times every ``spacing_s``."""

    signal: Literal["doublet"]
    period_s: Positive
    repeats: Annotated[int, Field(ge=1)] = 1
    spacing_s: Positive | None = None


class StandardMultistep(_Stepped):
    """Steps of alternating sign; the name (3-2-1-1, 2-1-1 or 1-2-3) gives their lengths in units of ``step_s``."""

    signal: Literal["3211", "211", "123"]
    step_s: Positive


class Multistep(_Stepped):
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
    fade_s: NonNegative = 0.0


class Multisine(_Input):
    """A sum of sines at harmonics of ``1 / period_s``, phases chosen for the least peak; ``amplitude`` is the peak.

    It holds every ``stride``-th harmonic from ``f_min_hz`` to ``f_max_hz``, beginning with number ``first``. Multisines
    with the same period and stride and different ``first`` are orthogonal, so that several controls can move at once.
    """

    signal: Literal["multisine"]
    f_min_hz: Positive
    f_max_hz: Positive
    period_s: Positive
    periods: Annotated[int, Field(ge=1)] = 1
    stride: Annotated[int, Field(ge=1)] = 1
    first: Annotated[int, Field(ge=0)] = 0
    powers: Annotated[tuple[NonNegative, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _first_below_stride(self) -> Multisine:
        if self.first >= self.stride:
            raise ValueError(f"first < stride = {self.stride} must hold for a multisine, got {self.first}")
        return self


class Prbs(_Input):
    """A pseudo-random binary sequence of plus or minus the amplitude, clocked every ``step_s``.

    It repeats after 2^bits - 1 steps, the longest sequence of a shift register with that many bits.
    """

    signal: Literal["prbs"]
    step_s: Positive
    prbs_s: Positive
    bits: Annotated[int, Field(ge=2, le=16)] = 10
    seed: Annotated[int, Field(ge=0)] = 1


class BinaryNoise(_Input):
    """Generalised binary noise: each ``step_s`` the sign changes with probability ``switching``."""

    signal: Literal["gbn"]
    step_s: Positive
    gbn_s: Positive
    switching: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    seed: Annotated[int, Field(ge=0)] = 0


Input = Annotated[
    Step | Pulse | Doublet | StandardMultistep | Multistep | Sweep | Multisine | Prbs | BinaryNoise,
    Field(discriminator="signal"),
]
