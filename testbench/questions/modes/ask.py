"""Operational modal analysis as one question: fly a scenario in turbulence, or take records, and find their modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.advice import doubt
from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.door import read_text
from testbench.core.errors import ChannelError, EstimationError, RecordError, ScenarioError, located
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, load_record
from testbench.core.schema import parse
from testbench.estimators.operational import Criteria, Onset, OperationalModes, estimate, onset
from testbench.estimators.operational.onset import CRITERIA, ORDER, RISK
from testbench.estimators.prepare import prepared
from testbench.evaluation.operational import TrueMode, match_modes, true_modes
from testbench.flight import TrimmedFlight, linearise, load_aircraft
from testbench.flight.air import air_of, scale_lengths
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.inputs import InputSignal, build
from testbench.line import fly_and_measure, log_rate, trim_for
from testbench.questions.modes.result import ModesResult
from testbench.questions.modes.scenario import ModeSearch, ModesScenario, TurbulentFlight
from testbench.sensors import load_suite

if TYPE_CHECKING:
    from testbench.line import Keep, Report

WING = ("az_wing_", "strain_wing_")
"""Beginnings of the names of channels in which modes are sought if none are named."""
_ONE_SPEED = 0.04  # mean airspeeds within this part of the slowest of them are one speed of a build-up


def search_for(given: Mapping[str, Any], otherwise: ModeSearch | None = None) -> ModeSearch:
    """Return the search of a scenario with the keys of ModeSearch in ``given`` replaced.

    Raises:
        ScenarioError: a value breaks a law.
    """
    held = otherwise.model_dump() if otherwise else {}
    search, faults = parse(ModeSearch, {**held, **given}, None)
    if search is None or faults:
        raise ScenarioError(faults)
    return search


def find_modes(
    records: Mapping[str, FlightRecord],
    search: ModeSearch,
    name: str = "modes",
    title: str = "",
    source: str = "",
    risk: float = RISK,
) -> ModesResult:
    """Return the modes of recorded flights; of several speeds, the onset of flutter and the speed that is cleared.

    Args:
        records: name -> measured record. Those whose mean airspeeds differ by less than 4 % are of one speed.
        search: channels, band and order.
        name: of the results folder.
        title: of the report; the names of the records if not given.
        source: text that says where the records come from.
        risk: probability of an onset at or below the speed that is cleared.

    Raises:
        ChannelError: no channel is named and the records hold none of the wing, or a record lacks one.
        EstimationError: see :func:`testbench.estimators.operational.estimate`.
    """
    found, at, margin = _sought(list(records.values()), search)
    title = title or f"Modes of {', '.join(records)}"
    return ModesResult(name, title, "", found, records, source, at=at, onset=margin, risk=risk)


def _sought(
    records: Sequence[FlightRecord], search: ModeSearch
) -> tuple[OperationalModes, dict[float, OperationalModes | None], Onset | None]:
    """Return the modes at the fastest speed that shows any; if there are several speeds, those at each, and the onset.

    What stands in the way of an onset is a doubt about the modes.
    """
    speeds = by_speed(records)
    if len(speeds) < 2:
        return _estimate(records, search), {}, None
    at: dict[float, OperationalModes | None] = {}
    given = search.model_fields_set
    criteria = replace(CRITERIA, least_orders=search.least_orders) if "least_orders" in given else CRITERIA
    search = search.model_copy(update={"order": search.order or ORDER})
    for V, own in speeds.items():
        try:
            at[V] = _estimate(own, search, criteria)
        except EstimationError as refusal:
            at[V], why = None, refusal
    found = next((m for m in reversed(at.values()) if m is not None), None)
    if found is None:
        raise why
    try:
        return found, at, onset(list(at), list(at.values()))
    except EstimationError as refusal:
        return replace(found, advice=(*found.advice, doubt("no_onset", f"nothing is cleared: {refusal}"))), at, None


def by_speed(records: Sequence[FlightRecord]) -> dict[float, list[FlightRecord]]:
    """Return mean airspeed -> the records flown at it, rising; one speed where a record has no airspeed."""
    if any("V" not in r for r in records):
        return {0.0: list(records)}
    groups: list[list[tuple[float, FlightRecord]]] = []
    for V, record in sorted(((_mean_speed(r), r) for r in records), key=lambda x: x[0]):
        if groups and (1.0 + _ONE_SPEED) * groups[-1][0][0] > V:
            groups[-1].append((V, record))
        else:
            groups.append([(V, record)])
    return {float(np.mean([V for V, _ in g])): [r for _, r in g] for g in groups}


def _mean_speed(record: FlightRecord) -> float:
    return float(record["V"][record.select(["V"]).valid[:, 0]].mean())


def read_modes(
    files: Sequence[Path],
    search: ModeSearch,
    data_folder: Path | None = None,
    progress: Report | None = None,
    risk: float = RISK,
) -> ModesResult:
    """Return the modes of record files (.nc), or of those that one description of recorded flights names.

    A description's records are prepared as it says; where no channels are named they are its outputs.

    Raises:
        RecordError: a file cannot be read, or a description comes with other files.
        TestbenchError: as :func:`find_modes`.
    """
    say = progress or (lambda text: None)
    if all(file.suffix.lower() == ".nc" for file in files):
        held = [load_record(file) for file in files]
        say("find modes")
        named = dict(zip(_names([f.stem for f in files]), held, strict=True))
        return find_modes(named, search, files[0].stem, risk=risk)
    if len(files) > 1:
        raise RecordError(f"either records (.nc) or one description must be given, got {', '.join(map(str, files))}")
    from testbench.logs.read import read_records
    from testbench.questions.identify.scenario import RecordDescription

    described = RecordDescription.load(files[0])
    records = {
        name: prepared(record, described.trim_s, described.preparation)
        for name, _, record in read_records(described, data_folder)
    }
    say("find modes")
    with located(described.file, "identification.outputs"):
        search = search if search.channels else search.model_copy(update={"channels": described.outputs})
        text = read_text(described.file, "scenario") if described.file else ""
        return find_modes(records, search, described.name, described.title, text, risk)


def _names(stems: Sequence[str]) -> list[str]:
    return [f"{s} ({i})" if stems.count(s) > 1 else s for i, s in enumerate(stems, 1)]


def _estimate(
    records: Sequence[FlightRecord], search: ModeSearch, criteria: Criteria | None = None
) -> OperationalModes:
    return estimate(
        records,
        search.channels or _of_the_wing(records),
        references=search.references,
        band_hz=search.band_hz,
        order=search.order,
        criteria=criteria or Criteria(least_orders=search.least_orders),
    )


def _of_the_wing(records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Return the channels of the wing that the first record holds; if there are none, ask for channels."""
    have = records[0].channels if records else ()
    wing = tuple(name for name in have if name.startswith(WING))
    if records and not wing:
        raise ChannelError(
            f"records without wing accelerometers or strain gauges need channels to be named, got {', '.join(have)}"
        )
    return wing


