"""The figures of a plan: damping of the elastic modes over speed, points over speed and height, energy over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.plot import (
    COLOURS,
    DASHES,
    INK,
    QUIET,
    Plate,
    grid,
    label,
    legend,
    legend_in,
    line_handles,
    new_figure,
)
from testbench.questions.plan.card_text import short_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.questions.plan.result import Plan

_SHOWN_MODES = 4
_WARN = "#b34700"


def plan_plates(plan: Plan) -> list[Plate]:
    """Return the figures of the plan's page; the first shows what limits the plan, elastic modes or energy."""
    out = [_build_up(plan), *([_energy(plan)] if plan.flights else [])]
    return out if _weakest(plan) else out[::-1]


def _weakest(plan: Plan) -> list[str]:
    """Return the elastic modes that are damped least at some point, the least first."""
    least: dict[str, float] = {}
    for p in plan.points:
        for m in p.modes:
            if m.elastic:
                least[m.name] = min(least.get(m.name, np.inf), m.zeta)
    return sorted(least, key=lambda n: least[n])[:_SHOWN_MODES]


def _build_up(plan: Plan) -> Plate:
    names = _weakest(plan)
    caption = "Points are numbered in the order of flying: a circle as given, a diamond scaled, a square refused. " + (
        "Damping ratio of the least damped elastic modes. Dashed: onset of instability and, where the plan keeps it, "
        "the onset less the margin. Dotted: least admissible damping."
        if names
        else "The aircraft has no elastic modes: only its limits bound the build-up."
    )

    def make(wide: bool) -> Figure:
        """Draw the points, and the damping above them where there are elastic modes."""
        shown = [short_name(n) for n in names]
        head = 0.3 + (legend_in(shown, wide) if names else 0.0)
        heights = [2.3, 1.1] if names else [1.6]
        figure = new_figure(wide, head + sum(heights) + (1.05 if names else 0.55))
        panels = grid(figure, head, heights, gap_in=0.5)
        if names:
            _damping(panels[0, 0], plan, names)
            legend(figure, line_handles(shown))
        _points(panels[-1, 0], plan)
        return figure

    return Plate("build_up", "Build-up", caption, make)


def _span(plan: Plan) -> tuple[float, float]:
    """Return the range of speeds that is drawn."""
    speeds = [p.V_m_s for p in plan.points]
    onset = [p.onset.V_m_s for p in plan.points if p.onset is not None and p.onset.V_m_s is not None]
    low, high = min(speeds), max([*speeds, *onset])
    room = max(0.06 * (high - low), 0.5)
    return low - room, high + room


def _damping(axes: Axes, plan: Plan, names: list[str]) -> None:
    low, high = _span(plan)
    top = 0.0
    for envelope in plan.envelopes:
        V = np.array(envelope.speeds)
        inside = (low <= V) & (high * 1.08 >= V)
        for k, name in enumerate(names):
            zeta = np.nanmin(envelope.history(name)[1], axis=1)
            axes.plot(V[inside], zeta[inside], color=COLOURS[k % 6], linestyle=DASHES[k % 6])
            at = [p for p in plan.points if p.h_m == envelope.h_m]
            here = [m.zeta for p in at for m in p.modes if m.name == name]
            axes.plot([p.V_m_s for p in at], here, "o", color=COLOURS[k % 6], markersize=4.0)
            top = max(top, max(here, default=0.0))
    axes.axhline(0.0, color=INK, linewidth=0.7)
    axes.axhline(plan.scenario.least_damping, color=_WARN, linewidth=0.9, linestyle=(0, (1, 1.5)))
    axes.set_xlim(low, high)
    axes.set_ylim(-0.25 * top, 1.15 * top)
    _onset_lines(axes, plan)
    label(axes, "", "damping ratio ζ", "least damped elastic modes")


def _onset_lines(axes: Axes, plan: Plan) -> None:
    for onset in {p.onset.V_m_s for p in plan.points if p.onset is not None and p.onset.V_m_s is not None}:
        axes.axvline(onset, color=_WARN, linewidth=1.1, linestyle=(0, (5, 2)))
        if not plan.scenario.allow_above_onset:
            kept = onset * (1.0 - plan.scenario.onset_margin_percent / 100.0)
            axes.axvline(kept, color=QUIET, linewidth=0.9, linestyle=(0, (5, 2)))


def _points(axes: Axes, plan: Plan) -> None:
    heights = sorted({p.h_m for p in plan.points})
    for p in plan.points:
        cards = [c for c in plan.cards if c.point is p]
        refused = any(c.status == "refused" for c in cards)
        scaled = any(c.status == "scaled" for c in cards)
        colour = _WARN if refused else COLOURS[4] if scaled else COLOURS[2]
        axes.plot([p.V_m_s], [p.h_m], "s" if refused else "D" if scaled else "o", color=colour, markersize=7.0)
        axes.annotate(
            str(p.number), (p.V_m_s, p.h_m), xytext=(0, 7), textcoords="offset points", ha="center", fontsize=7.5
        )
    room = max(0.25 * (heights[-1] - heights[0]), 20.0)
    axes.set_ylim(heights[0] - room, heights[-1] + 1.6 * room)
    axes.set_xlim(*_span(plan))
    if len(heights) < 5:
        axes.set_yticks(heights)
    _onset_lines(axes, plan)
    label(axes, "true airspeed V, m/s", "h, m", "test points")


def _energy(plan: Plan) -> Plate:
    def make(wide: bool) -> Figure:
        """Draw the energy used over the time of each flight, one after the other."""
        figure = new_figure(wide, 2.6)
        axes = grid(figure, 0.3, [1.75])[0, 0]
        before = 0.0
        usable = plan.flights[0].usable_J / 3600.0
        for leg in plan.flights:
            mine = [r for r in plan.runs if r.flight == leg.number]
            ends = [r.start_s + r.card.length_s + plan.scenario.timing.turn_s for r in mine]
            t = before + np.array([0.0, mine[0].start_s, *ends]) / 60.0
            first = mine[0].used_J - mine[0].card.point.power_W * (ends[0] - mine[0].start_s)
            used = np.array([0.0, first, *(r.used_J for r in mine)]) / 3600.0
            axes.plot(t, used, color=COLOURS[0], marker=".", markersize=3.5, linewidth=1.2)
            axes.annotate(
                f"flight {leg.number}", (t[0], usable), xytext=(3, 3), textcoords="offset points", fontsize=7.5
            )
            before += leg.time_s / 60.0
        axes.axhline(usable, color=_WARN, linewidth=1.0, linestyle=(0, (5, 2)))
        axes.set_ylim(0.0, 1.12 * usable)
        axes.set_xlim(0.0, 1.01 * before)
        label(axes, "time in the air, min", "energy, Wh", "energy used in each flight")
        return figure

    return Plate(
        "energy", "Energy and time", "One dot per run; time between flights is left out. Dashed: usable energy.", make
    )
