"""An aircraft in sentences: speed range, onset of instability, modes at the design speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError
from testbench.evaluation.derivatives import dimensional_derivatives, static_margin
from testbench.evaluation.modes import frequency_and_damping
from testbench.flight.thrust import thrust_words
from testbench.page.labels import number

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.evaluation.envelope import Envelope
    from testbench.questions.aircraft.ask import Survey

_SAME = 0.01  # of a pole: what a control law moves by less is not said
_NOISE = 1e-6  # what perturbing a model leaves of a coefficient that it does not have


def aircraft_answer(survey: Survey) -> list[str]:
    """Return the findings as sentences: speed range, static margin, instability, then all else."""
    envelope, found = survey.envelope, survey.range
    ends = [u.reason for u in found.beyond]
    out = [
        f"the aircraft trims from {found.slowest:g} to {found.fastest:g} m/s at {envelope.h_m:g} m"
        + ("" if ends else ", the whole range that its limits allow")
    ]
    margin, *remarks = _pitch_remarks(envelope)
    out.append(margin)
    if envelope.elastic:
        out += onset_sentences(envelope)
    out += [sentence for name in envelope.motion if (sentence := _rigid_instability(survey, name))]
    out += _law_words(survey)
    out.append(thrust_words(envelope.aircraft, envelope.trims[envelope.design]))
    out += [f"outside that range: {reason}" for reason in ends]
    if "de" in envelope.aircraft.controls:
        out.append(_elevator_words(survey))
    at = envelope.poles[envelope.design]
    said = []
    for name in (n for n in envelope.motion if n not in envelope.elastic):
        for pole in at[name]:
            wn, zeta = frequency_and_damping(pole)
            said.append(f"{name} {_motion_words(pole, wn, zeta)}")
    out += remarks
    out += envelope.aircraft.notes
    out.append(f"rigid modes at {envelope.speeds[envelope.design]:g} m/s: {'; '.join(said)}")
    return out


def _law_words(survey: Survey) -> list[str]:
    """Return whether the model's own control law flies, and what it does to the modes; empty if it has none."""
    if not survey.by_law:
        return []
    alone, said = survey.envelope.poles[survey.envelope.design], []
    for name, poles in survey.by_law.items():
        was = alone[name]
        if len(poles) != len(was) or any(abs(a - b) > _SAME * abs(a) for a, b in zip(was, poles, strict=True)):
            words = [" and ".join(_motion_words(s, *frequency_and_damping(s)) for s in found) for found in (was, poles)]
            said.append(f"{name}: {words[0]} without it, {words[1]} with it")
    by_stick = survey.envelope.aircraft.under_law
    flies = "is included: commands are the stick (--commanded-at surface leaves it out)" if by_stick else (
        "is left out: commands are those of the surfaces (--commanded-at stick includes it)"
    )  # fmt: skip
    return [f"the model's own control law {flies}; {'; '.join(said) or 'it changes no pole'}"]


def _pitch_remarks(envelope: Envelope) -> list[str]:
    """Return the static margin, and what of the model's pitching does not belong together, as sentences."""
    aircraft, k = envelope.aircraft, envelope.design
    margin = static_margin(aircraft, dimensional_derivatives(envelope.models[k], envelope.trims[k]))
    out = [f"the static margin at {envelope.speeds[k]:g} m/s is {margin.held:.1f} % of the mean chord"]
    if envelope.elastic:
        out[0] += f" with the elastic modes held, and {margin.flown:.1f} % in flight, where they follow the motion"
    lift, moment = (_has(aircraft, f"{c}_alphadot") for c in ("CL", "Cm"))
    if lift != moment:
        with_, without = ("lift", "pitching moment") if lift else ("pitching moment", "lift")
        out.append(
            f"the {with_} of the model has a term in the rate of alpha and its {without} has none: the lag of the "
            "downwash at a tail, the cause of such terms, gives both"
        )
    return out


def _has(aircraft: Aircraft, name: str) -> bool:
    try:
        return abs(aircraft.coefficient(name)) > _NOISE
    except ModelError:
        return False


def onset_sentences(envelope: Envelope) -> list[str]:
    """Return from what speed on each elastic mode is unstable, in sentences, the slowest first; or that none is."""
    onsets = [envelope.onset(name) for name in envelope.elastic]
    unstable = sorted((o for o in onsets if o.V_m_s is not None), key=lambda o: o.V_m_s or 0.0)
    if not unstable:
        return [f"no elastic mode becomes unstable up to {envelope.speeds[-1]:g} m/s"]
    return [f"the elastic mode {o.sentence.replace(f'{o.name}: ', f'{o.name} is ', 1)}" for o in unstable]


def _elevator_words(survey: Survey) -> str:
    """Return what the trim takes of the elevator at the design speed and leaves for an input, and at the slowest."""
    envelope = survey.envelope
    design = envelope.trims[envelope.design]
    said = []
    for V in (envelope.speeds[envelope.design], survey.range.slowest):
        up, down = (a / DEG_RAD for a in survey.elevator_left(V))
        said.append(f"{up:.1f} deg up and {down:.1f} deg down")
    control, held = envelope.aircraft.controls["de"], design.controls["de"]
    throw = (control.full if held >= 0.0 else -control.low) / DEG_RAD  # to the side that trim takes it
    return (
        f"trim at {envelope.speeds[envelope.design]:g} m/s takes {abs(held) / DEG_RAD:.1f} of the "
        f"elevator's {throw:.4g} deg and leaves {said[0]} for an input; at "
        f"{survey.range.slowest:g} m/s it leaves {said[1]}"
    )


def _motion_words(pole: complex, wn: float, zeta: float) -> str:
    if pole.imag > 1e-9:
        return f"{number(wn / (2.0 * math.pi))} Hz with damping ratio {number(zeta)}"
    if abs(pole.real) < 1e-9:
        return "neutral"
    return f"{'doubles' if pole.real > 0.0 else 'halves'} in {number(math.log(2.0) / abs(pole.real))} s"


def _rigid_instability(survey: Survey, name: str) -> str:
    """Return where a rigid mode is unstable, in words; empty if nowhere."""
    envelope = survey.envelope
    if name in envelope.elastic:
        return ""
    growth = [max(s.real for s in found[name]) for found in envelope.poles]
    unstable = [g > 1e-9 for g in growth]
    if not any(unstable):
        return ""
    where = "at every speed" if all(unstable) else " and ".join(_intervals(envelope.speeds, unstable))
    return f"the {name} is unstable {where}: its amplitude doubles in {number(math.log(2.0) / max(growth))} s at worst"


def _intervals(speeds: Sequence[float], holds: Sequence[bool]) -> list[str]:
    """Return in words the intervals of speed in which something holds, m/s."""
    out = []
    for true, group in groupby(zip(speeds, holds, strict=True), key=lambda pair: pair[1]):
        between = [V for V, _ in group]
        if true:
            first, last = between[0], between[-1]
            out.append(f"at {first:.3g} m/s" if first == last else f"between {first:.3g} and {last:.3g} m/s")
    return out


def shapes_missing(survey: Survey) -> str:
    """Return which mode shapes cannot be drawn, and why, as a sentence; empty if all are drawn."""
    envelope = survey.envelope
    if not envelope.elastic:
        return "No mode shapes are drawn: this aircraft has no elastic modes."
    shaped = survey.shaped
    if not shaped:
        return "No mode shapes are drawn: the elastic modes of this aircraft are given without shapes along the wing."
    without = [name for name, i in envelope.elastic.items() if i not in shaped]
    return f"Modes without a shape along the wing are not drawn: {'; '.join(without)}." if without else ""
