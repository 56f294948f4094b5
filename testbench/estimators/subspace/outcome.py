"""What a subspace method is asked for, and what it has found."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from testbench.core.record import FloatArray
from testbench.estimators.subspace.data import (
    Offset,
)


class Settings(NamedTuple):
    """What :func:`estimate` was asked for, as JSON values by name."""

    method: str
    past_horizon: int
    future_horizon: int
    order: int | None
    direct_feedthrough: bool
    offset: Offset
    decimate: int | Literal["auto"]
    stable: bool
    closed_loop: bool
    bootstrap: int
    seed: int


class Outcome(NamedTuple):
    """Matrices in units of the stretches, at the records' rate, and intermediate results."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray
    found: dict[str, Any]
