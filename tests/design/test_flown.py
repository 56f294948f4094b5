"""Designs in the nonlinear simulator: what breaks a limit is scaled back and said, what has room is scaled up."""

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError
from testbench.core.paths import SCENARIOS
from testbench.core.record import FlightRecord
from testbench.core.scenario.air import AirSpec
from testbench.core.scenario.inputs import Doublet
from testbench.design.amplitude import Ensemble
from testbench.design.candidates import Candidate, sampled
from testbench.design.ensemble import Member, Placed
from testbench.design.limits import Limits, limit_words
from testbench.design.problem import Screened, design_of
from testbench.design.realise import Range
from testbench.evaluation.modes import modes_of
from testbench.flight import linearise
from testbench.questions.design.pose import problem_of
from testbench.questions.design.scenario import DesignScenario
from testbench.sensors import load_suite


def fly_one(aircraft, trimmed, problem, one):
    member = Member(aircraft, trimmed, problem.prediction.model, {}, problem)
    (flown,) = Ensemble(Range(member, None, None, AirSpec(), 100.0, 0)).started([one])
    return flown


@pytest.fixture(scope="module")
def taurus_problem(taurus, taurus_trim):
    scenario = DesignScenario.load(SCENARIOS / "design" / "taurus_short_period.toml")
    scenario = scenario.model_copy(update={"duration_s": 10.0})
    linear = linearise(taurus, taurus_trim)
    modes = modes_of(linear, taurus, "longitudinal")
    suite = load_suite("taurus_8hz")

    def make(limits):
        return problem_of(scenario, Placed(taurus, taurus_trim, linear, modes), suite, limits)

    return make


def design(problem, degrees, period_s=4.0):
    spec = Doublet(signal="doublet", control="de", amplitude_deg=degrees, period_s=period_s, start_s=2.0)
    u = sampled([spec], ("de",), problem.duration_s, problem.rate_hz)
    return design_of(problem, Screened(0.0, Candidate("doublet", "", (spec,), u), 1.0, "V"))


def limits(**changes):
    base = {"deflection": {"de": 12.5 * DEG_RAD}, "rate": {}, "speed_change_m_s": 2.0}
    return Limits(**{**base, **changes})


def test_what_breaks_a_limit_is_named_with_its_moment_and_scaled_back(taurus, taurus_trim, taurus_problem):
    p = taurus_problem(limits())
    d = design(p, 3.0)
    flown = fly_one(taurus, taurus_trim, p, d)
    assert flown.breach.startswith("V passes ")
    assert " at t = " in flown.breach
    assert flown.admissible
    assert flown.factor < 1.0
    assert 0.9 < flown.tightest.share <= 1.0
    assert np.abs(flown.record["V"] - 12.0).max() <= 2.0
    np.testing.assert_allclose(flown.design.errors, d.errors / flown.factor, rtol=1e-3)


def test_what_has_room_is_scaled_up_but_not_beyond_the_surface(taurus, taurus_trim, taurus_problem):
    p = taurus_problem(limits())
    flown = fly_one(taurus, taurus_trim, p, design(p, 0.5))
    assert flown.breach == ""
    assert 1.2 < flown.factor <= 1.5 + 1e-6
    at_trim = taurus_trim.controls["de"] / DEG_RAD
    narrow = limits(deflection={"de": (abs(at_trim) + 1.0) * DEG_RAD})
    p = taurus_problem(narrow)
    flown = fly_one(taurus, taurus_trim, p, design(p, 0.9))
    assert flown.admissible
    assert np.degrees(flown.design.peak[0]) <= 1.0 + 1e-4


def test_a_flight_out_of_the_aircrafts_limits_says_so(taurus, taurus_trim, taurus_problem):
    wild = limits(speed_change_m_s=4.9)
    p = taurus_problem(wild)
    flown = fly_one(taurus, taurus_trim, p, design(p, 4.0, 6.0))
    assert "leaves the aircraft's limits at t = " in flown.breach or "passes" in flown.breach
    assert flown.factor < 1.0


def test_rates_are_those_of_the_servo(taurus_problem):
    fast = limits(rate={"de": 40.0 * DEG_RAD})
    p = taurus_problem(fast)
    e = p.envelope
    lag, most = e.rates["de"]
    t = np.arange(3) / 10.0
    data = np.array([[0.0, 0.0, 12.0], [0.1, 0.0, 12.0], [0.1, 0.05, 12.0]])
    record = FlightRecord(t, ("de_cmd", "de", "V"), data, "truth")
    assert e.tightest(record).name == "rate of de"
    assert e.tightest(record).share == pytest.approx(0.1 * lag / most)
    assert e.tightest(record).t_s == pytest.approx(0.1)
    assert "the rate of de passes 40 deg/s at t = 0.10 s" in e.broken(record)[0]
    names = p.prediction.names
    assert {"rate of de", "command of de", "de", "V"} <= set(names)
    factor, limit = p.prediction.largest_factor(design(p, 1.0).u)
    assert limit == "rate of de"
    assert factor * lag * DEG_RAD * 2.0 == pytest.approx(40.0 * DEG_RAD, rel=0.05)  # the middle edge jumps by 2 deg


def test_words_of_limits():
    assert limit_words("az") == "the load factor"
    assert limit_words("rate of de") == "the rate of elevator deflection"
    assert limit_words("V") == "the true airspeed"


def test_trim_outside_a_limit_is_refused(taurus_problem):
    with pytest.raises(LimitError, match="trim must lie inside the limits on alpha"):
        taurus_problem(limits(alpha=(-2.0 * DEG_RAD, -1.0 * DEG_RAD)))
    with pytest.raises(LimitError, match="no room inside the limit on de"):
        taurus_problem(limits(deflection={"de": 0.1 * DEG_RAD}))


def test_the_command_may_not_leave_the_surface_even_if_the_servo_is_too_slow_to_follow(taurus_problem):
    p = taurus_problem(limits(speed_change_m_s=1e6))
    d = design(p, 1.0, 0.1)
    factor, limit = p.prediction.largest_factor(d.u)
    assert limit == "command of de"
    room = -float(p.prediction.low[p.prediction.names.index(limit)])  # trim is up elevator: the nearer end
    assert factor * DEG_RAD == pytest.approx(room, rel=1e-6)
