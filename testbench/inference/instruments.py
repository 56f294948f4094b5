"""Do the instruments of records agree with one another, and if not, which one errs, by how much, how probably?

What each instrument should have read by kinematics (:mod:`.kinematics`) is compared with what it read. Every instrument
has scale, clock and place that are known as well as those of a sound one; a hypothesis lets one of these of one
instrument be as wrong as those of a faulty one. What is left is white noise of unknown size beside a process of first
order, of unknown size and time: gusts, where flow angles and airspeed are compared, integrated noise, and the filter of
an attitude. Of a size that neither air nor sound instruments have it is a hypothesis, too: something unknown.

White noise and a process of first order, e = n + g, g_k = a g_(k-1) + w_k, are moving averages of first order after
e_k - a e_(k-1): their covariance has three diagonals, and one factor of it whitens all columns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from scipy.special import logsumexp
from scipy.stats import norm

from testbench.core.blas import on_one_thread
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.regression.smoothing import white_std
from testbench.inference.kinematics import ANGLES, BESIDE, FLOW, FORCES, RATES, Kinematics
from testbench.inference.linear import Grams, sized

CLEAR = 0.9  # probability from which an answer is said without a doubt
KINDS: Mapping[str, tuple[float, float]] = {
    "scale": (0.01, 0.1),
    "late": (0.005, 0.05),
    "lag": (0.0, 0.05),
    "place": (0.02, 0.3),
    "turned": (0.01, 0.05),
}
"""Kind of error -> prior standard deviations of a sound instrument and of a faulty one: shares of what is read, s, s, m
ahead of the centre of gravity, rad."""
_SCALES = dict.fromkeys(FLOW, 0.03) | {"V": 0.02}
"""Prior standard deviations of scales that are less well known: upwash at a vane, a static port."""
_BIAS = dict.fromkeys(RATES, 0.02) | dict.fromkeys(FORCES, 0.3)  # rad/s, m/s2
_WITHOUT_GRAVITY = (3.0, 20.0)  # m/s2: beyond this mean an accelerometer's zero is its own; its prior then
_FILTER_S = 0.01  # mean and standard deviation of the lag of an attitude that a sound filter makes
_PITCHED_RAD = 0.2  # of a trim whose pitch angle is not recorded
_BAROMETER_S = 0.3  # that a height, or a speed over ground, may be late by
_WIND_M_S, _VANE_RAD = 3.0, 0.05
_LEVEL_WIND_M_S = 20.0
_FINEST = {"V": 5e-3, "h": 1e-2, "Vg": 5e-3}  # m/s, m; rad: 1e-4. Less noise is none: integration errs by as much
_FALSE = 0.001  # probability that an error is told from none where there is none, if only noise were in the way
_P_FAULTY = 0.25
_P_UNKNOWN = 0.02
_TIMES_S = (0.5, 2.0, 8.0)
_SIZES = tuple(float(x) for x in np.geomspace(3e-3, 3.0, 10))
"""Of the process of first order: its correlation time, and its innovations over the white noise of one sample."""
_SOUND = {"theta": 1.0 * DEG_RAD, "phi": 1.0 * DEG_RAD, "psi": 2.0 * DEG_RAD, "V": 1.5, "h": 1.5, "Vg": 1.5}
_MET = ("met", "metrise", "metforce", "metrate", "metturn")
"""What answers to gusts: a flow angle, its derivative, a force, a rate, and the angle turned. An aircraft turns into a
gust and rises with it, so that its motion goes with the gust that a vane reads beside it, as if scale or timing of vane
or accelerometer were others."""
_ANSWERED_S, _ANSWER = 1.0, 1.5
# Of the motion of a flow angle: larger gusts, of which forces and rates tell more than a vane can be asked.
_GUSTY = 0.04
_STEEP = 200.0  # in ln p, for a process e times as large
_CLEARLY = 3.0  # in ln p
_GUSTS_M_S = 1.5  # largest rms of what is left but for white noise: rad, m/s (of a height: of its rate), and of gusts
_SPREAD = 0.3
_ENOUGH = 4000  # samples of all records together: what they do not tell, more of them would not
_SMOOTH_S = 0.04  # of a rate before its derivative
_MOVED = 2.0  # times its noise: below it a channel rests, and says nothing
_START = 10.0  # times the noise: prior of what a record begins with
_LED = 8  # hypotheses that are put about their own estimates
_LITTLE = 0.1  # in ln p
_ROUNDS = 3
_AGAIN = 2  # times that sound instruments are put about their own errors
_STILL = 0.2  # of a standard error
_UNTOLD = 1e-3  # of the precision of priors: what records tell by less is nothing


@dataclass(frozen=True)
class InstrumentFault:
    """One error of one instrument that may explain why instruments do not agree."""

    channel: str  # of the instrument
    kind: str  # "scale", "late" (its clock), "lag", "place" or "turned", see :data:`KINDS`
    probability: float  # that this, and nothing else, is wrong
    # estimate, std: size and standard error if so, in the units of :data:`KINDS`
    estimate: float
    std: float

    @property
    def name(self) -> str:
        """Channel and kind."""
        return f"{self.channel}_{self.kind}"


@dataclass(frozen=True, eq=False)
class Agreement:
    """What kinematics say of the instruments of records.

    Attributes:
        compared: channels that others foretell.
        instruments: channels that were asked about.
        p_agree: probability that all agree.
        p_unknown: that they do not, and no single error says why.
        faults: all single errors, the most probable first.
        gusty: flow angles that could not be compared, as gusts moved them.
        left: channel -> (white noise of one sample, rms of what is left beside it), SI, under the best hypothesis.
        errors, errors_mean, errors_covariance: all errors of instruments (k,), their posterior mean and covariance if
            all are sound; where they are contradicted, under the best hypothesis.
    """

    compared: tuple[str, ...] = ()
    instruments: tuple[str, ...] = ()
    p_agree: float = 1.0
    p_unknown: float = 0.0
    faults: tuple[InstrumentFault, ...] = ()
    gusty: tuple[str, ...] = ()
    left: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    errors: tuple[str, ...] = ()
    errors_mean: FloatArray = field(default_factory=lambda: np.zeros(0))
    errors_covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def by_instrument(self) -> dict[str, float]:
        """Channel -> probability that its instrument errs, the most probable first."""
        total: dict[str, float] = {}
        for f in self.faults:
            total[f.channel] = total.get(f.channel, 0.0) + f.probability
        return dict(sorted(total.items(), key=lambda item: -item[1]))

    @property
    def gusts_felt(self) -> bool | None:
        """Whether flow angles or airspeed show gusts, larger than the noise of one sample; None if nothing read does.

        An airspeed alone shows those along the path.
        """
        read = [c for c in ("alpha", "beta", "V") if c in self.left]
        felt = bool(self.gusty) or any(self.left[c][1] > self.left[c][0] for c in read)
        return felt or (False if {"alpha", "beta"} & set(read) else None)

    @property
    def contradicted(self) -> bool:
        """Whether the instruments clearly do not agree."""
        return 1.0 - self.p_agree >= CLEAR

    @property
    def fault(self) -> InstrumentFault | None:
        """The most probable error, if it clearly is its instrument that errs."""
        if not self.contradicted or not self.faults:
            return None
        first, probability = next(iter(self.by_instrument.items()))
        return next(f for f in self.faults if f.channel == first) if probability >= CLEAR else None


def taken_for_sure(found: Agreement) -> dict[str, float]:
    """Return the small errors that sound instruments are found to have by more than two standard deviations."""
    if found.contradicted:
        return {}
    std = np.sqrt(np.diag(found.errors_covariance))
    return {
        n: float(x)
        for n, x, s in zip(found.errors, found.errors_mean, std, strict=True)
        if n.rpartition("_")[2] in KINDS and abs(x) > 2.0 * s
    }


def without_errors(record: FlightRecord, errors: Mapping[str, float]) -> FlightRecord:
    """Return a record with errors of its instruments taken out, still of kind "measured".

    Of y(t) = (1 + scale) x(t - late) + bias, lagged by tau, what is returned is

        x(t) = (y(t + late) + tau ydot(t + late) - bias) / (1 + scale).

    A lag is inverted with the derivative over one time constant, to first order: noise grows. Samples that lateness
    leaves without a source at an end of the record are held and marked not valid. ``provenance`` holds what was done
    under "corrected", a scale as the factor.

    Args:
        record: measured.
        errors: CHANNEL_KIND -> size, see :data:`KINDS`, and CHANNEL_bias. Those of channels that it lacks are left.

    Raises:
        ChannelError: an accelerometer is to be moved without the rate, or an axis turned back without the force.
        RecordError: the record is not sampled uniformly.

    Example:
        >>> import testbench as tb
        >>> tb.without_errors(record, {"q_scale": -0.15})  # doctest: +SKIP
    """
    columns: dict[str, FloatArray] = {}
    valid, done = record.valid.copy(), dict[str, float]()
    for name, size in errors.items():
        c, kind = name.rpartition("_")[::2]
        if c not in record:
            continue
        if kind == "place":
            rate, way = ("q", 1.0) if c == "az" else ("r", -1.0)
            turning = np.gradient(gaussian_filter1d(record[rate], _SMOOTH_S / record.dt_s), record.dt_s)
            columns[c] = columns.get(c, record[c]) + way * size * turning
        elif kind == "turned":
            columns[c] = columns.get(c, record[c]) - size * record[dict(BESIDE)[c]]
        else:
            columns.setdefault(c, record[c])
            done[f"{c}_delay" if kind == "late" else name] = 1.0 + size if kind == "scale" else size
    for c in dict.fromkeys(n.rpartition("_")[0] for n in done):
        y, at = columns[c].copy(), np.arange(len(record))
        late, lag = done.get(f"{c}_delay", 0.0), done.get(f"{c}_lag", 0.0)
        if lag > 0.0:
            reach = max(1, round(min(0.5 * lag / record.dt_s, y.size)))
            before, after = np.maximum(at - reach, 0), np.minimum(at + reach, y.size - 1)
            y = y + lag * (y[after] - y[before]) / ((after - before) * record.dt_s)
        if late:
            t, i = record.t_s - record.t_s[0], record.channels.index(c)
            y = np.interp(t + late, t, y)
            source = np.rint(np.clip((t + late) / record.dt_s, 0, y.size - 1)).astype(int)
            valid[:, i] = valid[source, i] & (t + late >= 0.0) & (t + late <= t[-1] + 1e-9)
        columns[c] = (y - done.get(f"{c}_bias", 0.0)) / done.get(f"{c}_scale", 1.0)
    if not columns:
        return record
    note = {"corrected": {"errors": done}} if done else {}
    return replace(record.with_columns(columns), valid=valid, provenance={**record.provenance, **note})


@on_one_thread
def agreement(
    records: Sequence[FlightRecord], known_std: Mapping[str, float] | None = None, gravity_m_s2: float = G0_M_S2
) -> Agreement:
    """Compare the instruments of measured records with one another by rigid-body kinematics.

    Args:
        records: of one flight or of several by the same instruments, not as deviations from trim.
        known_std: CHANNEL_KIND -> standard deviation of that error of a sound instrument, where it is known.
        gravity_m_s2: at the place of the flight.

    Returns:
        What is known of them; of records without any relation that nothing contradicts them.

    Example:
        >>> import testbench as tb
        >>> tb.agreement([record]).p_agree  # doctest: +SKIP
    """
    return agreement_of(_bound(records, gravity_m_s2), known_std or {})


def _bound(records: Sequence[FlightRecord], gravity_m_s2: float, ground: bool = False) -> list[Kinematics]:
    """Return the records as far as kinematics bind them, with the channels that all have and that move in some."""
    parts, samples = [], 0
    for record in records:
        part = Kinematics.of(record, gravity_m_s2, ground)
        if part.compared and samples < _ENOUGH:
            parts.append(part)
            samples += len(part.x[part.compared[0]])
    common = [c for c in parts[0].compared if all(c in k.compared for k in parts)] if parts else []
    moved = [c for c in common if max(float(np.std(k.x[c])) for k in parts) > _MOVED * _white(parts, c)]
    return [replace(k, compared=tuple(moved)) for k in parts]


@dataclass(frozen=True, eq=False)
class Foretold:
    """What the others foretell of the channels of a record, with errors of the instruments and without."""

    t_s: FloatArray  # (n,) from the first sample of the record
    measured: Mapping[str, FloatArray]  # channel -> (n,), SI
    # before, after: the same, foretold without an error and with those that are found; a constant of each is its own
    before: Mapping[str, FloatArray]
    after: Mapping[str, FloatArray]

    @classmethod
    def of(cls, part: Kinematics, errors: Mapping[str, float]) -> Foretold:
        """Return what is foretold of one record with these errors."""
        t = np.asarray(part.dt_s * (np.arange(len(part.x[part.compared[0]])) + 0.5))
        told: list[dict[str, FloatArray]] = []
        for at in ({}, errors):
            read = part.readings(at)
            told.append({c: y + float(np.mean(part.x[c] - y)) for c, y in zip(part.compared, read.T, strict=True)})
        return cls(t, {c: part.x[c] for c in part.compared}, *told)


@dataclass(frozen=True, eq=False)
class EveryError:
    """All errors of instruments at once, each perhaps as large as that of a faulty one."""

    # those that the records tell from none, CHANNEL_KIND -> size and standard error if there are no others, those that
    # are lost included; biases and the wind are among them
    found: Mapping[str, tuple[float, float]]
    # those that the records decide, to a third of what they may be, -> the same if all of them are there
    told: Mapping[str, tuple[float, float]]
    lost: Mapping[str, tuple[float, float]]  # the others -> standard error beside all others, and what they may be
    # error found -> others that would explain the records as well in its place -> the same of them
    rivals: Mapping[str, Mapping[str, tuple[float, float]]]
    foretold: tuple[Foretold, ...]  # of every record, with the errors found

    @property
    def sizes(self) -> dict[str, float]:
        """Sizes of the errors that are found."""
        return {name: size for name, (size, _) in self.found.items()}

    def rms(self, channel: str) -> tuple[float, float]:
        """Return root mean square of measured less foretold of a channel, without errors and with those found, SI."""
        before, after = (
            np.concatenate([f.measured[channel] - getattr(f, which)[channel] for f in self.foretold])
            for which in ("before", "after")
        )
        return float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2)))


@on_one_thread
def every_error(records: Sequence[FlightRecord], gravity_m_s2: float = G0_M_S2) -> EveryError | None:
    """Return all errors of the instruments of measured records, estimated together; None without a relation.

    Of the errors, in the order in which they are believed, those are asked for that the records can tell apart. Of them
    the surest is added to those that are found until no other differs from none; whichever it explains is taken back.

    Args:
        records: of one flight or of several by the same instruments, not as deviations from trim.
        gravity_m_s2: at the place of the flight; an error of it shows as a bias of the accelerometers.

    Raises:
        EstimationError: gravity is not a number above 0.
    """
    if not 0.0 < gravity_m_s2 < math.inf:
        raise EstimationError(f"gravity must be > 0 m/s2 and finite, got {gravity_m_s2:g}")
    parts = _bound(records, gravity_m_s2, ground=True)
    if not parts or not parts[0].compared:
        return None
    asked = _Asked(parts, {}, _steady(parts))
    row = asked.coloured(asked.origin, "", asked.beginning(), bounded=False)
    for _ in range(_ROUNDS):
        row = asked.coloured(asked.origin.about(row.at, "", every=True), "", row)
    names, prior = tuple(row.at), np.array(list(asked.std.values()))
    precision, right = asked.told(row)

    def among(places: Sequence[int], known: float = 0.0) -> tuple[FloatArray, FloatArray]:
        P = np.linalg.inv(precision[np.ix_(places, places)] + known * np.diag(prior[places] ** -2.0))
        return P @ right[places], np.sqrt(np.diag(P))

    def named(places: Sequence[int]) -> dict[str, tuple[float, float]]:
        return {names[i]: (float(x), float(s)) for i, x, s in zip(places, *among(places), strict=True)}

    told = list[int]()
    for i in range(len(names)):
        if np.all(among([*told, i], 1.0)[1] <= prior[[*told, i]] / 3.0):
            told.append(i)
    left, sure = list[int](), float(norm.isf(0.5 * _FALSE / max(len(told), 1)))

    def surety(places: Sequence[int]) -> FloatArray:
        return np.abs(np.divide(*among(places)))

    while new := {surety([*left, i])[-1]: i for i in told if i not in left}:
        if max(new) < sure:
            break
        left.append(new[max(new)])
        while (z := surety(left)).min() < sure:  # what was taken for it
            left.pop(int(np.argmin(z)))
    found, std = named(left), among(range(len(names)), 1.0)[1]
    lost = {n: (float(std[i]), float(prior[i])) for i, n in enumerate(names) if i not in told}
    rivals: dict[str, dict[str, tuple[float, float]]] = {}
    for i in left:
        others = [j for j in left if j != i]
        least = surety([*others, i])[-1] ** 2 - 2.0 * _CLEARLY
        for j in (j for j, n in enumerate(names) if n not in found):
            x, s = (float(of[-1]) for of in among([*others, j], 1.0))
            if (x / s) ** 2 > least and abs(x) < 3.0 * prior[j]:
                rivals.setdefault(names[i], {})[names[j]] = x, s
    sizes = {n: x for n, (x, _) in found.items()}
    return EveryError(found, named(told), lost, rivals, tuple(Foretold.of(part, sizes) for part in parts))


def _steady(parts: Sequence[Kinematics]) -> dict[str, float]:
    """Return error -> how large it may be, in the order in which errors are believed where records cannot tell them.

    In steady air, by accelerometers that err by a constant.
    """
    first = parts[0]

    def of(kind: str, size: float, names: Sequence[str]) -> dict[str, float]:
        return {f"{c}_{kind}": size for c in names if c in first.instruments}

    compared = [c for c in (*FLOW, "V") if c in first.compared]
    out = of("bias", 3.0 * DEG_RAD, RATES) | of("bias", 1.0, FORCES)
    out |= of("scale", 0.5, FLOW) | of("scale", 0.3, ("V",)) | of("late", 0.3, compared)
    out |= {"wind_bias": 3.0} if "h" in first.compared else {}
    out |= {"north_bias": 20.0, "east_bias": 20.0} if "Vg" in first.compared else {}
    out |= of("scale", 0.2, ("theta", "phi")) | of("scale", 0.1, RATES)
    return out | of("bias", 0.02, ("theta", "phi", *FLOW)) | of("bias", 0.5, ("V",))  # much like those of forces


def agreement_of(parts: Sequence[Kinematics], known_std: Mapping[str, float]) -> Agreement:
    """Return the same for records that are prepared, all with the same channels compared."""
    return _Asked(parts, known_std).answer() if parts and parts[0].compared else Agreement()


def sound(channel: str, dt_s: float) -> dict[str, float]:
    """Return error -> prior standard deviation of a sound instrument whose channel no other foretells."""
    return {
        f"{channel}_scale": _SCALES.get(channel, KINDS["scale"][0]),
        f"{channel}_late": math.hypot(KINDS["late"][0], 0.25 * dt_s),
    }


def _priors(parts: Sequence[Kinematics]) -> dict[str, float]:
    """Return error -> prior standard deviation if all instruments are sound."""
    std: dict[str, float] = {}
    first = parts[0]
    for c in first.instruments:
        if c in _BIAS:
            std[f"{c}_bias"] = _BIAS[c]
        if c in FORCES and any(abs(float(np.mean(_beyond_gravity(part, c)))) > _WITHOUT_GRAVITY[0] for part in parts):
            std[f"{c}_bias"] = _WITHOUT_GRAVITY[1]
        if c not in ("h", "psi", "Vg"):
            std[f"{c}_scale"] = _SCALES.get(c, KINDS["scale"][0])
            std[f"{c}_lag"] = _FILTER_S if c in ANGLES else KINDS["lag"][0]
        std[f"{c}_late"] = _BAROMETER_S if c in ("h", "Vg") else math.hypot(KINDS["late"][0], 0.25 * first.dt_s)
        if c in ("az", "ay"):
            std[f"{c}_place"] = KINDS["place"][0]
    for c, source in BESIDE:
        if {c, source} <= set(first.instruments):
            std[f"{c}_turned"] = KINDS["turned"][0] if _judged(first, f"{c}_turned") else _PITCHED_RAD
    if "h" in first.compared:
        speed = max(float(np.mean(part.x["V"])) for part in parts)
        std["wind_bias"] = math.hypot(_WIND_M_S, _VANE_RAD * speed)  # zeros of vane and attitude look like it
    if "Vg" in first.compared:
        std |= {"north_bias": _LEVEL_WIND_M_S, "east_bias": _LEVEL_WIND_M_S}
    return std | {f"{c}_{how}": 0.0 for c in FLOW if c in first.compared for how in _MET}


def _judged(part: Kinematics, error: str) -> bool:
    """Return whether an error may be a fault: a turned roll gyro is what a pitch angle is that is not read."""
    return error != "p_turned" or "theta" in part.x


def _beyond_gravity(part: Kinematics, c: str) -> FloatArray:
    theta, phi = (part.x.get(n, np.zeros(1)) for n in ("theta", "phi"))
    gravity = {"ax": -np.sin(theta), "ay": np.cos(theta) * np.sin(phi), "az": np.cos(theta) * np.cos(phi)}[c]
    return np.asarray(part.x[c] + part.gravity_m_s2 * gravity)


def _white(parts: Sequence[Kinematics], c: str) -> float:
    """Return the standard deviation of white noise of one sample, no less than integration errs by."""
    return max(white_std([part.x[c] for part in parts]), _FINEST.get(c, 1e-4))


@dataclass(frozen=True)
class _Colour:
    """Places in the grids of correlation time and relative size, of the process of first order of each channel."""

    time: tuple[int, ...]
    size: tuple[int, ...]

    def moved(self, c: int, time: int, size: int) -> _Colour:
        """Return the colour with another of channel ``c``."""
        return _Colour((*self.time[:c], time, *self.time[c + 1 :]), (*self.size[:c], size, *self.size[c + 1 :]))


@dataclass(frozen=True, eq=False)
class _Weighed:
    """Evidence of one hypothesis."""

    log_evidence: float  # natural logarithm
    colour: _Colour  # with which it is largest
    scales: FloatArray  # (p,) of white noise, over what third differences say
    at: Mapping[str, float]  # error -> most probable value
    # value, std: of the error in question, if it is one
    value: float
    std: float
    covariance: FloatArray  # (k, k) of the errors ``at``


def _left(part: Kinematics, read: FloatArray) -> FloatArray:
    """Return measured less foretold (n, p), from the first sample on."""
    left = np.stack([part.x[c] for c in part.compared], axis=1) - read
    return np.asarray(left - left[0])


def _met(part: Kinematics, read: FloatArray, name: str) -> FloatArray:
    """Return a motion (n, p) that answers to gusts, in one flow angle and as large as that angle's own."""
    c, what = name.split("_")
    at, out = part.compared.index(c), np.zeros_like(read)
    force, rate = ("az", "q") if c == "alpha" else ("ay", "r")
    y = read[:, at]
    if what in ("metforce", "metrate"):
        y = part.x[force if what == "metforce" else rate]
    elif what == "metturn":
        y = np.cumsum(part.x[rate])
    elif what == "metrise":
        y = np.gradient(gaussian_filter1d(y, 2.0))
    y = y - y.mean()
    out[:, at] = y * (np.std(read[:, at]) / max(float(np.std(y)), 1e-12))
    return out


