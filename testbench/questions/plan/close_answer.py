"""A plan after its flights in sentences: what was flown and found, what must be repeated, and what comes next."""

from __future__ import annotations

import math
from collections.abc import Iterator

from testbench.core.constants import PERCENT
from testbench.page.labels import number
from testbench.page.words import counted, listed, some
from testbench.questions.design.answer import is_ratio
from testbench.questions.plan.result import Card
from testbench.questions.plan.verdicts import Campaign, JudgedCard, Target

_CHANGED = 3.0  # standard errors from the believed value, from which it is told
_MOST = 4
_ABOVE = 1.1  # times what an estimator states, from which it is told what else an error holds
Sentences = Iterator[tuple[str, str]]


def close_answer(campaign: Campaign) -> Sentences:
    """Yield (kind, sentence): what was found, whether promises are kept, what to repeat, and which card is next."""
    closed, plan = campaign.closed, campaign.plan
    wanted = sum(c.repeats for c in plan.cards)
    good = sum(not r.faults for r in closed.runs)
    yield "lead", _lead(campaign, good, wanted)
    found = f"{counted(len(closed.runs), 'run')} of {wanted} found in {counted(len(closed.logs), 'log')}"
    yield "finding", f"{found}, {good} as {'its card says' if wanted == 1 else 'their cards say'}"
    if closed.why_none:
        yield "doubt", closed.why_none
    yield from (("doubt", text) for text in dict.fromkeys(t for r in closed.runs for t in r.anomalies))
    yield from _verdicts(campaign)
    yield from _beyond_stated(campaign)
    never = [str(c.number) for c in plan.cards if c.repeats and not closed.of(c)]
    if never:
        yield "finding", f"not flown: {'cards' if never[1:] else 'card'} {listed(never)}"
    bad = [f"card {r.card.number} at {r.start_s:.1f} s of {r.log} ({r.faults[0]})" for r in closed.runs if r.faults]
    if bad:
        yield "doubt", f"to be repeated: {some(bad)}"
    strange = [f"card {r.card.number} ({', '.join(r.strange)})" for r in closed.runs if r.strange]
    if strange:
        yield (
            "finding",
            f"the response left its band: {some(strange)}; the aircraft differs from the a-priori model there",
        )
    yield from _more_runs(campaign)
    yield from _next(campaign)


def _lead(campaign: Campaign, good: int, wanted: int) -> str:
    """Return how many targets are as well known as promised, or what was found where nothing was promised."""
    judged = [t for c in campaign.cards for t in c.targets]
    promised = [t for t in judged if t.verdict != "found"]
    known, runs = len(judged) - len(promised), f"{good} good of {counted(wanted, 'planned run')}"
    if promised:
        reached = sum(t.verdict == "reached" for t in promised)
        asked = [t for t in promised if math.isfinite(t.wanted)]
        goal = "promised" if not asked else "wanted" if len(asked) == len(promised) else "wanted or promised"
        return f"{reached or 'none'} of {counted(len(promised), 'target')} known as well as {goal}, from {runs}"
    return f"{counted(known, 'derivative')} found, from {runs}" if known else f"nothing found, from {runs}"


def _all(campaign: Campaign, *verdicts: str) -> list[tuple[JudgedCard, Target]]:
    return [(c, t) for c in campaign.cards for t in c.targets if t.verdict in verdicts]


def _verdicts(campaign: Campaign) -> Sentences:
    for verdict, words in (("reached", "reached"), ("found", "found, without a promised error")):
        told = [_value(c, t) for c, t in _all(campaign, verdict)]
        if told:
            yield "finding", f"{words}: {some(told, _MOST, ', ')}"
    for c, t in sorted(_all(campaign, "not reached"), key=lambda ct: -ct[1].lack)[:_MOST]:
        why = f": {t.causes[0]}" if t.causes else ""
        goal = f"{error_words(t, t.goal)} {'is wanted' if math.isfinite(t.wanted) else 'would keep the promise'}"
        short = f"not reached: {_value(c, t)}, where {goal}"
        yield "doubt", f"{short if t.error > t.goal else f'not reliable: {_value(c, t)}'}{why}"
    lost: dict[str, list[str]] = {}
    for c, t in _all(campaign, "not identifiable"):
        lost.setdefault(t.causes[0] if t.causes else "", []).append(f"{t.name} of card {c.card.number}")
    for why, names in list(lost.items())[:_MOST]:
        yield "doubt", f"not identifiable from these logs: {listed(names)}: {why}"
    for c in campaign.cards:
        if c.flown.runs and c.flown.reason and not c.targets and c.card.spec.use != "validation":
            yield "doubt", f"card {c.card.number} is not identified: {c.flown.reason}"
    for c in campaign.cards:
        if c.flown.distrusted and any(t.verdict in ("reached", "found") for t in c.targets):
            assert c.flown.case is not None
            told_of = (
                "; the simulated flights, whose errors are included, may have the same fault" if _simulated(c) else ""
            )
            advice = c.flown.case.model.advice[0]
            yield "doubt", f"card {c.card.number}: the estimator has doubts about its model: {advice}{told_of}"
    changed = [(c, t) for c, t in _all(campaign, "reached", "found", "not reached") if abs(t.differs) > _CHANGED]
    if changed:
        texts = [f"{_value(c, t)}, a priori {number(t.here, 3)}" for c, t in changed]
        yield "finding", f"different from the a-priori model: {some(texts, _MOST)}"


