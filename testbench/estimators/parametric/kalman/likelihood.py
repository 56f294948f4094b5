"""The filter-error cost of a set of records: innovations and their exact derivatives by all unknowns.

Unknowns are those of output error, then ln F: the process noise of the states that are chosen to have some.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.parametric.gauss_newton import Problem
from testbench.estimators.parametric.kalman.gain import Gain, sampled_noise, steady_gain
from testbench.estimators.parametric.kalman.innovations import Rows, innovations
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.structure import STEP, AnyArray, LinearStructure

_START = 0.1  # process noise to start from, relative to the size of a state, per square root of a second
_SMALLEST, _LARGEST = 1e-5, 1e2  # and its bounds, for the numbers' sake
_BELIEF = np.log(
    1e3
)  # ln F is believed to lie within that of its start: where there is no noise, nothing else holds it
_NUDGE = 1e-6  # of a state, to linearise a nonlinear structure; its parameters are stepped exactly


class Part(NamedTuple):
    """One record: innovations v (N, p), zero where not valid, derivatives dv (N, p, a), predicted states x (N, n), and
    gain. Not finite where the filter fails."""

    v: FloatArray
    dv: FloatArray
    x: FloatArray
    gain: Gain


class FilterLikelihood:
    """Innovations as a function of a search point.

    Args:
        base: the records, the structure and what is estimated of them besides noise.
        noisy: indices of the states whose process noise is estimated.
        fixed: (n,) process noise of the other states, unit of the state per square root of a second.
    """

    def __init__(self, base: Likelihood, noisy: Sequence[int], fixed: FloatArray) -> None:
        self.base, self.noisy, self.fixed = base, list(noisy), fixed
        self.points = [(s.x0, s.u[0]) for s in base.stretches]  # where nonlinear structures are linearised
        self.unknowns = base.unknowns + len(self.noisy)
        self.state_size = self._state_size()

    def _state_size(self) -> FloatArray:
        """Return (n,) how far each state goes when the outputs go as far as they do, seen over one second."""
        base = self.base
        A, C = (part[0].real for part in self.linearised(base.structure.values[None].astype(complex), 0))
        samples = max(1, round(1.0 / base.dt_s))
        step, _ = sampled_noise(A, np.zeros(len(A)), base.dt_s)
        total, power = np.zeros(len(A)), np.eye(len(A))
        for _ in range(samples):
            total += np.sum((C / base.size[:, None] @ power) ** 2, axis=0)
            power = step @ power
        return np.divide(1.0, np.sqrt(total / samples), out=np.ones_like(total), where=total > 0.0)

    def start(self, values: FloatArray) -> FloatArray:
        """Return the search point of parameter values (k,)."""
        return np.concatenate([self.base.start(values), np.log(_START * self.state_size[self.noisy])])

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the search point."""
        (low, high), size = self.base.bounds(), np.log(self.state_size[self.noisy])
        return np.concatenate([low, size + np.log(_SMALLEST)]), np.concatenate([high, size + np.log(_LARGEST)])

    @property
    def prior_weight(self) -> FloatArray:
        """(a,) one over the standard deviation of the prior; 0 without one."""
        out = np.zeros(self.unknowns)
        out[: self.base.prior_weight.size] = self.base.prior_weight
        out[self.base.unknowns :] = 1.0 / _BELIEF
        return out

    def names(self) -> list[str]:
        """Return a name for every unknown, for messages."""
        return self.base.names() + [f"process noise of {self.base.structure.states[i]}" for i in self.noisy]

    def process_noise(self, point: AnyArray) -> AnyArray:
        """Return F (..., n) of search points (..., a)."""
        F = np.array(np.broadcast_to(self.fixed, (*point.shape[:-1], self.fixed.size)), point.dtype)
        F[..., self.noisy] = np.exp(point[..., self.base.unknowns :])
        return F

    def linearised(self, params: AnyArray, record: int) -> tuple[AnyArray, AnyArray]:
        """Return A (rows, n, n) and C (rows, p, n) of complex parameters (rows, k) at a record's point."""
        structure, (x, u) = self.base.structure, self.points[record]
        if isinstance(structure, LinearStructure):
            s = structure.matrices(params)
            return s.A, s.C
        n, count = x.size, len(params)
        nudge = _NUDGE * np.maximum(np.abs(x), 1.0)
        X = np.broadcast_to((x + np.vstack([np.diag(nudge), -np.diag(nudge)])).astype(complex), (count, 2 * n, n))
        U = np.broadcast_to(u, (count, 2 * n, u.size))
        P = np.broadcast_to(params[:, None], (count, 2 * n, params.shape[1]))
        f, h = structure.derivative(X, U, P), structure.output(X, U, P)
        A, C = (((z[:, :n] - z[:, n:]) / (2.0 * nudge[:, None])).transpose(0, 2, 1) for z in (f, h))
        return A, C

    def evaluate(self, point: FloatArray, R: FloatArray) -> list[Part]:
        """Return the records' innovations at a search point (a,), with the gain that variances R (p,) ask for."""
        linear = isinstance(self.base.structure, LinearStructure)  # then all records have one gain
        common = self._gain(point, np.sqrt(R), 0) if linear else None
        parts = []
        for i in range(len(self.base.stretches)):
            gain = common if linear else self._gain(point, np.sqrt(R), i)
            parts.append(self._lost(i) if gain is None else self._part(point, gain, i))
        return parts

    def _gain(self, point: FloatArray, G: FloatArray, i: int) -> Gain | None:
        """Return the gain with complex steps by the parameters and the process noise, then the nominal one."""
        base, f = self.base, self.base.layout.chosen.size
        active = np.r_[0:f, base.unknowns : self.unknowns]
        rows = np.tile(point.astype(complex), (active.size + 1, 1))
        rows[np.arange(active.size), active] += 1j * STEP
        params = np.tile(base.structure.values.astype(complex), (len(rows), 1))
        params[:, base.layout.chosen] = rows[:, :f]
        A, C = self.linearised(params, i)
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(C))):
            return None
        return steady_gain(A, C, self.process_noise(rows), G, base.dt_s)

    def _lost(self, i: int) -> Part:
        s, inf = self.base.stretches[i], np.inf
        (N, p), n = s.y.shape, s.x0.size
        none = Gain(np.full((n, p), inf), np.full((p, p), inf))
        return Part(np.full((N, p), inf), np.full((N, p, self.unknowns), inf), np.full((N, n), inf), none)

    def _part(self, point: FloatArray, gain: Gain, i: int) -> Part:
        base, layout, s = self.base, self.base.layout, self.base.stretches[i]
        f, mine = layout.chosen.size, layout.nuisances(i)
        active = np.r_[0:f, mine, base.unknowns : self.unknowns]  # the other records' nuisances do not matter here
        rows = np.tile(point.astype(complex), (active.size + 1, 1))
        rows[np.arange(active.size), active] += 1j * STEP
        params = np.tile(base.structure.values.astype(complex), (len(rows), 1))
        params[:, layout.chosen] = rows[:, :f]
        count = rows[0, mine].size  # of nuisances, which the gain does not feel
        K = np.concatenate([gain.K[:f], np.repeat(gain.K[-1:].real, count, axis=0), gain.K[f:]])
        own, n = rows[:, mine], layout.initial
        x0 = np.concatenate([own[:, :n], np.tile(s.x0[n:].astype(complex), (len(rows), 1))], axis=1)
        shift = np.zeros((len(rows), s.u.shape[1]), complex)
        shift[:, list(layout.biased_inputs)] = own[:, n + layout.offsets :]
        y = s.y[:, None] - np.einsum("kpb,rb->krp", s.offsets, own[:, n : n + layout.offsets])
        v, x = innovations(
            base.structure, Rows(params, x0, shift, K), s.u, y, s.valid, base.dt_s, base.held, base.substeps
        )
        dv = np.zeros((*s.y.shape, self.unknowns))
        dv[:, :, active] = v[:, :-1].imag.transpose(0, 2, 1) / STEP
        return Part(v[:, -1].real, dv, x[:, -1].real, Gain(gain.K[-1].real, gain.S[-1].real))

    def problem(self, R: FloatArray) -> Problem:
        """Return innovations and Jacobian, weighted by the variances R (p,), priors last, as a function."""
        weight, prior_weight = 1.0 / np.sqrt(R), self.prior_weight
        centre, believed = self.start(self.base.structure.values), prior_weight > 0.0
        prior = np.diag(prior_weight)[believed]

        def weighted(point: FloatArray) -> tuple[FloatArray, FloatArray]:
            with np.errstate(all="ignore"):  # a trial point may diverge: the search sees that and steps back
                parts = self.evaluate(point, R)
                r = [(part.v * weight).ravel() for part in parts]
                J = [(part.dv * weight[:, None]).reshape(-1, self.unknowns) for part in parts]
            r.append((prior_weight * (point - centre))[believed])
            J.append(prior)
            return np.concatenate(r), np.vstack(J)

        return weighted
