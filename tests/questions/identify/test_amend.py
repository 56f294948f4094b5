"""Identified derivatives written back into the user's aircraft: what is written, what is reached, what is refused."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from changed_flights import LATERAL, LONGITUDINAL, NOISE, changed_aircraft, described, flown, steps
from plain_fits import plain_fits
from typer.testing import CliRunner

import testbench as tb
from testbench.cli import app
from testbench.core.errors import EstimationError, ScenarioError, WriteError
from testbench.effects import SERVOS
from testbench.estimators.parametric.structures import Trim
from testbench.estimators.structured import Servo
from testbench.evaluation.derivatives import true_parameters
from testbench.questions.aircraft.contract import aircraft_laws
from testbench.questions.identify.amend.answer import amended_answer
from testbench.questions.identify.amend.ask import amend
from testbench.questions.identify.amend.choose import aims_of, chosen_case, derivatives_of, servo_aims
from testbench.questions.identify.amend.page import amended_plates
from testbench.questions.identify.ask import identify
from testbench.questions.identify.page import identify_page
from testbench.questions.identify.scenario import RecordDescription

pytestmark = pytest.mark.usefixtures("plain_fits")

V, H = 15.0, 100.0
FACTORS = {"Cm_q": 0.6, "Cm_alpha": 1.25, "CL_alpha": 1.1}
CONDITION = tb.FlightCondition(V, H)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    truth = changed_aircraft("taurus", FACTORS)
    flights = [flown(truth, V, H, {"de": steps(1.0, 0.24, 0.5)}, 6.0)]
    flights.append(flown(truth, V, H, {"de": steps(1.0, 0.4, 0.5, (1, 1))}, 6.0))
    folder = tmp_path_factory.mktemp("flights")
    return described(folder, "pitch", flights, "taurus", ["de"], ["V", "alpha", "q", "theta"], LONGITUDINAL, NOISE)


@pytest.fixture(scope="module", params=[True, pytest.param(False, marks=pytest.mark.slow)], ids=["plain", "mended"])
def found(request, file):
    with plain_fits(request.param):
        return identify(RecordDescription.load(file))


@pytest.fixture(scope="module")
def made(found, tmp_path_factory):
    return amend([found], str(tmp_path_factory.mktemp("project") / "mine"))["pitch"]


def true_derivatives(name="taurus", factors=FACTORS, condition=CONDITION, structure="longitudinal"):
    truth = changed_aircraft(name, factors)
    return derivatives_of(truth, tb.trim(truth, condition), structure)


def test_the_amended_aircraft_has_the_derivatives_of_the_truth_within_their_errors(made):
    truth = true_derivatives()
    assert {"M_q", "M_alpha", "Z_alpha"} <= {a.name for a in made.written}
    for a in made.aims:  # 8 of them beyond 4 errors by chance: 5e-4
        if a.name[2:] in ("alpha", "q", "de"):
            assert abs(a.reached - truth[a.name]) < 4.0 * a.std, a.name
    assert all(a.off < 1e-5 for a in made.written)


def test_the_folder_is_an_aircraft_that_keeps_every_law(made):
    loaded = tb.load_aircraft(made.folder)
    assert loaded.name == "mine"
    assert [law for law in aircraft_laws(loaded) if not law.holds] == []
    assert loaded.coefficient("Cm_q") / tb.load_aircraft("taurus").coefficient("Cm_q") == pytest.approx(0.6, abs=0.08)


def test_the_equilibrium_of_the_records_stays(made):
    old, new = (tb.trim(a, tb.FlightCondition(made.V_m_s, made.h_m)) for a in (made.old, made.new))
    assert new.alpha == pytest.approx(old.alpha, abs=1e-6)
    assert new.controls["de"] == pytest.approx(old.controls["de"], abs=1e-6)


def test_the_flight_that_was_not_used_is_followed_down_to_its_noise(made):
    misses = {m.channel: m for m in made.misses("validation")}
    for name in ("alpha", "q", "theta"):
        assert misses[name].after < misses[name].before, name
        noise = np.radians(NOISE[name])
        assert misses[name].after == pytest.approx(noise, rel=0.15), name  # 5 standard errors of 300 samples
    assert misses["q"].before > 1.5 * misses["q"].after
    assert 0.0 < misses["q"].theil_after < misses["q"].theil_before < 1.0


def test_the_answer_the_tables_and_the_folder_say_what_was_done(made, found):
    lead = amended_answer(made)[0]
    assert lead.text.startswith("'mine': M_q −")
    assert "pitch rate rms residual" in lead.text
    assert "on the record that it did not use" in lead.text
    page = identify_page(found, made)
    assert {"amended", "amended_coefficients", "amended_misses"} <= {t.name for t in page.more_tables}
    assert "amended" in [p.name for p in page.plates]
    sources = (made.folder / "SOURCES.md").read_text()
    record = found.flights[0].measured["recorded"]
    assert record.provenance["sha256"] in sources
    assert "| M_q |" in sources
    assert "# taurus: sources, as they were" in sources
    assert "2026" not in sources.split("# taurus: sources")[0]


def test_the_figure_shows_records_that_were_not_used_first(made, tmp_path):
    (plate,) = amended_plates(made)
    figure = plate.make(True)
    titles = [axes.get_title(loc) for axes in figure.axes for loc in ("left", "center")]
    assert [t for t in titles if t][:2] == ["flight 1, not used", "flight 0, used for identification"]
    assert len(figure.axes) == 8


def test_what_is_left_says_why(made):
    why = {a.name: a.why for a in made.aims if a.aimed is None}
    assert "no coefficient of its own" in why["X_V"]
    assert why["X_de"] in (
        "the data give little information on it",
        "not significantly different from before: within 3 errors",
    )
    by_name = {a.name: a for a in made.aims}
    assert by_name["X_de"].reached == pytest.approx(by_name["X_de"].before, abs=1e-6)


def test_changes_are_of_coefficients_so_that_another_speed_scales_as_physics_says(made):
    def change(V_m_s):
        condition = tb.FlightCondition(V_m_s, H)
        old, new = (derivatives_of(a, tb.trim(a, condition), "longitudinal") for a in (made.old, made.new))
        return {n: new[n] - old[n] for n in ("M_alpha", "M_q")}

    slow, fast = change(15.0), change(20.0)
    assert fast["M_alpha"] / slow["M_alpha"] == pytest.approx((20.0 / 15.0) ** 2, rel=1e-3)
    assert fast["M_q"] / slow["M_q"] == pytest.approx(20.0 / 15.0, rel=1e-3)


def test_an_amended_aircraft_is_amended_again(found, made, tmp_path):
    again = RecordDescription.load(found.source.file).changed(aircraft=str(made.folder))
    second = identify(again)
    with pytest.raises(EstimationError, match=r"nothing to write|none is left"):
        amend([second], str(tmp_path / "second"))
    assert not (tmp_path / "second").exists()


def test_exact_data_give_the_exact_derivatives(tmp_path):
    from scipy.linalg import expm

    from testbench.estimators.parametric.structures import longitudinal

    truth = true_derivatives()
    taurus = tb.load_aircraft("taurus")
    trimmed = tb.trim(taurus, CONDITION)
    structure = longitudinal(Trim(V, trimmed.alpha, trimmed.theta))
    params = np.array([truth.get(n, 0.0) for n in structure.parameter_names])
    m = structure.matrices(params)
    step = expm(np.block([[m.A, m.B], [np.zeros((1, 5))]]) / 50.0)
    records = []
    for signal in (steps(1.0, 0.24, 0.5), steps(1.0, 0.4, 0.5, (1, 1))):
        t = np.arange(300) / 50.0
        u = signal(t)
        x = np.zeros((300, 4))
        for k in range(299):
            x[k + 1] = step[:4, :4] @ x[k] + step[:4, 4] * u[k]
        at = np.array([V, trimmed.alpha, 0.0, trimmed.theta])
        columns = dict(zip(("V", "alpha", "q", "theta"), (x + at).T, strict=True))
        columns |= {"h": np.full(300, H), "de": u + trimmed.controls["de"]}
        records.append(
            tb.FlightRecord(
                t_s=t, channels=tuple(columns), data=np.column_stack(list(columns.values())), kind="measured"
            )
        )
    file = described(tmp_path, "exact", records, "taurus", ["de"], ["V", "alpha", "q", "theta"], LONGITUDINAL,
                     {n: 1e-4 * v for n, v in NOISE.items()})  # fmt: skip
    exact = amend([identify(RecordDescription.load(file))], str(tmp_path / "mine"))["exact"]
    for a in exact.aims:
        if a.name[2:] in ("alpha", "q", "de"):
            assert a.reached == pytest.approx(truth[a.name], rel=1e-4, abs=1e-3), a.name


def test_the_command_writes_the_aircraft_and_the_next_one_takes_it(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("testbench.page.page.write_plates", lambda plates, folder: ([], []))  # drawn below, once
    run = CliRunner().invoke
    done = run(app, ["identify", str(file), "--amend", "mine"])
    assert done.exit_code == 0, done.output
    assert "'mine': M_q" in done.output
    assert "aircraft/mine" in done.output
    html = (tmp_path / "results/pitch/report.html").read_text()
    assert "the amended aircraft" in html
    checked = run(app, ["check", "aircraft/mine"])
    assert checked.exit_code == 0, checked.output
    assert "9 laws kept" in checked.output
    assert "which is amended: give another name" in refused(file, "--amend", "mine", "--aircraft", "aircraft/mine")
    (tmp_path / "aircraft/own").mkdir()
    (tmp_path / "aircraft/own/aircraft.toml").write_text("mine")
    assert "no manifest lists 'aircraft/own/aircraft.toml'" in refused(file, "--amend", "own")
    assert (tmp_path / "aircraft/own/aircraft.toml").read_text() == "mine"


def refused(file, *more):
    done = CliRunner().invoke(app, ["identify", str(file), *more])
    assert done.exit_code != 0
    return str(done.exception) + done.output


def test_each_refusal_says_what_to_do(file, found, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bare = tmp_path / "bare.toml"
    bare.write_text(file.read_text().replace('aircraft = "taurus"\n', ""))
    assert "give --aircraft" in refused(bare, "--amend", "mine")
    assert "which is packaged" in refused(file, "--amend", "eolo")
    assert "letters, digits" in refused(file, "--amend", "my plane")
    (tmp_path / "aircraft").write_text("a file where the folder would be")
    with pytest.raises(WriteError, match="can be written to"):
        amend([found], "mine")
    other = replace(found, source=found.source.changed(aircraft="eolo"))
    with pytest.raises(ScenarioError, match="one aircraft"):
        amend([found, other], str(tmp_path / "mine"))


def test_a_model_that_must_not_be_used_is_not_written(found, tmp_path):
    from testbench.core.advice import wrong

    case = found.cases[0]
    bad = replace(case, model=replace(case.model, advice=(wrong("feedback", "the pilot closed the loop"),)))
    assert bad.model.status == "wrong"
    with pytest.raises(EstimationError, match="the pilot closed the loop"):
        amend([replace(found, cases=(bad,))], str(tmp_path / "mine"))
    assert not (tmp_path / "mine").exists()


def test_parameters_without_a_known_meaning_are_not_written(found, tmp_path):
    case = found.cases[0]
    own = replace(case, model=replace(case.model, structure=replace(case.model.structure, means="")))
    with pytest.raises(EstimationError, match="equations of your own"):
        amend([replace(found, cases=(own,))], str(tmp_path / "mine"))


def test_of_several_models_the_one_is_taken_that_predicts_unseen_records_best(found):
    case = found.cases[0]
    scores = replace(case.evaluation, validation=replace(case.evaluation.validation, mrse_percent=np.full(4, 99.0)))
    both = replace(found, cases=(replace(case, evaluation=scores), case))
    index, rule = chosen_case(both)
    assert index == 1
    assert "of 2 models" in rule
    assert chosen_case(found) == (0, "")


def test_two_that_are_known_only_together_are_not_both_written(found):
    """One of a pair with correlation 0.999, 0.9 errors off each, is held; then the other is not told either."""
    case = found.cases[0]
    model = case.model
    i, j = (model.structure.parameter_names.index(n) for n in ("M_alpha", "M_q"))
    P = np.diag(np.diag(model.covariance))
    P[i, j] = P[j, i] = 0.999 * np.sqrt(P[i, i] * P[j, j])
    before = {d.name: d.before for d in found.derivatives}
    params = np.array(model.params)
    params[i], params[j] = before["M_alpha"] + 0.9 * np.sqrt(P[i, i]), before["M_q"] + 0.9 * np.sqrt(P[j, j])
    pair = replace(case, model=replace(model, params=params, covariance=P))
    derivatives = tuple(
        replace(d, value=float(params[model.structure.parameter_names.index(d.name)])) for d in found.derivatives
    )
    aims, _ = aims_of(replace(found, cases=(pair,), derivatives=derivatives), 0)
    by_name = {a.name: a.aimed for a in aims}
    assert by_name["M_alpha"] is None
    assert by_name["M_q"] is None
    assert by_name["Z_alpha"] is not None
    assert true_parameters("my_equations", (), V) == {}


def test_a_flight_of_the_aircraft_itself_writes_something_in_two_percent_of_draws(found):
    """8 parameters with the errors of a real fit, 400 draws about what they were: within 3 errors of 2.1 %."""
    case, rng = found.cases[0], np.random.default_rng(5)
    names = case.model.structure.parameter_names
    own = [d for d in found.derivatives if d.name[2:] in ("alpha", "q", "de")]
    index, before = [names.index(d.name) for d in own], np.array([d.before for d in own])
    P = case.model.covariance
    root = np.linalg.cholesky(P[np.ix_(index, index)])
    written = 0
    for _ in range(400):
        drawn = before + root @ rng.standard_normal(len(own))
        params = np.array(case.model.params)
        params[index] = drawn
        pair = replace(case, model=replace(case.model, params=params))
        values = dict(zip((d.name for d in own), drawn, strict=True))
        derivatives = tuple(replace(d, value=values[d.name], believed="determined") for d in own)
        with suppress(EstimationError):  # there is nothing to write
            aims_of(replace(found, cases=(pair,), derivatives=derivatives), 0)
            written += 1
    assert written <= 19  # 8.6 +- 2.9 if independent; more than 19 by chance: 1e-3


def assert_reached(written, true, names, share):
    """Every aim is reached, and those named are the truth within 4 errors, or a share of it."""
    for a in written:
        assert a.off < 1e-3
        if a.name in names:
            assert abs(a.reached - true[a.name]) < max(4.0 * a.std, share * abs(true[a.name])), a.name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "factors", "V_m_s", "h_m", "unit_s"),
    [
        ("jsbsim:c172p", {"Cm_q": 0.7, "Cm_alpha": 1.3, "CL_alpha": 1.1, "Cm_de": 0.9}, 45.0, 1000.0, 0.5),
        ("eolo", {"Cm_q": 0.7, "Cm_alpha": 1.3}, 16.0, 547.0, 0.3),
        ("b1", {"Cm_q": 0.7, "Cm_alpha": 1.3}, 250.0, 5000.0, 0.5),
    ],
)
def test_any_aircraft_gets_the_derivatives_of_the_truth(tmp_path, name, factors, V_m_s, h_m, unit_s):
    if name == "b1":
        b1 = tb.load_aircraft("b1")
        V_m_s, h_m = b1.design_V_m_s, b1.design_h_m
    truth = changed_aircraft(name, factors)
    flights = [flown(truth, V_m_s, h_m, {"de": steps(1.0, unit_s, 1.0)}, 12.0)]
    flights.append(flown(truth, V_m_s, h_m, {"de": steps(1.0, 2.0 * unit_s, 1.0, (1, 1))}, 12.0))
    file = described(tmp_path, "any", flights, name, ["de"], ["V", "alpha", "q", "theta"], LONGITUDINAL, NOISE)
    done = amend([identify(RecordDescription.load(file))], str(tmp_path / "mine"))["any"]
    true = true_derivatives(name, factors, tb.FlightCondition(V_m_s, h_m))
    assert {"M_q", "M_alpha"} <= {a.name for a in done.written}
    assert_reached(done.written, true, ("M_q", "M_alpha", "M_de"), 0.05)
    misses = {m.channel: m for m in done.misses("validation")}
    assert misses["q"].after < 0.9 * misses["q"].before
    assert [law for law in aircraft_laws(tb.load_aircraft(done.folder)) if not law.holds] == []


@pytest.mark.slow
@pytest.mark.parametrize(("name", "V_m_s", "h_m"), [("taurus", 15.0, 100.0), ("jsbsim:f16", 150.0, 3000.0)])
def test_lateral_derivatives_are_written(tmp_path, name, V_m_s, h_m):
    factors = {"Cl_p": 0.7, "Cn_beta": 1.3, "Cl_da": 1.2}
    truth = changed_aircraft(name, factors)
    first = {"da": steps(1.0, 0.4, 2.0, (1, 1)), "dr": steps(3.0, 0.3, 2.0)}
    second = {"da": steps(1.0, 0.2, 1.5), "dr": steps(3.0, 0.4, 1.5, (1, 1))}
    flights = [flown(truth, V_m_s, h_m, u, 8.0) for u in (first, second)]
    file = described(tmp_path, "roll", flights, name, ["da", "dr"], ["beta", "p", "r", "phi"], LATERAL, NOISE)
    done = amend([identify(RecordDescription.load(file))], str(tmp_path / "mine"))["roll"]
    true = true_derivatives(name, factors, tb.FlightCondition(V_m_s, h_m), "lateral_directional")
    assert {"L_p", "N_beta", "L_da"} <= {a.name for a in done.written}
    assert_reached(done.written, true, ("L_p", "N_beta", "L_da"), 0.03)
    misses = {m.channel: m for m in done.misses("validation")}
    assert misses["p"].after < 0.5 * misses["p"].before
    assert misses["r"].after < 0.7 * misses["r"].before


@pytest.mark.slow
def test_both_motions_of_one_flight_go_into_one_aircraft(found, tmp_path):
    truth = changed_aircraft("taurus", {**FACTORS, "Cl_p": 0.7})
    signals = ({"da": steps(1.0, 0.4, 1.0, (1, 1)), "dr": steps(3.0, 0.3, 1.0)}, {"da": steps(1.0, 0.2, 1.0)})
    flights = [flown(truth, V, H, u, 8.0) for u in signals]
    file = described(tmp_path, "roll", flights, "taurus", ["da", "dr"], ["beta", "p", "r", "phi"], LATERAL, NOISE)
    done = amend([found, identify(RecordDescription.load(file))], str(tmp_path / "mine"))
    assert set(done) == {"pitch", "roll"}
    assert {"M_q", "L_p"} <= {a.name for part in done.values() for a in part.written}
    for part in done.values():
        assert all(a.off < 1e-3 for a in part.written)
    assert {c.name for c in done["roll"].coefficients}.isdisjoint(c.name for c in done["pitch"].coefficients)


@pytest.mark.slow
def test_a_servo_that_was_estimated_is_written(tmp_path):
    from testbench.aircraft import Amendment, SetProperty

    lag = Amendment("lag", "slow servo", (SetProperty("fcs/elevator-lag-rad_sec", 14.0),))
    truth = changed_aircraft("taurus", {"Cm_q": 0.7, "Cm_alpha": 1.2}).amended(lag)
    flights = [flown(truth, V, H, {"de": steps(1.0, 0.24, 0.5)}, 8.0)]
    flights.append(flown(truth, V, H, {"de": steps(1.0, 0.4, 0.5, (1, 1))}, 8.0))
    servo = LONGITUDINAL + 'servo = { de_cmd = { lag_s = "estimate" } }\n'
    file = described(tmp_path, "servo", flights, "taurus", ["de_cmd"], ["V", "alpha", "q", "theta"], servo, NOISE)
    done = amend([identify(RecordDescription.load(file))], str(tmp_path / "mine"))["servo"]
    (servo_aim,) = done.servos
    assert servo_aim.control == "de"
    assert servo_aim.before_s == pytest.approx(1.0 / 33.0)
    assert servo_aim.reached_s == pytest.approx(servo_aim.lag_s)
    assert abs(servo_aim.lag_s - 1.0 / 14.0) < 4.0 * servo_aim.std_s
    misses = {m.channel: m for m in done.misses("validation")}
    assert misses["q"].after < 0.6 * misses["q"].before


def test_a_delay_is_not_written_but_said_and_what_is_said_delays_the_amended_aircraft_once(found, made):
    case = found.cases[0]
    late = case.estimator.model_copy(update={"servo": {"de_cmd": Servo(lag_s=1.0 / 33.0, delay_s=0.1)}})
    _, notes = servo_aims(replace(found, cases=(replace(case, estimator=late),)), 0)
    (note,) = (text for text in notes if text.startswith("the delay of de, 100 ms, is not written"))
    assert "SERVOS['delay', 'de'] of testbench.effects" in note
    suite = tb.load_suite("taurus_8hz")
    delayed, _ = SERVOS["delay", "de"].amend(made.new, suite, {"delay_s": 0.1})
    t = np.arange(round(3.0 * made.new.rate_hz)) / made.new.rate_hz
    signal = tb.InputSignal(t, steps(1.0, 0.24, 0.5)(t)[:, None], ("de",))
    at_once, after = (
        tb.fly_and_measure(tb.Job(a, tb.trim(a, CONDITION), tb.Manoeuvre("step", signal, 0.0), made.new.rate_hz)).flown[
            "de"
        ]
        for a in (made.new, delayed)
    )
    later = round(0.1 * made.new.rate_hz)
    assert np.ptp(at_once) > 0.01
    np.testing.assert_allclose(after[later:], at_once[:-later], atol=1e-3 * np.ptp(at_once))


@pytest.mark.slow
def test_an_aircraft_from_its_geometry_is_amended_with_what_is_known_of_its_coefficients(tmp_path):
    pytest.importorskip("aerosandbox")
    from any_aircraft import VISITORS

    trainer = next(v for v in VISITORS if v.from_geometry).made(tmp_path)
    factors = {"Cm_q": 0.7, "Cm_alpha": 1.2}
    truth = changed_aircraft(trainer.name, factors)
    flights = [flown(truth, 14.0, 100.0, {"de": steps(1.0, 0.24, 1.0)}, 6.0)]
    flights.append(flown(truth, 14.0, 100.0, {"de": steps(1.0, 0.4, 1.0, (1, 1))}, 6.0))
    file = described(tmp_path, "trainer", flights, trainer.name, ["de"], ["V", "alpha", "q", "theta"], LONGITUDINAL,
                     NOISE)  # fmt: skip
    done = amend([identify(RecordDescription.load(file))], str(tmp_path / "mine"))["trainer"]
    assert {"M_q", "M_alpha"} <= {a.name for a in done.written}
    old, new = tb.load_aircraft(trainer.name), tb.load_aircraft(done.folder)
    assert new.coefficient("Cm_alpha") / old.coefficient("Cm_alpha") == pytest.approx(1.2, abs=0.1)
    assert new.uncertainty["Cm_alpha"] < old.uncertainty["Cm_alpha"]
    assert new.uncertainty["Cn_beta"] == old.uncertainty["Cn_beta"]
