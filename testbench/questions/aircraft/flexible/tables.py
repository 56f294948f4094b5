"""Tables on what was coupled: constants of the strips, rigid derivatives beside the aircraft's own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.tables import Column, Table

if TYPE_CHECKING:
    from testbench.aircraft.strips.flexible import Flexible


def constant_table(made: Flexible) -> Table:
    """Return every constant of the strips with its source."""
    columns = (
        Column("constant", "constant"),
        Column("value", "value", digits=4),
        Column("unit", "unit"),
        Column("source", "from"),
    )
    rows = tuple((c.name, c.value, c.unit, c.source) for c in made.strips.constants)
    return Table("strips", "Constants of the strips", "What the strips are made of.", columns, rows)


def compared_table(made: Flexible) -> Table:
    """Return the rigid derivatives of the aircraft and those that the strips give."""
    columns = (
        Column("derivative", "derivative"),
        Column("own", "the aircraft's own", digits=4),
        Column("strips", "strips", digits=4),
    )
    rows = tuple((c.name, c.own, c.strips) for c in made.strips.compared)
    caption = (
        "What the strips say of the rigid aircraft; where they differ from its own, so may the modes' coefficients."
    )
    return Table("derivatives", "Rigid derivatives", caption, columns, rows)
