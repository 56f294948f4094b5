"""Derive the assumed mode shapes of the examples in this folder, by Rayleigh-Ritz with the masses in their files.

    python scenarios/ground_tests/derive.py            # print them
    python scenarios/ground_tests/derive.py --write    # write the CSV files

Nobody has tested these aircraft: frequencies are assumed for the reasons in the files, the stiffness is what puts the
modes there, and the shapes follow.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from testbench.aircraft.outline import Surface
from testbench.aircraft.strips.ground_test import GroundTestFile
from testbench.aircraft.strips.loads import Shape, Tail, Wing, at_stations
from testbench.aircraft.strips.ritz import Modes, Stiffness, symmetric_modes
from testbench.core.door import read_toml
from testbench.core.schema import parse

FOLDER = Path(__file__).resolve().parent
STIFF = 1e9  # a fuselage that does not bend, N/m
STATIONS = 9
# File, plan form of the wing, distance of the tail, mass and Iyy of the aircraft, power of the chord that stiffness
# goes with. Plan forms: taurus.xml's drawing; sailplane.toml. Masses: taurus.xml; SGS.xml (710 lb, 672 slug ft2).
TAURUS_WING = Surface(span_m=1.27, root_chord_m=0.221, tip_chord_m=0.221, x_m=0.015)


def tests() -> dict[str, GroundTestFile]:
    """Return the files by the name of what they are written to."""
    out = {}
    for name in ("taurus", "sailplane"):
        path = FOLDER / f"{name}.toml"
        content, faults = parse(GroundTestFile, read_toml(path), path)
        if content is None or faults:
            raise SystemExit("\n".join(faults))
        out[name] = content
    return out


def modes_of(test: GroundTestFile, surface: Surface, arm_m: float, mass_kg: float, Iyy: float) -> tuple[Wing, Modes]:
    """Return the wing and its symmetric modes, with the stiffness that gives the frequencies of the file."""
    mass, taper = test.mass, surface.tip_chord_m / surface.root_chord_m
    assert mass is not None
    assert mass.wing_kg is not None
    axis = test.strips.elastic_axis
    assert axis is not None
    wing = Wing(
        surface.span_m,
        surface.root_chord_m,
        taper,
        mass.wing_kg,
        axis,
        mass.centre_of_mass,
        mass.gyration,
        6.0,
        surface.x_m,
    )
    tail = Tail(arm_m, mass.tail_kg, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    wanted = np.array([m.f_hz for m in test.mode])

    def made(v: np.ndarray) -> Modes:
        power = 2.0 if taper < 1.0 else 0.0
        return symmetric_modes(wing, tail, Stiffness(*np.exp(v), power, STIFF, STIFF, STIFF), mass_kg, Iyy)

    def miss(v: np.ndarray) -> np.ndarray:
        torsion = v if len(wanted) > 1 else np.array([v[0], v[0] + 1.0])  # far above, where it is not asked for
        return np.log(made(torsion).f_hz[: len(wanted)] / wanted)

    start = np.log(mass_kg * surface.span_m**3 * wanted[0] ** 2 * np.array([0.3, 0.02]))[: len(wanted)]
    found = least_squares(miss, start).x
    return wing, made(found if len(wanted) > 1 else np.array([found[0], found[0] + 1.0]))


def table(wing: Wing, shapes: list[Shape]) -> str:
    """Return the CSV file of shapes, each divided by its largest motion at the tip."""
    y = np.linspace(0.0, 0.5 * wing.span_m, STATIONS)
    heads, columns = ["y_m"], [y]
    for i, shape in enumerate(shapes, 1):
        bend, twist = (at_stations(wing, v, y) for v in (shape.bend, shape.twist))
        size = bend[-1] if abs(bend[-1]) > abs(twist[-1]) * wing.root_chord_m else twist[-1]
        heads += [f"bend_m_{i}", f"twist_rad_{i}"]
        columns += [bend / size, twist / size]
    rows = [",".join(f"{v:.5g}" for v in row) for row in np.column_stack(columns)]
    return "\n".join([",".join(heads), *rows]) + "\n"


def files() -> dict[Path, str]:
    """Return path -> text of the CSV files."""
    found = tests()
    sailplane = found["sailplane"]
    assert sailplane.wing is not None
    assert sailplane.tail is not None
    out = {}
    for name, surface, arm, mass, Iyy in (
        ("taurus", TAURUS_WING, 0.62, 1.8, 0.079),
        ("sailplane", sailplane.wing, -sailplane.tail.x_m, 322.1, 911.1),
    ):
        wing, modes = modes_of(found[name], surface, arm, mass, Iyy)
        out[FOLDER / f"{name}_shapes.csv"] = table(wing, modes.shapes[: len(found[name].mode)])
    return out


if __name__ == "__main__":
    for path, text in files().items():
        print(f"{path.name}\n{text}")
        if "--write" in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
