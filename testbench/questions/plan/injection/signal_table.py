"""A planned input as a table that any autopilot, script or ground station can play back."""

from __future__ import annotations

import csv
import io

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.inputs import InputSignal, build
from testbench.questions.plan.response import scaled
from testbench.questions.plan.result import Card

SURFACES = ("de", "da", "dr")


def injected_signal(card: Card, period_ms: int) -> InputSignal:
    """Return what a card commands, sampled every ``period_ms`` and held; deviations from trim, SI.

    Raises:
        ScenarioError: the input cannot be sampled so slowly.
    """
    factor = card.factor if card.factor > 0.0 else 1.0
    return build(scaled(card.spec.input, factor), card.spec.duration_s, 1e3 / period_ms)


def signal_csv(signal: InputSignal, aircraft: Aircraft) -> str:
    """Return a signal as CSV: time in s, deviations from trim in deg (throttle in %) and over full deflection, -1 to 1.

    Signs are those of the testbench: elevator trailing edge down, aileron right wing down, rudder trailing edge left.
    Each row holds until the next one. All three surfaces have columns; one that does not move is zero.
    """
    names = (*SURFACES, *(("thr",) if "thr" in signal.channels else ()))
    columns = []
    for name in names:
        moved = name in signal.channels
        columns.append(signal.u[:, signal.channels.index(name)] if moved else np.zeros(len(signal.t_s)))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    shown = [f"{n}_percent" if n == "thr" else f"{n}_deg" for n in names]
    writer.writerow(["time_s", *shown, *(f"{n}_norm" for n in names)])
    units = [PERCENT if n == "thr" else DEG_RAD for n in names]
    ends = [
        (aircraft.controls[n].low, aircraft.controls[n].full) if n in aircraft.controls else (-1.0, 1.0) for n in names
    ]
    for k, t in enumerate(signal.t_s):
        row = [column[k] for column in columns]
        writer.writerow(
            [
                f"{t:.4f}",
                *(f"{v / unit + 0.0:.5f}" for v, unit in zip(row, units, strict=True)),
                *(f"{_share(v, *end) + 0.0:.6f}" for v, end in zip(row, ends, strict=True)),
            ]
        )
    return out.getvalue()


def _share(value: float, low: float, high: float) -> float:
    """Return a deflection as a share of the throw to its side, -1 to 1."""
    return value / high if value >= 0.0 or low >= 0.0 else -value / low
