"""How the simulated outputs of an identified model move with its parameters, whatever the method it came from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.discrete_transfer import TransferFunctionModel
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.prediction_error import Layout, Matrices, orbit
from testbench.estimators.state_space import StateSpaceModel

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
