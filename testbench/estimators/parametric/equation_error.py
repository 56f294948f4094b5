"""Equation error for a structure: least squares on the state equations, all states measured.

    smoothed dx/dt = f(smoothed x, smoothed u, params) + error

If f is linear in its parameters, as in all structures with dimensional derivatives, this is one linear least squares;
otherwise it takes Gauss-Newton steps. It needs no start values and cannot diverge, so it gives output error its start.
But noise of the measured states biases it, mostly towards zero, and so does what smoothing takes from the motion: both
are estimated and taken out (see ``equation_bias``). Where they are large, or cannot be told, the advice says so, and
results/estimators how far the errors fall short.
V. Klein and E. A. Morelli, Aircraft System Identification, AIAA, 2006, chapter 5.

What noise and smoothing do to equation error, and the estimates without it.

**Noise** of the measured states draws least squares towards zero: they tend to theta - (M - N)^-1 g, M the information
and N that of the noise alone (W. A. Fuller, Measurement Error Models, 1987, section 1.1). Equation i answers noise n of
state s by df_i/dx_s n, and its sensitivity to theta_j by d2f_i/dtheta_j dx_s n, so that with the variances v that the
low pass leaves of the noise

    g_j = sum over samples, i and s of v_is d2f_i/dtheta_j dx_s df_i/dx_s / R_i .

Noise of a state and that of its derivative do not go together.

Where the motion tells nothing, as the airspeed of a short flight in still air, noise is most of the information and
M - N has no inverse worth having. With M^-1 = L L', the eigenvectors of L' N L are combinations of parameters whose
estimates do not go together, and their eigenvalues the shares of noise in what decides each. Those with less than half
are corrected. The others keep their estimates, and their errors hold what the correction might have been.

**Smoothing** takes more from one state than from another, and from a corner that a step of the input makes: what it
takes is missing in the equations, and biases them whatever the noise. A response of the structure to the recorded
inputs, without noise and with known parameters, through the same low passes, shows what is missing (indirect inference;
C. Gourieroux, A. Monfort, E. Renault, Journal of Applied Econometrics 8, 1993): errors e of its equations at the very
parameters that made it, which should be nothing, bias the estimates by - (M - N)^-1 J' R^-1 e.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, AdviceList
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.parametric.accuracy import accuracy, correlations, whiteness
from testbench.estimators.parametric.gauss_newton import Sensitivities
from testbench.estimators.parametric.likelihood import Driven
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.servo import by_surfaces, in_front
from testbench.estimators.parametric.state_equations import (
    Regression,
    SmoothedStates,
    equations,
    free_of,
    missing,
    model_of_equations,
    smoothed,
)
from testbench.estimators.parametric.structure import STEP, ModelStructure
from testbench.estimators.settings import EquationError

# --- what noise and smoothing do to equation error, and the estimates without it --------------------------------------


_LONGEST = 20_000  # samples of a record that are looked at; of longer ones the stretch where the inputs move most
_MOST = 60_000  # samples of all records that are looked at; of more, records spread evenly over them
_NEVER_ALL = 0.95  # largest share of noise that is reckoned with: beyond, the share itself is not known well enough
_MOST_NOISE = 0.5  # share of a combination's information that noise alone makes, beyond which its bias cannot be told
_PART = 0.5  # of a parameter's standard error that makes a combination a part of it
_MOST_CHANGE = 0.5  # of the smoothing's bias, from the first estimate of it to the second, that is still believed


class Bias(NamedTuple):
    """Bias of the f free parameters."""

    noise: FloatArray  #: (f,) by noise of the measured states; of combinations of parameters of which it can be told
    smoothing: FloatArray  #: (f,) by what the low passes take from the motion; zero where it cannot be told
    widening: FloatArray  #: (f, f) by which estimates without the bias scatter more than those with it
    left: FloatArray  #: (f, f) covariance that stands for what noise may do to the combinations that are not corrected
    untold: NDArray[np.bool_]  #: (f,) parameters of which such a combination is a part
    #: the response shows the bias by smoothing: it does not diverge, and hardly depends on whether it is that of the
    #: estimates with the bias or without it
    smoothing_known: bool

    @property
    def total(self) -> FloatArray:
        """Both together, (f,)."""
        return self.noise + self.smoothing


def bias_of(fit: Regression, R: FloatArray, plain: FloatArray, prior: FloatArray, held: NDArray[np.bool_]) -> Bias:
    """Return the bias of least squares on the state equations.

    Args:
        fit: the records and the estimates.
        R: (n,) variances of the equations' errors.
        plain: (f, f) inverse of the information, priors included.
        prior: (f,) one over the standard deviation of the prior, 0 without one.
        held: (m,) inputs that are held between samples.
    """
    data, free = fit.data, fit.free
    stretches = [_busiest(d, _LONGEST) for d in data]
    often = -(-sum(len(s.taken) for s in stretches) // _MOST)
    stretches = stretches[::often]
    if often > 1 or any(s is not d for s, d in zip(stretches, data, strict=True)):
        share = sum(len(s.taken) for s in stretches) / sum(len(d.taken) for d in data)  # priors weigh less with fewer
        fit = fit._replace(data=stretches)
        information = np.diag(share * prior**2)
        for d in stretches:
            (J,) = equations(fit.structure, [d], fit.params, free)[1]
            information += np.einsum("nif,nig,i->fg", J, J, 1.0 / R, optimize=True)
        plain = np.asarray(np.linalg.inv(information))
    score, information = _of_noise(fit, R)
    root = np.linalg.cholesky(0.5 * (plain + plain.T))
    shares, V = np.linalg.eigh(root.T @ information @ root)
    told = shares < _MOST_NOISE
    combined = root @ V  # (f, f) columns: combinations of parameters, each by its plain standard error
    own = 1.0 / (1.0 - np.minimum(shares, _NEVER_ALL))
    widening = np.asarray(combined * own @ np.linalg.inv(combined), np.float64)
    inverse = combined[:, told] * own[told] @ combined[:, told].T
    kept = combined[:, ~told] * (own * (combined.T @ score))[~told]
    left = np.asarray(kept @ kept.T)
    part = np.abs(combined[:, ~told]) / np.sqrt(np.diag(plain))[:, None]
    untold = np.asarray(part.max(axis=1, initial=0.0) > _PART)
    nothing = np.zeros(free.size)
    noise = -inverse @ score
    if not told.any():
        return Bias(noise, nothing, widening, left, untold, False)
    corrected = fit.params.copy()
    corrected[free] -= noise
    first = _of_smoothing(fit.at(corrected), R, held)
    if first is None:
        return Bias(noise, nothing, widening, left, untold, False)
    corrected[free] -= inverse @ first
    second = _of_smoothing(fit.at(corrected), R, held)
    within = combined[:, told]
    if second is None or not _size(within.T @ (second - first)) <= _MOST_CHANGE * _size(within.T @ first):
        return Bias(noise, nothing, widening, left, untold, False)
    return Bias(noise, inverse @ second, widening, left, untold, True)


def _busiest(d: SmoothedStates, longest: int) -> SmoothedStates:
    """Return the stretch of ``longest`` samples in which the inputs move most; the record itself if it is no longer."""
    if len(d.taken) <= longest:
        return d
    size = np.maximum(d.driven.std(axis=0), 1e-300)
    moved = np.concatenate([[0.0], np.cumsum(np.sum((np.diff(d.driven, axis=0) / size) ** 2, axis=1))])
    at = int(np.argmax(moved[longest - 1 :] - moved[: len(moved) - longest + 1]))
    part = slice(at, at + longest)
    return d._replace(x=d.x[:, part], u=d.u[:, part], xdot=d.xdot[part], taken=d.taken[part], driven=d.driven[part])


def _size(x: FloatArray) -> float:
    return float(np.sqrt(x @ x))


def _of_noise(fit: Regression, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return g (f,) and N (f, f) of the module's text."""
    structure, data, params, free = fit
    z = np.tile(params.astype(complex), (free.size, 1))
    z[np.arange(free.size), free] += 1j * STEP
    score, information = np.zeros(free.size), np.zeros((free.size, free.size))
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
                by_params, weight = slope.imag / STEP, d.noise[i, s] / R[i]
                score += weight * np.sum(by_params * slope.real, axis=0)
                information += weight * by_params.T @ by_params
    return score, information


