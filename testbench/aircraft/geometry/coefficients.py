"""Which of two methods' values a model carries, and how well each is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

from testbench.aircraft.geometry.aerodynamics import Aerodynamics

_SEEN = "lattice: it sees how the surfaces act on each other"
_SPREAD = "lattice: it finds how the load spreads along the span"
_FLAP = "lattice: it spreads the load of a flap along the span"
_ZERO = "lattice: the build-up does not reduce the lift of camber for a finite span"
_DRAG = "build-up: the lattice has no friction"


@dataclass(frozen=True)
class _Row:
    """A coefficient: description in the XML, why its value is used, least relative standard deviation."""

    words: str
    why: str
    floor: float


# The last numbers are the least relative standard deviations, whatever the two methods agree on: what both of them
# leave out (thickness of the boundary layer, wake of the wing on tail and fin, slots at hinges, fuselage on wing,
# propeller) they leave out alike. All are judged; none is below the deviation that questions/gap/believed.py takes
# for any handbook method. Derivatives of sideslip and yaw rate hang on a fin within the wake of the fuselage; cross
# derivatives are differences of large terms; of a flap, viscosity and slots take 10 to 30 % of what theory without
# them finds.
ROWS = {
    "CL0": _Row("lift at zero alpha", _ZERO, 0.10),
    "CL_alpha": _Row("lift curve slope per rad", _SEEN, 0.05),
    "CL_q": _Row("lift due to pitch rate, q cbar / 2V", _SEEN, 0.20),
    "CL_alphadot": _Row("lift due to alphadot cbar / 2V", _SEEN, 0.40),
    "CL_de": _Row("lift due to elevator per rad", _FLAP, 0.15),
    "CD": _Row("parabolic polar: CD0 + k (CL - CL_min_drag)^2 with CL = CL0 + CL_alpha alpha", _DRAG, 0.20),
    "CY_beta": _Row("side force due to sideslip per rad", _SEEN, 0.20),
    "CY_p": _Row("side force due to roll rate, p b / 2V", _SEEN, 0.50),
    "CY_r": _Row("side force due to yaw rate, r b / 2V", _SEEN, 0.30),
    "CY_da": _Row("side force due to aileron per rad", _SEEN, 0.50),
    "CY_dr": _Row("side force due to rudder per rad", _FLAP, 0.15),
    "Cl_beta": _Row("dihedral effect per rad", _SPREAD, 0.20),
    "Cl_p": _Row("roll damping, p b / 2V", _SPREAD, 0.10),
    "Cl_r": _Row("roll due to yaw rate, r b / 2V", _SPREAD, 0.25),
    "Cl_da": _Row("roll due to aileron per rad", _FLAP, 0.15),
    "Cl_dr": _Row("roll due to rudder per rad", _FLAP, 0.30),
    "Cm0": _Row("pitching moment at zero alpha", _ZERO, 0.30),
    "Cm_alpha": _Row("static stability per rad", _SEEN, 0.10),
    "Cm_q": _Row("pitch damping, q cbar / 2V", _SEEN, 0.15),
    "Cm_alphadot": _Row("moment due to alphadot cbar / 2V", _SEEN, 0.40),
    "Cm_de": _Row("elevator power per rad", _FLAP, 0.15),
    "Cn_beta": _Row("weathercock stability per rad", _SEEN, 0.20),
    "Cn_p": _Row("yaw due to roll rate, p b / 2V", _SPREAD, 0.50),
    "Cn_r": _Row("yaw damping, r b / 2V", _SEEN, 0.25),
    "Cn_da": _Row("yaw due to aileron per rad", _SPREAD, 0.50),
    "Cn_dr": _Row("rudder power per rad", _FLAP, 0.15),
}
NEUTRAL_POINT = 0.03  # of cbar by which either method may miss the neutral point; judged
_NOTHING = 1e-7  # a coefficient below is zero by symmetry


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of the model.

    Attributes:
        name: as in the XML.
        used: its value there; of "CD", that of the polar at the trim.
        buildup, lattice: what either method finds; None if it finds none.
        deviation: relative standard deviation.
        from_difference: whether the methods' difference gives it, not the floor.
        why: whose value is used, and why.
    """

    name: str
    used: float
    buildup: float | None
    lattice: float | None
    deviation: float
    from_difference: bool
    why: str

    @property
    def words(self) -> str:
        """What it is."""
        return ROWS[self.name].words


def coefficients(found: Aerodynamics, CD0_added: float = 0.0) -> dict[str, Coefficient]:
    """Return the coefficients of a model, by name.

    The standard deviation is that of two values, |a - b| / sqrt(2), or the floor of :data:`ROWS` if that is larger.
    That of Cm_alpha has a second floor: the neutral point is known to a share of cbar, so that Cm_alpha = CL_alpha
    (x_cg - x_np) / cbar of an aircraft with a small static margin is known badly, whatever the two methods agree on.

    Args:
        found: by both methods.
        CD0_added: drag that neither of them sees.
    """
    out = {}
    a, b = found.buildup.values, found.lattice.values
    for name, row in ROWS.items():
        if name == "CD":
            out[name] = _drag(found, row, CD0_added)
            continue
        if name not in b or abs(b[name]) < _NOTHING:
            continue
        floor = row.floor
        if name == "Cm_alpha":
            floor = max(floor, NEUTRAL_POINT * b["CL_alpha"] / abs(b[name]))
        apart = abs(a[name] - b[name]) / math.sqrt(2.0) / abs(b[name])
        out[name] = Coefficient(name, b[name], a[name], b[name], max(floor, apart), apart > floor, row.why)
    return out


def _drag(found: Aerodynamics, row: _Row, added: float) -> Coefficient:
    lift = (found.CL - found.CL_least_drag) ** 2
    at_trim = found.CD0 + added + found.buildup.k * lift
    apart = abs(found.buildup.k - found.lattice.k) * lift / math.sqrt(2.0) / at_trim
    return Coefficient("CD", at_trim, at_trim, None, max(row.floor, apart), apart > row.floor, row.why)
