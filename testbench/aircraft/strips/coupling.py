"""From mode shapes to the elastic modes that fly: generalised forces and effects by strips, and their text in TOML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft.elastic import ElasticMode, WingShape
from testbench.aircraft.strips.loads import StripModel
from testbench.aircraft.strips.shapes import Shape, Wing
from testbench.core.escape import quoted
from testbench.core.record import FloatArray

MOTIONS = {True: ("zero", "alpha", "q", "de"), False: ("beta", "p", "r", "da", "dr")}
"""Symmetric or not -> the rigid motions and controls that drive such modes."""


@dataclass(frozen=True, eq=False)
class Vibration:
    """A mode as a ground vibration test finds it, or as it is assumed.

    Attributes:
        name: for people.
        f_hz, zeta: natural frequency and damping ratio, without air.
        mass_kg_m2: generalised mass per unit of the coordinate that ``shape`` belongs to.
        shape: at the strips.
    """

    name: str
    f_hz: float
    zeta: float
    mass_kg_m2: float
    shape: Shape


def coupled_modes(
    vibrations: Sequence[Vibration], symmetric: StripModel, asymmetric: StripModel, stations_m: FloatArray
) -> tuple[ElasticMode, ...]:
    """Return the modes with all aerodynamic coefficients; modes of different symmetry do not couple.

    Args:
        vibrations: the modes, in the order in which they are numbered.
        symmetric: strips of the symmetric motions.
        asymmetric: strips of the asymmetric motions; both have one plan form.
        stations_m: (n,) places y along the right wing at which the shapes are written.
    """
    out = []
    for v in vibrations:
        model = symmetric if v.shape.symmetric else asymmetric
        alike = {j: w.shape for j, w in enumerate(vibrations, 1) if w.shape.symmetric == v.shape.symmetric}
        forms = (at_stations(model.wing, values, stations_m) for values in (v.shape.bend, v.shape.twist))
        curvature = at_stations(model.wing, v.shape.curvature, stations_m)
        out.append(
            ElasticMode(
                v.name,
                v.f_hz,
                v.zeta,
                v.mass_kg_m2,
                "symmetric" if v.shape.symmetric else "asymmetric",
                {m: model.force(model.flow(m), v.shape) for m in MOTIONS[v.shape.symmetric]},
                {j: model.force(model.flow_of_deflection(s), v.shape) for j, s in alike.items()},
                {j: model.force(model.flow_of_rate(s), v.shape) for j, s in alike.items()},
                model.effect(model.flow_of_deflection(v.shape)),
                model.effect(model.flow_of_rate(v.shape)),
                WingShape(*(tuple(map(float, form)) for form in (*forms, curvature))),
                {j: model.force(model.rotary(s), v.shape) for j, s in alike.items()},
            )
        )
    return tuple(out)


def at_stations(wing: Wing, values: FloatArray, stations_m: FloatArray) -> FloatArray:
    """Return a quantity of the strips (n,) at stations (k,) along the right wing, by a cubic spline."""
    from scipy.interpolate import CubicSpline

    found = CubicSpline(wing.y, values)(stations_m)
    return np.where(np.abs(found) < 1e-12, 0.0, found)


def elastic_toml(modes: Sequence[ElasticMode], stations_m: FloatArray, comments: Sequence[str] = ()) -> str:
    """Return the [elastic] table of aircraft.toml, numbers with five digits.

    Args:
        modes: with shapes.
        stations_m: (n,) of the shapes.
        comments: one per mode, or none: lines that stand above it, each beginning with "#".
    """
    blocks = []
    for i, mode in enumerate(modes):
        tables: dict[str, Mapping[str, float] | Mapping[int, float]] = {
            "force": mode.force,
            "force_eta": mode.force_eta,
            "force_etadot": mode.force_etadot,
            "force_rotary": mode.force_rotary,
            "effect_eta": mode.effect_eta,
            "effect_etadot": mode.effect_etadot,
        }
        head = f"[[elastic.mode]]\nname = {quoted(mode.name)}\nf_hz = {mode.f_hz}\nzeta = {mode.zeta}\n"
        head += f'mass_kg_m2 = {mode.mass_kg_m2:.5g}\nsymmetry = "{mode.symmetry}"\n'
        rows = (f"{key} = {{ {', '.join(f'{k} = {v:.5g}' for k, v in t.items())} }}\n" for key, t in tables.items())
        assert mode.shape is not None
        form = ", ".join(
            f"{key} = [{', '.join(f'{v:.5g}' for v in getattr(mode.shape, key))}]"
            for key in ("bend_m", "twist_rad", "curvature_1_m")
        )
        said = comments[i] if comments else ""
        blocks.append(said + head + "".join(rows) + f"shape = {{ {form} }}\n")
    stations = ", ".join(f"{y:g}" for y in stations_m)
    return f"[elastic]\nstations_m = [{stations}]\n\n" + "\n".join(blocks)
