"""The accuracy of estimates: information, correction for coloured residuals, and undecided unknowns.

What is doubtful about parameter estimates, and what to do about it.

How much too small are errors that were corrected for the colour of residuals, because a fit takes colour away?

A fit takes out of the residuals just those slow motions that its unknowns can imitate. In a short record that is much
of their colour, and the errors that are corrected for what is left are too small (``make coloured-errors-study``).
Simulations say how much: noise of the colour found is drawn, what the unknowns can imitate is taken out of it, and its
errors are corrected as those of the record were (a parametric bootstrap: B. Efron and R. J. Tibshirani, "An
Introduction to the Bootstrap", 1993, sections 6.5 and 12.5).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from testbench.core.advice import AdviceList, doubt, note, ranked
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.estimators.parametric.gauss_newton import Sensitivities, believed_alone, in_blocks, square_root
from testbench.estimators.residuals import (
    LAG_SHARE,
    Autoregression,
    Colour,
    autoregressions,
    corrected_covariance,
    ljung_box,
    sides,
)

if TYPE_CHECKING:
    from testbench.estimators.parametric.model import ParametricModel
    from testbench.estimators.parametric.structure import ModelStructure

# --- errors are too small where the fit took the colour of residuals away ---------------------------------------------


DRAWS = 32  # the factor then scatters by some 5 % for a variance that scatters by 60 %
LONG_ENOUGH = 300.0  # correlation times in the records, beyond which the factor is below 1.01
LARGEST = 2e7  # of the sensitivities' numbers, that are kept for all records at once
_SEED = 30


def shortfall(
    residuals: Sequence[FloatArray],
    sensitivities: Callable[[], Iterable[Sensitivities]],
    R: FloatArray,
    plain: FloatArray,
    colour: Colour,
) -> FloatArray:
    """Return by how much variances (k,) corrected for colour fall short; 1 for white residuals and for long records.

    It is the mean of (variance of the noise drawn) / (variance as corrected in a draw), at least 1. The mean of the
    inverse also widens intervals for the scatter of the corrected variances, as Student's distribution does.

    Args:
        residuals: per record (N, p); zero where not valid.
        sensitivities: gives those of each record, zero where not valid.
        R: (p, p) covariance that weighs the residuals.
        plain: (k, k) covariance of the unknowns for white residuals; rows of zero are not estimated.
        colour: of the residuals.
    """
    k = len(plain)
    model, samples, p = colour.model, sum(len(v) for v in residuals), len(R)
    moved = np.flatnonzero(np.diag(plain) > 0.0)
    if model is None or not len(model.A) or not moved.size:
        return np.ones(k)
    if -np.log(model.slowest()) * samples > LONG_ENOUGH or samples * p * (k + 2 * DRAWS) > LARGEST:
        return np.ones(k)
    # A root that dies away over the whole record is one of chance: what is drawn with it would say nothing of the next.
    model = model.damped(float(np.exp(-LAG_SHARE / max(map(len, residuals)))))
    inverse, rng = np.asarray(np.linalg.inv(R), dtype=np.float64), np.random.default_rng(_SEED)
    felt = [_Felt.of(s, inverse, plain, moved) for s in sensitivities()]
    drawn = [_drawn(model, v, rng) for v in residuals]
    off = plain @ sum(f.score(x, k) for f, x in zip(felt, drawn, strict=True))
    total = np.zeros(moved.size)
    left = [x - f.s.values @ off[f.s.columns] for f, x in zip(felt, drawn, strict=True)]
    for again in autoregressions([[x[:, :, b] for x in left] for b in range(DRAWS)]):
        total += 1.0 / sum(f.variances(again) for f in felt)
    out = np.ones(k)
    out[moved] = np.maximum(sum(f.variances(model) for f in felt) * total / DRAWS, 1.0)
    return out


class _Felt(NamedTuple):
    """One record: sensitivities, the same times the inverse covariance, and the spectrum of the estimates by samples.

    ``gain`` (f, p, m) is the transform, over ``size`` samples, of the matrix that maps residuals to estimates.
    """

    s: Sensitivities
    weighted: FloatArray
    gain: NDArray[np.complex128]
    size: int

    @classmethod
    def of(cls, s: Sensitivities, inverse: FloatArray, plain: FloatArray, moved: NDArray[np.intp]) -> _Felt:
        weighted = inverse @ s.values
        size = next_fast_len(2 * len(weighted), real=True)
        return cls(s, weighted, rfft(weighted @ plain[np.ix_(s.columns, moved)], size, axis=0), size)

    def score(self, drawn: FloatArray, k: int) -> FloatArray:
        """Return the score (k, draws) of noise (N, p, draws)."""
        out = np.zeros((k, drawn.shape[2]))
        out[self.s.columns] = np.einsum("iak,iab->kb", self.weighted, drawn, optimize=True)
        return out

    def variances(self, model: Autoregression) -> FloatArray:
        """Return this record's share (m,) of the variances of the estimates for residuals of the colour ``model``."""
        G = model.shaped(self.gain, self.size)
        power = np.sum((np.conj(G) * (model.S @ G)).real, axis=1)
        return np.asarray(sides(self.size) @ power / self.size)


