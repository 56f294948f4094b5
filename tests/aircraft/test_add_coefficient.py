"""Increments of coefficients that leave an equilibrium where it is, in models of either form."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

import testbench as tb
from testbench.aircraft import Amendment
from testbench.aircraft.amend import AddCoefficient
from testbench.core.errors import ModelError
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight.load import load_aircraft
from testbench.questions.identify.amend.choose import derivatives_of, reached, with_increments, with_lag

TAURUS = tb.FlightCondition(15.0, 100.0)


def derivatives(aircraft, condition):
    trimmed = tb.trim(aircraft, condition)
    return {d.name: d.held for d in dimensional_derivatives(tb.linearise(aircraft, trimmed), trimmed)}


@pytest.mark.parametrize(
    ("name", "condition"),
    [("taurus", TAURUS), pytest.param("jsbsim:c172p", tb.FlightCondition(45.0, 1000.0), marks=pytest.mark.slow)],
)
def test_the_equilibrium_stays_and_one_derivative_moves_by_what_was_added(name, condition):
    aircraft = load_aircraft(name)
    trimmed, g, m = tb.trim(aircraft, condition), aircraft.geometry, aircraft.mass
    change = AddCoefficient("Cm_alpha", -0.2, trimmed.alpha)
    new = aircraft.amended(Amendment("more", "more Cm_alpha", (change,)))
    again = tb.trim(new, condition)
    assert again.alpha == pytest.approx(trimmed.alpha, abs=2e-7)
    assert again.controls["de"] == pytest.approx(trimmed.controls["de"], abs=2e-7)
    before, after = derivatives(aircraft, condition), derivatives(new, condition)
    expected = -0.2 * condition.qbar_Pa * g.S_m2 * g.cbar_m / m.Iyy
    assert after["M_alpha"] - before["M_alpha"] == pytest.approx(expected, rel=1e-3)
    others = {n: after[n] - v for n, v in before.items() if n != "M_alpha"}
    assert max(map(abs, others.values())) < 1e-4


def test_a_number_stays_one_number_and_what_has_none_gets_a_function():
    taurus = load_aircraft("taurus")
    tree = ET.fromstring(taurus.xml)
    for change in (AddCoefficient("Cm_q", 2.0), AddCoefficient("CD_de", 0.1, 0.05), AddCoefficient("CD_de", 0.2)):
        change.apply(tree, taurus)
    new = replace(taurus, xml=ET.tostring(tree, encoding="unicode"))
    assert new.coefficient("Cm_q") == pytest.approx(taurus.coefficient("Cm_q") + 2.0)
    functions = [f.get("name") for f in tree.iter("function")]
    assert functions.count("aero/coefficient/Cm_q") == 1
    (added,) = (f for f in tree.iter("function") if f.get("name") == "aero/increment/CD_de")
    assert float(added.findtext("product/value")) == pytest.approx(0.3)
    (kept,) = (f for f in tree.iter("function") if f.get("name") == "aero/increment/CD0")
    assert float(kept.findtext("product/value")) == pytest.approx(-0.005)


def test_a_control_that_is_not_there_is_refused():
    glider = load_aircraft("taurus")
    glider = replace(glider, controls={n: c for n, c in glider.controls.items() if n != "dr"})
    with pytest.raises(ModelError, match="needs the control dr"):
        AddCoefficient("Cn_dr", 0.1).apply(ET.fromstring(glider.xml), glider)


def test_what_is_written_into_a_foreign_model_belongs_to_its_coefficients():
    c172p = load_aircraft("jsbsim:c172p")
    trimmed = tb.trim(c172p, tb.FlightCondition(c172p.design_V_m_s, c172p.design_h_m))
    added = {"Cm_alpha": -0.3, "CL_alpha": 0.4, "Cm_de": 0.1, "CD_alpha": 0.05}
    new = with_increments(c172p, added, trimmed)
    new = replace(new, perturbed=type(c172p.perturbed)(new))
    for name, value in added.items():
        assert new.coefficient(name) - c172p.coefficient(name) == pytest.approx(value, rel=1e-3), name


def test_what_follows_a_surface_follows_it_behind_a_servo_that_came_later():
    c172p = load_aircraft("jsbsim:c172p")
    condition = tb.FlightCondition(45.0, 1000.0)
    new = with_increments(c172p, {"Cm_de": 0.3}, tb.trim(c172p, condition))
    slow = with_lag(new, "de", 0.1)
    assert slow.source_of("de")[0] != new.source_of("de")[0]
    quick, late = (tb.linearise(a, tb.trim(a, condition)) for a in (new, slow))
    rows, column = [m.states.index("q") for m in (quick, late)], [m.inputs.index("de") for m in (quick, late)]
    assert late.B[rows[1], column[1]] == pytest.approx(quick.B[rows[0], column[0]], rel=1e-6)
    assert late.B[rows[1], late.inputs.index("de_cmd")] == 0.0  # nothing passes the servo by


@pytest.mark.parametrize(
    ("name", "structure", "factors"),
    [
        ("taurus", "short_period", {"Z_alpha": 1.2, "M_alpha": 0.7, "M_q": 1.3, "M_de": 0.8}),
        ("eolo", "longitudinal", {"Z_alpha": 1.2, "M_alpha": 0.7, "M_q": 1.3, "X_alpha": 1.4}),
        ("jsbsim:f16", "lateral_directional", {"L_p": 0.7, "L_beta": 1.2, "N_beta": 1.3, "Y_beta": 0.9, "N_dr": 1.1}),
    ],
)
def test_aims_are_reached_and_nothing_else_moves(name, structure, factors):
    aircraft = load_aircraft(name)
    condition = tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)
    before = derivatives_of(aircraft, tb.trim(aircraft, condition), structure)
    targets = {n: f * before[n] for n, f in factors.items()}
    new, added = reached(aircraft, condition, structure, targets)
    has = derivatives_of(new, tb.trim(new, condition), structure)
    for n, value in targets.items():
        assert has[n] == pytest.approx(value, rel=1e-5), n
    size = max(abs(v) for v in before.values())
    assert max(abs(has[n] - v) for n, v in before.items() if n not in targets) < 1e-5 * size
    assert added
