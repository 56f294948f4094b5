"""Tables of a design: the ranking, the energy in the modes, what was screened, what prevents more accuracy."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.labels import number, symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.design.answer import air_words, family_label, is_ratio, peak_words
from testbench.questions.design.realise import FALSE_ALARM, INTERVAL, TRUST

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.design.draws import OverDraws
    from testbench.questions.design.known import Known
    from testbench.questions.design.problem import Design, Problem
    from testbench.questions.design.result import DesignResult, Ranked

_DRAWN = "over drawn aircraft"
_MOST_COLUMNS = 5  # targets beyond which a terminal shows the criterion alone


def design_tables(result: DesignResult) -> list[Table]:
    """Return the ranking, the errors over drawn aircraft, the energy in the modes, the screening, and the obstacles."""
    out = [
        ranking_table(result),
        known_table(result.problem, result.known, result.total(result.best), result.best.errors),
        realised_table(result),
        elsewhere_table(result),
        draws_table(result),
        energy_table(result),
        screening_table(result),
        obstacle_table(result),
    ]
    return [t for t in out if t.rows]


def ranking_table(result: DesignResult) -> Table:
    """Return every design flown, best first, with predicted standard errors and the limit that binds."""
    t = result.problem.targets
    columns = [
        Column("rank", "", given=True),
        Column("signal", "signal"),
        Column("quantities", "free quantities"),
        Column("peak", "peak command"),
        Column("end", "input ends", "s", decimals=2),
        Column("record", "record ends", "s", decimals=2),
        Column("worst", "criterion", "", digits=3),
    ]
    drawn = result.best.over is not None
    if drawn:
        columns += [
            Column("median", "median", "", _DRAWN, digits=3),
            Column("worst of draws", "worst", "", _DRAWN, digits=3),
        ]
    for k, name in enumerate(t.names):
        wanted = 100.0 * t.wanted[k] / abs(t.values[k]) if is_ratio(name) else t.wanted[k]
        unit = f"{'% ' if is_ratio(name) else ''}(wanted {wanted:.3g})"
        columns.append(Column(f"error of {name}", name, unit, "predicted standard errors", digits=2))
    columns += [Column("limit", "limit met", "", "flown"), Column("share", "used", "%", "flown", decimals=0)]
    columns += [Column("note", "at the linear prediction's amplitude", "", "flown")]
    rows: list[tuple[Value, ...]] = []
    entries: list[tuple[Value, Ranked]] = [*enumerate(result.ranking, 1)]
    if result.shortest is not None:
        entries.append(("shortest", result.shortest))
    for rank, entry in entries:
        rows.append((str(rank), *_ranking_row(result, entry.design, entry.over), *_flown_cells(entry.flown)))
    for flown in result.rejected:
        rows.append(("rejected", *_ranking_row(result, flown.design, None), *_flown_cells(flown)))
    counted = "" if result.known is None else ", with what was flown before; the errors are those of the flight alone"
    caption = (
        f"Each design has its largest admissible amplitude in the nonlinear simulator. Criterion "
        f"{result.scenario.criterion}, in units of the wanted errors{counted}: at 1 or less they are reached. "
        "Standard errors are Cramér-Rao bounds for these sensors in the air that is expected; sensor offsets, initial "
        "states of a rigid aircraft and all other free parameters are estimated too. What is realised stands in its "
        "own table."
    )
    if drawn:
        caption += " Median and worst: the criterion of the same commands over the drawn aircraft" + (
            "; the designs are ranked by the worst." if result.scenario.robust else "."
        )
    return Table("ranking", "Designs, ranked", caption, tuple(columns), tuple(rows), wide=True)


def known_table(
    problem: Problem, known: Known | None, after: FloatArray | None = None, alone: FloatArray | None = None
) -> Table:
    """Return per target what is known now and after the recommended flight; without earlier flights no rows.

    Args:
        problem: of the design.
        known: by earlier flights.
        after: (t,) errors after the flight of the recommended input; None: nothing is to be flown.
        alone: (t,) errors of that flight alone.
    """
    t, flown = problem.targets, after is not None
    columns = [
        Column("target", "target"),
        Column("unit", "unit"),
        Column("model", "value of the model", digits=3),
        Column("value", "value now", digits=3),
        Column("wanted", "wanted error", digits=2),
        Column("now", "known now", digits=2),
    ]
    if flown:
        columns += [
            Column("alone", "this flight alone", digits=2),
            Column("after", "after this flight", digits=2),
        ]
    columns.append(Column("verdict", "verdict"))
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(t.names if known is not None else ()):
        assert known is not None
        shown = 100.0 / abs(t.values[k]) if is_ratio(name) else 1.0
        errors = [t.wanted[k], known.errors[k]]
        if alone is not None and after is not None:
            errors += [alone[k], after[k]]
        met = "met" if known.errors[k] <= t.wanted[k] else None
        if met is None:
            met = "met after this flight" if after is not None and after[k] <= t.wanted[k] else "not met"
        cells = (float(shown * e) if np.isfinite(e) else None for e in errors)
        model = float(known.before[k]) if np.isfinite(known.before[k]) else None
        rows.append((name, "%" if is_ratio(name) else "", model, float(t.values[k]), *cells, met))
    caption = (
        "Standard errors by all flights before, by this flight alone (realised where it was realised), and by both "
        "together. The input is designed at the values that are believed now: those of the flights, and of the model "
        "where they hardly tell."
    )
    return Table("known", "Known now, promised after this flight", caption, tuple(columns), tuple(rows))


def _ranking_row(result: DesignResult, design: Design, over: OverDraws | None) -> tuple[Value, ...]:
    t = result.problem.targets
    errors = [
        float(100.0 * e / abs(v)) if is_ratio(n) else float(e)
        for n, e, v in zip(t.names, design.errors, t.values, strict=True)
    ]
    head = (family_label(design.family), design.words, peak_words(design), design.end_s, design.duration_s)
    costs: tuple[Value, ...] = ()
    if result.best.over is not None:
        costs = (None, None) if over is None else (float(np.median(over.told.costs)), float(over.told.costs.max()))
    return (*head, float(design.cost), *costs, *errors)


def _flown_cells(flown: Any) -> tuple[Value, ...]:
    return (limit_symbol(flown.tightest.name), 100.0 * flown.tightest.share, flown.breach or "all limits kept")


def draws_table(result: DesignResult) -> Table:
    """Return the errors of the recommended input over the drawn aircraft; without draws a table without rows."""
    t, over = result.problem.targets, result.best.over
    columns = (
        Column("target", "target"),
        Column("unit", "unit"),
        Column("wanted", "wanted", digits=2),
        Column("believed", "believed aircraft", digits=2),
        Column("median", "median", "", _DRAWN, digits=2),
        Column("worst", "worst", "", _DRAWN, digits=2),
        Column("reached", "reach it", "", _DRAWN),
        Column("have", "have it", "", _DRAWN),
    )
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(t.names if over is not None else ()):
        assert over is not None
        shown = 100.0 / abs(t.values[k]) if is_ratio(name) else 1.0
        errors = (
            t.wanted[k],
            result.best.design.errors[k],
            over.told.median(k) * t.wanted[k],
            over.told.worst(k) * t.wanted[k],
        )
        ratios = over.told.ratios[:, k]
        counts = (int(np.count_nonzero(ratios <= 1.0)), int(np.count_nonzero(~np.isnan(ratios))))
        rows.append((name, "%" if is_ratio(name) else "", *(float(shown * e) for e in errors), *counts))
    n = 0 if over is None else len(over.told.costs)
    caption = (
        f"Predicted standard errors of the recommended input over {n} aircraft whose coefficients are drawn, each on "
        f"its own, by the uncertainty that {result.aircraft.name} states. Every one is trimmed and linearised anew. "
        "Errors in percent count from the values of the believed aircraft. A mode that has split into two real roots "
        "keeps wn = sqrt(s1 s2) and zeta = -(s1 + s2) / (2 wn). No prior is counted: output error has none."
    )
    return Table("draws", "Over the aircraft's own uncertainty", caption, columns, tuple(rows))


def realised_table(result: DesignResult) -> Table:
    """Return promised against realised errors of the designs that were flown and identified; else no rows."""
    t = result.problem.targets
    columns = (
        Column("signal", "signal"),
        Column("target", "target"),
        Column("unit", "unit"),
        Column("wanted", "wanted", digits=2),
        Column("promised", "promised", digits=2),
        Column("realised", "rms", "", "realised", digits=2),
        Column("low", "from", "", "realised", digits=2),
        Column("high", "to", "", "realised", digits=2),
        Column("bias", "mean", "", "realised", digits=2),
        Column("stated", "stated by the estimator", digits=2),
        Column("flights", "estimates"),
        Column("failed", "none"),
        Column("counts", "counts"),
        Column("headline", "to plan with", digits=2),
        Column("cause", "most of it"),
    )
    rows: list[tuple[Value, ...]] = []
    entries = [(family_label(e.design.family), e) for e in result.ranking]
    for label, entry in entries:
        r = entry.realised
        if r is None:
            continue
        low, high = r.found.interval()
        for k, name in enumerate(t.names):
            shown = 100.0 / abs(t.values[k]) if is_ratio(name) else 1.0
            errors = (t.wanted, r.promised, r.found.rms, low, high, r.found.bias, r.found.claimed, r.headline)
            *cells, head = (float(shown * e[k]) if np.isfinite(e[k]) else None for e in errors)
            counts = "realised" if r.differs[k] else "both"
            unit, flights = "%" if is_ratio(name) else "", (r.found.n, len(r.found.failed))
            rows.append((label, name, unit, *cells, *flights, counts, head, r.cause(k)))
    caption = (
        f"Flown in {air_words(result)}, sensed by the suite and identified by the estimator of the scenario. Promised: "
        "by information in that air, and by what the estimates are off by without noise. The interval holds "
        f"{100 * INTERVAL:g} % for normal errors. Realised errors count where they contradict the promise: chi-square, "
        f"probability of a false alarm {100 * FALSE_ALARM:g} % per design. Elsewhere both count, the promise like "
        f"{TRUST} flights."
    )
    return Table("realised", "Promised and realised", caption, columns, tuple(rows), wide=True)


def short_realised(result: DesignResult) -> Table:
    """Return what a terminal shows of what was realised: units beside the targets, failures where there are any."""
    whole = realised_table(result)
    keys = [c.key for c in whole.columns]
    target, unit, failed = map(keys.index, ("target", "unit", "failed"))
    rows = []
    for row in whole.rows:
        named = f"{row[target]}, {row[unit]}" if row[unit] else row[target]
        rows.append((*row[:target], named, *row[target + 1 :]))
    none = () if any(row[failed] for row in whole.rows) else ("failed",)
    return replace(whole, rows=tuple(rows)).without("wanted", "low", "high", "unit", "counts", *none)


def elsewhere_table(result: DesignResult) -> Table:
    """Return the errors of the recommended input where the aircraft's fast mode lies elsewhere; else no rows."""
    t = result.problem.targets
    columns = (
        Column("aircraft", "aircraft"),
        Column("target", "target"),
        Column("unit", "unit"),
        Column("value", "true value", digits=3),
        Column("predicted", "predicted", digits=2),
        Column("realised", "realised rms", digits=2),
        Column("bias", "realised mean", digits=2),
        Column("flights", "estimates"),
        Column("limit", "limit met"),
        Column("used", "used", "%", decimals=0),
    )
    rows: list[tuple[Value, ...]] = []
    for e in result.elsewhere:
        if e.found is None or e.values is None or e.predicted is None or e.tightest is None:
            continue
        for k, name in enumerate(t.names):
            shown = 100.0 / abs(e.values[k]) if is_ratio(name) else 1.0
            errors = (e.predicted[k], e.found.rms[k], e.found.bias[k])
            cells = (float(shown * x) if np.isfinite(x) else None for x in errors)
            limit = (limit_symbol(e.tightest.name), 100.0 * e.tightest.share)
            rows.append((e.what, name, "%" if is_ratio(name) else "", float(e.values[k]), *cells, e.found.n, *limit))
    caption = (
        "The commands of the recommended input with an aircraft that is not the believed one; the estimator is that of "
        "the scenario, which holds what it does not estimate at the believed values. Limits are those of one flight in "
        "still air."
    )
    return Table("elsewhere", "If the fast mode lies elsewhere", caption, columns, tuple(rows), wide=True)


