"""Global models: exact functions come back, noise gives none, errors are those of the scatter, domains end."""

import numpy as np
import pytest
from global_flights import drawn

from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError
from testbench.estimators.regression.global_model import FlownDomain, GlobalModel, candidates, columns, fit, knots

SIGNALS = ("alpha", "beta", "q_hat", "de")


def flights(count: int = 5, samples: int = 200, seed: int = 0) -> list[dict[str, np.ndarray]]:
    """Flights about different alpha, each with slow random motion."""
    rng = np.random.default_rng(seed)
    out = []
    for alpha in np.linspace(2.0, 14.0, count) * DEG_RAD:
        slow = np.array(
            [np.convolve(rng.standard_normal(samples + 9), np.ones(10) / 10**0.5, "valid") for _ in range(4)]
        )
        size = np.array([2.0 * DEG_RAD, 2.0 * DEG_RAD, 0.005, 2.0 * DEG_RAD])
        out.append(
            dict(zip(SIGNALS, slow * size[:, None] + np.array([[alpha], [0.0], [0.0], [-alpha / 3]]), strict=True))
        )
    return out


def bent(x: dict[str, np.ndarray]) -> np.ndarray:
    """A coefficient that bends at 8 deg, with a product and a square."""
    over = np.maximum(x["alpha"] - 8.0 * DEG_RAD, 0.0)
    return 0.1 + 3.0 * x["alpha"] - 1.5 * over + 4.0 * x["q_hat"] + 0.8 * x["alpha"] * x["de"] + 2.0 * x["beta"] ** 2


def test_an_exact_function_with_a_bend_comes_back():
    flown = flights()
    for x in flown:
        x["CL"] = bent(x)
    found = fit("CL", flown, SIGNALS, knots(flown, SIGNALS))
    truth = {"1": 0.1, "alpha": 3.0, "alpha_over_8deg": -1.5, "q_hat": 4.0, "alpha*de": 0.8, "beta^2": 2.0}
    assert dict(zip(found.terms, found.params, strict=True)) == pytest.approx(truth, abs=1e-9)
    new = flights(seed=1)[2]
    value, std = found.at(new)
    assert np.allclose(value, bent(new), atol=1e-9)
    assert np.all(std < 1e-6)


def test_noise_alone_gives_a_constant():
    none = 0
    for seed in range(20):
        flown, rng = flights(3, 150, seed), np.random.default_rng([seed, 1])
        for x in flown:
            x["CL"] = np.convolve(rng.standard_normal(154), np.ones(5) / 5, "valid")
        none += fit("CL", flown, SIGNALS, knots(flown, SIGNALS)).terms == ("1",)
    # Measured over 100 other seeds: 93 of them. Binomial with 0.93: fewer than 15 of 20 in 0.2 %.
    assert none >= 15


def test_what_no_aerodynamic_coefficient_follows_is_told_apart():
    flown, rng = flights(), np.random.default_rng(0)
    for i, x in enumerate(flown):
        x["CL_by_az"] = np.full_like(x["alpha"], 0.1 * 2.0**i)
        x["CL"] = bent(x) + 0.3 * x["CL_by_az"] + 1e-4 * rng.standard_normal(x["alpha"].size)
    found = fit("CL", flown, SIGNALS, knots(flown, SIGNALS), ("CL_by_az",))
    size, error = found.apart["CL_by_az"]
    assert size == pytest.approx(0.3, abs=5.0 * error)
    assert error < 1e-3
    assert np.allclose(found.at(flown[1])[0] + found.beside(flown[1]), flown[1]["CL"], atol=1e-3)


