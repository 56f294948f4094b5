"""What varies reaches the simulator: mass, centre of gravity, coefficients and sensors by their physics."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD, SLUG_KG
from testbench.core.errors import ModelError
from testbench.flight import FlightCondition, linearise, trim
from testbench.flight.executive import Executive
from testbench.questions.campaign.targets import change_aircraft, change_suites, set_keys
from testbench.sensors import load_suite

CONDITION = FlightCondition(13.0, 100.0)


def test_mass_and_inertia_reach_jsbsim(taurus):
    changed = change_aircraft(taurus, {"aircraft.mass_percent": 10.0, "aircraft.Iyy_percent": -20.0})
    fdm = Executive(changed, changed.rate_hz, CONDITION)
    # JSBSim's own conversion of pounds and slugs agrees with ours to 1e-4
    assert fdm.get("inertia/mass-slugs") * SLUG_KG == pytest.approx(1.1 * taurus.mass.mass_kg, rel=1e-4)
    assert changed.mass.mass_kg == pytest.approx(1.98)
    assert changed.mass.Iyy == pytest.approx(0.8 * taurus.mass.Iyy)
    both = change_aircraft(taurus, {"aircraft.inertia_percent": 5.0})
    assert both.mass.Ixx == pytest.approx(1.05 * taurus.mass.Ixx)
    assert change_aircraft(taurus, {"condition.V_m_s": 3.0}) is taurus


def m_alpha(aircraft) -> float:
    linear = linearise(aircraft, trim(aircraft, CONDITION))
    return float(linear.A[linear.states.index("q"), linear.states.index("w")])


def test_a_centre_of_gravity_farther_forward_stiffens_in_pitch(taurus):
    """The change of M_w follows from the lift slope: dM_w = -dx Z_w mass / Iyy, here to 5 % (drag is left out)."""
    shift = 0.005
    linear = linearise(taurus, trim(taurus, CONDITION))
    z_w = float(linear.A[linear.states.index("w"), linear.states.index("w")])
    expected = shift * z_w * taurus.mass.mass_kg / taurus.mass.Iyy
    found = m_alpha(change_aircraft(taurus, {"aircraft.cg_x_m": shift})) - m_alpha(taurus)
    assert found == pytest.approx(expected, rel=0.05)
    assert found < 0.0


def test_coefficients_are_scaled(taurus):
    """Cm_alpha is nearly all of M_w; the rest (thrust, alphadot) is below 5 %."""
    found = m_alpha(change_aircraft(taurus, {"coefficient.Cm_alpha": 1.2})) / m_alpha(taurus)
    assert found == pytest.approx(1.2, abs=0.05)


def test_a_mass_must_stay(taurus):
    with pytest.raises(ModelError, match=r"aircraft.mass_percent > -100 must hold, got -100"):
        change_aircraft(taurus, {"aircraft.mass_percent": -100.0})


def test_sensors_change_in_every_suite_and_in_given_units():
    suites = (load_suite("eolo_alpha"), load_suite("eolo_no_alpha"))
    changed = change_suites(suites, {"sensor.q.bias_deg_s": 2.0, "sensor.alpha.scale": 1.1, "sensor.q.noise_std": 0.0})
    for suite in changed:
        q = next(s for s in suite.sensors if s.channel == "q")
        assert q.bias == pytest.approx(2.0 * DEG_RAD)
        assert q.noise_std == 0.0
    alpha = [s for suite in changed for s in suite.sensors if s.channel == "alpha"]
    assert [s.scale for s in alpha] == [1.1]
    assert change_suites(suites, {}) is suites


def test_accelerometers_stay_where_they_are_mounted():
    (moved,) = change_suites((load_suite("eolo_alpha"),), {"aircraft.cg_x_m": 0.02})
    before = {s.channel: s.position_m for s in load_suite("eolo_alpha").sensors}
    for sensor in moved.sensors:
        shift = np.subtract(sensor.position_m, before[sensor.channel])
        assert shift.tolist() == pytest.approx([-0.02 if sensor.channel in ("ax", "ay", "az") else 0.0, 0.0, 0.0])


def test_keys_of_the_scenario_are_set_in_a_copy():
    content = {"condition": {"V_m_s": 1.0}, "manoeuvre": [{"input": [{"a": 1}]}]}
    out = set_keys(content, {"condition.V_m_s": 2.0, "manoeuvre.0.input.0.pilot.jitter_s": 0.1, "air.x": 3.0})
    assert out["condition"]["V_m_s"] == 2.0
    assert out["manoeuvre"][0]["input"][0] == {"a": 1, "pilot": {"jitter_s": 0.1}}
    assert out["air"] == {"x": 3.0}
    assert content["condition"]["V_m_s"] == 1.0
