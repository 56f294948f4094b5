"""The amplitude of an input: one criterion over an ensemble, and one search for what is least.

What an input is worth is its criterion, the mean square errors of the targets in wanted ones: noise, turbulence, and
what the estimates are off by without either. What it costs are limits. The ensemble has parts, and each asks for an
amplitude of its own:

    believed    the believed aircraft in still air: the largest that keeps the limits,
    draws       the drawn aircraft, of a robust design: the largest with which all of them keep the limits,
    bias        standard errors fall with the amplitude and what bends grows with it: where both weigh least together,
    stability   in still air, aircraft of less and more static stability keep the limits, too,
    air         in turbulence, the next flight meets a limit with a small probability.

In air that moves, every flight's extreme uses a share of each limit. With their mean m and standard deviation s over n
flights, the next flight meets m + k s, k = t(n - 1, 1 - P) sqrt(1 + 1/n), with probability P if extremes are normal.
An amplitude is searched for one part after the other; from one round of flights to the next the response is taken as
proportional to it, and the turbulence's part of an extreme as the same. What each part asked for is kept as the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t as student

from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.design.candidates import sampled
from testbench.design.ensemble import Draws, HeldFlight, Member, OverDraws, lost, told
from testbench.design.limits import Tightest
from testbench.design.problem import Design, Problem, Screened, best_share, rescaled, total_errors
from testbench.design.realise import Range, Realised
from testbench.design.refine import minimum_time
from testbench.flight.air import Air

BELIEVED, DRAWS, BIAS, STABILITY, AIR = "believed", "draws", "bias", "stability", "air"
CLEARLY = 0.7
"""Share of a realised criterion below which another is better beyond the chance of 20 flights."""
REALISED = 3
"""Designs that may be recommended: they have a margin for the air, and are realised if need be."""
_ROUNDS = 5  # of flights with one part of the ensemble, at most
_LESS = 0.99  # of the amplitude at which a limit would just be met
_FULL = 0.97  # share of a limit from which it counts as used up
_MOST = 1.5  # factor by which the amplitude may grow over what the linearised aircraft allows
_LEAST = 0.25  # of the amplitude: where less would be needed, the air itself meets the limit
_LOWER = 0.9  # share of the amplitude from which lowering it is worth a flight
_HALF = 0.5  # of the amplitude, and no less, before a bias is measured again
_AGAIN = 3  # times that a bias is measured again
_MOST_BIAS = 0.5  # of the mean square error: a bias of which a smaller amplitude may take away enough to count


class Bound(NamedTuple):
    """What a part of the ensemble asks of an amplitude: a reason."""

    share: float  #: the amplitude over the one before
    limit: str = ""  #: that binds; "" where the flight ends, or for the bias
    reach: float = 0.0  #: the share of it that is used: the largest, or that met with the probability asked for
    #: mean, deviation: of the share that a flight's extreme uses
    mean: float = 0.0
    deviation: float = 0.0
    met: int = 0  #: flights that met some limit
    flights: int = 0  #: of all


@dataclass(frozen=True, eq=False)
class Part:
    """Members of an ensemble that keep the limits at an amplitude that is chosen for all of them."""

    name: str  #: of the part
    members: tuple[Member, ...]  #: aircraft; each flies through each of the airs
    airs: tuple[Air | None, ...] = (None,)  #: None is still
    #: k, how far the extremes of flights scatter towards the limits; None: no flight may meet one
    deviations: float | None = None
    least: float = 0.0  #: factor on the amplitude below which it is not lowered

    def bound(self, flights: Sequence[HeldFlight], factor: float, still: FloatArray | float) -> tuple[Bound, float]:
        """Return what flights at ``factor`` say, and the factor on it at which a limit would just be met.

        Args:
            flights: of the part.
            factor: on the amplitude before.
            still: (limits,) share of each limit that the same input uses of itself; counts where extremes scatter.
        """
        shares = np.array([f.shares for f in flights])
        mean, worst = shares.mean(axis=0), max((f.tightest for f in flights), key=lambda t: t.share)
        if self.deviations is None:
            reach, deviation = shares.max(axis=0), np.zeros(mean.size)
            still, limit = reach, worst.name
        else:
            deviation = shares.std(axis=0, ddof=1)
            reach = mean + self.deviations * deviation
            limit = self.members[0].problem.envelope.names[int(np.argmax(reach))]
        k = int(np.argmax(reach))
        met = int(np.count_nonzero([bool(f.breach) for f in flights]))
        found = Bound(factor, limit, float(reach[k]), float(mean[k]), float(deviation[k]), met, len(flights))
        return found, float(np.min((1.0 - (reach - still)) / np.maximum(still, 1e-9)))

    def kept(self, bound: Bound) -> bool:
        """Return whether the limits are kept: by every flight, or by the next one as probably as asked for."""
        return bound.reach <= 1.0 and (bound.met == 0 or self.deviations is not None)


@dataclass(frozen=True, eq=False)
class Flown:
    """A design at the amplitude that was found for it, and why."""

    design: Design  #: at that amplitude
    predicted: Design  #: the design at the amplitude that the linearised aircraft allows
    record: FlightRecord  #: of its flight with the believed aircraft in still air
    tightest: Tightest  #: the limit that it uses up most there
    breach: str  #: what broke at the predicted amplitude, with its moment; "" if nothing did
    admissible: bool  #: whether some amplitude kept all limits with the believed aircraft
    bounds: Mapping[str, Bound] = field(default_factory=dict)  #: part of the ensemble -> what it asked for
    over: OverDraws | None = None  #: what it is over the drawn aircraft; None if none are asked for
    realised: Realised | None = None  #: over flights that were identified; None if there were none

    @property
    def errors(self) -> FloatArray:
        """(t,) the errors to plan with: realised where they contradict the promised ones."""
        return self.design.errors if self.realised is None else self.realised.headline

    @property
    def factor(self) -> float:
        """Amplitude over the predicted one."""
        return self.share(*self.bounds)

    def share(self, *parts: str) -> float:
        """Return the amplitude over the one before some parts of the ensemble were asked."""
        return float(np.prod([self.bounds[name].share for name in parts if name in self.bounds]))

    def at(self, design: Design, part: str, bound: Bound) -> Flown:
        """Return the same input at another amplitude, and what asked for it."""
        before = self.share(part)
        kept = {**self.bounds, part: bound._replace(share=before * bound.share)}
        same = design is self.design
        return replace(
            self, design=design, bounds=kept, over=self.over if same else None, realised=self.realised if same else None
        )


Ask = tuple[Design, Part | None]
"""What a search asks for: flights of a design with a part of the ensemble; with None, what its estimates are off by."""
Search = Generator[Ask, Any, Flown]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Draws, air and bias: what the amplitude of an input is chosen for."""

    range_: Range  #: the believed aircraft, the air that is expected, sensors and estimator
    draws: Draws | None = None  #: the drawn aircraft; None if none are asked for
    others: tuple[Member, ...] = ()  #: aircraft of less and more static stability; they count in still air
    robust: bool = False  #: whether input and amplitude are chosen for the worst draw
    flights: int = 0  #: of one design in air that moves, and to realise it; 0: neither, and no bias
    probability: float = 0.05  #: with which the next flight may meet a limit in air that moves
    most: float = _MOST  #: factor by which an amplitude may grow beyond that of a design

    @property
    def problem(self) -> Problem:
        """The design problem of the believed aircraft."""
        return self.range_.member.problem

    @cached_property
    def parts(self) -> Mapping[str, Part]:
        """The parts that ask for limits."""
        n, believed = self.flights, (self.range_.member,)
        out = {BELIEVED: Part(BELIEVED, believed)}
        if self.robust and self.draws is not None and self.draws.judged:
            out[DRAWS] = Part(DRAWS, self.draws.judged)
        if n and self.range_.moves:
            k = float(student.ppf(1.0 - self.probability, n - 1) * np.sqrt(1.0 + 1.0 / n))
            out[AIR] = Part(AIR, believed, self.range_.airs(0, n), k, _LEAST)
        elif n and self.others:
            out[STABILITY] = Part(STABILITY, self.others, least=_LEAST)
        return out

    # --- the search -----------------------------------------------------------------------------------------------

    def started(self, designs: Sequence[Design]) -> list[Flown]:
        """Return designs at the largest amplitude that keeps the limits with the believed aircraft.

        Raises:
            TestbenchError: of the first that the believed aircraft cannot fly at all.
        """
        return self._together([self._start(design) for design in designs])

    def chosen(self, flown: Sequence[Flown], *parts: str) -> list[Flown]:
        """Return designs at the amplitudes that further parts of the ensemble ask for, those that it has."""
        return self._together([self._choice(one, parts) for one in flown])

    def _together(self, searches: Sequence[Search]) -> list[Flown]:
        """Run searches side by side: what all of them ask for in a round is flown at once."""
        out: dict[int, Flown] = {}
        answers: dict[int, Any] = dict.fromkeys(range(len(searches)))
        while answers:
            wanted: dict[int, Ask] = {}
            for i, answer in answers.items():
                try:
                    wanted[i] = searches[i].send(answer)
                except StopIteration as found:
                    out[i] = found.value
            flights = iter(self._flights([ask for ask in wanted.values() if ask[1] is not None]))
            sensed = [design for design, part in wanted.values() if part is None]
            designs = iter(self.range_.off(sensed) if sensed else ())
            answers = {i: next(designs if part is None else flights) for i, (_, part) in wanted.items()}
        return [out[i] for i in range(len(searches))]

    def _flights(self, asked: Sequence[Ask]) -> list[list[HeldFlight]]:
        """Return the flights of designs with their parts of the ensemble; records only of the believed aircraft."""
        jobs = [[(m, d, air) for m in part.members for air in part.airs] for d, part in asked if part is not None]
        found = iter(self.range_.flier.held([job for own in jobs for job in own]))
        out = []
        for (_, part), own in zip(asked, jobs, strict=True):
            flights = []
            for (member, *_), flight in zip(own, found, strict=False):
                if isinstance(flight, Refusal):
                    if part is self.parts[BELIEVED]:
                        raise flight
                    flight = lost(len(member.problem.envelope.names), flight.message)
                flights.append(flight if part is self.parts[BELIEVED] else flight._replace(record=None))
            out.append(flights)
        return out

    def _start(self, design: Design) -> Search:
        """Search for the amplitude of a design with the believed aircraft: it may grow beyond the linear prediction."""
        part, top = self.parts[BELIEVED], min(self.most, _room(self.range_.member, design))
        kept, now, (flight,), bound, said = yield from self._largest(design, part, top)
        assert flight.record is not None
        now = replace(now, limit=bound.limit or now.limit)
        return Flown(now, design, flight.record, flight.tightest, said, kept, {BELIEVED: bound})

    def _choice(self, flown: Flown, parts: Sequence[str], stale: bool = False) -> Search:
        """Search for the amplitudes that parts of the ensemble ask for, one after the other.

        The record is flown anew where the amplitude is another, or where it was before: ``stale``.
        """
        if stale:
            flown = yield from self._flown_again(flown)
        sensed, before = flown.design.off is not None or BIAS in parts, flown.share(*parts)
        still = self.problem.envelope.shares(flown.record)
        for name in parts:
            if name == BIAS:
                flown = yield from self._weighed(flown)
            elif part := self.parts.get(name):
                own = still * flown.share(*parts) / before
                _, design, flights, bound, _ = yield from self._largest(flown.design, part, 1.0, own)
                if design is not flown.design:
                    design = replace(design, limit=bound.limit or design.limit)
                flown = flown.at(design, name, bound)
                if name == DRAWS:
                    flown = replace(flown, over=self._over(design, flights))
        if flown.share(*parts) == before:
            return flown
        if sensed and flown.design.off is None:
            flown = replace(flown, design=(yield flown.design, None))
        return (yield from self._flown_again(flown))

    def _flown_again(self, flown: Flown) -> Search:
        (flight,) = yield flown.design, self.parts[BELIEVED]
        return replace(flown, record=flight.record, tightest=flight.tightest)

    def _largest(
        self, design: Design, part: Part, top: float, still: FloatArray | float = 0.0
    ) -> Generator[Ask, list[HeldFlight], tuple[bool, Design, list[HeldFlight], Bound, str]]:
        """Search for the largest amplitude at which a part of the ensemble keeps the limits.

        Args:
            design: at the amplitude that the search starts from, if that is not beyond ``top``.
            part: of the ensemble.
            top: largest factor on its amplitude.
            still: (limits,) share of each limit that it uses of itself.

        Returns:
            whether some amplitude keeps the limits, the largest that does, or else the smallest that was tried, with
            its flights and what they ask for, and what broke at first; "" if nothing did.
        """
        factor, low, high, tried = min(1.0, top), 0.0, np.inf, list[tuple[Design, list[HeldFlight], Bound]]()
        for _ in range(_ROUNDS):
            now = design if factor == 1.0 else rescaled(self.problem, design, factor)
            flights = yield now, part
            bound, room = part.bound(flights, factor, factor * still)
            tried.append((now, flights, bound))
            kept = part.kept(bound)
            low, high = (max(low, factor), high) if kept else (low, min(high, factor))
            full = bound.reach >= _FULL or factor >= _FULL * min(high, top)
            if (kept and full) or (not kept and factor <= part.least):
                break
            wanted = factor * _LESS * room
            if not low < wanted < high and room > 0.0:
                wanted = 0.5 * (low + high) if low > 0.0 else 0.9 * high
            factor = float(np.clip(wanted, part.least, top))
        good = [t for t in tried if part.kept(t[2])]
        best = max(good, key=lambda t: t[2].share) if good else min(tried, key=lambda t: t[2].share)
        return bool(good), *best, tried[0][1][0].breach

    def _weighed(self, flown: Flown) -> Search:
        """Search for the amplitude at which what the estimates are off by and the noise weigh least together."""
        flown = replace(flown, design=(yield flown.design, None))
        for _ in range(2):
            design = flown.design
            less = 1.0 if design.off is None else best_share(self.problem, design, design.off)
            if less >= _LOWER:
                break
            again = yield rescaled(self.problem, design, less), None
            if again.off is None or again.cost >= design.cost:
                break
            flown = flown.at(again, BIAS, Bound(less))
        return flown

    def ranked(self, flown: Sequence[Flown], say: Callable[[str], None]) -> list[Flown]:
        """Return designs at the amplitudes that all parts of the ensemble ask for, the best promise first.

        A robust order is by the worst draw, whose errors grow alike. Air takes many flights: those are flown in it that
        may be recommended.
        """

        def ordered(some: Sequence[Flown]) -> list[Flown]:
            return list(some) if self.robust else sorted(some, key=lambda f: f.design.cost)

        out = self.chosen(flown, DRAWS)
        if self.robust:
            out.sort(key=lambda f: f.over.rank if f.over else (np.inf, 0.0))
        if not self.flights:
            return out
        say("fly them in the expected air")
        out = ordered(self.chosen(out, BIAS))
        return [*ordered(self.chosen(out[:REALISED], AIR, STABILITY)), *out[REALISED:]]

    def shortest(self, ranked: Sequence[Screened], best: Flown, say: Callable[[str], None]) -> Flown | None:
        """Return the shortest input that reaches the wanted accuracy in flight, with its margin for the air, or None.

        Its first aim allows for the amplitude that the best design lost in flight; if that was not enough, it aims
        again.
        """
        say("find the shortest input that reaches the wanted accuracy")
        aim = min(1.0, best.factor)
        for _ in range(2):
            design = minimum_time(self.problem, ranked, aim)
            (out,) = self.started([design]) if design is not None else (None,)
            if out is None or not out.admissible:
                return None
            if self.flights:
                (out,) = self.chosen([out], BIAS, AIR, STABILITY)
            if out.design.cost <= 1.0:
                return out
            aim *= 0.97 / out.design.cost
        return None

    # --- over the draws, and realised -----------------------------------------------------------------------------

    def _over(self, design: Design, flights: Sequence[HeldFlight] = ()) -> OverDraws:
        assert self.draws is not None
        return OverDraws(told(design, self.draws.judged, self.problem.targets.names), tuple(flights))

    def over(self, flown: Sequence[Flown]) -> list[Flown]:
        """Return designs with what they are over the draws; the first, and all of a robust order, with flights."""
        if self.draws is None or not self.draws.judged:
            return list(flown)
        part = Part(DRAWS, self.draws.judged)
        at = [k for k, f in enumerate(flown) if f.over is None and (k == 0 or self.robust)]
        flights = dict(zip(at, self._flights([(flown[k].design, part) for k in at]), strict=True))
        return [replace(f, over=f.over or self._over(f.design, flights.get(k, ()))) for k, f in enumerate(flown)]

    def realised(self, flown: Sequence[Flown], say: Callable[[str], None]) -> list[Flown]:
        """Return the designs, the best by realised errors first, the others behind in their order.

        Designs are realised in the order of their promises, until no promise of a further one is clearly better than
        what has been realised, or a few have been. Where most of the best one's error is a mean error that was not
        promised, its amplitude is chosen again. A robust order and its amplitudes stay.
        """
        out, best = list(flown), 0
        for k, one in enumerate(out[:REALISED]):
            if k and (self.robust or one.design.cost > CLEARLY * self._cost(out[best])):
                break
            say(f"realise the {one.design.family}: fly and identify it {self.flights} times")
            out[k] = replace(one, realised=self.range_.realised(one.design, self.flights, say))
            if self._cost(out[k]) < CLEARLY * self._cost(out[best]):
                best = k
        first = out.pop(best)
        if not self.robust:
            first = self._again(first, say)
        assert first.realised is not None
        certain = self.range_.certain(first.design, self.flights, first.realised, say)
        return [replace(first, realised=certain), *out]

    def _cost(self, flown: Flown) -> float:
        """Return the largest error to plan with over the wanted one, earlier flights counted."""
        return float(np.max(total_errors(self.problem, flown.design, flown.errors) / self.problem.targets.wanted))

    def _again(self, flown: Flown, say: Callable[[str], None]) -> Flown:
        """Return a design at the amplitude that its measured bias asks for, if it is clearly better there.

        The promised bias is that of a bent response to first order. The estimator is not linear: process noise takes a
        part of what bends, and correlated estimates move together.
        """
        problem, n = self.problem, self.flights
        best, share = flown, 1.0
        for _ in range(_AGAIN if self.misleads(best) else 0):
            less = max(_HALF, best_share(problem, best.design, self.measured_bias(best)))
            if less >= _LOWER or not self.misleads(best):
                break
            say(
                f"realise the {best.design.family} at {less:.2g} times its amplitude, with less nonlinearity: {n} times"
            )
            (design,) = self.range_.off([rescaled(problem, best.design, less)])
            found = replace(best.at(design, BIAS, Bound(less)), realised=self.range_.realised(design, n, say))
            if self._cost(found) > CLEARLY * self._cost(best):
                break
            best, share = found, share * less
        if share == 1.0:
            return flown
        (kept,) = self._together([self._choice(best, (AIR,), stale=True)])
        return replace(kept, realised=best.realised)

    def misleads(self, flown: Flown) -> bool:
        """Return whether the worst target misses what is wanted, against the promise, for a mean error above all."""
        realised = flown.realised
        assert realised is not None
        total = total_errors(self.problem, flown.design, realised.headline) / self.problem.targets.wanted
        k = int(np.argmax(total))
        if not (total[k] > 1.0 and realised.differs[k] and realised.found.n):
            return False
        return realised.found.lasting(k) ** 2 > _MOST_BIAS * float(realised.found.rms[k]) ** 2

    def measured_bias(self, flown: Flown) -> FloatArray:
        """Return what the estimates (k,) are off by over flights: the least that makes the targets' mean errors."""
        assert flown.realised is not None
        J, found = self.problem.targets.jacobian, flown.realised.found
        off = np.zeros(J.shape[1]) if flown.design.off is None else flown.design.off
        mean = np.array([found.bias[k] if found.lasting(k) else float(J[k] @ off) for k in range(len(J))])
        return np.asarray(off + np.linalg.pinv(J) @ (mean - J @ off))


def _room(member: Member, design: Design) -> float:
    """Return by how much the amplitude may grow before a deflection, a command or a rate reaches its limit.

    For these the linear prediction is exact, because servos are linear. Commands count as they are flown, too: between
    the samples of the design a multisine or a sweep rises above them.
    """
    problem, prediction, room = member.problem, member.problem.prediction, _MOST
    y = prediction.response(design.u)
    flown = sampled(design.specs, problem.controls, design.duration_s, member.trimmed.rate_hz)
    for k, name in enumerate(prediction.names):
        if name not in prediction.controls and not name.startswith(("rate of", "command of")):
            continue
        moved = [y[:, k]]
        if name.startswith("command of"):  # amplitudes are rounded to 1e-6 deg
            moved.append(flown[:, problem.controls.index(name.removeprefix("command of "))] * (1.0 + 1e-5))
        for x in moved:
            top, bottom = max(float(x.max()), 1e-12), min(float(x.min()), -1e-12)
            room = min(room, prediction.high[k] / top, prediction.low[k] / bottom)
    return float(max(room, 1e-6))
