"""A planned input as a Lua script for ArduPilot Plane: elevator, aileron and rudder sequences on a start switch.

The script is the settings of one card followed by ``sequence.lua``, which is the same for all. It uses the scripting
interface of Plane 4.1 and later, as its generated documentation (libraries/AP_Scripting/docs/docs.lua) gives it, and
the functions of servos and the reckoning of pulses of SRV_Channel and of ArduPlane's mixer (servos.cpp). Scripting
reaches some 30 to 50 Hz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import LimitError
from testbench.core.escape import lua_comment
from testbench.core.record import FloatArray
from testbench.evaluation.derivatives import lift_per_rad
from testbench.questions.plan.injection.signal_table import SURFACES, injected_signal
from testbench.questions.plan.result import Card
from testbench.questions.plan.scenario import Autopilot

_BODY = Path(__file__).with_name("sequence.lua")
# ArduPilot counts nose up, right wing down and nose right as positive.
SURFACE_NAMES = {"de": ("elevator", -1), "da": ("aileron", 1), "dr": ("rudder", -1)}
"""Surface -> its name, and the sign from the testbench's deflection to the autopilot's demand."""
WATCHED = {"V": "airspeed", "h": "height", "phi": "bank", "theta": "pitch", "az": "load factor", "alpha": "alpha"}
"""Channel -> what a script calls the quantity that it watches."""


def injectable(card: Card) -> bool:
    """Say whether a script can fly the card: it moves surfaces only, and is not refused."""
    return card.status != "refused" and "thr" not in card.spec.controls


def lua_script(card: Card, aircraft: Aircraft, autopilot: Autopilot) -> str:
    """Return the script that flies a card.

    Raises:
        LimitError: the card moves the throttle, which is left to the pilot or the autopilot, or it is refused.
        ScenarioError: the input cannot be sampled at the period of the autopilot.
    """
    if not injectable(card):
        raise LimitError(
            f"a script flies elevator, aileron and rudder of a card that is not refused, got {card.title} "
            f"({', '.join(card.spec.controls)}, {card.status})"
        )
    times_ms, rows = rows_of(card, autopilot.period_ms)
    alpha, load, slope = lift_curve(card)
    lines = [
        f"-- Card {card.number}: {lua_comment(card.title)}.",
        "-- Made by flight-testbench; play it in a simulator before it flies.",
        f"local CARD = {card.number}",
        f"local SWITCH_OPTION = {autopilot.switch_option}",
        f"local MODE = {autopilot.mode}",
        f"local PERIOD_MS = {autopilot.period_ms}",
        f"local SETTLE_MS = {round(1e3 * card.spec.settle_s)}",
        f"local DURATION_MS = {round(1e3 * card.spec.duration_s)}",
        f"local SPEED = {card.point.V_m_s:.3f}",
        f"local SPEED_WINDOW = {autopilot.speed_window_m_s:.3f}",
        f"local START_BANK_DEG = {autopilot.bank_at_start_deg:.2f}",
        f"local STICK_US = {autopilot.stick_us}",
        f"local TRIM_ALPHA_DEG, TRIM_LOAD, LOAD_PER_DEG = {alpha:.3f}, {load:.4f}, {slope:.5f}",
        "-- lowest and highest: true airspeed (m/s), height from the start (m), bank and pitch (deg), load factor (g),",
        "-- angle of attack (deg); what is not here the pilot watches",
        "local LIMITS = {",
        *(f"  ['{name}'] = {{ {low:.3f}, {high:.3f} }}," for name, (low, high) in watched_limits(card).items()),
        "}",
        "local SURFACES = {",
        *(
            _surface_line(name, j, card, aircraft, rows)
            for j, name in enumerate(SURFACES)
            if name in aircraft.controls and (autopilot.hold == "all" or name in card.spec.controls)
        ),
        "}",
        "-- time (ms) from which each row holds; deflections from trim (deg): elevator trailing edge down, aileron",
        "-- right wing down, rudder trailing edge left are positive",
        f"local T = {{ {', '.join(map(str, times_ms))} }}",
        "local D = {",
        *(
            f"  {{ {', '.join(f'{v:.5g}' for v in rows[:, j]) if n in card.spec.controls else ''} }},"
            for j, n in enumerate(SURFACES)
        ),
        "}",
        "",
    ]
    return "\n".join(lines) + _BODY.read_text(encoding="utf-8")


def heap_bytes(script: str) -> int:
    """Return the share of SCR_HEAP_SIZE that a script takes at most while it loads: five times its text."""
    return 1000 * -(-5 * len(script) // 1000)


def rows_of(card: Card, period_ms: int) -> tuple[list[int], FloatArray]:
    """Return the times (ms) from which each row of deflections (n, 3) holds, deg from trim: elevator, aileron, rudder.

    Raises:
        ScenarioError: the input cannot be sampled at this period.
    """
    signal = injected_signal(card, period_ms)
    u = np.zeros((len(signal.t_s), len(SURFACES)))
    for j, name in enumerate(SURFACES):
        if name in signal.channels:
            u[:, j] = signal.u[:, signal.channels.index(name)] / DEG_RAD
    u = np.round(u, 5) + 0.0
    changes = np.flatnonzero(np.any(np.diff(u, axis=0, prepend=np.full((1, len(SURFACES)), np.nan)) != 0.0, axis=1))
    return [round(1e3 * signal.t_s[k]) for k in changes], u[changes]


def _surface_line(name: str, column: int, card: Card, aircraft: Aircraft, rows: FloatArray) -> str:
    words, sign = SURFACE_NAMES[name]
    control = aircraft.controls[name]
    moved = name in card.spec.controls
    low, high = (min(rows[:, column].min(), 0.0), max(rows[:, column].max(), 0.0)) if moved else (0.0, 0.0)
    return (
        f"  {{ name = '{words}', column = {column + 1}, sign = {sign}, full_deg = {control.full / DEG_RAD:.4f}, "
        f"least_deg = {-control.low / DEG_RAD:.4f}, lowest = {low:.5g}, highest = {high:.5g}, "
        f"moved = {'true' if moved else 'false'} }},"
    )


def watched_limits(card: Card) -> dict[str, tuple[float, float]]:
    """Return what a script watches -> (lowest, highest): m/s, m from the start, deg, and g for the load factor."""
    out = {}
    for limit in card.limits:
        low, high = limit.low, limit.high
        if limit.channel in ("theta", "phi", "alpha"):
            low, high = low / DEG_RAD, high / DEG_RAD
        elif limit.channel == "h":
            low, high = low - card.point.trimmed.state["h"], high - card.point.trimmed.state["h"]
        elif limit.channel == "az":
            low, high = -high / G0_M_S2, -low / G0_M_S2
        if limit.channel in WATCHED:
            out[WATCHED[limit.channel]] = (low, min(high, 1e6))
    return out


def lift_curve(card: Card) -> tuple[float, float, float]:
    """Return alpha (deg) and load factor at the trim of a card, and the change of load factor per degree of alpha."""
    trimmed = card.point.trimmed
    slope = lift_per_rad(card.point.model, card.point.V_m_s) * DEG_RAD
    return trimmed.alpha / DEG_RAD, -trimmed.state["az"] / G0_M_S2, slope
