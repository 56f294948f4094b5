"""A flexible aircraft in sentences: what was coupled, and from what speed on it flutters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.page.tables import Column, Table
from testbench.questions.aircraft.answer import onset_sentences

if TYPE_CHECKING:
    from testbench.aircraft.strips.flexible import Flexible
    from testbench.questions.aircraft.flexible.ask import FlexibleAnswer


def flexible_answer(found: FlexibleAnswer) -> list[str]:
    """Return what was found, the most important first."""
    made, range_ = found.made, found.survey.range
    elastic = made.aircraft.elastic
    assert elastic is not None
    count = len(elastic)
    out = onset_sentences(found.survey.envelope)
    out.append(f"it trims from {range_.slowest:g} to {range_.fastest:g} m/s at {found.survey.envelope.h_m:g} m")
    matched = [c for c in made.strips.constants if c.source.startswith("the aircraft's own")]
    if matched:
        out.append(
            f"{len(matched)} constants of the strips are chosen to reproduce the aircraft's own derivatives: "
            + ", ".join(c.source.removeprefix("the aircraft's own ") for c in matched)
        )
    evidence = found.test.content.evidence
    masses = dict.fromkeys(o.mass for o in made.origins)
    out.append(
        f"frequency, damping and shape of {'the mode' if count == 1 else f'all {count} modes'} are {evidence}; "
        f"generalised masses: {'; '.join(masses)}"
    )
    return [*out, *made.notes]


# --- tables -----------------------------------------------------------------------------------------------------------


def constant_table(made: Flexible) -> Table:
    """Return every constant of the strips with its source."""
    columns = (
        Column("constant", "constant", get="name"),
        Column("value", "value", digits=4),
        Column("unit", "unit"),
        Column("source", "from"),
    )
    caption = "Data of the strips."
    return Table.of("strips", "Constants of the strips", caption, columns, made.strips.constants)


def compared_table(made: Flexible) -> Table:
    """Return the rigid derivatives of the aircraft and those that the strips give."""
    columns = (
        Column("derivative", "derivative", get="name"),
        Column("own", "the aircraft's own", digits=4),
        Column("strips", "strips", digits=4),
    )
    caption = (
        "Derivatives of the rigid aircraft by the strips. A difference from the aircraft's own indicates an error "
        "of the modes' coefficients."
    )
    return Table.of("derivatives", "Rigid derivatives", caption, columns, made.strips.compared)
