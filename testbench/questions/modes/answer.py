"""Modes found without an input, in sentences: what they are, how they compare, and on which data they rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from testbench.core.words import with_error
from testbench.estimators.operational.result import ASSUMPTION
from testbench.page.labels import number
from testbench.page.words import Line, advice_lines, counted, some

if TYPE_CHECKING:
    from testbench.estimators.operational import OperationalMode
    from testbench.evaluation.operational import ModeMatch
    from testbench.questions.modes.result import ModesResult


_WORTH = 1.02  # a step of less than this is no card
_LEADING = 4  # modes that the first sentence names, so that it can be read at once


def modes_answer(result: ModesResult) -> list[Line]:
    """Return what was found, how it compares with the aircraft, and on which data it rests, in sentences."""
    found = result.found
    q = found.quantile
    many, outputs = counted(len(found.modes), "mode"), len(found.channels)
    where = f"at {max(V for V, m in result.at.items() if m is not None):.3g} m/s " if result.at else ""
    lead = f"{many} found {where}in {found.duration_s:.0f} s of {outputs} outputs"
    if found.modes:
        lead += (
            f": {some([with_error(m.frequency_hz, q * m.frequency_std_hz) for m in found.modes], _LEADING, ', ')} Hz"
        )
    pieces = [f"{_frequency(m, q)} with damping {_damping(m, q)}" for m in found.modes]
    out = [*clearance_lines(result)]
    out += [f"with 95 % intervals: {'; '.join(pieces)}"] if pieces else []
    out += [_judged(match, q) for match in result.matches if match.true is not None and match.found is not None]
    band = found.settings["band_hz"]
    lost = [m.true for m in result.matches if m.found is None and m.true is not None]
    inside = [t.name for t in lost if band[0] <= t.frequency_hz <= band[1]]
    if inside:
        out.append(f"inside the band but not found: {'; '.join(inside)}")
    foreign = [m.found for m in result.matches if m.true is None and m.found is not None]
    out += [f"no mode of the linear model corresponds to the one at {number(m.frequency_hz)} Hz" for m in foreign]
    text = ASSUMPTION
    if result.corners_hz:
        corners = " and ".join(dict.fromkeys(number(f, 2) for f in result.corners_hz))
        text += f"; the break frequencies of this turbulence are {corners} Hz"
    heads = [lead] if not result.at else [_cleared(result), lead]
    lines = [Line("finding", finding) for finding in (*heads[1:], *out, text)]
    return [Line("lead", heads[0]), *lines, *advice_lines(found.advice)]


def _cleared(result: ModesResult) -> str:
    """Return whether a faster speed may be flown, and at which risk."""
    top, risk = max(result.at), f"{100.0 * result.risk:.2g} %"
    if result.onset is None or result.cleared_m_s < _WORTH * top:
        return f"NO-GO beyond {top:.3g} m/s: no speed worth a card is cleared at a risk of {risk}"
    return (
        f"GO to {result.cleared_m_s:.3g} m/s: the probability that flutter begins at or below it is at most {risk}, "
        f"after flights at {some([f'{V:.3g}' for V in result.at], _LEADING, ', ')} m/s"
    )


def clearance_lines(result: ModesResult) -> Iterator[str]:
    """Yield the posterior of the onset, the trend of each mode, and what to fly where nothing is cleared."""
    if result.onset is None:
        return
    low, middle, high = (result.onset.quantile(p) for p in (0.05, 0.5, 0.95))
    far = f"{high:.3g} m/s" if math.isfinite(high) else "no upper limit"
    yield (
        f"flutter begins at {middle:.3g} m/s in the median, with 90 % between {low:.3g} and {far}"
        if math.isfinite(middle)
        else f"flutter begins beyond {low:.3g} m/s with 95 %; these flights do not determine where"
    )
    if result.cleared_m_s < _WORTH * max(result.at):
        yield (
            f"fly {max(result.at):.3g} m/s once more and give all records together: more data narrow the posterior, "
            "unless the onset is near"
        )


def _frequency(mode: OperationalMode, q: float) -> str:
    return f"{with_error(mode.frequency_hz, q * mode.frequency_std_hz)} Hz"


def _damping(mode: OperationalMode, q: float) -> str:
    return with_error(mode.damping, q * mode.damping_std)


def _judged(match: ModeMatch, q: float) -> str:
    assert match.true is not None
    assert match.found is not None
    assert match.mac is not None
    inside = [
        abs(match.found.frequency_hz - match.true.frequency_hz) <= q * match.found.frequency_std_hz,
        abs(match.found.damping - match.true.damping) <= q * match.found.damping_std,
    ]
    words = {2: "both inside the intervals", 1: "one of them outside its interval", 0: "both outside the intervals"}
    return (
        f"{match.true.name}: the linear model has {number(match.true.frequency_hz)} Hz and damping "
        f"{number(match.true.damping)}, {words[sum(inside)]}; the MAC of the shapes is {match.mac:.3f}"
    )
