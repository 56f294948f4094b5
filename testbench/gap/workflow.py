"""The gap workflow: locate, name, amend, and judge on manoeuvres that were used for neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from testbench.errors import RecordError
from testbench.gap.believed import NUISANCES, Believed
from testbench.gap.locate import ResidualMap, locate
from testbench.gap.name import Naming, name_effect
from testbench.record import FlightRecord, FloatArray


@dataclass(frozen=True, eq=False)
class Shrink:
    """Before and after on one held-out manoeuvre, residuals in units of the noise.

    Attributes:
        manoeuvre: name.
        record: the measured record.
        before, after: (n, p) predictions of the believed and of the amended model, offset to the record's mean.
        energy_before, energy_after: (p,) mean squared residual per channel, 1 is the noise floor.
        map_before, map_after: where the residual sits.
    """

    manoeuvre: str
    record: FlightRecord
    before: FloatArray
    after: FloatArray
    energy_before: FloatArray
    energy_after: FloatArray
    map_before: ResidualMap
    map_after: ResidualMap

    @property
    def visible(self) -> bool:
        """True if the excess before stands four standard deviations above what noise alone scatters by."""
        scatter = np.sqrt(2.0 * self.energy_before.size / len(self.record))
        return float(np.sum(self.energy_before - 1.0)) > 4.0 * scatter

    @property
    def removed(self) -> float:
        """Share of the excess energy over the noise floor that the amendment removed, all channels together."""
        excess = float(np.sum(self.energy_before - 1.0))
        return 1.0 - float(np.sum(self.energy_after - 1.0)) / excess if excess > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class GapFinding:
    """What the gap workflow found, where, and what adding it did on held-out manoeuvres."""

    believed: Believed
    amended: Believed
    maps: tuple[ResidualMap, ...]
    naming: Naming
    shrink: tuple[Shrink, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer in words."""
        out = [self.naming.sentence]
        if self.naming.outcome != "no gap":
            out += [m.sentence for m in self.maps]
        for s in self.shrink if self.naming.best else ():
            k = int(np.argmax(s.energy_before))
            out.append(
                f"held-out {s.manoeuvre}: mean squared residual {s.energy_before.mean():.3g} before and "
                f"{s.energy_after.mean():.3g} after, noise floor 1 (most in {self.believed.outputs[k]}: "
                f"{s.energy_before[k]:.3g} and {s.energy_after[k]:.3g}); "
                + (
                    f"{100 * s.removed:.1f} % of the excess removed"
                    if s.visible
                    else "too little excess to judge by here"
                )
            )
        return tuple(out)


def find_gap(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    progress: Callable[[str], None] | None = None,
) -> GapFinding:
    """Find what the believed model lacks.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: name -> measured record, used to locate and to name.
        held_out: name -> measured record, used only to judge.
        progress: called with a few words as each stage begins.

    Raises:
        RecordError: a record is not measured, or lacks a channel of the believed suite.
        FlightAborted, TrimError: the believed aircraft cannot fly these commands.
    """
    say = progress or (lambda text: None)
    for name, record in {**records, **held_out}.items():
        if record.kind != "measured":
            raise RecordError(f"the gap workflow takes measured records only, got '{name}' of kind '{record.kind}'")
    say("locate the residual")
    maps = tuple(_map(believed, name, record) for name, record in records.items())
    naming = name_effect(believed, list(records.values()), say)
    amended = believed
    if naming.best is not None:
        amended = _tuned(believed, naming.best.tuning).with_effect(naming.best.effect, naming.best.values)
    say("judge on held-out manoeuvres")
    shrink = tuple(_shrink(believed, amended, name, record) for name, record in held_out.items())
    return GapFinding(believed, amended, maps, naming, shrink)


def _tuned(believed: Believed, factors: Mapping[str, float]) -> Believed:
    return believed.with_tuning({n: factors[n] for n in NUISANCES})


def _map(believed: Believed, name: str, record: FlightRecord) -> ResidualMap:
    return locate(name, believed.residuals(record), believed.outputs, record.dt_s)


def _shrink(believed: Believed, amended: Believed, name: str, record: FlightRecord) -> Shrink:
    measured = record.columns(believed.outputs)
    predictions, energy, maps = [], [], []
    for model in (believed, amended):
        y = model.predict(record)
        residuals = model.in_noise_units(record, measured - y)
        predictions.append(y + (measured - y).mean(axis=0))
        energy.append((residuals**2).mean(axis=0))
        maps.append(locate(name, residuals, model.outputs, record.dt_s))
    return Shrink(name, record, predictions[0], predictions[1], energy[0], energy[1], maps[0], maps[1])
