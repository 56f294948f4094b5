"""Operational modal analysis as one question: fly a scenario in turbulence, or take records, and find their modes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from testbench.aircraft import Aircraft, load_aircraft
from testbench.channels import CONTROLS
from testbench.constants import DEG_RAD
from testbench.errors import ChannelError, RecordError, ScenarioError, TestbenchError, located, nearest
from testbench.estimators.operational import Criteria, OperationalModes, estimate
from testbench.estimators.prepare import prepare
from testbench.evaluation.operational import ModeMatch, TrueMode, match_modes, true_modes
from testbench.flight import FlightCondition, Manoeuvre, TrimmedFlight, fly, linearise, trim
from testbench.flight.air import air_of, scale_lengths
from testbench.flight.preflight import log_rate
from testbench.flight.simulate import stride
from testbench.inputs import InputSignal, build
from testbench.paths import find_scenario
from testbench.record import FlightRecord, load_record
from testbench.scenario import Scenario
from testbench.scenario.modes import ModeSearch, ModesScenario, TurbulentFlight
from testbench.schema import parse, read_toml
from testbench.sensors import SensorSuite, load_suite

if TYPE_CHECKING:
    from testbench.pipeline import Keep, Report

WING = ("az_wing_", "strain_wing_")
"""How the channels begin that modes are sought in where none are named."""


@dataclass(frozen=True, eq=False)
class ModesResult:
    """What was found, and what is known of the aircraft.

    Attributes:
        name, title, question: for the report.
        found: modes with errors.
        records: name -> record that they come from.
        source: text of the scenario or description, empty for bare records.
        true: the linear model's oscillatory modes; empty for recorded flights.
        matches: found and true modes that stand for each other; empty for recorded flights.
        corners_hz: frequencies V / (2 pi L) at which the spectra of the turbulence u, v, w bend; empty if not known.
        stations_m: place of each channel along the wing, None where it has none.
    """

    name: str
    title: str
    question: str
    found: OperationalModes
    records: Mapping[str, FlightRecord]
    source: str = ""
    true: tuple[TrueMode, ...] = ()
    matches: tuple[ModeMatch, ...] = ()
    corners_hz: tuple[float, ...] = ()
    stations_m: tuple[float | None, ...] = ()


def search_for(given: Mapping[str, Any], otherwise: ModeSearch | None = None) -> ModeSearch:
    """Return what is sought where ``given`` (keys of ModeSearch) replaces what a scenario says.

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
    from testbench.logs import load_description, read_records

    described = load_description(files[0])
    steps = described.preparation
    records = {
        name: prepare(
            record, bias=steps.bias, trim_s=described.trim_s, lowpass_hz=steps.lowpass_hz, decimate=steps.decimate
        )
        for name, _, record in read_records(described, data_folder)
    }
    say("find modes")
    with located(described.file, "identification.outputs"):
        search = search if search.channels else search.model_copy(update={"channels": described.outputs})
        text = described.file.read_text(encoding="utf-8") if described.file else ""
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


def load_modes(path: Path | str) -> ModesScenario:
    """Read a scenario of flight in turbulence and check it against its aircraft and suite, without flying.

    Raises:
        ScenarioError: lists every fault with file, key, law, value and the nearest valid name.
    """
    file = find_scenario(path)
    scenario, faults = parse(ModesScenario, read_toml(file), file)
    if scenario is not None:
        scenario = scenario.model_copy()
        scenario.__pydantic_private__ = {"_file": file}
        faults = [*faults, *check(scenario)]
    if scenario is None or faults:
        raise ScenarioError(faults)
    return scenario


