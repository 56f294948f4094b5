"""Equation error for a structure: least squares on the state equations, all states measured.

    smoothed dx/dt = f(smoothed x, u, params) + error

One linear least squares where f is linear in its parameters, as all structures with dimensional derivatives are;
Gauss-Newton steps otherwise. No start values are needed and nothing can diverge, so that it gives output error a place
to start from; but noise of the measured states biases it, towards zero as a rule. Derivatives by Fourier smoothing
(see ``regression.smoothing``). V. Klein and E. A. Morelli, Aircraft System Identification, AIAA, 2006, chapter 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.errors import EstimationError
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import accuracy, correlations, whiteness
from testbench.estimators.parametric.advice import advice_in_words
from testbench.estimators.parametric.model import ParametricModel, named
from testbench.estimators.parametric.output_error import held_inputs
from testbench.estimators.parametric.response import delayed
from testbench.estimators.parametric.structure import STEP, ModelStructure
from testbench.estimators.regression.smoothing import fourier_smooth
from testbench.record import FlightRecord, FloatArray

_STEPS = 20
_STILL = 1e-10  # relative change of the parameters, in standard errors, that ends the steps


def estimate(
    records: Sequence[FlightRecord],
    structure: ModelStructure,
    *,
    delays_s: Mapping[str, float] | None = None,
    held: Sequence[str] | None = None,
    cutoff_hz: float | None = None,
) -> ParametricModel:
    """Estimate the free parameters of a structure whose states are all channels of the records.

    Bounds are not enforced: an estimate beyond one is moved onto it and said in the advice. Priors count as data.

    Args:
        records: measured records with one sample time.
        structure: the equations; every state is a channel.
        delays_s: known delay per input, s.
        held: inputs held between samples, for simulations with the model; None takes ``*_cmd``.
        cutoff_hz: of the smoothing; chosen from the data if None.

    Returns:
        The model; diagnostics as of output error where they apply, ``residual_std`` and ``whiteness_p`` per state.

    Raises:
        EstimationError: a state is not measured, nothing is free, or the data do not decide some parameter.
        ChannelError: a record lacks a channel.
    """
    check_records(records, structure.must_move, structure.outputs)
    free = np.flatnonzero(structure.free)
    if not free.size:
        raise EstimationError(f"structure '{structure.name}' has no free parameter; free some, or simulate it instead")
    for name in structure.states:
        for record in records:
            if name not in record:
                raise EstimationError(
                    f"equation error needs every state of '{structure.name}' as a channel, but a record lacks "
                    f"'{name}'; sense it, or use output error"
                )
    delays = named(delays_s, structure.inputs, "a delay")
    data = [_smoothed(r, structure, delays, cutoff_hz) for r in records]
    params, R = structure.values, np.ones(len(structure.states))
    stds = (structure.parameters[i].prior_std for i in free)
    prior = np.array([0.0 if std is None else 1.0 / std for std in stds])
    residuals, jacobians = _equations(structure, data, params, free)
    size = np.sqrt(np.mean(np.vstack([d for _, _, d in data]) ** 2, axis=0))
    R = np.maximum(size**2, 1e-300)
    for _ in range(_STEPS):
        left = np.vstack([*[(j / np.sqrt(R)[:, None]).reshape(-1, free.size) for j in jacobians], np.diag(prior)])
        centre = prior * (params[free] - structure.values[free])
        right = np.concatenate([*[(e / np.sqrt(R)).ravel() for e in residuals], centre])
        scale = np.maximum(np.linalg.norm(left, axis=0), 1e-300)
        step = -np.linalg.lstsq(left / scale, right, rcond=1e-12)[0] / scale
        params = params.copy()
        params[free] += step
        residuals, jacobians = _equations(structure, data, params, free)
        new = np.maximum(np.mean(np.vstack(residuals) ** 2, axis=0), (1e-11 * size) ** 2 + 1e-300)
        settled = float(np.max(np.abs(step) * scale)) <= _STILL * float(np.linalg.norm(right))
        settled = settled and bool(np.all(np.abs(new - R) <= 1e-6 * R))
        R = new
        if settled:
            break
    low, high = structure.bounds
    beyond = [structure.parameter_names[i] for i in free if not low[i] <= params[i] <= high[i]]
    inside = np.clip(params, low, high)
    return _model(structure, records, data, inside, R, residuals, jacobians, prior, beyond, delays, held, size)


def _smoothed(
    record: FlightRecord, structure: ModelStructure, delays: FloatArray, cutoff_hz: float | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return smoothed states (N, n), inputs (N, m) and derivatives of the states (N, n)."""
    found = [fourier_smooth(record[s], record.dt_s, cutoff_hz=cutoff_hz) for s in structure.states]
    u = delayed(record.columns(structure.inputs), record.dt_s, delays)
    return np.stack([s.values for s in found], axis=1), u, np.stack([s.derivative for s in found], axis=1)


