"""Every effect of the library on a packaged and on two stock aircraft: it applies, flies, vanishes and shows.

The packaged one is in the testbench's own form, c172p has a propeller and no servo, the F-16 a servo and a jet.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from testbench.aircraft import Aircraft
from testbench.core.errors import ModelError
from testbench.core.record import FlightRecord, FloatArray
from testbench.effects import EFFECTS, ON_REQUEST, Effect, library
from testbench.flight import FlightCondition, Manoeuvre, TrimmedFlight, fly, linearise, load_aircraft, trim
from testbench.inputs.signal import InputSignal
from testbench.sensors import load_suite

AIRCRAFT = ("taurus", "jsbsim:c172p", "jsbsim:f16")
ONE_EACH = pytest.mark.sampled(len(AIRCRAFT))  # an effect on one of them, the next effect on the next
SUITE = load_suite("eolo_full")
SECONDS = 2.0
SENSED = tuple(n for n in EFFECTS if EFFECTS[n].place.endswith(" sensor"))
OF_THE_AIR = ("steady_wind", "gust", "clock_offset", "air_density", *SENSED)  # they leave the aircraft as it is
OF_AIRCRAFT = {n: e for n, e in (EFFECTS | ON_REQUEST).items() if n not in OF_THE_AIR}
CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "theta", "phi", "ax", "ay", "az", "de", "da", "dr", "h")
# What an effect moves is seen in; a place not listed moves the pitch rate.
SEEN = {"thrust": "V", "drag": "V", "lift": "az", "mass": "az", "air": "az", "aileron": "p", "rudder": "r"}
SEEN |= {"wing": "p", "fin": "r", "gyroscopic": "q"}
# Else two of the three do not trim, or what two seconds move is lost in rounding.
SIZES = {n: {"alpha_rad": 0.3} for n in ("stall", "stall_hysteresis", "stall_moment", "asymmetric_stall")}
SIZES["asymmetric_stall"] |= {"Cl": 0.3}
SIZES |= {"cubic_weathercock": {"Cn_beta3": 50.0}, "cubic_dihedral": {"Cl_beta3": 25.0}, "lost_wing": {"share": 0.03}}
SLACK = 1e-9
IN_COMMAND = {n for n in OF_AIRCRAFT if n.endswith("surface_offset")}  # what is trimmed out shows nowhere else


@dataclass(frozen=True, eq=False)
class Case:
    """An aircraft with wide limits, in its design condition, and its flight of doublets on all controls."""

    aircraft: Aircraft
    trimmed: TrimmedFlight
    flown: FlightRecord

    def moved(self, aircraft: Aircraft) -> FloatArray:
        """Return how far (n, channels) the flight of an amended aircraft is from that of the plain one."""
        trimmed = trim(aircraft, self.trimmed.condition)
        flight = fly(aircraft, trimmed, doublets(aircraft), aircraft.rate_hz)
        return flight.columns(CHANNELS) - self.flown.columns(CHANNELS)


def doublets(aircraft: Aircraft) -> Manoeuvre:
    """Return a doublet on every control at once."""
    n = round(SECONDS * aircraft.rate_hz)
    t = np.arange(n) / aircraft.rate_hz
    names = tuple(aircraft.controls)
    up, down = (t > 0.1) & (t < 0.5), (t >= 0.5) & (t < 0.9)
    u = np.column_stack([(0.1 if c == "thr" else 0.03) * (1.0 * up - 1.0 * down) for c in names])
    return Manoeuvre("doublets", InputSignal(t, u, names), 0.0)


@cache
def case(name: str) -> Case:
    aircraft = load_aircraft(name)
    wide = {"V": (1.0, 1e3), "alpha": (-1.5, 1.5), "beta": (-1.5, 1.5), "theta": (-1.5, 1.5), "phi": (-3.2, 3.2)}
    aircraft = replace(aircraft, limits={**aircraft.limits, **wide, "h": (-1e3, 1e5)})
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    return Case(aircraft, trimmed, fly(aircraft, trimmed, doublets(aircraft), aircraft.rate_hz))


def usual(effect: Effect) -> dict[str, float]:
    return {p.name: p.starts[0] for p in effect.parameters} | SIZES.get(effect.name, {})


@ONE_EACH
@pytest.mark.parametrize("aircraft", AIRCRAFT)
@pytest.mark.parametrize("name", OF_AIRCRAFT)
def test_an_effect_flies_and_shows_where_it_should(name, aircraft):
    """At its start, in two seconds of doublets; the linear model about its trim has finite numbers."""
    here, effect = case(aircraft), OF_AIRCRAFT[name]
    amended, _ = effect.amend(here.aircraft, SUITE, usual(effect))
    if name == "ground_effect":
        amended, here = near_the_ground(effect, here)
    moved = np.max(np.abs(here.moved(amended)), axis=0)
    assert np.isfinite(moved).all()
    if name in IN_COMMAND:
        control = {"elevator": "de", "aileron": "da", "rudder": "dr"}[effect.place]
        at = here.trimmed.condition
        difference = trim(amended, at).controls[control] - here.trimmed.controls[control]
        assert difference == pytest.approx(-usual(effect)["offset_rad"], abs=1e-6)
    else:
        channel = SEEN.get(name, SEEN.get(effect.place, "q"))
        assert moved[CHANNELS.index(channel)] > 1e-5, f"{channel} moves by {moved[CHANNELS.index(channel)]:.2g}"
    linear = linearise(amended, trim(amended, here.trimmed.condition))
    assert np.isfinite(linear.A).all()
    assert np.isfinite(linear.B).all()


def near_the_ground(effect: Effect, here: Case) -> tuple[Aircraft, Case]:
    """Return the aircraft with the effect, and the case, a quarter of the span above the ground."""
    at = FlightCondition(here.aircraft.design_V_m_s, 0.25 * here.aircraft.geometry.b_m)
    trimmed = trim(here.aircraft, at)
    low = Case(here.aircraft, trimmed, fly(here.aircraft, trimmed, doublets(here.aircraft), here.aircraft.rate_hz))
    return effect.amend(here.aircraft, SUITE, usual(effect))[0], low


@ONE_EACH
@pytest.mark.parametrize("aircraft", AIRCRAFT)
@pytest.mark.parametrize("name", [n for n, e in OF_AIRCRAFT.items() if any(p.none is not None for p in e.parameters)])
def test_an_effect_without_size_changes_nothing(name, aircraft):
    here, effect = case(aircraft), OF_AIRCRAFT[name]
    none = {p.name: p.starts[0] if p.none is None else p.none for p in effect.parameters}
    amended, suite = effect.amend(here.aircraft, SUITE, none)
    assert np.max(np.abs(here.moved(amended))) < SLACK
    if not name.startswith(("payload", "cg_shift", "lateral_cg")):
        assert suite == SUITE


@pytest.mark.parametrize("aircraft", AIRCRAFT)
@pytest.mark.parametrize("name", OF_THE_AIR)
def test_what_is_of_sensors_or_the_air_leaves_the_aircraft(name, aircraft):
    here, effect = case(aircraft).aircraft, library(SUITE).get(name, EFFECTS[name])
    amended, suite = effect.amend(here, SUITE, usual(effect))
    assert amended is here
    assert suite != SUITE or name == "gust" or effect.place.split()[0] not in SUITE.channels


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("slipstream", "SGS has no engine"),
        ("thrust_lag", "SGS has no engine"),
        ("thrust_line", "SGS has no engine"),
        ("throttle_transport_delay", "SGS has no engine"),
    ],
)
def test_an_effect_that_an_aircraft_cannot_have_says_so(name, words):
    glider, effect = load_aircraft("jsbsim:SGS"), OF_AIRCRAFT[name]
    with pytest.raises(ModelError, match=words):
        effect.amend(glider, SUITE, usual(effect))
    assert name not in library(SUITE, glider)


def test_a_glider_keeps_all_other_effects():
    glider = load_aircraft("jsbsim:SGS")
    missing = set(library(SUITE)) - set(library(SUITE, glider))
    assert missing == {n for n, e in EFFECTS.items() if e.place == "thrust"}


def test_a_control_that_is_not_there_is_named():
    taurus = load_aircraft("taurus")
    without = replace(taurus, controls={n: c for n, c in taurus.controls.items() if n != "dr"})
    with pytest.raises(ModelError, match="taurus has no rudder"):
        EFFECTS["rudder_lag"].amend(without, SUITE, usual(EFFECTS["rudder_lag"]))
