"""Flights with one thing wrong with each, for the study of advice, and which codes of advice name it."""

from __future__ import annotations

from dataclasses import dataclass

from testbench.questions.compare.benchmark.flights import (
    DT,
    INPUTS,
    NOISE,
    OUTPUTS,
    TRUTH,
    WN,
    ZETA,
    A,
    B,
    doublets,
    fly,
)  # fmt: skip

__all__ = ["CASES", "DT", "INPUTS", "NOISE", "OUTPUTS", "TRUTH", "WN", "ZETA", "A", "B", "Case", "doublets", "fly"]


@dataclass(frozen=True)
class Case:
    """What is wrong with a flight, and which codes of advice name it.

    Attributes:
        words: what is wrong.
        names: codes that name the cause. Of the clean flight and of too many states, what noise does to methods that it
            biases; a missing state may be called a lag.
        order: number of states that is asked for; the truth has two.
    """

    words: str
    names: tuple[str, ...] = ()
    order: int = 2


CASES = {
    "clean": Case("white measurement noise", ("far_from_best", "noisy_terms")),
    "loop": Case("rate and alpha feedback, gusts", ("closed_loop",)),
    "colour": Case("noise of the sensors coloured over a second", ("coloured_residuals",)),
    "delay": Case("the surface follows three samples late", ("delay", "lag")),
    "drift": Case("biases and drifts of the sensors", ("drift",)),
    "stall": Case("lift and stability fall beyond 1.7 deg", ("bend",)),
    "order4": Case(
        "two states too many",
        ("order_too_high", "not_told_apart", "weak_state", "no_continuous_counterpart", "far_from_best"),
        order=4,
    ),
    "order1": Case("one state too few", ("order_too_low", "lag"), order=1),
    "short": Case("thirty samples", ("few_data",)),
}
