"""Promised, realised in simulation and flown, target by target: is the promise kept, why not, and how many more runs?

The error of n runs falls with the root of n, but for a mean error m that the simulated flights of the design show: that
stays. The flown error is

    sqrt((s c k)^2 + m^2),

with s stated by the estimator, c the scatter of the runs and k what the scatter of simulated errors exceeds the stated
ones; m, c - 1 and k - 1 are zero where they may be chance. It keeps the promise below the value that it has with the
stated error that simulated flights pass with a probability of one in a hundred. Where no flights of a design were
simulated, m is what the estimator makes of the expected response of the card, k = 1, and s may be a quarter larger than
promised; s holds what the form of a linear model and sound instruments may hide. A target is reached where its error is
what was wanted, as a share of the estimate, else what was promised, and the estimate is to be believed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from scipy.stats import t

from testbench.core.constants import PERCENT
from testbench.core.door import read_text
from testbench.core.escape import table_lines
from testbench.core.files import write_file
from testbench.core.record import FlightRecord
from testbench.design.realise import CHANCE, Realised
from testbench.estimators.parametric.model import ParametricModel
from testbench.page.labels import number
from testbench.page.words import listed
from testbench.questions.design.answer import is_ratio
from testbench.questions.identify.derivatives import by_input
from testbench.questions.plan.close import Closed, FlownRun, command_of
from testbench.questions.plan.flown_card import Estimate, FlownCard
from testbench.questions.plan.result import Card, Plan

Verdict = Literal["reached", "not reached", "found", "not identifiable", "not flown"]
"""Found: known, and nothing was promised or wanted of it."""
SLACK = 1.25  # judged: a promise by information alone is kept within a quarter
MOST = 50  # judged: more runs than this are no plan
_WEAK = 0.95  # of the card's amplitude, below which that is named
_SLOWER = 0.9  # of the rate of the sensors, below which that of the log is named
_NOISIER = 1.5  # residuals over the noise of the sensor, from which something else is in them
_CLIPPED = 0.03  # of the samples of a run, at which a control stays at its extreme where the card goes beyond


@dataclass(frozen=True)
class Target:
    """One target of one card."""

    name: str  # "M_q", "wn of short period"
    believed: float  # value of the believed aircraft at the condition of the card
    here: float  # the same at the recorded speed and height
    wanted: float  # standard error that was asked for; NaN if none was
    promised: float  # standard error of ``runs`` runs by information; NaN if there is no promise
    # (rms, low, high) of ``runs`` runs by simulation, with the 95 % interval of one run's; None if it was not computed
    realised: tuple[float, float, float] | None
    runs: int  # that are counted: those flown, else those planned
    estimate: Estimate | None  # flown; None if not
    error: float  # its standard error, with scatter and what simulation adds; NaN without one
    allowed: float  # the largest error that keeps the promise; NaN if there is none
    differs: float  # (estimate - here) in standard errors; NaN if not known
    verdict: Verdict  # see :data:`Verdict`
    causes: tuple[str, ...]  # what makes the error larger than promised, the likeliest first, in sentences
    # runs that are still to be flown for the wanted error, or else the promise; None if no number reaches it
    more: int | None
    beyond: float = 1.0
    lasting: float = 0.0

    @property
    def goal(self) -> float:
        """The error that is wanted, else the promised one, else NaN."""
        return self.wanted if math.isfinite(self.wanted) else self.allowed

    @property
    def lack(self) -> float:
        """The error over the goal; infinite for what is not known at all, 0 where there is no goal."""
        if self.verdict in ("not flown", "not identifiable"):
            return math.inf
        return self.error / self.goal if math.isfinite(self.goal) else 0.0


@dataclass(frozen=True, eq=False)
class JudgedCard:
    """A card with the verdicts on its targets."""

    flown: FlownCard  # the card and what its runs said
    targets: tuple[Target, ...]  # of the promise; without one all derivatives that were found
    missing: int  # runs of the plan that are still to be flown
    go: str  # "" if it may be flown next, else why not, in words

    @property
    def card(self) -> Card:
        """The card."""
        return self.flown.card

    @property
    def more(self) -> int:
        """Runs to fly: those that the plan misses, or as many as the targets need that a number of runs can reach."""
        return max([self.missing, *(t.more for t in self.targets if t.more is not None)])

    @property
    def lack(self) -> float:
        """The largest lack of its targets; infinite if none is known."""
        if not self.flown.runs or not self.targets:
            judges = self.card.spec.use == "validation"
            return math.inf if self.missing or (self.flown.runs and not judges) else 0.0
        return max(t.lack for t in self.targets)


@dataclass(frozen=True, eq=False)
class Campaign:
    """A plan after its flights: what was found in the logs, and every card judged."""

    closed: Closed
    cards: tuple[JudgedCard, ...]

    @property
    def plan(self) -> Plan:
        """The plan."""
        return self.closed.plan

    @property
    def following(self) -> JudgedCard | None:
        """The card to fly next: of those that may be flown the one with the largest lack; None if none is to fly."""
        open_ = [c for c in self.cards if c.more and not c.go]
        return max(open_, key=lambda c: (c.missing > 0, c.lack, -c.card.number), default=None)


def judge(closed: Closed, flown: Sequence[FlownCard]) -> Campaign:
    """Return every card with its verdicts, and which is next."""
    cards = []
    for f in flown:
        missing = closed.missing(f.card)
        cards.append(JudgedCard(f, tuple(_targets(closed, f)), missing, no_go(closed, f.card)))
    return Campaign(closed, tuple(cards))


def no_go(closed: Closed, card: Card) -> str:
    """Return why a card must not be flown next, in words; "" if it may.

    What no aircraft explains, such as a reversed servo, is looked for first. A build-up goes from slow to fast: every
    card of the slower points at the same height comes first, and a limit that was met there, or a response that left
    its band, is looked at on the ground.
    """
    if card.status == "refused":
        return f"it is refused: {card.met[0]}"
    odd = next((f"{text} (card {r.card.number})" for r in closed.runs for text in r.anomalies), "")
    if odd:
        return odd
    slower = [c for c in closed.plan.cards if c.point.h_m == card.point.h_m and c.point.V_m_s < card.point.V_m_s]
    lacking = [str(c.number) for c in slower if closed.missing(c)]
    if lacking:
        one = not lacking[1:]
        return f"{'card' if one else 'cards'} {listed(lacking)} at a lower speed {'comes' if one else 'come'} first"
    for c in slower:
        strange = [r for r in closed.of(c) if r.unexpected]
        if len(strange) > len(closed.good(c)):
            return f"card {c.number} met a limit or left its band in most runs: evaluate this on the ground"
    return ""


def _targets(closed: Closed, f: FlownCard) -> Iterator[Target]:
    promise, n = f.promise, len(f.runs)
    if promise is None:
        for name, found in f.estimates.items():
            yield _unpromised(name, found, n)
        return
    causes = tuple(causes_of(closed, f)) if f.runs else ()
    for k, name in enumerate(promise.names):
        yield _target(f, k, name, f.estimates.get(name), causes)


def _unpromised(name: str, found: Estimate, runs: int) -> Target:
    """Return a derivative of which nothing is known before: found if the data decide it."""
    known = found.believed in ("determined", "in doubt")
    verdict: Verdict = "found" if known else "not identifiable"
    why, none = () if known else (_undecided(found),), math.nan
    return Target(name, none, none, none, none, None, runs, found, found.error, none, none, verdict, why, 0)


def _target(f: FlownCard, k: int, name: str, found: Estimate | None, causes: tuple[str, ...]) -> Target:
    promise, card = f.promise, f.card
    assert promise is not None
    runs = len(f.runs) or max(card.repeats, 1)
    believed, one = float(promise.values[k]), float(promise.promised[k])
    here = believed * f.here.get(name, 1.0)
    promised = one / math.sqrt(runs)
    realised = None if promise.realised is None else _realised_of(promise.realised, k, runs)
    factor = 1.0 if promise.realised is None else promise.realised.found.excess(k)
    lasting = abs(f.bends.get(name, 0.0)) if promise.realised is None else promise.realised.found.lasting(k)
    allowed = math.hypot(SLACK * promised, lasting)
    if promise.realised is not None:
        allowed = max(SLACK * promised, math.hypot(factor * _limit(promise.realised, k) / math.sqrt(runs), lasting))
    wanted = float(promise.wanted[k])
    if found is not None and is_ratio(name) and believed:  # what is wanted is a share of what is found
        wanted *= abs(found.value / believed)
    base = (name, believed, here, wanted, promised, realised, runs)
    if not f.runs:
        return Target(*base, None, math.nan, allowed, math.nan, "not flown", (), None)
    if found is None or found.believed not in ("determined", "in doubt"):
        why = (f.reason or f"the structure that the log allows has no {name}") if found is None else _undecided(found)
        error = math.nan if found is None else math.hypot(found.error * factor, lasting)
        return Target(*base, found, error, allowed, math.nan, "not identifiable", (why, *causes), None)
    error = math.hypot(found.error * factor, lasting)
    spread = math.hypot(error, _speed_doubt(f, here))
    differs = (found.value - here) / spread if spread > 0.0 else math.nan
    if not f.asked:
        return Target(*base, found, error, math.nan, differs, "found", tuple(_distrust(f)), 0, factor, lasting)
    goal = wanted if math.isfinite(wanted) else allowed
    reached = error <= goal and _believed(f, k, found, promised)
    told = causes if not reached else ()
    if found.scatter > 1.0 and not reached:
        told = (f"the runs differ by {found.scatter:.2g} times their errors: air, trim or speed differed", *told)
    more = 0 if reached and not math.isfinite(wanted) else more_runs(error, goal, runs, lasting)
    verdict: Verdict = "reached" if reached else "not reached"
    return Target(*base, found, error, allowed, differs, verdict, told, more, factor, lasting)


def _believed(f: FlownCard, k: int, found: Estimate, promised: float) -> bool:
    """Return whether an estimate stands with its error.

    What the estimator doubts is counted where simulated flights of the design have it too: nothing that goes with the
    inputs, and errors stated as those flights state them.
    """
    if found.believed == "determined":
        return True
    realised = None if f.promise is None else f.promise.realised
    if realised is None or f.case is None or by_input(cast("ParametricModel", f.case.model)):
        return False
    return found.stated <= max(SLACK * promised, _limit(realised, k) / math.sqrt(len(f.runs)))


def _distrust(f: FlownCard) -> Iterator[str]:
    """Yield why the estimator says of its model that it must not be used."""
    if f.case is not None:
        yield from (str(a) for a in f.case.model.advice if getattr(a, "severity", "doubt") == "wrong")


def _undecided(found: Estimate) -> str:
    return {"weak": "its error is more than half of its value"}.get(found.believed, f"it is {found.believed}")


def _realised_of(realised: Realised, k: int, runs: int) -> tuple[float, float, float] | None:
    """Return the realised error of several runs, and the 95 % interval of one run's shrunk alike."""
    rms = float(realised.found.rms[k])
    if not math.isfinite(rms) or rms == 0.0:
        return None
    share = _after(rms, realised.found.lasting(k), runs) / rms
    low, high = realised.found.interval()
    return rms * share, float(low[k]) * share, float(high[k]) * share