def limit_symbol(name: str) -> str:
    """Return a limit's name with the symbol of its channel."""
    for kind in ("rate of ", "command of "):
        if name.startswith(kind):
            return kind + symbol(name.removeprefix(kind))
    return "load factor" if name == "az" else symbol(name) if name else "aborted"


def energy_table(result: DesignResult) -> Table:
    """Return for each design and mode the share of its energy and the signal-to-noise ratio at the best sensor."""
    modes = result.best.energy.modes
    columns = [
        Column("rank", "", given=True),
        Column("signal", "signal"),
        Column("below", "95 % of energy below", "rad/s"),
    ]
    for m in modes:
        wn = number(abs(result.modes[m]))
        columns.append(Column(f"share {m}", "share", "%", f"{m}, {wn} rad/s", digits=2))
        columns.append(Column(f"snr {m}", "best sensor", "", f"{m}, {wn} rad/s"))
    rows = []
    for rank, entry in enumerate(result.ranking, 1):
        e = entry.energy
        cells: list[Value] = []
        for i, m in enumerate(modes):
            sensor, snr = e.seen(m)
            cells += [100.0 * float(e.share[i]), f"{symbol(sensor)} {snr:+.0f} dB".replace("-", "−")]
        rows.append((str(rank), family_label(entry.design.family), float(np.nanmax(e.below_95)), *cells))
    caption = (
        "Share of the input's energy in each mode's half-power band, and the mode's own response there over the noise "
        "of the sensor that shows it best. Above 10 dB a mode counts as excited."
    )
    return Table("energy", "Spectral energy", caption, tuple(columns), tuple(rows), wide=True)


