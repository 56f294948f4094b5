"""Users' estimators and structures: their file is found, checked as text, and called with care."""

from __future__ import annotations

import ast
import copy
import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, model_validator

from testbench.core import bring
from testbench.core.advice import ranked, status_of
from testbench.core.errors import EstimationError, Refusal, ScenarioError, nearest
from testbench.core.paths import find_scenario
from testbench.core.record import FlightRecord
from testbench.core.schema import parse
from testbench.estimators.equations import read_equations
from testbench.estimators.settings import Settings

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel


FOLDER = "estimators"
"""Folder of a project in which estimators and structures are looked for."""


_STATUS = "; leave status out: it follows from advice"


def located(name: str, info: ValidationInfo) -> str:
    """Return ``FILE.py:NAME`` with the absolute path of its file, found from the scenario that is being read.

    Raises:
        ValueError: there is no such file; pydantic adds the key.
    """
    beside = (info.context or {}).get("file")
    try:
        path, attribute = bring.find(name, beside, FOLDER)
    except ScenarioError as error:
        raise ValueError("; ".join(error.faults)) from error
    return f"{path}:{attribute}"


def is_text(name: object) -> bool:
    """Say whether a structure's name means equations in a TOML file: ``FILE.toml``."""
    return isinstance(name, str) and name.endswith(".toml")


def text_file(name: str, beside: Path | str | None) -> Path:
    """Return the file that ``FILE.toml`` means: one's own, else a packaged one such as ``structures/engine.toml``.

    Args:
        name: as in the scenario.
        beside: the scenario's file; None if there is none.

    Raises:
        ScenarioError: there is no such file.
    """
    found = bring.find_file(name, beside, FOLDER)
    if found is None:
        packaged = find_scenario(name).resolve()
        found = packaged if packaged.is_file() else None
    if found is None or not found.is_file():
        there = bring.places(beside, FOLDER)
        others = {file.name for place in there for file in place.glob("*.toml")}
        looked = ", ".join(str(place) for place in there if place.is_dir())
        raise ScenarioError(f"the file of a structure must exist, got no '{name}' in {looked}{nearest(name, others)}")
    return found


def whole(name: str, beside: Path | str | None) -> str:
    """Return a name of what is brought with the absolute path of its file; packaged names as they are.

    Raises:
        ScenarioError: there is no such file.
    """
    if is_text(name):
        return str(text_file(name, beside))
    return ":".join(map(str, bring.find(name, beside, FOLDER))) if bring.is_brought(name) else name


def written(name: str, info: ValidationInfo) -> str:
    """Return the absolute path of a structure's equations, which have been read and checked.

    Raises:
        ValueError: there is no such file, or its equations break a law; pydantic adds the key.
    """
    try:
        path = text_file(name, (info.context or {}).get("file"))
        read_equations(path)
    except Refusal as error:
        raise ValueError("; ".join(getattr(error, "faults", (str(error),)))) from error
    return str(path)


def structure(name: str, info: ValidationInfo) -> str:
    """Return the name of a brought structure with the absolute path of its file, whose text has been checked.

    Raises:
        ValueError: there is no such file, or no function (inputs, outputs, trim) in it; pydantic adds the key.
    """
    found = located(name, info)
    path, attribute = place(found)
    try:
        file = bring.declared(path)
        file.need(attribute)
    except ScenarioError as error:
        raise ValueError("; ".join(error.faults)) from error
    function = file.functions.get(attribute)
    wrong = function and wrong_arguments(function, ("inputs", "outputs", "trim"), (), path)
    if wrong:
        raise ValueError(wrong)
    return found


def place(name: str) -> tuple[Path, str]:
    """Return path and attribute of a name whose file has been found."""
    path, _, attribute = name.rpartition(":")
    return Path(path), attribute


def wrong_arguments(function: ast.FunctionDef, first: Sequence[str], more: Sequence[str], path: Path) -> str | None:
    """Return what is wrong with the arguments of a function, as its text shows them; None if nothing is.

    Args:
        function: its definition.
        first: what it gets by position.
        more: what it may take by name.
        path: of its file.
    """
    a = function.args
    placed = [arg.arg for arg in (*a.posonlyargs, *a.args)]
    needed = placed[: len(placed) - len(a.defaults)][len(first) :]
    needed += [arg.arg for arg, default in zip(a.kwonlyargs, a.kw_defaults, strict=True) if default is None]
    if (len(placed) >= len(first) or a.vararg is not None) and set(needed) <= set(more):
        return None
    wanted = ", ".join([*first, *more])
    return f"{function.name} of {path.name} must take ({wanted}), got ({', '.join(placed)})"


