"""An aircraft that is unstable without a pilot: told so, or flown with a stabiliser that its file states."""

import math

import numpy as np
import pytest

from testbench.core.errors import ScenarioError
from testbench.core.paths import stock_root
from testbench.core.record import FlightAborted
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.flight.batch.jobs import Job
from testbench.flight.load import adopted_at
from testbench.flight.simulate import Manoeuvre
from testbench.inputs import InputSignal
from testbench.line import fly_and_measure
from testbench.questions.aircraft.adopt import write_adopted

CONDITION = FlightCondition(250.0, 1000.0)  # where the F-16 of JSBSim is unstable without its flight control system
GAINS = "\n[stabiliser]\nde = { alpha = 0.5, q = 0.4 }\n"


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    bare, helped = (tmp_path_factory.mktemp("f16") / name for name in ("bare", "helped"))
    for folder in (bare, helped):
        write_adopted(adopted_at(stock_root() / "aircraft" / "f16"), folder)
    file = helped / "aircraft.toml"
    file.write_text(file.read_text(encoding="utf-8") + GAINS, encoding="utf-8")
    return bare, helped


def step(aircraft, size_rad, seconds):
    trimmed = trim(aircraft, CONDITION)
    n = round(seconds * trimmed.rate_hz)
    u = np.zeros((n, 1))
    u[: round(0.5 * trimmed.rate_hz)] = size_rad
    signal = InputSignal(np.arange(n) / trimmed.rate_hz, u, ("de",))
    return fly_and_measure(Job(aircraft, trimmed, Manoeuvre("pulse", signal, 0.0), 100.0)).flown


def test_an_unstable_aircraft_that_leaves_its_limits_is_told_with_its_time_to_double(folders):
    aircraft = load_aircraft(folders[0])
    growth = linearise(aircraft, trim(aircraft, CONDITION)).poles().real.max()
    with pytest.raises(FlightAborted, match="unstable without a pilot") as caught:
        step(aircraft, 1e-4, 30.0)
    assert f"doubles in {math.log(2.0) / growth:.2g} s" in caught.value.message
    assert "[stabiliser]" in caught.value.message
    assert len(caught.value.record) > 100


def test_it_may_be_flown_for_as_long_as_it_stays_inside_its_limits(folders):
    assert step(load_aircraft(folders[0]), 1e-3, 3.0).outcome == "completed"


def test_with_a_stabiliser_it_flies_and_the_record_says_so(folders):
    aircraft = load_aircraft(folders[1])
    trimmed = trim(aircraft, CONDITION)
    model = linearise(aircraft, trimmed)
    assert model.fed_back == ("servo_de",)
    assert model.poles().real.max() < 0.05
    record = step(aircraft, 0.02, 15.0)
    assert record.outcome == "completed"
    assert record.provenance["amendments"] == ["stabiliser_de"]
    change = record["de"] - record["de_cmd"]
    fed = 0.5 * record["alpha"] + 0.4 * record["q"]
    assert np.abs(change - fed)[200:].max() < 0.05 * np.abs(fed - fed[0]).max() + 1e-4  # less the lag of the servo


def test_derivatives_remain_those_of_the_aircraft_alone(folders):
    found = []
    for folder in folders:
        aircraft = load_aircraft(folder)
        trimmed = trim(aircraft, CONDITION)
        found.append({d.name: d.held for d in dimensional_derivatives(linearise(aircraft, trimmed), trimmed)})
    bare, helped = found
    for name in ("M_alpha", "M_q", "M_de", "Z_alpha"):
        assert helped[name] == pytest.approx(bare[name], rel=1e-4), name


def test_a_stabiliser_of_a_surface_that_has_no_servo_gets_one(tmp_path):
    write_adopted(adopted_at(stock_root() / "aircraft" / "SGS"), tmp_path / "glider")
    file = tmp_path / "glider" / "aircraft.toml"
    file.write_text(file.read_text(encoding="utf-8") + "\n[stabiliser]\nda = { p = -0.1 }\n", encoding="utf-8")
    glider = load_aircraft(tmp_path / "glider")
    assert glider.has_servo("da")
    assert not glider.has_servo("de")
    plain = load_aircraft("jsbsim:SGS")
    condition = FlightCondition(glider.design_V_m_s, glider.design_h_m)
    fastest = [min(linearise(a, trim(a, condition)).poles().real) for a in (plain, glider)]
    assert fastest[1] < fastest[0]  # the servo's own root
    assert glider.coefficient("Cl_p") == pytest.approx(plain.coefficient("Cl_p"), rel=1e-6)


def test_a_stabiliser_of_what_is_not_there_is_refused(folders, tmp_path):
    write_adopted(adopted_at(stock_root() / "aircraft" / "SGS"), tmp_path / "glider")
    file = tmp_path / "glider" / "aircraft.toml"
    kept = file.read_text(encoding="utf-8")
    file.write_text(kept + "\n[stabiliser]\nde = { alfa = 0.1 }\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"stabiliser.de.*alfa"):
        load_aircraft(tmp_path / "glider")
