"""What it costs to take a command for the surface: the derivatives again, as if a usual servo lay between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from testbench.core.errors import Refusal
from testbench.estimators import estimate
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.structured import Servo, Structured
from testbench.line import Case
from testbench.page.labels import number

USUAL_LAG_S = 0.05
"""A fast servo of a small aircraft; judged. What it moves the estimates by says what an unknown one may."""


def bare_commands(case: Case) -> tuple[str, ...]:
    """Return the inputs of a case's model that are commands taken for surfaces: no servo with a lag or delay is known.

    Throttle commands are left out: an engine is no servo.
    """
    if not isinstance(case.model, ParametricModel) or not isinstance(case.estimator, Structured):
        return ()
    servos: Mapping[str, Servo] = case.estimator.servo
    return tuple(
        name
        for name in case.model.inputs
        if name.endswith("_cmd")
        and name != "thr_cmd"
        and (name not in servos or servos[name].ignore)
        and name not in case.estimator.delays_s
    )


def cost_in_words(case: Case, inputs: Sequence[str]) -> str | None:
    """Return what a servo that is not described may cost, in a sentence; None if every command has its servo."""
    bare = bare_commands(case)
    if not bare:
        return None
    which = f"{', '.join(bare)}: a command is taken for the surface, as if no servo lay between"
    fix = f'give [servo.{bare[0]}] with lag_s = "estimate" or its value'
    entry: Any = case.estimator
    servos = {n: s for n, s in entry.servo.items() if n not in bare}
    servos |= dict.fromkeys(bare, Servo(lag_s=USUAL_LAG_S))
    try:
        other: Any = estimate(
            entry.model_copy(update={"servo": servos}), case.identification, inputs, case.model.outputs
        )
    except Refusal:
        return f"{which}; what that costs cannot be told, since no estimate was found with one; {fix}"
    model: Any = case.model
    moved = [
        (abs(other.values[n] - v) / max(abs(other.values[n]), 1e-300), n)
        for n, v in model.values.items()
        if model.standard_errors[n] > 0.0
        and n in other.values
        and not n.endswith("_0")
        and other.standard_errors[n] < 0.5 * abs(other.values[n])
        and abs(other.values[n] - v) > model.standard_errors[n]
    ]
    if not moved:
        return f"{which}; a lag of {USUAL_LAG_S:g} s would move no derivative by more than its error; {fix}"
    texts = [
        f"{n} would be {number(other.values[n])}, not {number(model.values[n])}"
        for _, n in sorted(moved, reverse=True)[:3]
    ]
    return f"{which}; with a lag of {USUAL_LAG_S:g} s {', '.join(texts)}: do not believe them yet; {fix}"