def guarded(path: Path, label: str, what: str, function: Any, *arguments: Any, **named: Any) -> Any:
    """Call a user's function; turn an error that is not one of the testbench into one sentence.

    Raises:
        BroughtCodeError: with kind, text and line of the error.
        TestbenchError: as it was raised.
    """
    try:
        with bring.running(path, f"{label} must return {what}"):
            return function(*arguments, **named)
    except bring.BroughtCodeError as error:
        if isinstance(error.__cause__, TypeError) and "argument 'status'" in error.message:
            raise bring.BroughtCodeError(f"{error.message}{_STATUS}") from error.__cause__
        raise


# --- an estimator of the user's own -----------------------------------------------------------------------------------


class OwnMethod(Settings):
    """An estimator in a Python file; the keys beyond method and label are its settings, checked by its own class."""

    model_config = ConfigDict(extra="allow")

    method: Annotated[str, Field(json_schema_extra={"pattern": ":"}), AfterValidator(located)]

    @property
    def given(self) -> dict[str, Any]:
        """The settings as the scenario gives them."""
        return dict(self.model_extra or {})

    @model_validator(mode="after")
    def _as_declared(self) -> OwnMethod:
        path, attribute = place(self.method)
        try:
            faults = declared_faults(bring.declared(path), attribute, self.given)
        except ScenarioError as error:
            faults = list(error.faults)
        if faults:
            raise ValueError("; ".join(faults))
        return self


# --- what can be said without running it ------------------------------------------------------------------------------


def declared_faults(file: bring.Declared, attribute: str, given: Mapping[str, Any]) -> list[str]:
    """Return what is wrong with a function and its settings, as far as the text of its file shows it.

    Args:
        file: as declared.
        attribute: name of the function.
        given: settings of the scenario.

    Raises:
        ScenarioError: the file does not define the name.
    """
    file.need(attribute)
    function = file.functions.get(attribute)
    if function is None:
        return []  # imported, or made by a call: only running it shows what it takes
    wrong = wrong_arguments(function, ("records", "inputs", "outputs"), ("settings", "validation"), file.path)
    if wrong:
        return [wrong]
    every = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    settings = next((a for a in every if a.arg == "settings"), None)
    if settings is None:
        return [_unknown(name, (), file.path) for name in given] if function.args.kwarg is None else []
    fields = _declared_fields(file, settings.annotation)
    if fields is None:
        return []
    faults = [_unknown(name, fields, file.path) for name in given if name not in fields]
    return faults + [
        f"setting '{n}' of {file.path.name} is required and missing" for n in fields if fields[n] and n not in given
    ]


def _unknown(name: str, fields: Mapping[str, bool] | tuple[()], path: Path) -> str:
    have = nearest(name, fields) if fields else "; it has no settings"
    return f"{path.name} has no setting '{name}'{have}"


def _declared_fields(file: bring.Declared, annotation: ast.expr | None) -> dict[str, bool] | None:
    """Return field -> whether it is required, of the class that an annotation names; None if the text does not show."""
    name = annotation.value if isinstance(annotation, ast.Constant) else getattr(annotation, "id", None)
    node = file.classes.get(str(name))
    if node is None:
        return None
    fields: dict[str, bool] = {}
    for base in node.bases:
        known = ast.unparse(base).split(".")[-1]
        if known in ("BaseModel", "Strict"):
            continue
        above = _declared_fields(file, base)
        if above is None:
            return None
        fields |= above
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            kind = ast.unparse(item.annotation)
            if item.target.id.startswith(("_", "model_config")) or "ClassVar" in kind:
                continue
            fields[item.target.id] = item.value is None or _no_default(item.value)
    return fields


