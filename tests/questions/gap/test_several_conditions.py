"""Records from several conditions in one search: each is flown from its own, and speed separates what one cannot.

False alarms: a case without an effect is named with probability 1e-3 (criteria.FALSE_ALARM), and an estimate lies four
standard errors off with probability 6e-5; seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap.hidden_truths import NOTHING, measure_truth, rate_feedback

import testbench.questions.gap.flights as flights_module
from testbench.core.errors import RecordError, TrimError
from testbench.core.paths import SCENARIOS
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import StandardMultistep
from testbench.effects import library
from testbench.flight import FlightCondition, load_aircraft
from testbench.flight.air import Air, turbulence_rms
from testbench.questions.gap import ask
from testbench.questions.gap.ask import run_gap
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import in_air, listen
from testbench.questions.gap.name import Sought, name_effect
from testbench.questions.gap.records import Said, load_flights
from testbench.questions.gap.search.gust_search import GustSearch
from testbench.questions.gap.search.point import Point
from testbench.questions.gap.starts import KEY, Start, marked, start_of
from testbench.questions.gap.workflow import find_gap
from testbench.sensors import load_suite, suite_toml

H_M = 547.0
SUITE = replace(load_suite("eolo_gap"), rate_hz=50.0)
FEW = {n: library(SUITE)[n] for n in ("pitch_damper", "actuator_lag", "alpha_scale")}
GAIN_S = 0.02
DAMPER = rate_feedback(GAIN_S)
SLOW, FAST = Start(FlightCondition(14.0, H_M)), Start(FlightCondition(20.0, H_M))
HEAVY = Start(FlightCondition(16.0, H_M), load_kg=0.4, load_aft_m=0.02)


def believe() -> Believed:
    return Believed(load_aircraft("eolo", "rigid"), SUITE, FlightCondition(16.0, H_M), 100.0)


def measure(hidden, *starts: Start, seed: int = 3):
    """Return one elevator 3-2-1-1 from each start, which it says."""
    step = StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4)
    specs = [Manoeuvre(name=f"m{i}", use="identification", duration_s=8.0, input=(step,)) for i, _ in enumerate(starts)]
    from_ = {m.name: s for m, s in zip(specs, starts, strict=True)}
    b = believe()
    found = measure_truth("eolo", hidden, SUITE, b.condition, specs, seed, b.rate_hz, from_)
    return [marked(r, s) for r, s in zip(found.values(), starts, strict=True)]


def test_two_speeds_separate_a_damper_from_the_coefficient_that_hides_it_at_one():
    """The moment of a pitch damper grows with dynamic pressure, that of Cm_q with speed."""
    at = Start(FlightCondition(16.0, H_M))
    hidden_in = name_effect(believe(), measure(DAMPER, at, at), Sought(FEW, pairs=False))
    assert hidden_in.outcome == "no gap", hidden_in.sentence
    assert max(f.gain for f in hidden_in.ranking) < 10.0
    assert hidden_in.nuisances["Cm_q"] > 1.1  # in which it hides
    naming = name_effect(believe(), measure(DAMPER, SLOW, FAST), Sought(FEW, pairs=False))
    assert (naming.outcome, naming.names) == ("named", ("pitch_damper",)), naming.sentence
    best = naming.best
    assert abs(best.values["gain_s"] - GAIN_S) < 4.0 * best.errors["gain_s"] < 0.5 * GAIN_S
    assert best.gain > 400.0
    assert best.nuisances["Cm_q"] == pytest.approx(1.0, abs=0.06)


def test_nothing_is_no_gap_at_two_speeds_with_a_load_and_one_condition_would_be_wrong():
    records = measure(NOTHING, SLOW, FAST, HEAVY)
    naming = name_effect(believe(), records, Sought(FEW, pairs=False))
    assert naming.outcome == "no gap", naming.sentence
    # 5 channels of about 500 samples each: the mean of so many squares of white noise scatters by 0.028 about 1
    energies = [float(np.mean(believe().residuals(r) ** 2)) for r in records]
    assert energies == pytest.approx([1.0] * 3, abs=5 * 0.028)  # false alarm 2e-6
    for record in records:
        as_one = replace(record, provenance={n: v for n, v in record.provenance.items() if n != KEY})
        assert float(np.mean(believe().residuals(as_one) ** 2)) > 1.3


def test_a_record_from_the_condition_of_the_belief_is_predicted_to_the_last_bit():
    b, (record,) = believe(), measure(DAMPER, Start(FlightCondition(16.0, H_M)))
    plain = replace(record, provenance={})
    assert b.predict(record).tobytes() == b.predict(plain).tobytes()
    assert b.at(plain) is b


def test_each_condition_is_trimmed_once(monkeypatch):
    asked, b = [], replace(believe(), rate_hz=150.0)  # nobody else flies at that rate
    own = flights_module.trim_many
    monkeypatch.setattr(flights_module, "trim_many", lambda a, c, *more: asked.extend(c) or own(a, c, *more))
    records = measure(NOTHING, SLOW, FAST, SLOW, FAST)
    for _ in range(2):
        for record in records:
            b.predict(record)
    assert sorted(asked, key=str) == [SLOW.condition, FAST.condition]


def test_a_condition_that_cannot_be_trimmed_is_refused_with_its_record():
    slow, fast = measure(NOTHING, SLOW, FAST)
    with pytest.raises(TrimError, match="4 m/s") as caught:
        find_gap(believe(), {"fast": fast, "slow": marked(slow, Start(FlightCondition(4.0, H_M)))}, {})
    assert caught.value.place == "record 'slow'"


def test_what_is_no_start_is_refused():
    (record,) = measure(NOTHING, SLOW)
    for told in ("fast", {"V_m_s": 3.0}, {"V_m_s": 3.0, "h_m": "high"}):
        with pytest.raises(RecordError, match="must hold V_m_s and h_m"):
            start_of(replace(record, provenance={KEY: told}))
    with pytest.raises(RecordError, match=r"load_kg > -\d.* must hold"):
        believe().predict(marked(record, replace(SLOW, load_kg=-90.0)))


def test_turbulence_is_heard_and_whitened_at_each_speed():
    """Mean squares of about 2500 white samples: five of their deviations; a filter about another trim leaves more."""
    b, records = believe(), []
    rms = turbulence_rms(0.25, H_M)
    for i, record in enumerate(measure(NOTHING, SLOW, FAST)):
        truth = b.flown(record, None, Air(turbulence_rms_m_s=rms, seed=5 + i))
        measured = SUITE.measure(truth, 5 + i)
        records.append(record.with_columns({n: measured[n] for n in b.outputs}))
    heard = listen(b, records)
    assert heard.moves
    flown_in = in_air(b, replace(heard, rms_m_s=0.25))
    energies = [float(np.mean(flown_in.residuals(r) ** 2)) for r in records]
    assert energies == pytest.approx([1.0, 1.0], abs=5 * 0.028)


def test_gusts_are_looked_at_from_each_condition():
    """The filters of gusts are those of a record alone."""
    b, records = believe(), measure(NOTHING, SLOW, FAST, HEAVY)
    together = GustSearch.at(Point.at(b, b, tuple(records)))
    for i, record in enumerate(records):
        alone = GustSearch.at(Point.at(b, b, (record,)))
        assert np.array_equal(together.filters[i], alone.filters[0])


def test_flights_at_several_speeds_are_read_from_their_quiet_flight(tmp_path):
    files = []
    for i, record in enumerate(measure(NOTHING, SLOW, FAST, SLOW)):
        files.append(tmp_path / f"r{i}.nc")
        replace(record, provenance={}).save(files[-1])
    suite = tmp_path / "slow.toml"
    suite.write_text(suite_toml(SUITE), encoding="utf-8")
    flights = load_flights("eolo", files, said=Said(str(suite)), wings="rigid")
    assert flights.believed.condition.V_m_s == pytest.approx(14.0, abs=0.1)  # that of two of three
    starts = [start_of(r) for r in (*flights.naming.values(), *flights.held_out.values())]
    assert [s is None for s in starts] == [True, False, True]
    assert starts[1].condition.V_m_s == pytest.approx(20.0, abs=0.1)
    assert any("start from 2 conditions" in note and "m/s and 547 m in r1" in note for note in flights.notes)
    assert all(float(np.mean(flights.believed.residuals(r) ** 2)) < 1.2 for r in flights.naming.values())
    with pytest.raises(
        RecordError, match=r"got (19|20)\.\d\d m/s in 'r1' and 14\.00 m/s as the condition; without --V"
    ):
        load_flights("eolo", files, said=Said(str(suite), 14.0), wings="rigid")


def test_a_scenario_says_where_its_flights_start(tmp_path, monkeypatch):
    """Made from a hidden truth or recorded, the search is asked the same but for the noise of a condition."""
    asked = []
    monkeypatch.setattr(ask, "find_gap", lambda believed, naming, held, *_, **__: asked.append((believed, naming)))
    monkeypatch.setattr(ask, "GapResult", lambda *_: None)
    text = (SCENARIOS / "gap" / "nothing.toml").read_text(encoding="utf-8")
    head, first, *rest = text.split("[[manoeuvre]]\n")
    own = "condition = {V_m_s = 20.0, h_m = 547.0}\nload_kg = 0.4\n"
    file = tmp_path / "g.toml"
    file.write_text("[[manoeuvre]]\n".join((head, own + first, rest[-1])), encoding="utf-8")
    kept = {}
    run_gap(file, keep=lambda name, record: kept.update({name: record}))
    (name, record), *others = kept.items()
    assert start_of(record) == Start(FlightCondition(20.0, H_M), 0.4)
    assert all(start_of(r) is None for _, r in others)
    tables = ""
    for i, (n, r) in enumerate(kept.items()):
        replace(r, provenance={}).save(tmp_path / f"{i}.nc")
        tables += f'[[measured]]\nname = "{n}"\nfile = "{i}.nc"\nuse = "{"held_out" if i else "naming"}"\n'
        tables += 'condition = "recorded"\nload_kg = 0.4\n' if i == 0 else ""
    file.write_text(head.split("\n[hidden]")[0] + "\n" + tables, encoding="utf-8")
    run_gap(file)
    for believed, naming in asked:
        assert float(np.mean(believed.residuals(naming[name]) ** 2)) < 1.2
    assert start_of(asked[1][1][name]).condition.V_m_s == pytest.approx(20.0, abs=0.1)
    file.write_text(file.read_text(encoding="utf-8").replace('condition = "recorded"\n', ""), encoding="utf-8")
    with pytest.raises(RecordError, match="within 5 % of the airspeed of its condition"):
        run_gap(file)
