"""An aircraft as functions of JAX flies as batches do, and differentiates as differences do (``test_as_jax.py``)."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import testbench as tb
from testbench.core.errors import LimitError, MissingPackage
from testbench.core.record import FlightRecord
from testbench.flight.batch.check import TOLERANCE, difference, every_control
from testbench.flight.simulate import checked

CASES = {"taurus": (12.0, 100.0), "eolo": (16.0, 547.0), "jsbsim:c172p": (43.0, 1000.0)}
NAMES = ("coefficient.Cm_q", "coefficient.CL_alpha", "aircraft.mass_percent")
SLOW = [pytest.param(name, marks=[] if name == "taurus" else pytest.mark.slow) for name in CASES]


@pytest.fixture(autouse=True)
def with_64_bits():
    """Let JAX compute with 64 bits in this file."""
    before = jax.config.read("jax_enable_x64")
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def flown(plane, inputs):
    """Return the outputs (frames, outputs) of a flight with inputs (frames, inputs)."""

    def frame(state, u):
        state = plane.step(state, u)
        return state, plane.outputs(state)

    return jax.lax.scan(frame, plane.state, inputs)[1]


@pytest.mark.parametrize("name", SLOW)
def test_flights_side_by_side_are_those_of_a_batch(name):
    aircraft = tb.load_aircraft(name)
    trimmed = tb.trim(aircraft, tb.FlightCondition(*CASES[name]))
    manoeuvres = [every_control(aircraft, trimmed, share) for share in (0.02, 0.01)]
    jobs = [tb.Job(aircraft, trimmed, m, trimmed.rate_hz) for m in manoeuvres]
    truths = tb.fly_many(jobs, "batch")
    plane = tb.as_jax(aircraft, trimmed)
    inputs = np.tile(np.asarray(plane.inputs), (2, len(truths[0]) - 1, 1))
    for u, manoeuvre in zip(inputs, manoeuvres, strict=True):
        _, commands, _ = checked(aircraft, trimmed, manoeuvre, trimmed.rate_hz, None)
        u[:, [plane.input_names.index(f"{n}_cmd") for n in manoeuvre.signal.channels]] = commands[1:]
    got = np.asarray(jax.jit(jax.vmap(lambda u: flown(plane, u)))(inputs))
    kept = [n for n in truths[0].channels if n in plane.output_names]
    for truth, y in zip(truths, got, strict=True):
        columns = [plane.output_names.index(n) for n in kept]
        beside = FlightRecord(truth.t_s[1:], tuple(kept), np.column_stack([truth[n][1:] for n in kept]), truth.kind)
        worst, channel = difference(FlightRecord(beside.t_s, beside.channels, y[:, columns], truth.kind), beside)
        assert worst < TOLERANCE, channel


def test_a_step_has_the_derivatives_that_differences_find():
    plane = tb.as_jax("taurus", tb.FlightCondition(12.0, 100.0), NAMES)
    wanted = np.array([plane.output_names.index(n) for n in ("ax", "az", "qdot", "de")])

    def after(x):  # elevator and parameters
        return plane.outputs(plane.step(plane.state, plane.inputs.at[0].add(x[0]), x[1:]), x[1:])[wanted]

    x, large = jnp.concatenate([jnp.array([0.01]), plane.parameters]), np.array([0.1, 1.0, 1.0, 100.0])
    exact = np.asarray(jax.jit(jax.jacfwd(after))(x))
    after = jax.jit(after)
    slopes = np.stack([(after(x + h) - after(x - h)) / (2.0 * h.sum()) for h in np.diag(1e-4 * large)], axis=1)
    np.testing.assert_allclose(exact, slopes, rtol=0.0, atol=1e-7 * np.abs(exact).max())
    assert np.all(np.abs(exact).max(axis=0) > 0.0)


@pytest.mark.slow
def test_gradients_of_a_flight_are_tangents_by_differences():
    aircraft = tb.load_aircraft("taurus")
    trimmed = tb.trim(aircraft, tb.FlightCondition(12.0, 100.0))
    plane, names = tb.as_jax(aircraft, trimmed, NAMES), ("alpha", "q", "az")
    wanted, frames = jnp.array([plane.output_names.index(n) for n in names]), 480
    u = np.zeros((frames + 1, 1))
    u[1:121] = 0.02
    inputs = jnp.tile(plane.inputs, (frames, 1)).at[:, 0].add(u[1:, 0])

    def flight(parameters):
        def frame(state, u):
            state = plane.step(state, u, parameters)
            return state, plane.outputs(state, parameters)[wanted]

        return jax.lax.scan(frame, plane.begin(parameters), inputs)[1]

    exact = np.asarray(jax.jit(jax.jacfwd(flight))(plane.parameters))
    pulse = tb.Manoeuvre("pulse", tb.InputSignal(np.arange(frames + 1) / trimmed.rate_hz, u, ("de",)), 0.0)
    (found,) = tb.tangents([tb.Job(aircraft, trimmed, pulse, trimmed.rate_hz, names)], list(NAMES), held=True)
    apart = np.abs(found.derivatives[1 : frames + 1] - exact).max(axis=0) / np.abs(exact).max(axis=0)
    assert apart.max() < 3e-6  # what differences leave is some 1e-6
    weights = np.random.default_rng(1).standard_normal(exact.shape[:2])
    backwards = jax.jit(jax.grad(lambda x: jnp.sum(weights * flight(x))))(plane.parameters)
    np.testing.assert_allclose(backwards, np.einsum("ij,ijk->k", weights, exact), rtol=1e-9)


def test_what_jax_cannot_do_is_said_in_one_line(monkeypatch):
    for names, law in ((("coefficient.Cm_x",), "must have the coefficient"), (("mass",), "a parameter must be one of")):
        with pytest.raises(tb.TestbenchError, match=law):
            tb.as_jax("taurus", None, names)
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(LimitError, match="JAX must compute with 64 bits"):
        tb.as_jax("taurus")
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingPackage, match=r"pip install '.*\[jax\]'"):
        tb.as_jax("taurus")
