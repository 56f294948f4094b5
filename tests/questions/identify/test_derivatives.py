"""From a log to derivatives: what a new user's commands give, and what is said of servos, holds and the aircraft."""

import json
from functools import cache
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import testbench as tb
from testbench.cli import app
from testbench.core.errors import RecordError, ScenarioError
from testbench.estimators.settings import EquationErrorEntry
from testbench.estimators.structured import Servo
from testbench.questions.identify.answer import identify_answer, passed
from testbench.questions.identify.ask import identify
from testbench.questions.identify.derivatives import _beliefs, servos_of
from testbench.questions.identify.page import identify_page
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log, write_import

RATE = 50.0
TRUE = {"Z_alpha": -40.0, "M_alpha": -12.0, "M_q": -6.0, "M_de": -20.0}


@cache
def table(lag: float, control: str = "de_cmd") -> str:
    """A CSV of a short period at 20 m/s behind a servo, with noise: two 3-2-1-1, degrees and m/s."""
    n, fine = round(60.0 * RATE), 20
    t = np.arange(n) / RATE
    u = np.zeros(n)
    for begin in (5.0, 30.0):
        at, sign = begin, 1.0
        for k in (3, 2, 1, 1) * 2:
            u[(t >= at - 1e-9) & (t < at + 0.3 * k - 1e-9)] = 0.05 * sign
            at, sign = at + 0.3 * k, -sign
    A, B = np.array([[-2.0, 1.0], [-12.0, -6.0]]), np.array([-0.1, -20.0])
    x, delta, out, h = np.zeros(2), 0.0, np.zeros((n, 2)), 1.0 / RATE / fine
    for k in range(n):
        out[k] = x
        for _ in range(fine):
            new = u[k] + (delta - u[k]) * np.exp(-h / lag) if lag else u[k]
            middle = x + 0.5 * h * (A @ x + B * delta)
            x = x + h * (A @ middle + B * 0.5 * (delta + new))
            delta = new
    rng = np.random.default_rng(3)
    V = 20.0 + 0.05 * rng.standard_normal(n)
    alpha, q = (out + np.array([0.002, 0.004]) * rng.standard_normal(out.shape)).T
    columns = [t, V, np.degrees(0.05 + alpha), np.degrees(q), np.degrees(0.02 + u)]
    head = f"time [s],V [m/s],alpha [deg],q [deg/s],{control} [deg]"
    text = StringIO()
    np.savetxt(text, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.7g")
    return text.getvalue()


def described(tmp_path, lag: float, control: str = "de_cmd", edit=lambda text: text) -> RecordDescription:
    folder = tmp_path / "records"
    log = tmp_path / "flight.csv"
    log.write_text(table(lag, control))
    file = write_import(import_log(log), folder)[-1]
    file.write_text(edit(file.read_text()))
    return RecordDescription.load(file)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """What identify finds in the log as it was imported."""
    return identify(described(tmp_path_factory.mktemp("plain"), 0.08))


def test_what_import_writes_gives_derivatives_that_cover_the_truth(plain):
    by_name = {d.name: d for d in plain.derivatives}
    for name, value in {**TRUE, "tau_de": 0.08}.items():  # 5 of them beyond 4 errors by chance: 3e-4
        assert abs(by_name[name].value - value) < 4.0 * by_name[name].std, name
    assert by_name["M_q"].determined
    assert by_name["M_q"].unit == "1/s"
    assert plain.doubts == ()
    lines = identify_answer(plain)
    assert lines[0].kind == "lead"
    assert "determined" in lines[0].text
    page = identify_page(plain)
    assert page.terminal[0].name == "derivatives"
    assert page.more_tables[0].name == "derivatives"


@pytest.mark.parametrize("ignored", [False, True])
def test_a_command_taken_for_the_surface_has_its_servo_tried_or_is_in_doubt(tmp_path, ignored):
    servo = 'lag_s = "estimate"'
    found = identify(
        described(
            tmp_path,
            0.08,
            edit=lambda text: text.replace(servo, "ignore = true") if ignored else text.split("[servo.de_cmd]")[0],
        )
    )
    first, *others = [d for d in found.derivatives if d.name == "M_q"]
    if ignored:  # knowingly: no servo is tried
        (doubt,) = found.doubts
        assert "de_cmd: the command is used as the surface" in doubt
        assert [line.kind for line in identify_answer(found)].count("doubt") >= 1
        assert abs(first.value - TRUE["M_q"]) > 4.0 * first.std
        return
    assert found.doubts == ()
    assert abs(first.value - TRUE["M_q"]) < 4.0 * first.std  # with the lag that was tried
    assert found.replaced == {1}
    assert [d.believed for d in others] == ["replaced"]
    assert any("a lag behind de_cmd" in note for note in found.notes)


@pytest.mark.usefixtures("plain_and_mended")
def test_an_estimator_that_refuses_costs_the_other_nothing(plain, tmp_path):
    """Too short a record for 4000 block rows: one of two gives no model."""
    edit = "[[identification.estimators]]\nmethod = 'dsr_e'\norder = 2\npast_horizon = 2000\nfuture_horizon = 2000\n\n"
    both = identify(described(tmp_path, 0.08, edit=lambda text: text.replace("[servo.", f"{edit}[servo.")))
    assert [d.value for d in both.derivatives] == [d.value for d in plain.derivatives]
    (cell,) = both.failed
    assert cell.estimator == "dsr_e"
    page = identify_page(both)
    assert any(cell.reason in line.text for line in page.answer)
    (table,) = [t for t in page.terminal if t.name == "failed"]
    assert table.rows == ((cell.suite, "dsr_e", cell.reason),)
    assert table.rows in [t.rows for t in page.tables]


def test_a_surface_that_steps_is_said_to_be_taken_as_held(tmp_path):
    found = identify(described(tmp_path, 0.0, "de"))
    assert found.doubts == ()
    assert any("held from sample to sample: de" in text for text in found.notes)
    M_de = next(d for d in found.derivatives if d.name == "M_de")
    assert abs(M_de.value - TRUE["M_de"]) < 4.0 * M_de.std


@pytest.mark.usefixtures("plain_and_mended")
def test_an_aircraft_gives_values_before_and_coefficients(tmp_path):
    found = identify(described(tmp_path, 0.0, "de", lambda text: 'aircraft = "eolo"\n' + text))
    M_q = next(d for d in found.derivatives if d.name == "M_q")
    eolo = tb.load_aircraft("eolo")
    assert M_q.source == eolo.name
    assert M_q.before is not None
    assert M_q.changed
    symbol, value, std = M_q.coefficient
    assert symbol == "Cm_q"
    g, qbar = eolo.geometry, found.before.qbar_Pa
    expected = M_q.value * eolo.mass.Iyy / (qbar * g.S_m2 * g.cbar_m) * 2.0 * found.before.condition.V_m_s / g.cbar_m
    assert value == pytest.approx(expected, rel=1e-12)
    assert std / abs(value) == pytest.approx(M_q.std / abs(M_q.value), rel=1e-9)
    assert found.before.condition.V_m_s == pytest.approx(20.0, abs=0.05)
    assert any("no height" in text for text in found.notes)


def test_the_servo_of_an_aircraft_is_taken_where_the_description_gives_none():
    servo = servos_of(tb.load_aircraft("b1"), ("de_cmd", "thr_cmd", "de"))
    assert set(servo) == {"de_cmd"}
    assert servo["de_cmd"].lag_s == pytest.approx(0.05)
    assert servo["de_cmd"].rate_limit_deg_s == pytest.approx(np.degrees(1.0))


def test_it_is_said_which_servo_a_command_passed_where_an_estimator_has_one_of_its_own():
    stated = Servo(lag_s=0.05, rate_limit_deg_s=60.0)

    def case(label, **own):
        estimator = EquationErrorEntry(method="equation_error", structure="short_period", **own)
        return SimpleNamespace(label=label, estimator=estimator, model=SimpleNamespace(inputs=("de_cmd",)))

    of_aircraft = case("first", servo={"de_cmd": stated})
    of_its_own = case("second", servo={"de_cmd": Servo(lag_s=0.02, delay_s=0.01)})
    late = case("third", delays_s={"de_cmd": 0.03})
    said = "the servo of b1 (a lag of 0.05 s, at most 60 deg/s)"
    described = SimpleNamespace(aircraft="b1")
    assert passed("de_cmd", stated, described, [of_aircraft]) == [f"de_cmd passes {said}"]
    assert passed("de_cmd", stated, described, [of_aircraft, of_its_own, late]) == [
        f"de_cmd passes {said} in first",
        f"de_cmd passes a lag of 0.02 s, a delay of 10 ms, which replaces {said} in second",
        f"de_cmd passes a delay of 30 ms alone, which replaces {said} in third",
    ]


def test_a_servo_of_what_is_no_input_is_refused_with_its_key(tmp_path):
    with pytest.raises(ScenarioError, match=r"servo\.da_cmd"):
        described(tmp_path, 0.08, edit=lambda text: text + "\n[servo.da_cmd]\nlag_s = 0.1\n")


@pytest.mark.usefixtures("plain_and_mended")
def test_identify_takes_a_log_itself(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.csv").write_text(table(0.08))
    done = CliRunner().invoke(app, ["identify", "flight.csv", "--out", "results"])
    assert done.exit_code == 0, done.output
    assert "M_q" in done.output
    assert (tmp_path / "results/flight/flight_longitudinal.toml").is_file()
    html = (tmp_path / "results/flight_longitudinal/report.html").read_text()
    assert html.index('id="derivatives"') < html.index('id="flown"')


@pytest.mark.usefixtures("plain_and_mended")
def test_identify_takes_the_folder_that_import_wrote(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight.csv").write_text(table(0.08))
    shown = CliRunner().invoke(app, ["import", "flight.csv", "--out", "mylog"])
    assert shown.exit_code == 0
    assert "can be cut out, with quiet flight before and after" in " ".join(shown.output.split())
    done = CliRunner().invoke(app, ["identify", "mylog", "--out", "results"])
    assert done.exit_code == 0, done.output
    assert "M_q" in done.output
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordError, match=r"must hold a description of records \(.toml\), got 'empty'"):
        CliRunner().invoke(app, ["identify", "empty"], catch_exceptions=False)


@pytest.mark.parametrize(("whiteness", "believed"), [([0.0, 0.4], "determined"), ([0.0, 0.0], "in doubt")])
def test_the_colour_of_one_output_alone_is_held_against_what_it_touches(whiteness, believed):
    names = ["Z_alpha", "M_q"]
    model = SimpleNamespace(
        values={"Z_alpha": -2.0, "M_q": -3.0},
        standard_errors={"Z_alpha": 0.1, "M_q": 0.1},
        structure=SimpleNamespace(parameters=names, free=np.ones(2, bool)),
        status="good",
        diagnostics={"correlation": np.eye(2), "error_inflation": np.array([2.4, 1.2]), "whiteness_p": whiteness},
    )
    assert _beliefs(model, names) == {"Z_alpha": "in doubt", "M_q": believed}


def test_errors_of_simulated_flights_count_where_they_are_larger(plain, tmp_path):
    described(tmp_path, 0.08)
    stated = {d.name: d.std for d in plain.derivatives}
    asked = {"M_q": 5.0 * stated["M_q"], "M_de": 0.5 * stated["M_de"], "Z_alpha": 1000.0}
    more = "\n".join(f"{name} = {value!r}" for name, value in asked.items())
    file = next(iter((tmp_path / "records").glob("*.toml")))
    text = file.read_text("utf-8")
    given = f'\n[simulated_errors]\nsource = "20 simulated flights"\n[simulated_errors.errors]\n{more}\n'
    file.write_text(text + given, "utf-8")
    found = identify(RecordDescription.load(file))
    by_name = {d.name: d for d in found.derivatives}
    assert by_name["M_q"].std == pytest.approx(asked["M_q"])
    assert by_name["M_q"].stated == pytest.approx(stated["M_q"])
    assert by_name["M_de"].std == pytest.approx(stated["M_de"])
    assert by_name["Z_alpha"].believed == "weak"
    (said,) = (note for note in found.notes if "20 simulated flights" in note)
    assert "M_de" not in said
    (model,) = [json.loads(text) for name, text in identify_page(found).files.items() if name.startswith("models/")]
    assert model["flown_errors"] == {n: pytest.approx(asked[n]) for n in ("Z_alpha", "M_q")}
    file.write_text(text + given.replace("M_q", "M_qq"), "utf-8")
    with pytest.raises(ScenarioError, match=r"errors\.M_qq: .* did you mean 'M_q'"):
        identify(RecordDescription.load(file))
