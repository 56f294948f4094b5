"""The steps after A and C: the innovations gain, a stable A, and how far poles lie apart."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from scipy.linalg import fractional_matrix_power
from scipy.optimize import linear_sum_assignment

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray, continuous_poles
from testbench.estimators.subspace.factor import Factor

_LONG = 20  # future horizons from here on are checked against their half, shorter ones against their double
_OTHER_HORIZONS: ContextVar[bool] = ContextVar("other_horizons", default=True)
_DEFECTIVE = 1e10  # condition of the eigenvectors beyond which a pole cannot be moved alone


def gain(A: FloatArray, C: FloatArray, f: Factor) -> FloatArray:
    """Return K (n, p) in the factor's units, by least squares of the VARX predictor's response to the innovations.

    With VARX coefficients Y_j of y[k - j], that response is H_i = sum_(j=1..i) Y_j H_(i-j), H_0 = I; for the
    innovations model it is C A^(i-1) K. Noise-free outputs have none.
    """
    d, p, n = f.m + f.p, f.p, A.shape[0]
    K = np.zeros((n, p))
    if f.exact:
        return K
    lags = [f.theta[(f.J - j) * d + f.m : (f.J - j + 1) * d].T for j in range(1, f.J + 1)]
    H = [np.eye(p)]
    O_L = [C]
    for i in range(1, f.J + 1):
        H.append(sum((lags[j - 1] @ H[i - j] for j in range(1, i + 1)), np.zeros((p, p))))
        O_L.append(O_L[-1] @ A)
    K[:] = np.linalg.lstsq(np.vstack(O_L[:-1]), np.vstack(H[1:]), rcond=1e-10)[0]
    K[:, ~f.noisy] = 0.0
    return K


def reflect(A: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Return A with its poles outside the unit circle at 1/z*, and those poles; poles on the circle stay.

    Frequency and eigenvectors stay, damping changes its sign.

    Raises:
        EstimationError: A is defective, so that its poles cannot be moved one by one.
    """
    z, V = np.linalg.eig(A)
    outside = np.abs(z) > 1.0
    if not outside.any():
        return A, np.zeros(0, np.complex128)
    if np.linalg.cond(V) > _DEFECTIVE:
        raise EstimationError("stable = true needs poles that can be told apart, got repeated ones; lower the order")
    moved = np.where(outside, 1.0 / np.conj(np.where(outside, z, 1.0)), z)
    return np.real(V @ np.diag(moved) @ np.linalg.inv(V)), np.asarray(z[outside], np.complex128)


def pair(reference: ComplexArray, other: ComplexArray) -> ComplexArray:
    """Return ``other`` in the order that lies nearest to ``reference``, relatively, at least total cost."""
    apart = np.abs(reference[:, None] - other) / np.maximum(np.abs(reference), 1e-12)[:, None]
    return np.asarray(other[linear_sum_assignment(apart)[1]])


def pole_distance(A: FloatArray, other: FloatArray) -> float:
    """Return the largest distance of the poles ln z of two models, each relative to the first's, paired."""
    s, t = (np.log(np.linalg.eigvals(M).astype(complex) + 1e-300) for M in (A, other))
    return float(np.max(np.abs(s - pair(s, t)) / np.maximum(np.abs(s), 1e-12)))


def other_horizon(L: int) -> int:
    """Return the future horizon with which L is compared: its double or, if L is long, its half, which costs less."""
    return 2 * L if L < _LONG else L // 2


@contextmanager
def without_other_horizons() -> Generator[None, None, None]:
    """Identify inside the block with the given horizons only: models are the same, and no doubt says how far others
    would move their poles. That takes a quarter of the time, which repetitions of one identification need not spend.
    """
    token = _OTHER_HORIZONS.set(False)
    try:
        yield
    finally:
        _OTHER_HORIZONS.reset(token)


def pole_shifts(
    A: FloatArray, other: int, past: Callable[[], FloatArray] | None, future: Callable[[], FloatArray] | None
) -> dict[str, Any]:
    """Return how far, relatively, the poles move with half the past horizon and with another future horizon.

    A past horizon too short to forget the initial state biases the poles, and half of it biases them more; a future
    horizon too short to tell the states apart is seen by doubling it.

    Args:
        A: (n, n) state matrix of the estimate.
        other: the other future horizon.
        past: makes A with half the past horizon; None where that is not possible, or without noise.
        future: makes A with the other future horizon; None likewise.
    """
    if not _OTHER_HORIZONS.get():
        past = future = None
    return {
        "other_future_horizon": other,
        "pole_shift_past": None if past is None else pole_distance(A, past()),
        "pole_shift_future": None if future is None else pole_distance(A, future()),
    }


def to_rate(A: FloatArray, stride: int) -> tuple[FloatArray, ComplexArray]:
    """Return A^(1/stride), and the eigenvalues without a continuous counterpart, which forbid it (A as it is then)."""
    lost = continuous_poles(np.linalg.eigvals(A).astype(np.complex128), 1.0)[1]
    if stride == 1 or lost.size:
        return A, lost if stride > 1 else lost[:0]
    return np.real(fractional_matrix_power(A, 1.0 / stride)), lost


def lost_poles(lost: ComplexArray, stride: int) -> str:
    """Return the message that A of the lower rate cannot come back to the records' rate."""
    return (
        f"a model identified at every {stride}th sample needs a continuous counterpart of every pole to come back to "
        f"the records' rate, got z = {np.array2string(lost.real, precision=3)}; lower the order or decimate less"
    )
