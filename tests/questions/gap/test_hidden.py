"""What ``[hidden]`` says flies, and changes what it says and nothing else; what breaks a law is told with its key."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.reliability.small import GAP

from testbench.core.errors import ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.core.scenario.base import Manoeuvre
from testbench.effects import catalogue
from testbench.flight import FlightCondition
from testbench.questions.gap.scenario import GapScenario
from testbench.questions.gap.starts import Start
from testbench.questions.hidden import Acting, Hidden, Real, fly_hidden, issued
from testbench.sensors import load_suite

CONDITION = FlightCondition(16.0, 547.0)
SUITE = load_suite("eolo_gap")
HEAD = (SCENARIOS / "gap" / "nothing.toml").read_text(encoding="utf-8")
# Of a ground speed that is not read, of air that is as dense at another height, near the ground, and trimmed away.
UNSEEN = ("steady_wind", "air_density", "ground_effect", "surface_offset")
OF_SENSORS = {n for n, e in catalogue(SUITE).items() if e.place.endswith(" sensor") and n != "airspeed_flown"}
EFFECTS = {n: e for n, e in catalogue(SUITE).items() if not e.lateral and n not in UNSEEN and e.upstream == 0}
PATHS = {n: e for n, e in catalogue(SUITE).items() if not e.lateral and n not in UNSEEN and e.upstream > 0}
TRUTH = """
from dataclasses import replace
from testbench.questions.hidden import Truth

def amend(aircraft, suite, at_s):
    sensors = (replace(s, bias=0.1) if s.channel == "q" else s for s in suite.sensors)
    return aircraft, replace(suite, sensors=tuple(sensors))

def send(controls, u, dt_s, at_s):
    return 0.5 * u

def read(record):
    data = record.data.copy()
    data[:, record.channels.index("theta")] = 1.0
    return replace(record, data=data)

