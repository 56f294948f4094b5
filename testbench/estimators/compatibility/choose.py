"""What the data tell: which errors are identifiable, which are significant, and which explain the data equally well.

How the noise of rates and accelerations, which output error takes as exact, enters the errors of estimates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.compatibility.fit import (
    Fit,
    Problem,
    Stretch,
    Whitener,
    noise_std,
    none_value,
    plausible_size,
)
from testbench.estimators.compatibility.take_out import parameters
from testbench.estimators.parametric.response import Sampling, respond, runge_kutta
from testbench.estimators.parametric.structure import STEP
from testbench.estimators.residuals import coloured_information, corrected_covariance

# --- how the noise of rates and accelerations, which output error takes as exact, enters the errors of estimates ------


def score_of_input_noise(problem: Problem, fit: Fit, whitened: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance (c, c) that white noise of the inputs adds to the score sum_i J[i]' v[i].

    A sample u_j[k] with noise of variance s_j^2 moves all outputs after it. With the adjoint
    L[k] = L[k+1] A[k] + J[k]' H[k], the score moves by c_j[k] = L[k+1] B0_j[k] + L[k] B1_j[k-1] + J[k]' D_j[k], where
    B0 and B1 are the derivatives of a step by the input at its two ends, and the covariance is sum s_j^2 c c'. The
    variances come from third differences of the inputs. Delays of instruments, short against the record, are left out.

    Args:
        problem: the records.
        fit: where it is linearised.
        whitened: per record derivatives (N, p, c) of the whitened residuals.
    """
    columns = whitened[0].shape[2]
    out = np.zeros((columns, columns))
    variance = [noise_std(problem.stretches, j) ** 2 for j in range(len(problem.structure.inputs))]
    for s, x0, J in zip(problem.stretches, fit.x0, whitened, strict=True):
        c = _moved(problem, fit, s, x0, _adjoint_filter(J, s, fit.whiteners))
        out += np.einsum("j,kaj,kbj->ab", variance, c, c, optimize=True)
    return out


def _adjoint_filter(J: FloatArray, s: Stretch, whiteners: Sequence[Whitener]) -> FloatArray:
    """Return the transposed whitening filters applied to J (N, p, c): what multiplies residuals before whitening."""
    out = np.zeros_like(J)
    for i, w in enumerate(whiteners):
        rows = np.flatnonzero(s.valid[:, i])
        order = w.a.size
        if rows.size <= order:
            continue
        e = J[rows[order:], i] / w.std
        out[rows[order:], i] += e
        for j, a in enumerate(w.a):
            out[rows[order - 1 - j : rows.size - 1 - j], i] -= a * e
    return out


def _moved(problem: Problem, fit: Fit, s: Stretch, x0: FloatArray, J: FloatArray) -> FloatArray:
    """Return c (N, c, m): how each sample of each input moves the score."""
    structure, dt_s = problem.structure, problem.dt_s
    N, m = s.u.shape
    n = len(structure.states)
    p = parameters(structure, fit.values)
    x = respond(structure, p, (), s.u, Sampling(dt_s, problem.held), x0).x
    rows = n + 2 * m
    X = np.tile(x[:, None, :].astype(complex), (1, rows, 1))
    U = np.tile(s.u[:, None, :].astype(complex), (1, rows, 1))
    dU = np.tile(np.diff(s.u, axis=0, append=s.u[-1:])[:, None, :].astype(complex), (1, rows, 1))
    X[:, np.arange(n), np.arange(n)] += 1j * STEP
    U[:, n + np.arange(m), np.arange(m)] += 1j * STEP
    dU[:, n + np.arange(m), np.arange(m)] -= 1j * STEP  # the end of the step stays
    dU[:, n + m + np.arange(m), np.arange(m)] += 1j * STEP
    P = np.broadcast_to(p, (N, rows, p.size))
    step = runge_kutta(structure, X, U, dU, P, dt_s).imag.transpose(0, 2, 1) / STEP
    A, B0, B1 = step[:, :, :n], step[:, :, n : n + m], step[:, :, n + m :]
    read = structure.output(X, U, P).imag.transpose(0, 2, 1) / STEP
    H, D = read[:, :, :n], read[:, :, n : n + m]
    Jt = J.transpose(0, 2, 1)
    felt, c = Jt @ H, Jt @ D
    L = felt[-1]
    c[-1] += L @ B1[-2]
    for k in range(N - 2, -1, -1):
        c[k] += L @ B0[k]
        L = L @ A[k] + felt[k]
        if k:
            c[k] += L @ B1[k - 1]
    return np.asarray(c)


