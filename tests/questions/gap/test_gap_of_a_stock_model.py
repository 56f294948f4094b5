"""The gap workflow on a model that comes with JSBSim: c172p, whose controls have no servos, flown with a slow one."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from commands import ends
from gap.gap_fits import write_amended

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError
from testbench.core.paths import stock_root
from testbench.core.record import FlightRecord
from testbench.core.scenario.inputs import Doublet, StandardMultistep
from testbench.effects import EFFECTS, OTHER_SERVOS, library
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.ask import GapResult
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.brought import choose
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.priors import LATERAL_PRIORS, PRIORS
from testbench.questions.gap.workflow import GapSearch, find_gap
from testbench.sensors import load_suite

CONDITION = FlightCondition(50.0, 1000.0)
MULTISTEP = StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4)
THROTTLE = Doublet(signal="doublet", control="thr", amplitude_percent=10.0, period_s=3.0)
DOUBLET = Doublet(signal="doublet", control="de", amplitude_deg=3.0, period_s=1.6)
SEARCHED = ("actuator_lag", "transport_delay")


def measured(truth: Believed, spec: StandardMultistep | Doublet, seed: int) -> FlightRecord:
    """Return what the suite reads of one manoeuvre, after two seconds of quiet flight."""
    coarse = build((spec,), 5.0, truth.suite.rate_hz)
    u = np.repeat(coarse.u, round(truth.rate_hz / truth.suite.rate_hz), axis=0)
    signal = InputSignal(np.arange(len(u)) / truth.rate_hz, u, coarse.channels)
    trimmed = trim(truth.aircraft, CONDITION, truth.rate_hz)
    flown = fly(truth.aircraft, trimmed, Manoeuvre("flight", signal, 2.0), truth.suite.rate_hz)
    return truth.suite.measure(flown, seed)


@pytest.fixture(scope="module")
def believed() -> Believed:
    aircraft = load_aircraft("jsbsim:c172p")
    return Believed(aircraft, load_suite("eolo_gap"), CONDITION, 100.0)


@pytest.mark.slow
def test_a_slow_servo_is_found_that_the_model_does_not_have(believed, tmp_path):
    """Its corner frequency within three standard errors; the held-out flight agrees to the noise afterwards."""
    truth = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 6.0})
    records = {"multistep": measured(truth, MULTISTEP, 1), "throttle": measured(truth, THROTTLE, 2)}
    held_out = {"doublet": measured(truth, DOUBLET, 3)}
    finding = find_gap(believed, records, held_out, GapSearch(effects={n: EFFECTS[n] for n in SEARCHED}))
    assert finding.naming.names == ("actuator_lag",)
    best = finding.naming.best
    assert best is not None
    assert best.values["lag_rad_s"] == pytest.approx(6.0, abs=3.0 * best.errors["lag_rad_s"])
    result = GapResult("stock", "", "", "jsbsim:c172p", records, finding)
    files = amended_files(result)
    assert set(files) >= {"c172p/c172p.xml", "c172p/README.md", "model.diff"}
    assert "- testbench/elevator-command-rad: -0." in files["c172p/README.md"]
    write_amended(result, tmp_path)
    with pytest.raises(ModelError, match="as its author wrote it"):
        load_aircraft(str(tmp_path / "c172p"))
    (shrink,) = finding.shrink
    assert float(np.mean(shrink.energy_after)) < 1.2
    assert float(np.mean(shrink.energy_before)) > 3.0


def test_a_stock_model_has_the_nuisances_of_its_coefficients(believed):
    t = np.arange(100) / 100.0
    moved = 0.05 * (t > 0.6)[:, None]
    made = {"t_s": t, "data": moved, "kind": "measured"}
    elevator, lateral = (FlightRecord(channels=(f"{n}_cmd",), **made) for n in ("de", "da"))
    assert dict(believed.priors_of([elevator])) == dict(PRIORS)
    assert set(believed.priors_of([lateral])) == {*PRIORS, *LATERAL_PRIORS}


def test_what_a_glider_cannot_lack_is_not_searched_and_said():
    glider, suite = load_aircraft("jsbsim:SGS"), load_suite("eolo_gap")
    choice = choose(suite, aircraft=glider)
    assert "thrust_lag" not in choice.effects
    assert set(choice.effects) == set(library(suite, glider))
    (note,) = choice.notes
    assert note.startswith("not searched: thrust_line, thrust_lag")
    assert note.endswith("since SGS has no engine with a throttle that could be changed")


def test_servo_effects_of_other_controls_are_searched_when_they_are_asked_for():
    suite = load_suite("eolo_gap")
    plain, more = choose(suite), choose(suite, more=("aileron_free_play", "throttle_transport_delay"))
    assert set(OTHER_SERVOS).isdisjoint(plain.effects)
    assert set(more.effects) - set(plain.effects) == {"aileron_free_play", "throttle_transport_delay"}
    assert all(e.lateral == (n.split("_")[0] in ("aileron", "rudder")) for n, e in OTHER_SERVOS.items())


def as_table(record: FlightRecord, name: str) -> None:
    """Write a record as a logger might: in degrees, with names that are not the house's."""
    names = {"alpha": "alpha_deg", "q": "q_deg_s", "theta": "theta_deg", "de_cmd": "de_cmd_deg", "V": "V_m_s"}
    columns = [record[n] / DEG_RAD if "deg" in names.get(n, "") else record[n] for n in record.channels]
    head = ",".join(["t_s", *(names.get(n, n) for n in record.channels)])
    np.savetxt(f"{name}.csv", np.column_stack([record.t_s, *columns]), "%.6g", ",", header=head, comments="")


