"""Designs ready to fly: scenarios for `testbench run`, and signals as CSV and MAT."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.door import read_text
from testbench.core.escape import quoted
from testbench.core.record import FlightRecord
from testbench.page.labels import file_stem, number
from testbench.questions.design.answer import family_label, is_ratio
from testbench.questions.design.identified import toml_of
from testbench.questions.design.promised import promise_of, promise_text
from testbench.questions.files import PROMISES

if TYPE_CHECKING:
    from testbench.page.page import Content
    from testbench.questions.design.problem import Design
    from testbench.questions.design.result import DesignResult, Ranked

_DEFAULTS = {"start_s", "repeats", "spacing", "fade_s", "periods", "stride", "first", "powers", "bits", "seed"}


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
    s = result.scenario
    judge = next((r.design for r in result.ranking if r.design.family != design.family), design)
    wings = [] if s.wings == "flexible" else [f'wings = "{s.wings}"']
    rate = [] if s.simulation.rate_hz is None else [f"rate_hz = {s.simulation.rate_hz:g}"]
    lines = [
        f"# Designed input: {family_label(design.family)}, {design.words}. {_told(result, design)}:",
        *(f"#   {text}" for text in _error_lines(result, design)),
        f"title = {quoted(f'{s.title}: {family_label(design.family)}')}",
        f"aircraft = {quoted(s.aircraft)}",
        *wings,
        f"seed = {s.seed}",
        f"suites = [{', '.join(quoted(name) for name in s.suites[:1])}]",
        "",
        "[condition]",
        f"V_m_s = {float(s.condition.V_m_s)!r}",
        f"h_m = {float(s.condition.h_m)!r}",
        f"gamma_deg = {float(s.condition.gamma_deg)!r}",
        "",
        "[simulation]",
        *rate,
        f"log_rate_hz = {result.problem.rate_hz!r}",
        *_air_lines(result),
    ]
    for use, one in (("identification", design), ("validation", judge)):
        start = result.problem.start_s
        lines += [
            "",
            "[[manoeuvre]]",
            f"name = {quoted(family_label(one.family) + ('' if use == 'identification' else ' to judge'))}",
            f'use = "{use}"',
            f"duration_s = {round(one.duration_s - start, 6)!r}",
            f"settle_s = {round(start, 6)!r}",
        ]
        for spec in one.specs:
            lines += ["[[manoeuvre.input]]", *_entry(spec, start)]
    assert result.identified is not None
    lines += ["", *toml_of(result.identified.table, quoted)]
    return "\n".join(lines) + "\n"


def _air_lines(result: DesignResult) -> list[str]:
    """Return the table of the air in which the design was realised, if it moves."""
    if result.air is None:
        return []
    given = result.air.model_dump(exclude_defaults=True)
    return ["", "[air]", *(f"{k} = {v!r}" for k, v in given.items() if k != "gust")] if given else []


def _entry_of(result: DesignResult, design: Design) -> Ranked | None:
    entries = [*result.ranking, *([result.shortest] if result.shortest else [])]
    return next((e for e in entries if e.design is design), None)


def _told(result: DesignResult, design: Design) -> str:
    entry = _entry_of(result, design)
    realised = entry is not None and entry.realised is not None
    return "Errors to plan with, promised and realised" if realised else "Predicted standard errors"


def _error_lines(result: DesignResult, design: Design) -> list[str]:
    t, entry = result.problem.targets, _entry_of(result, design)
    errors = design.errors if entry is None else entry.errors
    return [
        f"{name}: {number(100 * e / abs(v))} %" if is_ratio(name) else f"{name}: {number(e)}"
        for name, e, v in zip(t.names, errors, t.values, strict=True)
    ]


def _entry(spec: Any, start_s: float) -> list[str]:
    out = []
    for key, value in spec.model_dump().items():
        if value is None or (key in _DEFAULTS and value == type(spec).model_fields[key].default):
            continue
        if key == "start_s":
            value = round(max(value - start_s, 0.0), 9)
        out.append(f"{key} = {_value(value)}")
    return out


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_value(v) for v in value)}]"
    if isinstance(value, str):
        return quoted(value)
    return repr(value) if isinstance(value, int) else repr(float(value))
