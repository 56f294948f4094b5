"""Mode by mode: the band in which a mode rings, and its term of the response of a linear model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.flight.linear_model import LinearModel

EXCITED_DB = 10.0
"""A mode counts as excited when a sensor shows its response this far above the noise in the mode's own band."""
REAL = 1e-9
"""Imaginary part, rad/s, that a real root may have by rounding."""


def half_power_band(pole: complex, duration_s: float) -> tuple[float, float]:
    """Return the half-power band of a mode, wn (1 - zeta) to wn (1 + zeta), rad/s; of a real root, up to |s|.

    A record of T s resolves no band narrower than 2 pi / T.
    """
    wn = abs(pole)
    half = min(max(abs(pole.real), np.pi / duration_s), 0.95 * wn)
    return wn - half, wn + half if abs(pole.imag) > REAL else wn


class ModalForm:
    """The partial-fraction expansion of a linear model: H(jw) = sum of R_i / (jw - s_i), R_i = C v_i w_i B.

    Args:
        model: whose states span the modes.
        outputs, inputs: (p,) and (m,) of its channels.
    """

    def __init__(self, model: LinearModel, outputs: Sequence[str], inputs: Sequence[str]) -> None:
        self._poles, self._V = np.linalg.eig(model.A)
        self._W = np.linalg.inv(self._V)
        self._C = model.C[[model.outputs.index(o) for o in outputs]]
        self._B = model.B[:, [model.inputs.index(i) for i in inputs]]

    def response(self, pole: complex, omega_rad_s: FloatArray, duration_s: float) -> NDArray[np.complex128]:
        """Return the term (k, p, m) of the mode nearest to ``pole``, with its conjugate, at ``omega_rad_s`` (k,).

        No mode rings for longer than the record of ``duration_s``: its damping counts as 1 / T at least.
        """
        k = int(np.argmin(np.abs(self._poles - pole)))
        s = complex(-max(abs(pole.real), 1.0 / duration_s), self._poles[k].imag)
        residue = np.outer(self._C @ self._V[:, k], self._W[k] @ self._B)
        jw = 1j * omega_rad_s[:, None, None]
        H = residue / (jw - s)
        if abs(self._poles[k].imag) > REAL:
            H = H + residue.conj() / (jw - s.conjugate())
        return np.asarray(H, np.complex128)
