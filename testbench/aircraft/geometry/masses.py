"""Mass, centre of gravity and inertias: as given, from a list of items, or from radii of gyration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft.geometry.schema import Item, Mass, _check_inertias
from testbench.core.errors import ScenarioError

# Radii of gyration over half the span, half the length and half their mean: D. P. Raymer, Aircraft Design: A Conceptual
# Approach, table "nondimensional radii of gyration", single-engine propeller aircraft.
GYRATION = (0.25, 0.38, 0.39)
_OFF_CENTRE = 0.01  # of the span, by which the centre of gravity may lie beside y = 0


@dataclass(frozen=True)
class Balance:
    """Mass (kg), centre of gravity (m; x aft, y right, z up), and inertias about it in body axes (kg m2).

    ``Ixz`` is the integral of x z with x forward and z down. ``source`` says where they come from.
    """

    mass_kg: float
    cg_m: tuple[float, float, float]
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float
    source: str


def balance(mass: Mass, b_m: float, length_m: float) -> Balance:
    """Return what the file says, or what follows from it; see :class:`.schema.Mass`.

    Args:
        mass: of the file.
        b_m: span, for inertias by radii of gyration.
        length_m: likewise.

    Raises:
        ScenarioError: the items make no body, or lie to one side.
    """
    if mass.item:
        found = of_items(mass.item)
    else:
        assert mass.mass_kg is not None  # the schema has seen to it
        assert mass.cg_m is not None
        if mass.Ixx_kg_m2 is not None and mass.Iyy_kg_m2 is not None and mass.Izz_kg_m2 is not None:
            axes = (mass.Ixx_kg_m2, mass.Iyy_kg_m2, mass.Izz_kg_m2, mass.Ixz_kg_m2 or 0.0)
            source = "given" + ("" if mass.Ixz_kg_m2 is not None else "; Ixz assumed 0")
        else:
            halves = (0.5 * b_m, 0.5 * length_m, 0.25 * (b_m + length_m))
            Ixx, Iyy, Izz = (mass.mass_kg * (k * h) ** 2 for k, h in zip(GYRATION, halves, strict=True))
            axes = (Ixx, Iyy, min(Izz, Ixx + Iyy), 0.0)
            source = (
                "mass and centre of gravity given; inertias estimated from span and length with Raymer's radii "
                "of gyration "
                f"of single-engine propeller aircraft ({', '.join(f'{k:g}' for k in GYRATION)}), Ixz assumed 0"
            )
        found = Balance(mass.mass_kg, mass.cg_m, *axes, source)
    if abs(found.cg_m[1]) > _OFF_CENTRE * b_m:
        raise ScenarioError(
            f"the centre of gravity must lie in the plane of symmetry, got y = {found.cg_m[1]:g} m: balance the masses"
        )
    return found


def of_items(items: Sequence[Item]) -> Balance:
    """Return mass, centre of gravity and inertias of point masses and boxes.

    A box of mass m and extents a, b, c has m (b^2 + c^2) / 12 about its own x axis, and so on; the parallel-axis
    theorem brings it to the common centre.

    Raises:
        ScenarioError: no body has the inertias that follow, as when all points lie on one line.
    """
    m, at, size = [], [], []
    for item in items:
        for sign in (1.0, -1.0) if item.mirrored else (1.0,):
            m.append(item.mass_kg)
            at.append((item.at_m[0], sign * item.at_m[1], item.at_m[2]))
            size.append(item.size_m)
    masses, places, extents = np.array(m), np.array(at), np.array(size)
    total = float(masses.sum())
    cg = masses @ places / total
    d = places - cg
    square = d**2 + extents**2 / 12.0
    moments = masses @ (square.sum(axis=1, keepdims=True) - square)
    Ixx, Iyy, Izz = (float(v) for v in moments)
    Ixz = float(masses @ (d[:, 0] * d[:, 2]))  # both axes of the body point the other way: the product keeps its sign
    try:
        _check_inertias(Ixx, Iyy, Izz, Ixz)
        if min(Ixx, Iyy, Izz) <= 0.0:
            raise ValueError("every inertia must be > 0")
    except ValueError as error:
        raise ScenarioError(f"items must make a body with inertia about every axis, got Ixx = {Ixx:g}, Iyy = {Iyy:g}, "
                             f"Izz = {Izz:g} kg m2 ({error}): give more items, or sizes") from error  # fmt: skip
    x, y, z = (float(v) for v in cg)
    return Balance(total, (x, y, z), Ixx, Iyy, Izz, Ixz, f"computed from {len(items)} items of the geometry file")
