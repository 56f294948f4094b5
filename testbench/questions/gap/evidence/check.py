"""Check the data first: errors of instruments and wind from kinematics alone, before any aerodynamics.

Whether each control of some records turns the aircraft the way in which the believed one turns.

A log that counts a control the other way, or a model that does, is no effect that is to be named: every hypothesis
would be fitted about the wrong model. The moment that a control makes about its own axis is told by the errors of
forces and moments at every sample (:mod:`.felt`), regressed on what the coefficients of that moment contribute.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from testbench.core.advice import ranked
from testbench.core.errors import ChannelError, EstimationError, RecordError, Refusal
from testbench.core.record import FlightRecord
from testbench.effects.servo import WORDS
from testbench.estimators import data_compatibility
from testbench.estimators.data_compatibility import DataCompatibility, InstrumentError
from testbench.estimators.parametric.kinematics import INPUTS, OUTPUTS, motion_of
from testbench.logs.plausible import questions_of, refusal
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import moves_laterally
from testbench.questions.gap.evidence.felt import Felt, felt
from testbench.questions.gap.evidence.motion import smooth
from testbench.questions.gap.search.parallel import spread
from testbench.sensors import Sensor
from testbench.sensors.sensor import ACCELEROMETERS, ROTATION

_TOGETHER_S = 0.5
OWN_MOMENTS = {"de": "Cm_de", "da": "Cl_da", "dr": "Cn_dr"}


@dataclass(frozen=True)
class Turned:
    """What records say of a control: the moment about its own axis, as a multiple of the believed one.

    Attributes:
        control: de, da or dr.
        factor: 1 as believed, about -1 where the signs differ.
        error: its standard error.
    """

    control: str
    factor: float
    error: float

    @property
    def reversed(self) -> bool:
        """True if records and belief count the control in opposite ways."""
        return self.factor < min(CRITERIA.reversed, -CRITERIA.sure * self.error)


def check_signs(believed: Believed, records: Mapping[str, FlightRecord]) -> None:
    """Check that every control that moves turns the aircraft as it turns the believed one.

    Args:
        believed: model and sensors.
        records: by name; those that do not begin with quiet flight say so.

    Raises:
        RecordError: one turns it the other way, or values that are hardly meant say so.
    """
    try:
        found = turned(felt(believed, records, copies=0))
    except Refusal:  # without forces and moments nothing is known of signs
        return
    asked = questions_of(records.items()) if any(t.reversed for t in found) else ()
    if asked:  # values in another unit are the cause
        raise RecordError(refusal("the records", asked))
    for one in (t for t in found if t.reversed):
        word = WORDS[one.control]
        raise RecordError(
            f"the {word} of the records must turn the aircraft the way in which the believed one turns, got a moment "
            f"by {one.control} of {one.factor:.2f} times the believed {OWN_MOMENTS[one.control]}: one of them counts "
            f"the {word} the other way. In a log, turn its sign where it is described (testbench import LOG "
            f"--describe; scale = -1) and import it again; in the model, turn {OWN_MOMENTS[one.control]}"
        )


def turned(flights: Sequence[Felt]) -> list[Turned]:
    """Return what records say of each control whose own moment they hold."""
    return [t for c, own in OWN_MOMENTS.items() if (t := _turned(flights, c, own)) is not None]


def _turned(flights: Sequence[Felt], control: str, own: str) -> Turned | None:
    """Regress the error of a moment on what its coefficients contribute, each record about its own mean.

    Errors of neighbouring samples are alike: the covariance is that of sums over half a second (K.-Y. Liang and S. L.
    Zeger, Biometrika 73, 1986).
    """
    coefficient = own.split("_")[0]
    about = [f for f in flights if coefficient in f.coefficients and own in f.tuned]
    names = [n for n in about[0].tuned if n.split("_")[0] == coefficient] if about else []
    at = names.index(own) if names else 0
    rows, errors, ends = [], [], [0]
    for f in about:
        k = f.coefficients.index(coefficient)
        dt_s = f.motion.record.dt_s  # the motion is smoothed, so that all that it is compared with has to be
        x, y = np.column_stack([smooth(f.tuned[n][:, k], dt_s) for n in names]), smooth(f.errors[0][:, k], dt_s)
        rows.append(x - x.mean(axis=0))
        errors.append(y - y.mean())
        together = max(1, round(_TOGETHER_S / dt_s))
        ends += [*range(ends[-1] + together, ends[-1] + y.size - together + 1, together), ends[-1] + y.size]
    if not rows or not np.any(np.concatenate(rows)[:, at]):
        return None
    X, y = np.concatenate(rows), np.concatenate(errors)
    size = np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny)
    inverse = np.linalg.pinv(X / size)
    changes = inverse @ y
    scores = np.add.reduceat(inverse * (y - (X / size) @ changes), ends[:-1], axis=1)
    return Turned(control, 1.0 + float(changes[at] / size[at]), float(np.linalg.norm(scores[at]) / size[at]))


PIECE_S = (
    8.0  # records are cut into pieces of no more: the noise of the inertial unit, integrated, does not add up over
)
_INERTIAL = ("p", "q", "r", "ax", "ay", "az")
_FLIGHTS = 3  # believed flights measured with sensors that drift, sit ahead, sample slowly or keep another clock
_BEYOND = 2.0  # an error is news beyond so many times the largest one in those flights
_FELT = 1e-3  # share of another channel that a sensor may feel, or of its own that it may lose, unknown to kinematics
_GRAVITY = 0.05  # m/s2, by which an accelerometer's bias may be local gravity


@dataclass(frozen=True, eq=False)
class DataCheck:
    """What the instruments say of each other, set against what is believed of them.

    Attributes:
        result: errors of the instruments, or None if the records cannot be checked.
        why_not: why they cannot.
        news: (error, what is believed of it) for errors that the believed suite does not hold. Biases and scales are
            what exceeds the believed ones, lags and delays are the whole.
    """

    result: DataCompatibility | None
    why_not: str
    news: tuple[tuple[InstrumentError, float], ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found, in words."""
        if self.result is None:
            return (f"the instruments could not be checked against each other: {self.why_not}",)
        checked = ", ".join((*self.result.structure.inputs, *self.result.structure.outputs))
        if not self.news:
            out = [f"the instruments ({checked}) agree with each other, apart from errors that are believed already"]
        else:
            out = [
                f"kinematics alone, without any aerodynamics, say that {error.words} "
                f"({_beside(error.name, value)}{error.significance:.1f} standard errors)"
                + (f"; equally well explained by: {' or '.join(error.alternatives)}" if error.alternatives else "")
                for error, value in self.news
            ]
        untold = [n for n in self.result.not_identifiable if n.rpartition("_")[2] in ("scale", "lag", "delay")]
        if untold:
            out.append(f"these manoeuvres do not determine {', '.join(untold)}")
        return (*out, *(a for a in ranked(self.result.advice) if a.code in ("unsteady_air", "not_converged")))

    def says(self, channel: str) -> tuple[str, ...]:
        """Return what was found of one channel's sensor, in words."""
        return tuple(e.words for e, _ in self.news if e.name.rpartition("_")[0] == channel)


