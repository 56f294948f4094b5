"""In still air amplitudes keep the limits with aircraft of less and more static stability, too."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from testbench.core.errors import Refusal
from testbench.questions.design import margins as module
from testbench.questions.design import realise
from testbench.questions.design.flown import Flight, Tightest
from testbench.questions.design.margins import for_others
from testbench.questions.design.realise import Range


class Believed(SimpleNamespace):
    flown_as = Range.flown_as


RANGE = Believed(aircraft="believed", trimmed="", problem=None, simulator="auto", tally="")


@dataclass(frozen=True)
class Flown:
    design: Any
    record: str = "first"
    tightest: Any = None
    for_others: float = 1.0


@pytest.fixture
def flying(monkeypatch):
    """An aircraft is the share of a limit that it uses per amplitude; a text cannot be flown."""

    def flight(aircraft: Any, size: float) -> Flight | Refusal:
        if isinstance(aircraft, Refusal):
            return aircraft
        return Flight("again", [], Tightest("bank", {"believed": 0.99}.get(aircraft, aircraft) * size, 1.0))  # type: ignore[arg-type]

    def each(aircraft, trimmed, designs, limits, simulator, tally):
        assert len(aircraft) == len(trimmed) == len(designs) == len(limits)
        return [flight(a, d.size) for a, d in zip(aircraft, designs, strict=True)]

    monkeypatch.setattr(module, "fly_each", each)
    monkeypatch.setattr(realise, "fly_all", lambda a, t, designs, *rest: [flight(a, d.size) for d in designs])
    monkeypatch.setattr(
        module, "rescaled", lambda p, d, factor, limit: SimpleNamespace(size=factor * d.size, limit=limit)
    )


def lowered(*others: Any) -> list[Flown]:
    flown = [Flown(SimpleNamespace(size=size, limit="bank")) for size in (1.0, 0.5)]
    return for_others(RANGE, flown, None, [(other, "") for other in others])


def test_the_amplitude_is_what_the_most_sensitive_aircraft_allows(flying):
    """One that uses 1.25 of the limit asks for 0.8 of the amplitude, and a little less; half of it needs nothing."""
    large, small = lowered(0.7, 1.25)
    assert large.for_others == pytest.approx(0.8 * 0.98)
    assert large.design.size == large.for_others
    assert large.tightest.share == pytest.approx(0.99 * large.for_others)  # of the believed aircraft
    assert (small.for_others, small.record) == (1.0, "first")


def test_nothing_is_lowered_without_an_aircraft_that_breaks_a_limit(flying):
    assert [f.record for f in lowered()] == ["first", "first"]
    assert [f.record for f in lowered(0.9, Refusal("it does not trim"))] == ["first", "first"]


def test_an_aircraft_that_no_amplitude_suits_takes_no_more_than_three_quarters(flying):
    large, small = lowered(50.0)
    assert large.for_others == small.for_others == 0.25
