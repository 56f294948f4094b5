"""The gap workflow: locate, name, amend, and judge on manoeuvres that were used for neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.errors import RecordError, located
from testbench.core.processes import Ahead
from testbench.core.record import FlightRecord
from testbench.effects import OTHER_SERVOS, Effect, library
from testbench.flight.batch.jobs import Tally
from testbench.inference.evidence import Comparison
from testbench.inference.parameters import Source
from testbench.questions.gap import onset
from testbench.questions.gap.again import KeptFits, Reflown, search_key
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.drive import SurfacePath, driven, paths_seen
from testbench.questions.gap.evidence.air import AirFound, in_air, listen, listen_again, listen_in_flight, smoothed
from testbench.questions.gap.evidence.check import check_instruments, check_signs, differences
from testbench.questions.gap.evidence.commanded import starts_freely
from testbench.questions.gap.evidence.locate import lacking, largest_errors, left_by, locate, locate_regions
from testbench.questions.gap.evidence.noise_found import NoiseFound, find_noise
from testbench.questions.gap.explain import Explanation, Naming
from testbench.questions.gap.flights import flights
from testbench.questions.gap.name import ELSEWHERE, Sought, name_effect, nearest, unknown_motion
from testbench.questions.gap.plan import separate
from testbench.questions.gap.result import GapFinding, Shrink
from testbench.questions.gap.scenario import Drive, Windows
from testbench.questions.gap.search.point import NOT_FLOWN, Point, retune
from testbench.questions.gap.starts import called
from testbench.questions.gap.windows import as_they_start, begin_freely, in_windows, nearly_trimmed

SHOWN = 3  # records of which it is shown over time what the model lacks: those with the largest residuals
PLACES, NEAR = 3, 20  # where effects come nearest if they begin there, and effects that are sought to: by first order
SAME_AIR = 0.15  # share by which the rms of turbulence may change before the search is made again


@dataclass(frozen=True)
class GapSearch:
    """How it is sought what a model lacks.

    Attributes:
        effects: the library, by name; that of the suite if not given.
        further: effects that are sought only in a place where one of the library comes near, by name; if not given,
            those servo effects that the library lacks, and none if ``effects`` are given.
        noise: where the noise of the believed sensors comes from. Unless it was simulated here, how large it is in
            these records is found first, and they are judged by that.
        drive: "both" compares surfaces that are recorded beside their commands, and lets surfaces drive where no
            command is recorded; "surface" lets them drive wherever they are recorded; "command" does not look at them.
        windows: "auto" cuts records that do not begin with quiet trim flight into windows that start freely, a number
            all of them, into windows of so many seconds; "off" refuses them; None is what a scenario says, else "auto".
        check: check the instruments against each other first.
        again: number of the user's own flights that are flown again with truths drawn from the priors, each of which is
            asked about as the measured ones were: what are stated probabilities worth here?
        again_file: keeps each of them, so that none is flown twice.
        search_file: keeps fits that are at rest: a search that is interrupted goes on from them, with the same answer.

    Example:
        >>> import testbench as tb
        >>> how = tb.GapSearch(noise="stated", check=True)
        >>> finding = tb.find_gap(believed, records, held_out, how)  # doctest: +SKIP
    """

    effects: Mapping[str, Effect] | None = None
    further: Mapping[str, Effect] | None = None
    noise: Source = "simulated"
    drive: Drive = "both"
    windows: Windows | None = None
    check: bool = False
    again: int = 0
    again_file: Path | None = None
    search_file: Path | None = None


@on_one_thread
def find_gap(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    how: GapSearch | None = None,
    progress: Callable[[str], None] | None = None,
) -> GapFinding:
    """Find what the believed model lacks.

    The instruments are checked against each other, the turbulence is measured, and all explanations that these leave
    open are weighed against each other.
    The turbulence is measured again beside what was named; if it differs, they are weighed again in the new air.

    Args:
        believed: aircraft, sensors and condition as believed.
        records: name -> measured record, used to locate and to name.
        held_out: name -> measured record, used only to judge.
        how: it is sought.
        progress: called with a few words as each stage begins.

    Raises:
        RecordError: a record is not measured, or lacks a channel of the believed suite; or ``again_file`` or
            ``search_file`` cannot be used.
        FlightAborted, LimitError, TrimError: the believed aircraft cannot fly these commands.

    Example:
        >>> import testbench as tb
        >>> finding = tb.find_gap(believed, {"doublet": record}, {"sweep": held_out})  # doctest: +SKIP
        >>> finding.sentences  # doctest: +SKIP
    """
    say, how = progress or (lambda text: None), how or GapSearch()
    given = _Given.of(believed, records, held_out, how, say)
    instruments = partial(check_instruments, given.believed.suite, list(given.whole.values()))
    with Ahead() as ahead:
        if how.check:
            say("check the instruments against each other")
            ahead.begin("check", instruments)  # the search needs nothing of it
        checked = ahead.take("check", instruments) if how.check and ahead.most == 1 else None
        say("estimate the turbulence")
        air = listen(given.believed, list(given.records.values()))
        given = replace(
            given,
            records=_smoothed(given.believed, air, given.records),
            held_out=_smoothed(given.believed, air, given.held_out),
        )
        given = given.nearly_trimmed()
        sought = given.sought(how)
        if how.search_file is not None:
            all_flown = [*given.records.values(), *given.held_out.values()]
            depends_on = Reflown(given.believed, all_flown, air, {**(sought.effects or {}), **sought.further})
            more = sought.source, given.believed.simulator, sorted(given.believed.surface_noise.items())
            key = search_key(depends_on, more)
            sought = replace(sought, keeper=KeptFits(how.search_file, key, say))
        found = _Asked(given, air, sought, how.noise, say).answer()
        if how.check and checked is None:
            checked = ahead.take("check", instruments)
    flights_again = None
    if how.again:

        def ask(measured: Sequence[FlightRecord], heard: AirFound) -> Naming:
            """Ask about a flight as the measured ones were asked about."""
            heard_in = smoothed(found.all_in, heard, measured)
            return search(
                found.all_in, heard_in, heard, lambda stage: None, replace(sought, open_terms=False, keeper=None)
            )[1]

        flown = Reflown(found.all_in, list(given.records.values()), found.air, sought.effects or {})
        flights_again = flown.times(how.again, ask, say, how.again_file)
    return replace(_judged(given, found, say), check=checked, again=flights_again)


@dataclass(frozen=True, eq=False)
class _Given:
    """Records and the belief in them, as they can be compared."""

    stated: Believed  # what is believed, with the noise that is stated
    believed: Believed  # the same with the noise that was found
    # records, held_out: by name, cut into windows where they do not begin in quiet flight
    records: Mapping[str, FlightRecord]
    held_out: Mapping[str, FlightRecord]
    whole: Mapping[str, FlightRecord]  # the measured records as they were before
    noise: NoiseFound | None  # found, None where it was simulated here
    paths: tuple[SurfacePath, ...]  # of the controls
    notes: tuple[str, ...]  # how records, and those held out, were cut

    @classmethod
    def of(
        cls,
        believed: Believed,
        records: Mapping[str, FlightRecord],
        held_out: Mapping[str, FlightRecord],
        how: GapSearch,
        say: Callable[[str], None],
    ) -> _Given:
        """Return them; what cannot be compared or flown, of those held out too, is known before anything is sought."""
        for name, record in {**records, **held_out}.items():
            if record.kind != "measured":
                raise RecordError(f"the gap workflow takes measured records only, got '{name}' of kind '{record.kind}'")
        driving, both, paths = driven(believed, {**records, **held_out}, how.drive)
        records, held_out = ({n: both[n] for n in part} for part in (records, held_out))
        check_signs(driving, as_they_start(records))
        stated, cut, others = in_windows(driving, records, held_out, how.windows or "auto", say)
        records, held_out = called(cut.records), others.records
        for name, record in {**records, **held_out}.items():
            with located(None, f"record '{name}'"):
                stated.check_commands(record)
                stated.predict(record)
        believed, noise = stated, None
        if how.noise != "simulated":
            say("estimate the noise")
            noise = find_noise(stated, list(records.values()), how.noise)
            believed = noise.corrects(stated)
        return cls(stated, believed, records, held_out, cut.whole, noise, paths, cut.notes)

    def nearly_trimmed(self) -> _Given:
        """Return them with what is not known of those that begin at trim; noise is found without."""
        return replace(self, believed=nearly_trimmed(self.believed, [*self.records.values(), *self.held_out.values()]))

    def sought(self, how: GapSearch) -> Sought:
        """Return what is weighed as an explanation."""
        b, unseen = self.believed, {n for path in self.paths for n in path.effects}
        known = library(b.suite, b.aircraft) if how.effects is None else how.effects
        servos = OTHER_SERVOS if how.further is None and how.effects is None else how.further or {}
        return Sought(
            {n: e for n, e in known.items() if n not in unseen},
            {n: e for n, e in servos.items() if n not in unseen},
            open_terms=True,
            source="simulated" if self.noise is None else "measured",
            held_out=list(self.held_out.values()),
        )


@dataclass(frozen=True, eq=False)
class _Found:
    """What was found of records."""

    believed: Believed  # in the air that was found
    naming: Naming  # what is lacking, by its probability
    air: AirFound  # found beside it
    records: Mapping[str, FlightRecord]  # that it was found in
    all_in: Believed  # what is believed, before the air
    before: Believed  # the same, with starts of windows before these were found beside what comes nearest
    noise: NoiseFound | None  # found beside it
    # what is lacking begins or ends there in flight, None if it acts in all of the records
    begun: onset.Begun | None = None

    @property
    def amended(self) -> Believed:
        """The believed model with what was named, or with the coefficients re-tuned if these are off."""
        if self.naming.best is not None:
            return self.naming.best.added_to(self.believed)
        return self.believed.with_nuisances(self.naming.nuisances) if self.naming.off else self.believed


@dataclass(eq=False)
class _Asked:
    """A question about records: asked once more where noise, starts or the time of onset depend on what was found."""

    given: _Given
    air: AirFound
    sought: Sought
    source: Source
    say: Callable[[str], None]
    places: list[onset.Begun] | None = None

    def answer(self) -> _Found:
        """Return what is lacking."""
        given = self.given
        believed, noise = given.believed, given.noise
        alone = replace(self.sought, elsewhere=self._elsewhere)
        found = self._found(believed, noise, alone)
        near = _nearest(found.naming)
        if noise is not None and near is not None:  # what was missing may have been taken for noise
            beside_it = find_noise(given.stated, list(given.records.values()), self.source, near.added_to(given.stated))
            if noise.differs(beside_it):
                noise, believed = beside_it, replace(beside_it.corrects(given.stated), off_trim=believed.off_trim)
                found = self._found(believed, noise, alone, found)
        weighed = found.naming.weighed
        if weighed.open:  # one of hundreds of terms may do what an effect does in a part of the flights
            begun = self._begun(found)
            return begun if begun is not None and begun.naming.names and not begun.naming.weighed.open else found
        if weighed.needed <= ELSEWHERE or not self._elsewhere(found.believed, weighed.table):
            return found  # what acts in all records explains them
        begun = self._begun(found)
        if begun is not None and begun.naming.weighed.needed < ELSEWHERE:
            return begun
        return self._found(believed, noise, self.sought, found)

    def _found(
        self, believed: Believed, noise: NoiseFound | None, sought: Sought, after: _Found | None = None
    ) -> _Found:
        """Return what is lacking; an earlier search tells the air, and where fits came to rest, which begin there."""
        air = self.air if after is None else after.air
        sought = sought if after is None else replace(sought, rested=after.naming.rested)
        return self._searched(believed, noise, self.given.records, air, sought)

    def _searched(
        self,
        believed: Believed,
        noise: NoiseFound | None,
        records: Mapping[str, FlightRecord],
        air: AirFound,
        sought: Sought,
        begun: onset.Begun | None = None,
    ) -> _Found:
        """Return what is lacking; what was flown is flown again from starts found beside what comes nearest.

        Tangents of a start are those of the model that it was fitted to.
        """
        free, flown = any(map(starts_freely, records.values())), list(records.values())
        one = replace(sought, pairs=sought.pairs and not free)
        found = _Found(*search(believed, flown, air, self.say, one), records, believed, believed, noise, begun)
        near, first = _nearest(found.naming), found.naming
        if not free or near is None or first.weighed.nothing > 0.5:
            return found
        self.say("fit initial states of windows with the nearest explanation")
        begins = begin_freely(believed, {**records, **self.given.held_out}, near.added_to(believed))
        effects = [e.name for e in first.weighed.effects.values() if e.parameters and e.name not in first.weighed.terms]
        again = replace(sought, rested=first.rested, near=effects, terms=first.flown_terms, open_terms=False)
        flown_in, naming, air = search(begins, flown, found.air, self.say, again)
        rejected = {n: why for n, why in first.rejected.items() if naming.weighed[n] == 0.0}
        rejected = {**rejected, **naming.rejected}
        naming = replace(naming, rejected=rejected, terms=first.terms, acting=first.acting)
        return _Found(flown_in, naming, air, records, begins, believed, noise, begun)

    def _places(self, believed: Believed, table: Comparison) -> list[onset.Begun]:
        """Return where what is lacking may begin or end in flight, by an unknown motion alone, the most probable first.

        Sought once, where it is asked for: most flights are explained without it.
        """
        if self.places is None:
            self.say("seek effects that begin in flight")
            self.places = onset.seek(believed, self.given.records, table)
        return self.places

    def _elsewhere(self, believed: Believed, table: Comparison) -> bool:
        """Return whether what is lacking does not act in all records, more probably than not."""
        return any(place.probability > 0.5 for place in self._places(believed, table))

    def _begun(self, found: _Found) -> _Found | None:
        """Return what is found in records that are cut where effects come nearest, if any can be flown there."""
        records, believed, of = self.given.records, found.before, self.sought.effects or {}
        places = self._places(found.believed, found.naming.weighed.table)
        assert found.naming.acting is not None
        if not places:
            return None
        acting = found.naming.acting([onset.samples(records, place) for place in places])
        logs = [max(near.values(), default=-np.inf) for near in acting]
        of_all = zip(places, acting, logs, strict=True)  # of those that differ by nothing, first what needs no cut
        there = sorted(of_all, key=lambda one: (-round(one[2], 1), bool(one[0].record)))
        naming = found.naming
        alone = replace(self.sought, further={}, open_terms=False, pairs=False)
        alone = replace(alone, terms=naming.flown_terms, rested=naming.rested)
        best = -np.inf
        for place, near, _ in there[:PLACES]:
            cut, begins = onset.divided(believed, records, place), believed
            if place.record:
                flown_in, beside = found.believed, found.naming.beside_unknown
                along = Point.towards_unknown(flown_in, tuple(records.values()), beside)
                tuned = flown_in.with_nuisances(along.by_name)
                begins = onset.begin_there(believed, cut, place, records[place.record], tuned)
            effects = onset.later({n: of[n] for n in list(near)[:NEAR] if n in of}, place)
            flown = list(cut.values())
            try:
                gain = nearest(in_air(begins, found.air), flown, [e for e in effects.values() if e.later])
            except NOT_FLOWN:  # the a-priori model leaves its limits from where the cut begins
                continue
            if gain > best:
                best, at = gain, (begins, replace(alone, effects=effects), cut, place)
        if not np.isfinite(best):
            return None
        begins, sought, cut, place = at
        return self._searched(begins, found.noise, cut, found.air, sought, place)


def _judged(given: _Given, found: _Found, say: Callable[[str], None]) -> GapFinding:
    """Locate what the believed model leaves, and judge what was found on the records held out."""
    believed, amended, naming, records = found.believed, found.amended, found.naming, found.records
    held_out, flown = given.held_out, list(records.values())
    if found.begun is not None and amended.later:
        held_out = onset.lasting(believed, amended, held_out)
    say("locate the residual")
    left, taken = zip(*((believed.residuals(r), believed.taken(r)) for r in flown), strict=True)
    each = zip(records.items(), left, taken, strict=True)
    maps = tuple(locate(name, x, believed.outputs, r.dt_s, valid) for (name, r), x, valid in each)
    of = sorted(zip(records.items(), left, strict=True), key=lambda one: -float(np.mean(one[1] ** 2)))[:SHOWN]
    lacks = [lacking(believed, n, r, unknown_motion(believed, r, deflections=False), x) for (n, r), x in of]
    next_flight = ""
    alike = [f for f in naming.ranking if f.effect.name in naming.names and not f.coefficients]
    if naming.outcome == "set" and len(alike) > 1:
        say("seek the manoeuvre that would separate the rest")
        next_flight = separate(believed, flown, alike)
    say("validate on held-out manoeuvres")
    models, every = dict.fromkeys((believed, amended)), [*flown, *held_out.values()]
    again = flights([model.wanted_to_read(r) for model in models for r in every])  # those that are kept are not flown
    return GapFinding(
        believed=believed,
        amended=amended,
        maps=maps,
        naming=replace(naming, acting=None),
        shrink=tuple(_shrink(believed, amended, name, record) for name, record in held_out.items()),
        air=found.air,
        noise=found.noise,
        regions=locate_regions(flown, left, believed.outputs, taken),
        lacks=tuple(lacks),
        next_flight=next_flight,
        errors=largest_errors(believed, every),
        left=None if naming.best is None else left_by(amended, flown),
        windows=given.notes,
        begun=found.begun,
        paths=(*given.paths, *paths_seen(believed, amended, naming, flown)),
        held_out=differences(believed, records, held_out),
        tally=Tally.of(x for x in again if isinstance(x, FlightRecord)),
    )


def _nearest(naming: Naming) -> Explanation | None:
    """Return the most probable effect, if there is any that explains something."""
    return next((f for f in naming.ranking if f.gain > 0.0 and not f.coefficients), None)


def _smoothed(believed: Believed, air: AirFound, records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    return dict(zip(records, smoothed(believed, air, list(records.values())), strict=True))


def search(
    believed: Believed, records: Sequence[FlightRecord], air: AirFound, say: Callable[[str], None], sought: Sought
) -> tuple[Believed, Naming, AirFound]:
    """Return the believed model in the air that was found, the naming, and the air.

    A gap raises the rms of turbulence that is measured beside it, and it changes the flights that the turbulence works
    on. So the effect that comes nearest is taken out, and the rms is measured again; where it changes, all is weighed
    once more.
    """
    if air.moves:
        say("estimate the air")
    flown_in, air = in_measured_air(believed, records, air)
    naming = name_effect(flown_in, records, sought, say)
    if not air.moves and naming.outcome in ("no gap", "named", "set"):
        return flown_in, naming, air
    say("estimate the turbulence again")
    near = _nearest(naming)
    beside = believed.with_nuisances(naming.nuisances) if near is None else near.added_to(believed)
    left = naming.weighed.table["nothing" if near is None else near.effect.name].posterior
    again = listen_again(beside, records, air, 2.0 * (left.log_part - left.log_whole))
    if again.moves == air.moves and abs(again.rms_m_s - air.rms_m_s) <= SAME_AIR * air.rms_m_s:
        return flown_in, naming, air
    flown_in = in_air(believed, again, beside)
    return flown_in, name_effect(flown_in, records, replace(sought, rested=naming.rested), say), again


def in_measured_air(believed: Believed, records: Sequence[FlightRecord], air: AirFound) -> tuple[Believed, AirFound]:
    """Return the believed model in the air that was heard, measured over all records, and that air.

    Turbulence works on the flights of the real aircraft, so coefficients are re-tuned first.
    """
    if not air.moves:
        return in_air(believed, air), air
    flown_in = in_air(believed, air)
    tuned = believed.with_nuisances(retune(Point.at(flown_in, flown_in, tuple(records))).by_name)
    air = listen_in_flight(tuned, records, air)
    return in_air(believed, air, tuned), air


def _shrink(believed: Believed, amended: Believed, name: str, record: FlightRecord) -> Shrink:
    measured, taken = record.columns(believed.outputs), believed.taken(record)
    count = taken.sum(axis=0).astype(float)
    predictions, energy = [], []
    for model in (believed, amended):
        y = model.predict(record)
        residuals = model.residuals(record)
        predictions.append(y + ((measured - y) * taken).sum(axis=0) / np.maximum(count, 1.0))
        energy.append((residuals**2).sum(axis=0) / np.maximum(count, 1.0))
    return Shrink(name, record, predictions[0], predictions[1], energy[0], energy[1], count)
