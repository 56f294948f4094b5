"""Scenarios of flight in turbulence: what is flown, and which outputs the modes are sought in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, PrivateAttr, model_validator

from testbench.scenario import LOWEST_M, AircraftName, AirSpec, Condition, Input, Simulation, SuiteName
from testbench.schema import NonNegative, Positive, Strict

Names = Annotated[tuple[str, ...], Field(strict=False)]
Band = Annotated[tuple[Positive, Positive], Field(strict=False)]


class TurbulentFlight(Strict):
    """One flight; controls stay at trim where no input is given.

    The record starts ``settle_s`` after the trim: by then the turbulence has risen to its strength. Flights differ in
    their turbulence.
    """

    name: Annotated[str, Field(min_length=1)]
    duration_s: Positive
    settle_s: NonNegative = 4.0
    input: Annotated[tuple[Input, ...], Field(strict=False)] = ()


class ModeSearch(Strict):
    """Which modes are sought, and in what.

    ``channels`` left empty means every wing accelerometer and strain gauge of the suite; ``references`` are those that
    all are correlated with, all if none is given. ``band_hz`` is the lowest and highest frequency; ``order`` the
    largest number of states, 40 if the lags have room for them; a mode must be stable at ``least_orders`` of the orders
    2, 4, ... ``order``.
    """

    channels: Names = ()
    references: Names = ()
    band_hz: Band | None = None
    order: Annotated[int, Field(ge=4, le=200)] | None = None
    least_orders: Annotated[int, Field(ge=2)] = 5


class ModesScenario(Strict):
    """Flights in turbulence, whose modes are found from the outputs alone and set beside those of the aircraft."""

    title: Annotated[str, Field(min_length=1)]
    question: str = ""
    aircraft: AircraftName
    seed: Annotated[int, Field(ge=0)] = 0
    suite: SuiteName
    condition: Condition
    air: AirSpec
    simulation: Simulation = Simulation()
    flight: Annotated[tuple[TurbulentFlight, ...], Field(min_length=1, strict=False)]
    modes: ModeSearch = ModeSearch()
    _file: Path | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _moving_air_and_names(self) -> ModesScenario:
        if self.air.turbulence_rms_m_s == 0.0 and not any(f.input for f in self.flight):
            raise ValueError("air.turbulence_rms_m_s > 0 must hold where no flight has an input: nothing else moves")
        if self.air.turbulence_rms_m_s > 0.0 and self.air.height_m is None and self.condition.h_m < LOWEST_M:
            raise ValueError(
                f"condition.h_m >= {LOWEST_M:g} (10 ft) must hold in turbulence, got {self.condition.h_m:g}; give the "
                "height above ground as air.height_m"
            )
        names = [f.name for f in self.flight]
        if len(set(names)) != len(names):
            raise ValueError(f"flight names must differ, got {', '.join(names)}")
        return self

    @property
    def file(self) -> Path | None:
        """The file that the scenario was read from."""
        return self._file

    @property
    def name(self) -> str:
        """The file's stem, or "modes"; names the results folder."""
        return self._file.stem if self._file else "modes"
