"""Equation error in the time domain: linear least squares with errors that count the colour of the residuals.

E. A. Morelli, V. Klein, "Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data", Journal of
Guidance, Control, and Dynamics 20(1), 1997; V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, ch. 5.

Whether the data can decide the terms of a regression: excitation, collinearity, and noise in the terms.

Linear models of motion from equation error: x' = A x + B u + offset, one regression per state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, Advised, doubt, ranked
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.coverage import approximate
from testbench.estimators.model import ComplexArray
from testbench.estimators.regression.data import BIAS, RegressionData, check_terms, factors
from testbench.estimators.regression.result import RegressionResult
from testbench.estimators.regression.smoothing import noise_level

# --- whether the data can decide the terms of a regression ------------------------------------------------------------


_STILL = 1e-12  # a term that moves less than this share of its size does not move
_DEFICIENT = 1e-9  # singular values below this share of the largest are zero: rounding of centred terms
_VIF = 10.0  # customary limit (Montgomery, Peck, Vining, Introduction to Linear Regression Analysis)
_SHARE = 0.1  # entries of a null vector below this are not part of the dependence
_ATTENUATION = 0.02  # bias from noise in a term worth mentioning
_NOISY = 0.01  # noise over motion of a term that biases a regression over a band by more than its errors
_T = 2.0
_LEAST = 16
_R2 = 0.5


class Diagnostics(NamedTuple):
    """Collinearity of the terms."""

    vif: FloatArray  # (k,)
    correlation: FloatArray  # (k', k') without the constant
    condition: float


def _centred(X: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the terms without the constant, centred if there is one, scaled to unit length."""
    keep = [i for i, name in enumerate(names) if name != BIAS]
    Z = X[:, keep]
    if len(keep) < len(names):
        Z = Z - Z.mean(axis=0)
    size = np.linalg.norm(Z, axis=0)
    return np.asarray(Z / np.where(size > 0.0, size, 1.0))


def diagnose(X: FloatArray, names: Sequence[str]) -> Diagnostics:
    """Return variance inflation factors, correlations and the condition number of the terms."""
    Z = _centred(X, names)
    vif = np.ones(len(names))
    keep = [i for i, name in enumerate(names) if name != BIAS]
    if not keep:
        return Diagnostics(vif, np.zeros((0, 0)), 1.0)
    _, s, Vt = np.linalg.svd(Z, full_matrices=False)
    floor = max(float(s[0]) * np.finfo(float).eps, np.finfo(float).tiny)
    s = np.maximum(s, floor)  # finite where only a prior decides
    vif[keep] = np.sum((Vt.T / s) ** 2, axis=1)
    return Diagnostics(vif, Z.T @ Z, float(s[0] / s[-1]))


def refuse_deficient(X: FloatArray, names: Sequence[str], weight: FloatArray) -> None:
    """Check that data and prior decide every term; ``weight`` (k,) is positive where there is a prior.

    Raises:
        EstimationError: names the terms that do not move, or that are linear combinations of each other.
    """
    free = [i for i in range(len(names)) if weight[i] == 0.0]
    with_bias = BIAS in names
    for i in free:
        column = X[:, i]
        moved = float(np.ptp(column)) if with_bias else float(np.max(np.abs(column)))
        if names[i] != BIAS and moved <= _STILL * float(np.max(np.abs(column))):
            what = "never moves in these records" if with_bias else "is zero throughout these records"
            raise EstimationError(
                f"term '{names[i]}' {what}: its effect is not identifiable; excite it, leave it out, or give a prior"
            )
    chosen = [names[i] for i in free]
    Z = _centred(X[:, free], chosen)
    if Z.shape[1] < 2:
        return
    _, s, Vt = np.linalg.svd(Z, full_matrices=False)
    if s[-1] > _DEFICIENT * s[0]:
        return
    null = Vt[s <= _DEFICIENT * s[0]]
    moving = [name for name in chosen if name != BIAS]
    tied = [name for name, share in zip(moving, np.max(np.abs(null), axis=0), strict=True) if share > _SHARE]
    raise EstimationError(
        f"terms must be linearly independent, but {', '.join(tied)} depend on each other "
        f"(condition number {s[0] / max(float(s[-1]), 1e-300):.1e}); leave one out, excite them separately, "
        "or give a prior"
    )