def _after(one: float, lasting: float, runs: int) -> float:
    """Return the error of several runs from that of one, of which a part lasts."""
    return math.sqrt(lasting**2 + max(one**2 - lasting**2, 0.0) / runs)


def _limit(realised: Realised | None, k: int) -> float:
    """Return the stated error of one run that simulated ones pass with the probability :data:`CHANCE`; 0 if unknown."""
    if realised is None or realised.found.n < 3:
        return 0.0
    s = np.log(realised.found.stated[:, k])
    n = len(s)
    if not np.all(np.isfinite(s)):
        return 0.0
    return float(np.exp(s.mean() + t.ppf(1.0 - CHANCE, n - 1) * s.std(ddof=1) * math.sqrt(1.0 + 1.0 / n)))


def more_runs(error: float, goal: float, runs: int, lasting: float) -> int | None:
    """Return how many more runs reach a goal; None if no number does, or more than :data:`MOST`."""
    if error <= goal * (1.0 + 1e-9):
        return 0
    room = goal**2 - lasting**2
    if not room > 0.0:
        return None
    falls = max(error**2 - lasting**2, goal**2 - lasting**2) * runs
    needed = math.ceil(falls / room - 1e-9) - runs
    return needed if needed <= MOST else None


def _speed_doubt(f: FlownCard, here: float) -> float:
    """Return what the offset of the airspeed sensor makes of a value: 2 dV / V of it, as of a moment by an angle."""
    case = f.case
    if f.V_m_s is None or case is None:
        return 0.0
    return 2.0 * abs(here) * f.V_offset_m_s / f.V_m_s


