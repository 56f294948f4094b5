"""What a cause would leave in the residuals of a model: regressors of delays, lags, bends, drifts, missing states.

How the simulated outputs of an identified model move with its parameters, whatever the method it came from.

Linear regression of residuals whose noise is coloured: generalised least squares with autoregressive noise.

    v = X b + n,    n[k] = sum_j A[j] n[k - j] + e[k]

Regressions are solved by their normal equations with columns of unit size, the columns that depend on others left out:
many hypotheses then share one matrix of products (:class:`Normal`).

Regression and autoregression in turns (D. Cochrane and G. H. Orcutt, Journal of the American Statistical Association
44, 1949), from the residuals as they are and from those that plain least squares leaves: what drifts looks like noise
of a long memory from the first, and a strong disturbance like signal from the second. The better likelihood is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpstrf
from scipy.signal import lfilter

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import Layout, Matrices, orbit
from testbench.estimators.residuals import LARGEST_ORDER, Autoregression, autoregression
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.transfer_function import TransferFunctionModel

# --- linear regression of residuals whose noise is coloured -----------------------------------------------------------


_ROUNDS = 3
_SETTLED = 0.01  # of the criterion, between two rounds
_DEPENDENT = 1e-11  # squared sine of the angle to the columns before below which a column adds nothing


class Stretch(NamedTuple):
    """Residuals v (p, N) of one record with zeros where ``good`` (N,) is False."""

    v: FloatArray
    good: NDArray[np.bool_]


class Regression(NamedTuple):
    """Coefficients b (d,), their standard deviations, what they leave of v per record (p, N), noise and criterion.

    ``criterion`` is -2 ln L with the penalty of Hannan and Quinn on the order of the noise; differences between nested
    regressions are distributed as chi-squared with as many degrees of freedom as columns were added.
    """

    b: FloatArray
    std: FloatArray
    left: list[FloatArray]
    noise: Autoregression
    criterion: float


def samples_lost(parts: Sequence[Stretch]) -> int:
    """Return how many samples at the start of every record only serve the autoregression."""
    p, total = parts[0].v.shape[0], sum(s.v.shape[1] for s in parts)
    return max(0, min(LARGEST_ORDER, min(s.v.shape[1] for s in parts) // 4, total // (10 * p)))


def regress(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> Regression:
    """Return the regression of residuals on columns X (p, N, d), one array per record.

    Columns may depend on each other; those that add nothing to the others then have no coefficient.
    """
    first = regress_from(parts, columns, [s.v for s in parts])
    if columns[0].shape[2] == 0:
        return first
    _, left = regress_plainly(parts, columns)
    other = regress_from(parts, columns, left)
    return min(first, other, key=lambda found: found.criterion)


def regress_plainly(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> tuple[FloatArray, list[FloatArray]]:
    """Return the coefficients (d,) of ordinary least squares, outputs of unit size, and what they leave (p, N)."""
    size = np.sqrt(np.sum([np.sum(s.v**2, axis=1) for s in parts], axis=0))
    size = np.where(size > 0.0, size, 1.0)[:, None]
    Z = np.vstack(
        [((X * s.good[:, None]) / size[:, :, None]).reshape(-1, X.shape[2]) for s, X in _both(parts, columns)]
    )
    b, _ = solved(normal(Z, np.concatenate([(s.v / size).ravel() for s in parts])))
    return b, [s.v - s.good * (X @ b) for s, X in _both(parts, columns)]


def regress_from(parts: Sequence[Stretch], columns: Sequence[FloatArray], left: Sequence[FloatArray]) -> Regression:
    """Return the same with the noise that is in ``left`` (p, N) per record as a start.

    Raises:
        EstimationError: no more samples are left than there are columns, as where outputs have other rates.
    """
    p, lost, width = parts[0].v.shape[0], samples_lost(parts), columns[0].shape[2]
    if sum(settled(s.good, lost).size for s in parts) <= width:
        raise EstimationError(
            "residuals of coloured noise need samples of all outputs one after the other, got too few"
        )
    criterion = np.inf
    for _ in range(_ROUNDS):
        noise = autoregression([r.T for r in left], lost)
        whitener = Whitener(noise, parts)
        e = whitener([s.v[:, :, None] for s in parts])[:, 0]
        Z = whitener(columns)
        b, std = solved(normal(Z, e))
        left = [s.v - s.good * (X @ b) for s, X in _both(parts, columns)]
        E = (e - Z @ b).reshape(-1, p) @ whitener.root.T
        n, last = len(E), criterion
        penalty = 2.0 * np.log(np.log(max(n, 3))) * len(noise.A) * p * p
        criterion = float(n * np.linalg.slogdet(E.T @ E / n)[1] + penalty)
        if width == 0 or not abs(last - criterion) > _SETTLED:
            break
    return Regression(b, std, list(left), noise, criterion)


class Whitener:
    """The inverse of an autoregression, for signals of given records, at the samples that have a past.

    Attributes:
        root: (p, p) Cholesky factor of the covariance of the noise's innovations.
    """

    def __init__(self, noise: Autoregression, parts: Sequence[Stretch]) -> None:
        """Prepare one banded matrix per record."""
        p, lost = parts[0].v.shape[0], samples_lost(parts)
        self.root = np.linalg.cholesky(noise.S + 1e-12 * np.trace(noise.S) * np.eye(p))
        inverse = np.linalg.inv(self.root)
        taps = np.hstack([inverse, *[-inverse @ A for A in noise.A]])  # (p, (order + 1) p), the present sample first
        back = (-p * np.arange(len(noise.A) + 1)[:, None] + np.arange(p)).ravel()
        self.matrices = []
        for part in parts:
            rows = settled(part.good, lost)
            at = np.repeat(rows[:, None] * p + back, p, axis=0)
            values, ends = np.tile(taps, (len(rows), 1)), np.arange(len(at) + 1) * at.shape[1]
            shape = (len(at), part.v.shape[1] * p)
            self.matrices.append(sparse.csr_matrix((values.ravel(), at.ravel(), ends), shape))

    def __call__(self, signals: Sequence[FloatArray]) -> FloatArray:
        """Return signals (p, N, d), one array per record, as white (rows, d), the outputs of a sample together."""
        return np.vstack(
            [
                M @ x.transpose(1, 0, 2).reshape(M.shape[1], x.shape[2])
                for M, x in zip(self.matrices, signals, strict=True)
            ]
        )


class Normal(NamedTuple):
    """Products of white columns Z (rows, d) among themselves G (d, d), with the residuals g (d,), and their square."""

    G: FloatArray
    g: FloatArray
    total: float

    def of(self, chosen: Sequence[int] | NDArray[np.intp]) -> Normal:
        """Return the normal equations of the chosen columns alone."""
        at = np.asarray(chosen, np.intp)
        return Normal(self.G[np.ix_(at, at)], self.g[at], self.total)

    def explained(self) -> float:
        """Return by how much all columns together reduce the sum of squares."""
        return float(np.sum(self._eliminated()[0] ** 2))

    def _eliminated(self) -> tuple[FloatArray, FloatArray, NDArray[np.intp], FloatArray]:
        """Return R^-T g, R (r, r) of the r columns that do not depend on others, which they are, and their sizes."""
        size = np.sqrt(np.diag(self.G))
        alive = np.flatnonzero(size > 0.0)
        s = size[alive]
        if not alive.size:
            return np.zeros(0), np.zeros((0, 0)), alive, s
        R, order, rank, _ = dpstrf(self.G[np.ix_(alive, alive)] / np.outer(s, s), tol=_DEPENDENT, lower=0)
        kept = order[:rank] - 1
        R = np.triu(R[:rank, :rank])
        return solve_triangular(R, (self.g[alive] / s)[kept], trans="T"), R, alive[kept], s[kept]


def normal(Z: FloatArray, e: FloatArray) -> Normal:
    """Return the normal equations of residuals e (rows,) on columns Z (rows, d)."""
    return Normal(np.asarray(Z.T @ Z), np.asarray(Z.T @ e), float(e @ e))


def solved(equations: Normal) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients (d,) and their standard deviations for errors of unit size; zero of columns left out."""
    z, R, kept, size = equations._eliminated()
    b, std = np.zeros(len(equations.g)), np.zeros(len(equations.g))
    if kept.size:
        inverse = solve_triangular(R, np.eye(len(R)))
        b[kept], std[kept] = inverse @ z / size, np.sqrt(np.sum(inverse**2, axis=1)) / size
    return b, std


