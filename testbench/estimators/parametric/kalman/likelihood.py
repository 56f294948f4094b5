"""The filter-error cost of a set of records: innovations and their exact derivatives by all unknowns.

Unknowns are those of output error, then ln F: the process noise of the states that are chosen to have some; then, if
these states share it, what each takes of the noise of those before it: F is lower triangular.

The search for the maximum of the filter-error likelihood: Gauss-Newton steps in turns with new variances R.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.estimators.parametric.gauss_newton import (
    Minimum,
    Problem,
    Rounds,
    Sensitivities,
    believed_alone,
    in_blocks,
    minimise,
    reduced,
)
from testbench.estimators.parametric.kalman.innovations import Gain, Rows, innovations, sampled_noise, steady_gain
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.structure import STEP, AnyArray, LinearStructure

_START = 0.1  # process noise to start from, relative to the size of a state, per square root of a second
_SMALLEST, _LARGEST = 1e-5, 1e2  # and its bounds, for the numbers' sake
_BELIEF = np.log(
    1e3
)  # ln F is believed to lie within that of its start: where there is no noise, nothing else holds it
_NUDGE = 1e-6  # of a state, to linearise a nonlinear structure; its parameters are stepped exactly


class Part(NamedTuple):
    """One record: innovations v (N, p), zero where not valid, their sensitivities, predicted states x (N, n), and gain.
    Not finite where the filter fails."""

    v: FloatArray
    dv: Sensitivities
    x: FloatArray
    gain: Gain


class FilterLikelihood:
    """Innovations as a function of a search point.

    Args:
        base: the records, the structure and what is estimated of them besides noise.
        noisy: indices of the states whose process noise is estimated.
        fixed: (n,) process noise of the other states, unit of the state per square root of a second.
        shared: the process noise of these states goes together.
    """

    def __init__(self, base: Likelihood, noisy: Sequence[int], fixed: FloatArray, *, shared: bool = False) -> None:
        self.base, self.noisy, self.fixed = base, list(noisy), fixed
        self.points = [(s.x0, s.u[0]) for s in base.stretches]  # where nonlinear structures are linearised
        self.pairs = [(i, j) for k, i in enumerate(self.noisy) for j in self.noisy[:k]] if shared else []
        self.own = base.unknowns + len(self.noisy)  # where the logarithms end
        self.unknowns = self.own + len(self.pairs)
        self.state_size = self._state_size()

    def _state_size(self) -> FloatArray:
        """Return (n,) how far each state goes when the outputs go as far as they do, seen over one second."""
        base = self.base
        A, C = (part[0].real for part in self.linearised(base.structure.values[None].astype(complex), 0))
        samples = max(1, round(1.0 / base.sampling.dt_s))
        step, _ = sampled_noise(A, np.zeros(len(A)), base.sampling.dt_s)
        total, power = np.zeros(len(A)), np.eye(len(A))
        for _ in range(samples):
            total += np.sum((C / base.size[:, None] @ power) ** 2, axis=0)
            power = step @ power
        return np.divide(1.0, np.sqrt(total / samples), out=np.ones_like(total), where=total > 0.0)

    def start(self, values: FloatArray) -> FloatArray:
        """Return the search point of parameter values (k,)."""
        own = np.log(_START * self.state_size[self.noisy])
        return np.concatenate([self.base.start(values), own, np.zeros(len(self.pairs))])

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the search point."""
        (low, high), size = self.base.bounds(), np.log(self.state_size[self.noisy])
        largest = np.full(len(self.pairs), _LARGEST / _START)
        return (
            np.concatenate([low, size + np.log(_SMALLEST), -largest]),
            np.concatenate([high, size + np.log(_LARGEST), largest]),
        )

    @property
    def prior_weight(self) -> FloatArray:
        """(a,) one over the standard deviation of the prior; 0 without one."""
        out = np.zeros(self.unknowns)
        out[: self.base.prior_weight.size] = self.base.prior_weight
        out[self.base.unknowns : self.own] = 1.0 / _BELIEF
        out[self.own :] = _START / _LARGEST
        return out

    def names(self) -> list[str]:
        """Return a name for every unknown, for messages."""
        states = self.base.structure.states
        own = [f"process noise of {states[i]}" for i in self.noisy]
        return self.base.names() + own + [f"process noise of {states[i]} with {states[j]}" for i, j in self.pairs]

    def process_noise(self, point: AnyArray) -> AnyArray:
        """Return F (..., n, n), lower triangular, of search points (..., a)."""
        n = self.fixed.size
        F = np.zeros((*point.shape[:-1], n, n), point.dtype)
        F[..., range(n), range(n)] = self.fixed
        F[..., self.noisy, self.noisy] = np.exp(point[..., self.base.unknowns : self.own])
        for k, (i, j) in enumerate(self.pairs, self.own):
            F[..., i, j] = _START * self.state_size[i] * point[..., k]
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
        try:
            return steady_gain(A, C, self.process_noise(rows), G, base.sampling.dt_s)
        except np.linalg.LinAlgError:
            return None  # an output without any noise, or a state that nothing moves: no gain is the best one

    @property
    def alone(self) -> NDArray[np.bool_]:
        """(a,) unknowns that only one record feels."""
        out = np.zeros(self.unknowns, bool)
        out[self.base.layout.chosen.size : self.base.unknowns] = True
        return out

    def _felt(self, i: int) -> NDArray[np.intp]:
        """Return the unknowns that a record feels: all but the nuisances of others."""
        return np.concatenate([self.base.layout.felt(i), np.arange(self.base.unknowns, self.unknowns)])

    def _lost(self, i: int) -> Part:
        s, inf = self.base.stretches[i], np.inf
        (N, p), n = s.y.shape, s.x0.size
        none = Gain(np.full((n, p), inf), np.full((p, p), inf))
        felt = self._felt(i)
        return Part(
            np.full((N, p), inf), Sensitivities(np.full((N, p, felt.size), inf), felt), np.full((N, n), inf), none
        )

    def _part(self, point: FloatArray, gain: Gain, i: int) -> Part:
        base, layout, s = self.base, self.base.layout, self.base.stretches[i]
        f, mine = layout.chosen.size, layout.nuisances(i)
        active = self._felt(i)
        rows = np.tile(point.astype(complex), (active.size + 1, 1))
        rows[np.arange(active.size), active] += 1j * STEP
        params = np.tile(base.structure.values.astype(complex), (len(rows), 1))
        params[:, layout.chosen] = rows[:, :f]
        count = rows[0, mine].size  # of nuisances, which the gain does not feel
        K = np.concatenate([gain.K[:f], np.repeat(gain.K[-1:].real, count, axis=0), gain.K[f:]])
        own, n = rows[:, mine], layout.initial
        x0 = np.concatenate([own[:, :n], np.tile(s.x0[n:].astype(complex), (len(rows), 1))], axis=1)
        shift = np.zeros((len(rows), s.u.shape[1]), complex)
        late = n + layout.offsets + len(layout.biased_inputs)  # where lateness begins
        shift[:, list(layout.biased_inputs)] = own[:, n + layout.offsets : late]
        timed = layout.split(point, i)
        timed = timed._replace(biases=np.zeros_like(timed.biases))
        y = s.y[:, None] - np.einsum("kpb,rb->krp", s.offsets, own[:, n : n + layout.offsets])
        along = Rows(params, x0, shift, K)
        v, x = innovations(base.structure, along, base.driven(s.u, timed), y, s.valid, base.sampling)
        dv = v[:, :-1].imag.transpose(0, 2, 1) / STEP
        nominal = Rows(*(part[-1:] for part in along))
        for j, (moved, step) in enumerate(base.acting_later(s.u, timed)):
            there = innovations(base.structure, nominal, moved, y[:, -1:], s.valid, base.sampling).v
            dv[:, :, f + late + j] = (there[:, -1] - v[:, -1]).real / step
        return Part(v[:, -1].real, Sensitivities(dv, active), x[:, -1].real, Gain(gain.K[-1].real, gain.S[-1].real))

    def problem(self, R: FloatArray) -> Problem:
        """Return innovations and Jacobian, weighted by the variances R (p,), with priors, as a function."""
        weight, prior_weight = 1.0 / np.sqrt(R), self.prior_weight
        alone = np.append(self.alone, False)  # the innovations, last, meet in all records
        centre = self.start(self.base.structure.values)
        believed = np.flatnonzero((prior_weight > 0.0) & ~self.alone)
        prior, columns = np.diag(prior_weight[believed]), np.append(believed, self.unknowns)

        def parts(point: FloatArray) -> Iterator[tuple[Iterable[FloatArray], NDArray[np.intp]]]:
            for part in self.evaluate(point, R):
                own = believed_alone(part.dv.columns, prior_weight, alone, point)
                rows = chain(in_blocks(part.v, part.dv, np.diag(weight)), own)
                yield rows, np.append(part.dv.columns, self.unknowns)
            yield [np.column_stack([prior, (prior_weight * (point - centre))[believed]])], columns

        return reduced(parts, alone)