def causes_of(closed: Closed, f: FlownCard) -> Iterator[str]:
    """Yield what may have made the errors of a card larger than promised, in sentences."""
    case, plan = f.case, closed.plan
    if f.recipe is not None and f.recipe.missing:
        yield f"not logged: {listed(f.recipe.missing)}, which the design identifies from"
    gain = float(np.mean([r.gain for r in f.runs]))
    if gain < _WEAK:
        yield f"the amplitude was {gain / PERCENT:.0f} % of the card's: errors are {1.0 / gain:.2g} times as large"
    for control in f.card.spec.controls:
        if any(_clipped(r, control) for r in f.runs):
            yield f"{control} stayed at an extreme where the card goes beyond it: saturated"
    if case is None:
        return
    assert isinstance(case.model, ParametricModel)
    yield from _slower(plan, f)
    yield from _noisier(plan, f, case.identification, case.model)
    for advice in case.model.advice:
        if getattr(advice, "severity", "doubt") != "note":
            yield str(advice)


def _clipped(run: FlownRun, control: str) -> bool:
    """Return whether the recorded command rests at its extreme while the card's still moves beyond."""
    name = command_of(run.record, control)
    if name is None:
        return False
    from_start = run.record.t_s >= run.start_s - 1e-9
    x = run.record[name][from_start]
    u = run.card.signal.at(np.arange(x.size) * run.record.dt_s, [control])[:, 0]
    for side in (1.0, -1.0):
        top = float((side * x).max())
        span = float(np.ptp(x))
        resting = side * x > top - 1e-3 * span
        wanted = side * u[resting]
        if resting.sum() > _CLIPPED * x.size and np.ptp(wanted) > 0.1 * float(np.ptp(u)):
            return True
    return False


