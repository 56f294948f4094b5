"""A planned input as a Lua script for ArduPilot Plane: elevator, aileron and rudder sequences on a start switch.

The script is the settings of one card followed by ``sequence.lua``, which is the same for all. It uses the scripting
interface of Plane 4.1 and later, as its generated documentation (libraries/AP_Scripting/docs/docs.lua) gives it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError
from testbench.core.escape import lua_comment
from testbench.questions.plan.injection.signal_table import SURFACES, injected_signal
from testbench.questions.plan.result import Card
from testbench.questions.plan.scenario import Autopilot

_BODY = Path(__file__).with_name("sequence.lua")
# ArduPilot counts nose up, right wing down and nose right as positive; SERVOn_FUNCTION numbers from its parameter list.
_SERVOS = {"de": ("elevator", 19, -1), "da": ("aileron", 4, 1), "dr": ("rudder", 21, -1)}
_UNLIMITED = {"V": (0.0, 1e3), "theta": (-89.0, 89.0), "phi": (-179.0, 179.0), "h": (-1e4, 1e4)}


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
    signal = injected_signal(card, autopilot.period_ms)
    u = np.zeros((len(signal.t_s), len(SURFACES)))
    for j, name in enumerate(SURFACES):
        if name in signal.channels:
            u[:, j] = signal.u[:, signal.channels.index(name)] / DEG_RAD
    u = np.round(u, 5) + 0.0
    changes = np.flatnonzero(np.any(np.diff(u, axis=0, prepend=np.full((1, len(SURFACES)), np.nan)) != 0.0, axis=1))
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
        *_limit_lines(card),
        "local SURFACES = {",
        *(
            f"  {{ name = '{_SERVOS[n][0]}', fn = {_SERVOS[n][1]}, sign = {_SERVOS[n][2]}, column = {j}, "
            f"full_deg = {0.5 * (aircraft.controls[n].full - aircraft.controls[n].low) / DEG_RAD:.4f} }},"
            for j, n in enumerate(SURFACES, 1)
            if n in aircraft.controls and (autopilot.hold == "all" or n in card.spec.controls)
        ),
        "}",
        "-- time (ms) from which each row holds; deflections from trim (deg): elevator trailing edge down, aileron",
        "-- right wing down, rudder trailing edge left are positive",
        f"local T = {{ {', '.join(str(round(1e3 * signal.t_s[k])) for k in changes)} }}",
        "local D = {",
        *(
            f"  {{ {', '.join(f'{v:.5g}' for v in u[:, j][changes]) if n in signal.channels else ''} }},"
            for j, n in enumerate(SURFACES)
        ),
        "}",
        "",
    ]
    return "\n".join(lines) + _BODY.read_text(encoding="utf-8")


def _limit_lines(card: Card) -> list[str]:
    """Return the limits that the script watches: true airspeed, height change, bank and pitch."""
    bands = dict(_UNLIMITED)
    for limit in card.limits:
        if limit.channel in bands:
            scale = 1.0 / DEG_RAD if limit.channel in ("theta", "phi") else 1.0
            at = card.point.trimmed.state["h"] if limit.channel == "h" else 0.0
            low, high = bands[limit.channel]
            bands[limit.channel] = (max(low, scale * (limit.low - at)), min(high, scale * (limit.high - at)))
    names = {"V": "SPEED", "theta": "PITCH_DEG", "phi": "BANK_DEG", "h": "CLIMB"}
    lines = []
    for channel, name in names.items():
        low, high = bands[channel]
        lines.append(f"local {name}_LOW, {name}_HIGH = {low:.3f}, {high:.3f}")
    return lines
