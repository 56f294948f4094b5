"""File schemas: what TOML holds validated, every fault of a file reported at once in words."""

from __future__ import annotations

import copy
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    ValidationError,
)
from pydantic_core import CoreSchema

from testbench.core.errors import nearest

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Text = Annotated[str, Field(min_length=1)]
Names = Annotated[tuple[str, ...], Field(strict=False)]  # TOML has lists
Pair = Annotated[tuple[float, float], Field(strict=False)]


def _rising(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise ValueError(f"low < high must hold, got {pair[0]:g} and {pair[1]:g}")
    return pair


Range = Annotated[Pair, AfterValidator(_rising)]
Band = Annotated[tuple[Positive, Positive], Field(strict=False), AfterValidator(_rising)]
Model = TypeVar("Model", bound="Strict")


class Strict(BaseModel):
    """Base of all file schemas: frozen, unknown keys refused, no silent conversion, finite numbers only.

    Each number has the unit and the range that :mod:`testbench.core.schema` gives its key.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        made = handler(source)
        fields: Any = handler.resolve_ref_schema(made)
        while "fields" not in fields:
            fields = fields["schema"]
        for name, field in fields["fields"].items():
            if (of := quantity(name)) is not None:
                bound(field["schema"], of)
        return made

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        made = handler(core)
        for name, value in handler.resolve_ref_schema(made).get("properties", {}).items():
            if (of := quantity(name)) is not None and "imum" in str(value):
                value["unit"] = of.unit
        return made


def parse(schema: type[Model], content: Mapping[str, Any], file: Path | str | None) -> tuple[Model | None, list[str]]:
    """Validate ``content`` against ``schema`` and return the object, if it could be built, and all faults in words.

    Unknown keys do not keep the object from being built, so that a caller can go on and report deeper faults too.
    """
    laws = ((where, text, _broken_law(where, text)) for where, text in _texts(content))
    broken = [_text_fault(where, text, law, file) for where, text, law in laws if law]
    if broken:
        return None, broken
    beside = {"file": file}  # what a file names by a path is looked for beside it: core/paths.py, core/bring.py
    try:
        return schema.model_validate(content, context=beside), []
    except ValidationError as error:
        faults = [_fault(schema, content, item, file) for item in error.errors() if not _follows_from_another(item)]
        unknown = [item["loc"] for item in error.errors() if item["type"] == "extra_forbidden"]
    if not unknown:
        return None, faults
    try:
        return schema.model_validate(_without(content, unknown), context=beside), faults
    except ValidationError:
        return None, faults


_LONGEST = 255  # bytes of the name of a file on every system in use
_PROSE = frozenset({"question", "source", "rights", "note", "says", "command"})
"""Keys whose text is for people and may have several lines; every other text becomes a name somewhere."""
_EXPRESSIONS = frozenset({"equations", "definitions", "outputs", "initial"})
"""Tables of expressions, which may be as long; they are parsed, and become no names."""


def _texts(content: Any, where: str = "") -> Iterator[tuple[str, str]]:
    """Yield the place and every text of a file's content, keys included."""
    if isinstance(content, str):
        yield where, content
    elif isinstance(content, Mapping):
        for key, value in content.items():
            yield f"a key of {where or 'the file'}", str(key)
            yield from _texts(value, f"{where}.{key}" if where else str(key))
    elif isinstance(content, (list, tuple)):
        for i, value in enumerate(content):
            yield from _texts(value, f"{where}[{i}]")


def _broken_law(where: str, text: str) -> str:
    """Return the law that a text breaks, or "": one line, short enough to name a file; prose and expressions are free.

    They may have line ends and tabs, and any length.
    """
    *_, table, key = ("", *where.split("."))
    free = key in _PROSE or table in _EXPRESSIONS
    allowed = "\n\r\t" if free else ""
    if any(unicodedata.category(c) in ("Cc", "Zl", "Zp") and c not in allowed for c in text):
        return "must be one line without control characters"
    if not free and any(len(part.encode("utf-8", "replace")) > _LONGEST for part in text.split("/")):
        return f"must be at most {_LONGEST} bytes, as names of files are"
    return ""


def _text_fault(where: str, text: str, law: str, file: Path | str | None) -> str:
    shown = text if len(text) <= 60 else f"{text[:60]}..."
    where = where if len(where) <= 200 else f"{where[:60]}..."
    return f"{f'{file}, ' if file else ''}{where}: {law}, got {shown!r}"


def _follows_from_another(item: Any) -> bool:
    """Say whether a list is only too short because its faulty items, reported themselves, were dropped."""
    return item["type"] == "too_short" and len(item["input"]) > 0


def _without(content: Mapping[str, Any], paths: list[tuple[int | str, ...]]) -> Any:
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
        elif not (isinstance(place, Mapping) and key in place) and key in _variants(model):
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
            tag, valid = context["discriminator"].strip("'()"), context["expected_tags"].replace("'", "").split(", ")
            return f"{prefix}unknown {tag} '{context['tag']}'{nearest(context['tag'], valid)}"
        valid = context["expected"].replace("'", "").replace(" or ", ", ").split(", ")
        hint = nearest(str(got), valid) if str(got) not in valid else ""
        return f"{prefix}must be one of {', '.join(valid)}, got {_shown(got)}{hint}"
    if kind == "union_tag_not_found":
        return f"{prefix}the key {context['discriminator'].removesuffix('()')} is required and missing"
    of = quantity(next((key for key in reversed(shown) if quantity(key.partition("[")[0])), "").partition("[")[0])
    if of and context.get("ge", context.get("le")) in (of.low, of.high):
        return f"{prefix}must be {of.low:g} to {of.high:g} {of.unit if of.unit != '1' else ''}".rstrip() + (
            f", got {_shown(got)}"
        )
    message = item["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:].replace("Input should be", "must be")
    message = message.replace("input should be", "must be").replace("input should have", "must have")
    return f"{prefix}{message}" + ("" if kind == "value_error" else f", got {_shown(got)}")


def _shown(got: Any) -> str:
    """Return a value as Python writes it, at most 200 letters of it."""
    text = repr(got)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _variants(model: Any) -> dict[str, Any]:
    """Return tag -> class of a discriminated union (possibly inside Annotated or tuple), else nothing."""
    found: dict[str, Any] = dict(_tagged(model))
    for part in _members(model):
        if isinstance(part, type) and issubclass(part, Strict):
            for name in ("signal", "method", "kind"):
                if name in part.model_fields:
                    for tag in get_args(part.model_fields[name].annotation):
                        found[str(tag)] = part
    return found


def _tagged(model: Any) -> Iterable[tuple[str, Any]]:
    """Yield tag and class of the members of a union that carry one."""
    origin = get_origin(model)
    if origin is Annotated:
        inner, *marks = get_args(model)
        tags = [mark.tag for mark in marks if isinstance(mark, Tag)]
        yield from ((tag, inner) for tag in tags)
        if not tags:
            yield from _tagged(inner)
    elif origin in (Union, UnionType):
        for part in get_args(model):
            yield from _tagged(part)
    elif origin in (tuple, dict):
        yield from _tagged(get_args(model)[0 if origin is tuple else 1])


def _members(model: Any) -> Iterable[Any]:
    origin = get_origin(model)
    if origin in (Annotated, tuple):
        yield from _members(get_args(model)[0])
    elif origin in (Union, UnionType):
        for part in get_args(model):
            yield from _members(part)
    elif origin is dict:
        yield from _members(get_args(model)[1])
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


# --- quantities with a unit -------------------------------------------------------------------------------------------


class Quantity(NamedTuple):
    """What a number of a file is: its unit ("1": none), and the least and the most that it can be."""

    unit: str
    low: float
    high: float


_ANY = 1e12
"""Bound of what can be anything: coefficients, drawn values of any key, properties of a model."""
_LONGEST_S = 36000.0
OF_ITS_CHANNEL = "of its channel"
_SEED = 2**63 - 1  # the largest whole number of TOML

_ROWS: dict[tuple[float, float, str], str] = {
    # by unit, at the end of the key
    (-1000.0, 1000.0, "m"): "m",
    (-500.0, 30000.0, "m"): "h_m heights_m lowest_m highest_m field_m release_m height_change_m",
    (0.0, 1e5, "m"): "length_m width_m height_m size_m",
    (1e-3, 1000.0, "m"): "chord_m span_m b_m cbar_m diameter_m pitch_m step_m length_unit_m",
    (-1e4, 1e4, "1/m"): "curvature_1_m",
    (1e-5, 1e4, "m2"): "S_m2",
    (-1000.0, 1000.0, "m/s"): "m_s",
    (0.1, 1000.0, "m/s"): "V_m_s V0_m_s speeds_m_s V_min_m_s V_max_m_s",
    (0.0, 100.0, "m/s"): "rms_m_s wind_m_s gust_m_s",
    (0.0, _LONGEST_S, "s"): "s",
    (1e-3, _LONGEST_S, "s"): "duration_s",
    (1e-5, _LONGEST_S, "s"): "step_s prbs_s gbn_s sweep_s period_s width_s",
    (0.0, 60.0, "s"): "lag_s delay_s delays_s jitter_s rise_s time_s",
    (-1e3, 1e3, "s"): "gain_s",
    (-1e5, 1e5, "s"): "clock_offset_s",
    (-1e15, 1e15, "s"): "zero_s segments",
    (0.0, 1e7, "s"): "flown_at_s drift_time_s limit_s",
    (0.0, 1e5, "ms"): "ms",
    (0.0, 1e4, "us"): "us",
    (1e-5, 20000.0, "Hz"): "hz rate_hz",
    (1e-6, 1e6, "rad/s"): "rad_s",
    (1e-3, 1e6, "deg/s"): "deg_s",
    (-360.0, 360.0, "deg"): "deg",
    (-1000.0, 1000.0, "rad"): "rad",
    (1e-9, 1e6, "kg"): "kg",
    (-1e6, 1e6, "kg"): "load_kg",
    (0.0, 1e6, "kg"): "tail_kg",
    (0.0, 1e5, "kg/m"): "kg_per_m",
    (1e-15, 1e9, "kg m2"): "kg_m2",
    (-1e9, 1e9, "kg m2"): "Ixz_kg_m2",
    (0.0, 1e9, "kg m2"): "roll_inertia_kg_m2",
    (1e-6, 20.0, "kg/m3"): "kg_m3",
    (0.01, 20.0, "kg/l"): "kg_l",
    (1e-9, 1e9, "1/(kg m)"): "S_cbar_over_Iyy_1_per_kg_m",
    (1e-6, 1e4, "m2/kg"): "S_m2_per_kg",
    (-1e6, 1e6, "rad/s2/N"): "rad_s2_per_N",
    (1e-6, 1e7, "N"): "N",
    (0.0, 1e9, "W"): "W",
    (1e-6, 1e9, "W h"): "Wh",
    (0.1, 500.0, "MJ/kg"): "MJ_kg",
    (-100.0, 100.0, "degC"): "degC",
    (0.0, 1e4, "%"): "percent accuracies",
    (-1e4, 1e4, "%"): "amplitude_percent",
    (-1e5, 1e5, "1e-6"): "ppm",
    (0.0, 1e9, "EUR"): "price_eur",
    (0.0, 1e9, "g"): "mass_g",
    (1e-6, 1e6, "1/min"): "per_min",
    (1e-3, 100.0, "1/rad"): "slope_1_rad",
    # without a unit
    (0, _SEED, "1"): "seed",
    (0, 100_000_000, "1"): "runs flights sealed block minimum skip_rows column minus_column",
    (0, 100_000, "1"): (
        "repeats bits bootstrap draws realise seeds first stride periods decimate future_horizon past_horizon "
        "max_iterations passes substeps starts mode switch_channel switch_option"
    ),
    (0, 1000, "1"): "order least_orders poles zeros accelerometers strain_gauges",
    (0.0, 10_000.0, "samples"): "delay_samples",
    (0.0, 10.0, "1"): "CD0 CD0_added zeta",
    (-100.0, 100.0, "1"): (
        "CL effectiveness alpha beta kappa static_cp static_cp_alpha static_cp_beta2 upwash cross_axis speed_ratio "
        "load_factor noise"
    ),
    (-1e4, 1e4, "1"): "scale",
    (-1e9, 1e9, "1"): "offset gain pattern powers weights share windows stabiliser drives limits half_width",
    (0.0, 1.0, "1"): (
        "centre_of_mass gyration chord_fraction elastic_axis downwash dropout span_from span_to switching "
        "section_thickness confidence level identification_fraction test train validation"
    ),
    (0.0, 1e9, OF_ITS_CHANNEL): "noise_std noise_density bias_walk drift_std quantum",
    (-1e9, 1e9, OF_ITS_CHANNEL): "bias bias_rate",
    (-100.0, 100.0, "its own"): "correct",
    (-_ANY, _ANY, "its own"): (
        "among bounds constants declare effect_eta effect_etadot errors fixed_process_noise force force_eta "
        "force_etadot force_rotary grid high initial initial_std low mean measurement_noise median parameter_drift "
        "parameters prior_std process_noise set sigma start std uncertainty value values"
    ),
}  # fmt: skip
QUANTITIES = {key: Quantity(unit, low, high) for (low, high, unit), keys in _ROWS.items() for key in keys.split()}
"""Key of a file, or the end of one -> what it measures."""

OF_CHANNELS = {
    "rad": 10.0, "rad/s": 1000.0, "rad/s2": 1e5, "m": 30000.0, "m/s": 1000.0, "m/s2": 1e4, "N": 1e7, "Pa": 1e6,
    "1": 1000.0, "1/s": 1e5, "1/s2": 1e8,
}  # fmt: skip
"""SI unit of a channel -> the most that its signal, and so its noise or bias, can be."""


@cache
def quantity(key: str) -> Quantity | None:
    """Return the row of a key: that of the whole key, else that of its longest end; None without one.

    Example:
        >>> quantity("design_V_m_s")
        Quantity(unit='m/s', low=0.1, high=1000.0)
    """
    words = key.split("_")
    return next((q for i in range(len(words)) if (q := QUANTITIES.get("_".join(words[i:])))), None)


def bound(schema: Any, of: Quantity) -> None:
    """Put the range of a quantity on every number of a pydantic core schema, in place; tighter laws of it stay."""
    if isinstance(schema, tuple):  # a choice of a union with its label
        schema = schema[0]
    if schema["type"] in ("float", "int"):
        number = float if schema["type"] == "float" else int
        if of.low > schema.get("gt", -float("inf")):
            schema.pop("gt", None)
            schema["ge"] = max(number(of.low), schema.get("ge", number(of.low)))
        if of.high < schema.get("lt", float("inf")):
            schema.pop("lt", None)
            schema["le"] = min(number(of.high), schema.get("le", number(of.high)))
    inner = [schema[part] for part in ("schema", "values_schema", "lax_schema", "strict_schema") if part in schema]
    if schema["type"] in ("tuple", "union"):
        inner += schema["items_schema" if schema["type"] == "tuple" else "choices"]
    if schema["type"] == "tagged-union":
        inner += schema["choices"].values()
    for part in inner:
        bound(part, of)
