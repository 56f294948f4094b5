"""Survey an aircraft: the speeds at which it can fly, its trims and modes over them, and its derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from testbench.aircraft import Aircraft, ElasticMode
from testbench.core.blas import on_one_thread
from testbench.core.errors import TrimError
from testbench.core.named import Named, obtain
from testbench.evaluation.envelope import (
    _INTERVALS,
    _RESPONSE_SPEEDS,
    _SCAN,
    _TABLED,
    MOTIONS,
    Envelope,
    Untrimmed,
    fly_envelope,
)
from testbench.evaluation.modes import modes_by_law
from testbench.flight import FlightCondition, TrimmedFlight, linearise, trim
from testbench.page.shown import Shown


@dataclass(frozen=True)
class SpeedRange:
    """Slowest and fastest speed that can be trimmed, m/s, on a grid of ``step_m_s``, and what ends the range."""

    slowest: float
    fastest: float
    step_m_s: float
    beyond: tuple[Untrimmed, ...] = ()

    def tabled(self) -> list[float]:
        """Return ten to about twenty speeds for a table: both ends, and round values between them."""
        width = self.fastest - self.slowest
        step = next((s for s in _round_steps(width) if width / s >= _TABLED - 1), None)
        if step is None:
            return [self.slowest]
        first, last = math.floor(self.slowest / step) + 1, math.ceil(self.fastest / step) - 1
        return [self.slowest, *(round(k * step, 9) for k in range(first, last + 1)), self.fastest]

    def followed(self) -> list[float]:
        """Return the speeds over which modes are followed: evenly spaced, both ends included."""
        return [float(V) for V in np.linspace(self.slowest, self.fastest, _INTERVALS + 1)]


def _round_steps(width: float) -> list[float]:
    if width <= 0.0:
        return []
    power = math.floor(math.log10(width))
    return [m * 10.0**p for p in (power, power - 1, power - 2) for m in (5.0, 2.0, 1.0)]


def speed_range(aircraft: Aircraft, h_m: float | None = None) -> SpeedRange:
    """Return the range of speeds about the design speed that can be trimmed within the aircraft's limits.

    Limits without a speed count as half to twice the design speed. Bisection finds the ends, on a grid of a hundredth
    to a thousandth of the width of the limits.

    Raises:
        TrimError: no speed within the limits can be trimmed.
    """
    height, aircraft = aircraft.design_h_m if h_m is None else h_m, aircraft.commanded_at("surface")
    design = aircraft.design_V_m_s
    low, high = aircraft.limits.get("V", (0.5 * design, 2.0 * design))
    step = 10.0 ** (math.floor(math.log10(high - low)) - 2)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    reasons: dict[int, str | None] = {}
    trims: dict[int, TrimmedFlight] = {}

    def flies(k: int) -> bool:
        """Return whether speed ``k * step`` trims, from the nearest trim that is known; keep the reason if not."""
        if k not in reasons:
            near = trims[min(trims, key=lambda i: abs(i - k))] if trims else None
            try:
                trims[k] = trim(aircraft, FlightCondition(round(k * step, 9), height), near=near)
                reasons[k] = None
            except TrimError as error:
                reasons[k] = error.message
        return reasons[k] is None

    tried = [round(k) for k in np.linspace(first, last, _SCAN)]
    centre = min(max(round(design / step), first), last)
    good = [k for k in (centre, *sorted(tried, key=lambda k: abs(k - centre))) if flies(k)]
    if not good:
        raise TrimError(
            f"{aircraft.name} must trim at a speed within its limits, {low:g} to {high:g} m/s, but at {height:g} m "
            f"none of {len(reasons)} speeds does; at {round(centre * step, 9):g} m/s: {reasons[centre]}"
        )
    ends: list[int] = []
    beyond: list[Untrimmed] = []
    for limit, sign in ((first, -1), (last, 1)):
        inside = good[0]
        outside: int | None = None
        for k in sorted((k for k in {*tried, limit} if sign * (k - good[0]) > 0), key=lambda k: sign * k):
            if not flies(k):
                outside = k
                break
            inside = k
        while outside is not None and abs(outside - inside) > 1:
            middle = (inside + outside) // 2
            inside, outside = (middle, outside) if flies(middle) else (inside, middle)
        ends.append(inside)
        if outside is not None:
            beyond.append(Untrimmed(round(outside * step, 9), str(reasons[outside])))
    return SpeedRange(round(ends[0] * step, 9), round(ends[1] * step, 9), step, tuple(beyond))


@dataclass(frozen=True, eq=False)
class Survey(Shown, page="testbench.questions.aircraft.page:aircraft_page"):
    """An envelope, with the speeds of its tables and frequency responses.

    Attributes:
        name: folder name of the aircraft.
        envelope: trims, models and modes at many speeds, those below included.
        range: speeds that can be trimmed.
        tabled: speeds of the tables, m/s, all trimmed.
        responses: speeds of the frequency responses, m/s, all trimmed.
        untrimmed: speeds that cannot be flown: asked for, or at the ends of the range.
        by_law: mode -> its poles at the design speed where the model's own control law flies; empty if it has
            none.
    """

    name: str
    envelope: Envelope
    range: SpeedRange
    tabled: tuple[float, ...]
    responses: tuple[float, ...]
    untrimmed: tuple[Untrimmed, ...]
    by_law: Mapping[str, tuple[complex, ...]] = field(default_factory=dict)

    @property
    def shaped(self) -> dict[int, ElasticMode]:
        """The flown elastic modes whose shape along the wing is known, by number."""
        flown = self.envelope.aircraft.flown_modes()
        if flown is None:
            return {}
        numbers = self.envelope.elastic.values()
        return {i: flown.modes[i - 1] for i in numbers if flown.modes[i - 1].shape is not None}

    def elevator_left(self, V_m_s: float) -> tuple[float, float]:
        """Return how far the elevator can turn from its trim, trailing edge up and down, rad; both are positive."""
        at = self.envelope.trims[self.envelope.nearest(V_m_s)].controls["de"]
        control = self.envelope.aircraft.controls["de"]
        return at - control.low, control.full - at


@on_one_thread
def survey(aircraft: Named[Aircraft], name: str = "") -> Survey:
    """Return the envelope of an aircraft over all speeds at which it can be trimmed, at its design altitude.

    Raises:
        TrimError: no speed within its limits can be trimmed.

    Example:
        >>> import testbench as tb
        >>> found = tb.survey(tb.load_aircraft("taurus"), "taurus")
        >>> sorted(found.envelope.aircraft.controls)
        ['da', 'de', 'dr', 'thr']
    """
    aircraft = obtain(Aircraft, aircraft)
    name = name or aircraft.name
    found = speed_range(aircraft)
    tabled = found.tabled()
    spread = sorted({tabled[round(k)] for k in np.linspace(0, len(tabled) - 1, 5)})
    wanted = _RESPONSE_SPEEDS.get(name, tuple(spread))
    envelope = fly_envelope(aircraft, [*found.followed(), *tabled, *wanted, aircraft.design_V_m_s])
    flown = set(envelope.speeds)
    refused = {u.V_m_s: u for u in (*found.beyond, *envelope.untrimmed)}
    return Survey(
        name,
        envelope,
        found,
        tuple(V for V in tabled if V in flown),
        tuple(V for V in wanted if V in flown),
        tuple(refused[V] for V in sorted(refused)),
        _by_law(envelope),
    )


def _by_law(envelope: Envelope) -> dict[str, tuple[complex, ...]]:
    """Return the poles of all modes at the design speed under the model's own control law, if it has one."""
    flown = envelope.aircraft.commanded_at("stick")
    if not flown.under_law:
        return {}
    model = linearise(flown, envelope.trims[envelope.design])
    out: dict[str, tuple[complex, ...]] = {}
    for motion in MOTIONS:
        members = {envelope.elastic[n]: n for n in envelope.names(motion, elastic=True)}
        out |= modes_by_law(model, motion, members)
    return out
