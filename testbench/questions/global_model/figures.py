"""The functions over alpha with bands, the coefficients felt beside them, and their slopes by what they follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.page.figure import COLOURS, INTERVAL, MEASURED, Curve, Drawn, Panel, Plate, band, grid

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.global_model.result import GlobalFound

_SLOPES = (
    ("CL", "alpha"), ("CL", "de"), ("Cm", "alpha"), ("Cm", "q_hat"), ("Cm", "de"), ("CY", "beta"), ("Cl", "beta"),
    ("Cn", "beta"), ("Cl", "p_hat"), ("Cl", "da"), ("Cn", "r_hat"), ("Cn", "dr"),
)  # fmt: skip
_POINTS = 600  # drawn of what was felt
_STEP = 0.5  # of the half range of a signal, to either side, over which a slope is taken
_ALPHA_STEP = 1.0 * DEG_RAD
_LEAST_SHARE = 0.2  # of a slope, that its panel spans at least
_KEPT = ("V_rel", "de")  # signals of trim, which go with alpha; the others are zero in the figures


def global_plates(found: GlobalFound) -> list[Plate]:
    """Return the coefficients over alpha, and their slopes over alpha."""
    domain, functions = found.model.domain, found.model.functions
    alpha = np.linspace(domain.low, domain.high, 61)
    at = {"alpha": alpha} | {
        s: np.interp(alpha, domain.alpha, domain.middle[:, i]) * (s in _KEPT) for i, s in enumerate(domain.signals)
    }
    flights = [f.signals for f in found.of_use("identification")]
    flown = np.concatenate([f["alpha"] for f in flights]) / DEG_RAD
    some = slice(None, None, max(1, flown.size // _POINTS))
    values, slopes = list[Panel](), list[Panel]()
    for c, f in functions.items():
        felt = np.concatenate([s[c] - f.beside(s) for s in flights])
        points = Curve(x=flown[some], y=felt[some], name="felt", colour=MEASURED, marker=".", size=2.5)
        values.append(_panel(c, alpha, *f.at(at), points))
    for c, s in _SLOPES:
        if s != "alpha" and s not in domain.signals:
            continue
        half = np.full_like(alpha, _ALPHA_STEP)
        if s != "alpha":
            half = _STEP * np.interp(alpha, domain.alpha, domain.half[:, domain.signals.index(s)])
        change, std = functions[c].at({**at, s: at[s] + half}, {**at, s: at[s] - half})
        slopes.append(_panel(f"{c} by {s}", alpha, change / (2.0 * half), std / (2.0 * half)))
    middle = "with the V and de of the middle of the flown domain at that alpha; all other signals are zero"
    return [
        Plate(
            "functions",
            "Coefficients over the angle of attack",
            "Points: coefficients felt in the flights of the fit, at all deflections, rates and sideslips: where data "
            f"lie. Line and band: the function and its 95 % interval {middle}.",
            grid(values, 3),
        ),
        Plate(
            "slopes",
            "Derivatives over the angle of attack",
            "Differences of the functions across half of the flown range of one signal (of alpha, 2 deg), per rad or "
            f"per nondimensional rate, with 95 % intervals, {middle}.",
            grid(slopes, 3),
        ),
    ]


def _panel(title: str, alpha: FloatArray, value: FloatArray, std: FloatArray, *behind: Drawn) -> Panel:
    x, half = alpha / DEG_RAD, INTERVAL * std
    line = Curve(x=x, y=value, colour=COLOURS[0], width=1.4, name="function, 95 %")
    drawn = [*(c.y for c in behind if isinstance(c, Curve)), value - half, value + half]
    low, high = float(min(map(np.min, drawn))), float(max(map(np.max, drawn)))
    room = 0.05 * (high - low) + max(0.0, _LEAST_SHARE * max(abs(low), abs(high)) - (high - low)) / 2.0
    return Panel(
        draws=[*behind, band(x, value - half, value + half, COLOURS[0]), line], title=title, x="alpha, deg",
        y_range=(low - room, high + room),
    )  # fmt: skip
