"""Changes in flight: when, in which part, with which probability; sound flights are left alone."""

import numpy as np
import pytest
from inference.closed_loop import fly
from scipy.special import logsumexp

from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.inference import changes
from testbench.inference.changes import SURE, Watch

AT_S = 120.0


def part_of(record, rows):
    return FlightRecord(record.t_s[rows], record.channels, record.data[rows], "measured", record.valid[rows])


def watched(record, nominal_s=60.0, nominal=(), at_once=100):
    watch = Watch(record.channels, record.dt_s, nominal_s)
    watch.believe(nominal)
    for k in range(0, len(record), at_once):
        watch.take(part_of(record, slice(k, k + at_once)))
    return watch


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("part", "factor", "called_s"), [("da", 0.5, 5.0), ("de", 0.5, 5.0), ("de", 0.8, 15.0), ("thr", 0.0, 20.0)]
)
def test_a_part_that_loses_effect_is_named_with_its_time_and_factor(part, factor, called_s):
    watch = watched(fly(101, at_s=AT_S, factors={part: factor}))
    found, *later = watch.found()
    assert found.part == part
    assert found.since_s == pytest.approx(AT_S, abs=2.0)
    assert [found, *later][-1].until_s == watch.t_s[-1]
    assert not later or part == "thr"  # without thrust it soon flies as the linear equations do not hold
    assert found.factor == pytest.approx(factor, abs=0.12)
    assert found.probability > SURE
    assert watch.changed > SURE
    live = np.array(watch.t_s)[1.0 - watch.probabilities(smoothed=False)[:, 0] > SURE]
    assert AT_S < live[0] < AT_S + called_s


@pytest.mark.parametrize("side", ["right", "left"])
def test_an_elevon_is_told_from_elevator_and_aileron(side):
    flown = fly(8, at_s=AT_S, factors={side: 0.4})
    record = flown.select([c for c in flown.channels if c != "dr"])
    found = watched(record).found()
    assert [c.part for c in found] == [side]
    assert found[0].since_s == pytest.approx(AT_S, abs=2.0)
    assert found[0].factor == pytest.approx(0.4, abs=0.2)


def test_it_ends_where_the_effect_is_back():
    first, second = fly(3, at_s=AT_S, factors={"da": 0.3}), fly(4)
    data = np.vstack([first.data[:1800], second.data[600:1800]])
    record = FlightRecord(0.1 * np.arange(len(data)), first.channels, data, "measured")
    found = [c for c in watched(record).found() if c.part == "da"]
    assert found[0].since_s == pytest.approx(AT_S, abs=2.0)
    assert found[0].until_s == pytest.approx(180.0, abs=3.0)


@pytest.mark.parametrize("flights", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_sound_flights_are_left_alone(flights):
    """One of the flights at most: of 30 of other seeds two were called while this was built, so of ten two or more in
    14 %, of three in 1 %; the seeds are fixed.
    """
    called = [bool(watched(fly(900 + seed, length_s=180.0)).found()) for seed in range(flights)]
    assert sum(called) <= 1


def test_other_flights_make_up_for_a_short_beginning():
    record = fly(12, length_s=60.0, at_s=40.0, factors={"da": 0.4})
    with pytest.raises(RecordError, match=r"12 s of nominal flight tell the 41 coefficients .* got 5"):
        watched(record, 5.0)
    (found,) = watched(record, 5.0, [fly(13)]).found()
    assert found.part == "da"


def test_pieces_of_any_length_give_the_same():
    record = fly(5, length_s=90.0)
    at_once, by_ones = watched(record), watched(record, at_once=7)
    assert at_once.t_s == by_ones.t_s
    np.testing.assert_allclose(at_once.probabilities(), by_ones.probabilities(), rtol=1e-6, atol=1e-12)


def test_what_is_not_valid_is_not_weighed():
    record = fly(101, at_s=AT_S, factors={"da": 0.5})
    valid = record.valid.copy()
    valid[900:1100, 0] = False
    data = np.where(valid, record.data, 1e3)
    found = watched(FlightRecord(record.t_s, record.channels, data, "measured", valid)).found()
    assert [c.part for c in found] == ["da"]


def test_evidence_of_a_block_is_that_of_its_covariance():
    watch = watched(fly(5, length_s=90.0))
    watch._reset(1)
    rng = np.random.default_rng(0)
    A, Y = rng.standard_normal((6, len(watch._tags))), rng.standard_normal((6, len(watch.targets)))
    E, J, s2 = len(watch.targets), len(watch.controls), watch._s2.copy()
    watch._effects(A)
    D = np.zeros((6, E, E + J))
    D[:, range(E), range(E)] = 1.0
    for j, c in enumerate(watch.controls):
        D[:, :, E + j] = watch._of[c]
    D, y = D.reshape(6 * E, -1), (Y - A @ watch._B).ravel()
    noise = np.tile(s2 * (1.0 + np.trace(A @ watch._inverse @ A.T)), 6)
    likely = []
    for share, rough in ((1.0 - changes._GUSTS, 1.0), (changes._GUSTS, changes._ROUGHER)):
        C = np.diag(rough * noise) + D @ np.diag(watch._v0[: E + J]) @ D.T
        square, size = y @ np.linalg.solve(C, y), np.linalg.slogdet(C)[1]
        nu = changes._FREEDOM
        likely.append(np.log(share) - 0.5 * (nu + 6 * E) * np.log1p(square / nu) - 0.5 * size)
    assert watch._weigh(A, Y) == pytest.approx(logsumexp(likely), rel=1e-9)


def test_what_shows_no_change_is_refused():
    with pytest.raises(RecordError, match=r"a control is recorded with what it moves.*got p, V"):
        Watch(("p", "V"), 0.1)
    with pytest.raises(RecordError, match="1 to 10 Hz, got 50 Hz"):
        Watch(("p", "da"), 0.02)
    watch = Watch(("p", "da"), 0.1)
    assert watch.found() == ()
    assert watch.changed == 0.0
    assert watch.now[0] == 1.0
