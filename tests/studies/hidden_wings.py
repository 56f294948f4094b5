"""Flexible aircraft whose flutter onset is hidden: beams in strips of lagging air, drawn, flown in turbulence.

Each strip of a cantilever of two bending and two torsion modes has the lift and moment of an oscillating section (T.
Theodorsen, NACA report 496, 1935) with R. T. Jones' approximation of Wagner's function, two states for each strip, and
the apparent mass of the air. A body that heaves and pitches, with a tail, and a mass on a spring at mid-span, such as a
pod or an underwing store, are there in some. Nothing of the package is used but the record that is made at the end: its
estimator, which has no lag, no strip and no body, shares no term with this.
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter, resample_poly

RHO = 1.2
STRIPS = 12
JONES = ((0.165, 0.0455), (0.335, 0.3))
PLACES = (0.35, 0.65, 0.95)
"""Of the half span: where the accelerometers are."""
KINDS = ("wing", "body", "store", "body and store")


@dataclass(frozen=True)
class Wing:
    """One drawn aircraft: matrices of M x'' + C x' + K x = forces, and where each strip moves.

    Attributes:
        kind: of :data:`KINDS`.
        M, C, K: (n, n) of the structure.
        H, T: (strips, n) plunge (down) and twist (nose up) of each strip for each coordinate.
        b_m, a, slope: half chord, place of the elastic axis in half chords aft of mid-chord, (strips,) lift slope.
        dy_m: width of a strip.
        arm, tail: (n,) incidence of the tail by rates over V and by the angle; its rho S a / 2 (0: no body).
    """

    kind: str
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    H: np.ndarray
    T: np.ndarray
    b_m: float
    a: float
    slope: np.ndarray
    dy_m: float
    arm: np.ndarray
    angle: np.ndarray
    tail: float
    shown: np.ndarray

    def linear(self, V: float) -> tuple[np.ndarray, np.ndarray]:
        """Return A and the column of a gust downwards (m/s) at V m/s; states: x, x', two lags a strip."""
        b, a, n = self.b_m, self.a, len(self.M)
        width = np.pi * RHO * b**2 * self.dy_m
        H, T = self.H, self.T
        added = width * (H.T @ H - b * a * (H.T @ T + T.T @ H) + b**2 * (1.0 / 8.0 + a**2) * T.T @ T)
        rates = width * V * (H.T @ T + b * (0.5 - a) * T.T @ T)  # of the apparent mass alone
        # circulatory: force -rho V^2 b c_l on (h - b (a + 1/2) theta) by the downwash V theta + h' + b (1/2 - a) theta'
        felt = (H - b * (a + 0.5) * T) * (RHO * V * b * self.dy_m * self.slope)[:, None]
        by_x, by_v = V * T, H + b * (0.5 - a) * T
        at_once = 1.0 - sum(c for c, _ in JONES)
        M = self.M + added
        K = self.K + at_once * felt.T @ by_x + self.tail * V**2 * np.outer(self.arm, self.angle)
        C = self.C + rates + at_once * felt.T @ by_v + self.tail * V * np.outer(self.arm, self.arm)
        N = len(H)
        A = np.zeros((2 * n + 2 * N,) * 2)
        B = np.zeros(2 * n + 2 * N)
        inverse = np.linalg.inv(M)
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n] = -inverse @ K, -inverse @ C
        B[n : 2 * n] = -inverse @ (at_once * felt.sum(axis=0) + self.tail * V * self.arm)
        for k, (c, p) in enumerate(JONES):
            rows = slice(2 * n + k * N, 2 * n + (k + 1) * N)
            rate = p * V / b
            A[n : 2 * n, rows] = -c * inverse @ felt.T
            A[rows, :n], A[rows, n : 2 * n], A[rows, rows] = rate * by_x, rate * by_v, -rate * np.eye(N)
            B[rows] = rate
        return A, B

    def growth(self, V: float) -> tuple[float, bool]:
        """Return the largest real part of the poles at V m/s, in 1/s, and whether that pole oscillates.

        Slower poles than 1 rad/s are of the body's flight, not of the structure.
        """
        s = np.linalg.eigvals(self.linear(V)[0])
        s = s[np.abs(s) > 1.0]
        worst = s[np.argmax(s.real)]
        return float(worst.real), abs(worst.imag) > 1.0

    def least_damping(self, V: float) -> float:
        """Return the least damping ratio of the poles that oscillate at V m/s."""
        s = np.linalg.eigvals(self.linear(V)[0])
        s = s[s.imag > 1.0]
        return float(np.min(-s.real / np.abs(s)))

    def onset(self, fastest: float) -> float:
        """Return the lowest speed at which an oscillation grows; infinite if there is none, or divergence is first."""
        V, before = 4.0, 2.0
        while fastest > V:
            grows, oscillates = self.growth(V)
            if grows > 0.0:
                for _ in range(40):
                    middle = 0.5 * (before + V)
                    before, V = (before, middle) if self.growth(middle)[0] <= 0.0 else (middle, V)
                return V if oscillates else np.inf
            before, V = V, 1.02 * V
        return np.inf

    def fly(self, V: float, seconds: float, rate_hz: float, rms: float, rng: Generator) -> np.ndarray:
        """Return (n, 6) accelerations (m/s2, downwards) at three places ahead of and behind the elastic axis.

        Dryden's spectrum of the vertical gust, 150 m long; each pole is filtered by itself, held over half a sample.
        """
        A, B = self.linear(V)
        fine = 2
        dt = 1.0 / (fine * rate_hz)
        n = round((seconds + 10.0) * rate_hz) * fine
        lag = 150.0 / V
        w = lfilter([rms * np.sqrt(2.0 * dt / lag)], [1.0, -np.exp(-dt / lag)], rng.standard_normal(n))
        s, v = np.linalg.eig(A)
        drive = np.linalg.solve(v, B.astype(complex))
        s = np.where(np.abs(s) < 1e-6, -1e-6, s)  # heave: where it is does not matter
        z = np.stack([lfilter([0.0, np.expm1(p * dt) / p * f], [1.0, -np.exp(p * dt)], w + 0j)
                      for p, f in zip(s, drive, strict=True)])  # fmt: skip
        k = len(self.M)
        acceleration = (A[k : 2 * k] @ v @ z + np.outer(B[k : 2 * k], w)).real
        out = (self.shown @ acceleration).T
        return resample_poly(out, 1, fine, axis=0)[round(10.0 * rate_hz) :]


