"""The kinds of hidden truth in roll and yaw that the lateral draw knows: names that are right, how sizes are drawn.

What flies is made by testbench/questions/gap/hidden/lateral.py. The names are strings, compared with what the workflow
says only when a case is scored.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from testbench.questions.gap.sealed.kinds import Kind, between, either, kind

# Hidden truths in the library's own mathematics.
LIBRARY_FORM: Mapping[str, Kind] = {
    "slow aileron servo": kind("library", "aileron_lag", between(lag_rad_s=(5.0, 15.0)), "lag_rad_s"),
    "slow rudder servo": kind("library", "rudder_lag", between(lag_rad_s=(4.0, 12.0)), "lag_rad_s"),
    "late aileron link": kind("library", "aileron_transport_delay", between(delay_s=(0.05, 0.15)), "delay_s"),
    "late rudder link": kind("library", "rudder_transport_delay", between(delay_s=(0.06, 0.18)), "delay_s"),
    "aileron linkage ratio": kind(
        "library", "aileron_surface_scale", either(gain=(0.45, 0.62, 1.4, 1.6)), "gain -> scale"
    ),
    "rudder linkage ratio": kind(
        "library", "rudder_surface_scale", either(gain=(0.45, 0.62, 1.4, 1.6)), "gain -> scale"
    ),
    "roll-rate feedback": kind("library", "roll_damper", between(share=(0.5, 1.6))),
    "roll damper that filters": kind("library", "filtered_roll_damper roll_damper", between(share=(0.5, 1.6))),
    "yaw-rate feedback": kind("library", "yaw_damper", between(share=(1.2, 4.0), washout_s=(1.0, 4.0))),
    "interconnect": kind("library", "interconnect", between(ratio_=(0.3, 0.8)), "ratio"),
    "bank hold": kind("library", "bank_hold", between(time_s=(1.0, 4.0))),
    "weak bank hold": kind("library", "limited_bank_hold bank_hold", between(time_s=(1.0, 2.5))),
    "heading hold": kind("library", "heading_hold", between(omega_rad_s=(0.4, 0.9))),
    "lateral centre of gravity": kind("library", "lateral_cg", between(right_spans_=(0.01, 0.03)), "right_spans"),
    "pod under a wing": kind("library", "side_payload lateral_cg", between(ratio=(0.04, 0.12), side_=(1.0, 1.0))),
    "uneven lift": kind("library", "asymmetric_lift", between(Cl_alpha_=(0.06, 0.2)), "Cl_alpha"),
    "lost fin": kind("library", "lost_fin", between(share=(0.3, 0.5)), "share"),
    "lost wing": kind("library", "lost_wing", between(share=(0.1, 0.25), side_=(1.0, 1.0))),
    "curved weathercock": kind("library", "cubic_weathercock", between(share=(0.4, 1.0))),
    "sideslip gain": kind("library", "beta_scale", either(gain=(0.75, 0.88, 1.12, 1.3)), "gain -> scale"),
    "sideslip lag": kind("library", "beta_lag", between(lag_s=(0.06, 0.25)), "lag_s"),
    "roll gyro gain": kind("library", "p_scale", either(gain=(0.8, 0.93, 1.07, 1.25)), "gain -> scale"),
    "yaw gyro gain": kind("library", "r_scale", either(gain=(0.8, 0.93, 1.07, 1.25)), "gain -> scale"),
    "late bank angle": kind("library", "phi_delay", between(delay_s=(0.08, 0.25)), "delay_s"),
    "lateral accelerometer ahead": kind("library", "ay_position", between(ahead_m_=(0.4, 1.0)), "ahead_m"),
}
# Hidden truths in other forms of the library's effects.
OTHER_FORM: Mapping[str, Kind] = {
    "aileron servo of two stages": kind(
        "other", "aileron_second_order_actuator aileron_lag", between(lag_rad_s=(10.0, 22.0))
    ),
    "rudder servo of two stages": kind(
        "other", "rudder_second_order_actuator rudder_lag", between(lag_rad_s=(8.0, 18.0))
    ),
    "soft aileron slew limit": kind("other", "aileron_rate_limit", between(slew_s=(0.2, 0.5))),
    "soft rudder slew limit": kind("other", "rudder_rate_limit", between(slew_s=(0.25, 0.6))),
    "aileron link with jitter": kind("other", "aileron_transport_delay", between(delay_s=(0.06, 0.15)), "delay_s"),
    "rudder link with jitter": kind("other", "rudder_transport_delay", between(delay_s=(0.08, 0.18)), "delay_s"),
    "aileron linkage that loses": kind(
        "other", "aileron_surface_scale aileron_curved_linkage", either(gain=(0.45, 0.6, 1.4, 1.6))
    ),
    "rudder linkage that loses": kind(
        "other", "rudder_surface_scale rudder_curved_linkage", either(gain=(0.45, 0.6, 1.4, 1.6))
    ),
    "yaw damper that filters": kind("other", "filtered_yaw_damper yaw_damper", between(share=(1.2, 4.0))),
    "springy interconnect": kind("other", "interconnect late_interconnect", between(ratio_=(0.3, 0.8))),
    "uneven lift and drag": kind("other", "asymmetric_lift", between(Cl_alpha_=(0.06, 0.2)), "Cl_alpha"),
    "fin that fades": kind("other", "cubic_weathercock", between(share=(0.4, 0.9))),
    "sideslip vane of second order": kind("other", "beta_lag beta_delay", between(omega_rad_s=(5.0, 12.0))),
    "sideslip with a bent scale": kind("other", "beta_scale", either(gain=(0.75, 0.88, 1.12, 1.3)), "gain -> scale"),
    "yaw gyro with a bent scale": kind("other", "r_scale", either(gain=(0.8, 0.92, 1.08, 1.25)), "gain -> scale"),
    "bank angle of two stages": kind("other", "phi_lag phi_delay", between(lag_s=(0.1, 0.3))),
}
LATERAL_KINDS: Mapping[str, Kind] = {**LIBRARY_FORM, **OTHER_FORM}
# Standard deviations by which the believed coefficients are off in every case (the priors that the workflow states).
PARAMETER_ERRORS: Mapping[str, float] = {
    "CL_alpha": 0.05,
    "CD": 0.10,
    "Cm_alpha": 0.10,
    "Cm_q": 0.15,
    "Cm_de": 0.10,
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


def parameter_errors(rng: np.random.Generator) -> dict[str, float]:
    """Return a factor per coefficient: normal about 1, cut at two standard deviations."""
    return {n: 1.0 + s * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for n, s in PARAMETER_ERRORS.items()}
