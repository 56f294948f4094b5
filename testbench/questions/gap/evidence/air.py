"""The air that was flown through: does it move, how much, and residuals as they would be had it stood still.

Turbulence reaches every channel through the aircraft. To a test that takes residuals for white noise, a gap in still
air and a gust therefore look alike. Two things tell them apart. A gap needs a command, so it does not show in the quiet
flight before the first one; turbulence does. And turbulence has a known spectrum (Dryden), of which only rms and height
are to be estimated. In a Kalman filter of the believed aircraft in turbulence, the innovations of the residual are
white with covariance S, and S^(-1/2) times them is white noise of variance one (filter error; R. V. Jategaonkar, Flight
Vehicle System Identification, 2nd ed., 2015, chapter 5). The filter is linear: it takes the same out of a residual and
out of an effect's signature, so that the likelihoods of hypotheses remain comparable.

Many filters are tried to find rms and height, so these are steady and about trim. A filter along each flight then
whitens its residuals.

Recorded surfaces freed of noise, as far as the motion tells it.

Where a recorded surface u drives the believed model G, its noise is in the regressor: least squares of y - G(theta) u,
however well it is weighed, takes a control for weaker than it is (errors in variables; W. A. Fuller, Measurement Error
Models, 1987, chapter 1). The noise is white and of known size, so the residual of the believed model tells its
likeliest course s, by the smoother that belongs to the filter that whitens residuals (A. E. Bryson and M. Frazier,
1963). The model is then driven by u + s, and what s changes in the flight of the believed model is taken out of what
was measured: the residual stays what it was, and what an effect or a coefficient changes is uncorrelated with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.air import LOWEST_M
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import quiet_samples, starts_freely, surface_noise
from testbench.questions.gap.evidence.gust_filter import FlightFilter, GustFilter, GustModel

_RMS_M_S = (0.01, 3.0)  # vertical rms that is looked for
_HEIGHTS_M = (15.0, 60.0, 250.0, 700.0)  # above ground; all lengths are 1750 ft from 2000 ft on


@dataclass(frozen=True)
class AirFound:
    """What the residuals say of the air."""

    moves: bool  # True if turbulence was found
    rms_m_s: float  # vertical rms; 0 if it does not move
    height_m: float  # above ground, as the scale lengths of the turbulence tell it
    gain: float  # likelihood-ratio statistic of turbulence against none: twice the gain in log-likelihood
    threshold: float  # what noise alone exceeds with probability ``Criteria.false_alarm``
    quiet_s: float  # quiet flight that was listened to, all records together
    # False if it was not found in the quiet flight but over all records, more likely than any effect
    in_quiet: bool = True

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        if not self.quiet_s and not self.moves:
            return (
                "no record begins with quiet flight, which would show turbulence: it is not known whether the air "
                "moved, and the residuals are compared with the noise of the sensors alone"
            )
        heard = f"likelihood-ratio statistic {self.gain:.3g}, threshold {self.threshold:.3g}"
        if not self.moves:
            return (
                f"no turbulence is found in the {self.quiet_s:.3g} s of quiet flight before the commands ({heard}); "
                "the residuals are compared with the noise of the sensors alone"
            )
        where = (
            "the quiet flight before the commands shows turbulence"
            if self.in_quiet
            else "turbulence explains more of the residual than any effect"
        )
        return (
            f"the air moved: {where} ({heard}); its vertical rms is {self.rms_m_s:.2g} m/s; a Kalman filter of the "
            "a-priori model in this turbulence whitens the residuals of every test"
        )


def listen(believed: Believed, records: Sequence[FlightRecord]) -> AirFound:
    """Look for turbulence in the quiet flight before the first commands.

    Its rms is first taken from the quiet flight, too: in the manoeuvres, wrong coefficients and missing effects add to
    it. :func:`listen_in_flight` and :func:`listen_again` measure it over all records.

    The test is a likelihood ratio of turbulence against none. As the rms 0 lies on the edge of its range, the statistic
    is half a chi-square with one degree of freedom (Chernoff 1954). Trim errors and biases are free in both hypotheses,
    and so is the drift of an instrument that explains more than turbulence would (:func:`_steadied`). Records that
    start freely have no quiet flight. If there is none at all, nothing is said of the air.
    """
    plain = replace(believed, whiten=None)
    quiet = _quiet(plain, records)
    height = max(believed.condition.h_m, LOWEST_M)
    if not quiet:
        return AirFound(False, 0.0, height, 0.0, float("inf"), 0.0)
    threshold = _threshold()
    rms, gain = _likeliest(plain, quiet, height)
    if gain > threshold:
        rms, gain = _likeliest(plain, _steadied(plain, quiet, height), height)
    moves = gain > threshold
    return AirFound(moves, rms if moves else 0.0, height, gain, threshold, sum(r.duration_s for r, _ in quiet))


def measure(model: Believed, records: Sequence[FlightRecord], heard: AirFound) -> AirFound:
    """Return ``heard`` with the rms and height that make the residuals of ``model`` on ``records`` likeliest.

    Short records hardly tell rms and height apart, so the height is kept unless another one is clearly likelier.
    """
    residuals = plain_residuals(model, records)
    heights = dict.fromkeys((heard.height_m, *_HEIGHTS_M))
    found = [(*_likeliest(model, residuals, h), h) for h in heights]
    best = max(found, key=lambda f: f[1])
    rms, _, height = found[0] if best[1] - found[0][1] <= CRITERIA.air_refuted else best
    return replace(heard, rms_m_s=rms, height_m=height)


def _threshold() -> float:
    """Return what the statistic of turbulence exceeds in noise alone with a probability of ``false_alarm``."""
    return float(chi2.isf(2.0 * CRITERIA.false_alarm, 1))


def listen_in_flight(tuned: Believed, records: Sequence[FlightRecord], heard: AirFound) -> AirFound:
    """Return ``heard`` with the rms and height of all records, coefficients re-tuned in ``tuned``.

    All records tell more of the air than a few seconds of quiet flight, but a gap adds to their rms. If the quiet
    flight refutes that rms, ``heard`` is returned as it is.
    """
    found = measure(tuned, records, heard)
    return heard if _refuted(tuned, records, found, heard) else found


def listen_again(amended: Believed, records: Sequence[FlightRecord], heard: AirFound, unknown: float) -> AirFound:
    """Return what all of the records say of the air, once something was named.

    If turbulence was heard, its rms is measured anew beside what was named, as a gap adds to it. If it was not, light
    turbulence may still be what is left, as it does not show in a second or two of quiet flight, or in none. It is the
    better explanation if it gains more likelihood than an unknown motion does, and if the quiet flight, where there is
    any, does not refute that rms: a gap that no effect explains looks like turbulence from the first command on.
    ``unknown`` is twice what an unknown motion beside what was named gains in ln p.
    """
    if heard.moves:
        return measure(amended, records, heard)
    rms, of_turbulence = _likeliest(amended, plain_residuals(amended, records), heard.height_m)
    if of_turbulence <= max(_threshold(), unknown):
        return heard
    if _refuted(amended, records, replace(heard, rms_m_s=rms), replace(heard, rms_m_s=0.0)):
        return heard
    found = replace(heard, moves=True, rms_m_s=rms, gain=of_turbulence, threshold=_threshold(), in_quiet=False)
    return measure(amended, records, found)


def misfit(believed: Believed, residuals: Sequence[tuple[FlightRecord, FloatArray]], air: AirFound) -> float:
    """Return minus twice the log-likelihood of residuals in units of the noise in ``air``, but for a constant."""
    return _cost(believed, _models(believed, air.height_m, residuals), residuals, air.rms_m_s)


def _models(
    believed: Believed, height_m: float, residuals: Sequence[tuple[FlightRecord, FloatArray]]
) -> list[GustModel]:
    """Return the believed aircraft in turbulence about the trim of each record; one trim gives one model."""
    there = [believed.at(record) for record, _ in residuals]
    dt_s = residuals[0][0].dt_s
    found = {id(b): GustModel.at_trim(b, height_m, dt_s) for b in {id(b): b for b in there}.values()}
    return [found[id(b)] for b in there]


def _refuted(believed: Believed, records: Sequence[FlightRecord], air: AirFound, other: AirFound) -> bool:
    """Return whether there is quiet flight, and so much likelier in the ``other`` air that ``air`` is ruled out."""
    plain = replace(believed, whiten=None)
    quiet = _steadied(plain, _quiet(plain, records), air.height_m)
    return bool(quiet) and misfit(believed, quiet, air) - misfit(believed, quiet, other) > CRITERIA.air_refuted


def plain_residuals(model: Believed, records: Sequence[FlightRecord]) -> list[tuple[FlightRecord, FloatArray]]:
    """Return records and their residuals (n, outputs) in units of the noise, as if nothing coloured them."""
    plain = replace(model, whiten=None)
    # The filter takes out where the aircraft began by itself.
    return [(r, plain.over_noise(r, r.columns(plain.outputs) - plain.predict(r))) for r in records]


def in_air(believed: Believed, air: AirFound, along: Believed | None = None) -> Believed:
    """Return ``believed`` with residuals that are white in ``air``; as it is if nothing colours them.

    The turbulence works on the flights of ``along``, those of ``believed`` if that is not given, and on sensors as they
    are believed: whitened as one that errs reads gusts, residuals beside all other explanations would be coloured. The
    noise of recorded surfaces that drive the model works on these flights, too.
    """
    if not (air.moves or believed.surface_noise):
        return believed
    return replace(believed, whiten=filter_in(along or believed, air, believed).whiten)


def filter_in(along: Believed, air: AirFound, believed: Believed | None = None) -> FlightFilter:
    """Return the filter along the flights of ``along`` in that air, with the sensors of ``believed``, if given."""
    rms_m_s, sensors = air.rms_m_s if air.moves else 0.0, (believed or along).suite
    return FlightFilter(replace(along, whiten=None), rms_m_s, air.height_m, sensors)


def _quiet(plain: Believed, records: Sequence[FlightRecord]) -> list[tuple[FlightRecord, FloatArray]]:
    """Return the flight before the first command of every record that begins at trim, and its residuals there."""
    out = []
    for record in records:
        if starts_freely(record):
            continue
        n = quiet_samples(record)
        start = record.between(float(record.t_s[0]), float(record.t_s[n - 1]) + 0.5 * record.dt_s)
        out.append((start, plain.in_noise_units(start, start.columns(plain.outputs))))
    return out


def _steadied(
    believed: Believed, quiet: Sequence[tuple[FlightRecord, FloatArray]], height_m: float
) -> list[tuple[FlightRecord, FloatArray]]:
    """Return residuals of quiet flight without the steady drifts of instruments that explain more than turbulence does.

    An instrument that drifts has one slope in all records, to within its noise, which moving air has not: one parameter
    of one channel.
    """
    out = [(record, r.copy()) for record, r in quiet]
    if len(out) < 2:
        return out
    times = [record.t_s - record.t_s.mean() for record, _ in out]
    squares = np.array([float(t @ t) for t in times])
    scatter = float(chi2.isf(CRITERIA.false_alarm, len(out) - 1))
    while True:
        own = np.array([t @ r for t, (_, r) in zip(times, out, strict=True)])  # (records, outputs)
        slopes = own.sum(axis=0) / squares.sum()
        gains = slopes**2 * squares.sum()
        alike = (own**2 / squares[:, None]).sum(axis=0) - gains < scatter
        k = int(np.argmax(np.where(alike, gains, 0.0)))
        if not alike[k] or gains[k] <= CRITERIA.least or gains[k] <= _likeliest(believed, out, height_m)[1]:
            return out
        for t, (_, r) in zip(times, out, strict=True):
            r[:, k] -= slopes[k] * t


def _likeliest(
    believed: Believed, residuals: Sequence[tuple[FlightRecord, FloatArray]], height_m: float
) -> tuple[float, float]:
    """Return the rms that is likeliest at one height, and twice the log-likelihood that it gains over none."""
    models = _models(believed, height_m, residuals)

    def cost(log_rms: float) -> float:
        return _cost(believed, models, residuals, float(np.exp(log_rms)))

    low, high = np.log(_RMS_M_S)
    grid = np.linspace(low, high, 9)
    costs = [cost(x) for x in grid]
    k = int(np.argmin(costs))
    bounds = (grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)])
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.02})
    return float(np.exp(found.x)), max(_cost(believed, models, residuals, 0.0) - float(found.fun), 0.0)


def _cost(
    believed: Believed,
    models: Sequence[GustModel],
    residuals: Sequence[tuple[FlightRecord, FloatArray]],
    rms_m_s: float,
) -> float:
    """Return minus twice the log-likelihood of residuals in units of the noise at an rms, but for a constant.

    Each record's residuals have the model of its condition.
    """
    filters: dict[tuple[int, bytes], GustFilter] = {}
    taken = [believed.taken(record) for record, _ in residuals]
    both = zip(models, taken, strict=True)
    for model, one in sorted(both, key=lambda p: len(p[1]), reverse=True):
        # the filter of a shorter record is the beginning of that of a longer one from the same condition
        of, key = id(model), one.tobytes()
        longer = next((f for (m, k), f in filters.items() if m == of and k.startswith(key)), None)
        if (of, key) not in filters:
            filters[of, key] = GustFilter.of(model, rms_m_s, one) if longer is None else longer.first(len(one))
    total = 0.0
    for model, one, (_, r) in zip(models, taken, residuals, strict=True):
        found = filters[id(model), one.tobytes()]
        total += float(np.sum(found.whiten(r) ** 2)) + found.log_det
    return total


def smoothed(believed: Believed, air: AirFound, records: Sequence[FlightRecord]) -> list[FlightRecord]:
    """Return records whose surfaces, where noisy ones drive the model, are what the motion says that they were."""
    if not believed.surface_noise:
        return list(records)
    known, outputs, out = filter_in(believed, air), believed.outputs, []
    for record in records:
        stirring = {f"{c}_cmd": c for c in surface_noise(record) if believed.surface_noise.get(c)}
        if stirring:
            predicted = believed.predict(record)
            left = believed.over_noise(record, record.columns(outputs) - predicted)
            errors = known.surface_errors(record, left)
            driven = record.with_columns({n: record[n] + errors[c] for n, c in stirring.items()})
            measured = record.columns(outputs) + believed.predict(driven) - predicted
            record = driven.with_columns(dict(zip(outputs, measured.T, strict=True)))
        out.append(record)
    return out
