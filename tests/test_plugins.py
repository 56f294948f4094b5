"""A package as docs/guides/publish_a_plug_in.md shows it, installed: what it brings is listed, checked and used."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np

from testbench.core.paths import AIRCRAFT_MODELS, SUITES
from testbench.core.record import FlightRecord

ROOT = Path(__file__).resolve().parents[1]
GUIDE = (ROOT / "docs" / "guides" / "publish_a_plug_in.md").read_text(encoding="utf-8")
ASKED = """
import json, sys
from pathlib import Path
import testbench as tb
from testbench.core.bring import find
from testbench.core.errors import TestbenchError
from testbench.questions.files import FAMILIES
from testbench.questions.export.ask import export_record

def refused(call):
    try:
        call()
    except TestbenchError as error:
        return str(error)

print(json.dumps({
    "listed": {kind: [row[0] for row in FAMILIES[kind]()] for kind in ("aircraft", "sensors", "estimators", "effects")},
    "mass_kg": tb.load_aircraft("gliders:asw").mass.mass_kg,
    "rate_hz": tb.load_suite("gliders:logger").rate_hz,
    "code": [str(part) for part in find("gliders:ridge", None, "estimators")],
    "written": export_record(Path(sys.argv[1]), "gliders:igc").name,
    "near": refused(lambda: tb.load_aircraft("gliders:asv")),
    "lost": refused(lambda: find("gliders:late_airbrake", None, "effects")),
    "jsbsim": refused(lambda: tb.load_aircraft("jsbsim:nothing")),
}))
"""


def block(language: str) -> str:
    """Return the one block of code in a language that the guide has."""
    (found,) = [part.partition("```")[0] for part in GUIDE.split(f"```{language}\n")[1:]]
    return found


def test_what_an_installed_package_brings_is_listed_loaded_and_missed_by_name(tmp_path):
    package, about = tmp_path / "gliders", tmp_path / "gliders-0.1.dist-info"
    shutil.copytree(AIRCRAFT_MODELS / "taurus", package / "asw")
    shutil.copy(SUITES / "taurus_8hz.toml", package / "logger.toml")
    (package / "__init__.py").write_text("raise AssertionError('nothing needs the package itself')")
    (package / "ridge.py").write_text("def estimate(records, inputs, outputs): ...")
    (package / "igc.py").write_text(block("python"), encoding="utf-8")
    project = tomllib.loads(block("toml"))["project"]
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = project["entry-points"].items()
    lines = [f"[{group}]\n" + "".join(f"{n} = {v}\n" for n, v in rows.items()) for group, rows in groups]
    (about / "entry_points.txt").write_text("\n".join(lines))
    t_s = 0.1 * np.arange(20)
    record = FlightRecord(t_s, ("h",), 100.0 + t_s[:, None], "measured").save(tmp_path / "flight.nc")
    done = subprocess.run(
        [sys.executable, "-c", ASKED, record], cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    for kind, name in (
        ("aircraft", "asw"),
        ("sensors", "logger"),
        ("estimators", "ridge"),
        ("effects", "late_airbrake"),
    ):
        assert f"gliders:{name}" in said["listed"][kind]
    assert (round(said["mass_kg"], 1), said["rate_hz"]) == (1.8, 8.0)
    assert said["code"] == [str(package / "ridge.py"), "estimate"]
    assert (tmp_path / said["written"]).read_text().startswith("0.00 ")
    assert said["written"] == "flight.igc"
    assert "did you mean 'gliders:asw'" in said["near"]
    assert "'gliders.late:EFFECT' of 'gliders:late_airbrake' must name what is there" in said["lost"]
    assert "no model 'nothing' comes with JSBSim" in said["jsbsim"]
