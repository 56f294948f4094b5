"""What may be added to a model over its records: columns (p, N, d) of outputs, one array per record, for each cause."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import Sampling, delayed, scheduled
from testbench.estimators.parametric.structure import LinearStructure
from testbench.estimators.state_space import StateSpaceModel
from testbench.inference.free_run import Flown, Late, all_poles

_KNOTS = (0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 85, 113, 150)  # samples: hats of the linear response
_MODES = 4  # the slowest, through which a bend is looked for: aerodynamics that bend move the rigid body
_AXES = tuple(f"{axis}_" for axis in "XYZLMN")  # of forces and moments


def bends(at: Flown) -> Iterator[tuple[str, list[FloatArray]]]:
    """Yield quadratic and cubic terms of each simulated output, through each slow mode, on every output.

    Where forces and moments are known, so is what the airspeed does to them, see :func:`with_speed`.
    """
    p = len(at.model.outputs)
    poles = np.unique(np.round(all_poles(at.model), 9))
    poles = poles[poles.imag >= 0.0]
    z = np.exp(poles[np.argsort(np.abs(poles))][:_MODES] * at.model.dt_s)
    z = np.where(np.abs(z) < 1.0, z, 0.999 * z / np.maximum(np.abs(z), 1.0) ** 2)
    for i, name in enumerate(at.model.outputs):
        if name == "V" and (large := with_speed(at)) is not None:
            yield name, large
            continue
        size = np.sqrt(np.mean(np.concatenate([y[:, i] for y in at.simulated]) ** 2))
        columns = []
        for y in at.simulated if size > 0.0 else ():
            a = y[:, i] / size
            crooked = [g - a * (a @ g) / (a @ a) for g in (a * np.abs(a), a**3)]  # of no linear part
            modes = [lfilter([0.0, 1.0], [1.0, -pole], g) for g in crooked for pole in z]
            columns.append(
                _each([part for w in modes for part in ([w.real, w.imag] if np.any(w.imag) else [w.real])], p)
            )
        if columns:
            yield name, columns


def with_speed(at: Flown) -> list[FloatArray] | None:
    """Return how outputs move by what large motion does to small-motion equations; None where those are not known.

    Dynamic pressure scales what acts along an axis, and its derivatives with it: a column for each of X, Z, M and so
    on, p -> p + c p V(t) to first order, see :func:`scheduled`. Drag goes with the square of lift, and weight across
    the flight path with the cosine of its angle: X_0 + c alpha(t)^2, Z_0 + c (theta - alpha)(t)^2.
    """
    model = at.model
    structure = getattr(model, "structure", None)
    if "V" not in model.outputs or not isinstance(model, ParametricModel) or not isinstance(structure, LinearStructure):
        return None
    names, shown = structure.parameter_names, model.outputs
    constants = set(structure.trim_constants)
    moving = [k for k, n in enumerate(names) if n[:2] in _AXES and n not in constants and model.params[k] != 0.0]
    axes = list(dict.fromkeys(names[k].split("_")[0] for k in moving))
    if not axes:
        return None
    together = np.array([[model.params[k] * (names[k].split("_")[0] == axis) for axis in axes] for k in moving])
    bent = {"X_0": ("alpha",), "Z_0": ("theta", "alpha")}
    squares = [n for n, angles in bent.items() if n in names and set(angles) <= set(shown)]
    out, at_rest = [], np.zeros(len(structure.states))
    for record, y in zip(at.records, at.simulated, strict=True):
        acting = record if at.late is None else at.late.acting(record)
        u = delayed(acting.columns(model.inputs), record.dt_s, np.array(model.delays_s))
        flown = u, Sampling(record.dt_s, np.array(model.held), model.substeps), at_rest
        each = dict(zip(shown, y.T, strict=True))
        columns = [scheduled(structure, model.params, moving, *flown, each["V"][:, None])[..., 0] @ together]
        for n in squares:
            angle = each["alpha"] if n == "X_0" else each["theta"] - each["alpha"]
            columns.append(scheduled(structure, model.params, [names.index(n)], *flown, angle[:, None] ** 2)[..., 0])
        out.append(np.concatenate(columns, axis=2).transpose(1, 0, 2))
    return out if all(np.all(np.isfinite(X)) for X in out) else None


def lines(at: Flown, terms: int = 2) -> list[FloatArray]:
    """Return a constant and a line, the first ``terms`` of them, per output and record."""
    p, records = len(at.model.outputs), range(len(at.records))
    own = [_each([np.ones(len(r)), np.linspace(-1.0, 1.0, len(r))], p)[:, :, : terms * p] for r in at.records]
    return [np.concatenate([X if i == k else 0.0 * X for k in records], axis=2) for i, X in enumerate(own)]


def estimated_along(model: IdentifiedModel) -> int:
    """Return 1 for models with a constant of their own per record, 2 for those with a line."""
    if isinstance(model, ParametricModel):
        return 2 if model.trended else 0
    offset = model.settings.get("offset", model.settings.get("offsets", False))
    return {"trend": 2, "offset": 1}.get(offset, 0) if isinstance(offset, str) else int(bool(offset))


def estimated(at: Flown) -> list[FloatArray]:
    """Return the constants, and lines, that the method estimated along and ``simulate`` of its model leaves out."""
    return lines(at, 0 if isinstance(at.model, ParametricModel) else estimated_along(at.model))


def nuisances(at: Flown) -> list[FloatArray]:
    """Return what stands beside every hypothesis: what the method estimated along, and initial states.

    ``simulate`` fits the initial state of every record by the model alone: beside a cause it is another.
    """
    return joined(estimated(at), _begun(at))


def whatever_else(at: Flown) -> list[FloatArray]:
    """Return what the best model of a kind is sought beside: nuisances, drifts, and what goes with the airspeed.

    They would move it to where its slopes say nothing of the aircraft, and every other cause is told by its slopes.
    """
    drifts = [] if estimated_along(at.model) == 2 else [lines(at)]
    large = with_speed(at)
    return joined(nuisances(at), *drifts, *([] if large is None else [large]))


def _begun(at: Flown) -> list[FloatArray]:
    """Return the free responses of every record: each mode with its shape; of unstable ones the end has size one."""
    shapes = _modes(at.model)
    out, records = [], range(len(at.records))
    for i, record in enumerate(at.records):
        k = np.arange(len(record))
        free = []
        for s, shape in shapes:
            w = np.exp(s * at.model.dt_s * (k if s.real <= 0.0 else k - k[-1]))
            each = shape[:, None] * w
            free += [each.real, each.imag] if s.imag > 0.0 else [each.real]
        X = np.stack(free, axis=2) if free else np.zeros((len(at.model.outputs), len(record), 0))
        out.append(np.concatenate([X if i == j else 0.0 * X for j in records], axis=2))
    return out


def _modes(model: IdentifiedModel) -> list[tuple[complex, ComplexArray]]:
    """Return the modes of a model, of pairs the upper one: pole in rad/s, and how it shows in the outputs (p,)."""
    if isinstance(model, ParametricModel):
        s = model.linear()
        poles, vectors = np.linalg.eig(s.A)
        shapes = s.C @ vectors
    elif isinstance(model, StateSpaceModel):
        z, vectors = np.linalg.eig(model.A)
        poles, shapes = np.log(np.where(z == 0.0, 1e-9, z).astype(complex)) / model.dt_s, model.C @ vectors
    else:
        each = [np.ravel(p) for p in model.poles().values()]
        if len(each) < len(model.outputs):  # all outputs share them
            each = [np.concatenate(each)] * len(model.outputs)
        poles = np.concatenate(each)
        shapes = np.repeat(np.eye(len(each)), [p.size for p in each], axis=1)
    return [(complex(s), v.astype(complex)) for s, v in zip(poles, shapes.T, strict=True) if s.imag >= 0.0]


def any_linear(at: Flown, first: int = 0) -> list[FloatArray]:
    """Return the inputs at the knots from ``first`` of any linear response, as many as a tenth of the data bears."""
    p, m = len(at.model.outputs), len(at.model.inputs)
    bears = sum(len(r) for r in at.records) // (20 * m)
    knots = [k for k in _KNOTS if k < min(len(r) for r in at.records) // 4][: max(bears, 2)]
    return [
        _each([hat(r[n] - r[n][0], knots, i) for n in at.model.inputs for i in range(first, len(knots))], p)
        for r in at.records
    ]


def hat(u: FloatArray, knots: Sequence[int], i: int) -> FloatArray:
    """Return u weighted by a hat over its past around knot i: linear interpolation of an impulse response."""
    left = knots[i - 1] if i else knots[i]
    right = knots[i + 1] if i + 1 < len(knots) else knots[i]
    lags = np.arange(left, right + 1)
    weights = np.interp(lags, [left, knots[i], right], [float(i == 0), 1.0, float(right == knots[i])])
    return np.asarray(lfilter(np.concatenate([np.zeros(left), weights]), [1.0], u))


_BEYOND = 1.5  # times the fastest pole of the model, from which a mode is none of its own
_DAMPING = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
_RINGS = 0.3  # damping ratio up to which a mode is one: what is slower to swing is order that is missing
_WIDTH = 2.0  # half-widths of a resonance, or of the line of a record, between two frequencies
_REFINED = 3  # times that the grid about the best mode is halved
_TOGETHER = 32  # modes at a time


class Mode(NamedTuple):
    """A mode beside a model: natural frequency, rad/s, damping ratio, and columns (p, N, d) per record."""

    wn_rad_s: float
    zeta: float
    columns: list[FloatArray]


def likeliest_mode(at: Flown, held: Sequence[bool], left: Callable[[list[FloatArray]], list[float]]) -> Mode | None:
    """Return the mode faster than the model's own, up to half the Nyquist frequency, that leaves least.

    Inputs drive it, and each output has its share of displacement and rate; what the motion of the aircraft does to it
    comes to the same, since inputs drive that as well. None where the model is too fast, or where what is missing looks
    the more like it the nearer to the model's own modes, or the more damped: it has no frequency of its own then.

    Args:
        at: the model over its records.
        held: inputs that are held from sample to sample.
        left: columns of several modes, side by side per record -> sum of squares that each leaves.
    """
    dt, longest = at.model.dt_s, max(len(r) for r in at.records) * at.model.dt_s
    fastest, most = float(np.abs(all_poles(at.model)).max(initial=0.0)), 0.25 * 2.0 * np.pi / (2.0 * dt)
    lowest, grid = max(_BEYOND * fastest, 2.0 * np.pi / longest), []
    for zeta in _DAMPING:
        wn = lowest
        while wn < most:
            grid.append((wn, zeta))
            wn += _WIDTH * max(zeta * wn, np.pi / longest)
    best, least = None, np.inf
    for k in range(_REFINED + 1):
        parts = [grid[i : i + _TOGETHER] for i in range(0, len(grid), _TOGETHER)]
        found = [square for part in parts for square in left(_driven(at, held, part))]
        for mode, square in zip(grid, found, strict=True):
            if square < least:
                best, least = mode, square
        if best is None:
            return None
        wn, zeta = best
        step, ratio = 0.5**k * max(zeta * wn, np.pi / longest), 2.0 ** (0.5 ** (k + 1))
        around = [(wn + i * step, zeta * ratio**j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
        grid = [(w, z) for w, z in around if z < 1.0 and lowest <= w < most]
    assert best is not None
    if best[0] <= lowest or best[1] > _RINGS:
        return None
    return Mode(*best, _driven(at, held, [best]))


def _driven(at: Flown, held: Sequence[bool], modes: Sequence[tuple[float, float]]) -> list[FloatArray]:
    """Return displacement and rate of modes that each input drives, exact for inputs held or linear between samples."""
    dt, out = at.model.dt_s, []
    for record in at.records:
        columns = []
        for wn, zeta in modes:
            s = wn * complex(-zeta, np.sqrt(1.0 - zeta**2))
            z = np.exp(s * dt)
            step, ramp = (z - 1.0) / s, (z - 1.0 - s * dt) / (s * s * dt)
            for name, constant in zip(at.model.inputs, held, strict=True):
                u = record[name] - record[name][0]
                w = lfilter([0.0, step] if constant else [ramp, step - ramp], [1.0, -z], u)
                columns += [w.real, w.imag]
        out.append(_each(columns, len(at.model.outputs)))
    return out


def slow_response(at: Flown) -> list[FloatArray]:
    """Return the inputs through lags from the longest hat to beyond the record, which a slow mode would leave."""
    longest, p = max(len(r) for r in at.records), len(at.model.outputs)
    lags = [_KNOTS[-1] * 2.0**k for k in range(max(int(np.ceil(np.log2(longest / _KNOTS[-1]))), 0) + 2)]
    return [
        _each([Late("lag", n, T, True).acting(r)[n] - r[n][0] for n in at.model.inputs for T in lags], p)
        for r in at.records
    ]


def _each(columns: Sequence[FloatArray], p: int) -> FloatArray:
    """Return columns (N,) on each of p outputs by itself, (p, N, d p)."""
    d, N = len(columns), len(columns[0])
    return np.asarray(np.einsum("dn,pq->pndq", np.array(columns), np.eye(p)).reshape(p, N, d * p))


def joined(*blocks: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the regressors of several blocks, per record, side by side."""
    return [np.concatenate(parts, axis=2) for parts in zip(*blocks, strict=True)]
