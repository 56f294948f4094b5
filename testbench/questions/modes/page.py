"""The report on modes found without an input: tables, the answer in sentences, files and page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.words import with_error
from testbench.estimators.operational.advice import ASSUMPTION
from testbench.page.labels import number
from testbench.page.tables import Column, Table, Value
from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.modes.figures import modes_plates

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.estimators.operational import OperationalMode
    from testbench.evaluation.operational import ModeMatch
    from testbench.questions.modes.ask import ModesResult


def modes_answer(result: ModesResult) -> list[str]:
    """Return what was found, how it compares with the aircraft, and what it rests on, in sentences."""
    found = result.found
    q = found.quantile
    pieces = [f"{_frequency(m, q)} with damping {_damping(m, q)}" for m in found.modes]
    many = f"{len(found.modes)} mode{'s' if len(found.modes) > 1 else ''}"
    out = [
        f"{many} in {found.duration_s:.0f} s of {len(found.channels)} outputs, with 95 % intervals: {'; '.join(pieces)}"
    ]
    out += [_judged(match, q) for match in result.matches if match.true is not None and match.found is not None]
    band = found.settings["band_hz"]
    lost = [m.true for m in result.matches if m.found is None and m.true is not None]
    inside = [t.name for t in lost if band[0] <= abs(t.pole) / (2.0 * np.pi) <= band[1]]
    if inside:
        out.append(f"not found, though inside the band: {'; '.join(inside)}")
    foreign = [m.found for m in result.matches if m.true is None and m.found is not None]
    out += [f"no mode of the linear model stands behind the one at {number(m.frequency_hz)} Hz" for m in foreign]
    text = ASSUMPTION
    if result.corners_hz:
        corners = " and ".join(dict.fromkeys(number(f, 2) for f in result.corners_hz))
        text += f"; the spectra of this turbulence bend at {corners} Hz"
    return [*out, text, *found.advice]


def _frequency(mode: OperationalMode, q: float) -> str:
    return f"{with_error(mode.frequency_hz, q * mode.frequency_std_hz)} Hz"


def _damping(mode: OperationalMode, q: float) -> str:
    return with_error(mode.damping, q * mode.damping_std)


def _judged(match: ModeMatch, q: float) -> str:
    assert match.true is not None
    assert match.found is not None
    assert match.mac is not None
    wn, zeta = abs(match.true.pole), -match.true.pole.real / abs(match.true.pole)
    inside = [
        abs(match.found.frequency_hz - wn / (2.0 * np.pi)) <= q * match.found.frequency_std_hz,
        abs(match.found.damping - zeta) <= q * match.found.damping_std,
    ]
    words = {2: "both inside", 1: "one of them outside", 0: "both outside"}[sum(inside)]
    return (
        f"{match.true.name}: the linear model has {number(wn / (2.0 * np.pi))} Hz and damping {number(zeta)}, {words} "
        f"of the intervals; MAC of the shapes {match.mac:.3f}"
    )


def modes_tables(result: ModesResult) -> list[Table]:
    """Return the modes, their comparison with the linear model if there is one, and their shapes."""
    out = [_modes_table(result)]
    if result.true:
        out.append(_comparison_table(result))
    return [*out, _shape_table(result)]


def _modes_table(result: ModesResult) -> Table:
    columns = (
        Column("mode", "mode"),
        Column("frequency", "frequency", "Hz", digits=4),
        Column("frequency_std", "its std", "Hz", digits=2),
        Column("damping", "damping ratio", digits=3),
        Column("damping_std", "its std", digits=2),
        Column("orders", "orders"),
        Column("remarks", "what is doubtful"),
    )
    rows = tuple(
        (k, m.frequency_hz, m.frequency_std_hz, m.damping, m.damping_std, len(m.orders), "; ".join(m.remarks) or None)
        for k, m in enumerate(result.found.modes, 1)
    )
    criteria = result.found.settings["criteria"]
    caption = (
        f"Standard deviations from {result.found.blocks} blocks of data; an interval of 95 % is "
        f"{result.found.quantile:.2f} of them either way. Orders: at how many of {len(result.found.views)} "
        f"orders the mode was stable (frequency within {100 * criteria['frequency']:g} %, damping within "
        f"{100 * criteria['damping']:g} %, MAC at least "
        f"{criteria['mac']:g} from order to order); fewer than {criteria['least_orders']} are not reported, nor modes "
        f"whose errors exceed {100 * criteria['frequency_error']:g} % in frequency or "
        f"{100 * criteria['damping_error']:g} % in damping."
    )
    return Table("modes", "Modes found", caption, columns, rows, wide=True)


def _comparison_table(result: ModesResult) -> Table:
    columns = (
        Column("mode", "mode"),
        Column("true_frequency", "model", "Hz", "frequency", digits=4),
        Column("frequency", "found", "Hz", "frequency", digits=4),
        Column("frequency_error", "error", "%", "frequency", decimals=1),
        Column("frequency_error_std", "error / std", "", "frequency", decimals=1),
        Column("true_damping", "model", "", "damping ratio", digits=3),
        Column("damping", "found", "", "damping ratio", digits=3),
        Column("damping_error_std", "error / std", "", "damping ratio", decimals=1),
        Column("mac", "MAC", decimals=3),
    )
    rows: list[tuple[Value, ...]] = []
    for match in result.matches:
        t, m = match.true, match.found
        f = abs(t.pole) / (2.0 * np.pi) if t else None
        z = -t.pole.real / abs(t.pole) if t else None
        rows.append(
            (
                t.name if t else "none of the linear model",
                f,
                m.frequency_hz if m else None,
                100.0 * (m.frequency_hz / f - 1.0) if m and f else None,
                _in_std(m.frequency_hz, f, m.frequency_std_hz) if m else None,
                z,
                m.damping if m else None,
                _in_std(m.damping, z, m.damping_std) if m else None,
                match.mac,
            )
        )
    caption = (
        "Oscillatory modes of the aircraft linearised at trim beside those found. MAC: likeness of the shapes at the "
        "sensors, outputs divided by their rms."
    )
    return Table("modes_and_model", "Modes found and those of the linear model", caption, columns, tuple(rows))


def _in_std(value: float, true: float | None, std: float) -> float | None:
    return None if true is None or std == 0.0 else (value - true) / std


def _shape_table(result: ModesResult) -> Table:
    modes = result.found.modes
    columns = [Column("channel", "channel")]
    for k in range(1, len(modes) + 1):
        columns.append(Column(f"magnitude_{k}", "magnitude", "", f"mode {k}", digits=3))
        columns.append(Column(f"phase_{k}", "phase", "deg", f"mode {k}", decimals=0))
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (name, *(x for m in modes for x in (float(abs(m.shape[i])), float(np.degrees(np.angle(m.shape[i]))))))
        for i, name in enumerate(result.found.channels)
    )
    caption = (
        "SI units of the channels, over the output that moves most for its rms. Phases near 0 or 180 deg: a real shape."
    )
    return Table("shapes", "Mode shapes", caption, tuple(columns), rows)


def write_modes(result: ModesResult, folder: Path | str) -> list[Path]:
    """Write tables, figures, models/modes.json and report.html; return the paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.page.html import render

    folder, tables = Path(folder), modes_tables(result)
    out = write_tables(tables, folder)
    content = json.dumps(result.found.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    out.append(write_file(folder / "models" / "modes.json", content))
    paths, pictures = write_plates(modes_plates(result), folder)
    page = render(
        "analysis.html.j2",
        kicker=f"Operational modes: {result.name}",
        title=result.title,
        answer=modes_answer(result),
        pictures=pictures,
        tables=tables,
        source_name=f"{result.name}.toml" if result.source else "records",
        source_text=result.source or "\n".join(result.records),
    )
    return [*out, *paths, write_file(folder / PAGE, page)]


def print_modes(result: ModesResult, console: Console, folder: Path | str) -> None:
    """Print the answer, the table of modes and where the files are."""
    from rich.table import Table as Grid
    from rich.text import Text

    answer = Grid.grid(padding=(0, 1))
    for sentence in modes_answer(result)[1:]:
        answer.add_row("-", Text(sentence[:1].upper() + sentence[1:] + ("" if sentence.endswith(".") else ".")))
    shown = _modes_table(result)
    table = Grid(title=shown.title, title_justify="left", title_style="", box=None, pad_edge=False)
    for column in shown.columns[:-1]:
        table.add_column(column.head + (f", {column.unit}" if column.unit else ""), justify="right")
    for row in shown.cells():
        table.add_row(*(text for text, _ in row[:-1]))
    console.print(Text(result.title, style="bold underline"))
    console.print(table)
    console.print()
    console.print(answer)
    console.print()
    console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)
