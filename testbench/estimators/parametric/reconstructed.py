"""Angle of attack or sideslip where no vane was flown: integrated from rates and accelerations, to start a search from.

    alphadot = q + az / V,    betadot = (ay + g cos(theta0) phi) / V + p sin(alpha0) - r cos(alpha0)

as deviations from trim. Biases of gyro and accelerometer make the integral drift; the straight line that fits it best
is taken out. What is left is good for start values only: slow motion is lost in that line. V. Klein, E. A. Morelli,
Aircraft System Identification, 2006, section 10.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from testbench.core.record import FlightRecord, FloatArray


def with_flow_angle(structure: Any, record: FlightRecord) -> FlightRecord:
    """Return the record with the flow angle that a structure has as state and the record lacks; itself if it can't be.

    Args:
        structure: with a trim, behind servos or not.
        record: prepared: deviations from trim, SI.
    """
    trim = getattr(getattr(structure, "base", structure), "trim", None)
    if trim is None:
        return record
    rate: FloatArray
    if "alpha" in structure.states and "alpha" not in record and {"q", "az"} <= set(record.channels):
        name, rate = "alpha", record["q"] + record["az"] / trim.V
    elif "beta" in structure.states and "beta" not in record and {"p", "r", "phi", "ay"} <= set(record.channels):
        side = (record["ay"] + trim.g * np.cos(trim.theta) * record["phi"]) / trim.V
        name, rate = "beta", side + np.sin(trim.alpha) * record["p"] - np.cos(trim.alpha) * record["r"]
    else:
        return record
    angle = record.dt_s * np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
    t = record.t_s - record.t_s[0]
    return record.with_columns({name: angle - np.polyval(np.polyfit(t, angle, 1), t)})
