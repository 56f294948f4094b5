"""State-variable filters: s^k / A(s) of sampled signals in continuous time, exact for held or ramped inputs and delays.

Between its samples an input is held ("zoh") or joined by straight lines ("foh"). Commands of a computer are held;
measured deflections are smooth, and straight lines are nearer to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.hold import held
from testbench.estimators.settings import Hold
from testbench.estimators.state_space import Trajectories

_ON_SAMPLE = 1e-9  # fractions of a sample below this are rounding


def holds(
    inputs: Sequence[str], given: Mapping[str, Hold] | Hold | None, records: Sequence[FlightRecord] = ()
) -> tuple[tuple[Hold, ...], tuple[str, ...]]:
    """Return how each input runs between its samples, and the names of those of which only the records say so.

    As ``given``, else "zoh" for commands and for what the records show to be held, and "foh" for the rest.

    Args:
        inputs: (m,) channel names; those that end in ``_cmd`` are commands.
        given: one word for all inputs, or input -> word; None for the default.
        records: what is identified from.

    Raises:
        EstimationError: an input is unknown.
    """
    asked: Mapping[str, Hold] = dict.fromkeys(inputs, given) if isinstance(given, str) else given or {}
    for name in asked:
        if name not in inputs:
            raise EstimationError(f"hold must name inputs only, got '{name}'{nearest(name, inputs)}")
    found, recognised = held(inputs, [asked[n] == "zoh" if n in asked else None for n in inputs], records)
    table: dict[str, Hold] = {n: asked.get(n, "zoh" if h else "foh") for n, h in zip(inputs, found, strict=True)}
    return tuple(table[name] for name in inputs), recognised


def shifted(v: FloatArray, samples: int) -> FloatArray:
    """Return v[k - samples] (N,); before the first and after the last sample these hold."""
    return v[np.clip(np.arange(v.size) - samples, 0, v.size - 1)]


def _split(delay_samples: float) -> tuple[int, float]:
    """Return a delay as whole samples and a rest in [0, 1)."""
    whole = int(np.floor(delay_samples + _ON_SAMPLE))
    rest = delay_samples - whole
    return whole, rest if rest > _ON_SAMPLE else 0.0


def delayed(v: FloatArray, hold: Hold, delay_samples: float) -> FloatArray:
    """Return v(t_k - delay) (N,) of a signal between samples as ``hold`` says."""
    d, f = _split(delay_samples)
    now, before = shifted(v, d), shifted(v, d + 1)
    if f == 0.0:
        return now
    return before if hold == "zoh" else now + f * (before - now)


def _exponential(M: FloatArray) -> FloatArray:
    """Return exp(M) of a small matrix: Taylor series after halving, squared back.

    scipy's routine hands matrices of this size to threaded BLAS, which takes a hundred times as long.
    """
    norm = float(np.max(np.sum(np.abs(M), axis=0)))
    halvings = max(0, int(np.ceil(np.log2(norm / 0.5)))) if norm > 0.0 else 0
    M = M / 2.0**halvings
    term = out = np.eye(len(M))
    for k in range(1, 15):  # 0.5^15 / 15! lies below rounding
        term = term @ M / k
        out = out + term
    for _ in range(halvings):
        out = out @ out
    return out


class StateVariableFilter:
    """The filters s^(n-1)/A(s), ..., s/A(s), 1/A(s) on a grid of ``samples`` samples, from rest.

    Controllable canonical form dx/dt = F x + e1 v, x_i = s^(n-i)/A v, in time scaled by the geometric mean of the
    poles so that the states are of one size; stepped by matrix exponentials (Van Loan 1978), so that nothing but
    the course of v between samples is assumed.

    Args:
        a: (n + 1,) coefficients 1, a1 ... an of A(s), highest power first, n >= 1.
        dt_s: sample time, s.
        samples: number of samples N.

    Raises:
        EstimationError: a pole grows beyond all numbers within one sample.
    """

    def __init__(self, a: FloatArray, dt_s: float, samples: int) -> None:
        n = a.size - 1
        sizes = np.abs(np.roots(a))
        sizes = sizes[sizes > 1e-6 / dt_s / max(samples, 1)]
        self._scale = float(np.exp(np.mean(np.log(sizes)))) if sizes.size else 1.0 / dt_s
        self._powers = self._scale ** -np.arange(1.0, n + 1.0)
        self._F = np.diag(np.ones(n - 1), -1)
        self._F[0] = -a[1:] * self._powers
        self._e = np.eye(n, 1)
        self._h = dt_s * self._scale
        self._known: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = {}
        self.a, self.order, self.samples = a, n, samples
        with np.errstate(all="ignore"):
            step = self._moments(1.0)[0]
        if not np.all(np.isfinite(step)):
            fastest = float(np.max(np.roots(a).real))
            raise EstimationError(
                f"a pole must not grow beyond all numbers within a sample of {dt_s:g} s, got one at {fastest:.3g} 1/s"
            )
        self._paths = Trajectories(step, samples)

    def _moments(self, part: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return exp(F h), the response to v = 1 and to a v that rises from 0 to 1 over h = part of a sample."""
        if part in self._known:
            return self._known[part]
        n, h = self.order, part * self._h
        M = np.zeros((n + 2, n + 2))
        M[:n, :n], M[:n, n], M[n, n + 1] = self._F * h, self._e[:, 0] * h, 1.0
        out = _exponential(M)
        self._known[part] = out[:n, :n], out[:n, n], out[:n, n + 1]
        return self._known[part]

    def _forcing(self, v: FloatArray, hold: Hold, delay_samples: float) -> FloatArray:
        """Return what v adds to the state over each sample, (N, n)."""
        d, f = _split(delay_samples)
        knot = shifted(v, d)
        _, flat, ramp = self._moments(1.0 - f)
        if hold == "zoh":
            out = np.outer(knot, flat)
            if f > 0.0:
                across = self._moments(1.0 - f)[0]
                out += np.outer(shifted(v, d + 1), across @ self._moments(f)[1])
            return out
        begin = delayed(v, hold, delay_samples)
        end = delayed(v, hold, delay_samples - 1.0)
        out = np.outer(knot, flat) + np.outer(end - knot, ramp)
        if f > 0.0:
            across = self._moments(1.0 - f)[0]
            _, flat, ramp = self._moments(f)
            out += (np.outer(begin, flat) + np.outer(knot - begin, ramp)) @ across.T
        return out

    def states(self, v: FloatArray, hold: Sequence[Hold], delay_samples: Sequence[float]) -> FloatArray:
        """Return s^(n-i)/A v for i = 1 ... n of the columns of v (N, b), shape (N, n, b).

        For poles that grow by more than a factor 1000 over the grid they are those from another initial state (see
        :class:`~testbench.estimators.state_space.Trajectories`).
        """
        forcing = [self._forcing(column, word, d) for column, word, d in zip(v.T, hold, delay_samples, strict=True)]
        x = self._paths.forced(np.stack(forcing, axis=2))
        return np.asarray(x * self._powers[:, None])

    def free(self) -> FloatArray:
        """Return a basis (N, n) of the free responses: the solutions of A(d/dt) y = 0."""
        return self._paths.free()[:, -1]

    def output(self, b: FloatArray, states: FloatArray, v: FloatArray) -> FloatArray:
        """Return B(s)/A(s) v (N,) from the states (N, n) of v and v itself, delayed alike.

        Args:
            b: (n + 1,) coefficients of s^n ... 1.
            states: (N, n) of :meth:`states`.
            v: (N,) of :func:`delayed`.
        """
        return np.asarray(states @ (b[1:] - b[0] * self.a[1:]) + b[0] * v)
