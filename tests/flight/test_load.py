"""Any aircraft by name or path, and what is checked when it is loaded."""

import pickle
import shutil

import numpy as np
import pytest
from killed import killed_at, shown, whole

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError, ScenarioError, WriteError
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, resolve, stock_root
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.load import AircraftNote, adopted_at
from testbench.questions.aircraft.adopt import described, write_adopted

STOCK = stock_root() / "aircraft"


def own(tmp_path, name="taurus"):
    folder = tmp_path / "mine"
    shutil.copytree(AIRCRAFT_MODELS / name, folder)
    return folder


def replaced(file, old, new):
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_one_model_by_four_names(tmp_path, monkeypatch):
    shutil.copytree(STOCK / "c172p", tmp_path / "aircraft" / "skyhawk")
    (tmp_path / "aircraft" / "skyhawk" / "c172p.xml").rename(tmp_path / "aircraft" / "skyhawk" / "skyhawk.xml")
    monkeypatch.chdir(tmp_path)
    whole = [
        load_aircraft(n)
        for n in ("c172p", "jsbsim:c172p", "skyhawk", "aircraft/skyhawk", "aircraft/skyhawk/skyhawk.xml")
    ]
    assert [a.name for a in whole] == ["c172p", "c172p", "skyhawk", "skyhawk", "skyhawk"]
    assert len({a.mass for a in whole}) == 1
    assert resolve("c172p", AIRCRAFT) == "jsbsim:c172p"


def test_an_own_aircraft_comes_before_one_that_comes_with_jsbsim(tmp_path, monkeypatch):
    shutil.copytree(AIRCRAFT_MODELS / "taurus", tmp_path / "aircraft" / "c172p")
    monkeypatch.chdir(tmp_path)
    assert load_aircraft("c172p").mass.mass_kg == 1.8
    assert load_aircraft("jsbsim:c172p").mass.mass_kg > 800.0


def test_what_is_nothing_is_said_with_what_there_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ScenarioError, match=r"did you mean 'c172[prx]'"):
        load_aircraft("jsbsim:c172q")
    with pytest.raises(ScenarioError, match="is there, but holds neither"):
        load_aircraft("empty")
    with pytest.raises(ScenarioError, match="valid: b1, eolo, taurus"):
        load_aircraft("zzz/zzz")


def test_a_full_deflection_that_is_not_the_models_is_refused(tmp_path):
    folder = own(tmp_path)
    replaced(folder / "aircraft.toml", "full_deflection_deg = 12.5", "full_deflection_deg = 9.0")
    with pytest.raises(ModelError, match=r"moves fcs/elevator-pos-rad by 12.5 deg, but 9 is said .*controls.de.full"):
        load_aircraft(folder)


def test_a_surface_that_turns_the_aircraft_the_wrong_way_is_refused(tmp_path):
    folder = own(tmp_path)
    text = (folder / "taurus.xml").read_text(encoding="utf-8")
    for name in ("Cl_da", "Cm_de", "Cn_dr"):
        head, tail = text.split(f'name="aero/coefficient/{name}"')
        i, j = tail.index("<value>") + len("<value>"), tail.index("</value>")
        turned = f'{head}name="aero/coefficient/{name}"{tail[:i]}{-float(tail[i:j])}{tail[j:]}'
        (folder / "taurus.xml").write_text(turned, encoding="utf-8")
        with pytest.raises(ModelError, match=rf"a positive {name[-2:]} .* in the opposite direction"):
            load_aircraft(folder)


def test_a_surface_that_the_aerodynamics_does_not_read_is_refused(tmp_path):
    folder = own(tmp_path)
    text = (folder / "taurus.xml").read_text(encoding="utf-8")
    head, tail = text.split("<aerodynamics>")
    (folder / "taurus.xml").write_text(
        head + "<aerodynamics>" + tail.replace("fcs/rudder-pos-rad", "fcs/elevator-pos-rad"), encoding="utf-8"
    )
    with pytest.raises(ModelError, match=r"dr must turn mine, .* does not read fcs/rudder-pos-rad"):
        load_aircraft(folder)


def test_a_command_that_does_not_exist_is_refused(tmp_path):
    folder = own(tmp_path)
    replaced(folder / "aircraft.toml", '"fcs/rudder-cmd-norm"', '"fcs/ruder-cmd-norm"')
    with pytest.raises(ModelError, match="ruder"):
        load_aircraft(folder)


def test_an_aircraft_that_does_not_stay_at_its_trim_is_noted(tmp_path):
    folder = own(tmp_path)
    text = (folder / "taurus.xml").read_text(encoding="utf-8")
    head, tail = text.split('name="aero/coefficient/Cm_q"')
    i, j = tail.index("<value>") + len("<value>"), tail.index("</value>")
    unstable = f'{head}name="aero/coefficient/Cm_q"{tail[:i]}60.0{tail[j:]}'
    (folder / "taurus.xml").write_text(unstable, encoding="utf-8")
    with pytest.warns(AircraftNote, match="within 1 s with fixed controls"):
        load_aircraft(folder)


def test_a_trim_that_does_not_exist_is_noted(tmp_path):
    folder = own(tmp_path)
    replaced(folder / "aircraft.toml", "design_V_m_s = 12.0", "design_V_m_s = 27.0")
    with pytest.warns(AircraftNote, match="does not trim at its design condition"):
        load_aircraft(folder)


