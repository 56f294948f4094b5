"""What an amendment by identified derivatives is: what was written, what was reached, and the flights against both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft import Aircraft
from testbench.core.record import FloatArray


@dataclass(frozen=True)
class Aim:
    """One derivative of the model that was chosen."""

    #: name, unit: as identified
    name: str
    unit: str
    #: identified, std: estimate and standard error
    identified: float
    std: float
    before: float  #: what the aircraft had
    aimed: float | None  #: what it is to have; None if it is left as it was
    why: str = ""  #: why it is left, or what was done to it; "" if the identified value is aimed at as it is
    reached: float | None = None  #: what the amended aircraft has, loaded from its folder and linearised

    @property
    def off(self) -> float | None:
        """Distance of what was reached from the aim, over the size of the aim or of what it was before."""
        if self.aimed is None or self.reached is None:
            return None
        return abs(self.reached - self.aimed) / max(abs(self.aimed), abs(self.before), 1e-12)


@dataclass(frozen=True)
class ServoAim:
    """The servo of one control."""

    control: str  #: "de", "da" or "dr"
    before_s: float | None  #: time constant that the aircraft had; None without a lag
    lag_s: float  #: what was written
    std_s: float | None  #: its standard error; None if the description gave it
    reached_s: float | None = None  #: what the amended aircraft has


@dataclass(frozen=True)
class Coefficient:
    """One coefficient that changed: per rad, or per nondimensional rate.

    ``before`` and ``after`` are None where the model does not have it as one number.
    """

    name: str
    added: float
    before: float | None
    after: float | None


@dataclass(frozen=True, eq=False)
class Replay:
    """One record beside what both aircraft do with its inputs."""

    name: str  #: of the record
    use: str  #: "identification" or "validation"
    t_s: FloatArray  #: (n,)
    channels: tuple[str, ...]  #: (p,) outputs
    measured: FloatArray  #: (n, p) as prepared, deviations, SI
    valid: NDArray[np.bool_]  #: (n, p) samples that count
    #: before, after: (n, p) of the old and the amended aircraft; None if it did not fly to the end
    before: FloatArray | None
    after: FloatArray | None
    notes: tuple[str, ...] = ()  #: what happened, in sentences


@dataclass(frozen=True)
class Miss:
    """How far one output of both aircraft is from what was measured, over all records of one use."""

    channel: str  #: output
    use: str  #: "identification" or "validation"
    size: float  #: root mean square of what was measured about its mean, SI
    #: before, after: root mean square of the difference, SI; None if a flight did not reach its end
    before: float | None
    after: float | None
    #: theil_before, theil_after: Theil's inequality coefficient, 0 for equal and 1 for opposite
    theil_before: float | None
    theil_after: float | None


@dataclass(frozen=True, eq=False)
class Amended:
    """The part of an amendment that one identification gave, and the aircraft that came of all parts.

    Attributes:
        name: of the amended aircraft.
        folder: that it was written to.
        old, new: the aircraft.
        model: label of the model whose derivatives were taken.
        rule: how it was chosen among several, a sentence; "" if there was one.
        V_m_s, h_m: condition.
        aims: every derivative of the model.
        servos: those that were written.
        coefficients: those that changed.
        replays: the records through both aircraft.
        notes: what was left out and why, in sentences.
        doubts: what may make the aircraft wrong, in sentences.
    """

    name: str
    folder: Path
    old: Aircraft
    new: Aircraft
    model: str
    rule: str
    V_m_s: float
    h_m: float
    aims: tuple[Aim, ...]
    servos: tuple[ServoAim, ...]
    coefficients: tuple[Coefficient, ...]
    replays: tuple[Replay, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    @property
    def written(self) -> tuple[Aim, ...]:
        """The derivatives that were aimed at."""
        return tuple(a for a in self.aims if a.aimed is not None)

    def misses(self, use: str) -> tuple[Miss, ...]:
        """Return the misses of every output over the records of one use."""
        replays = [r for r in self.replays if r.use == use]
        return tuple(_miss(replays, i, use) for i in range(len(replays[0].channels))) if replays else ()


def _miss(replays: list[Replay], i: int, use: str) -> Miss:
    measured = np.concatenate([_centred(r.measured[r.valid[:, i], i]) for r in replays])
    found: dict[str, tuple[float | None, float | None]] = {}
    for which in ("before", "after"):
        flown = [getattr(r, which) for r in replays]
        if any(y is None for y in flown):
            found[which] = (None, None)
            continue
        raw = np.concatenate([r.measured[r.valid[:, i], i] for r in replays])
        y = np.concatenate([y[r.valid[:, i], i] for r, y in zip(replays, flown, strict=True)])
        error, both = _rms(raw - y), _rms(raw) + _rms(y)
        found[which] = (error, error / both if both else 0.0)
    (before, U0), (after, U1) = found["before"], found["after"]
    return Miss(replays[0].channels[i], use, _rms(measured), before, after, U0, U1)


def _centred(y: FloatArray) -> FloatArray:
    return y - y.mean() if y.size else y


def _rms(y: FloatArray) -> float:
    return float(np.sqrt(np.mean(y**2))) if y.size else 0.0


Targets = Mapping[str, float]
"""Parameter of a structure -> value that the aircraft is to have."""
