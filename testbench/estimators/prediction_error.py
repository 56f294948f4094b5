"""Prediction error: a state-space model whose one-step predictions fit best, started from a subspace estimate.

    x[k+1] = A x[k] + B u[k] + K e[k],    y[k] = C x[k] + D u[k] + o + e[k]

All matrices, and an initial state x[0] and constants o per record, minimise sum e' S^-1 e + N ln |S|, by Gauss-Newton
steps for a given S in turn with S = sum e e' / N (L. Ljung, System Identification, 2nd ed., 1999, section 7.2 and
chapter 10). All entries are free, but only directions that a change of the states' basis does not produce are searched:
data-driven local coordinates, T. McKelvey, A. Helmersson and T. Ribarits, Automatica 40, 2004. What is reported with
errors (poles, frequency response) does not depend on the basis.

Outputs that were not measured correct nothing: e = 0 there. With ``disturbances`` off, K = 0: output error.

One-step prediction errors of a discrete state-space model, and their exact derivatives by all its entries.

Standard errors of the poles and the frequency response of a state-space model that has a covariance.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, AdviceList
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.model import check_records, continuous_poles
from testbench.estimators.parametric.accuracy import coloured_covariance, whiteness
from testbench.estimators.parametric.gauss_newton import (
    Minimum,
    Problem,
    Sensitivities,
    in_blocks,
    minimise,
    reduced,
    square_root,
)
from testbench.estimators.parametric.kalman.innovations import steady_covariance
from testbench.estimators.settings import DsrE, PredictionError, Refinement, Subspace
from testbench.estimators.state_space import Series, StateSpaceModel, check_sample_time
from testbench.estimators.subspace import dsr_e, family
from testbench.estimators.trajectories import Trajectories, carried

# --- standard errors of the poles and the frequency response of a state-space model that has a covariance -------------


class PoleAccuracy(NamedTuple):
    """A continuous pole, rad/s, its natural frequency (rad/s) and damping ratio, and the standard errors of all."""

    pole: complex
    wn_rad_s: float
    zeta: float
    real_std: float
    imag_std: float
    wn_std: float
    zeta_std: float


def pole_accuracy(model: StateSpaceModel) -> tuple[PoleAccuracy, ...]:
    """Return the poles of the upper half plane with standard errors, the slowest first.

        ds = l' dA r / (l' r z dt),    l, r left and right eigenvectors of the discrete pole z

    propagated linearly from the covariance; independent of the states' basis.

    Raises:
        EstimationError: the model has no covariance: it was not estimated by prediction errors.
    """
    covariance = _covariance_of(model)
    n = model.order
    values, right = np.linalg.eig(model.A)
    left = np.linalg.inv(right)
    out = []
    for i, z in enumerate(values):
        real_negative = abs(z.imag) <= 1e-12 * max(abs(z), 1e-300) and z.real <= 0.0
        if z.imag < 0.0 or real_negative:
            continue
        s = np.log(complex(z)) / model.dt_s
        d = np.outer(left[i], right[:, i]).ravel() / (z * model.dt_s)
        wn = max(abs(s), 1e-300)
        d_wn = (np.conj(s) * d).real / wn
        d_zeta = -d.real / wn + s.real * d_wn / wn**2
        P = covariance[: n * n, : n * n]
        std = [float(np.sqrt(max(g @ P @ g, 0.0))) for g in (d.real, d.imag, d_wn, d_zeta)]
        out.append(PoleAccuracy(complex(s), float(wn), float(-s.real / wn), *std))
    return tuple(sorted(out, key=lambda pole: pole.wn_rad_s))


def _covariance_of(model: StateSpaceModel) -> FloatArray:
    if "covariance" not in model.diagnostics:
        raise EstimationError(
            f"method '{model.method}' gives no covariance of its matrices; refine it by prediction error"
        )
    return np.asarray(model.diagnostics["covariance"], float)


# --- one-step prediction errors of a discrete state-space model, and their exact derivatives by all its entries -------


_GROWTH = 1e3  # over a series, beyond which digits are lost in a recursion forwards


class Matrices(NamedTuple):
    """x[k+1] = A x + B u + K e, y = C x + D u + e."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray


