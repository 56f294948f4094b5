"""Nonlinear longitudinal motion with aerodynamic coefficients as polynomials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from testbench.core.constants import G0_M_S2
from testbench.core.errors import EstimationError
from testbench.estimators.equations import Equations, WrittenParameter
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures.settings import OUTPUTS, check_outputs
from testbench.estimators.parametric.structures.written import written
from testbench.estimators.structured import AirframeConstants

_STATES = ("V", "alpha", "theta", "q")
_COEFFICIENTS = ("CD", "CL", "Cm")
TERMS: Mapping[str, tuple[str, ...]] = {
    "CD": ("0", "V", "alpha"),
    "CL": ("0", "V", "alpha"),
    "Cm": ("0", "V", "alpha", "q", "de"),
}
"""The parametrisation of the HFB-320 example: CD_0, CD_V, CD_alpha, CL_0, ..., Cm_de."""
_GUESS = {"CD_0": 0.05, "CD_alpha": 0.3, "CL_0": 0.1, "CL_alpha": 4.5, "Cm_alpha": -0.8, "Cm_q": -15.0, "Cm_de": -1.0}
_EQUATIONS = {
    "V_dot": "-S_m2_per_kg*lift*CD + force*cos(alpha + thrust_angle_rad) + g*sin(alpha - theta)",
    "alpha_dot": "q + (-S_m2_per_kg*lift*CL - force*sin(alpha + thrust_angle_rad) + g*cos(alpha - theta))/V",
    "theta_dot": "q",
    "q_dot": "S_cbar_over_Iyy_1_per_kg_m*lift*Cm + thrust_moment_rad_s2_per_N*thrust",
}
_FORCES = {
    "ax": "S_m2_per_kg*lift*(CL*sin(alpha) - CD*cos(alpha)) + force*cos(thrust_angle_rad)",
    "az": "-S_m2_per_kg*lift*(CL*cos(alpha) + CD*sin(alpha)) - force*sin(thrust_angle_rad)",
}
_DEFINED = {
    "lift": "0.5*rho_kg_m3*V*V",
    "force": "thrust/mass_kg",
    "V_hat": "V/V0_m_s",
    "q_hat": "q*(cbar_m/(2*V0_m_s))",
}


def aerodynamic_longitudinal(
    airframe: AirframeConstants,
    *,
    terms: Mapping[str, Sequence[str]] = TERMS,
    outputs: Sequence[str] = OUTPUTS["aerodynamic_longitudinal"],
    controls: Sequence[str] = ("de",),
) -> ModelStructure:
    """Return longitudinal flight over a flat earth; inputs are the controls that stand in a term, and ``thrust``.

    A term of a coefficient is a product of V/V0, alpha, q cbar/(2 V0) and controls, written ``alpha``, ``alpha*alpha``,
    ``alpha*de``; "0" is the constant. Its parameter is ``CL_alpha``, ``CL_alpha_alpha``,
    ``Cm_alpha_de``, ``CD_0``. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015 (HFB-320 example).

    Args:
        airframe: constants of the aircraft.
        terms: CD, CL and Cm -> their terms, e.g. ``("0", "alpha", "alpha*alpha", "de")``.
        outputs: any of V, alpha, theta, q, qdot, ax and az.
        controls: input channels besides thrust.

    Raises:
        EstimationError: a coefficient without terms, a term, an output or a parameter that the structure does not have.
    """
    check_outputs("aerodynamic_longitudinal", outputs)
    variables = {"V": "V_hat", "alpha": "alpha", "q": "q_hat", **{name.removesuffix("_cmd"): name for name in controls}}
    if set(terms) != set(_COEFFICIENTS):
        raise EstimationError(f"terms must be given for CD, CL and Cm, got {', '.join(terms)}")
    sums: dict[str, list[str]] = {coefficient: [] for coefficient in _COEFFICIENTS}
    parameters, used = {}, set[str]()
    for coefficient, texts in sums.items():
        for term in terms[coefficient]:
            factors = [] if term == "0" else term.split("*")
            if not set(factors) <= set(variables):
                raise EstimationError(
                    f"a term of {coefficient} must be '0' or a product of {', '.join(variables)}, such as "
                    f"'alpha*alpha', got '{term}'"
                )
            name = f"{coefficient}_{term.replace('*', '_')}"
            parameters[name] = WrittenParameter(value=_GUESS.get(name, 0.0))
            texts.append("*".join([name, *(variables[factor] for factor in factors)]))
            used |= {variables[factor] for factor in factors}
    equations = Equations(
        states=_STATES,
        inputs=tuple(name for name in controls if name in used),
        equations=_EQUATIONS,
        outputs=_FORCES,
        parameters=parameters,
        constants={**airframe.model_dump(), "g": G0_M_S2},
        definitions={**_DEFINED, **{name: " + ".join(texts) or "0" for name, texts in sums.items()}},
    )
    name = "aerodynamic_longitudinal"
    return replace(written(equations, name, outputs), means=name)
