"""What turbulence does to the outputs of the linearised aircraft, and the filter that makes it white.

    dx/dt = A x - A_g g,    y = C x - C_g g + sensor noise,    g = Dryden turbulence

The aircraft feels its motion through the air, x less the gust in the columns of its velocities. Sensitivities that pass
the Kalman filter of this model give the information of an estimator that knows the turbulence's spectrum: what filter
error estimates from innovations (R. E. Maine and K. W. Iliff, NASA TP 1690, 1981). Dryden's forms, MIL-F-8785C 3.7.1.2:

    dx/dt = -a x + sqrt(2 a) n              along,          a = V / L
    dx1/dt = -a x1 + sqrt(a) n, dx2/dt = a (x1 - x2), g = sqrt(3) x1 + (1 - sqrt(3)) x2     across
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray
from testbench.core.scenario.air import AirSpec
from testbench.estimators.parametric.kalman.innovations import sampled_noise
from testbench.flight.air import scale_lengths, turbulence_rms
from testbench.information.aircraft_structure import AircraftStructure
from testbench.sensors import Sensor

_VELOCITIES = ("u", "v", "w")
INERTIAL = frozenset({"h", "hdot", "Vg", "phi", "theta", "psi", "v_north", "v_east", "north", "east"})
"""States and channels that do not depend on the motion of the air, but for what it does to the aircraft."""


@dataclass(frozen=True, eq=False)
class Turbulence:
    """The linearised aircraft in Dryden turbulence, in continuous time."""

    A: FloatArray  # (n, n) states of the aircraft, of the gust's forming filters, of the sensors' lags
    # (n, 3 + m) what white noise of unit intensity does to them: of the gust along, to the right and down, and of
    # sensed deflections
    F: FloatArray
    C: FloatArray  # (p, n) what the sensors show

    @classmethod
    def of(
        cls,
        structure: AircraftStructure,
        sensors: Sequence[Sensor],
        air: AirSpec,
        h_m: float,
        V_m_s: float,
        theta: float,
        driven: FloatArray | None = None,
    ) -> Turbulence | None:
        """Return the aircraft in the turbulence of an air, None where there is none.

        Args:
            structure: the linearised aircraft.
            sensors: of its outputs, in the same order.
            air: expected.
            h_m: height of the flight; that of the turbulence unless the air has one.
            V_m_s: airspeed at trim.
            theta: pitch angle at trim, rad.
            driven: (states, m) what white noise of unit intensity in sensed deflections does to a model driven by them.
        """
        if air.turbulence_rms_m_s == 0.0:
            return None
        height = h_m if air.height_m is None else air.height_m
        G, forming, shown = _dryden(turbulence_rms(air.turbulence_rms_m_s, height), scale_lengths(height), V_m_s)
        c, s = math.cos(theta), math.sin(theta)
        body = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ shown  # along the body's axes
        # a height that nothing shows would drift without bound in the filter, and nothing depends on it
        keep = [i for i, name in enumerate(structure.states) if name != "h" or np.any(structure.C0[:, i])]
        names = [structure.states[i] for i in keep]
        A, C = structure.A0[np.ix_(keep, keep)], structure.C0[:, keep]
        moving = [(names.index(v), k) for k, v in enumerate(_VELOCITIES) if v in names]
        feels = np.zeros((len(names), body.shape[1]))
        sees = np.zeros((len(C), body.shape[1]))
        for column, axis in moving:
            feels -= np.outer(A[:, column], body[axis])
            sees -= np.outer(C[:, column], body[axis])
        feels[[i for i, name in enumerate(names) if name in INERTIAL]] = 0.0
        sees[[i for i, name in enumerate(structure.outputs) if name in INERTIAL]] = 0.0
        n, g = len(names), len(G)
        lagging = [i for i, sensor in enumerate(sensors) if sensor.lag_s > 0.0]
        size = n + g + len(lagging)
        whole, seen = np.zeros((size, size)), np.zeros((len(C), size))
        whole[:n, :n], whole[:n, n : n + g], whole[n : n + g, n : n + g] = A, feels, G
        seen[:, :n], seen[:, n : n + g] = C, sees
        for j, i in enumerate(lagging, n + g):
            whole[j] = seen[i] / sensors[i].lag_s
            whole[j, j] -= 1.0 / sensors[i].lag_s
            seen[i] = np.eye(size)[j]
        noise = np.zeros((len(structure.states), 0)) if driven is None else driven
        F = np.zeros((size, 3 + noise.shape[1]))
        F[n : n + g, :3], F[:n, 3:] = forming, noise[keep]
        return cls(whole, F, np.array([s.scale for s in sensors])[:, None] * seen)

    def whitener(self, sigma: FloatArray, dt_s: float, samples: int) -> FloatArray:
        """Return the impulse response (N, p, p) of the filter from outputs to white innovations of variance one.

        Its gain is that after N samples from rest.

        Args:
            sigma: (p,) standard deviations of the sensors' noise at each sample.
            dt_s: sample time, s.
            samples: N.
        """
        n, p = len(self.A), len(self.C)
        Phi, Q = sampled_noise(self.A, self.F, dt_s)
        C = self.C / sigma[:, None]
        T, G, P = Phi.T, C.T @ C, Q
        for _ in range(math.ceil(math.log2(max(samples, 2)))):  # doubling, see kalman.gain.steady_covariance
            inner = np.linalg.solve(np.eye(n) + G @ P, np.hstack([T, G]))
            grown = T.T @ P @ inner[:, :n]
            T, G, P = T @ inner[:, :n], G + T @ inner[:, n:] @ T.T, P + 0.5 * (grown + grown.T)
        S = C @ P @ C.T + np.eye(p)
        K = np.linalg.solve(S, C @ P @ Phi.T).T
        root = np.linalg.inv(np.linalg.cholesky(S))
        closed, x = Phi - K @ C, K
        out = np.empty((samples, p, p))
        out[0] = root
        for k in range(1, samples):
            out[k] = -root @ C @ x
            x = closed @ x
        return np.asarray(out / sigma)


def _dryden(
    rms: tuple[float, float, float], lengths: tuple[float, float, float], V_m_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the forming filters: states (5, 5), white noise in (5, 3), and the gust (3, 5), m/s."""
    a = [V_m_s / length for length in lengths]
    G, F, shown = np.zeros((5, 5)), np.zeros((5, 3)), np.zeros((3, 5))
    G[0, 0], F[0, 0], shown[0, 0] = -a[0], math.sqrt(2.0 * a[0]), rms[0]
    for axis, i in ((1, 1), (2, 3)):
        G[i, i] = G[i + 1, i + 1] = -a[axis]
        G[i + 1, i] = a[axis]
        F[i, axis] = math.sqrt(a[axis])
        shown[axis, i : i + 2] = rms[axis] * math.sqrt(3.0), rms[axis] * (1.0 - math.sqrt(3.0))
    return G, F, shown
