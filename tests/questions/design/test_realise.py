"""Promised and realised: the estimator that a design writes, the statistics of its flights, causes, margins, air."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from testbench.core.door import read_toml
from testbench.core.errors import EstimationError, ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.core.scenario.air import AirSpec
from testbench.design.amplitude import AIR, Ensemble
from testbench.design.ensemble import Setting, with_mode
from testbench.design.identified import STRUCTURE, identified_by
from testbench.design.problem import rescaled
from testbench.design.realise import FALSE_ALARM, TRUST, Errors, Realised, without_noise
from testbench.estimators.parametric.structures.written import written
from testbench.evaluation.modes import modes_of
from testbench.flight import load_aircraft
from testbench.questions.design.answer import design_sentences
from testbench.questions.design.ask import run_design
from testbench.questions.design.page import design_page, elsewhere_table, realised_table
from testbench.questions.design.pose import limits_of, place, problem_of
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.run.scenario import Scenario
from testbench.sensors import load_suite


def problem(name, aircraft=None):
    scenario = DesignScenario.load(SCENARIOS / "design" / f"{name}.toml")
    aircraft = aircraft or load_aircraft(scenario.aircraft)
    at, suite = place(scenario, aircraft), load_suite(scenario.suites[0])
    return problem_of(scenario, at, suite, limits_of(scenario, aircraft, at.trimmed), starts=True), suite


@pytest.mark.parametrize("name", ["taurus_short_period", "eolo_short_period", "eolo_modes"])
def test_the_written_equations_are_the_linearised_aircraft_at_any_parameters(name):
    """The text and the structure that information is computed of agree, elastic modes and accelerometers included."""
    p, suite = problem(name)
    found = identified_by(p.deflected, suite, p.servo_lag_s, p.experiment.samples, False)
    law = written(found.asked.structures[STRUCTURE], "x", p.deflected.outputs)
    assert type(law).__name__ == "LinearWrittenStructure"
    params = law.values * (1.0 + 0.1 * np.cos(np.arange(law.values.size)))
    order = [law.parameter_names.index(k) for k in p.deflected.parameter_names]
    mine, theirs = law.matrices(params), p.deflected.matrices(params[order])
    n = len(p.deflected.states)
    np.testing.assert_allclose(mine.A[:n, :n], theirs.A, rtol=1e-9, atol=max(1e-7 * np.abs(theirs.A).max(), 1e-9))
    for omega in (0.3, 3.0, 30.0):
        shown, true = (m.C @ np.linalg.solve(1j * omega * np.eye(len(m.A)) - m.A, m.B) + m.D for m in (mine, theirs))
        for i, name in enumerate(p.deflected.outputs):
            sensor = next(s for s in suite.sensors if s.channel == name)
            late = 0.5j * omega * sensor.delay_s
            lag = sensor.lag_s if sensor.lag_s * np.pi * suite.rate_hz > 1.0 else 0.0  # no sample shows a shorter one
            seen = true[i] / (1.0 + 1j * omega * lag) * (1.0 - late) / (1.0 + late)
            np.testing.assert_allclose(shown[i], seen, rtol=1e-5, atol=1e-7 * np.abs(true).max())


def test_commands_pass_the_servo_and_sensed_deflections_do_not():
    p, suite = problem("taurus_short_period")
    (entry,) = identified_by(p.deflected, suite, p.servo_lag_s, p.experiment.samples, False).table["estimators"]
    assert entry["servo"]["de_cmd"]["lag_s"] == pytest.approx(1.0 / 33.0, rel=1e-6)
    assert "h" not in entry["output_biases"]  # its offset is what an initial height does
    assert set(entry["output_biases"]) == {"theta", "q", "u"}
    assert entry["method"] == "output_error"
    p, suite = problem("eolo_short_period")
    table = identified_by(p.deflected, suite, p.servo_lag_s, p.experiment.samples, False).table
    assert table["inputs"] == ["de"]
    assert "servo" not in table["estimators"][0]


def test_the_targets_of_the_true_parameters_are_the_true_targets():
    p, _ = problem("taurus_short_period")
    np.testing.assert_allclose(p.targets.at(p.deflected, p.deflected.true), p.targets.values, rtol=1e-9)
    step = 1e-6 * p.deflected.true[1]
    moved = p.deflected.true + step * np.eye(p.deflected.true.size)[1]
    slope = (p.targets.at(p.deflected, moved) - p.targets.values) / step
    np.testing.assert_allclose(slope, p.targets.jacobian[:, 1], rtol=1e-3, atol=1e-9)


def test_unknown_initial_states_cost_information():
    p, _ = problem("taurus_short_period")
    known = replace(p.experiment, initial_states=False)
    u = np.zeros((p.experiment.samples * p.experiment.stride, 1))
    u[round(2.0 * p.rate_hz) : round(4.0 * p.rate_hz)] = 0.02
    more, less = known.information(u), p.experiment.information(u)
    assert np.linalg.eigvalsh(more - less).min() > -1e-9 * np.abs(more).max()
    assert np.trace(less) < 0.999 * np.trace(more)


def errors_of(sigma, n, seed, scale=1.0, mean=0.0):
    rng = np.random.default_rng(seed)
    e = mean + scale * sigma * rng.standard_normal((n, sigma.size))
    return Errors(e, np.tile(sigma, (n, 1)), ())


def test_right_promises_are_called_wrong_as_rarely_as_stated():
    """2000 designs of 4 targets: the rate of false alarms is 1 % to within 4 standard deviations, 0.9 %."""
    sigma = np.array([1.0, 0.1, 5.0, 1e-3])
    alarms = sum(errors_of(sigma, 20, seed).departs(sigma).any() for seed in range(2000)) / 2000
    assert alarms == pytest.approx(FALSE_ALARM, abs=0.009)


def test_wrong_promises_are_found_and_the_realised_error_counts():
    sigma = np.array([1.0, 0.1])
    found = errors_of(sigma, 20, 1, scale=np.array([1.0, 3.0]))
    realised = Realised(sigma, found, found.departs(sigma))
    assert realised.differs.tolist() == [False, True]
    pooled = np.sqrt((TRUST + 20 * found.rms[0] ** 2) / (TRUST + 20))
    assert realised.headline[0] == pytest.approx(pooled)
    assert realised.headline[1] == found.rms[1]
    low, high = found.interval()
    assert low[1] < 0.3 < high[1]
    assert (found.rms[1] / low[1]) ** 2 == pytest.approx(chi2.ppf(0.975, 20) / 20)


def test_a_bias_alone_is_found_and_no_estimates_promise_nothing():
    sigma = np.array([1.0])
    assert errors_of(sigma, 20, 2, scale=0.1, mean=2.0).departs(sigma).all()
    none = Errors(np.zeros((1, 1)), np.zeros((1, 1)), ("diverged",) * 19)
    assert np.isinf(Realised(sigma, none, none.departs(sigma)).headline).all()


def test_the_air_that_is_expected():
    scenario = DesignScenario.load(SCENARIOS / "design" / "taurus_short_period.toml")
    assert scenario.expected_air.turbulence_rms_m_s == 0.3
    still = DesignScenario.of({**read_toml(scenario.file), "air": {}}, scenario.file)
    assert still.expected_air == AirSpec()


def test_a_suite_without_noise_keeps_all_else_that_its_files_say():
    suite = load_suite("eolo_alpha")
    quiet = without_noise(suite)
    for before, after in zip(suite.sensors, quiet.sensors, strict=True):
        assert after.noise_std == after.quantum == after.dropout == 0.0
        assert (after.bias, after.lag_s, after.delay_s, after.scale) == (
            before.bias,
            before.lag_s,
            before.delay_s,
            before.scale,
        )


@pytest.mark.parametrize("n", [1, 4])
def test_fewer_flights_than_say_anything_are_refused(n):
    file = SCENARIOS / "design" / "taurus_short_period.toml"
    with pytest.raises(ScenarioError, match="realise >= 5 flights must hold, or 0 for none"):
        DesignScenario.of({**read_toml(file), "realise": n}, file)


@pytest.fixture(scope="module")
def taurus_file(tmp_path_factory):
    """A short design in still air with a suite that has noise alone: what is promised must be realised."""
    folder = tmp_path_factory.mktemp("own")
    text = """title = "noise alone"
