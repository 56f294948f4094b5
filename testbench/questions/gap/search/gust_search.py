"""Look for a gust in the residual of every record: matched filters over record, start, duration and component.

To first order the response R to a gust of 1 m/s that starts later is the same response later. With r the residuals
after re-tuning, T the tangents of the nuisances, A = T'T + S^-2 (S the deviations of their priors) and R_s the response
shifted by s, means over the record taken out, the gain of the best amplitude (score test) is

    z(s) = (r'R_s)^2 / (R_s'R_s - (T'R_s)' A^-1 (T'R_s)),

and all correlations over s are one pass of Fourier transforms. Without a gust every z(s) is chi-square with one degree
of freedom. Bonferroni's bound over all records, starts, durations and components keeps the largest below the threshold
with probability 1 - FALSE_ALARM. It is safe however alike the tests are; starts much closer than the shortest duration
would add few tests of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from testbench.core.record import FlightRecord, FloatArray
from testbench.effects.air import LARGEST_M_S, Axis, placed
from testbench.effects.base import Effect, MetGust
from testbench.flight.air import Gust
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import LATERAL_CHANNELS, starts_freely
from testbench.questions.gap.search.point import Point, fly_together
from testbench.questions.gap.starts import manoeuvre_of, record_key

DURATIONS_S = (0.3, 0.45, 0.65, 0.9, 1.3, 1.8, 2.6, 3.7)
STEP_S = 0.1  # between the starts that are looked at
LEAST_SHARE = 0.5  # share of the excess that a gust must promise: one that explains less is a gap in several records
_LEAST = 1e-3  # information on the amplitude, (m/s)^-2, below which a start (at the very end) is not looked at


@dataclass(frozen=True)
class FoundGust:
    """Where one gust explains most."""

    record: int  # its number in the sequence, from 0
    axis: Axis  # component of the air
    # start_s, duration_s: on the clock of the record
    start_s: float
    duration_s: float
    amplitude_m_s: float  # the best one, to first order
    gain: float  # fall of chi-square, to first order
    looks: int  # number of places that were looked at

    @property
    def stands_out(self) -> bool:
        """True if noise alone would gain as much anywhere with probability FALSE_ALARM at most."""
        return self.looks > 0 and self.gain > float(chi2.isf(CRITERIA.false_alarm / self.looks, 1))


@dataclass(frozen=True, eq=False)
class GustSearch:
    """Matched filters of a point's records, made once; residuals are searched by :meth:`best`."""

    records: tuple[FlightRecord, ...]  # the records
    places: tuple[tuple[Axis, float], ...]  # (axis, duration) of every filter
    filters: tuple[FloatArray, ...]  # per record (filters, frequencies, p) conjugate transforms of the responses
    # per record (filters, n) information on the amplitude, by start; 0 where it is not looked at
    information: tuple[FloatArray, ...]
    sizes: tuple[int, ...]  # per record the length of its transforms

    @classmethod
    def at(cls, point: Point) -> GustSearch:
        """Make the filters of the model of ``point`` in still air."""
        records = point.records
        axes: tuple[Axis, ...] = ("north", "down")
        if LATERAL_CHANNELS & set(point.believed.outputs):
            axes = (*axes, "east")
        places = tuple((axis, d) for axis in axes for d in DURATIONS_S)
        A = cho_factor(point.tangents.T @ point.tangents + np.diag(point.prior_std**-2.0))
        of_start = {}
        for there in point.model.at_each(records):
            longest = max((r for r in records if point.model.at(r) is there), key=len)
            of_start[id(there)] = _responses(point, longest, places)
        filters, information, sizes = [], [], []
        for record, tangents in zip(records, point.by_record(point.tangents), strict=True):
            n = len(record)
            size = next_fast_len(2 * n, real=True)
            R = of_start[id(point.model.at(record))][:, :n]
            valid = record.valid[:, [record.channels.index(c) for c in point.believed.outputs]].astype(float)
            F = np.conj(rfft(R, size, axis=1))
            V = rfft(valid, size, axis=0)
            square = irfft((V * np.conj(rfft(R**2, size, axis=1))).sum(axis=2), size, axis=1)[:, :n]
            sums = irfft(V * F, size, axis=1)[:, :n]
            square -= (sums**2 / np.maximum(valid.sum(axis=0), 1.0)).sum(axis=2)
            onto = rfft(tangents, size, axis=0)
            G = irfft(np.einsum("fpk,mfp->mfk", onto, F), size, axis=1)[:, :n]
            flat = G.reshape(-1, G.shape[2])
            square -= (flat * cho_solve(A, flat.T).T).sum(axis=1).reshape(square.shape)
            step = max(1, round(STEP_S / record.dt_s))
            looked = (np.arange(n) % step == 0) & (square > _LEAST) & (not starts_freely(record))
            filters.append(F)
            information.append(np.where(looked, square, 0.0))
            sizes.append(size)
        return cls(records, places, tuple(filters), tuple(information), tuple(sizes))

    @property
    def looks(self) -> int:
        """Number of places that are looked at."""
        return sum(int(np.count_nonzero(i)) for i in self.information)

    def best(self, residuals: Sequence[FloatArray]) -> FoundGust | None:
        """Return the gust that explains most of ``residuals``, per record (n, p), nuisances re-tuned; None if nowhere.

        Amplitudes beyond LARGEST_M_S are none of a gust.
        """
        out: FoundGust | None = None
        for k, (record, r) in enumerate(zip(self.records, residuals, strict=True)):
            n, info = len(record), self.information[k]
            X = rfft(r, self.sizes[k], axis=0)
            score = irfft((X * self.filters[k]).sum(axis=2), self.sizes[k], axis=1)[:, :n]
            amplitude = np.divide(score, info, out=np.zeros_like(score), where=info > 0.0)
            gain = np.where(np.abs(amplitude) < LARGEST_M_S, amplitude * score, 0.0)
            m, s = np.unravel_index(int(np.argmax(gain)), gain.shape)
            if gain[m, s] > (0.0 if out is None else out.gain):
                axis, duration = self.places[int(m)]
                start, size = float(s) * record.dt_s, float(amplitude[m, s])
                out = FoundGust(k, axis, start, duration, size, float(gain[m, s]), self.looks)
        return out


