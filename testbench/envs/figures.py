"""The picture of an episode under way: attitude, time histories, spectrum of the commands among the modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from testbench.core.constants import DEG_RAD
from testbench.page.figure import COLOURS, DASHED, QUIET, WIDE_IN, Area, Chart, Curve, Panel, Rule, Words, line_look
from testbench.page.labels import axis_label, number, shown_unit

if TYPE_CHECKING:
    from testbench.core.record import FloatArray

_DPI, _TALL_IN = 80, 6.6
_SENSORS = 4  # most sensors that are drawn
_SPAN = 20.0 * DEG_RAD  # half of the height of the horizon
_DECADES = 4


@dataclass(frozen=True, eq=False)
class Episode:
    """A flight so far, as it is drawn."""

    title: str  # what is flown
    # start_s, decision_s, duration_s: first decision, length of each and end of the record
    start_s: float
    decision_s: float
    duration_s: float
    sensor_rate_hz: float  # of the samples ``y``
    # controls, u, amplitude: names (m,), commands (steps, m) and their largest size (m,), rad (1 for the throttle)
    controls: tuple[str, ...]
    u: FloatArray
    amplitude: FloatArray
    # channels, y: names (p,) and samples (n, p) shown by the sensors, SI
    channels: tuple[str, ...]
    y: FloatArray
    use: FloatArray  # (steps,) largest share of a limit in each step
    cost: FloatArray  # (steps + 1,) cost before the first step and after each
    # theta, phi: pitch and bank now, rad
    theta: float
    phi: float
    modes: Mapping[str, complex]  # name -> pole, rad/s


def draw_episode(episode: Episode) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3), 8 bits each; always the same for one episode."""
    from testbench.page.draw import pixels

    left, y = list[Panel](), 0.35
    for panel in (_horizon(episode), _spectrum(episode), _progress(episode)):
        left.append(replace(panel, box_in=(0.66, y, WIDE_IN - 5.96, panel.tall_in)))
        y += panel.tall_in + 0.68
    right = _histories(episode)
    tall = (_TALL_IN - 0.8 - 0.32 * (len(right) - 1)) / len(right)
    placed = [replace(p, box_in=(4.0, 0.35 + k * (tall + 0.32), WIDE_IN - 4.12, tall)) for k, p in enumerate(right)]
    out: NDArray[np.uint8] = pixels(Chart([left, placed], keys=(), size_in=(WIDE_IN, _TALL_IN)), _DPI)
    return out


def _horizon(episode: Episode) -> Panel:
    """Return the horizon as it looks from the cockpit: it sinks when the nose rises, and tilts against the bank."""
    theta, phi = episode.theta / _SPAN, episode.phi
    x = np.array([-3.0, 3.0])
    line = -theta - np.tan(np.clip(phi, -1.5, 1.5)) * x  # steeper than 86 deg looks the same
    across = [*x, *x[::-1]]
    ladder = [(0.12, degrees * DEG_RAD / _SPAN - theta) for degrees in (-10.0, 10.0)]
    shown = [round(angle / DEG_RAD, 1) + 0.0 for angle in (episode.theta, episode.phi)]  # no -0.0
    return Panel(
        draws=[
            Area(outlines=[(across, [*line, 9.0, 9.0])], colour="#dcebf5"),
            Area(outlines=[(across, [*line, -9.0, -9.0])], colour="#e9dfd2"),
            Curve(x=x, y=line, width=1.2),
            *(Curve(x=[-half, half], y=[y, y], colour=QUIET, width=0.8) for half, y in ladder),
            *(Curve(x=[0.25 * s, 0.7 * s], y=[0.0, 0.0], colour=COLOURS[1], width=2.5) for s in (-1.0, 1.0)),
            Curve(x=[0.0], y=[0.0], marker="o", colour=COLOURS[1], size=4.0),
            Words(x=0.03, y=0.05, of_panel="xy", text=f"θ = {shown[0]:.1f}°\nφ = {shown[1]:.1f}°", up="bottom"),
        ],
        title=episode.title, x_range=(-1.6, 1.6), y_range=(-1.0, 1.0), x_ticks=[], y_ticks=[], tall_in=1.75, plain=True,
    )  # fmt: skip


def _spectrum(episode: Episode) -> Panel:
    """Return the energy spectrum of the commands over the modes."""
    from testbench.inputs.signal import energy_spectrum

    omega = np.geomspace(0.1, max([10.0, *(3.0 * abs(p) for p in episode.modes.values())]), 160)
    marks = [Rule(at=abs(pole), colour=COLOURS[2], dash=DASHED) for pole in episode.modes.values()]
    if not np.any(episode.u != 0.0):
        return Panel(draws=marks, title="No command yet, modes dashed", x="rad/s", log_x=True, y_ticks=[], tall_in=1.3,
                     x_range=(omega[0], omega[-1]))  # fmt: skip
    energy = energy_spectrum(episode.u / episode.amplitude, episode.decision_s, omega).sum(axis=1)
    top = float(energy.max())
    return Panel(
        draws=[Curve(x=omega, y=np.maximum(energy, 1e-12), colour=COLOURS[0]), *marks],
        title="Command energy, modes dashed", x="rad/s", log_x=True, log_y=True, x_range=(omega[0], omega[-1]),
        y_range=(top * 10.0**-_DECADES, top * 3.0), tall_in=1.3,
    )  # fmt: skip


def _progress(episode: Episode) -> Panel:
    t = episode.start_s + episode.decision_s * np.arange(len(episode.cost))
    return Panel(
        draws=[Curve(x=t, y=episode.cost, colour=COLOURS[0]), Rule(at=1.0, of="y", width=0.8, dash=DASHED)],
        title=f"Errors over wanted: {number(float(episode.cost[-1]))}", x="time, s", log_y=True,
        x_range=(0.0, episode.duration_s), tall_in=1.3,
        y_range=(min(0.5, 0.7 * float(episode.cost.min())), 1.5 * float(episode.cost.max())),
    )  # fmt: skip


def _histories(episode: Episode) -> list[Panel]:
    """Return the commands, and what the first sensors show."""
    span = (0.0, episode.duration_s)
    edges = episode.start_s + episode.decision_s * np.arange(len(episode.u) + 1)
    commands = []
    for j, name in enumerate(episode.controls):
        u = episode.u[:, j] * shown_unit(name)[0]
        commands.append(Curve(x=edges, y=np.append(u, u[-1:]), steps=True, **line_look(j)) if len(u) else None)
    reach = max(1.1 * float(a) * shown_unit(n)[0] for a, n in zip(episode.amplitude, episode.controls, strict=True))
    worst = f"; largest share of a limit {100.0 * float(episode.use.max()):.0f} %" if len(episode.use) else ""
    title = "Commands from trim: " + ", ".join(episode.controls) + worst
    t, channels = np.arange(len(episode.y)) / episode.sensor_rate_hz, episode.channels[:_SENSORS]
    names = [episode.controls[0], *channels]
    drawn = [[c for c in commands if c is not None]]
    drawn += [
        [Curve(x=t, y=episode.y[:, i] * shown_unit(n)[0], colour=COLOURS[0], width=0.9)] for i, n in enumerate(channels)
    ]
    return [
        Panel(draws=draws, title="" if k else title, x="time, s" if k == len(channels) else "", y=axis_label(name),
              x_range=span, y_range=None if k else (-reach, reach), x_ticks=None if k == len(channels) else [])
        for k, (name, draws) in enumerate(zip(names, drawn, strict=True))
    ]  # fmt: skip
