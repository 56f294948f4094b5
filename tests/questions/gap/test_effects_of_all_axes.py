"""Effects in roll, yaw and thrust: the laws of every effect, and each is found again, at its size, in what it made."""

from __future__ import annotations

import numpy as np
import pytest
from axes import believe, commands
from gap_fits import check_sizes, fits

from testbench.effects import EFFECTS, ON_REQUEST, aerodynamics, feedback, mass, structure, thrust
from testbench.flight import FlightCondition, linearise, trim
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.search.point import Point

NEW = {e.name: e for table in (aerodynamics, feedback, mass, structure, thrust) for e in table.EFFECTS if e.lateral}
NEW |= {e.name: e for table in (aerodynamics, structure) for e in table.ON_REQUEST}
for of_yaw_rate in ("yaw_damper", "filtered_yaw_damper"):
    del NEW[of_yaw_rate]  # tried in test_lateral_gap.py
# What is trimmed out shows nowhere else.
TRIMMED_OUT = {"wing_twist", "asymmetric_drag"}
TRUE = {
    "roll_damper": {"gain_s": 0.06},
    "interconnect": {"ratio": 0.15},
    "bank_hold": {"gain": 0.12},
    "limited_bank_hold": {"gain": 0.12, "most_rad": 0.012},
    "filtered_roll_damper": {"gain_s": 0.1, "lag_s": 0.08},
    "late_interconnect": {"ratio": 0.4, "lag_s": 0.1},
    "heading_hold": {"gain": 0.15},
    "propeller_torque": {"lever_m": 0.015},
    "p_factor": {"lever_m_rad": 0.3},
    "gyroscopic": {"h_over_Izz_rad_s": 0.15},
    "lateral_cg": {"right_spans": 0.008},
    "side_payload": {"ratio": 0.08, "right_spans": -0.2},
    "asymmetric_lift": {"Cl_alpha": 0.04},
    "lost_wing": {"share": 0.08},
    "lost_fin": {"share": 0.25},
    "lost_tail": {"share": 0.15},
}
# Some five seconds each, of which another effect of the same table stays: a damper with a lag beside one without, ...
LONG = {"filtered_roll_damper", "late_interconnect", "lost_fin", "lost_tail", "side_payload"}
LOOSE = {"lost_fin", "lost_tail", "stall_moment", "asymmetric_stall"}


def values(name: str) -> dict[str, float]:
    return TRUE.get(name) or {p.name: 0.7 * p.starts[0] + 0.3 * (p.none or 0.0) for p in NEW[name].parameters}


@pytest.mark.parametrize("name", NEW)
def test_a_new_effect_that_no_name_calls_for_is_searched_and_the_others_are_known_by_name(name):
    assert (name in EFFECTS) != (name in ON_REQUEST)
    if name in EFFECTS:
        assert NEW[name].lateral, "records of elevator and throttle must not pay for it"


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow) if n in LONG else n
        for n in NEW
        if n not in TRIMMED_OUT | {"stall_moment", "asymmetric_stall"}
    ],
)
def test_a_lateral_effect_is_found_again_at_its_size_in_data_that_it_made(name):
    """Noise-free records, coefficients free: a fiftieth of the gap is left at most, the size is right to 5 %."""
    b, effect = believe(), NEW[name]
    records = recorded(b.with_effect(effect, values(name)), commands())
    start = Point.at(b, b, tuple(records))
    (found,) = fits(b, records, effect)
    assert found is not None
    assert found.chi2 < max(0.02 * start.chi2, 1.0), f"{start.chi2:.4g} to {found.chi2:.4g}: {found.values}"
    if name not in LOOSE:
        check_sizes(found, values(name), 0.05)


def test_an_interconnect_turns_the_rudder_by_its_share_of_the_aileron_command():
    b, record = believe(), commands()[1]
    flown = b.with_effect(NEW["interconnect"], {"ratio": 0.2}).flown(record, ("dr", "da"))
    dr, da = (flown.columns((n,))[:, 0] for n in ("dr", "da"))
    dr, da = dr - dr[0], da - da[0]
    late = slice(round(1.3 * b.rate_hz / 2), round(1.4 * b.rate_hz / 2))  # the servos have settled
    assert dr[late] == pytest.approx(0.2 * da[late], rel=1e-3)