def check(scenario: ModesScenario) -> list[str]:
    """Return every law of aircraft, inputs and sensors that the scenario breaks, in words, without flying it."""
    faults: list[str] = []

    def attempt(key: str, action: Callable[[], object]) -> object:
        """Return what the action returns; if it fails, note why under the key and return None."""
        try:
            return action()
        except TestbenchError as error:
            inner = error.faults if isinstance(error, ScenarioError) else (error.message,)
            faults.extend(f"{scenario.file}, {key}: {fault}" for fault in inner)
            return None

    aircraft = cast("Aircraft | None", attempt("aircraft", lambda: load_aircraft(scenario.aircraft, "flexible")))
    suite = cast("SensorSuite | None", attempt("suite", lambda: load_suite(scenario.suite)))
    if aircraft is None or suite is None:
        return faults
    rate = scenario.simulation.rate_hz or aircraft.rate_hz
    logged = log_rate(cast(Scenario, scenario), [suite])
    attempt("simulation.log_rate_hz", lambda: stride(rate, logged))
    attempt("suite", lambda: suite.check_log_rate(logged))
    for i, spec in enumerate(scenario.flight):
        attempt(f"flight[{i}]", lambda spec=spec: _signal(spec, rate))  # type: ignore[misc]
    for name in (*scenario.modes.channels, *scenario.modes.references):
        if name not in suite.outputs:
            hint = nearest(name, suite.outputs)
            faults.append(f"{scenario.file}, modes: channels must be sensed by the suite, got '{name}'{hint}")
    if not scenario.modes.channels and not any(c.startswith(WING) for c in suite.outputs):
        faults.append(f"{scenario.file}, modes.channels: must be given, suite '{suite.name}' has no sensor on the wing")
    if aircraft.flown_modes() is None:
        faults.append(f"{scenario.file}, aircraft: {aircraft.name} must have elastic modes, it has none")
    return faults


def fly_modes(
    scenario: ModesScenario,
    search: ModeSearch | None = None,
    seed: int | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
) -> ModesResult:
    """Fly a scenario, measure, find modes from the outputs alone, and set them beside those of the linear model.

    Args:
        scenario: of :func:`load_modes`.
        search: replaces the scenario's own.
        seed: replaces the scenario's own; flight i has the turbulence and noise of seed + i.
        keep: called with a name and each record as soon as it exists.
        progress: called with a few words as each stage begins.

    Raises:
        TestbenchError: with the file and key of the scenario that it comes from.
    """
    keep, say = keep or (lambda name, record: None), progress or (lambda text: None)
    seed, where = scenario.seed if seed is None else seed, scenario.file
    aircraft, suite = load_aircraft(scenario.aircraft, "flexible"), load_suite(scenario.suite)
    say(f"trim {aircraft.name}")
    c = scenario.condition
    with located(where, "condition"):
        trimmed = trim(
            aircraft, FlightCondition(c.V_m_s, c.h_m, c.gamma_deg * DEG_RAD), scenario.simulation.rate_hz,
            air_of(scenario.air, scenario.condition.h_m, seed),
        )  # fmt: skip
    rate, records = log_rate(cast(Scenario, scenario), [suite]), {}
    for i, spec in enumerate(scenario.flight):
        say(f"fly {spec.name}")
        with located(where, f"flight[{i}]"):
            manoeuvre = Manoeuvre(spec.name, _signal(spec, trimmed.rate_hz), spec.settle_s)
            truth = fly(
                aircraft, trimmed, manoeuvre, rate, None, air_of(scenario.air, scenario.condition.h_m, seed + i)
            )
        record = suite.measure(truth, seed + i).between(spec.settle_s, np.inf)
        keep(f"{spec.name}_truth", truth)
        keep(f"{spec.name}_{suite.name}", record)
        records[spec.name] = record
    say("find modes")
    with located(where, "modes"):
        found = _estimate(list(records.values()), search or scenario.modes)
    say("linearise")
    true = _truth(aircraft, trimmed, found.channels)
    lengths = scale_lengths(c.h_m if scenario.air.height_m is None else scenario.air.height_m)
    turbulent = scenario.air.turbulence_rms_m_s > 0.0
    return ModesResult(
        scenario.name,
        scenario.title,
        scenario.question,
        found,
        records,
        where.read_text(encoding="utf-8") if where else "",
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


def _signal(spec: TurbulentFlight, rate_hz: float) -> InputSignal:
    if spec.input:
        return build(spec.input, spec.duration_s, rate_hz)
    n = round(spec.duration_s * rate_hz)
    return InputSignal(np.arange(n) / rate_hz, np.zeros((n, 1)), CONTROLS[:1])
