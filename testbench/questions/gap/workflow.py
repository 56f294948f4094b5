"""The gap workflow: locate, name, amend, and judge on manoeuvres that were used for neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.errors import RecordError, located
from testbench.core.processes import Ahead
from testbench.core.record import FlightRecord
from testbench.effects import OTHER_SERVOS, Effect, library
from testbench.flight.batch.jobs import Tally
from testbench.inference.parameters import Source
from testbench.questions.gap import onset
from testbench.questions.gap.again import fly_again
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.drive import driven
from testbench.questions.gap.evidence.air import AirFound, in_air, listen, listen_again, listen_in_flight, smoothed
from testbench.questions.gap.evidence.check import check_instruments, check_signs
from testbench.questions.gap.evidence.control_path import paths_seen
from testbench.questions.gap.evidence.gusts import called
from testbench.questions.gap.evidence.held_out import differences
from testbench.questions.gap.evidence.lacking import lacking
from testbench.questions.gap.evidence.locate import (
    ResidualMap,
    largest_errors,
    left_by,
    locate,
    locate_regions,
)
from testbench.questions.gap.evidence.noise_found import find_noise
from testbench.questions.gap.explain import Explanation, Naming
from testbench.questions.gap.flights import flights
from testbench.questions.gap.name import ELSEWHERE, Sought, name_effect, unknown_motion
from testbench.questions.gap.plan import separate
from testbench.questions.gap.result import GapFinding, Shrink
from testbench.questions.gap.scenario import Drive
from testbench.questions.gap.search.hypothesis import Hypothesis, retune
from testbench.questions.gap.window_length import Windows
from testbench.questions.gap.windows import as_they_start, begin_freely, in_windows

SHOWN = 3  # records of which it is shown over time what the model lacks: those with the largest residuals
SAME_AIR = 0.15  # share by which the rms of turbulence may change before the search is made again


@on_one_thread
def find_gap(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    progress: Callable[[str], None] | None = None,
    check: bool = False,
    effects: Mapping[str, Effect] | None = None,
    again: int = 0,
    again_file: Path | None = None,
    windows: Windows = "auto",
    drive: Drive = "both",
    further: Mapping[str, Effect] | None = None,
    noise: Source = "simulated",
) -> GapFinding:
    """Find what the believed model lacks.

    The instruments are checked against each other, the turbulence is measured, and all explanations that these leave
    open are weighed against each other.
    The turbulence is measured again beside what was named; if it differs, they are weighed again in the new air.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: name -> measured record, used to locate and to name.
        held_out: name -> measured record, used only to judge.
        progress: called with a few words as each stage begins.
        check: check the instruments against each other first.
        effects: the library, by name; that of the suite if not given.
        again: number of the user's own flights that are flown again with truths drawn from the priors, each of which is
            asked about as the measured ones were: what are stated probabilities worth here?
        again_file: keeps each of them, so that none is flown twice.
        windows: "auto" cuts records that do not begin with quiet trim flight into windows that start freely, a number
            all of them, into windows of so many seconds; "off" refuses them.
        drive: "both" compares surfaces that are recorded beside their commands, and lets surfaces drive where no
            command is recorded; "surface" lets them drive wherever they are recorded; "command" does not look at them.
        further: effects that are sought only in a place where one of the library comes near, by name; if not given,
            those servo effects that the library lacks, and none if ``effects`` are given.
        noise: where the noise of the believed sensors comes from. Unless it was simulated here, how large it is in
            these records is found first, and they are judged by that.

    Raises:
        RecordError: a record is not measured, or lacks a channel of the believed suite; or ``again_file`` cannot be
            used.
        FlightAborted, LimitError, TrimError: the believed aircraft cannot fly these commands.

    Example:
        >>> import testbench as tb
        >>> finding = tb.find_gap(believed, {"doublet": record}, {"sweep": held_out})  # doctest: +SKIP
        >>> finding.sentences  # doctest: +SKIP
    """
    say = progress or (lambda text: None)
    for name, record in {**records, **held_out}.items():
        if record.kind != "measured":
            raise RecordError(f"the gap workflow takes measured records only, got '{name}' of kind '{record.kind}'")
    by = driven(believed, records, held_out, drive)
    believed, records, held_out = by.believed, by.records, by.held_out
    check_signs(believed, as_they_start(records))
    believed, given, others = in_windows(believed, records, held_out, windows, say)
    records, held_out = called(given.records), others.records
    for name, record in {**records, **held_out}.items():
        with located(None, f"record '{name}'"):
            believed.check_commands(record)
            believed.predict(record)  # what cannot be flown, of those held out too, is to be known before the search
    stated, noise_found = believed, None
    if noise != "simulated":
        say("measure the noise")
        noise_found = find_noise(believed, list(records.values()), noise)
        believed = replace(stated, suite=noise_found.corrected(stated.suite))
    instruments = partial(check_instruments, believed.suite, list(given.whole.values()))
    with Ahead() as ahead:
        if check:
            say("check the instruments against each other")
            ahead.begin("check", instruments)  # the search needs nothing of it
        checked = ahead.take("check", instruments) if check and ahead.most == 1 else None
        say("listen to the air")
        air = listen(believed, list(records.values()))
        records, held_out = _smoothed(believed, air, records), _smoothed(believed, air, held_out)
        flown = list(records.values())
        known = library(believed.suite, believed.aircraft) if effects is None else effects
        servos = OTHER_SERVOS if further is None and effects is None else further or {}
        unseen = {n for path in by.paths for n in path.effects}
        sought = Sought(
            {n: e for n, e in known.items() if n not in unseen},
            {n: e for n, e in servos.items() if n not in unseen},
            open_terms=True,
            source="simulated" if noise == "simulated" else "measured",
            pairs=not given.notes,  # where starts are fitted once more beside what comes nearest, two are sought after
            held_out=list(held_out.values()),
        )
        as_believed = believed
        begun = _Begun(as_believed, records, air, sought, say)
        alone = replace(sought, elsewhere=lambda: bool(begun.places))
        believed, naming, air = search(as_believed, flown, air, say, alone)
        near = _nearest(naming)
        if noise_found is not None and near is not None:  # what was missing may have been taken for noise
            beside_it = find_noise(stated, flown, noise, near.added_to(stated))
            if noise_found.differs(beside_it):
                noise_found = beside_it
                as_believed = replace(stated, suite=noise_found.corrected(stated.suite))
                believed, naming, air = search(as_believed, flown, air, say, alone)
                near = _nearest(naming)
        if near is not None and given.notes:  # tangents of a start are those of the model that it was fitted to
            say("fit where windows start beside what comes nearest")
            as_believed = begin_freely(as_believed, {**records, **held_out}, near.added_to(as_believed))
            alone = replace(alone, pairs=True)
            believed, naming, air = search(as_believed, flown, air, say, alone)
        if check and checked is None:
            checked = ahead.take("check", instruments)
    whole, all_in = flown, as_believed
    acting = None
    if naming.weighed.unknown > ELSEWHERE and begun.places:  # else what acts in all records explains them
        elsewhere = _begun_somewhere(begun.places, as_believed, records, (believed, naming, air), sought, say)
        if elsewhere is not None:
            acting, records, (believed, naming, air) = elsewhere
            flown = list(records.values())
        else:
            believed, naming, air = search(as_believed, flown, air, say, replace(sought, pairs=True))
    flights_again = None
    if again:

        def ask(measured: Sequence[FlightRecord], heard: AirFound) -> Naming:
            """Ask about a flight as the measured ones were asked about."""
            heard_in = smoothed(all_in, heard, measured)
            return search(all_in, heard_in, heard, lambda stage: None, replace(sought, open_terms=False))[1]

        flights_again = fly_again(all_in, whole, air, sought.effects or {}, again, ask, say, again_file)
    if naming.best is not None:
        amended = naming.best.added_to(believed)
    else:
        amended = believed.with_nuisances(naming.nuisances) if naming.off else believed
    if acting is not None and amended.later:
        held_out = onset.lasting(believed, amended, held_out)
    say("locate the residual")
    maps = tuple(_map(believed, name, record) for name, record in records.items())
    left, taken = zip(*((believed.residuals(r), believed.taken(r)) for r in flown), strict=True)
    of = sorted(zip(records.items(), left, strict=True), key=lambda one: -float(np.mean(one[1] ** 2)))[:SHOWN]
    lacks = [lacking(believed, n, r, unknown_motion(believed, r, deflections=False), x) for (n, r), x in of]
    next_flight = ""
    alike = [f for f in naming.ranking if f.effect.name in naming.names and not f.coefficients]
    if naming.outcome == "set" and len(alike) > 1:
        say("seek the manoeuvre that would tell the rest apart")
        next_flight = separate(believed, flown, alike)
    say("judge on held-out manoeuvres")
    models = [believed, amended] if amended is not believed else [believed]
    return GapFinding(
        believed=believed,
        amended=amended,
        maps=maps,
        naming=naming,
        shrink=tuple(_shrink(believed, amended, name, record) for name, record in held_out.items()),
        air=air,
        noise=noise_found,
        regions=locate_regions(flown, left, believed.outputs, taken),
        lacks=tuple(lacks),
        next_flight=next_flight,
        check=checked,
        errors=largest_errors(believed, [*flown, *held_out.values()]),
        left=None if naming.best is None else left_by(amended, flown),
        again=flights_again,
        windows=(*given.notes, *others.notes),
        begun=acting,
        paths=(*by.paths, *paths_seen(believed, amended, naming, flown)),
        held_out=differences(believed, records, held_out),
        tally=_tally(models, [*flown, *held_out.values()]),
    )


@dataclass(frozen=True, eq=False)
class _Begun:
    """What may begin or end in flight, sought where it is asked for: most flights are explained without it."""

    believed: Believed
    records: Mapping[str, FlightRecord]
    air: AirFound
    sought: Sought
    say: Callable[[str], None]

    @cached_property
    def places(self) -> list[onset.Begun]:
        """Where it may, by an unknown motion alone, the most probable first."""
        self.say("seek what begins in flight")
        flown_in, _ = in_measured_air(self.believed, list(self.records.values()), self.air)
        nothing = replace(self.sought, effects={}, further={}, open_terms=False, pairs=False, held_out=())
        naming = name_effect(flown_in, list(self.records.values()), nothing)
        return [] if naming.weighed.nothing > 0.5 else onset.seek(flown_in, self.records, naming)


def _begun_somewhere(
    places: Sequence[onset.Begun],
    believed: Believed,
    records: Mapping[str, FlightRecord],
    found: tuple[Believed, Naming, AirFound],
    sought: Sought,
    say: Callable[[str], None],
) -> tuple[onset.Begun, dict[str, FlightRecord], tuple[Believed, Naming, AirFound]] | None:
    """Return the first place whose effects explain the records that are cut there, these, and what is found in them.

    ``found`` is what was found of the records as they are.
    """
    flown_in, naming, air = found
    along = Hypothesis.towards_unknown(flown_in, tuple(records.values()), naming.beside_unknown)
    tuned, effects = flown_in.with_nuisances(along.by_name), sought.effects or {}
    for place in places:
        cut = onset.divided(believed, records, place)
        there = replace(sought, effects=onset.later(effects, place), further={}, open_terms=False, pairs=False)
        begins = believed
        if place.record:
            begins = onset.begin_there(believed, cut, place, records[place.record], tuned)
        named = search(begins, list(cut.values()), air, say, there)
        if named[1].weighed.unknown < ELSEWHERE:
            return place, cut, named
    return None


def _nearest(naming: Naming) -> Explanation | None:
    """Return the most probable effect, if there is any that explains something."""
    return next((f for f in naming.ranking if f.gain > 0.0 and not f.coefficients), None)


def _smoothed(believed: Believed, air: AirFound, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    return dict(zip(records, smoothed(believed, air, list(records.values())), strict=True))


def _tally(models: Sequence[Believed], records: Sequence[FlightRecord]) -> Tally:
    """Count by what models are flown through records; flights that are kept are not flown again."""
    found = flights([model.wanted_to_read(record) for model in models for record in records])
    return Tally.of(x for x in found if isinstance(x, FlightRecord))


def search(
    believed: Believed, records: Sequence[FlightRecord], air: AirFound, say: Callable[[str], None], sought: Sought
) -> tuple[Believed, Naming, AirFound]:
    """Return the believed model in the air that was found, the naming, and the air.

    A gap raises the rms of turbulence that is measured beside it, and it changes the flights that the turbulence works
    on. So the effect that comes nearest is taken out, and the rms is measured again; where it changes, all is weighed
    once more.
    """
    if air.moves:
        say("measure the air")
    flown_in, air = in_measured_air(believed, records, air)
    naming = name_effect(flown_in, records, sought, say)
    if not air.moves and naming.outcome in ("no gap", "named", "set"):
        return flown_in, naming, air
    say("listen to the air again")
    near = _nearest(naming)
    tuned = believed.with_nuisances(naming.nuisances)
    beside = tuned if near is None else near.added_to(believed)
    again = listen_again(tuned, beside, records, air, 0.0 if near is None else near.gain)
    if again.moves == air.moves and abs(again.rms_m_s - air.rms_m_s) <= SAME_AIR * air.rms_m_s:
        return flown_in, naming, air
    flown_in = in_air(believed, again, beside)
    return flown_in, name_effect(flown_in, records, sought, say), again


def in_measured_air(believed: Believed, records: Sequence[FlightRecord], air: AirFound) -> tuple[Believed, AirFound]:
    """Return the believed model in the air that was heard, measured over all records, and that air.

    Turbulence works on the flights of the real aircraft, so coefficients are re-tuned first.
    """
    if not air.moves:
        return in_air(believed, air), air
    tuned = _retuned(believed, in_air(believed, air), records)
    air = listen_in_flight(tuned, records, air)
    return in_air(believed, air, tuned), air


def _retuned(believed: Believed, flown_in: Believed, records: Sequence[FlightRecord]) -> Believed:
    """Return the believed model with the coefficients that suit the records best in the air of ``flown_in``."""
    return believed.with_nuisances(retune(Hypothesis.at(flown_in, flown_in, tuple(records))).by_name)


def _map(believed: Believed, name: str, record: FlightRecord) -> ResidualMap:
    return locate(name, believed.residuals(record), believed.outputs, record.dt_s, believed.taken(record))


def _shrink(believed: Believed, amended: Believed, name: str, record: FlightRecord) -> Shrink:
    measured, taken = record.columns(believed.outputs), believed.taken(record)
    count = taken.sum(axis=0).astype(float)
    predictions, energy, maps = [], [], []
    for model in (believed, amended):
        y = model.predict(record)
        residuals = model.residuals(record)
        predictions.append(y + ((measured - y) * taken).sum(axis=0) / np.maximum(count, 1.0))
        energy.append((residuals**2).sum(axis=0) / np.maximum(count, 1.0))
        maps.append(locate(name, residuals, model.outputs, record.dt_s, taken))
    return Shrink(name, record, predictions[0], predictions[1], energy[0], energy[1], count, maps[0], maps[1])
