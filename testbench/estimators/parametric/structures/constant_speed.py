"""Whether the speed stayed constant enough for a structure that leaves it out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.advice import Advice, doubt
from testbench.core.record import FlightRecord, FloatArray

_SHARE = 0.3  # of the change of the flight path that speed alone makes
_G = 9.81


def speed_doubts(records: Sequence[FlightRecord], V_m_s: float | None) -> list[Advice]:
    """Return the doubt that a short-period model without airspeed takes up what the airspeed did.

    Lift grows with the square of speed, so that a speed V0 + v bends the flight path by 2 g v / V0^2. Its integral is
    compared with alpha less the integral of q, which is what the normal force did to the path altogether; a straight
    line is removed from both, since trims and biases make one.

    Args:
        records: prepared, with V, alpha and q; others say nothing.
        V_m_s: trimmed airspeed V0; None: the mean that was removed from V.
    """
    shares, moved = [], []
    for record in records:
        speed = V_m_s or dict(record.provenance.get("prepared", {}).get("removed", {})).get("V")
        if not speed or any(name not in record.channels for name in ("V", "alpha", "q")):
            continue
        part = record.select(("V", "alpha", "q"))
        V, alpha, q = (np.where(ok, z, 0.0) for z, ok in zip(part.data.T, part.valid.T, strict=True))
        V = V - speed if abs(float(np.mean(V))) > 0.5 * speed else V
        by_speed = _bent(np.cumsum(2.0 * _G * V / speed**2) * record.dt_s)
        whole = _bent(alpha - np.cumsum(q) * record.dt_s)
        if whole > 0.0:
            shares.append(by_speed / whole)
            moved.append(float(np.std(V)) / speed)
    if not shares or float(np.median(shares)) < _SHARE:
        return []
    return [
        doubt(
            "speed_left_out",
            f"the structure leaves out the airspeed, which varied by {100 * float(np.median(moved)):.1f} % (rms) and "
            f"by lift alone bent the path {float(np.median(shares)):.1f} times as much as all that was measured: "
            "Z_alpha, Z_q and what depends on them are biased beyond their errors; estimate V and theta too (leave out "
            "short), or identify from a few seconds after a fast input",
        )
    ]


def _bent(angle: FloatArray) -> float:
    """Return the root mean square of an angle (N,) about its straight line."""
    t = np.linspace(-1.0, 1.0, angle.size)
    return float(np.std(angle - np.polyval(np.polyfit(t, angle, 1), t)))
