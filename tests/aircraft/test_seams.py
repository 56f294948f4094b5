"""The seams of stock models, against what Newton, Euler and a first-order lag say they must do."""

from dataclasses import astuple, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from testbench.aircraft import Aircraft, Amendment, Increment, ScaleCoefficient
from testbench.aircraft.adapter import Adapter
from testbench.aircraft.amend import Change, Thrust, ThrustLine
from testbench.aircraft.seams import added_load, changed, control_path, moved_centre, opened, scaled_mass, with_servo
from testbench.core.constants import FT_M, LBF_N, PSF_PA, SLUG_KG
from testbench.core.errors import ModelError
from testbench.core.record import FloatArray
from testbench.flight import FlightCondition, Manoeuvre, TrimmedFlight, fly, linearise, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.flight.mass import mass_flown
from testbench.flight.trim import place_at_trim
from testbench.inputs.signal import InputSignal

STOCK = ("c172p", "f16", "B747")
_FORCE = ("udot-ft_sec2", "vdot-ft_sec2", "wdot-ft_sec2")
_TURN = ("pdot-rad_sec2", "qdot-rad_sec2", "rdot-rad_sec2")
_SLUG_FT2 = SLUG_KG * FT_M**2


@cache
def stock(name: str) -> tuple[Aircraft, TrimmedFlight]:
    aircraft = load_aircraft(f"jsbsim:{name}")
    return aircraft, trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))


class Bench:
    """An aircraft held at a trim of the plain one, time standing still."""

    def __init__(self, aircraft: Aircraft, trimmed: TrimmedFlight) -> None:
        self.fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        place_at_trim(self.fdm, trimmed)
        self.fdm.evaluate(to_rest=True, held=True)

    def get(self, *names: str) -> FloatArray:
        return np.array([self.fdm.get(n) for n in names])

    @property
    def force(self) -> FloatArray:
        """Return m (d velocity / dt), what aerodynamics and engines do taken away, lbf, body axes."""
        mass = self.fdm.get("inertia/mass-slugs")
        moving = mass * self.get(*(f"accelerations/{n}" for n in _FORCE))
        return moving - self.get(*(f"forces/fb{x}-{of}-lbs" for of in ("aero",) for x in "xyz"))

    @property
    def moment(self) -> FloatArray:
        """Return J (d rates / dt), what the aerodynamics does taken away, lbf ft, body axes."""
        xx, yy, zz, xz, xy, yz = self.get(*(f"inertia/i{n}-slugs_ft2" for n in ("xx", "yy", "zz", "xz", "xy", "yz")))
        J = np.array([[xx, -xy, xz], [-xy, yy, -yz], [xz, -yz, zz]])  # signs as JSBSim gives products of inertia
        turning = J @ self.get(*(f"accelerations/{n}" for n in _TURN))
        return turning - self.get(*(f"moments/{n}-aero-lbsft" for n in "lmn"))


def with_changes(aircraft: Aircraft, *changes: Change) -> Aircraft:
    return changed(aircraft, "test", "test", *changes)


@pytest.mark.parametrize("name", STOCK)
@pytest.mark.parametrize("coefficient", ["CL", "CD", "CY", "Cl", "Cm", "Cn"])
def test_an_increment_acts_at_the_centre_of_gravity_along_its_axis(name, coefficient):
    """Force qbar S C turned from wind to body axes, moment qbar S l C about body axes, nothing else: to 1e-6.

    Aerodynamic forces that follow from alphadot change with it and are taken away.
    """
    aircraft, trimmed = stock(name)
    size = 0.01
    plain = Bench(aircraft, trimmed)
    bench = Bench(with_changes(aircraft, Increment(coefficient, "test", (f"<value>{size}</value>",))), trimmed)
    qS = plain.fdm.get("aero/qbar-psf") * plain.fdm.get("metrics/Sw-sqft")
    a, b = trimmed.alpha, trimmed.beta
    axes = np.array(  # wind axes in body axes (Etkin 1972, section 4.4)
        [
            [np.cos(a) * np.cos(b), np.sin(b), np.sin(a) * np.cos(b)],
            [-np.cos(a) * np.sin(b), np.cos(b), -np.sin(a) * np.sin(b)],
            [-np.sin(a), 0.0, np.cos(a)],
        ]
    )
    force, moment = np.zeros(3), np.zeros(3)
    span, chord = plain.get("metrics/bw-ft", "metrics/cbarw-ft")
    if coefficient in ("CL", "CD", "CY"):
        row, sign = {"CL": (2, -1.0), "CD": (0, -1.0), "CY": (1, 1.0)}[coefficient]
        force = sign * size * qS * axes[row]
    else:
        moment["lmn".index(coefficient[1])] = size * qS * (chord if coefficient == "Cm" else span)
    assert bench.force - plain.force == pytest.approx(force, abs=1e-6 * size * qS)
    assert bench.moment - plain.moment == pytest.approx(moment, abs=1e-6 * size * qS * chord)


