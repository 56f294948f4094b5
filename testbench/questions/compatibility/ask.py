"""Data compatibility of recorded flights: which instruments err, by how much; see :mod:`testbench.estimators`."""

from __future__ import annotations

from testbench.estimators.data_compatibility import estimate as compatibility

__all__ = ["compatibility"]
