"""Every question on aircraft that are not packaged: one of each in the suite, all of all among the slow tests.

The Gymnasium environment and the export are tried on all of them.
"""

import json
import re

import gymnasium
import jsbsim
import numpy as np
import pytest
from any_aircraft import VISITORS
from commands import command

import testbench.envs
from testbench.core.constants import FT_M
from testbench.core.paths import STOCK
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.questions.aircraft.contract import aircraft_laws

BY_NAME = {v.name.removeprefix(STOCK): v for v in VISITORS}


@pytest.fixture(scope="session")
def visitors(tmp_path_factory):
    """Return the visitor of a name; what comes from a geometry is made when it is first asked for."""
    made = {}

    def visitor(name):
        if BY_NAME[name].from_geometry and name not in made:
            pytest.importorskip("aerosandbox", reason="needs the extra geometry")
            made[name] = BY_NAME[name].made(tmp_path_factory.mktemp("aircraft"))
        return made.get(name, BY_NAME[name])

    return visitor


# the trainer keeps them in tests/aircraft/geometry, too
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n == "trainer" else n for n in BY_NAME])
def test_the_laws_of_aircraft(visitors, name):
    laws = aircraft_laws(load_aircraft(visitors(name).name))
    assert [law.sentence for law in laws if not law.holds] == []


@pytest.mark.parametrize(
    ("question", "name"),
    [
        pytest.param("run", "c172p", marks=pytest.mark.slow),
        pytest.param("design", "f16", marks=pytest.mark.slow),
        ("plan", "SGS"),
        pytest.param("compare", "B747", marks=pytest.mark.slow),
        pytest.param("campaign", "SGS", marks=pytest.mark.slow),
        pytest.param("run", "trainer", marks=pytest.mark.slow),
    ],
)
def test_one_question_each(visitors, tmp_path, question, name):
    answered(tmp_path, question, visitors(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
@pytest.mark.parametrize("question", ["run", "design", "plan", "compare", "campaign", "gap"])
def test_every_question_on_every_visitor(visitors, tmp_path, question, name):
    answered(tmp_path, question, visitors(name))


def answered(tmp_path, question, visitor):
    file = visitor.write(tmp_path)[question]
    words = ("campaign", "run") if question == "campaign" else (question,)
    done = command(*words, file, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "out").rglob("report.html"))


def test_what_is_identified_is_what_flew(tmp_path):
    file = BY_NAME["B747"].write(tmp_path)["run"]
    assert command("run", file, "-o", tmp_path / "out").returncode == 0
    table = json.loads(next((tmp_path / "out").rglob("parameters.json")).read_text(encoding="utf-8"))
    rows = {row["parameter"]: row for row in table["rows"]}
    for parameter in ("M_alpha", "M_q", "M_de"):
        assert rows[parameter]["estimate"] == pytest.approx(rows[parameter]["true"], rel=0.06), parameter


@pytest.mark.sampled(3)
@pytest.mark.parametrize("dynamics", ["linear", "jsbsim"])
@pytest.mark.parametrize("name", BY_NAME)
def test_an_agent_designs_for_an_aircraft_that_is_not_packaged(visitors, tmp_path, name, dynamics):
    """A doublet of small steps tells something of the parameters and breaks no limit."""
    file = visitors(name).write(tmp_path)["design"]
    text = file.read_text(encoding="utf-8").replace('modes = ["short period"]\n', "")
    file.write_text(text, encoding="utf-8")
    testbench.envs.register()
    env = gymnasium.make("testbench/ExcitationDesign-v0", task=str(file), dynamics=dynamics)
    env.reset(seed=1)
    rewards = []
    for size in (*[0.2] * 4, *[-0.2] * 4):
        observation, reward, terminated, _, info = env.step(np.array([size], np.float32))
        assert not terminated
        assert np.isfinite(observation).all()
        rewards.append(reward)
    assert sum(rewards) > 0.0
    assert 0.0 < info["use"] < 1.0


@pytest.mark.parametrize("name", BY_NAME)
def test_an_exported_visitor_flies_in_jsbsim_alone(visitors, tmp_path, name):
    """Commanded and told as its README says, it is in balance where the testbench trims it."""
    visitor = visitors(name)
    done = command("export", "aircraft", visitor.name, "--to", "jsbsim", "-o", tmp_path / "aircraft")
    assert done.returncode == 0, done.stderr
    readme = (tmp_path / "aircraft" / name / "README.md").read_text(encoding="utf-8")
    aircraft = load_aircraft(visitor.name)
    trimmed = trim(aircraft, FlightCondition(visitor.V_m_s, visitor.h_m))
    fdm = in_balance(tmp_path, name, readme, aircraft, trimmed)
    assert max(abs(fdm[f"accelerations/{a}dot-ft_sec2"]) for a in "uvw") < 1e-6
    assert max(abs(fdm[f"accelerations/{a}dot-rad_sec2"]) for a in "pqr") < 1e-7


def in_balance(root, name, readme, aircraft, trimmed):
    """Return JSBSim with an exported model, told what its README says before and after its engines are started."""
    before, _, after = (
        re.findall(r"^- `([^`]+)` = (\S+)$", part, re.MULTILINE) for part in readme.partition("Set once they run")
    )
    fdm = jsbsim.FGFDMExec(str(root))
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / aircraft.rate_hz)
    assert fdm.load_model(name)
    for key, value in before:
        fdm[key] = float(value)
    fdm["ic/h-sl-ft"] = trimmed.condition.h_m / FT_M
    fdm["ic/theta-rad"], fdm["ic/phi-rad"] = trimmed.theta, trimmed.phi
    for axis in "uvw":
        fdm[f"ic/{axis}-fps"] = trimmed.state[axis] / FT_M
    for axis in "pqr":
        fdm[f"ic/{axis}-rad_sec"] = trimmed.state[axis]
    for control, value in trimmed.controls.items():
        fdm[aircraft.controls[control].command] = value / aircraft.controls[control].scale
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1
    for key, value in after:
        fdm[key] = float(value)
    for _ in range(20):
        fdm.run_ic()
    for _ in range(5):  # a propeller comes to its speed
        fdm.get_propulsion().get_steady_state()
        fdm.run_ic()
    return fdm
