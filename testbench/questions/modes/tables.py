"""Tables of modes found without an input: frequencies and dampings, the linear model beside them, shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.estimators.operational.onset import tracked
from testbench.page.tables import Column, Table, Value

if TYPE_CHECKING:
    from testbench.questions.modes.result import ModesResult


def modes_tables(result: ModesResult) -> list[Table]:
    """Return the modes, their comparison with the linear model if there is one, and their shapes."""
    out = [*([trend_table(result)] if result.at else []), modes_table(result)]
    if result.true:
        out.append(_comparison_table(result))
    return [*out, _shape_table(result)]


def modes_table(result: ModesResult) -> Table:
    """Return frequency and damping of every mode with their errors."""
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
        f"Standard deviations come from {result.found.blocks} blocks of data; a 95 % interval reaches "
        f"{result.found.quantile:.2f} of them either way. Orders: at how many of {len(result.found.views)} "
        f"orders the mode was stable (frequency within {100 * criteria['frequency']:g} %, damping within "
        f"{100 * criteria['damping']:g} %, MAC at least {criteria['mac']:g} from order to order). A mode is reported "
        f"if it was stable at {criteria['least_orders']} orders or more and its standard deviations are at most "
        f"{100 * criteria['frequency_error']:g} % in frequency and {100 * criteria['damping_error']:g} % in damping."
    )
    return Table("modes", "Modes found", caption, columns, rows, wide=True)


def trend_table(result: ModesResult) -> Table:
    """Return frequency and damping of each mode at each speed of a build-up."""
    tracks = result.onset.tracks if result.onset is not None else tracked(list(result.at.values()))
    columns = [Column("V", "V", "m/s", digits=4)]
    for k in range(1, len(tracks) + 1):
        columns.append(Column(f"frequency_{k}", "frequency", "Hz", f"mode {k}", digits=4))
        columns.append(Column(f"frequency_std_{k}", "its std", "Hz", f"mode {k}", digits=2))
        columns.append(Column(f"damping_{k}", "damping ratio", "", f"mode {k}", digits=3))
        columns.append(Column(f"damping_std_{k}", "its std", "", f"mode {k}", digits=2))
    rows: list[tuple[Value, ...]] = []
    for i, V in enumerate(result.at):
        here = [t[i] for t in tracks]
        cells = [(m.frequency_hz, m.frequency_std_hz, m.damping, m.damping_std) if m else (None,) * 4 for m in here]
        rows.append((V, *(x for four in cells for x in four)))
    caption = (
        "Modes followed from speed to speed by pole and shape; where one has no figures it was not found. Damping "
        "alone may rise until shortly before the onset; frequencies that come together are the earlier sign."
    )
    return Table("trend", "Modes over speed", caption, tuple(columns), tuple(rows), wide=True)


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
        "SI units of the channels, divided by the output that moves most for its rms. Phases near 0 or 180 deg mean a "
        "real shape."
    )
    return Table("shapes", "Mode shapes", caption, tuple(columns), rows)