def _of_smoothing(fit: Regression, R: FloatArray, held: NDArray[np.bool_]) -> FloatArray | None:
    """Return - J' R^-1 e (f,) of the response with these parameters, or None where it diverges."""
    score = np.zeros(fit.free.size)
    for d in fit.data:
        found = missing(fit.structure, d, fit.params, fit.free, held)
        if found is None:
            return None
        e, J = found
        score -= np.einsum("nif,ni->f", J, e / R)
    return score if np.all(np.isfinite(score)) else None


# --- equation error for a structure -----------------------------------------------------------------------------------


_STEPS = 20
_LITTLE = 0.1  # bias, in standard errors, that is not worth a word
_MUCH = 5.0  # bias, in standard errors, of which what its correction leaves may be an error (see results/estimators)
_STILL = 1e-10  # relative change of the parameters, in standard errors, that ends the steps


_DEFAULT = EquationError()


def estimate(
    records: Sequence[FlightRecord], structure: ModelStructure, settings: EquationError = _DEFAULT
) -> ParametricModel:
    """Estimate the free parameters of a structure whose states are all channels of the records.

    Bounds are not enforced: an estimate beyond one is moved onto it, and the advice says so. Priors count as data.

    Args:
        records: measured records with one sample time.
        structure: the equations; every state is a channel.
        settings: of the smoothing, and how the inputs act.

    Returns:
        The model; diagnostics as of output error where they apply, ``residual_std`` and ``whiteness_p`` per state.

    Raises:
        EstimationError: a state is not measured, nothing is free, too few samples, or a parameter is not decided.
        ChannelError: a record lacks a channel.
    """
    if in_front(structure):
        return by_surfaces(records, structure, settings, estimate)
    free = free_of(records, structure, "equation error")
    driven = Driven.of(settings, structure, records)
    data = [smoothed(r, structure, driven.delays_s, driven.held, settings.cutoff_hz) for r in records]
    count = sum(int(d.taken.sum()) for d in data)
    if count <= 2 * free.size:
        raise EstimationError(
            f"equation error of '{structure.name}' needs more than twice as many samples as its {free.size} "
            f"parameters, got {count} with all states and inputs sampled; give more data or fix some parameters"
        )
    params = structure.values
    stds = (structure.parameters[i].prior_std for i in free)
    prior = np.array([0.0 if std is None else 1.0 / std for std in stds])
    residuals, jacobians = equations(structure, data, params, free)
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
        residuals, jacobians = equations(structure, data, params, free)
        new = np.maximum(np.sum(np.vstack(residuals) ** 2, axis=0) / count, (1e-11 * size) ** 2 + 1e-300)
        settled = float(np.max(np.abs(step) * scale)) <= _STILL * float(np.linalg.norm(right))
        settled = settled and bool(np.all(np.abs(new - R) <= 1e-6 * R))
        R = new
        if settled:
            break
    return _model(Regression(structure, data, params, free), records, driven, R, prior, (residuals, jacobians))


