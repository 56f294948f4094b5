"""Tables of a design: the ranking, the energy in the modes, what was screened, what prevents more accuracy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.labels import number, symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.design.answer import family_label, is_ratio, peak_words

if TYPE_CHECKING:
    from testbench.questions.design.problem import Design
    from testbench.questions.design.result import DesignResult, Ranked

_MOST_COLUMNS = 5  # targets beyond which a terminal shows the criterion alone


def design_tables(result: DesignResult) -> list[Table]:
    """Return the ranking, the energy in the modes, what was screened, and what prevents more accuracy."""
    out = [ranking_table(result), energy_table(result), screening_table(result), obstacle_table(result)]
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
        rows.append((str(rank), *_ranking_row(result, entry.design), *_flown_cells(entry.flown)))
    for flown in result.rejected:
        rows.append(("rejected", *_ranking_row(result, flown.design), *_flown_cells(flown)))
    caption = (
        f"Each design has its largest admissible amplitude in the nonlinear simulator. Criterion "
        f"{result.scenario.criterion}, in units of the wanted errors: at 1 or less they are reached. Standard errors "
        "are Cramér-Rao bounds for these sensors; sensor offsets and all other free parameters are estimated too."
    )
    return Table("ranking", "Designs, ranked", caption, tuple(columns), tuple(rows), wide=True)


def _ranking_row(result: DesignResult, design: Design) -> tuple[Value, ...]:
    t = result.problem.targets
    errors = [
        float(100.0 * e / abs(v)) if is_ratio(n) else float(e)
        for n, e, v in zip(t.names, design.errors, t.values, strict=True)
    ]
    head = (family_label(design.family), design.words, peak_words(design), design.end_s, design.duration_s)
    return (*head, float(design.cost), *errors)


def _flown_cells(flown: Any) -> tuple[Value, ...]:
    return (limit_symbol(flown.tightest.name), 100.0 * flown.tightest.share, flown.breach or "all limits kept")


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
