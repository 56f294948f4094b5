"""The figures of the gap workflow: where the residual sits, which effect explains it, before and after.

The part that a verdict points to, drawn on a sketch of an aircraft from above and from the side.

Figures of what would be stated of planned manoeuvres: how often each effect is named, and what it is taken for.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import PERCENT
from testbench.core.record import FloatArray
from testbench.page.labels import axis_label, number, shown_unit, symbol
from testbench.page.plot import (
    BAND,
    COLOURS,
    FAINT,
    INK,
    MEASURED,
    QUIET,
    Plate,
    envelope,
    grid,
    label,
    legend,
    legend_in,
    line_handles,
    log_axis,
    new_figure,
    time_axis,
)
from testbench.questions.gap.evidence.locate import BANDS_HZ
from testbench.questions.gap.explain import percent
from testbench.questions.gap.explored import held_out, spectra
from testbench.questions.gap.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.core.record import FloatArray
    from testbench.questions.gap.ask import GapResult
    from testbench.questions.gap.evidence.locate import ResidualMap
    from testbench.questions.gap.result import Shrink


_MOST, _OTHERS, _SEEN = 24, 8, 0.05  # rows; columns beside them, of effects that are given so much

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbench.questions.gap.plan import GapPlan


def plan_plates(plan: GapPlan) -> list[Plate]:
    """Return how often each effect is named, and what those named least are taken for; none without flights."""
    return [_power_plate(plan), _confusion_plate(plan)] if plan.power else []


def _power_plate(plan: GapPlan) -> Plate:
    power = plan.power

    def make(wide: bool) -> Figure:
        """Draw one bar per effect, the most often named on top."""
        step = 0.17
        figure = new_figure(wide, 0.3 + step * len(power) + 0.55, share=0.75)
        axes = grid(figure, 0.2, [step * len(power)], left_in=1.75 if wide else 1.45)[0, 0]
        at = range(len(power))
        held, sure = ([100.0 * x for x in of] for of in zip(*((p.held, p.sure) for p in power.values()), strict=True))
        axes.barh(at, held, height=0.65, facecolor="none", edgecolor=COLOURS[0], linewidth=0.8)
        axes.barh(at, sure, height=0.65, color=COLOURS[0])
        axes.set_yticks(at, list(power), fontsize=7)
        axes.set_ylim(len(power) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        axes.set_xlim(0.0, 100.0)
        label(axes, "flights, %")
        return figure

    caption = (
        "Flights with each effect in them, drawn from its prior. Filled: it is stated with 90 % or more. Outline: it "
        "is in the set that holds 95 %."
    )
    return Plate("power", "How often each effect would be named", caption, make)


def _confusion_plate(plan: GapPlan) -> Plate:
    power = plan.power
    truths = list(power)[-_MOST:]
    taken = {n: p for t in truths for n, p in power[t].given.items() if n not in truths and p >= _SEEN}
    others = sorted(taken.keys() - {"nothing", "unknown"}, key=lambda n: -taken[n])[:_OTHERS]
    names = [*truths, *others, "nothing", "unknown"]
    given = np.array([[power[t].given.get(n, 0.0) for n in names] for t in truths])

    def make(wide: bool) -> Figure:
        """Draw the matrix of mean probabilities."""
        cell = 0.168 if wide else 0.088
        left, top = (1.75, 1.85) if wide else (1.15, 1.5)
        size = 7 if wide else 4
        figure = new_figure(wide, top + cell * len(truths) + 0.75)
        width = float(figure.get_size_inches()[0])
        right = max(0.1, width - left - cell * len(names))
        axes = grid(figure, top, [cell * len(truths)], left_in=left, right_in=right)[0, 0]
        image = axes.imshow(given / PERCENT, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=size)
        axes.set_yticks(range(len(truths)), truths, fontsize=size)
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        tall = float(figure.get_size_inches()[1])
        bar = figure.add_axes((left / width, 0.33 / tall, 1.8 / width, 0.09 / tall))
        colours = figure.colorbar(image, cax=bar, orientation="horizontal", ticks=[0.0, 50.0, 100.0])
        colours.ax.set_title("mean probability that is given, %", fontsize=7, color=QUIET, loc="left")
        colours.outline.set_visible(False)
        return figure

    caption = (
        f"Row: an effect that is there; the {len(truths)} that are named least. Column: what it is taken for, by the "
        "mean probability over its flights. A right answer lies on the diagonal; the last two columns are nothing, and "
        "something that the library lacks."
    )
    return Plate("confusion", "What effects would be taken for", caption, make)


_MARK = COLOURS[1]
Outline = Sequence[tuple[float, float]]


def _box(x: float, y: float, dx: float, dy: float) -> Outline:
    return ((x, y), (x + dx, y), (x + dx, y + dy), (x, y + dy))


def _round(x: float, y: float, r: float) -> Outline:
    angle = np.linspace(0.0, 2.0 * np.pi, 40)
    return tuple(zip(x + r * np.cos(angle), y + r * np.sin(angle), strict=True))


# A sketch, nose to the left, half a span long: (from above, from the side), each outlines in that length.
_BODY_X = (0.0, 0.07, 0.35, 1.0, 1.0, 0.35, 0.07, 0.0)
_BODY_ABOVE: Outline = tuple(zip(_BODY_X, (-0.03, -0.06, -0.06, -0.02, 0.02, 0.06, 0.06, 0.03), strict=True))
_BODY_SIDE: Outline = tuple(zip(_BODY_X, (-0.03, -0.07, -0.06, 0.0, 0.05, 0.08, 0.07, 0.03), strict=True))
_WINGS: tuple[Outline, ...] = (_box(0.25, 0.06, 0.2, 0.94), _box(0.25, -1.0, 0.2, 0.94))
_TAIL_ABOVE, _FIN = _box(0.85, -0.3, 0.15, 0.6), ((0.82, 0.05), (0.9, 0.28), (1.0, 0.28), (1.0, 0.05))
_WING_SIDE, _TAIL_SIDE = _box(0.25, 0.06, 0.2, 0.03), _box(0.85, 0.03, 0.15, 0.025)
_ELEVATOR = (_box(0.95, -0.3, 0.05, 0.6),), (_box(0.94, 0.03, 0.06, 0.025),)
_AILERON = (_box(0.4, 0.55, 0.05, 0.42), _box(0.4, -0.97, 0.05, 0.42)), (_box(0.4, 0.06, 0.05, 0.03),)
_RUDDER: tuple[tuple[Outline, ...], tuple[Outline, ...]] = ((), (_box(0.95, 0.05, 0.05, 0.23),))
_PROPELLER = (_box(-0.03, -0.14, 0.03, 0.28),), (_box(-0.03, -0.14, 0.03, 0.28),)
_BALANCE = (_round(0.32, 0.0, 0.045),), (_round(0.32, 0.02, 0.045),)
_LIFTING = (*_WINGS, _TAIL_ABOVE), (_WING_SIDE, _TAIL_SIDE)
_BOX = (_box(0.14, -0.035, 0.1, 0.07),), (_box(0.14, -0.03, 0.1, 0.06),)
_NOSE = (_round(0.03, 0.0, 0.035),), (_round(0.03, 0.0, 0.035),)
_REGIONS: Mapping[str, tuple[tuple[Outline, ...], tuple[Outline, ...]]] = {
    **dict.fromkeys(("elevator path", "de sensor"), _ELEVATOR),
    **dict.fromkeys(("aileron path", "da sensor"), _AILERON),
    **dict.fromkeys(("rudder path", "dr sensor"), _RUDDER),
    "thrust": _PROPELLER,
    "mass": _BALANCE,
    "structure": ((*_WINGS, _box(0.5, -0.045, 0.35, 0.09)), (_WING_SIDE, _box(0.5, -0.02, 0.35, 0.07))),
    "lift": (_WINGS, (_WING_SIDE,)),
    "drag": ((_BODY_ABOVE,), (_BODY_SIDE,)),
    "pitching moment": _LIFTING,
    "wing": (_WINGS, (_WING_SIDE,)),
    "fin": ((_box(0.82, -0.015, 0.18, 0.03),), (_FIN,)),
    "autopilot": _BOX,
}


def part_plate(verdict: Verdict) -> Plate | None:
    """Return the figure of the parts that a verdict calls; None if it calls none."""
    if not verdict.parts:
        return None

    def make(wide: bool) -> Figure:
        """Draw the sketch from above and from the side, the parts filled."""
        figure = new_figure(wide, 2.3 if wide else 2.0)
        above, side = figure.subplots(1, 2)
        figure.subplots_adjust(left=0.02, right=0.98, top=0.88, bottom=0.03, wspace=0.03)
        _sketch(above, (_BODY_ABOVE, *_WINGS, _TAIL_ABOVE), "from above", (-1.1, 1.1))
        _sketch(side, (_BODY_SIDE, _WING_SIDE, _TAIL_SIDE, _FIN), "from the side", (-0.35, 0.6))
        for part in verdict.parts:
            for axes, outlines in zip((above, side), _region(part.name), strict=True):
                for outline in outlines:
                    axes.fill(*np.transpose(outline), facecolor=_MARK, edgecolor=_MARK, linewidth=1.0)
                if part.name == "air":
                    _wind(axes)
        return figure

    caption = f"A sketch, not this aircraft. Filled: {verdict.where}. Probability: {percent(verdict.probability)}."
    return Plate("part", "Where to look", caption, make)


def _region(name: str) -> tuple[tuple[Outline, ...], tuple[Outline, ...]]:
    """Return the outlines of a part from above and from the side; a sensor sits in the nose, a vane beside it."""
    if name in _REGIONS:
        return _REGIONS[name]
    return _NOSE if name.endswith("sensor") else ((), ())


def _sketch(axes: Axes, outlines: Sequence[Outline], title: str, height: tuple[float, float]) -> None:
    for outline in outlines:
        axes.fill(*np.transpose(outline), facecolor=FAINT, edgecolor=QUIET, linewidth=0.8)
    axes.set(xlim=(-0.35, 1.1), ylim=height, aspect="equal")
    axes.set_title(title, fontsize=9, color=QUIET)
    axes.set_axis_off()


def _wind(axes: Axes) -> None:
    """Draw three gusts ahead of the nose."""
    x: FloatArray = np.linspace(-0.32, -0.08, 40)
    shift: Callable[[float], FloatArray] = lambda y: y + 0.025 * np.sin(2.0 * np.pi * (x + 0.32) / 0.12)  # noqa: E731
    for y in (-0.15, 0.0, 0.15):
        axes.plot(x, shift(y), color=_MARK, linewidth=1.6)


_TOP_ENERGY = 100.0  # residual energies from 1 (noise) to this span the colour scale
_BEFORE, _AFTER = COLOURS[1], COLOURS[0]
_BEFORE_DASH, _AFTER_DASH, _FLOOR_DASH = (0, (5, 1.5)), "-", (0, (2, 2))  # told apart in grey print too
_MODELS = (("believed model", _BEFORE, _BEFORE_DASH), ("amended model", _AFTER, _AFTER_DASH))
_LOOKS: list[tuple[str, str, tuple[float, ...]]] = [
    (name, colour, () if isinstance(dash, str) else (float(dash[1][0]), float(dash[1][1])))
    for name, colour, dash in _MODELS
]
_TOLD = 3.0  # standard errors
_SEGMENTS = 8  # of a residual spectrum, averaged


def gap_plates(result: GapResult) -> list[Plate]:
    """Return the figures of a gap case: where to look, maps, ranking, and before and after on held-out manoeuvres."""
    verdict = result.finding.verdict
    where = None if verdict is None else part_plate(verdict)
    out = [_answer_plate(result)] if result.finding.shrink and result.finding.changed else []
    out += [] if where is None else [where]
    out += [_map_plate(result), _region_plate(result)] if result.finding.regions else [_map_plate(result)]
    if any(one.kappa > 0.0 for one in result.finding.lacks):
        out.append(_lacking_plate(result))
    if result.finding.naming.ranking:
        out.append(_ranking_plate(result))
    if result.finding.changed:
        for k, shrink in enumerate(result.finding.shrink, 1):
            out += [_history_plate(result, shrink, k), _spectrum_plate(result, shrink, k)]
    return out


def _answer_plate(result: GapResult) -> Plate:
    """Return the one figure that shows the answer: the worst held-out channel, and all channels' energies."""
    finding = result.finding
    shrink = max(finding.shrink, key=lambda s: float(s.energy_before.max()))
    outputs = finding.believed.outputs
    k = int(np.argmax(shrink.energy_before))
    t = shrink.record.t_s

    def make(wide: bool) -> Figure:
        """Draw measurement and both models beside the energies of their residuals."""
        handles = line_handles([], [("measured", MEASURED), *_MODELS])
        top = legend_in([h.get_label() for h in handles], wide) + 0.28
        heights = [2.1] if wide else [1.9, 0.28 * len(outputs) + 0.2]
        figure = new_figure(wide, top + sum(heights) + 0.62 * (len(heights) - 1) + 0.55)
        panels = grid(figure, top, heights, (1.6, 1.0) if wide else (1.0,), gap_in=0.62, between_in=0.75).ravel()
        axes, bars = panels[0], panels[1]
        factor = shown_unit(outputs[k])[0]
        axes.plot(*envelope(t, factor * shrink.record[outputs[k]]), color=MEASURED, linewidth=1.0)
        axes.plot(t, factor * shrink.before[:, k], color=_BEFORE, linestyle=_BEFORE_DASH, linewidth=1.3)
        axes.plot(t, factor * shrink.after[:, k], color=_AFTER, linewidth=1.3)
        label(axes, "t, s", axis_label(outputs[k]), shrink.manoeuvre)
        time_axis(axes)
        rows = np.arange(len(outputs))
        low = 0.5
        open_bar, full_bar = {"facecolor": "white", "edgecolor": _BEFORE, "linewidth": 1.2}, {"color": _AFTER}
        for energy, look, shift in ((shrink.energy_before, open_bar, -0.19), (shrink.energy_after, full_bar, 0.19)):
            bars.barh(rows + shift, np.maximum(energy - low, 0.0), left=low, height=0.34, **look)
        bars.axvline(1.0, color=INK, linewidth=0.9, linestyle=_FLOOR_DASH)
        bars.set_yticks(rows, [symbol(o) for o in outputs])
        bars.set_ylim(len(outputs) - 0.4, -0.6)
        bars.grid(axis="y", visible=False)
        bars.set_xlim(low, max(2.0, 1.5 * float(shrink.energy_before.max())))
        log_axis(bars, "x", powers=False)
        label(bars, "mean squared residual, noise = 1")
        legend(figure, handles)
        return figure

    caption = (
        f"The manoeuvre '{shrink.manoeuvre}' was used neither to name nor to fit. Left: {symbol(outputs[k])}, in which "
        "the believed model is furthest off. Right: residuals of all channels. Open bars are those of the believed "
        "model, full bars those of the amended one; the dashed line is the noise floor."
    )
    return Plate("answer", "What the amendment does to a flight that it has not seen", caption, make)


