"""What kinematics say of the instruments of records, in sentences, and what it does to derivatives found from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from testbench.core.advice import Advice, doubt
from testbench.core.constants import DEG_RAD
from testbench.core.words import with_error
from testbench.inference.instruments import InstrumentFault
from testbench.page.labels import number, shown_unit

if TYPE_CHECKING:
    from testbench.inference.instruments import Agreement
    from testbench.questions.identify.derivatives import FoundDerivative

CONTRADICTED = "instruments_contradicted"
"""The code of the advice that says so."""
_INSTRUMENTS = {
    "V": "airspeed sensor",
    "alpha": "angle-of-attack vane",
    "beta": "sideslip vane",
    "p": "roll-rate gyro",
    "q": "pitch-rate gyro",
    "r": "yaw-rate gyro",
    "ax": "forward accelerometer",
    "ay": "lateral accelerometer",
    "az": "vertical accelerometer",
    "phi": "bank angle",
    "theta": "pitch angle",
}
_WINDS = {
    "wind": ("downwards", "upwards"),
    "north": ("to the north", "to the south"),
    "east": ("to the east", "to the west"),
}
_TIED = 0.05  # probability from which another error is named beside the first
_NAMED = 3
_SETTLED = {
    "scale": "turn or lean the instrument by a known amount, or fly level at several known speeds",
    "late": "log both instruments by one clock, with the time at which each sample was taken",
    "lag": "read the filter that the instrument or the autopilot puts on the channel, and log it unfiltered",
    "place": "measure how far the accelerometer sits from the centre of gravity",
    "turned": "level the instrument on the ground, and compare its axes with a plumb line",
}


def error_in_words(name: str, size: float, std: float) -> str:
    """Return what an error means, CHANNEL_KIND or CHANNEL_bias; see :func:`fault_in_words`."""
    return fault_in_words(InstrumentFault(*name.rpartition("_")[::2], 0.0, size, std))


def fault_in_words(fault: InstrumentFault) -> str:
    """Return what an error means, e.g. "the pitch-rate gyro reads 14.9 +- 1.2 % too little"."""
    what, size = _INSTRUMENTS.get(fault.channel, fault.channel), abs(fault.estimate)
    if fault.channel in _WINDS:
        return f"the air moves {with_error(size, fault.std)} m/s {_way(fault, *_WINDS[fault.channel])}"
    if fault.kind == "bias":
        factor, unit = shown_unit(fault.channel)
        much = _way(fault, "much", "little")
        return f"the {what} reads {with_error(factor * size, factor * fault.std)} {unit} too {much}"
    if fault.kind == "scale":
        return f"the {what} reads {with_error(100 * size, 100 * fault.std)} % too {_way(fault, 'much', 'little')}"
    if fault.kind == "late":
        return f"the clock of the {what} is {with_error(1e3 * size, 1e3 * fault.std)} ms {_way(fault, 'late', 'early')}"
    if fault.kind == "lag":
        return f"the {what} lags with a time constant of {with_error(1e3 * size, 1e3 * fault.std)} ms"
    if fault.kind == "place":
        where = _way(fault, "ahead of", "behind")
        other = " (or the vane as far the other way)" if fault.channel == "az" else ""
        return f"the {what} sits {with_error(size, fault.std)} m {where} the centre of gravity{other}"
    return f"the axis of the {what} is turned by {with_error(size / DEG_RAD, fault.std / DEG_RAD)} deg"


def _way(fault: InstrumentFault, more: str, less: str) -> str:
    return more if fault.estimate >= 0.0 else less


def settled_by(fault: InstrumentFault) -> str:
    """Return what would settle whether an instrument has this error."""
    return _SETTLED[fault.kind]


def agreement_in_words(found: Agreement) -> list[str]:
    """Return what is known of the instruments: what is wrong, what else it may be, and what would settle it."""
    if not found.compared:
        return ["no kinematic relation connects these channels: no instrument can be checked"]
    out = []
    likely = [f for f in found.faults if f.probability > _TIED][:_NAMED]
    first, others = (likely[0] if likely else None), likely[1:]
    if not found.contradicted:
        out.append(
            f"kinematics do not contradict {', '.join(found.instruments)}: they agree with a probability of "
            f"{found.p_agree:.2g}"
        )
        if first is not None:
            out.append(f"check this first: {fault_in_words(first)}, with a probability of {first.probability:.2g}")
    elif first is None or found.p_unknown > first.probability:
        out.append(
            f"kinematics contradict the instruments ({', '.join(found.instruments)}), and no single error explains this"
        )
    else:
        out.append(f"kinematics show that {fault_in_words(first)}, with a probability of {_probability(first)}")
    if others and first is not None:
        out.append(
            "it may also be that " + ", or that ".join(f"{fault_in_words(f)} ({f.probability:.2g})" for f in others)
        )
    if first is not None:
        out.append(f"to decide: {settled_by(first)}")
    if found.gusty:
        out.append(
            f"gusts moved {' and '.join(found.gusty)}: their instruments could not be compared; repeat in calm air"
        )
    return out


def taken_in_words(found: Agreement, taken: Mapping[str, float]) -> Iterator[str]:
    """Yield which small errors of sound instruments were taken out of the records before anything was identified."""
    for name, size in taken.items():
        std = math.sqrt(found.errors_covariance[(at := found.errors.index(name)), at])
        yield (
            f"kinematics show that {error_in_words(name, size, std)}, within the errors of sound instruments: this is "
            "corrected"
        )


def _probability(fault: InstrumentFault) -> str:
    return "above 0.999" if fault.probability > 0.999 else f"{fault.probability:.2g}"


def contradiction(found: Agreement, channels: Sequence[str]) -> str:
    """Return the channel whose instrument kinematics contradict, if it is among ``channels``; else "".

    Where no single instrument is to blame it is the most probable one.
    """
    if not found.contradicted:
        return ""
    blamed = found.fault.channel if found.fault is not None else next(iter(found.by_instrument), "")
    return blamed if blamed in channels else ""


def in_doubt(derivatives: Sequence[FoundDerivative], channel: str) -> tuple[FoundDerivative, ...]:
    """Return derivatives of which none is determined, as an instrument that they come from is contradicted.

    Whatever else its residuals put in doubt, the instrument is the reason to look at first.
    """
    why = f"{channel} contradicted"
    return tuple(replace(d, believed=why) if d.determined or d.believed == "in doubt" else d for d in derivatives)


def widened(
    fault: InstrumentFault, was: Sequence[FoundDerivative], now: Sequence[FoundDerivative]
) -> Iterator[FoundDerivative]:
    """Yield corrected derivatives whose errors hold that of the correction: what it moved them by, in its own share."""
    before = {(d.case, d.name): d.value for d in was}
    for d in now:
        moved = d.value - before.get((d.case, d.name), d.value)
        yield replace(d, std=math.hypot(d.std, moved * fault.std / fault.estimate))


def corrected_in_words(fault: InstrumentFault, was: Sequence[FoundDerivative], now: Sequence[FoundDerivative]) -> str:
    """Return what the derivatives become where the error is taken out of the records."""
    before = {(d.case, d.name): d for d in was}
    moved = [d for d in now if d.determined and (d.case, d.name) in before]
    moved.sort(key=lambda d: -abs(d.value - before[d.case, d.name].value) / max(d.std, 1e-300))
    said = [f"{d.name} {with_error(d.value, d.std)} (was {number(before[d.case, d.name].value)})" for d in moved[:6]]
    size = f"{fault.name} = {fault.estimate:.3g}"
    if not said:
        return f"after correction of the records ({size}) no derivative is determined"
    return f"after correction of the records ({size}): {', '.join(said)}"


def doubts_of(found: Agreement) -> list[Advice]:
    """Return the doubts that belong to derivatives from instruments that are contradicted."""
    return [doubt(CONTRADICTED, text) for text in agreement_in_words(found)[1:]] if found.contradicted else []
