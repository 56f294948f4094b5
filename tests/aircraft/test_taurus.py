from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from testbench.flight import FlightCondition, load_aircraft, trim

FOLDER = Path(__file__).resolve().parents[2] / "aircraft_models" / "taurus"


@pytest.fixture(scope="module")
def derive():
    spec = importlib.util.spec_from_file_location("derive_taurus", FOLDER / "derive.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_file_holds_the_thrust_law_that_the_script_derives(derive):
    text = (FOLDER / "taurus.xml").read_text(encoding="utf-8")
    assert text == derive.amended_xml(), "run aircraft_models/taurus/derive.py --write"


def test_the_propeller_balances_the_motor(derive):
    """At rest the closed form: n from P = CP0 rho n^3 D^5, thrust = CT0 rho n^2 D^4."""
    power = np.polyval(derive.POWER_W, 0.7)
    n = (power / (derive.CP[-1] * derive.DENSITY_KG_M3 * derive.DIAMETER_M**5)) ** (1 / 3)
    assert derive.thrust(0.7, 0.0) == pytest.approx(derive.CT[-1] * derive.DENSITY_KG_M3 * n**2 * derive.DIAMETER_M**4)
    assert derive.thrust(0.7, 12.0) < derive.thrust(0.7, 6.0)


@pytest.mark.parametrize("V", [10.0, 12.0, 15.0, 18.0])
def test_thrust_at_trim_is_that_of_motor_and_propeller(derive, V):
    """Throttle found by trim, put into motor and propeller, gives the thrust that the simulator reports, to the fit."""
    trimmed = trim(load_aircraft("taurus"), FlightCondition(V, 100.0))
    assert trimmed.state["thrust"] == pytest.approx(derive.thrust(trimmed.controls["thr"], V), abs=0.15)


def test_geometry_is_that_of_table_1():
    taurus = load_aircraft("taurus")
    inch = 0.0254
    assert taurus.geometry.S_m2 == pytest.approx(435 * inch**2, rel=1e-3)
    assert taurus.geometry.b_m == pytest.approx(50 * inch)
    assert taurus.geometry.cbar_m == pytest.approx(taurus.geometry.S_m2 / taurus.geometry.b_m, rel=1e-3)
    assert taurus.controls["de"].full == pytest.approx(np.radians(12.5))
    assert taurus.controls["dr"].full == pytest.approx(np.radians(25.0))
