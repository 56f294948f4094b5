"""Ground vibration tests whose answer is known: eolo's own modes, written down as somebody would bring them."""

from __future__ import annotations

import importlib.util
import re
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np

from testbench.aircraft.strips.shapes import Shape
from testbench.core.paths import AIRCRAFT_MODELS, SCENARIOS

EXAMPLES = SCENARIOS / "ground_tests"
PLAN_FORM = """
[wing]
span_m = 4.0
root_chord_m = {root!r}
tip_chord_m = {tip!r}
x_m = 0.022
[tail]
span_m = 0.5
root_chord_m = 0.1412
tip_chord_m = 0.0988
x_m = -1.05
[fin]
span_m = 0.25
root_chord_m = 0.30
tip_chord_m = 0.18
x_m = -1.05
[strips]
own_derivatives = false
elastic_axis = 0.35
lift_slope_1_rad = 5.65
tail_lift_slope_1_rad = 3.3
fin_lift_slope_1_rad = 2.8
downwash = 0.35
elevator_effectiveness = 0.55
rudder_effectiveness = 0.5
fin_height_m = 0.08
dihedral_deg = 4.0
CL = 0.69
zero_lift_deg = {zero!r}
aileron = {{ inner_m = 1.2, outer_m = 1.9, effectiveness = 0.4 }}
"""
MASS = """
[mass]
evidence = "assumed"
wing_kg = 3.0
centre_of_mass = 0.42
gyration = 0.27
tail_kg = 0.35
tail_roll_inertia_kg_m2 = 0.006
tail_mass_height_m = 0.036
"""
HEAD = 'source = "eolo"\nevidence = "computed"\nnormalisation = "given"\n'


def script(path: Path) -> ModuleType:
    """Import a script by its path."""
    spec = importlib.util.spec_from_file_location(f"script_{path.parent.name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rigid_eolo(folder: Path) -> Path:
    """Write eolo without its modes and wing stations; return its folder."""
    out = folder / "aircraft" / "stiff"
    shutil.copytree(AIRCRAFT_MODELS / "eolo", out)
    path = out / "aircraft.toml"
    text = re.split(r"^\[elastic\]$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[0]
    text = re.sub(r"^wing_station = \[.*?^\]\n", "", text, flags=re.MULTILINE | re.DOTALL)
    path.write_text(re.sub(r"^eta = .*\n", "", text, flags=re.MULTILINE), encoding="utf-8")
    return out


def entry(mode: tuple[str, float, float], shape: Shape, mass: float | None, rows: str) -> str:
    """Return one [[mode]] of a file."""
    name, f_hz, zeta = mode
    text = f'[[mode]]\nname = "{name}"\nf_hz = {f_hz}\nzeta = {zeta}\n'
    text += f'symmetry = "{"symmetric" if shape.symmetric else "asymmetric"}"\n' + rows
    text += "" if mass is None else f"mass_kg_m2 = {mass!r}\n"
    keys = ("up", "pitch") if shape.symmetric else ("side", "roll", "yaw")
    for key in keys:
        unit = "m" if key in ("up", "side") else "rad"
        text += f"tail_{key}_{unit} = {float(getattr(shape, f'tail_{key}'))!r}\n"
    return text


def eolo_test(folder: Path, derive: ModuleType, masses: bool = True) -> Path:
    """Write eolo's own modes at its strips, one CSV file per mode, with all that its strips are made of."""
    shapes, generalised, _ = derive.modes()
    text = HEAD
    for i, (row, shape, mass) in enumerate(zip(derive.GROUND_TEST, shapes, generalised, strict=True), 1):
        columns = np.column_stack([derive.WING.y, shape.bend, shape.twist, shape.curvature])
        lines = [",".join(repr(float(v)) for v in line) for line in columns]
        (folder / f"mode_{i}.csv").write_text(
            "\n".join(["y_m,bend_m,twist_rad,curvature_1_m", *lines]) + "\n", encoding="utf-8"
        )
        rows = f'csv = "mode_{i}.csv"\nunit = "given"\n'
        text += entry((row[2], row[3], row[4]), shape, mass if masses else None, rows)
    root = derive.WING.root_chord_m
    text += PLAN_FORM.format(root=root, tip=root * derive.TAPER, zero=float(np.degrees(0.30 / 5.65)))
    path = folder / "eolo_modes.toml"
    path.write_text(text + ("" if masses else MASS), encoding="utf-8")
    return path
