"""Campaign files: every fault at once in words, laws of the nominal checked before anything flies."""

import pytest

from testbench.core.errors import ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.questions.campaign.load import load_campaign


def faults(file) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_campaign(file)
    return str(caught.value)


def test_packaged_campaigns_are_valid():
    names = sorted((SCENARIOS / "campaign").glob("*.toml"))
    assert names
    for file in names:
        assert load_campaign(file).cases


def test_every_varied_key_that_is_wrong_is_named_with_the_nearest_right_one(written):
    vary = """
"condition.V_ms" = { kind = "normal", mean = 1.0, std = 0.1 }
"coefficient.Cm_alfa" = { kind = "normal", mean = 1.0, std = 0.1 }
"aircraft.mas_percent" = { kind = "normal", mean = 1.0, std = 0.1 }
"property.no/such" = { kind = "normal", mean = 1.0, std = 0.1 }
"sensor.thta.bias" = { kind = "normal", mean = 1.0, std = 0.1 }
"sensor.q.bais" = { kind = "normal", mean = 1.0, std = 0.1 }
"sensor.q.bias_m_s" = { kind = "normal", mean = 1.0, std = 0.1 }
"manoeuvre.3.duration_s" = { kind = "normal", mean = 1.0, std = 0.1 }
"sensor.q.lag_s" = { kind = "normal", mean = -0.1, std = 0.1 }
"sensor.q.delay_s" = { kind = "choice", among = ["much"] }
"""
    text = faults(written(vary=vary))
    for said in (
        "vary.\"condition.V_ms\": condition.V_ms: unknown key 'V_ms'; did you mean 'V_m_s'?",
        "got 'Cm_alfa'; did you mean 'Cm_alpha'?",
        "unknown key 'aircraft.mas_percent'; did you mean 'mass_percent'?",
        "got 'no/such'",
        "got 'thta'; did you mean 'theta'?",
        "unknown figure 'bais' of sensor 'q'",
        "did you mean 'bias'?",
        "channel 'q' is measured in rad/s",
        "'manoeuvre.3' must be an entry of a list of 1 (0 to 0), got '3'",
        "0 <= lag_s <= 60 must hold, got -0.1",
        "a number must be given, got 'much'",
    ):
        assert said in text
    assert "short.toml" in text


@pytest.mark.parametrize(
    ("head", "vary", "said"),
    [
        ("runs = 0", "", "runs: must be greater than or equal to 1, got 0"),
        ("", "", "takes runs and not repeats"),
        ("runs = 3\nrepeats = 3", "", "takes runs and not repeats"),
        ("runs = 3\nbase = 'taurus_doublet'", "", "takes either base"),
        ("runs = 3\nrun = 3", "", "unknown key 'run'; did you mean 'runs'?"),
        ("runs = 3", '"a" = { kind = "norml", mean = 1.0, std = 1.0 }', "unknown kind 'norml'; did you mean 'normal'?"),
        ("runs = 3", '"a" = { kind = "normal", mean = 1.0, std = -1.0 }', "vary.a.std: must be greater than or equal"),
        ("runs = 3", '"a" = { kind = "uniform", low = 1.0, high = 1.0 }', "low < high must hold"),
        ("runs = 3", '"a" = { kind = "choice", among = [1, 2], weights = [1.0] }', "one per entry of among (2)"),
        ("runs = 3", '[grid]\n"condition.V_m_s" = [12.0]', "takes repeats and not runs; a key is either varied or on"),
    ],
)
def test_a_broken_law_has_its_message(written, head, vary, said):
    assert said in faults(written(head, vary))


def test_the_limits_of_the_middle_and_of_every_point_of_the_grid_are_checked(written):
    key = "manoeuvre.0.input.0.amplitude_deg"
    said = faults(written(vary=f'"{key}" = {{ kind = "normal", mean = 20.0, std = 0.1 }}'))
    assert "amplitude_deg <= 12.5 must hold for control 'de' of taurus, got 20" in said
    said = faults(written("repeats = 2", f'[grid]\n"{key}" = [1.0, 2.0, 30.0]'))
    assert "amplitude_deg <= 12.5 must hold for control 'de' of taurus, got 30" in said


def test_a_stopping_rule_must_name_a_case(written):
    stop = '[stop]\nquantity = "taurus, transfer_function: x"\nhalf_width = 1.0'
    said = faults(written(vary=stop))
    assert "must be 'SUITE, ESTIMATOR: FIGURE'" in said
    assert "did you mean 'taurus_8hz, transfer_function'?" in said


def test_the_base_may_be_a_file_beside_the_campaign(tmp_path):
    (tmp_path / "mine.toml").write_text((SCENARIOS / "taurus_doublet.toml").read_text(encoding="utf-8"))
    file = tmp_path / "c.toml"
    file.write_text(
        'title = "c"\nbase = "mine.toml"\nruns = 2\n[vary]\n"condition.V_m_s" = { kind = "values", values = [12.5] }'
    )
    loaded = load_campaign(file)
    assert loaded.base.condition.V_m_s == 12.5
    assert loaded.base.file == tmp_path / "mine.toml"
