"""An estimator of the user's own: ``method = "my_method.py:estimate"`` in a scenario, its settings beside it.

The function is ``estimate(records, inputs, outputs, settings, validation=()) -> IdentifiedModel``. Its settings class
is the annotation of ``settings``: a pydantic model or a dataclass; without annotation the function gets a dict. A
function without ``settings`` or ``validation`` is called without. A structure is brought the same way, see
``parametric.structures.build``.
"""

from __future__ import annotations

import ast
import copy
import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator

from testbench.core import bring
from testbench.core.advice import ranked, status_of
from testbench.core.errors import EstimationError, ScenarioError, nearest
from testbench.core.record import FlightRecord
from testbench.core.schema import parse
from testbench.estimators.brought import guarded, located, place, wrong_arguments
from testbench.estimators.settings import Settings

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel


class OwnMethod(Settings):
    """An estimator in a Python file; the keys beyond method and label are its settings, checked by its own class."""

    model_config = ConfigDict(extra="allow")

    method: Annotated[str, AfterValidator(located)]

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
