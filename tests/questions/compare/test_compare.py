"""A comparison of suites: paired, honest about chance, and in agreement with information where it should be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from testbench.core.errors import ScenarioError
from testbench.flight import load_aircraft
from testbench.questions.compare.answer import compare_answer, compare_sentences
from testbench.questions.compare.ask import Experiment, _known, compare, derived_seed, errors_in_own_units
from testbench.questions.compare.page import compare_page, compare_tables
from testbench.questions.compare.result import CaseKey, Quantity
from testbench.questions.compare.scenario import CompareScenario
from testbench.sensors import KINDS, load_suite, suite_toml

SENSORS = {
    "V": 'unit = "m/s"\nnoise_std = 0.02\nbias = 0.3\nlag_s = 0.05\nkind = "pitot"',
    "alpha": 'unit = "deg"\nnoise_std = 0.02\nlag_s = 0.02\nkind = "flow_vane"\n'
    "position_m = [0.7, 0, 0]\nupwash = 1.05",
    "q": 'unit = "deg/s"\nnoise_std = 0.03\nbias = 0.2\nkind = "rate_gyro"',
    "theta": 'unit = "deg"\nnoise_std = 0.02',
    "de": 'unit = "deg"\nnoise_std = 0.02\nkind = "surface_position"',
    "de_cmd": 'unit = "deg"\nkind = "command_log"',
}


def suite(folder: Path, name: str, *channels: str, cost: bool = True) -> str:
    entries = "".join(
        f'[[sensor]]\nchannel = "{c}"\npart = "p"\nsource = "s"\n{SENSORS[c]}\n'
        + ("price_eur = 100.0\nmass_g = 10.0\n" if cost else "")
        for c in channels
    )
    path = folder / f"{name}.toml"
    path.write_text(f'title = "{name}"\nrate_hz = 50.0\n{entries}', encoding="utf-8")
    return str(path)


def dsr_e(past: int, future: int) -> str:
    return (
        '[[identification.estimators]]\nmethod = "dsr_e"\norder = 4\n'
        f"past_horizon = {past}\nfuture_horizon = {future}\n"
    )


def scenario(folder: Path, suites: list[str], inputs: str = "de_cmd", more: str = "", seeds: int = 3, wings="rigid"):
    path = folder / "mine.toml"
    path.write_text(
        f"""
