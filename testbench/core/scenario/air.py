"""The air of a scenario: wind, one gust, turbulence."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.core.constants import FT_M
from testbench.core.schema import NonNegative, Positive, Strict

LOWEST_M = 10.0 * FT_M  # MIL-F-8785C gives the scale lengths of turbulence from 10 ft above ground

CALM_RMS_M_S = 0.3
"""Vertical rms of the turbulence of a calm morning: a tenth of a wind of 3 m/s at 20 ft (MIL-F-8785C)."""


class GustSpec(Strict):
    """One 1-cosine gust from ``start_s`` on the clock of the inputs; positive air moves north, east or down."""

    axis: Literal["north", "east", "down"]
    amplitude_m_s: float
    start_s: NonNegative = 0.0
    duration_s: Positive | None = None
    length_m: Positive | None = None

    @model_validator(mode="after")
    def _one_size(self) -> GustSpec:
        if (self.duration_s is None) == (self.length_m is None):
            raise ValueError("a gust takes either duration_s or length_m (the distance flown through it), and not both")
        return self


class AirSpec(Strict):
    """The air of a flight, still by default; the heading at trim is north.

    ``turbulence_rms_m_s`` is the rms of the vertical component. The rms of the others and the scale lengths follow from
    ``height_m`` above ground, which is the altitude of the condition if it is not given.
    """

    wind_north_m_s: float = 0.0
    wind_east_m_s: float = 0.0
    wind_down_m_s: float = 0.0
    turbulence_rms_m_s: NonNegative = 0.0
    height_m: Annotated[float, Field(ge=LOWEST_M)] | None = None
    gust: GustSpec | None = None
