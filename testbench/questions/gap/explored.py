"""Before and after on a held-out manoeuvre as numbers that a reader explores: over time, and by frequency."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.page.explore import Curve, Explorable, Panel, View
from testbench.page.labels import axis_label, shown_unit, symbol
from testbench.page.plot import INK, MEASURED

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.gap.result import Shrink

Look = tuple[str, str, tuple[float, ...]]
"""Name, colour and dash of a model."""


def held_out(shrink: Shrink, outputs: Sequence[str], models: Sequence[Look]) -> Explorable:
    """Return measurement and both models (before, after) over time; residuals are differences to the measurement."""
    panels = []
    for i, name in enumerate(outputs):
        factor, t = shown_unit(name)[0], shrink.record.t_s
        curves = [Curve(name="measured", x=t, y=factor * shrink.record[name], colour=MEASURED, width=1.0)]
        for y, (model, colour, dash) in zip((shrink.before, shrink.after), models, strict=True):
            curves.append(Curve(name=model, x=t, y=factor * y[:, i], colour=colour, dash=dash))
        panels.append(Panel(title=axis_label(name), x="t, s", curves=curves))
    return Explorable([View(name=shrink.manoeuvre, panels=panels, reference="measured")])


def spectra(
    sides: Sequence[FloatArray],
    outputs: Sequence[str],
    share: FloatArray,
    models: Sequence[Look],
    spectrum: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
) -> Explorable:
    """Return the spectra of the residuals before and after, relative to noise; ``spectrum`` makes one of (n,)."""
    panels = []
    for i, name in enumerate(outputs):
        curves = []
        for residual, (model, colour, dash) in zip(sides, models, strict=True):
            f, density = spectrum(residual[:, i])
            curves.append(Curve(name=model, x=f, y=density / max(float(share[i]), 1e-9), colour=colour, dash=dash))
        curves.append(Curve(name="noise floor", x=f, y=np.ones_like(f), colour=INK, dash=(2.0, 2.0), width=1.0))
        panels.append(
            Panel(title=f"{symbol(name)}, noise = 1", x="f, Hz", curves=curves, log_x=True, log_y=True, hidden=i > 3)
        )
    return Explorable([View(name="spectra", panels=panels)])
