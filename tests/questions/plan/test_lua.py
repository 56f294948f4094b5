"""The script for ArduPilot, run by Lua 5.3, the version that ArduPilot holds, against a stub of its interface."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lupa.lua53 import LuaError, LuaRuntime

from testbench.core.errors import LimitError
from testbench.flight import linearise
from testbench.questions.plan.injection import injected_signal, lua_script, signal_csv
from testbench.questions.plan.injection.scripts import heap_bytes
from testbench.questions.plan.result import Card, Limit, Point
from testbench.questions.plan.scenario import Autopilot, PlannedManoeuvre

STUB = (Path(__file__).with_name("ardupilot_stub.lua")).read_text(encoding="utf-8")
AUTOPILOT = Autopilot(period_ms=20, hold="all")
INPUTS = {
    "elevator": [{"signal": "3211", "control": "de", "amplitude_deg": 4.0, "step_s": 0.3, "start_s": 0.5}],
    "lateral": [
        {"signal": "doublet", "control": "da", "amplitude_deg": 3.0, "period_s": 1.0},
        {"signal": "doublet", "control": "dr", "amplitude_deg": 5.0, "period_s": 1.0, "start_s": 1.5},
    ],
    "multisine": [
        {
            "signal": "multisine",
            "control": "de",
            "amplitude_deg": 2.0,
            "f_min_hz": 0.5,
            "f_max_hz": 5.0,
            "period_s": 2.0,
            "start_s": 0.5,
        }
    ],
    "throttle": [{"signal": "step", "control": "thr", "amplitude_percent": 10.0, "start_s": 0.5}],
}
SERVOS = {19: (2, 0), 4: (1, 1), 21: (4, 0)}  # function -> (number, reversed)
SIGN = {"de": -1.0, "da": 1.0, "dr": -1.0}
FUNCTION = {"de": 19, "da": 4, "dr": 21}


@pytest.fixture(scope="module")
def point(eolo, eolo_trim):
    return Point(1, 13.0, 547.0, eolo_trim, linearise(eolo, eolo_trim), 100.0, None, (), None)


def card_of(point, which, **changes):
    spec = PlannedManoeuvre.model_validate(
        {"name": which, "duration_s": 4.0, "settle_s": 1.0, "repeats": 1, "input": INPUTS[which]}
    )
    limits = (Limit("V", 9.0, 17.0), Limit("h", 522.0, 572.0), Limit("phi", -0.5, 0.5), Limit("theta", -0.4, 0.6))
    made = {
        "number": 7,
        "point": point,
        "spec": spec,
        "status": "fly",
        "factor": 1.0,
        "met": (),
        "signal": None,
        "expected": None,
        "band": {},
        "limits": limits,
        "repeats": 1,
        "reached": (),
    }
    return Card(**{**made, **changes})


class Bench:
    """A script on the stub, run period by period."""

    def __init__(self, script: str, selected: int = 7, switch: int = 0) -> None:
        self.lua = LuaRuntime(unpack_returned_tuples=True)
        self.lua.execute(STUB)
        self.stub = self.lua.globals().stub
        self.stub.option = 300
        self.stub.switch = switch
        self.stub.params.SCR_USER1 = selected
        for function, (n, is_reversed) in SERVOS.items():
            for key, value in (
                ("FUNCTION", function),
                ("MIN", 1100),
                ("TRIM", 1500),
                ("MAX", 1900),
                ("REVERSED", is_reversed),
            ):
                self.stub.params[f"SERVO{n}_{key}"] = value
            self.stub.pwm[n - 1] = 1500 + 10 * n
        self.update, self.wait = self.lua.execute(script)

    def run(self, seconds: float) -> None:
        for _ in range(round(1000 * seconds / self.wait)):
            self.stub.now += self.wait
            self.update, self.wait = self.update()

    def sent(self) -> np.ndarray:
        """Return (n, 4): time in ms, channel, pwm, timeout."""
        return np.array([list(row.values()) for row in self.stub.sent.values()], float).reshape(-1, 4)

    @property
    def texts(self) -> list[str]:
        return list(self.stub.texts.values())

    def fly(self, seconds: float = 6.0) -> None:
        """Show the switch low, then high."""
        self.run(0.1)
        self.stub.switch = 2
        self.run(seconds)


def test_a_card_s_name_stays_a_comment(point, eolo):
    for name in ("x\nos.execute('touch PWNED') --", "[[ x", "x ]] os.execute('x')", "x\u2028stub.hurt = true"):
        card = card_of(point, "elevator")
        card = replace(card, spec=card.spec.model_copy(update={"name": name}))
        bench = Bench(lua_script(card, eolo, AUTOPILOT))
        bench.fly()
        assert len(bench.sent()) > 0
        assert lua_script(card, eolo, AUTOPILOT).splitlines()[2] == "local CARD = 7"


def test_every_script_is_lua(point, eolo):
    for which in ("elevator", "lateral", "multisine"):
        compiled = LuaRuntime().compile(lua_script(card_of(point, which), eolo, AUTOPILOT))
        assert compiled is not None
    with pytest.raises(LuaError):
        LuaRuntime().compile(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT) + "\nend")


@pytest.mark.parametrize("which", ["elevator", "lateral", "multisine"])
def test_what_is_commanded_is_the_signal_of_the_csv(point, eolo, which):
    card = card_of(point, which)
    rows = list(csv.DictReader(io.StringIO(signal_csv(injected_signal(card, 20), eolo))))
    bench = Bench(lua_script(card, eolo, AUTOPILOT))
    bench.fly()
    sent = bench.sent()
    begun = sent[0, 0]
    assert bench.texts[-1].endswith("done")
    logged = np.array([list(r.values()) for r in bench.stub.logged.values()], float)
    for name, function in FUNCTION.items():
        n, is_reversed = SERVOS[function]
        mine = sent[sent[:, 1] == n - 1]
        t = (mine[:, 0] - begun) / 1000.0 - 1.0
        captured = 1500 + 10 * n
        np.testing.assert_array_equal(mine[t < -1e-9, 2], captured)  # settles at the captured trim
        wanted = np.array([float(r[f"{name}_deg"]) for r in rows])
        per_degree = SIGN[name] * (-1.0 if is_reversed else 1.0) * 400.0 / 25.0
        np.testing.assert_allclose(t[t >= -1e-9], [float(r["time_s"]) for r in rows], atol=1e-9)
        # PWM is whole microseconds: half of one either way
        np.testing.assert_allclose(mine[t >= -1e-9, 2], captured + per_degree * wanted, atol=0.5 + 1e-3)
        column = {"de": 2, "da": 3, "dr": 4}[name]
        np.testing.assert_allclose(logged[logged[:, 1] >= -1e-9, column], wanted, atol=1e-4)
        norm = np.array([float(r[f"{name}_norm"]) for r in rows])
        np.testing.assert_allclose(norm, wanted / 25.0, atol=1e-6)
    assert set(sent[:, 3]) == {60.0}


def test_nothing_moves_before_the_switch_and_a_switch_left_high_starts_nothing(point, eolo):
    script = lua_script(card_of(point, "elevator"), eolo, AUTOPILOT)
    bench = Bench(script)
    bench.run(3.0)
    assert not len(bench.sent())
    bench = Bench(script, switch=2)  # high since before the script was loaded
    bench.run(3.0)
    assert not len(bench.sent())
    bench.stub.switch = 1  # the middle is not high
    bench.run(1.0)
    assert not len(bench.sent())
    bench.stub.switch = 2
    bench.run(0.2)
    assert len(bench.sent())


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("armed", False, "disarmed"),
        ("mode", 10, "wrong flight mode"),
        ("radio", False, "no radio contact"),
        ("eas", None, "no airspeed"),
        ("eas", 15.0, "not at the speed"),
        ("roll", 0.4, "too much bank"),
    ],
)
def test_a_run_starts_only_where_it_may(point, eolo, key, value, text):
    bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT))
    bench.stub[key] = value
    bench.fly()
    assert not len(bench.sent())
    assert text in bench.texts[-1]


def test_another_card_says_and_does_nothing(point, eolo):
    for selected in (0, 8):
        bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT), selected)
        bench.fly()
        assert not len(bench.sent())
        assert len(bench.texts) == 1  # that it is loaded


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("switch", 0, "switch"),
        ("switch", 1, "switch"),
        ("mode", 5, "wrong flight mode"),
        ("armed", False, "disarmed"),
        ("radio", False, "no radio contact"),
        ("eas", 8.5, "airspeed limit"),
        ("eas", 17.5, "airspeed limit"),
        ("eas", float("nan"), "airspeed limit"),
        ("eas2tas", 1.4, "airspeed limit"),
        ("down", -126.0, "height limit"),
        ("down", -74.0, "height limit"),
        ("roll", 0.55, "bank limit"),
        ("pitch", -0.45, "pitch limit"),
        ("roll_us", 1551, "the pilot took the stick"),
        ("pitch_us", 1429, "the pilot took the stick"),
        ("yaw_us", 1561, "the pilot took the stick"),
        ("yaw_us", float("nan"), "the pilot took the stick"),
        ("breaches", 4, "geofence"),
    ],
)
def test_a_run_ends_at_once_and_nothing_is_commanded_any_more(point, eolo, key, value, text):
    bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT))
    bench.fly(2.0)
    before = len(bench.sent())
    assert before
    bench.stub[key] = value
    bench.run(2.0)
    assert len(bench.sent()) == before
    assert "ABORTED, " + text in bench.texts[-1]
    card, seconds, why = bench.stub.ended.values()
    assert (card, why) == (7, "ABORTED, " + text)
    assert 1.9 <= seconds <= 2.1
    if key == "switch":
        return  # low and high again is the next run
    # all well again: it does not go on by itself
    bench.stub[key] = {"switch": 2, "mode": 0, "armed": True, "radio": True, "eas": 13.0, "eas2tas": 1.0,
                       "down": -100.0, "roll": 0.0, "pitch": 0.05, "roll_us": 1500, "pitch_us": 1480, "yaw_us": 1510,
                       "breaches": 0}[key]  # fmt: skip
    bench.run(2.0)
    assert len(bench.sent()) == before
    bench.stub.switch = 0
    bench.fly(1.0)
    assert len(bench.sent()) > before


def test_a_script_takes_no_more_memory_than_is_said(point, eolo):
    """While it is loaded and run, in a Lua of 64 bit numbers; ArduPilot's are of 32."""
    for which in ("elevator", "lateral"):
        script = lua_script(card_of(point, which), eolo, AUTOPILOT)
        lua = LuaRuntime()
        lua.execute(STUB + "collectgarbage('collect'); collectgarbage('stop')")
        before = lua.eval("collectgarbage('count')")
        lua.execute(script)
        assert 1024.0 * (lua.eval("collectgarbage('count')") - before) < heap_bytes(script)


