"""Does what is missing begin, or end, within the records, and when?

An unknown motion (:mod:`.unknown`) is sought in every record from its beginning, in some of them, or from, or until, a
time that is not known: in all records that follow, or go before, if they were flown in the order in which they are
given, or in those that show it. The noise and all that is re-tuned are as uncertain as elsewhere (:mod:`.linear`). The
pulses of a record are put in the order of time, so that one Cholesky factor holds the evidence of every time: its
leading blocks are the factors of fewer pulses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import logsumexp

from testbench.core.record import FloatArray
from testbench.inference.linear import KAPPAS, Linearised, Reduced

_SIZES = KAPPAS[1:]


@dataclass(frozen=True)
class Onset:
    """In which records what is missing acts, and where it most probably begins or ends."""

    probability: float  # that it does not act in all of the records, if anything is missing at all
    record: int  # number of the record in which it begins or ends; -1 if it acts throughout those that show it
    sample: int  # at which it does
    ends: bool  # whether it ends there, and was there before
    shows: tuple[bool, ...]  # whether each record shows it
    places: int  # number of times and records that were compared
    step: FloatArray  # (k,) posterior mean of the re-tuned parameters there, less the point

    @property
    def place(self) -> tuple[int, int, bool, tuple[bool, ...]]:
        """Record, sample, kind and the records that show it."""
        return self.record, self.sample, self.ends, self.shows


def find_onset(
    records: Sequence[Linearised],
    pulses: Sequence[FloatArray],
    begins: Sequence[Sequence[int]],
    scales: FloatArray,
    mean: FloatArray,
    std: FloatArray,
    prior: float,
) -> tuple[Onset, ...]:
    """Return whether what is missing acts in some of the records alone, and where it begins or ends in one of them.

    The most probable of each record and kind, in the order of the records or not, the best first.

    Args:
        records: about the best point without it; their ``unknown`` is not used.
        pulses: of each record, the response (n, p, m) to each pulse of the unknown motion at kappa = 1.
        begins: of each record, the samples at which these pulses begin, (m,).
        scales: (p,) of the noise.
        mean: (k,) prior mean of the re-tuned parameters, less the point.
        std: (k,) of their prior.
        prior: probability that it does not act in all records; a third of it is that it acts in some of them, another
            that it begins or ends at some time in the order of the records, another that it does so in one alone.

    Example:
        >>> from testbench.inference.onset import find_onset
        >>> find_onset(records, pulses, begins, scales, mean, std, 0.1)[0].probability  # doctest: +SKIP
    """
    times = [sorted(set(b)) for b in begins]
    n, every_time = len(records), 2 * sum(max(len(t) - 1, 0) for t in times)
    count = every_time + 2 * (n - 1)
    of_some, of_time = math.log(prior / 3.0), math.log(prior / 3.0 / max(every_time, 1))
    of_order = math.log(prior / 3.0 / max(count, 1))
    always, cut = [], []
    summed = [
        _Summed.of(r, U, np.array(b), t, scales) for r, U, b, t in zip(records, pulses, begins, times, strict=True)
    ]
    for kappa in _SIZES:
        found = [each.at(kappa) for each in summed]
        every = [f.from_[0] for f in found]
        none = [f.never for f in found]
        alone = [a.log_evidence(mean, std) - b.log_evidence(mean, std) for a, b in zip(every, none, strict=True)]
        some = tuple(gain > 0.0 for gain in alone)
        chosen = [a if shown else b for a, b, shown in zip(every, none, some, strict=True)]
        always.append(_sum(every).log_evidence(mean, std))
        if any(some) and not all(some):
            cut.append((of_some, _sum(chosen), -1, 0, False, some))
        for ends, inside in ((False, [f.from_ for f in found]), (True, [f.until for f in found])):
            for i in range(n):
                follows = tuple((j < i) if ends else (j > i) for j in range(n))
                ordered = [every[j] if follows[j] else none[j] for j in range(n)]
                if any(follows) and (i or not ends):  # between two records
                    cut.append((of_order, _sum(ordered), -1, 0, ends, follows))
                kinds = [(of_order, ordered, follows)]
                if some[:i] + some[i + 1 :] != follows[:i] + follows[i + 1 :]:
                    kinds.append((of_time, chosen, some))
                for log_prior, rest, shown in kinds:
                    others = [_sum(o)] if (o := [c for j, c in enumerate(rest) if j != i]) else []
                    for sample, part in zip(times[i][1:], inside[i][1:], strict=True):
                        cut.append((log_prior, _sum([part, *others]), i, sample, ends, shown))
    if not cut:
        return (Onset(0.0, -1, 0, False, tuple(True for _ in records), 1, np.zeros(len(mean))),)
    density = np.array([log_prior + held.log_evidence(mean, std) for log_prior, held, *_ in cut])
    whole = float(logsumexp(always)) + math.log(1.0 - prior)
    probability = 1.0 / (1.0 + math.exp(min(whole - float(logsumexp(density)), 700.0)))
    out: dict[tuple[object, ...], Onset] = {}
    for k in np.argsort(-density, kind="stable"):
        log_prior, best, record, sample, ends, some = cut[k]
        kind = (some,) if record < 0 else (record, ends, log_prior)
        if kind not in out:
            shows = tuple(s or i == record for i, s in enumerate(some))
            step = best.posterior(mean, std)[0]
            out[kind] = Onset(probability, record, sample, ends, shows, count + 1, step)
    return tuple(out.values())


@dataclass(frozen=True, eq=False)
class _Record:
    """The reduced record without any pulse, and with those from, or until, each of its times on."""

    never: Reduced
    from_: list[Reduced]
    until: list[Reduced]


@dataclass(frozen=True, eq=False)
class _Summed:
    """Sums over the samples of a record, whatever the size of the unknown motion."""

    S: FloatArray  # (k + 1, k + 1) of the columns, then the residual
    # B, G: (m, k + 1) and (m, m) of the pulses with these, and with one another
    B: FloatArray
    G: FloatArray
    log_noise: float  # ln of the determinant of the noise
    samples: float  # their number
    # of the pulses, the latest first and the earliest first, (m,), with how many are held at each time
    orders: tuple[tuple[np.ndarray, list[int]], ...]

    @classmethod
    def of(
        cls, record: Linearised, U: FloatArray, begins: np.ndarray, times: Sequence[int], scales: FloatArray
    ) -> _Summed:
        new = record.counted(np.concatenate([record.columns, record.residual[:, :, None]], axis=2))
        new = (new / scales[:, None, None]).reshape(-1, new.shape[2])
        moved = (record.counted(U) / scales[:, None, None]).reshape(len(new), -1)
        samples = record.taken.sum(axis=0).astype(float)
        log_noise = 2.0 * float(samples @ np.log(scales))
        orders = (
            (np.argsort(-begins, kind="stable"), [int(np.sum(begins >= t)) for t in times]),
            (np.argsort(begins, kind="stable"), [int(np.sum(begins < t)) for t in times]),
        )
        return cls(new.T @ new, moved.T @ new, moved.T @ moved, log_noise, float(samples.sum()), orders)

    def at(self, kappa: float) -> _Record:
        """Return the reduced record at one size of the unknown motion."""
        M = kappa**2 * self.G
        np.fill_diagonal(M, M.diagonal() + 1.0)
        parts: list[list[Reduced]] = []
        for order, held in self.orders:
            L = cholesky(M[np.ix_(order, order)], lower=True, check_finite=False)
            y = solve_triangular(L, kappa * self.B[order], lower=True, check_finite=False)
            log_det = np.concatenate([[0.0], np.cumsum(2.0 * np.log(np.diag(L)))])
            parts.append([self._reduced(self.S - y[:r].T @ y[:r], log_det[r]) for r in held])
        return _Record(self._reduced(self.S, 0.0), *parts)

    def _reduced(self, S: FloatArray, log_det: float) -> Reduced:
        return Reduced(S[:-1, :-1], S[:-1, -1], float(S[-1, -1]), self.log_noise + float(log_det), self.samples)


def _sum(each: Sequence[Reduced]) -> Reduced:
    return Reduced(
        np.sum([r.A for r in each], axis=0),
        np.sum([r.b for r in each], axis=0),
        math.fsum(r.c for r in each),
        math.fsum(r.log_det for r in each),
        math.fsum(r.samples for r in each),
    )
