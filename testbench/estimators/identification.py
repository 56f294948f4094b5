"""The table ``identification`` of a scenario: inputs, outputs, and the estimators that run on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import Discriminator, Field, Tag

from testbench.core.bring import is_brought
from testbench.core.schema import Strict
from testbench.estimators import METHODS
from testbench.estimators.own import OwnMethod
from testbench.estimators.settings import Settings

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

    If ``outputs`` is empty, every channel of the suite that is not a control is an output.
    """

    inputs: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    outputs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    estimators: Annotated[tuple[Estimator, ...], Field(min_length=1, strict=False)]
