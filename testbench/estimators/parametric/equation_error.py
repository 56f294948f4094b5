"""Equation error for a structure: least squares on the state equations, all states measured.

    smoothed dx/dt = f(smoothed x, smoothed u, params) + error

If f is linear in its parameters, as in all structures with dimensional derivatives, this is one linear least squares;
otherwise it takes Gauss-Newton steps. It needs no start values and cannot diverge, so it gives output error its start.
But noise of the measured states biases it, mostly towards zero, and its standard errors do not cover this: the advice
says by how much, parameter by parameter (see ``_noise_bias``), and results/estimators how far the errors fall short.
Derivatives by Fourier smoothing (see ``regression.smoothing``). The equation of a state passes, derivative, states and
inputs, the low pass that suits this state: a linear equation holds for filtered signals if one filter has passed them
all; states that show nothing but noise from a lower frequency on are cut off there. Inputs that are held are taken
half a sample later, as states that integrate a staircase answer to them (see ``_within``).
V. Klein and E. A. Morelli, Aircraft System Identification, AIAA, 2006, chapter 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, doubt, note
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.call import with_settings
from testbench.estimators.coverage import approximate
from testbench.estimators.hold import said_of_hold
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import accuracy, correlations, whiteness
from testbench.estimators.parametric.advice import advice_in_words
from testbench.estimators.parametric.likelihood import held_inputs
from testbench.estimators.parametric.model import ParametricModel, named
from testbench.estimators.parametric.response import delayed
from testbench.estimators.parametric.sensitivities import Sensitivities
from testbench.estimators.parametric.servo import by_surfaces, in_front
from testbench.estimators.parametric.structure import STEP, ModelStructure
from testbench.estimators.regression.smoothing import SineSeries, bridge
from testbench.estimators.settings import EquationError

_STEPS = 20
_LITTLE = 0.1  # bias by noise, in standard errors, that is not worth a word
_STILL = 1e-10  # relative change of the parameters, in standard errors, that ends the steps


@with_settings(EquationError)
def estimate(
    records: Sequence[FlightRecord],
    structure: ModelStructure,
    *,
    delays_s: Mapping[str, float] | None,
    held: Sequence[str] | None,
    cutoff_hz: float | None,
) -> ParametricModel:
    """Estimate the free parameters of a structure whose states are all channels of the records.

    Bounds are not enforced: an estimate beyond one is moved onto it, and the advice says so. Priors count as data.

    Args:
        records: measured records with one sample time.
        structure: the equations; every state is a channel.
        delays_s: known delay per input, s.
        held: inputs held between samples; None takes ``*_cmd`` and those that the records show to be held. The others
            run linearly.
        cutoff_hz: of the smoothing; chosen from each record if None.

    Returns:
        The model; diagnostics as of output error where they apply, ``residual_std`` and ``whiteness_p`` per state.

    Raises:
        EstimationError: a state is not measured, nothing is free, too few samples, or a parameter is not decided.
        ChannelError: a record lacks a channel.
    """
    if in_front(structure):
        return by_surfaces(
            records,
            structure,
            held,
            lambda moved, base, still: estimate(moved, base, delays_s=delays_s, held=still, cutoff_hz=cutoff_hz),
        )
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
    hold, recognised = held_inputs(structure.inputs, held, records)
    data = [_smoothed(r, structure, delays, hold, cutoff_hz) for r in records]
    count = sum(int(d.taken.sum()) for d in data)
    if count <= 2 * free.size:
        raise EstimationError(
            f"equation error of '{structure.name}' needs more than twice as many samples as its {free.size} "
            f"parameters, got {count} with all states and inputs sampled; give more data or fix some parameters"
        )
    params = structure.values
    stds = (structure.parameters[i].prior_std for i in free)
    prior = np.array([0.0 if std is None else 1.0 / std for std in stds])
    residuals, jacobians = _equations(structure, data, params, free)
    size = np.sqrt(np.mean(np.vstack([d.xdot for d in data]) ** 2, axis=0))
    R = np.where(size > 0.0, size**2, 1.0)  # what never moves decides nothing, which the accuracy will say
    for _ in range(_STEPS):
        left = np.vstack([*[(j / np.sqrt(R)[:, None]).reshape(-1, free.size) for j in jacobians], np.diag(prior)])
        centre = prior * (params[free] - structure.values[free])
        right = np.concatenate([*[(e / np.sqrt(R)).ravel() for e in residuals], centre])
        scale = np.linalg.norm(left, axis=0)
        scale = np.where(scale > 0.0, scale, 1.0)
        step = -np.linalg.lstsq(left / scale, right, rcond=1e-12)[0] / scale
        params = params.copy()
        params[free] += step
        residuals, jacobians = _equations(structure, data, params, free)
        new = np.maximum(np.sum(np.vstack(residuals) ** 2, axis=0) / count, (1e-11 * size) ** 2 + 1e-300)
        settled = float(np.max(np.abs(step) * scale)) <= _STILL * float(np.linalg.norm(right))
        settled = settled and bool(np.all(np.abs(new - R) <= 1e-6 * R))
        R = new
        if settled:
            break
    low, high = structure.bounds
    beyond = [structure.parameter_names[i] for i in free if not low[i] <= params[i] <= high[i]]
    inside = np.clip(params, low, high)
    return _model(
        structure, records, data, inside, R, residuals, jacobians, prior, beyond, delays, hold, recognised, size
    )


class _Data(NamedTuple):
    """One record's x (n, N, n) and inputs (n, N, m) per equation, derivatives (N, n), samples taken (N,), and the
    variances of the noise that is left in x (n, n), by equation and state."""

    x: FloatArray
    u: FloatArray
    xdot: FloatArray
    taken: NDArray[np.bool_]
    noise: FloatArray


def _smoothed(
    record: FlightRecord,
    structure: ModelStructure,
    delays: FloatArray,
    held: NDArray[np.bool_],
    cutoff_hz: float | None,
) -> _Data:
    """Return the record's states, inputs and derivatives, all through one low pass; gaps are bridged first."""
    part = record.select((*structure.states, *structure.inputs))
    rows = [bridge(record.t_s, part[name], part.valid[:, i], name) for i, name in enumerate(part.channels)]
    x, u = np.array(rows[: len(structure.states)]), np.array(rows[len(structure.states) :])
    u = delayed(u.T, record.dt_s, delays)
    u = np.where(held, _within(u), u)

    x_series, u_series = ([SineSeries.of(signal, record.dt_s) for signal in signals] for signals in (x, u.T))
    cutoffs = [s.best_cutoff_hz if cutoff_hz is None else cutoff_hz for s in x_series]
    states, inputs, derivatives, noise = [], [], [], []
    for i, cutoff in enumerate(cutoffs):
        found = [s.smoothed(min(own, cutoff)) for s, own in zip(x_series, cutoffs, strict=True)]
        states.append(np.stack([s.values for s in found], axis=1))
        inputs.append(np.stack([s.smoothed(cutoff).values for s in u_series], axis=1))
        derivatives.append(found[i].derivative)
        noise.append([s.noise_left(min(own, cutoff)) for s, own in zip(x_series, cutoffs, strict=True)])
    return _Data(
        np.array(states),
        np.array(inputs),
        np.stack(derivatives, axis=1),
        np.asarray(part.valid.all(axis=1)),
        np.array(noise),
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


def _equations(
    structure: ModelStructure,
    data: Sequence[_Data],
    params: FloatArray,
    free: np.ndarray,
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


def _model(
    structure: ModelStructure,
    records: Sequence[FlightRecord],
    data: Sequence[_Data],
    params: FloatArray,
    R: FloatArray,
    residuals: list[FloatArray],
    jacobians: list[FloatArray],
    prior: FloatArray,
    beyond: list[str],
    delays: FloatArray,
    held: NDArray[np.bool_],
    recognised: Sequence[str],
    size: FloatArray,
) -> ParametricModel:
    free, k = np.flatnonzero(structure.free), params.size
    names = [structure.parameter_names[i] for i in free]
    felt = np.array([any(np.any(j[:, s]) for j in jacobians) for s in range(size.size)])
    found = accuracy(
        [e[:, felt] for e in residuals],
        lambda: (Sensitivities.of_all(j[:, felt]) for j in jacobians),
        np.diag(R[felt]),
        prior,
        np.ones(free.size, bool),
        names,
    )
    covariance, white = np.zeros((k, k)), np.zeros((k, k))
    covariance[np.ix_(free, free)], white[np.ix_(free, free)] = found.corrected, found.plain
    deviation = np.sqrt(np.diag(found.plain))
    valid = [np.tile(d.taken[:, None], size.size) for d in data]
    white_p = np.where(felt, whiteness(residuals, valid, size, np.diag(R)), 1.0)
    y = np.vstack([r.columns(structure.outputs) for r in records])
    spread = np.maximum(y.var(axis=0), 1e-300)
    model = ParametricModel(
        method="equation_error",
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=records[0].dt_s,
        settings={"delays_s": dict(zip(structure.inputs, delays.tolist(), strict=True)), **said_of_hold(recognised)},
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
        held=tuple(held.tolist()),
        delays_s=tuple(delays.tolist()),
        operating_point=(
            np.mean([d.x[0, 0] for d in data], axis=0),
            np.mean([d.u[0, 0] for d in data], axis=0),
        ),
    )
    bias = np.zeros(k)
    bias[free] = _noise_bias(structure, data, params, free, R, found.plain)
    model = replace(model, diagnostics={**model.diagnostics, "noise_bias": bias[free]})
    # what advice says of outputs holds of states here
    said = replace(advice_in_words(replace(model, outputs=structure.states)), outputs=structure.outputs)
    return replace(said, advice=(*said.advice, *_bias_in_words(said, bias)))


def _noise_bias(
    structure: ModelStructure,
    data: Sequence[_Data],
    params: FloatArray,
    free: np.ndarray,
    R: FloatArray,
    plain: FloatArray,
) -> FloatArray:
    """Return the bias (f,) of the free parameters by noise of the measured states.

    With errors in variables, least squares tend to theta - M^-1 N theta (W. A. Fuller, Measurement Error Models, 1987,
    section 1.1), M the information and N that of the noise alone. Equation i answers noise n of state s by df_i/dx_s n,
    and its sensitivity to theta_j by d2f_i/dtheta_j dx_s n, so that with the variances v of the noise that the low pass
    leaves, the bias is - plain sum over samples, i and s of v_is d2f_i/dtheta_j dx_s df_i/dx_s / R_i. Noise of a state
    and that of its derivative do not go together.

    Args:
        structure: the equations.
        data: smoothed records.
        params: (k,) estimates.
        free: (f,) indices of those that are estimated.
        R: (n,) variances of the equations' errors.
        plain: (f, f) inverse of the information.
    """
    z = np.tile(params.astype(complex), (free.size, 1))
    z[np.arange(free.size), free] += 1j * STEP
    total = np.zeros(free.size)
    for d in data:
        for i, (x, u) in enumerate(zip(d.x, d.u, strict=True)):
            for s in np.flatnonzero(d.noise[i] > 0.0):
                nudge = max(float(np.std(x[:, s])), 1e-12)
                moved = np.zeros(x.shape[1])
                moved[s] = nudge
                f, g = (
                    structure.derivative((x + side * moved)[:, None, :].astype(complex), u[:, None, :], z[None])[
                        :, :, i
                    ]
                    for side in (1.0, -1.0)
                )
                slope = (f - g)[d.taken] / (2.0 * nudge)  # by the state; its imaginary part by the parameters, too
                total += d.noise[i, s] / R[i] * np.sum(slope.imag / STEP * slope.real, axis=0)
    return np.asarray(-plain @ total)


def _bias_in_words(model: ParametricModel, bias: FloatArray) -> tuple[Advice, ...]:
    """Return by how much noise of the states biases the estimates: a doubt if by more than an error, else a note."""
    error, names = np.sqrt(np.diag(model.covariance)), model.structure.parameter_names

    def said(i: int) -> str:
        large = abs(bias[i]) > abs(model.params[i])  # percent of a value near zero say nothing
        share = "" if large else f"{100.0 * abs(bias[i] / model.params[i]):.2g} % of it, "
        return f"{names[i]} by {bias[i]:.2g} ({share}{abs(bias[i]) / error[i]:.2g} of its errors)"

    worth = [int(i) for i in np.flatnonzero(error > 0.0) if abs(bias[i]) > _LITTLE * error[i]]
    if not worth:
        return ()
    worth.sort(key=lambda i: -abs(bias[i]) / error[i])
    beyond = [i for i in worth if abs(bias[i]) > error[i]]
    if not beyond:
        most = f"noise of the measured states biases these estimates by less than their errors, most {said(worth[0])}"
        return (note("noisy_terms", most), *approximate("equation_error"))
    return (
        doubt(
            "noisy_terms",
            f"noise of the measured states biases {', '.join(said(i) for i in beyond)}, and the standard errors do not "
            "hold that; refine the estimate by output error",
        ),
        *approximate("equation_error"),
    )