@pytest.mark.parametrize("name", STOCK)
def test_accelerometers_feel_an_increment_and_aerodynamic_forces_do_not_hold_it(name):
    aircraft, trimmed = stock(name)
    cd = Increment("CD", "test", ("<value>0.02</value>",))
    plain, bench = Bench(aircraft, trimmed), Bench(with_changes(aircraft, cd), trimmed)
    qS = plain.fdm.get("aero/qbar-psf") * plain.fdm.get("metrics/Sw-sqft")
    felt = bench.fdm.read()["ax"] - plain.fdm.read()["ax"]
    assert felt == pytest.approx(-0.02 * qS * np.cos(trimmed.alpha) * LBF_N / aircraft.mass.mass_kg, rel=1e-6)
    assert bench.fdm.get("forces/fwx-aero-lbs") == pytest.approx(plain.fdm.get("forces/fwx-aero-lbs"), rel=1e-12)


@pytest.mark.sampled(len(STOCK))
@pytest.mark.parametrize("name", STOCK)
@pytest.mark.parametrize(
    ("coefficient", "row", "column"),
    [("Cm_q", "q", "q"), ("Cm_de", "q", "de"), ("Cl_p", "p", "p"), ("Cl_da", "p", "da"), ("Cn_dr", "r", "dr")],
)
def test_a_scaled_derivative_changes_the_linear_model_by_its_share(name, coefficient, row, column):
    """Of J A, the inertia tensor times the rows of the angular accelerations: half of qbar S l C (l / 2V) for 1.5."""
    aircraft, trimmed = stock(name)
    models = [linearise(x, trimmed) for x in (aircraft, with_changes(aircraft, ScaleCoefficient(coefficient, 1.5)))]
    index = models[0].states.index(column) if column in "pqr" else models[0].inputs.index(column)
    columns = [(m.A if column in "pqr" else m.B)[[m.states.index(n) for n in "pqr"], index] for m in models]
    fdm = Bench(aircraft, trimmed).fdm
    xx, yy, zz, xz, xy, yz = (
        fdm.get(f"inertia/i{n}-slugs_ft2") * _SLUG_FT2 for n in ("xx", "yy", "zz", "xz", "xy", "yz")
    )
    J = np.array([[xx, -xy, xz], [-xy, yy, -yz], [xz, -yz, zz]])  # signs as JSBSim gives products of inertia
    g, V = aircraft.geometry, trimmed.condition.V_m_s
    length = g.cbar_m if coefficient.startswith("Cm") else g.b_m
    rate = length / (2.0 * V) if column in "pqr" else 1.0
    expected = 0.5 * fdm.get("aero/qbar-psf") * PSF_PA * g.S_m2 * length * aircraft.coefficient(coefficient) * rate
    found = J @ (columns[1] - columns[0])
    assert found["pqr".index(row)] == pytest.approx(expected, rel=1e-4)
    assert np.delete(found, "pqr".index(row)) == pytest.approx([0.0, 0.0], abs=1e-4 * abs(expected))


