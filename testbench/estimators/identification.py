"""The table ``identification`` of a scenario: inputs, outputs, and the estimators that run on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Discriminator, Field, Tag, ValidationError, ValidationInfo, model_validator

from testbench.core.bring import is_brought
from testbench.core.errors import nearest
from testbench.core.schema import Positive, Strict
from testbench.estimators import METHODS
from testbench.estimators.brought import OwnMethod
from testbench.estimators.equations import STAND_IN, Equations, Symbol
from testbench.estimators.settings import Settings
from testbench.estimators.structured import STRUCTURE_NAMES, Structured

_OWN = "FILE.py:NAME"


def method(entry: Any) -> str | None:
    """Return the method that an entry names, by which its settings class is found in the table."""
    name = entry.get("method") if isinstance(entry, dict) else getattr(entry, "method", None)
    return name if name is None else _OWN if is_brought(name) else str(name)


if TYPE_CHECKING:
    Estimator = Settings
else:
    Estimator = Annotated[
        Union[
            (*(Annotated[row.settings, Tag(name)] for name, row in METHODS.items()), Annotated[OwnMethod, Tag(_OWN)])
        ],
        Discriminator(method),
    ]
"""An entry ``identification.estimators``: the settings class of the method that it names, or one's own method."""


def estimator_name(entry: Settings) -> str:
    """Return the label of an estimator in tables, or its method if it has none."""
    return entry.shown


class Identification(Strict):
    """Which measured channels are inputs and outputs, and which estimators run on them.

    If ``outputs`` is empty, every channel of the suite that is not a control is an output. ``structures`` holds state
    equations of one's own, by the names that the estimators give as their structure. ``limit_s`` is the longest time
    that one estimator may take for the records of one suite; one that takes longer counts as failed.
    """

    inputs: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    outputs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    structures: dict[Symbol, Equations] = {}
    limit_s: Positive = 600.0
    estimators: Annotated[tuple[Estimator, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="before")
    @classmethod
    def _structures_by_name(cls, content: Any, info: ValidationInfo) -> Any:
        """Hand every estimator the equations that it names."""
        if not (isinstance(content, dict) and isinstance(content.get("structures"), dict)):
            return content
        if info.context is not None:
            info.context["structures"] = tuple(content["structures"])
        entries = content.get("estimators")
        if not isinstance(entries, (list, tuple)):
            return content
        return {**content, "estimators": [_with_equations(entry, content["structures"]) for entry in entries]}

    @model_validator(mode="after")
    def _structures_fit(self) -> Identification:
        for name in self.structures:
            if name in STRUCTURE_NAMES:
                raise ValueError(f"structures.{name}: a packaged structure has this name; take another")
        for i, entry in enumerate(self.estimators):
            equations = entry.equations if isinstance(entry, Structured) else None
            if equations is None:
                continue
            assert isinstance(entry, Structured)
            _, symbols = equations.reached(equations.trees.values())
            for name in equations.driven_by(symbols):
                if name not in self.inputs:
                    raise ValueError(
                        f"estimators[{i}].structure: '{entry.structure}' is driven by '{name}', which must be among "
                        f"identification.inputs, {', '.join(self.inputs)}"
                    )
            for name in entry.outputs:
                if name not in equations.possible_outputs:
                    raise ValueError(
                        f"estimators[{i}].outputs: '{entry.structure}' has no output '{name}'"
                        f"{nearest(name, equations.possible_outputs)}"
                    )
        return self


def _with_equations(entry: Any, structures: dict[str, Any]) -> Any:
    """Return the entry with the equations of the structure that it names; their faults are told where they stand."""
    name = entry.get("structure") if isinstance(entry, dict) else None
    if name not in structures or "equations" in entry:
        return entry
    try:
        return {**entry, "equations": Equations.model_validate(structures[name])}
    except ValidationError:
        return {**entry, "equations": STAND_IN}
