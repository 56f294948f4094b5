"""A member of every structure with believable true values, and records simulated with it."""

from typing import NamedTuple

import numpy as np

from testbench.core.record import FlightRecord
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures import (
    Trim,
    aerodynamic_longitudinal,
    flexible,
    lateral_directional,
    lateral_per_speed,
    longitudinal,
    roll_yaw_rates,
    short_period,
)
from testbench.estimators.structured import AirframeConstants

HFB = AirframeConstants(
    S_m2_per_kg=4.028e-3,
    S_cbar_over_Iyy_1_per_kg_m=8.0027e-4,
    cbar_m=2.43,
    mass_kg=7472.0,
    V0_m_s=104.67,
    rho_kg_m3=0.792,
    thrust_angle_rad=0.0524,
    thrust_moment_rad_s2_per_N=-7.0153e-6,
)
FILTER_ERROR_HFB = {
    "CD_0": 0.1227,
    "CD_V": -0.0645,
    "CD_alpha": 0.3201,
    "CL_0": -0.0929,
    "CL_V": 0.1487,
    "CL_alpha": 4.3279,
    "Cm_0": 0.1119,
    "Cm_V": 0.0040,
    "Cm_alpha": -0.9679,
    "Cm_q": -34.71,
    "Cm_de": -1.5291,
}
ATTAS_SHORT_PERIOD = {
    "Z_0": -0.00899,
    "Z_alpha": -0.4834,
    "Z_q": 0.1042,
    "Z_de": 0.6763,
    "M_0": 0.4752,
    "M_alpha": -4.9265,
    "M_q": -2.0057,
    "M_de": -7.2081,
}
ATTAS_RATES = {
    "L_p": -2.0675,
    "L_r": 1.0293,
    "L_da": -6.3059,
    "L_dr": 1.1452,
    "L_beta": -3.8444,
    "N_p": -0.1839,
    "N_r": -0.4856,
    "N_da": -0.3912,
    "N_dr": -1.7609,
    "N_beta": 3.0314,
}
_UAV = {
    "X_V": -0.12,
    "X_alpha": 5.1,
    "X_de": -0.4,
    "Z_V": -1.31,
    "Z_alpha": -97.5,
    "Z_q": -3.2,
    "Z_de": -8.1,
    "M_V": 0.05,
    "M_alpha": -86.0,
    "M_q": -13.4,
    "M_de": -101.0,
}


class Case(NamedTuple):
    """A structure that starts from its own guess, true values, sample time and the initial states of two records."""

    structure: ModelStructure
    truth: dict[str, float]
    dt_s: float
    starts: tuple[np.ndarray, np.ndarray]


def _small(n: int) -> tuple[np.ndarray, np.ndarray]:
    return 0.02 * np.cos(np.arange(n)), -0.01 * np.sin(1.0 + np.arange(n))


