"""Every sentence that is called out in flight, and the answer when it has ended."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from testbench.core.channels import CHANNELS
from testbench.core.constants import DEG_RAD
from testbench.page.words import Answer, grouped, listed
from testbench.questions.live.ask import LEAST_HZ
from testbench.questions.live.stream import REQUESTS

if TYPE_CHECKING:
    from testbench.questions.live.ask import Call, Session
    from testbench.questions.live.clock import Rate
    from testbench.questions.live.track import Estimate

_GOOD_HZ = 25.0
"""Ten samples a period of a short period of 2.5 Hz: an aircraft that one holds in the hand has a slower one."""
_LONGEST_S = 300.0  # of manoeuvres that anybody repeats
_NEEDED = ("p", "q", "r", "phi", "theta", "alpha", "beta", "az", "V", "de", "da", "dr", "de_cmd", "da_cmd", "dr_cmd")


_EXPLAINED = {
    "gain": "{of} has {value:.2g} of the effect that is expected",
    "late": "{of} acts some {value:.2g} s later than expected",
    "reads": "{of} has the wrong sign: check its instrument",
    "other": "the aircraft does not answer as the believed one, nor as one within its uncertainty",
}


def _likely(p: float) -> str:
    return "" if p > 0.99 else f" ({100.0 * p:.0f} % likely)"


def sized(name: str, value: float) -> str:
    """Return a value of a channel with its unit; angles in degrees, the load factor as it is."""
    if name == "nz":
        return f"{value:.2f} g"
    unit = CHANNELS[name].unit
    if unit.startswith("rad"):
        return f"{value / DEG_RAD:.3g} {unit.replace('rad', 'deg')}"
    return f"{value:.3g}" + ("" if unit == "1" else f" {unit}")


def called(call: Call) -> str:
    """Return what is called out, in one sentence."""
    if call.kind == "limit":
        return f"limit: {call.channel} is {sized(call.channel, call.value)}, beyond {sized(call.channel, call.other)}"
    if call.kind == "stop":
        return f"stop: {_EXPLAINED[call.words].format(of=call.channel, value=call.value)}{_likely(call.other)}"
    if call.kind == "change":
        return f"stop: {call.words}"
    if call.kind == "instrument":
        if call.words == "frozen":
            return f"stop: {call.channel} stands still at {sized(call.channel, call.value)}: check its instrument"
        return f"stop: the airspeed is {call.value:+.2g} m/s off what the forces make of it: check the pitot tube"
    if call.kind == "careful":
        return f"{call.channel}, careful: {call.words}"
    if call.kind == "enough":
        after = f": next card {call.words}" if call.words else ": go on to the next card"
        return f"you have it: the {call.channel} derivatives are as accurate as wanted{after}"
    if call.kind == "next":
        if not call.channel:
            return f"nothing is left to fly: {call.words or 'all that is wanted is known'}"
        what = f": {call.words}" if call.words else ""
        return f"next card {call.channel}{what}; {call.value:.0f} s of flight left, {call.other:.0f} s as printed"
    after = f"; next card {call.other:.0f}" if call.other else "; no card is left"
    flown = "was flown as it says" if not call.words else f"must be flown again: {call.words}"
    return f"card {call.channel} {flown}{after}"


def estimate_line(e: Estimate) -> str:
    """Return a derivative, its error, and the one that is wanted, as said over the radio."""
    text = f"{e.name} {e.value:.3g}, {100.0 * e.std / max(abs(e.value), 1e-12):.2g} %"
    if e.believed is not None:
        text += f" (believed {e.believed:.3g})"
    if not e.wanted:
        return text
    aim = 100.0 * e.wanted / max(abs(e.believed or e.value), 1e-12)
    return f"{text}: as wanted" if e.reached else f"{text}: {aim:.2g} % is wanted, {more(e.more_s)}"


def more(seconds: float | None) -> str:
    """Return how long it takes until a derivative is as accurate as wanted."""
    if seconds is None:
        return "how soon is told after a manoeuvre of each control"
    if seconds > _LONGEST_S:
        return "larger manoeuvres are needed"
    return f"in {max(seconds, 1.0):.0f} s of such manoeuvres"


def link_lines(rates: Mapping[str, Rate], told: Mapping[str, str], radio: bool) -> Iterator[str]:
    """Yield what the link gives, what can be told from it, and which message rates would do better."""
    groups = grouped({n: f"{rate.hz:.3g} Hz, {100.0 * rate.lost:.1f} % lost" for n, rate in rates.items()})
    yield "link: " + "; ".join(f"{listed(names)} at {what}" for what, names in groups.items())
    for plane, why in told.items():
        if why:
            yield f"{plane} derivatives cannot be told: {why}; limits and instruments are watched"
    used = [rates[n].hz for n in _NEEDED if n in rates and rates[n].hz >= LEAST_HZ]
    if not all(told.values()) and min(used) < _GOOD_HZ:
        yield (
            f"at {min(used):.3g} Hz the estimates hold motions below {0.2 * min(used):.2g} Hz; for all of a short "
            f"period {_GOOD_HZ:g} Hz or more are needed: record on board"
        )
    slow = any(told.values()) or (bool(used) and min(used) < _GOOD_HZ)
    if radio and slow:
        asks = ", ".join(f"{name} (SET_MESSAGE_INTERVAL {number} 20000)" for name, number in REQUESTS.items())
        yield f"nothing is sent; to have 50 Hz, let the ground station request {asks}, on a link that carries it"


def live_answer(session: Session) -> Answer:
    """Return what the flight told, in sentences."""
    stops = [c for c in session.calls if c.kind in ("stop", "instrument", "change", "limit")]
    found = [(plane, session.latest(plane)) for plane in ("longitudinal", "lateral")]
    some = [(plane, [e for e in estimates if e.wanted]) for plane, estimates in found if estimates]
    out = []
    for plane, estimates in some:
        have = [e for e in estimates if e.reached]
        off = [e for e in estimates if e.believed is not None and abs(e.value - e.believed) > 1.5 * e.half]
        out.append(
            f"{plane}: {len(have)} of {len(estimates)} derivatives as accurate as wanted"
            + (f"; not as believed: {listed([e.name for e in off])}" if off else "; as believed within their errors")
        )
    if not some:
        out.append("no derivatives: " + ("no control moved" if not all(session.told.values()) else "see the link"))
    out += [f"{c.t_s:.1f} s: {called(c)}" for c in stops[:6]]
    if len(stops) > 6:
        out.append(f"{len(stops) - 6} more calls are in the table")
    out += link_lines(session.rates, session.told, False)
    return [*out, *session.notes]