def _responses(point: Point, record: FlightRecord, places: Sequence[tuple[Axis, float]]) -> FloatArray:
    """Return what a gust of 1 m/s from the first sample on changes in the readings (places, n, p), in noise units."""
    model, key = replace(point.model.with_nuisances(point.by_name), gusts=()), record_key(record)
    met = [replace(model, gusts=(MetGust(key, "", Gust(axis, 1.0, 0.0, d)),)) for axis, d in places]
    fly_together([model, *met], [record])
    calm = model.predict(record)
    return np.array([(m.predict(record) - calm) / model.noise_std for m in met])


def sought(point: Point, effect: Effect) -> Effect:
    """Return a gust placed where it explains most of the residual of ``point``; every other effect as it is.

    Its place is a record, an axis and a time. A gust that does not stand out, or promises too small a share of the
    excess over the noise, stays without a place and is not fitted. In turbulence no gust is sought: the whitening
    filter takes moving air out of the residuals, and one more gust of it is not another effect. For the same reason a
    gust in the quiet flight before the commands counts as turbulence. Records that start freely are not looked at.
    """
    if effect.met is None or point.believed.whiten is not None or point.model.gusts:
        return effect
    left, records = point.tuned(point.exact)[0][: point.exact.size], point.records
    found = GustSearch.at(point).best(point.by_record(left))
    if found is None or not found.stands_out or found.gain < LEAST_SHARE * (point.chi2 - point.samples):
        return effect
    record = records[found.record]
    start = (found.amplitude_m_s, found.start_s, found.duration_s)
    name = manoeuvre_of(record, found.record + 1)
    return placed(effect, record_key(record), name, found.axis, start, record.duration_s, found.looks)