CASES = {
    "short_period": Case(short_period(("alpha", "q", "qdot")), ATTAS_SHORT_PERIOD, 0.04, _small(2)),
    "longitudinal": Case(
        longitudinal(
            Trim(15.0, 0.08, 0.03), outputs=("V", "alpha", "q", "theta", "qdot", "ax", "az"), accelerometer=(0.2, -0.05)
        ).with_parameters({"M_alpha": -40.0, "M_de": -50.0, "M_q": -6.0}),
        _UAV,
        0.025,
        _small(4),
    ),
    "flexible": Case(
        flexible(Trim(16.0, 0.08), wn_rad_s=(26.0,), coupled=True).with_parameters({"slope_1": 0.8, "zeta_1": 0.1}),
        {
            **{n: v for n, v in _UAV.items() if n[0] != "X" and n[-1] != "V"},
            "wn_1": 28.9,
            "zeta_1": 0.21,
            "Q1_alpha": -310.0,
            "Q1_q": -4.0,
            "Q1_de": -30.0,
            "Z_eta_1": 12.0,
            "Z_etadot_1": 3.0,
            "M_eta_1": 20.0,
            "M_etadot_1": 2.0,
            "slope_1": 0.8,
        },
        0.01,
        _small(4),
    ),
    "lateral_directional": Case(
        lateral_directional(
            Trim(128.0, 0.05, 0.05), outputs=("beta", "p", "r", "phi", "pdot", "rdot", "ay"), accelerometer=(1.5, 0.3)
        ),
        {**ATTAS_RATES, "Y_0": 0.1, "L_0": 0.01, "N_0": -0.004, "Y_beta": -19.0, "Y_r": 0.6, "Y_dr": 4.0},
        0.04,
        _small(4),
    ),
    "lateral_per_speed": Case(
        lateral_per_speed(("beta", "p", "r", "phi", "pdot", "rdot")),
        {
            **ATTAS_RATES,
            **{"Y_0": 0.1 / 128.0, "L_0": 0.01, "N_0": -0.004, "Y_beta": -19.0 / 128.0, "Y_r": 0.6 / 128.0},
            **{"Y_dr": 4.0 / 128.0, "alpha_trim": 0.05, "theta_trim": 0.05, "g_V": 9.80665 / 128.0},
        },
        0.04,
        _small(4),
    ),
    "roll_yaw_rates": Case(
        roll_yaw_rates(("p", "r", "ay")),
        {**ATTAS_RATES, "L_0": 0.002, "N_0": -0.001, "Y_beta": -19.0, "Y_r": 0.6, "Y_dr": 4.0},
        0.04,
        _small(2),
    ),
    "aerodynamic_longitudinal": Case(
        aerodynamic_longitudinal(HFB),
        FILTER_ERROR_HFB,
        0.1,
        (np.array([106.0, 0.112, 0.105, 0.0]), np.array([104.0, 0.12, 0.1, 0.01])),
    ),
}


def truth(case: Case) -> np.ndarray:
    """Return the true parameter vector: the named values, the structure's own fixed ones, zero for the rest."""
    return np.array([case.truth.get(p.name, 0.0 if p.free else p.value) for p in case.structure.parameters])


def inputs(structure: ModelStructure, samples: int, seed: int) -> np.ndarray:
    """Return multisteps of random length for controls, a smooth curve for beta, thrust with a change.

    A step takes two samples, so that it runs linearly and is not taken as held.
    """
    rng = np.random.default_rng(seed)
    out = np.empty((samples, len(structure.inputs)))
    for j, name in enumerate(structure.inputs):
        steps = np.repeat(rng.choice([-1.0, 0.0, 1.0], samples), rng.integers(4, 30, samples))[:samples]
        ramped = 0.5 * (steps + np.append(steps[0], steps[:-1]))
        smooth = np.convolve(steps, np.ones(9) / 9.0, mode="same")
        out[:, j] = {"thrust": 11500.0 + 300.0 * smooth, "beta": 0.05 * smooth}.get(name, 0.03 * ramped)
    return out


def fly(
    structure: ModelStructure,
    params: np.ndarray,
    u: np.ndarray,
    dt_s: float,
    x0: np.ndarray,
    noise: np.ndarray | float = 0.0,
    seed: int = 0,
    held: bool = False,
) -> FlightRecord:
    """Return a measured record with white noise of standard deviation ``noise`` on the outputs."""
    clean = respond(structure, params, (), u, Sampling(dt_s, np.full(u.shape[1], held)), x0).y
    y = clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)
    return FlightRecord(
        np.arange(len(u)) * dt_s, (*structure.inputs, *structure.outputs), np.hstack([u, y]), "measured"
    )


def flights(case: Case, lengths: tuple[int, int] = (400, 250), held: bool = False, noise: float = 0.0, seed: int = 0):
    """Return two records of different length and initial state; noise relative to each output's spread."""
    out = []
    for i, (samples, x0) in enumerate(zip(lengths, case.starts, strict=True)):
        u = inputs(case.structure, samples, 10 * seed + i)
        clean = fly(case.structure, truth(case), u, case.dt_s, x0, held=held)
        std = noise * clean.columns(case.structure.outputs).std(axis=0)
        out.append(fly(case.structure, truth(case), u, case.dt_s, x0, std, 100 + 10 * seed + i, held))
    return out