def test_a_roll_damper_damps_and_bank_hold_returns_to_level():
    b, record = believe(), commands()[1]
    p, phi = b.outputs.index("p"), b.outputs.index("phi")
    plain = b.predict(record)
    damped = b.with_effect(NEW["roll_damper"], {"gain_s": 0.1}).predict(record)
    held = b.with_effect(NEW["bank_hold"], {"gain": 0.3}).predict(record)
    assert np.ptp(damped[:, p]) < 0.8 * np.ptp(plain[:, p])
    assert abs(held[-1, phi]) < 0.5 * abs(plain[-1, phi])


def test_torque_and_gyroscopic_moments_are_those_of_the_formulas():
    """Changes of the linear model: L = -lever T, M = -h r, N = h q over the moments of inertia."""
    b = believe()
    at = FlightCondition(15.0, 100.0)

    def linear(name, size):
        aircraft, _ = NEW[name].amend(b.aircraft, b.suite, size)
        return linearise(aircraft, trim(aircraft, at))

    plain = linearise(b.aircraft, trim(b.aircraft, at))
    row, column = plain.states.index, plain.states.index
    mass = b.aircraft.mass
    h = 0.05 * mass.Izz
    spun = linear("gyroscopic", {"h_over_Izz_rad_s": 0.05})
    assert (spun.A - plain.A)[row("q"), column("r")] == pytest.approx(-h / mass.Iyy, rel=1e-3)
    yaw = mass.Izz - mass.Ixz**2 / mass.Ixx
    assert (spun.A - plain.A)[row("r"), column("q")] == pytest.approx(h / yaw, rel=2e-2)
    turned = linear("propeller_torque", {"lever_m": 0.02})
    thrust = plain.B[row("u") if "u" in plain.states else row("V"), plain.inputs.index("thr")]
    roll = mass.Ixx - mass.Ixz**2 / mass.Izz
    expected = -0.02 * thrust * mass.mass_kg / roll
    assert (turned.B - plain.B)[row("p"), plain.inputs.index("thr")] == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize(("name", "control"), [("wing_twist", "da"), ("asymmetric_drag", "dr")])
def test_what_is_trimmed_out_shows_in_the_control_at_trim_alone(name, control):
    b = believe()
    at = FlightCondition(15.0, 100.0)
    effect = NEW[name]
    size = {p.name: p.starts[0] for p in effect.parameters}
    aircraft, _ = effect.amend(b.aircraft, b.suite, size)
    plain, turned = trim(b.aircraft, at).controls, trim(aircraft, at).controls
    moment = ("Cl_da", "Cn_dr")[("da", "dr").index(control)]
    alone = -next(iter(size.values())) / b.aircraft.coefficient(moment)
    assert turned[control] - plain[control] == pytest.approx(alone, rel=0.3)  # the other control takes a part
    record = commands()[0]
    assert np.max(np.abs((b.with_effect(effect, size).predict(record) - b.predict(record)) / b.noise_std)) < 3.0


def test_accelerometers_stay_in_the_airframe_when_its_centre_of_gravity_moves():
    b = believe()
    moved, suite = EFFECTS["lateral_cg"].amend(b.aircraft, b.suite, {"right_spans": 0.1})
    shift = 0.1 * b.aircraft.geometry.b_m
    places = {
        one.channel: (one.position_m, other.position_m)
        for one, other in zip(b.suite.sensors, suite.sensors, strict=True)
    }
    moving = sorted({"ax", "ay", "az"} & set(places))
    assert moving == ["ay", "az"]
    for channel in moving:
        before, after = places[channel]
        assert np.subtract(after, before) == pytest.approx([0.0, -shift, 0.0])
    assert places["q"][0] == places["q"][1]
    assert moved is not b.aircraft
