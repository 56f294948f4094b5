"""Measured frequency responses drawn: magnitude, phase and coherence with their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.estimators.frequency.response import COHERENT, USABLE
from testbench.page.figure import COLOURS, DOTTED, Chart, Curve, Panel, Plate, Rule, Span, bode, unwrapped
from testbench.page.labels import file_stem, ratio_unit, symbol

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.estimators.frequency.response import FrequencyResponse


def response_plates(response: FrequencyResponse) -> list[Plate]:
    """Return one figure per output and input."""
    return [_plate(response, i, j) for i in range(len(response.outputs)) for j in range(len(response.inputs))]


def _plate(response: FrequencyResponse, i: int, j: int) -> Plate:
    output, given = response.outputs[i], response.inputs[j]
    w, H, error = response.omega_rad_s, response.H[:, i, j], response.total_error[:, i, j]
    factor, unit = ratio_unit(output, given)
    name = f"{symbol(output)} / {symbol(given)}"
    caption = (
        f"Response of {symbol(output)} to {symbol(given)} with its error on either side: one standard deviation by "
        f"chance, and what the windows do. Shaded: usable (coherence of at least {COHERENT:g}, error of at most "
        f"{100 * USABLE:g} %). Do not believe the response outside that band."
    )
    size, phase, spread = factor * np.abs(H), unwrapped(H), np.minimum(error, 1.0)
    look: dict[str, Any] = {"colour": COLOURS[0], "width": 1.4}
    magnitude, turn = (
        (size * np.maximum(1.0 - spread, 0.03), size * (1.0 + spread)),
        (phase - np.degrees(spread), phase + np.degrees(spread)),
    )
    usable = _stretches(w, response.usable[:, i, j])
    upper, middle = bode(name, unit, [(w, size, phase, look)], draws=usable, bands=(magnitude, turn))
    lower = Panel(
        draws=[*usable, Curve(x=w, y=response.partial_coherence[:, i, j], **look),
               Rule(at=COHERENT, of="y", dash=DOTTED)],
        title="coherence", x="frequency, rad/s", log_x=True, x_range=(w[0], w[-1]), y_range=(0.0, 1.02), tall_in=0.9,
    )  # fmt: skip
    chart = Chart([[upper], [middle], [lower]], share=0.75, share_x=True)
    return Plate(f"response_{file_stem(output)}_{file_stem(given)}", f"Frequency response {name}", caption, chart)


def _stretches(w: FloatArray, good: np.ndarray) -> list[Span]:
    """Return the stretches of frequencies (n,) that are ``good``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    return [Span(low=float(w[a]), high=float(w[b - 1])) for a, b in edges.reshape(-1, 2)]
