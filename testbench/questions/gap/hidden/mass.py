"""Hidden loads, and a centre of gravity that is not where it is believed.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Insert, SetText
from testbench.questions.gap.hidden.truth import Truth
from testbench.sensors import Sensor

_PLACED = ("ax", "ay", "az")


def load(kg: float, aft_m: float) -> Truth:
    """Return the truth of a point mass on the centre line."""
    point = (
        f'<pointmass name="load"><weight unit="KG">{kg!r}</weight><location unit="M"><x>{aft_m!r}</x><y>0</y><z>0</z>'
        "</location></pointmass>"
    )
    return Truth(changes=(Insert("mass_balance", point),), extra_kg=kg)


def with_moved_accelerometers(truth: Truth, ahead_m: float) -> Truth:
    """Return the truth with all accelerometers so much further ahead of the centre of gravity than believed."""

    def read(s: Sensor) -> Sensor:
        return replace(s, position_m=(s.position_m[0] + ahead_m, *s.position_m[1:])) if s.channel in _PLACED else s

    return replace(truth, read=read)


def shifted(ahead_m: float) -> Truth:
    """Everything but the centre of gravity moves forward."""
    truth = Truth(changes=(SetText("metrics/location[@name='AERORP']/x", -ahead_m),))
    return with_moved_accelerometers(truth, ahead_m)
