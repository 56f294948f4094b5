"""The limits of a plan at a point: those of its file, else those of the aircraft; each with its source.

Where the aircraft says nothing either, a careful value is taken, and the card says so. Sources: V >= 1.2 times the
stall speed is the usual least speed of a manoeuvre; 3.8 is the load factor of the normal category of CS-23.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from testbench.aircraft import Aircraft
from testbench.aircraft.model import ASSUMED, source_at
from testbench.core.atmosphere import air_density
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.evaluation.derivatives import lift_per_rad
from testbench.questions.plan.result import Point
from testbench.questions.plan.scenario import PlanLimits

_STALL_MARGIN = 1.2
_LOAD_FACTOR = (0.0, 2.0)  # judged: no push beyond weightlessness, about half of what CS-23 asks a structure to bear
_ANGLES_DEG = (30.0, 45.0)  # judged: bank and pitch that a pilot recovers from at once
_OF_THE_ANGLE = 0.5  # judged: the part of the aircraft's own limit on an angle that a manoeuvre uses
_SECONDS = 5.0  # judged: the height that is lost or won in this time of vertical flight is more than any run takes
GIVEN = "as the plan says"


@dataclass(frozen=True)
class Bounds:
    """Limits without gaps: ``sources`` says of each channel where its limit comes from."""

    limits: PlanLimits
    sources: dict[str, str]


def stall_speed_m_s(aircraft: Aircraft, point: Point) -> float | None:
    """Return the speed at which level flight takes the highest angle of attack of the aircraft, or None if it has none.

    An angle that was only assumed is none. From lift that is linear in alpha at the trim of the point:
    (V / V_s)^2 = 1 + dn/dalpha (alpha_max - alpha).
    """
    if "alpha" not in aircraft.limits or source_at(aircraft.limit_source("alpha"), "highest") == ASSUMED:
        return None
    room = aircraft.limits["alpha"][1] - point.trimmed.alpha
    ratio = 1.0 + lift_per_rad(point.model, point.V_m_s) * room
    return point.V_m_s / math.sqrt(ratio) if ratio > 0.0 else None


def slowest_level_m_s(aircraft: Aircraft, point: Point) -> float | None:
    """Return the slowest level flight found by trimming, at the density of the point; None if it was not sought."""
    if aircraft.level_V_m_s is None:
        return None
    return aircraft.level_V_m_s[0] * math.sqrt(air_density(aircraft.design_h_m) / air_density(point.h_m))


def bounds_at(
    limits: PlanLimits, aircraft: Aircraft, point: Point, field_m: float, onset_m_s: float | None = None
) -> Bounds:
    """Return the limits that hold at a point: what the plan leaves out comes from the aircraft.

    Args:
        limits: of the plan; what it gives stays.
        aircraft: its own limits bound alpha, beta, speed, bank and pitch.
        point: trim and linear model give the stall speed.
        field_m: height of the field above sea level.
        onset_m_s: speed of the onset of an elastic instability, which nothing may pass; None without one.
    """
    own, name = aircraft.limits, aircraft.name
    new: dict[str, object] = {}
    sources: dict[str, str] = {}

    def take(key: str, channel: str, value: object, source: str) -> None:
        """Take the value of the plan, or else this one."""
        if getattr(limits, key) is None:
            new[key] = value
            sources[channel] = source
        else:
            sources[channel] = GIVEN

    if "az" in own:
        low, high = own["az"]
        take("load_factor", "az", (-high / G0_M_S2, -low / G0_M_S2), aircraft.limit_source("az"))
    else:
        take("load_factor", "az", _LOAD_FACTOR, f"0 to 2 taken, {name} states none")
    if "alpha" in own:
        take("alpha_deg", "alpha", tuple(x / DEG_RAD for x in own["alpha"]), aircraft.limit_source("alpha"))
    elif limits.alpha_deg is not None:
        sources["alpha"] = GIVEN
    if "beta" in own:
        take("beta_deg", "beta", min(abs(x) for x in own["beta"]) / DEG_RAD, aircraft.limit_source("beta"))
    elif limits.beta_deg is not None:
        sources["beta"] = GIVEN
    for key, channel in (("bank_deg", "phi"), ("pitch_change_deg", "theta")):
        who = f"{name} allows" if channel not in aircraft.limit_sources else f"are {aircraft.limit_source(channel)}"
        take(key, channel, *_angle_deg(channel, own, who, name, point))
    above = max(point.h_m - field_m, 1.0)
    height = round(min(0.5 * above, _SECONDS * point.V_m_s), 1)
    words = "half the height above the field" if 0.5 * above <= _SECONDS * point.V_m_s else f"{_SECONDS:g} s of flight"
    take("height_change_m", "h", height, words)
    _speeds(limits, aircraft, point, new, sources)
    change = limits.speed_change_m_s
    fastest = [float(str(new.get("V_max_m_s") or limits.V_max_m_s or math.inf))]
    fastest += [point.V_m_s + change] if change is not None else []
    if onset_m_s is not None and onset_m_s < min(fastest):
        kept = [part for part in sources["V"].split("; ") if not part.startswith("highest")]
        sources["V"] = "; ".join([*kept, "highest: onset of the instability"])
    return Bounds(limits.model_copy(update=new), sources)


def _angle_deg(
    channel: str, own: Mapping[str, tuple[float, float]], who: str, name: str, point: Point
) -> tuple[float, str]:
    """Return the largest bank, or change of pitch, deg: half the aircraft's own limit, but 30 to 45 deg."""
    least, most = _ANGLES_DEG
    span = own.get(channel)
    if span is None:
        return least, f"{least:g} deg taken, {name} states none"
    trim = point.trimmed.state.get(channel, 0.0)
    room = min(span[1] - trim, trim - span[0]) / DEG_RAD
    taken = min(max(round(_OF_THE_ANGLE * room, 1), least), most)
    if taken >= room:
        return round(0.9 * room, 1), f"0.9 of the {room:.0f} deg that {who}"
    return taken, f"of the {room:.0f} deg that {who}"


