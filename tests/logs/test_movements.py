"""Movements of a control in a record made of known ones: where each begins and ends, what is joined, what is cut."""

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.logs.manoeuvres import _movements, cut_at, find_manoeuvres

RATE = 50.0
seconds = np.arange(round(60.0 * RATE)) / RATE


def record(de: np.ndarray, da: np.ndarray | None = None, valid: np.ndarray | None = None) -> FlightRecord:
    data = np.column_stack([de, 0.0 * seconds if da is None else da])
    taken = None if valid is None else np.column_stack([valid, valid])
    return FlightRecord(seconds, ("de", "da"), data, "measured", valid=taken)


def box(begin: float, end: float, size: float = 1.0) -> np.ndarray:
    return size * DEG_RAD * ((seconds >= begin) & (seconds < end))


def doublet(begin: float, half: float = 0.5, size: float = 2.0) -> np.ndarray:
    return box(begin, begin + half, size) - box(begin + half, begin + 2.0 * half, size)


def spans(x: np.ndarray) -> list[tuple[float, float]]:
    return [(m.start_s, m.end_s) for m in find_manoeuvres(record(x), ["de"]).manoeuvres]


def test_a_movement_spans_its_first_and_its_last_change():
    found = find_manoeuvres(record(doublet(20.0), box(40.0, 41.0, 3.0)), ["de", "da"])
    assert [m.controls for m in found.manoeuvres] == [("de",), ("da",)]
    ends = [(m.start_s, m.end_s) for m in found.manoeuvres]
    np.testing.assert_allclose(ends, [(20.0, 21.0), (40.0, 41.0)], atol=0.021)
    assert [m.amplitude for m in found.manoeuvres] == [pytest.approx((2.0 * DEG_RAD,)), pytest.approx((3.0 * DEG_RAD,))]
    np.testing.assert_allclose([m.cut_s for m in found.manoeuvres], [(18.0, 26.0), (38.0, 46.0)], atol=0.021)
    assert found.said[0] == "de: moves where its range within 0.5 s exceeds 0.5 deg, once"


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (doublet(20.0) + doublet(21.7), [(20.0, 22.7)]),  # 0.7 s apart
        (doublet(20.0) + doublet(22.3), [(20.0, 21.0), (22.3, 23.3)]),  # 1.3 s apart
        (box(20.0, 29.0), [(20.0, 29.0)]),  # held away for 9 s
        (box(20.0, 31.0), [(20.0, 20.0), (31.0, 31.0)]),  # for 11 s: trimmed, twice
        (doublet(20.0, size=20.0) + doublet(24.0, size=1.9), [(20.0, 21.0)]),  # below a tenth of its neighbour
        (doublet(20.0, size=20.0) + doublet(24.0, size=2.1), [(20.0, 21.0), (24.0, 25.0)]),
        (doublet(20.0, size=20.0) + doublet(28.0, size=1.9), [(20.0, 21.0), (28.0, 29.0)]),  # not nearby
        (doublet(20.0, size=0.24), []),  # 0.48 deg from one extreme to the other
        (doublet(20.0, size=0.26), [(20.5, 20.5)]),
    ],
)
def test_movements_are_joined_held_or_left_out_by_the_stated_limits(x, expected):
    np.testing.assert_allclose(np.reshape(spans(x), (-1, 2)), np.reshape(expected, (-1, 2)), atol=0.041)


def test_noise_raises_the_threshold_to_three_times_its_range():
    noise = 0.2 * DEG_RAD * np.sign(np.sin(2.0 * np.pi * 10.0 * seconds + 0.1))  # a range of 0.4 deg all the time
    taken = np.ones(seconds.size, bool)
    found, threshold = _movements(noise + box(20.0, 21.0, 0.7), taken, 1.0 / RATE, 0.5 * DEG_RAD)
    assert threshold == pytest.approx(1.2 * DEG_RAD)
    assert found == []  # 0.7 and the noise's 0.4 are less
    found, _ = _movements(noise + box(20.0, 21.0, 0.9), taken, 1.0 / RATE, 0.5 * DEG_RAD)
    assert len(found) == 1


def test_a_control_that_begins_away_from_rest_is_looked_at_from_its_first_sample():
    x = box(0.0, 0.02) + doublet(20.0)
    found, _ = _movements(x, np.ones(seconds.size, bool), 1.0 / RATE, 0.5 * DEG_RAD)
    assert [a for a, _ in found] == pytest.approx([0, 1000], abs=1)
    first, second = find_manoeuvres(record(x), ["de"]).manoeuvres
    assert first.reason == "less than 0.5 s of quiet controls before it"
    assert second.reason == ""


def test_samples_that_were_lost_and_an_end_too_soon_are_said():
    valid = np.ones(seconds.size, bool)
    valid[(seconds > 20.3) & (seconds < 20.6)] = False
    (one,) = find_manoeuvres(record(doublet(20.0), valid=valid), ["de"]).manoeuvres
    assert one.reason == "samples of the controls were lost within it"
    assert one.cut_s is None
    valid[:] = (seconds < 18.5) | (seconds > 19.0)
    (one,) = find_manoeuvres(record(doublet(20.0), valid=valid), ["de"]).manoeuvres
    np.testing.assert_allclose(one.cut_s, (19.02, 26.0), atol=0.021)
    (one,) = find_manoeuvres(record(box(59.5, 61.0)), ["de"]).manoeuvres
    assert "quiet controls after it" in one.reason or "still held away" in one.reason


def test_a_control_that_flies_the_aircraft_finds_no_manoeuvres():
    busy = 3.0 * DEG_RAD * np.sin(8.0 * seconds) * (seconds < 40.0)
    found = find_manoeuvres(record(busy, doublet(50.0)), ["de", "da"])
    assert found.said[0] == "de: moves for more than 60 % of the record, not used to find manoeuvres"
    assert [m.controls for m in found.manoeuvres] == [("da",)]


def test_a_cut_that_somebody_chose_holds_what_moves_in_it():
    flown = record(doublet(20.0) + doublet(40.0), box(21.5, 22.0, 3.0))
    found = cut_at(flown, ["de", "da"], [(38.5, 44.0), (19.0, 21.2)]).manoeuvres
    assert [m.cut_s for m in found] == [(19.0, 21.2), (38.5, 44.0)]
    assert [m.controls for m in found] == [("de",), ("de",)]
    np.testing.assert_allclose([(m.start_s, m.end_s) for m in found], [(20.0, 21.0), (40.0, 41.0)], atol=0.021)
    (both,) = cut_at(flown, ["de", "da"], [(19.0, 25.0)]).manoeuvres
    assert set(both.controls) == {"de", "da"}
    with pytest.raises(RecordError, match=r"a control must move within a cut, got 30:35 s"):
        cut_at(flown, ["de", "da"], [(30.0, 35.0)])
    for wrong in ((-1.0, 5.0), (50.0, 61.0), (25.0, 20.0)):
        with pytest.raises(RecordError, match=r"a cut must be START:END within the record, 0 to 59\.98 s"):
            cut_at(flown, ["de"], [wrong])
