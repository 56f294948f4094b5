"""Logs at several speeds, heights and masses into one set of coefficients: from descriptions, and what is refused."""

import csv
import json

import numpy as np
import pytest
from commands import ends
from plain_fits import plain_fits
from pooled_logs import CBAR, GEOMETRY, TRUE, B, S, description, record, write_day, write_record
from taurus_logs import true_coefficients, write_log

import testbench as tb
from testbench.aircraft.geometry.coefficients import relative_deviation
from testbench.aircraft.model import Geometry
from testbench.core.atmosphere import air_density
from testbench.core.errors import EstimationError, RecordError, ScenarioError
from testbench.evaluation.coefficients import PartialMass, Scaling, weights
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.page.words import MOST_WORDS, brief
from testbench.pooling.prior import prior_of_file
from testbench.questions.identify.ask import identify
from testbench.questions.identify.pool.answer import pool_answer
from testbench.questions.identify.pool.ask import identify_and_pool
from testbench.questions.identify.pool.page import pool_page
from testbench.questions.identify.scenario import Pooling, RecordDescription

pytestmark = pytest.mark.usefixtures("plain_fits")

CONDITIONS = ((12.0, 1.8, 100.0), (15.0, 2.2, 900.0), (19.0, 1.8, 400.0))


def days(folder, conditions=CONDITIONS, **more):
    return [
        RecordDescription.load(write_day(folder, f"day{i}", V, m, 0.08 * m / 1.8, h_m=h, seed=i, **more))
        for i, (V, m, h) in enumerate(conditions)
    ]


def test_exact_logs_at_three_conditions_give_the_coefficients_exactly(tmp_path):
    found = identify_and_pool(days(tmp_path, noise=0.0)).pooled
    for name, value in TRUE.items():
        assert found.coefficient(name).value == pytest.approx(value, rel=1e-7), name
    assert [log.at["mass"] for log in found.logs] == [1.8, 2.2, 1.8]
    for log, (V, _, h) in zip(found.logs, CONDITIONS, strict=True):
        assert log.at["qbar"] == pytest.approx(0.5 * air_density(h) * V**2, rel=1e-9)
        assert log.at["alpha"] == pytest.approx(0.05, abs=0.01)


@pytest.fixture(scope="module", params=[True, pytest.param(False, marks=pytest.mark.slow)], ids=["plain", "mended"])
def pooled(request, tmp_path_factory):
    with plain_fits(request.param):
        return identify_and_pool(days(tmp_path_factory.mktemp("days")), settings=Pooling(prior=None))


def test_noisy_logs_cover_the_truth_and_agree(pooled):
    assert pooled.pooled.agree
    for name, value in TRUE.items():  # one of six beyond 4 errors by chance: 4e-4
        c = pooled.pooled.coefficient(name)
        assert abs(c.value - value) < 4.0 * c.std, name
        own = [float(log.covariance[i, i]) ** 0.5 for log in pooled.pooled.logs for i in [log.names.index(name)]]
        assert c.std < min(own)


def test_errors_of_simulated_flights_weigh_a_log_less(tmp_path):
    (day,) = days(tmp_path, CONDITIONS[:1])
    plain = identify_and_pool([day], settings=Pooling(prior=None)).pooled.logs[0]
    stated = {d.name: d.std for d in identify(day).derivatives}
    given = f'\n[simulated_errors]\nsource = "20 flights"\nerrors = {{ M_q = {3.0 * stated["M_q"]!r} }}\n'
    day.file.write_text(day.file.read_text("utf-8") + given, "utf-8")
    known = identify_and_pool([RecordDescription.load(day.file)], settings=Pooling(prior=None)).pooled.logs[0]
    ratio = np.sqrt(np.diag(known.covariance) / np.diag(plain.covariance))
    expected = {**dict.fromkeys(plain.names, 1.0), "Cm_q": 3.0}
    assert dict(zip(known.names, ratio, strict=True)) == {n: pytest.approx(v, rel=1e-6) for n, v in expected.items()}