@pytest.mark.slow
def test_a_stock_model_and_tables_become_a_case_that_names_what_is_missing(believed, monkeypatch, capsys, tmp_path):
    """By commands alone: c172p is adopted, tables are imported, a case is made, checked and asked."""
    monkeypatch.chdir(tmp_path)
    truth = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 6.0})
    small = DOUBLET.model_copy(update={"amplitude_deg": 1.5, "period_s": 1.0})
    flown = {"multistep": MULTISTEP, "throttle": THROTTLE, "doublet": DOUBLET, "small": small}
    model = stock_root() / "aircraft" / "c172p" / "c172p.xml"
    assert ends(monkeypatch, capsys, "aircraft", "adopt", str(model), "--speed", "50", "-o", "cessna")[0] == 0
    for seed, (name, spec) in enumerate(flown.items(), 1):
        as_table(measured(truth, spec, seed), name)
        assert ends(monkeypatch, capsys, "import", f"{name}.csv", "-o", name)[0] == 0
    assert ends(monkeypatch, capsys, "gap", "new", "mine.toml", "--aircraft", "cessna", *flown)[0] == 0
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert "wings" not in text  # it has no elastic modes
    assert [m in text for m in ('suite = "mine_sensors.toml"', "h_m = 1000.0  # YOURS", 'use = "held_out"')] == [
        True
    ] * 3
    few = text.replace('# effects = ["actuator_lag"]', 'effects = ["actuator_lag", "transport_delay", "q_delay"]')
    (tmp_path / "mine.toml").write_text(few, encoding="utf-8")
    assert ends(monkeypatch, capsys, "check", "mine.toml")[0] == 0
    status, lines = ends(monkeypatch, capsys, "gap", "mine.toml", "--workers", "1")
    assert status == 0, lines
    (first, *_) = csv.DictReader(Path("results/gap_mine/tables/ranking.csv").read_text(encoding="utf-8").splitlines())
    assert first["effect"] == "lag of the elevator servo"
    assert float(first["whole [%]"]) > 90.0
    value, error = map(float, re.findall(r"[\d.]+", first["size"])[:2])
    assert abs(value - 6.0) < 4.0 * error
