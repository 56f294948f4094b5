"""Files of a design: scenarios for `testbench run`, signals as CSV and MAT, and what it promises.

A flight plan that took the design over reads promises/NAME.json after the flight. All errors are standard errors in SI
units.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.door import read_json, read_text
from testbench.core.errors import RecordError
from testbench.core.escape import table_lines
from testbench.core.record import FlightRecord, FloatArray
from testbench.design.realise import Errors, Realised
from testbench.page.labels import file_stem, number
from testbench.questions.design.answer import air_words, family_label, is_ratio
from testbench.questions.files import PROMISES, promise_beside

if TYPE_CHECKING:
    from testbench.core.scenario.inputs import Input
    from testbench.design.amplitude import Flown
    from testbench.design.problem import Design
    from testbench.page.page import Content
    from testbench.questions.design.result import DesignResult


def ready_to_fly(result: DesignResult) -> Mapping[str, Content]:
    """Return the files of every ranked design: designs/NAME.toml, promises/NAME.json, signals/NAME.csv and .mat.

    The scenario that asked for them lies beside as design.toml: `testbench plan --from` takes its limits.
    """
    out: dict[str, Content] = {}
    asked = result.scenario.file
    if asked is not None and asked.is_file():
        out["design.toml"] = read_text(asked, "scenario")
    ranked = [*enumerate(result.ranking, 1), *([("shortest", result.shortest)] if result.shortest else [])]
    for rank, entry in ranked:
        design = entry.design
        stem = file_stem(f"{rank}_{family_label(design.family)}".replace("shortest_shortest", "shortest"))
        channels = tuple(f"{c}_cmd" for c in design.controls)
        t = np.arange(len(design.u)) / result.problem.rate_hz
        rows = t < design.duration_s - 1e-9
        record = FlightRecord(
            t[rows], channels, design.u[rows], "truth", provenance={"signal": "deviation from trim", "held": True}
        )
        out[f"designs/{stem}.toml"] = scenario_toml(result, design)
        out[f"{PROMISES}/{stem}.json"] = promise_text(promise_of(result, entry))
        out[f"signals/{stem}.csv"] = record.save_csv
        out[f"signals/{stem}.mat"] = record.save_mat
    return out


def scenario_toml(result: DesignResult, design: Design) -> str:
    """Return a design as the text of a scenario: flown for identification, another input for validation."""
    s, t, start = result.scenario, result.problem.targets, result.problem.start_s
    judge = next((r.design for r in result.ranking if r.design.family != design.family), design)
    manoeuvres = [
        {
            "name": family_label(one.family) + ("" if use == "identification" else " to judge"),
            "use": use,
            "duration_s": round(one.duration_s - start, 6),
            "settle_s": round(start, 6),
            "input": [_entry(spec, start) for spec in one.specs],
        }
        for use, one in (("identification", design), ("validation", judge))
    ]
    air = result.air.model_dump(exclude_defaults=True, exclude={"gust"}) if result.air else {}
    condition = {key: float(getattr(s.condition, key)) for key in ("V_m_s", "h_m", "gamma_deg")}
    table = {
        "title": f"{s.title}: {family_label(design.family)}",
        "aircraft": s.aircraft,
        "wings": None if s.wings == "flexible" else s.wings,
        "seed": s.seed,
        "suites": s.suites[:1],
        "condition": condition,
        "simulation": {"rate_hz": s.simulation.rate_hz, "log_rate_hz": result.problem.rate_hz},
        "air": air or None,
        "manoeuvre": manoeuvres,
        "identification": result.ensemble.range_.identified.table,
    }
    entry = next((e for e in (*result.ranking, result.shortest) if e is not None and e.design is design), None)
    realised = entry is not None and entry.realised is not None
    told = "Errors to plan with, promised and realised" if realised else "Predicted standard errors"
    errors = design.errors if entry is None else entry.errors
    lines = [
        f"#   {name}: {number(100 * e / abs(v))} %" if is_ratio(name) else f"#   {name}: {number(e)}"
        for name, e, v in zip(t.names, errors, t.values, strict=True)
    ]
    head = f"# Designed input: {family_label(design.family)}, {design.words}. {told}:"
    return "\n".join([head, *lines, *table_lines(table)]) + "\n"


def _entry(spec: Input, start_s: float) -> dict[str, Any]:
    """Return an entry of a manoeuvre whose clock starts when the input does."""
    entry = spec.model_dump(exclude_defaults=True)
    return {**entry, "start_s": round(max(spec.start_s - start_s, 0.0), 9)}


# --- promises ---------------------------------------------------------------------------------------------------------


Modes = dict[str, complex | tuple[complex, complex]]


@dataclass(frozen=True, eq=False)
class Promise:
    """The promise of one design."""

    names: tuple[str, ...]  # (t,) targets: parameters such as "M_q", and "wn of MODE", "zeta of MODE"
    values: FloatArray  # (t,) of the believed aircraft
    wanted: FloatArray  # (t,) standard errors that were asked for; NaN where none was
    promised: FloatArray  # (t,) standard errors by information
    modes: Modes  # mode -> its believed pole, or its two real roots
    V_m_s: float  # true airspeed of the design
    h_m: float  # its height above sea level
    air: str = ""  # in which it was flown in simulation, in words; "" if it was not
    realised: Realised | None = None  # over simulated flights; None if it was not computed

    @property
    def headline(self) -> FloatArray:
        """(t,) the errors of one run to plan with: realised where they contradict the promised ones."""
        return self.promised if self.realised is None else self.realised.headline


def promise_of(result: DesignResult, entry: Flown) -> Promise:
    """Return the promise of one of the designs of a result."""
    t = result.problem.targets
    return Promise(
        t.names,
        t.values,
        t.wanted,
        entry.design.errors,
        dict(t.modes),
        result.scenario.condition.V_m_s,
        result.scenario.condition.h_m,
        air_words(result) if entry.realised is not None else "",
        entry.realised,
    )


def promise_text(promise: Promise) -> str:
    """Return the text of the file; an error without bound, or that nobody wanted, is null."""
    r = promise.realised
    realised = None
    if r is not None:
        realised = {
            "errors": r.found.errors.tolist(),
            "stated": r.found.stated.tolist(),
            "failed": list(r.found.failed),
            "counts": r.differs.tolist(),
            "causes": [dict(c) for c in r.causes],
        }
    content = {
        "targets": list(promise.names),
        "believed": promise.values.tolist(),
        "wanted": _finite(promise.wanted),
        "promised": _finite(promise.promised),
        "modes": {name: [[z.real, z.imag] for z in _roots(pole)] for name, pole in promise.modes.items()},
        "V_m_s": promise.V_m_s,
        "h_m": promise.h_m,
        "air": promise.air,
        "realised": realised,
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def read_promise(design: Path) -> Promise | None:
    """Return the promise of a design's file ``designs/NAME.toml``; None if none lies beside it.

    Raises:
        RecordError: it is not as :func:`promise_text` writes it.
    """
    file = promise_beside(design)
    return None if file is None else promise_of_file(file)


def promise_of_file(file: Path) -> Promise:
    """Return the promise that a file ``promises/NAME.json`` holds.

    Raises:
        RecordError: it is not as :func:`promise_text` writes it, or cannot be read.
    """
    found = read_json(file, "promise")
    try:
        return _read(found)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordError(
            f"a promise must be as `testbench design` writes it, got '{file}' ({type(error).__name__}: {error}); "
            "design again, or remove it"
        ) from error


def _read(found: Mapping[str, Any]) -> Promise:
    names, realised = tuple(str(n) for n in found["targets"]), None
    t = len(names)
    values = _row(found["believed"], t)
    wanted = _row([np.nan if e is None else e for e in found["wanted"]], t)
    promised = _row([np.inf if e is None else e for e in found["promised"]], t)
    modes: Modes = {}
    for name, roots in found["modes"].items():
        poles = [complex(*root) for root in roots]
        modes[name] = (poles[0], poles[1]) if len(poles) == 2 else poles[0]
    if found["realised"] is not None:
        r = found["realised"]
        errors, stated = (np.array(r[key], float).reshape(-1, t) for key in ("errors", "stated"))
        counts = np.array(r["counts"], bool).reshape(t)
        realised = Realised(promised, Errors(errors, stated, tuple(r["failed"])), counts, tuple(r["causes"]))
    V_m_s, h_m = float(found["V_m_s"]), float(found["h_m"])
    return Promise(names, values, wanted, promised, modes, V_m_s, h_m, str(found["air"]), realised)


def _finite(values: FloatArray) -> list[float | None]:
    return [float(e) if np.isfinite(e) else None for e in values]


def _row(values: Any, t: int) -> FloatArray:
    return np.array(values, float).reshape(t)


def _roots(pole: complex | tuple[complex, complex]) -> tuple[complex, ...]:
    return pole if isinstance(pole, tuple) else (pole,)