def _drawn(model: Autoregression, residuals: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return noise (N, p, draws) of the colour ``model``, zero where a residual (N, p) is."""
    size = next_fast_len(2 * len(residuals), real=True)
    white = np.linalg.cholesky(model.S) @ rng.standard_normal((size, len(model.S), DRAWS))
    noise = irfft(np.linalg.solve(model.whitener(size), rfft(white, axis=0)), size, axis=0)[: len(residuals)]
    return np.asarray(np.where(residuals[:, :, None] == 0.0, 0.0, noise))


# --- what is doubtful about parameter estimates, and what to do about it ----------------------------------------------


_LOST = 1e-7  # smallest over largest singular value of the scaled sensitivities below which nothing is decided
_NAMED = 0.3  # share of a null direction that makes a parameter worth naming
_TOGETHER = 0.98  # correlation beyond which two estimates stand for one another
_VAGUE = 0.5  # standard error relative to the value
_MANY = 0.5  # share of the estimates that are vague beyond which the flight, not one small effect, is the reason
_EXACT = 1e-9  # median standard error relative to the value below which the records are free of noise
_BIASED = 5.0  # corrected over plain errors beyond which residuals are no noise but what the model misses (judged)
_FILTERED = ("equation_error", "recursive_fourier")  # whose derivatives colour the residuals of any flight
_WHY = {"not_converged": "the search did not converge", "on_bound": "{} ended on a bound"}


def null_directions(J: FloatArray, size: FloatArray, names: Sequence[str]) -> str:
    """Return in words the unknowns that the sensitivities J (N, k) do not decide; empty if all are decided."""
    dead = [name for name, s in zip(names, size, strict=True) if not s > 0.0]
    if dead:
        return ", ".join(dead)
    _, sigma, Vt = np.linalg.svd(np.linalg.qr(J / size, mode="r"))
    lost = Vt[sigma <= _LOST * sigma[0]]
    return ", ".join(name for name, column in zip(names, lost.T, strict=True) if np.any(np.abs(column) > _NAMED))


def own_poles(model: Any) -> NDArray[np.complex128]:
    """Return the poles (n,), rad/s, of a model without those of its servos.

    A delay that is estimated is a Pade approximation, with poles at 3.5 over the delay: fast, and nothing that moves.
    """
    A = model.linear().A
    n = len(model.structure.states) - len(model.structure.followers)
    return np.asarray(np.linalg.eigvals(A[:n, :n]), complex)


def advice_in_words(model: Any) -> Any:
    """Return the ParametricModel with one piece of advice per doubt that its diagnostics give rise to."""
    found = model.diagnostics
    out = AdviceList()
    names = [p.name for p in model.structure.parameters if p.free]
    free = model.structure.free
    values, errors = model.params[free], np.sqrt(np.diag(model.covariance))[free]
    if not found["converged"]:
        out.wrong(
            "not_converged",
            "the search did not converge: the estimates are not reliable; use other start values, fewer free "
            "parameters or more iterations",
        )
    if found["at_bound"]:
        out.wrong(
            "on_bound",
            f"{', '.join(found['at_bound'])} ended on a bound: the value is that of the bound, not of the data, and it "
            "has no standard error; widen the bound, or find out why the data lead beyond it",
        )
    if found.get("none_shows"):
        out.note(
            "none_shows",
            f"{', '.join(found['none_shows'])} ended at its smallest value: these data show no such time of a servo; "
            "leave it out, or give it as a number",
        )
    # Rounding of noise-free records says nothing of a true zero.
    constants = model.structure.trim_constants
    noisy = float(np.median(errors / np.maximum(np.abs(values), 1e-300))) > _EXACT
    vague = [
        f"{n} {with_error(float(v), float(e))}"
        for n, v, e in zip(names, values, errors, strict=True)
        if noisy and e > _VAGUE * abs(v) and e > 0.0 and n not in constants
    ]
    if vague:
        asked = sum(n not in constants for n in names)
        rank = doubt if len(vague) > _MANY * asked else note  # an error that is stated misleads nobody
        out.append(
            rank(
                "weakly_identifiable",
                (
                    f"these data give little information on {', '.join(vague)}: fix them at prior values, or excite "
                    "them more"
                ),
            )
        )
    fast = [abs(s) for s in own_poles(model) if abs(s) > np.pi / model.dt_s]
    if fast:
        out.doubt(
            "beyond_nyquist",
            f"poles of {', '.join(f'{w:.4g}' for w in fast)} rad/s lie beyond the Nyquist frequency of "
            f"{np.pi / model.dt_s:.4g} rad/s: these samples show only that they are fast; fix the parameters that "
            "make them so",
        )
    correlation = np.abs(np.triu(found["correlation"], 1))
    pairs = [f"{names[i]} and {names[j]} ({correlation[i, j]:.3f})" for i, j in np.argwhere(correlation > _TOGETHER)]
    if pairs:
        out.doubt(
            "correlated_estimates",
            f"these data do not separate these estimates (correlation): {', '.join(pairs)}; fix one of each pair, or "
            "excite them separately",
        )
    coloured = [o for o, p in zip(model.outputs, found["whiteness_p"], strict=True) if p < WHITE]
    if coloured:
        inflation = np.asarray(found["error_inflation"])
        factor = float(np.max(inflation))
        # a constant takes up every drift, which need not touch the derivatives
        slopes = np.array([0.0 if n in constants else 1.0 for n in names]) * inflation
        # a correction of errors that are not to be believed would lend them weight
        why = [_WHY[a.code].format(", ".join(found["at_bound"])) for a in out if a.code in _WHY]
        if why:
            errors_hold = f"the standard errors are not reliable, because {' and '.join(why)}"
        elif np.max(slopes) > _BIASED and model.method not in _FILTERED:
            worst, most = names[int(np.argmax(slopes))], float(np.max(slopes))
            errors_hold = (
                f"so much so (a factor {most:.2g} in the error of {worst}) as if a term of the model were missing, "
                "which biases the estimates beyond any standard error: the errors are not reliable unless the "
                "sensors' noise itself is that slow"
            )
        else:
            errors_hold = f"standard errors are corrected for it, by up to a factor {factor:.2g}"
        own = model.method in _FILTERED and not why
        out.append(
            (note if own else doubt)(
                "coloured_residuals",
                f"the residuals of {', '.join(coloured)} are not white (turbulence, filtered noise or missing terms of "
                f"the model): {errors_hold}",
            )
        )
    return replace(model, advice=tuple(out))


# --- the accuracy of estimates ----------------------------------------------------------------------------------------


WHITENESS_LAGS = 20
_ROUNDING = 1e-9  # residuals below this share of an output's size say nothing about noise


class Accuracy(NamedTuple):
    """Covariances (k, k) for residuals taken as white and corrected for their colour; condition of the scaled J."""

    plain: FloatArray
    corrected: FloatArray
    condition: float


def accuracy(
    residuals: Sequence[FloatArray],
    sensitivities: Callable[[], Iterable[Sensitivities]],
    R: FloatArray,
    prior_weight: FloatArray,
    moving: NDArray[np.bool_],
    names: Sequence[str],
    alone: NDArray[np.bool_] | None = None,
) -> Accuracy:
    """Return the covariances of unknowns whose residuals have covariance R.

    Args:
        residuals: per record (N, p); zero where not valid.
        sensitivities: called two or three times; gives those of each record, zero where not valid.
        R: (p, p) covariance of the residuals.
        prior_weight: (k,) one over the standard deviation of the prior, 0 without one.
        moving: (k,) False for unknowns on a bound, which get zero variance.
        names: (k,) names of the unknowns.
        alone: (k,) unknowns that only one record feels; none if not given.

    Raises:
        EstimationError: no output feels an unknown or a combination of them; they are named.
    """
    k = moving.size
    alone = np.zeros(k, bool) if alone is None else alone
    whiten = np.linalg.inv(np.linalg.cholesky(R))
    believed = np.flatnonzero((prior_weight > 0.0) & ~alone)

    def parts() -> Iterator[tuple[Iterable[FloatArray], NDArray[np.intp]]]:
        for v, s in zip(residuals, sensitivities(), strict=True):
            rows = chain(in_blocks(v, s, whiten), believed_alone(s.columns, prior_weight, alone))
            yield rows, np.append(s.columns, k)
        yield [np.diag(np.append(prior_weight[believed], 0.0))], np.append(believed, k)

    J = square_root(parts(), np.append(alone, False))[:, :-1][:, moving]
    size = np.sqrt(np.sum(J**2, axis=0))
    lost = null_directions(J, size, [name for name, m in zip(names, moving, strict=True) if m])
    if lost:
        raise EstimationError(
            f"these data do not separate {lost}, or do not contain them: not identifiable; fix or leave out some of "
            "them, or fly an input that moves them"
        )
    scaled = np.linalg.qr(J / size, mode="r")
    inverse = np.linalg.inv(scaled) / size[:, None]
    plain = np.zeros((k, k))
    plain[np.ix_(moving, moving)] = inverse @ inverse.T
    corrected = coloured_covariance(residuals, sensitivities, R, plain, prior_weight)
    return Accuracy(plain, corrected, float(np.linalg.cond(scaled)))


def coloured_covariance(
    residuals: Sequence[FloatArray],
    sensitivities: Callable[[], Iterable[Sensitivities]],
    R: FloatArray,
    plain: FloatArray,
    prior_weight: FloatArray,
) -> FloatArray:
    """Return the covariance (k, k) of unknowns whose residuals are as coloured as these, weighed by their covariance R.

    Args:
        residuals: per record (N, p); zero where not valid.
        sensitivities: gives those of each record, zero where not valid.
        R: (p, p) covariance of the residuals.
        plain: (k, k) covariance of the unknowns if the residuals were white.
        prior_weight: (k,) one over the standard deviation of the prior, 0 without one.
    """
    colour, inverse, score = Colour.of(residuals), np.linalg.inv(R), np.zeros_like(plain)
    for s in sensitivities():
        score[np.ix_(s.columns, s.columns)] += colour.score(inverse @ s.values)
    wider = np.sqrt(shortfall(residuals, sensitivities, R, plain, colour))
    noise = corrected_covariance(plain, 0.5 * (score + score.T)) * np.outer(wider, wider)
    return np.asarray(noise + plain @ np.diag(prior_weight**2) @ plain)


def correlations(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix; rows of zero variance are zero."""
    std = np.sqrt(np.diag(covariance))
    inverse = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0.0)
    return np.asarray(covariance * np.outer(inverse, inverse))


