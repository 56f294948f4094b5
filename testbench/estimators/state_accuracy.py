"""Standard errors of the poles and the frequency response of a state-space model that has a covariance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.state_space import StateSpaceModel, unit_circle


class PoleAccuracy(NamedTuple):
    """A continuous pole, rad/s, its natural frequency (rad/s) and damping ratio, and the standard errors of all."""

    pole: complex
    wn_rad_s: float
    zeta: float
    real_std: float
    imag_std: float
    wn_std: float
    zeta_std: float


def pole_accuracy(model: StateSpaceModel) -> tuple[PoleAccuracy, ...]:
    """Return the poles of the upper half plane with standard errors, the slowest first.

        ds = l' dA r / (l' r z dt),    l, r left and right eigenvectors of the discrete pole z

    propagated linearly from the covariance; independent of the states' basis.

    Raises:
        EstimationError: the model has no covariance: it was not estimated by prediction errors.
    """
    covariance = _covariance_of(model)
    n = model.order
    values, right = np.linalg.eig(model.A)
    left = np.linalg.inv(right)
    out = []
    for i, z in enumerate(values):
        real_negative = abs(z.imag) <= 1e-12 * max(abs(z), 1e-300) and z.real <= 0.0
        if z.imag < 0.0 or real_negative:
            continue
        s = np.log(complex(z)) / model.dt_s
        d = np.outer(left[i], right[:, i]).ravel() / (z * model.dt_s)
        wn = max(abs(s), 1e-300)
        d_wn = (np.conj(s) * d).real / wn
        d_zeta = -d.real / wn + s.real * d_wn / wn**2
        P = covariance[: n * n, : n * n]
        std = [float(np.sqrt(max(g @ P @ g, 0.0))) for g in (d.real, d.imag, d_wn, d_zeta)]
        out.append(PoleAccuracy(complex(s), float(wn), float(-s.real / wn), *std))
    return tuple(sorted(out, key=lambda pole: pole.wn_rad_s))


def frequency_response_std(model: StateSpaceModel, omega_rad_s: FloatArray) -> FloatArray:
    """Return the standard deviation (k, p, m) of the frequency response's distance from its estimate.

    First-order propagation from the covariance: sqrt(E |dG|^2), in SI units; independent of the states' basis.

    Raises:
        EstimationError: the model has no covariance, or a frequency lies above the Nyquist frequency.
    """
    covariance = _covariance_of(model)
    z = unit_circle(omega_rad_s, model.dt_s)
    n, m, p = model.order, len(model.inputs), len(model.outputs)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    cuts = np.cumsum([n * n, n * m, p * n])
    dA, dB, dC, dD = (
        part.T.reshape(-1, *shape)
        for part, shape in zip(np.split(root, cuts), ((n, n), (n, m), (p, n), (p, m)), strict=True)
    )
    out = np.zeros((z.size, p, m))
    for k, point in enumerate(z):
        inner = np.linalg.inv(point * np.eye(n) - model.A)
        dG = (dC + model.C @ inner @ dA) @ inner @ model.B + model.C @ inner @ dB + dD
        out[k] = np.sqrt(np.sum(np.abs(dG) ** 2, axis=0))
    return out


def _covariance_of(model: StateSpaceModel) -> FloatArray:
    if "covariance" not in model.diagnostics:
        raise EstimationError(
            f"method '{model.method}' gives no covariance of its matrices; refine it by prediction error"
        )
    return np.asarray(model.diagnostics["covariance"], float)
