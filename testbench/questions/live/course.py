"""Which card to fly next: what is known so far, what each card of the plan would add, and what can be left out.

What is known is the posterior of the runs so far (:meth:`InFlight.fit_along`). A derivative may change with the angle
of attack of the trim, so that a card at another speed is told by those beside it only as far as that is believed
(the prior of :mod:`testbench.inference.form`):

    theta(s) = a + b s + c s^2,    s = (alpha - alpha_0) / ALPHA_RAD

b and c scatter by FORM_STD of the derivative about those of the believed aircraft. A run tells the mean of theta over
the angles of attack that it met.

A run of a card adds its Fisher information, by sensitivities at the current estimate. In gusts less than that is
reached: expected information counts by the share that the runs so far have brought of theirs. Each run is off by what a
linear aircraft is beside it: two that are near to one another tell no slope. The next
card is the one that brings the most, per second in the air, towards the errors that are still too large; those after it
are chosen in the same way, until nothing is wanted or the plan as printed would end. No card is faster than the next
speed of the build-up. What cannot be told in flight is flown as printed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from testbench.core.errors import Refusal
from testbench.core.record import FloatArray
from testbench.inference.form import ALPHA_RAD, FORM_STD
from testbench.information.targets import needed_parameters
from testbench.page.words import listed
from testbench.questions.live.belief import LEAST_FORM
from testbench.questions.live.track import Plane
from testbench.questions.plan.repeats import told_by_a_run
from testbench.questions.plan.response import scaled
from testbench.questions.plan.result import Card, Plan, Point

_UNKNOWN = 100.0
"""Relative standard error, over what is wanted, beyond which nothing is known: all such errors are alike."""
_NOTHING = 1e-3  # of the sum of logarithms, a run that brings less brings nothing
_LEAST_SHARE = 0.01  # of the information that was expected
_LOOSE = 1e-6
"""Inverse standard deviation, over the believed value, of a derivative that nothing is known of."""
_SAID = 3  # errors that the next card makes smaller
_AT_ONCE = 3  # cards that are expected in an update
_MOST = 60  # runs that are looked ahead
_NEAR = 0.25  # relative standard error of an estimate that sensitivities are taken at


@dataclass(frozen=True)
class Gain:
    """A relative standard error: now (inf if nothing is known), what the next run makes of it, and what is wanted."""

    name: str
    now: float
    after: float
    wanted: float


@dataclass(frozen=True)
class Outlook:
    """What to fly from now on."""

    card: int  # to fly next; 0 if nothing is left
    gains: tuple[Gain, ...]  # what it brings, of what is still wanted at its point
    spare: tuple[int, ...]  # cards with runs left that nothing is wanted of any more
    order: tuple[int, ...]  # cards of the runs to come, the next one first
    left_s: float  # time in the air that they take, turns included
    printed_s: float  # what the runs of the plan take that have not been flown
    open: tuple[int, ...]  # cards whose wanted errors are not reached in that time

    @property
    def words(self) -> str:
        """What the next card brings, and what can be left out, in words."""
        told = [f"{g.name} {_percent(g.now)} -> {_percent(g.after)}" for g in self.gains[:_SAID]]
        if self.spare:
            told.append(f"{_cards(self.spare)} can be left out")
        if self.open:
            told.append(f"what is wanted of {_cards(self.open)} takes longer than the plan as printed")
        return "; ".join(told)


def _cards(numbers: Sequence[int]) -> str:
    return ("card " if len(numbers) == 1 else "cards ") + listed([str(n) for n in numbers])


def _percent(error: float) -> str:
    return f"{100.0 * error:.2g} %" if error < 1.0 else "unknown"


@dataclass(eq=False)
class _Known:
    """A plane of motion."""

    names: tuple[str, ...]  # (f,) derivatives that are estimated in flight
    estimate: FloatArray  # (3 f,) a, b and c of each over its believed value, without its sign
    information: FloatArray  # (3 f, 3 f) on a, b and c of each over its believed value
    alpha: float  # angle of attack that s is zero at
    # point of the plan -> (f,) what is believed there, over ``size`` and dynamic pressure, and (f,) itself
    at: Mapping[int, tuple[FloatArray, FloatArray]]
    now: Mapping[str, float]  # derivative -> estimate over what is believed, of those that are known
    # (f,) of expected information on each that the runs have brought
    share: FloatArray = field(default_factory=lambda: np.ones(0))
    # (t, 3 f) what is wanted, by a, b and c, over the wanted error of each
    targets: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    wanted: FloatArray = field(default_factory=lambda: np.zeros(0))  # (t,) these errors
    of: tuple[tuple[int, str], ...] = ()  # card and name of each

    def scatter(self, information: FloatArray) -> FloatArray:
        """Return the variances (..., t) of the targets over the wanted ones, of information (..., 3 f, 3 f)."""
        size = np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
        both = size[..., :, None] * size[..., None, :]
        C = np.linalg.inv(information / both + 1e-12 * np.eye(size.shape[-1])) / both
        return np.maximum(np.einsum("tk,...kl,tl->...t", self.targets, C, self.targets), 0.0)

    def errors(self, information: FloatArray) -> FloatArray:
        """Return the same as errors."""
        return np.sqrt(self.scatter(information))

    def of_cards(self, information: FloatArray) -> list[tuple[int, float]]:
        """Return card and error over the wanted one of every target."""
        return [(n, e) for (n, _), e in zip(self.of, self.errors(information).tolist(), strict=True)]

    def lacks(self, information: FloatArray) -> FloatArray:
        """Return the sum (...) of the logarithms of the errors that are larger than wanted."""
        return np.asarray(np.sum(np.log(np.clip(self.errors(information), 1.0, _UNKNOWN)), axis=-1))


class Course:
    """The cards of a plan, and what each would tell.

    Args:
        plan: whose cards are flown.
        wanted: standard error relative to the value of a card that does not say it.
    """

    def __init__(self, plan: Plan, wanted: float) -> None:
        self.plan = plan
        self.cards = {c.number: c for c in plan.cards if c.status != "refused"}
        self.wanted = {number: _wanted(card, wanted) for number, card in self.cards.items()}
        self._told: dict[int, tuple[tuple[str, ...], FloatArray]] = {}
        self._known: dict[str, _Known] = {}
        self._stale = list(self.cards)
        self._done: set[tuple[int, str]] = set()

    def learn(self, plane: Plane) -> None:
        """Take what the runs of a plane tell now, before the first one nothing; its cards are to be expected anew."""
        names, f, before = plane.regression.names, len(plane.regression.names), self._known.get(plane.name)
        if before is not None and before.of and not plane.regression.places:  # another condition: what was known
            met = before.errors(before.information) <= 1.0  # of the one before stays known
            points = [(self.cards[n].point.number, name) for n, name in before.of]
            self._done |= {key for key, ok in zip(points, met.tolist(), strict=True) if ok}
        size = np.array([abs(plane.before.get(n) or 0.0) or 1e-9 for n in names])
        V, mean_s, square = np.array(plane.regression.places).reshape(-1, 3).T
        alphas = np.array([self._alpha(x) for x in V.tolist()])
        alpha = float(alphas.mean()) if alphas.size else self.plan.points[0].trimmed.alpha
        at = {}
        for p in self.plan.points:
            believed, scale = plane.believed_at(p)
            at[p.number] = believed / (size * scale), believed
        form, none = np.full(2 * f, 1.0 / FORM_STD["alpha"]), np.full(f, _LOOSE)
        start = np.diag(np.concatenate([none, form]) ** 2)
        mean = self._along(alpha, at)
        known = _Known(names, mean, start, alpha, at, {}, np.ones(f))
        fit = None
        if alphas.size:
            s = (alphas - alpha) / ALPHA_RAD
            first, second = s + mean_s / ALPHA_RAD, s**2 + (2.0 * s * mean_s + square / ALPHA_RAD) / ALPHA_RAD
            along, unit = np.column_stack([np.ones(s.size), first, second]), np.tile(size, 3)
            fit = plane.regression.fit_along(along, mean * unit, np.concatenate([none, form]) / unit, LEAST_FORM)
        if fit is not None:
            P = fit.corrected / np.outer(unit, unit)
            known.information[:] = np.linalg.inv(0.5 * (P + P.T))
            known.estimate[:] = fit.step / unit
            near = np.sqrt(np.diag(P)[:f]) < _NEAR
            known.now = {n: float(x / m) for n, x, m, ok in
                         zip(names, known.estimate[:f], mean[:f], near, strict=True) if ok and m}  # fmt: skip
        self._known[plane.name] = known
        self._aim(plane.name, known)
        self._stale += [n for n, c in self.cards.items() if c.spec.plane == plane.name and n not in self._stale]

    def _along(self, alpha: float, at: Mapping[int, tuple[FloatArray, FloatArray]]) -> FloatArray:
        """Return a, b and c (3 f,) of the believed aircraft, by its derivatives at the points of the plan."""
        s = np.array([(p.trimmed.alpha - alpha) / ALPHA_RAD for p in self.plan.points])
        order = min(2, np.unique(np.round(s, 3)).size - 1)
        curves = np.polynomial.polynomial.polyfit(s, np.array([at[p.number][0] for p in self.plan.points]), order)
        out: FloatArray = np.pad(curves, ((0, 2 - order), (0, 0))).ravel()
        return out

    def _alpha(self, V_m_s: float) -> float:
        """Return the angle of attack of the trim at a speed, by those of the plan."""
        V, alpha = zip(*sorted((p.V_m_s, p.trimmed.alpha) for p in self.plan.points), strict=True)
        return float(np.interp(V_m_s, V, alpha))

    def _aim(self, plane: str, known: _Known) -> None:
        """Set the targets of a plane: each derivative at each point once, with the smallest error that is wanted."""
        least: dict[tuple[int, str], tuple[float, int]] = {}
        for number, wanted in self.wanted.items():
            card = self.cards[number]
            for name, share in wanted.items() if card.spec.plane == plane else ():
                key = card.point.number, name
                if name in known.names and key not in self._done:
                    least[key] = min(least.get(key, (math.inf, 0)), (share, number))
        rows = [self._row(known, number, name) for (_, name), (_, number) in least.items()]
        known.wanted = np.array([share for share, _ in least.values()])
        known.of = tuple((number, name) for (_, name), (_, number) in least.items())
        known.targets = np.array(rows).reshape(len(rows), 3 * len(known.names)) / known.wanted[:, None]

    def _row(self, known: _Known, number: int, name: str, flown: bool = False) -> FloatArray:
        """Return a derivative over its believed value at the point of a card, (3 f,), by a, b and c of all of them.

        Or what a run of the card tells of it: its mean over the angles of attack that are expected of it.
        """
        point, at = self.cards[number].point, known.names.index(name)
        s = np.array([point.trimmed.alpha - known.alpha]) / ALPHA_RAD
        record = self.cards[number].expected
        if flown and "alpha" in record and self.cards[number].spec.plane == "longitudinal":
            s = (record["alpha"] - known.alpha) / ALPHA_RAD
        here = known.at[point.number][0][at] or np.inf
        return np.kron([1.0, s.mean(), np.mean(s**2)], np.arange(len(known.names)) == at) / here

    def expect(self) -> bool:
        """Expect some more cards at the current estimate; return whether all are. All at once would take too long."""
        for _ in range(min(_AT_ONCE, len(self._stale))):
            number = self._stale.pop(0)
            self._told[number] = self._by_a_run(number)
        return not self._stale

    def _by_a_run(self, number: int) -> tuple[tuple[str, ...], FloatArray]:
        """Return names (k,) and the information (k, k) of a run of a card on derivatives over their believed values."""
        card, plan, known = self.cards[number], self.plan, self._known.get(self.cards[number].spec.plane)
        inputs = scaled(card.spec.input, card.factor)
        given = plan.aircraft, card.point, card.spec, inputs, plan.suite, plan.scenario.held_ms
        for now in ({} if known is None else known.now, {}):  # as believed, if the estimated aircraft diverges
            try:
                told = told_by_a_run(*given, now)
            except Refusal:
                continue
            size = np.abs(told.values) / np.array([abs(now.get(n, 1.0)) for n in told.names])
            return told.names, told.information * np.outer(size, size)
        return (), np.zeros((0, 0))

    def _added(self, known: _Known, number: int) -> FloatArray:
        """Return the information (3 f, 3 f) that a run of a card adds; what is not estimated in flight is unknown."""
        names, M = self._told[number]
        own = [i for i, n in enumerate(names) if n in known.names]
        rest = [i for i, n in enumerate(names) if n not in known.names]
        cross = M[np.ix_(own, rest)]
        M = M[np.ix_(own, own)] - cross @ np.linalg.pinv(M[np.ix_(rest, rest)], hermitian=True) @ cross.T
        rows = [self._row(known, number, names[i], flown=True) for i in own]
        J = np.array(rows).reshape(len(own), 3 * len(known.names))
        brought = np.sqrt([known.share[known.names.index(names[i])] for i in own])
        M *= np.outer(brought, brought)
        out: FloatArray = J.T @ M @ np.linalg.inv(np.eye(len(own)) + LEAST_FORM**2 * M) @ J
        return out

    def _compare(self, known: _Known, flown: Mapping[int, int]) -> None:
        """Find the share of the information that was expected of the runs so far that they have brought."""
        f, shown = len(known.names), {number for number, _ in known.of}
        known.share = np.ones(f)
        own = {n: k for n, k in flown.items() if k and n in shown}
        prior = np.diag(np.concatenate([np.full(f, _LOOSE), np.full(2 * f, 1.0 / FORM_STD["alpha"])]) ** 2)
        expected = prior + sum(k * self._added(known, n) for n, k in own.items())
        ratio = known.scatter(expected) / np.maximum(known.scatter(known.information), 1e-300)
        of = {n: [r for (number, name), r in zip(known.of, ratio.tolist(), strict=True) if name == n and number in own]
              for n in known.names}  # fmt: skip
        told = [r for each in of.values() for r in each]
        usual = float(np.median(told)) if told else 1.0
        known.share = np.clip([float(np.median(of[n])) if of[n] else usual for n in known.names], _LEAST_SHARE, 1.0)

    def claimed(self, point: Point) -> dict[str, tuple[float, float]]:
        """Return derivative -> its estimate at a point of the plan, and the error that is wanted there, SI."""
        out = {}
        for known in self._known.values():
            for (number, name), wanted in zip(known.of, known.wanted.tolist(), strict=True):
                if self.cards[number].point is point:
                    believed = known.at[point.number][1][known.names.index(name)]
                    value = believed * (self._row(known, number, name) @ known.estimate)
                    out[name] = float(value), float(abs(believed) * wanted)
        return out

    def outlook(self, flown: Mapping[int, int]) -> Outlook:
        """Return what to fly next, and until when, after so many good runs of each card.

        Every plane must have been learnt of, and all cards expected.
        """
        seconds = {n: c.length_s + self.plan.scenario.timing.turn_s for n, c in self.cards.items()}
        printed = {n: max(c.repeats - flown.get(n, 0), 0) for n, c in self.cards.items()}
        judged = {
            n
            for n, c in self.cards.items()
            if np.any(self._told[n][1])
            and c.spec.plane in self._known
            and set(self.wanted[n]) & set(self._known[c.spec.plane].names)
        }
        ahead = {name: known.information for name, known in self._known.items() if known.of}
        adds: dict[int, FloatArray] = {}
        for name in ahead:
            known = self._known[name]
            self._compare(known, flown)
            for n in judged:
                if self.cards[n].spec.plane == name:
                    adds[n] = self._added(known, n)
        order: list[int] = []
        count, budget_s = dict(flown), sum(seconds[n] * (c.repeats - flown.get(n, 0)) for n, c in self.cards.items())
        gains: tuple[Gain, ...] = ()
        while len(order) < _MOST:
            spent_s = sum(seconds[n] for n in order)
            may = [n for n in self._allowed(count) if n in adds and spent_s + seconds[n] <= budget_s]
            lacks = {name: float(self._known[name].lacks(M)) for name, M in ahead.items()}
            gain: dict[int, float] = {}
            for name, M in ahead.items():
                of = [n for n in may if self.cards[n].spec.plane == name]
                if of and lacks[name] > 0.0:
                    after = self._known[name].lacks(M + np.array([adds[n] for n in of]))
                    gain |= {n: lacks[name] - float(x) for n, x in zip(of, after, strict=True)}
            best = max(gain, key=lambda n: gain[n] / seconds[n], default=0)
            if not best or gain[best] < _NOTHING:
                best = self._step(may, count) if any(x > 0.0 for x in lacks.values()) else 0
            if not best:
                break
            name = self.cards[best].spec.plane
            more = ahead[name] + adds[best]
            if not order:
                gains = self._gains(self._known[name], best, more)
            ahead[name], count[best] = more, count.get(best, 0) + 1
            order.append(best)
        lost, lacking = (
            {n for name, M in by.items() for n, e in self._known[name].of_cards(M) if e > 1.0}
            for by in (ahead, {name: self._known[name].information for name in ahead})
        )
        spare = tuple(n for n in sorted(judged) if printed[n] and n not in order and n not in lacking)
        order += [n for n in self.cards if n not in judged for _ in range(printed[n])]
        left = sum(seconds[n] for n in order), sum(seconds[n] * k for n, k in printed.items())
        return Outlook(order[0] if order else 0, gains, spare, tuple(order), *left, tuple(sorted(lost)))

    def _fastest(self, flown: Mapping[int, int]) -> float:
        """Return the highest speed of a card that has been flown, m/s; 0 before the first."""
        return max((self.cards[n].point.V_m_s for n, k in flown.items() if k and n in self.cards), default=0.0)

    def _allowed(self, flown: Mapping[int, int]) -> list[int]:
        """Return the cards that may be flown now: none is faster than the next speed of the build-up."""
        speeds = sorted({c.point.V_m_s for c in self.cards.values() if not self.plan.waits(c.point.V_m_s)})
        fastest = self._fastest(flown)
        most = next((V for V in speeds if fastest < V), math.inf)
        return [n for n, c in self.cards.items() if c.point.V_m_s in speeds and c.point.V_m_s <= most]

    def _step(self, may: list[int], flown: Mapping[int, int]) -> int:
        """Return the shortest card of the next speed, if what is still wanted may lie beyond it; 0 if there is none."""
        fastest = self._fastest(flown)
        new = [n for n in may if self.cards[n].point.V_m_s > fastest]
        return min(new, key=lambda n: self.cards[n].length_s, default=0)

    def _gains(self, known: _Known, number: int, after: FloatArray) -> tuple[Gain, ...]:
        """Return what a run brings of what is still wanted at its point."""
        before, later = known.errors(known.information), known.errors(after)
        lacking = [
            (self.cards[n].point, Gain(name, float(a * w), float(b * w), float(w)))
            for (n, name), a, b, w in zip(known.of, before, later, known.wanted, strict=True)
            if a > 1.0
        ]
        here = [g for point, g in lacking if point is self.cards[number].point]
        gains = here or [g for _, g in lacking]
        return tuple(sorted(gains, key=lambda g: g.after / g.now))


def _wanted(card: Card, wanted: float) -> dict[str, float]:
    """Return name -> wanted error of a card; empty if it only judges what others tell."""
    if card.spec.use == "validation":
        return {}
    named = {n: percent / 100.0 for n, percent in card.spec.accuracy_percent.items()}
    return named or dict.fromkeys(needed_parameters(card.spec.plane, card.spec.controls, False, ()), wanted)