rate_hz = 60.0
[[sensor]]
channel = "q"
unit = "deg/s"
noise_std = 6.0
part = "a test"
source = "made up"
[[sensor]]
channel = "theta"
unit = "deg"
noise_std = 6.0
part = "a test"
source = "made up"
[[sensor]]
channel = "alpha"
unit = "deg"
noise_std = 6.0
part = "a test"
source = "made up"
[[sensor]]
channel = "de_cmd"
unit = "deg"
part = "a test"
source = "made up"
"""
    (folder / "noise_alone.toml").write_text(text, encoding="utf-8")
    asked = """title = "A short period through noise"
aircraft = "taurus"
suites = ["noise_alone.toml"]
controls = ["de"]
duration_s = 6.0
start_s = 1.0
realise = 20
shortest_step_s = 0.1
[air]
[condition]
V_m_s = 12.0
h_m = 100.0
[targets]
parameters = { M_alpha = 90.0, M_q = 90.0, M_de = 90.0 }
[limits]
deflection_deg = { de = 9.2 }
alpha_deg = [-8.0, 12.0]
speed_change_m_s = 0.5
"""
    (folder / "small.toml").write_text(asked, encoding="utf-8")
    return folder / "small.toml"


@pytest.fixture(scope="module")
def small(taurus_file):
    return run_design(DesignScenario.load(taurus_file))


@pytest.mark.slow
def test_where_only_noise_disturbs_a_small_input_the_promise_is_kept(small):
    """A 1 % false alarm per design; the seed is fixed."""
    best = small.best.realised
    assert best.found.n == 20
    assert not best.found.failed
    assert not best.differs.any()
    np.testing.assert_allclose(small.best.errors, small.best.design.errors, rtol=0.3)
    assert any(
        "its errors agree with the promised ones within the scatter of 20 flights" in s for s in design_sentences(small)
    )
    assert AIR not in small.best.bounds  # still air has no extremes of its own


@pytest.mark.parametrize("factor", [1.0, 20.0])
def test_what_an_error_is_made_of_begins_with_the_noise(small, factor):
    """Still air adds nothing, what is as promised no bias or scatter; noise falls with the square of the input."""
    best = small.best
    assert not best.realised.differs.any()
    larger = rescaled(small.problem, best.design, factor)
    causes = small.ensemble.range_._causes(larger, best.realised.found, best.realised.differs)
    for parts, promised in zip(causes, best.design.errors / factor, strict=True):
        assert [parts[cause] for cause in ("air", "bias", "scatter")] == pytest.approx([0.0] * 3, abs=1e-9 * promised)
        assert 0.5 * promised**2 < parts["noise"] <= promised**2 * (1.0 + 1e-9)


def test_the_written_scenario_is_read_and_its_estimator_gives_the_targets(small, tmp_path):
    design_page(small).write(tmp_path)
    (first,) = (tmp_path / "designs").glob("1_*.toml")
    scenario = Scenario.load(first)
    assert scenario.identification.model_dump() == small.ensemble.range_.identified.asked.model_dump()
    for target in small.problem.targets.names:
        assert target in scenario.identification.structures[STRUCTURE].parameters
    rows = realised_table(small).rows
    assert {row[1] for row in rows} == set(small.problem.targets.names)


def test_the_aircraft_elsewhere_has_the_frequency_that_it_should(small):
    """Changed about the trim, which stays; each of the same commands is flown, identified and said."""
    assert [e.factor for e in small.elsewhere] == [0.7, 1.3]
    for e in small.elsewhere:
        assert e.why_not == ""
        believed = dict(zip(small.problem.targets.names, small.problem.targets.values, strict=True))
        there = dict(zip(small.problem.targets.names, e.values, strict=True))
        assert (abs(there["M_alpha"]) > abs(believed["M_alpha"])) == (e.factor > 1.0)
    assert len(elsewhere_table(small).rows) == 6


def test_amplitudes_keep_a_margin_in_turbulence(small):
    windy = replace(small.ensemble.range_, air=AirSpec(turbulence_rms_m_s=0.3))
    (kept,) = Ensemble(windy, flights=10).chosen([small.best], AIR)
    m = kept.bounds[AIR]
    assert m.flights == 10
    assert kept.design.peak.max() == pytest.approx(m.share * small.best.design.peak.max(), rel=1e-3)
    assert (m.reach <= 1.0) or m.share == 0.25
    assert m.share < 1.0  # still air left no room for as much wind
    assert m.reach > m.mean


def test_a_mode_that_damping_makes_is_not_moved_beyond_static_stability(small):
    """Of a short period with two real roots, 0.7 times its frequency takes a divergent aircraft: that says nothing."""
    scenario, believed = small.scenario, small.believed.linear
    row, column = believed.states.index("q"), believed.states.index("w")
    assert believed.A[row, column] < 0.0

    def hardly_stable(aircraft):
        at = place(scenario, aircraft)
        A = at.linear.A.copy()
        A[row, column] -= 0.9 * believed.A[row, column]  # what is left of the stiffness is a tenth of it
        linear = replace(at.linear, A=A)
        return at._replace(linear=linear, modes=modes_of(linear, aircraft, scenario.plane))

    setting = Setting(scenario.plane, hardly_stable, None)
    with pytest.raises(EstimationError, match=r"damping contributes most .* Cm_alpha \+.* without static stability"):
        with_mode(setting, small.believed, 0.7)
