"""The gap workflow: locate, name, amend, and judge on manoeuvres that were used for neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from testbench.constants import DEG_RAD, G0_M_S2, KT_M_S
from testbench.errors import RecordError, located
from testbench.gap.ahead import Ahead
from testbench.gap.air import AirFound, in_air, listen, listen_again, listen_in_flight, measure, misfit
from testbench.gap.believed import LATERAL_NUISANCES, NUISANCES, Believed
from testbench.gap.check import DataCheck, check_data
from testbench.gap.descent import retune
from testbench.gap.effects import Effect
from testbench.gap.evidence import WEAK, noise_limit
from testbench.gap.fit import FALSE_ALARM
from testbench.gap.forces import EquationErrors, equation_errors
from testbench.gap.local import Local
from testbench.gap.locate import RegionMap, ResidualMap, Structure, locate, locate_regions, structure
from testbench.gap.name import ENOUGH_ALONE, Naming, name_effect
from testbench.gap.plan import separate
from testbench.gap.verdict import FAR, WrongParameter, confirmed, largest_errors, off_parameters, wrong_parameters
from testbench.record import FlightRecord, FloatArray

# What a simulator may be off in the short period and after a power change, in roll and yaw response and in a steady
# sideslip, 14 CFR 60, appendix A, table A2A; the pitch angle's tolerance is taken for the angle of attack.
TOLERANCE = {
    "theta": 1.5 * DEG_RAD,
    "alpha": 1.5 * DEG_RAD,
    "q": 2.0 * DEG_RAD,
    "az": 0.10 * G0_M_S2,
    "V": 3.0 * KT_M_S,
    "beta": 1.0 * DEG_RAD,
    "phi": 2.0 * DEG_RAD,
    "p": 2.0 * DEG_RAD,
    "r": 2.0 * DEG_RAD,
}
_ALLOWED = (
    "than a flight simulator for training may be off (1.5 deg, 2 deg/s, 0.10 g, 3 kt, 2 deg of bank, 1 deg of "
    "sideslip: 14 CFR 60, table A2A)"
)
SAME_AIR = 0.15  # the search is made again if the rms of turbulence changes by more than this share of it


@dataclass(frozen=True, eq=False)
class Shrink:
    """Before and after on one held-out manoeuvre, residuals in units of the noise.

    Attributes:
        manoeuvre: name.
        record: the measured record.
        before, after: (n, p) predictions of the believed and of the amended model, offset to the record's mean.
        energy_before, energy_after: (p,) mean squared residual per channel, 1 is the noise floor.
        taken: (p,) number of samples that were taken.
        map_before, map_after: where the residual sits.
    """

    manoeuvre: str
    record: FlightRecord
    before: FloatArray
    after: FloatArray
    energy_before: FloatArray
    energy_after: FloatArray
    taken: FloatArray
    map_before: ResidualMap
    map_after: ResidualMap

    @property
    def visible(self) -> bool:
        """True if the excess before stands four standard deviations above what noise alone scatters by."""
        scatter = np.sqrt(np.sum(2.0 / np.maximum(self.taken, 1.0)))
        return float(np.sum(self.energy_before - 1.0)) > 4.0 * scatter

    @property
    def removed(self) -> float:
        """Share of the excess energy over the noise floor that the amendment removed, all channels together."""
        excess = float(np.sum(self.energy_before - 1.0))
        return 1.0 - float(np.sum(self.energy_after - 1.0)) / excess if excess > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class GapFinding:
    """What the gap workflow found, where, and what adding it did on held-out manoeuvres.

    Attributes:
        believed: what was believed, with the air that was found.
        amended: the same with what was named.
        maps: where the residual of the believed model sits, one per manoeuvre that was used to name.
        naming: the outcome.
        shrink: before and after, one per held-out manoeuvre.
        air: what the residuals say of the air.
        regions: where in the flight envelope the residual of the believed model sits.
        forces: equation errors of forces and moments, one per manoeuvre that has the channels for it.
        next_flight: the manoeuvre that would tell the rest apart, in words; "" if nothing is left to tell apart.
        check: what the instruments say of each other, or None if that was not asked.
        parameters: believed coefficients that re-tuning finds wrong, where no effect is named; ``amended`` is re-tuned.
        errors: channel -> largest error of the believed model over all records, about its mean in each, SI.
        left: what the residuals of ``amended`` hold that is not white, where an effect is named in still air; None if
            that may be noise.
    """

    believed: Believed
    amended: Believed
    maps: tuple[ResidualMap, ...]
    naming: Naming
    shrink: tuple[Shrink, ...]
    air: AirFound
    regions: tuple[RegionMap, ...] = ()
    forces: tuple[EquationErrors, ...] = ()
    next_flight: str = ""
    check: DataCheck | None = None
    parameters: tuple[WrongParameter, ...] = ()
    errors: Mapping[str, float] = field(default_factory=dict)
    left: Structure | None = None

    @property
    def changed(self) -> bool:
        """True if ``amended`` is another model than ``believed``: something was named, or parameters are wrong."""
        return self.naming.best is not None or bool(self.parameters)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer in words."""
        re_tuned = "; ".join(p.sentence for p in self.parameters)
        out = [f"{re_tuned}; beside that, {self.naming.sentence}" if re_tuned else self.naming.sentence]
        out += [*self._evidence(), *([self.next_flight] if self.next_flight else [])]
        for s in self.shrink if self.changed else ():
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
        if self.naming.outcome != "no gap":
            out += [m.sentence for m in self.maps]
            out += [max(self.regions, key=lambda r: r.contrast).sentence] if self.regions else []
        news = self.check.sentences if self.check is not None and self.check.news else ()
        return (*out, self.air.sentence, *news)

    @property
    def immaterial(self) -> bool:
        """True if what was named changes no channel of a held-out manoeuvre by as much as TOLERANCE.

        That is what flight simulators for training are allowed to be off; a channel without a tolerance must not change
        by more than its noise. Where nothing is named but more than noise is left, or parameters are wrong: True if the
        believed model errs by less than TOLERANCE in every record.
        """
        judged = [i for i, n in enumerate(self.believed.outputs) if n in TOLERANCE]
        if self.naming.best is None:
            errors = [(self.errors.get(self.believed.outputs[i], np.inf), i) for i in judged]
            gap = bool(self.parameters) or self.naming.outcome != "no gap"
            return gap and bool(judged) and all(e < TOLERANCE[self.believed.outputs[i]] for e, i in errors)
        if not self.shrink or self.naming.best.effect.met is not None:  # a gust is of no other manoeuvre's air
            return False
        limits = np.array(
            [TOLERANCE.get(n, s) for n, s in zip(self.believed.outputs, self.believed.noise_std, strict=True)]
        )
        moved = [np.abs(s.after - s.before).max(axis=0) for s in self.shrink]
        return bool(judged) and bool(np.all(np.max(moved, axis=0) < limits))

    def _evidence(self) -> list[str]:
        best = self.naming.best
        if best is None:
            judged = ", ".join(n for n in self.believed.outputs if n in TOLERANCE)
            words = f"real but immaterial: in {judged} of these records the believed model errs by less {_ALLOWED}"
            off = [p.sentence for p in off_parameters(self.naming) if p.deviations <= FAR]
            return [*off, words] if self.immaterial else off
        out = [
            f"evidence: it lowers chi-square by {best.gain:.0f}, where noise alone reaches {best.threshold:.3g} once "
            f"in {1.0 / FALSE_ALARM:.0f} cases"
        ]
        others = [f for f in self.naming.ranking if f.effect.name not in self.naming.names]
        if others:
            second = max(others, key=lambda f: f.gain)
            share = 100.0 * second.gain / best.gain
            out[0] += f"; the runner-up, {second.effect.title}, lowers it by {second.gain:.0f} ({share:.0f} %)"
        if self.left is not None:
            out.append(self.left.sentence)
        if self.immaterial:
            words = f"real but immaterial: in the manoeuvres held out it changes every channel by less {_ALLOWED}"
            if not set(self.believed.outputs) <= TOLERANCE.keys():
                words += ", or where none is given by less than its noise"
            out.append(words)
        if best.effect.met is not None:
            out.append(
                "it was in the air of that manoeuvre alone; what those held out gain is the work of the coefficients "
                f"re-tuned beside it. It could be mistaken for {best.effect.mistaken_for}. What separates them: "
                f"{best.effect.separated_by}"
            )
        priors = {**NUISANCES, **LATERAL_NUISANCES}
        far = [f"{n} {f:.3g}" for n, f in best.tuning.items() if abs(f - 1.0) > 2.0 * priors[n]]
        if far:
            out.append(
                f"re-tuned beside it by more than twice what is believed of them: {', '.join(far)} times the believed "
                "value; the effect may not be the whole story"
            )
        return out