@pytest.mark.parametrize("name", STOCK)
def test_scaled_whole_drag_is_drag_in_flight(name):
    """Whatever the drag follows: at 1.2 the force along the airspeed is a fifth of the aerodynamic drag more."""
    aircraft, trimmed = stock(name)
    plain, bench = Bench(aircraft, trimmed), Bench(with_changes(aircraft, ScaleCoefficient("CD", 1.2)), trimmed)
    along = np.array([np.cos(trimmed.alpha), 0.0, np.sin(trimmed.alpha)])
    more = float((bench.force - plain.force) @ along)
    assert more == pytest.approx(-0.2 * plain.fdm.get("forces/fwx-aero-lbs"), rel=1e-6)
    assert bench.moment == pytest.approx(plain.moment, abs=1e-6 * abs(more))


@pytest.mark.parametrize("name", STOCK)
def test_the_parts_of_a_coefficient_add_up(name):
    """CL = CL0 + sum of derivatives times variables at trim, those that are not zero there: alpha, q, de, alphadot."""
    aircraft, trimmed = stock(name)
    V, cbar = trimmed.condition.V_m_s, aircraft.geometry.cbar_m
    parts = {"alpha": trimmed.alpha, "de": trimmed.controls["de"], "da": trimmed.controls["da"]}
    parts |= {"dr": trimmed.controls["dr"], "beta": trimmed.beta}
    parts["q"] = trimmed.state["q"] * cbar / (2.0 * V)  # that of the horizon: 1e-6 rad/s
    whole = aircraft.coefficient("CL0") + sum(aircraft.coefficient(f"CL_{n}") * x for n, x in parts.items())
    assert whole == pytest.approx(aircraft.coefficient("CL"), rel=1e-3)


@pytest.mark.parametrize("name", STOCK)
@pytest.mark.parametrize("factors", [{"mass_kg": 1.3}, {"mass_kg": 0.7}, {"Iyy": 0.6}, {"Ixx": 1.2, "Ixz": 2.0}])
def test_mass_and_inertia_as_flown_become_what_is_asked(name, factors):
    aircraft, trimmed = stock(name)
    changes, expected = scaled_mass(aircraft, factors)
    fdm = Executive(with_changes(aircraft, *changes), trimmed.rate_hz, trimmed.condition)
    assert astuple(mass_flown(fdm, Path())) == pytest.approx(astuple(expected), rel=1e-7)
    assert centre_m(fdm) == pytest.approx(centre_m(Executive(aircraft, trimmed.rate_hz, trimmed.condition)), abs=1e-9)


@pytest.mark.parametrize("name", STOCK)
@pytest.mark.parametrize("shift", [(0.05, 0.0, 0.0), (-0.02, 0.03, -0.04)])
def test_the_centre_of_gravity_moves_and_mass_and_inertia_stay(name, shift):
    aircraft, trimmed = stock(name)
    before = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    fdm = Executive(with_changes(aircraft, *moved_centre(aircraft, shift)), trimmed.rate_hz, trimmed.condition)
    assert centre_m(fdm) - centre_m(before) == pytest.approx(shift, abs=1e-8)
    for n in ("mass-slugs", *(f"i{x}-slugs_ft2" for x in ("xx", "yy", "zz", "xz", "xy", "yz"))):
        assert fdm.get(f"inertia/{n}") == pytest.approx(before.get(f"inertia/{n}"), rel=1e-9, abs=1e-4)


@pytest.mark.parametrize("name", STOCK)
def test_a_load_adds_mass_and_the_inertia_of_two_bodies(name):
    """Steiner: Iyy and Izz by the reduced mass times the square of the distance; Ixx stays."""
    aircraft, trimmed = stock(name)
    fdm = Executive(with_changes(aircraft, *added_load(aircraft, 50.0, 0.5)), trimmed.rate_hz, trimmed.condition)
    flown, m = mass_flown(fdm, Path()), aircraft.mass
    reduced = 50.0 * m.mass_kg / (50.0 + m.mass_kg)
    expected = (m.mass_kg + 50.0, m.Ixx, m.Iyy + 0.25 * reduced, m.Izz + 0.25 * reduced, m.Ixz)
    assert astuple(flown) == pytest.approx(expected, rel=1e-8)


def centre_m(fdm: Executive) -> FloatArray:
    return np.array([fdm.get(f"inertia/cg-{x}-in") for x in "xyz"]) * FT_M / 12.0


