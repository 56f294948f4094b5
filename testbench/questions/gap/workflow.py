"""The gap workflow: locate, name, amend, and judge on manoeuvres that were used for neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.errors import RecordError, located
from testbench.core.record import FlightRecord
from testbench.effects import OTHER_SERVOS, Effect, library
from testbench.flight.batch.jobs import Tally
from testbench.inference.parameters import Source
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.by_surface import borne_out, named_beside
from testbench.questions.gap.controls import fly_controls, without_false_alarms
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.decide import Naming, judged, noise_limit
from testbench.questions.gap.drive import driven
from testbench.questions.gap.evidence.air import (
    AirFound,
    in_air,
    listen,
    listen_again,
    listen_in_flight,
    measure,
    misfit,
)
from testbench.questions.gap.evidence.check import check_data
from testbench.questions.gap.evidence.control_path import JudgedPath, judge_paths, restricted
from testbench.questions.gap.evidence.forces import equation_errors
from testbench.questions.gap.evidence.gusts import called
from testbench.questions.gap.evidence.held_out import differences
from testbench.questions.gap.evidence.locate import (
    ResidualMap,
    largest_errors,
    left_by,
    locate,
    locate_regions,
)
from testbench.questions.gap.evidence.noise_found import find_noise
from testbench.questions.gap.evidence.signs import check_signs
from testbench.questions.gap.evidence.smoothed import smoothed
from testbench.questions.gap.flights import flights
from testbench.questions.gap.further import named_in_path
from testbench.questions.gap.in_windows import in_windows
from testbench.questions.gap.open_set import first_look, named_openly
from testbench.questions.gap.parameters import wrong_parameters
from testbench.questions.gap.plan import separate
from testbench.questions.gap.result import GapFinding, Shrink
from testbench.questions.gap.scenario import Drive
from testbench.questions.gap.search.gauss_newton import retune
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.name import name_effect
from testbench.questions.gap.search.parallel import Ahead
from testbench.questions.gap.surface_evidence import with_surfaces
from testbench.questions.gap.weighed import weigh
from testbench.questions.gap.window_length import Windows
from testbench.questions.gap.windows import as_they_start, begin_freely

SAME_AIR = 0.15  # share by which the rms of turbulence may change before the search is made again


@on_one_thread
def find_gap(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    progress: Callable[[str], None] | None = None,
    check: bool = False,
    effects: Mapping[str, Effect] | None = None,
    controls: int = 0,
    control_file: Path | None = None,
    windows: Windows = "auto",
    drive: Drive = "both",
    further: Mapping[str, Effect] | None = None,
    noise: Source = "simulated",
) -> GapFinding:
    """Find what the believed model lacks.

    The instruments are checked against each other, paths whose command and surface are recorded are judged by
    themselves, the turbulence is measured, the library is searched as far as these leave it open, and what is found is
    judged on the manoeuvres held out: what makes them worse is not named. The turbulence is measured again
    beside what was named; if it differs, the search is made again in the new air. Within
    ``testbench.questions.gap.search.parallel.processes(n)`` the same is found sooner, in n processes.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: name -> measured record, used to locate and to name.
        held_out: name -> measured record, used only to judge.
        progress: called with a few words as each stage begins.
        check: check the instruments against each other first; takes about as long as the search itself.
        effects: the library, by name; that of the suite if not given.
        controls: number of control flights without any effect; if one of them gains as much, nothing is named.
        control_file: keeps each of them, so that none is flown twice.
        windows: "auto" cuts records that do not begin with quiet trim flight into windows that start freely, a number
            all of them, into windows of so many seconds; "off" refuses them.
        drive: "both" judges paths whose surfaces are recorded beside their commands by themselves, and lets surfaces
            drive where no command is recorded; "surface" lets them drive wherever they are recorded; "command" does not
            look at them.
        further: servo effects that are sought only where the search points to the path of their control, by name; if
            not given, those that the library lacks, and none if ``effects`` are given.
        noise: where the noise of the believed sensors comes from. Unless it was simulated here, how large it is in
            these records is found first, and they are judged by that.

    Raises:
        RecordError: a record is not measured, or lacks a channel of the believed suite; or ``control_file`` cannot be
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
    as_believed = believed
    for name, record in {**records, **held_out}.items():
        with located(None, f"record '{name}'"):
            believed.check_commands(record)
            believed.predict(record)  # what cannot be flown, of those held out too, is to be known before the search
    naming_records = list(records.values())
    noise_found, as_stated = None, believed
    if noise != "simulated":
        say("measure the noise")
        noise_found = find_noise(believed, naming_records, noise)
        believed = as_believed = replace(believed, suite=noise_found.corrected(believed.suite))
    checked, instruments = None, partial(check_data, believed, list(given.whole.values()), naming_records)
    with Ahead() as ahead:
        if check:
            say("check the instruments against each other")
            ahead.begin("check", instruments)  # the search needs nothing of it
            checked = ahead.take("check", instruments) if ahead.most == 1 else None
        say("look at forces and moments")
        first = first_look(believed, given.whole)
        say("listen to the air")
        air = listen(believed, naming_records)
        records, held_out = _smoothed(believed, air, records), _smoothed(believed, air, held_out)
        naming_records = list(records.values())
        known = library(believed.suite, believed.aircraft) if effects is None else effects
        paths = judge_paths(believed, naming_records) if drive == "both" and not given.notes else ()
        known = restricted(known, [replace(p, outcome="not seen") for p in by.paths])[1]
        # Where starts are fitted once more beside what comes nearest, two effects at once are sought after that alone.
        pairs = not given.notes
        library_, still = known, believed
        believed, naming, air, known = _search_beside(paths, library_, still, naming_records, air, say, pairs)
        near = next((f for f in naming.ranking if f.significant and f.flown), None)
        if noise_found is not None and near is not None:  # what was missing may have been taken for noise
            beside_it = find_noise(as_stated, naming_records, noise, near.added_to(as_stated))
            if noise_found.differs(beside_it):
                noise_found = beside_it
                as_believed = replace(as_stated, suite=noise_found.corrected(as_stated.suite))
                still = replace(still, suite=as_believed.suite)
                believed, naming, air, known = _search_beside(paths, library_, still, naming_records, air, say, pairs)
                near = next((f for f in naming.ranking if f.significant and f.flown), None)
        if near is not None and given.notes:  # tangents of a start are those of the model that it was fitted to
            say("fit where windows start beside what comes nearest")
            as_believed = begin_freely(as_believed, {**records, **held_out}, near.added_to(as_believed))
            believed, naming, air = search(as_believed, naming_records, air, say, known)
        if check and checked is None:
            checked = ahead.take("check", instruments)
    if naming.best is not None:
        say("look at what is left")
    naming, unexplained = judged(naming, believed, naming_records, list(held_out.values()), known)
    more = restricted(OTHER_SERVOS if further is None and effects is None else further or {}, (*by.paths, *paths))[1]
    naming, unexplained = named_in_path(
        naming, unexplained, first, believed, naming_records, list(held_out.values()), known, more, say
    )
    if naming.outcome == "unexplained" and first.terms:
        checked = checked or instruments()  # what instruments do is no force
        if not checked.news:
            naming = named_openly(naming, first, believed, naming_records, list(held_out.values()), say)
    naming = named_beside(naming, paths, as_believed, records, air)
    beside = None
    if controls:

        def again(flown: Sequence[FlightRecord], heard: AirFound) -> Naming:
            """Search a control flight as the measured ones were searched."""
            return search(as_believed, smoothed(as_believed, heard, flown), heard, lambda stage: None, known)[1]

        beside = fly_controls(as_believed, naming_records, air, naming, controls, again, say, control_file)
        naming = without_false_alarms(naming, beside)
    parameters = wrong_parameters(naming, believed, list(held_out.values()), naming_records, known)
    parameters = borne_out(parameters, paths, as_believed, records, air)
    if naming.best is not None:
        amended = naming.best.added_to(believed)
    else:
        amended = believed.with_nuisances(naming.nuisances) if parameters else believed
    say("weigh what came nearest")
    weighed = weigh(believed, naming_records, naming, known, noise if noise == "simulated" else "measured")
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
    uneven = left_by(amended, naming_records) if named else None
    return GapFinding(
        believed=believed,
        amended=amended,
        maps=maps,
        naming=naming,
        shrink=shrink,
        air=air,
        noise=noise_found,
        weighed=weighed,
        regions=regions,
        forces=forces,
        next_flight=next_flight,
        check=checked,
        parameters=parameters,
        errors=errors,
        left=uneven,
        rest=None if naming.best is None else unexplained,
        first=first,
        controls=beside,
        windows=(*given.notes, *others.notes),
        paths=(*by.paths, *paths),
        held_out=differences(believed, records, held_out),
        tally=_tally(
            [believed, amended] if amended is not believed else [believed], [*records.values(), *held_out.values()]
        ),
    )