def draw(rng: Generator) -> tuple[Wing, float]:
    """Draw an aircraft whose onset lies between 15 and 150 m/s; return it and its onset."""
    while True:
        wing = _draw(rng)
        onset = wing.onset(150.0)
        if 15.0 < onset < 150.0:
            return wing, onset


def _draw(rng: Generator) -> Wing:
    kind = KINDS[rng.choice(4, p=(0.4, 0.25, 0.2, 0.15))]
    b, aspect = rng.uniform(0.08, 0.4), rng.uniform(6.0, 14.0)
    span = aspect * b
    y = (np.arange(STRIPS) + 0.5) / STRIPS
    dy = span / STRIPS
    a, x, r2 = rng.uniform(-0.35, -0.1), rng.uniform(0.02, 0.35), rng.uniform(0.2, 0.3)
    m = np.pi * RHO * b**2 * rng.uniform(6.0, 40.0) * (1.0 - rng.uniform(0.0, 0.5) * y)  # kg/m
    twist_hz = rng.uniform(6.0, 16.0)
    bend_hz = twist_hz * rng.uniform(0.25, 0.75)
    bends = [_cantilever(k, y) for k in (1.8751, 4.6941)]
    twists = [np.sin((k - 0.5) * np.pi * y) for k in (1, 2)]
    shapes = [(h, 0.0 * y) for h in bends] + [(0.0 * y, t) for t in twists]
    hz = [bend_hz, 6.27 * bend_hz, twist_hz, 3.0 * twist_hz]
    if "body" in kind:
        shapes = [(np.ones(STRIPS), 0.0 * y), (np.full(STRIPS, -rng.uniform(0.0, 0.4) * b), np.ones(STRIPS)), *shapes]
        hz = [0.0, 0.0, *hz]
    n = len(shapes)
    H, T = (np.stack(s, axis=1) for s in zip(*shapes, strict=True))
    weighed = (m * dy)[:, None]
    M = H.T @ (weighed * H) + x * b * (H.T @ (weighed * T) + T.T @ (weighed * H)) + r2 * b**2 * T.T @ (weighed * T)
    arm, angle, tail = np.zeros(n), np.zeros(n), 0.0
    if "body" in kind:
        mass = rng.uniform(1.0, 4.0) * float(weighed.sum())
        length = rng.uniform(5.0, 9.0) * b
        M[0, 0] += mass
        M[1, 1] += mass * (rng.uniform(0.15, 0.35) * length) ** 2
        tail = 0.5 * RHO * rng.uniform(0.1, 0.2) * 2.0 * b * span * 4.0
        arm[0], arm[1], angle[1] = 1.0, length, 1.0
    K = np.diag(np.diag(M) * (2.0 * np.pi * np.array(hz)) ** 2)
    zeta = rng.uniform(0.005, 0.03, n)
    C = np.diag(2.0 * zeta * np.sqrt(np.diag(M) * np.diag(K)))
    shown = np.concatenate([np.stack([[np.interp(p, y, H[:, i]) - off * b * np.interp(p, y, T[:, i]) for i in range(n)]
                                      for p in PLACES]) for off in (0.5, -0.5)])  # fmt: skip
    if "store" in kind:  # hangs on a spring in plunge and pitch, its centre ahead of or behind the axis
        at = int(rng.integers(3, STRIPS - 1))
        held = rng.uniform(0.03, 0.15) * float(weighed.sum())
        off = rng.uniform(-0.6, 0.6) * b
        row = H[at] + off * T[at]
        M = np.block([[M + held * np.outer(row, row), held * row[:, None]], [held * row[None], np.array([[held]])]])
        own = (2.0 * np.pi * rng.uniform(0.6, 1.4) * rng.choice([bend_hz, twist_hz])) ** 2 * held
        K, C = _grown(K, own), _grown(C, 2.0 * rng.uniform(0.01, 0.03) * np.sqrt(own * held))
        H, T, shown = (np.hstack([X, np.zeros((len(X), 1))]) for X in (H, T, shown))
        arm, angle = np.append(arm, 0.0), np.append(angle, 0.0)
    slope = 2.0 * np.pi * rng.uniform(0.75, 0.95) * np.sqrt(1.0 - (0.98 * y) ** 4)
    return Wing(kind, M, C, K, H, T, b, a, slope, dy, arm, angle, tail, shown)


def _grown(X: np.ndarray, last: float) -> np.ndarray:
    out = np.zeros((len(X) + 1,) * 2)
    out[:-1, :-1], out[-1, -1] = X, last
    return out


def _cantilever(k: float, y: np.ndarray) -> np.ndarray:
    """Return the bending shape of a cantilever, 1 at its tip; k L of the characteristic equation."""
    ratio = (np.cosh(k) + np.cos(k)) / (np.sinh(k) + np.sin(k))

    def shape(s: np.ndarray) -> np.ndarray:
        return np.cosh(k * s) - np.cos(k * s) - ratio * (np.sinh(k * s) - np.sin(k * s))

    return np.asarray(shape(y) / shape(np.ones(1)))