def _equations(
    structure: ModelStructure,
    data: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
    params: FloatArray,
    free: np.ndarray,
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return per record the errors of the state equations (N, n) and their derivatives (N, n, f) by the parameters."""
    z = np.tile(params.astype(complex), (free.size, 1))
    z[np.arange(free.size), free] += 1j * STEP
    residuals, jacobians = [], []
    for x, u, xdot in data:
        f = structure.derivative(x[:, None, :].astype(complex), u[:, None, :], z[None, :, :])
        residuals.append(xdot - f[:, 0].real)
        jacobians.append(-f.imag.transpose(0, 2, 1) / STEP)
    return residuals, jacobians


def _model(
    structure: ModelStructure,
    records: Sequence[FlightRecord],
    data: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
    params: FloatArray,
    R: FloatArray,
    residuals: list[FloatArray],
    jacobians: list[FloatArray],
    prior: FloatArray,
    beyond: list[str],
    delays: FloatArray,
    held: Sequence[str] | None,
    size: FloatArray,
) -> ParametricModel:
    free, k = np.flatnonzero(structure.free), params.size
    names = [structure.parameter_names[i] for i in free]
    felt = np.array([any(np.any(j[:, s]) for j in jacobians) for s in range(size.size)])
    found = accuracy(
        [e[:, felt] for e in residuals],
        [j[:, felt] for j in jacobians],
        np.diag(R[felt]),
        prior,
        np.ones(free.size, bool),
        names,
    )
    covariance, white = np.zeros((k, k)), np.zeros((k, k))
    covariance[np.ix_(free, free)], white[np.ix_(free, free)] = found.corrected, found.plain
    deviation = np.sqrt(np.diag(found.plain))
    valid = [np.ones(e.shape, bool) for e in residuals]
    white_p = np.where(felt, whiteness(residuals, valid, size, np.diag(R)), 1.0)
    y = np.vstack([r.columns(structure.outputs) for r in records])
    spread = np.maximum(y.var(axis=0), 1e-300)
    model = ParametricModel(
        method="equation_error",
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=records[0].dt_s,
        settings={"delays_s": dict(zip(structure.inputs, delays.tolist(), strict=True))},
        diagnostics={
            "converged": True,
            "at_bound": beyond,
            "condition": found.condition,
            "residual_std": np.sqrt(R),
            "whiteness_p": white_p,
            "correlation": correlations(found.plain),
            "error_inflation": np.sqrt(np.diag(found.corrected)) / np.maximum(deviation, 1e-300),
        },
        structure=structure,
        params=params,
        covariance=covariance,
        covariance_plain=white,
        noise_covariance=np.diag(spread),
        held=tuple(held_inputs(structure.inputs, held).tolist()),
        delays_s=tuple(delays.tolist()),
        operating_point=(
            np.mean([x[0] for x, _, _ in data], axis=0),
            np.mean([u[0] for _, u, _ in data], axis=0),
        ),
    )
    # what advice says of outputs holds of states here
    said = advice_in_words(replace(model, outputs=structure.states))
    return replace(said, outputs=structure.outputs)
