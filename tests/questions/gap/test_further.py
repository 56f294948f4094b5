"""Further effects of a path: where a search points, and what they name there."""

from __future__ import annotations

import numpy as np
import pytest
from axes import believe, commands

from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS, OTHER_SERVOS, Effect
from testbench.effects.base import together
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.effect_contract import recorded
from testbench.questions.gap.evidence.stepwise import FoundTerm, Regression
from testbench.questions.gap.evidence.vocabulary import Factor, Term
from testbench.questions.gap.further import named_in_path, pointed_to
from testbench.questions.gap.open_set import FirstLook
from testbench.questions.gap.search.fit import EffectFit
from testbench.questions.gap.search.name import name_effect

NOTHING = FirstLook()
LAG, DELAY, GAIN = (EFFECTS[f"rudder_{kind}"] for kind in ("lag", "transport_delay", "surface_scale"))


def naming(outcome: str, effect: Effect | None = None) -> Naming:
    """Return what is said where ``effect`` comes nearest; it is named if the outcome is "named"."""
    fits = () if effect is None else (EffectFit(effect, {"x": 1.0}, {}, 10.0, 900.0, 14.0, 0.9, {}),)
    names = (effect.name,) if effect is not None and outcome == "named" else ()
    return Naming(outcome, names, fits, 1000.0, 910.0, {}, 100, "")


def follows(*controls: str) -> FirstLook:
    found = tuple(FoundTerm("Cn", Term((Factor(c),)), 0.01, 0.001, 1.0) for c in controls)
    return FirstLook((), Regression(found, 5, {}, {}, {}))


@pytest.mark.parametrize(
    ("said", "first", "control"),
    [
        (naming("unexplained", LAG), NOTHING, "dr"),
        (naming("named", together(LAG, DELAY)), NOTHING, "dr"),  # two of one path are a form of a third
        (naming("unexplained", EFFECTS["mass_error"]), follows("thr", "da", "dr"), "da"),  # the surest with a surface
        (naming("unexplained"), follows("dr"), "dr"),
        (naming("unexplained"), follows("thr"), "thr"),
        (naming("unexplained", EFFECTS["thrust_lag"]), NOTHING, "thr"),
        (naming("named", EFFECTS["thrust_lag"]), NOTHING, ""),
        (naming("named", LAG), follows("dr"), ""),  # what is named by itself needs no other
        (naming("named", together(LAG, EFFECTS["aileron_lag"])), NOTHING, ""),
        (naming("no gap"), follows("da"), ""),
        (naming("unexplained", EFFECTS["actuator_lag"]), NOTHING, ""),  # the elevator's are in the library
        (naming("unexplained"), NOTHING, ""),
    ],
)
def test_what_comes_nearest_or_a_term_points_to_a_path(said, first, control):
    assert pointed_to(said, first) == control


@pytest.mark.slow
def test_a_servo_of_second_order_is_named_where_its_lag_points_to_its_path():
    """Nothing of the aileron is sought, and without further effects the lag leaves too much to be named."""
    believed = believe()
    truth = believed.with_effect(OTHER_SERVOS["rudder_second_order_actuator"], {"omega_rad_s": 8.0, "zeta": 0.4})
    records = recorded(truth, commands()[:1])
    said = name_effect(believed, records, effects={LAG.name: LAG})
    assert said.outcome == "unexplained"
    stages: list[str] = []
    more = {n: OTHER_SERVOS[n] for n in ("rudder_second_order_actuator", "aileron_second_order_actuator")}
    found, rest = named_in_path(said, None, NOTHING, believed, records, (), {LAG.name: LAG}, more, stages.append)
    assert found.names == ("rudder_second_order_actuator",)
    assert found.best.values["omega_rad_s"] == pytest.approx(8.0, rel=0.05)
    assert rest is None
    assert stages[0] == "seek further effects of the rudder's path"
    assert not any("aileron" in s for s in stages)


@pytest.mark.slow
def test_play_of_a_throttle_is_named_where_what_comes_nearest_is_of_the_thrust():
    believed = believe()
    truth = believed.with_effect(OTHER_SERVOS["throttle_free_play"], {"width": 0.1})
    t = np.arange(600) / 50.0
    thr = 0.25 * ((t > 1.0) & (t < 3.0)) - 0.08 * ((t > 4.0) & (t < 6.0)) + 0.05 * ((t > 7.0) & (t < 9.0))
    data = np.column_stack([np.zeros((600, 3)), thr])
    flown = FlightRecord(t_s=t, channels=("de_cmd", "da_cmd", "dr_cmd", "thr_cmd"), data=data, kind="measured")
    records = recorded(truth, (flown, commands()[2]))
    few = {n: EFFECTS[n] for n in ("thrust_lag", "thrust_scale")}
    said = name_effect(believed, records, effects=few)
    assert said.outcome == "unexplained"
    stages: list[str] = []
    more = {n: OTHER_SERVOS[n] for n in ("throttle_free_play", "throttle_rate_limit", "rudder_free_play")}
    found, _ = named_in_path(said, None, NOTHING, believed, records, (), few, more, stages.append)
    assert found.names == ("throttle_free_play",)
    assert found.best.values["width"] == pytest.approx(0.1, rel=0.03)
    assert stages[0] == "seek further effects of the throttle's path"


def test_what_further_effects_do_not_explain_stays_as_it_was():
    believed = believe()
    truth = believed.with_effect(EFFECTS["cubic_weathercock"], {"Cn_beta3": 5.0})
    records = recorded(truth, commands()[:1])
    said = naming("unexplained", LAG)
    more = {"rudder_dead_band": OTHER_SERVOS["rudder_dead_band"]}
    assert named_in_path(said, None, NOTHING, believed, records, (), {}, more, lambda stage: None) == (said, None)
