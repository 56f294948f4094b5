"""What the factories of structures share: checks of their settings, and start values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.core.errors import EstimationError, nearest
from testbench.estimators.parametric.structure import Parameter


@dataclass(frozen=True)
class Trim:
    """The steady straight flight from which a linear structure describes deviations.

    Args:
        V: true airspeed, m/s.
        alpha: angle of attack, rad.
        theta: pitch angle, rad.
        g: acceleration of gravity, m/s2.

    Raises:
        EstimationError: V > 0 does not hold, or a value is not finite.
    """

    V: float
    alpha: float = 0.0
    theta: float = 0.0
    g: float = G0_M_S2

    def __post_init__(self) -> None:
        if not np.all(np.isfinite([self.V, self.alpha, self.theta, self.g])) or not self.V > 0.0:
            raise EstimationError(f"a trim must be finite numbers with V > 0, got {self}")


OUTPUTS = {
    "short_period": ("alpha", "q", "qdot"),
    "longitudinal": ("V", "alpha", "q", "theta", "qdot", "ax", "az"),
    "flexible": ("V", "alpha", "q", "theta", "qdot", "ax", "az"),
    "lateral_directional": ("beta", "p", "r", "phi", "pdot", "rdot", "ay"),
    "lateral_per_speed": ("beta", "p", "r", "phi", "pdot", "rdot"),
    "roll_yaw_rates": ("p", "r", "pdot", "rdot", "ay"),
    "aerodynamic_longitudinal": ("V", "alpha", "theta", "q", "qdot", "ax", "az"),
}
"""Packaged structure -> outputs that it can have; a flexible one has its elastic states besides."""


def check_outputs(structure: str, outputs: Sequence[str], possible: Sequence[str] = ()) -> None:
    """Check that the outputs are some of the ``possible`` ones, those of :data:`OUTPUTS` if not given, each once.

    Raises:
        EstimationError: none, one twice, or one that the structure cannot give.
    """
    possible = possible or OUTPUTS[structure]
    if not outputs or len(set(outputs)) != len(outputs):
        raise EstimationError(
            f"structure '{structure}' needs outputs that differ, got {', '.join(outputs) or 'none'}; choose from "
            f"{', '.join(possible)}"
        )
    for name in outputs:
        if name not in possible:
            raise EstimationError(
                f"an output of structure '{structure}' must be one of {', '.join(possible)}, got '{name}'"
                f"{nearest(name, possible)}"
            )


def derivatives(
    symbol: str, variables: Sequence[str], guess: Mapping[str, float], fixed: Sequence[str]
) -> list[Parameter]:
    """Return the parameters symbol_0, symbol_v, ... with start values from ``guess``, 0 where it has none."""
    names = [f"{symbol}_{v.removesuffix('_cmd')}" for v in ("0", *variables)]
    return [Parameter(name, guess.get(name, 0.0), free=name not in fixed) for name in names]


def total(symbol: str, variables: Iterable[str], parameters: Sequence[Parameter]) -> str:
    """Return symbol_0 + symbol_v v + ... as text, over those ``variables`` that have such a parameter."""
    have = {p.name for p in parameters}
    terms = {f"{symbol}_0": f"{symbol}_0"} | {
        (name := f"{symbol}_{v.removesuffix('_cmd')}"): f"{name}*{v}" for v in variables
    }
    return " + ".join(text for name, text in terms.items() if name in have) or "0"
