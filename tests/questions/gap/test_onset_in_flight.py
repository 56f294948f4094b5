"""What begins in flight is found in the record where it does, named by its effect, and held apart in the belief."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from questions.gap.gap_flights import CONDITION, ELEVATOR, THROTTLE, believe, measure
from questions.gap.hand_flown import hand_flown

from testbench.core.record import FlightRecord
from testbench.core.scenario.inputs import Doublet
from testbench.effects import EFFECTS
from testbench.flight import Manoeuvre, fly, trim
from testbench.inputs.signal import InputSignal
from testbench.questions.gap import onset
from testbench.questions.gap.name import _Asker
from testbench.questions.gap.starts import Start, marked
from testbench.questions.gap.windows import begin_freely, cut
from testbench.questions.gap.workflow import GapSearch, find_gap

AT_S = 6.0
SOUGHT = {n: EFFECTS[n] for n in ("surface_scale", "actuator_lag", "alpha_scale", "drag_increment")}
DOUBLET = Doublet(signal="doublet", control="de", amplitude_deg=2.0, period_s=1.2)


def doublets(believed, gain_later, seed=7) -> FlightRecord:
    """Return a record of two doublets, before and after AT_S, when the elevator begins to do so much of its command."""
    rate = believed.rate_hz
    t = np.arange(round(12.0 * rate)) / rate
    u = np.zeros_like(t)
    for begin in (0.5, 5.5):
        u[(t >= begin) & (t < begin + 0.6)], u[(t >= begin + 0.6) & (t < begin + 1.2)] = 0.035, -0.035
    done = np.where(t >= AT_S - 2.0, gain_later * u, u)
    trimmed = trim(believed.aircraft, CONDITION, rate)
    manoeuvre = Manoeuvre("doublets", InputSignal(t, done[:, None], ("de",)), 2.0)
    record = believed.suite.measure(fly(believed.aircraft, trimmed, manoeuvre, believed.suite.rate_hz), seed)
    plain = Manoeuvre("doublets", InputSignal(t, u[:, None], ("de",)), 2.0)
    commanded = believed.suite.measure(fly(believed.aircraft, trimmed, plain, believed.suite.rate_hz), seed)
    return record.with_columns({"de_cmd": commanded["de_cmd"]})


@pytest.fixture(scope="module")
def found():
    believed = believe()
    first, third, second = measure(believed, 3, inputs=(ELEVATOR, THROTTLE, DOUBLET), duration_s=8.0)
    records = {"3211": first, "throttle": third, "doublets": doublets(believed, 0.5)}
    suite = replace(
        believed.suite, sensors=tuple(replace(s, noise_std=s.noise_std / 1.2) for s in believed.suite.sensors)
    )
    return find_gap(
        replace(believed, suite=suite),
        records,
        {"doublet": second},
        GapSearch(effects=SOUGHT, further={}, noise="stated"),
    )


@pytest.mark.slow
def test_half_the_elevator_from_six_seconds_on_is_named_and_dated(found):
    begun = found.begun
    assert begun is not None
    assert (begun.record, begun.ends) == ("doublets", False)
    assert 3.7 <= begun.at_s <= 7.6  # the elevator is at rest from 3.7 s to 7.5 s, and nothing shows there
    assert found.naming.names[0] == f"surface_scale{onset.LATER}", found.naming.sentence
    best = found.naming.best
    assert best.values["scale"] == pytest.approx(0.5, abs=4.0 * best.errors["scale"])
    assert best.probability + best.imitates > 0.98  # of all else that is known; it may imitate what is not
    assert any("s of 'doublets' on" in s for s in found.sentences)


@pytest.mark.slow
def test_a_flight_without_it_is_judged_without_it(found):
    """The flight held out had the whole elevator: what began in another flight is not added to it."""
    assert float(found.shrink[0].energy_after.mean()) < 1.2


def test_what_begins_acts_in_records_that_say_so():
    believed = believe().with_effect(replace(EFFECTS["surface_scale"], later=True), {"scale": 0.5})
    record = measure(believe(), 5, inputs=(ELEVATOR,))[0]
    before, after = (marked(record, Start(CONDITION, changed=changed)) for changed in (False, True))
    plain, half = believe(), believe().with_effect(EFFECTS["surface_scale"], {"scale": 0.5})
    assert np.array_equal(believed.predict(record), plain.predict(record))
    assert np.array_equal(believed.predict(before), plain.predict(before))
    assert np.array_equal(believed.predict(after), half.predict(record))
    assert np.array_equal(believed.begun_later().predict(record), half.predict(record))


@pytest.mark.parametrize("ends", [False, True])
def test_both_parts_of_a_window_that_is_cut_can_be_flown(ends):
    """A record that was in motion from its first sample on is no more at trim before the cut than after it."""
    believed = believe()
    whole = cut(believed, {"by hand": hand_flown(believed, 3, 6.0)}, 6.0).records
    ((name, record),) = whole.items()
    known = begin_freely(believed, whole)
    begun = onset.Begun(name, 3.0, ends, 1.0, (f"{name}, {'until' if ends else 'from'} 3 s",), 1)
    parts = onset.divided(known, whole, begun)
    assert len(parts) == 2
    started = onset.begin_there(known, parts, begun, record, known)
    for part in parts.values():
        left = started.residuals(part)[started.taken(part)]
        assert np.sqrt(np.mean(left**2)) < 1.2  # nothing is missing: noise


@pytest.mark.slow
def test_an_effect_of_all_records_is_not_said_to_begin():
    """A slow servo shows where the elevator moves, in every record: it is named as what it is."""
    believed = believe()
    truth = believed.with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 8.0})
    records = dict(zip(("3211", "doublet"), measure(truth, 11, inputs=(ELEVATOR, DOUBLET)), strict=True))
    found = find_gap(believed, records, {}, GapSearch(effects=SOUGHT, further={}))
    assert found.naming.names[0] == "actuator_lag"
    assert found.begun is None


def test_every_effect_is_seen_where_it_acts_though_coefficients_imitate_it_in_all_records():
    """Half the elevator in the last of three records, which Cm_de and CL_de half do in all of them."""
    believed = believe()
    truth = believed.with_effect(EFFECTS["surface_scale"], {"scale": 0.5})
    first, second, _ = measure(believed, 3, inputs=(ELEVATOR, DOUBLET, THROTTLE), duration_s=8.0)
    third = measure(truth, 9, inputs=(ELEVATOR,), duration_s=8.0)[0]
    asker = _Asker(believed, (first, second, third), "measured")
    effects = list(SOUGHT.values())
    whole = [np.full(len(r), True) for r in asker.records]
    none = np.full(len(first), False)
    everywhere, last, late = asker.acting(effects, [whole, [none, none, whole[2]], [none, none, third.t_s > 4.0]])
    assert len(asker.bases) == 1
    assert everywhere == pytest.approx({one.effect.name: one.log for one in asker.near(effects)})
    assert next(iter(last)) == "surface_scale"
    assert last["surface_scale"] > max(everywhere.values()) + 50.0
    assert last["surface_scale"] > late["surface_scale"]
