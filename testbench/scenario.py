"""Scenario files: TOML in, frozen Scenario out, every fault of a file reported at once.

A scenario says what is flown, what is sensed and what is identified; it holds no code. Keys carry their unit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from testbench.constants import DEG_RAD, FT_M, PERCENT
from testbench.errors import nearest
from testbench.paths import aircraft_names, suite_names
from testbench.schema import NonNegative, Positive, Strict

Control = Literal["de", "da", "dr", "thr"]
LOWEST_M = 10.0 * FT_M  # MIL-F-8785C gives the scale lengths of turbulence from 10 ft above ground


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
    """The air that is flown through, still if nothing is given; the heading at trim is north.

    ``turbulence_rms_m_s`` is that of the vertical component; the others follow from ``height_m`` above ground, as do
    the scale lengths. The altitude of the condition is taken for it if it is not given.
    """

    wind_north_m_s: float = 0.0
    wind_east_m_s: float = 0.0
    wind_down_m_s: float = 0.0
    turbulence_rms_m_s: NonNegative = 0.0
    height_m: Annotated[float, Field(ge=LOWEST_M)] | None = None
    gust: GustSpec | None = None


class Simulation(Strict):
    """Rates of the simulation; the aircraft's own default rate if not given."""

    rate_hz: Positive | None = None
    log_rate_hz: Positive | None = None


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


class DsrE(Strict):
    """Subspace identification DSR_e of the EOLO paper; order chosen from the singular values if not given."""

    method: Literal["dsr_e"]
    label: str | None = None
    order: Annotated[int, Field(ge=1)] | None = None
    past_horizon: Annotated[int, Field(ge=1)]
    future_horizon: Annotated[int, Field(ge=2)]
    direct_feedthrough: bool = False


class TransferFunctions(Strict):
    """One least-squares transfer function per output; the number of zeros is chosen on the validation part."""

    method: Literal["transfer_function"]
    label: str | None = None
    poles: Annotated[int, Field(ge=1)]
    zeros: Annotated[tuple[int, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _proper(self) -> TransferFunctions:
        if not all(0 <= z < self.poles for z in self.zeros):
            raise ValueError(
                f"0 <= zeros < poles = {self.poles} must hold for every entry of zeros, got {list(self.zeros)}"
            )
        return self


def estimator_name(spec: DsrE | TransferFunctions) -> str:
    """Return the label of an estimator in tables, or its method if it has none."""
    return spec.label or spec.method


Estimator = Annotated[DsrE | TransferFunctions, Field(discriminator="method")]


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