class Layout(NamedTuple):
    """Order n, inputs m, outputs p, and what is free besides A, B and C: D, K, a constant per output and record.

    Entries stand in the order A, B, C, D, K, each row by row, those that are not free left out; then, per record, the
    initial state and the constants.
    """

    n: int
    m: int
    p: int
    direct: bool
    disturbances: bool
    offsets: bool

    @property
    def nuisances(self) -> int:
        """Unknowns of one record."""
        return self.n + (self.p if self.offsets else 0)

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Shapes of A, B, C, D and K; without entries where not free."""
        n, m, p = self.n, self.m, self.p
        return [(n, n), (n, m), (p, n), (p if self.direct else 0, m), (n if self.disturbances else 0, p)]

    @property
    def size(self) -> int:
        """Number of free entries."""
        return sum(a * b for a, b in self.shapes)

    @property
    def size_abcd(self) -> int:
        """Number of free entries without K."""
        return sum(a * b for a, b in self.shapes[:4])

    def moved(self, s: Matrices, step: FloatArray) -> Matrices:
        """Return the matrices with ``step`` (size,) added to their free entries."""
        parts = np.split(step, np.cumsum([a * b for a, b in self.shapes])[:-1])
        return Matrices(*(M + part.reshape(M.shape) if part.size else M for M, part in zip(s, parts, strict=True)))

    def vector(self, s: Matrices) -> FloatArray:
        """Return the free entries (size,)."""
        return np.concatenate([M.ravel() for M, (a, b) in zip(s, self.shapes, strict=True) if a * b])

    def units(self, size_u: FloatArray, size_y: FloatArray) -> FloatArray:
        """Return (size,) what an entry for channels divided by their sizes is multiplied by for SI units."""
        n, one = self.n, np.ones(self.n)
        y = size_y[:, None]
        full = Matrices(np.ones((n, n)), one[:, None] / size_u, y * one, y / size_u, one[:, None] / size_y)
        return self.vector(full)

    def with_direct(self, covariance: FloatArray) -> FloatArray:
        """Return a covariance of A, B, C and D with zeros for D where it is not free."""
        missing = 0 if self.direct else self.p * self.m
        return np.pad(covariance, (0, missing))


class Run(NamedTuple):
    """Errors e (N, p), zero where not measured, states x (N, n), and derivatives de (N, p, size + nuisances)."""

    e: FloatArray
    x: FloatArray
    de: FloatArray


def errors(s: Matrices, series: Series, nuisance: FloatArray, layout: Layout, derivatives: bool = False) -> Run:
    """Return one-step prediction errors over a series from the initial state and constants in ``nuisance``.

    The predictor x+ = (A - K M C) x + (B - K M D) u + K M (y - o), M = 1 where measured, is linear, and its
    sensitivities obey the same recursion with other inputs: sample by sample all of them at once, or, where it grows
    over the series, by :class:`.trajectories.Trajectories` in numbers that stay bounded (all outputs measured).

    Raises:
        EstimationError: it grows so fast that its initial state leaves nothing to be seen at the first sample.
    """
    u, y, valid = series
    n, p, N = layout.n, layout.p, len(u)
    x0, o = nuisance[:n], nuisance[n:] if layout.offsets else np.zeros(p)
    mask = valid.astype(float)
    rest = mask * (y - u @ s.D.T - o)
    A = s.A - np.einsum("ij,kj,jl->kil", s.K, mask, s.C)
    paths, free = None, np.zeros((0, n, n))
    if valid.all() and N * np.log(max(np.max(np.abs(np.linalg.eigvals(A[0]))), 1e-300)) > np.log(_GROWTH):
        paths = Trajectories(A[0], N)
        free = paths.free()
        try:
            free = free @ np.linalg.inv(free[0])
        except np.linalg.LinAlgError:
            said = "the predictor grows so fast that no initial state can be found; lower the order"
            raise EstimationError(said) from None

    def path(drive: FloatArray, first: FloatArray) -> FloatArray:
        """Return x (N, n, b) from ``first`` (n, b) under the drive (N, n, b)."""
        if paths is not None:
            out = paths.forced(drive)
            return np.asarray(out + np.matmul(free, first - out[0]))
        return carried(A, drive, first)

    x = path((u @ s.B.T + rest @ s.K.T)[:, :, None], x0[:, None])[:, :, 0]
    e = rest - mask * (x @ s.C.T)
    if not derivatives:
        return Run(e, x, np.zeros((N, p, 0)))
    force, direct = _forces(x, u, e, layout)
    force -= np.matmul(s.K, mask[:, :, None] * direct)
    first = np.zeros((n, force.shape[2]))
    first[:, layout.size : layout.size + n] = np.eye(n)
    dx = path(force, first)
    return Run(e, x, -mask[:, :, None] * (np.matmul(s.C, dx) + direct))


def _forces(x: FloatArray, u: FloatArray, e: FloatArray, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Return what each unknown adds to x+ at given e, (N, n, b), and to the predicted output at given x, (N, p, b)."""
    N, n, p = len(x), layout.n, layout.p

    def spread(rows: int, signal: FloatArray) -> FloatArray:
        return np.einsum("ij,ks->kijs", np.eye(rows), signal).reshape(N, rows, -1)

    states = [(x, True), (u, True), (x, False), (u, False), (e, True)]
    force, direct = [], []
    for (signal, drives), (rows, columns) in zip(states, layout.shapes, strict=True):
        if not rows * columns:
            continue
        part, none = spread(rows, signal), np.zeros((N, p if drives else n, rows * columns))
        force.append(part if drives else none)
        direct.append(none if drives else part)
    force.append(np.zeros((N, n, layout.nuisances)))
    constants = np.zeros((N, p, layout.nuisances))
    if layout.offsets:
        constants[:, :, n:] = np.eye(p)
    direct.append(constants)
    return np.concatenate(force, axis=2), np.concatenate(direct, axis=2)


