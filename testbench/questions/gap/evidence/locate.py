"""Where simulation and measurement disagree: residual energy by manoeuvre, channel, time, frequency, region.

The accelerations that the believed model lacks, over time: its unknown motion, estimated. It is made of pulses
u ~ N(0, kappa^2) of acceleration in each state (:mod:`testbench.inference.unknown`). Of residuals r = U u + e, in units
of the noise, the size kappa is that of the largest marginal likelihood, and

    u = (U'U + kappa^-2 I)^-1 U'r,    P = (U'U + kappa^-2 I)^-1.

The model is flown, so that neither noise of vanes nor derivatives of readings enter, and whatever is recorded counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.linear import KAPPAS
from testbench.inference.unknown import PULSE_S, forced_states, rms_acceleration
from testbench.page.labels import number
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import moves_laterally

BANDS_HZ = ((0.0, 0.5), (0.5, 1.5), (1.5, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, 50.0))
_WINDOW_S = 1.0


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """Residual energy of one manoeuvre in units of the noise energy: 1 everywhere if the model is right."""

    manoeuvre: str  #: name
    channels: tuple[str, ...]  #: (p,) outputs
    by_band: FloatArray  #: (bands, p) mean squared residual within each frequency band
    by_time: FloatArray  #: (windows, p) mean squared residual within each window of ``window_s``
    window_s: float  #: length of a window, s

    @property
    def sentence(self) -> str:
        """Channel, time and band of the largest residual, in words."""
        window, channel = np.unravel_index(int(np.argmax(self.by_time)), self.by_time.shape)
        band = BANDS_HZ[int(np.argmax(self.by_band[:, channel]))]
        return (
            f"{self.manoeuvre}: the residual is largest in {self.channels[int(channel)]}, at "
            f"{window * self.window_s:.0f} to {(window + 1) * self.window_s:.0f} s and {band[0]:g} to {band[1]:g} Hz: "
            f"{number(self.by_time[window, channel])} times the noise"
        )


def locate(
    name: str, residuals: FloatArray, channels: Sequence[str], dt_s: float, taken: NDArray[np.bool_]
) -> ResidualMap:
    """Return where the residuals (n, p), in units of the noise, have their energy.

    ``taken`` (n, p) says which samples were taken; the others are zero. A window without any has no energy.
    """
    n, p = residuals.shape
    frequency, power = _periodogram(residuals, dt_s)
    power = power / np.maximum(taken.mean(axis=0), 1.0 / n)
    by_band = np.zeros((len(BANDS_HZ), p))
    for b, (low, high) in enumerate(BANDS_HZ):
        inside = (frequency > low) & (frequency <= high)
        if inside.any():
            by_band[b] = power[inside].mean(axis=0)
    length = min(n, max(1, round(_WINDOW_S / dt_s)))
    windows = [slice(i, i + length) for i in range(0, n - length + 1, length)]
    by_time = np.stack([(residuals[w] ** 2).sum(axis=0) / np.maximum(taken[w].sum(axis=0), 1) for w in windows])
    return ResidualMap(name, tuple(channels), by_band, by_time, length * dt_s)


def _periodogram(residuals: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (f,), Hz, and power (f, p), which white noise of unit variance has as 1 in every bin."""
    n = len(residuals)
    return np.asarray(np.fft.rfftfreq(n, dt_s), float), np.abs(np.fft.rfft(residuals, axis=0)) ** 2 / n


@dataclass(frozen=True)
class Structure:
    """Where residuals hold more energy than white noise, all manoeuvres together."""

    channel: str  #: output
    band_Hz: tuple[float, float]  #: (low, high)
    energy: float  #: mean squared residual within it, 1 is the noise
    probability: float  #: that white noise holds as much in any channel and band (Bonferroni's bound)

    @property
    def sentence(self) -> str:
        """What that says of a name, in words."""
        low, high = self.band_Hz
        return (
            f"the remaining residual is not white: {self.channel} holds {number(self.energy)} times the noise between "
            f"{low:g} and {high:g} Hz; noise alone does this once in {1.0 / max(self.probability, 1e-99):.2g} cases. "
            "Its form is not exact, or the true effect is a similar one"
        )


