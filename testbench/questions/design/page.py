"""The report of a design: files, page, and the answer in a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.page.labels import file_stem, number, symbol
from testbench.page.tables import Column, Table, Value
from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.design.answer import design_sentences, family_label, is_ratio, peak_words

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.design.ask import DesignResult, Ranked
    from testbench.questions.design.problem import Design

_MOST_COLUMNS = 5  # targets beyond which a terminal shows the criterion alone
_DEFAULTS = {"start_s", "repeats", "spacing", "fade_s", "periods", "stride", "first", "powers", "bits", "seed"}


def write_design(result: DesignResult, folder: Path | str) -> list[Path]:
    """Write tables, figures, designs/*.toml that `testbench run` flies, signals/*.csv and *.mat, and report.html.

    Returns:
        The paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.page.html import render
    from testbench.questions.design.figures import design_plates

    folder = Path(folder)
    tables = design_tables(result)
    out = write_tables(tables, folder)
    paths, pictures = write_plates(design_plates(result), folder)
    out += paths
    ready = write_inputs(result, folder)
    out += ready
    file = result.scenario.file
    page = render(
        "questions/design/page.html.j2",
        result=result,
        answer=design_sentences(result),
        tables=tables,
        pictures=pictures,
        ready=[str(path.relative_to(folder)) for path in ready],
        limits=limit_rows(result),
        source_text=file.read_text(encoding="utf-8") if file else result.scenario.model_dump_json(indent=1),
    )
    out.append(write_file(folder / PAGE, page))
    return out


def write_inputs(result: DesignResult, folder: Path) -> list[Path]:
    """Write every ranked design as a scenario for `testbench run` and as a signal; return the paths."""
    from testbench.core.record import FlightRecord

    out = []
    ranked = [*enumerate(result.ranking, 1), *([("shortest", result.shortest)] if result.shortest else [])]
    for rank, entry in ranked:
        design = entry.design
        stem = file_stem(f"{rank}_{family_label(design.family)}".replace("shortest_shortest", "shortest"))
        out.append(write_file(folder / "designs" / f"{stem}.toml", scenario_toml(result, design)))
        channels = tuple(f"{c}_cmd" for c in design.controls)
        t = np.arange(len(design.u)) / result.problem.rate_hz
        rows = t < design.duration_s - 1e-9
        record = FlightRecord(
            t[rows], channels, design.u[rows], "truth", provenance={"signal": "deviation from trim", "held": True}
        )
        out.append(record.save_csv(folder / "signals" / f"{stem}.csv"))
        out.append(record.save_mat(folder / "signals" / f"{stem}.mat"))
    return out


def scenario_toml(result: DesignResult, design: Design) -> str:
    """Return a design as the text of a scenario: flown for identification, another input for validation."""
    s = result.scenario
    judge = next((r.design for r in result.ranking if r.design.family != design.family), design)
    inputs = [c if c in result.suite.channels else f"{c}_cmd" for c in design.controls]
    wings = [] if s.wings == "flexible" else [f'wings = "{s.wings}"']
    rate = [] if s.simulation.rate_hz is None else [f"rate_hz = {s.simulation.rate_hz:g}"]
    lines = [
        f"# Designed input: {family_label(design.family)}, {design.words}. Predicted standard errors:",
        *(f"#   {text}" for text in _error_lines(result, design)),
        f"title = {_text(f'{s.title}: {family_label(design.family)}')}",
        f'aircraft = "{s.aircraft}"',
        *wings,
        f"seed = {s.seed}",
        f"suites = [{', '.join(_text(name) for name in s.suites[:1])}]",
        "",
        "[condition]",
        f"V_m_s = {float(s.condition.V_m_s)!r}",
        f"h_m = {float(s.condition.h_m)!r}",
        f"gamma_deg = {float(s.condition.gamma_deg)!r}",
        "",
        "[simulation]",
        *rate,
        f"log_rate_hz = {result.problem.rate_hz!r}",
    ]
    for use, one in (("identification", design), ("validation", judge)):
        start = result.problem.start_s
        lines += [
            "",
            "[[manoeuvre]]",
            f"name = {_text(family_label(one.family) + ('' if use == 'identification' else ' to judge'))}",
            f'use = "{use}"',
            f"duration_s = {round(one.duration_s - start, 6)!r}",
            f"settle_s = {round(start, 6)!r}",
        ]
        for spec in one.specs:
            lines += ["[[manoeuvre.input]]", *_entry(spec, start)]
    lines += ["", "[identification]", f"inputs = [{', '.join(_text(i) for i in inputs)}]", *_estimator(result)]
    return "\n".join(lines) + "\n"


def _error_lines(result: DesignResult, design: Design) -> list[str]:
    t = result.problem.targets
    return [
        f"{name}: {number(100 * e / abs(v))} %" if is_ratio(name) else f"{name}: {number(e)}"
        for name, e, v in zip(t.names, design.errors, t.values, strict=True)
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
        return _text(value)
    return repr(value) if isinstance(value, int) else repr(float(value))


def _text(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _estimator(result: DesignResult) -> list[str]:
    elastic = result.aircraft.flown_modes()
    names = {m.name for m in elastic.modes} if elastic else set()
    order = 4 + 2 * sum(m in names for m in result.scenario.targets.modes)
    if any(s.rate_hz not in (None, result.suite.rate_hz) for s in result.suite.sensors):
        return [
            "[[identification.estimators]]",
            'method = "transfer_function"',
            f"poles = {order}",
            "zeros = [1, 2, 3]",
        ]
    horizon = max(2 * order, round(0.5 * result.suite.rate_hz))
    return [
        "[[identification.estimators]]",
        'method = "dsr_e"',
        f"order = {order}",
        f"past_horizon = {horizon}",
        f"future_horizon = {horizon}",
    ]


# --- tables -----------------------------------------------------------------------------------------------------------


def design_tables(result: DesignResult) -> list[Table]:
    """Return the ranking, the energy in the modes, what was screened, and what stands in the way."""
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
        f"Each at its largest admissible amplitude in the nonlinear simulator. Criterion {result.scenario.criterion}: "
        "in units of the wanted errors, 1 or less reaches them. Standard errors are Cramér-Rao bounds for these "
        "sensors with unknown offsets, every other free parameter estimated along."
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
    """Return what each design does to each mode: share of its energy and signal-to-noise ratio at the best sensor."""
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
        "the linearised aircraft allows: by spectral energy at the sensors, and by information."
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
        "The same input, one hindrance taken away at a time: a sensor's noise to a hundredth, or the binding limit."
    )
    return Table("obstacles", "What stands in the way of more", caption, columns, rows)


def limit_rows(result: DesignResult) -> list[str]:
    """Return the limits that were kept, in words."""
    out = []
    for name, (low, high) in result.envelope.bands.items():
        if name == "az":
            out.append(f"load factor {-high / 9.80665:.3g} to {-low / 9.80665:.3g}")
            continue
        scale, unit = _unit(name)
        out.append(f"{symbol(name)} {low / scale:.4g} to {high / scale:.4g} {unit}".strip())
    out += [f"rate of {symbol(n)} up to {most / DEG_RAD:.4g} deg/s" for n, (_, most) in result.envelope.rates.items()]
    return [text.replace("-", "−") for text in out]


def _unit(name: str) -> tuple[float, str]:
    from testbench.core.channels import channel

    unit = channel(name).unit
    if unit == "rad":
        return DEG_RAD, "deg"
    return (PERCENT, "%") if name == "thr" else (1.0, "" if unit == "1" else unit)


def print_design(result: DesignResult, console: Console, folder: Path | str | None = None) -> None:
    """Print the recommendation, the ranking, and where the files are."""
    from rich.table import Table as RichTable
    from rich.text import Text

    console.print(Text(result.scenario.title, style="bold underline"))
    answer = RichTable.grid(padding=(0, 1))
    for i, sentence in enumerate(design_sentences(result)):
        answer.add_row("-", Text(sentence, style="bold" if i == 0 else ""))
    console.print(answer)
    table = ranking_table(result)
    shown = RichTable(box=None, pad_edge=False)
    left_out = {"record", "note"} | ({"quantities"} if len(result.problem.targets.names) > _MOST_COLUMNS else set())
    kept = [i for i, c in enumerate(table.columns) if c.key not in left_out]
    if len(result.problem.targets.names) > _MOST_COLUMNS:
        kept = [i for i in kept if not table.columns[i].key.startswith("error of ")]
    for i in kept:
        column = table.columns[i]
        shown.add_column(f"{column.head} {column.unit}".strip(), overflow="fold")
    for row in table.cells():
        shown.add_row(*(Text(row[i][0]) for i in kept))
    console.print()
    console.print(shown)
    if folder is not None:
        console.print()
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)
        console.print(Text(f"Ready to fly: testbench run {Path(folder) / 'designs'}/1_*.toml"), soft_wrap=True)