def whiteness(
    residuals: Sequence[FloatArray], valid: Sequence[NDArray[np.bool_]], size: FloatArray, R: FloatArray
) -> FloatArray:
    """Return per output the probability that white residuals are as correlated as the worst record's; 1 for rounding.

    Args:
        residuals: per record (N, p).
        valid: per record (N, p), which of them count.
        size: (p,) standard deviation of the outputs.
        R: (p, p) covariance of the residuals.
    """
    out = np.ones(size.size)
    for o in np.flatnonzero(np.sqrt(np.diag(R)) > _ROUNDING * size):
        tests = []
        for v, good in zip(residuals, valid, strict=True):
            counting = v[good[:, o], o]
            if counting.size >= 8:
                tests.append(ljung_box(counting, min(WHITENESS_LAGS, counting.size // 4)))
        out[o] = min(1.0, min(tests, default=1.0) * len(tests))  # Bonferroni: the worst of several records
    return out


# --- which parameters records ask for ---------------------------------------------------------------------------------


def chosen(
    structure: ModelStructure,
    held: Mapping[str, float],
    records: Sequence[FlightRecord],
    fit: Callable[[ModelStructure], ParametricModel],
) -> ParametricModel:
    """Return the fit of a structure of which only those parameters are estimated that the records ask for.

    All are estimated first. Then the one that differs least from what it is held at, by its standard error, is held
    there and the rest is fitted again, as long as that raises the evidence (G. Schwarz, Annals of Statistics 6, 1978):
    z^2 < log N_e, N_e the samples over the square by which its error is widened for coloured residuals.

    Args:
        structure: with all parameters free that may be estimated.
        held: name -> value at which a parameter is held that is not asked for; others always stay.
        records: that it is fitted to.
        fit: fits a structure to them.

    Raises:
        EstimationError: the records do not decide all parameters.
    """
    model = fit(structure)
    samples = sum(float(np.sum(r.select(structure.outputs).valid.any(axis=1))) for r in records)
    gone = dict[str, float]()
    while True:
        names = [p.name for p in structure.parameters if p.free]
        errors, plain = model.standard_errors, np.sqrt(np.diag(model.covariance_plain))
        at = structure.parameter_names.index
        weak = {
            n: ((model.values[n] - held[n]) / errors[n]) ** 2
            - np.log(max(samples * (plain[at(n)] / errors[n]) ** 2, np.e))
            for n in names
            if n in held and errors[n] > 0.0
        }
        weakest = min(weak, key=lambda n: weak[n], default=None)
        if weakest is None or weak[weakest] >= 0.0 or len(names) == 1:
            break
        gone[weakest] = held[weakest]
        structure = structure.with_parameters({**{n: model.values[n] for n in names}, **gone}, fixed=gone)
        model = fit(structure)
    said = "the records support every parameter of the structure"
    if gone:
        those = ", ".join(f"{n} = {v:g}" for n, v in gone.items())
        said = f"the records do not support {those}, fixed there; the other errors do not include the choice"
    return replace(model, advice=ranked((*model.advice, note("structure_chosen", said))))
