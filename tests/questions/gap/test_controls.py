"""Control flights: believed flights without any effect, with the commands, sensors and air of the measured ones.

Statistical assertions have fixed seeds; their false-alarm probabilities stand beside them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_flights import believe, measure

import testbench.questions.gap.controls as controls_module
from testbench.core.errors import LimitError, RecordError
from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.controls import Control, Controls, fly_control, fly_controls, without_false_alarms
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.evidence.air import AirFound, in_air, listen
from testbench.questions.gap.evidence.air import measure as measure_air
from testbench.questions.gap.priors import PRIORS
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.gauss_newton import retune
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.workflow import find_gap

STILL = AirFound(False, 0.0, 547.0, 0.0, 9.55, 4.0)


@pytest.fixture(scope="module")
def believed() -> Believed:
    return replace(believe(), rate_hz=100.0)


@pytest.fixture(scope="module")
def records(believed) -> list[FlightRecord]:
    return measure(believed, 7)


def test_a_control_flight_has_commands_and_samples_of_the_measured_one_and_leaves_noise(believed, records):
    blind = records[0].valid.copy()
    blind[300:340, records[0].channels.index("alpha")] = False
    records = [replace(records[0], valid=blind), records[1]]
    flown = fly_control(believed, STILL, records, 1)
    assert flown is not None
    for control, record in zip(flown, records, strict=True):
        assert (control.channels, control.kind) == (record.channels, "measured")
        np.testing.assert_array_equal(control.valid, record.valid)
        for name in ("de_cmd", "thr_cmd"):
            np.testing.assert_array_equal(control[name], record[name])
        assert np.all(np.std(control.columns(believed.outputs) - record.columns(believed.outputs), axis=0) > 0.0)
    tuned = retune(Hypothesis.at(believed, believed, tuple(flown)))
    # White noise alone: chi-square over n samples scatters by sqrt(2 n); five of it are 6e-7 both sides. Means that are
    # taken out and coefficients that are re-tuned take some 15 of it.
    assert abs(tuned.chi2 - tuned.samples) < 5.0 * np.sqrt(2.0 * tuned.samples) + 15.0
    assert np.max(np.abs(tuned.nuisances - 1.0)) > 0.02  # they were drawn, not left where they are believed


def test_control_flights_are_drawn_by_their_number_alone(believed, records):
    one, same, other = (fly_control(believed, STILL, records[:1], n) for n in (1, 1, 2))
    assert one is not None
    assert same is not None
    assert other is not None
    np.testing.assert_array_equal(one[0].data, same[0].data)
    assert not np.array_equal(one[0].data, other[0].data)


def test_control_flights_meet_the_turbulence_that_was_found(believed, records):
    found = AirFound(True, 0.4, 547.0, 100.0, 9.55, 4.0)
    flown = fly_control(believed, found, records, 3)
    assert flown is not None
    heard = listen(believed, flown)
    assert heard.moves
    # 28 s of turbulence, scale length 533 m at 16 m/s: its rms as filters see it is told to some 10 %; here three.
    assert measure_air(believed, flown, heard).rms_m_s == pytest.approx(0.4, rel=0.3)
    white = in_air(believed, replace(found, rms_m_s=0.4))
    tuned = retune(Hypothesis.at(white, white, tuple(flown)))
    assert tuned.chi2 == pytest.approx(
        tuned.samples, rel=0.06
    )  # the filter is linear; six standard deviations of noise


def naming(gain: float, outcome: str = "named") -> Naming:
    """A naming of a slow servo that gains so much, or of nothing."""
    fit = EffectFit(
        effect=EFFECTS["actuator_lag"],
        values={"lag_rad_s": 12.0},
        errors={"lag_rad_s": 0.1},
        chi2=4_450.0,
        gain=gain,
        threshold=17.0,
        share=0.999,
        nuisances=dict.fromkeys(PRIORS, 1.0),
    )
    names = ("actuator_lag",) if outcome == "named" else ()
    return Naming(outcome, names, (fit,), 4_450.0 + gain, 4_450.0 + gain, {}, 4_500, "what was said")


def test_control_flights_are_searched_once_and_kept(believed, records, tmp_path, monkeypatch):
    asked = []

    def search(flown, heard):
        asked.append((len(flown), heard.moves))
        return naming(5.0, "no gap")

    monkeypatch.setattr(controls_module, "listen", lambda model, flown: STILL)
    file = tmp_path / "controls.jsonl"
    said: list[str] = []

    def fly(count, file=file, air=STILL):
        return fly_controls(believed, records[:1], air, naming(9_000.0), count, search, said.append, file)

    first = fly(2)
    assert asked == [(1, False)] * 2
    assert [c.number for c in first.flights] == [1, 2]
    file.write_text(file.read_text() + '{"of": "cut off', encoding="utf-8")  # a process that was killed as it wrote
    more = fly(3)
    assert len(asked) == 3
    assert more.flights[:2] == first.flights
    assert said[-1] == "control flight 3 of 3, without any effect"
    assert fly(3).flights == more.flights
    assert len(asked) == 3
    fly(1, air=replace(STILL, moves=True, rms_m_s=0.2))  # another air: other control flights
    assert len(asked) == 4
    assert fly(2, file=None).flights == first.flights  # the same without a file, flown anew
    assert len(asked) == 6
    with pytest.raises(RecordError, match=r"a readable journal of finished work must lie at '.*', got: Is a directory"):
        fly(1, file=tmp_path)


def test_coefficients_with_which_nothing_flies_are_drawn_again_and_then_said(believed, records, monkeypatch):
    tried = []

    def fails(real, record, air, seed):
        tried.append(seed)
        raise LimitError("it leaves its limits")

    monkeypatch.setattr(controls_module, "_measured", fails)
    found = fly_controls(believed, records[:1], STILL, naming(9_000.0), 1, lambda r, a: naming(1.0), lambda s: None)
    assert len(set(tried)) == 10
    assert [c.outcome for c in found.flights] == ["not flown"]
    assert found.sentence.startswith("none of the control flights could be flown")


def among(*gains: float, gain: float = 30.0) -> Controls:
    flights = [Control(i, "named" if g > 25.0 else "no gap", (), g, 4_400.0 + i) for i, g in enumerate(gains, 1)]
    return Controls(tuple(flights), gain, 4_402.0)


def test_probabilities_count_the_measured_flights_among_the_controls():
    controls = among(1.0, 5.0, 9.0)
    assert controls.by_gain == pytest.approx(1 / 4)  # none gains as much: no less than one in four can be said
    assert controls.by_misfit == pytest.approx(3 / 4)  # two leave as much
    assert "the search calls none a gap; effects gain at most 9 there and 30 here" in controls.sentence
    louder = among(1.0, 40.0, 9.0)
    assert (louder.by_gain, louder.called) == (pytest.approx(2 / 4), 1)
    lost = replace(controls, flights=(*controls.flights, Control(4, "not flown", (), 0.0, 0.0)))
    assert lost.by_gain == controls.by_gain
    assert lost.sentence.endswith("; 1 more could not be flown")


def test_a_name_that_control_flights_reach_without_an_effect_is_withdrawn():
    assert without_false_alarms(naming(30.0), among(1.0, 29.0)).names == ("actuator_lag",)
    withdrawn = without_false_alarms(naming(30.0), among(1.0, 31.0))
    assert (withdrawn.outcome, withdrawn.names) == ("no gap", ())
    assert "so much is gained in 1 of 2 control flights without any effect" in withdrawn.sentence


def test_the_workflow_says_what_control_flights_say(believed, records):
    few = {n: EFFECTS[n] for n in ("actuator_lag", "q_scale")}
    slow = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 12.0})
    measured = measure(slow, 11)
    named = {"a": measured[0]}
    finding = find_gap(believed, named, {"b": measured[1]}, effects=few, controls=2)
    assert finding.naming.names == ("actuator_lag",)
    assert finding.controls is not None
    # A control flight is called a gap with a probability of 1e-3.
    assert [c.outcome for c in finding.controls.flights] == ["no gap", "no gap"]
    assert finding.controls.gain == max(f.gain for f in finding.naming.ranking) > 100.0
    assert finding.controls.sentence in finding.sentences
