"""What the factories of structures share: checks of their settings, and start values.

Rows over states, inputs and one: linear equations written term by term.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.core.errors import EstimationError, nearest
from testbench.estimators.parametric.structure import AnyArray, Matrices, ModelStructure, Parameter

# --- rows over states, inputs and one ---------------------------------------------------------------------------------


class Rows:
    """Makes rows (..., n + m + 1) that multiply [x; u; 1], with the leading axes of the parameters.

    Args:
        structure: whose states, inputs and parameter names count.
        params: (..., k) parameters, real or complex.
    """

    def __init__(self, structure: ModelStructure, params: AnyArray) -> None:
        self.values = structure.unpack(np.asarray(params))
        self._n = len(structure.states)
        self._names = (*structure.states, *structure.inputs, "0")
        self._zero = np.zeros((*np.shape(params)[:-1], len(self._names)), np.asarray(params).dtype)

    def zero(self) -> AnyArray:
        """Return an empty row, to be filled."""
        return self._zero.copy()

    def unit(self, name: str) -> AnyArray:
        """Return the row that picks the state or input called ``name``, or one for "0"; empty if there is none."""
        row = self.zero()
        if name in self._names:
            row[..., self._names.index(name)] = 1.0
        return row

    def sum_of(self, symbol: str, variables: Iterable[str]) -> AnyArray:
        """Return the row of symbol_0 + symbol_v v + ... over those ``variables`` that have such a parameter."""
        row = self.zero()
        for variable in ("0", *variables):
            value = self.values.get(f"{symbol}_{variable.removesuffix('_cmd')}")
            if value is not None:
                row[..., self._names.index(variable)] = value
        return row

    def scaled(self, factor: AnyArray | float, row: AnyArray) -> AnyArray:
        """Return factor times row; the factor has the leading axes, or is a number."""
        return np.asarray(np.asarray(factor)[..., None] * row)

    def matrices(self, derivatives: Sequence[AnyArray], outputs: Sequence[AnyArray]) -> Matrices:
        """Return the matrices whose rows are those of dx/dt and of y."""
        f, h, n = np.stack(derivatives, axis=-2), np.stack(outputs, axis=-2), self._n
        return Matrices(f[..., :n], f[..., n:-1], h[..., :n], h[..., n:-1], f[..., -1], h[..., -1])


# --- what the factories of structures share ---------------------------------------------------------------------------


S = TypeVar("S", bound=ModelStructure)


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


def check_outputs(structure: str, outputs: Sequence[str], possible: Sequence[str]) -> None:
    """Check that the outputs are some of the ``possible`` ones, each once.

    Raises:
        EstimationError: none, one twice, or one that the structure cannot give.
    """
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
