"""Which terms of a vocabulary the felt coefficients follow: forward selection with control of false discoveries.

Each coefficient is regressed by generalised least squares: what noise of the sensors makes of its error is coloured,
and its autocovariance is that of the copies' scatter. Beside every term stand a constant for each record (biases are
not known) and the coefficients of the model that are re-tuned within their priors. Noise is in the regressors G, too,
and is correlated with that of the errors y. The copies say how much of the moments it makes, so that is taken out of
them (W. A. Fuller, Measurement Error Models, 1987, section 2.2):

    b = (G'G - S_gg)^-1 (G'y - S_gy),    S_gy = mean over copies of (G_j - G)' (y_j - y).

Of all terms of all coefficients the one of the largest t enters, as long as its p, the k-th of m, holds

    p <= k q / (m + 1 - k (1 - q)),

which keeps the expected share of false terms below q (Y. Benjamini and Y. Gavrilov, Annals of Applied Statistics 3,
2009, pp. 179-198), and as long as it gains more than noise ever does.

The vocabulary that missing forces and moments are sought in: products and powers of motion and controls, lags, time.

A term is a product of factors, each of which is a quantity of the flight that JSBSim knows as well, so that whatever is
found can be added to the model (:mod:`testbench.questions.gap.open_set`). Quantities are without unit: angles in rad,
rates times b/2V or cbar/2V, the throttle from 0 to 1, the airspeed as its deviation from the
aircraft's design speed over that speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.signal import firwin
from scipy.stats import norm

from testbench.core.record import FloatArray
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.felt import Felt
from testbench.sensors.sensor import first_order_lag

CONTROLS = ("de", "da", "dr", "thr")
_LONGITUDINAL = ("alpha", "q", "alphadot", "V", "de", "thr")
_LATERAL = ("beta", "p", "r", "da", "dr")
_LAGS_S = (0.05, 0.1, 0.2, 0.4)
_CUBED = ("alpha", "beta", "de", "da", "dr")
TIME = "t"


@dataclass(frozen=True)
class Factor:
    """A quantity, or its modulus; of a control also what it was, less what it is, through a lag of ``lag_s``."""

    quantity: str
    modulus: bool = False
    lag_s: float = 0.0

    @property
    def label(self) -> str:
        """As in a formula."""
        if self.lag_s:
            return f"({self.quantity} lagged by {self.lag_s:g} s - {self.quantity})"
        return f"|{self.quantity}|" if self.modulus else self.quantity


@dataclass(frozen=True)
class Term:
    """A product of factors."""

    factors: tuple[Factor, ...]

    @property
    def label(self) -> str:
        """As in a formula, such as "alpha*thr", "beta^3", "|dr|"."""
        out = []
        for factor in dict.fromkeys(self.factors):
            power = self.factors.count(factor)
            out.append(factor.label if power == 1 else f"{factor.label}^{power}")
        return "*".join(out)

    @property
    def quantities(self) -> frozenset[str]:
        """What it depends on."""
        return frozenset(f.quantity for f in self.factors)


def vocabulary(lateral: bool, controls: frozenset[str]) -> tuple[Term, ...]:
    """Return the terms.

    Args:
        lateral: whether lateral motion was recorded.
        controls: those that the aircraft has and a record moves.
    """
    known = [n for n in (*_LONGITUDINAL, *(_LATERAL if lateral else ())) if n not in CONTROLS or n in controls]
    plain = {n: Factor(n) for n in known}
    size = {n: Factor(n, True) for n in known if n in _LATERAL}
    terms = [Term((plain[n],)) for n in known]
    terms += [Term((f,)) for f in size.values()]
    terms += [
        Term((plain[a], plain[b])) for a, b in combinations_with_replacement(known, 2) if "alphadot" not in (a, b)
    ]
    terms += [Term((plain[n], f)) for n, f in size.items()]
    terms += [Term((plain[n],) * 3) for n in known if n in _CUBED]
    terms += [Term((Factor(n, lag_s=lag),)) for n in known if n in CONTROLS for lag in _LAGS_S]
    return (*terms, Term((Factor(TIME),)))


def quantities(believed: Believed, felt: Felt) -> Mapping[str, FloatArray]:
    """Return quantity -> its values in every version (versions, n) of a motion; surfaces are those of the model."""
    state, geometry = felt.motion.state, believed.aircraft.geometry
    V = state["V"]
    out = {n: state[n] for n in ("alpha", "beta")}
    out |= {n: state[n] * geometry.b_m / (2.0 * V) for n in "pr"}
    out["q"] = state["q"] * geometry.cbar_m / (2.0 * V)
    u, w = V * np.cos(state["alpha"]), V * np.sin(state["alpha"])  # over cos(beta), which the ratio does not see
    rate = (u * state["wdot"] - w * state["udot"]) / (u * u + w * w)
    out["alphadot"] = rate * geometry.cbar_m / (2.0 * V)
    out["V"] = V / believed.aircraft.design_V_m_s - 1.0
    out |= {n: felt.surfaces[n] for n in CONTROLS if n in felt.surfaces}
    out[TIME] = np.broadcast_to(felt.motion.record.t_s - felt.motion.record.t_s[0], V.shape)
    return out


def columns(terms: tuple[Term, ...], known: Mapping[str, FloatArray], dt_s: float) -> FloatArray:
    """Return the terms' values (versions, n, terms) of quantities (versions, n), ``dt_s`` apart."""
    made: dict[Factor, FloatArray] = {}
    for factor in dict.fromkeys(f for t in terms for f in t.factors):
        x = known[factor.quantity]
        if factor.lag_s:
            made[factor] = np.stack([first_order_lag(each, dt_s, factor.lag_s) - each for each in x])
        else:
            made[factor] = np.abs(x) if factor.modulus else x
    return np.stack([np.prod([made[f] for f in t.factors], axis=0) for t in terms], axis=-1)


