"""What is believed of coefficients before any flight: nuisances, and how far off each may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from testbench.aircraft import Aircraft
from testbench.core.record import FlightRecord
from testbench.questions.gap.evidence.commanded import moves_laterally

# A nuisance is a coefficient of the believed aircraft that is estimated along with every hypothesis ("re-tuned"). Its
# value is a multiple of the believed one. Its prior, before any flight, is Gaussian about 1 with the relative standard
# deviation given here, or with the aircraft's own if it has one (``[uncertainty]`` of aircraft.toml). These
# deviations are estimates of what handbook methods reach.
PRIORS: Mapping[str, float] = {"CL_alpha": 0.05, "CD": 0.10, "Cm_alpha": 0.10, "Cm_q": 0.15, "Cm_de": 0.10}
# The same for the lateral motion, re-tuned only if aileron or rudder moves. Cross derivatives are known less well.
LATERAL_PRIORS: Mapping[str, float] = {
    "CY_beta": 0.15,
    "Cl_beta": 0.15,
    "Cl_p": 0.10,
    "Cl_r": 0.20,
    "Cl_da": 0.10,
    "Cn_beta": 0.15,
    "Cn_p": 0.30,
    "Cn_r": 0.20,
    "Cn_da": 0.30,
    "Cn_dr": 0.10,
}


def deviations_of(aircraft: Aircraft | None, general: Mapping[str, float] | None = None) -> Mapping[str, float]:
    """Return nuisance -> relative standard deviation of its prior: the aircraft's own where it has one."""
    general = {**PRIORS, **LATERAL_PRIORS} if general is None else general
    own = {} if aircraft is None else {n: s for n, s in aircraft.uncertainty.items() if n in general}
    return {**general, **own} if own else general


def priors_of(records: Sequence[FlightRecord], aircraft: Aircraft | None = None) -> Mapping[str, float]:
    """Return the nuisances of hypotheses about these records -> relative standard deviation of the prior.

    The deviations are the aircraft's own where it has some (:func:`deviations_of`). Lateral nuisances are among them
    only if an aileron or rudder command moves. Otherwise a symmetric aircraft in still air shows nothing of them, and
    records of elevator and throttle must not pay for them.
    """
    return deviations_of(aircraft, {**PRIORS, **LATERAL_PRIORS} if moves_laterally(records) else PRIORS)