TRUTH = Truth(amend, send, read)
NONE = 3
"""


def flown(real: Real, start: Start | None = None):
    manoeuvre = Manoeuvre.model_validate(
        {
            "name": "both",
            "use": "identification",
            "duration_s": 6.0,
            "input": (
                {"signal": "doublet", "control": "de", "amplitude_deg": 2.0, "period_s": 1.0},
                {"signal": "doublet", "control": "thr", "amplitude_percent": 15.0, "period_s": 2.0, "start_s": 2.0},
            ),
        }
    )
    starts = {} if start is None else {"both": start}
    return fly_hidden(real, SUITE, issued(SUITE, CONDITION, [manoeuvre], 3, starts), 200.0)["both"]


def case(tmp_path, table: str) -> GapScenario:
    file = tmp_path / "case.toml"
    file.write_text(HEAD.replace("[hidden]\n", f"[hidden]\n{table}\n"), encoding="utf-8")
    return GapScenario.load(file)


@pytest.fixture(scope="module")
def plain():
    return flown(GapScenario.load("gap/nothing").hidden.real(GapScenario.load("gap/nothing"), SUITE))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [*EFFECTS, *PATHS])
def test_an_effect_flies_and_shows_in_the_readings_but_not_in_the_commands(name, plain):
    effect = {**EFFECTS, **PATHS}[name]
    values = {p.name: p.starts[-1] for p in effect.parameters}
    scenario = GapScenario.load("gap/nothing")
    hidden = Hidden.model_validate({"effects": [{"effect": name, **values}]})
    record = flown(hidden.real(scenario, SUITE), Start(CONDITION, at_s=1500.0))
    assert record.kind == "measured"
    assert set(record.provenance) == {"manoeuvre"}, "what was hidden is not told"
    for command in ("de_cmd", "thr_cmd"):  # about its trim, which is another one; whoever moves the stick does not know
        assert record[command] - record[command][0] == pytest.approx(plain[command] - plain[command][0], abs=1e-8)
    same = {c for c in ("V", "alpha", "q", "theta", "az") if np.array_equal(record[c], plain[c])}
    if name in OF_SENSORS:
        assert same == {"V", "alpha", "q", "theta", "az"} - {effect.place.removesuffix(" sensor")}
    else:
        assert len(same) <= 2


def test_an_empty_table_hides_nothing_and_noise_and_wings_are_hidden_without_an_effect(tmp_path, plain):
    scenario = case(tmp_path, 'noise = { q = 3.0 }\nwings = "flexible"')
    bent, still = scenario.hidden.real(scenario, SUITE), case(tmp_path, "noise = { q = 3.0 }")
    assert bent.aircraft.flown_modes() is not None
    loud = flown(still.hidden.real(still, SUITE))
    quiet = flown(replace(still.hidden.real(still, SUITE), noise={"q": 1e-12}))
    assert loud["q"] - quiet["q"] == pytest.approx(3.0 * (plain["q"] - quiet["q"]), abs=4e-4)  # a quantum
    assert np.array_equal(loud["alpha"], plain["alpha"])


def test_what_grows_is_what_it_has_become_by_the_time_of_the_record_and_what_moves_the_air_moves_it():
    empty = catalogue(SUITE)["thrust_fade"], {"per_min": 0.02}
    scenario = GapScenario.load("gap/nothing")
    real = replace(scenario.hidden.real(scenario, SUITE), effects=(Acting(*empty),))
    early, late = (flown(real, Start(CONDITION, at_s=t)) for t in (0.0, 1200.0))
    assert late["thr_cmd"][0] == pytest.approx(early["thr_cmd"][0] / (1.0 - 0.02 * 20.0), rel=0.01)
    thin = replace(real, effects=(Acting(catalogue(SUITE)["air_density"], {"over_believed": 0.9}),))
    _, _, condition = thin.from_(Start(CONDITION), SUITE)
    assert condition.h_m > CONDITION.h_m + 900.0


def test_a_gust_is_met_by_the_manoeuvre_that_is_named():
    scenario = GapScenario.load("gap/nothing")
    entry = {"effect": "gust", "amplitude_m_s": 3.0, "start_s": 2.0, "duration_s": 1.0}
    for more, met in (({}, ["first"]), ({"manoeuvre": "second"}, ["second"])):
        real = Hidden.model_validate({"effects": [{**entry, **more}]}).real(scenario, SUITE)
        assert [n for i, n in enumerate(("first", "second")) if real.gust_in(n, i == 0)] == met


def test_own_code_amends_sends_and_reads_and_its_commands_are_recorded_as_issued(tmp_path, plain):
    (tmp_path / "mine.py").write_text(TRUTH, encoding="utf-8")
    scenario = case(tmp_path, 'truth = "mine.py:TRUTH"')
    record = flown(scenario.hidden.real(scenario, SUITE))
    assert record["q"].mean() == pytest.approx(plain["q"].mean() + 0.1, abs=0.01)
    assert np.ptp(record["q"]) < 0.7 * np.ptp(plain["q"])
    assert (record["theta"] == 1.0).all()
    assert record["de_cmd"] == pytest.approx(plain["de_cmd"], abs=1e-8)
    scenario = case(tmp_path, 'truth = "mine.py:NONE"')
    with pytest.raises(ScenarioError, match=r"mine.py:NONE must be a Truth, got int"):
        scenario.hidden.real(scenario, SUITE)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('effects = [{ effect = "actuator_lgg" }]', r"hidden.effects\[0\].effect: .* did you mean 'actuator_lag'"),
        ('effects = [{ effect = "actuator_lag" }]', r"hidden.effects\[0\].lag_rad_s: the key is required and missing"),
        (
            'effects = [{ effect = "actuator_lag", lag_rad_s = 900 }]',
            r"hidden.effects\[0\].lag_rad_s: must be 2 to 200 rad/s, got 900",
        ),
        ('effects = [{ effect = "V_lag", lag = 0.1, lag_s = 0.1 }]', r"effects\[0\].lag: unknown parameter of V_lag"),
        ('effects = [{ effect = "V_lag", lag_s = true }]', r"effects\[0\].lag_s: must be 0 to 5 s, got True"),
        ('effects = [{ effect = "V_lag", lag_s = 0.1, manoeuvre = "sweep" }]', "unknown manoeuvre 'sweep'"),
        ("noise = { alfa = 1.2 }", "hidden.noise: unknown channel 'alfa'; did you mean 'alpha'"),
        ("noise = 0.0", "hidden.noise: must be greater than 0, got 0.0"),
        ("noise = { V = 1000.0 }", "hidden.noise.V: must be -100 to 100, got 1000.0"),
        ('truth = "none.py:TRUTH"', "hidden.truth: the file of 'none.py:TRUTH' must exist"),
        ('aircraft = "taurs"', "hidden.aircraft: .*did you mean 'taurus'"),
    ],
)
def test_what_breaks_a_law_is_told_with_file_and_key_before_anything_flies(tmp_path, table, said):
    with pytest.raises(ScenarioError, match=said) as caught:
        case(tmp_path, table)
    assert all(f.startswith(str(tmp_path / "case.toml")) for f in caught.value.faults)


def test_what_moves_unrecorded_and_a_rate_that_does_not_divide_are_told_before_anything_flies(tmp_path):
    """The search would find something unknown: a throttle that the suite does not record moved the aircraft."""
    bad = GAP.replace("eolo_gap", "taurus_8hz").replace("rate_hz = 100.0", "rate_hz = 60.0")
    (tmp_path / "case.toml").write_text(bad, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        GapScenario.load(tmp_path / "case.toml")
    rate, *moved = caught.value.faults
    assert "simulation.rate_hz: a log rate must divide" in rate
    assert [f.split("'")[1] for f in moved] == ["throttle doublet", "elevator and throttle"]
    assert all("no sensor of thr or thr_cmd" in f for f in moved)