def orbit(s: Matrices, layout: Layout) -> FloatArray:
    """Return a basis (size, size - n^2) of the changes of the entries that no change of the states' basis makes.

    A change x -> (I + E) x adds E A - A E, E B, -C E, 0 and E K; the basis is orthonormal and orthogonal to these.
    """
    n = layout.n
    tangent = np.zeros((layout.size, n * n))
    for j in range(n * n):
        E = np.zeros((n, n))
        E.flat[j] = 1.0
        tangent[:, j] = layout.vector(Matrices(E @ s.A - s.A @ E, E @ s.B, -s.C @ E, np.zeros_like(s.D), E @ s.K))
    return np.asarray(np.linalg.qr(tangent, mode="complete")[0][:, n * n :])


# --- prediction error -------------------------------------------------------------------------------------------------


_SETTLED = 1e-3  # relative change of the innovations' covariance between two rounds that ends them
_ROUNDS = 40
_EXACT = 1e-12  # floor of the innovations, as a share of an output's size
_NOTHING = 1e-10  # innovations below this share are rounding: nothing is left to weigh
_FREE_OF_NOISE = 1e-7  # start innovations below this share say nothing of a disturbance: K is not identifiable
_LOST = 1e-8  # smallest over largest singular value of the scaled Jacobian below which a direction is undecided
_MARGINAL = 0.999  # spectral radius of the predictor from which on it stands at its limit (judged)


@dataclass(frozen=True, eq=False)
class _Data:
    """Records divided by the channels' root mean square, (m,) and (p,)."""

    series: list[Series]
    size_u: FloatArray
    size_y: FloatArray


class _Found(NamedTuple):
    """Where the search ended: matrices in scaled units, nuisances (records, n + offsets), and the chart around it."""

    matrices: Matrices
    nuisances: FloatArray
    basis: FloatArray
    minimum: Minimum
    S: FloatArray
    rounds: int
    settled: bool


_DEFAULT = Refinement()


def estimate(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], settings: PredictionError
) -> StateSpaceModel:
    """Identify by a subspace method, then refine by prediction errors; see :func:`refine`.

    Args:
        records: measured records of deviations from trim with one sample time; of different lengths if need be.
        inputs: (m,) channels that drive the model.
        outputs: (p,) channels that it predicts.
        settings: of the start and of the refinement.

    Raises:
        EstimationError: as of the subspace method, or of :func:`refine`.
        ChannelError: a record lacks a channel.
    """
    first: dict[str, Any] = {
        "past_horizon": settings.past_horizon,
        "future_horizon": settings.future_horizon,
        "order": settings.order,
        "direct_feedthrough": settings.direct_feedthrough,
        "stable": True,
    }
    if settings.start == "dsr_e":
        model = dsr_e.estimate(records, inputs, outputs, DsrE(**first))
    else:
        model = family.estimate(records, inputs, outputs, Subspace(method=settings.start, **first))
    return refine(records, model, settings)