def _beyond_stated(campaign: Campaign) -> Sentences:
    """Yield for each card the target whose error is most above what its estimator states, and what is added to that."""
    for c in campaign.cards:
        above = [
            (t.error / t.estimate.stated, t.estimate, t)
            for t in c.targets
            if t.estimate is not None and t.verdict != "not identifiable" and t.error > _ABOVE * t.estimate.stated > 0.0
        ]
        if not above:
            continue
        _, found, t = max(above, key=lambda row: row[0])
        parts = [f"the runs differ by {number(found.scatter, 2)} times that"] if found.scatter > 1.0 else []
        of = "simulated flights of the design" if _simulated(c) else "the expected response of the card"
        added = [f"scatter by {number(t.beyond, 2)} times the stated error"] if t.beyond > 1.0 else []
        added += [f"have a mean error of {number(t.lasting, 2)}"] if t.lasting > 0.0 else []
        if added:
            parts.append(f"estimates in {of} {listed(added)}")
        yield (
            "finding",
            f"for {t.name} (card {c.card.number}) the estimator alone states ± {number(found.stated, 2)}; ± "
            f"{number(t.error, 2)} includes that {listed(parts)}",
        )


def _simulated(c: JudgedCard) -> bool:
    return c.flown.promise is not None and c.flown.promise.realised is not None


def _value(c: JudgedCard, t: Target) -> str:
    assert t.estimate is not None
    return f"{t.name} {number(t.estimate.value, 3)} ± {number(t.error, 2)} (card {c.card.number})"


def error_words(t: Target, error: float) -> str:
    """Return a standard error as people read it: in percent of the estimate, of a damping ratio as it is."""
    if not math.isfinite(error):
        return "no bound"
    value = t.believed if t.estimate is None or not t.estimate.value else t.estimate.value
    return f"{number(error / abs(value) / PERCENT, 2)} %" if is_ratio(t.name) else number(error, 2)


def _more_runs(campaign: Campaign) -> Sentences:
    """Yield how many more runs reach what was wanted, and what no number of runs reaches."""
    for c in campaign.cards:
        short = [t for t in c.targets if t.estimate is not None and t.more]
        if short:
            t = max(short, key=lambda t: t.more or 0)
            goal = error_words(t, t.goal)
            verb = "brings" if t.more == 1 else "bring"
            yield (
                "finding",
                f"{counted(t.more or 0, 'more run')} of card {c.card.number} {verb} the error of {t.name} to {goal}",
            )
        never = [t for t in c.targets if t.verdict in ("reached", "not reached") and t.more is None]
        if never:
            names = listed([f"{t.name} to {error_words(t, t.goal)}" for t in never])
            yield (
                "doubt",
                (
                    f"repeating card {c.card.number} does not reduce the error of {names}: {_in_the_way(never)}; "
                    "design another input"
                ),
            )


def _in_the_way(targets: list[Target]) -> str:
    lasting = any(t.realised is not None and t.realised[0] > t.goal for t in targets)
    return (
        "the simulated flights of its design have a mean error of that size, which repeats do not reduce"
        if lasting
        else "it would take too many runs"
    )


def _next(campaign: Campaign) -> Sentences:
    held = [c for c in campaign.cards if c.more and c.go]
    if held:
        texts = [f"card {c.card.number}: {c.go}" for c in held]
        yield "finding", f"NO-GO for {some(texts)}"
    following = campaign.following
    if following is not None:
        card, left = following.card, counted(following.more, "run")
        yield "finding", f"next is card {card.number}, {card.title}: GO for {left}{_if_cleared(campaign, card)}"
    elif any(c.more for c in campaign.cards):
        yield "doubt", "no card may be flown next"
    else:
        yield "finding", "all planned runs are flown"


def _if_cleared(campaign: Campaign, card: Card) -> str:
    """Return that a faster speed must be cleared first, of an aircraft whose structure vibrates."""
    slower = any(r.card.point.V_m_s < card.point.V_m_s for r in campaign.closed.runs)
    vibrates = any(m.elastic for m in card.point.modes)
    return f", if testbench modes clears {card.point.V_m_s:g} m/s from these records" if slower and vibrates else ""
