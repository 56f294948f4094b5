"""Sensor models and the named sensor suites, read from TOML."""

from __future__ import annotations

from testbench.sensors.kinds import KINDS
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import SensorSuite, load_suite, noise_std, suite_table, suite_toml

__all__ = ["KINDS", "Sensor", "SensorSuite", "load_suite", "noise_std", "suite_table", "suite_toml"]
