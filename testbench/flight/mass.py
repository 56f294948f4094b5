"""Reference geometry, mass and inertia of a model as it flies: fuel, point masses and all."""

from __future__ import annotations

import math
from pathlib import Path

from testbench.aircraft.model import Geometry, MassProperties
from testbench.core.constants import FT_M, SLUG_FT2, SLUG_KG
from testbench.core.errors import ModelError
from testbench.flight.executive import Executive


def geometry_flown(fdm: Executive, file: Path) -> Geometry:
    """Return reference area, span and mean chord.

    Raises:
        ModelError: one of them is missing or not positive; ``file`` is named.
    """
    S, b, cbar = (fdm.get(f"metrics/{n}") for n in ("Sw-sqft", "bw-ft", "cbarw-ft"))
    for words, value in (("wing area <wingarea>", S), ("span <wingspan>", b), ("mean chord <chord>", cbar)):
        if not value > 0.0:
            raise ModelError(f"{words} > 0 must hold in <metrics>, got {value:g} in '{file}'")
    return Geometry(S * FT_M**2, b * FT_M, cbar * FT_M)


def mass_flown(fdm: Executive, file: Path) -> MassProperties:
    """Return mass and inertias, fuel and point masses included.

    Raises:
        ModelError: the mass or a moment of inertia is not positive; ``file`` is named.
    """
    mass = fdm.get("inertia/mass-slugs") * SLUG_KG
    Ixx, Iyy, Izz, Ixz = (fdm.get(f"inertia/{n}-slugs_ft2") * SLUG_FT2 for n in ("ixx", "iyy", "izz", "ixz"))
    for words, value in (("mass", mass), ("Ixx", Ixx), ("Iyy", Iyy), ("Izz", Izz)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ModelError(f"{words} > 0 must hold in <mass_balance>, got {value:g} in '{file}'")
    return MassProperties(mass, Ixx, Iyy, Izz, Ixz)
