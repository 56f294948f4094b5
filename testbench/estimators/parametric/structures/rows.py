"""Rows over states, inputs and one: linear equations written term by term."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from testbench.estimators.parametric.structure import AnyArray, Matrices, ModelStructure


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
