"""An aircraft of the package in closed loop through gusts, linear about its trim: what an autopilot's log holds."""

from functools import cache

import numpy as np
from scipy.linalg import expm

import testbench as tb
from testbench.core.record import FlightRecord

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "h")
CONTROLS = ("de", "da", "dr", "thr")
CHANNELS = ("p", "q", "r", "phi", "theta", "V", "h", "hdot", "de", "da", "dr", "thr")
NOISE = {"p": 0.004, "q": 0.004, "r": 0.004, "phi": 0.004, "theta": 0.004, "V": 0.15, "h": 0.3, "hdot": 0.1}


@cache
def _model(name, V):
    aircraft = tb.load_aircraft(name)
    trimmed = tb.trim(aircraft, tb.FlightCondition(V, 500.0))
    model = tb.linearise(aircraft, trimmed)
    rows, inputs = [model.states.index(s) for s in STATES], [model.inputs.index(c) for c in CONTROLS]
    A, B = model.A[np.ix_(rows, rows)], model.B[np.ix_(rows, inputs)]
    start = np.array([trimmed.state[c] for c in CONTROLS])
    return A, B, start, trimmed.theta


def fly(seed, length_s=240.0, at_s=np.inf, factors=(), gust=0.5, aircraft="taurus", V=12.0, rate_hz=10):
    """Return the log of a flight; of a control or an elevon, a factor of its effect is left from ``at_s`` on."""
    rng = np.random.default_rng(seed)
    A, B, trim, theta0 = _model(aircraft, V)
    dt = 0.02
    E = expm(np.block([[A, B], [np.zeros((4, 13))]]) * dt)
    F, G = E[:9, :9], E[:9, 9:]
    air = F[:, :3] - np.eye(9)[:, :3]  # what a wind along body axes does
    keep = np.exp(-dt / 1.5)
    x, wind, turn, wanted = np.zeros(9), np.zeros(3), 0.0, 0.0
    left = np.eye(4)
    for name, k in dict(factors).items():
        if name in CONTROLS:
            left[CONTROLS.index(name), CONTROLS.index(name)] = k
        else:  # an elevon, of which de and da are half the sum and half the difference
            sign = -1.0 if name == "right" else 1.0
            left[:2, :2] = np.eye(2) + 0.5 * (k - 1.0) * np.array([[1.0, sign], [sign, 1.0]])
    sums, rows = np.zeros(2), []
    for n in range(round(length_s / dt)):
        t = n * dt
        if t >= turn:
            turn, wanted = t + rng.uniform(6.0, 15.0), rng.choice([-0.5, 0.0, 0.5])
        wind = keep * wind + gust * np.sqrt(1.0 - keep**2) * rng.standard_normal(3)
        u, _, w, p, q, r, phi, theta, h = x
        pitch = np.clip(-0.03 * h, -0.15, 0.15)
        sums += dt * np.clip([theta - pitch, u], -0.2, 0.2)
        du = np.array([1.0 * (theta - pitch) + 0.2 * q + 0.5 * sums[0], 0.5 * (wanted - phi) - 0.1 * p, 0.3 * r,
                       -0.1 * u - 0.05 * sums[1]])  # fmt: skip
        du = np.clip(du, -0.3, 0.3)
        if n % round(1.0 / rate_hz / dt) == 0:
            hdot = V * (theta - w / V)
            rows.append([p, q, r, phi, theta + theta0, V + u - wind[0], 500.0 + h, hdot, *(trim + du)])
        acting = du if t < at_s else left @ (trim + du) - trim
        x = F @ x + G @ acting - air @ wind
    data = np.array(rows)
    for j, name in enumerate(CHANNELS):
        data[:, j] += NOISE.get(name, 0.0) * rng.standard_normal(len(data))
    return FlightRecord(np.arange(len(data)) / rate_hz, CHANNELS, data, "measured")
