"""The state equations of a structure at the smoothed samples of a record: values, errors and their derivatives.

Derivatives are those of Fourier smoothing (see ``regression.smoothing``). The equation of a state passes, derivative,
states and inputs, the low pass that suits this state: a linear equation holds for filtered signals if one filter has
passed them all; states that show nothing but noise from a lower frequency on are cut off there. Inputs that are held
are taken half a sample later, as states that integrate a staircase answer to them (see ``_within``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import advice_in_words
from testbench.estimators.parametric.likelihood import Driven
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import Sampling, delayed, respond
from testbench.estimators.parametric.structure import STEP, ModelStructure
from testbench.estimators.regression.smoothing import SineSeries, bridge


class SmoothedStates(NamedTuple):
    """One record as the state equations see it."""

    x: FloatArray  # (n, N, n) states, by equation
    u: FloatArray  # (n, N, m) inputs, by equation
    xdot: FloatArray  # (N, n) derivatives of the states
    taken: NDArray[np.bool_]  # (N,) samples at which everything was measured
    noise: FloatArray  # (n, n) variance of the noise that is left in x, by equation and state
    cutoffs_hz: FloatArray  # (n,) of the states' low passes
    driven: FloatArray  # (N, m) inputs as they reach the aircraft, delayed and not smoothed
    dt_s: float  # sample time, s


class Regression(NamedTuple):
    """Least squares on the state equations: parameters (k,), of which those with the indices ``free`` (f,) are
    estimated."""

    structure: ModelStructure
    data: Sequence[SmoothedStates]
    params: FloatArray
    free: NDArray[np.intp]

    def at(self, params: FloatArray) -> Regression:
        """Return it with other parameters (k,)."""
        return self._replace(params=params)


def free_of(records: Sequence[FlightRecord], structure: ModelStructure, method: str) -> NDArray[np.intp]:
    """Return which parameters (f,) a regression of the state equations estimates.

    Raises:
        EstimationError: none is free, or a state is not measured; ``method`` is the one that needs it.
        ChannelError: a record lacks an output.
    """
    check_records(records, structure.must_move, structure.outputs)
    free = np.flatnonzero(structure.free)
    if not free.size:
        raise EstimationError(f"structure '{structure.name}' has no free parameter; free some, or simulate it instead")
    for name in structure.states:
        for record in records:
            if name not in record:
                raise EstimationError(
                    f"{method} needs every state of '{structure.name}' as a channel, but a record lacks "
                    f"'{name}'; sense it, or use output error"
                )
    return free


def model_of_equations(
    method: str,
    fit: Regression,
    records: Sequence[FlightRecord],
    driven: Driven,
    covariance: FloatArray,
    white: FloatArray,
    diagnostics: Mapping[str, Any],
) -> ParametricModel:
    """Return the model of estimates from the state equations; those beyond a bound are moved onto it."""
    structure, data, params, free = fit
    low, high = structure.bounds
    beyond = [structure.parameter_names[i] for i in free if not low[i] <= params[i] <= high[i]]
    y = np.vstack([r.columns(structure.outputs) for r in records])
    model = driven.model(
        structure,
        {"delays_s": dict(zip(structure.inputs, driven.delays_s.tolist(), strict=True))},
        method=method,
        dt_s=records[0].dt_s,
        diagnostics={"converged": True, "at_bound": beyond, **diagnostics},
        params=np.clip(params, low, high),
        covariance=covariance,
        covariance_plain=white,
        noise_covariance=np.diag(np.maximum(y.var(axis=0), 1e-300)),
        operating_point=(np.mean([d.x[0, 0] for d in data], axis=0), np.mean([d.u[0, 0] for d in data], axis=0)),
    )
    # what advice says of outputs holds of states here
    return replace(advice_in_words(replace(model, outputs=structure.states)), outputs=structure.outputs)


def smoothed(
    record: FlightRecord,
    structure: ModelStructure,
    delays: FloatArray,
    held: NDArray[np.bool_],
    cutoff_hz: float | None,
) -> SmoothedStates:
    """Return the record's states, inputs and derivatives, all through one low pass; gaps are bridged first."""
    part = record.select((*structure.states, *structure.inputs))
    rows = [bridge(record.t_s, part[name], part.valid[:, i], name) for i, name in enumerate(part.channels)]
    x, u = np.array(rows[: len(structure.states)]), np.array(rows[len(structure.states) :])
    driven = delayed(u.T, record.dt_s, delays)
    series = [SineSeries.of(signal, record.dt_s) for signal in x]
    cutoffs = np.array([s.best_cutoff_hz if cutoff_hz is None else cutoff_hz for s in series])
    return _passed(series, driven, held, cutoffs, np.asarray(part.valid.all(axis=1)), record.dt_s)


