"""What scenarios of several questions share: title and file; aircraft, condition and air; manoeuvres, preparation."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, model_validator

from testbench.core.door import read_toml
from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT, SENSOR_SUITES, Family, find_scenario, resolve
from testbench.core.project import completed
from testbench.core.scenario.air import LOWEST_M, AirSpec
from testbench.core.scenario.inputs import Control, Input
from testbench.core.schema import NonNegative, Positive, Range, Strict, parse


def _resolved(family: Family) -> AfterValidator:
    """Return the validator of a name: what it means is told from the folder of the file that it stands in."""

    def validate(name: str, info: ValidationInfo) -> str:
        try:
            file = (info.context or {}).get("file")
            return resolve(name, family, Path(file).parent if file else None)
        except ScenarioError as error:
            raise ValueError(error.message) from None

    return AfterValidator(validate)


AircraftName = Annotated[str, _resolved(AIRCRAFT)]
SuiteName = Annotated[str, _resolved(SENSOR_SUITES)]


class Asked(Strict):
    """A question as its file puts it: a title, the question in words, and the file itself.

    Every kind of scenario derives from it and adds only the keys of its own.
    """

    unnamed: ClassVar[str] = "scenario"
    """Name of a scenario that comes from no file."""
    checked_by: ClassVar[str] = ""
    """Function, "module:name", that takes it and returns every law that it breaks beyond its schema."""

    noted_by: ClassVar[str] = ""
    """Function, "module:name", that takes it and returns what is to be known of it, though it breaks no law."""

    title: Annotated[str, Field(min_length=1)]
    question: str = ""
    _file: Path | None = PrivateAttr(default=None)

    @property
    def file(self) -> Path | None:
        """The file that it was read from."""
        return self._file

    @property
    def name(self) -> str:
        """The file's stem; names the results folder."""
        return self._file.stem if self._file else self.unnamed

    def at(self, file: Path | None) -> Self:
        """Return the same scenario as if read from ``file``, the name of which messages and the results folder use."""
        copy = self.model_copy()
        copy._file = file
        return copy

    def changed(self, **changes: Any) -> Self:
        """Return the same scenario, from the same file, with other values of some keys, which are not checked."""
        return self.model_copy(update=changes)

    def faults(self) -> list[str]:
        """Return every law that the file breaks beyond its schema, in words with file and key; nothing is flown."""
        return self._asked_of(self.checked_by)

    def notes(self) -> list[str]:
        """Return what ``testbench check`` says of a file that breaks no law, in words; nothing is flown."""
        return self._asked_of(self.noted_by)

    def _asked_of(self, function: str) -> list[str]:
        if not function:
            return []
        module, name = function.split(":")  # by name: what checks a scenario knows the scenario's class
        found: list[str] = getattr(import_module(module), name)(self)
        return found

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a file, or a packaged one by its name, and check it without flying.

        Raises:
            ScenarioError: lists every fault with file, key, law, value and the nearest valid name.
            RecordError: the file cannot be read.
        """
        file = find_scenario(path)
        return cls.of(read_toml(file), file)

    @classmethod
    def of(cls, content: Mapping[str, Any], file: Path | None) -> Self:
        """Check the content of a file and return it as a scenario; see :meth:`load`."""
        asked, faults = parse(cls, completed(content, cls.model_fields, file), file)
        if asked is not None:
            asked = asked.at(file)
            faults = [*faults, *asked.faults()]
        if asked is None or faults:
            raise ScenarioError(faults)
        return asked


class Condition(Strict):
    """The flight condition to trim at."""

    V_m_s: Positive
    h_m: float
    gamma_deg: float = 0.0


class Simulation(Strict):
    """Rates of the simulation; the aircraft's own default rate if not given."""

    rate_hz: Positive | None = None
    log_rate_hz: Positive | None = None


class Flown(Asked):
    """What flies: an aircraft, with its wings moving or held, and the seed of every random draw."""

    aircraft: AircraftName
    wings: Literal["flexible", "rigid"] = "flexible"
    seed: Annotated[int, Field(ge=0)] = 0

    def with_aircraft(self, aircraft: str) -> Self:
        """Return the scenario with another aircraft, checked against that.

        Args:
            aircraft: a name or path, which is looked for from the working directory.

        Raises:
            ScenarioError: there is no such aircraft, or it cannot fly the scenario; lists every fault.
        """
        changed = self.changed(aircraft=resolve(aircraft, AIRCRAFT))
        faults = changed.faults()
        if faults:
            raise ScenarioError([f"{fault}, flown by {aircraft}" for fault in faults])
        return changed


class FlownAt(Flown):
    """What flies from one trimmed condition, at the rates of the simulation."""

    condition: Condition
    simulation: Simulation = Simulation()


class FlownInAir(FlownAt):
    """What flies from one condition through air that may move."""

    air: AirSpec = AirSpec()

    @model_validator(mode="after")
    def _height_of_turbulence(self) -> Self:
        if self.air.turbulence_rms_m_s > 0.0 and self.air.height_m is None and self.condition.h_m < LOWEST_M:
            raise ValueError(
                f"condition.h_m >= {LOWEST_M:g} (10 ft) must hold in turbulence, got {self.condition.h_m:g}; give the "
                "height above ground as air.height_m"
            )
        return self


class Manoeuvre(Strict):
    """Inputs flown from trim, and the use of the record.

    The clock of the inputs starts after ``settle_s`` of undisturbed flight, which bias removal needs.
    """

    name: Annotated[str, Field(min_length=1)]
    use: Literal["identification", "validation", "split"]
    duration_s: Positive
    settle_s: NonNegative = 2.0
    input: Annotated[tuple[Input, ...], Field(min_length=1, strict=False)]


class Preparation(Strict):
    """Preparation of a measured record before estimation.

    ``bias`` "trim" subtracts the mean over the settling time, "mean" the mean of the record, "trend" a straight line.
    ``lowpass_hz`` is a zero-phase 4th-order Butterworth filter over inputs and outputs alike.
    """

    bias: Literal["trim", "mean", "trend", "none"] = "trim"
    lowpass_hz: Positive | None = None
    decimate: Annotated[int, Field(ge=1)] = 1
    identification_fraction: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.7


class ManoeuvreLimits(Strict):
    """The limits of a manoeuvre as designs and plans give them; changes count from trim."""

    deflection_deg: dict[Control, Positive] = {}
    rate_deg_s: dict[Control, Positive] = {}
    load_factor: Range | None = None
    alpha_deg: Range | None = None
    beta_deg: Positive | None = None
    speed_change_m_s: Positive | None = None
    height_change_m: Positive | None = None
    pitch_change_deg: Positive | None = None
    bank_deg: Positive | None = None
