"""Scenarios of flight in turbulence: what is flown, and in which outputs the modes are sought."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.scenario.air import AirSpec
from testbench.core.scenario.base import FlownInAir, SuiteName
from testbench.core.scenario.inputs import Input
from testbench.core.schema import Band, Names, NonNegative, Positive, Strict


class TurbulentFlight(Strict):
    """One flight; controls without an input stay at trim.

    The record starts ``settle_s`` after the trim: by then the turbulence has risen to its strength. Flights differ in
    their turbulence, and in speed where they give one.
    """

    name: Annotated[str, Field(min_length=1)]
    duration_s: Positive
    V_m_s: Positive | None = None
    settle_s: NonNegative = 4.0
    input: Annotated[tuple[Input, ...], Field(strict=False)] = ()


class ModeSearch(Strict):
    """The wanted modes, and their channels.

    If ``channels`` is empty, every wing accelerometer and strain gauge of the suite is used. All channels are
    correlated with the ``references``, which are all channels if none is given. ``band_hz`` is the lowest and highest
    frequency. ``order`` is the largest number of states: 40 by default, if the lags have room for them. A mode must be
    stable at ``least_orders`` of the orders 2, 4, ... ``order``.
    """

    channels: Names = ()
    references: Names = ()
    band_hz: Band | None = None
    order: Annotated[int, Field(ge=4, le=200)] | None = None
    least_orders: Annotated[int, Field(ge=2)] = 5


class ModesScenario(FlownInAir):
    """Flights in turbulence, whose modes are found from the outputs alone and compared with those of the aircraft."""

    unnamed: ClassVar[str] = "modes"
    checked_by: ClassVar[str] = "testbench.questions.modes.check:check"

    wings: Literal["flexible"] = "flexible"
    air: AirSpec
    suite: SuiteName
    flight: Annotated[tuple[TurbulentFlight, ...], Field(min_length=1, strict=False)]
    modes: ModeSearch = ModeSearch()

    @property
    def speeds_m_s(self) -> list[float]:
        """The speeds that are flown, rising."""
        return sorted({f.V_m_s or self.condition.V_m_s for f in self.flight})

    def flown_at(self, V_m_s: float) -> ModesScenario:
        """Return the scenario with another speed of its condition."""
        return self.model_copy(update={"condition": self.condition.model_copy(update={"V_m_s": V_m_s})})

    @model_validator(mode="after")
    def _moving_air_and_names(self) -> ModesScenario:
        if self.air.turbulence_rms_m_s == 0.0 and not any(f.input for f in self.flight):
            raise ValueError("air.turbulence_rms_m_s > 0 must hold where no flight has an input: nothing else moves")
        names = [f.name for f in self.flight]
        if len(set(names)) != len(names):
            raise ValueError(f"flight names must differ, got {', '.join(names)}")
        return self