def _search_beside(
    paths: Sequence[JudgedPath],
    known: Mapping[str, Effect],
    believed: Believed,
    records: Sequence[FlightRecord],
    air: AirFound,
    say: Callable[[str], None],
    pairs: bool,
) -> tuple[Believed, Naming, AirFound, Mapping[str, Effect]]:
    """Return what :func:`search` does among the effects that the paths leave open, and those effects.

    Those that a path shows come first; if they name nothing that the motion shows, too, all that is left open is
    searched.
    """
    shown, left_open = restricted(known, paths)
    if shown is not left_open:
        found = search(believed, records, air, say, shown, paths, pairs)
        best = found[1].best
        if best is not None and best.in_motion > CRITERIA.least:
            return (*found, left_open)
    return (*search(believed, records, air, say, left_open, paths, pairs), left_open)


def _smoothed(believed: Believed, air: AirFound, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    return dict(zip(records, smoothed(believed, air, list(records.values())), strict=True))


def _tally(models: Sequence[Believed], records: Sequence[FlightRecord]) -> Tally:
    """Count by what models are flown through records; flights that are kept are not flown again."""
    found = flights([model.wanted_to_read(record) for model in models for record in records])
    return Tally.of(x for x in found if isinstance(x, FlightRecord))


def search(
    believed: Believed,
    records: Sequence[FlightRecord],
    air: AirFound,
    say: Callable[[str], None],
    effects: Mapping[str, Effect] | None = None,
    paths: Sequence[JudgedPath] = (),
    pairs: bool = True,
) -> tuple[Believed, Naming, AirFound]:
    """Return the believed model in the air that was found, the naming, and the air.

    ``effects`` is the library, that of the suite if not given; ``paths`` are those that recorded surfaces tell of;
    ``pairs`` lets two effects at once be sought.

    A gap raises the rms of turbulence that is measured beside it, and it changes the flights that the turbulence works
    on. So the effect that comes nearest is taken out, and the rms is measured again. If the rms changes, or more than
    noise is left, the search is made once more, with the new rms and along the flights with the effect.

    The first rms may hold most of a gap, so that the true effect seems to explain little. If the search names an effect
    once the rms is measured beside the one that explained little, that is the answer.
    """
    if air.moves:
        say("measure the air")
    flown_in, air = in_measured_air(believed, records, air)
    naming = _named(flown_in, records, say, effects, paths, pairs)
    if naming.noise_left and not air.moves:
        return flown_in, naming, air
    say("listen to the air again")
    tuned = believed.with_nuisances(naming.nuisances)
    near = next((f for f in naming.ranking if f.significant and f.flown and f.gain > CRITERIA.weak), None)
    if air.moves and near is not None and near.share < CRITERIA.enough_alone:
        hidden = _hidden_by_air(believed, tuned, near.added_to(believed), records, air, say, effects, paths, pairs)
        if hidden is not None:
            return hidden
        near = None  # it explains too little to be what is missing: what it would take out may be turbulence
    beside = tuned if near is None else near.added_to(believed)
    gain = max((f.gain for f in naming.ranking), default=0.0)
    again = listen_again(tuned, beside, records, air, gain)
    same = again.moves == air.moves and abs(again.rms_m_s - air.rms_m_s) <= SAME_AIR * air.rms_m_s
    if same and (near is None or not air.moves or near.chi2 <= noise_limit(flown_in, naming.samples)):
        return flown_in, naming, air
    if near is None and again.moves:  # the coefficients were re-tuned in another air
        beside = _retuned(believed, in_air(believed, again, beside), records)
        again = measure(beside, records, again)
    flown_in = in_air(believed, again, beside)
    return flown_in, _named(flown_in, records, say, effects, paths, pairs), again


def _named(
    believed: Believed,
    records: Sequence[FlightRecord],
    say: Callable[[str], None],
    effects: Mapping[str, Effect] | None,
    paths: Sequence[JudgedPath],
    pairs: bool,
) -> Naming:
    """Return what is named by the motion and by what recorded surfaces tell of ``paths``."""
    return with_surfaces(name_effect(believed, records, say, effects, pairs), paths, believed, records)


def _hidden_by_air(
    believed: Believed,
    tuned: Believed,
    beside: Believed,
    records: Sequence[FlightRecord],
    air: AirFound,
    say: Callable[[str], None],
    effects: Mapping[str, Effect] | None,
    paths: Sequence[JudgedPath],
    pairs: bool,
) -> tuple[Believed, Naming, AirFound] | None:
    """Return what :func:`search` does if an effect is named once the air is measured beside another; else None.

    Args:
        believed: model.
        tuned: the same, re-tuned without an effect.
        beside: the same, with an effect that explains little.
        records: those that are named from.
        air: what was heard.
        say: called with a few words as each stage begins.
        effects: the library.
        paths: those that recorded surfaces tell of.
        pairs: seek two effects at once, too.
    """
    again = measure(beside, records, air)
    if misfit(tuned, records, measure(tuned, records, air)) - misfit(beside, records, again) <= CRITERIA.weak:
        return None
    flown_in = in_air(believed, again, beside)
    naming = _named(flown_in, records, say, effects, paths, pairs)
    return (flown_in, naming, again) if naming.names else None


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