@pytest.mark.usefixtures("rendered")
def test_the_page_shows_every_log_the_pooled_set_and_the_conditions(pooled, tmp_path):
    page = pool_page(pooled)
    page.write(tmp_path)
    rows = list(csv.DictReader((tmp_path / "tables/logs.csv").open(encoding="utf-8")))
    assert len(rows) == 3 * len(TRUE)
    first = next(row for row in rows if row["coefficient"] == "Cm_q")
    assert first["derivative"] == "M_q"
    assert (tmp_path / "figures/pooled.png").stat().st_size > 10_000
    written = json.loads((tmp_path / "pooled.json").read_text())
    assert written["coefficients"]["Cm_q"] == pooled.pooled.coefficient("Cm_q").posterior
    html = (tmp_path / "report.html").read_text()
    assert html.index("6 coefficients from 3 logs") < html.index("Where the logs were flown")
    first = brief(page.answer[0][1])[0]
    assert first.count("±") >= 3  # values stand on the first screen
    assert len(first.split()) <= MOST_WORDS


def test_records_of_one_description_are_pooled_each_at_its_own_condition(pooled, tmp_path):
    for i, (V, m, h) in enumerate(CONDITIONS):
        write_record(tmp_path / f"day{i}.csv", V, h, m, 0.08 * m / 1.8, seed=i)
    parts = "".join(
        record(f"day{i}", more=f"condition = {{ mass_kg = {m}, Iyy_kg_m2 = {0.08 * m / 1.8!r} }}")
        for i, (_, m, _) in enumerate(CONDITIONS)
    )
    (tmp_path / "all.toml").write_text(description(parts, tail=f"{GEOMETRY}[pool]\neach = true\n"))
    found = identify_and_pool([RecordDescription.load(tmp_path / "all.toml")])
    assert found.names == ("all_day0", "all_day1", "all_day2")
    for name in TRUE:
        a, b = found.pooled.coefficient(name), pooled.pooled.coefficient(name)
        assert (a.value, a.std) == pytest.approx((b.value, b.std), rel=1e-9)


def test_records_of_several_conditions_in_one_fit_are_doubted(tmp_path):
    for i, V in enumerate((12.0, 16.0)):
        write_record(tmp_path / f"day{i}.csv", V)
    text = description(record("day0") + record("day1"), tail=GEOMETRY, condition="[condition]\nIyy_kg_m2 = 0.08\n")
    (tmp_path / "all.toml").write_text(text)
    (found,) = (tb.identify(RecordDescription.load(tmp_path / "all.toml")),)
    assert "each = true" in found.flown.doubts[0]


def test_a_derivative_that_only_some_logs_estimate_comes_from_those(tmp_path):
    """Where Z_de is fixed and Iyy is not given, the log says nothing of CZ_de and Cm; what is left out is said."""
    a = RecordDescription.load(write_day(tmp_path, "a", 12.0))
    fixed = write_day(tmp_path, "b", 15.0, extra='fixed = ["Z_de"]\nstart = { Z_de = -0.05 }')
    fixed.write_text(fixed.read_text().replace("Iyy_kg_m2 = 0.08\n", ""))
    found = identify_and_pool([a, RecordDescription.load(fixed)])
    logs = {c.name: c.logs for c in found.pooled.coefficients}
    assert logs == {"CZ_alpha": 2, "CZ_q": 2, "CZ_de": 1, "Cm_alpha": 1, "Cm_q": 1, "Cm_de": 1}
    left = dict(found.contributions[1].balance)
    assert "Iyy_kg_m2 under [condition]" in left["M_q"]


