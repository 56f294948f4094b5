"""The tables of an amendment: derivatives aimed at and reached, coefficients, servos, and how far the flights miss."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.core.constants import PERCENT
from testbench.page.labels import shown_unit, symbol
from testbench.page.tables import Column, Table, Value

if TYPE_CHECKING:
    from testbench.questions.identify.amend.result import Amended

USES = {"identification": "used for identification", "validation": "not used"}


def amended_tables(amended: Amended) -> list[Table]:
    """Return every table of an amendment that has rows."""
    tables = [_aims(amended), _coefficients(amended), _servos(amended), misses_table(amended)]
    return [t for t in tables if t.rows]


def _aims(amended: Amended) -> Table:
    caption = (
        f"Before: {amended.old.name} at {amended.V_m_s:.4g} m/s and {amended.h_m:.4g} m. Identified: by "
        f"{amended.model}. Aimed: what the aircraft is to have; those left stay what they were, and the "
        "others are what the data give with these fixed there. Reached: "
        f"{amended.name}, loaded from its folder, trimmed and linearised. Off: from the aim."
    )
    columns = (
        Column("derivative", "derivative", get="name"),
        Column("before", "before", digits=4),
        Column("identified", "identified", digits=4),
        Column("std", "± std", digits=2, get=lambda a: a.std or None),
        Column("aimed", "aimed", digits=4),
        Column("reached", "reached", digits=4),
        Column("off", "off", "%", digits=2, get=lambda a: None if a.off is None else a.off / PERCENT),
        Column("unit", "unit", get=lambda a: a.unit or None),
        Column("remark", "remark", get=lambda a: a.why or "as identified"),
    )
    return Table.of("amended", f"{amended.name}: derivatives aimed at and reached", caption, columns, amended.aims)


def _coefficients(amended: Amended) -> Table:
    caption = (
        "What the folder holds: changes of coefficients, so that they scale with dynamic pressure, and by rates with "
        "p b/2V, q c̄/2V, r b/2V. Each vanishes at the trim, which stays. Before and after at the design condition "
        "where the model does not have the coefficient as one number."
    )
    columns = (
        Column("coefficient", "coefficient", get="name"),
        Column("before", "before", digits=4),
        Column("after", "after", digits=4),
        Column("added", "added", digits=4),
    )
    title = f"{amended.name}: coefficients that changed"
    return Table.of("amended_coefficients", title, caption, columns, amended.coefficients)


def _servos(amended: Amended) -> Table:
    columns = (
        Column("control", "control"),
        Column("before", "lag before", "s", get="before_s"),
        Column("lag", "written", "s", get="lag_s"),
        Column("std", "± std", "s", digits=2, get="std_s"),
        Column("reached", "reached", "s", get="reached_s"),
    )
    caption = "Time constants of servos; without ± the description gave it."
    return Table.of("amended_servos", f"{amended.name}: servos", caption, columns, amended.servos)


def misses_table(amended: Amended) -> Table:
    """Return how far each output of both aircraft is from what was measured."""
    rows: list[tuple[Value, ...]] = []
    for use, words in USES.items():
        for m in amended.misses(use):
            factor, unit = shown_unit(m.channel)
            before, after = (None if x is None else factor * x for x in (m.before, m.after))
            share = (None if x is None or not m.size else x / m.size / PERCENT for x in (m.before, m.after))
            rows.append((words, symbol(m.channel), unit, factor * m.size, before, after, *share, m.theil_before,
                         m.theil_after))  # fmt: skip
    columns = (
        Column("records", "records"),
        Column("output", "output"),
        Column("unit", "unit"),
        Column("size", "size"),
        Column("before", "before", group="misses by"),
        Column("after", "after", group="misses by"),
        Column("before_share", "before", "%", group="of the size"),
        Column("after_share", "after", "%", group="of the size"),
        Column("theil_before", "before", group="Theil's U", digits=2),
        Column("theil_after", "after", group="Theil's U", digits=2),
    )
    caption = (
        f"Root mean square of measured minus flown in JSBSim, before by {amended.old.name}, after by {amended.name}: "
        "the recorded inputs from trim, in still air, with the state that a record begins with and a constant of each "
        "input and output fitted, of both alike. Size: of what was measured, about its mean. Theil's U is 0 for equal "
        "and 1 for opposite. The amendment was made without the records that are not used."
    )
    return Table("amended_misses", f"{amended.name}: the flight against both", caption, columns, tuple(rows))
