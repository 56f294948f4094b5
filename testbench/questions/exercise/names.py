"""The exercises by name, in an order in which they can be taken."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from testbench.core.errors import RecordError, nearest
from testbench.questions.exercise.exercise import Exercise

CATALOGUE = Path(__file__).parent / "catalogue"
NAMES = (
    "doublet_length",
    "short_period",
    "static_margin",
    "plan_within_limits",
    "sampling_8hz",
    "order_by_singular_values",
    "how_many_repeats",
    "what_alpha_buys",
    "wrong_sign",
    "log_to_derivatives",
    "coloured_residuals",
    "which_sensor_lies",
    "dsr_horizon",
    "flutter_onset",
    "name_missing_effect",
)
"""The exercises, in an order in which they can be taken."""


def load_exercise(name: str) -> Exercise:
    """Return the exercise called ``name``.

    Raises:
        RecordError: there is none of that name.
    """
    if name not in NAMES:
        raise RecordError(f"an exercise must be one of the list, got '{name}'{nearest(name, NAMES)}")
    found = import_module(f"testbench.questions.exercise.catalogue.{name}").EXERCISE
    assert isinstance(found, Exercise)
    return found
