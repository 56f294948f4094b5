"""Servo effects of aileron and rudder: they are found again in data that they made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_fits import check_sizes, fits

from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS, SERVOS
from testbench.flight import FlightCondition, load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.search.point import Point
from testbench.sensors import load_suite

LATERAL = {e.name: e for (_, control), e in SERVOS.items() if control in ("da", "dr")}
SIZES = {
    "second_order_actuator": {"omega_rad_s": 15.0, "zeta": 0.6},
    "delayed_servo": {"delay_s": 0.04, "omega_rad_s": 15.0, "zeta": 0.6},
    "rate_limit": {"limit_rad_s": 0.3},
    "asymmetric_rate_limit": {"down_rad_s": 0.2, "up_rad_s": 0.4},
    "transport_delay": {"delay_s": 0.06},
    "free_play": {"width_rad": 0.02},
    "creeping_free_play": {"width_rad": 0.02, "creep_1_s": 2.0, "power": 1.5},
    "dead_band": {"half_width_rad": 0.008},
    "surface_scale": {"scale": 0.8},
    "one_sided_linkage": {"scale": 0.7},
    "curved_linkage": {"scale": 0.7, "loss_per_rad2": 20.0},
}


def sized(name: str) -> dict[str, float]:
    return SIZES[name.removeprefix("aileron_").removeprefix("rudder_")]


def believe() -> Believed:
    suite = replace(load_suite("eolo_gap_lateral"), rate_hz=50.0)
    return Believed(load_aircraft("taurus", "rigid"), suite, FlightCondition(15.0, 100.0), 100.0)


def commands(suite_hz: float = 50.0) -> tuple[FlightRecord, ...]:
    """Return records that hold commands only: doublets of two sizes of aileron, then of rudder."""
    t = np.arange(round(6.0 * suite_hz)) / suite_hz
    sizes = 0.05 * ((t > 1.0) & (t < 1.4)) - 0.05 * ((t >= 1.4) & (t < 1.8))
    sizes = sizes + 0.02 * ((t > 3.5) & (t < 3.9)) - 0.02 * ((t >= 3.9) & (t < 4.3))
    none = np.zeros_like(t)
    made = ({"da": sizes, "dr": none}, {"da": none, "dr": sizes})
    return tuple(
        FlightRecord(t_s=t, channels=("da_cmd", "dr_cmd"), data=np.column_stack([*u.values()]), kind="measured")
        for u in made
    )


@pytest.mark.parametrize(
    "name",
    [
        "aileron_dead_band",
        "rudder_curved_linkage",
        pytest.param("rudder_transport_delay", marks=pytest.mark.slow),
        pytest.param("aileron_rate_limit", marks=pytest.mark.slow),
    ],
)
def test_an_effect_is_found_again_in_data_that_it_made(name):
    """From noise-free records, nuisances free: no more than a fiftieth of the gap is left, its size to 5 %."""
    believed, effect = believe(), LATERAL[name]
    records = recorded(believed.with_effect(effect, sized(name)), commands())
    start = Point.at(believed, believed, tuple(records))
    (found,) = fits(believed, records, effect)
    assert found is not None
    assert found.chi2 < max(0.02 * start.chi2, 1.0)
    check_sizes(found, sized(name), 0.05)


def test_names_of_other_controls_say_whose_they_are():
    for name, effect in LATERAL.items():
        control = name.split("_")[0]
        assert effect.place == control
        assert "elevator" not in effect.title + effect.physics
        assert all(n.startswith(control) and n in LATERAL | EFFECTS for n in effect.contains)