def settled(good: NDArray[np.bool_], lost: int) -> NDArray[np.intp]:
    """Return the samples (k,) with ``lost`` good ones before them."""
    run = np.cumsum(good)
    before = np.concatenate([np.zeros(lost + 1), run])[: len(run)]
    return np.flatnonzero((run - before == lost + 1) & (np.arange(len(run)) >= lost))


def _both(parts: Sequence[Stretch], columns: Sequence[FloatArray]) -> list[tuple[Stretch, FloatArray]]:
    return list(zip(parts, columns, strict=True))


# --- what a cause would leave in the residuals of a model -------------------------------------------------------------


_ARRAYS = ("params", "A", "B", "C", "D", "numerators", "denominators", "delays_s")  # what neighbours differ in
_STEP = 1e-5  # of a parameter's own size; simulations are exact to some 1e-12


class Direction(NamedTuple):
    """One way in which a model may move.

    Attributes:
        name: of the parameter; empty for a direction without a name.
        value: of the parameter.
        error: its standard error; NaN without one.
        step: length of the step that ``model`` stands away.
        model: the neighbour.
    """

    name: str
    value: float
    error: float
    step: float
    model: IdentifiedModel


def directions(model: IdentifiedModel) -> list[Direction]:
    """Return one neighbour for each free parameter; for a state-space model for each direction that shows outside.

    A model of another class, such as a user's own, has none.
    """
    for kind, neighbours in _KINDS:
        if isinstance(model, kind):
            return list(neighbours(model))
    return []