def advise(
    records: Sequence[RegressionData],
    target: str,
    names: Sequence[str],
    theta: FloatArray,
    std: FloatArray,
    r2: float,
    found: Diagnostics,
) -> tuple[Advice, ...]:
    """Return what is doubtful about a fit and what to do about it, in sentences."""
    out = []
    moving = [name for name in names if name != BIAS]
    for i, name in enumerate(names):
        if found.vif[i] > _VIF:
            row = np.abs(found.correlation[moving.index(name)]) - np.eye(len(moving))[moving.index(name)]
            partner = moving[int(np.argmax(row))]
            out.append(
                doubt(
                    "collinear_terms",
                    f"{name}: nearly a combination of the other terms (variance inflation {found.vif[i]:.0f}, most "
                    f"like {partner}, correlation {row.max():.3f}), so that its estimate depends on theirs; excite "
                    "them separately, fix one by a prior or leave one out",
                )
            )
    for i, name in enumerate(names):
        if name != BIAS and abs(theta[i]) < _T * std[i]:
            out.append(
                doubt(
                    "weakly_identifiable",
                    f"{name}: {theta[i]:.3g} is within two standard errors ({std[i]:.2g}) of zero: these data do not "
                    "decide it; excite it more or leave it out",
                )
            )
    biased = False
    for name, share in _attenuation(records, names, found).items():
        if share > _ATTENUATION:
            out.append(
                doubt(
                    "noisy_terms",
                    f"{name}: noise in the signal draws its estimate towards zero by about {100 * min(share, 1.0):.0f} "
                    "%; smooth the record first or regress in the frequency domain over the band of the manoeuvre",
                )
            )
            biased = True
    if biased:
        out.extend(approximate("regression", "standard errors do not count noise in the terms, and"))
    if r2 < _R2:
        out.append(
            doubt(
                "little_explained",
                f"{target}: the terms explain {100 * max(r2, 0.0):.0f} % of it; look for terms that are missing, "
                "or for more excitation",
            )
        )
    return tuple(out)


def noisy_terms(records: Sequence[RegressionData], names: Sequence[str]) -> tuple[Advice, ...]:
    """Return, for a regression over a band, how far its errors can be believed if a term holds much noise."""
    for name in names:
        if len(factors(name)) != 1 or factors(name)[0][1] != 1:
            continue
        for record in records:
            y = record[name][record.sampled([name])]
            if y.size >= _LEAST and noise_level(y) > _NOISY * float(np.std(y)):
                of = f"noise in {name} biases the estimates, standard errors do not count it, and the"
                return tuple(doubt("noisy_terms", said) for said in approximate("regression", of))
    return ()


def _attenuation(records: Sequence[RegressionData], names: Sequence[str], found: Diagnostics) -> dict[str, float]:
    """Return the share by which white noise in plain signals biases their own estimates: VIF x noise / variance."""
    out = {}
    for i, name in enumerate(names):
        if name == BIAS or len(factors(name)) != 1 or factors(name)[0][1] != 1:
            continue
        noise, spread, count = 0.0, 0.0, 0
        for record in records:
            y = record[name][record.sampled([name])]
            if y.size >= _LEAST:
                noise += y.size * noise_level(y) ** 2
                spread += y.size * float(np.var(y))
                count += y.size
        if count and spread > 0.0:
            out[name] = float(found.vif[i]) * noise / spread
    return out


# --- equation error in the time domain --------------------------------------------------------------------------------


_CONFLICT = 3.0  # standard deviations between prior and data worth mentioning


class Block(NamedTuple):
    """One record's part of a regression; rows that are not used are zero in X and y, so that lags stay lags."""

    X: FloatArray  # (n, k)
    y: FloatArray  # (n,)
    used: NDArray[np.bool_]  # (n,)


