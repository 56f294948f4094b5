"""What a record must hold for a recipe: enough samples, and a control that moves and was logged fast enough."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.logs.manoeuvres import SMALLEST
from testbench.page.words import counted

if TYPE_CHECKING:
    from testbench.questions.importing.recipe import Recipe

FEWEST = 50
"""Samples below which a record decides nothing; judged: five for each of the ten unknowns of the smallest structure."""
UNBROKEN = 5
"""Samples in a row that a control must have somewhere; judged: with fewer it was logged too slowly for the record."""


def moving(records: Sequence[FlightRecord], controls: Sequence[str]) -> list[str]:
    """Return the controls that move by more than a dead band in some record."""
    return [n for n in controls if any(_range(r, n) >= SMALLEST[channel(n).unit] for r in records)]


def why_not(record: FlightRecord, controls: Sequence[str]) -> str:
    """Return why nothing can be identified from a record, or "" if something may.

    Args:
        record: on one clock.
        controls: of it.
    """
    if not moving([record], controls):
        said = ", ".join(f"{n} by {_shown(n, _range(record, n))}" for n in controls)
        return f"no control moves ({said})"
    if len(record) < FEWEST:
        return f"it holds {len(record)} samples, and a model needs {FEWEST} at least"
    slow = too_slow(record, controls)
    if slow:
        longest = min(_longest(record, name) for name in slow)
        have = "has" if len(slow) == 1 else "have"
        return (
            f"{', '.join(slow)} {have} at most {counted(longest, 'sample')} in a row at {1.0 / record.dt_s:.3g} Hz: "
            "logged more slowly than the record"
        )
    return ""


def too_slow(record: FlightRecord, controls: Sequence[str]) -> list[str]:
    """Return the controls that move and were logged too slowly for the record's rate."""
    return [name for name in moving([record], controls) if _longest(record, name) < UNBROKEN]


def too_few(records: Sequence[FlightRecord], recipe: Recipe, inputs: Sequence[str]) -> str:
    """Return why a recipe's model without a structure cannot be made of records, or "" if it can.

    Args:
        records: that the model is identified from: of one that is split, the first part.
        recipe: of them.
        inputs: of the model.
    """
    from testbench.estimators.subspace.dsr_e import shortage

    settings = next((entry for _, entry in recipe.estimators if entry["method"] == "dsr_e"), None)
    if settings is None:
        return ""
    good = [np.asarray(r.select([*inputs, *recipe.outputs]).valid.all(axis=1)) for r in records]
    L = settings["future_horizon"]
    short = shortage(good, len(inputs), len(recipe.outputs), settings["past_horizon"], L)
    if short is None:
        return ""
    return (
        f"a model of {', '.join(recipe.outputs)} without a structure takes {short[1]} stretches of samples that follow "
        f"each other, and {counted(short[0], 'stretch', 'stretches')} of {L} samples or more could be identified from; "
        "fly longer, or log faster"
    )


def _longest(record: FlightRecord, name: str) -> int:
    """Return the longest stretch of valid samples of a channel."""
    edges = np.flatnonzero(np.diff(np.r_[0, record.valid[:, record.channels.index(name)].astype(int), 0]))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _range(record: FlightRecord, name: str) -> float:
    values = record[name][record.valid[:, record.channels.index(name)]]
    return float(np.ptp(values)) if values.size else 0.0


def _shown(name: str, value: float) -> str:
    return f"{value / DEG_RAD:.2g} deg" if channel(name).unit == "rad" else f"{100.0 * value:.2g} %"