def find_gap(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    progress: Callable[[str], None] | None = None,
    check: bool = False,
    effects: Mapping[str, Effect] | None = None,
) -> GapFinding:
    """Find what the believed model lacks.

    The instruments are checked against each other, the air is listened to, the library is searched, and what is found
    is judged on the manoeuvres held out: what makes them worse is not named. The air is listened to again beside what
    was named; where it turns out to move otherwise than believed, the search is made again in it. Within
    ``testbench.gap.ahead.processes(n)`` the same is found sooner, in n processes.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: name -> measured record, used to locate and to name.
        held_out: name -> measured record, used only to judge.
        progress: called with a few words as each stage begins.
        check: check the instruments against each other first; takes about as long as the search itself.
        effects: the library, by name; that of the suite if not given.

    Raises:
        RecordError: a record is not measured, or lacks a channel of the believed suite.
        FlightAborted, LimitError, TrimError: the believed aircraft cannot fly these commands.
    """
    say = progress or (lambda text: None)
    for name, record in {**records, **held_out}.items():
        if record.kind != "measured":
            raise RecordError(f"the gap workflow takes measured records only, got '{name}' of kind '{record.kind}'")
        with located(None, f"record '{name}'"):
            believed.check_commands(record)
            believed.predict(record)  # what cannot be flown, of those held out too, is to be known before the search
    naming_records = list(records.values())
    checked, instruments = None, partial(check_data, believed, naming_records)
    with Ahead() as ahead:
        if check:
            say("check the instruments against each other")
            ahead.begin("check", instruments)  # the search needs nothing of it
            checked = ahead.take("check", instruments) if ahead.most == 1 else None
        say("listen to the air")
        air = listen(believed, naming_records)
        believed, naming, air = search(believed, naming_records, air, say, effects)
        if check and checked is None:
            checked = ahead.take("check", instruments)
    naming = confirmed(naming, believed, list(held_out.values()))
    parameters = wrong_parameters(naming, believed, list(held_out.values()))
    if naming.best is not None:
        amended = naming.best.added_to(believed)
    else:
        amended = believed.with_tuning(naming.tuning) if parameters else believed
    say("locate the residual")
    maps = tuple(_map(believed, name, record) for name, record in records.items())
    left, taken = zip(*((believed.residuals(r), believed.taken(r)) for r in naming_records), strict=True)
    regions = locate_regions(naming_records, left, believed.outputs, taken)
    plain = replace(believed, whiten=None)
    forces = tuple(e for n, r in records.items() if (e := equation_errors(plain, n, r)) is not None)
    next_flight = ""
    if naming.outcome == "set":
        say("seek the manoeuvre that would tell the rest apart")
        alike = [f for f in naming.ranking if f.effect.name in naming.names]
        next_flight = separate(believed, naming_records, alike)
    say("judge on held-out manoeuvres")
    shrink = tuple(_shrink(believed, amended, name, record) for name, record in held_out.items())
    errors = largest_errors(believed, [*naming_records, *held_out.values()])
    named = naming.best is not None and not naming.best.scatter_s  # scattered commands leave what no model has
    uneven = _left(amended, naming_records) if named else None
    return GapFinding(
        believed, amended, maps, naming, shrink, air, regions, forces, next_flight, checked, parameters, errors, uneven
    )


