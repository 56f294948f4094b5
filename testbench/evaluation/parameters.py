"""Estimated parameters beside the true ones: how far off, and whether the stated error covers it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.structured import STRUCTURE_NAMES, per_speed
from testbench.evaluation.derivatives import Derivative

_ELASTIC = ("flexible",)  # structures that hold the modes themselves: their derivatives are those with modes held


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: its estimate, standard errors and, where it is known, the truth.

    Attributes:
        name: symbol.
        value: estimate, or the value it was held at.
        std: standard error, corrected for coloured residuals; 0 if held.
        std_white: standard error for white residuals.
        free: estimated or held.
        true: true value of the simulated aircraft at trim; None if not known.
    """

    name: str
    value: float
    std: float
    std_white: float
    free: bool
    true: float | None

    @property
    def deviations(self) -> float | None:
        """Error in standard errors; None if truth or error is not known."""
        if self.true is None or not self.std > 0.0:
            return None
        return (self.value - self.true) / self.std


def parameter_estimates(model: ParametricModel, truth: Mapping[str, float] | None) -> tuple[ParameterEstimate, ...]:
    """Return every parameter of a model.

    Args:
        model: what an estimator returned.
        truth: name -> true value; see :func:`true_parameters`.
    """
    white = dict(zip(model.structure.parameter_names, model.covariance_plain.diagonal().tolist(), strict=True))
    return tuple(
        ParameterEstimate(
            p.name,
            model.values[p.name],
            model.standard_errors[p.name],
            max(white[p.name], 0.0) ** 0.5,
            p.free,
            None if truth is None else truth.get(p.name),
        )
        for p in model.structure.parameters
    )


def true_parameters(structure: str, derivatives: Sequence[Derivative], V_m_s: float) -> dict[str, float]:
    """Return the true parameters of a structure by name, from the derivatives of the linearised aircraft.

    A structure without elastic modes is compared with derivatives in which the modes follow statically, because slow
    motion cannot tell the two apart. A structure with modes is compared with derivatives at which the modes are held.
    Parameters whose meaning nobody said, whatever their names are, have no truth.

    Args:
        structure: name of a packaged structure, the ``meaning`` of any; "" where it is not known.
        derivatives: of :func:`testbench.evaluation.derivatives.dimensional_derivatives`.
        V_m_s: airspeed at trim.
    """
    out: dict[str, float] = {}
    if structure not in STRUCTURE_NAMES:
        return out
    for d in derivatives:
        if d.name.endswith("/V"):
            continue
        value = d.held if structure in _ELASTIC or d.static is None else d.static
        out[d.name] = value / (V_m_s if per_speed(structure, d.name.partition("_")[0]) else 1.0)
    return out
