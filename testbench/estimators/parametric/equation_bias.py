"""What noise and smoothing do to equation error, and the estimates without it.

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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.record import FloatArray
from testbench.estimators.parametric.state_equations import Regression, SmoothedStates, equations, missing
from testbench.estimators.parametric.structure import STEP

_LONGEST = 20_000  # samples of a record that are looked at; of longer ones the stretch where the inputs move most
_MOST = 60_000  # samples of all records that are looked at; of more, records spread evenly over them
_NEVER_ALL = 0.95  # largest share of noise that is reckoned with: beyond, the share itself is not known well enough
_MOST_NOISE = 0.5  # share of a combination's information that noise alone makes, beyond which its bias cannot be told
_PART = 0.5  # of a parameter's standard error that makes a combination a part of it
_MOST_CHANGE = 0.5  # of the smoothing's bias, from the first estimate of it to the second, that is still believed


class Bias(NamedTuple):
    """Bias of the f free parameters.

    Attributes:
        noise: (f,) by noise of the measured states; of combinations of parameters of which it can be told.
        smoothing: (f,) by what the low passes take from the motion; zero where it cannot be told.
        widening: (f, f) by which estimates without the bias scatter more than those with it.
        left: (f, f) covariance that stands for what noise may do to the combinations that are not corrected.
        untold: (f,) parameters of which such a combination is a part.
        smoothing_known: the response shows the bias by smoothing: it does not diverge, and hardly depends on whether it
            is that of the estimates with the bias or without it.
    """

    noise: FloatArray
    smoothing: FloatArray
    widening: FloatArray
    left: FloatArray
    untold: NDArray[np.bool_]
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
