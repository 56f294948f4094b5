"""Half the amplitude counts where flights show that the estimates are misled by more than was foreseen."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from testbench.questions.design import gentler as module
from testbench.questions.design import realise
from testbench.questions.design.gentler import gentler, misleads
from testbench.questions.design.realise import Errors, Realised

N = 20
WANTED = 0.05


def realised(mean: float, scatter: float, promised: float) -> Realised:
    """Return what 20 flights with this mean error and scatter have shown against a promise."""
    e = mean + scatter * np.random.default_rng(1).standard_normal((N, 1))
    found = Errors(e, np.full((N, 1), scatter), ())
    return Realised(np.array([promised]), found, found.departs(np.array([promised])))


@dataclass(frozen=True)
class Flown:
    design: Any
    record: str = "of the first amplitude"
    tightest: str = ""
    curbed: float = 1.0


@dataclass
class Range:
    """A range on which the mean error grows with the square of the amplitude, and the scatter falls with it."""

    bend: float
    noise: float
    problem: Any = field(default_factory=lambda: SimpleNamespace(known=None))
    targets: Any = field(default_factory=lambda: SimpleNamespace(wanted=np.array([WANTED])))
    aircraft: str = ""
    trimmed: str = ""
    simulator: str = "auto"
    tally: str = ""

    flown_as = realise.Range.flown_as

    def off(self, designs):
        return [(design, None) for design in designs]

    def realised(self, design, n, say):
        assert n == N
        return realised(self.bend * design.size**2, self.noise / design.size, self.noise / design.size)


@pytest.fixture
def rescaling(monkeypatch):
    """Designs are their amplitude alone."""
    half = lambda problem, design, factor, limit: SimpleNamespace(size=factor * design.size, family="2-1-1", limit="")  # noqa: E731
    monkeypatch.setattr(module, "rescaled", half)
    monkeypatch.setattr(module, "total_errors", lambda problem, design, errors: errors)
    flight = SimpleNamespace(record="of the last amplitude", tightest="load factor")
    monkeypatch.setattr(realise, "fly_all", lambda *args: [flight])


def tried(range_: Range) -> tuple[Flown, Realised, int]:
    said: list[str] = []
    first = Flown(SimpleNamespace(size=1.0, family="2-1-1", limit=""))
    flown, found = gentler(range_, first, range_.realised(first.design, N, None), None, N, said.append)
    return flown, found, len(said)


def test_the_amplitude_is_halved_until_the_bias_no_longer_rules(rescaling):
    flown, found, halvings = tried(Range(bend=1.0, noise=0.03))
    # Mean error and scatter: 1.0 and 0.03, then 0.25 and 0.06, then 0.06 and 0.12, where noise rules.
    assert (flown.design.size, flown.curbed, halvings) == (0.25, 0.25, 2)
    assert found.headline[0] == pytest.approx(np.hypot(0.0625, 0.12), rel=0.3)
    assert (flown.record, flown.tightest) == ("of the last amplitude", "load factor")


def test_an_amplitude_that_is_not_clearly_better_is_not_taken(rescaling):
    """The bias does not fall with the amplitude: it is none of a bent response."""
    range_ = Range(bend=1.0, noise=0.03)
    whole = realised(0.5, 0.03, 0.03)
    range_.realised = lambda design, n, say: whole  # type: ignore[method-assign]
    first = Flown(SimpleNamespace(size=1.0, family="2-1-1", limit=""))
    assert gentler(range_, first, whole, None, N, lambda text: None) == (first, whole)


@pytest.mark.parametrize(
    ("mean", "scatter", "promised", "why"),
    [
        (0.02, 0.001, 0.001, "what is wanted is reached"),
        (0.2, 0.01, 0.2, "the promise foresaw it"),
        (0.1, 0.4, 0.1, "scatter is most of it"),
    ],
)
def test_an_error_that_a_smaller_amplitude_would_not_mend_is_left_alone(rescaling, mean, scatter, promised, why):
    design = SimpleNamespace(size=1.0)
    assert not misleads(Range(0.0, 0.0), design, realised(mean, scatter, promised)), why
    assert misleads(Range(0.0, 0.0), design, realised(0.3, 0.01, 0.02))
    nothing = replace(realised(0.3, 0.01, 0.02), found=Errors(np.zeros((0, 1)), np.zeros((0, 1)), ("no trim",)))
    assert not misleads(Range(0.0, 0.0), design, nothing)