def equation_error(
    data: RegressionData | Sequence[RegressionData],
    target: str,
    terms: Sequence[str],
    *,
    bias: bool = True,
    prior: Mapping[str, tuple[float, float]] | None = None,
    finite_record: bool = True,
) -> RegressionResult:
    """Fit target = sum of parameter x term by ordinary least squares over all records.

    theta = (X'X)^-1 X'y, plain covariance s^2 (X'X)^-1 with s^2 = v'v / (N - k), v = y - X theta. The corrected
    covariance is (X'X)^-1 [sum_i x(i) sum_j R(i - j) x(j)'] (X'X)^-1, R(l) = sum_i v(i) v(i + l) / N the
    autocorrelation of the residuals at all lags within a record (Morelli and Klein 1997). It counts the colour of
    residuals from noise and from effects left out, not the bias of noisy terms (which the advice estimates). As printed
    it comes out low, because the fit takes the terms' share out of the residuals: by 6 to 14 % of the error in a record
    of 12 s with 0.3 Hz motion, and for the constant, which takes all of their mean, by half. ``finite_record`` makes
    up for that: exactly for white residuals, and for others as far as they are level over the frequencies of the terms.

    A sample is used if target and terms were all really sampled.

    Args:
        data: signals of one or several records (see ``regression_data``).
        target: signal to explain, e.g. "CZ" or "qdot".
        terms: signals and products of their powers, e.g. "alpha", "alpha^2", "alpha*q_hat".
        bias: add a constant, called "1".
        prior: term -> (value, standard deviation), known beforehand (mixed estimation: H. Theil, A. S. Goldberger,
            1961): theta = (X'X + s^2 c W)^-1 (X'y + s^2 c W theta_0), W the inverse of the prior's variances, s^2
            and the mean ratio c >= 1 of corrected to plain variance from the data alone. A prior may decide what the
            data cannot.
        finite_record: make up for the part that the fit takes out of the residuals; False for the formula as printed.

    Raises:
        EstimationError: no record, terms that repeat or cannot be read, too few samples, terms that do not move or that
            are linear combinations of each other (named), or a prior against the laws above.
        ChannelError: a signal is not there.
    """
    records = as_records(data)
    names = (*check_terms([t for t in terms if t != BIAS]), *((BIAS,) if bias else ()))
    weight, value = _prior(prior or {}, names)
    blocks = [block(record, target, names) for record in records]
    X, y = stack(blocks)
    require_samples(len(y), names, target)
    refuse_deficient(X, names, weight)
    theta, plain, covariance, conflict = _solve(blocks, X, y, weight, value, finite_record)
    v = y - X @ theta
    about = y - y.mean() if bias else y
    energy = float(about @ about)
    std_plain, std = np.sqrt(np.diag(plain)), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    diagnostics = diagnose(X, names)
    rms = float(np.sqrt(v @ v / len(y)))
    r2 = 1.0 - float(v @ v) / energy if energy > 0.0 else 0.0
    found = advise(records, target, names, theta, std, r2, diagnostics)
    found += tuple(
        doubt(
            "prior_conflict",
            f"{name}: data and prior differ by {far:.1f} standard deviations of their difference; check the units and "
            "sign of the prior, or look for effects that are missing",
        )
        for name, far in zip(names, conflict, strict=True)
        if far > _CONFLICT
    )
    lag_products = autocorrelation(blocks, theta)
    return RegressionResult(
        target=target,
        terms=names,
        params=theta,
        covariance=covariance,
        std_plain=std_plain,
        std_corrected=std,
        r2=r2,
        residual_rms=rms,
        autocorrelation=lag_products / lag_products[0] if lag_products[0] > 0.0 else np.eye(1, lag_products.size)[0],
        vif=diagnostics.vif,
        correlation=diagnostics.correlation,
        condition=diagnostics.condition,
        samples=len(y),
        dt_s=records[0].dt_s,
        recipe=records[0].recipe,
        settings={
            "bias": bias,
            "prior": {k: list(v) for k, v in (prior or {}).items()},
            "finite_record": finite_record,
            "records": len(records),
        },
        advice=found,
    )


def as_records(data: RegressionData | Sequence[RegressionData]) -> list[RegressionData]:
    """Return the records as a list after checking that there are some, of one sample time.

    Raises:
        EstimationError: no record, or different sample times.
    """
    records = [data] if isinstance(data, RegressionData) else list(data)
    if not records:
        raise EstimationError("a regression needs at least one record, got none")
    steps = [record.dt_s for record in records]
    if max(steps) - min(steps) > 0.01 * min(steps):
        raise EstimationError(
            f"records must share one sample time, got {min(steps):g} to {max(steps):g} s; resample them"
        )
    return records


def block(record: RegressionData, target: str, names: Sequence[str]) -> Block:
    """Return a record's rows, zero where something was not sampled.

    Raises:
        EstimationError: the target is among the terms.
        ChannelError: a signal is not there.
    """
    if any(name == target for term in names for name, _ in factors(term)):
        raise EstimationError(f"the target must not explain itself, got '{target}' among the terms; leave it out")
    used = record.sampled([target, *names])
    return Block(record.matrix(names) * used[:, None], record[target] * used, used)