# --- the search for the maximum of the filter-error likelihood --------------------------------------------------------


_SETTLED = 3e-3  # relative change of the innovations' variances between two rounds that ends them
_ROUNDS = 60
_FOLLOWING = 4  # steps per round until R has settled
_START = 0.1  # innovations to start from, relative to the outputs' size
_NOTHING = 1e-10  # innovations below this share of every output's size are rounding


class Found(NamedTuple):
    """Where the search ended: the minimum, innovations of every record, their variances R (p,), and how it went."""

    minimum: Minimum
    parts: list[Part]
    R: FloatArray
    rounds: int
    settled: bool

    @property
    def converged(self) -> bool:
        """Whether both the steps and the variances came to rest."""
        return self.minimum.converged and self.settled


def search(likelihood: FilterLikelihood, values: FloatArray, max_iterations: int, rounds: int = _ROUNDS) -> Found:
    """Search by Gauss-Newton steps for a given R in turns with a new R, F and point of linearisation.

    Args:
        likelihood: of the records; its points of linearisation are moved.
        values: (k,) parameter values to start from.
        max_iterations: Gauss-Newton steps of the last round.
        rounds: most values of R.

    Raises:
        EstimationError: the filter diverges from these values.
    """
    base = likelihood.base
    low, high = likelihood.bounds()
    point = likelihood.start(values)
    R = (_START * base.size) ** 2
    total = float(base.counts.sum())
    settled, done, following = False, 0, Rounds(R)
    while True:
        done += 1
        # The rounds only have to follow R; the last one ends at 1/1000 of an error.
        tolerance, most = (1e-6, max_iterations) if settled else (1e-2, _FOLLOWING)
        minimum = minimise(likelihood.problem(R), point, low, high, tolerance=tolerance / total, max_iterations=most)
        point = minimum.point
        parts = likelihood.evaluate(point, R)
        if settled or done == rounds:
            return Found(minimum, parts, R, done, settled)
        new = np.diag(base.noise([part.v for part in parts]))
        if np.all(new <= (_NOTHING * base.size) ** 2):  # data without noise: nothing left to weigh
            return Found(minimum._replace(converged=True), parts, new, done, True)
        settled = bool(np.max(np.abs(new - R) / R) < _SETTLED)
        new = following.follow(new, settled)
        likelihood.points = [
            (part.x.mean(axis=0), s.u.mean(axis=0)) for part, s in zip(parts, base.stretches, strict=True)
        ]
        if not settled:
            point = np.clip(_rescaled(likelihood, point, R, new), low, high)
        R = new


def _rescaled(likelihood: FilterLikelihood, point: FloatArray, R: FloatArray, new: FloatArray) -> FloatArray:
    """Return the search point with F F' changed as R is where the states show: Jategaonkar 2015, section 5.3."""
    base, out = likelihood.base, point.copy()
    params = base.parameters(point, base.structure.values)[None].astype(complex)
    C = likelihood.linearised(params, 0)[1][0].real[:, likelihood.noisy]
    before, after = (np.sum(C**2 / variance[:, None], axis=0) for variance in (R, new))
    seen = before > 0.0
    common = np.full(seen.size, np.exp(np.mean(np.log(new / R))))
    change = 0.5 * np.log(np.divide(before, after, out=common, where=seen))
    out[base.unknowns : likelihood.own] += change
    rows = [likelihood.noisy.index(i) for i, _ in likelihood.pairs]
    out[likelihood.own :] *= np.exp(change[rows])
    return out
