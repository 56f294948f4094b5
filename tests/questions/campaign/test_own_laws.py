"""Coefficients drawn by the aircraft's own uncertainty: which, by what law, and what is refused."""

import json

import pytest
from believed_taurus import believed_taurus

from testbench.aircraft.believed import drawn
from testbench.core.errors import ScenarioError
from testbench.flight import load_aircraft
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.draws import nominal_inputs, run_inputs
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.page import campaign_page
from testbench.questions.campaign.result import read_campaign
from testbench.questions.campaign.store import Store

EVERY = '"coefficient.*" = { kind = "uncertainty" }'
STATED = {"CL_alpha": 0.05, "Cm_alpha": 0.4, "Cm_q": 0.15}


@pytest.fixture
def mine(tmp_path, written):
    """Write a campaign of a Taurus that states its uncertainty and return its file."""

    def write(vary: str = EVERY, old: str = "[vary]", new: str = "[vary]", stated=STATED):
        folder = believed_taurus(tmp_path, stated)
        file = written("runs = 3", vary, 'aircraft = "taurus"', f'aircraft = "{folder}"', "own")
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new), encoding="utf-8")
        return file

    return write


def faults(file) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_campaign(file)
    return str(caught.value)


def test_every_coefficient_is_drawn_but_those_that_another_key_varies(mine):
    campaign = load_campaign(mine())
    assert list(campaign.spec.vary) == [
        *("condition.V_m_s", "coefficient.Cm_alpha", "sensor.q.scale"),
        *("coefficient.CL_alpha", "coefficient.Cm_q"),
    ]
    assert campaign.spec.vary["coefficient.Cm_alpha"].kind == "lognormal"
    assert campaign.own == ("coefficient.CL_alpha", "coefficient.Cm_q")
    law = campaign.spec.vary["coefficient.Cm_q"]
    assert (law.kind, law.mean, law.std) == ("normal", 1.0, 0.15)
    assert nominal_inputs(campaign.spec)["coefficient.Cm_q"] == 1.0


def test_the_draws_are_those_of_a_normal_law_with_the_stated_deviation(mine, tmp_path):
    file = mine()
    own = [run_inputs(load_campaign(file).spec, i) for i in range(5)]
    laws = "\n".join(
        f'"coefficient.{n}" = {{ kind = "normal", mean = 1.0, std = {s} }}'
        for n, s in STATED.items()
        if n != "Cm_alpha"
    )
    file.write_text(file.read_text(encoding="utf-8").replace(EVERY, laws), encoding="utf-8")
    assert own == [run_inputs(load_campaign(file).spec, i) for i in range(5)]


def test_a_run_is_the_draw_of_the_aircraft_with_that_number(mine, tmp_path):
    campaign = load_campaign(mine())
    (amendment,) = drawn(load_aircraft(campaign.base.aircraft), campaign.spec.seed, 2).amendments
    inputs = run_inputs(campaign.spec, 2)
    for change in amendment.changes:
        if change.name != "Cm_alpha":
            assert inputs[f"coefficient.{change.name}"] == change.factor


def test_one_coefficient_alone_and_a_grid_beside(mine):
    file = mine('"coefficient.Cm_q" = { kind = "uncertainty" }')
    assert load_campaign(file).own == ("coefficient.Cm_q",)
    text = file.read_text(encoding="utf-8").replace('"coefficient.Cm_q"', '"coefficient.*"')
    text = text.replace("runs = 3", "repeats = 3").replace(
        "[scenario]", '[grid]\n"coefficient.CL_alpha" = [0.9]\n[scenario]'
    )
    file.write_text(text, encoding="utf-8")
    campaign = load_campaign(file)
    assert campaign.own == ("coefficient.Cm_q",)
    assert run_inputs(campaign.spec, 0)["coefficient.CL_alpha"] == 0.9


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        (
            '"coefficient.Cm_qq" = { kind = "uncertainty" }',
            "deviation of the coefficient, got 'Cm_qq'; did you mean 'Cm_q'",
        ),
        ('"sensor.q.bias" = { kind = "uncertainty" }', 'is for coefficients, "coefficient.NAME"'),
        (
            '"coefficient.*" = { kind = "normal", mean = 1.0, std = 0.1 }',
            '"coefficient.*" takes { kind = "uncertainty" }',
        ),
        (f'{EVERY}\n"aircraft" = {{ kind = "values", values = ["taurus"] }}', "but aircraft varies"),
    ],
)
def test_what_cannot_be_drawn_is_refused(mine, vary, said):
    assert said in faults(mine(vary))


def test_an_aircraft_that_states_nothing_is_refused_with_what_to_do(written):
    said = faults(written(vary=EVERY))
    assert 'vary."coefficient.*": taurus must state how well its coefficients are known' in said
    assert "[uncertainty]; write that into aircraft.toml" in said


def test_it_flies_and_says_what_was_drawn(mine, tmp_path):
    campaign = load_campaign(mine())
    fly_campaign(campaign, tmp_path / "store", workers=1)
    with Store.read(tmp_path / "store") as store:
        rows = list(store.rows())
        page = campaign_page(read_campaign(campaign, store))
    assert [row.reason for row in rows] == [None] * 3
    assert [json.loads(row.inputs) for row in rows] == [run_inputs(campaign.spec, i) for i in range(3)]
    (own,) = [value for key, value in page.asked if key == "coefficients"]
    assert "by the stated uncertainty of the aircraft" in own
    assert "CL_alpha 5.00 %, Cm_q 15.0 %" in own
    assert "coefficient.Cm_q" in page.files["tables/runs.csv"].splitlines()[0]
    toml = tmp_path / "aircraft" / "mine" / "aircraft.toml"
    toml.write_text(toml.read_text(encoding="utf-8").replace("Cm_q = 0.15", "Cm_q = 0.2"), encoding="utf-8")
    assert load_campaign(tmp_path / "own.toml").digest() != campaign.digest()  # no store takes draws of two laws
