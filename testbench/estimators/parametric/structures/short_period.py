"""The short period: angle of attack and pitch rate at constant speed."""

from __future__ import annotations

from dataclasses import dataclass

from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, Parameter
from testbench.estimators.parametric.structures.rows import Rows
from testbench.estimators.parametric.structures.settings import check_outputs

_OUTPUTS = ("alpha", "q", "qdot")


@dataclass(frozen=True, eq=False, kw_only=True)
class ShortPeriod(LinearStructure):
    """Short-period motion in dimensional derivatives per speed and per inertia (rad, s).

        alphadot = Z_0 + Z_alpha alpha + (1 + Z_q) q + Z_de de
        qdot     = M_0 + M_alpha alpha + M_q q + M_de de

    Outputs are any of alpha, q and qdot. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015.
    """

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        rows = Rows(self, params)
        variables = ("alpha", "q", *self.inputs)
        alphadot, qdot = rows.unit("q") + rows.sum_of("Z", variables), rows.sum_of("M", variables)
        outputs = [qdot if name == "qdot" else rows.unit(name) for name in self.outputs]
        return rows.matrices([alphadot, qdot], outputs)


def short_period(outputs: tuple[str, ...] = ("alpha", "q"), control: str = "de") -> ShortPeriod:
    """Return the short-period structure; it starts from a slow, well damped one.

    Args:
        outputs: any of alpha, q and qdot.
        control: the input channel, e.g. ``de`` or ``de_cmd``.

    Raises:
        EstimationError: an output or a parameter is not one of the structure's.
    """
    check_outputs("short_period", outputs, _OUTPUTS)
    d = control.removesuffix("_cmd")
    guess = {"Z_alpha": -1.0, "M_alpha": -4.0, "M_q": -2.0, f"M_{d}": -5.0}
    names = ("Z_0", "Z_alpha", "Z_q", f"Z_{d}", "M_0", "M_alpha", "M_q", f"M_{d}")
    return ShortPeriod(
        name="short_period",
        states=("alpha", "q"),
        inputs=(control,),
        outputs=tuple(outputs),
        parameters=tuple(Parameter(name, guess.get(name, 0.0)) for name in names),
    )
