"""What every aircraft folder must do, packaged or brought."""

import pytest

from testbench.core.paths import aircraft_names
from testbench.flight import load_aircraft
from testbench.questions.aircraft.contract import aircraft_laws


@pytest.mark.parametrize("name", aircraft_names())
def test_aircraft(name):
    laws = aircraft_laws(load_aircraft(name))
    assert [law.sentence for law in laws if not law.holds] == []
    assert len(laws) == 5 + len(load_aircraft(name).controls)
