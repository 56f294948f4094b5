"""Operational modal analysis: modes from outputs alone, when nobody knows the input, as of a wing in turbulence."""

from __future__ import annotations

from testbench.estimators.operational.estimate import estimate
from testbench.estimators.operational.onset import Onset, onset
from testbench.estimators.operational.realise import mac
from testbench.estimators.operational.result import Criteria, OperationalMode, OperationalModes

__all__ = ["Criteria", "Onset", "OperationalMode", "OperationalModes", "estimate", "mac", "onset"]
