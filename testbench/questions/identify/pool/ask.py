"""Identify several logs, or every record of one description, and pool what they give."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.errors import EstimationError, RecordError, ScenarioError, located, nearest
from testbench.core.named import Named, obtain_all
from testbench.line import RECORDED, Keep, Report
from testbench.page.labels import file_stem, unique
from testbench.page.shown import Shown
from testbench.page.words import listed
from testbench.pooling.pool import Pooled, pool
from testbench.pooling.prior import Prior, prior_of_aircraft, prior_of_file
from testbench.questions.identify.ask import identify
from testbench.questions.identify.pool.logs import Contribution, contribution
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import Pooling, RecordDescription

PRIORS = ("aircraft", "handbook")
"""Words for priors; any other is a file."""


@dataclass(frozen=True, eq=False)
class PooledFlights(Shown, page="testbench.questions.identify.pool.page:pool_page"):
    """Several logs, identified each by itself and pooled.

    Attributes:
        pooled: the coefficients of all of them.
        found: what each log gave, in the order of ``pooled.logs``.
        contributions: the same as coefficients, with what was left out.
        notes: what was assumed, in sentences.
        doubts: what may make coefficients wrong, in sentences.
    """

    pooled: Pooled
    found: tuple[Identified, ...]
    contributions: tuple[Contribution, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the logs."""
        return tuple(c.coefficients.log for c in self.contributions)


@on_one_thread
def identify_and_pool(
    descriptions: Sequence[Named[RecordDescription]],
    data_folder: Path | None = None,
    *,
    settings: Pooling | None = None,
    keep: Callable[[str], Keep] | None = None,
    progress: Report | None = None,
    strict: bool = False,
) -> PooledFlights:
    """Identify every log by itself and return one set of coefficients with trend, agreement and prior.

    Args:
        descriptions: one per log; with ``each`` every record that identifies is a log.
        data_folder: where the files lie, instead of the folders that the descriptions name.
        settings: instead of the tables [pool] of the descriptions, which must agree.
        keep: called with the name of a log; returns what is called with its records.
        progress: called with a few words as each stage begins.
        strict: refuse records with implausible values.

    Raises:
        TestbenchError: with the file and key of the description that it comes from; logs of several aircraft; one
            record in two logs.

    Example:
        >>> import testbench as tb
        >>> days = [tb.load_description(f"day{i}.toml") for i in (1, 2, 3)]  # doctest: +SKIP
        >>> tb.identify_and_pool(days).pooled.coefficient("Cm_alpha").value  # doctest: +SKIP
    """
    say = progress or (lambda text: None)
    described = obtain_all(RecordDescription, descriptions)
    asked = settings if settings is not None else agreed(described)
    _one_aircraft(described)
    _known_method(asked.method, described)
    given = _given_prior(asked.prior, described)
    logs = list(parts_of(described, asked.each))
    found, gave, nothing = [], [], []
    for name, description in logs:
        say(f"log {name}")
        result = identify(description, data_folder, None if keep is None else keep(name), say, strict)
        with located(description.file, f"log {name}"):
            part = contribution(result, name, asked.method)
        if part.coefficients.names:
            gave.append(part)
            found.append(result)
        else:
            nothing.append(f"{name} is left out, since it gives no coefficient ({part.why_nothing})")
    if not gave:
        raise EstimationError(f"no log gives a coefficient: {'; '.join(nothing)}")
    _one_geometry(found, gave)
    _no_record_twice(found, gave)
    say("pool the logs")
    prior: Prior | None = None
    if asked.prior in PRIORS:
        prior = _prior_of_model(asked.prior, found, gave)
    elif given is not None:
        prior = prior_of_file(given, _mean_condition(gave))
    stated = next((f.before.aircraft.scale_uncertainty for f in found if f.before is not None), {})
    pooled = pool([c.coefficients for c in gave], prior, asked.trend, stated)
    notes = [
        f"{c.coefficients.log}: {text}"
        for c, r in zip(gave, found, strict=True)
        for text in (r.flown.notes if r.flown is not None else ())
    ]
    if prior is not None:
        unused = [name for name in prior.names if name not in {c.name for c in pooled.coefficients}]
        notes += prior.notes
        if unused:
            notes.append(f"the prior of {', '.join(unused)} is not used: no log holds it")
    doubts = (*nothing, *_doubts(found, gave))
    return PooledFlights(pooled, tuple(found), tuple(gave), tuple(dict.fromkeys(notes)), doubts)


def _doubts(found: Sequence[Identified], gave: Sequence[Contribution]) -> Iterator[str]:
    """Yield what may make coefficients wrong: doubts of one cause together, with the names of their logs."""
    by_cause: dict[str, list[tuple[str, str]]] = {}
    for part, result in zip(gave, found, strict=True):
        for advice in (*part.doubts, *result.doubts):
            by_cause.setdefault(advice.code, []).append((part.coefficients.log, advice))
    for said in by_cause.values():
        logs = list(dict.fromkeys(log for log, _ in said))
        others = f" (the same of {listed(logs[1:])})" if len(logs) > 1 else ""
        yield f"{logs[0]}: {said[0][1]}{others}"


def parts_of(descriptions: Sequence[RecordDescription], each: bool) -> Iterator[tuple[str, RecordDescription]]:
    """Yield (name, description) of every log; with ``each`` one for every record or segment that identifies."""
    parts: list[tuple[str, RecordDescription]] = []
    for d in descriptions:
        if not each:
            parts.append((d.name, d))
            continue
        judging = tuple(r for r in d.record if r.use == "validation")
        for r in (r for r in d.record if r.use != "validation"):
            pieces: tuple[tuple[tuple[float, float], ...], ...] = tuple((s,) for s in r.segments) or ((),)
            for name, piece in zip(r.parts, pieces, strict=True):
                one = r.model_copy(update={"name": name, "segments": piece})
                parts.append((f"{d.name}_{name}", d.changed(record=(one, *judging))))
    names = unique([file_stem(name) for name, _ in parts])
    for name, (_, description) in zip(names, parts, strict=True):
        yield file_stem(name), description


