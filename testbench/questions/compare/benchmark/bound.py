"""The Cramér-Rao bound of frequency and damping for one flight of the benchmark.

    J = sum_k psi_k' L_k^-1 psi_k + 1/2 tr(L_k^-1 dL_k L_k^-1 dL_k),    psi = d(one-step prediction)/dparams

L is the covariance of the innovations (L. Ljung, System Identification, 2nd ed., 1999, chapter 7). In still air the
prediction is the response itself; in gusts it is that of the Kalman filter, along the record. Everything but the five
derivatives is taken for known: input, start, size and colour of the noise, spectrum of the gusts, the elastic mode, the
bend. A method that must find these too does worse. In a loop the law of the autopilot is taken for unknown.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from testbench.core.record import FlightRecord, FloatArray
from testbench.questions.compare.benchmark import flights as f

_STEP = 1e-4  # relative, of central differences


def bound(case: str, record: FlightRecord, surface: FloatArray) -> FloatArray:
    """Return the standard errors (wn in rad/s, zeta) that no unbiased estimator falls below.

    Args:
        case: of :func:`~.flights.fly`.
        record: measured flight.
        surface: (N,) elevator at every DT, rad.
    """
    J = _in_gusts(case, record, surface) if case in f.GUST_STD else _in_still_air(case, record, surface)
    slopes = mode_slopes(f.TRUE)
    return np.sqrt(np.diag(slopes @ np.linalg.inv(J) @ slopes.T))


def mode_slopes(params: FloatArray) -> FloatArray:
    """Return d(wn, zeta)/dparams (2, 5)."""
    Z, _, M, Mq, _ = params
    wn = np.sqrt(Z * Mq - M)
    dwn = np.array([Mq, 0.0, -1.0, Z, 0.0]) / (2.0 * wn)
    dzeta = np.array([-1.0, 0.0, 0.0, -1.0, 0.0]) / (2.0 * wn) + (Z + Mq) / (2.0 * wn**2) * dwn
    return np.stack([dwn, dzeta])


def _in_still_air(case: str, record: FlightRecord, surface: FloatArray) -> FloatArray:
    S = _slopes(case, surface.tobytes())[:: f.SLOW if case == "slow" else 1]
    S = S * record.select(f.OUTPUTS).valid[:, :, None]
    if case == "colour":  # of first order: its innovations are white
        S = np.concatenate([S[:1], (S[1:] - f.COLOUR * S[:-1]) / np.sqrt(1.0 - f.COLOUR**2)]) / f.COLOURED
    white = (S / f.NOISE[:, None]).reshape(-1, S.shape[2])
    return np.asarray(white.T @ white)


@lru_cache(maxsize=16)
def _slopes(case: str, surface: bytes) -> FloatArray:
    """Return the derivatives (N, 2, 5) of what would be seen without noise; all seeds share the elevator."""
    u = np.frombuffer(surface)
    S = [np.subtract(*(f.mean_outputs(case, p, u) for p in ends)) / width for ends, width in _steps()]
    return np.stack(S, axis=-1)


def _in_gusts(case: str, record: FlightRecord, surface: FloatArray) -> FloatArray:
    y = record.columns(f.OUTPUTS)
    _, L = _predicted(case, f.TRUE, y, surface)
    psi, dL = [], []
    for ends, width in _steps():
        (high, L_high), (low, L_low) = (_predicted(case, p, y, surface) for p in ends)
        psi.append((high - low) / width)
        dL.append(np.linalg.solve(L, (L_high - L_low) / width))
    first = np.einsum("ika,kab,jkb->ij", np.array(psi), np.linalg.inv(L), np.array(psi))
    return np.asarray(first + 0.5 * np.einsum("ikab,jkba->ij", np.array(dL), np.array(dL)))


def _steps() -> list[tuple[tuple[FloatArray, FloatArray], float]]:
    """Return for every parameter the two ends of its central difference, and the distance between them."""
    out = []
    for k, value in enumerate(f.TRUE):
        step = np.zeros(f.TRUE.size)
        step[k] = _STEP * abs(value)
        out.append(((f.TRUE + step, f.TRUE - step), 2.0 * float(step[k])))
    return out


def _predicted(case: str, params: FloatArray, y: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the one-step predictions (N, 2) of the Kalman filter and the covariances (N, 2, 2) of what they miss."""
    A, B = f.truth_matrices(params)
    block = expm(np.block([[A, B], [np.zeros((1, 3))]]) * f.DT)
    F, G, C = np.zeros((3, 3)), np.append(block[:2, 2], 0.0), np.eye(2, 3)
    F[:2, :2], F[:2, 2], F[2, 2] = block[:2, :2], A[:, 0] * f.DT, f.GUST
    Q, R = np.diag([0.0, 0.0, f.GUST_STD[case] ** 2]), np.diag(f.NOISE**2)
    x, P = np.zeros(3), np.zeros((3, 3))
    predicted, L = np.empty_like(y), np.empty((len(y), 2, 2))
    for k in range(len(y)):
        predicted[k], L[k] = x[:2], P[:2, :2] + R
        K = P @ C.T @ np.linalg.inv(L[k])
        x, P = F @ (x + K @ (y[k] - x[:2])) + G * u[k], F @ (P - K @ C @ P) @ F.T + Q
    return predicted, L
