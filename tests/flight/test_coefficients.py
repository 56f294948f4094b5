"""Aerodynamic coefficients by perturbation, against the numbers that the models are written with."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from testbench.core.errors import ModelError
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.coefficients import coefficients


@pytest.mark.parametrize("name", ["taurus", "eolo", "b1"])
def test_what_a_packaged_model_is_written_with_is_found(name):
    aircraft = load_aircraft(name, "rigid")
    found = coefficients(aircraft, trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)))
    checked = 0
    for function in ET.fromstring(aircraft.xml).iter("function"):
        coefficient = (function.get("name") or "").removeprefix("aero/coefficient/")
        values = function.findall("product/value")
        if coefficient in found and coefficient.count("_") == 1 and len(values) == 1:
            assert found[coefficient] == pytest.approx(float(values[0].text), abs=2e-7), coefficient
            checked += 1
    assert checked >= 18


def test_lift_carries_the_weight():
    aircraft = load_aircraft("jsbsim:SGS")
    t = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    found = coefficients(aircraft, t)
    weight = aircraft.mass.mass_kg * 9.777 * np.cos(t.condition.gamma_rad)  # 1 km above the equator, turning with it
    assert found["CL"] * t.state["qbar"] * aircraft.geometry.S_m2 == pytest.approx(weight, rel=1e-3)
    assert found["CD"] / found["CL"] == pytest.approx(-t.condition.gamma_rad, rel=2e-3)  # an unpowered glide


def test_a_stock_model_is_asked_like_a_packaged_one():
    c172p = load_aircraft("jsbsim:c172p")
    assert c172p.coefficient("CL_de") == pytest.approx(0.43, rel=1e-6)  # CLDe of c172p.xml
    assert c172p.coefficient("CL_q") == pytest.approx(3.9, rel=1e-6)
    assert c172p.coefficient("CL_alphadot") == pytest.approx(1.7, rel=1e-6)
    assert c172p.coefficient("Cn_da") == pytest.approx(-0.0053, rel=1e-6)
    with pytest.raises(ModelError, match="must have a coefficient 'CL_gamma'"):
        c172p.coefficient("CL_gamma")


def test_the_numbers_of_the_packaged_three_are_those_of_their_files():
    taurus = load_aircraft("taurus")
    assert taurus.coefficient("CL_alpha") == 4.58
    assert taurus.perturbed["CL_alpha"] == pytest.approx(4.58, rel=1e-7)
    assert taurus.perturbed["CL_q"] == pytest.approx(6.1639, rel=1e-6)
