"""Designs after flights: what flights say together, the aircraft that is believed then, and what the next one adds."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from commands import command

import testbench as tb
from testbench.core.errors import EstimationError, RecordError
from testbench.core.paths import SCENARIOS
from testbench.design.problem import seen_in, total_errors
from testbench.design.realise import Errors, Realised
from testbench.flight import load_aircraft
from testbench.information.fisher import accuracy
from testbench.questions.design.ask import run_design
from testbench.questions.design.known import AllKnown, known_after, of_problem, together, with_values
from testbench.questions.design.page import design_page, known_table
from testbench.questions.design.pose import pose
from testbench.questions.design.ready import Promise, promise_text
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.files import promise_beside
from testbench.sensors import load_suite

FILE = SCENARIOS / "design" / "taurus_short_period.toml"


def scenario(name="taurus_short_period", **changes):
    content = tomllib.loads((SCENARIOS / "design" / f"{name}.toml").read_text(encoding="utf-8"))
    return DesignScenario.of({**content, "realise": 0, **changes}, None)


def short(percent=0.5, **changes):
    targets = {"parameters": dict.fromkeys(("M_alpha", "M_q", "M_de"), percent)}
    return scenario(duration_s=10.0, draws=0, targets=targets, **changes)


def posed(asked):
    return pose(asked, load_aircraft(asked.aircraft, asked.wings), load_suite(asked.suites[0]))


def model_file(path, names, values, covariance, structure="designed_for", **more):
    parameters = {n: {"value": v, "free": True} for n, v in zip(names, values, strict=True)}
    path.write_text(
        json.dumps({"structure": structure, "parameters": parameters, "covariance": covariance, **more}), "utf-8"
    )
    return path


@pytest.fixture(scope="module")
def first():
    return run_design(short())


def test_flights_together_are_the_least_squares_of_both():
    """x = argmin of the sum of both squares; the same by stacking whitened rows."""
    rng = np.random.default_rng(0)
    A, B = (m @ m.T + np.eye(len(m)) for m in (rng.standard_normal((2, 2)), rng.standard_normal((3, 3))))
    a = tb.Prior(("M_q", "M_de"), np.array([-2.0, -10.0]), A, "one")
    b = tb.Prior(("M_alpha", "M_q", "M_de"), np.array([-30.0, -2.5, -10.5]), B, "two")
    both = together([a, b])
    rows, right = [], []
    for p in (a, b):
        W = np.linalg.inv(np.linalg.cholesky(p.covariance))
        rows.append(W @ np.array([[float(n == m) for m in both.names] for n in p.names]))
        right.append(W @ p.values)
    J, y = np.vstack(rows), np.concatenate(right)
    np.testing.assert_allclose(both.values, np.linalg.lstsq(J, y)[0], rtol=1e-10)
    np.testing.assert_allclose(both.covariance, np.linalg.inv(J.T @ J), rtol=1e-10)
    assert both.notes == ()


def test_flights_that_contradict_each_other_count_less():
    a, b = (tb.Prior(("M_q",), np.array([v]), np.array([[1e-4]]), f"{v}") for v in (-2.0, -2.2))
    both = together([a, b])
    # square of both: 2 (0.1 / 0.01)^2 = 200 with one degree of freedom
    assert both.covariance[0, 0] == pytest.approx(0.5e-4 * 200.0)
    assert "differ by 14 times" in both.notes[0]


def test_model_files_are_read_with_their_meaning(tmp_path):
    file = model_file(tmp_path / "a.json", ("Z_alpha", "M_q"), (-5.0, -2.0), [[0.04, 0.0], [0.0, 0.01]], "short_period")
    known = known_after([file], 12.0)
    assert known.names == ("Z_alpha", "M_q")
    np.testing.assert_allclose(known.values, [-60.0, -2.0])  # per mass, not per momentum
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance)), [2.4, 0.1])
    assert any("does not state its airspeed" in n for n in known.notes)
    folder = tmp_path / "close_x"
    (folder / "models").mkdir(parents=True)
    more = {"condition": {"V_m_s": 12.1, "h_m": 0.0}, "flown_errors": {"M_q": 0.3}, "status": "wrong"}
    model_file(folder / "models" / "b.json", ("M_q",), (-2.0,), [[0.01]], **more)
    flown = known_after([folder], 12.0)
    assert flown.covariance[0, 0] == pytest.approx(0.09)  # the flown error counts where it exceeds the stated one
    assert [n for n in flown.notes if "has doubts about its model" in n]
    assert not [n for n in flown.notes if "speed" in n]
    with pytest.raises(EstimationError, match=r"speed of the design, 14 m/s, got 12\.1 m/s"):
        known_after([folder], 14.0)


def test_a_run_of_a_design_is_not_known_better_than_its_simulated_flights_show(tmp_path):
    """Errors of -0.3 +- 0.2 where 0.1 is stated: 0.1 becomes sqrt(0.2^2 + 0.3^2), not what was stated."""
    e = np.random.default_rng(3).standard_normal(40)
    e = -0.3 + 0.2 * (e - e.mean()) / e.std()
    off, right = np.column_stack([e, 0.1 * (e + 0.3) / 0.2]), np.full((40, 2), 0.1)
    realised = Realised(np.full(2, 0.1), Errors(off, right, ()), np.array([True, False]))
    values = np.array([-10.0, -2.0])
    promise = Promise(("M_de", "M_q"), values, np.full(2, np.nan), np.full(2, 0.1), {}, 12.0, 0.0, "", realised)
    (tmp_path / "promises").mkdir()
    (tmp_path / "promises" / "1_x.json").write_text(promise_text(promise), "utf-8")
    beside = promise_beside(tmp_path / "designs" / "1_x.toml")
    assert beside is not None
    more = {"condition": {"V_m_s": 12.0}, "promise": beside.as_posix()}
    run = model_file(tmp_path / "run.json", ("M_de", "M_q"), values.tolist(), [[0.01, 0.0], [0.0, 0.01]], **more)
    known = known_after([run], 12.0)
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance)), [np.hypot(0.2, 0.3), 0.1], rtol=1e-6)
    assert "beyond stated ones: M_de by 3.6" in known.notes[0]
    beside.unlink()
    stated = known_after([run], 12.0)
    np.testing.assert_allclose(np.sqrt(np.diag(stated.covariance)), [0.1, 0.1])
    assert "not there any more" in stated.notes[0]  # said, not passed over
    bare = model_file(tmp_path / "bare.json", ("M_q",), (-2.0,), [[0.01]], condition={"V_m_s": 12.0})
    assert "those of its estimator alone" in known_after([bare], 12.0).notes[0]


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"structure": "designed_for", "parameters": {"M_q": 3}}'])
def test_what_is_no_model_is_refused_with_its_file(tmp_path, text):
    file = tmp_path / "strange.json"
    file.write_text(text, "utf-8")
    with pytest.raises(RecordError, match=r"strange\.json"):
        known_after([file], 12.0)


def test_folders_and_structures_without_meaning_are_refused(tmp_path):
    with pytest.raises(RecordError, match="without one"):
        known_after([tmp_path], 12.0)
    file = model_file(tmp_path / "own.json", ("M_q",), (-2.0,), [[0.01]], "my_own")
    with pytest.raises(EstimationError, match="my_own"):
        known_after([file], 12.0)
    with pytest.raises(EstimationError, match="determine parameters of this design"):
        of_problem(tb.Prior(("N_r",), np.array([-1.0]), np.array([[0.1]]), "another"), posed(short()).problem)


@pytest.mark.parametrize("name", ["taurus_short_period", pytest.param("eolo_short_period", marks=pytest.mark.slow)])
def test_the_believed_aircraft_has_the_derivatives_that_were_flown(name):
    """Rigid and elastic aircraft alike: exact where the flights are, the model where they tell nothing."""
    asked = scenario(name)
    p = posed(asked)
    s = p.problem.experiment.structure
    names = tuple(n for n in s.parameter_names if n in ("Z_alpha", "M_alpha", "M_q", "M_de"))
    own = dict(zip(s.parameter_names, s.true.tolist(), strict=True))
    wanted = np.array([own[n] for n in names]) * np.array([1.1, 0.8, 1.3, 0.9])[: len(names)]
    sure = tb.Prior(names, wanted, np.diag((1e-6 * wanted) ** 2), "flown")
    new, notes = with_values(p.aircraft, p.trimmed, s, sure)
    again = replace(posed(asked), aircraft=new)
    q = pose(asked, again.aircraft, load_suite(asked.suites[0])).problem.experiment.structure
    found = dict(zip(q.parameter_names, q.true.tolist(), strict=True))
    np.testing.assert_allclose([found[n] for n in names], wanted, rtol=1e-4)
    assert notes == ()
    for n in set(own) - set(names):
        assert found[n] == pytest.approx(own[n], rel=0.02, abs=1e-3 * abs(own["M_alpha"]))
    vague = replace(sure, covariance=np.diag((100.0 * wanted) ** 2))
    same, _ = with_values(p.aircraft, p.trimmed, s, vague)
    r = pose(asked, same, load_suite(asked.suites[0])).problem.experiment.structure
    np.testing.assert_allclose(r.true, s.true, rtol=1e-3, atol=1e-6)


def test_the_next_input_is_made_for_what_is_uncertain(first):
    p, d = first.problem, first.best.design
    s = p.experiment.structure
    P = np.linalg.inv(d.information)
    P[0, :] *= 0.02  # one parameter is known fifty times better than the others
    P[:, 0] *= 0.02
    prior = tb.Prior(s.parameter_names, s.true, 0.5 * (P + P.T), "earlier flights")
    second = run_design(short(), after=prior)
    assert second.known is not None
    np.testing.assert_allclose(second.problem.experiment.structure.true, s.true, rtol=1e-6)
    # the total, by a second way: inverse of the sum of inverse covariances
    M = second.best.design.information
    total = np.linalg.inv(M + np.linalg.inv(prior.covariance))
    J = second.problem.targets.jacobian
    np.testing.assert_allclose(second.total(second.best), np.sqrt(np.diag(J @ total @ J.T)), rtol=1e-6)
    assert second.best.design.cost == pytest.approx(float(np.max(second.total(second.best) / p.targets.wanted)))
    # it is at least as good as flying the first one again
    assert second.best.design.cost <= seen_in(second.problem, d).cost * (1.0 + 1e-6)
    table = known_table(second.problem, second.known, second.total(second.best), second.best.errors)
    assert [r[0] for r in table.rows] == list(p.targets.names)
    page = design_page(second)
    assert "known" in {t.name for t in page.tables}
    assert any("known as well as wanted from the previous flights" in str(line) for line in page.answer)


def test_headline_errors_widen_the_flight_and_nothing_else(first):
    p, d = first.problem, first.best.design
    known = 0.5 * d.information
    q = replace(p, known=known)
    plain = total_errors(q, d, p.targets.errors(accuracy(d.information)))
    wider = total_errors(q, d, 3.0 * d.errors)
    alone = p.targets.errors(accuracy(known))
    assert np.all(plain < wider)
    assert np.all(wider < alone)
    huge = total_errors(q, d, 1e6 * d.errors)
    np.testing.assert_allclose(huge, alone, rtol=1e-3)


def test_where_everything_is_known_nothing_is_designed(first, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    s = first.problem.experiment.structure
    P = np.diag((0.01 * np.abs(s.true)) ** 2)
    prior = tb.Prior(s.parameter_names, s.true, P, "earlier flights")
    with pytest.raises(AllKnown, match="no flight is needed") as caught:
        run_design(short(5.0), after=prior)
    assert np.all(caught.value.known.errors <= caught.value.problem.targets.wanted)
    text = FILE.read_text("utf-8").split("[targets]")[0].replace("duration_s = 30.0", "duration_s = 10.0")
    asked = "[targets]\nparameters = { M_alpha = 5.0, M_q = 5.0, M_de = 5.0 }\n"
    (tmp_path / "mine.toml").write_text(text.replace("[condition]", "draws = 0\n\n[condition]") + asked, "utf-8")
    model_file(tmp_path / "m.json", s.parameter_names, s.true.tolist(), P.tolist(), condition={"V_m_s": 12.0})
    done = command("design", "mine.toml", "--after", "m.json")
    assert done.returncode == 0, done.stderr
    assert "Nothing has to be flown" in " ".join(done.stdout.split())
    assert (tmp_path / "results" / "design_mine_after_1" / "report.html").is_file()
    assert not (tmp_path / "results" / "design_mine_after_1" / "designs").exists()
