"""The modes of one motion by name, and the onset of vibration."""

from __future__ import annotations

from testbench.aircraft import Aircraft
from testbench.evaluation.modes import longitudinal_modes, name_modes, poles_of, spectrum
from testbench.flight import LinearModel

RIGID_MODES = {"longitudinal": ("phugoid", "short period"), "lateral": ("Dutch roll", "roll", "spiral")}
"""Plane -> names of its rigid modes."""


def elastic_modes(aircraft: Aircraft, plane: str) -> dict[int, str]:
    """Return number -> name of the elastic modes that belong to a plane; equal names carry their number."""
    elastic = aircraft.flown_modes()
    modes = elastic.modes if elastic else ()
    names = [m.name for m in modes]
    wanted = "symmetric" if plane == "longitudinal" else "asymmetric"
    return {
        i: m.name if names.count(m.name) == 1 else f"{m.name} ({i})"
        for i, m in enumerate(modes, 1)
        if m.symmetry == wanted
    }


def modes_of(linear: LinearModel, aircraft: Aircraft, plane: str) -> dict[str, complex]:
    """Return name -> pole, rad/s, of the motion in one plane, its elastic modes included; slow ones first."""
    elastic = elastic_modes(aircraft, plane)
    if plane == "longitudinal":
        return longitudinal_modes(linear, elastic)
    found = spectrum(linear, "lateral-directional", elastic)
    out: dict[str, complex] = {}
    for name, owned in name_modes(found, elastic).items():
        poles = poles_of(found, owned)
        roots = ("", ", fast root") if len(poles) == 1 else (", slow root", ", fast root")
        out |= {f"{name}{text}": pole for text, pole in zip(roots, poles, strict=False)}
    return dict(sorted(out.items(), key=lambda item: abs(item[1])))
