"""A flight plan in sentences: flights and time, the onset, the narrowest step, cards refused, accuracy."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import TYPE_CHECKING

from testbench.core.errors import Refusal
from testbench.page.words import counted, listed, some
from testbench.questions.plan.card_text import beyond_limits
from testbench.questions.plan.flown_recipe import design_file
from testbench.questions.run.scenario import Scenario

if TYPE_CHECKING:
    from testbench.questions.plan.result import Card, Plan


def plan_answer(plan: Plan) -> list[tuple[str, str]]:
    """Return (kind, sentence) for each result: flights and time, onset, predicted damping, cards and accuracy."""
    out: list[tuple[str, str]] = []
    planes = Counter(r.card.spec.plane for r in plan.runs)
    if plan.runs:
        minutes = sum(f.time_s for f in plan.flights) / 60.0
        legs = len(plan.flights)
        one, many = {"battery": ("battery", "batteries"), "tow": ("tow", "tows")}.get(
            plan.scenario.energy.kind, ("tank", "tanks")
        )
        on = counted(legs, one, many)
        head = (
            f"{counted(len(plan.runs), 'run')} ({', '.join(f'{n} {plane}' for plane, n in planes.most_common())}) at "
            f"{counted(len(plan.points), 'point')} take "
            f"{counted(legs, 'flight')} on {on} and {minutes:.0f} min in the air"
        )
        fullest = max(plan.flights, key=lambda f: f.share)
        out.append(("lead", head))
        used = f"uses {100.0 * fullest.share:.0f} % of the usable energy"
        out.append(("finding", f"the fullest flight, no. {fullest.number}, {used}"))
    else:
        out.append(("lead", "nothing can be flown: every card is refused"))
    out += _onset_lines(plan)
    for status, verb in (("refused", "are refused"), ("scaled", "are scaled down")):
        found = [c for c in plan.cards if c.status == status]
        if found:
            named = some(f"{c.number} ({c.title}: {c.met[0]})" for c in found)
            kind = "doubt" if status == "refused" else "finding"
            out.append((kind, f"{len(found)} of {len(plan.cards)} cards {verb}: {named}"))
    beyond = [str(c.number) for c in plan.cards if c.status != "refused" and beyond_limits(c)]
    if beyond:
        out.append(
            (
                "doubt",
                f"the 95 % band of the expected response reaches beyond a limit on {'cards' if beyond[1:] else 'card'} "
                f"{listed(beyond)}, which {'say' if beyond[1:] else 'says'} watch",
            )
        )
    out += _calm_lines(plan)
    out += _accuracy_lines(plan)
    return out


def _calm_lines(plan: Plan) -> list[tuple[str, str]]:
    """Return which cards have a design for still air, though the plan's air moves.

    Its estimator is output error, which takes gusts for noise.
    """
    rms, calm = plan.scenario.turbulence_rms_m_s, []
    for card in plan.cards if rms else ():
        file = design_file(plan, card)
        with suppress(Refusal):  # a design that is damaged is told where it is needed
            if file is not None and Scenario.load(file).identification.estimators[0].method == "output_error":
                calm.append(str(card.number))
    if not calm:
        return []
    many = len(calm) > 1
    head = (
        f"the {'designs of cards' if many else 'design of card'} {listed(calm)} {'are' if many else 'is'} for still air"
    )
    text = (
        f"{head}, and this plan has turbulence of {rms:g} m/s, which biases {'their' if many else 'its'} estimator: "
        f"fly in calm air, or design again with [air] turbulence_rms_m_s = {rms:g}"
    )
    return [("doubt", text)]


def _onset_lines(plan: Plan) -> list[tuple[str, str]]:
    out: list[tuple[str, str]] = []
    fastest = plan.points[-1] if plan.points else None
    if fastest is None:
        return out
    if fastest.margin is None or fastest.onset is None:
        out.append(("finding", "no onset of an elastic instability is predicted in the range"))
        return out
    side = "below" if fastest.margin >= 0.0 else "ABOVE"
    out.append(
        (
            "finding" if fastest.margin >= 0.0 else "doubt",
            f"{fastest.onset.sentence}; the fastest point, {fastest.V_m_s:g} m/s, lies "
            f"{abs(100.0 * fastest.margin):.0f} % {side} it",
        )
    )
    waiting = sorted({p.V_m_s for p in plan.points if plan.waits(p.V_m_s)})
    if waiting:
        speeds = listed([f"{V:g}" for V in waiting])
        out.append(("finding", f"NO-GO yet at {speeds} m/s: {plan.waits(waiting[0])}"))
    elif plan.cleared is not None:
        out.append(("finding", f"all speeds are cleared, to {plan.cleared.cleared_m_s:.3g} m/s"))
    return out


def _accuracy_lines(plan: Plan) -> list[tuple[str, str]]:
    """Return whether the wanted accuracy is reached."""
    cards = [c for c in plan.cards if c.reached and c.status != "refused"]
    if not cards:
        return []
    short = [(c, r) for c in cards for r in c.reached if not r.reached <= r.wanted * (1.0 + 1e-9)]
    if not short:
        return [("finding", f"the wanted accuracy is reached on all {len(cards)} cards that ask for one")]
    return [("doubt", f"card {c.number}, {r.sentence}; {_in_the_way(c)}") for c, r in short[:6]] + (
        [("doubt", f"{len(short) - 6} more accuracies are not reached; see the table of cards")]
        if len(short) > 6
        else []
    )


def _in_the_way(card: Card) -> str:
    """Return what keeps a card from telling more, in words."""
    if card.status == "scaled":
        return f"the limit on its amplitude ({card.met[0]}) stands in the way"
    return f"the noise of the sensors stands in the way at this amplitude and duration, {card.spec.duration_s:g} s"
