"""Tables of a design: the ranking, the energy in the modes, what was screened, what prevents more accuracy."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from testbench.design.realise import FALSE_ALARM, INTERVAL, TRUST
from testbench.page.labels import number, symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.design.answer import air_words, family_label, is_ratio, peak_words

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.design.problem import Problem
    from testbench.questions.design.known import Known
    from testbench.questions.design.result import DesignResult

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


def _columns(group: str = "", digits: int = 3, **heads: str) -> list[Column]:
    """Return columns by key and head."""
    return [Column(key, head, "", group, digits=digits) for key, head in heads.items()]


def _errors(name: str, value: float, *errors: float) -> tuple[str, str, list[float | None]]:
    """Return a target, the unit of its errors and the errors in it: percent of the value but for damping ratios."""
    factor = 100.0 / abs(value) if is_ratio(name) else 1.0
    return name, "%" if is_ratio(name) else "", [float(factor * e) if np.isfinite(e) else None for e in errors]


def ranking_table(result: DesignResult) -> Table:
    """Return every design flown, best first, with predicted standard errors and the limit that binds."""
    t, drawn = result.problem.targets, result.best.over is not None
    columns = [
        Column("rank", "", given=True),
        *_columns(signal="signal", quantities="free quantities", peak="peak command"),
        Column("end", "input ends", "s", decimals=2),
        Column("record", "record ends", "s", decimals=2),
        Column("worst", "criterion", "", digits=3),
    ]
    if drawn:
        columns += [Column("median", "median", "", _DRAWN), Column("worst of draws", "worst", "", _DRAWN)]
    for name, value, wanted in zip(t.names, t.values, t.wanted, strict=True):
        _, unit, (shown,) = _errors(name, value, wanted)
        words = f"{unit} (wanted {shown:.3g})".lstrip()
        columns.append(Column(f"error of {name}", name, words, "predicted standard errors", digits=2))
    columns += [Column("limit", "limit met", "", "flown"), Column("share", "used", "%", "flown", decimals=0)]
    columns += [Column("note", "at the linear prediction's amplitude", "", "flown")]
    entries = [(str(rank), entry) for rank, entry in enumerate(result.ranking, 1)]
    entries += [("shortest", result.shortest)] if result.shortest is not None else []
    entries += [("rejected", flown) for flown in result.rejected]
    rows: list[tuple[Value, ...]] = []
    for rank, f in entries:
        d = f.design
        head = (rank, family_label(d.family), d.words, peak_words(d), d.end_s, d.duration_s, float(d.cost))
        costs: tuple[Value, ...] = (f.over.rank[::-1] if f.over else (None, None)) if drawn else ()
        each = zip(t.names, t.values, d.errors, strict=True)
        errors = [float(100.0 * e / abs(v)) if is_ratio(n) else float(e) for n, v, e in each]
        limit = limit_symbol(f.tightest.name), 100.0 * f.tightest.share, f.breach or "all limits kept"
        rows.append((*head, *costs, *errors, *limit))
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
    t, flown = problem.targets, [] if after is None or alone is None else [alone, after]
    columns = _columns(target="target", unit="unit", model="value of the model", value="value now")
    columns += _columns(digits=2, wanted="wanted error", now="known now")
    columns += _columns(digits=2, alone="this flight alone", after="after this flight") if flown else []
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(t.names if known is not None else ()):
        assert known is not None
        _, unit, cells = _errors(name, t.values[k], *(e[k] for e in (t.wanted, known.errors, *flown)))
        met = "met after this flight" if flown and flown[1][k] <= t.wanted[k] else "not met"
        met = "met" if known.errors[k] <= t.wanted[k] else met
        model = float(known.before[k]) if np.isfinite(known.before[k]) else None
        rows.append((name, unit, model, float(t.values[k]), *cells, met))
    caption = (
        "Standard errors by all flights before, by this flight alone (realised where it was realised), and by both "
        "together. The input is designed at the values that are believed now: those of the flights, and of the model "
        "where they hardly tell."
    )
    columns += _columns(verdict="verdict")
    return Table("known", "Known now, promised after this flight", caption, tuple(columns), tuple(rows))


def draws_table(result: DesignResult) -> Table:
    """Return the errors of the recommended input over the drawn aircraft; without draws a table without rows."""
    t, over = result.problem.targets, result.best.over
    columns = _columns(target="target", unit="unit") + _columns(digits=2, wanted="wanted", believed="believed aircraft")
    columns += _columns(_DRAWN, 2, median="median", worst="worst") + _columns(
        _DRAWN, reached="reach it", have="have it"
    )
    rows: list[tuple[Value, ...]] = []
    kinds = [t.wanted, result.best.design.errors]
    kinds += [over.told.over(how) * t.wanted for how in (np.median, np.max)] if over is not None else []
    for k, name in enumerate(t.names if over is not None else ()):
        assert over is not None
        name, unit, cells = _errors(name, t.values[k], *(e[k] for e in kinds))
        ratios = over.told.ratios[:, k]
        rows.append((name, unit, *cells, int(np.sum(ratios <= 1.0)), int(np.sum(~np.isnan(ratios)))))
    n = 0 if over is None else len(over.told.costs)
    caption = (
        f"Predicted standard errors of the recommended input over {n} aircraft whose coefficients are drawn, each on "
        f"its own, by the uncertainty that {result.aircraft.name} states. Every one is trimmed and linearised anew. "
        "Errors in percent count from the values of the believed aircraft. A mode that has split into two real roots "
        "keeps wn = sqrt(s1 s2) and zeta = -(s1 + s2) / (2 wn). No prior is counted: output error has none."
    )
    return Table("draws", "Over the aircraft's own uncertainty", caption, tuple(columns), tuple(rows))


def realised_table(result: DesignResult) -> Table:
    """Return promised against realised errors of the designs that were flown and identified; else no rows."""
    t = result.problem.targets
    columns = _columns(signal="signal", target="target", unit="unit")
    columns += _columns(digits=2, wanted="wanted", promised="promised")
    columns += _columns("realised", 2, realised="rms", low="from", high="to", bias="mean")
    columns += _columns(digits=2, stated="stated by the estimator")
    columns += _columns(flights="estimates", failed="none", counts="counts")
    columns += _columns(digits=2, headline="to plan with") + _columns(cause="most of it")
    rows: list[tuple[Value, ...]] = []
    for entry in result.ranking:
        if (r := entry.realised) is None:
            continue
        found, label = r.found, family_label(entry.design.family)
        kinds = (t.wanted, r.promised, found.rms, *found.interval(), found.bias, found.claimed, r.headline)
        for k, name in enumerate(t.names):
            _, unit, (*cells, head) = _errors(name, t.values[k], *(e[k] for e in kinds))
            counts = "realised" if r.differs[k] else "both"
            rows.append((label, name, unit, *cells, found.n, len(found.failed), counts, head, r.cause(k)))
    caption = (
        f"Flown in {air_words(result)}, sensed by the suite and identified by the estimator of the scenario. Promised: "
        "by information in that air, and by what the estimates are off by without noise. The interval holds "
        f"{100 * INTERVAL:g} % for normal errors. Realised errors count where they contradict the promise: chi-square, "
        f"probability of a false alarm {100 * FALSE_ALARM:g} % per design. Elsewhere both count, the promise like "
        f"{TRUST} flights."
    )
    return Table("realised", "Promised and realised", caption, tuple(columns), tuple(rows), wide=True)


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
    columns = _columns(aircraft="aircraft", target="target", unit="unit", value="true value")
    columns += _columns(digits=2, predicted="predicted", realised="realised rms", bias="realised mean")
    columns += [*_columns(flights="estimates", limit="limit met"), Column("used", "used", "%", decimals=0)]
    rows: list[tuple[Value, ...]] = []
    for e in result.elsewhere:
        if e.found is None or e.values is None or e.predicted is None or e.flight is None:
            continue
        limit = limit_symbol(e.flight.tightest.name), 100.0 * e.flight.tightest.share
        for k, name in enumerate(result.problem.targets.names):
            _, unit, cells = _errors(name, e.values[k], e.predicted[k], e.found.rms[k], e.found.bias[k])
            rows.append((e.what, name, unit, float(e.values[k]), *cells, e.found.n, *limit))
    caption = (
        "The commands of the recommended input with an aircraft that is not the believed one; the estimator is that of "
        "the scenario, which holds what it does not estimate at the believed values. Limits are those of one flight in "
        "still air."
    )
    return Table("elsewhere", "If the fast mode lies elsewhere", caption, tuple(columns), tuple(rows), wide=True)


def limit_symbol(name: str) -> str:
    """Return a limit's name with the symbol of its channel."""
    for kind in ("rate of ", "command of "):
        if name.startswith(kind):
            return kind + symbol(name.removeprefix(kind))
    return "load factor" if name == "az" else symbol(name) if name else "aborted"


def energy_table(result: DesignResult) -> Table:
    """Return for each design and mode the share of its energy and the signal-to-noise ratio at the best sensor."""
    energies = [result.energy(entry.design) for entry in result.ranking]
    modes = energies[0].modes
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
    for rank, (entry, e) in enumerate(zip(result.ranking, energies, strict=True), 1):
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
