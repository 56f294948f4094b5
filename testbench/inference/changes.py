"""What changes while an aircraft flies: when, in which part, and with which probability.

The equations of the flight are those of its own record: every rate, and the airspeed where a throttle is recorded, is
predicted one step ahead from the last samples of all motions and controls,

    y(t+1) = c + sum_l (A_l x(t-l) + B_l u(t-l) V(t-l)^2/V0^2) + e.

An autopilot acts on what it has measured before, so the innovations e are not correlated with the regressors, although
the loop is closed. The coefficients are those of nominal flight: other flights, and the beginning of this one, and they
go on being learnt while nothing has changed. A hypothesis multiplies the part of a control, or what an instrument
reads, by a factor, or lets a control stand still at an unknown angle, or lets everything change. Where elevator and
aileron are recorded without a rudder, each elevon is a part: right de - da, left de + da.

Beneath every hypothesis the constant and the effect of each control wander (gusts, trim, an airspeed that nobody
measured), by amounts that the nominal flight tells (:meth:`Watch._tune`); noise has a scale that follows the air. A
hidden Markov chain holds the hypotheses, each with its own Kalman filter of what wanders (interacting multiple models:
H. A. P. Blom and Y. Bar-Shalom, IEEE Transactions on Automatic Control 33(8), 1988). In flight the filter answers; of a
finished log, the smoother of the chain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from testbench.core.channels import CONTROLS, SURFACES
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord, FloatArray

FASTEST_HZ, LEAST_HZ = 10.0, 1.0
"""Rates of the record that is taken: rigid motion is slower, and innovations of faster ones are noise alone."""
BLOCK_S, NOMINAL_S, WORTH_S = 1.0, 60.0, 60.0
"""Time that is weighed at once; beginning that is believed nominal; time that all other flights together are worth."""
SURE = 0.99
"""Probability of a change from which on it is called out."""
_STEP = 0.1
FACTORS = tuple(_STEP * k for k in range(10))  # of the effect that is left
_BRIEF_S = 10.0  # beside another part that is changed
_READS = {"V": 0.5}  # of what an instrument reads; others, -1
_EVERY_S = 600.0  # a change is expected in so much flight; half of all changes lead back to nominal flight
_WANDERS_S, _EFFECT_S, _NOISE_S = 20.0, 60.0, 30.0  # time constants: constant, effect of controls, scale of the noise
_SHARES = (0.01, 0.03, 0.1)  # of the variance of the innovations, that of the constant
_EFFECTS = (0.05, 0.1, 0.2, 0.3)  # standard deviation of the effect of a control
_FORM = 0.2  # of what a part loses: by so much may the equations be off, which are linear about nominal flight
_JUMP = 10.0  # variance of a new constant over that of the innovations
_GUSTS, _ROUGHER = 0.1, 9.0  # share of the blocks that are rougher, and variance there over the others
_FREEDOM = 100.0  # samples that the scale of the noise is known by
_BELIEVED = 0.9  # probability of nominal flight from which on it is learnt from
_LAG_S, _MOST_LAGS, _FEWEST_ROWS = 0.4, 4, 3  # of regressors; rows of regressors per coefficient
_Rows = tuple[FloatArray, FloatArray, FloatArray]
_RATES, _BESIDE, _ENERGY = ("p", "q", "r"), ("ax", "ay", "az", "alpha", "beta"), ("theta", "hdot")


@dataclass(frozen=True)
class Hypothesis:
    """What may be the case at one time."""

    part: str  #: control, "right" or "left" elevon, or channel of an instrument; "" if it is of none
    kind: Literal["nominal", "factor", "stuck", "reads", "unknown"]  #: what is the matter with it
    factor: float  #: of its effect, or of what it reads


@dataclass(frozen=True)
class Change:
    """A stretch of a flight in which something is not as in nominal flight."""

    part: str  #: of the most probable hypothesis there; "" if all may have changed
    kind: str  #: its kind
    factor: float  #: mean of what is left of the effect, or of the reading
    std: float  #: its standard deviation
    since_s: float  #: where nominal flight is less probable than not
    until_s: float  #: until when; the end of the record if it lasts
    probability: float  #: that something is changed, at most, within it
    of_part: float  #: that it is this part, if something is changed; mean over the stretch


class Watch:
    """A flight that is watched for changes.

    Args:
        channels: of the records to come, which must hold a control and what it moves: p, q or r for surfaces (or their
            commands), V with theta or hdot for the throttle.
        dt_s: time step of the records, 0.1 to 1 s.
        nominal_s: beginning of the flight that is believed nominal.

    Raises:
        RecordError: the channels hold no control with what it moves, or the step is out of range.

    Example:
        >>> from testbench.inference.changes import Watch
        >>> Watch(("p", "da"), 0.1).parts
        ('da',)
    """

    def __init__(self, channels: Sequence[str], dt_s: float, nominal_s: float = NOMINAL_S) -> None:
        if not 0.999 / FASTEST_HZ <= dt_s <= 1.001 / LEAST_HZ:
            raise RecordError(f"changes are watched for at {LEAST_HZ:g} to {FASTEST_HZ:g} Hz, got {1.0 / dt_s:.3g} Hz")
        named = {c: next((n for n in (c, f"{c}_cmd") if n in channels), "") for c in CONTROLS}
        turns = [n for n in _RATES if n in channels] if any(named[c] for c in SURFACES) else []
        beside = [n for n in _ENERGY if n in channels] if named["thr"] and "V" in channels else []
        self.targets = (*turns, *(["V"] if beside else []))
        if not self.targets:
            raise RecordError(
                "changes show where a control is recorded with what it moves, de, da or dr (or its command) with p, q "
                f"or r, thr with V and theta or hdot; got {', '.join(channels)}"
            )
        self.controls = {c: n for c, n in named.items() if n and (beside if c == "thr" else turns)}
        self.states = (*self.targets, *(n for n in _BESIDE if turns and n in channels), *beside)
        self.dt_s, self.nominal_s, self._speed = dt_s, nominal_s, "V" in channels
        self.lags = min(max(round(_LAG_S / dt_s), 2), _MOST_LAGS)
        tags = ["", *(n for n in self.states for _ in range(self.lags))]
        self._tags = np.array([*tags, *(c for c in self.controls for _ in range(self.lags))])
        elevons = ("right", "left") if {"de", "da"} <= set(self.controls) and "dr" not in self.controls else ()
        self.parts = (*self.controls, *elevons)
        self.hypotheses, self._transitions = self._chain()
        self._wandering = self._shares()
        self.t_s: list[float] = []  # ends of the blocks that were weighed
        self._filtered: list[FloatArray] = []
        self._needed = tuple(dict.fromkeys((*self.states, *self.controls.values(), *(["V"] if self._speed else []))))
        self._V0 = 0.0  # speed that effects are of
        self._last: tuple[Any, ...] = ()  # samples that the next rows need, too
        self._held: list[_Rows] = []  # rows that are not weighed yet
        n, E = len(self._tags), len(self.targets)
        self._M, self._N, self._rows, self._begun = np.zeros((n, n)), np.zeros((n, E)), 0.0, False
        self.log_nominal = 0.0  # ln of the probability that nothing has changed at any time

    def _chain(self) -> tuple[tuple[Hypothesis, ...], FloatArray]:
        """Return the hypotheses and the probabilities (S, S) of going from one to another within a block."""
        of: list[list[Hypothesis]] = [[Hypothesis("", "nominal", 1.0)]]
        of += [[*(Hypothesis(p, "factor", k) for k in FACTORS), Hypothesis(p, "stuck", 0.0)] for p in self.parts]
        of += [[Hypothesis(n, "reads", _READS.get(n, -1.0))] for n in self.targets]
        of += [[Hypothesis("", "unknown", 1.0)]]
        into = np.concatenate([np.full(len(h), (0.5 if not i else 0.5 / (len(of) - 1)) / len(h)) for i, h in
                               enumerate(of)])  # fmt: skip
        leaves = 1.0 - math.exp(-BLOCK_S / _EVERY_S)
        return tuple(h for some in of for h in some), (1.0 - leaves) * np.eye(len(into)) + leaves * into

    def _shares(self) -> FloatArray:
        """Return (2 E + J, S): how much what a hypothesis takes from is of each thing that wanders."""
        E, names = len(self.targets), list(self.controls)
        out = np.zeros((2 * E + len(names), len(self.hypotheses)))
        for s, h in enumerate(self.hypotheses):
            if h.kind in ("factor", "stuck"):
                of = [h.part] if h.part in names else ["de", "da"]
                out[[E + names.index(c) for c in of], s] = 1.0 / len(of)
        return out

    def believe(self, nominal: Sequence[FlightRecord]) -> None:
        """Learn from other flights without a change, before this one: together they are worth a minute of it."""
        rows = [self._regressors(*self._read(r)) for r in nominal]
        count = sum(len(A) for _, A, _ in rows)
        for _, A, Y in rows:
            self._learn(A, Y, min(1.0, WORTH_S / self.dt_s / max(count, 1)))

    def take(self, block: FlightRecord) -> None:
        """Take the next samples of the flight, on one even clock.

        Raises:
            RecordError: the beginning is too short to learn the equations of the flight from.
        """
        new = self._read(block)
        self._last = tuple(np.concatenate(pair) for pair in zip(self._last, new, strict=True)) if self._last else new
        t, x, sound = self._last
        self._last = t[-self.lags :], x[-self.lags :], sound[-self.lags :]
        self._held.append(self._regressors(t, x, sound))
        held = [np.concatenate(part) for part in zip(*self._held, strict=True)]
        if not self._begun:
            first = math.ceil(self.nominal_s / self.dt_s - 1e-6)
            if len(held[0]) < first:
                return
            self._begin(*(part[:first] for part in held))
            held = [part[first:] for part in held]
        at_s = self.t_s[-1] if self.t_s else self._since_s
        while block.t_s[-1] >= at_s + BLOCK_S:
            at_s += BLOCK_S
            now = held[0] <= at_s + 0.5 * self.dt_s
            self._weigh(held[1][now], held[2][now])
            self.t_s.append(at_s)
            held = [part[~now] for part in held]
        self._held = [(held[0], held[1], held[2])]

    def _read(self, record: FlightRecord) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return times, the channels that are needed, and whether all of them were taken."""
        part = record.select(self._needed)
        return part.t_s, part.columns(self._needed), np.asarray(part.valid.all(axis=1), np.bool_)

    def _begin(self, t: FloatArray, A: FloatArray, Y: FloatArray) -> None:
        """Learn the beginning, and what wanders in it."""
        self._learn(A, Y, 1.0)
        self._solve()
        self.S2 = ((Y - A @ self._B) ** 2).sum(axis=0) / max(len(A) - 0.5 * len(self._tags), 0.2 * len(A))
        self.S2 = np.maximum(self.S2, 1e-12 * np.mean(Y**2, axis=0) + 1e-30)  # what is simulated has no noise
        self._tune(A, Y)
        self._reset(len(self.hypotheses))
        self._begun, self._since_s = True, float(t[-1])

    def _regressors(self, t: FloatArray, x: FloatArray, sound: NDArray[np.bool_]) -> _Rows:
        """Return times (n,), regressors (n, f) and what they predict (n, E), of samples with all that they need."""
        of, L = dict(zip(self._needed, x.T, strict=True)), self.lags
        if self._speed and sound.any() and not self._V0:
            self._V0 = max(float(np.median(of["V"][sound])), 1.0)
        rows = np.arange(L - 1, len(t) - 1)
        rows = rows[np.all([sound[rows - k] for k in range(-1, L)], axis=0)] if len(rows) else rows
        columns = [np.ones(len(rows))]
        for name in (*self.states, *self.controls.values()):
            pressed = self._V0 and name.removesuffix("_cmd") in SURFACES
            y = of[name] * (of["V"] / self._V0) ** 2 if pressed else of[name]
            columns += [y[rows - k] for k in range(L)]
        return t[rows + 1], np.column_stack(columns), np.column_stack([of[n][rows + 1] for n in self.targets])

    def _learn(self, A: FloatArray, Y: FloatArray, weight: float) -> None:
        self._M += weight * A.T @ A
        self._N += weight * A.T @ Y
        self._rows += weight * len(A)

    def _solve(self) -> None:
        if self._rows < _FEWEST_ROWS * len(self._tags):
            raise RecordError(
                f"{_FEWEST_ROWS * len(self._tags) * self.dt_s:.0f} s of nominal flight tell the {len(self._tags)} "
                f"coefficients of its equations, got {self._rows * self.dt_s:.3g} s: give more, or other flights"
            )
        size = np.sqrt(np.diag(self._M)) + 1e-12
        ridge = self._M / np.outer(size, size) + 1e-6 * np.eye(len(size))
        self._inverse = np.linalg.inv(ridge) / np.outer(size, size)
        self._B = self._inverse @ self._N

    def _tune(self, A: FloatArray, Y: FloatArray) -> None:
        """Take the wandering that makes the beginning most probable, nothing having changed."""
        size = max(round(BLOCK_S / self.dt_s), 1)
        best = (-math.inf, 0.0, 0.0)
        for share in _SHARES:
            for effect in _EFFECTS:
                self.wanders = share, effect
                self._reset(1)
                total = sum(self._weigh(A[k : k + size], Y[k : k + size]) for k in range(0, len(A), size))
                best = max(best, (total, share, effect))
        self.wanders = best[1:]

    def _reset(self, count: int) -> None:
        """Begin the chain with the first ``count`` hypotheses, in nominal flight."""
        E, J = len(self.targets), len(self.controls)
        self._v0 = np.concatenate([self.wanders[0] * self.S2, np.full(J, self.wanders[1] ** 2), np.zeros(E)])
        keep = np.exp(-BLOCK_S / np.concatenate([np.full(E, _WANDERS_S), np.full(J, _EFFECT_S), np.full(E, np.inf)]))
        self._keep, self._added = keep, np.diag(self._v0 * (1.0 - keep**2))
        self._m, self._P = np.zeros((count, 2 * E + J)), np.tile(np.diag(self._v0), (count, 1, 1))
        self._logp = np.where(np.arange(count) == 0, 0.0, -27.0)
        self._s2, self._solved = self.S2.copy(), 0
        self._filtered, self.t_s, self.log_nominal = [], [], 0.0

    def _effects(self, A: FloatArray) -> dict[tuple[str, float], FloatArray]:
        """Return (part, factor) -> what it adds to the prediction of a block, (b, E)."""
        of = {c: A[:, self._tags == c] @ self._B[self._tags == c] for c in self.controls}
        if "right" in self.parts:
            e, a = self._tags == "de", self._tags == "da"
            for name, sign in (("right", -1.0), ("left", 1.0)):
                of[name] = 0.5 * (A[:, e] + sign * A[:, a]) @ (self._B[e] + sign * self._B[a])
        out = {}
        for h in self.hypotheses[: len(self._m)]:
            if h.kind in ("factor", "stuck"):
                out[h.part, h.factor] = (h.factor - 1.0) * of[h.part]
            elif h.kind == "reads":
                own = A[:, self._tags == h.part] @ self._B[self._tags == h.part]
                target = self.targets.index(h.part)
                added = (1.0 / h.factor - 1.0) * own
                added[:, target] = (h.factor - 1.0) * (A @ self._B - own)[:, target]
                out[h.part, h.factor] = added
        self._of = of
        return out

    def _weigh(self, A: FloatArray, Y: FloatArray) -> float:
        """Weigh the hypotheses by a block of samples; return ln of its probability."""
        S, E, b = len(self._m), len(self.targets), len(A)
        hypotheses = self.hypotheses[:S]
        T = self._transitions[:S, :S] / self._transitions[:S, :S].sum(axis=1, keepdims=True)
        joint = T * np.exp(self._logp)[:, None]
        prior = joint.sum(axis=0)
        weights = joint / prior
        m = weights.T @ self._m
        away = self._m[:, None, :] - m[None]
        P = np.einsum("is,ijk->sjk", weights, self._P) + np.einsum("is,isj,isk->sjk", weights, away, away)
        m, P = m * self._keep, P * np.outer(self._keep, self._keep) + self._added
        m[0, -E:], P[0, -E:], P[0, :, -E:] = 0.0, 0.0, 0.0  # nominal flight has no new constant
        enters = 1.0 - np.diag(weights)
        for s, h in enumerate(hypotheses):
            if h.kind in ("stuck", "unknown"):  # what is new stands anywhere
                P[s, range(-E, 0), range(-E, 0)] += _JUMP * self.S2 * enters[s]
        if not b:
            self._m, self._P, self._logp = m, P, np.log(prior)
            self._filtered.append(prior)
            return 0.0
        effects = self._effects(A)
        D = np.zeros((b, E, m.shape[1]))
        D[:, range(E), range(E)] = D[:, range(E), range(-E, 0)] = 1.0
        for j, c in enumerate(self.controls):
            D[:, :, E + j] = self._of[c]
        D = D.reshape(b * E, -1)
        nothing = np.zeros((b, E))
        added = np.array([effects.get((h.part, h.factor), nothing) for h in hypotheses])
        P[:, range(-E, 0), range(-E, 0)] += enters[:, None] * (_FORM * added.mean(axis=1)) ** 2
        added *= 1.0 + np.einsum("sj,js->s", m, self._wandering[:, :S])[:, None, None]  # what is lost has wandered, too
        # What the coefficients are not known by is common to the samples of a block.
        noise = self._s2 * (1.0 + float(np.einsum("bf,fg,bg->", A, self._inverse, A)))
        w = np.tile(1.0 / noise, b)
        residual = (Y - A @ self._B - added).reshape(S, -1) - m @ D.T
        information, score = D.T @ (w[:, None] * D), (residual * w) @ D
        total_square = residual**2 @ w
        likely, means, spreads = [], [], []
        for rough in (1.0, _ROUGHER):
            spread = np.eye(m.shape[1]) + P @ information / rough
            after = np.linalg.solve(spread, P)
            step = np.einsum("sjk,sk->sj", after, score) / rough
            square = np.maximum(total_square - np.einsum("sj,sj->s", score, step), 0.0) / rough
            log_size = float(b * np.log(noise).sum() + b * E * math.log(rough)) + np.linalg.slogdet(spread)[1]
            likely.append(-0.5 * (_FREEDOM + b * E) * np.log1p(square / _FREEDOM) - 0.5 * log_size)
            means.append(step)
            spreads.append(after)
        likely[0] += math.log(1.0 - _GUSTS)
        likely[1] += math.log(_GUSTS)
        both = np.logaddexp(*likely)
        calm = np.exp(likely[0] - both)[:, None]
        step = calm * means[0] + (1.0 - calm) * means[1]
        P = calm[:, :, None] * spreads[0] + (1.0 - calm[:, :, None]) * spreads[1]
        posterior = np.log(prior) + both
        total = float(logsumexp(posterior))
        self._logp, self._m, self._P = np.maximum(posterior - total, -600.0), m + step, P
        self.log_nominal = min(self.log_nominal + math.log(T[0, 0]) + float(both[0]) - total, 0.0)
        p = np.exp(self._logp)
        left = ((residual - step @ D.T) ** 2).reshape(S, b, E).sum(axis=1)
        scale = calm + (1.0 - calm) / _ROUGHER
        forget = math.exp(-b * self.dt_s / _NOISE_S)
        self._s2 = forget * self._s2 + (1.0 - forget) * ((p[:, None] * scale) * left).sum(axis=0) / (b - 0.3)
        if S > 1:
            self._filtered.append(p)
            if p[0] > _BELIEVED:
                self._learn(A, Y, 1.0)
                self._solved += 1
                if self._solved % 10 == 0:
                    self._solve()
        return total

    @property
    def now(self) -> FloatArray:
        """Probability of every hypothesis at the end of what was taken, (S,); nominal flight before it can be told."""
        return self._filtered[-1] if self._filtered else np.eye(len(self.hypotheses))[0]

    @property
    def changed(self) -> float:
        """Probability that something has changed at any time."""
        return -math.expm1(self.log_nominal)

    def probabilities(self, smoothed: bool = True) -> FloatArray:
        """Return the probability (n, S) of every hypothesis at ``t_s``, with all samples or with those before alone."""
        out = np.array(self._filtered).reshape(-1, len(self.hypotheses))
        if smoothed:
            for k in range(len(out) - 2, -1, -1):
                ahead = out[k] @ self._transitions
                out[k] *= self._transitions @ (out[k + 1] / np.maximum(ahead, 1e-300))
                out[k] /= out[k].sum()
        return out

    def found(self, smoothed: bool = True) -> tuple[Change, ...]:
        """Return the stretches in which something is changed, more probably than not, in the order of time."""
        p = self.probabilities(smoothed)
        if not len(p):
            return ()
        kinds = [(h.part, h.kind == "reads") for h in self.hypotheses]
        parts = list(dict.fromkeys(kinds[1:]))
        of = np.array([-1, *map(parts.index, kinds[1:])])
        parted = np.column_stack([p[:, of == k].sum(axis=1) for k in range(len(parts))])
        label = np.where(p[:, 0] < 0.5, parted.argmax(axis=1), -1)
        for first, last in _runs(label):  # what is brief beside another part belongs to it
            beside = [k for k in (*label[first - 1 : first], *label[last : last + 1]) if k >= 0]
            if label[first] >= 0 and beside and last - first < _BRIEF_S / BLOCK_S:
                label[first:last] = beside[0]
        factors = np.array([h.factor for h in self.hypotheses])
        out = []
        for first, last in _runs(label):
            if (k := label[first]) < 0:
                continue
            own = np.where(of == k, p[first:last].sum(axis=0), 0.0)
            share = own / own.sum()
            h = self.hypotheses[int(own.argmax())]
            mean = float(share @ factors)
            known = h.kind != "factor"  # the factors that are compared are a step apart, and effects wander
            std = math.sqrt(share @ (factors - mean) ** 2 + (0.0 if known else _STEP**2 / 12.0 + self.wanders[1] ** 2))
            peak = float(np.max(1.0 - p[first:last, 0]))
            of_part = float(own.sum() / (1.0 - p[first:last, 0]).sum())
            out.append(Change(h.part, h.kind, mean, std, self.t_s[first] - BLOCK_S, self.t_s[last - 1], peak, of_part))
        return tuple(out)


def _runs(label: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Return first and last + 1 of every run of equal labels."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(label)) + 1, [len(label)]]).tolist()
    return list(pairwise(edges))
