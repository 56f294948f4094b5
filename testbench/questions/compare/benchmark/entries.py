"""What every method is asked for in a benchmark: two states, from the same settings for all data sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from testbench.core import bring
from testbench.core.door import sha256
from testbench.core.errors import EstimationError, nearest
from testbench.estimators import METHODS, settings_of
from testbench.estimators.brought import OwnMethod, place, whole
from testbench.estimators.settings import Settings

ASKED: dict[str, Any] = {
    "order": 2,
    "past_horizon": 12,
    "future_horizon": 15,
    "poles": 2,
    "zeros": 1,
    "window_s": [6.0],
    "hold": "zoh",
    "structure": "short_period",
    "held": ["de"],
}
"""Setting -> value, for every method that has it. A new row of METHODS with such settings needs nothing here."""
_LISTS = {"srivc": ("poles", "zeros"), "transfer_function": ("zeros",)}


class Entry(NamedTuple):
    """A method in a benchmark: its name in tables, its settings, and the SHA-256 of its file if it was brought."""

    label: str
    settings: Settings
    told: dict[str, Any]


def entries(methods: Sequence[str] = (), own: Sequence[str] = ()) -> tuple[Entry, ...]:
    """Return the methods of a benchmark.

    Args:
        methods: names of METHODS; all of them if empty.
        own: estimators of one's own, FILE.py:NAME, on top.

    Raises:
        EstimationError: a name is not in the table.
        ScenarioError: a file is not there, or does not define the function.
    """
    for name in methods:
        if name not in METHODS:
            raise EstimationError(f"the method must be one of the table, got '{name}'{nearest(name, METHODS)}")
    out = [_packaged(name) for name in (methods or METHODS)]
    return (*out, *(_own(name) for name in own))


def _packaged(name: str) -> Entry:
    lists = _LISTS.get(name, ())
    fields = METHODS[name].settings.model_fields
    given: Mapping[str, Any] = {k: [v] if k in lists else v for k, v in ASKED.items() if k in fields}
    settings = settings_of(name, dict(given))
    return Entry(name, settings, settings.model_dump(mode="json"))


def _own(name: str) -> Entry:
    settings = settings_of(whole(name, None), {})
    assert isinstance(settings, OwnMethod)
    path, attribute = place(settings.method)
    told = {"file": Path(path).name, "name": attribute, "sha256": sha256(path, "python")}
    return Entry(bring.short(settings.method), settings, told)