def slopes(model: IdentifiedModel, found: Sequence[Direction], record: FlightRecord, at: FloatArray) -> FloatArray:
    """Return the derivatives (N, p, k) of ``at`` (N, p), what ``model`` simulates, initial states fitted anew.

    Raises:
        EstimationError, ChannelError: what ``simulate`` of the model raises.
    """
    columns = [(_neighbour(model, d.model, record, at) - at) / d.step for d in found]
    return np.stack(columns, axis=2) if columns else np.zeros((*at.shape, 0))


def _neighbour(model: IdentifiedModel, other: IdentifiedModel, record: FlightRecord, at: FloatArray) -> FloatArray:
    """Return what a neighbour simulates; outputs whose own transfer function did not move stay as they are."""
    if not (isinstance(model, TransferFunctionModel) and isinstance(other, TransferFunctionModel)):
        return other.simulate(record)
    apart = np.any(other.numerators != model.numerators, axis=1)
    apart |= np.any(other.denominators != model.denominators, axis=1)
    rows = np.flatnonzero(apart)
    if rows.size == 0:
        return at
    part = replace(
        other,
        outputs=tuple(other.outputs[i] for i in rows),
        numerators=other.numerators[rows],
        denominators=other.denominators[rows],
        delays=tuple(other.delays[i] for i in rows),
    )
    out = at.copy()
    out[:, rows] = part.simulate(record)
    return out


def moved(model: IdentifiedModel, found: Sequence[Direction], change: FloatArray) -> IdentifiedModel:
    """Return the model after a change (k,) of its parameters along the directions found."""
    arrays = {}
    for name in _ARRAYS:
        here = getattr(model, name, None)
        if isinstance(here, np.ndarray):
            arrays[name] = here + sum(
                (c / d.step) * (getattr(d.model, name) - here) for d, c in zip(found, change, strict=True)
            )
            if name == "delays_s":  # no model answers before its input
                arrays[name] = np.maximum(arrays[name], 0.0)
    return replace(model, **arrays)


def moved_poles(
    first: IdentifiedModel, model: IdentifiedModel, found: Sequence[Direction], b: FloatArray
) -> tuple[float, float]:
    """Return by how much, relative to its size, the pole moves most from ``first`` to ``model`` and on by a change.

    The change b (k,) along the directions found at ``model`` counts to first order. Poles that it takes from complex to
    real ones, or back, are paired by the nearest. Infinite where a pole without continuous counterpart gets one.

    Returns:
        The shift over the size of the pole, and that size in rad/s (NaN where the shift is not finite).
    """
    start, here = all_poles(first), all_poles(model)
    if start.size != here.size:
        return np.inf, np.nan
    here = _nearest(start, here)
    total = here - start
    for d, c in zip(found, b, strict=True):
        other = all_poles(d.model)
        if other.size != start.size:
            return np.nan, np.nan
        total += (_nearest(here, other) - here) * (c / d.step)
    if not start.size:
        return 0.0, np.nan
    size = np.maximum(np.abs(start), 1e-9)
    i = int(np.argmax(np.abs(total) / size))
    return float(np.abs(total[i]) / size[i]), float(size[i])