@pytest.mark.parametrize("name", STOCK)
def test_more_thrust_is_more_of_all_that_the_engines_do(name):
    aircraft, trimmed = stock(name)
    plain = Bench(aircraft, trimmed)
    bench = Bench(with_changes(aircraft, Thrust("<value>0.25</value>")), trimmed)
    force = plain.get(*(f"forces/fb{x}-prop-lbs" for x in "xyz"))
    moment = plain.get(*(f"moments/{n}-prop-lbsft" for n in "lmn"))
    assert bench.force - plain.force == pytest.approx(0.25 * force, abs=1e-6 * np.linalg.norm(force))
    assert bench.moment - plain.moment == pytest.approx(0.25 * moment, abs=1e-6 * np.linalg.norm(force))


@pytest.mark.parametrize("name", STOCK)
def test_a_higher_thrust_line_pitches_down_by_thrust_times_height(name):
    aircraft, trimmed = stock(name)
    plain, bench = Bench(aircraft, trimmed), Bench(with_changes(aircraft, ThrustLine(0.3)), trimmed)
    moment = bench.moment - plain.moment
    assert moment[1] == pytest.approx(-plain.fdm.get("forces/fbx-prop-lbs") * 0.3 / FT_M, rel=1e-6)
    assert bench.force == pytest.approx(plain.force, abs=1e-6 * abs(float(moment[1])))


def step(aircraft: Aircraft, control: str) -> Manoeuvre:
    t = np.arange(round(2.0 * aircraft.rate_hz)) / aircraft.rate_hz
    u = 0.02 * ((t > 0.2) & (t < 1.0)) + 0.02 * np.minimum(t, 0.1)
    return Manoeuvre("step", InputSignal(t, u[:, None], (control,)), 0.0)


@pytest.mark.parametrize("control", ["de", "da", "dr"])
def test_a_surface_without_a_servo_can_be_given_one(control):
    """The deflection follows the command as scipy integrates d' = lag (c - d) for commands that run linearly."""
    aircraft, trimmed = stock("c172p")
    assert aircraft.servo_of(control) is None
    slow, changes = with_servo(aircraft, control, 8.0)
    slow = with_changes(slow, *changes)
    assert slow.servo_of(control) == control_path(slow, control).lag
    flown = fly(slow, trimmed, step(aircraft, control), aircraft.rate_hz)
    command, deflection = flown.columns((f"{control}_cmd", control)).T
    c = command - command[0]
    expected = lsim(([8.0], [1.0, 8.0]), c, np.arange(len(c)) / aircraft.rate_hz)[1]
    assert deflection - deflection[0] == pytest.approx(expected, abs=1e-9)
    servo = next(s for s in linearise(slow, trimmed).states if s.endswith(control))
    assert servo


def test_a_surface_that_is_opened_flies_as_before():
    aircraft, trimmed = stock("c172p")
    apart, path = opened(aircraft, "de")
    assert path.servo != path.command
    assert opened(apart, "de")[0] is apart
    flights = [fly(x, trimmed, step(aircraft, "de"), aircraft.rate_hz) for x in (aircraft, apart)]
    names = [n for n in flights[0].channels if n != "psi"]
    assert np.max(np.abs(flights[0].columns(names) - flights[1].columns(names))) < 1e-12


def test_a_packaged_aircraft_is_opened_as_it_is(taurus):
    same, path = opened(taurus, "da")
    assert same is taurus
    assert (path.command, path.servo) == ("fcs/aileron-command-rad", "fcs/left-aileron-pos-rad")


def test_a_model_that_was_not_loaded_cannot_be_changed():
    aircraft, trimmed = stock("c172p")
    assert isinstance(aircraft.adapter, Adapter)
    raw = replace(aircraft, adapter=replace(aircraft.adapter, cg_in=None))
    amended = raw.amended(Amendment("x", "x", (ScaleCoefficient("CD", 1.1),)))
    with pytest.raises(ModelError, match="loaded with load_aircraft"):
        amended.model_tree(200.0, 100.0, trimmed.condition.V_m_s)
