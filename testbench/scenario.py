"""Scenario files: TOML in, frozen Scenario out, every fault of a file reported at once.

A scenario says what is flown, what is sensed and what is identified; it holds no code. Keys carry their unit.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from testbench.constants import DEG_RAD, FT_M, PERCENT
from testbench.errors import RecordError, ScenarioError, nearest
from testbench.paths import aircraft_names, suite_names

Control = Literal["de", "da", "dr", "thr"]
Positive = Annotated[float, Field(gt=0.0)]
LOWEST_M = 10.0 * FT_M  # MIL-F-8785C gives the scale lengths of turbulence from 10 ft above ground
NonNegative = Annotated[float, Field(ge=0.0)]
Model = TypeVar("Model", bound="Strict")


class Strict(BaseModel):
    """Base of all file schemas: frozen, unknown keys refused, no silent conversion, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


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


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        RecordError: the file does not exist or cannot be read.
        ScenarioError: it is not TOML; the message carries line and column.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise RecordError(f"a readable TOML file must lie at '{path}', got: {reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError([f"{path} must be TOML: {error}"]) from error


def parse(schema: type[Model], content: Mapping[str, Any], file: Path | str | None) -> tuple[Model | None, list[str]]:
    """Validate ``content`` against ``schema`` and return the object, if it could be built, and all faults in words.

    Unknown keys do not keep the object from being built, so that a caller can go on and report deeper faults too.
    """
    try:
        return schema.model_validate(content), []
    except ValidationError as error:
        faults = [_fault(schema, content, item, file) for item in error.errors() if not _follows_from_another(item)]
        unknown = [item["loc"] for item in error.errors() if item["type"] == "extra_forbidden"]
    if not unknown:
        return None, faults
    try:
        return schema.model_validate(_without(content, unknown)), faults
    except ValidationError:
        return None, faults


def _follows_from_another(item: Any) -> bool:
    """Say whether a list is only too short because its faulty items, reported themselves, were dropped."""
    return item["type"] == "too_short" and len(item["input"]) > 0


def _without(content: Mapping[str, Any], paths: list[tuple[int | str, ...]]) -> Any:
    import copy

    out = copy.deepcopy(dict(content))
    for path in paths:
        place: Any = out
        for key in path[:-1]:
            if not (isinstance(place, dict) and key not in place):  # else the tag of a union: in loc, not in the file
                place = place[key]
        place.pop(path[-1], None)
    return out


def _fault(schema: type[Strict], content: Mapping[str, Any], item: Any, file: Path | str | None) -> str:
    """Say law, value, fix and place of one pydantic error."""
    place: Any = content
    shown: list[str] = []
    model: Any = schema
    for key in item["loc"]:
        if isinstance(key, int):
            shown[-1] += f"[{key}]"
            place = place[key] if isinstance(place, (list, tuple)) and key < len(place) else None
        elif isinstance(place, Mapping) and key not in place and _variants(model) and key in _variants(model):
            model = _variants(model)[key]  # a union's tag: not a key of the file
            continue
        else:
            shown.append(str(key))
            place = place.get(key) if isinstance(place, Mapping) else None
        model = _descend(model, key) or model
    where = ".".join(shown)
    prefix = f"{file}, {where}: " if file and where else f"{file or where}: " if (file or where) else ""
    kind, got, context = item["type"], item.get("input"), item.get("ctx", {})
    if kind == "extra_forbidden":
        owner = _owner(schema, content, item["loc"])
        return f"{prefix}unknown key '{shown[-1]}'{nearest(shown[-1], owner.model_fields if owner else ())}"
    if kind == "missing":
        return f"{prefix}the key is required and missing"
    if kind in {"literal_error", "union_tag_invalid"}:
        if kind == "union_tag_invalid":
            tag, valid = context["discriminator"].strip("'"), context["expected_tags"].replace("'", "").split(", ")
            return f"{prefix}unknown {tag} '{context['tag']}'{nearest(context['tag'], valid)}"
        valid = context["expected"].replace("'", "").replace(" or ", ", ").split(", ")
        hint = nearest(str(got), valid) if str(got) not in valid else ""
        return f"{prefix}must be one of {', '.join(valid)}, got {got!r}{hint}"
    if kind == "union_tag_not_found":
        return f"{prefix}the key {context['discriminator']} is required and missing"
    message = item["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:].replace("Input should be", "must be")
    message = message.replace("input should be", "must be").replace("input should have", "must have")
    return f"{prefix}{message}" + ("" if kind == "value_error" else f", got {got!r}")


def _variants(model: Any) -> dict[str, Any]:
    """Return tag -> class of a discriminated union (possibly inside Annotated or tuple), else nothing."""
    found: dict[str, Any] = {}
    for part in _members(model):
        if isinstance(part, type) and issubclass(part, Strict):
            for name in ("signal", "method", "kind"):
                if name in part.model_fields:
                    for tag in get_args(part.model_fields[name].annotation):
                        found[str(tag)] = part
    return found


def _members(model: Any) -> Iterable[Any]:
    origin = get_origin(model)
    if origin in (Annotated, tuple):
        yield from _members(get_args(model)[0])
    elif origin in (Union, UnionType):
        for part in get_args(model):
            yield from _members(part)
    else:
        yield model


def _descend(model: Any, key: int | str) -> Any:
    for part in _members(model):
        if isinstance(part, type) and issubclass(part, BaseModel) and key in part.model_fields:
            return part.model_fields[str(key)].annotation
    return None


def _owner(schema: type[Strict], content: Mapping[str, Any], loc: tuple[int | str, ...]) -> type[Strict] | None:
    """Return the model class that the last key of ``loc`` would have belonged to."""
    model: Any = schema
    for key in loc[:-1]:
        if isinstance(key, int):
            continue
        variants = _variants(model)
        model = variants[key] if key in variants and _descend(model, key) is None else (_descend(model, key) or model)
    owners = [part for part in _members(model) if isinstance(part, type) and issubclass(part, Strict)]
    return owners[0] if len(owners) == 1 else None


def attach_file(scenario: Scenario, file: Path | None) -> Scenario:
    """Return ``scenario`` with the file that it came from, used in messages and for the results folder."""
    copy = scenario.model_copy()
    object.__setattr__(copy, "_file", file)
    copy.__pydantic_private__ = {"_file": file}
    return copy
