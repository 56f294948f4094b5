"""State equations as text in scenarios, descriptions of recorded flights, comparisons and campaigns."""

import numpy as np
import pytest
from recorded import flight_data

import testbench as tb
from testbench.core.door import sha256
from testbench.core.errors import ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.questions.campaign.load import load_campaign
from testbench.questions.compare.scenario import CompareScenario
from testbench.questions.files import check_file
from testbench.questions.run.scenario import Scenario

SCENARIO = """
title = "own"
aircraft = "eolo"
suites = ["eolo_alpha"]
[condition]
V_m_s = 16.0
h_m = 547.0
[[manoeuvre]]
name = "3-2-1-1"
use = "split"
duration_s = 10.0
input = [{ signal = "3211", control = "de", amplitude_deg = 2.0, step_s = 0.2 }]
[identification]
inputs = ["de"]
outputs = ["alpha", "q"]
[identification.structures.mine]
states = ["alpha", "q"]
[identification.structures.mine.equations]
alpha_dot = "Z_alpha*alpha + q"
q_dot = "M_alpha*alpha + M_q*q + M_de*de"
[identification.structures.mine.parameters]
Z_alpha = -5.0
M_alpha = { value = -20.0, high = 0.0 }
M_q = -5
M_de = -30.0
[[identification.estimators]]
method = "equation_error"
structure = "mine"
"""
OWN_FILE = """
states = ["alpha", "q"]
equations = { alpha_dot = "Z*alpha + q", q_dot = "M*alpha + M_q*q + D*de" }
parameters = { Z = -5.0, M = -20.0, M_q = -5.0, D = -30.0 }
"""


def read(folder, text):
    (folder / "own.toml").write_text(text, encoding="utf-8")
    return Scenario.load(folder / "own.toml")


def test_an_entry_has_the_equations_that_it_names(tmp_path):
    (entry,) = read(tmp_path, SCENARIO).identification.estimators
    assert entry.equations.parameters["M_alpha"].high == 0.0
    assert entry.equations.equations["alpha_dot"] == "Z_alpha*alpha + q"
    assert check_file(tmp_path / "own.toml") == "scenario"


@pytest.mark.parametrize(
    ("before", "after", "key", "said"),
    [
        ("+ M_q*q + M", "+ M_qq*q + M", "structures.mine", "'M_qq' at character 17"),
        ("q_dot", "qdot", "structures.mine", "did you mean 'q_dot'?"),
        ("M_q = -5", "M_q = true", "structures.mine.parameters.M_q", "must be a number or a table"),
        ("high = 0.0", "hihg = 0.0", "structures.mine.parameters.M_alpha.hihg", "did you mean 'high'?"),
        ("\nstates", "\nstats", "structures.mine.states", "required and missing"),
        ('structure = "mine"', 'structure = "mind"', "estimators[0].structure", "did you mean 'mine'?"),
        ('inputs = ["de"]', 'inputs = ["thr"]', "identification", "'mine' is driven by 'de'"),
        ('structure = "mine"', 'structure = "mine"\noutputs = ["V"]', "identification", "'mine' has no output 'V'"),
        (
            "[identification.structures.mine]",
            '[identification.structures."a.toml"]',
            "structures.a.toml",
            "a name must be",
        ),
        ("structures.mine", "structures.flexible", "identification", "a packaged structure has this name"),
        ('"M_alpha*alpha', '"__import__(1)*alpha', "structures.mine", "there is no function '__import__'"),
    ],
)
def test_faults_of_equations_are_told_where_they_stand(tmp_path, before, after, key, said):
    text = SCENARIO.replace(before, after)
    if "flexible" in after:
        text = text.replace('structure = "mine"', 'structure = "short_period"')
    with pytest.raises(ScenarioError) as error:
        read(tmp_path, text)
    (fault,) = [f for f in error.value.faults if said in f]
    assert f"own.toml, identification.{key}".replace("identification.identification", "identification") in fault
    assert not [f for f in error.value.faults if "estimators[0].equations" in f]


