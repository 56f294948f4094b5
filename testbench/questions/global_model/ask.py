"""Make one global model of many flights of an aircraft, and judge it on flights that were held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.reactions import reacts
from testbench.core.blas import on_one_thread
from testbench.core.channels import SURFACES
from testbench.core.errors import EstimationError, nearest
from testbench.core.named import Named, obtain
from testbench.core.record import FlightRecord, load_record
from testbench.estimators.regression.global_model import (
    CoefficientFunction,
    FlownDomain,
    GlobalModel,
    fit,
    knots,
    refit,
)
from testbench.inference.instruments import without_errors
from testbench.line import Report
from testbench.logs.read import read_records
from testbench.questions.global_model.coefficients import (
    APART,
    COEFFICIENTS,
    MOTIONS,
    FeltFlight,
    cutoff_hz,
    felt_flights,
    forces_of,
)
from testbench.questions.global_model.result import GlobalFound, HeldOut
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import WHOLE, import_log

Flights = Sequence[tuple[str, str, FlightRecord]]
"""Name, use and record of each."""
_FEWEST = 3
_SLOWEST_M_S = 1.0


def flights_of(path: Path, data_folder: Path | None = None) -> tuple[Flights, RecordDescription | None]:
    """Return the flights that a file stands for: a description, a folder that import wrote, a record, or a log.

    A log is taken whole, from its first sample to its last: cut it to flight with a description.

    Raises:
        RecordError: it is none of these, or cannot be read.
        ScenarioError: the description breaks a law.
    """
    if path.is_dir() and (path / f"{WHOLE}.nc").is_file():
        return [(path.name, "identification", load_record(path / f"{WHOLE}.nc"))], None
    if path.is_file() and path.suffix == ".nc":
        return [(path.stem, "identification", load_record(path))], None
    if path.is_file() and path.suffix != ".toml":
        return [(path.stem, "identification", import_log(path).record)], None
    description = obtain(RecordDescription, path)
    read = read_records(description, data_folder)
    return [(n, use, without_errors(r, description.correct)) for n, use, r in read], description


@on_one_thread
def global_model(
    flights: Flights,
    aircraft: Named[Aircraft],
    *,
    hold_out: Sequence[str] = (),
    instrument_std: Mapping[str, float] | None = None,
    progress: Report | None = None,
) -> GlobalFound:
    """Return the coefficients of an aircraft as functions of its state, from many flights.

    Args:
        flights: name, use and record of each, of one configuration; "validation" ones are held out.
        aircraft: the believed model: mass, inertia, geometry and engines are taken from it.
        hold_out: names of flights to hold out besides. If none is held out, that in the middle of alpha is.
        instrument_std: errors that instruments may have, CHANNEL_KIND -> standard deviation, as a description states
            them; without it they are taken as they read.
        progress: called with a few words as each stage begins.

    Raises:
        EstimationError: a record is no measured one, fewer than three flights are left to fit, a name is not that of a
            flight, or a coefficient never moves.
        ChannelError: a record lacks a channel.
        LimitError, ModelError, TrimError: the model cannot be evaluated along a flight.

    Example:
        >>> import testbench as tb
        >>> found = tb.global_model(flights, tb.load_aircraft("jsbsim:T38"))  # doctest: +SKIP
        >>> found.model.functions["Cm"].terms  # doctest: +SKIP
    """
    aircraft = obtain(Aircraft, aircraft)
    say = progress or (lambda text: None)
    records = _divided(flights, hold_out)
    cut = cutoff_hz([r for _, _, r in records])
    V_ref = float(np.mean([np.mean(r["V"]) for _, _, r in records]))
    say("run the a-priori model along the flights")
    forces = forces_of(aircraft, records, cut)
    felt = felt_flights(aircraft, records, forces, V_ref, cut)
    fitted = [f.signals for f in felt if f.use == "identification"]
    signals = (*MOTIONS, *(c for c in SURFACES if c in fitted[0]))
    hinges = knots(fitted, signals)
    functions = {}
    for c in COEFFICIENTS:
        say(f"choose the terms of {c}")
        functions[c] = fit(c, fitted, signals, hinges, APART.get(c, ()))
    known = {k: s for k, s in (instrument_std or {}).items() if all(k.rpartition("_")[0] in r for _, _, r in records)}
    if known:
        say("include the errors of instruments")
    own = [k for k, (_, use, _) in enumerate(records) if use == "identification"]
    for error, std in known.items():
        moved = [(records[k][0], "", without_errors(records[k][2], {error: -std})) for k in own]
        there = [f.signals for f in felt_flights(aircraft, moved, [forces[k] for k in own], V_ref, cut)]
        for c, f in functions.items():
            d = refit(c, there, f.terms, f.hinges, tuple(f.apart)).params - f.params
            functions[c] = replace(f, covariance=f.covariance + np.outer(d, d))
    domain = FlownDomain.of(fitted, signals)
    held = [f for f in felt if f.use == "validation"]
    return GlobalFound(
        aircraft,
        GlobalModel(functions, domain),
        tuple(felt),
        tuple(_held(f, held, domain) for f in functions.values()),
        V_ref,
        cut,
        known,
        _notes(aircraft, records),
    )


def _divided(flights: Flights, hold_out: Sequence[str]) -> list[tuple[str, str, FlightRecord]]:
    names = [n for n, _, _ in flights]
    for n in hold_out:
        if n not in names:
            raise EstimationError(
                f"a flight that is held out must be one of {', '.join(names)}, got '{n}'{nearest(n, names)}"
            )
    for n, _, r in flights:
        if r.kind != "measured":
            raise EstimationError(f"a global model takes measured records only, '{n}' is one of kind '{r.kind}'")
        if "V" in r and float(np.min(r["V"])) < _SLOWEST_M_S:
            raise EstimationError(
                f"V must be above {_SLOWEST_M_S:g} m/s throughout, '{n}' falls below: cut it to flight"
            )
    out = [(n, "validation" if n in hold_out or use == "validation" else "identification", r) for n, use, r in flights]
    if all(use == "identification" for _, use, _ in out) and out and all("alpha" in r for _, _, r in out):
        means = np.array([np.mean(r["alpha"]) for _, _, r in out])
        middle = int(np.argsort(means)[len(means) // 2])
        out[middle] = (out[middle][0], "validation", out[middle][2])
    left = sum(use == "identification" for _, use, _ in out)
    if left < _FEWEST:
        raise EstimationError(
            f"a global model needs {_FEWEST} flights to fit and one that is held out, got {left} to fit; cut a long "
            "log into segments, or fly more"
        )
    return out


def _held(f: CoefficientFunction, flights: Sequence[FeltFlight], domain: FlownDomain) -> HeldOut:
    felt = np.concatenate([x.signals[f.name] - f.beside(x.signals) for x in flights])
    error = felt - np.concatenate([f.at(x.signals)[0] for x in flights])
    believed = felt - np.concatenate([x.believed[f.name] for x in flights])
    inside = np.concatenate([domain.inside(x.signals) for x in flights])
    return HeldOut(
        f.name, f.span, f.residual_rms, float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(believed**2))),
        1.0 - float(np.sum(error**2) / np.sum((felt - felt.mean()) ** 2)), float(np.mean(inside)),
    )  # fmt: skip


def _notes(aircraft: Aircraft, records: Flights) -> tuple[str, ...]:
    out = []
    commands = [c for c in SURFACES if c in aircraft.controls and any(c not in r for _, _, r in records)]
    if commands:
        out.append(
            f"{', '.join(commands)} not recorded in all flights: the a-priori servo converts the command to the "
            "deflection"
        )
    if reacts(aircraft.xml):
        out.append(
            f"{aircraft.name} contains increments of an earlier amendment: the functions are in addition to them, and "
            "a written aircraft keeps them"
        )
    return tuple(out)