# --- what the data tell -----------------------------------------------------------------------------------------------


USEFUL = 1.0 / 3.0  # largest standard error over plausible size of an error that the data are said to tell
_FELT = 0.1  # share of its plausible size that an error must take up of another's to be named with it
_LIKELY = 6.0  # loss of 2 ln likelihood below which another explanation is as good (a likelihood ratio of 20)


@dataclass(frozen=True)
class Linear:
    """The whitened residuals at the end of a search, linear in errors and initial states.

    Attributes:
        names: errors, the first columns.
        here: (k,) their values where it was linearised.
        R: (c, c) triangle of the c = k + initial states columns of derivatives.
        target: (c,) residuals in its frame.
        score: (c, c) covariance of the sums of derivatives times residuals, residuals correlated as they are and moved
            by the noise of the inputs.
    """

    names: tuple[str, ...]
    here: FloatArray
    R: FloatArray
    target: FloatArray
    score: FloatArray

    def columns(self, kept: Sequence[str]) -> list[int]:
        """Return the columns of the errors ``kept`` and of the initial states."""
        return [self.names.index(n) for n in kept] + list(range(len(self.names), self.R.shape[1]))

    def solve(self, kept: Sequence[str]) -> tuple[FloatArray, float]:
        """Return the estimates of ``kept`` without all other errors, and the cost that is left."""
        none = np.array([none_value(n) for n in self.names])
        shift = np.zeros(self.R.shape[1])
        shift[: none.size] = none - self.here  # everything at none first; what is kept moves from there
        columns = self.columns(kept)
        r = self.target + self.R @ shift
        step = -np.linalg.lstsq(self._scaled(columns), r, rcond=1e-13)[0]
        left = r + self._scaled(columns) @ step
        size = np.linalg.norm(self.R[:, columns], axis=0)
        at = [self.names.index(n) for n in kept]
        return none[at] + (step / np.where(size > 0.0, size, 1.0))[: len(at)], float(left @ left)

    def _scaled(self, columns: Sequence[int]) -> FloatArray:
        part = self.R[:, columns]
        size = np.linalg.norm(part, axis=0)
        return np.asarray(part / np.where(size > 0.0, size, 1.0))

    def covariance(self, kept: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of ``kept`` for white residuals, and the corrected one where that is larger."""
        columns, k = self.columns(kept), len(kept)
        size = np.linalg.norm(self.R[:, columns], axis=0)
        size = np.where(size > 0.0, size, 1.0)
        inverse = np.linalg.pinv(self._scaled(columns), rcond=1e-13) / size[:, None]
        plain: FloatArray = np.array(inverse @ inverse.T, np.float64)
        corrected = corrected_covariance(plain, self.score[np.ix_(columns, columns)])
        variance = np.asarray(np.diag(plain))[:k]
        factor = np.sqrt(np.maximum(np.diag(corrected)[:k] / np.where(variance > 0.0, variance, 1.0), 1.0))
        white = plain[:k, :k]
        return white, np.asarray(white * np.outer(factor, factor))

    def errors(self, kept: Sequence[str]) -> FloatArray:
        """Return the standard errors of ``kept``, corrected for coloured residuals."""
        return np.sqrt(np.diag(self.covariance(kept)[1]))


def linearise(problem: Problem, fit: Fit, names: Sequence[str]) -> Linear:
    """Return the linear problem of the errors ``names`` at the end of a search."""
    parts = problem.whitened(fit.whiteners, fit.values, fit.x0, names)
    columns = parts[0][1].shape[2]
    J = np.vstack([j.reshape(-1, columns) for _, j in parts])
    r = np.concatenate([v.ravel() for v, _ in parts])
    triangle = np.asarray(np.linalg.qr(np.column_stack([J, r]), mode="r"))
    score = coloured_information([j for _, j in parts], [v for v, _ in parts])
    score += score_of_input_noise(problem, fit, [j for _, j in parts])
    here = np.array([fit.values.get(n, none_value(n)) for n in names])
    return Linear(tuple(names), here, triangle[:, :-1], triangle[:, -1], score)


def identifiable(linear: Linear) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the errors that the data tell, in order of belief, and for every other error why the data do not tell it.

    An error is included if every standard error then stays below a third of the plausible size.
    """
    kept: tuple[str, ...] = ()
    lost: dict[str, str] = {}
    for name in linear.names:
        trial = (*kept, name)
        size = np.array([plausible_size(n) for n in trial])
        if _rank_kept(linear, kept, name) and np.all(linear.errors(trial) <= USEFUL * size):
            kept = trial
        else:
            lost[name] = _why(linear, kept, name)
    return kept, lost


def _rank_kept(linear: Linear, kept: Sequence[str], name: str) -> bool:
    column, share = _apart(linear, kept, name)
    return bool(np.linalg.norm(column) > 0.0 and share > 1e-7)


def _apart(linear: Linear, kept: Sequence[str], name: str) -> tuple[FloatArray, float]:
    """Return the column of an error and the share of it that the kept ones and initial states leave."""
    column = linear.R[:, linear.names.index(name)]
    Q = np.linalg.qr(linear._scaled(linear.columns(kept)))[0]
    left = column - Q @ (Q.T @ column)
    return column, float(np.linalg.norm(left) / max(float(np.linalg.norm(column)), 1e-300))


def _why(linear: Linear, kept: Sequence[str], name: str) -> str:
    column, _ = _apart(linear, kept, name)
    size = plausible_size(name)
    if np.linalg.norm(column) * size * USEFUL < 1.0:
        return "no output feels it in these manoeuvres"
    columns = linear.columns(kept)
    norm = np.linalg.norm(linear.R[:, columns], axis=0)
    share = np.linalg.lstsq(linear._scaled(columns), column, rcond=1e-13)[0] / np.where(norm > 0.0, norm, 1.0) * size
    alike = [n for n, s in zip(kept, share, strict=False) if abs(s) > _FELT * plausible_size(n)]
    return f"shows as {', '.join(alike)}" if alike else "shows as another initial state"


def significant(linear: Linear, kept: Sequence[str], threshold: float) -> tuple[str, ...]:
    """Return ``kept`` without the errors below ``threshold``, the least significant dropped one at a time.

    Args:
        linear: the problem.
        kept: errors to begin with.
        threshold: least estimate over standard error of the errors that stay.
    """
    left = list(kept)
    while left:
        values, _ = linear.solve(left)
        off = np.array([v - none_value(n) for n, v in zip(left, values, strict=True)])
        size = np.array([plausible_size(n) for n in left])
        error = linear.errors(left)
        ratio = np.abs(off) / np.maximum(error, 1e-300)
        ratio[np.abs(off) <= 1e-6 * size] = 0.0  # integration error of data without noise
        worst = int(np.argmin(ratio))
        if ratio[worst] >= threshold:
            break
        left.pop(worst)
    return tuple(left)


def alternatives(linear: Linear, found: Sequence[str]) -> Mapping[str, tuple[tuple[str, float, float], ...]]:
    """Return, for each error found, the others that explain the data as well: (name, estimate, standard error)."""
    _, cost = linear.solve(found)
    out: dict[str, tuple[tuple[str, float, float], ...]] = {}
    plain, corrected = linear.covariance(found)
    for i, name in enumerate(found):
        colour = corrected[i, i] / plain[i, i] if plain[i, i] > 0.0 else 1.0
        others = []
        for other in linear.names:
            if other in found or not _rank_kept(linear, [n for n in found if n != name], other):
                continue
            swapped = [other if n == name else n for n in found]
            values, loss = linear.solve(swapped)
            value = float(values[i])
            if loss - cost <= _LIKELY * colour and abs(value - none_value(other)) <= plausible_size(other):
                others.append((other, value, float(linear.errors(swapped)[i])))
        out[name] = tuple(others)
    return out