def refine(records: Sequence[FlightRecord], start: StateSpaceModel, settings: Refinement = _DEFAULT) -> StateSpaceModel:
    """Refine a state-space model by prediction errors.

    Args:
        records: measured records of deviations from trim with one sample time; of different lengths if need be.
        start: the start of the search, e.g. the estimate of a subspace method; it gives inputs, outputs and order.
        settings: what is estimated besides.

    Returns:
        The model. Diagnostics: ``prediction_error_percent`` (p,) and ``prediction_error_percent_start`` (p,), root mean
        square of e over that of y; ``innovation_covariance`` (p, p); ``cost`` (log likelihood without constants);
        ``rounds``, ``iterations``, ``converged``; ``disturbances`` and why not; ``parameters`` (free directions),
        ``covariance`` of the entries of A, B, C, D row by row, in that order (singular: ``state_accuracy`` turns it
        into errors of poles and frequency response), corrected for innovations that are not white;
        ``pole_accuracy``; ``pole_std``: standard deviation of each pole's distance from its estimate, rad/s;
        ``whiteness_p`` (p,), ``offsets`` and ``poles_without_continuous_counterpart``.

    Raises:
        EstimationError: fewer samples than unknowns, or a start that diverges over the records.
        ChannelError: a record lacks a channel.
        RecordError: the records' sample time is not the start's.
    """
    check_records(records, start.inputs, start.outputs)
    for record in records:
        check_sample_time(record, start.dt_s)
    data = _scaled(records, start)
    asked, disturbances = settings.direct_feedthrough, settings.disturbances
    through = bool(np.any(start.D)) if asked is None else asked
    first, nuisances, e = _first(data, start, through, disturbances, settings.offsets)
    quiet = all(np.sqrt(np.mean(part**2)) < _FREE_OF_NOISE for part in e)
    if disturbances and quiet:
        first = first._replace(K=np.zeros_like(first.K))
    n, m, p = start.order, len(start.inputs), len(start.outputs)
    layout = Layout(n, m, p, through, disturbances and not quiet, settings.offsets)
    unknowns = layout.size - n * n + len(records) * layout.nuisances
    counts = np.sum([s.valid.sum(axis=0) for s in data.series], axis=0)
    if counts.sum() <= unknowns:
        raise EstimationError(
            f"a model of order {n} has {unknowns} unknowns with the initial states, got {int(counts.sum())} valid "
            "output samples; give more data or lower the order"
        )
    found = _search(data, layout, first, nuisances, e, counts, settings.max_iterations)
    model = StateSpaceModel(
        method="prediction_error",
        inputs=start.inputs,
        outputs=start.outputs,
        dt_s=start.dt_s,
        settings={
            "disturbances": disturbances,
            "direct_feedthrough": through,
            "offsets": settings.offsets,
            "order": n,
            "start": start.method,
        },
        **_si(found.matrices, data),
    )
    return _finish(model, data, layout, found, e, counts, quiet)


def _scaled(records: Sequence[FlightRecord], start: StateSpaceModel) -> _Data:
    sizes = []
    for names in (start.inputs, start.outputs):
        parts = [r.select(names) for r in records]
        squares = np.sum([np.sum(np.where(r.valid, r.data, 0.0) ** 2, axis=0) for r in parts], axis=0)
        for name, square in zip(names, squares, strict=True):
            if square == 0.0:
                raise EstimationError(f"channel '{name}' must move to be modelled, but all its valid samples are zero")
        sizes.append(np.sqrt(squares / np.sum([r.valid.sum(axis=0) for r in parts], axis=0)))
    u, y = sizes
    series = [
        Series(r.columns(start.inputs) / u, r.columns(start.outputs) / y, r.select(start.outputs).valid)
        for r in records
    ]
    return _Data(series, u, y)


