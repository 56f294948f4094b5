"""One suite and one estimator: whether they can work together, and how one that fails is kept from the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.bring import is_brought, running, short
from testbench.core.errors import EstimationError
from testbench.core.interrupts import TimeUp, time_limit
from testbench.core.record import FlightRecord
from testbench.estimators import METHODS
from testbench.estimators.aside import time_is_up
from testbench.estimators.settings import Settings
from testbench.estimators.structured import Structured

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel

_SAMPLES = 8
_MATRICES = ("A", "B", "C", "D", "params")


@dataclass(frozen=True)
class FailedCell:
    """An estimator that gave no model of what a suite measured, and why; ``label`` is that of a case."""

    suite: str
    estimator: str
    reason: str

    @property
    def label(self) -> str:
        """Suite and estimator, in words."""
        return f"{self.suite}, {self.estimator}"


def impossible(entry: Settings, channels: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]) -> str | None:
    """Return why an estimator cannot work on the channels of a suite, from what its method and structure need.

    Users' Python files are not run, and so nothing is known of what they need.

    Args:
        entry: of a scenario.
        channels: that the suite measures.
        inputs: (m,) of the identification.
        outputs: (p,) of the identification that the suite measures.

    Returns:
        One sentence, or None if nothing speaks against it.
    """
    missing = [name for name in inputs if name not in channels]
    if missing:
        return f"the suite does not sense the {'input' if len(missing) == 1 else 'inputs'} {', '.join(missing)}"
    if not outputs:
        return "the suite senses none of the outputs"
    needs = METHODS[entry.method].needs if entry.method in METHODS else ()
    if "one input" in needs and len(inputs) != 1:
        return f"{entry.method} needs a single input, got {', '.join(inputs)}"
    if not isinstance(entry, Structured) or is_brought(entry.structure):
        return None
    return _misfit(entry, channels, inputs, outputs, "all states" in needs)


def _misfit(
    entry: Structured, channels: Sequence[str], inputs: Sequence[str], outputs: Sequence[str], states: bool
) -> str | None:
    """Return why the structure of an entry does not fit the channels, found by making it for a record of ones."""
    from testbench.estimators.parametric.structures.build import build

    data = np.ones((_SAMPLES, len(channels)))
    removed = dict.fromkeys(channels, 1.0)
    record = FlightRecord(
        np.arange(float(_SAMPLES)), tuple(channels), data, "measured", provenance={"prepared": {"removed": removed}}
    )
    try:
        made = build(entry, inputs, outputs, [record] if entry.equations is None else [])
    except EstimationError as error:
        return error.message
    own = made.states[: len(made.states) - len(made.followers)]
    missing = [name for name in own if name not in channels] if states else []
    if missing:
        return (
            f"{getattr(entry, 'method', '')} needs every state of the structure '{short(entry.structure)}', and the "
            f"suite does not sense {', '.join(missing)}"
        )
    return None


@contextmanager
def contained(method: str, limit_s: float) -> Iterator[None]:
    """Turn whatever goes wrong inside the block, or takes longer than its limit, into one error with its reason.

    Args:
        method: whose work the block is.
        limit_s: s; see :func:`testbench.core.interrupts.time_limit`.

    Raises:
        EstimationError: the time is up, or an error that is not one of the testbench, with file and line.
        TestbenchError: as it was raised.
    """
    try:
        with running(None, f"{short(method)} must return a model"), time_limit(limit_s):
            yield
    except TimeUp:
        raise time_is_up(method, limit_s) from None


def need_numbers(model: IdentifiedModel) -> IdentifiedModel:
    """Return a model that holds numbers.

    Raises:
        EstimationError: its matrices, parameters or poles hold NaN.
    """
    for name in _MATRICES:
        values = getattr(model, name, None)
        if isinstance(values, np.ndarray) and values.dtype.kind in "fc" and np.isnan(values).any():
            raise EstimationError(f"{model.method} must return numbers, got NaN in {name}")
    for outputs, poles in model.poles().items():
        if np.isnan(poles).any():
            raise EstimationError(f"{model.method} must return numbers, got NaN in the poles of {outputs}")
    return model