def _nearest(poles: ComplexArray, other: ComplexArray) -> ComplexArray:
    return np.asarray(other[np.argmin(np.abs(poles[:, None] - other), axis=1)])


def feeds_through(model: IdentifiedModel) -> NDArray[np.bool_]:
    """Return (p,) which outputs answer an input in the same sample."""
    if isinstance(model, ParametricModel):
        direct = model.linear().D
    elif isinstance(model, StateSpaceModel):
        direct = model.D
    elif isinstance(model, ContinuousTransferModel):
        direct = model.numerators[:, :, 0] * (np.abs(model.denominators[:, :1]) > 0.0)
    else:
        direct = np.zeros((len(model.outputs), 1))
    return np.asarray(np.any(direct != 0.0, axis=1))


def all_poles(model: IdentifiedModel) -> ComplexArray:
    """Return the poles of all outputs in one array."""
    return np.concatenate([np.zeros(0, np.complex128), *model.poles().values()])


def _of_structure(model: ParametricModel) -> Iterator[Direction]:
    error = np.sqrt(np.diag(model.covariance))
    for i in np.flatnonzero(model.structure.free & (error > 0.0)):
        step = _STEP * max(abs(float(model.params[i])), float(error[i]))
        params = model.params.copy()
        params[i] += step
        yield Direction(
            model.structure.parameter_names[i],
            float(model.params[i]),
            float(error[i]),
            step,
            replace(model, params=params),
        )


def _of_states(model: StateSpaceModel) -> Iterator[Direction]:
    n, m, p = model.order, len(model.inputs), len(model.outputs)
    layout = Layout(n, m, p, bool(np.any(model.D)), False, False)
    size_u = np.linalg.norm(model.B, axis=0)
    size_y = np.linalg.norm(model.C, axis=1)
    u, y = 1.0 / np.where(size_u > 0.0, size_u, 1.0), np.where(size_y > 0.0, size_y, 1.0)
    scaled = Matrices(model.A, model.B * u, model.C / y[:, None], model.D * u / y[:, None], np.zeros((n, p)))
    for direction in orbit(scaled, layout).T:
        s = layout.moved(scaled, _STEP * direction)
        yield Direction(
            "", 0.0, np.nan, _STEP, replace(model, A=s.A, B=s.B / u, C=y[:, None] * s.C, D=y[:, None] * s.D / u)
        )


def _of_polynomials(model: ContinuousTransferModel) -> Iterator[Direction]:
    n = model.denominators.shape[1] - 1
    errors, common = model.standard_errors, model.common
    for i, output in enumerate(model.outputs):
        rows = slice(None) if common else i
        for k in range(1, n + 1) if not (common and i) else ():
            name = f"a{k}" if common else f"{output}: a{k}"
            step, moved = _entry(model.denominators, (rows, k))
            value = float(model.denominators[i, k])
            yield Direction(name, value, errors.get(name, np.nan), step, replace(model, denominators=moved))
        for j, given in enumerate(model.inputs):
            for k in np.flatnonzero(model.numerators[i, j]).tolist():
                name = f"{output}/{given}: b{n - k}"
                step, moved = _entry(model.numerators, (i, j, k))
                value = float(model.numerators[i, j, k])
                yield Direction(name, value, errors.get(name, np.nan), step, replace(model, numerators=moved))
            name = f"{output}/{given}: delay_s"
            if errors.get(name, 0.0) > 0.0:
                moved = model.delays_s.copy()
                moved[i, j] += _STEP * model.dt_s
                yield Direction(
                    name, float(model.delays_s[i, j]), errors[name], _STEP * model.dt_s, replace(model, delays_s=moved)
                )


def _of_differences(model: TransferFunctionModel) -> Iterator[Direction]:
    for i, k in np.argwhere(model.numerators):
        step, moved = _entry(model.numerators, (i, k))
        yield Direction("", float(model.numerators[i, k]), np.nan, step, replace(model, numerators=moved))
    for i, k in np.argwhere(model.denominators[:, 1:]):
        step, moved = _entry(model.denominators, (i, k + 1))
        yield Direction("", float(model.denominators[i, k + 1]), np.nan, step, replace(model, denominators=moved))


def _entry(array: FloatArray, at: tuple[object, ...]) -> tuple[float, FloatArray]:
    """Return a step for the entry of an array, and the array after it."""
    moved = array.copy()
    size = float(np.max(np.abs(array[at])))  # type: ignore[index]
    step = _STEP * (size if size > 0.0 else 1.0)
    moved[at] += step  # type: ignore[index]
    return step, moved


