"""Records to regress: a short period after a 3-2-1-1, with noise of any colour; and the Twin Otter."""

from __future__ import annotations

import numpy as np
import pytest
from recorded import flight_data
from scipy.linalg import expm
from scipy.signal import lfilter

from testbench.core.constants import DEG_RAD, FT_M, LBF_N, PSF_PA, SLUG_KG
from testbench.core.record import FlightRecord
from testbench.estimators.regression import MassProperties, RegressionData, regression_data

DT = 0.02
TRUTH = np.array([-8.0, -2.0, -9.0, 0.05])  # of qdot: alpha, q, de, 1
TERMS = ["alpha", "q", "de"]
_A = np.array([[-1.2, 0.95, -0.1], [-8.0, -2.0, -9.0], [0.0, 0.0, 0.0]])


def motion(n: int = 600, size: float = 0.03) -> np.ndarray:
    """Return (n, 3) alpha, q, de of a short period of 3 rad/s after an elevator multistep, 50 Hz."""
    t = np.arange(n) * DT
    u = np.zeros(n)
    for start, end, sign in ((0.5, 2, 1), (2, 3, -1), (3, 3.5, 1), (3.5, 4, -1), (6, 7, -1), (7, 8, 1)):
        u[(t >= start) & (t < end)] = sign * size
    u = lfilter([0.2], [1.0, -0.8], u)  # an actuator
    step = expm(_A * DT)
    x = np.zeros((n, 3))
    x[:, 2] = u
    for i in range(n - 1):
        x[i + 1, :2] = step[:2] @ x[i]
    return x


def noise(seed: int, n: int, pole: float, std: float) -> np.ndarray:
    """Return (n,) noise of first order, e(k) = pole e(k - 1) + w(k), of standard deviation ``std``."""
    white = np.random.default_rng(seed).standard_normal(n + 1000)
    return lfilter([1.0], [1.0, -pole], white)[1000:] * np.sqrt(1.0 - pole**2) * std


def record(x: np.ndarray, qdot: np.ndarray, valid: np.ndarray | None = None) -> FlightRecord:
    t = np.arange(len(x)) * DT
    return FlightRecord(t, (*TERMS, "qdot"), np.column_stack([x, qdot]), "measured", valid=valid)


def signals(x: np.ndarray, qdot: np.ndarray, valid: np.ndarray | None = None) -> RegressionData:
    return regression_data(record(x, qdot, valid))


def twin_otter() -> tuple[FlightRecord, MassProperties, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the record, its mass properties, the coefficients printed in the file, and the printed results."""
    from scipy.io import loadmat

    folder = flight_data() / "twin_otter"
    files = [folder / name for name in ("totter_lon_020213f1_018.mat", "totter_results.mat")]
    for file in files:
        if not file.is_file():
            pytest.skip(f"the Twin Otter record is missing: no {file.name} in the folder of flight records")
    f = loadmat(files[0])["fdata"].T
    g = 32.174 * FT_M  # as its authors have it
    inertia = SLUG_KG * FT_M**2
    channels = {
        "V": f[1] * FT_M,
        "beta": f[2] * DEG_RAD,
        "alpha": f[3] * DEG_RAD,
        "p": f[4] * DEG_RAD,
        "q": f[5] * DEG_RAD,
        "r": f[6] * DEG_RAD,
        "ax": f[10] * g,
        "ay": f[11] * g,
        "az": f[12] * g,
        "de": f[13] * DEG_RAD,
        "qbar": f[26] * PSF_PA,
        "thrust": (f[37] + f[38]) * LBF_N,
        "pdot": f[41] * DEG_RAD,
        "qdot": f[42] * DEG_RAD,
        "rdot": f[43] * DEG_RAD,
    }
    mass = MassProperties(
        mass_kg=float(f[47].mean()) * SLUG_KG,
        area_m2=f[76, 0] * FT_M**2,
        span_m=f[77, 0] * FT_M,
        chord_m=f[78, 0] * FT_M,
        Ixx=f[48, 0] * inertia,
        Iyy=f[49, 0] * inertia,
        Izz=f[50, 0] * inertia,
        Ixz=f[51, 0] * inertia,
    )
    made = dict(zip(("CX", "CY", "CZ", "Cl", "Cm", "Cn"), f[60:66], strict=True))
    made |= dict(zip(("p_hat", "q_hat", "r_hat"), f[70:73], strict=True))
    out = FlightRecord(f[0] - f[0, 0], tuple(channels), np.column_stack(list(channels.values())), "measured")
    return out, mass, made, loadmat(files[1], squeeze_me=True)