class _Point:
    """Residuals and their tangents about some errors, whitened for every colour that is asked for."""

    def __init__(self, parts: Sequence[Kinematics], noise: FloatArray, stds: Mapping[str, float]) -> None:
        self.parts, self.noise, self.names = parts, noise, tuple(stds)
        self.at: Mapping[str, float] = {}
        self.steps = {n: 0.1 * (s or KINDS["lag"][1]) for n, s in stds.items()}
        self.tables = [self._table(part) for part in parts]
        self._whitened: dict[tuple[int, int, int], tuple[list[FloatArray], float]] = {}

    def _table(self, part: Kinematics) -> FloatArray:
        """Return tangents, a start and residuals (n, p, k + 2), in units of the noise."""
        base = part.readings({})
        columns = [
            _met(part, base, n) if "_met" in n else (part.readings({n: step}) - base) / step
            for n, step in self.steps.items()
        ]
        start = np.broadcast_to(_START * self.noise, base.shape)
        return np.stack([*columns, start, _left(part, base)], axis=2) / self.noise[:, None]

    def about(self, at: Mapping[str, float], fault: str, every: bool = False) -> _Point:
        """Return the same about other errors.

        Tangents are taken anew of the fault; of ``every`` error if it moves motion in time, as another one that does so
        would else look unlike it.
        """
        out = object.__new__(_Point)
        out.parts, out.noise, out.names, out.steps = self.parts, self.noise, self.names, self.steps
        out.at, out._whitened, out.tables = at, {}, []
        every = every or fault.endswith(("_late", "_lag"))
        anew = [n for n in self.names if n == fault or (every and "_met" not in n)]
        for part, table in zip(self.parts, self.tables, strict=True):
            base, new = part.readings(at), table.copy()
            new[:, :, -1] = _left(part, base) / self.noise
            for name in anew:
                step = self.steps[name]
                moved = part.readings({**at, name: at[name] + step})
                new[:, :, self.names.index(name)] = (moved - base) / step / self.noise
            out.tables.append(new)
        return out

    def grams(self, colour: _Colour) -> tuple[list[Grams], float]:
        """Return the sums of every record, and ln of the determinant of the covariances."""
        found = [self._of(c, *key) for c, key in enumerate(zip(colour.time, colour.size, strict=True))]
        k, out = len(self.names), []
        for r, table in enumerate(self.tables):
            p = table.shape[1]
            of = np.zeros((p, k + p + 1, k + p + 1))  # every channel of a record has a start of its own
            for c, (whitened, _) in enumerate(found):
                at = np.r_[0:k, k + c, k + p]
                of[c][np.ix_(at, at)] = whitened[r]
            out.append(Grams.parted(of, np.full(p, float(len(table) - 1)), k))
        return out, sum(log_det for _, log_det in found)

    def _of(self, c: int, time: int, size: int) -> tuple[list[FloatArray], float]:
        """Return, of one channel, the sums (k + 2, k + 2) of every record, and ln of the determinant."""
        if (c, time, size) not in self._whitened:
            grams, log_det = [], 0.0
            for part, table in zip(self.parts, self.tables, strict=True):
                Z = _filtered(_taps(part, c, time), table[:, c])
                factor = _factor(part, c, time, size)
                grams.append(Z.T @ cho_solve_banded((factor, True), Z, check_finite=False))
                log_det += 2.0 * float(np.sum(np.log(factor[0])))
            self._whitened[c, time, size] = grams, log_det
        return self._whitened[c, time, size]

    def weights(self, r: int, c: int, colour: _Colour, scale: float) -> FloatArray:
        """Return by what a channel (n,) of a record is multiplied to give the scores (n, k), its start integrated."""
        part, table = self.parts[r], self.tables[r][:, c]
        taps = _taps(part, c, colour.time[c])
        factor = _factor(part, c, colour.time[c], colour.size[c])
        solved = cho_solve_banded((factor, True), _filtered(taps, table), check_finite=False) / scale**2
        out = np.zeros_like(table)
        for lag, tap in enumerate(taps):
            out[len(taps) - 1 - lag : len(table) - lag] += tap * solved
        start, weighted = out[:, -2], out[:, :-2]
        across = (start @ table[:, :-2]) / (1.0 + start @ table[:, -2])
        return weighted - start[:, None] * across


