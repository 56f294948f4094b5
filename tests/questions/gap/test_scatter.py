"""Delays that scatter from command to command: what they leave is told from the form of another effect."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from studies.blind.flights import fly_lateral, fly_truth, suite
from studies.blind.lateral_truths import LATERAL
from studies.blind.run import believe
from studies.blind.truth import Truth
from studies.blind.truths import TRUTHS

from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS, catalogue
from testbench.questions.gap.search.fit import fit
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.name import name_effect
from testbench.questions.gap.search.scatter import _responses, _Spread, scattered
from testbench.questions.gap.search.screening import screen

LATE = ("transport_delay", "clock_offset")
RNG_SEED = 3


def jittery(delay_s: float, scatter_s: float, drawn: list[float]):
    """A link that hands steps on, each late by a time of its own, which is noted in ``drawn``."""

    rng = np.random.default_rng(RNG_SEED)

    def law(u, dt_s):
        t, out = np.arange(len(u)) * dt_s, np.full(len(u), float(u[0]))
        for k in np.flatnonzero(np.diff(u)) + 1:
            drawn.append(delay_s + scatter_s * rng.standard_normal())
            share = np.clip((t - t[k] - drawn[-1]) / dt_s + 1.0, 0.0, 1.0)
            out = (1.0 - share) * out + share * u[k]
        return out

    return law


@pytest.mark.parametrize("control", ["de", "da", "dr", "thr"])
def test_commands_that_are_all_late_by_a_sample_change_what_their_responses_say(control):
    believed = believe("taurus", draw="lateral")
    t = np.arange(200) / 50.0
    u = 0.05 * ((t > 1.0) & (t < 1.6)) - 0.03 * ((t >= 1.6) & (t < 2.0)) + 0.02 * (t >= 3.0)
    late, early = np.concatenate([u[:1], u[:-1]]), np.concatenate([u[1:], u[-1:]])
    still = np.zeros((t.size, len(believed.outputs)))
    names = (*believed.outputs, f"{control}_cmd")
    on_time, later, sooner = (FlightRecord(t, names, np.column_stack([still, x]), "measured") for x in (u, late, early))
    moved = 0.5 * (believed.predict_linear(later) - believed.predict_linear(sooner))
    change = believed.in_noise_units(on_time, moved).ravel()
    said = _responses(believed, on_time, f"{control}_cmd").sum(axis=1) * on_time.dt_s
    assert np.max(np.abs(change)) > 0.05
    np.testing.assert_allclose(-said, change, atol=0.02 * np.max(np.abs(change)))


def named(plan: Truth, names: tuple[str, ...] = LATE):
    records = list(fly_truth("taurus", plan, "short", 11).values())
    return name_effect(believe("taurus"), records, effects={n: EFFECTS[n] for n in names})


@pytest.mark.slow
def test_a_delay_is_named_with_its_scatter_where_each_command_arrives_at_a_time_of_its_own():
    drawn: list[float] = []
    naming = named(Truth(elevator=jittery(0.08, 0.006, drawn)))
    assert naming.names == ("transport_delay",), naming.sentence
    best = naming.best
    assert len(drawn) > 8
    assert best.scatter_s == pytest.approx(np.std(drawn), rel=0.2)  # each lateness is read to a tenth of it
    assert abs(best.values["delay_s"] - np.mean(drawn)) < 4.0 * best.errors["delay_s"]  # false alarm 6e-5
    assert best.errors["delay_s"] > 0.5 * np.std(drawn) / np.sqrt(len(drawn))  # so few say no more of their mean
    assert "from command to command" in best.size


@pytest.mark.slow
def test_a_rudder_s_delay_is_named_with_its_scatter():
    truth = LATERAL["rudder link with jitter"]({"delay_s": 0.085}, "taurus")
    records = list(fly_lateral("taurus", truth, "rich", 5).values())
    known = catalogue(suite("lateral"))
    names = ("rudder_transport_delay", "rudder_lag", "rudder_second_order_actuator", "r_delay")
    naming = name_effect(believe("taurus", draw="lateral"), records, effects={n: known[n] for n in names})
    assert naming.names == ("rudder_transport_delay",), naming.sentence
    assert naming.best.scatter_s > 0.01
    assert abs(naming.best.values["delay_s"] - 0.085) < 4.0 * naming.best.errors["delay_s"]  # false alarm 6e-5


@pytest.mark.parametrize(
    "kinds",
    [
        {"late link": {"delay_s": 0.07}},
        pytest.param({"servo of second order": {"omega_rad_s": 15.0, "zeta": 0.6}}, marks=pytest.mark.slow),
        {"late link": {"delay_s": 0.07}, "airspeed lag": {"lag_s": 0.5}},
    ],
    ids=["the same delay for all commands", "form of a servo", "another effect beside it"],
)
def test_what_is_the_same_for_all_commands_is_not_taken_for_scatter(kinds):
    believed, plan = believe("taurus"), Truth()
    for kind, sizes in kinds.items():
        plan = plan.with_(TRUTHS[kind](sizes, "taurus"))
    records = tuple(fly_truth("taurus", plan, "short", 11).values())
    base = Hypothesis.at(believed, believed, records)
    found = fit(screen(base, EFFECTS["transport_delay"]), base.chi2, 0.0, 1)
    assert found.gain > 1000.0
    assert scattered(base, [found], base.chi2) is None


@pytest.fixture(scope="module")
def spread():
    rng = np.random.default_rng(5)
    return _Spread([rng.standard_normal((40, 6)), rng.standard_normal((30, 4))])


def covariance(spread: _Spread, s: float) -> np.ndarray:
    """V = I + s^2 J J', dense."""
    sizes = np.cumsum([0, *(len(J) for J in spread.responses)])
    V = np.eye(sizes[-1])
    for a, b, J in zip(sizes, sizes[1:], spread.responses, strict=False):
        V[a:b, a:b] += s**2 * J @ J.T
    return V


def test_weights_and_volume_are_those_of_the_dense_covariance(spread):
    V, r = covariance(spread, 0.7), np.random.default_rng(6).standard_normal((70, 3))
    assert spread.weigh(r, 0.7) == pytest.approx(np.linalg.solve(V, r), abs=1e-10)
    assert spread.weigh(r[:, 0], 0.7) == pytest.approx(np.linalg.solve(V, r[:, 0]), abs=1e-10)
    assert spread.volume(0.7) == pytest.approx(np.linalg.slogdet(V)[1], rel=1e-10)


def test_the_likeliest_scatter_is_that_of_the_dense_likelihood(spread):
    r = np.linalg.cholesky(covariance(spread, 0.5)) @ np.random.default_rng(7).standard_normal(70)

    def cost(s: float) -> float:
        V = covariance(spread, s)
        return float(r @ np.linalg.solve(V, r) + np.linalg.slogdet(V)[1])

    dense = minimize_scalar(cost, bounds=(1e-3, 5.0), method="bounded", options={"xatol": 1e-8}).x
    assert spread.likeliest(r, 5.0) == pytest.approx(dense, rel=1e-3)
    assert spread.likeliest(r, 0.1) == pytest.approx(0.1, rel=1e-3)  # no more than is asked for
