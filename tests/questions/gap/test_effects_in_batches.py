"""Every effect of the library flies in batches as JSBSim flies it, on a model aircraft, a glider and a bomber."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from testbench.core.errors import Refusal
from testbench.effects import library
from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, linearise_along, load_aircraft, trim
from testbench.flight.batch.check import TOLERANCE, difference
from testbench.flight.batch.fly import Job, Tally, fly_block
from testbench.flight.batch.linear import linearise_flight, linearise_many
from testbench.flight.batch.model import batch_model
from testbench.flight.batch.trim import trim_many
from testbench.inputs.signal import InputSignal
from testbench.sensors import load_suite

CONDITIONS = {
    "eolo": FlightCondition(16.0, 547.0),
    "taurus": FlightCondition(15.0, 100.0),
    "b1": FlightCondition(200.6, 1524.0),
    "jsbsim:A4": FlightCondition(120.0, 2000.0),
    "jsbsim:f16": FlightCondition(150.0, 2500.0),
}
SECONDS = 5.0


def flyable(aircraft, effect, suite, condition):
    """Return the aircraft with the effect at the first of its starts that has a trim, and the trim; None without."""
    for starts in product(*(p.starts for p in effect.parameters)):
        values = dict(zip((p.name for p in effect.parameters), starts, strict=True))
        try:
            amended = effect.amend(aircraft, suite, values)[0]
            return amended, trim(amended, condition)
        except Refusal:
            continue
    return None


def every_control(aircraft, trimmed) -> Manoeuvre:
    """Move every control by a hundredth of its range: doublets one after the other, then waves together."""
    t = np.arange(round(SECONDS * trimmed.rate_hz)) / trimmed.rate_hz
    names = tuple(aircraft.controls)
    u = np.zeros((t.size, len(names)))
    for i, name in enumerate(names):
        size = 0.01 * (aircraft.controls[name].full - aircraft.controls[name].low)
        u[:, i] = size * np.sign(np.sin(2 * np.pi * 2.0 * t)) * ((t > 0.2 + 0.5 * i) & (t < 0.7 + 0.5 * i))
        u[:, i] += size * np.sin(2 * np.pi * (0.5 + 0.4 * i) * t) * ((t > 2.7) & (t < 4.5))
    return Manoeuvre("every control", InputSignal(t, u, names), 0.0)


@pytest.mark.parametrize("name", ["taurus", *(pytest.param(n, marks=pytest.mark.slow) for n in ("eolo", "b1"))])
def test_every_effect_flies_in_a_batch_as_in_jsbsim(name):
    aircraft, condition, suite = load_aircraft(name, "rigid"), CONDITIONS[name], load_suite("eolo_gap")
    worst, tried = {}, set()
    for effect in library(suite, aircraft).values():
        found = flyable(aircraft, effect, suite, condition)
        if found is None or found[0].amendments == aircraft.amendments:
            continue  # of sensors, of the air, or nothing that this aircraft has
        amended, trimmed = found
        job = Job(amended, trimmed, every_control(amended, trimmed), trimmed.rate_hz)
        truth = fly(amended, trimmed, job.manoeuvre, job.log_rate_hz)
        model = batch_model(amended, trimmed.rate_hz, condition)
        worst[effect.name] = difference(fly_block([job], [model], Tally())[0], truth)
        tried.add(effect.name)
    assert len(tried) > 25, f"most effects change the aircraft, got {sorted(tried)}"
    assert {n: w for n, w in worst.items() if not w[0] <= TOLERANCE} == {}


@pytest.mark.parametrize(
    "name", ["eolo", "taurus", *(pytest.param(n, marks=pytest.mark.slow) for n in ("jsbsim:A4", "jsbsim:f16"))]
)
def test_amended_aircraft_are_trimmed_and_linearised_in_blocks_as_by_jsbsim(name):
    aircraft = load_aircraft(name) if name.startswith("jsbsim:") else load_aircraft(name, "rigid")
    condition, suite = CONDITIONS[name], load_suite("eolo_gap_lateral")
    effects = library(suite, aircraft)
    names = (
        "wake_lag", "wing_bending", "alpha_dot", "payload", "filtered_pitch_damper", "washed_pitch_damper",
        "filtered_yaw_damper", "interconnect", "rudder_lag",
    )  # fmt: skip
    amended, by_jsbsim = zip(*(flyable(aircraft, effects[n], suite, condition) for n in names), strict=True)
    for trimmed, alone in zip(trim_many(amended, [condition] * len(names)), by_jsbsim, strict=True):
        apart = {c: abs(trimmed.state[c] - x) for c, x in alone.state.items() if c != "psi"}
        assert max(apart.values()) < 1e-8 * max(abs(x) for x in alone.state.values()), apart
    for model, each, at in zip(linearise_many(amended, by_jsbsim), amended, by_jsbsim, strict=True):
        alone = linearise(each, at)
        assert (model.states, model.inputs, model.outputs) == (alone.states, alone.inputs, alone.outputs)
        for matrix in "ABCD":
            got, right = getattr(model, matrix), getattr(alone, matrix)
            np.testing.assert_allclose(got, right, rtol=0.0, atol=1e-8 * (1.0 + np.max(np.abs(right))))


@pytest.mark.parametrize("effect", ["wake_lag", "filtered_pitch_damper", "wing_bending"])
def test_an_amended_aircraft_is_linearised_along_its_flight_in_blocks_as_by_jsbsim(effect):
    aircraft, condition, suite = load_aircraft("eolo", "rigid"), CONDITIONS["eolo"], load_suite("eolo_gap")
    amended, trimmed = flyable(aircraft, library(suite, aircraft)[effect], suite, condition)
    flown = fly(amended, trimmed, every_control(amended, trimmed), 5.0)
    states = [s for s in linearise(amended, trimmed).states if s not in ("h", "phi", "psi")]
    (A, C, outputs), right = (
        linearise_flight(amended, trimmed, flown, states),
        linearise_along(amended, trimmed, flown, states),
    )
    assert outputs == right[2]
    np.testing.assert_allclose(A, right[0], rtol=0.0, atol=1e-6 * np.max(np.abs(right[0])))
    np.testing.assert_allclose(C, right[1], rtol=0.0, atol=1e-6 * np.max(np.abs(right[1])))