def test_errors_are_those_that_repeated_noise_makes():
    flown, z = flights(4, 150), []
    states = flights(4, 150, seed=9)[1]
    for seed in range(20):
        rng = np.random.default_rng([seed, 2])
        noisy = [{**x, "CL": bent(x) + 0.01 * rng.standard_normal(x["alpha"].size)} for x in flown]
        value, std = fit("CL", noisy, SIGNALS, knots(noisy, SIGNALS)).at(states)
        z.append((value - bent(states)) / std)
    rms = float(np.sqrt(np.mean(np.square(z))))
    assert 0.4 < rms < 1.3  # the jackknife over four flights is wide


def test_differences_have_errors_of_their_own():
    flown, rng = flights(), np.random.default_rng(4)
    for x in flown:
        x["CL"] = bent(x) + 0.01 * rng.standard_normal(x["alpha"].size)
    found, state = fit("CL", flown, SIGNALS, knots(flown, SIGNALS)), {s: flown[2][s][:1] for s in SIGNALS}
    more = {**state, "q_hat": state["q_hat"] + 0.01}
    change, std = found.at(more, state)
    assert change == pytest.approx(found.at(more)[0] - found.at(state)[0])
    assert float(std[0]) < float(np.hypot(found.at(more)[1], found.at(state)[1])[0])
    assert change == pytest.approx(0.04, abs=4.0 * float(std[0]))


def test_states_beyond_the_flown_domain_are_not_answered():
    flown = flights()
    for x in flown:
        x["CL"] = bent(x)
    domain = FlownDomain.of(flown, SIGNALS)
    model = GlobalModel({"CL": fit("CL", flown, SIGNALS, knots(flown, SIGNALS))}, domain)
    assert np.mean([np.mean(domain.inside(x)) for x in flown]) > 0.85
    states = drawn(domain, np.random.default_rng(0), 300)
    assert np.all(domain.inside(states))
    assert np.allclose(model.at(states)["CL"][0], bent(states), atol=1e-9)
    for signal, more in (("alpha", 10.0 * DEG_RAD), ("beta", 15.0 * DEG_RAD), ("q_hat", 0.1), ("de", -20.0 * DEG_RAD)):
        beyond = {**states, signal: states[signal] + (20.0 if signal == "alpha" else 1.0) * more}
        assert not domain.inside(beyond).any(), signal
        assert all(np.isnan(x).all() for x in model.at(beyond)["CL"]), signal


def test_the_distance_is_one_at_the_edge():
    domain = FlownDomain.of(flights(), SIGNALS)
    middle = {"alpha": domain.alpha} | {s: domain.middle[:, i] for i, s in enumerate(domain.signals)}
    assert np.allclose(domain.distance(middle), 0.0)
    edge = {**middle, "beta": domain.middle[:, 0] + domain.half[:, 0]}
    assert np.allclose(domain.distance(edge), 1.0)
    corner = {"alpha": domain.alpha} | {s: (domain.middle + domain.half)[:, i] for i, s in enumerate(domain.signals)}
    assert np.all(domain.distance(corner) >= 1.0)
    assert np.any(domain.distance(corner) > 1.05)
    below = {k: v[:1] for k, v in middle.items()} | {"alpha": np.array([domain.low - 1.0 * DEG_RAD])}
    assert domain.distance(below) == pytest.approx(1.5)


def test_hinges_lie_where_there_are_flights_on_both_sides():
    flown = flights()
    made = knots(flown, SIGNALS)
    alpha = np.concatenate([x["alpha"] for x in flown])
    for signal, knot in made.values():
        if signal == "alpha":
            assert 0.02 <= np.mean(alpha < knot) <= 0.98
    assert made["beta_over_0deg"] == ("beta", 0.0)
    terms = candidates(SIGNALS, made)
    assert len(set(terms)) == len(terms)
    assert columns(flown[0], made, ["1", "alpha_over_8deg*de"]).shape == (200, 2)


def test_a_coefficient_that_rests_is_refused():
    flown = [{**x, "CL": np.ones_like(x["alpha"])} for x in flights()]
    with pytest.raises(EstimationError, match="never moves"):
        fit("CL", flown, SIGNALS, knots(flown, SIGNALS))