@pytest.mark.parametrize("name", ["c172p", "f16", "SGS", "T38", "Camel"])
def test_an_adopted_folder_is_the_same_aircraft(tmp_path, name):
    adopted = adopted_at(STOCK / name)
    folder = tmp_path / "mine"
    write_adopted(adopted, folder)
    before, after = adopted.aircraft, load_aircraft(folder)
    condition = FlightCondition(before.design_V_m_s, before.design_h_m)
    one, two = trim(before, condition), trim(after, condition)
    assert after.controls.keys() == before.controls.keys()
    for control in before.controls:
        assert after.controls[control].full == pytest.approx(before.controls[control].full, rel=1e-10)
        assert after.controls[control].low == pytest.approx(before.controls[control].low, rel=1e-10)
        assert two.controls[control] == pytest.approx(one.controls[control], abs=1e-6)
    assert two.alpha == pytest.approx(one.alpha, abs=1e-7)
    assert after.mass.mass_kg == pytest.approx(before.mass.mass_kg, rel=1e-6)
    for channel, ends in before.limits.items():
        assert after.limits[channel] == pytest.approx(ends, rel=1e-5)


def test_an_adopted_throw_that_is_edited_wrongly_is_refused(tmp_path):
    folder = tmp_path / "mine"
    write_adopted(adopted_at(STOCK / "J3Cub"), folder)
    toml = folder / "aircraft.toml"
    kept = toml.read_text(encoding="utf-8")
    replaced(toml, '"fcs/rudder-pos-rad" = [[-29.79', '"fcs/rudder-pos-rad" = [[-20.0')
    with pytest.raises(ModelError, match=r"controls.dr.drives must agree with the model: at dr = -20"):
        load_aircraft(folder)
    toml.write_text(kept.replace("fcs/rudder-pos-rad", "fcs/rudder-pos-radd"), encoding="utf-8")
    with pytest.raises(ModelError, match=r"controls.dr.drives must name what dr moves in the model \(fcs/rudder"):
        load_aircraft(folder)
    toml.write_text(kept.replace("throw_deg = [-29.79", "throw_deg = [40.0, -29.79"), encoding="utf-8")
    with pytest.raises(ScenarioError):
        load_aircraft(folder)


def test_adopting_twice_keeps_what_was_edited_and_an_aircraft_of_the_users_own_is_refused(tmp_path):
    adopted, file = adopted_at(STOCK / "SGS"), tmp_path / "mine" / "aircraft.toml"
    write_adopted(adopted, tmp_path / "mine")
    text = file.read_text()
    write_adopted(adopted, tmp_path / "mine")
    file.write_text("edited")
    with pytest.warns(UserWarning, match="changed by hand"):
        write_adopted(adopted, tmp_path / "mine")
    assert (file.read_text(), file.with_name("aircraft.toml.kept").read_text()) == (text, "edited")
    own = tmp_path / "own" / "aircraft.toml"
    own.parent.mkdir()
    own.write_text("mine")
    with pytest.raises(WriteError, match=r"no manifest lists '.*aircraft\.toml'"):
        write_adopted(adopted, own.parent)
    assert [p.read_text() for p in own.parent.iterdir()] == ["mine"]


def test_a_killed_adoption_leaves_no_half_aircraft(tmp_path):
    adopted = adopted_at(STOCK / "SGS")
    ends = set()
    for step in (1, 5, 9, *range(13, 27), 500):
        folder = tmp_path / str(step) / "mine"
        folder.mkdir(parents=True)
        (folder / "notes.txt").write_text("mine")
        killed = killed_at(step, lambda folder=folder: write_adopted(adopted, folder))
        made = shown(folder) - {"notes.txt"}
        assert made in (set(), {"mine.xml", "aircraft.toml"})
        ends.add((killed, bool(made)))
        write_adopted(adopted, folder)
        assert whole(folder)
        assert shown(folder) == {"mine.xml", "aircraft.toml", "notes.txt"}
    assert ends == {(True, False), (True, True), (False, True)}


def test_the_file_says_what_was_found_and_what_was_assumed():
    text = described(adopted_at(STOCK / "T38"), "T38.xml")
    for words in ("Found:", "Assumed:", "states no angle of it", "gives no ixz: zero", "Engines: turbine J85-GE-5",
                  "a control law of the model"):  # fmt: skip
        assert words in " ".join(text.replace("\n#", "\n").split()), words


def test_asymmetric_throws_are_kept_to_both_sides():
    c172p = load_aircraft("jsbsim:c172p")
    assert c172p.controls["de"].low == pytest.approx(-28.0 * DEG_RAD, rel=1e-3)
    assert c172p.controls["de"].full == pytest.approx(23.0 * DEG_RAD, rel=1e-3)
    assert load_aircraft("jsbsim:f16", commanded_at="surface").has_servo("de")
    assert not c172p.has_servo("de")


def test_an_adopted_aircraft_can_be_sent_to_another_process():
    aircraft = load_aircraft("jsbsim:SGS")
    again = pickle.loads(pickle.dumps(aircraft))
    assert again.xml == aircraft.xml
    assert again.coefficient("CL_alpha") == pytest.approx(aircraft.coefficient("CL_alpha"), rel=1e-9)


def test_the_left_aileron_is_not_needed_to_know_da():
    aircraft = load_aircraft("jsbsim:f16")  # whose fcs/left-aileron-pos-rad stays zero
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    assert np.isfinite(trimmed.state["da"])
    assert aircraft.coefficient("Cl_da") > 0.01
