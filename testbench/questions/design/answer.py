"""A design in words: what to fly, what it will tell, and what prevents more accuracy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.page.labels import number, shown_unit, symbol
from testbench.questions.design.flown import limit_words

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.design.problem import Design
    from testbench.questions.design.result import DesignResult, Ranked

_LABELS = {"3211": "3-2-1-1", "211": "2-1-1", "123": "1-2-3", "prbs": "PRBS", "gbn": "binary noise"}


def family_label(family: str) -> str:
    """Return the name of a signal family as people write it."""
    return _LABELS.get(family, family)


def controls_words(design: Design) -> str:
    """Return "elevator" or "aileron and rudder"."""
    return " and ".join(channel(c).description.split(",")[0].split()[0] for c in design.controls)


def peak_words(design: Design) -> str:
    """Return the peak of each control, "5.2 deg" or "5.2 and 3 deg"."""
    return " and ".join(
        f"{number(p / PERCENT)} %" if c == "thr" else f"{number(p / DEG_RAD)} deg"
        for c, p in zip(design.controls, design.peak, strict=True)
    )


def is_ratio(name: str) -> bool:
    """Return whether a target's error is shown in percent of its value; damping ratios are shown as they are."""
    return not name.startswith("zeta of ")


def error_words(result: DesignResult, errors: FloatArray, k: int) -> str:
    """Return the standard error of target ``k`` as people read it."""
    t = result.problem.targets
    if not np.isfinite(errors[k]):
        return "unbounded"
    return f"{number(100.0 * errors[k] / abs(t.values[k]), 2)} %" if is_ratio(t.names[k]) else number(errors[k], 2)


def wanted_words(result: DesignResult, k: int) -> str:
    """Return the wanted standard error of target ``k``."""
    return error_words(result, result.problem.targets.wanted, k)


def worst_target(result: DesignResult, errors: FloatArray) -> int:
    """Return the target whose error is largest against what is wanted of it."""
    return int(np.argmax(errors / result.problem.targets.wanted))


def design_sentences(result: DesignResult) -> list[str]:
    """Return the recommendation, most important first; the first sentence is the answer."""
    best = result.best.design
    k = worst_target(result, best.errors)
    name, ratio = result.problem.targets.names[k], float(best.errors[k] / result.problem.targets.wanted[k])
    what = f"the {family_label(best.family)} on the {controls_words(best)} ({best.words}), peak {peak_words(best)}"
    error, wanted = error_words(result, best.errors, k), wanted_words(result, k)
    out = []
    if ratio <= 1.0:
        out.append(
            f"Fly {what}: it reaches every wanted accuracy; the least known is {name}, with a standard error of "
            f"{error} where {wanted} is wanted"
        )
    else:
        flights = result.obstacles.flights
        out.append(
            f"No admissible input found in {result.scenario.duration_s:g} s reaches every wanted accuracy; the best "
            f"is {what}, which leaves {name} with a standard error of {error} where {wanted} is wanted"
        )
        if flights:
            out.append(f"Flown {flights} times it would reach them: errors fall with the root of the number of flights")
    out += _shortest(result) + _against_classics(result) + _in_flight(result.best) + _in_the_way(result)
    out += _modes(result) + _other_suites(result)
    for onset in result.onsets:
        if onset.V_m_s is not None:
            V = result.scenario.condition.V_m_s
            side = f"{onset.V_m_s - V:.1f} m/s above" if onset.V_m_s >= V else f"{V - onset.V_m_s:.1f} m/s BELOW"
            out.append(f"The onset of vibration lies {side} the speed of the design ({onset.sentence})")
    return out


def _shortest(result: DesignResult) -> list[str]:
    if result.shortest is None:
        return []
    d = result.shortest.design
    return [
        f"The shortest record that reaches the wanted accuracy lasts {d.duration_s:.3g} s: a switching signal "
        f"({d.words}), peak {peak_words(d)}, moves the {controls_words(d)} for "
        f"{d.end_s - result.problem.start_s:.3g} s"
    ]


def _against_classics(result: DesignResult) -> list[str]:
    parts = []
    for family in ("doublet", "3211"):
        ranked = next((r for r in result.ranking if r.design.family == family), None)
        if ranked is not None and ranked is not result.best:
            ratio = ranked.design.cost / result.best.design.cost
            parts.append(f"the best single {family_label(family)} has {ratio:.2g} times its error")
    return [f"Compared with the pilots' usual inputs, {' and '.join(parts)}"] if parts else []


def _in_flight(best: Ranked) -> list[str]:
    flown = best.flown
    tight = flown.tightest
    text = (
        f"Flown in the nonlinear simulator it uses {100 * tight.share:.0f} % of the limit on "
        f"{limit_words(tight.name).removeprefix('the ')}, most at t = {tight.t_s:.2f} s"
    )
    if flown.breach:
        text += (
            f"; the amplitude was lowered to {100 * flown.factor:.0f} % of what the linearised aircraft allows, "
            f"because at that amplitude {flown.breach}"
        )
    return [text]


def _in_the_way(result: DesignResult) -> list[str]:
    tried = [o for o in result.obstacles.tried if o.cost < 0.9 * result.best.design.cost][:3]
    if not tried:
        return []
    most, *others = [(o.words, f"{100.0 * o.cost / result.best.design.cost:.2g} %") for o in tried]
    text = f"Without {most[0]} the error would fall to {most[1]} of what it is"
    return [text + "".join(f"; without {words}, to {share}" for words, share in others)]


def _modes(result: DesignResult) -> list[str]:
    energy = result.best.energy
    unseen = [m for m in energy.modes if not energy.excited(m)]
    if not unseen:
        return ["It excites every mode of this plane above the noise of some sensor"]
    parts = [f"{m} ({energy.seen(m)[1]:+.0f} dB at {energy.seen(m)[0]})" for m in unseen]
    return [f"It does not excite {'; '.join(parts)}: this flight tells nothing of them"]


def _other_suites(result: DesignResult) -> list[str]:
    out = []
    for suite, errors in result.others.items():
        k = worst_target(result, errors)
        verdict = "reaches" if errors[k] <= result.problem.targets.wanted[k] else "does not reach"
        out.append(
            f"Through the suite {suite} the same input {verdict} the wanted accuracy: the worst error is that of "
            f"{result.problem.targets.names[k]}, {error_words(result, errors, k)} where {wanted_words(result, k)} is "
            "wanted"
        )
    return out


def limit_rows(result: DesignResult) -> list[str]:
    """Return the limits that were kept, in words."""
    out = []
    for name, (low, high) in result.envelope.bands.items():
        if name == "az":
            out.append(f"load factor {-high / G0_M_S2:.3g} to {-low / G0_M_S2:.3g}")
            continue
        factor, unit = shown_unit(name)
        out.append(f"{symbol(name)} {factor * low:.4g} to {factor * high:.4g} {unit}".strip())
    out += [f"rate of {symbol(n)} up to {most / DEG_RAD:.4g} deg/s" for n, (_, most) in result.envelope.rates.items()]
    return [text.replace("-", "−") for text in out]
