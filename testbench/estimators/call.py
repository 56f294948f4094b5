"""How a method is called: its settings as an instance of their class, or as keywords; defaults stand in the class."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from testbench.core.schema import Strict

Result = TypeVar("Result")


def with_settings(schema: type[Strict]) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Give a function's keywords the defaults of a settings class, and let it take an instance of the class instead.

    The function names its settings as keywords without defaults. Callers then give ``settings=Settings(...)``, keywords
    such as ``order=4``, or both, in which case the keywords count. Keywords are not checked against the class: a method
    checks its own laws, whoever calls it.

    Args:
        schema: settings class; fields that the function does not take are others' (the structure, the label).
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        shape = inspect.signature(function)
        keywords = [p for p in shape.parameters.values() if p.kind is p.KEYWORD_ONLY and p.default is p.empty]
        takes = [p.name for p in keywords if p.name in schema.model_fields]
        fields = {name: schema.model_fields[name] for name in takes}
        defaults = {n: f.get_default(call_default_factory=True) for n, f in fields.items() if not f.is_required()}

        @wraps(function)
        def call(*arguments: Any, settings: Strict | None = None, **given: Any) -> Result:
            base = defaults if settings is None else {name: getattr(settings, name) for name in takes}
            return function(*arguments, **{**base, **given})

        shown = [
            p.replace(default=defaults[p.name]) if p in keywords and p.name in defaults else p
            for p in shape.parameters.values()
        ]
        call.__signature__ = shape.replace(parameters=shown)  # type: ignore[attr-defined]
        return call

    return decorate