def test_a_hand_that_rests_on_the_stick_ends_nothing(point, eolo):
    """The dead band counts from where the sticks were at the start; older firmware without fence:get_breaches flies."""
    bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT))
    bench.lua.execute("fence = nil")
    bench.stub.pitch_us = 1600
    bench.fly(1.0)
    bench.stub.pitch_us, bench.stub.roll_us = 1649, 1451
    bench.run(6.0)
    assert bench.texts[-1].endswith("done")
    assert list(bench.stub.ended.values())[2] == "done"


def test_no_room_at_a_stop_or_no_such_servo_is_refused_and_not_clipped(point, eolo):
    script = lua_script(card_of(point, "elevator"), eolo, AUTOPILOT)
    bench = Bench(script)
    bench.stub.pwm[1] = 1150  # 4 deg are 64 us: it would have to go to 1086
    bench.fly()
    assert not len(bench.sent())
    assert "no room for the elevator" in bench.texts[-1]
    bench = Bench(script)
    bench.stub.params.SERVO2_FUNCTION = 0
    bench.fly()
    assert not len(bench.sent())
    assert "no servo output for the elevator" in bench.texts[-1]


def test_older_firmware_and_two_ailerons(point, eolo):
    script = lua_script(card_of(point, "lateral"), eolo, AUTOPILOT)
    bench = Bench(script)
    bench.stub.channel_outputs = False
    bench.fly()
    assert bench.texts[-1].endswith("done")
    for firmware in (True, False):
        bench = Bench(script)
        bench.stub.channel_outputs = firmware
        for key, value in (("FUNCTION", 4), ("MIN", 1000), ("TRIM", 1500), ("MAX", 2000), ("REVERSED", 0)):
            bench.stub.params[f"SERVO5_{key}"] = value
        bench.stub.pwm[4] = 1480
        bench.fly()
        sent = bench.sent()
        if firmware:  # both move, in opposite directions of PWM, by their own travel
            first, second = sent[sent[:, 1] == 0, 2] - 1510, sent[sent[:, 1] == 4, 2] - 1480
            assert (first.min(), first.max()) == (-48.0, 48.0)
            np.testing.assert_allclose(second, -first * 1000.0 / 800.0, atol=0.6)
        else:
            assert not len(sent)
            assert "cannot read the aileron" in bench.texts[-1]


