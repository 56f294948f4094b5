"""The recipe that the channels of a record allow, and that what it writes identifies at once."""

import tomllib

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.questions.importing.recipe import LATE_STD_S, lines, propose

LONGITUDINAL = ("V", "alpha", "q", "theta", "az", "h")


def record(*channels: str, still: tuple[str, ...] = ()) -> FlightRecord:
    t = np.arange(200) * 0.02
    columns = [np.full(200, 20.0) if n in still else 20.0 * (n == "V") + np.sin(t + i) for i, n in enumerate(channels)]
    return FlightRecord(t, channels, np.column_stack(columns), "measured")


def entry(inputs: tuple[str, ...], *channels: str, still: tuple[str, ...] = ()):
    recipe = propose(inputs, [record(*inputs, *channels, still=still)], 50.0)
    assert recipe is not None
    return recipe, recipe.estimators[0][1]


def test_all_four_states_give_the_whole_longitudinal_motion():
    recipe, found = entry(("de",), *LONGITUDINAL)
    assert found == {
        "method": "output_error",
        "structure": "longitudinal",
        "late_std_s": {"de": LATE_STD_S},
        "output_biases": ["q"],
    }
    assert recipe.outputs == ("V", "alpha", "q", "theta")
    assert recipe.left_out == ("az", "h")
    assert recipe.servos == ()


@pytest.mark.parametrize(
    ("channels", "still", "outputs", "settings"),
    [
        (
            ("V", "q", "theta", "az"),
            (),
            ("q", "az"),
            {
                "structure": "longitudinal",
                "short": True,
                "fixed": ["Z_0"],
                "start": {"Z_q": 0.0},
                "prior_std": {"Z_q": 2.0},
                "bounds": {"Z_alpha": [-600.0, 0.0]},
            },
        ),
        (("V", "alpha", "q"), (), ("alpha", "q"), {"structure": "longitudinal", "short": True}),
        (("V", "alpha", "q", "theta"), ("V",), ("alpha", "q"), {"structure": "longitudinal", "short": True}),
        (("alpha", "q", "theta"), (), ("alpha", "q"), {"structure": "short_period"}),
    ],
)
def test_what_is_missing_makes_the_structure_smaller_and_constants_that_do_not_show_are_fixed(
    channels, still, outputs, settings
):
    recipe, found = entry(("de",), *channels, still=still)
    assert recipe.outputs == outputs
    assert found == {"method": "output_error", **settings, "late_std_s": {"de": LATE_STD_S}}


@pytest.mark.parametrize("channels", [("q", "theta"), ("q", "theta", "az"), ("V", "q", "theta")])
def test_without_alpha_or_az_and_speed_a_model_without_derivatives_is_proposed(channels):
    recipe, found = entry(("de",), *channels)
    assert found["method"] == "dsr_e"
    assert recipe.outputs == tuple(n for n in channels if n != "V")


@pytest.mark.parametrize(
    ("channels", "outputs", "fixed"),
    [
        (("V", "beta", "p", "r", "phi", "ay"), ("beta", "p", "r", "phi"), None),
        (("V", "p", "r", "phi", "ay"), ("p", "r", "phi", "ay"), ["Y_0"]),
        (("V", "p", "r", "ay"), ("p", "r", "ay"), ["Y_0", "L_0"]),
    ],
)
def test_lateral_channels_give_lateral_derivatives(channels, outputs, fixed):
    recipe, found = entry(("da", "dr"), *channels)
    assert recipe.outputs == outputs
    assert found["structure"] == "lateral_directional"
    assert found.get("fixed") == fixed


