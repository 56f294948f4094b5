"""The amended aircraft as a folder: read back it flies as the amended one, with and without elastic modes."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from gap_fits import write_amended
from gap_flights import CONDITION, believe

from testbench.core.paths import AIRCRAFT_MODELS
from testbench.effects import EFFECTS
from testbench.flight import linearise, load_aircraft, trim
from testbench.questions.gap.export import aircraft_files


def written(aircraft, folder: Path) -> Path:
    for path, text in aircraft_files(aircraft, "eolo", 500.0, CONDITION).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("wing_bending", {"f_hz": 5.0, "mass_ratio": 0.08, "twist_rad": 0.05, "lever": 0.05}),
        ("actuator_lag", {"lag_rad_s": 11.0}),
        ("pitch_damper", {"gain_s": 0.1}),
        ("free_play", {"width_rad": 0.02}),
    ],
)
def test_the_folder_reads_back_as_the_amended_aircraft(effect, values, tmp_path):
    amended = believe().with_nuisances({"CL_alpha": 1.05, "Cm_q": 0.9}).with_effect(EFFECTS[effect], values).aircraft
    back = load_aircraft("eolo", "flexible", written(amended, tmp_path))
    poles = [np.sort_complex(linearise(a, trim(a, CONDITION)).poles()) for a in (back, amended)]
    assert poles[0] == pytest.approx(poles[1], abs=1e-8)
    assert back.coefficient("CL_alpha") == pytest.approx(1.05 * load_aircraft("eolo").coefficient("CL_alpha"))
    assert "amended" in back.title
    assert (tmp_path / "airframe.xml").exists() == (effect == "wing_bending")


def test_an_aircraft_that_is_not_amended_reads_back_as_it_was(tmp_path):
    flexible = load_aircraft("eolo")
    back = load_aircraft("eolo", "flexible", written(flexible, tmp_path))
    assert back.elastic == flexible.elastic
    assert back.title == flexible.title
    assert back.wing_stations == flexible.wing_stations


def test_files_say_the_frame_rate_that_they_are_made_for():
    """A delay of the library counts frames: flown at another rate it would be another delay."""
    late = believe().with_effect(EFFECTS["transport_delay"], {"delay_s": 0.1}).aircraft
    own = aircraft_files(late, "eolo", 500.0, CONDITION)
    other = aircraft_files(late, "eolo", 600.0, CONDITION)
    assert "rate_hz = 500.0 " in own["aircraft.toml"]  # with its comment
    assert "rate_hz = 600.0\n" in other["aircraft.toml"]
    assert "600 frames a second" in other["eolo.xml"]


def test_an_aircraft_brought_by_its_path_is_written_under_its_name_and_loads(tmp_path):
    """Beside the report, not where the path leads: there lies the user's own."""
    home = tmp_path / "aircraft" / "mine"
    shutil.copytree(AIRCRAFT_MODELS / "eolo", home)
    before = (home / "aircraft.toml").read_bytes()
    amended = believe().with_effect(EFFECTS["actuator_lag"], {"lag_rad_s": 11.0})
    finding = SimpleNamespace(believed=believe(), amended=amended, changed=True, naming=SimpleNamespace(best=None))
    paths = write_amended(SimpleNamespace(aircraft=str(home), finding=finding), tmp_path / "out")
    assert (home / "aircraft.toml").read_bytes() == before
    assert tmp_path / "out" / "mine" / "mine.xml" in paths
    back = load_aircraft(tmp_path / "out" / "mine")
    poles = [np.sort_complex(linearise(a, trim(a, CONDITION)).poles()) for a in (back, amended.aircraft)]
    assert poles[0] == pytest.approx(poles[1], abs=1e-8)