def _model(
    fit: Regression,
    records: Sequence[FlightRecord],
    driven: Driven,
    R: FloatArray,
    prior: FloatArray,
    errors: tuple[list[FloatArray], list[FloatArray]],
) -> ParametricModel:
    """Return the model of estimates from the errors of the equations, their slopes and their variances R (n,)."""
    structure, data, params, free = fit
    (residuals, jacobians), k = errors, params.size
    size = np.sqrt(np.mean(np.vstack([d.xdot for d in data]) ** 2, axis=0))
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
    bias = bias_of(fit, R, found.plain, prior, driven.held)
    corrected = params.copy()
    corrected[free] -= bias.total
    covariance, white = np.zeros((k, k)), np.zeros((k, k))
    few = _of_few_lines(data, jacobians)
    covariance[np.ix_(free, free)] = (
        bias.widening @ (found.corrected * np.outer(few, few)) @ bias.widening.T + bias.left
    )
    white[np.ix_(free, free)] = bias.widening @ found.plain @ bias.widening.T
    deviation = np.sqrt(np.diag(found.plain))
    valid = [np.tile(d.taken[:, None], size.size) for d in data]
    white_p = np.where(felt, whiteness(residuals, valid, size, np.diag(R)), 1.0)
    said = model_of_equations(
        "equation_error",
        fit.at(corrected),
        records,
        driven,
        covariance,
        white,
        {
            "condition": found.condition,
            "residual_std": np.sqrt(R),
            "whiteness_p": white_p,
            "correlation": correlations(found.plain),
            "error_inflation": np.sqrt(np.diag(found.corrected)) / np.maximum(deviation, 1e-300),
            "noise_bias": bias.noise,
            "smoothing_bias": bias.smoothing,
        },
    )
    return replace(said, advice=(*said.advice, *_bias_in_words(said, bias, free)))


