"""What an autopilot needs to fly a planned input: CSV, a Lua script for ArduPilot Plane, a MAVLink sender for PX4."""

from testbench.questions.plan.injection.lua import lua_script
from testbench.questions.plan.injection.px4 import px4_script
from testbench.questions.plan.injection.signal_table import injected_signal, signal_csv

__all__ = ["injected_signal", "lua_script", "px4_script", "signal_csv"]
