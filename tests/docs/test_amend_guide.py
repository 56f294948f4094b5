"""The commands of the guide that writes derivatives back into an aircraft, run as they stand there."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from changed_flights import NOISE, UNITS, changed_aircraft, flown, steps
from commands import command

import testbench as tb
from testbench.core.paths import AIRCRAFT_MODELS

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "from_log_to_derivatives.md"


@pytest.mark.slow
def test_the_guide_s_way_from_a_log_to_an_amended_aircraft_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(AIRCRAFT_MODELS / "taurus", "aircraft/plane")
    Path("aircraft/plane/taurus.xml").rename("aircraft/plane/plane.xml")
    toml = Path("aircraft/plane/aircraft.toml")
    toml.write_text(toml.read_text().replace("taurus.xml", "plane.xml"))
    truth = changed_aircraft("taurus", {"Cm_q": 0.6, "Cm_alpha": 1.25})
    first, second = steps(5.0, 0.24, 0.5), steps(25.0, 0.24, 0.5)
    record = flown(truth, 15.0, 100.0, {"de": lambda t: first(t) + second(t)}, 40.0)
    rng, names = np.random.default_rng(2), ("V", "h", "alpha", "q", "theta", "de")
    columns = [np.degrees(record[c]) if UNITS[c].startswith("deg") else record[c] for c in names]
    columns = [y + NOISE.get(c, 0.0) * rng.standard_normal(len(y)) for c, y in zip(names, columns, strict=True)]
    head = ",".join(["time [s]", *(f"{c} [{UNITS[c]}]" for c in names)])
    np.savetxt("flight.csv", np.column_stack([record.t_s, *columns]), "%.9g", ",", header=head, comments="")
    chapter = GUIDE.read_text("utf-8").split("## Back into the aircraft")[1]
    lines = re.search(r"```sh\n(.*?)```", chapter, re.DOTALL)[1].splitlines()
    assert len(lines) == 3
    said = []
    for line in lines:
        done = command(*shlex.split(line)[1:])
        assert done.returncode == 0, f"{line}: {done.stderr}"
        said.append(done.stdout)
    assert "'plane_flown': M_q" in said[0] or "'plane_flown': M_alpha" in said[0]
    assert "laws kept" in said[1]
    old, new = (tb.load_aircraft(name).coefficient("Cm_q") for name in ("plane", "plane_flown"))
    assert new / old == pytest.approx(0.6, abs=0.05)