def _speeds(
    limits: PlanLimits, aircraft: Aircraft, point: Point, new: dict[str, object], sources: dict[str, str]
) -> None:
    """Add the lowest and the highest speed: 1.2 stall speeds and the aircraft's limit, unless a change is given."""
    if limits.speed_change_m_s is not None:
        sources["V"] = GIVEN
        return
    low, high = aircraft.limits.get("V", (0.0, math.inf))
    stall = stall_speed_m_s(aircraft, point)
    slowest = slowest_level_m_s(aircraft, point)
    said = []
    if limits.V_min_m_s is not None:
        said.append("lowest: as the plan says")
    elif slowest is not None and slowest > max(low, _STALL_MARGIN * (stall or 0.0)):
        new["V_min_m_s"] = slowest
        said.append(f"lowest: slowest level flight, {slowest:.4g} m/s, found by trimming")
    elif stall is not None and _STALL_MARGIN * stall > low:
        new["V_min_m_s"] = _STALL_MARGIN * stall
        said.append(f"lowest: {_STALL_MARGIN:g} x {stall:.3g} m/s (stall)")
    elif low > 0.0:
        new["V_min_m_s"] = low
        said.append(f"lowest: {source_at(aircraft.limit_source('V'), 'lowest')}")
    else:  # nobody knows the stall: no slower than a tenth below the speed of the card
        new["V_min_m_s"] = 0.9 * point.V_m_s
        said.append("lowest: stall unknown, 10 % below the card's speed taken")
    if limits.V_max_m_s is not None:
        said.append("highest: as the plan says")
    elif math.isfinite(high):
        new["V_max_m_s"] = high
        said.append(f"highest: {source_at(aircraft.limit_source('V'), 'highest')}")
    else:
        new["V_max_m_s"] = 1.3 * point.V_m_s
        said.append("highest: no limit is stated, 30 % above the card's speed taken")
    sources["V"] = "; ".join(said)
