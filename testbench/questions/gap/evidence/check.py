"""What is checked before anything is fitted: signs of the controls, and instruments against each other.

A log that counts a control the other way, or a model that does, is no effect that is to be named: every hypothesis
would be fitted about the wrong model. And how different a flight that was held out is from those used: a good fit to
the same excitation warns of nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from testbench.core.errors import RecordError, Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.effects.servo import COEFFICIENTS, WORDS
from testbench.estimators.trajectories import driven
from testbench.inference.instruments import Agreement, agreement, without_errors
from testbench.logs.plausible import questions_of, refusal
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import MOVED, commands, starts_freely
from testbench.sensors import SensorSuite

_ABOUT = {"de": ("q", ("V", "alpha", "q")), "da": ("p", ("beta", "p", "r")), "dr": ("r", ("beta", "p", "r"))}
"""Control -> the rate that it turns, and the motion that turns it, too."""
_SMOOTH_S = 0.05  # standard deviation of Gauss's filter
_TOGETHER_S = 0.5


@dataclass(frozen=True)
class Turned:
    """What records say of a control: how it turns the aircraft, as a multiple of how it turns the believed one."""

    control: str  #: de, da or dr
    factor: float  #: 1 as believed, about -1 where the signs differ
    error: float  #: its standard error

    @property
    def reversed(self) -> bool:
        """True if records and belief count the control in opposite ways."""
        return self.factor < min(CRITERIA.reversed, -CRITERIA.sure * self.error)


def check_signs(believed: Believed, records: Mapping[str, FlightRecord]) -> None:
    """Check that every control that moves turns the aircraft as it turns the believed one.

    Raises:
        RecordError: one turns it the other way, or implausible values say so.
    """
    try:
        found = turned(believed, list(records.values()))
    except Refusal:  # of a model that cannot be linearised nothing is known
        return
    wrong = [t for t in found if t.reversed]
    asked = questions_of(records.items()) if wrong else ()
    if asked:  # values in another unit are the cause
        raise RecordError(refusal("the records", asked))
    for one in wrong:
        word, moment = WORDS[one.control], COEFFICIENTS[one.control][0]
        raise RecordError(
            f"the {word} of the records must turn the aircraft in the same direction as the a-priori model, got a "
            f"moment by {one.control} of {one.factor:.2f} times the a-priori {moment}: in one of them the {word} has "
            "the opposite sign. In a log, change its sign in the description (testbench import LOG --describe; scale "
            f"= -1) and import it again; in the model, turn {moment}"
        )


def turned(believed: Believed, records: Sequence[FlightRecord]) -> list[Turned]:
    """Return what records say of each control that moves, whose rate they hold.

    The derivative of a rate is regressed on motion and commands, in the records and in the believed model's response to
    the same commands: what servos, limits, filters and smoothing do to such a slope, they do to both. The response is
    flown; where the model leaves its limits, as it may without the hands of the pilot, it is the linear one from rest.
    """
    out = []
    for control, (rate, motion) in _ABOUT.items():
        parts = [(r, believed.at(r)) for r in records if rate in r and f"{control}_cmd" in r]
        parts = [(r, m) for r, m in parts if f"{control}_cmd" in m.linear.inputs and np.ptp(r[f"{control}_cmd"]) > 0.0]
        known = tuple(n for n in motion if all(n in r and n in there.linear.outputs for r, there in parts))
        if not parts:
            continue
        measured = _slope([(r, {n: r[n] for n in (*known, rate)}) for r, _ in parts], control, rate, known)
        response = [(r, _moved(there, r, (*known, rate))) for r, there in parts]
        model = _slope(response, control, rate, known)
        if model[0] != 0.0:
            out.append(Turned(control, measured[0] / model[0], measured[1] / abs(model[0])))
    return out


def _moved(there: Believed, record: FlightRecord, wanted: Sequence[str]) -> Mapping[str, FloatArray]:
    """Return the response of the model to the commands of a record: output -> (n,)."""
    if not starts_freely(record):
        try:
            truth = there.flown(record, tuple(dict.fromkeys(wanted)))
            return {n: truth[n] for n in wanted}
        except Refusal:
            pass
    names, u = commands(record)
    model = there.linear
    inputs = [n if n == "thr" else f"{n}_cmd" for n in names]
    u = u[:, [n in model.inputs for n in inputs]]  # a record may hold commands of what the model does not have
    columns = [model.inputs.index(n) for n in inputs if n in model.inputs]
    (x,) = driven(model.A, model.B[:, columns], [u], record.dt_s)
    y = x @ model.C.T + u @ model.D[:, columns].T
    return {n: y[:, model.outputs.index(n)] for n in wanted}


def _slope(
    parts: Sequence[tuple[FlightRecord, Mapping[str, FloatArray]]], control: str, rate: str, motion: Sequence[str]
) -> tuple[float, float]:
    """Return the slope of the derivative of a rate by a control, and its standard error; each record about its means.

    Errors of neighbouring samples are alike: the covariance is that of sums over half a second (K.-Y. Liang and S. L.
    Zeger, Biometrika 73, 1986).
    """
    rows, slopes, ends = [], [], [0]
    given = [commands(record) for record, _ in parts]
    controls = dict.fromkeys((control, *(n for names, _ in given for n in names)))
    for (record, values), (names, u) in zip(parts, given, strict=True):
        moved = {**dict(zip(names, u.T, strict=True)), **values}
        still = np.zeros(len(record))
        every = {n: gaussian_filter1d(moved.get(n, still), _SMOOTH_S / record.dt_s) for n in (*controls, *motion, rate)}
        x = np.column_stack([every[n] for n in (*controls, *motion)])
        y = np.gradient(every[rate], record.dt_s)
        rows.append(x - x.mean(axis=0))
        slopes.append(y - y.mean())
        together = max(1, round(_TOGETHER_S / record.dt_s))
        ends += [*range(ends[-1] + together, ends[-1] + y.size - together + 1, together), ends[-1] + y.size]
    X, y = np.concatenate(rows), np.concatenate(slopes)
    size = np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny)
    inverse = np.linalg.pinv(X / size, rcond=1e-6)
    found = inverse @ y
    scores = np.add.reduceat(inverse * (y - (X / size) @ found), ends[:-1], axis=1)
    return float(found[0] / size[0]), float(np.linalg.norm(scores[0]) / size[0])


def check_instruments(suite: SensorSuite, records: Sequence[FlightRecord]) -> Agreement:
    """Return what kinematics say of the instruments beyond the errors that are believed of them."""
    return agreement([_without_believed(suite, record) for record in records])


def _without_believed(suite: SensorSuite, record: FlightRecord) -> FlightRecord:
    own = [s for s in suite.sensors if s.channel in record and not s.channel.endswith("_cmd")]
    columns = {s.channel: record[s.channel] - s.bias - s.drifted(record.t_s) for s in own}
    known: dict[str, float] = {}
    for s in own:
        errors = {"scale": s.scale - 1.0, "late": s.delay_s + s.clock_offset_s, "lag": s.lag_s}
        if (s.channel == "az" and "q" in record) or (s.channel == "ay" and "r" in record):
            errors["place"] = s.position_m[0]
        known |= {f"{s.channel}_{kind}": x for kind, x in errors.items() if x}
    return without_errors(record.with_columns(columns), known)


ALIKE = 0.2  # difference below which a flight warns of little; that of the same command with half of its amplitude
_BAND_HZ = 0.25  # spectra are compared in bands as wide


@dataclass(frozen=True)
class HeldOutFlight:
    """How far a flight that was held out is from the nearest of those used."""

    name: str  # of the flight
    nearest: str  # the flight used that is most like it
    # 0 for the same controls, amplitudes and spectra at the same dynamic pressure, 1 for nothing shared
    difference: float

    @property
    def sentence(self) -> str:
        """That in words."""
        found = (
            f"held-out {self.name} differs by {100.0 * self.difference:.0f} % from {self.nearest}, the most similar "
            "flight that was used (control, amplitude and spectrum of the command, dynamic pressure)"
        )
        return f"{found}: so similar a flight is a weak test" if self.difference < ALIKE else found


def differences(
    believed: Believed, used: Mapping[str, FlightRecord], held_out: Mapping[str, FlightRecord]
) -> tuple[HeldOutFlight, ...]:
    """Return how different each flight held out is from those used.

    The likeness of two flights is 2 a'b / (a'a + b'b) of the amplitudes a and b of their commands, by control and band
    of frequency, each control in units of its rms over all flights; times the ratio of their dynamic pressures. It is
    one for equal commands whenever they come, and falls with the shape of the spectrum as with its size.
    """
    flights = [*used.values(), *held_out.values()]
    spectra = _spectra(flights)
    pressures = [believed.at(r).condition.qbar_Pa for r in flights]
    out = []
    for i, name in enumerate(held_out, len(used)):
        likeness, a = [], spectra[i]
        for b, pressure in zip(spectra[: len(used)], pressures, strict=False):
            whole = float(np.sum(a * a) + np.sum(b * b))
            alike = float(2.0 * np.sum(a * b)) / whole if whole > 0.0 else 1.0
            likeness.append(alike * min(pressures[i], pressure) / max(pressures[i], pressure))
        k = int(np.argmax(likeness))
        out.append(HeldOutFlight(name, list(used)[k], 1.0 - likeness[k]))
    return tuple(out)


def _spectra(flights: list[FlightRecord]) -> list[FloatArray]:
    """Return the amplitudes (controls, bands) of the commands of each flight, each control over its rms in all."""
    given = [commands(r) for r in flights]
    controls = list(dict.fromkeys(n for names, _ in given for n in names))
    dt_s, longest = flights[0].dt_s, max(len(u) for _, u in given)
    wide = max(1, round(_BAND_HZ * longest * dt_s))
    amplitudes = []
    for names, u in given:
        own = np.zeros((len(controls), longest))
        for name, column in zip(names, u.T, strict=True):
            if np.ptp(column) > MOVED:
                own[controls.index(name), : len(column)] = column
        power = np.abs(np.fft.rfft(own, axis=1)) ** 2
        bands = np.add.reduceat(power, np.arange(0, power.shape[1], wide), axis=1)
        amplitudes.append(np.sqrt(bands))
    rms = np.sqrt(np.mean([np.sum(a * a, axis=1) for a in amplitudes], axis=0))
    return [a / np.where(rms > 0.0, rms, 1.0)[:, None] for a in amplitudes]
