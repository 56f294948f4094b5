"""Measured frequency responses drawn: magnitude, phase and coherence with their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.estimators.frequency.response import COHERENT, USABLE
from testbench.page.labels import file_stem, ratio_unit, symbol
from testbench.page.plot import BAND, COLOURS, QUIET, Plate, grid, label, log_axis, new_figure
from testbench.questions.run.frequency_figures import steps_of_phase

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.estimators.frequency.response import FrequencyResponse


def response_plates(response: FrequencyResponse) -> list[Plate]:
    """Return one figure per output and input."""
    return [_plate(response, i, j) for i in range(len(response.outputs)) for j in range(len(response.inputs))]


def _plate(response: FrequencyResponse, i: int, j: int) -> Plate:
    output, given = response.outputs[i], response.inputs[j]
    w, H, error = response.omega_rad_s, response.H[:, i, j], response.total_error[:, i, j]
    coherence = response.partial_coherence[:, i, j]
    factor, unit = ratio_unit(output, given)
    name = f"{symbol(output)} / {symbol(given)}"
    caption = (
        f"Response of {symbol(output)} to {symbol(given)} with its error on either side: one standard deviation by "
        f"chance, and what the windows do. Shaded: usable (coherence of at least {COHERENT:g}, error of at most "
        f"{100 * USABLE:g} %). Do not believe the response outside that band."
    )

    def make(wide: bool) -> Figure:
        """Draw magnitude, phase and coherence below each other."""
        tall = [1.5, 1.3, 0.9]
        figure = new_figure(wide, 0.25 + sum(tall) + 2 * 0.4 + 0.5, 0.75)
        panels = grid(figure, 0.25, tall, [1.0], gap_in=0.4).ravel()
        magnitude, phase = factor * np.abs(H), np.degrees(np.unwrap(np.angle(H)))
        spread = np.minimum(error, 1.0)
        good = response.usable[:, i, j]
        for axes in panels:
            axes.fill_between(w, 0, 1, where=good, transform=axes.get_xaxis_transform(), color=BAND, linewidth=0)
            log_axis(axes, "x", powers=False)
            axes.set_xlim(w[0], w[-1])
        panels[0].fill_between(
            w, magnitude * np.maximum(1.0 - spread, 0.03), magnitude * (1.0 + spread), color=COLOURS[0], alpha=0.25
        )
        panels[0].plot(w, magnitude, color=COLOURS[0], linewidth=1.4)
        log_axis(panels[0], "y", powers=True)
        degrees = np.degrees(spread)
        panels[1].fill_between(w, phase - degrees, phase + degrees, color=COLOURS[0], alpha=0.25, linewidth=0)
        panels[1].plot(w, phase, color=COLOURS[0], linewidth=1.4)
        panels[1].yaxis.set_major_locator(steps_of_phase(panels[1].get_ylim()))
        panels[2].plot(w, coherence, color=COLOURS[0], linewidth=1.4)
        panels[2].axhline(COHERENT, color=QUIET, linewidth=0.8, linestyle=":")
        panels[2].set_ylim(0.0, 1.02)
        label(panels[0], "", unit, f"{name}, magnitude")
        label(panels[1], "", "deg", f"{name}, phase")
        label(panels[2], "frequency, rad/s", "", "coherence")
        for axes in panels[:2]:
            axes.tick_params(labelbottom=False)
        return figure

    return Plate(f"response_{file_stem(output)}_{file_stem(given)}", f"Frequency response {name}", caption, make)
