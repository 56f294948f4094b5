"""The modal assurance criterion: how alike two mode shapes are."""

from __future__ import annotations

import numpy as np

from testbench.estimators.model import ComplexArray


def mac(one: ComplexArray, other: ComplexArray) -> float:
    """Return the modal assurance criterion |a^H b|^2 / (a^H a b^H b) of two mode shapes (r,); 0 if one vanishes."""
    size = float(np.vdot(one, one).real * np.vdot(other, other).real)
    return float(abs(np.vdot(one, other)) ** 2 / size) if size > 0.0 else 0.0
