"""Every question on aircraft that are not packaged: one of each in the suite, all of all among the slow tests."""

from __future__ import annotations

import json

import gymnasium
import numpy as np
import pytest
from any_aircraft import VISITORS
from commands import command

import testbench.envs
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.questions.aircraft.contract import aircraft_laws

BY_NAME = {v.name.removeprefix("jsbsim:"): v for v in VISITORS}


@pytest.mark.parametrize("name", BY_NAME)
def test_the_laws_of_aircraft(name):
    laws = aircraft_laws(load_aircraft(name))
    assert [law.sentence for law in laws if not law.holds] == []


@pytest.mark.parametrize(
    ("question", "name"),
    [("run", "c172p"), ("design", "f16"), ("plan", "SGS"), ("compare", "B747"), ("campaign", "SGS")],
)
def test_one_question_each(tmp_path, question, name):
    answered(tmp_path, question, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
@pytest.mark.parametrize("question", ["run", "design", "plan", "compare", "campaign", "gap"])
def test_every_question_on_every_visitor(tmp_path, question, name):
    answered(tmp_path, question, name)


def answered(tmp_path, question, name):
    file = BY_NAME[name].write(tmp_path)[question]
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


def test_an_agent_designs_for_an_aircraft_that_is_not_packaged(tmp_path):
    file = BY_NAME["c172p"].write(tmp_path)["design"]
    text = file.read_text(encoding="utf-8").replace('modes = ["short period"]\n', "")
    file.write_text(text, encoding="utf-8")
    testbench.envs.register()
    env = gymnasium.make("testbench/ExcitationDesign-v0", task=str(file))
    env.reset(seed=1)
    observation, reward, *_ = env.step(env.action_space.sample())
    assert np.isfinite(reward)
    assert np.isfinite(observation).all() if isinstance(observation, np.ndarray) else True


def test_an_exported_visitor_flies_in_jsbsim_alone(tmp_path):
    import jsbsim

    done = command("aircraft", "SGS", "--export", tmp_path / "aircraft")
    assert done.returncode == 0, done.stderr
    glider = load_aircraft("SGS")
    trimmed = trim(glider, FlightCondition(glider.design_V_m_s, glider.design_h_m))
    fdm = jsbsim.FGFDMExec(str(tmp_path))
    fdm.set_debug_level(0)
    assert fdm.load_model("SGS")
    for name, value in (
        ("ic/h-sl-ft", glider.design_h_m / 0.3048),
        ("ic/theta-rad", trimmed.theta),
        ("ic/phi-rad", trimmed.phi),
        *((f"ic/{a}-fps", trimmed.state[a] / 0.3048) for a in "uvw"),
        *((f"ic/{a}-rad_sec", trimmed.state[a]) for a in "pqr"),
        ("testbench/elevator-command-rad", trimmed.controls["de"]),
        ("testbench/aileron-command-rad", trimmed.controls["da"]),
        ("testbench/rudder-command-rad", trimmed.controls["dr"]),
    ):
        fdm[name] = value
    for _ in range(5):
        fdm.run_ic()
    assert abs(fdm["accelerations/qdot-rad_sec2"]) < 1e-7
    assert abs(fdm["accelerations/udot-ft_sec2"]) < 1e-6
    poles = linearise(glider, trimmed).poles()
    assert np.isfinite(poles).all()
