"""The picture of an episode under way: attitude, time histories, spectrum of the commands among the modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.constants import DEG_RAD
from testbench.page.labels import axis_label, number, shown_unit
from testbench.page.plot import COLOURS, INK, QUIET, grid, label, line_look, log_axis, new_figure, style, time_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from testbench.core.record import FloatArray

_DPI = 80
_SENSORS = 4  # most sensors that are drawn
_SPAN = 20.0 * DEG_RAD  # half of the height of the horizon
_DECADES = 4


@dataclass(frozen=True, eq=False)
class Episode:
    """A flight so far, as it is drawn.

    Attributes:
        title: what is flown.
        start_s, decision_s, duration_s: first decision, length of each and end of the record.
        sensor_rate_hz: of the samples ``y``.
        controls, u, amplitude: names (m,), commands (steps, m) and their largest size (m,), rad (1 for the throttle).
        channels, y: names (p,) and samples (n, p) shown by the sensors, SI.
        use: (steps,) largest share of a limit in each step.
        cost: (steps + 1,) cost before the first step and after each.
        theta, phi: pitch and bank now, rad.
        modes: name -> pole, rad/s.
    """

    title: str
    start_s: float
    decision_s: float
    duration_s: float
    sensor_rate_hz: float
    controls: tuple[str, ...]
    u: FloatArray
    amplitude: FloatArray
    channels: tuple[str, ...]
    y: FloatArray
    use: FloatArray
    cost: FloatArray
    theta: float
    phi: float
    modes: Mapping[str, complex]


def draw_episode(episode: Episode) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), 8 bits each; always the same for one episode."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with rc_context(style()):
        figure = new_figure(True, 6.6)
        figure.set_dpi(_DPI)
        canvas = FigureCanvasAgg(figure)
        rows = min(len(episode.channels), _SENSORS) + 1
        height = (6.6 - 0.35 - 0.45 - 0.32 * (rows - 1)) / rows
        right = grid(figure, 0.35, [height] * rows, gap_in=0.32, left_in=4.0)[:, 0]
        left = grid(figure, 0.35, [1.75, 1.3, 1.3], gap_in=0.68, right_in=5.3)[:, 0]
        _horizon(left[0], episode)
        _spectrum(left[1], episode)
        _progress(left[2], episode)
        _histories(right, episode)
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba(), np.uint8)
    return pixels[:, :, :3].copy()


def _horizon(axes: Axes, episode: Episode) -> None:
    """Draw the horizon as it looks from the cockpit: it sinks when the nose rises, and tilts against the bank."""
    theta, phi = episode.theta / _SPAN, episode.phi
    x = np.array([-3.0, 3.0])
    line = -theta - np.tan(np.clip(phi, -1.5, 1.5)) * x  # steeper than 86 deg looks the same
    axes.fill_between(x, line, 9.0, color="#dcebf5", linewidth=0.0)
    axes.fill_between(x, -9.0, line, color="#e9dfd2", linewidth=0.0)
    axes.plot(x, line, color=INK, linewidth=1.2)
    for degrees in (-10.0, 10.0):
        axes.plot([-0.12, 0.12], [degrees * DEG_RAD / _SPAN - theta] * 2, color=QUIET, linewidth=0.8)
    for side in (-1.0, 1.0):
        axes.plot([0.25 * side, 0.7 * side], [0.0, 0.0], color=COLOURS[1], linewidth=2.5)
    axes.plot([0.0], [0.0], marker="o", color=COLOURS[1], markersize=4.0)
    axes.set(xlim=(-1.6, 1.6), ylim=(-1.0, 1.0), xticks=[], yticks=[])
    shown = [round(angle / DEG_RAD, 1) + 0.0 for angle in (episode.theta, episode.phi)]  # no -0.0
    text = f"θ = {shown[0]:.1f}°\nφ = {shown[1]:.1f}°"
    axes.text(0.03, 0.05, text, transform=axes.transAxes, fontsize=8.0)
    label(axes, title=episode.title)


def _spectrum(axes: Axes, episode: Episode) -> None:
    """Draw the energy spectrum of the commands over the modes."""
    from testbench.inputs.signal import energy_spectrum

    omega = np.geomspace(0.1, max([10.0, *(3.0 * abs(p) for p in episode.modes.values())]), 160)
    moved = bool(np.any(episode.u != 0.0))
    if moved:
        energy = energy_spectrum(episode.u / episode.amplitude, episode.decision_s, omega).sum(axis=1)
        axes.plot(omega, np.maximum(energy, 1e-12), color=COLOURS[0])
        top = float(energy.max())
        axes.set_ylim(top * 10.0**-_DECADES, top * 3.0)
        axes.set_yscale("log")
    else:
        axes.set_yticks([])
    axes.set_xlim(omega[0], omega[-1])
    log_axis(axes, "x", powers=False)
    for pole in episode.modes.values():
        axes.axvline(abs(pole), color=COLOURS[2], linewidth=0.9, linestyle=(0, (3, 2)))
    label(axes, "rad/s", title="Command energy, modes dashed" if moved else "No command yet, modes dashed")


def _progress(axes: Axes, episode: Episode) -> None:
    t = episode.start_s + episode.decision_s * np.arange(len(episode.cost))
    axes.plot(t, episode.cost, color=COLOURS[0])
    axes.axhline(1.0, color=QUIET, linewidth=0.8, linestyle=(0, (4, 2)))
    axes.set_xlim(0.0, episode.duration_s)
    axes.set_ylim(min(0.5, 0.7 * float(episode.cost.min())), 1.5 * float(episode.cost.max()))
    log_axis(axes, "y", powers=False)
    time_axis(axes)
    label(axes, "time, s", title=f"Errors over wanted: {number(float(episode.cost[-1]))}")


def _histories(panels: NDArray[Any], episode: Episode) -> None:
    edges = episode.start_s + episode.decision_s * np.arange(len(episode.u) + 1)
    for j, name in enumerate(episode.controls):
        factor = shown_unit(name)[0]
        panels[0].stairs(episode.u[:, j] * factor, edges, baseline=None, **line_look(j))
        reach = 1.1 * float(episode.amplitude[j]) * factor
        panels[0].set_ylim(-reach, reach)
    label(panels[0], y=axis_label(episode.controls[0]), title="Commands from trim: " + ", ".join(episode.controls))
    t = np.arange(len(episode.y)) / episode.sensor_rate_hz
    for i, axes in enumerate(panels[1:]):
        name = episode.channels[i]
        axes.plot(t, episode.y[:, i] * shown_unit(name)[0], color=COLOURS[0], linewidth=0.9)
        label(axes, y=axis_label(name))
    if len(episode.use):
        worst = f"; largest share of a limit {100.0 * float(episode.use.max()):.0f} %"
        panels[0].set_title(panels[0].get_title(loc="left") + worst, y=1.0, pad=4.0)
    for axes in panels:
        axes.set_xlim(0.0, episode.duration_s)
        time_axis(axes)
        axes.tick_params(labelbottom=axes is panels[-1])
    panels[-1].set_xlabel("time, s")
