"""A flow angle that no vane measured, integrated from rates and accelerations."""

import numpy as np

from testbench.core.record import FlightRecord
from testbench.estimators.parametric.starts import with_flow_angle
from testbench.estimators.parametric.structures import Trim, longitudinal

T = 0.01 * np.arange(800)


def flown(bias: float, channels=("q", "az")) -> FlightRecord:
    alpha = 0.05 * np.sin(5.0 * T)
    az = 20.0 * -4.0 * alpha
    q = 0.25 * np.cos(5.0 * T) - az / 20.0 + bias
    data = {"q": q, "az": az, "alpha": alpha}
    return FlightRecord(T, channels, np.column_stack([data[n] for n in channels]), "measured")


def structure():
    return longitudinal(Trim(20.0), states=("alpha", "q"), outputs=("q", "az"))


def test_alpha_comes_back_in_spite_of_a_bias_of_the_gyro():
    for bias in (0.0, 0.02):
        found = with_flow_angle(structure(), flown(bias))["alpha"]
        alpha = 0.05 * np.sin(5.0 * T)
        assert np.std(found - alpha) < 0.1 * np.std(alpha)


def test_what_was_measured_stays_and_what_cannot_be_reconstructed_is_left():
    measured = flown(0.0, ("q", "az", "alpha"))
    assert with_flow_angle(structure(), measured) is measured
    poor = flown(0.0, ("q",))
    assert with_flow_angle(structure(), poor) is poor
