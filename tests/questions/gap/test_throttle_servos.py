"""Effects between the throttle command and the engine: flown as their laws say, and found again at their size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from axes import believe, commands
from gap_fits import check_sizes, fits
from studies.blind.servos import backlash

from testbench.aircraft import Aircraft
from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS, OTHER_SERVOS, SERVOS, left_out, library
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.flight.batch.check import TOLERANCE, difference
from testbench.flight.batch.fly import Job, Tally, fly_block
from testbench.flight.batch.model import batch_model
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.effect_contract import OF_AIRCRAFT, OF_WORDS, Trial, recorded
from testbench.questions.gap.search.point import Point
from testbench.sensors import load_suite

CONDITIONS = {
    "taurus": FlightCondition(15.0, 100.0),
    "eolo": FlightCondition(16.0, 547.0),
    "jsbsim:c172p": FlightCondition(50.0, 1000.0),
    "jsbsim:737": FlightCondition(150.0, 3000.0),
}
OWN = {e.name: e for (_, control), e in SERVOS.items() if control == "thr" and e.name in OTHER_SERVOS}
TRUE = {
    "throttle_rate_limit": {"limit_1_s": 0.08},
    "throttle_asymmetric_rate_limit": {"rise_1_s": 0.06, "fall_1_s": 0.15},
    "throttle_free_play": {"width": 0.06},
    "throttle_dead_band": {"half_width": 0.03, "lag_s": 0.4},
    "throttle_curved_linkage": {"scale": 0.8, "loss": 6.0},
}
SUITE = load_suite("eolo_gap")


def slewed(u: np.ndarray, dt_s: float, fall: float, rise: float) -> np.ndarray:
    y = [u[0]]
    for c in u:
        y.append(y[-1] + np.clip(c - y[-1], -fall * dt_s, rise * dt_s))
    return np.array(y[1:])


def reluctant(u: np.ndarray, dt_s: float, half: float, lag: float) -> np.ndarray:
    y = [u[0]]
    for c in u:
        beyond = np.sign(c - y[-1]) * max(abs(c - y[-1]) - half, 0.0)
        y.append(y[-1] + (1.0 - np.exp(-dt_s / lag)) * beyond)
    return np.array(y[1:])


# what the engine is told, frame by frame, by another hand
LAWS: dict[str, Callable[[np.ndarray, float], np.ndarray]] = {
    "throttle_rate_limit": lambda u, dt: slewed(u, dt, 0.08, 0.08),
    "throttle_asymmetric_rate_limit": lambda u, dt: slewed(u, dt, 0.15, 0.06),
    "throttle_free_play": backlash(0.06),
    "throttle_dead_band": lambda u, dt: reluctant(u, dt, 0.03, 0.4),
    "throttle_curved_linkage": lambda u, dt: 0.8 * u / np.sqrt(1.0 + 12.0 * u**2),
}


@cache
def loaded(name: str) -> Aircraft:
    aircraft = load_aircraft(name, "rigid") if not name.startswith("jsbsim") else load_aircraft(name)
    return replace(aircraft, limits={})


def steps(seconds: float, dt_s: float) -> np.ndarray:
    """Return throttle steps of two sizes and both signs, and a wave of half a play, as deviations from trim."""
    t = np.arange(round(seconds / dt_s)) * dt_s
    u = 0.15 * ((t > 0.3) & (t < 1.2)) - 0.1 * ((t >= 1.2) & (t < 2.0)) + 0.04 * ((t >= 2.5) & (t < 3.0))
    return u + 0.02 * np.sin(2.0 * np.pi * 1.5 * t) * (t > 3.0)


def flown(aircraft: Aircraft, name: str, u: np.ndarray) -> FlightRecord:
    trimmed = trim(aircraft, CONDITIONS[name])
    t = np.arange(len(u)) / trimmed.rate_hz
    return fly(aircraft, trimmed, Manoeuvre("steps", InputSignal(t, u[:, None], ("thr",)), 0.0), trimmed.rate_hz)


@pytest.mark.parametrize("aircraft", CONDITIONS)
@pytest.mark.parametrize("name", LAWS)
def test_the_engine_is_told_what_the_law_makes_of_the_command(name, aircraft):
    """The flight with the effect is that without it of the command that its law makes, and not that of the command."""
    plain = loaded(aircraft)
    amended = OWN[name].amend(plain, SUITE, TRUE[name])[0]
    dt = 1.0 / trim(plain, CONDITIONS[aircraft]).rate_hz
    u = steps(4.0, dt)
    got = flown(amended, aircraft, u)
    right, other = (flown(plain, aircraft, x) for x in (LAWS[name](u, dt), u))
    channels = [n for n in ("V", "alpha", "q", "theta", "h") if n in got]
    away = np.max(np.abs(got.columns(channels) - right.columns(channels)), axis=0)
    moved = np.max(np.abs(got.columns(channels) - other.columns(channels)), axis=0)
    assert moved[0] > 1e-3
    assert np.all(away < 1e-6 * np.maximum(moved, 1e-3)), dict(zip(channels, away, strict=True))


@pytest.mark.parametrize("aircraft", ["taurus", "jsbsim:c172p"])
@pytest.mark.parametrize("name", LAWS)
def test_it_flies_in_a_batch_as_in_jsbsim(name, aircraft):
    amended = OWN[name].amend(loaded(aircraft), SUITE, TRUE[name])[0]
    trimmed = trim(amended, CONDITIONS[aircraft])
    u = steps(4.0, 1.0 / trimmed.rate_hz)
    signal = InputSignal(np.arange(len(u)) / trimmed.rate_hz, u[:, None], ("thr",))
    job = Job(amended, trimmed, Manoeuvre("steps", signal, 0.0), trimmed.rate_hz)
    truth = fly(amended, trimmed, job.manoeuvre, job.log_rate_hz)
    model = batch_model(amended, trimmed.rate_hz, CONDITIONS[aircraft])
    assert difference(fly_block([job], [model], Tally())[0], truth)[0] <= TOLERANCE


@pytest.mark.parametrize("law", [*OF_WORDS, *OF_AIRCRAFT], ids=lambda law: law.__name__)
@pytest.mark.parametrize("name", OWN)
def test_it_keeps_the_laws_of_effects(name, law):
    effect = OWN[name]
    assert law(Trial(effect)) is None
    assert effect.place == "thrust"
    assert not effect.lateral


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n == "throttle_asymmetric_rate_limit" else n for n in TRUE]
)
def test_it_is_found_again_in_data_that_it_made(name):
    """From noise-free records, nuisances free: no more than a fiftieth of the gap is left, its size to 5 %."""
    b, effect = believe(), OWN[name]
    t = np.arange(600) / 50.0
    thr = np.interp(t, np.arange(600) / 50.0, np.concatenate([np.zeros(50), steps(11.0, 0.02)]))
    thr = thr + 0.12 * ((t > 8.0) & (t < 9.5)) - 0.12 * ((t >= 9.5) & (t < 11.0))
    none = np.zeros_like(t)
    data = np.column_stack([none, none, none, thr])
    channels = ("de_cmd", "da_cmd", "dr_cmd", "thr_cmd")
    throttle = FlightRecord(t_s=t, channels=channels, data=data, kind="measured")
    records = recorded(b.with_effect(effect, TRUE[name]), (throttle, commands()[2]))
    start = Point.at(b, b, tuple(records))
    (found,) = fits(b, records, effect)
    assert found is not None
    assert found.chi2 < max(0.02 * start.chi2, 1.0), f"{start.chi2:.4g} to {found.chi2:.4g}: {found.values}"
    check_sizes(found, TRUE[name], 0.05)


def test_a_quick_servo_with_a_dead_band_is_a_play_of_twice_its_half_width():
    """So the play, which is simpler, is what is named. The servo's shortest lag is not quite none over a sample."""
    b, record = believe(), commands()[2]
    play = b.with_effect(OWN["throttle_free_play"], {"width": 0.06})
    band = b.with_effect(OWN["throttle_dead_band"], {"half_width": 0.03, "lag_s": 0.0})
    assert band.predict(record) == pytest.approx(play.predict(record), abs=1e-5)
    assert "throttle_free_play" in OWN["throttle_dead_band"].contains


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("true", "other"), [("throttle_scale", "thrust_scale"), ("thrust_scale", "throttle_scale")])
def test_a_linkage_of_another_ratio_is_told_from_a_stronger_engine_where_thrust_is_no_line_over_throttle(true, other):
    """A 737's engines turn slower in trim if they are stronger, where a step of the throttle gives less. Noise-free."""
    suite = replace(load_suite("eolo_gap"), rate_hz=50.0)
    b = Believed(load_aircraft("jsbsim:737"), suite, FlightCondition(130.0, 2000.0), 100.0)
    t = np.arange(800) / 50.0
    thr = 0.2 * ((t > 1.0) & (t < 5.0)) - 0.2 * ((t >= 5.0) & (t < 9.0)) + 0.1 * ((t > 11.0) & (t < 14.0))
    data = np.column_stack([np.zeros_like(t), thr])
    commanded = FlightRecord(t_s=t, channels=("de_cmd", "thr_cmd"), data=data, kind="measured")
    records = recorded(b.with_effect(EFFECTS[true], {"scale": 1.4}), (commanded,))
    start = Point.at(b, b, records)
    found, mistaken = fits(b, records, EFFECTS[true], EFFECTS[other])
    assert found.values["scale"] == pytest.approx(1.4, rel=0.02)
    assert found.chi2 < 0.02 * start.chi2
    assert mistaken.chi2 > 3.0 * found.chi2
    assert abs(mistaken.values["scale"] - 1.4) > 0.15


def test_a_linkage_of_another_ratio_is_a_scale_of_the_thrust_where_thrust_is_proportional_to_the_throttle():
    why = left_out({"throttle_scale": EFFECTS["throttle_scale"]}, loaded("taurus"), SUITE)
    assert "thrust_scale" in why["throttle_scale"]
    assert "throttle_scale" not in library(SUITE, loaded("taurus"))
    assert "throttle_scale" in library(SUITE, loaded("jsbsim:c172p"))