def check_data(
    believed: Believed, records: Sequence[FlightRecord], flown: Sequence[FlightRecord] | None = None
) -> DataCheck:
    """Compare the records with rigid-body kinematics, the believed biases and scales of the sensors taken out.

    A lag and a delay are taken together, as kinematics tell their sum better than either. Without a forward
    accelerometer, a vane and an attitude that are off by the same angle look much like an aircraft turned by that
    angle; the attitude is believed then. If aileron or rudder moves, kinematics of level wings would blame the
    instruments, so those of the lateral motion are used, or of all axes if every channel for them is there.

    Kinematics know bias, scale, lag and delay of sensors at the centre of gravity of a rigid body. Believed sensors may
    also drift, sit ahead or sample slowly, which looks like one of these errors. If they do, believed flights are
    measured with them, too, and errors that show there are no news. These fly the commands of ``flown``, of ``records``
    if that is not given.
    """
    try:
        result = _estimated(believed, records)
        plain = all(_is_plain(s, b.trimmed.state) for b in believed.at_each(records) for s in b.suite.sensors)
        shown = {} if plain else _shown(believed, records if flown is None else flown)
    except (ChannelError, EstimationError) as error:
        return DataCheck(None, str(error), ())
    sensors = {s.channel: s for s in believed.suite.sensors}
    # A lag that is found is one behind the inertial unit, whose own lag it is short of.
    inertial = max(_believed(sensors.get(n), "lag") for n in result.structure.inputs if n in _INERTIAL)
    news = []
    for found in result.errors:
        of, _, kind = found.name.rpartition("_")
        value = _believed(sensors.get(of), kind)
        none = value if kind in ("lag", "delay") else 1.0 if kind == "scale" else 0.0
        slack = _GRAVITY if kind == "bias" and of in ("ax", "ay", "az") else 0.0
        if kind in ("lag", "delay"):
            slack = inertial
        away = abs(found.estimate - none) - slack - _BEYOND * shown.get(found.name, 0.0)
        if away > result.diagnostics["threshold"] * found.standard_error:
            news.append((found, value))
    return DataCheck(result, "", tuple(news))