@pytest.mark.parametrize(
    ("air", "density"),
    [
        ("density_kg_m3 = 1.1", 1.1),
        ("temperature_degC = 35.0", air_density(100.0, 308.15)),
        ("h_m = 2000.0", air_density(2000.0)),
    ],
)
def test_what_is_given_of_the_air_goes_before_what_is_recorded(tmp_path, air, density):
    condition = f"[condition]\nmass_kg = 1.8\nIyy_kg_m2 = 0.08\n{air}\n"
    d = RecordDescription.load(write_day(tmp_path, "a", 12.0, condition=condition))
    found = tb.identify(d).flown
    assert found.qbar_Pa == pytest.approx(0.5 * density * found.V_m_s**2, rel=1e-9)


def test_a_warm_day_is_thinner_air_at_the_standard_pressure():
    assert air_density(0.0, 288.15) == pytest.approx(1.225, rel=1e-12)
    assert air_density(0.0, 308.15) == pytest.approx(1.1455, rel=1e-4)  # 101325 Pa / (287.053 J/(kg K) 308.15 K)


def _error(tmp_path, edit=lambda text, i: text, settings=None, **more):
    found = []
    for i, path in enumerate(write_day(tmp_path, f"day{i}", V, **more) for i, V in enumerate((12.0, 15.0))):
        path.write_text(edit(path.read_text(), i))
        found.append(RecordDescription.load(path))
    return identify_and_pool(found, settings=settings)


WITHOUT_H = '[[channel]]\nname = "h"\ncolumn = "h"\nunit = "m"\n'
WITHOUT_V = '[[channel]]\nname = "V"\ncolumn = "V"\nunit = "m/s"\n'


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda t, i: f'aircraft = "{("taurus", "eolo")[i]}"\n{t}', r"one aircraft, got taurus in day0, eolo in day1"),
        (lambda t, i: t.replace(GEOMETRY, ""), r"reference area.*\[geometry\].*day0\.toml"),
        (lambda t, i: t.replace(WITHOUT_V, ""), r"'day0' must have an airspeed.*V_m_s under \[condition\]"),
        (lambda t, i: t.replace(WITHOUT_H, ""), r"'day0' must have a dynamic pressure.*density_kg_m3"),
        (lambda t, i: t.replace("day1.csv", "day0.csv"), r"no sample may be pooled twice"),
        (lambda t, i: t.replace("S_m2 = 0.28", f"S_m2 = 0.2{8 + i}"), r"one geometry.*'day1'.*0\.29 m2"),
        (lambda t, i: t + f'[pool]\ntrend = "{("V", "qbar")[i]}"\n', r"must agree"),
    ],
    ids=["aircraft", "no geometry", "no airspeed", "no air", "record twice", "geometries", "pool tables"],
)
def test_what_cannot_be_pooled_is_refused_with_its_cause(tmp_path, edit, words):
    with pytest.raises((RecordError, ScenarioError), match=r"(?s)" + words):
        _error(tmp_path, edit)


@pytest.mark.parametrize(
    ("prior", "words"),
    [("aircraft", "no description names one"), ("handbok", "aircraft, handbook or a file, got 'handbok'")],
)
def test_a_prior_that_there_is_not_is_refused(tmp_path, prior, words):
    with pytest.raises(RecordError, match=words):
        _error(tmp_path, settings=Pooling(prior=prior))


def test_a_log_that_gives_nothing_is_left_out_and_said(tmp_path):
    found = _error(tmp_path, lambda t, i: t.replace('"output_error"', '"equation_error"') if i else t,
                   Pooling(method="output_error"))  # fmt: skip
    assert found.names == ("day0",)
    assert "day1 is left out" in found.doubts[0]
    with pytest.raises(RecordError, match="got 'output_eror'; did you mean 'output_error'"):
        _error(tmp_path, settings=Pooling(method="output_eror"))
    with pytest.raises(EstimationError, match=r"no log gives a coefficient.*mass_kg under \[condition\]"):
        _error(tmp_path, condition="")


