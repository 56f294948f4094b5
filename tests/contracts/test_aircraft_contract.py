"""What every aircraft folder must do, packaged or brought."""

from __future__ import annotations

import shutil

import pytest

from testbench.core.paths import AIRCRAFT_MODELS, aircraft_names
from testbench.flight import load_aircraft
from testbench.questions.aircraft.contract import aircraft_laws


@pytest.mark.parametrize("name", aircraft_names())
def test_aircraft(name):
    laws = aircraft_laws(load_aircraft(name))
    assert [law.sentence for law in laws if not law.holds] == []
    assert len(laws) == 5 + len(load_aircraft(name).controls)


def test_an_elevator_of_the_wrong_sign_is_told(tmp_path):
    folder = tmp_path / "wrong"
    shutil.copytree(AIRCRAFT_MODELS / "taurus", folder)
    model = folder / "taurus.xml"
    text = model.read_text(encoding="utf-8")
    before, after = text.split('name="aero/coefficient/Cm_de"')
    i, j = after.index("<value>") + len("<value>"), after.index("</value>")
    model.write_text(
        f'{before}name="aero/coefficient/Cm_de"{after[:i]}{-float(after[i:j])}{after[j:]}', encoding="utf-8"
    )
    broken = [law for law in aircraft_laws(load_aircraft(folder)) if not law.holds]
    assert [law.words for law in broken] == ["a positive step of de makes q fall first"]
    assert "check the sign of de" in broken[0].why
