"""The folder of a new campaign: project.toml, and a design for each motion that its sensors see."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.core.errors import RecordError
from testbench.core.escape import quoted, real
from testbench.core.files import write_file
from testbench.core.paths import AIRCRAFT, SENSOR_SUITES, STOCK, resolve
from testbench.core.project import FILE
from testbench.core.store import ResultFolder, is_fresh
from testbench.flight import load_aircraft
from testbench.flight.linear_model import PLANE_CONTROLS
from testbench.questions.files import SCHEMAS, schema_files, to_edit
from testbench.sensors import SensorSuite, load_suite
from testbench.sensors.suite import needed

WANTED: Mapping[str, Mapping[str, float]] = {
    "longitudinal": {"Z_alpha": 5.0, "M_alpha": 5.0, "M_q": 10.0, "M_de": 5.0},
    "lateral": {"L_beta": 10.0, "L_p": 5.0, "L_da": 5.0, "N_beta": 5.0, "N_r": 10.0, "N_dr": 5.0},
}
"""Motion -> derivative -> standard error that is wanted, percent."""


def new_project(name: Path | str, aircraft: str, sensors: str, speeds_m_s: Sequence[float] = ()) -> list[Path]:
    """Write the folder of a campaign; return its files.

    Args:
        name: the folder, which must not be there.
        aircraft: packaged, a path, or a name in ``aircraft/``.
        sensors: a packaged suite, a file, or a name in ``suites/``.
        speeds_m_s: true airspeeds to fly at; the aircraft's design speed if none is given.

    Raises:
        RecordError: the folder holds something, or its sensors see no motion that a control moves.
        ScenarioError, ModelError: no such aircraft or suite.

    Example:
        >>> import testbench as tb
        >>> tb.new_project("my_project", "taurus", "eolo_alpha")  # doctest: +SKIP
    """
    folder = Path(name)
    _must_be_new(folder)
    flown, suite = load_aircraft(aircraft), load_suite(sensors)
    designs = {motion: _targets(motion, flown, suite) for motion in WANTED}
    if not any(designs.values()):
        raise RecordError(f"the sensors of a project must see a motion ({needed()}), got {', '.join(suite.channels)}")
    speeds = list(speeds_m_s) or [flown.design_V_m_s]
    text = _text(folder.name, _named(aircraft, AIRCRAFT, folder), _named(sensors, SENSOR_SUITES, folder), flown, speeds)
    rate_hz = suite.rate_hz * math.ceil(flown.rate_hz / suite.rate_hz - 1e-9)
    if not math.isclose(rate_hz, flown.rate_hz):
        text += f"\n[simulation]\nrate_hz = {real(rate_hz)}  # a multiple of the rate of the sensors\n"
    unseen = [m for m, wanted in designs.items() if not wanted]
    text += "\n[accuracies]                 # wanted standard errors, percent: those that these sensors can determine\n"
    text += "".join(f"{n} = {real(x)}\n" for wanted in designs.values() for n, x in wanted.items())
    text += "".join(f"# Nothing of the {m} motion: that needs {needed(m)} among the sensors.\n" for m in unseen)
    files = {FILE: to_edit(text, "project")}
    files |= {f"{m}.toml": to_edit(_design(m, flown), "design scenario") for m, wanted in designs.items() if wanted}
    with ResultFolder(folder) as place:
        _must_be_new(folder)  # another process may have been there
        schemas = {f"{SCHEMAS}/{n}": x for n, x in schema_files(("project", "design scenario")).items()}
        for file, content in (schemas | files).items():
            write_file(place.new / file, content)
    return [folder / file for file in files]


def _must_be_new(folder: Path) -> None:
    if not is_fresh(folder):
        raise RecordError(f"a new project must go to a new folder, got '{folder}', which is there; give another name")


def _targets(motion: str, aircraft: Aircraft, suite: SensorSuite) -> dict[str, float]:
    """Return the derivatives that the sensors can tell -> wanted error."""
    moved = [c for c in PLANE_CONTROLS[motion] if c in aircraft.controls]
    if not moved or not suite.sees(motion):
        return {}
    felt = bool({"alpha", "az"} & set(suite.channels))
    return {
        name: error
        for name, error in WANTED[motion].items()
        if (felt or not name.startswith("Z")) and (name[2:] not in ("de", "da", "dr") or name[2:] in moved)
    }


def _named(name: str, family: object, folder: Path) -> str:
    """Return what a project calls an aircraft or suite: a path from its folder if it is the user's own."""
    meant = resolve(name, family)  # type: ignore[arg-type]
    if meant.startswith(STOCK) or not Path(meant).is_absolute():
        return meant
    return Path(os.path.relpath(meant, folder.resolve())).as_posix()


def _text(title: str, aircraft: str, suite: str, flown: Aircraft, speeds: Sequence[float]) -> str:
    return f"""# A campaign, made by `testbench new`. Files in this folder take the keys that they omit from here.
# Commands that are run here add their results to the end. `testbench` alone prints the state of the campaign.
title = {quoted(title)}
aircraft = {quoted(aircraft)}  # structure, servos and stops: in its aircraft.toml
suite = {quoted(suite)}  # sensors as sold, with places, lags and noise: `testbench list sensors`, or a file of yours
speeds_m_s = [{", ".join(real(V) for V in speeds)}]  # true airspeeds; designs are for the middle one
h_m = {real(flown.design_h_m)}  # above sea level
by = "autopilot"  # or "pilot": who flies the cards

[limits]                     # YOURS: of designs and plans that do not state them
load_factor = [0.3, 1.7]
# [air]                      # a calm morning, if it is not given; 0.0 is still air
# turbulence_rms_m_s = 0.3
"""


def _design(motion: str, aircraft: Aircraft) -> str:
    controls = ", ".join(quoted(c) for c in PLANE_CONTROLS[motion] if c in aircraft.controls)
    return f"""# Keys that are omitted here are in {FILE}: the targets are the accuracies of this motion.
title = {quoted(f"Which input determines the {motion} motion?")}
controls = [{controls}]
duration_s = 10.0
"""