def stack(blocks: Sequence[Block]) -> tuple[FloatArray, FloatArray]:
    """Return the rows that are used, of all records."""
    return np.vstack([b.X[b.used] for b in blocks]), np.concatenate([b.y[b.used] for b in blocks])


def require_samples(count: int, names: Sequence[str], target: str) -> None:
    """Check that there are at least twice as many samples as parameters.

    Raises:
        EstimationError: there are fewer.
    """
    if count < 2 * len(names):
        raise EstimationError(
            f"least squares of '{target}' needs at least twice as many samples as its {len(names)} parameters, "
            f"got {count} with all signals sampled; give more data or fewer terms"
        )


def _prior(prior: Mapping[str, tuple[float, float]], names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return inverse variances (zero without prior) and values, (k,) each."""
    weight, value = np.zeros(len(names)), np.zeros(len(names))
    for term, (mean, std) in prior.items():
        if term not in names:
            raise EstimationError(f"a prior must be on a term, got one on '{term}'; the terms are {', '.join(names)}")
        if not (np.isfinite(mean) and 0.0 < std < np.inf):
            raise EstimationError(f"a prior is (value, standard deviation > 0), got {mean}, {std} for '{term}'")
        weight[names.index(term)], value[names.index(term)] = 1.0 / std**2, mean
    return weight, value


class _Solution(NamedTuple):
    theta: FloatArray
    plain: FloatArray  # (k, k)
    corrected: FloatArray  # (k, k)
    conflict: FloatArray  # (k,) distance of data and prior in standard deviations of their difference; 0 without prior


def _solve(
    blocks: Sequence[Block],
    X: FloatArray,
    y: FloatArray,
    weight: FloatArray,
    value: FloatArray,
    finite_record: bool,
) -> _Solution:
    """Return estimates and covariances; the residuals of the data alone, unique at any rank, tell noise and colour."""
    n, k = X.shape
    size = np.linalg.norm(X, axis=0)
    size[size == 0.0] = 1.0  # only a prior can hold such a term
    Z = X / size
    U, s, Vt = np.linalg.svd(Z, full_matrices=False)
    keep = s > np.finfo(float).eps * max(n, k) * s[0]
    inverse = Vt[keep].T / s[keep]
    theta = inverse @ (U[:, keep].T @ y)
    theta = theta + inverse @ (U[:, keep].T @ (y - Z @ theta))  # one step of refinement
    v = y - Z @ theta
    rank = int(keep.sum())
    s2 = float(v @ v) / (n - rank)
    S = coloured(blocks, theta / size, size)
    H = inverse @ inverse.T
    scale = np.outer(size, size)
    corrected = H @ S @ H
    if finite_record and rank == k:
        factor = _finite_record(blocks, size, inverse)
        corrected = corrected * np.sqrt(np.outer(factor, factor))
        S = (Z.T @ Z) @ corrected @ (Z.T @ Z)
    conflict = np.zeros(k)
    if weight.any():
        W, goal = weight / size**2, value * size
        if rank == k:
            apart = np.abs(theta - goal)[W > 0.0]
            conflict[W > 0.0] = apart / np.sqrt(np.diag(corrected)[W > 0.0] + 1.0 / W[W > 0.0])
        rho = max(float(np.trace(H @ S)) / rank, s2)
        A = Z.T @ Z
        H = np.linalg.inv(A + rho * np.diag(W))
        theta = H @ (Z.T @ y + rho * W * goal)
        corrected = H @ (S + rho**2 * np.diag(W)) @ H
    return _Solution(theta / size, s2 * H / scale, 0.5 * (corrected + corrected.T) / scale, conflict)


def coloured(blocks: Sequence[Block], theta: FloatArray, size: FloatArray) -> FloatArray:
    """Return sum_i sum_j x(i) R(i - j) x(j)' (k, k) over the records, x divided by ``size``.

    R is a convolution kernel, so the double sum is one over frequencies of transforms padded to twice the length.
    """
    R = autocorrelation(blocks, theta)
    length = _padded(blocks)
    kernel = np.zeros(length)
    kernel[: R.size] = R
    kernel[length - R.size + 1 :] = R[1:][::-1]
    power = np.fft.rfft(kernel).real * _both_sides(length)
    out = np.zeros((len(size), len(size)))
    for b in blocks:
        F = np.fft.rfft(b.X / size, length, axis=0)
        out += np.real(np.conj(F).T @ (F * power[:, None])) / length
    return out


def _finite_record(blocks: Sequence[Block], size: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return (k,) by how much the corrected variances come out low because k parameters were fitted.

    The fit takes the share p(f) = sum_j |U_j(f)|^2 / N out of the residuals' spectrum, U the orthonormal terms: for
    white noise E S_v(f) = S (1 - p(f)). The variance of a parameter is a mean of the spectrum with weights W(f), so
    that sum W / sum W (1 - p) makes it unbiased for noise that is level over what W covers.
    """
    length = _padded(blocks)
    total = sum(int(b.used.sum()) for b in blocks)
    sides = _both_sides(length)
    share = np.zeros(sides.size)
    W = np.zeros((sides.size, len(size)))
    for b in blocks:
        F = np.fft.rfft(b.X / size, length, axis=0) @ inverse
        share += np.sum(np.abs(F) ** 2, axis=1) / total
        W += np.abs(F @ inverse.T) ** 2 * sides[:, None]
    return np.asarray(np.sum(W, axis=0) / np.sum(W * (1.0 - share)[:, None], axis=0))


def _padded(blocks: Sequence[Block]) -> int:
    return 1 << (2 * max(len(b.y) for b in blocks) - 1).bit_length()


def _both_sides(length: int) -> FloatArray:
    """Return how often each line of a real transform counts in a sum over positive and negative frequencies."""
    out = np.full(length // 2 + 1, 2.0)
    out[[0, -1]] = 1.0
    return out


def autocorrelation(blocks: Sequence[Block], theta: FloatArray) -> FloatArray:
    """Return R(l) = sum of v(i) v(i + l) within records / N, (n,) of the longest record, N the samples used."""
    length = _padded(blocks)
    power = np.zeros(length // 2 + 1)
    for b in blocks:
        v = np.where(b.used, b.y - b.X @ theta, 0.0)
        power += np.abs(np.fft.rfft(v, length)) ** 2
    total = np.fft.irfft(power, length)[: max(len(b.y) for b in blocks)]
    return np.asarray(total / sum(int(b.used.sum()) for b in blocks))


# --- linear models of motion from equation error ----------------------------------------------------------------------


_RATES = {"alpha": "alphadot", "beta": "betadot", "p": "pdot", "q": "qdot", "r": "rdot"}


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModel(Advised):
    """x' = A x + B u + offset in SI units.

    Attributes:
        states: (n,) names.
        inputs: (m,) names.
        A: (n, n), rad and s.
        B: (n, m).
        offset: (n,).
        A_std: (n, n) standard errors, corrected for coloured residuals.
        B_std: (n, m).
        results: (n,) regressions of the state derivatives.
        advice: that of all regressions; ``status`` follows from it.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    offset: FloatArray
    A_std: FloatArray
    B_std: FloatArray
    results: tuple[RegressionResult, ...]
    advice: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("A", "B", "offset", "A_std", "B_std"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def poles(self) -> ComplexArray:
        """Return the eigenvalues of A, rad/s, by magnitude."""
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        return found[np.lexsort((found.imag, np.abs(found)))]


def linear_model(
    data: RegressionData | Sequence[RegressionData], *, states: Sequence[str], inputs: Sequence[str]
) -> LinearModel:
    """Regress each state's derivative on all states and inputs, e.g. ("alpha", "q") on ("de",): the short period.

    Args:
        data: signals of one or several records.
        states: some of alpha, beta, p, q, r.
        inputs: controls.

    Raises:
        EstimationError: a state without a derivative in the table, or against ``equation_error``.
        ChannelError: a signal is not there.
    """
    for state in states:
        if state not in _RATES:
            raise EstimationError(f"states must be some of {', '.join(_RATES)}, got '{state}'")
    terms = [*states, *inputs]
    results = tuple(equation_error(data, _RATES[state], terms) for state in states)
    if not results:
        raise EstimationError("a linear model needs at least one state, got none")
    n = len(states)
    params, std = np.array([r.params for r in results]), np.array([r.std_corrected for r in results])
    advice = tuple(a.about(r.target) for r in results for a in ranked(r.advice))
    return LinearModel(
        states=tuple(states),
        inputs=tuple(inputs),
        A=params[:, :n],
        B=params[:, n:-1],
        offset=params[:, -1],
        A_std=std[:, :n],
        B_std=std[:, n:-1],
        results=results,
        advice=advice,
    )