def _slower(plan: Plan, f: FlownCard) -> Iterator[str]:
    """Yield outputs that were logged at a lower rate than the sensors of the plan give."""
    rates = {s.channel: s.rate_hz or plan.suite.rate_hz for s in plan.suite.sensors}
    assert f.case is not None
    for name in f.case.model.outputs:
        shares = [float(r.record.valid[:, r.record.channels.index(name)].mean()) for r in f.runs if name in r.record]
        if name in rates and shares:
            rate = float(np.mean(shares)) / f.runs[0].record.dt_s
            if rate < _SLOWER * rates[name]:
                larger = math.sqrt(rates[name] / rate)
                yield (
                    f"{name} was logged at {rate:.3g} Hz instead of {rates[name]:g}: as much as {larger:.2g} times the "
                    "error"
                )


def _noisier(plan: Plan, f: FlownCard, records: Sequence[FlightRecord], model: ParametricModel) -> Iterator[str]:
    """Yield the output whose residuals exceed the noise of its sensor most: air, or what the model lacks."""
    noise: Mapping[str, float] = {
        s.channel: math.hypot(s.noise_std, s.quantum / math.sqrt(12.0)) for s in plan.suite.sensors
    }
    left = np.asarray(model.diagnostics.get("residual_std", ()))
    ratios = {n: float(r) / noise[n] for n, r in zip(model.outputs, left, strict=False) if noise.get(n)}
    if not ratios:
        return
    name = max(ratios, key=lambda n: ratios[n])
    if ratios[name] > _NOISIER:
        yield (
            f"residuals of {name} are {number(ratios[name], 2)} times the noise of its sensor: wind and turbulence, "
            "noise that its file does not state, or missing terms of the model"
        )


# --- errors that simulated flights of a design show, in the description of its flown runs -----------------------------


def keep_errors(campaign: Campaign) -> None:
    """Write the errors of every card that exceed those of its estimator behind the description of its runs."""
    for card in campaign.cards:
        errors = _beyond(card)
        if errors and card.flown.file is not None:
            table = {"simulated_errors": {"source": _source(card), "flights": _flights(card), "errors": errors}}
            text = read_text(card.flown.file, "scenario")
            write_file(card.flown.file, "\n".join([text.rstrip("\n"), "", *table_lines(table), ""]))


def _beyond(card: JudgedCard) -> dict[str, float]:
    """Return derivative -> error of the runs: where flights of its design were simulated, else where it is larger."""
    derivatives = {} if card.flown.found is None else {d.name: d for d in card.flown.found.derivatives}
    return {
        t.name: t.error
        for t in card.targets
        if t.name in derivatives
        and math.isfinite(t.error)
        and (_flights(card) or t.error > derivatives[t.name].stated * (1.0 + 1e-9))
    }


def _flights(card: JudgedCard) -> int:
    promise = card.flown.promise
    return 0 if promise is None or promise.realised is None else promise.realised.found.n


def _source(card: JudgedCard) -> str:
    if not (n := _flights(card)):
        return "the estimator's own answer to the expected response, and the scatter of the runs"
    return f"{n} simulated flights of the design, and the scatter of the runs"