# --- scenarios --------------------------------------------------------------------------------------------------------


@on_one_thread
def fly_modes(
    scenario: Named[ModesScenario],
    search: ModeSearch | None = None,
    seed: int | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
    risk: float = RISK,
) -> ModesResult:
    """Fly a scenario, measure, find modes from the outputs alone, and set them beside those of the linear model.

    Args:
        scenario: of :meth:`ModesScenario.load`.
        search: replaces the scenario's own.
        seed: replaces the scenario's own; flight i has the turbulence and noise of seed + i.
        keep: called with a name and each record as soon as it exists.
        progress: called with a few words as each stage begins.
        risk: as of :func:`find_modes`.

    Raises:
        TestbenchError: with the file and key of the scenario that it comes from.

    Example:
        >>> import testbench as tb
        >>> result = tb.fly_modes(tb.load("modes/eolo_turbulence"))  # doctest: +SKIP
        >>> result.found  # doctest: +SKIP
    """
    scenario = obtain(ModesScenario, scenario)
    say = progress or (lambda text: None)
    seed, where = scenario.seed if seed is None else seed, scenario.file
    aircraft, suite = load_aircraft(scenario.aircraft, scenario.wings), load_suite(scenario.suite)
    say(f"trim {aircraft.name}")
    trims = {V: trim_for(scenario.flown_at(V), aircraft, seed) for V in scenario.speeds_m_s}
    records = {}
    for i, spec in enumerate(scenario.flight):
        trimmed = trims[spec.V_m_s or scenario.condition.V_m_s]
        say(f"fly {spec.name}")
        with located(where, f"flight[{i}]"):
            manoeuvre = Manoeuvre(spec.name, signal_of(spec, trimmed.rate_hz), spec.settle_s)
            air = air_of(scenario.air, scenario.condition.h_m, seed + i)
            job = Job(aircraft, trimmed, manoeuvre, log_rate(scenario.simulation, [suite]), None, air)
            flight = fly_and_measure(job, [suite], seed + i, settled=True, keep=keep)
        records[spec.name] = flight.measured[suite.name]
    say("find modes")
    with located(where, "modes"):
        found, at, margin = _sought(list(records.values()), search or scenario.modes)
    say("linearise")
    true = _truth(aircraft, trims[max(trims)], found.channels)
    c = scenario.flown_at(max(trims)).condition
    lengths = scale_lengths(c.h_m if scenario.air.height_m is None else scenario.air.height_m)
    turbulent = scenario.air.turbulence_rms_m_s > 0.0
    return ModesResult(
        scenario.name,
        scenario.title,
        scenario.question,
        found,
        records,
        read_text(where, "scenario") if where else "",
        tuple(true),
        tuple(match_modes(found, true)),
        tuple(c.V_m_s / (2.0 * np.pi * length) for length in lengths) if turbulent else (),
        _stations(aircraft, found.channels),
        at,
        margin,
        risk,
    )


def _truth(aircraft: Aircraft, trimmed: TrimmedFlight, channels: Sequence[str]) -> list[TrueMode]:
    linear, elastic = linearise(aircraft, trimmed), aircraft.flown_modes()
    kinds: dict[str, dict[int, str]] = {"symmetric": {}, "asymmetric": {}}
    for i, mode in enumerate(elastic.modes if elastic else (), 1):
        kinds[mode.symmetry][i] = mode.name
    return true_modes(linear, kinds["symmetric"], kinds["asymmetric"], channels)


def _stations(aircraft: Aircraft, channels: Sequence[str]) -> tuple[float | None, ...]:
    places = aircraft.flown_stations()
    return tuple(places[int(n.rsplit("_", 1)[1]) - 1].y_m if n.startswith(WING) else None for n in channels)


def signal_of(spec: TurbulentFlight, rate_hz: float) -> InputSignal:
    """Return the inputs of a flight as a signal; controls stay at trim where it has none."""
    if spec.input:
        return build(spec.input, spec.duration_s, rate_hz)
    n = round(spec.duration_s * rate_hz)
    return InputSignal(np.arange(n) / rate_hz, np.zeros((n, 1)), CONTROLS[:1])