_KINDS: tuple[tuple[type[IdentifiedModel], Callable[..., Iterator[Direction]]], ...] = (
    (ParametricModel, _of_structure),
    (StateSpaceModel, _of_states),
    (ContinuousTransferModel, _of_polynomials),
    (TransferFunctionModel, _of_differences),
)


_LATER = (1, 2, 3, 4, 6, 8)  # samples: delays that are tried
_LAGS = (1.0, 2.0, 4.0, 8.0)  # samples: time constants that are tried
_KNOTS = (0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 85, 113, 150)  # samples: hats of the linear response
_MODES = 4  # the slowest, through which a bend is looked for: aerodynamics that bend move the rigid body


class Data(NamedTuple):
    """Records with simulated outputs (N, p), residuals and slopes (p, N, k)."""

    records: list[FlightRecord]
    simulated: list[FloatArray]
    parts: list[Stretch]
    slopes: list[FloatArray]


class Candidate(NamedTuple):
    """Regressors (p, N, d) per record that a cause would leave, and what it is called."""

    code: str
    subject: str
    amount: float
    columns: list[FloatArray]


def busiest(record: FlightRecord, inputs: Sequence[str], longest: int) -> FlightRecord:
    """Return the stretch of at most ``longest`` samples in which the inputs move most."""
    if len(record) <= longest:
        return record
    step = np.abs(np.diff(record.columns(inputs), axis=0))
    activity = np.cumsum(np.concatenate([[0.0], np.sum(step / np.maximum(step.max(axis=0), 1e-300), axis=1)]))
    first = int(np.argmax(activity[longest - 1 :] - activity[: len(activity) - longest + 1]))
    return record.between(float(record.t_s[first]), float(record.t_s[first + longest - 1]))


def gather(model: IdentifiedModel, records: list[FlightRecord], found: Sequence[Direction]) -> Data:
    """Return the records with what the model simulates, what it leaves and how it moves with its parameters."""
    simulated, parts, moves = [], [], []
    for record in records:
        y, channels = model.simulate(record), record.select(model.outputs)
        good = np.all(channels.valid, axis=1)
        parts.append(Stretch(((channels.data - y) * good[:, None]).T, good))
        simulated.append(y)
        moves.append(turned(slopes(model, found, record, y)))
    return Data(records, simulated, parts, moves)


def _later(u: FloatArray, samples: float) -> FloatArray:
    at = np.arange(len(u)) - samples
    return np.asarray(np.interp(at, np.arange(len(u)), u))


def _lagged(u: FloatArray, samples: float) -> FloatArray:
    a = np.exp(-1.0 / samples)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], u, zi=[a * u[0]])[0])


MOVES = {"delay": _later, "lag": _lagged}


def moved_inputs(model: IdentifiedModel, data: Data) -> list[Candidate]:
    """Return delays and lags of each input in turn."""
    out = []
    for name in model.inputs:
        for code, samples in [("delay", float(d)) for d in _LATER] + [("lag", T) for T in _LAGS]:
            move = MOVES[code]
            columns = [
                turned((model.simulate(r.with_columns({name: move(r[name], samples)})) - y)[:, :, None])
                for r, y in zip(data.records, data.simulated, strict=True)
            ]
            out.append(Candidate(code, name, samples * model.dt_s, columns))
    return out


def bends(model: IdentifiedModel, data: Data) -> list[Candidate]:
    """Return quadratic and cubic terms of each simulated output, through each mode, on every output."""
    out, p = [], len(model.outputs)
    poles = np.unique(np.round(all_poles(model), 9))
    poles = poles[poles.imag >= 0.0]
    z = np.exp(poles[np.argsort(np.abs(poles))][:_MODES] * model.dt_s)
    z = np.where(np.abs(z) < 1.0, z, 0.999 * z / np.maximum(np.abs(z), 1.0) ** 2)
    for i, name in enumerate(model.outputs):
        size = np.sqrt(np.mean(np.concatenate([y[:, i] for y in data.simulated]) ** 2))
        if size <= 0.0:
            continue
        columns = []
        for y in data.simulated:
            a = y[:, i] / size
            modes = [lfilter([0.0, 1.0], [1.0, -pole], g) for g in (a * np.abs(a), a**3) for pole in z]
            columns.append(each(np.stack([part for w in modes for part in _parts(w)], axis=1), p))
        out.append(Candidate("bend", name, 0.0, columns))
    return out