def _region_plate(result: GapResult) -> Plate:
    """Return maps of residual energy over the flight region: one quantity per panel, channel by bin."""
    regions = result.finding.regions

    def make(wide: bool) -> Figure:
        """Draw one map per quantity."""
        per_row = min(3, len(regions)) if wide else 1
        rows = -(-len(regions) // per_row)
        height = 0.19 * len(regions[0].channels) + 0.25
        figure = new_figure(wide, 0.95 + rows * height + (rows - 1) * 0.66 + 0.55)
        panels = grid(figure, 0.95, [height] * rows, (1.0,) * per_row, gap_in=0.66, between_in=0.55).ravel()
        image = None
        for axes in panels[len(regions) :]:
            axes.set_visible(False)
        for axes, region in zip(panels, regions, strict=False):
            image = _draw_energy(axes, region.channels, region.energy)
            factor = shown_unit(region.quantity)[0]
            ticks = [0, len(region.edges) // 2, len(region.edges) - 1]
            axes.set_xticks([k - 0.5 for k in ticks], [number(factor * region.edges[k]) for k in ticks])
            axes.get_xticklabels()[-1].set_horizontalalignment("right")  # the last panel ends where the figure does
            label(axes, axis_label(region.quantity))
        _energy_bar(figure, image)
        return figure

    caption = (
        "The same residuals over angle of attack, airspeed, pitch rate and the commands, all manoeuvres together. A "
        "gap that sits at one end of a quantity depends on that quantity. Grey: too few samples."
    )
    return Plate("residual_regions", "Where in the flight region the residual sits", caption, make)


def _lacking_plate(result: GapResult) -> Plate:
    """Return what the believed model lacks over time: a row for each state, a column for each manoeuvre."""
    lacks = result.finding.lacks
    ratio = {s: max(_largest(one.accelerations[s] / one.std[s]) for one in lacks) for s in lacks[0].accelerations}
    states = [s for s in ratio if ratio[s] > _TOLD] or [max(ratio, key=lambda s: ratio[s])]

    def make(wide: bool) -> Figure:
        """Draw one panel for each state and manoeuvre."""
        columns, rows = (len(lacks), len(states)) if wide else (1, len(states) * len(lacks))
        gap = 0.5 if wide else 0.75
        figure = new_figure(wide, 0.35 + 1.05 * rows + gap * (rows - 1) + 0.5)
        panels = grid(figure, 0.3, [1.05] * rows, (1.0,) * columns, gap_in=gap, between_in=0.6)
        panels = panels.reshape(len(states), len(lacks)) if wide else panels.reshape(len(lacks), len(states)).T
        for r, state in enumerate(states):
            factor, unit = shown_unit(state)
            top = factor * max(_largest(one.accelerations[state]) for one in lacks)
            for c, one in enumerate(lacks):
                axes, value, band = panels[r, c], factor * one.accelerations[state], 2.0 * factor * one.std[state]
                axes.stairs(value + band, one.t_s, baseline=value - band, fill=True, color=BAND)
                axes.stairs(value, one.t_s, baseline=None, color=COLOURS[0], linewidth=1.2)
                axes.axhline(0.0, color=INK, linewidth=0.6)
                axes.set_ylim(-1.3 * top, 1.3 * top)
                last = r == len(states) - 1 or not wide
                title = one.manoeuvre if r == 0 or not wide else ""
                said = f"d{symbol(state)}/dt, {unit}/s"
                label(axes, "t, s" if last else "", said if c == 0 or not wide else "", title)
                time_axis(axes)
        return figure

    caption = (
        "Accelerations that an unknown motion would have to add to the believed model, in stretches of half a second, "
        "of the manoeuvres with the largest residuals. Grey: two standard errors. States in which they are none to "
        "within these are left out."
    )
    return Plate("lacking", "What the believed model lacks over time", caption, make)


def _largest(x: FloatArray) -> float:
    return float(np.max(np.abs(x)))


def _map_plate(result: GapResult) -> Plate:
    maps = result.finding.maps

    def make(wide: bool) -> Figure:
        """Draw two maps per manoeuvre: by frequency band and by time."""
        from matplotlib.ticker import MaxNLocator

        rows = len(maps) if wide else 2 * len(maps)
        height = 0.19 * len(maps[0].channels) + 0.35
        gap = 0.62 if wide else 0.8  # one below the other, every panel has its axis label
        figure = new_figure(wide, 0.95 + rows * height + (rows - 1) * gap + 0.55)
        panels = grid(figure, 0.95, [height] * rows, (1.0, 1.6) if wide else (1.0,), gap_in=gap, between_in=0.5)
        panels = panels.reshape(len(maps), 2)
        for r, m in enumerate(maps):
            image = _draw_map(panels[r, 0], m, m.by_band)
            _draw_map(panels[r, 1], m, m.by_time)
            panels[r, 0].set_xticks(range(len(BANDS_HZ)), [f"{b[0]:g}–{b[1]:g}" for b in BANDS_HZ], fontsize=7)
            panels[r, 1].xaxis.set_major_locator(MaxNLocator(integer=True))
            last = r == len(maps) - 1 or not wide
            label(panels[r, 0], "frequency, Hz" if last else "", "", m.manoeuvre)
            label(panels[r, 1], f"t, windows of {m.window_s:g} s" if last else "", "", "" if wide else m.manoeuvre)
        _energy_bar(figure, image)
        return figure

    caption = (
        "Energy of measured minus predicted, in units of the noise energy, in the manoeuvres that the effect was "
        "sought in: each channel over frequency bands and over time. The left end of the colour bar is noise, the "
        "right end what the model does not explain."
    )
    return Plate("residual_maps", "Where the residual sits", caption, make)


def _energy_bar(figure: Figure, image: Any) -> None:
    width, tall = figure.get_size_inches()
    bar = figure.add_axes((0.66 / width, 1.0 - 0.36 / tall, 1.8 / width, 0.09 / tall))
    colours = figure.colorbar(image, cax=bar, orientation="horizontal", ticks=[1, 3, 10, 30, 100])
    colours.ax.set_xticklabels(["1", "3", "10", "30", "≥100"])
    colours.ax.set_title("residual energy, noise = 1", fontsize=8, color=QUIET)
    colours.outline.set_visible(False)


def _draw_map(axes: Axes, m: ResidualMap, energy: FloatArray) -> Any:
    return _draw_energy(axes, m.channels, energy)


def _draw_energy(axes: Axes, channels: tuple[str, ...], energy: FloatArray) -> Any:
    from matplotlib.colors import LogNorm

    image = axes.imshow(
        np.clip(energy.T, 1.0, _TOP_ENERGY), aspect="auto", cmap="Blues", norm=LogNorm(1.0, _TOP_ENERGY)
    )
    axes.set_facecolor(FAINT)  # what is not a number shows it
    axes.set_yticks(range(len(channels)), [symbol(c) for c in channels])
    axes.grid(False)
    axes.tick_params(length=0)
    return image


def _ranking_plate(result: GapResult) -> Plate:
    fits = result.finding.naming.ranking

    def make(wide: bool) -> Figure:
        """Draw one bar per effect, the best on top."""
        row, left, letters, lines = (0.34, 2.6, 38, 2) if wide else (0.44, 1.6, 23, 3)
        titles = [textwrap.wrap(f.effect.title, letters, max_lines=lines, placeholder=" …") for f in fits]
        figure = new_figure(wide, 0.3 + row * len(fits) + 0.55)
        axes = grid(figure, 0.25, [row * len(fits)], left_in=left)[0, 0]
        for i, fit in enumerate(fits):
            whole, part = 100.0 * fit.probability, 100.0 * fit.imitates
            axes.barh(i, whole, height=0.55, color=COLOURS[0])
            axes.barh(i, part, left=whole, height=0.55, color=MEASURED)
        axes.set_yticks(range(len(fits)), ["\n".join(title) for title in titles])
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.set_xlim(0.0, 100.0)
        label(axes, "probability, %")
        return figure

    weighed = result.finding.naming.weighed
    caption = (
        "Blue: probability that this is all that the model lacks. Grey: that something which the library lacks does "
        f"nearly this. Nothing is missing: {percent(weighed.nothing)}; something is, and nothing is near it: "
        f"{percent(weighed.imitates('nothing'))}."
    )
    return Plate("ranking", "Which effect explains it", caption, make)


def _history_plate(result: GapResult, shrink: Shrink, nth: int) -> Plate:
    outputs = result.finding.believed.outputs
    t = shrink.record.t_s

    def make(wide: bool) -> Figure:
        """Draw one panel per output."""
        handles = line_handles([], [("measured", MEASURED), *_MODELS])
        top = legend_in([h.get_label() for h in handles], wide) + 0.2
        figure = new_figure(wide, top + 1.0 * len(outputs) + 0.28 * (len(outputs) - 1) + 0.5)
        panels = grid(figure, top, [1.0] * len(outputs), gap_in=0.28)[:, 0]
        for i, (axes, name) in enumerate(zip(panels, outputs, strict=True)):
            factor = shown_unit(name)[0]
            axes.plot(*envelope(t, factor * shrink.record[name]), color=MEASURED, linewidth=1.0)
            axes.plot(t, factor * shrink.before[:, i], color=_BEFORE, linestyle=_BEFORE_DASH, linewidth=1.2)
            axes.plot(t, factor * shrink.after[:, i], color=_AFTER, linewidth=1.2)
            last = i == len(outputs) - 1
            text = f"{number(shrink.energy_before[i])} → {number(shrink.energy_after[i])}"
            axes.set_title(text, loc="right", fontsize=8, color=QUIET, pad=2)
            label(axes, "t, s" if last else "", axis_label(name))
            time_axis(axes)
            axes.tick_params(labelbottom=last)
        legend(figure, handles)
        return figure

    caption = (
        "This manoeuvre was used neither to name nor to fit. Numbers above a panel: mean squared residual before and "
        "after, the noise being 1. Predictions are shifted to the mean of the measurement, as sensor biases are "
        "unknown."
    )
    title = f"Before and after on a held-out manoeuvre: {shrink.manoeuvre}"
    explore = partial(held_out, shrink, outputs, _LOOKS)
    return Plate(f"held_out_{nth}", title, caption, make, explore)


def _spectrum_plate(result: GapResult, shrink: Shrink, nth: int) -> Plate:
    outputs = result.finding.believed.outputs
    dt = shrink.record.dt_s
    believed = result.finding.believed
    measured, share = shrink.record.columns(outputs), shrink.taken / len(shrink.record)
    sides = [believed.in_noise_units(shrink.record, measured - y) for y in (shrink.before, shrink.after)]

    def make(wide: bool) -> Figure:
        """Draw one panel per output."""
        per_row = 3 if wide else 1
        rows = -(-len(outputs) // per_row)
        handles = line_handles([], [*_MODELS, ("noise floor", INK, _FLOOR_DASH)])
        top = legend_in([h.get_label() for h in handles], wide) + 0.3
        figure = new_figure(wide, top + 1.3 * rows + 0.55 * (rows - 1) + 0.5)
        panels = grid(figure, top, [1.3] * rows, (1.0,) * per_row, gap_in=0.55).ravel()
        for i, axes in enumerate(panels):
            if i >= len(outputs):
                axes.set_visible(False)
                continue
            for residual, (_, colour, dash) in zip(sides, _MODELS, strict=True):
                f, density = _spectrum(residual[:, i], dt)
                axes.plot(f, density / max(share[i], 1e-9), color=colour, linestyle=dash, linewidth=1.2)
            axes.axhline(1.0, color=INK, linewidth=0.9, linestyle=_FLOOR_DASH)
            axes.set_xlim(f[0], f[-1])
            log_axis(axes, "x", powers=False)
            log_axis(axes, "y", powers=True)
            side = "residual, noise = 1" if i % per_row == 0 else ""
            label(axes, "f, Hz" if i >= len(outputs) - per_row else "", side, symbol(outputs[i]))
        legend(figure, handles)
        return figure

    caption = "Spectrum of the residual in units of the noise density, averaged over overlapping segments."
    if result.finding.air.moves:
        caption += " Turbulence is taken out by the Kalman filter in which the effect was sought."
    explore = partial(spectra, sides, outputs, share, _LOOKS, partial(_spectrum, dt_s=dt))
    return Plate(f"held_out_{nth}_spectrum", f"The same by frequency: {shrink.manoeuvre}", caption, make, explore)


def _spectrum(residual: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies, Hz, and the power of ``residual`` (n,) relative to unit white noise (Welch's method)."""
    from scipy.signal import welch

    length = 2 * residual.size // (_SEGMENTS + 1)
    f, density = welch(residual, fs=1.0 / dt_s, nperseg=length, detrend="constant")
    return f[1:-1], density[1:-1] / (2.0 * dt_s)