def structure(
    residuals: Sequence[FloatArray],
    channels: Sequence[str],
    dt_s: float,
    false_alarm: float,
    taken: Sequence[NDArray[np.bool_]] | None = None,
) -> Structure | None:
    """Return the channel and band in which residuals (n, p) are least like white noise; None if they may be noise.

    Periodograms of white noise of unit variance are half a chi-square of two degrees of freedom in each bin between
    mean and Nyquist frequency, independent of one another (Priestley 1981, section 6.1). Their sums over a band are
    compared with that, in all p channels and bands at once. A channel with samples that were not taken, see
    :func:`locate`, is left out, as its bins are not independent.
    """
    whole = [k for k in range(len(channels)) if all(t[:, k].all() for t in taken or ())]
    if not whole:
        return None
    residuals, channels = [r[:, whole] for r in residuals], [channels[k] for k in whole]
    sums, bins = np.zeros((len(BANDS_HZ), len(channels))), np.zeros(len(BANDS_HZ))
    for r in residuals:
        frequency, power = (x[1 : (len(r) + 1) // 2] for x in _periodogram(r, dt_s))
        for b, (low, high) in enumerate(BANDS_HZ):
            inside = (frequency > low) & (frequency <= high)
            sums[b] += power[inside].sum(axis=0)
            bins[b] += inside.sum()
    p = chi2.sf(2.0 * sums, 2.0 * np.maximum(bins, 1.0)[:, None])
    band, c = divmod(int(np.argmin(p)), len(channels))
    probability = min(1.0, float(p[band, c]) * p.size)
    if probability > false_alarm:
        return None
    return Structure(channels[c], BANDS_HZ[band], float(sums[band, c] / bins[band]), probability)


def left_by(amended: Believed, records: Sequence[FlightRecord]) -> Structure | None:
    """Return where the residuals of an amended model are not white; None in moving air, whose model is not exact."""
    if amended.whiten is not None:
        return None
    residuals, taken = zip(*((amended.residuals(r), amended.taken(r)) for r in records), strict=True)
    return structure(residuals, amended.outputs, records[0].dt_s, CRITERIA.false_alarm, taken)


_REGIONS = ("alpha", "V", "q", "de_cmd", "thr_cmd")
_LATERAL_REGIONS = ("beta", "p", "r", "da_cmd", "dr_cmd")
_BINS = 6
_SMOOTH_S = 0.2  # the measured region is smoothed over this time: its own noise must not pick the bin
_FEWEST = 20  # samples that a bin needs to say anything


@dataclass(frozen=True, eq=False)
class RegionMap:
    """Residual energy over one quantity of the flight, all manoeuvres together, in units of the noise energy."""

    quantity: str  #: channel that was measured or commanded
    edges: FloatArray  #: (b + 1,) edges of the bins, SI
    channels: tuple[str, ...]  #: (p,) outputs
    energy: FloatArray  #: (b, p) mean squared residual in each bin; NaN where there are too few samples
    samples: FloatArray  #: (b,) number of samples

    @property
    def contrast(self) -> float:
        """Largest energy of a bin over that of the whole, over all channels; 0 if there is but one bin."""
        if np.isfinite(self.energy).any(axis=1).sum() < 2:
            return 0.0
        weights = self.samples[:, None] / self.samples.sum()
        whole = np.nansum(self.energy * weights, axis=0)
        return float(np.nanmax((self.energy - 1.0) / np.maximum(np.max(whole), 1.0)))

    @property
    def sentence(self) -> str:
        """Where in the flight envelope the residual is largest, in words."""
        b, c = np.unravel_index(int(np.nanargmax(self.energy)), self.energy.shape)
        low, high = self.edges[int(b)], self.edges[int(b) + 1]
        unit = channel(self.quantity).unit
        factor, shown = (1.0 / DEG_RAD, unit.replace("rad", "deg")) if unit.startswith("rad") else (1.0, unit)
        return (
            f"over the flight region the residual is largest at {self.quantity} from {number(low * factor)} to "
            f"{number(high * factor)}{'' if shown == '1' else ' ' + shown}: {number(self.energy[b, c])} times the "
            f"noise in {self.channels[int(c)]}"
        )


def locate_regions(
    records: Sequence[FlightRecord],
    residuals: Sequence[FloatArray],
    channels: Sequence[str],
    taken: Sequence[NDArray[np.bool_]],
) -> tuple[RegionMap, ...]:
    """Return where in alpha, V, pitch rate, elevator and throttle the residuals (n, p) have their energy.

    Where aileron or rudder moves, sideslip, roll and yaw rate and these two are looked at, too. A quantity that no
    record holds, or that hardly moves, is left out. ``taken`` (n, p) as for :func:`locate`.
    """
    energy = np.concatenate([r**2 for r in residuals])
    counted = np.concatenate(taken) * 1.0
    out = []
    for name in (*_REGIONS, *(_LATERAL_REGIONS if moves_laterally(records) else ())):
        if not all(name in r for r in records):
            continue
        length = [max(1, round(_SMOOTH_S / r.dt_s)) for r in records]
        x = np.concatenate([uniform_filter1d(r[name], n, mode="nearest") for r, n in zip(records, length, strict=True)])
        low, high = np.percentile(x, [0.5, 99.5])
        if high - low < 1e-6:
            continue
        edges = np.linspace(low, high, _BINS + 1)
        index = np.clip(np.digitize(x, edges) - 1, 0, _BINS - 1)
        samples = np.bincount(index, minlength=_BINS).astype(float)
        sums, counts = (np.stack([np.bincount(index, x, _BINS) for x in y.T], axis=1) for y in (energy, counted))
        mean = np.where(counts >= _FEWEST, sums / np.maximum(counts, 1.0), np.nan)
        if not np.isfinite(mean).any():  # records so short that no bin says anything
            continue
        edges = np.where(np.abs(edges) < 1e-6 * (high - low), 0.0, edges)  # rounding would be printed
        out.append(RegionMap(name, edges, tuple(channels), mean, samples))
    return tuple(out)


def largest_errors(believed: Believed, records: Sequence[FlightRecord]) -> Mapping[str, float]:
    """Return channel -> largest difference of measurement and prediction, each about its mean over a record, SI.

    Sensor noise and turbulence are in it.
    """
    worst = np.zeros(len(believed.outputs))
    plain = replace(believed, whiten=None)
    for record in records:
        worst = np.maximum(worst, np.max(np.abs(plain.residuals(record)), axis=0) * believed.noise_std)
    return dict(zip(believed.outputs, worst.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Lacking:
    """Accelerations of one manoeuvre that the believed model lacks."""

    manoeuvre: str  #: name
    t_s: FloatArray  #: (s + 1,) edges of the stretches, each of which has one value
    #: state of the model, such as "w" or "q" -> (s,) what is added to its derivative, SI
    accelerations: Mapping[str, FloatArray]
    std: Mapping[str, FloatArray]  #: the same -> (s,) standard errors
    kappa: float  #: size of the unknown motion, a share of the motion; 0 where nothing is lacking


def lacking(believed: Believed, name: str, record: FlightRecord, moved: FloatArray, residuals: FloatArray) -> Lacking:
    """Return what the believed model lacks in one record.

    Pulses ``moved`` (n, p, m), those of surfaces left out, and residuals (n, p) are in units of the noise.
    """
    there = believed.at(record)
    states = forced_states(there.linear)
    U = np.where(believed.taken(record)[:, :, None], moved, 0.0).reshape(residuals.size, -1)
    square, turn = np.linalg.eigh(U.T @ U)
    along = turn.T @ (U.T @ residuals.ravel())
    sizes = np.array(KAPPAS)[:, None] ** 2
    shrunk = sizes / (1.0 + sizes * np.maximum(square, 0.0))
    best = int(np.argmax(0.5 * np.sum(shrunk * along**2 - np.log1p(sizes * np.maximum(square, 0.0)), axis=1)))
    scale = np.array([rms_acceleration(s, there.condition.V_m_s, record) for s in states])[:, None]
    value = scale * (turn @ (shrunk[best] * along)).reshape(len(states), -1)
    std = scale * np.sqrt((turn**2 @ shrunk[best]).reshape(len(states), -1))
    begins = record.t_s[:: max(1, round(PULSE_S / record.dt_s))]
    edges = np.append(begins, record.t_s[-1] + record.dt_s)
    by_state = (dict(zip(states, x, strict=True)) for x in (value, std))
    return Lacking(name, edges, next(by_state), next(by_state), KAPPAS[best])
