"""What an autopilot needs to fly a planned input: CSV, a Lua script for ArduPilot Plane, a MAVLink sender for PX4."""

from testbench.questions.plan.injection.scripts import injected_signal, lua_script, px4_script, signal_csv

__all__ = ["injected_signal", "lua_script", "px4_script", "signal_csv"]