def _si(s: Matrices, data: _Data) -> dict[str, Any]:
    u, y = data.size_u, data.size_y[:, None]
    return {"A": s.A, "B": s.B / u, "C": y * s.C, "D": y * s.D / u, "K": s.K / data.size_y}


def _first(
    data: _Data, start: StateSpaceModel, through: bool, disturbances: bool, offsets: bool
) -> tuple[Matrices, FloatArray, list[FloatArray]]:
    """Return the start in scaled units and in a basis of states of unit size, fitted nuisances, and its errors."""
    u, y = data.size_u, data.size_y
    C, A = start.C / y[:, None], start.A
    D = start.D * u / y[:, None] if through else np.zeros_like(start.D)
    K = start.K * y if disturbances else np.zeros_like(start.K)
    n, p = start.order, len(start.outputs)
    if disturbances and np.max(np.abs(np.linalg.eigvals(A - K @ C))) >= 1.0:
        P = steady_covariance(A, C, 1e-2 * np.eye(n), np.ones(p))
        K = A @ np.linalg.solve(C @ P @ C.T + np.eye(p), C @ P).T
        if not np.all(np.isfinite(K)):
            raise EstimationError("the start has an unstable mode that no output shows; lower its order")
    s = Matrices(A, start.B * u, C, D, K)
    layout = Layout(n, len(start.inputs), p, through, disturbances, offsets)
    fitted, e = _fit_nuisances(data.series, s, layout)
    x = np.vstack([errors(s, z, z0, layout).x for z, z0 in zip(data.series, fitted, strict=True)])
    values, vectors = np.linalg.eigh(x.T @ x / len(x))
    values = np.maximum(values, 1e-12 * values[-1])
    T = (vectors / np.sqrt(values)).T
    back = vectors * np.sqrt(values)
    s = Matrices(T @ s.A @ back, T @ s.B, s.C @ back, s.D, T @ s.K)
    fitted[:, :n] = fitted[:, :n] @ T.T
    return s, fitted, e


def _fit_nuisances(series: Sequence[Series], s: Matrices, layout: Layout) -> tuple[FloatArray, list[FloatArray]]:
    """Return initial states and offsets (records, n + offsets), linear least squares, and the errors (N, p) left."""
    out, left = [], []
    for part in series:
        r = errors(s, part, np.zeros(layout.nuisances), layout, derivatives=True)
        J = r.de[:, :, layout.size :].reshape(-1, layout.nuisances)
        if not np.all(np.isfinite(r.e)) or not np.all(np.isfinite(J)):
            raise EstimationError("the start diverges over the records; start from a stable model")
        step = np.linalg.lstsq(J, -r.e.ravel(), rcond=1e-12)[0]
        out.append(step)
        left.append((r.e.ravel() + J @ step).reshape(r.e.shape))
    return np.array(out), left


def _covariance(e: Sequence[FloatArray], counts: FloatArray, series: Sequence[Series]) -> FloatArray:
    """Return S (p, p); diagonal where outputs come at different times, since products of pairs are then missing."""
    v = np.vstack(e)
    S = v.T @ v / np.sqrt(np.outer(counts, counts))
    if any(np.any(part.valid != part.valid[:, :1]) for part in series):
        S = np.diag(np.diag(S))
    rounding = 16.0 * np.finfo(float).eps * float(np.trace(S))  # errors of one sample alone have no full rank
    return np.asarray(S + (_EXACT**2 + rounding) * np.eye(len(S)))


def _problem(data: _Data, layout: Layout, centre: Matrices, basis: FloatArray, S: FloatArray) -> Problem:
    """Return weighted errors and their Jacobian by coordinates in ``basis`` around ``centre``, then the nuisances."""
    whiten = np.linalg.inv(np.linalg.cholesky(S))
    c, k = basis.shape[1], layout.nuisances
    total = c + k * len(data.series)
    alone = np.append(np.arange(total) >= c, False)  # the errors, last, meet in all records

    def parts(point: FloatArray) -> Iterator[tuple[Iterable[FloatArray], NDArray[np.intp]]]:
        s = layout.moved(centre, basis @ point[:c])
        causal = not layout.disturbances or np.max(np.abs(np.linalg.eigvals(s.A - s.K @ s.C))) < 1.0
        for i, part in enumerate(data.series):
            r = errors(s, part, point[c + i * k : c + (i + 1) * k], layout, derivatives=True)
            felt = _felt(r.de, basis, layout, i)
            yield in_blocks(r.e if causal else np.full(r.e.shape, np.inf), felt, whiten), np.append(felt.columns, total)

    return reduced(parts, alone)