def _parts(w: FloatArray) -> list[FloatArray]:
    return [w.real, w.imag] if np.any(w.imag) else [w.real]


def drifts(model: IdentifiedModel, data: Data) -> list[Candidate]:
    """Return a constant and a line per output and record, less what the model estimates along."""
    p, terms = len(model.outputs), []
    have = _estimated_along(model)
    if have >= 2:
        return []
    for r in data.records:
        line = np.linspace(-1.0, 1.0, len(r))
        terms.append(each(np.stack([np.ones(len(r)), line], axis=1), p))
    return [Candidate("drift", "", 0.0, own(terms))]


def nuisances(model: IdentifiedModel, data: Data) -> list[FloatArray]:
    """Return the constants, and lines, that the method estimated along and ``simulate`` of its model leaves out."""
    p, have = len(model.outputs), 0 if isinstance(model, ParametricModel) else _estimated_along(model)
    lines = [np.stack([np.ones(len(r)), np.linspace(-1.0, 1.0, len(r))], axis=1)[:, :have] for r in data.records]
    return own([each(line, p) for line in lines])


def _estimated_along(model: IdentifiedModel) -> int:
    """Return 1 for models with a constant of their own per record, 2 for those with a line."""
    if isinstance(model, ParametricModel):
        return 2 if model.trended else 0
    offset = model.settings.get("offset", model.settings.get("offsets", False))
    return {"trend": 2, "offset": 1}.get(offset, 0) if isinstance(offset, str) else int(bool(offset))


def any_linear(model: IdentifiedModel, data: Data, first: int = 0) -> list[FloatArray]:
    """Return the inputs at the knots from ``first`` of any linear response, as many as a tenth of the data bears."""
    p, m = len(model.outputs), len(model.inputs)
    bears = sum(len(r) for r in data.records) // (20 * m)
    knots = [k for k in _KNOTS if k < min(len(r) for r in data.records) // 4][: max(bears, 2)]
    out = []
    for r in data.records:
        hats = [_hat(_deviation(r[name]), knots, i) for name in model.inputs for i in range(first, len(knots))]
        out.append(each(np.stack(hats, axis=1), p))
    return out


def slow_response(model: IdentifiedModel, data: Data) -> list[FloatArray]:
    """Return the inputs through lags from the longest hat to beyond the record, which a slow mode would leave."""
    longest, p = max(len(r) for r in data.records), len(model.outputs)
    lags = [_KNOTS[-1] * 2.0**k for k in range(max(int(np.ceil(np.log2(longest / _KNOTS[-1]))), 0) + 2)]
    return [
        each(np.stack([_lagged(_deviation(r[name]), T) for name in model.inputs for T in lags], axis=1), p)
        for r in data.records
    ]


def _deviation(u: FloatArray) -> FloatArray:
    return np.asarray(u - u[0])


def _hat(u: FloatArray, knots: Sequence[int], i: int) -> FloatArray:
    """Return u weighted by a hat over its past around knot i: linear interpolation of an impulse response."""
    left = knots[i - 1] if i else knots[i]
    right = knots[i + 1] if i + 1 < len(knots) else knots[i]
    lags = np.arange(left, right + 1)
    weights = np.interp(lags, [left, knots[i], right], [float(i == 0), 1.0, float(right == knots[i])])
    return np.asarray(lfilter(np.concatenate([np.zeros(left), weights]), [1.0], u))


def turned(x: FloatArray) -> FloatArray:
    """Return (N, p, d) as (p, N, d)."""
    return np.ascontiguousarray(x.transpose(1, 0, 2))


def each(columns: FloatArray, p: int) -> FloatArray:
    """Return columns (N, d) on each of p outputs by itself, (p, N, d p)."""
    N, d = columns.shape
    return np.asarray(np.einsum("nd,pq->pndq", columns, np.eye(p)).reshape(p, N, d * p))


def own(columns: list[FloatArray]) -> list[FloatArray]:
    """Return columns (p, N, d) per record as columns that belong to one record each, (p, N, d records)."""
    out = []
    for i, X in enumerate(columns):
        widths = [np.zeros((*X.shape[:2], Y.shape[2])) for Y in columns]
        widths[i] = X
        out.append(np.concatenate(widths, axis=2))
    return out


def joined(*blocks: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the regressors of several blocks, per record, side by side."""
    return [np.concatenate(parts, axis=2) for parts in zip(*blocks, strict=True)]
