"""What tells how the controls moved: commands, or recorded surfaces in their place.

A command drives the believed path: its servo, what is fed back, what is joined. A recorded surface drives the model
behind all of that. Its servo is bypassed, and nothing that lies between command and surface can be seen. The noise of
the surface moves the prediction as a gust would, and its zero is not known: both are taken out of residuals and
signatures alike (:mod:`.evidence.gust_filter`). A surface that every record holds beside its command is a channel that
the believed path, driven by the command, predicts.

Where commands drive, a recorded surface is a channel as all others are: servo, linkage and feedback of the model say
where it stands, and explanations are weighed by it as by any other reading.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft, Amendment, SetProperty
from testbench.aircraft.amend import Change
from testbench.aircraft.seams import control_path, with_servo
from testbench.core.channels import CONTROLS, SURFACES
from testbench.core.errors import LimitError, RecordError, located
from testbench.core.record import FlightAborted, FlightRecord
from testbench.effects import SERVOS
from testbench.effects.feedback import FED_TO
from testbench.effects.servo import WORDS
from testbench.estimators.regression.smoothing import LEAST, noise_level
from testbench.page.words import listed
from testbench.questions.gap.believed import NO_SERVO_RAD_S, Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import (
    BETWEEN,
    begins_quietly,
    between_samples,
    driven_by_surfaces,
    rested,
    stilled,
    stirs,
    surface_noise,
)
from testbench.questions.gap.explain import Naming, percent
from testbench.questions.gap.scenario import Drive
from testbench.sensors import SensorSuite

BYPASS = "recorded surface"  # the amendment that takes a servo away; files of the amended aircraft do without it
_NO_LIMIT_RAD_S = 100.0
_LOG = "sha256"  # in the provenance of what was imported from a log


def driven(
    believed: Believed, records: Mapping[str, FlightRecord], drive: Drive
) -> tuple[Believed, dict[str, FlightRecord], tuple[SurfacePath, ...]]:
    """Return belief and records with what drives as ``drive`` says, and the paths that are not seen for it.

    Of controls that surfaces drive, the belief has no servos; the other surfaces are compared.
    """
    given = drive_records(believed.suite, records, drive)
    controls = driving(list(given.values()))
    out = _without_servos(believed, given, controls) if controls else believed
    if drive == "both":
        out = comparing(out, list(given.values()))
    why = 'drive = "surface" asks for it' if drive == "surface" else "its command, {}_cmd, is not recorded"
    return out, given, tuple(SurfacePath(c, why.format(c)) for c in controls if c in SURFACES)


def comparing(believed: Believed, records: Sequence[FlightRecord] = ()) -> Believed:
    """Return the belief that compares the surfaces of its suite which all records hold beside their commands.

    A surface that is said to have no noise has as much as a simulated servo errs by between samples.
    """
    suite, least = believed.suite, CRITERIA.faintest_rad
    surfaces = tuple(
        c
        for c in suite.surfaces
        if c in believed.aircraft.controls
        and all(c in r and f"{c}_cmd" in r and c not in surface_noise(r) for r in records)
    )
    silent = [c for c in surfaces if suite.noise_std[c] < least]
    sensors = tuple(replace(s, noise_std=least) if s.channel in silent else s for s in suite.sensors)
    return replace(believed, suite=replace(suite, sensors=sensors), surfaces=surfaces) if surfaces else believed


def drive_records(
    suite: SensorSuite, records: Mapping[str, FlightRecord], drive: Drive = "both"
) -> dict[str, FlightRecord]:
    """Return records that hold what drives each control: its command, or its surface in place of it.

    Commands that a sensor with noise measured stand still where they rest (:mod:`.evidence.rested`). Those of a log
    that go step by step move on between samples (:func:`.evidence.commanded.between_samples`). Samples of a
    surface that were lost lie on straight lines. A surface that stirs no more than its noise stands still; one that
    stirs in no record is left alone where something else drives. ``drive`` "surface" takes surfaces wherever they are
    recorded, "both" where no command is, "command" none.

    Raises:
        RecordError: a record holds nothing that drives the model; or one holds the command of a control alone, where
            the surface of others is to drive.
    """
    out = rested(suite, records)
    for control in CONTROLS if drive != "command" else ():
        out |= _by_surface(suite, out, control, drive == "surface")
    for name, record in out.items():
        with located(None, f"record '{name}'"):
            if not any(f"{c}_cmd" in record for c in CONTROLS):
                surfaces = [c for c in CONTROLS if c in record]
                fix = f'; {", ".join(surfaces)} could drive it: set drive = "both"' if surfaces else ""
                raise RecordError(
                    "a record must hold what drives the model, a command such as de_cmd or a surface such as de, got "
                    f"{', '.join(record.channels)}{fix}"
                )
    return {
        n: between_samples(r) if _LOG in r.provenance and BETWEEN not in r.provenance else r for n, r in out.items()
    }


def _by_surface(
    suite: SensorSuite, records: Mapping[str, FlightRecord], control: str, wherever: bool
) -> dict[str, FlightRecord]:
    """Return the records that the surface of a control is to drive, ``wherever`` it is recorded or for want of it."""
    command = f"{control}_cmd"
    own = {n: r for n, r in records.items() if (control in r or command in r) and control not in surface_noise(r)}
    silent = [n for n, r in own.items() if command not in r]
    if not (silent or (wherever and any(control in r for r in own.values()))):
        return {}
    for name, record in own.items():
        if control not in record:
            why = f"as '{silent[0]}' holds no {command}" if silent else 'as drive = "surface"'
            raise RecordError(f"record '{name}': {control} must be recorded, {why}, got {command} alone")
    out = {n: _driven(suite, r, control) for n, r in own.items()}
    stirring = any(np.ptp(r[command]) > 0.0 for r in out.values())
    others = all(any(f"{c}_cmd" in records[n] for c in CONTROLS if c != control) for n in out)
    return out if stirring or not others else {}


def driving(records: Sequence[FlightRecord]) -> dict[str, float]:
    """Return the controls whose surfaces drive the model in any of the records -> noise, 0 where none stirs."""
    out: dict[str, float] = {}
    for record in records:
        for control, noise in surface_noise(record).items():
            stands = bool(np.ptp(record[f"{control}_cmd"]) == 0.0)
            out[control] = max(out.get(control, 0.0), 0.0 if stands else noise)
    return out


def _without_servos(believed: Believed, records: Mapping[str, FlightRecord], controls: Mapping[str, float]) -> Believed:
    """Return the belief that recorded surfaces drive: their servos bypassed, their noise known."""
    aircraft = replace(believed.aircraft, rate_hz=believed.rate_hz)
    turned = [c for c in controls if c in SURFACES]
    for control in turned:
        aircraft = _bypassed(aircraft, control)
    noise = {c: controls[c] for c in turned if controls[c] > 0.0}
    out = replace(believed, aircraft=aircraft, surface_noise=noise)
    for control in turned:
        if _turned(out, control, records):
            raise RecordError(
                f"a recorded {WORDS[control]} cannot drive a model that moves it by feedback, as "
                f"{believed.aircraft.name} does; record {control}_cmd, or use a model without that feedback"
            )
    return out


def _turned(believed: Believed, control: str, records: Mapping[str, FlightRecord]) -> bool:
    """Return whether the believed model turns a surface by what it measures, by a record that it can fly from trim.

    Then the surface moves otherwise, about its trim, where other coefficients move the aircraft so. A record may begin
    while the controls rest and the aircraft does not: from trim it may not survive that.
    """
    for record in (r for r in records.values() if control in surface_noise(r) and begins_quietly(r)):
        with suppress(FlightAborted, LimitError):
            other = believed.with_nuisances(dict.fromkeys(believed.priors_of([record]), 1.03))
            a, b = (m.flown(record, (control,))[control] for m in (believed, other))
            return bool(np.max(np.abs((a - a[0]) - (b - b[0]))) > CRITERIA.turned_rad)
    return False


def driven_by(records: Sequence[FlightRecord]) -> str:
    """Return what drives the believed model in these records, in a sentence."""
    words = [WORDS[c] for c in driving(records)]
    if not words:
        return "The measured commands drive the a-priori model."
    return f"The recorded deflections of {listed(words)} drive the a-priori model, and measured commands otherwise."


def as_it_is(aircraft: Aircraft) -> Aircraft:
    """Return an aircraft with the servos that recorded surfaces bypass."""
    return replace(aircraft, amendments=tuple(a for a in aircraft.amendments if a.name != BYPASS))


def _driven(suite: SensorSuite, record: FlightRecord, control: str) -> FlightRecord:
    """Return the record with its surface in place of the command."""
    sensor = next((s for s in suite.sensors if s.channel == control), None)
    valid = record.valid[:, record.channels.index(control)]
    if not valid.any():
        raise RecordError(f"{control} must be recorded where it is to drive the model, every sample of it is missing")
    surface = np.interp(record.t_s, record.t_s[valid], record[control][valid])
    noise = CRITERIA.faintest_rad
    if sensor is None and control not in SURFACES and surface.size >= LEAST:
        noise = max(noise_level(surface), noise)
    if sensor is not None:
        noise = max(suite.noise_std[control] / abs(sensor.scale), CRITERIA.faintest_rad)
        surface = (surface - sensor.bias - sensor.drifted(record.t_s)) / sensor.scale
        late = sensor.lag_s + sensor.delay_s  # a lag is a delay to what is much slower than it
        surface = np.interp(record.t_s + late, record.t_s, surface)
    if not stirs(surface, noise, record.dt_s).any():
        surface = np.full_like(surface, surface.mean())
    elif control not in SURFACES:  # whose noise no filter takes out of the residuals
        surface = stilled(surface, noise, record.dt_s)
    known = {**surface_noise(record), control: noise}
    return driven_by_surfaces(record.with_columns({f"{control}_cmd": surface}), known)


def _bypassed(aircraft: Aircraft, control: str) -> Aircraft:
    """Return the aircraft whose surface is where its command is."""
    path = control_path(aircraft, control)
    changes: list[Change] = []
    if path.lag is not None:
        aircraft, more = with_servo(aircraft, control, NO_SERVO_RAD_S)
        changes += more
    if path.rate_limit is not None:
        changes.append(SetProperty(path.rate_limit, _NO_LIMIT_RAD_S))
    if not changes:
        return aircraft
    return aircraft.amended(Amendment(BYPASS, f"no servo of the {path.word}: its surface is recorded", tuple(changes)))


# Behind the recorded surface, too: it may work better or worse, or stand elsewhere than it reads.
_BEHIND = ("gain", "offset", "curved linkage")


@dataclass(frozen=True)
class SurfacePath:
    """The path of one control whose surface is recorded."""

    control: str  # "de", "da" or "dr"
    why: str = ""  # why it is not seen; "" if it is
    probability: float = 0.0  # that something of it is among what the model lacks
    # believed, nearest: rms that the believed model, and what comes nearest, leave of the surface, over its noise
    believed: float = 1.0
    nearest: float = 1.0

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the library's effects that act in it; where it is not seen, those that do not show."""
        kinds = [kind for kind, control in SERVOS if control == self.control and not (self.why and kind in _BEHIND)]
        clock = ("clock_offset",) if self.why and self.control == "de" else ()
        return (*(SERVOS[kind, self.control].name for kind in kinds), *FED_TO[self.control], *clock)

    @property
    def sentence(self) -> str:
        """What is known of it, in words."""
        word = WORDS[self.control]
        if self.why:
            return (
                f"the path of the {word} could not be seen: {self.why}, so the recorded {word} drives the model. Lag, "
                "rate limit, delay, dead band and play of its servo, its feedbacks and interconnects are not "
                "observable in these records and are not sought"
            )
        return (
            f"the path of the {word}: the a-priori model leaves {self.believed:.3g} times the noise of the recorded "
            f"surface, the nearest explanation {self.nearest:.3g} times; probability that something is missing between "
            f"its command and surface: {percent(self.probability)}"
        )


def paths_seen(
    believed: Believed, nearest: Believed, naming: Naming, records: Sequence[FlightRecord]
) -> tuple[SurfacePath, ...]:
    """Return what was found of the path of every surface that is compared."""
    if not believed.surfaces:
        return ()
    counts = np.sum([believed.taken(r).sum(axis=0) for r in records], axis=0)
    left = []
    for model in (replace(m, whiten=None) for m in (believed, nearest)):  # no gust moves a surface
        squares = np.sum([np.sum(model.residuals(r) ** 2, axis=0) for r in records], axis=0)
        left.append(np.sqrt(squares / np.maximum(counts, 1)))
    out = []
    for control in believed.surfaces:
        here, path = believed.outputs.index(control), SurfacePath(control)
        sure = naming.weighed.holds(path.effects)
        out.append(replace(path, probability=sure, believed=float(left[0][here]), nearest=float(left[1][here])))
    return tuple(out)