def _taps(part: Kinematics, c: int, time: int) -> FloatArray:
    """Return the filter that turns a process of first order into white noise; a height's is its rate's."""
    white = np.array([1.0, -math.exp(-part.dt_s / _TIMES_S[time])])
    return np.convolve(white, [1.0, -1.0]) if part.compared[c] == "h" else white


def _filtered(taps: FloatArray, y: FloatArray) -> FloatArray:
    """Return samples (n, k) through a filter, from the first on for which all of its inputs are there."""
    first = len(taps) - 1
    return np.asarray(sum(tap * y[first - lag : len(y) - lag] for lag, tap in enumerate(taps)))


def _factor(part: Kinematics, c: int, time: int, size: int) -> FloatArray:
    """Return the Cholesky factor, by diagonals, of the covariance of white noise so filtered, and innovations."""
    taps = _taps(part, c, time)
    bands = np.zeros((len(taps), len(part.x[part.compared[c]]) - len(taps) + 1))
    for lag in range(len(taps)):
        bands[lag] = taps[lag:] @ taps[: len(taps) - lag]
    bands[0] += _SIZES[size] ** 2
    return np.asarray(cholesky_banded(bands, lower=True, check_finite=False))


def _beside(time: int, size: int) -> Iterator[tuple[int, int]]:
    """Yield the places of the grids about one of them."""
    for t in (time, time - 1, time + 1):
        for z in (size, size - 1, size + 1):
            if 0 <= t < len(_TIMES_S) and 0 <= z < len(_SIZES) and (t, z) != (time, size):
                yield t, z


