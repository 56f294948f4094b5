"""File schemas: what TOML holds validated, every fault of a file reported at once in words."""

from __future__ import annotations

import copy
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag, ValidationError
from pydantic_core import CoreSchema

from testbench.core.errors import nearest
from testbench.core.quantities import bound, quantity

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Model = TypeVar("Model", bound="Strict")


class Strict(BaseModel):
    """Base of all file schemas: frozen, unknown keys refused, no silent conversion, finite numbers only.

    Each number has the unit and the range that :mod:`testbench.core.quantities` gives its key.
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
