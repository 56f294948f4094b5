"""What varies reaches the simulator: mass, centre of gravity, coefficients and sensors by their physics."""

import re

import numpy as np
import pytest
from short_campaigns import SHORT

from testbench.core.constants import DEG_RAD, FT_M, SLUG_KG
from testbench.core.errors import ModelError
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.draws import change_aircraft, change_suites, check_target, set_keys
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.store import Store
from testbench.sensors import load_suite

CONDITION = FlightCondition(13.0, 100.0)
CESSNA = FlightCondition(50.0, 1000.0)


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


@pytest.fixture(scope="module")
def cessna():
    return load_aircraft("jsbsim:c172p")


def test_a_stock_model_gets_mass_and_inertia_as_flown(cessna):
    """Fuel and pilot included: the aircraft that flies weighs a tenth more, about the same centre of gravity."""
    changed = change_aircraft(cessna, {"aircraft.mass_percent": 10.0, "aircraft.Iyy_percent": -20.0})
    fdm = Executive(changed, changed.rate_hz, CESSNA)
    assert fdm.get("inertia/mass-slugs") * SLUG_KG == pytest.approx(1.1 * cessna.mass.mass_kg, rel=1e-6)
    slug_ft2 = SLUG_KG * FT_M**2
    assert fdm.get("inertia/iyy-slugs_ft2") * slug_ft2 == pytest.approx(0.8 * cessna.mass.Iyy, rel=1e-6)
    assert fdm.get("inertia/ixx-slugs_ft2") * slug_ft2 == pytest.approx(cessna.mass.Ixx, rel=1e-6)
    assert changed.mass.mass_kg == pytest.approx(1.1 * cessna.mass.mass_kg)


def test_a_stock_model_whose_centre_of_gravity_moves_beside_its_mass(cessna):
    inputs = {"aircraft.mass_percent": 20.0, "aircraft.cg_x_m": 0.03, "aircraft.cg_z_m": -0.01}
    plain, changed = (Executive(a, a.rate_hz, CESSNA) for a in (cessna, change_aircraft(cessna, inputs)))
    moved = [changed.get(f"inertia/cg-{x}-in") - plain.get(f"inertia/cg-{x}-in") for x in "xyz"]
    assert np.array(moved) * FT_M / 12.0 == pytest.approx([-0.03, 0.0, 0.01], abs=1e-8)


@pytest.mark.parametrize("coefficient", ["Cm_q", "Cm_alpha", "CL_alpha"])
def test_coefficients_of_a_stock_model_are_scaled(cessna, coefficient):
    """The moment or force about trim changes by a fifth of that coefficient: M_q = qbar S cbar^2 Cm_q / (2 V Iyy)."""
    trimmed = trim(cessna, CESSNA)
    one, two = (linearise(a, trimmed) for a in (cessna, change_aircraft(cessna, {f"coefficient.{coefficient}": 1.2})))
    g, m = cessna.geometry, cessna.mass
    q, w = one.states.index("q"), one.states.index("w")
    row, column = {"Cm_q": (q, q), "Cm_alpha": (q, w), "CL_alpha": (w, w)}[coefficient]
    rate = g.cbar_m / 2.0 if coefficient == "Cm_q" else 1.0
    per = {"Cm_q": g.cbar_m / m.Iyy, "Cm_alpha": g.cbar_m / m.Iyy, "CL_alpha": -1.0 / m.mass_kg}[coefficient]
    expected = 0.2 * CESSNA.qbar_Pa * g.S_m2 * per * cessna.coefficient(coefficient) * rate / CESSNA.V_m_s
    # moments due to alphadot, and alpha itself in w, take some per cent
    assert two.A[row, column] - one.A[row, column] == pytest.approx(expected, rel=0.03)


def test_a_property_that_a_stock_model_is_told_reaches_it(cessna):
    """The flaps of c172p are told to be up before it flies; what the campaign says takes its place."""
    assert cessna.adapter.settings["fcs/flap-cmd-norm"] == 0.0
    flaps = change_aircraft(cessna, {"property.fcs/flap-cmd-norm": 1.0})
    assert flaps.adapter.settings["fcs/flap-cmd-norm"] == 1.0
    assert cessna.adapter.settings["fcs/flap-cmd-norm"] == 0.0


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("coefficient.Cm_alfa", r"c172p must have the coefficient that is varied, got 'Cm_alfa'.*Cm_alpha"),
        ("coefficient.CL_beta", r"c172p must have the coefficient that is varied, got 'CL_beta'"),
        ("property.fcs/nothing", r"declared in the model, got 'fcs/nothing'"),
    ],
)
def test_what_a_stock_model_has_not_is_refused(cessna, key, words):
    (fault,) = check_target(key, 1.1, cessna, ())
    assert re.search(words, fault)


def test_a_campaign_of_a_stock_model_flies(tmp_path):
    """Mass, centre of gravity, a derivative and the drag vary; every run is flown and identified."""
    text = SHORT.format(head="runs = 3", vary='"aircraft.mass_percent" = { kind = "uniform", low = -3.0, high = 3.0 }')
    for old, new in (
        ('aircraft = "taurus"', 'aircraft = "jsbsim:c172p"'),
        ("taurus_8hz", "eolo_gap"),
        ("V_m_s = 13.0, h_m = 100.0", "V_m_s = 50.0, h_m = 1000.0"),
        ("mean = 13.0, std = 0.3", "mean = 50.0, std = 1.0"),
        ("log_rate_hz = 40.0", "log_rate_hz = 200.0"),
        ("[scenario]", '"aircraft.cg_x_m" = { kind = "uniform", low = -0.02, high = 0.02 }\n[scenario]'),
        ("[scenario]", '"coefficient.CD" = { kind = "lognormal", median = 1.0, sigma = 0.1 }\n[scenario]'),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    file = tmp_path / "stock.toml"
    file.write_text(text, encoding="utf-8")
    fly_campaign(load_campaign(file), tmp_path / "store", workers=1)
    with Store.read(tmp_path / "store") as store:
        rows = list(store.rows())
    assert [row.reason for row in rows] == [None] * 3
    assert all(row.results for row in rows)
