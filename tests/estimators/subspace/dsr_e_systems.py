"""Systems, inputs and records that the tests of DSR_e share."""

import numpy as np
from scipy.signal import chirp, cont2discrete

from testbench.core.record import FlightRecord

G0 = 9.80665


def simulate(A, B, C, D, u, x0=None, w=None):
    x = np.zeros(len(A)) if x0 is None else np.array(x0, float)
    y = np.empty((len(u), len(C)))
    for k in range(len(u)):
        y[k] = C @ x + D @ u[k]
        x = A @ x + B @ u[k] + (0.0 if w is None else w[k])
    return y


def sampled(A, B, dt):
    n = len(A)
    return cont2discrete((A, B, np.eye(n), np.zeros((n, B.shape[1]))), dt)[:2]


def short_period(wn=3.0, zeta=0.617):
    """States alpha, q; wn = 3 rad/s and zeta = 0.617 unless told."""
    Za = -1.2
    Mq = -2.0 * zeta * wn - Za
    return np.array([[Za, 1.0], [Za * Mq - wn**2, Mq]]), np.array([[-0.1], [-8.0]])


def longitudinal():
    """States V, alpha, q, theta at 16 m/s: short period 4.5 rad/s and 0.75, phugoid 0.65 rad/s and 0.02.

    XV, ZV, M_alpha and Mq were solved for from these four figures with the other entries given.
    """
    A = np.array(
        [
            [-0.10632383, 4.0, 0.0, -G0],
            [-0.10096251, -3.5, 1.0, 0.0],
            [0.0, -8.64113787, -3.16967617, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
    return A, np.array([[0.0], [-0.3], [-25.0], [0.0]])


def multistep_3211(dt, duration, step, amplitude, start=2.0):
    t = np.arange(0.0, duration - 1e-9, dt)
    edges = start + step * np.array([0.0, 3.0, 5.0, 6.0, 7.0])
    u = np.zeros(t.size)
    for begin, end, sign in zip(edges[:-1], edges[1:], (1, -1, 1, -1), strict=True):
        u[(t >= begin - 1e-9) & (t < end - 1e-9)] = sign * amplitude
    return u[:, None]


def flight_test_inputs(dt=0.02, duration=30.0):
    t = np.arange(0.0, duration - 1e-9, dt)
    rng = np.random.default_rng(0)

    def multisine(f):
        return np.cos(2 * np.pi * np.outer(t, f) - np.pi * np.arange(f.size) ** 2 / f.size).sum(axis=1)

    signals = {
        "3211": multistep_3211(dt, duration, 0.5, 1.0)[:, 0],
        "prbs": np.repeat(rng.choice([-1.0, 1.0], size=200), round(0.2 / dt))[: t.size],
        "sweep": chirp(t, 0.05, duration, 2.5),
        "multisine of 20 lines": multisine(np.linspace(0.1, 2.0, 20)),
        "multisine of 60 lines": multisine(np.arange(1, 61) / 30.0),
    }
    return {name: (0.05 * u / np.abs(u).max())[:, None] for name, u in signals.items()}


def record(dt, u, y, inputs, outputs, valid=None):
    return FlightRecord(np.arange(len(u)) * dt, (*inputs, *outputs), np.hstack([u, y]), "measured", valid=valid)


def poles_of(model):
    (poles,) = model.poles().values()
    return poles[np.lexsort((poles.imag, poles.real))]


def sort(s):
    s = np.asarray(s, complex)
    return s[np.lexsort((s.imag, s.real))]


def pole_error(model, A):
    """Largest relative error of a pole against the eigenvalues of the continuous A; inf if their number differs."""
    found, true = poles_of(model), sort(np.linalg.eigvals(A))
    if found.size != true.size:
        return np.inf
    return float(np.min([np.max(np.abs(p - true) / np.abs(true)) for p in (found, sort(found.conj()))]))


def innovations_system():
    A = np.array([[0.9, 0.2], [-0.2, 0.85]])
    return A, np.array([[0.2], [1.0]]), np.eye(2), np.array([[0.5, 0.1], [0.0, 0.3]])


def innovations_record(n, rng):
    A, B, C, K = innovations_system()
    u = np.repeat(rng.choice([-1.0, 1.0], size=(n // 5 + 1, 1)), 5, axis=0)[:n]
    e = 0.3 * rng.standard_normal((n, 2))
    y = simulate(A, B, C, np.zeros((2, 1)), u, w=e @ K.T) + e
    return record(0.1, u, y, ("de",), ("alpha", "q"))
