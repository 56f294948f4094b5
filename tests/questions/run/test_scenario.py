import re
from pathlib import Path

import pytest

from testbench.core.errors import ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.questions.run.scenario import Scenario

GOOD = (SCENARIOS / "eolo_alpha.toml").read_text(encoding="utf-8")


def faults(tmp_path: Path, text: str) -> list[str]:
    file = tmp_path / "x.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(file)
    for fault in caught.value.faults:
        assert str(file) in fault
    return [f.removeprefix(f"{file}, ") for f in caught.value.faults]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("V_m_s = 16.0", "V_ms = 16.0", r"condition.V_ms: unknown key 'V_ms'; did you mean 'V_m_s'\?"),
        ("V_m_s = 16.0", 'V_m_s = "fast"', r"condition.V_m_s: must be a valid number, got 'fast'"),
        ("V_m_s = 16.0", "V_m_s = nan", r"condition.V_m_s: must be a finite number"),
        ('aircraft = "eolo"', 'aircraft = "eollo"',
         r"aircraft: an aircraft must be a packaged name, .*got 'eollo'; did you mean 'eolo'\?"),
        ('"eolo_alpha"]', '"eolo_alfa"]',
         r"suites\[1\]: a sensor suite must be a packaged name, .*got 'eolo_alfa'; did you mean 'eolo_alpha'\?"),
        ('signal = "3211"', 'signal = "3212"',
         r"manoeuvre\[0\].input\[0\]: unknown signal '3212'; did you mean '3211'\?"),
        ("amplitude_deg = 5.0\nstep_s", "amplitude_rad = 2.0\nstep_s", r"unknown key 'amplitude_rad'"),
        ("amplitude_deg = 5.0\nstep_s", "amplitude_deg = 40.0\nstep_s",
         r"manoeuvre\[0\].input\[0\].amplitude_deg: amplitude_deg <= 25 must hold for control 'de' of eolo, got 40"),
        ('method = "dsr_e"', 'method = "dsr_f"',
         r"identification.estimators\[0\]: unknown method 'dsr_f'; did you mean 'dsr_e'\?"),
        ("[condition]", "[simulation]\nlog_rate_hz = 60.0\n[condition]", r"must divide"),
        ('inputs = ["de"]', 'inputs = ["dee"]', r"'dee'"),
        ("duration_s = 25.0", "duration_s = 1.0", r"must"),
    ],
)  # fmt: skip
def test_every_fault_has_its_message(tmp_path, old, new, message):
    text = GOOD.replace(old, new, 1)
    assert text != GOOD
    found = faults(tmp_path, text)
    assert any(re.search(message, f) for f in found), found


def test_all_faults_come_at_once_schema_and_physics_together(tmp_path):
    text = (
        GOOD.replace("seed = 1", "sede = 1")
        .replace("amplitude_deg = 5.0", "amplitude_deg = 40.0")
        .replace("amplitude_deg = 1.0", "amplitude_deg = 40.0")
    )
    text = text.replace("[condition]", "[simulation]\nrate_hz = 450.0\n[condition]")
    found = faults(tmp_path, text)
    assert any("'sede'; did you mean 'seed'?" in f for f in found)
    assert sum("amplitude_deg <= 25" in f for f in found) == 2
    assert any("must divide" in f for f in found)


def test_a_faulty_item_does_not_make_its_list_look_empty(tmp_path):
    found = faults(tmp_path, GOOD.replace('signal = "3211"', 'signal = "x"'))
    assert not any("at least 1 item" in f for f in found)


def test_toml_that_is_not_toml_names_line_and_column(tmp_path):
    file = tmp_path / "x.toml"
    file.write_text("title = [\nx", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"x.toml must be TOML: .* line 2, column 1"):
        Scenario.load(file)


def test_an_empty_file_lists_what_is_required(tmp_path):
    found = faults(tmp_path, "")
    assert {f.split(":")[0] for f in found} >= {
        "title",
        "aircraft",
        "condition",
        "manoeuvre",
        "suites",
        "identification",
    }