def test_faults_of_a_file_are_told_with_the_file(tmp_path):
    (tmp_path / "file.toml").write_text(OWN_FILE.replace("Z*alpha", "Zz*alpha"), encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        read(tmp_path, SCENARIO.replace('structure = "mine"', 'structure = "file.toml"'))
    (fault,) = error.value.faults
    assert "own.toml, identification.estimators[0].structure: " in fault
    assert f"{tmp_path / 'file.toml'}: equations.alpha_dot: 'Zz' at character 1" in fault


def test_equations_may_have_several_lines_and_names_may_not(tmp_path):
    long = '"""\n  M_alpha*alpha\n\t+ M_q*q\n+ M_de*de"""'
    (entry,) = read(tmp_path, SCENARIO.replace('"M_alpha*alpha + M_q*q + M_de*de"', long)).identification.estimators
    assert len(entry.equations.trees) == 2
    with pytest.raises(ScenarioError, match="must be one line"):
        read(
            tmp_path,
            SCENARIO.replace('"M_alpha*alpha + M_q*q + M_de*de"', long).replace(
                "structures.mine", 'structures."a\\nb"'
            ),
        )


def test_comparisons_take_them(tmp_path):
    text = (SCENARIOS / "compare" / "eolo_alpha.toml").read_text(encoding="utf-8")
    tables, entries = SCENARIO[SCENARIO.index("[identification.structures") :].split("[[identification.estimators]]")
    at = text.index("[[identification.estimators]]")
    (tmp_path / "c.toml").write_text(
        text[:at] + tables + f"[[identification.estimators]]{entries}label = 'own'\n" + text[at:], encoding="utf-8"
    )
    first, *_ = CompareScenario.load(tmp_path / "c.toml").identification.estimators
    assert first.shown == "own"
    assert first.equations.states == ("alpha", "q")


def test_a_campaign_knows_the_bytes_of_the_file_and_flies(tmp_path):
    (tmp_path / "file.toml").write_text(OWN_FILE, encoding="utf-8")
    (tmp_path / "own.toml").write_text(
        SCENARIO.replace('structure = "mine"', 'structure = "file.toml"\n[[identification.estimators]]\n'
                         'method = "equation_error"\nlabel = "table"\nstructure = "mine"'),
        encoding="utf-8",
    )  # fmt: skip
    (tmp_path / "c.toml").write_text(
        'title = "c"\nbase = "own.toml"\nruns = 2\n'
        '[vary]\n"condition.V_m_s" = { kind = "values", values = [15.5, 16.5] }\n',
        encoding="utf-8",
    )
    campaign = load_campaign(tmp_path / "c.toml")
    before = campaign.digest()
    assert sha256(tmp_path / "file.toml", "python") in dict(campaign.files).values()
    first, _ = campaign.content["identification"]["estimators"]
    assert first["structure"] == str(tmp_path / "file.toml")
    assert tb.fly_campaign(campaign, tmp_path / "store", workers=1).counts.done == 2
    (tmp_path / "file.toml").write_text(OWN_FILE + "# changed\n", encoding="utf-8")
    assert load_campaign(tmp_path / "c.toml").digest() != before


def test_a_recorded_flight_gives_what_the_packaged_structure_gives(tmp_path):
    text = (SCENARIOS / "records" / "attas_short_period.toml").read_text(encoding="utf-8")
    text = text[: text.index("# 25 Hz.")].replace("../../../shared/flight_data", flight_data().resolve().as_posix())
    names = ("Z_0", "Z_alpha", "Z_q", "Z_de", "M_0", "M_alpha", "M_q", "M_de")
    start = dict.fromkeys(names, 0.0) | {"Z_alpha": -1.0, "M_alpha": -4.0, "M_q": -2.0, "M_de": -5.0}
    own = "".join(f"{name} = {value}\n" for name, value in start.items())
    text += f"""
[[identification.estimators]]
method = "output_error"
structure = "short_period"
[[identification.estimators]]
method = "output_error"
structure = "mine"
label = "own"
[identification.structures.mine]
states = ["alpha", "q"]
[identification.structures.mine.equations]
alpha_dot = "Z_0 + Z_alpha*alpha + (1 + Z_q)*q + Z_de*de"
q_dot = "M_0 + M_alpha*alpha + M_q*q + M_de*de"
[identification.structures.mine.parameters]
{own}"""
    (tmp_path / "attas.toml").write_text(text, encoding="utf-8")
    result = tb.identify(tb.load_description(tmp_path / "attas.toml"))
    packaged, mine = (case.model for case in result.cases)
    np.testing.assert_array_equal(mine.params, packaged.params)
    np.testing.assert_array_equal(mine.covariance, packaged.covariance)
