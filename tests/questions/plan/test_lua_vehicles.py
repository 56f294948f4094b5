"""The script on vehicles of all kinds: mixed controls by SERVOn_FUNCTION, and a vehicle that fails at every frame."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_lua import Bench, card_of

from testbench.aircraft.model import Control
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.flight import linearise
from testbench.questions.plan.injection import lua_script
from testbench.questions.plan.injection.scripts import lift_curve, watched_limits
from testbench.questions.plan.result import Limit, Point
from testbench.questions.plan.scenario import Autopilot

AUTOPILOT = Autopilot(period_ms=20)
PERIOD_MS = 20
# what the mixers of ArduPlane make of demands of elevator e, aileron a, rudder r in whole throws
MIXERS = {
    "elevons": {77: lambda e, a, r: e - a, 78: lambda e, a, r: e + a},
    "V-tail": {79: lambda e, a, r: e + r, 80: lambda e, a, r: e - r, 4: lambda e, a, r: a},
    "flaperons": {24: lambda e, a, r: a, 25: lambda e, a, r: a, 19: lambda e, a, r: e, 21: lambda e, a, r: r},
}


@pytest.fixture(scope="module")
def point(eolo, eolo_trim):
    return Point(1, 13.0, 547.0, eolo_trim, linearise(eolo, eolo_trim), 100.0, None, (), None)


def with_limits(point, which):
    """A card with limits on all that a script watches."""
    limits = (
        Limit("V", 9.0, 17.0),
        Limit("h", 522.0, 572.0),
        Limit("phi", -0.5, 0.5),
        Limit("theta", -0.4, 0.6),
        Limit("az", -2.0 * G0_M_S2, 0.0),
        Limit("alpha", -10.0 * DEG_RAD, 13.0 * DEG_RAD),
    )
    return card_of(point, which, limits=limits)


def bench_of(script, functions, ends=(1100.0, 1500.0, 1900.0), turned=()):
    bench = Bench(script)
    for n in (1, 2, 4):
        bench.stub.params[f"SERVO{n}_FUNCTION"] = 0
    for n, function in enumerate(functions, 1):
        for key, value in zip(("FUNCTION", "MIN", "TRIM", "MAX"), (function, *ends), strict=True):
            bench.stub.params[f"SERVO{n}_{key}"] = value
        bench.stub.params[f"SERVO{n}_REVERSED"] = int(function in turned)
        bench.stub.pwm[n - 1] = ends[1]
    return bench


@pytest.mark.parametrize("kind", list(MIXERS))
@pytest.mark.parametrize("which", ["elevator", "lateral"])
def test_mixed_controls_move_as_the_mixer_of_the_autopilot_moves_them(point, eolo, kind, which):
    functions = list(MIXERS[kind])
    card = card_of(point, which)
    if kind == "elevons" and which == "lateral":  # no rudder on a flying wing
        card = replace(card, spec=card.spec.model_copy(update={"input": card.spec.input[:1]}))
    bench = bench_of(lua_script(card, eolo, AUTOPILOT), functions, turned=functions[1:2])
    bench.fly()
    assert bench.texts[-1].endswith("done")
    sent = bench.sent()
    logged = np.array([list(r.values()) for r in bench.stub.logged.values()], float)
    demands = -logged[:, 2] / 25.0, logged[:, 3] / 25.0, -logged[:, 4] / 25.0
    assert max(np.abs(d).max() for d in demands) > 0.1
    moved = set()
    for n, function in enumerate(functions, 1):
        share = MIXERS[kind][function](*demands)
        mine = sent[sent[:, 1] == n - 1, 2]
        if not len(mine):
            assert not np.any(share)
            continue
        moved.add(function)
        sign = -1.0 if function in functions[1:2] else 1.0
        np.testing.assert_allclose(mine, 1500.0 + 400.0 * sign * share, atol=0.51)
    assert moved == {f for f in functions if np.any(MIXERS[kind][f](*demands))}


def test_pulses_count_from_the_trim_of_the_servo_and_the_throw_of_each_side(point, eolo):
    """One side of the servo is longer, and one side of the elevator: the deflection is still that of the card."""
    full, low = 20.0, -30.0
    uneven = replace(eolo, controls={**eolo.controls, "de": Control("de", "x", full * DEG_RAD, low * DEG_RAD)})
    bench = bench_of(lua_script(card_of(point, "elevator"), uneven, AUTOPILOT), [19], (1000.0, 1400.0, 2000.0))
    bench.stub.pwm[0] = 1460.0  # nose up by a tenth: -3 deg
    bench.fly()
    assert bench.texts[-1].endswith("done")
    sent = bench.sent()
    logged = np.array([list(r.values()) for r in bench.stub.logged.values()], float)
    degrees = -3.0 + logged[:, 2]
    share = np.where(degrees >= 0.0, -degrees / full, degrees / low)
    pulse = 1400.0 + share * np.where(share >= 0.0, 600.0, 400.0)
    np.testing.assert_allclose(sent[:, 2], pulse, atol=0.51)
    assert degrees.max() > 0.5  # both sides are met
    assert degrees.min() < -6.0


def test_servos_that_the_card_does_not_use_are_left_alone(point, eolo):
    bench = bench_of(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT), [19, 4, 21, 70])
    bench.fly()
    assert set(bench.sent()[:, 1]) == {0.0}
    # all of them held: those that there are
    bench = bench_of(
        lua_script(card_of(point, "elevator"), eolo, AUTOPILOT.model_copy(update={"hold": "all"})), [19, 4]
    )
    bench.fly()
    assert set(bench.sent()[:, 1]) == {0.0, 1.0}


def test_what_the_script_cannot_move_rightly_is_refused(point, eolo):
    script = lua_script(card_of(point, "elevator"), eolo, AUTOPILOT)
    for functions, ends, text in (
        ([16, 17, 86, 87], (1100.0, 1500.0, 1900.0), "split elevons"),
        ([19], (1100.0, 1100.0, 1900.0), "TRIM is not between"),
        ([4, 21], (1100.0, 1500.0, 1900.0), "no servo output for the elevator"),
        ([77, 78], (1490.0, 1500.0, 1510.0), None),
    ):
        bench = bench_of(script, functions, ends)
        if text is None:
            bench.stub.pwm[0] = 1509.0
            text = "no room for the elevator"
        bench.fly()
        assert not len(bench.sent())
        assert text in bench.texts[-1]


FAULTS = {
    "switch": {"switch": 0},
    "mode switched": {"mode": 5},
    "disarmed": {"armed": False},
    "link lost": {"radio": False},
    "no airspeed": {"eas": None},
    "airspeed is no number": {"eas": math.nan},
    "too slow": {"eas": 8.9},
    "too fast": {"eas": 17.1},
    "too high": {"down": -125.1},
    "height is no number": {"down": math.nan},
    "bank": {"roll": -0.51},
    "bank is no number": {"roll": math.nan},
    "pitch": {"pitch": 0.61},
    "pitch is no number": {"pitch": math.nan},
    "load factor": {"az": -2.01 * G0_M_S2},
    "pushed": {"az": 0.1},
    "load factor is no number": {"az": math.nan},
    "infinite": {"eas": math.inf},
}


@pytest.mark.parametrize("fault", list(FAULTS))
def test_controls_return_within_one_frame_whenever_it_fails(point, eolo, fault):
    """The vehicle fails at every tenth frame of the run in turn, the first and the last included."""
    script = lua_script(with_limits(point, "elevator"), eolo, AUTOPILOT)
    frames = round(1000 * (1.0 + 4.0) / PERIOD_MS)
    for k in [*range(1, frames, 10), frames - 1]:
        bench = Bench(script)
        bench.run(0.1)
        bench.stub.switch = 2
        bench.run(k * PERIOD_MS / 1000)
        before = len(bench.sent())
        assert before == k
        for key, value in FAULTS[fault].items():
            bench.stub[key] = value
        bench.run(10 * PERIOD_MS / 1000)
        assert len(bench.sent()) == before  # nothing is commanded any more, not even in the frame of the fault
        assert "ABORTED" in bench.texts[-1]
    assert set(bench.sent()[:, 3]) == {3.0 * PERIOD_MS}  # and what was commanded lapses


@pytest.mark.parametrize("fault", [f for f in FAULTS if "no number" in f or f == "infinite"])
def test_a_run_does_not_start_on_what_is_no_number(point, eolo, fault):
    bench = Bench(lua_script(with_limits(point, "elevator"), eolo, AUTOPILOT))
    for key, value in FAULTS[fault].items():
        bench.stub[key] = value
    bench.fly(1.0)
    assert not len(bench.sent())


def test_a_script_that_is_called_too_seldom_ends(point, eolo):
    bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT))
    bench.fly(2.0)
    before = len(bench.sent())
    bench.stub.now += 5 * PERIOD_MS
    bench.run(1.0)
    assert len(bench.sent()) == before
    assert "scripting is too slow" in bench.texts[-1]


def test_alpha_is_watched_by_the_lift_curve(point, eolo):
    """A pull at constant speed: the limit on alpha ends the run at the load factor that linear lift gives it."""
    card = with_limits(point, "elevator")
    card = replace(card, limits=(*card.limits[:-1], Limit("alpha", -10.0 * DEG_RAD, 8.0 * DEG_RAD)))
    alpha, load, slope = lift_curve(card)
    assert 0.05 < slope < 0.3
    at = load + slope * (8.0 - alpha)
    assert at < 2.0  # the load factor itself is inside
    for n, ends in ((at - 0.01, False), (at + 0.01, True)):
        bench = Bench(lua_script(card, eolo, AUTOPILOT))
        bench.fly(0.5)
        bench.stub.az = -n * G0_M_S2
        bench.run(0.2)
        assert ("alpha limit" in bench.texts[-1]) == ends


def test_a_limit_is_in_the_script_or_not_claimed_to_be(point, eolo):
    card = replace(with_limits(point, "elevator"), limits=(Limit("V", 9.0, math.inf), Limit("beta", -0.1, 0.1)))
    assert list(watched_limits(card)) == ["airspeed"]
    script = lua_script(card, eolo, AUTOPILOT)
    assert "['bank']" not in script
    assert "inf" not in script.split("SURFACES")[0].split("LIMITS")[1]
