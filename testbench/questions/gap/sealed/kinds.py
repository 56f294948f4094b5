"""What the blind test knows of a kind of hidden truth: names that are right, how its size is drawn, what compares.

What flies under its name is an entry of testbench/questions/gap/hidden.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Kind:
    """One kind of hidden truth.

    Attributes:
        form: "library" (the library's own mathematics), "other" (another form of one of its effects) or "unseen".
        names: names that are right; the first one is the effect itself.
        draw: sizes from a generator.
        size: (own size -> parameter of the library's effect) for the comparison of sizes.
        near: for "unseen", whether it resembles an effect of the library.
    """

    form: str
    names: tuple[str, ...]
    draw: Draw
    size: tuple[str, str] | None = None
    near: bool = False


def between(**ranges: tuple[float, float]) -> Draw:
    """Return a draw of every size, log-uniform between bounds; one whose name ends in ``_`` gets a random sign."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        out = {}
        for name, (low, high) in ranges.items():
            x = float(math.exp(rng.uniform(math.log(low), math.log(high))))
            out[name.rstrip("_")] = x * (float(rng.choice([-1.0, 1.0])) if name.endswith("_") else 1.0)
        return out

    return draw


def either(**ranges: tuple[float, float, float, float]) -> Draw:
    """Return a draw of every size from one of two intervals."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        return {n: float(rng.uniform(*(r[:2] if rng.random() < 0.5 else r[2:]))) for n, r in ranges.items()}

    return draw


def kind(form: str, names: str, draw: Draw, size: str = "", near: bool = False) -> Kind:
    """Return a kind; ``names`` with spaces between them, ``size`` as "own" or "own -> parameter of the library"."""
    own, _, parameter = size.partition(" -> ")
    return Kind(form, tuple(names.split()), draw, (own, parameter or own) if own else None, near)
