"""Which of two methods' values a model carries, and how well each is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

from testbench.aircraft.geometry.aerodynamics import Aerodynamics

_SEEN = "lattice: it includes the interference of the surfaces"
_SPREAD = "lattice: it computes the distribution of load along the span"
_FLAP = "lattice: it distributes the load of a flap along the span"
_ZERO = "lattice: the build-up does not reduce the lift of camber for a finite span"
_DRAG = "build-up: the lattice has no friction"


@dataclass(frozen=True)
class _Row:
    """A coefficient: description in the XML, why its value is used, and how it compares with published ones.

    ``bias`` is published over computed; ``spread`` the relative standard deviation of what is left; ``floor`` a
    deviation beside it in the coefficient's own unit (of Cm_alpha, over CL_alpha: of the neutral point in cbar).
    """

    words: str
    why: str
    spread: float
    bias: float = 1.0
    floor: float = 0.0


# Fitted on the published derivatives of seven aircraft and held against those of six others
# (tests/studies/corpus_study.py, results/aircraft/corpus.csv). Judged instead: CL0, CD and Cm0, of which the corpus has
# none, and all floors, which are for coefficients that may pass through zero; the corpus gives that of Cm_alpha.
ROWS = {
    "CL0": _Row("lift at zero alpha", _ZERO, 0.10),
    "CL_alpha": _Row("lift curve slope per rad", _SEEN, 0.14),
    "CL_q": _Row("lift due to pitch rate, q cbar / 2V", _SEEN, 0.45, bias=0.85),
    "CL_alphadot": _Row("lift due to alphadot cbar / 2V", _SEEN, 0.49, bias=1.06),
    "CL_de": _Row("lift due to elevator per rad", _FLAP, 0.37, floor=0.05),
    "CD": _Row("parabolic polar: CD0 + k (CL - CL_min_drag)^2 with CL = CL0 + CL_alpha alpha", _DRAG, 0.20),
    "CY_beta": _Row("side force due to sideslip per rad", _SEEN, 0.48, bias=1.02),
    "CY_p": _Row("side force due to roll rate, p b / 2V", _SEEN, 0.30, floor=0.07),
    "CY_r": _Row("side force due to yaw rate, r b / 2V", _SEEN, 0.35, bias=0.93, floor=0.05),
    "CY_da": _Row("side force due to aileron per rad", _SEEN, 0.30, floor=0.03),
    "CY_dr": _Row("side force due to rudder per rad", _FLAP, 0.35, bias=0.88, floor=0.03),
    "Cl_beta": _Row("dihedral effect per rad", _SPREAD, 0.37, bias=0.94, floor=0.01),
    "Cl_p": _Row("roll damping, p b / 2V", _SPREAD, 0.19, bias=0.97),
    "Cl_r": _Row("roll due to yaw rate, r b / 2V", _SPREAD, 0.48, bias=0.91, floor=0.03),
    "Cl_da": _Row("roll due to aileron per rad", _FLAP, 0.32, bias=0.98),
    "Cl_dr": _Row("roll due to rudder per rad", _FLAP, 0.30, floor=0.01),
    "Cm0": _Row("pitching moment at zero alpha", _ZERO, 0.30),
    "Cm_alpha": _Row("static stability per rad", _SEEN, 0.10, floor=0.11),
    "Cm_q": _Row("pitch damping, q cbar / 2V", _SEEN, 0.35, bias=1.06),
    "Cm_alphadot": _Row("moment due to alphadot cbar / 2V", _SEEN, 0.49, bias=1.05),
    "Cm_de": _Row("elevator power per rad", _FLAP, 0.33),
    "Cn_beta": _Row("weathercock stability per rad", _SEEN, 0.34, bias=1.04, floor=0.015),
    "Cn_p": _Row("yaw due to roll rate, p b / 2V", _SPREAD, 0.30, floor=0.06),
    "Cn_r": _Row("yaw damping, r b / 2V", _SEEN, 0.37, bias=1.04, floor=0.01),
    "Cn_da": _Row("yaw due to aileron per rad", _SPREAD, 0.30, floor=0.02),
    "Cn_dr": _Row("rudder power per rad", _FLAP, 0.43, bias=0.92, floor=0.01),
}
_NOTHING = 1e-7  # a coefficient below is zero by symmetry


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of the model."""

    name: str  # as in the XML
    used: float  # its value there, the lattice's times the bias; of "CD", that of the polar at the trim
    # buildup, lattice: what either method finds; None if it finds none
    buildup: float | None
    lattice: float | None
    deviation: float  # relative standard deviation
    why: str  # whose value is used, and why

    @property
    def apart(self) -> bool:
        """Whether the two methods differ by more than the deviation."""
        both = self.buildup is not None and self.lattice is not None
        return both and abs(self.buildup - self.lattice) > self.deviation * abs(self.used)  # type: ignore[operator]

    @property
    def words(self) -> str:
        """What it is."""
        return ROWS[self.name].words


def coefficients(found: Aerodynamics, CD0_added: float = 0.0) -> dict[str, Coefficient]:
    """Return the coefficients of a model, by name.

    The standard deviation has a part that goes with the value and one that does not, those of :data:`ROWS`. Cm_alpha =
    CL_alpha (x_cg - x_np) / cbar of an aircraft with a small static margin is known as badly as its neutral point.

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
        used = row.bias * b[name]
        deviation = relative_deviation(name, used, b["CL_alpha"])
        out[name] = Coefficient(name, used, a[name], b[name], deviation, row.why)
    return out


def relative_deviation(name: str, value: float, CL_alpha: float) -> float:
    """Return the relative standard deviation of a computed coefficient of this value."""
    row = ROWS[name]
    return math.hypot(row.spread, row.floor * (CL_alpha if name == "Cm_alpha" else 1.0) / value)


def _drag(found: Aerodynamics, row: _Row, added: float) -> Coefficient:
    lift = (found.CL - found.CL_least_drag) ** 2
    at_trim = found.CD0 + added + found.buildup.k * lift
    return Coefficient("CD", at_trim, at_trim, None, row.spread, row.why)