def test_rolling_and_yawing_coefficients_come_from_primed_derivatives_with_their_product_of_inertia():
    """L' and N' of chosen Cl and Cn, by the inertia matrix [[Ixx, Ixz], [Ixz, Izz]] with the file's sign of Ixz."""
    V, qbar, g, m = 20.0, 250.0, Geometry(S, B, CBAR), PartialMass(1.8, 0.07, 0.08, 0.14, 0.01)
    matrix = np.array([[m.Ixx, m.Ixz], [m.Ixz, m.Izz]])
    names = ("L_beta", "L_p", "N_beta", "N_p", "L_da")
    for variable, per in (("beta", 1.0), ("p", B / (2.0 * V))):
        Cl, Cn = -0.08, 0.05
        L, N = np.linalg.solve(matrix, qbar * S * B * per * np.array([Cl, Cn]))
        params = {f"L_{variable}": L, f"N_{variable}": N}
        for axis, true in (("L", Cl), ("N", Cn)):
            symbol, row = weights("lateral_directional", names, f"{axis}_{variable}", Scaling(V, qbar, g, m))
            assert symbol == f"C{axis.lower()}_{variable}"
            assert row @ [params.get(n, 0.0) for n in names] == pytest.approx(true, rel=1e-12)
    assert weights("lateral_directional", names, "L_da", Scaling(V, qbar, g, m)) is None  # N_da is not known
    alone = weights("lateral_directional", names, "L_da", Scaling(V, qbar, g, PartialMass(1.8, 0.07, 0.08, 0.14, 0.0)))
    assert alone[1] @ np.eye(5)[4] == pytest.approx(0.07 / (qbar * S * B))
    assert weights("own", names, "L_beta", Scaling(V, qbar, g, m)) is None


def test_coefficients_of_a_linearised_aircraft_with_a_product_of_inertia_are_those_of_its_file():
    """b1, rigid: JSBSim's own derivatives through mass, inertia and condition, against the numbers in its XML."""
    b1 = tb.load_aircraft("b1").with_rigid_wings()
    assert b1.mass.Ixz != 0.0
    trimmed = tb.trim(b1, tb.FlightCondition(b1.design_V_m_s, b1.design_h_m))
    found = {d.name: d.held for d in dimensional_derivatives(tb.linearise(b1, trimmed), trimmed)}
    m = b1.mass
    mass = PartialMass(m.mass_kg, m.Ixx, m.Iyy, m.Izz, m.Ixz)
    scaling = Scaling(b1.design_V_m_s, trimmed.condition.qbar_Pa, b1.geometry, mass)
    for name in ("L_beta", "L_p", "N_beta", "N_r", "L_da"):  # those of pitch hold alphadot's part, too
        symbol, row = weights("lateral_directional", tuple(found), name, scaling)
        assert row @ list(found.values()) == pytest.approx(b1.coefficient(symbol), rel=5e-4), symbol


PRIOR = """source = "wind tunnel"
[coefficient]
Cm_q = { value = -15.0, percent = 20.0 }
Cm_alpha = { value = -0.5, std = 0.05 }
Cl_p = { value = -0.4, std = 0.1 }
"""


