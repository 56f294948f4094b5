"""Operational modal analysis: modes of outputs whose input nobody knows, such as a wing in turbulence."""

from __future__ import annotations

from testbench.estimators.operational.estimate import estimate
from testbench.estimators.operational.likeness import mac
from testbench.estimators.operational.result import OperationalMode, OperationalModes
from testbench.estimators.operational.stabilise import Criteria

__all__ = ["Criteria", "OperationalMode", "OperationalModes", "estimate", "mac"]