class _Asked:
    """Hypotheses about the instruments of some records."""

    def __init__(
        self, parts: Sequence[Kinematics], known_std: Mapping[str, float], std: dict[str, float] | None = None
    ) -> None:
        self.parts, self.known_std, self.std = parts, known_std, _priors(parts) if std is None else std
        self.std |= {n: s for n, s in known_std.items() if n in self.std}
        self.compared = parts[0].compared
        self.noise = np.array([_white(parts, c) for c in self.compared])
        finest = np.array([_FINEST.get(c, 1e-4) for c in self.compared])
        self.spread = np.where(self.noise > finest, _SPREAD, 0.0)
        self.origin = _Point(parts, self.noise, self.std)
        V = float(np.median(parts[0].x["V"])) if "V" in parts[0].x else 1.0
        self.most = np.array([_SOUND.get(c, _GUSTS_M_S / V) for c in self.compared])
        self.dt_s = parts[0].dt_s
        # How far noise of all instruments makes what is left of each channel wander from sample to sample.
        noise = {m: _white(parts, m) for m in parts[0].instruments}
        squares = [sum(part.moved_by({}, m, s)[1:] ** 2 for m, s in noise.items()) for part in parts]
        self.wandered = np.asarray(np.sqrt(np.mean(np.concatenate(squares), axis=0)))
        self.met = [(i, self.compared.index(n.split("_")[0])) for i, n in enumerate(self.std) if "_met" in n]
        self.moved = np.array([max(float(np.std(part.x[c])) for part in parts) for c in self.compared])

    def weigh(self, point: _Point, colour: _Colour, fault: str, bounded: bool, scales: FloatArray | None) -> _Weighed:
        """Return the evidence if one error, or none, is that of a faulty instrument, with one colour."""
        grams, log_det = point.grams(colour)
        std = np.array(list(self.std.values()))
        about = np.array([point.at.get(n, 0.0) for n in point.names])
        mean = np.array([_FILTER_S if n.endswith("_lag") and s > 0.0 else 0.0 for n, s in self.std.items()]) - about
        for i, c in self.met:
            std[i] = min(1.0, _ANSWER * self._gusts(colour, scales)[c])
        at = point.names.index(fault) if fault else 0
        if fault:
            std[at] = KINDS[fault.rpartition("_")[2]][1]
        found = sized(grams, mean, std, self.spread, 0.0, scales)
        log_evidence = found.log_density - 0.5 * log_det
        if bounded:  # a slope back to what air and sound instruments are
            beyond = np.maximum(np.log(self.rms(colour, found.scales) / self.most), 0.0)
            log_evidence -= _STEEP * float(np.sum(beyond))
        centre, covariance = found.reduced.posterior(mean, std)
        values, error = centre + about, float(np.sqrt(covariance[at, at]))
        if fault.endswith("_lag"):  # none is negative
            log_evidence += float(norm.logcdf(values[at] / error)) + math.log(2.0)
        own = [i for i, n in enumerate(point.names) if "_met" not in n]
        known = {point.names[i]: float(values[i]) for i in own}
        known |= {n: max(v, 0.0) for n, v in known.items() if n.endswith("_lag")}
        return _Weighed(
            log_evidence, colour, found.scales, known, float(values[at]), error, covariance[np.ix_(own, own)]
        )

    def told(self, row: _Weighed) -> tuple[FloatArray, FloatArray]:
        """Return what the records alone say of the errors: precision (k, k), and its product with their estimate.

        The scores g = X' W (y - f), with the weights W of channels one by one, have the mean A theta, A = X' W X, and
        the covariance K that noise gives them on all its ways: that of an instrument is in what it reads and, summed
        from sample to sample, in all that is foretold with it. So A K^-1 A is the precision (L. P. Hansen, Econometrica
        50, 1982). Gusts are what of a process of first order is larger than noise so summed.
        """
        point = self.origin.about(row.at, "", every=True)
        std, k = np.array(list(self.std.values())), len(self.std)
        g, A, K = np.zeros(k), np.zeros((k, k)), np.zeros((k, k))
        for r, (part, table) in enumerate(zip(self.parts, point.tables, strict=True)):
            H = np.stack([point.weights(r, c, row.colour, s) for c, s in enumerate(row.scales)], axis=1) * std
            A += np.tensordot(H, table[:, :, :k] * std, ((0, 1), (0, 1)))
            g += np.tensordot(H, table[:, :, -1], ((0, 1), (0, 1)))
            H = H / self.noise[:, None]
            H[0] -= H.sum(axis=0)  # residuals count from the first
            for m in part.instruments:
                i = self.compared.index(m) if m in self.compared else None
                size = _white(self.parts, m) if i is None else self.noise[i] * row.scales[i]
                score = part.scored(row.at, H, part.moved_by(row.at, m, size)) + (0.0 if i is None else size * H[:, i])
                K += score.T @ score
            for c, time in enumerate(row.colour.time):
                gusts = (_SIZES[row.colour.size[c]] * self.noise[c] * row.scales[c]) ** 2 - self.wandered[c] ** 2
                score = lfilter([1.0], _taps(part, c, time), H[::-1, c], axis=0)
                K += max(gusts, 0.0) * score.T @ score
        g += A @ (np.array(list(row.at.values())) / std)
        solved = np.linalg.solve(K + _UNTOLD * np.eye(k), np.column_stack([A, g]))
        return A @ solved[:, :k] / np.outer(std, std), A @ solved[:, k] / std

    def rms(self, colour: _Colour, scales: FloatArray) -> FloatArray:
        """Return the rms (p,) of the process of first order."""
        a = np.exp(-self.dt_s / np.array(_TIMES_S)[list(colour.time)])
        w = np.array(_SIZES)[list(colour.size)] * self.noise * scales
        w = np.where([c == "h" for c in self.compared], w / self.dt_s, w)
        return np.asarray(w / np.sqrt(1.0 - a**2))

    def _gusty(self, fault: str, best: _Weighed) -> list[str]:
        """Return the flow angles that gusts clearly move by too much for their instruments to be compared."""
        point, out = self.origin.about(best.at, fault), []
        for c, name in enumerate(self.compared):
            calm = best.colour
            while name in FLOW and calm.size[c] > 0 and self._gusts(calm, best.scales)[c] > _GUSTY:
                calm = calm.moved(c, calm.time[c], calm.size[c] - 1)
            if calm is not best.colour:
                without = self.weigh(point, calm, fault, True, best.scales).log_evidence
                out += [name] if best.log_evidence - without > _CLEARLY else []
        return out

    def _gusts(self, colour: _Colour, scales: FloatArray | None) -> FloatArray:
        """Return the size of gusts in a second over the motion of each channel (p,)."""
        w = np.array(_SIZES)[list(colour.size)] * self.noise * (1.0 if scales is None else scales)
        w = np.sqrt(np.maximum(w**2 - self.wandered**2, 0.0))
        times = np.minimum(np.array(_TIMES_S)[list(colour.time)], _ANSWERED_S)
        return np.asarray(w * np.sqrt(0.5 * times / self.dt_s) / np.maximum(self.moved, 1e-12))

    def coloured(self, point: _Point, fault: str, begin: _Weighed | _Colour, bounded: bool = True) -> _Weighed:
        """Return the evidence with the colour that makes it largest, sought about another one."""
        colour, scales = (begin.colour, begin.scales) if isinstance(begin, _Weighed) else (begin, None)
        best = self.weigh(point, colour, fault, bounded, scales)
        moved = set(range(len(self.compared)))
        while moved:
            for c in sorted(moved):
                before, tried = best, set()
                while True:
                    here = best
                    for time, size in _beside(here.colour.time[c], here.colour.size[c]):
                        if (time, size) in tried:
                            continue
                        tried.add((time, size))
                        other = self.weigh(point, here.colour.moved(c, time, size), fault, bounded, here.scales)
                        best = max(best, other, key=lambda w: w.log_evidence)
                    if best is here:
                        break
                if not best.log_evidence - before.log_evidence >= _LITTLE:
                    moved.discard(c)
        return best

    def beginning(self) -> _Colour:
        """Return a colour in the middle of the grids, or as near to it as sound instruments allow."""
        count = len(self.compared)
        colour = _Colour((1,) * count, (len(_SIZES) // 2,) * count)
        for _ in _SIZES:
            over = self.rms(colour, np.full(count, 1.2)) > self.most
            colour = _Colour(colour.time, tuple(max(s - int(o), 0) for s, o in zip(colour.size, over, strict=True)))
        return colour

    def answer(self) -> Agreement:
        """Return the probabilities of all hypotheses."""
        faults = [n for n in self.std if n.rpartition("_")[2] in KINDS and n.rpartition("_")[0] != "h"]
        faults = [n for n in faults if _judged(self.parts[0], n)]
        none, point = self.coloured(self.origin, "", self.beginning()), self.origin
        least = none.log_evidence
        rows = {f: self.weigh(self.origin, none.colour, f, True, none.scales) for f in faults}
        for _ in range(_AGAIN):
            point = self.origin.about(none.at, "")
            none = self.coloured(point, "", none)
        ranked = sorted(faults, key=lambda f: -rows[f].log_evidence)
        for i, f in enumerate(ranked):
            if i < _LED and rows[f].log_evidence > least:
                rows[f] = self._at_rest(f, rows[f])
            else:  # about the same point as soundness was weighed at first: only their difference counts
                rows[f] = replace(rows[f], log_evidence=rows[f].log_evidence + none.log_evidence - least)
        best = max(rows.values(), key=lambda r: r.log_evidence)
        none = max(none, self.coloured(point, "", best), key=lambda r: r.log_evidence)
        unknown = self.coloured(point, "", none, bounded=False)
        fault, best = max((("", none), *rows.items()), key=lambda r: r[1].log_evidence)
        if gusty := self._gusty(fault, best):
            kept = tuple(c for c in self.compared if c not in gusty)
            calmer = agreement_of([replace(part, compared=kept) for part in self.parts], self.known_std)
            return replace(calmer, gusty=(*gusty, *calmer.gusty))
        return self._said(none, unknown, rows)

    def _at_rest(self, fault: str, row: _Weighed) -> _Weighed:
        """Return the evidence of an error linearised about its own estimate, with a colour of its own."""
        most = 4.0 * KINDS[fault.rpartition("_")[2]][1]
        for _ in range(_ROUNDS):
            value = float(np.clip(row.value, 0.0 if fault.endswith("_lag") else -most, most))
            row = self.coloured(self.origin.about({**row.at, fault: value}, fault), fault, row)
            if abs(row.value - value) < _STILL * max(row.std, 1e-12):
                break
        return row

    def _said(self, none: _Weighed, unknown: _Weighed, rows: Mapping[str, _Weighed]) -> Agreement:
        kinds = Counter(f.rpartition("_")[0] for f in rows)
        prior = [1.0 - _P_FAULTY - _P_UNKNOWN, _P_UNKNOWN]
        prior += [_P_FAULTY / len(kinds) / kinds[f.rpartition("_")[0]] for f in rows]
        logs = np.log(prior) + [r.log_evidence for r in (none, unknown, *rows.values())]
        probability = np.exp(logs - logsumexp(logs))
        found = [
            InstrumentFault(*f.rpartition("_")[::2], float(p), r.value, r.std)
            for (f, r), p in zip(rows.items(), probability[2:], strict=True)
        ]
        best = max((none, unknown, *rows.values()), key=lambda r: r.log_evidence)
        held = best if probability[0] <= 1.0 - CLEAR else none
        left = zip(self.noise * best.scales, self.rms(best.colour, best.scales), strict=True)
        return Agreement(
            self.compared,
            self.parts[0].instruments,
            float(probability[0]),
            float(probability[1]),
            tuple(sorted(found, key=lambda f: -f.probability)),
            left={c: (float(s), float(g)) for c, (s, g) in zip(self.compared, left, strict=True)},
            errors=tuple(held.at),
            errors_mean=np.array(list(held.at.values())),
            errors_covariance=held.covariance,
        )