def test_the_command_pools_with_a_prior_and_its_result_is_the_next_prior(pooled, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("testbench.questions.run.page.plates", lambda result: [])  # of single logs: drawn elsewhere
    days(tmp_path, CONDITIONS[:2])
    (tmp_path / "tunnel.toml").write_text(PRIOR)
    status, _ = ends(monkeypatch, capsys, "identify", "day0.toml", "day1.toml", "--prior", "tunnel.toml")
    assert status == 0
    folder = tmp_path / "results/pooled_day0_day1"
    html = (folder / "report.html").read_text()
    assert "contradict each other in Cm_alpha" in html
    assert "the prior of Cl_p is not used" in html.lower().replace("cl_p", "Cl_p")
    assert (tmp_path / "results/day1/report.html").is_file()
    first = json.loads((folder / "pooled.json").read_text())
    rows = {r["coefficient"]: r for r in csv.DictReader((folder / "tables/pooled.csv").open(encoding="utf-8"))}
    prior, both = float(rows["Cm_q"]["prior_std"]), float(rows["Cm_q"]["posterior_std"])
    assert prior == pytest.approx(3.0)
    assert float(rows["Cm_q"]["added [%]"]) == pytest.approx(100.0 * (1.0 - (both / prior) ** 2))
    later = prior_of_file(folder / "pooled.json")
    assert "day0, day1" in later.source
    np.testing.assert_allclose(later.covariance, first["covariance"])
    assert later.names == tuple(first["coefficients"])
    more = tb.pool(pooled.pooled.logs[2:], later, "none")
    assert all(c.posterior_std < c.prior_std for c in more.coefficients)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["day0.toml", "--trend", "V"], "pools several logs, got one"),
        (["day0.toml", "day1.toml", "--prior", "tunnel.toml"], "coefficient.Cm_alfa: must be a coefficient"),
        (["day0.toml", "day1.toml", "--prior", "day0.toml"], "source"),
        (["day0.toml", "day0.toml"], "no sample may be pooled twice"),
    ],
)
def test_the_command_says_what_is_wrong_in_one_message(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    days(tmp_path, CONDITIONS[:2])
    (tmp_path / "tunnel.toml").write_text(PRIOR.replace("Cm_alpha", "Cm_alfa"))
    status, lines = ends(monkeypatch, capsys, "identify", *words)
    assert status == 2
    assert said in " ".join(lines)


def test_the_prior_of_an_aircraft_has_its_own_deviations_else_those_of_the_handbook(tmp_path):
    """Taurus at 14 m/s believes its own coefficients; a log of other ones contradicts it where they differ."""
    head = 'aircraft = "taurus"'
    given = days(tmp_path, ((14.0, 1.8, 100.0),), head=head, tail="", coefficients={"Cm_de": -0.5})
    found = identify_and_pool(given, settings=Pooling(prior="aircraft"))
    prior = found.pooled.prior
    assert dict(zip(prior.names, prior.values, strict=True)) == pytest.approx(
        {name: true_coefficients(14.0)[name] for name in prior.names}, rel=1e-3
    )
    relative = np.sqrt(np.diag(prior.covariance)) / np.abs(prior.values)
    believed = true_coefficients(14.0)
    expected = {
        name: relative_deviation(name.replace("CZ", "CL"), believed[name], abs(believed["CZ_alpha"]))
        for name in ("CZ_alpha", "CZ_q", "CZ_de", "Cm_alpha", "Cm_q", "Cm_de")
    }
    assert dict(zip(prior.names, relative, strict=True)) == pytest.approx(expected, rel=1e-3)
    assert any("handbook deviations were taken for CZ_alpha 14 %" in text for text in found.notes)
    assert not found.pooled.agree or found.pooled.dof == 0
    lines = [line.text for line in pool_answer(found)]
    assert any("what the data added" in text.lower() for text in lines)


CASES = ((12.0, 1.0), (12.0, 1.2), (15.0, 1.0), (15.0, 1.2), (18.0, 1.0), (18.0, 1.2))


@pytest.mark.slow
def test_flights_of_taurus_at_three_speeds_and_two_masses_cover_the_model(tmp_path):
    """JSBSim, sensors, output error of each log, pooled: 5 sets of 6 logs against the linearised model.

    30 values beyond 4 errors by chance: 2e-3; the curvature of the model, too, is in what lies between.
    """
    off = []
    truth = {n: np.mean([true_coefficients(V, m, m)[n] for V, m in CASES]) for n in true_coefficients(12.0)}
    for k in range(5):
        folder = tmp_path / str(k)
        folder.mkdir()
        given = [
            RecordDescription.load(write_log(folder, f"day{i}", V, m, m, seed=100 * k + i))
            for i, (V, m) in enumerate(CASES)
        ]
        found = identify_and_pool(given).pooled
        assert found.chance > 1e-4
        off.append([(found.coefficient(n).value - t) / found.coefficient(n).std for n, t in truth.items()])
    assert np.max(np.abs(off)) < 4.0
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.6
