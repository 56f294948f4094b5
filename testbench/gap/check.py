"""Check the data first: errors of instruments and wind from kinematics alone, before anything is said of aerodynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.errors import ChannelError, EstimationError
from testbench.estimators import data_compatibility
from testbench.estimators.data_compatibility import DataCompatibility, InstrumentError
from testbench.gap.believed import Believed
from testbench.record import FlightRecord
from testbench.sensors import Sensor

RATE_HZ = 50.0  # records are thinned to about this rate: kinematics need no more, and the search takes half as long
FALSE_ALARM = 0.01  # probability of finding any error of an instrument where there is none
_GRAVITY = 0.05  # m/s2, by which an accelerometer's bias may be local gravity


@dataclass(frozen=True, eq=False)
class DataCheck:
    """What the instruments say of each other, set against what is believed of them.

    Attributes:
        result: errors of the instruments, or None if the records cannot be checked.
        why_not: why they cannot.
        news: errors that the believed suite does not hold, as (words, believed value).
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
            out = [f"the instruments ({checked}) agree with each other, but for errors that are believed already"]
        else:
            out = [
                f"kinematics alone, without any aerodynamics, say that {error.words} "
                f"(believed: {value:.3g}; {error.significance:.1f} standard errors)"
                + (f"; as well explained by: {' or '.join(error.alternatives)}" if error.alternatives else "")
                for error, value in self.news
            ]
        untold = [n for n in self.result.not_identifiable if n.rpartition("_")[2] in ("scale", "lag", "delay")]
        if untold:
            out.append(f"these manoeuvres do not tell {', '.join(untold)}")
        return (*out, *(a for a in self.result.advice if "not steady" in a or "did not settle" in a))

    def says(self, channel: str) -> tuple[str, ...]:
        """Return what was found of one channel's sensor, in words."""
        return tuple(e.words for e, _ in self.news if e.name.rpartition("_")[0] == channel)


def check_data(believed: Believed, records: Sequence[FlightRecord]) -> DataCheck:
    """Hold the records against rigid-body kinematics, and the errors found against what is believed of the sensors.

    A lag and a delay are taken together: kinematics tell their sum better than either.
    """
    thinned = [r.decimate(max(1, round(1.0 / (r.dt_s * RATE_HZ)))) for r in records]
    positions = {
        s.channel: s.position_m for s in believed.suite.sensors if s.channel in ("ax", "ay", "az") and any(s.position_m)
    }
    try:
        result = data_compatibility.estimate(thinned, positions_m=positions or None, false_alarm=FALSE_ALARM)
    except (ChannelError, EstimationError) as error:
        return DataCheck(None, str(error), ())
    sensors = {s.channel: s for s in believed.suite.sensors}
    news = []
    for error in result.errors:
        of, _, kind = error.name.rpartition("_")
        value = _believed(sensors.get(of), kind)
        slack = _GRAVITY if kind == "bias" and of in ("ax", "ay", "az") else 0.0
        away = abs(error.estimate - value) - slack
        if away > result.diagnostics["threshold"] * error.standard_error:
            news.append((error, value))
    return DataCheck(result, "", tuple(news))


def _believed(sensor: Sensor | None, kind: str) -> float:
    """Return what is believed of one error; the wind is believed to be none."""
    if sensor is None:
        return 0.0
    if kind in ("lag", "delay"):
        return sensor.lag_s + sensor.delay_s
    return float(getattr(sensor, kind))
