"""The response from held inputs to samples of a transfer function with delay."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray

_WHOLE = 1e-9  # of a sample: a delay this near to whole samples is whole


def sampled_response(
    b: FloatArray, a: FloatArray, s: ComplexArray, dt_s: float, delay_s: float, unit: float
) -> ComplexArray:
    """Return the response (k,) from a held input to samples of B(s)/A(s) exp(-s tau): with all that folds down.

    x[k+1] = e^(A dt) x[k] + e^(A r) F(dt - r) B u[k-d-1] + F(r) B u[k-d],    F(t) = integral of e^(A v) dv up to t

    for tau = (d + 1) dt - r, 0 < r <= dt (K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., 1997,
    section 2.3).

    Args:
        b: (n + 1,) numerator, highest power first.
        a: (n + 1,) denominator, a[0] = 1.
        s: j omega.
        dt_s: sample time, s.
        delay_s: tau, s.
        unit: a frequency, rad/s, in which the poles are of the order of 1.

    A response that has no digits left, as of a pole that grows beyond all numbers in a sample, is NaN.
    """
    n = a.size - 1
    scale = unit ** -np.arange(n + 1.0)
    a, b = a * scale, b * scale
    A = np.zeros((n + 1, n + 1))  # companion form, then the input that stays
    A[0, :n], A[0, n] = -a[1:], 1.0
    A[1:n, : n - 1] = np.eye(n - 1)
    whole = int(np.floor(delay_s / dt_s + _WHOLE))
    late = min(max(delay_s / dt_s - whole, 0.0), 1.0)
    with np.errstate(all="ignore"):
        early, rest = (expm(A * (unit * dt_s * part)) for part in (1.0 - late, late))
    z = np.exp(s * dt_s)
    drive = early[:n, n] + (early[:n, :n] @ rest[:n, n]) / z[:, None]
    try:
        x = np.linalg.solve(z[:, None, None] * np.eye(n) - early[:n, :n] @ rest[:n, :n], drive[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # a pole far outside: the exponential has no digits left, and a search turns away
        return np.full(s.shape, np.nan, np.complex128)
    direct = b[0] * (1.0 if late <= _WHOLE else 1.0 / z)
    return np.asarray((x @ (b[1:] - b[0] * a[1:]) + direct) * z**-whole, np.complex128)