@pytest.mark.parametrize(
    ("channels", "fixed", "believed"),
    [
        (("beta", "p", "r", "phi"), None, set()),
        (("p", "r", "phi"), ["Y_0"], {"alpha_trim", "Y_r", "Y_dr"}),
        (("V", "p", "r", "phi"), ["Y_0"], {"alpha_trim", "Y_r", "Y_dr", "g_V"}),
        (("p", "r"), ["Y_0", "theta_trim", "L_0"], {"alpha_trim", "Y_r", "Y_dr"}),
    ],
)
def test_without_speed_or_sideslip_lateral_derivatives_come_with_what_is_believed(channels, fixed, believed):
    recipe, found = entry(("da", "dr"), *channels)
    assert recipe.outputs == tuple(n for n in channels if n != "V")
    assert found["structure"] == "lateral_per_speed"
    assert found.get("fixed") == fixed
    assert set(found.get("prior_std", {})) == believed
    if "V" in channels:
        assert found["start"]["g_V"] == pytest.approx(9.81 / 20.0, rel=0.1)


def test_a_control_that_rests_has_no_parameters():
    _, found = entry(("da",), "p", "r", "phi")
    assert set(found["prior_std"]) == {"alpha_trim", "Y_r"}


@pytest.mark.parametrize(
    ("inputs", "channels", "order"),
    [(("da",), ("p",), 4), (("dr",), ("r", "phi"), 4), (("de",), ("q",), 2), (("de",), ("q", "theta"), 3)],
)
def test_a_model_without_derivatives_has_the_states_of_its_motion(inputs, channels, order):
    _, found = entry(inputs, *channels)
    assert (found["method"], found["order"]) == ("dsr_e", order)


def test_an_autopilots_phi_is_not_fitted_and_every_record_has_constants_of_its_own():
    recipe, found = entry(("da_cmd", "dr_cmd"), "V", "p", "r", "phi", "ay")
    assert recipe.outputs == ("p", "r", "ay")
    assert found["fixed"] == ["Y_0", "L_0", "N_0"]
    assert found["output_biases"] == ["p", "r", "ay"]
    recipe, found = entry(("de_cmd",), "V", "q", "theta", "az")
    assert recipe.outputs == ("q", "az")
    assert found["fixed"] == ["Z_0", "M_0"]
    assert found["output_biases"] == ["q", "az"]


def test_commands_get_servos_and_throttle_does_not():
    recipe, _ = entry(("de_cmd", "thr_cmd"), *LONGITUDINAL)
    assert recipe.servos == ("de_cmd",)


def test_a_servo_is_estimated_with_its_delay_about_what_is_believed_of_its_lag():
    recipe, found = entry(("da_cmd", "dr_cmd"), "V", "p", "r", "phi", "ay")
    assert found["start"] == {"tau_da": 0.05, "tau_dr": 0.05}
    assert found["prior_std"] == {"tau_da": 0.03, "tau_dr": 0.03}
    text = "\n".join(lines(recipe, ("da_cmd", "dr_cmd")))
    assert text.count('delay_s = "estimate"') == 2
    parsed = tomllib.loads(text)["identification"]["estimators"][0]
    assert parsed["prior_std"] == {"tau_da": 0.03, "tau_dr": 0.03}


def test_where_the_accelerometer_sits_is_taken_from_the_settings_of_the_autopilot():
    held = record("de_cmd", "V", "q", "az")
    recipe = propose(("de_cmd",), [held], 50.0, (0.04, 0.0, -0.01))
    remarks, found = recipe.estimators[0]
    assert found["accelerometer_m"] == [0.04, -0.01]
    assert not any("give accelerometer_m" in text for text in remarks)
    without = propose(("de_cmd",), [held], 50.0).estimators[0]
    assert "accelerometer_m" not in without[1]
    assert any("give accelerometer_m" in text for text in without[0])


def test_both_axes_at_once_give_a_structure_each_with_its_own_inputs():
    recipe, first = entry(("de", "da", "dr"), "V", "alpha", "q", "theta", "beta", "p", "r", "phi")
    second = recipe.estimators[1][1]
    assert (first["structure"], first["inputs"]) == ("longitudinal", ["de"])
    assert (second["structure"], second["inputs"]) == ("lateral_directional", ["da", "dr"])


def test_without_rates_there_is_a_model_without_derivatives_and_without_outputs_nothing():
    _, found = entry(("de",), "theta", "az")
    assert found["method"] == "dsr_e"
    assert propose(("de",), [record("de", "psi")], 50.0) is None