def search(
    believed: Believed,
    records: Sequence[FlightRecord],
    air: AirFound,
    say: Callable[[str], None],
    effects: Mapping[str, Effect] | None = None,
) -> tuple[Believed, Naming, AirFound]:
    """Return the believed model in the air that was found, the naming, and the air.

    ``effects`` is the library, that of the suite if not given.

    The rms of turbulence found beside a gap holds some of the gap, and the turbulence works on flights that the gap has
    changed. What comes nearest at first is taken out; if the rms changes, or more than noise is left, the search is
    made once more, in the air beside it and along its flights. What explains little may owe that to an rms that holds
    most of it: if in the air beside it something is named, that is the answer.
    """
    if air.moves:
        say("measure the air")
    flown_in, air = in_measured_air(believed, records, air)
    naming = name_effect(flown_in, records, say, effects)
    if naming.noise_left and not air.moves:
        return flown_in, naming, air
    say("listen to the air again")
    tuned = believed.with_tuning(naming.tuning)
    near = next((f for f in naming.ranking if f.significant and f.flown and f.gain > WEAK), None)
    if air.moves and near is not None and near.share < ENOUGH_ALONE:
        hidden = _hidden_by_air(believed, tuned, near.added_to(believed), records, air, say, effects)
        if hidden is not None:
            return hidden
        near = None  # what explains so little is not what is missing: what it would take out may be the air's
    beside = tuned if near is None else near.added_to(believed)
    gain = max((f.gain for f in naming.ranking), default=0.0)
    again = listen_again(tuned, beside, records, air, gain)
    same = again.moves == air.moves and abs(again.rms_m_s - air.rms_m_s) <= SAME_AIR * air.rms_m_s
    if same and (near is None or not air.moves or near.chi2 <= noise_limit(flown_in, naming.samples)):
        return flown_in, naming, air
    if near is None and again.moves:  # coefficients that were re-tuned in another air are not those of this one
        beside = _retuned(believed, in_air(believed, again, beside), records)
        again = measure(beside, records, again)
    flown_in = in_air(believed, again, beside)
    return flown_in, name_effect(flown_in, records, say, effects), again