def _of_few_lines(data: Sequence[SmoothedStates], jacobians: Sequence[FloatArray]) -> FloatArray:
    """Return by how much errors (f,) grow as their equation has passed few frequencies.

    A low pass at f leaves 2 f T independent values of a record of length T; as many as an equation has parameters are
    used up by them, and its residuals, smaller for it, tell too small a variance.
    """
    lines = np.sum([np.minimum(2.0 * d.cutoffs_hz * d.dt_s, 1.0) * len(d.taken) for d in data], axis=0)
    felt = np.any([np.any(J != 0.0, axis=0) for J in jacobians], axis=0)  # (n, f)
    factor = np.sqrt(lines / np.maximum(lines - felt.sum(axis=1), 1.0))
    return np.asarray(np.max(np.where(felt, np.maximum(factor, 1.0)[:, None], 1.0), axis=0))


def _bias_in_words(model: ParametricModel, bias: Bias, free: NDArray[np.intp]) -> tuple[Advice, ...]:
    """Return by how much the estimates were biased: a doubt where what is left of it may be an error, else a note."""
    error, names = np.sqrt(np.diag(model.covariance))[free], [model.structure.parameter_names[i] for i in free]
    value, total = model.params[free], bias.total

    def said(i: int) -> str:
        large = abs(total[i]) > abs(value[i])  # percent of a value near zero say nothing
        share = "" if large else f"{100.0 * abs(total[i] / value[i]):.2g} % of it, "
        return f"{names[i]} by {total[i]:.2g} ({share}{abs(total[i]) / error[i]:.2g} of its errors)"

    out = AdviceList()
    if bias.untold.any():
        which = ", ".join(name for name, there in zip(names, bias.untold, strict=True) if there)
        out.doubt(
            "noisy_terms",
            f"noise of the measured states is half or more of the information on {which}: its bias cannot be "
            "determined; their standard errors include the possible bias, and the other estimates are corrected; "
            "excite that motion, fix them at prior values, or refine the estimates by output error",
        )
    if not bias.smoothing_known and not bias.untold.all():
        why = "the response of these estimates diverges or is far from the record"
        out.note("noisy_terms", f"the attenuation by smoothing is not corrected, because {why}")
    worth = [int(i) for i in np.flatnonzero(error > 0.0) if abs(total[i]) > _LITTLE * error[i]]
    worth.sort(key=lambda i: -abs(total[i]) / error[i])
    much = [i for i in worth if abs(total[i]) > _MUCH * error[i]]
    cause = "noise of the measured states and smoothing biased"
    if much:
        left = "they are corrected, but the remainder may be an error: refine the estimates by output error"
        out.doubt("noisy_terms", f"{cause} {', '.join(said(i) for i in much)}; {left}")
    elif worth:
        out.note("noisy_terms", f"{cause} these estimates, most {said(worth[0])}; they are corrected for it")
    return (*out, *approximate("equation_error")) if out else ()