COPIES = 8
_CUTOFF_HZ = 5.0  # motion of rigid aircraft is slower
_OF_RATE = 0.1  # share of the sample rate up to which derivatives and means are right
_PER_CUTOFF = 2.5  # samples a second over the cut-off, once what is faster is filtered out
_COLOUR_S = 3.0  # over which noise of the felt coefficients may be correlated
_RELIABLE = 0.5  # share of a term's variance that noise may make up; one that noise moves says nothing
_LEFT = 0.01  # share of a term's square about its means that must be left beside the others: equations are not exact
_SEEN = 1e-3  # of the noise: a coefficient that moves an error by less is not in it
_SINGULAR = 1e-9  # smallest eigenvalue of a correlation that is inverted
_FOLLOWS = 0.1  # in proportion to a quantity but for so much, rms
_INDISTINCT = 12  # terms in the place of another: with more these flights tell nothing of it
_TRUE = 0.7  # share of what is left of a term beside the others that must not be noise
_MOST = 6  # terms
_START_S = 0.3  # of each record is left out: servos and engines settle


@dataclass(frozen=True)
class FoundTerm:
    """A term that the felt coefficients follow.

    Attributes:
        coefficient: which.
        term: which.
        size: multiple of the term that is added to the coefficient.
        error: standard error of ``size``.
        share: of the energy of the coefficient's error above noise that all of its terms so far explain.
        instead: (term, size) of those that explain nearly as much in its place, best first: these flights do not tell
            them apart from it.
    """

    coefficient: str
    term: Term
    size: float
    error: float
    share: float
    instead: tuple[tuple[Term, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Regression:
    """What regression found.

    Attributes:
        terms: found, in the order in which they entered.
        tried: number of terms of all coefficients that these flights move.
        excess: coefficient -> chi-square of its error over the number of samples, coefficients re-tuned, no term.
        left: the same with the terms.
        factors: coefficient of the model that is re-tuned -> (factor, standard error) beside the terms, the prior left
            out; where several coefficients felt tell of one, as the surest of them does. Only those of one variable.
    """

    terms: tuple[FoundTerm, ...]
    tried: int
    excess: Mapping[str, float]
    left: Mapping[str, float]
    factors: Mapping[str, tuple[float, float]]


def regress(believed: Believed, flights: Sequence[Felt]) -> Regression:
    """Return the terms that the errors of the felt coefficients follow.

    Args:
        believed: the model and its priors.
        flights: what records say, all with the same coefficients.
    """
    problems = _problems(believed, flights)
    before = {c: p.chi2 / p.samples for c, p in problems.items()}
    tried = sum(int(p.open.sum()) for p in problems.values())
    order: list[tuple[str, int]] = []
    while len(order) < min(_MOST, tried):
        found = {c: p.scan() for c, p in problems.items() if p.open.any()}
        c, best = max(found.items(), key=lambda item: float(np.max(item[1].t)))
        i, k = int(np.argmax(best.t)), len(order) + 1
        limit = k * CRITERIA.false_terms / (tried + 1 - k * (1.0 - CRITERIA.false_terms))
        if 2.0 * norm.sf(best.t[i]) > limit or best.gain[i] < CRITERIA.least:
            break
        problems[c].take(i)
        order.append((c, i))
        problems[c].exchange()
    terms = []
    for c, p in problems.items():
        p.prune()
        terms += p.found(c, before[c])
    terms = [f for f in terms if len(f.instead) <= _INDISTINCT]
    terms.sort(key=lambda f: -abs(f.size) / f.error)
    left = {c: p.chi2 / p.samples for c, p in problems.items()}
    factors: dict[str, tuple[float, float]] = {}
    for p in problems.values():
        for name, (factor, error) in p.factors().items():
            if name not in factors or error < factors[name][1]:
                factors[name] = factor, error
    return Regression(tuple(terms), tried, before, left, factors)


@dataclass(frozen=True, eq=False)
class Followed:
    """How an error of a coefficient follows what was found, in one record; of both, what is slower than the cut-off.

    Attributes:
        name: of the manoeuvre.
        t_s: (n,) time.
        error: (n,) felt less that of the model, about its mean.
        terms: (n,) the terms found in that coefficient, about their mean.
        noise: standard deviation of what the sensors' noise makes of the error.
    """

    name: str
    t_s: FloatArray
    error: FloatArray
    terms: FloatArray
    noise: float


def followed(
    believed: Believed, flights: Sequence[Felt], found: Sequence[FoundTerm], coefficient: str
) -> list[Followed]:
    """Return how the error of a coefficient follows what was found of it, in each record."""
    own = [f for f in found if f.coefficient == coefficient]
    out = []
    for flight in flights:
        record, c = flight.motion.record, flight.coefficients.index(coefficient)
        slow = _Slow.of(record.dt_s)
        y = slow(flight.errors[..., c], 1)
        Z = slow(columns(tuple(f.term for f in own), quantities(believed, flight), record.dt_s)[:1], 1)[0]
        terms = Z @ np.array([f.size for f in own])
        t = slow(record.t_s - record.t_s[0], 0)
        noise = float(np.std(y[1:] - y[0]))
        out.append(Followed(flight.name, t, y[0] - y[0].mean(), terms - terms.mean(), noise))
    return out


@dataclass(frozen=True, eq=False)
class _Scan:
    """Of every term (m,): estimate, standard error, |t|, and by how much it would lower chi-square."""

    size: FloatArray
    error: FloatArray
    t: FloatArray
    gain: FloatArray


@dataclass(frozen=True, eq=False)
class _Moments:
    """Moments of the whitened regressors G, p of them, and errors y.

    Attributes:
        raw: (p, p) G'G.
        noise: (p, p) S_gg.
        corrected: (p, p) G'G - S_gg.
        with_y: (p,) G'y - S_gy.
        y: y'y.
    """

    raw: FloatArray
    noise: FloatArray
    corrected: FloatArray
    with_y: FloatArray
    y: float

    @classmethod
    def of(cls, y: FloatArray, G: FloatArray) -> _Moments:
        """Return those of versions of errors (versions, n) and regressors (versions, n, p)."""
        more_G, more_y, copies = G[1:] - G[0], y[1:] - y[0], len(G) - 1
        noise = np.tensordot(more_G, more_G, ((0, 1), (0, 1))) / copies
        with_y = G[0].T @ y[0] - np.tensordot(more_G, more_y, ((0, 1), (0, 1))) / copies
        raw = G[0].T @ G[0]
        return cls(raw, noise, raw - noise, with_y, float(y[0] @ y[0]))


class _Problem:
    """The regression of one coefficient.

    Attributes:
        open: (m,) which terms may enter.
        samples: number of independent samples.
    """

    def __init__(
        self,
        terms: Sequence[Term],
        y: FloatArray,
        X: FloatArray,
        Z: FloatArray,
        rows: int,
        records: int,
        tuned: Mapping[str, float],
    ) -> None:
        """Take the problem, whitened; version 0 of all arrays is the record's, the others are copies.

        Args:
            terms: m of them.
            y: (versions, n) error of the coefficient, then a zero for each prior.
            X: (versions, n, k) what stands beside every term, priors as rows.
            Z: (versions, n, m) terms.
            rows: that are samples.
            records: the first columns of X are the constant of each.
            tuned: coefficient that is re-tuned -> deviation of its prior; the last columns of X.
        """
        self.terms, self.samples, self._tuned = terms, rows, tuned
        self._k, self._copies = X.shape[2], len(y) - 1
        self._y, self._G = y, np.concatenate([X, Z], axis=2)
        self._of = _Moments.of(y, self._G)
        self._taken: list[int] = []
        raw, noise = np.diag(self._of.raw)[self._k :], np.diag(self._of.noise)[self._k :]
        self.open = (raw > 1e-12) & (noise < _RELIABLE * raw)
        C = self._of.raw[:records, self._k :]
        means = np.linalg.solve(self._of.raw[:records, :records], C)
        self._about_means = np.maximum(raw - (C * means).sum(axis=0), 1e-300)

    @property
    def _beside(self) -> NDArray[np.bool_]:
        """The columns (k + taken,) that stand beside every term, as a mask."""
        out = np.zeros(self._k + len(self.terms), bool)
        out[: self._k] = True
        out[[self._k + i for i in self._taken]] = True
        return out

    @property
    def chi2(self) -> float:
        """What is left."""
        i, m = self._beside, self._of
        return m.y - float(m.with_y[i] @ np.linalg.solve(m.corrected[i][:, i], m.with_y[i]))

    def scan(self) -> _Scan:
        """Return what every term would do beside those that were taken."""
        i, m, k = self._beside, self._of, self._k
        cross, with_y = m.corrected[i, k:], m.with_y[k:]
        W = np.linalg.solve(m.corrected[i][:, i], cross)  # of each term, what is made up of those beside it
        square = np.diag(m.corrected)[k:] - (cross * W).sum(axis=0)
        spread = m.raw + m.noise / self._copies
        scatter = np.diag(spread)[k:] - 2.0 * (spread[i, k:] * W).sum(axis=0) + (W * (spread[i][:, i] @ W)).sum(axis=0)
        good = self.open & (square > _LEFT * self._about_means) & (square > _TRUE * scatter)
        safe = np.where(good, square, 1.0)
        size = np.where(good, (with_y - W.T @ m.with_y[i]) / safe, 0.0)
        gain = np.where(good, (size * safe) ** 2 / np.where(good, scatter, 1.0), 0.0)
        freedom = max(self.samples - int(i.sum()) - 1, 1)
        scale = np.sqrt(np.maximum((self.chi2 - gain) / freedom, 1.0))
        error = np.where(good, scale * np.sqrt(np.maximum(scatter, 0.0)) / safe, np.inf)
        return _Scan(size, error, np.abs(size) / error, gain)

    def take(self, i: int) -> None:
        """Let a term enter."""
        self._taken.append(i)
        self.open[i] = False

    def _without(self, i: int) -> None:
        self._taken.remove(i)
        self.open[i] = True

    def exchange(self) -> None:
        """Give each term that entered the place that another one would fill better beside the others."""
        for i in list(self._taken):
            self._without(i)
            self.take(int(np.argmax(self.scan().gain)))

    def prune(self) -> None:
        """Take out the terms that are no longer sure beside the others, the least sure one first."""
        while self._taken:
            sure = []
            for i, scatter in zip(list(self._taken), self._scatter(), strict=True):
                self._without(i)
                scan = self.scan()
                sure.append((abs(float(scan.size[i])) / max(float(scan.error[i]), float(scatter)), i))
                self.take(i)
            least, i = min(sure)
            if least > CRITERIA.sure:
                return
            self._without(i)

    def _scatter(self) -> FloatArray:
        """Return standard errors (terms that entered,) from what the copies' noise makes of the estimates.

        With a term the noise of its regressor is in the error, too, and of another size wherever it is not linear.
        """
        i = self._beside
        A, b = self._of.corrected[i][:, i], self._of.with_y[i]
        inverse, G = np.linalg.inv(A)[self._k :], self._G[..., i]
        left = self._y - G @ np.linalg.solve(A, b)
        pairs = zip(left[1:], G[1:], strict=True)
        moved = [inverse @ (G[0].T @ (e - left[0]) + (g - G[0]).T @ left[0]) for e, g in pairs]
        by_column = np.sqrt(np.mean(np.square(moved), axis=0))
        return np.asarray(by_column[np.argsort(np.argsort(self._taken))])

    def factors(self) -> dict[str, tuple[float, float]]:
        """Return what the samples alone say of the coefficients that are re-tuned: factor and standard error.

        Nothing where they do not tell them apart, or where the noise of what one multiplies is as large as that itself.
        """
        i = self._beside
        A = self._of.corrected[i][:, i].copy()
        at = range(self._k - len(self._tuned), self._k)
        for j, deviation in zip(at, self._tuned.values(), strict=True):
            A[j, j] -= deviation**-2
        if not np.min(np.diag(A)) > 0.0:  # as much noise was taken out as there is of it
            return {}
        scaled = A / np.sqrt(np.outer(np.diag(A), np.diag(A)))
        if not np.linalg.eigvalsh(scaled)[0] > _SINGULAR:
            return {}
        inverse = np.linalg.inv(A)
        b = inverse @ self._of.with_y[i]
        spread = inverse @ (self._of.raw + self._of.noise / self._copies)[i][:, i] @ inverse
        freedom = max(self.samples - len(b), 1)
        scale = max(self.chi2 / freedom, 1.0)
        return {
            n: (1.0 + float(b[j]), float(np.sqrt(scale * spread[j, j]))) for n, j in zip(self._tuned, at, strict=True)
        }

    def found(self, coefficient: str, before: float) -> list[FoundTerm]:
        """Return the terms that entered, each beside all others."""
        out, left = [], self.chi2
        above = max(before * self.samples - self.samples, 1e-9)
        for i, scatter in zip(list(self._taken), self._scatter(), strict=True):
            self._without(i)
            scan = self.scan()
            behind = scan.gain[i] - scan.gain
            near = self.open & (
                behind < CRITERIA.told_apart + (1.0 - CRITERIA.too_close) * max(left - self.samples, 0.0)
            )
            near[i] = False
            ranked = sorted(np.flatnonzero(near).tolist(), key=lambda j: float(behind[j]))
            instead = tuple((self.terms[j], float(scan.size[j])) for j in ranked)
            share = 1.0 - max(left - self.samples, 0.0) / above
            error = max(float(scan.error[i]), float(scatter))
            out.append(FoundTerm(coefficient, self.terms[i], float(scan.size[i]), error, share, instead))
            self.take(i)
        return out


def _problems(believed: Believed, flights: Sequence[Felt]) -> dict[str, _Problem]:
    """Return the regression of each coefficient."""
    records = [f.motion.record for f in flights]
    priors = believed.priors_of(records)
    moved = frozenset(n for n in CONTROLS if any(n in f.surfaces and np.ptp(f.surfaces[n]) > 0.0 for f in flights))
    terms = vocabulary(all(f.motion.moves_laterally for f in flights), moved)
    slow = [_Slow.of(f.motion.record.dt_s) for f in flights]
    known = [quantities(believed, f) for f in flights]
    Z = [s(columns(terms, k, f.motion.record.dt_s), 1) for s, k, f in zip(slow, known, flights, strict=True)]
    y = [s(f.errors, 1) for s, f in zip(slow, flights, strict=True)]
    T = [s(_tuned(f, k, list(priors)), 1) for s, k, f in zip(slow, known, flights, strict=True)]
    out = {}
    for c, name in enumerate(flights[0].coefficients):
        white = _whiteners([each[..., c] for each in y], slow[0].per_s(records[0].dt_s))
        beside = [each[:, :, c] for each in T]
        noise = _SEEN * max(float(np.std(each[1:, :, c] - each[0, :, c])) for each in y)
        used = np.array([any(np.ptp(b[0, :, k]) > noise for b in beside) for k in range(len(priors))], bool)
        kept = {n: d for (n, d), u in zip(priors.items(), used, strict=True) if u}
        own = _joined(terms, white, [e[..., c] for e in y], [b[..., used] for b in beside], Z, kept)
        own.open &= [f"{name}_{t.label}" not in priors for t in terms]  # of which the prior decides
        out[name] = own
    return out


def _tuned(flight: Felt, known: Mapping[str, FloatArray], names: Sequence[str]) -> FloatArray:
    """Return what the coefficients that are re-tuned contribute (versions, n, c, names).

    They were evaluated along version 0. In the others they differ as the quantity does that they multiply; where they
    follow it closely, they are a multiple of it, so that noise is in both alike.
    """
    versions, n, c = flight.errors.shape
    out = np.empty((versions, n, c, len(names)))
    for k, name in enumerate(names):
        T, x = flight.tuned[name], known.get(name.partition("_")[2])
        out[..., k] = T
        if x is not None:
            slope = (x[0] @ T) / max(float(x[0] @ x[0]), 1e-300)
            like = x[..., None] * slope
            follows = np.sum((T - like[0]) ** 2, axis=0) < _FOLLOWS**2 * np.sum(T**2, axis=0)
            out[..., k] = np.where(follows, like, out[..., k] + like - like[0])
    return out


def _joined(
    terms: Sequence[Term],
    white: Sequence[FloatArray],
    y: Sequence[FloatArray],
    T: Sequence[FloatArray],
    Z: Sequence[FloatArray],
    priors: Mapping[str, float],
) -> _Problem:
    """Return the regression over several records: whitened, with a constant for each and a row for each prior.

    Args:
        terms: m of them.
        white: (n, n) of each record: what makes its noise white.
        y: (versions, n) of each record.
        T: (versions, n, k) of each record.
        Z: (versions, n, m) of each record.
        priors: coefficient that is re-tuned -> deviation, k of them.
    """
    versions, k, m = len(y[0]), len(priors), len(terms)
    rows, ys, Xs, Zs = 0, [], [], []
    for i, (W, each, tuned, z) in enumerate(zip(white, y, T, Z, strict=True)):
        constants = np.zeros((versions, len(W), len(white)))
        constants[..., i] = W.sum(axis=1)
        ys.append(each @ W.T)
        Xs.append(np.concatenate([constants, W @ tuned], axis=2))
        Zs.append(W @ z)
        rows += len(W)
    ys.append(np.zeros((versions, k)))
    prior_rows = np.hstack([np.zeros((k, len(white))), np.diag(1.0 / np.array(list(priors.values())))])
    Xs.append(np.broadcast_to(prior_rows, (versions, *prior_rows.shape)))
    Zs.append(np.zeros((versions, k, m)))
    y_all, X_all, Z_all = (np.concatenate(part, axis=1) for part in (ys, Xs, Zs))
    return _Problem(terms, y_all, X_all, Z_all, rows, len(white), priors)


def _whiteners(y: Sequence[FloatArray], per_s: float) -> list[FloatArray]:
    """Return for each record the matrix (n, n) that makes the noise of errors (versions, n) white, of variance one.

    The autocovariance is that of the copies' scatter over all records, under a lag window of Parzen, which keeps it
    positive (M. B. Priestley, Spectral Analysis and Time Series, 1981, section 6.2.3).
    """
    scatter = [each[1:] - each[0] for each in y]
    longest = max(s.shape[1] for s in scatter)
    lags = min(longest - 1, round(_COLOUR_S * per_s))
    total, count = np.zeros(lags + 1), sum(s.size for s in scatter)
    for s in scatter:
        n = s.shape[1]
        for lag in range(min(lags, n - 1) + 1):
            total[lag] += np.sum(s[:, : n - lag] * s[:, lag:])
    x = np.arange(lags + 1) / (lags + 1)
    window = np.where(x < 0.5, 1.0 - 6.0 * x**2 + 6.0 * x**3, 2.0 * (1.0 - x) ** 3)
    colour = np.zeros(longest)
    colour[: lags + 1] = total / count * window
    colour[0] = max(colour[0] * (1.0 + 1e-6), 1e-300)
    return [
        solve_triangular(cholesky(toeplitz(colour[: s.shape[1]]), lower=True), np.eye(s.shape[1]), lower=True)
        for s in scatter
    ]


@dataclass(frozen=True, eq=False)
class _Slow:
    """A filter without a phase that leaves what is slower than a cut-off, and every ``step``-th sample of that."""

    taps: FloatArray
    step: int
    first: int

    @classmethod
    def of(cls, dt_s: float) -> _Slow:
        """Return the filter for a sample time."""
        cutoff_hz = min(_CUTOFF_HZ, _OF_RATE / dt_s)
        step = int(1.0 / (dt_s * _PER_CUTOFF * cutoff_hz))
        taps = firwin(10 * step + 1, cutoff_hz, fs=1.0 / dt_s)
        return cls(taps, step, max(0, round(_START_S / dt_s) - len(taps) // 2))

    def per_s(self, dt_s: float) -> float:
        """Return the rate of what is left, Hz."""
        return 1.0 / (dt_s * self.step)

    def __call__(self, x: FloatArray, axis: int) -> FloatArray:
        """Return signals filtered along the axis of the samples."""
        parts = np.moveaxis(sliding_window_view(x, len(self.taps), axis=axis), axis, 0)[self.first :: self.step]
        return np.moveaxis(parts @ self.taps, 0, axis)