def screening_table(result: DesignResult) -> Table:
    """Return how each family did in the screening."""
    columns = (
        Column("family", "family"),
        Column("candidates", "candidates"),
        Column("cost", "lowest criterion", digits=3),
        Column("snr", "worst mode of interest, at its best", "dB", decimals=0),
    )
    rows = tuple((family_label(f), n, cost, snr) for f, (n, cost, snr) in result.families.items())
    caption = (
        f"{result.screened[0]} candidates over the free quantities of every family, each at the largest amplitude that "
        "the linearised aircraft allows. They are judged by their spectral energy at the sensors, and by information."
    )
    return Table("screening", "Screening", caption, columns, rows)


def obstacle_table(result: DesignResult) -> Table:
    """Return what the best design would reach without one sensor's noise, or without the limit that binds."""
    now = result.best.design.cost
    rows = tuple((f"without {o.words}", o.cost, 100.0 * o.cost / now) for o in result.obstacles.tried)
    columns = (
        Column("what", "what if"),
        Column("cost", "criterion", digits=3),
        Column("share", "of what it is", "%", digits=2),
    )
    caption = (
        "The same input with one obstacle less: either one sensor has a hundredth of its noise, or the limit that "
        "binds is gone."
    )
    return Table("obstacles", "What keeps the error from falling further", caption, columns, rows)


def short_ranking(result: DesignResult) -> Table:
    """Return the ranking as a terminal shows it: without the free quantities and errors where there are many."""
    table = ranking_table(result).without("record", "note")
    if len(result.problem.targets.names) <= _MOST_COLUMNS:
        return table
    return table.without("quantities", *(c.key for c in table.columns if c.key.startswith("error of ")))
