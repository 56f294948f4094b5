"""The recorded flight against the aircraft as it was and as it is amended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.figure import COLOURS, DASHED, MEASURED, Chart, Curve, Panel, Plate, within
from testbench.page.labels import axis_label, shown_unit
from testbench.questions.identify.amend.tables import USES

if TYPE_CHECKING:
    from testbench.questions.identify.amend.result import Amended, Replay

_MOST = 3  # records drawn


def amended_plates(amended: Amended) -> list[Plate]:
    """Return the plate of the flights against both; none if no record was flown."""
    drawn = _drawn(amended)
    if not drawn:
        return []
    looks: list[dict[str, Any]] = [
        {"name": "measured", "colour": MEASURED, "width": 1.5},
        {"name": f"{amended.old.name}, as it was", "colour": COLOURS[1], "width": 1.2, "dash": DASHED},
        {"name": f"{amended.name}, amended", "colour": COLOURS[0]},
    ]
    caption = (
        f"Grey: measured, prepared. Both aircraft are flown by JSBSim with the recorded inputs from trim in still air; "
        "the state that a record begins with and constants of inputs and outputs are fitted, of both alike. Records "
        f"that were not used took no part in making {amended.name}."
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