def _felt(de: FloatArray, basis: FloatArray, layout: Layout, i: int) -> Sensitivities:
    """Return the sensitivities of the i-th record by coordinates in ``basis`` and by its own nuisances."""
    c, k = basis.shape[1], layout.nuisances
    columns = np.concatenate([np.arange(c), np.arange(c + i * k, c + (i + 1) * k)])
    return Sensitivities(np.concatenate([de[:, :, : layout.size] @ basis, de[:, :, layout.size :]], axis=2), columns)


def _search(
    data: _Data,
    layout: Layout,
    s: Matrices,
    nuisances: FloatArray,
    e: list[FloatArray],
    counts: FloatArray,
    max_iterations: int,
) -> _Found:
    """Search for a given S, in a chart around the point, in turns with a new S and a new chart."""
    S, total, settled, rounds = _covariance(e, counts, data.series), float(counts.sum()), False, 0
    while True:
        rounds += 1
        basis = orbit(s, layout)
        start = np.concatenate([np.zeros(basis.shape[1]), nuisances.ravel()])
        bound = np.full(start.size, np.inf)
        minimum = minimise(
            _problem(data, layout, s, basis, S),
            start,
            -bound,
            bound,
            tolerance=(1e-6 if settled else 1e-3) / total,
            max_iterations=max_iterations,
        )
        c = basis.shape[1]
        s, nuisances = layout.moved(s, basis @ minimum.point[:c]), minimum.point[c:].reshape(nuisances.shape)
        if settled or rounds == _ROUNDS:
            return _Found(s, nuisances, basis, minimum, S, rounds, settled)
        new = _covariance(
            [errors(s, part, z, layout).e for part, z in zip(data.series, nuisances, strict=True)], counts, data.series
        )
        settled = bool(np.max(np.abs(np.diag(new) / np.diag(S) - 1.0)) < _SETTLED)
        S = new
        if np.all(np.diag(S) <= _NOTHING**2):
            return _Found(s, nuisances, basis, minimum._replace(converged=True), S, rounds, True)


def _finish(
    model: StateSpaceModel,
    data: _Data,
    layout: Layout,
    found: _Found,
    before: list[FloatArray],
    counts: FloatArray,
    quiet: bool,
) -> StateSpaceModel:
    """Return the model with covariances, diagnostics and advice."""
    parts = [
        errors(found.matrices, s, z, layout, derivatives=True)
        for s, z in zip(data.series, found.nuisances, strict=True)
    ]
    e, c, k = [r.e for r in parts], found.basis.shape[1], layout.nuisances
    unknowns = c + k * len(parts)
    S = _covariance(e, counts, data.series) * counts.sum() / (counts.sum() - unknowns)
    felt = [_felt(r.de, found.basis, layout, i) for i, r in enumerate(parts)]
    whiten = np.linalg.inv(np.linalg.cholesky(S))
    rows = ((in_blocks(v, f, whiten), np.append(f.columns, unknowns)) for v, f in zip(e, felt, strict=True))
    R = square_root(rows, np.append(np.arange(unknowns) >= c, False))[:, :-1]
    size = np.sqrt(np.sum(R**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    _, sigma, Vt = np.linalg.svd(R / size)
    kept = sigma > _LOST * sigma[0]
    root = Vt[kept].T / sigma[kept] / size[:, None]
    plain = root @ root.T
    corrected = coloured_covariance(e, lambda: felt, S, plain, np.zeros(unknowns))[:c, :c]
    unit = layout.units(data.size_u, data.size_y)
    covariance = (found.basis @ corrected @ found.basis.T) * np.outer(unit, unit)
    end = layout.size_abcd
    rms = [np.sqrt(np.sum([np.sum(v**2, axis=0) for v in errs], axis=0) / counts) for errs in (before, e)]
    white = whiteness(e, [s.valid for s in data.series], np.ones(layout.p), S)
    half = 0.5 * float(counts.mean()) * float(np.linalg.slogdet(S * np.outer(data.size_y, data.size_y))[1])
    model = replace(
        model,
        diagnostics={
            "covariance": layout.with_direct(covariance[:end, :end]),
            "innovation_covariance": S * np.outer(data.size_y, data.size_y),
            "prediction_error_percent": 100.0 * rms[1],
            "prediction_error_percent_start": 100.0 * rms[0],
            "cost": 0.5 * found.minimum.cost + half,
            "rounds": found.rounds,
            "iterations": found.minimum.iterations,
            "converged": found.settled and found.minimum.converged,
            "disturbances": "none: the records are free of noise" if quiet else str(layout.disturbances).lower(),
            "parameters": c,
            "undecided": int(np.sum(~kept)),
            "whiteness_p": white,
            "offsets": [z[layout.n :] * data.size_y for z in found.nuisances] if layout.offsets else [],
            "poles_without_continuous_counterpart": continuous_poles(
                np.linalg.eigvals(model.A).astype(np.complex128), model.dt_s
            )[1],
        },
    )
    accuracy = pole_accuracy(model)
    found_more = {"pole_accuracy": accuracy, "pole_std": np.array([np.hypot(a.real_std, a.imag_std) for a in accuracy])}
    advice = _advice(model, white, layout)
    return replace(model, diagnostics={**model.diagnostics, **found_more}, advice=advice)


def _radius(A: FloatArray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(A))))


