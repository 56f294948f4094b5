"""A planned input as a Python script that sends it to PX4 over MAVLink: the settings of one card and ``sender.py``.

``sender.py`` is the same for every card; its docstring says what PX4 accepts in which version. The settings go in as
JSON, so that no text of a plan becomes code.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.core.atmosphere import air_density
from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError
from testbench.core.escape import one_line
from testbench.questions.plan.injection.lua import SURFACE_NAMES, injectable, lift_curve, rows_of, watched_limits
from testbench.questions.plan.injection.signal_table import SURFACES
from testbench.questions.plan.result import Card
from testbench.questions.plan.scenario import Autopilot

_BODY = Path(__file__).with_name("sender.py")
_PLACE = "SETTINGS: dict[str, Any] = {}"
_AXES = ("da", "de", "dr")  # roll, pitch, yaw


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
    body = _BODY.read_text(encoding="utf-8")
    assert body.count(_PLACE) == 1
    return body.replace(_PLACE, f"SETTINGS: dict[str, Any] = json.loads(\n    {text!r}\n)").replace(
        "import argparse\n", "import argparse\nimport json\n", 1
    )
