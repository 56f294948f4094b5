"""Flights that are given away as they are flown: the same records, made when they are wanted, in memory that stays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
import psutil
import pytest

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.core.errors import LimitError, Refusal
from testbench.flight.batch.jobs import BATCH, Tally
from testbench.flight.condition import TrimmedFlight


@pytest.fixture(scope="module")
def trimmed(taurus: Aircraft) -> TrimmedFlight:
    return tb.trim(taurus, tb.FlightCondition(13.0, 100.0))


def pulses(aircraft: Aircraft, trimmed: TrimmedFlight, duration_s: float = 1.0) -> Iterator[tb.Job]:
    """Make flights without end, each a little different."""
    t = np.arange(round(duration_s * trimmed.rate_hz)) / trimmed.rate_hz
    k = 0
    while True:
        u = 1e-3 * (1.0 + k % 97) / 97.0 * (t < 0.3)
        signal = tb.InputSignal(t, u[:, None], ("de",))
        yield tb.Job(aircraft, trimmed, tb.Manoeuvre(f"pulse {k}", signal, 0.0), 60.0, ("q", "alpha"))
        k += 1


def test_records_are_those_of_one_call_in_their_order(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    jobs = list(islice(pulses(taurus, trimmed), 70))
    told = Tally()
    stream = list(tb.fly_stream(jobs, flown=told, at_once=32))
    together = tb.fly_many(taurus, trimmed, [job.manoeuvre for job in jobs], 60.0, ("q", "alpha"), simulator="batch")
    assert (told.batch, told.jsbsim) == (70, 0)  # the last block holds six flights only
    for a, b in zip(stream, together, strict=True):
        assert isinstance(a, tb.FlightRecord)
        assert a.provenance["manoeuvre"] == b.provenance["manoeuvre"]
        assert np.array_equal(a.data, b.data)


def test_flights_are_made_when_they_are_wanted(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    made = 0

    def counted() -> Iterator[tb.Job]:
        nonlocal made
        for job in pulses(taurus, trimmed):
            made += 1
            yield job

    stream = tb.fly_stream(counted(), at_once=16)
    assert made == 0
    next(stream)
    assert made == 16


def test_a_few_flights_are_flown_by_jsbsim_and_told_how_many(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    told = Tally()
    records = list(tb.fly_stream(islice(pulses(taurus, trimmed), 3), flown=told))
    assert [BATCH in str(r.provenance) for r in records if isinstance(r, tb.FlightRecord)] == [False] * 3
    assert told.reasons == {"fewer than 8 flights at once are not worth a batch": 3}


def test_a_flight_that_breaks_a_law_is_its_error_and_the_others_fly(taurus: Aircraft, trimmed: TrimmedFlight) -> None:
    jobs = list(islice(pulses(taurus, trimmed), 10))
    jobs[4] = replace(jobs[4], log_rate_hz=100.0)
    found = list(tb.fly_stream(jobs))
    assert isinstance(found[4], LimitError)
    assert sum(isinstance(x, Refusal) for x in found) == 1
    with pytest.raises(LimitError, match="at_once >= 1"):
        next(tb.fly_stream(jobs, at_once=0))


def most_memory(stream: Iterator[tb.FlightRecord | Refusal], flights: int) -> float:
    """Consume flights; return the most memory that the process was seen to have meanwhile, MB."""
    process, most, greatest = psutil.Process(), 0, 0.0
    for k, record in enumerate(islice(stream, flights)):
        assert isinstance(record, tb.FlightRecord)
        greatest = max(greatest, float(np.max(np.abs(record["q"]))))
        if k % 250 == 0:
            most = max(most, process.memory_info().rss)
    assert greatest > 0.0
    return most / 2**20


@pytest.mark.slow
def test_a_hundred_thousand_flights_take_no_more_memory_than_ten_thousand(
    taurus: Aircraft, trimmed: TrimmedFlight
) -> None:
    """Held together, the records alone of 90 000 more flights would take some hundreds of MB."""
    stream = tb.fly_stream(pulses(taurus, trimmed))
    early = most_memory(stream, 10_000)
    late = most_memory(stream, 90_000)
    assert late - early < 8.0