title = "t"
aircraft = "eolo"
wings = "{wings}"
seeds = {seeds}
suites = {suites}
[condition]
V_m_s = 16.0
h_m = 547.0
[[manoeuvre]]
name = "3211"
use = "identification"
duration_s = 6.0
input = [{{ signal = "3211", control = "de", amplitude_deg = 0.3, step_s = 0.3 }}]
[[manoeuvre]]
name = "judge"
use = "validation"
duration_s = 4.0
input = [{{ signal = "doublet", control = "de", amplitude_deg = 0.3, period_s = 1.0 }}]
[targets]
parameters = ["Z_alpha", "M_alpha", "M_q", "M_de"]
[identification]
inputs = ["{inputs}"]
{more or "best_case = true"}
""",
        encoding="utf-8",
    )
    return path


# information and simulation


@pytest.mark.sampled(2)
@pytest.mark.parametrize("inputs", ["de_cmd", "de"])
def test_scatter_of_output_error_is_what_information_predicts(tmp_path: Path, inputs: str) -> None:
    base, more = (
        suite(tmp_path, n, *c, inputs)
        for n, c in (("a", ("V", "q", "theta")), ("b", SENSORS.keys() - {"de", "de_cmd"}))
    )
    result = compare(CompareScenario.load(scenario(tmp_path, [base, more], inputs, seeds=24)))
    checked = 0
    for s in result.summaries:
        if s.predicted is None:
            continue
        # the sum of squares over the predicted variance is chi-square with 23 degrees of freedom. 12 figures (6
        # quantities, 2 suites) at 1e-4 on either side: false alarm 2.4e-3, with a fixed seed; 8 % more for the trim
        # (an offset of its own), for what is not linear at 0.3 deg and for lines between samples instead of steps
        ratio = (s.scatter / s.predicted) ** 2 * (s.found - 1)
        low, high = stats.chi2.ppf([1e-4, 1.0 - 1e-4], s.found - 1)
        assert 0.92**2 * low < ratio < 1.08**2 * high, (s.case, s.quantity, s.scatter, s.predicted)
        checked += 1
    assert checked == 12
    inside, _, total, far, (least, median, most) = result.agreement
    assert total + far == 12
    assert far <= 1  # without alpha the slow root bends over its errors
    assert 0.5 < least < median < most < 2.0
    assert median == pytest.approx(1.0, abs=0.2)
    assert inside >= 8
    assert "information and simulation agree to a factor of" in " ".join(compare_sentences(result))
    # what alpha buys, by either way: the ratio of two standard deviations of 24 errors scatters by some 20 % of itself
    wn = next(g for g in result.gains if g.quantity == Quantity("parameter", "Z_alpha"))
    scatters = {s.case.suite: s.scatter for s in result.summaries if s.quantity == wn.quantity}
    assert scatters["b"] / scatters["a"] == pytest.approx(wn.predicted, rel=0.6)
    assert wn.predicted < 0.9


def test_noise_of_a_measured_input_costs_accuracy(tmp_path: Path) -> None:
    one = suite(tmp_path, "a", "V", "q", "theta", "de", "de_cmd")
    two = suite(tmp_path, "b", "V", "alpha", "q", "theta", "de", "de_cmd")
    exact, noisy = (
        compare(CompareScenario.load(scenario(tmp_path, [one, two], inputs)), simulate=False).predictions["3211", "a"]
        for inputs in ("de_cmd", "de")
    )
    assert np.all(noisy.std > 1.1 * exact.std)
    assert np.max(noisy.std / exact.std) > 2.0
    assert set(exact.without) == {"V", "q", "theta"}
    assert all(np.all(factor >= 1.0 - 1e-9) for factor in exact.without.values())


# pairing and chance


def test_errors_of_a_truth_near_zero_are_told_in_its_own_unit(tmp_path: Path) -> None:
    both = [suite(tmp_path, "slow", "q", "de_cmd"), suite(tmp_path, "all", "V", "alpha", "q", "theta", "de_cmd")]
    path = scenario(tmp_path, both)
    text = path.read_text(encoding="utf-8").replace("amplitude_deg = 0.3", "amplitude_deg = 0.003")
    path.write_text(text.replace('["Z_alpha",', '["Z_de", "Z_alpha",'), encoding="utf-8")
    asked = CompareScenario.load(path)
    result = compare(asked, simulate=False)
    p = result.predictions["3211", "all"]
    found = {name: (unit, std, value) for name, unit, std, value in zip(p.names, p.units, p.std, p.values, strict=True)}
    unit, std, value = found["Z_de"]
    assert unit == "m/s²"
    assert std > abs(value) > 0.0  # it is not known whether it is positive
    assert found["M_de"][0] == "%"
    rows = next(t for t in compare_tables(result) if t.name == "information").rows
    assert {row[1] for row in rows} >= {"Z_de, m/s²", "M_de, %"}
    own = {"Z_de": ("m/s²", 0.5)}
    errors = {Quantity("parameter", "Z_de"): 4.0, Quantity("parameter", "M_de"): 4.0, Quantity("prediction", "V"): 1.0}
    assert errors_in_own_units(errors, own) == {
        Quantity("parameter", "Z_de", "m/s²"): 2.0,
        Quantity("parameter", "M_de"): 4.0,
        Quantity("prediction", "V"): 1.0,
    }


def test_a_suite_that_adds_nothing_buys_nothing(tmp_path: Path) -> None:
    names = [suite(tmp_path, n, "V", "q", "theta", "de_cmd") for n in ("a", "b")]
    more = f"best_case = true\n{dsr_e(12, 6)}"
    result = compare(CompareScenario.load(scenario(tmp_path, names, more=more)))
    assert result.gains
    for gain in result.gains:
        if gain.paired.difference is not None:
            assert gain.paired.difference.value == 0.0
            assert gain.p_holm == 1.0
    assert result.flights == 2
    assert result.too_few is not None
    assert "repetitions cannot show anything beyond chance" in " ".join(compare_sentences(result))


def test_same_seed_same_figures_and_the_first_repetitions_do_not_depend_on_their_number(tmp_path: Path) -> None:
    names = [
        suite(tmp_path, "a", "V", "q", "theta", "de_cmd"),
        suite(tmp_path, "b", "alpha", "V", "q", "theta", "de_cmd"),
    ]
    three, again, four = (compare(CompareScenario.load(scenario(tmp_path, names, seeds=n))) for n in (3, 3, 4))
    for case, errors in three.errors.items():
        for quantity, values in errors.items():
            assert values.tobytes() == again.errors[case][quantity].tobytes()
            np.testing.assert_array_equal(values, four.errors[case][quantity][:3])
    other = compare(CompareScenario.load(scenario(tmp_path, names)), seed=5)
    case = CaseKey("3211", "a", "best case")
    assert np.all(other.errors[case][Quantity("prediction", "q")] != three.errors[case][Quantity("prediction", "q")])
    assert len({derived_seed(0, k, i) for k in range(30) for i in range(3)}) == 90


def test_turbulence_is_flown_anew_in_every_repetition(tmp_path: Path) -> None:
    names = [
        suite(tmp_path, "a", "V", "q", "theta", "de_cmd"),
        suite(tmp_path, "b", "alpha", "V", "q", "theta", "de_cmd"),
    ]
    path = scenario(tmp_path, names)
    path.write_text(path.read_text() + "[air]\nturbulence_rms_m_s = 0.1\n", encoding="utf-8")
    few = compare(CompareScenario.load(path))
    assert few.flights == 6
    assert few.tally.reasons == {"fewer than 8 flights at once are not worth a batch": 6}
    path.write_text(path.read_text().replace("seeds = 3", "seeds = 4"), encoding="utf-8")
    many = compare(CompareScenario.load(path))
    assert (many.tally.batch, many.tally.jsbsim) == (8, 0)
    assert compare_page(many).flown is many.tally
    alone = compare(CompareScenario.load(path), simulator="jsbsim")
    assert alone.tally.reasons == {"it is wanted": 8}
    for case, errors in alone.errors.items():
        for quantity, values in errors.items():
            np.testing.assert_allclose(many.errors[case][quantity], values, rtol=1e-6)


def test_an_estimator_that_fails_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    names = [
        suite(tmp_path, "a", "V", "q", "theta", "de_cmd"),
        suite(tmp_path, "b", "alpha", "V", "q", "theta", "de_cmd"),
    ]
    more = f"best_case = true\n{dsr_e(200, 90)}"
    result = compare(CompareScenario.load(scenario(tmp_path, names, more=more)))
    assert {f.case.estimator for f in result.failures} == {"dsr_e"}
    assert len(result.failures) == 6
    assert {case.estimator for case in result.errors} == {"best case"}
    assert "6 identifications gave no model" in " ".join(compare_sentences(result))


# files


def test_every_fault_is_reported_at_once(tmp_path: Path) -> None:
    names = [suite(tmp_path, "a", "V", "q", "theta", "de"), suite(tmp_path, "b", "alpha", "V", "q", "theta", "de_cmd")]
    path = scenario(tmp_path, names)
    text = path.read_text().replace('"Z_alpha"', '"Z_alfa"').replace("[targets]", '[targets]\nmodes = ["shortperiod"]')
    path.write_text(text + '[placement]\nmodes = ["phugoid"]\naccelerometers = 1\nstrain_suite = "eolo_strain"\n')
    with pytest.raises(ScenarioError) as caught:
        CompareScenario.load(path)
    keys = [fault.removeprefix(f"{path}, ").split(":")[0] for fault in caught.value.faults]
    assert keys == ["suites[0]", "targets.parameters", "targets.modes", "placement"]
    assert "did you mean 'short period'" in caught.value.faults[2]
    path.write_text(text.replace("seeds = 3", "seeds = 1\nsuits = 2").replace('use = "validation"', 'use = "split"'))
    with pytest.raises(ScenarioError) as caught:
        CompareScenario.load(path)
    assert any("suits: unknown key 'suits'; did you mean 'suites'" in f for f in caught.value.faults)
    assert any("seeds: must be greater than or equal to 3, got 1" in f for f in caught.value.faults)


def test_two_estimators_of_one_name_are_refused(tmp_path: Path) -> None:
    one = dsr_e(12, 6)
    names = [suite(tmp_path, n, "V", "q", "theta", "de_cmd") for n in ("a", "b")]
    with pytest.raises(ScenarioError, match="labels of estimators must differ, got dsr_e, dsr_e"):
        CompareScenario.load(scenario(tmp_path, names, more=one + one))


# the packaged scenarios


@pytest.fixture(scope="module")
def packaged():
    loaded = CompareScenario.load("compare/eolo_alpha")
    flown = loaded.manoeuvre[1:]  # one input is enough here
    result = compare(loaded.model_copy(update={"seeds": 3, "test": "t", "manoeuvre": flown}))
    assert result.scenario.seeds == 3
    return result


def test_alpha_tells_the_fast_root_of_the_short_period(packaged) -> None:
    for name in packaged.manoeuvres:
        before, after = (packaged.predictions[name, s.name] for s in packaged.suites)
        root = before.names.index("wn of short period, fast root")
        assert after.std[root] < 0.5 * before.std[root]
    gain = next(g for g in packaged.gains if g.quantity.name == "Z_alpha" and g.case.manoeuvre == "doublet")
    assert gain.after < 0.5 * gain.before


def test_report_of_the_packaged_scenario(packaged, tmp_path: Path) -> None:
    paths = compare_page(packaged).write(tmp_path)
    page = paths[-1].read_text(encoding="utf-8")
    assert {p.name for p in paths} >= {"report.html", "errors.png", "gains.csv", "gains.json", "without_each.csv"}
    answer = compare_sentences(packaged)
    assert answer[0].startswith("adding alpha (400 €, 80 g) to eolo_no_alpha significantly reduces ")
    said = compare_answer(packaged)
    assert said[0] == ("lead", "adding alpha (400 €, 80 g) changes none of 19 errors by more than chance")
    assert page.index("The answer") < page.index('id="figure-errors"') < page.index("How it was compared")
    assert page.index("How it was compared") < page.index('<h2 id="tables">')
    assert page.count('id="figure-errors"') == 1
    gains = next(t for t in compare_tables(packaged) if t.name == "gains")
    assert len(gains.rows) == len(packaged.gains)


@pytest.mark.slow
def test_wing_sensors_make_the_elastic_modes_known() -> None:
    loaded = CompareScenario.load("compare/eolo_wing")
    result = compare(loaded.model_copy(update={"placement": None}), simulate=False)
    assert result.flights == 0
    assert not result.errors
    std = {s.name: result.predictions["sweep", s.name].of("wn of 1st symmetric wing bending") for s in result.suites}
    assert std["eolo_no_alpha"] > 20.0  # percent: the instruments of 2019 cannot tell it
    assert std["eolo_ten_accelerometers"] < std["eolo_five_accelerometers"] < 10.0
    assert std["eolo_strain"] < 1.0
    near = {s.name: result.predictions["sweep", s.name].near("wn of 1st symmetric wing bending") for s in result.suites}
    assert near == {name: "accelerometers" in name or name == "eolo_strain" for name in near}
    assert "for some quantities with eolo_no_alpha and eolo_alpha it is not" in " ".join(compare_sentences(result))


def test_nothing_is_known_without_the_only_sensor_beside_the_input(tmp_path: Path) -> None:
    loaded = CompareScenario.load(
        scenario(tmp_path, [suite(tmp_path, "a", "q", "de"), suite(tmp_path, "b", "V", "q", "de")], "de")
    )
    few, more = (compare(loaded, simulate=False).predictions["3211", n] for n in "ab")
    assert np.isfinite(few.std).all()
    assert (few.std > more.std).all()
    assert np.isinf(few.without["q"]).all()
    assert more.std * more.without["V"] == pytest.approx(few.std)


def test_missing_a_mode_is_compared_too(packaged) -> None:
    missed = [g for g in packaged.gains if g.quantity.kind == "missed"]
    assert {g.quantity.name for g in missed} >= {"short period, fast root"}
    for gain in missed:
        wn = Quantity("mode", f"wn of {gain.quantity.name}")
        base = gain.case._replace(suite=packaged.suites[0].name)
        for case, share in ((base, gain.before), (gain.case, gain.after)):
            assert share == pytest.approx(100.0 * np.mean(~np.isfinite(packaged.errors[case][wn])))
        assert gain.paired.pairs == packaged.scenario.seeds


def test_what_a_suite_buys_for_its_price(tmp_path: Path) -> None:
    base, more, same = (
        suite(tmp_path, n, *c, "de_cmd")
        for n, c in (("a", ("V", "q")), ("b", ("V", "q", "alpha")), ("c", ("V", "q", "theta")))
    )
    result = compare(CompareScenario.load(scenario(tmp_path, [base, more, same])), simulate=False)
    table = next(t for t in compare_tables(result) if t.name == "suites")
    rows = {row[0]: dict(zip([c.key for c in table.columns], row, strict=True)) for row in table.rows}
    before, after = (result.predictions["3211", n] for n in ("a", "b"))
    factor = np.exp(np.mean(np.log(before.std / after.std)))  # every suite tells all of them
    assert rows["b"]["divides"] == pytest.approx(factor)
    assert rows["b"]["per_100_eur"] == pytest.approx(factor)  # one sensor of 100 euros
    assert rows["b"]["per_100_g"] == pytest.approx(factor**10)  # and of 10 g
    assert rows["a"]["divides"] is None
    best = max("bc", key=lambda n: rows[n]["per_100_eur"])
    assert f"in the geometric mean: {best} per €" in " ".join(compare_sentences(result))


def test_beta_vane_by_information() -> None:
    result = compare(CompareScenario.load("compare/eolo_beta"), simulate=False)
    before, after = (result.predictions[result.manoeuvres[0], n] for n in result.scenario.suites)
    # all other sensors are the same; weights that overlook the noise of inputs may cost a little
    assert np.all(after.std < 1.02 * before.std)
    assert after.of("Y_beta") < 0.9 * before.of("Y_beta")


@pytest.mark.slow
def test_wing_sensors_scatter_as_information_predicts(tmp_path: Path) -> None:
    names = []
    for name in (
        "eolo_five_accelerometers",
        "eolo_strain",
    ):  # with the command known, the noise is that of sensors alone
        packaged_suite = load_suite(name)
        sensors = [s for s in packaged_suite.sensors if s.channel != "de"]
        command = KINDS["command_log"](channel="de_cmd", part="p", source="s")
        path = tmp_path / f"{name}.toml"
        path.write_text(suite_toml(replace(packaged_suite, sensors=(*sensors, command))), encoding="utf-8")
        names.append(str(path))
    path = scenario(tmp_path, names, seeds=12, wings="flexible")
    text = path.read_text().replace("[targets]", '[targets]\nmodes = ["1st symmetric wing bending"]')
    path.write_text(text.replace("amplitude_deg = 0.3", "amplitude_deg = 1.0"), encoding="utf-8")
    inside, _, total, _, ratios = compare(CompareScenario.load(path)).agreement
    assert total >= 10
    assert 0.3 < ratios[0] < ratios[2] < 2.5
    # were they independent, fewer than 70 % of 10 or more at 95 % would have a probability below 1.1e-3
    assert inside >= 0.7 * total


@pytest.mark.slow
def test_packaged_wing_suites_with_a_noisy_elevator_scatter_as_information_predicts() -> None:
    loaded = CompareScenario.load("compare/eolo_wing")
    suites = ("eolo_five_accelerometers", "eolo_strain")
    result = compare(loaded.model_copy(update={"placement": None, "suites": suites}))
    _, apart, total, far, ratios = result.agreement
    # 18 figures at 5 % for all together (Holm), with a fixed seed
    assert (apart, total, far) == (0, 18, 0)
    assert 0.5 < ratios[0] < ratios[2] < 1.7
    assert ratios[1] == pytest.approx(1.0, abs=0.15)
    assert "none differs by more than chance" in " ".join(compare_sentences(result))


@pytest.mark.slow
def test_bias_comes_from_a_flight_that_is_not_linear() -> None:
    loaded = CompareScenario.load("compare/eolo_wing")
    sweep, judge = loaded.manoeuvre
    slow = sweep.model_copy(update={"name": "slow", "input": (sweep.input[0].model_copy(update={"f_start_hz": 0.5}),)})
    changes = {
        "placement": None,
        "suites": ("eolo_five_accelerometers", "eolo_strain"),
        "manoeuvre": (slow, sweep, judge),
    }
    scenario = loaded.model_copy(update=changes)
    known = _known(scenario, load_aircraft("eolo", "flexible"), 0)
    suite = load_suite("eolo_five_accelerometers")
    experiment = Experiment(scenario, known, [suite], 0, "jsbsim")
    truths, _ = next(experiment.flights(lambda text: None))
    found = experiment.flight_errors(truths)
    wn, M_de = Quantity("mode", "wn of 1st symmetric wing bending"), Quantity("parameter", "M_de")
    assert abs(found["slow", suite.name][M_de]) > 5.0  # percent, without any noise
    assert abs(found["slow", suite.name][wn]) > 10.0
    assert abs(found["sweep", suite.name][M_de]) < 3.5
    assert abs(found["sweep", suite.name][wn]) < 5.0


def test_command_line(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from testbench.cli import app

    done = CliRunner().invoke(app, ["compare", "eolo_alpha", "--information", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "compare_eolo_alpha" / "report.html").is_file()
    assert "By information, adding alpha" in done.output
    for name in ("eolo_wing", "eolo_beta"):
        checked = CliRunner().invoke(app, ["check", f"compare/{name}"])
        assert "a valid comparison" in checked.output
