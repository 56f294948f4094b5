"""A linear model of the simulator about a trimmed flight.

Mode by mode: the band in which a mode rings, and its term of the response of a linear model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import ChannelError, nearest
from testbench.core.record import FloatArray

SERVO = "servo_"
"""Before the name of a control: the state of its servo."""
LAW = "law_"
"""Before the name of a motion and a number: a state of the model's own control law."""
ENGINE = ("motor_speed", "manifold_pressure")
"""States of propellers and piston engines, where an aircraft has them: rad/s, and Pa in the first engine."""
PLANE_STATES = {"longitudinal": ("u", "w", "q", "theta", "h"), "lateral": ("v", "p", "r", "phi")}
PLANE_CONTROLS = {"longitudinal": ("de",), "lateral": ("da", "dr")}
"""Plane -> rigid states of its motion, and the surfaces that move it."""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """xdot = A x + B u, y = C x + D u for deviations from trim, SI.

    Attributes:
        A, B, C, D: (n, n), (n, m), (p, n), (p, m).
        states, inputs, outputs: names; inputs are control channels (deflection reached) or commands (``de_cmd``).
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def fed_back(self) -> tuple[str, ...]:
        """States of the servos whose commands hold a feedback that an amendment added."""
        rows = dict(zip(self.states, self.A, strict=True))
        return tuple(s for s, row in rows.items() if s.startswith(SERVO) and np.count_nonzero(row) > 1)

    def commands(self, controls: Sequence[str]) -> tuple[str, ...]:
        """Return the inputs that command controls: through the servo where there is one."""
        return tuple(f"{c}_cmd" if f"{c}_cmd" in self.inputs else c for c in controls)

    def poles(self) -> NDArray[np.complex128]:
        """Return the eigenvalues of A, rad/s."""
        return np.asarray(np.linalg.eigvals(self.A), np.complex128)

    def frequency_response(
        self, omega_rad_s: FloatArray, outputs: Sequence[str], inputs: Sequence[str]
    ) -> NDArray[np.complex128]:
        """Return C (jw - A)^-1 B + D at ``omega_rad_s`` (k,) for the named channels, shape (k, p, m)."""
        rows = [index_of(o, self.outputs) for o in outputs]
        columns = [index_of(i, self.inputs) for i in inputs]
        eye = np.eye(len(self.states))
        X = np.linalg.solve(
            1j * np.asarray(omega_rad_s)[:, None, None] * eye - self.A, self.B[None, :, columns].astype(complex)
        )
        return np.asarray(self.C[rows] @ X + self.D[np.ix_(rows, columns)], np.complex128)

    def subsystem(self, states: Sequence[str]) -> LinearModel:
        """Return the model of ``states`` alone, the others held at zero; an engine left out follows at once."""
        whole = self if any(s in ENGINE for s in states) else self.with_quick_engines()
        i = [index_of(s, whole.states) for s in states]
        return LinearModel(
            whole.A[np.ix_(i, i)], whole.B[i], whole.C[:, i], whole.D, tuple(states), self.inputs, self.outputs
        )

    def with_quick_engines(self) -> LinearModel:
        """Return the model without states of engines, which take their equilibrium at once.

        With e the states of engines and x the others, 0 = A_ex x + A_ee e + B_e u gives e.
        """
        e = [i for i, s in enumerate(self.states) if s in ENGINE]
        if not e:
            return self
        x = [i for i in range(len(self.states)) if i not in e]
        by_x, by_u = (-np.linalg.solve(self.A[np.ix_(e, e)], M) for M in (self.A[np.ix_(e, x)], self.B[e]))
        return LinearModel(
            self.A[np.ix_(x, x)] + self.A[np.ix_(x, e)] @ by_x,
            self.B[x] + self.A[np.ix_(x, e)] @ by_u,
            self.C[:, x] + self.C[:, e] @ by_x,
            self.D + self.C[:, e] @ by_u,
            tuple(self.states[i] for i in x),
            self.inputs,
            self.outputs,
        )

    def longitudinal(self, symmetric: Sequence[int] = ()) -> LinearModel:
        """Return the longitudinal motion: u, w, q, theta, h and the modes numbered ``symmetric`` (from 1)."""
        modal = [f"{kind}_{i}" for kind in ("eta", "etadot") for i in symmetric]
        return self.subsystem(["u", "w", "q", "theta", "h", *modal])

    def lateral(self, antisymmetric: Sequence[int] = ()) -> LinearModel:
        """Return the lateral-directional motion: v, p, r, phi and the modes numbered ``antisymmetric`` (from 1)."""
        modal = [f"{kind}_{i}" for kind in ("eta", "etadot") for i in antisymmetric]
        return self.subsystem(["v", "p", "r", "phi", *modal])

    def to_control(self) -> object:
        """Return the model as a python-control state space with named signals."""
        import control

        return control.ss(self.A, self.B, self.C, self.D, states=self.states, inputs=self.inputs, outputs=self.outputs)


def index_of(name: str, names: Sequence[str]) -> int:
    """Return the place of a channel of the model; ChannelError if it has none of that name."""
    if name not in names:
        raise ChannelError(f"a channel of the linear model must be one of its own, got '{name}'{nearest(name, names)}")
    return list(names).index(name)


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