def test_an_error_inside_releases_the_surfaces(point, eolo):
    bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT))
    bench.fly(2.0)
    before = len(bench.sent())
    bench.lua.execute("function logger:write() error('card full') end")
    bench.run(2.0)
    assert len(bench.sent()) <= before + 3  # the tick that fails has commanded its three surfaces
    assert any("card full" in text for text in bench.texts)


def test_only_what_moves_is_held_if_wanted(point, eolo):
    bench = Bench(lua_script(card_of(point, "elevator"), eolo, AUTOPILOT.model_copy(update={"hold": "moved"})))
    bench.fly()
    assert set(bench.sent()[:, 1]) == {1.0}


def test_throttle_and_refused_cards_have_no_script(point, eolo):
    with pytest.raises(LimitError, match="throttle"):
        lua_script(card_of(point, "throttle"), eolo, AUTOPILOT)
    with pytest.raises(LimitError, match="refused"):
        lua_script(card_of(point, "elevator", status="refused", factor=0.0), eolo, AUTOPILOT)
    text = signal_csv(injected_signal(card_of(point, "throttle"), 20), eolo)
    last = list(csv.DictReader(io.StringIO(text)))[-1]
    assert (float(last["thr_percent"]), float(last["thr_norm"])) == (10.0, 0.1)