def agreed(descriptions: Sequence[RecordDescription]) -> Pooling:
    """Return how descriptions are to be pooled, as their tables [pool] say, the default if none says anything.

    Raises:
        ScenarioError: the tables do not agree.
    """
    given = {d.pool for d in descriptions if d.pool != Pooling()}
    if len(given) > 1:
        raise ScenarioError(
            [f"{d.file}, pool: descriptions that are pooled must agree in this table" for d in descriptions]
        )
    return next(iter(given), Pooling())


def _one_aircraft(descriptions: Sequence[RecordDescription]) -> None:
    named = {d.name: d.aircraft for d in descriptions if d.aircraft is not None}
    if len(set(named.values())) > 1:
        said = ", ".join(f"{aircraft} in {name}" for name, aircraft in named.items())
        raise RecordError(
            f"logs that are pooled must be of one aircraft, got {said}; pool those of each aircraft separately, or "
            "give --aircraft if it is one"
        )


def _one_geometry(found: Sequence[Identified], gave: Sequence[Contribution]) -> None:
    sizes = [f.flown.geometry for f in found if f.flown is not None]
    names = [part.coefficients.log for part in gave]
    for name, result, size in zip(names, found, sizes, strict=True):
        first = sizes[0]
        assert size is not None
        assert first is not None
        pairs = zip((size.S_m2, size.b_m, size.cbar_m), (first.S_m2, first.b_m, first.cbar_m), strict=True)
        if any(not np.isclose(a, b, rtol=1e-6) for a, b in pairs):
            raise RecordError(
                f"coefficients of all logs must refer to one geometry, but '{name}' ({result.source.file}) has S = "
                f"{size.S_m2:g} m2, b = {size.b_m:g} m, cbar = {size.cbar_m:g} m and '{names[0]}' {first.S_m2:g} m2, "
                f"{first.b_m:g} m, {first.cbar_m:g} m"
            )


def _no_record_twice(found: Sequence[Identified], gave: Sequence[Contribution]) -> None:
    """Refuse samples that would be counted twice for one coefficient."""
    seen: list[tuple[str, str, tuple[float, float], set[str]]] = []
    for result, part in zip(found, gave, strict=True):
        log, names = part.coefficients.log, set(part.coefficients.names)
        for flight in result.flights:
            if flight.use == "validation":
                continue
            provenance = flight.measured[RECORDED].provenance
            digest, (start, end) = str(provenance["sha256"]), provenance["segment_s"]
            for other, same, (begin, stop), held in seen:
                both = names & held
                if other != log and same == digest and both and max(start, begin) < min(end, stop):
                    raise RecordError(
                        f"no sample may be pooled twice, but '{log}' and '{other}' hold the same part of one file "
                        f"({provenance['file']}, {max(start, begin):g} to {min(end, stop):g} s); leave one out"
                    )
            seen.append((log, digest, (start, end), names))


def _known_method(method: str | None, descriptions: Sequence[RecordDescription]) -> None:
    """Refuse a method that no description has, before anything is identified."""
    known = {e.method for d in descriptions for e in d.identification.estimators}
    if method is not None and method not in known:
        raise RecordError(
            f"the method that is pooled must be one of the descriptions', got '{method}'{nearest(method, known)}"
        )


def _mean_condition(gave: Sequence[Contribution]) -> dict[str, float]:
    """Return variable -> mean over the logs, of those that all logs know."""
    every = [part.coefficients.at for part in gave]
    return {name: float(np.mean([at[name] for at in every])) for name in every[0] if all(name in at for at in every)}


def _given_prior(asked: str | None, descriptions: Sequence[RecordDescription]) -> Path | None:
    """Return the file of a prior, which is right; None if there is none, or if it is to be taken from an aircraft.

    Raises:
        RecordError: there is no such file, or no aircraft that a prior could be taken from.
    """
    if asked is None:
        return None
    if asked in PRIORS:
        if all(d.aircraft is None for d in descriptions):
            raise RecordError(
                f"the prior '{asked}' is taken from the model of an aircraft, but no description names one; give "
                "aircraft = '...' or --aircraft, or the prior as a file"
            )
        return None
    places = [Path(asked), *(d.file.parent / asked for d in descriptions if d.file is not None)]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise RecordError(f"a prior must be {', '.join(PRIORS)} or a file, got '{asked}', which is none of them")
    prior_of_file(path)
    return path


def _prior_of_model(asked: str | None, found: Sequence[Identified], gave: Sequence[Contribution]) -> Prior:
    """Return the prior of the aircraft: its coefficients, the mean over the conditions of the logs.

    Raises:
        EstimationError: the aircraft trims at the condition of no log.
    """
    aircraft = next(f.before.aircraft for f in found if f.before is not None)
    told: dict[str, list[float]] = {}
    for part in gave:
        for name, value in part.believed.items():
            told.setdefault(name, []).append(value)
    if not told:
        raise EstimationError(
            f"the prior '{asked}' needs {aircraft.name} trimmed at the condition of a log, but it trims at none of "
            "them; give the prior as a file"
        )
    return prior_of_aircraft(aircraft, {n: float(np.mean(v)) for n, v in told.items()}, asked == "handbook")