def _advice(model: StateSpaceModel, white: FloatArray, layout: Layout) -> tuple[Advice, ...]:
    out, found = AdviceList(), model.diagnostics
    if not found["converged"] and layout.disturbances and _radius(model.A - model.K @ model.C) > _MARGINAL:
        out.doubt(
            "predictor_at_limit",
            "the search ended where the predictor A - K C becomes unstable: these data contain no disturbances beyond "
            "the noise; set disturbances = false",
        )
    elif not found["converged"]:
        out.wrong(
            "not_converged",
            "the search did not converge: do not use the model; lower the order, start from another estimate or "
            "allow more iterations",
        )
    if found["undecided"]:
        out.doubt(
            "not_told_apart",
            f"these data do not determine {found['undecided']} of {found['parameters']} directions, and the standard "
            "errors leave them out: the order is too high, or an input moves too little",
        )
    coloured = [o for o, w in zip(model.outputs, white, strict=True) if w < WHITE]
    if coloured and layout.disturbances:
        out.doubt(
            "coloured_residuals",
            f"innovations of {', '.join(coloured)} are not white: raise the order, or the system is nonlinear",
        )
    elif coloured:
        out.doubt(
            "coloured_residuals",
            f"residuals of {', '.join(coloured)} are not white: "
            + (
                "standard errors are corrected for it; estimate the disturbances to correct the weights as well"
                if found["converged"]
                else "the standard errors are not reliable, because the search did not converge"
            ),
        )
    return (*out, *approximate("prediction_error"))


def predict(model: StateSpaceModel, record: FlightRecord) -> tuple[FloatArray, FloatArray]:
    """Return the one-step predictions (N, p) over a record, initial state fitted to it, and the innovations (N, p).

    Innovations of samples that were not taken are zero.

    Raises:
        ChannelError: the record lacks an input or output of the model.
        RecordError: its sample time differs from the model's by more than 1 %.
    """
    check_sample_time(record, model.dt_s)
    part = record.select(model.outputs)
    s = Matrices(model.A, model.B, model.C, model.D, model.K)
    layout = Layout(model.order, len(model.inputs), len(model.outputs), True, True, False)
    size = np.sqrt(np.maximum(np.mean(part.data**2, axis=0), 1e-300))
    series = Series(record.columns(model.inputs), part.data / size, np.asarray(part.valid))
    scaled = Matrices(s.A, s.B, s.C / size[:, None], s.D / size[:, None], s.K * size)
    fitted, _ = _fit_nuisances([series], scaled, layout)
    run = errors(scaled, series, fitted[0], layout)
    u = record.columns(model.inputs)
    return run.x @ model.C.T + u @ model.D.T, run.e * size
