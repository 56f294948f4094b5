"""Tables and figures of an amendment: derivatives aimed at and reached, servos, and the flights beside both."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import PERCENT
from testbench.page.figure import COLOURS, DASHED, MEASURED, Chart, Curve, Panel, Plate, within
from testbench.page.labels import axis_label, shown_unit, symbol
from testbench.page.tables import Column, Table, Value

if TYPE_CHECKING:
    from testbench.questions.identify.amend.result import Amended, Replay


_MOST = 3  # records drawn
USES = {"identification": "used for identification", "validation": "not used"}


def amended_tables(amended: Amended) -> list[Table]:
    """Return every table of an amendment that has rows."""
    tables = [_aims(amended), _coefficients(amended), _servos(amended), misses_table(amended)]
    return [t for t in tables if t.rows]


def _aims(amended: Amended) -> Table:
    caption = (
        f"Before: {amended.old.name} at {amended.V_m_s:.4g} m/s and {amended.h_m:.4g} m. Identified: by "
        f"{amended.model}. Aimed: the wanted value; those left are unchanged, and the others are estimated with these "
        f"fixed. Reached: {amended.name}, loaded from its folder, trimmed and linearised. Off: from the aim."
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
    return Table.of("amended", f"{amended.name}: derivatives, aimed and reached", caption, columns, amended.aims)


def _coefficients(amended: Amended) -> Table:
    caption = (
        "The folder contains changes of coefficients, so that they scale with dynamic pressure, and by rates with p "
        "b/2V, q c̄/2V, r b/2V. Each vanishes at the trim, which is unchanged. Before and after at the design "
        "condition where the model does not have the coefficient as one number."
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
        Column("before", "before", group="rms residual"),
        Column("after", "after", group="rms residual"),
        Column("before_share", "before", "%", group="of the size"),
        Column("after_share", "after", "%", group="of the size"),
        Column("theil_before", "before", group="Theil's U", digits=2),
        Column("theil_after", "after", group="Theil's U", digits=2),
    )
    caption = (
        f"Root mean square of measured minus flown in JSBSim, before by {amended.old.name}, after by {amended.name}: "
        "the recorded inputs from trim, in still air, with the initial state of a record and a constant of each input "
        "and output fitted, for both aircraft alike. Size: of the measured signal, about its mean. Theil's U is 0 for "
        "equal and 1 for opposite. The amendment was made without the records that are not used."
    )
    return Table("amended_misses", f"{amended.name}: both aircraft against the flight", caption, columns, tuple(rows))


# --- figures ----------------------------------------------------------------------------------------------------------


def amended_plates(amended: Amended) -> list[Plate]:
    """Return the plate of the flights against both; none if no record was flown."""
    drawn = _drawn(amended)
    if not drawn:
        return []
    looks: list[dict[str, Any]] = [
        {"name": "measured", "colour": MEASURED, "width": 1.5},
        {"name": f"{amended.old.name}, before", "colour": COLOURS[1], "width": 1.2, "dash": DASHED},
        {"name": f"{amended.name}, amended", "colour": COLOURS[0]},
    ]
    caption = (
        "Grey: measured, prepared. Both aircraft are flown by JSBSim with the recorded inputs from trim in still air; "
        "the initial state of a record and constants of inputs and outputs are fitted, for both alike. Records that "
        f"were not used had no influence on {amended.name}."
    )
    if len(drawn) < len(amended.replays):
        caption += f" Of {len(amended.replays)} records {len(drawn)} are drawn, those not used first."
    longest = max(float(r.t_s[-1]) for r in drawn)
    rows = [[_panel(replay, i, name, looks, longest) for replay in drawn] for i, name in enumerate(drawn[0].channels)]
    title = f"The flight against {amended.old.name} and {amended.name}"
    return [Plate("amended", title, caption, Chart(rows, share_x=True))]


def _panel(replay: Replay, i: int, name: str, looks: list[dict[str, Any]], longest: float) -> Panel:
    """Return one channel of one record; a flight that departs does not hide what was measured."""
    factor = shown_unit(name)[0]
    measured = np.where(replay.valid[:, i], factor * replay.measured[:, i], np.nan)
    flown = [None if x is None else factor * x[:, i] for x in (replay.before, replay.after)]
    curves = [
        Curve(x=replay.t_s, y=y, **look) for y, look in zip((measured, *flown), looks, strict=True) if y is not None
    ]
    shown = [y for y in flown if y is not None]
    return Panel(
        draws=curves, title=f"{replay.name}, {USES[replay.use]}", x="t, s", y=axis_label(name, True), tall_in=1.15,
        broad=max(float(replay.t_s[-1]), 0.35 * longest),
        y_range=within(float(np.nanmin(measured)), float(np.nanmax(measured)), shown, 1.0),
    )  # fmt: skip


def _drawn(amended: Amended) -> list[Replay]:
    order = sorted(amended.replays, key=lambda r: r.use != "validation")
    chosen = order[:_MOST]
    if len(order) > _MOST and all(r.use == "validation" for r in chosen):
        chosen[-1] = next((r for r in order if r.use != "validation"), chosen[-1])
    return chosen