def _hidden_by_air(
    believed: Believed,
    tuned: Believed,
    beside: Believed,
    records: Sequence[FlightRecord],
    air: AirFound,
    say: Callable[[str], None],
    effects: Mapping[str, Effect] | None,
) -> tuple[Believed, Naming, AirFound] | None:
    """Return what :func:`search` does, if in the air beside an effect something is named; None if not.

    Args:
        believed: model.
        tuned: the same, re-tuned without an effect.
        beside: the same, with an effect that explains little.
        records: those that are named from.
        air: what was heard.
        say: called with a few words as each stage begins.
        effects: the library.
    """
    again = measure(beside, records, air)
    if misfit(tuned, records, measure(tuned, records, air)) - misfit(beside, records, again) <= WEAK:
        return None
    flown_in = in_air(believed, again, beside)
    naming = name_effect(flown_in, records, say, effects)
    return (flown_in, naming, again) if naming.names else None


def in_measured_air(believed: Believed, records: Sequence[FlightRecord], air: AirFound) -> tuple[Believed, AirFound]:
    """Return the believed model in the air that was heard, measured over all records, and that air.

    Turbulence works on the flights of the aircraft as it is, so that coefficients are re-tuned first.
    """
    if not air.moves:
        return believed, air
    tuned = _retuned(believed, in_air(believed, air), records)
    air = listen_in_flight(tuned, records, air)
    return in_air(believed, air, tuned), air


def _retuned(believed: Believed, flown_in: Believed, records: Sequence[FlightRecord]) -> Believed:
    """Return the believed model with the coefficients that suit the records best in the air of ``flown_in``."""
    return believed.with_tuning(retune(Local.at(flown_in, flown_in, tuple(records))).tuning)


def _left(amended: Believed, records: Sequence[FlightRecord]) -> Structure | None:
    """Return what the amended model leaves that is not white; in moving air residuals are white as far as its model."""
    if amended.whiten is not None:
        return None
    residuals, taken = zip(*((amended.residuals(r), amended.taken(r)) for r in records), strict=True)
    return structure(residuals, amended.outputs, records[0].dt_s, FALSE_ALARM, taken)


def _map(believed: Believed, name: str, record: FlightRecord) -> ResidualMap:
    return locate(name, believed.residuals(record), believed.outputs, record.dt_s, believed.taken(record))


def _shrink(believed: Believed, amended: Believed, name: str, record: FlightRecord) -> Shrink:
    measured, taken = record.columns(believed.outputs), believed.taken(record)
    count = taken.sum(axis=0).astype(float)
    predictions, energy, maps = [], [], []
    for model in (believed, amended):
        y = model.predict(record)
        residuals = model.in_noise_units(record, measured - y)
        predictions.append(y + ((measured - y) * taken).sum(axis=0) / np.maximum(count, 1.0))
        energy.append((residuals**2).sum(axis=0) / np.maximum(count, 1.0))
        maps.append(locate(name, residuals, model.outputs, record.dt_s, taken))
    return Shrink(name, record, predictions[0], predictions[1], energy[0], energy[1], count, maps[0], maps[1])
