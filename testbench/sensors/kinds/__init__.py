"""Kinds of instruments, one file each, all named in :data:`KINDS`."""

from __future__ import annotations

from testbench.sensors.kinds.accelerometer import Accelerometer
from testbench.sensors.kinds.attitude import Attitude
from testbench.sensors.kinds.barometer import Barometer
from testbench.sensors.kinds.command_log import CommandLog
from testbench.sensors.kinds.flow_vane import FlowVane
from testbench.sensors.kinds.gps import Gps
from testbench.sensors.kinds.magnetic_heading import MagneticHeading
from testbench.sensors.kinds.motor_speed import MotorSpeed
from testbench.sensors.kinds.pitot import Pitot
from testbench.sensors.kinds.rate_gyro import RateGyro
from testbench.sensors.kinds.strain_gauge import StrainGauge
from testbench.sensors.kinds.surface_position import SurfacePosition
from testbench.sensors.sensor import Sensor

__all__ = ["KINDS"]

KINDS: dict[str, type[Sensor]] = {
    kind.KIND: kind
    for kind in (
        RateGyro,
        Accelerometer,
        Attitude,
        MagneticHeading,
        Barometer,
        Pitot,
        Gps,
        FlowVane,
        StrainGauge,
        SurfacePosition,
        CommandLog,
        MotorSpeed,
    )
}
"""Name in a suite file -> class. A sensor without a kind reads its channel as it is."""
