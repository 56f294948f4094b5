"""One search for the amplitude of an input: what each part of the ensemble asks for, on aircraft that are a number."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from testbench.core.errors import Refusal
from testbench.design import amplitude as module
from testbench.design import ensemble as ensemble_module
from testbench.design.amplitude import AIR, BELIEVED, BIAS, DRAWS, STABILITY, Ensemble, Flown
from testbench.design.ensemble import Draws, HeldFlight
from testbench.design.limits import Tightest
from testbench.design.problem import best_share
from testbench.design.realise import Errors, Realised

N, WANTED = 20, 0.05


@dataclass(frozen=True)
class Design:
    """An input that is its amplitude alone."""

    size: float
    limit: str = "V"
    off: Any = None
    cost: float = 1.0
    family: str = "2-1-1"


def flight(share: float) -> HeldFlight:
    return HeldFlight(np.array([share]), Tightest("bank", share, 1.0), "bank passes" if share > 1.0 else "", "record")  # type: ignore[arg-type]


def member(sensitivity: Any) -> Any:
    """An aircraft that uses so much of its one limit per amplitude."""
    used = lambda record: np.array([sensitivity * record.size])  # noqa: E731
    envelope = SimpleNamespace(names=("bank",), shares=used)
    targets = SimpleNamespace(wanted=np.array([WANTED]), jacobian=np.eye(1), names=("M_alpha",))
    problem = SimpleNamespace(envelope=envelope, targets=targets, known=None)
    return SimpleNamespace(sensitivity=sensitivity, problem=problem)


@dataclass
class Range:
    """Air adds to what an input uses; the mean error grows with the square of the amplitude, and the scatter falls."""

    member: Any
    gusts: tuple[float, ...] = ()
    bend: float = 0.0
    noise: float = 1.0
    flown: list[float] = field(default_factory=list)

    moves = property(lambda self: bool(self.gusts))
    flier = property(lambda self: self)

    def airs(self, first, n):
        return self.gusts

    def held(self, flights):
        self.flown += [d.size for _, d, _ in flights]
        out: list[HeldFlight | Refusal] = []
        for m, d, air in flights:
            refused = isinstance(m.sensitivity, Refusal)
            one = m.sensitivity if refused else flight(m.sensitivity * d.size + (air or 0.0))
            out.append(one if refused else one._replace(record=d))
        return out

    def off(self, designs):
        return [replace(d, off=np.array([self.bend * d.size]), cost=self.promised(d.size)) for d in designs]

    def promised(self, size):
        return float(np.hypot(self.noise / size, self.bend * size))

    def realised(self, design, n, say):
        return realised(self.bend * design.size**2, self.noise / design.size, self.noise / design.size)


def realised(mean: float, scatter: float, promised: float) -> Realised:
    """Return what 20 flights with this mean error and scatter have shown against a promise."""
    e = mean + scatter * np.random.default_rng(1).standard_normal((N, 1))
    found = Errors(e, np.full((N, 1), scatter), ())
    return Realised(np.array([promised]), found, found.departs(np.array([promised])))


@pytest.fixture(autouse=True)
def by_amplitude(monkeypatch):
    """Designs scale, and are judged, by their amplitude alone."""
    monkeypatch.setattr(module, "rescaled", lambda p, d, factor: Design(factor * d.size, d.limit))
    monkeypatch.setattr(module, "_room", lambda member, design: 1.5)
    monkeypatch.setattr(module, "total_errors", lambda problem, design, errors: errors)
    monkeypatch.setattr(module, "told", lambda *_: SimpleNamespace(costs=np.ones(1)))

    def best_share(problem, design, off):
        """Return the share at which noise of 0.03 and a bias that falls with it weigh least together."""
        return min(1.0, float(np.sqrt(0.03 / design.size / max(abs(off[0]), 1e-9))))

    monkeypatch.setattr(module, "best_share", best_share)


def flown(size: float = 1.0, sensitivity: float = 0.99) -> Flown:
    one = flight(sensitivity * size)
    return Flown(Design(size), Design(size), Design(size), one.tightest, "", True)  # type: ignore[arg-type]


def test_the_believed_aircraft_takes_the_amplitude_that_uses_up_its_limit():
    """One that uses twice its limit is scaled to it, one that uses half of it grows as far as it may."""
    (found,) = Ensemble(Range(member(2.0))).started([Design(1.0)])
    assert (found.admissible, found.breach, found.design.limit) == (True, "bank passes", "bank")
    assert found.factor == found.share(BELIEVED) == pytest.approx(0.495)
    (found,) = Ensemble(Range(member(0.5))).started([Design(1.0)])
    assert (found.design.size, found.breach) == (1.5, "")
    nothing = Ensemble(Range(member(Refusal("it has no trim"))))
    with pytest.raises(Refusal, match="it has no trim"):
        nothing.started([Design(1.0)])


def test_designs_that_are_searched_together_are_those_that_are_searched_alone():
    ensemble = Ensemble(Range(member(2.0)))
    together = ensemble.started([Design(s) for s in (0.1, 1.0, 3.0)])
    alone = [ensemble.started([Design(s)])[0] for s in (0.1, 1.0, 3.0)]
    assert [f.design for f in together] == [f.design for f in alone]


@pytest.mark.parametrize("part", [DRAWS, STABILITY])
def test_the_amplitude_is_what_the_most_sensitive_aircraft_allows(part):
    others = (member(0.7), member(1.25))
    of = {"draws": Draws(others, ()), "robust": True} if part == DRAWS else {"others": others, "flights": N}  # type: ignore[arg-type]
    ensemble = Ensemble(Range(member(0.99)), **of)
    large, small = ensemble.chosen([flown(1.0), flown(0.5)], part)
    assert large.share(part) == pytest.approx(0.8 * 0.99)
    assert large.design.size == large.share(part)
    assert large.tightest.share == pytest.approx(0.99 * large.share(part))  # of the believed aircraft
    assert (small.share(part), small.design) == (1.0, flown(0.5).design)
    assert (large.over is not None) == (part == DRAWS)


def test_an_aircraft_that_no_amplitude_suits_takes_no_more_than_three_quarters():
    for one in (50.0, Refusal("the command leaves no room")):
        ensemble = Ensemble(Range(member(0.99)), others=(member(one),), flights=N)
        (found,) = ensemble.chosen([flown()], STABILITY)
        assert found.share(STABILITY) == 0.25
        assert found.bounds[STABILITY].reach > 1.0


def test_in_turbulence_the_extremes_of_the_next_flight_stay_inside_the_limits():
    """Gusts use 0.2 +- 0.1 of the limit at any amplitude: mean + k s of them, and what the input uses, make one."""
    gusts = tuple(0.2 + 0.1 * np.sqrt(19 / 20) * np.array([1.0, -1.0] * 10))
    range_ = Range(member(0.99), gusts)
    (found,) = Ensemble(range_, flights=N).chosen([flown()], AIR)
    bound = found.bounds[AIR]
    k = (bound.reach - bound.mean) / bound.deviation
    assert bound.deviation == pytest.approx(0.1)
    assert k == pytest.approx(1.729 * np.sqrt(1.05), rel=1e-3)  # t(19, 0.95)
    assert 0.97 <= bound.reach <= 1.0
    assert bound.mean == pytest.approx(0.2 + 0.99 * found.design.size)
    assert (bound.flights, found.share(AIR)) == (N, found.design.size)
    (calm,) = Ensemble(Range(member(0.99), gusts), flights=N).chosen([flown(0.3)], AIR)
    assert calm.share(AIR) == 1.0  # it never grows beyond what still air allows
    (storm,) = Ensemble(Range(member(0.99), (1.2,) * 20), flights=N).chosen([flown()], AIR)
    assert (storm.share(AIR), storm.bounds[AIR].met) == (0.25, 20)


def test_a_promised_bias_is_weighed_against_the_noise():
    """Noise of 0.03 over the amplitude, and a bias of it: least where both are alike, at 0.173."""
    range_ = Range(member(0.5), bend=1.0, noise=0.03)
    (found,) = Ensemble(range_, flights=N).chosen([flown()], BIAS)
    assert found.share(BIAS) == pytest.approx(np.sqrt(0.03))
    assert found.tightest.share == pytest.approx(0.5 * found.design.size)
    (straight,) = Ensemble(Range(member(0.5), bend=1e-3, noise=0.03), flights=N).chosen([flown()], BIAS)
    assert straight.share(BIAS) == 1.0


@pytest.mark.parametrize(("noise", "share"), [(0.03, np.sqrt(0.03)), (2.0, 1.0), (0.001, 0.1)])
def test_the_best_share_has_as_much_bias_as_noise_from_a_tenth_to_the_whole(noise, share):
    """Noise falls with the amplitude, what an estimate is off by grows with it; shares are 11 % apart."""
    problem = SimpleNamespace(cost_off=lambda M, off: float(np.hypot(1.0 / np.sqrt(M), off)))
    design = SimpleNamespace(information=1.0 / noise**2)
    assert best_share(problem, design, 1.0) == pytest.approx(share, rel=0.06)


def test_the_amplitude_is_lowered_until_the_measured_bias_no_longer_rules():
    """Mean error and scatter: 1.0 and 0.03, then 0.25 and 0.06, then 0.06 and 0.12, where noise rules."""
    range_ = Range(member(0.5), bend=1.0, noise=0.03)
    ensemble, said = Ensemble(range_, flights=N), []
    range_.certain = lambda design, n, first, say: first  # type: ignore[attr-defined]
    (found,) = ensemble.realised([flown()], said.append)
    assert (found.design.size, found.share(BIAS)) == pytest.approx((0.25, 0.25), rel=0.1)
    assert found.realised.headline[0] == pytest.approx(np.hypot(0.0625, 0.12), rel=0.3)
    assert found.tightest.share == pytest.approx(0.5 * found.design.size)
    assert len(said) == 3


def test_what_a_design_is_over_the_draws_is_that_of_its_last_amplitude(monkeypatch):
    """The first is flown with them; of a robust order every one, and none again that was."""
    monkeypatch.setattr(module, "told", lambda design, *_: SimpleNamespace(costs=np.array([design.size])))
    range_ = Range(member(0.5), bend=1.0, noise=0.03)
    for robust, flights in ((False, [1, 0]), (True, [1, 1])):
        ensemble = Ensemble(range_, Draws((member(0.6),), ()), robust=robust, flights=N)
        lowered = ensemble.chosen([flown(), flown(0.2)], DRAWS, BIAS)
        assert lowered[0].over is None
        found = ensemble.over(lowered)
        assert [f.over.told.costs[0] for f in found] == [f.design.size for f in found]
        assert [len(f.over.flights) for f in found] == flights
        range_.flown.clear()
        assert [f.over for f in ensemble.over(found)] == [f.over for f in found]
        assert range_.flown == []


def test_the_first_stays_the_first_unless_another_is_clearly_better():
    """Three designs of which the last has 0.8, then 0.6 times the realised error of the others."""
    for error, best in ((0.8, 0), (0.6, 2)):
        range_ = Range(member(0.5))
        errors = iter((0.02, 0.02, 0.02 * error))
        range_.realised = lambda design, n, say, e=errors: realised(0.0, next(e), 0.02)  # type: ignore[method-assign]
        range_.certain = lambda design, n, first, say: first  # type: ignore[attr-defined]
        designs = [replace(flown(size), design=Design(size, cost=0.1)) for size in (1.0, 0.9, 0.8)]
        found = Ensemble(range_, flights=N).realised(designs, lambda text: None)
        assert found[0].design is designs[best].design
        assert len(found) == 3


def test_every_wanted_accuracy_is_reached_where_no_target_needs_more(monkeypatch):
    targets = SimpleNamespace(names=("M_alpha", "M_q"), wanted=np.array([0.05, 0.1]))
    members = [
        SimpleNamespace(problem=SimpleNamespace(targets=targets, errors=e)) for e in ([0.05, 0.09], [0.06, 0.09])
    ]
    monkeypatch.setattr(ensemble_module, "seen_in", lambda problem, design: SimpleNamespace(cost=1.0))
    monkeypatch.setattr(ensemble_module, "total_errors", lambda problem, seen: np.array(problem.errors))
    found = ensemble_module.told(Design(1.0), members, ("M_q", "M_alpha"))  # type: ignore[arg-type]
    assert found.reached == 1
    np.testing.assert_allclose(found.ratios, [[0.9, 1.0], [0.9, 1.2]])


def test_an_amplitude_that_is_not_clearly_better_is_not_taken():
    """The bias does not fall with the amplitude: it is none of a bent response."""
    range_ = Range(member(0.5))
    range_.realised = lambda design, n, say: realised(0.5, 0.03, 0.03)  # type: ignore[method-assign]
    range_.certain = lambda design, n, first, say: first  # type: ignore[attr-defined]
    (found,) = Ensemble(range_, flights=N).realised([flown()], lambda text: None)
    assert (found.design.size, found.share(BIAS)) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("mean", "scatter", "promised", "why"),
    [
        (0.02, 0.001, 0.001, "what is wanted is reached"),
        (0.2, 0.01, 0.2, "the promise foresaw it"),
        (0.1, 0.4, 0.1, "scatter is most of it"),
    ],
)
def test_an_error_that_a_smaller_amplitude_would_not_mend_is_left_alone(mean, scatter, promised, why):
    ensemble = Ensemble(Range(member(0.5)), flights=N)
    assert not ensemble.misleads(replace(flown(), realised=realised(mean, scatter, promised))), why
    assert ensemble.misleads(replace(flown(), realised=realised(0.3, 0.01, 0.02)))
    nothing = replace(realised(0.3, 0.01, 0.02), found=Errors(np.zeros((0, 1)), np.zeros((0, 1)), ("no trim",)))
    assert not ensemble.misleads(replace(flown(), realised=nothing))


def test_a_measured_bias_takes_the_place_of_a_promised_one():
    ensemble = Ensemble(Range(member(0.5)), flights=N)
    promised = replace(flown(), design=Design(1.0, off=np.array([0.2])))
    assert ensemble.measured_bias(replace(promised, realised=realised(0.5, 0.01, 0.1)))[0] == pytest.approx(
        0.5, rel=0.02
    )
    assert ensemble.measured_bias(replace(promised, realised=realised(0.0, 0.3, 0.1)))[0] == 0.2  # it was chance