def _estimated(believed: Believed, records: Sequence[FlightRecord]) -> DataCompatibility:
    """Return what kinematics say of the instruments of ``records``.

    Raises:
        ChannelError, EstimationError: they cannot be asked.
    """
    pieces = [piece for record in records for piece in _cut(_corrected(believed, record))]
    common = [n for n in records[0].channels if all(n in r for r in records)]
    positions = {
        s.channel: s.position_m for s in believed.suite.sensors if s.channel in ("ax", "ay", "az") and any(s.position_m)
    }
    motion = motion_of(common)
    if motion != "full" and moves_laterally(records):
        motion = "lateral"
    without = ("theta_bias",) if motion == "vertical" else ()
    return data_compatibility.estimate(
        pieces,
        motion=motion,
        without=without,
        positions_m=positions or None,
        false_alarm=CRITERIA.instrument_false_alarm,
    )


def _is_plain(sensor: Sensor, trim: Mapping[str, float]) -> bool:
    """Return whether kinematics know all that a sensor does at a trim; of what they do not ask, there is nothing to."""
    if sensor.channel not in (*INPUTS["full"], *OUTPUTS["full"]):
        return True
    wanders = sensor.drift_std > 0.0 or sensor.bias_walk > 0.0
    clock = sensor.rate_hz or sensor.clock_offset_s or sensor.clock_ppm
    known = (sensor.channel, *(ROTATION if sensor.channel in ACCELEROMETERS else ()))
    felt = sensor.weights(trim)
    other = max((abs(w) for n, w in felt.items() if n not in known), default=0.0)
    return not (wanders or clock or max(other, abs(felt[sensor.channel] - 1.0)) > _FELT)


def _shown(believed: Believed, records: Sequence[FlightRecord]) -> dict[str, float]:
    """Return error -> the largest that kinematics find of it in believed flights of these commands, SI."""
    flown, out = [believed.flown(record) for record in records], dict[str, float]()

    def found(k: int) -> DataCompatibility:
        seeds = range(k * len(flown), (k + 1) * len(flown))
        suites = [believed.at(record).suite for record in records]
        measured = [suite.measure(f, s) for suite, f, s in zip(suites, flown, seeds, strict=True)]
        return _estimated(believed, measured)

    for result in spread([partial(found, k) for k in range(_FLIGHTS)]):
        for error in {e.name: e for e in (*result.tested, *result.errors)}.values():
            none = 1.0 if error.name.endswith("_scale") else 0.0
            out[error.name] = max(out.get(error.name, 0.0), abs(error.estimate - none))
    return out


def _corrected(believed: Believed, record: FlightRecord) -> FlightRecord:
    """Return the record less the biases, steady drifts and scales that are believed of its sensors."""
    return record.with_columns(
        {
            s.channel: (record[s.channel] - s.bias - s.drifted(record.t_s)) / s.scale
            for s in believed.suite.sensors
            if s.channel in record and (s.bias, s.bias_rate, s.scale) != (0.0, 0.0, 1.0)
        }
    )


def _beside(name: str, value: float) -> str:
    """Return what is believed of an error already, in words, if anything is."""
    kind = name.rpartition("_")[2]
    if value == (1.0 if kind == "scale" else 0.0):
        return ""
    return f"believed: {value:.3g} s; " if kind in ("lag", "delay") else f"beyond the {value:.3g} believed; "


def _cut(record: FlightRecord) -> list[FlightRecord]:
    """Return the record in pieces of equal length, none longer than PIECE_S."""
    count = max(1, math.ceil(record.duration_s / PIECE_S))
    ends = np.linspace(float(record.t_s[0]), float(record.t_s[-1]) + record.dt_s, count + 1)
    return [record.between(a, b) for a, b in pairwise(ends.tolist())]


def _believed(sensor: Sensor | None, kind: str) -> float:
    """Return what is believed of one error; the wind is believed to be none."""
    if sensor is None:
        return 0.0
    if kind in ("lag", "delay"):
        return sensor.lag_s + sensor.delay_s
    return float(getattr(sensor, kind))
