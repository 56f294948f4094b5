"""Operational modal analysis as one question: fly a scenario in turbulence, or take records, and find their modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.channels import CONTROLS
from testbench.core.door import read_text
from testbench.core.errors import ChannelError, RecordError, ScenarioError, located
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, load_record
from testbench.core.schema import parse
from testbench.estimators.operational import Criteria, OperationalModes, estimate
from testbench.estimators.prepare import prepared
from testbench.evaluation.operational import TrueMode, match_modes, true_modes
from testbench.flight import TrimmedFlight, linearise, load_aircraft
from testbench.flight.air import air_of, scale_lengths
from testbench.flight.batch.jobs import Job
from testbench.inputs import InputSignal, build
from testbench.line import log_rate, manoeuvre_of, measured, trim_for
from testbench.questions.modes.result import ModesResult
from testbench.questions.modes.scenario import ModeSearch, ModesScenario, TurbulentFlight
from testbench.sensors import load_suite

if TYPE_CHECKING:
    from testbench.line import Keep, Report

WING = ("az_wing_", "strain_wing_")
"""Beginnings of the names of channels in which modes are sought if none are named."""


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
    records: Mapping[str, FlightRecord], search: ModeSearch, name: str = "modes", title: str = "", source: str = ""
) -> ModesResult:
    """Return the modes of recorded flights.

    Args:
        records: name -> measured record.
        search: channels, band and order.
        name: of the results folder.
        title: of the report; the names of the records if not given.
        source: text that says where the records come from.

    Raises:
        ChannelError: no channel is named and the records hold none of the wing, or a record lacks one.
        EstimationError: see :func:`testbench.estimators.operational.estimate`.
    """
    found = _estimate(list(records.values()), search)
    return ModesResult(name, title or f"Modes of {', '.join(records)}", "", found, records, source)


def read_modes(
    files: Sequence[Path], search: ModeSearch, data_folder: Path | None = None, progress: Report | None = None
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
        return find_modes(dict(zip(_names([f.stem for f in files]), held, strict=True)), search, files[0].stem)
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
        return find_modes(records, search, described.name, described.title, text)


def _names(stems: Sequence[str]) -> list[str]:
    return [f"{s} ({i})" if stems.count(s) > 1 else s for i, s in enumerate(stems, 1)]


def _estimate(records: Sequence[FlightRecord], search: ModeSearch) -> OperationalModes:
    return estimate(
        records,
        search.channels or _of_the_wing(records),
        references=search.references,
        band_hz=search.band_hz,
        order=search.order,
        criteria=Criteria(least_orders=search.least_orders),
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
) -> ModesResult:
    """Fly a scenario, measure, find modes from the outputs alone, and set them beside those of the linear model.

    Args:
        scenario: of :meth:`ModesScenario.load`.
        search: replaces the scenario's own.
        seed: replaces the scenario's own; flight i has the turbulence and noise of seed + i.
        keep: called with a name and each record as soon as it exists.
        progress: called with a few words as each stage begins.

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
    trimmed = trim_for(scenario, aircraft, seed)
    records = {}
    for i, spec in enumerate(scenario.flight):
        say(f"fly {spec.name}")
        with located(where, f"flight[{i}]"):
            manoeuvre = manoeuvre_of(spec.name, signal_of(spec, trimmed.rate_hz), 0.0, spec.settle_s, trimmed.rate_hz)
            air = air_of(scenario.air, scenario.condition.h_m, seed + i)
            job = Job(aircraft, trimmed, manoeuvre, log_rate(scenario.simulation, [suite]), None, air)
            flight = measured(job, [suite], seed + i, settled=True, keep=keep)
        records[spec.name] = flight.measured[suite.name]
    say("find modes")
    with located(where, "modes"):
        found = _estimate(list(records.values()), search or scenario.modes)
    say("linearise")
    true = _truth(aircraft, trimmed, found.channels)
    c = scenario.condition
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
