"""What an autopilot needs to fly a planned input: the signal as CSV, and as a Lua script for ArduPilot Plane."""

from testbench.questions.plan.injection.lua import lua_script
from testbench.questions.plan.injection.signal_table import injected_signal, signal_csv

__all__ = ["injected_signal", "lua_script", "signal_csv"]
