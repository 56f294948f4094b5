"""The user's own flights, flown again with truths that are drawn from the priors."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_flights import believe, measure

import testbench.questions.gap.again as again_module
import testbench.questions.gap.flights as flights_module
from testbench.core.errors import LimitError, RecordError, TrimError
from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS
from testbench.questions.gap.again import Reflown
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import AirFound, in_air, listen
from testbench.questions.gap.evidence.air import measure as measure_air
from testbench.questions.gap.search.point import Point, retune
from testbench.questions.gap.workflow import GapSearch, find_gap

STILL = AirFound(False, 0.0, 547.0, 0.0, 9.55, 4.0)
FEW = {n: EFFECTS[n] for n in ("actuator_lag", "alpha_scale")}


@pytest.fixture(scope="module")
def believed() -> Believed:
    return replace(believe(), rate_hz=100.0)


@pytest.fixture(scope="module")
def records(believed) -> list[FlightRecord]:
    return measure(believed, 7)


def test_a_flight_again_has_commands_and_samples_of_the_measured_one_and_leaves_noise(believed, records):
    blind = records[0].valid.copy()
    blind[300:340, records[0].channels.index("alpha")] = False
    records = [replace(records[0], valid=blind), records[1]]
    name, flown = Reflown(believed, records, STILL, {}).drawn(np.random.default_rng(1))
    assert name == "nothing"
    for control, record in zip(flown, records, strict=True):
        assert (control.channels, control.kind) == (record.channels, "measured")
        np.testing.assert_array_equal(control.valid, record.valid)
        for channel in ("de_cmd", "thr_cmd"):
            np.testing.assert_array_equal(control[channel], record[channel])
        assert np.all(np.std(control.columns(believed.outputs) - record.columns(believed.outputs), axis=0) > 0.0)
    tuned = retune(Point.at(believed, believed, tuple(flown)))
    # White noise alone: chi-square over n samples scatters by sqrt(2 n); five of it are 6e-7 both sides. Means that are
    # taken out and coefficients that are re-tuned take some 15 of it.
    assert abs(tuned.chi2 - tuned.samples) < 5.0 * np.sqrt(2.0 * tuned.samples) + 15.0
    assert np.max(np.abs(tuned.nuisances - 1.0)) > 0.02  # they were drawn, not left where they are believed


def test_truths_are_drawn_from_the_priors(believed, records, monkeypatch):
    """Of 40 draws some 17 hold an effect; fewer than 6 or more than 30 in one set of 3000."""
    monkeypatch.setattr(again_module, "_measured", lambda real, record, air, seed: real)
    drawn = [Reflown(believed, records[:1], STILL, FEW).drawn(np.random.default_rng([1, i])) for i in range(40)]
    names = [name for name, _ in drawn]
    assert 6 <= sum(n != "nothing" for n in names) <= 30
    assert set(names) == {"nothing", *FEW}
    scales = [real[0].suite for name, real in drawn if name == "alpha_scale"]
    assert len({repr(s) for s in scales}) == len(scales)  # each of another size


def test_flights_again_meet_the_turbulence_that_was_found(believed, records):
    found = AirFound(True, 0.4, 547.0, 100.0, 9.55, 4.0)
    _, flown = Reflown(believed, records, found, {}).drawn(np.random.default_rng(3))
    heard = listen(believed, flown)
    assert heard.moves
    # 28 s of turbulence, scale length 533 m at 16 m/s: its rms as filters see it is told to some 10 %; here three.
    assert measure_air(believed, flown, heard).rms_m_s == pytest.approx(0.4, rel=0.3)
    white = in_air(believed, replace(found, rms_m_s=0.4))
    tuned = retune(Point.at(white, white, tuple(flown)))
    # the filter is linear; six standard deviations of noise
    assert tuned.chi2 == pytest.approx(tuned.samples, rel=0.06)


def test_flights_again_are_asked_about_once_and_kept(believed, records, tmp_path, monkeypatch):
    asked = []

    def ask(flown, heard):
        asked.append((len(flown), heard.moves))
        return SimpleNamespace(weighed=SimpleNamespace(stated={"actuator_lag": 0.08, "nothing": 0.9, "unknown": 0.02}))

    monkeypatch.setattr(again_module, "listen", lambda model, flown: STILL)
    file = tmp_path / "again.jsonl"
    words: list[str] = []

    def fly(count, file=file, air=STILL):
        return Reflown(believed, records[:1], air).times(count, ask, words.append, file)

    first = fly(2)
    assert asked == [(1, False)] * 2
    assert [t.stated for t in first.trials] == [{"actuator_lag": 0.08, "nothing": 0.9, "unknown": 0.02}] * 2
    file.write_text(file.read_text() + '{"of": "cut off', encoding="utf-8")  # a process that was killed as it wrote
    more = fly(3)
    assert len(asked) == 3
    assert more.trials[:2] == first.trials
    assert words[-1] == "flight again 3 of 3, with a truth drawn from the priors"
    assert fly(3) == more
    assert len(asked) == 3
    fly(1, air=replace(STILL, moves=True, rms_m_s=0.2))  # another air: other flights
    assert len(asked) == 4
    assert fly(2, file=None) == first  # the same without a file, flown anew
    assert len(asked) == 6
    lines = [json.loads(line) for line in file.read_text().splitlines() if line.endswith("}")]
    file.write_text("".join(json.dumps(row) + "\n" for row in lines[1:]))
    assert fly(2).trials == first.trials  # what is missing before it is flown again
    with pytest.raises(RecordError, match=r"a readable journal of finished work must lie at '.*', got: Is a directory"):
        fly(1, file=tmp_path)


def test_truths_with_which_nothing_flies_are_drawn_again_and_then_said(believed, records, monkeypatch):
    tried = []

    def fails(real, record, air, seed):
        tried.append(seed)
        raise LimitError("it leaves its limits")

    monkeypatch.setattr(again_module, "_measured", fails)
    with pytest.raises(TrimError, match="of 50 truths that were drawn from the priors one must fly the commands"):
        Reflown(believed, records[:1], STILL, FEW).times(1, lambda r, a: None, lambda s: None)
    assert len(set(tried)) == 50


def test_the_workflow_says_what_stated_probabilities_are_worth(believed):
    slow = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 12.0})
    measured = measure(slow, 11)
    finding = find_gap(believed, {"a": measured[0]}, {"b": measured[1]}, GapSearch(effects=FEW, again=2))
    assert finding.naming.names == ("actuator_lag",)
    assert len(finding.again.trials) == 2
    assert {t.truth for t in finding.again.trials} <= {"nothing", *FEW}
    for trial in finding.again.trials:
        assert sum(trial.stated.values()) == pytest.approx(1.0)
    assert any("flights again" in s for s in finding.sentences)


# --- a search that is interrupted -------------------------------------------------------------------------------------


def numbers(finding):
    """Everything that a search found, to the last digit."""
    found = [(f.effect.name, f.probability, f.chi2, dict(f.values), dict(f.errors)) for f in finding.naming.ranking]
    table = finding.naming.weighed.table.rows
    rows = [(r.name, r.log_evidence, r.difference, r.held_out) for r in table]
    posteriors = [(p.values.tolist(), p.covariance.tolist(), p.noise, p.doubts) for p in (r.posterior for r in table)]
    return found, rows, posteriors, finding.sentences


class Stopped:
    """A stage of a search at which it is interrupted, the n-th of its kind."""

    def __init__(self, monkeypatch, at):
        kept, self.written = again_module.KeptFits.keep, 0

        def keep(keeper, group, content):
            kept(keeper, group, content)
            self.written += 1
            if self.written == at:
                raise KeyboardInterrupt

        monkeypatch.setattr(again_module.KeptFits, "keep", keep)


def fresh_flights(monkeypatch):
    """As in a new process: nothing that was flown is known."""
    for name in ("_TRIMS", "_NEAR", "_LINEAR", "_FLOWN"):
        monkeypatch.setattr(flights_module, name, flights_module._Kept(512))


def test_a_search_that_was_interrupted_ends_with_the_answer_of_one_that_was_not(believed, tmp_path, monkeypatch):
    slow = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 12.0})
    a, b = measure(slow, 11)[:2]
    given = believed, {"a": a}, {"b": b}
    whole = numbers(find_gap(*given, GapSearch(effects=FEW)))
    file, said = tmp_path / "search.jsonl", list[str]()
    how = GapSearch(effects=FEW, search_file=file)
    with monkeypatch.context() as patch:
        fresh_flights(monkeypatch)
        Stopped(patch, 1)
        with pytest.raises(KeyboardInterrupt):
            find_gap(*given, how)
    assert len(file.read_text("utf-8").splitlines()) == 1
    with file.open("a", encoding="utf-8") as out:
        out.write('{"of": "cut off')  # as a machine that stops leaves it
    fresh_flights(monkeypatch)
    with monkeypatch.context() as patch:
        again = Stopped(patch, 0)
        assert numbers(find_gap(*given, how, said.append)) == whole
    assert any("fits of the search that was interrupted" in s for s in said)
    fresh_flights(monkeypatch)
    with monkeypatch.context() as patch:  # all of it is known now, and no other search takes it
        known = Stopped(patch, 0)
        assert numbers(find_gap(*given, how)) == whole
        assert (known.written, again.written > 0) == (0, True)
        find_gap(believed, {"a": b}, {"b": a}, how)
        assert known.written > 0
