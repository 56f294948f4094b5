"""A design in words: what to fly, what it will tell, and what prevents more accuracy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.design.amplitude import AIR, BELIEVED, BIAS, DRAWS, STABILITY
from testbench.design.limits import limit_words
from testbench.design.realise import CAUSES
from testbench.page.labels import number, shown_unit, symbol
from testbench.page.words import counted, grouped, listed

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.design.amplitude import Flown
    from testbench.design.problem import Design
    from testbench.questions.design.result import DesignResult

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
    return _error(t.names[k], float(errors[k]), float(t.values[k]))


def _error(name: str, error: float, value: float) -> str:
    """Return an error in percent of the value; as it is for damping ratios, and where it exceeds a value near zero."""
    if not is_ratio(name) or error > abs(value):
        return number(error, 2) + (f" (value {number(value, 2)})" if is_ratio(name) else "")
    return f"{number(100.0 * error / abs(value), 2)} %"


def wanted_words(result: DesignResult, k: int) -> str:
    """Return the wanted standard error of target ``k``."""
    return error_words(result, result.problem.targets.wanted, k)


def worst_target(result: DesignResult, errors: FloatArray) -> int:
    """Return the target whose error is largest against what is wanted of it."""
    return int(np.argmax(np.nan_to_num(errors / result.problem.targets.wanted, nan=-1.0, posinf=np.inf)))


def design_sentences(result: DesignResult) -> list[str]:
    """Return the recommendation, most important first; the first sentence is the answer."""
    out = _verdict(result) + _known(result) + _realised(result) + _over_draws(result)
    out += (
        _elsewhere(result)
        + _shortest(result)
        + _against_classics(result)
        + _in_flight(result.best)
        + _in_the_way(result)
    )
    out += _modes(result) + _other_suites(result)
    for onset in result.believed.onsets:
        if onset.V_m_s is not None:
            V = result.scenario.condition.V_m_s
            side = f"{onset.V_m_s - V:.1f} m/s above" if onset.V_m_s >= V else f"{V - onset.V_m_s:.1f} m/s BELOW"
            out.append(f"The onset of vibration lies {side} the speed of the design ({onset.sentence})")
    return out


def _verdict(result: DesignResult) -> list[str]:
    """Return what to fly and whether it is enough: for the believed aircraft, or for the worst drawn one if robust."""
    best, over = result.best.design, result.best.over
    robust = over is not None and result.scenario.robust
    t = result.problem.targets
    errors = over.told.over(np.max) * t.wanted if over is not None and robust else result.total(result.best)
    k = worst_target(result, errors)
    what = f"the {family_label(best.family)} on the {controls_words(best)} ({best.words}), peak {peak_words(best)}"
    left = f"with a standard error of {error_words(result, errors, k)}"
    left += f"{' in the worst of them' if robust else ''} where {wanted_words(result, k)} is wanted"
    reached = "every wanted accuracy" + (
        f" in each of {len(over.told.costs)} drawn aircraft" if over and robust else ""
    )
    if float(errors[k] / t.wanted[k]) <= 1.0:
        return [f"Fly {what}: it reaches {reached}; the least known is {t.names[k]}, {left}"]
    if result.scenario.input:
        out = [f"{what[0].upper()}{what[1:]} does not reach {reached}: it leaves {t.names[k]} {left}"]
    else:
        short = f"No admissible input found in {result.scenario.duration_s:g} s reaches {reached}"
        out = [f"Fly {what}: it is nearest to the wanted accuracies", f"{short}; the best leaves {t.names[k]} {left}"]
    if result.obstacles.flights and not robust and not _refuted(result.best):
        out.append(
            f"Flown {result.obstacles.flights} times it would reach them: errors fall with the root of the number of "
            "flights"
        )
    return out


def _known(result: DesignResult) -> list[str]:
    """Return what was known before this flight, which targets need no more, and what the flight adds."""
    known, t = result.known, result.problem.targets
    if known is None:
        return []
    total = result.total(result.best)
    met = [n for n, e, w in zip(t.names, known.errors, t.wanted, strict=True) if e <= w]
    open_ = [k for k, n in enumerate(t.names) if n not in met]
    k = max(open_, key=lambda k: float(known.errors[k] / t.wanted[k]))
    text = f"Of {len(t.names)} targets {listed(met) if met else 'none'} {'are' if met[1:] else 'is'} known as well as "
    text += (
        f"wanted from the previous flights. The least known is {t.names[k]}: {error_words(result, known.errors, k)} "
    )
    text += f"now, {error_words(result, total, k)} after this flight"
    return [text, *known.notes]


_FIX = {
    "noise": "Quieter or more sensors, more time or more flights reduce it",
    "air": "Calmer air or more flights reduce it",
    "curvature": "A smaller amplitude reduces it; so does a structure with the nonlinearity of the aircraft",
    "equations": "Measure the deflection, log the commands faster, or include the sensor dynamics in the estimator",
    "bias": "More flights do not reduce it; other air or another input may",
    "scatter": "More flights reduce it",
}


def air_words(result: DesignResult) -> str:
    """Return the air in which designs were realised, and why it is that."""
    if result.air is None:
        return "none: realise = 0"
    given = "air" in result.scenario.model_fields_set
    rms = result.air.turbulence_rms_m_s
    if rms == 0.0:
        return "air without turbulence"
    text = f"turbulence of {rms:g} m/s vertical rms"
    return text if given else f"{text}, a calm morning, as [air] is not given"


def _realised(result: DesignResult) -> list[str]:
    """Return what flying and identifying the best design many times says of its promised errors, and of its limits."""
    r, t = result.best.realised, result.problem.targets
    if r is None:
        return ["The errors are promised by information alone and have not been realised: realise = 0"]
    flights = r.found.n + len(r.found.failed)
    by = result.ensemble.range_.identified.words
    head = f"flown, sensed and identified by {by} {flights} times in {air_words(result)}"
    out = []
    if r.found.n < 3:
        out.append(f"{head}, it gives {counted(r.found.n, 'estimate')}: no error can be promised")
    elif not np.any(r.differs):
        k = worst_target(result, r.headline)
        out.append(
            f"{head}, its errors agree with the promised ones within the scatter of {r.found.n} flights: that of "
            f"{t.names[k]} is {error_words(result, r.found.rms, k)}, {error_words(result, r.promised, k)} was promised"
        )
    else:
        low, high = r.found.interval()
        k = int(np.argmax(np.where(r.differs, r.headline / t.wanted, -1.0)))
        out.append(
            f"{'All' if r.differs.all() else 'Some'} realised errors differ from the promised ones, and the realised "
            f"ones are used; {head}, that of {t.names[k]} is {error_words(result, r.found.rms, k)} "
            f"({error_words(result, low, k)} to {error_words(result, high, k)}), {error_words(result, r.promised, k)} "
            f"was promised, and the estimator states {error_words(result, r.found.claimed, k)}"
        )
    for cause, of in grouped({name: r.cause(i) for i, name in enumerate(t.names)}).items():
        out.append(f"Most of the error of {' and '.join(of)} is {CAUSES[cause]}. {_FIX[cause]}")
    if r.found.failed:
        out.append(
            f"{len(r.found.failed)} of {flights} flights give no estimate; the first: {r.found.failed[0].split(';')[0]}"
        )
    if (curbed := result.best.share(BIAS)) < 1.0:
        out.append(
            f"The amplitude is {100 * curbed:.0f} % of what the limits allow: a larger one would increase the bias of "
            "the estimates by more than it reduces their scatter"
        )
    return out + _margin(result)


def _margin(result: DesignResult) -> list[str]:
    best, asked = result.best, result.best.bounds.get(AIR)
    if (share := best.share(STABILITY)) < 1.0:
        return [
            f"The amplitude is {100 * share:.0f} % of what the a-priori model allows, so that the limits also hold "
            f"with {listed([m.words for m in result.ensemble.others])}"
        ]
    if asked is None:
        return []
    claim, chance = 100.0 * (1.0 - 0.05 ** (1.0 / asked.flights)), 100 * result.ensemble.probability
    text = f"Over {asked.flights} flights in that air the input meets a limit in {asked.met}; the extreme uses "
    text += f"{100 * asked.mean:.0f} +- {100 * asked.deviation:.0f} % of the limit on {_limit_words(asked.limit, '')}"
    if asked.share < 1.0:
        text += f", at {100 * asked.share:.0f} % of the amplitude that is possible in still air"
    if asked.reach > 1.0:
        return [f"{text}. No amplitude keeps this limit in this air with {chance:g} %: widen it, or wait"]
    told = f"; the flights alone show less than {claim:.0f} % with 95 % confidence" if asked.met == 0 else ""
    return [f"{text}. The next flight meets it with at most {chance:g} % if extremes are normal{told}"]


def _elsewhere(result: DesignResult) -> list[str]:
    out = []
    for e in result.elsewhere:
        if e.found is None or e.values is None or e.predicted is None:
            out.append(f"With the {e.what} no error can be given: {e.why_not}")
            continue
        t = result.problem.targets
        text = f"With the {e.what}"
        if e.found.n < 3:
            out.append(f"{text}, {e.found.n} of {e.found.n + len(e.found.failed)} flights give an estimate")
        else:
            k = int(np.argmax(e.found.rms / t.wanted))
            rms, name = float(e.found.rms[k]), t.names[k]
            error = _error(name, rms, float(e.values[k]))
            out.append(f"{text}, the realised error of {name} is {error}")
        if e.flight is not None and e.flight.breach:
            out[-1] += f"; in still air {e.flight.breach}"
    return out


def _over_draws(result: DesignResult) -> list[str]:
    """Return what the stated uncertainty of the aircraft makes of the best design."""
    draws, over, name = result.draws, result.best.over, result.aircraft.name
    if draws is None:
        if result.scenario.draws == 0:
            return []
        return [
            f"Errors and limits are those of the a-priori model of {name}, which states no [uncertainty]: draws = 20 "
            "computes them over aircraft drawn with the accuracy of handbook methods, and robust = true chooses the "
            "input for those"
        ]
    out = []
    if over is not None:
        n = len(over.told.costs)
        by = f"the stated uncertainty of {name}" if result.aircraft.uncertainty else "the accuracy of handbook methods"
        worst, median = (over.told.over(how) * result.problem.targets.wanted for how in (np.max, np.median))
        k = worst_target(result, worst)
        out.append(
            f"Over {counted(n, 'aircraft', 'aircraft')} drawn with {by}, the standard error of "
            f"{result.problem.targets.names[k]} is {error_words(result, median, k)} in the median and "
            f"{error_words(result, worst, k)} in the worst, against "
            f"{error_words(result, result.best.design.errors, k)} for the a-priori model; every wanted accuracy is "
            f"reached in {over.told.reached} of {n}"
        )
        out += _limits_over_draws(result)
        nominal = None if result.nominal is None else result.ranking[result.nominal]
        if nominal is not None and nominal.over is not None:
            more = float(nominal.over.told.costs.max() / over.told.costs.max())
            out.append(
                "The design for the a-priori model alone is the same"
                if nominal is result.best
                else f"The design for the a-priori model alone, the {family_label(nominal.design.family)} "
                f"({nominal.design.words}), has {number(more, 2)} times its error in the worst of them, within "
                "the same limits"
            )
        out.append(
            "These errors contain no prior, because output error has none: they are those of the flight alone"
            if result.known is None
            else "These errors include the previous flights"
        )
    if draws.lost:
        out.append(
            f"{len(draws.lost)} of {draws.asked} drawn aircraft cannot be judged; the first: {draws.lost[0].reason}"
        )
    return out


def _limits_over_draws(result: DesignResult) -> list[str]:
    over, out, asked = result.best.over, [], result.best.bounds.get(DRAWS)
    assert over is not None
    n, names = len(over.told.costs), [f.tightest.name for f in over.broken]
    if asked is not None and asked.share < 1.0:
        out.append(
            f"For the drawn aircraft the amplitude was lowered to {100 * asked.share:.0f} % of what the a-priori model "
            f"allows; the binding limit of the worst of them is {_limit_words(asked.limit)}"
        )
    if names:
        most = max(dict.fromkeys(names), key=names.count)
        said = f"At this amplitude the input breaks a limit in {len(names)} of {n} drawn aircraft, most often "
        said += _limit_words(most)
        fix = "; robust = true chooses input and amplitude for all of them"
        out.append(said + ("" if result.scenario.robust else fix))
    else:
        out.append(f"At this amplitude the input breaks no limit in any of the {n} drawn aircraft")
    return out


def _limit_words(name: str, head: str = "that on ") -> str:
    """Return a limit in words; one without a name has ended the flight."""
    if not name:
        return "one of the aircraft itself, which ends the flight"
    return head + (limit_words(name) if head else limit_words(name).removeprefix("the "))


def _refuted(entry: Flown) -> bool:
    """Return whether realised errors contradict what information promises of a design."""
    return entry.realised is not None and bool(np.any(entry.realised.differs))


def _shortest(result: DesignResult) -> list[str]:
    if result.shortest is None:
        return []
    d = result.shortest.design
    what = f"a switching signal ({d.words}), peak {peak_words(d)}, moves the {controls_words(d)} for "
    what += f"{d.end_s - result.problem.start_s:.3g} s"
    promised = "" if result.best.realised is None else ", as promised; it has not been realised"
    return [f"The shortest record that reaches the wanted accuracy lasts {d.duration_s:.3g} s: {what}{promised}"]


def _against_classics(result: DesignResult) -> list[str]:
    parts, robust = [], result.scenario.robust

    def cost(ranked: Flown) -> float:
        """Return the criterion by which designs are compared."""
        return float(ranked.over.told.costs.max()) if ranked.over and robust else ranked.design.cost

    for family in ("doublet", "3211"):
        ranked = next((r for r in result.ranking if r.design.family == family), None)
        if ranked is not None and ranked is not result.best and np.isfinite(cost(ranked)):
            parts.append(
                f"the best single {family_label(family)} has {cost(ranked) / cost(result.best):.2g} times its error"
            )
    how = " over the drawn aircraft" if robust else ", as promised" if _refuted(result.best) else ""
    return [f"Compared with the pilots' usual inputs{how}, {' and '.join(parts)}"] if parts else []


def _in_flight(best: Flown) -> list[str]:
    tight = best.tightest
    text = (
        f"Flown in the nonlinear simulator it uses {100 * tight.share:.0f} % of the limit on "
        f"{_limit_words(tight.name, '')}, most at t = {tight.t_s:.2f} s"
    )
    if best.breach:
        text += (
            f"; the amplitude was lowered to {100 * best.share(BELIEVED):.0f} % of what the linearised aircraft "
            f"allows, because at that amplitude {best.breach}"
        )
    return [text]


def _in_the_way(result: DesignResult) -> list[str]:
    if _refuted(result.best):  # by something that the information does not hold
        return []
    tried = [o for o in result.obstacles.tried if o.cost < 0.9 * result.best.design.cost][:3]
    if not tried:
        return []
    most, *others = [(o.words, f"{100.0 * o.cost / result.best.design.cost:.2g} %") for o in tried]
    text = f"Without {most[0]} the error would fall to {most[1]} of its value"
    return [text + "".join(f"; without {words}, to {share}" for words, share in others)]


def _modes(result: DesignResult) -> list[str]:
    energy = result.energy(result.best.design)
    unseen = [m for m in energy.modes if not energy.excited(m)]
    if not unseen:
        return ["It excites every mode of this plane above the noise of some sensor"]
    parts = [f"{m} ({energy.seen(m)[1]:+.0f} dB at {energy.seen(m)[0]})" for m in unseen]
    return [f"It does not excite {'; '.join(parts)}: this flight gives no information on them"]


def _other_suites(result: DesignResult) -> list[str]:
    out = []
    for suite, errors in result.others.items():
        k = worst_target(result, errors)
        verdict = "reaches" if errors[k] <= result.problem.targets.wanted[k] else "does not reach"
        verdict = f"{verdict}, by information alone," if _refuted(result.best) else verdict
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
