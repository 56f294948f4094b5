"""A planned input as what flies it: a Lua script for ArduPilot Plane, a MAVLink sender for PX4, a table for any other.

The Lua script plays sequences of elevator, aileron and rudder on a start switch. It is the settings of one card, then
``sequence.lua``, which is the same for all. It uses the scripting interface of Plane 4.1 and later, as its generated
documentation (libraries/AP_Scripting/docs/docs.lua) gives it, and the functions of servos and the reckoning of pulses
of SRV_Channel and of ArduPlane's mixer (servos.cpp). Scripting reaches some 30 to 50 Hz.
"""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.atmosphere import air_density
from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.core.errors import LimitError
from testbench.core.escape import lua_comment, one_line
from testbench.core.record import FloatArray
from testbench.evaluation.derivatives import lift_per_rad
from testbench.inputs import InputSignal, build
from testbench.questions.plan.response import scaled
from testbench.questions.plan.result import Card
from testbench.questions.plan.scenario import Autopilot

_SENDER = Path(__file__).with_name("sender.py")
_PLACE = "SETTINGS: dict[str, Any] = {}"
_AXES = ("da", "de", "dr")  # roll, pitch, yaw
SURFACES = ("de", "da", "dr")
_SEQUENCE = Path(__file__).with_name("sequence.lua")
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
    return "\n".join(lines) + _SEQUENCE.read_text(encoding="utf-8")


def heap_bytes(script: str) -> int:
    """Return the share of SCR_HEAP_SIZE that a script takes at most while it loads: five times its text."""
    return 1000 * -(-5 * len(script) // 1000)


def rows_of(card: Card, period_ms: int) -> tuple[list[int], FloatArray]:
    """Return the times (ms) from which each row of deflections (n, 3) holds, deg from trim: elevator, aileron, rudder.

    Raises:
        ScenarioError: the input cannot be sampled at this period.
    """
    signal = injected_signal(card, period_ms)
    u = np.round(signal.columns(SURFACES) / DEG_RAD, 5) + 0.0
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


# --- a signal as a table ----------------------------------------------------------------------------------------------


def injected_signal(card: Card, period_ms: int) -> InputSignal:
    """Return what a card commands, sampled every ``period_ms`` and held; deviations from trim, SI.

    Raises:
        ScenarioError: the input cannot be sampled so slowly.
    """
    factor = card.factor if card.factor > 0.0 else 1.0
    return build(scaled(card.spec.input, factor), card.spec.duration_s, 1e3 / period_ms)


def signal_csv(signal: InputSignal, aircraft: Aircraft) -> str:
    """Return a signal as CSV: time in s, deviations from trim in deg (throttle in %) and over full deflection, -1 to 1.

    Signs are those of the testbench: elevator trailing edge down, aileron right wing down, rudder trailing edge left.
    Each row holds until the next one. All three surfaces have columns; one that does not move is zero.
    """
    names = (*SURFACES, *(("thr",) if "thr" in signal.channels else ()))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    shown = [f"{n}_percent" if n == "thr" else f"{n}_deg" for n in names]
    writer.writerow(["time_s", *shown, *(f"{n}_norm" for n in names)])
    units = [PERCENT if n == "thr" else DEG_RAD for n in names]
    ends = [
        (aircraft.controls[n].low, aircraft.controls[n].full) if n in aircraft.controls else (-1.0, 1.0) for n in names
    ]
    for t, row in zip(signal.t_s, signal.columns(names), strict=True):
        writer.writerow(
            [
                f"{t:.4f}",
                *(f"{v / unit + 0.0:.5f}" for v, unit in zip(row, units, strict=True)),
                *(f"{_share(v, *end) + 0.0:.6f}" for v, end in zip(row, ends, strict=True)),
            ]
        )
    return out.getvalue()


def _share(value: float, low: float, high: float) -> float:
    """Return a deflection as a share of the throw to its side, -1 to 1."""
    return value / high if value >= 0.0 or low >= 0.0 else -value / low


# --- PX4 --------------------------------------------------------------------------------------------------------------


def sender_settings(card: Card, aircraft: Aircraft, autopilot: Autopilot) -> dict[str, object]:
    """Return the settings of a card as the sender takes them: SI, angles in deg, demands of whole throws.

    Raises:
        LimitError: the card moves the throttle, which stays with the pilot, or it is refused.
        ScenarioError: the input cannot be sampled at the period of the autopilot.
    """
    if not injectable(card):
        raise LimitError(
            f"a script flies elevator, aileron and rudder of a card that is not refused, got {card.title} "
            f"({', '.join(card.spec.controls)}, {card.status})"
        )
    times_ms, rows = rows_of(card, autopilot.period_ms)
    demands = [[_demand(n, row[SURFACES.index(n)], aircraft) for n in _AXES] for row in rows]
    return {
        "card": card.number,
        "title": one_line(card.title),
        "interface": autopilot.interface,
        "switch_channel": autopilot.switch_channel,
        "period_ms": autopilot.period_ms,
        "settle_s": card.spec.settle_s,
        "duration_s": card.spec.duration_s,
        "speed_m_s": card.point.V_m_s,
        "window_m_s": autopilot.speed_window_m_s,
        "bank_deg": autopilot.bank_at_start_deg,
        "stick_us": autopilot.stick_us,
        "eas2tas": round(math.sqrt(air_density(0.0) / air_density(card.point.h_m)), 5),
        "lift_curve": [round(x, 5) for x in lift_curve(card)],
        "limits": {name: [round(x, 4) for x in limit] for name, limit in watched_limits(card).items()},
        "times_s": [t / 1000.0 for t in times_ms],
        "demands": demands,
    }


def _demand(name: str, degrees: float, aircraft: Aircraft) -> float:
    """Return a deflection as PX4 counts it: 1 is full throw, rolling right, nose up, nose right."""
    if name not in aircraft.controls or degrees == 0.0:
        return 0.0
    control = aircraft.controls[name]
    full = control.full if degrees > 0.0 else -control.low
    return round(float(SURFACE_NAMES[name][1] * degrees * DEG_RAD / full), 6)


def px4_script(card: Card, aircraft: Aircraft, autopilot: Autopilot) -> str:
    """Return the script that flies a card.

    Raises:
        LimitError, ScenarioError: as :func:`sender_settings`.
    """
    text = json.dumps(sender_settings(card, aircraft, autopilot), allow_nan=False)
    body = _SENDER.read_text(encoding="utf-8")
    assert body.count(_PLACE) == 1
    return body.replace(_PLACE, f"SETTINGS: dict[str, Any] = json.loads(\n    {text!r}\n)").replace(
        "import argparse\n", "import argparse\nimport json\n", 1
    )