def _no_default(value: ast.expr) -> bool:
    """Say whether ``= Field(...)`` gives a field no default."""
    if not (isinstance(value, ast.Call) and ast.unparse(value.func).split(".")[-1] in ("Field", "field")):
        return False
    first = value.args[0] if value.args else None
    named = {k.arg for k in value.keywords} & {"default", "default_factory"}
    return not named and (first is None or (isinstance(first, ast.Constant) and first.value is Ellipsis))


# --- running it -------------------------------------------------------------------------------------------------------


def run(
    entry: OwnMethod,
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    validation: Sequence[FlightRecord],
) -> IdentifiedModel:
    """Run the function of an entry; the model says whose code made it.

    Raises:
        ScenarioError: the file cannot be run.
        EstimationError: a setting breaks a law of its class, the function returns no model, or a model whose status is
            not that of its advice.
        BroughtCodeError: the function fails with an error that is not one of the testbench.
        TestbenchError: as the function raises it.
    """
    from testbench.estimators.model import IdentifiedModel

    path, attribute = place(entry.method)
    function = bring.load(path, attribute)
    label = bring.short(entry.method)
    if not callable(function):
        raise EstimationError(f"{label} must be a function, got {type(function).__name__}")
    takes = inspect.signature(function).parameters
    more: dict[str, Any] = {"validation": tuple(validation)} if "validation" in takes else {}
    if "settings" in takes:
        more["settings"] = settings_for(function, entry.given, path)
    elif entry.given:
        raise EstimationError(_unknown(next(iter(entry.given)), (), path))
    model = guarded(path, label, "a model", function, tuple(records), tuple(inputs), tuple(outputs), **more)
    if not isinstance(model, IdentifiedModel):
        raise EstimationError(f"{label} must return an IdentifiedModel, got {type(model).__name__}")
    _advised(model, label)
    return stamped(
        model, advice=ranked(model.advice), method=label, provenance={"estimator": bring.whose(path, attribute)}
    )


def _advised(model: IdentifiedModel, label: str) -> None:
    """Check that the advice of a user's model is a sequence of sentences, and that its status is the one of these."""
    if isinstance(model.advice, str) or not all(isinstance(a, str) for a in model.advice):
        raise EstimationError(f"advice of {label} must be a tuple of sentences, got {model.advice!r}")
    status = status_of(model.advice)
    if model.status != status:
        raise EstimationError(
            f"the status of a model follows from its advice; {label} must leave status out, got '{model.status}' where "
            f"the advice says '{status}'"
        )


def stamped(model: IdentifiedModel, **values: Any) -> IdentifiedModel:
    """Return the model with other values of some attributes, whatever arguments its class needs."""
    out = copy.copy(model)
    for name, value in values.items():
        object.__setattr__(out, name, value)
    return out


def settings_for(function: Any, given: Mapping[str, Any], path: Path) -> Any:
    """Return the settings as the class that the function asks for, or as a dict if it asks for none.

    Raises:
        EstimationError: a name is unknown or missing, or a value breaks a law of the class.
    """
    schema = inspect.signature(function).parameters["settings"].annotation
    if isinstance(schema, str):
        schema = getattr(inspect.unwrap(function), "__globals__", {}).get(schema)
    if isinstance(schema, type) and issubclass(schema, BaseModel):
        fields = {name: f.is_required() for name, f in schema.model_fields.items()}
    elif isinstance(schema, type) and dataclasses.is_dataclass(schema):
        none = dataclasses.MISSING
        fields = {f.name: f.default is none and f.default_factory is none for f in dataclasses.fields(schema)}
    else:
        return dict(given)
    faults = [_unknown(name, fields, path) for name in given if name not in fields]
    faults += [f"setting '{n}' of {path.name} is required and missing" for n in fields if fields[n] and n not in given]
    if not faults and issubclass(schema, BaseModel):
        made, faults = parse(schema, given, None)
        if made is not None and not faults:
            return made
    if faults:
        raise EstimationError("; ".join(faults))
    return guarded(path, f"{schema.__name__} of {path.name}", "settings", schema, **given)


def of_python(name: str, given: Mapping[str, Any]) -> OwnMethod:
    """Return the entry of a method that is named from Python; its file is looked for in the working directory.

    Raises:
        EstimationError: all faults of name and settings.
    """
    entry, faults = parse(OwnMethod, {"method": name, **given}, None)
    if entry is None or faults:
        raise EstimationError("; ".join(faults))
    return entry
