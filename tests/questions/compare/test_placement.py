"""Stations along the wing: sums of information, greedy with exchanges against every set."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.core.errors import ModelError
from testbench.information.fisher import cost
from testbench.information.targets import unknowns
from testbench.questions.compare.ask import _known, _place
from testbench.questions.compare.placement import best_set, brute_force, candidate_stations, informations, templates
from testbench.questions.compare.prediction import experiment_of, wanted_modes
from testbench.questions.compare.scenario import CompareScenario
from testbench.sensors import load_suite


@pytest.fixture(scope="module")
def scenario():
    return CompareScenario.load("compare/eolo_wing")


@pytest.fixture(scope="module")
def aimed(scenario, eolo):
    known = _known(scenario, eolo, 0)
    asked = scenario.placement
    free = unknowns(eolo, "longitudinal", ["de"], asked.modes, ())
    return replace(known, wanted_modes=wanted_modes(known.modes, asked.modes), wanted=(), free=free)


def parts_of(scenario, aimed, **changes):
    asked = scenario.placement.model_copy(update={"stations": "listed", **changes})
    suite = load_suite("eolo_no_alpha")
    return informations(aimed, asked, suite, suite.sensing(), scenario.manoeuvre[0], templates(asked))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("criterion", ["D", "worst"])
def test_best_stations_of_eolo_are_those_of_all_sets(scenario, aimed, criterion) -> None:
    spots, parts, base, aims = parts_of(scenario, aimed)
    accelerometers = [k for k, s in enumerate(spots) if s.kind == "accelerometer"]
    gauges = [k for k, s in enumerate(spots) if s.kind == "strain gauge"]
    groups = [(accelerometers, 3), (gauges, 1)]

    def value(M):
        return cost(M, aims.gradient, criterion)

    best, least = brute_force(base, parts, groups, value)  # 165 x 11 sets
    found, _ = best_set(base, parts, groups, value)
    total = value(base + sum(parts[k] for k in found))
    # exchanges may end in a set that no single exchange betters: within 1 % of the best of all
    assert least * (1.0 - 1e-9) <= total <= 1.01 * least
    assert len(best) == len(set(found)) == 4


def test_exchanges_better_a_greedy_choice_that_is_not_the_best() -> None:
    # the two sensors that tell one direction each are worth less alone than the one between them
    rng = np.random.default_rng(0)
    exchanged = 0
    for _ in range(40):
        rows = rng.standard_normal((9, 4))
        parts = [np.outer(r, r) for r in rows]
        base = 1e-2 * np.eye(4)

        def value(M):
            return float(-np.linalg.slogdet(M)[1])

        _, least = brute_force(base, parts, [(range(9), 4)], value)
        found, swaps = best_set(base, parts, [(range(9), 4)], value)
        exchanged += swaps
        total = value(base + sum(parts[k] for k in found))
        assert total <= least + np.log(1.5)  # never far off; most often the best itself
    assert exchanged > 0


def test_information_of_sensors_adds_up(scenario, aimed) -> None:
    spots, parts, base, _ = parts_of(scenario, aimed, strain_gauges=0)
    suite = load_suite("eolo_ten_accelerometers")
    experiment, u = experiment_of(aimed, suite.sensing(), suite.rate_hz, scenario.manoeuvre[0])
    together = base + sum(part for spot, part in zip(spots, parts, strict=True) if spot.y_m != 0.0)
    np.testing.assert_allclose(together, experiment.information(u), rtol=1e-6, atol=1e-8 * np.abs(together).max())


def test_accelerometers_go_to_the_tips_and_strain_gauges_to_the_root(scenario, eolo) -> None:
    known = _known(scenario, eolo, 0)
    asked = scenario.placement.model_copy(update={"accelerometers": 2, "strain_gauges": 1, "step_m": 0.5})
    placed = _place(scenario, asked, known, load_suite("eolo_no_alpha"))
    by_kind = {kind: {abs(s.y_m) for s in placed.spots if s.kind == kind} for kind in ("accelerometer", "strain gauge")}
    assert by_kind == {"accelerometer": {2.0}, "strain gauge": {0.0}}
    assert list(placed.path) == sorted(placed.path, reverse=True)
    assert np.all(placed.after < 0.1 * placed.before)


def test_rigid_wings_have_nothing_to_place_on(scenario, aimed) -> None:
    from testbench.flight import load_aircraft

    with pytest.raises(ModelError, match="flexible wings with stations"):
        candidate_stations(replace(aimed, aircraft=load_aircraft("eolo", "rigid")), scenario.placement)