def missing(
    structure: ModelStructure, data: SmoothedStates, params: FloatArray, free: NDArray[np.intp], held: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray] | None:
    """Return what the low passes leave missing in the equations, (N, n), and the derivatives of the errors (N, n, f).

    Both are those of the structure's own response to a record's inputs, without noise. With all inputs held the
    response is exact, and so are the errors of its equations, which should be nothing. Of inputs that are not held the
    samples do not say how they run in between; what is missing then is what an equation would have had of each state
    at its own cut-off and has not, as that state is cut off earlier.

    Args:
        structure: the equations.
        data: the smoothed record; the response begins where it does.
        params: (k,) parameters.
        free: (f,) indices of those that are estimated.
        held: (m,) inputs that are held between samples.

    Returns:
        None where the response diverges.
    """
    recorded = np.stack([x[:, i] for i, x in enumerate(data.x)], axis=1)
    found = respond(structure, params, [], data.driven, Sampling(data.dt_s, held), recorded)
    if not np.all(np.isfinite(found.x)):
        return None
    series = [SineSeries.of(signal, data.dt_s) for signal in found.x.T]
    made = _passed(series, data.driven, held, data.cutoffs_hz, data.taken, data.dt_s)
    (errors,), (jacobian,) = equations(structure, [made], params, free)
    if not np.all(held):
        whole = [np.stack([s.smoothed(cutoff).values for s in series], axis=1) for cutoff in data.cutoffs_hz]
        errors -= equations(structure, [made._replace(x=np.array(whole))], params, free)[0][0]
    return errors, jacobian


def _passed(
    series: Sequence[SineSeries],
    driven: FloatArray,
    held: NDArray[np.bool_],
    cutoffs: FloatArray,
    taken: NDArray[np.bool_],
    dt_s: float,
) -> SmoothedStates:
    u_series = [SineSeries.of(signal, dt_s) for signal in np.where(held, _within(driven), driven).T]
    states, inputs, derivatives, noise = [], [], [], []
    for i, cutoff in enumerate(cutoffs):
        found = [s.smoothed(min(own, cutoff)) for s, own in zip(series, cutoffs, strict=True)]
        states.append(np.stack([s.values for s in found], axis=1))
        inputs.append(np.stack([s.smoothed(cutoff).values for s in u_series], axis=1))
        derivatives.append(found[i].derivative)
        noise.append([s.noise_left(min(own, cutoff)) for s, own in zip(series, cutoffs, strict=True)])
    return SmoothedStates(
        np.array(states), np.array(inputs), np.stack(derivatives, axis=1), taken, np.array(noise), cutoffs, driven, dt_s
    )


def _within(u: FloatArray) -> FloatArray:
    """Return what held inputs (N, m) are to states that are differentiated over frequency.

    States that integrate a staircase have, at their samples, the spectrum of dt / (z - 1) and not that of 1 / (i w):
    a derivative i w of them answers to the input half a sample later, times (w dt/2) / sin(w dt/2) = 1 + (w dt)^2 / 24.
    Four values around the half sample have this to (w dt)^4; the mean of two has 1 - (w dt)^2 / 8, which left
    control derivatives of short steps 2 % too large.
    """
    padded = np.vstack([u[:1], u[:1], u, u[-1:]])
    return np.asarray((7.0 * (padded[1:-2] + padded[2:-1]) - (padded[:-3] + padded[3:])) / 12.0)


def equations(
    structure: ModelStructure, data: Sequence[SmoothedStates], params: FloatArray, free: np.ndarray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return per record the errors of the state equations (N, n) and their derivatives (N, n, f) by the parameters.

    Both are zero where something was not sampled.
    """
    z = np.tile(params.astype(complex), (free.size, 1))
    z[np.arange(free.size), free] += 1j * STEP
    residuals, jacobians = [], []
    for d in data:
        sides = [
            structure.derivative(x[:, None, :].astype(complex), u[:, None, :], z[None, :, :])[:, :, i]
            for i, (x, u) in enumerate(zip(d.x, d.u, strict=True))
        ]
        f = np.stack(sides, axis=1)  # (N, n, f)
        residuals.append(np.where(d.taken[:, None], d.xdot - f[:, :, 0].real, 0.0))
        jacobians.append(np.where(d.taken[:, None, None], -f.imag / STEP, 0.0))
    return residuals, jacobians
