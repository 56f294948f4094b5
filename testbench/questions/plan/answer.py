"""A flight plan in sentences: flights and time, the onset, the narrowest step, cards refused, accuracy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

from testbench.core.errors import Refusal
from testbench.page.words import counted, listed, some
from testbench.questions.plan.card_text import beyond_limits
from testbench.questions.plan.flown_recipe import design_file
from testbench.questions.run.scenario import Scenario

if TYPE_CHECKING:
    from testbench.questions.plan.result import Card, Plan

_MOST = 6  # accuracies that are told one by one
Sentences = Iterator[tuple[str, str]]


def plan_answer(plan: Plan) -> Sentences:
    """Yield (kind, sentence) for each result: flights and time, onset, predicted damping, cards and accuracy."""
    planes = Counter(r.card.spec.plane for r in plan.runs)
    if plan.runs:
        minutes, legs = sum(f.time_s for f in plan.flights) / 60.0, len(plan.flights)
        words = {"battery": ("battery", "batteries"), "tow": ("tow", "tows")}
        on = counted(legs, *words.get(plan.scenario.energy.kind, ("tank", "tanks")))
        runs = f"{counted(len(plan.runs), 'run')} ({', '.join(f'{n} {plane}' for plane, n in planes.most_common())})"
        time = f"take {counted(legs, 'flight')} on {on} and {minutes:.0f} min in the air"
        yield "lead", f"{runs} at {counted(len(plan.points), 'point')} {time}"
        fullest = max(plan.flights, key=lambda f: f.share)
        used = f"uses {100.0 * fullest.share:.0f} % of the usable energy"
        yield "finding", f"the fullest flight, no. {fullest.number}, {used}"
    else:
        yield "lead", "nothing can be flown: every card is refused"
    yield from _onset_lines(plan)
    for status, verb, kind in (("refused", "are refused", "doubt"), ("scaled", "are scaled down", "finding")):
        found = [c for c in plan.cards if c.status == status]
        if found:
            named = some(f"{c.number} ({c.title}: {c.met[0]})" for c in found)
            yield kind, f"{len(found)} of {len(plan.cards)} cards {verb}: {named}"
    beyond = [str(c.number) for c in plan.cards if c.status != "refused" and beyond_limits(c)]
    if beyond:
        which = f"{'cards' if beyond[1:] else 'card'} {listed(beyond)}, with the status watch"
        yield "doubt", f"the 95 % band of the expected response reaches beyond a limit on {which}"
    yield from _calm_lines(plan)
    yield from _accuracy_lines(plan)


def _calm_lines(plan: Plan) -> Sentences:
    """Yield which cards have a design for still air, though the plan's air moves.

    Its estimator is output error, which takes gusts for noise.
    """
    rms, calm = plan.scenario.turbulence_rms_m_s, []
    for card in plan.cards if rms else ():
        file = design_file(plan, card)
        with suppress(Refusal):  # a design that is damaged is told where it is needed
            if file is not None and Scenario.load(file).identification.estimators[0].method == "output_error":
                calm.append(str(card.number))
    if calm:
        designs, are, their = ("designs of cards", "are", "their") if calm[1:] else ("design of card", "is", "its")
        yield (
            "doubt",
            f"the {designs} {listed(calm)} {are} for still air, and this plan has turbulence of {rms:g} m/s, which "
            f"biases {their} estimator: fly in calm air, or design again with [air] turbulence_rms_m_s = {rms:g}",
        )


def _onset_lines(plan: Plan) -> Sentences:
    fastest = plan.points[-1] if plan.points else None
    if fastest is None:
        return
    if fastest.margin is None or fastest.onset is None:
        yield "finding", "no onset of an elastic instability is predicted in the range"
        return
    kind, side = ("finding", "below") if fastest.margin >= 0.0 else ("doubt", "ABOVE")
    lies = f"lies {abs(100.0 * fastest.margin):.0f} % {side} it"
    yield kind, f"{fastest.onset.sentence}; the fastest point, {fastest.V_m_s:g} m/s, {lies}"
    waiting = sorted({p.V_m_s for p in plan.points if plan.waits(p.V_m_s)})
    if waiting:
        yield "finding", f"NO-GO yet at {listed([f'{V:g}' for V in waiting])} m/s: {plan.waits(waiting[0])}"
    elif plan.cleared is not None:
        yield "finding", f"all speeds are cleared, to {plan.cleared.cleared_m_s:.3g} m/s"


def _accuracy_lines(plan: Plan) -> Sentences:
    """Yield whether the wanted accuracy is reached."""
    cards = [c for c in plan.cards if c.reached and c.status != "refused"]
    short = [(c, r) for c in cards for r in c.reached if not r.reached <= r.wanted * (1.0 + 1e-9)]
    if cards and not short:
        yield "finding", f"the wanted accuracy is reached on all {len(cards)} cards that have one"
    for c, r in short[:_MOST]:
        yield "doubt", f"card {c.number}, {r.sentence}; {_in_the_way(c)}"
    if len(short) > _MOST:
        yield "doubt", f"{len(short) - _MOST} more accuracies are not reached; see the table of cards"


def _in_the_way(card: Card) -> str:
    """Return what keeps a card from telling more, in words."""
    if card.status == "scaled":
        return f"the limit on its amplitude ({card.met[0]}) prevents it"
    return f"the noise of the sensors prevents it at this amplitude and duration, {card.spec.duration_s:g} s"
