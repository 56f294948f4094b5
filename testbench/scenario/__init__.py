"""Scenario files: TOML in, frozen Scenario out, every fault of a file reported at once.

A scenario says what is flown, what is sensed and what is identified; it holds no code. Keys carry their unit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from testbench.errors import nearest
from testbench.paths import aircraft_names, suite_names
from testbench.scenario.air import LOWEST_M, AirSpec, GustSpec
from testbench.scenario.estimators import DsrE, Estimator, TransferFunctions, estimator_name
from testbench.scenario.inputs import (
    BinaryNoise,
    Control,
    Doublet,
    Input,
    Multisine,
    Multistep,
    Pilot,
    Prbs,
    Pulse,
    StandardMultistep,
    Step,
    Sweep,
)
from testbench.schema import NonNegative, Positive, Strict

__all__ = [
    "LOWEST_M",
    "AirSpec",
    "AircraftName",
    "BinaryNoise",
    "Condition",
    "Control",
    "Doublet",
    "DsrE",
    "Estimator",
    "GustSpec",
    "Identification",
    "Input",
    "Manoeuvre",
    "Multisine",
    "Multistep",
    "Pilot",
    "Prbs",
    "Preparation",
    "Pulse",
    "Scenario",
    "Simulation",
    "StandardMultistep",
    "Step",
    "SuiteName",
    "Sweep",
    "TransferFunctions",
    "attach_file",
    "estimator_name",
]


def _known_aircraft(name: str) -> str:
    if name not in aircraft_names():
        raise ValueError(f"must name an aircraft folder, got '{name}'{nearest(name, aircraft_names())}")
    return name


def _known_suite(name: str) -> str:
    if name not in suite_names() and not Path(name).suffix == ".toml":
        raise ValueError(f"must name a sensor suite or a .toml file, got '{name}'{nearest(name, suite_names())}")
    return name


AircraftName = Annotated[str, AfterValidator(_known_aircraft)]
SuiteName = Annotated[str, AfterValidator(_known_suite)]


class Condition(Strict):
    """The flight condition to trim at."""

    V_m_s: Positive
    h_m: float
    gamma_deg: float = 0.0


class Simulation(Strict):
    """Rates of the simulation; the aircraft's own default rate if not given."""

    rate_hz: Positive | None = None
    log_rate_hz: Positive | None = None


class Manoeuvre(Strict):
    """Inputs flown from trim, and what the record is used for.

    ``settle_s`` of undisturbed flight come before the clock of the inputs starts: bias removal needs them.
    """

    name: Annotated[str, Field(min_length=1)]
    use: Literal["identification", "validation", "split"]
    duration_s: Positive
    settle_s: NonNegative = 2.0
    input: Annotated[tuple[Input, ...], Field(min_length=1, strict=False)]


class Preparation(Strict):
    """What is done to a measured record before estimation.

    ``bias`` "trim" subtracts the mean over the settling time, "mean" the mean of the record, "trend" a straight line.
    ``lowpass_hz`` is a zero-phase 4th-order Butterworth filter over inputs and outputs alike.
    """

    bias: Literal["trim", "mean", "trend", "none"] = "trim"
    lowpass_hz: Positive | None = None
    decimate: Annotated[int, Field(ge=1)] = 1
    identification_fraction: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.7


class Identification(Strict):
    """Which measured channels are inputs and outputs, and which estimators run on them.

    ``outputs`` left empty means every channel of the suite that is not a control.
    """

    inputs: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    outputs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    estimators: Annotated[tuple[Estimator, ...], Field(min_length=1, strict=False)]


class Scenario(Strict):
    """One experiment: aircraft, condition, manoeuvres, sensor suites, estimators."""

    title: Annotated[str, Field(min_length=1)]
    question: str = ""
    aircraft: AircraftName
    wings: Literal["flexible", "rigid"] = "flexible"
    seed: Annotated[int, Field(ge=0)] = 0
    condition: Condition
    air: AirSpec = AirSpec()
    simulation: Simulation = Simulation()
    manoeuvre: Annotated[tuple[Manoeuvre, ...], Field(min_length=1, strict=False)]
    suites: Annotated[tuple[SuiteName, ...], Field(min_length=1, strict=False)]
    preparation: Preparation = Preparation()
    identification: Identification
    _file: Path | None = PrivateAttr(default=None)

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
        if self.air.turbulence_rms_m_s > 0.0 and self.air.height_m is None and self.condition.h_m < LOWEST_M:
            raise ValueError(
                f"condition.h_m >= {LOWEST_M:g} (10 ft) must hold in turbulence, got {self.condition.h_m:g}; give the "
                "height above ground as air.height_m"
            )
        return self

    @property
    def file(self) -> Path | None:
        """The file that the scenario was read from."""
        return self._file

    @property
    def name(self) -> str:
        """The file's stem, or "scenario"; names the results folder."""
        return self._file.stem if self._file else "scenario"


def attach_file(scenario: Scenario, file: Path | None) -> Scenario:
    """Return ``scenario`` with the file that it came from, used in messages and for the results folder."""
    copy = scenario.model_copy()
    object.__setattr__(copy, "_file", file)
    copy.__pydantic_private__ = {"_file": file}
    return copy
