"""The figures of the gap workflow: where the residual sits, which effect explains it, before and after.

The part that a verdict points to, drawn on a sketch of an aircraft from above and from the side.

Figures of what would be stated of planned manoeuvres: how often each effect is named, and what it is taken for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import PERCENT
from testbench.page.explore import View
from testbench.page.figure import (
    BAND,
    COLOURS,
    FAINT,
    INK,
    MEASURED,
    QUIET,
    Area,
    Chart,
    Curve,
    Dash,
    Drawn,
    Image,
    Panel,
    Plate,
    Rule,
    band,
    bars,
    grid,
    rows,
)
from testbench.page.labels import axis_label, number, shown_unit, symbol
from testbench.questions.gap.evidence.locate import BANDS_HZ
from testbench.questions.gap.explain import percent

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.questions.gap.ask import GapResult
    from testbench.questions.gap.plan import GapPlan
    from testbench.questions.gap.result import Shrink, Verdict

_MOST, _OTHERS, _SEEN = 24, 8, 0.05  # rows; columns beside them, of effects that are given so much
_MARK = COLOURS[1]
_TOP_ENERGY = 100.0  # residual energies from 1 (noise) to this span the colour scale
_FLOOR: Dash = (2, 2)
_BEFORE: dict[str, Any] = {"name": "a-priori model", "colour": COLOURS[1], "dash": (5, 1.5), "width": 1.2}
_AFTER: dict[str, Any] = {"name": "amended model", "colour": COLOURS[0], "width": 1.2}  # told apart in grey print too
_TOLD = 3.0  # standard errors
_SEGMENTS = 8  # of a residual spectrum, averaged


# --- what would be stated of planned manoeuvres -----------------------------------------------------------------------


def plan_plates(plan: GapPlan) -> list[Plate]:
    """Return how often each effect is named, and what those named least are taken for; none without flights."""
    return [_power_plate(plan), _confusion_plate(plan)] if plan.power else []


def _power_plate(plan: GapPlan) -> Plate:
    """Return one bar per effect, the most often named on top."""
    at = range(len(plan.power))
    held, sure = ([100.0 * x for x in of] for of in zip(*((p.held, p.sure) for p in plan.power.values()), strict=True))
    draws = [bars(at, 0.0, held, 0.65, colour="none", edge=COLOURS[0]), bars(at, 0.0, sure, 0.65, colour=COLOURS[0])]
    panel = Panel(draws=draws, x="flights, %", x_range=(0.0, 100.0), **rows(list(plan.power), 0.17))
    caption = (
        "Flights with each effect, drawn from its prior. Filled: it is stated with 90 % or more. Outline: it is in "
        "the set with 95 %."
    )
    return Plate("power", "Rate at which each effect would be named", caption, Chart([[panel]], share=0.75))


def _confusion_plate(plan: GapPlan) -> Plate:
    power = plan.power
    truths = list(power)[-_MOST:]
    taken = {n: p for t in truths for n, p in power[t].given.items() if n not in truths and p >= _SEEN}
    others = sorted(taken.keys() - {"nothing", "unknown"}, key=lambda n: -taken[n])[:_OTHERS]
    names = [*truths, *others, "nothing", "unknown"]
    given = np.array([[power[t].given.get(n, 0.0) for n in names] for t in truths])
    image = Image(
        values=given / PERCENT, low=0.0, high=100.0, title="mean stated probability, %",
        ticks=[(at, f"{at:g}") for at in (0.0, 50.0, 100.0)],
    )  # fmt: skip
    panel = Panel(
        draws=[image], x_ticks=list(enumerate(names)), y_ticks=list(enumerate(truths)), tall_in=0.168 * len(truths)
    )
    caption = (
        f"Row: the true effect; the {len(truths)} that are named least. Column: the stated explanation, by the mean "
        "probability over its flights. A right answer lies on the diagonal; the last two columns are nothing, and "
        "something that the library lacks."
    )
    return Plate("confusion", "Confusion of effects", caption, Chart([[panel]]))


# --- where to look ----------------------------------------------------------------------------------------------------

Outline = tuple[Sequence[float], Sequence[float]]  # x and y of its corners


def _box(x: float, y: float, dx: float, dy: float) -> Outline:
    return (x, x + dx, x + dx, x), (y, y, y + dy, y + dy)


def _round(x: float, y: float, r: float) -> Outline:
    angle = np.linspace(0.0, 2.0 * np.pi, 40)
    return (x + r * np.cos(angle)).tolist(), (y + r * np.sin(angle)).tolist()


# A sketch, nose to the left, half a span long: (from above, from the side), each outlines in that length.
_BODY_X = (0.0, 0.07, 0.35, 1.0, 1.0, 0.35, 0.07, 0.0)
_BODY_ABOVE: Outline = _BODY_X, (-0.03, -0.06, -0.06, -0.02, 0.02, 0.06, 0.06, 0.03)
_BODY_SIDE: Outline = _BODY_X, (-0.03, -0.07, -0.06, 0.0, 0.05, 0.08, 0.07, 0.03)
_WINGS: tuple[Outline, ...] = (_box(0.25, 0.06, 0.2, 0.94), _box(0.25, -1.0, 0.2, 0.94))
_TAIL_ABOVE, _FIN = _box(0.85, -0.3, 0.15, 0.6), ((0.82, 0.9, 1.0, 1.0), (0.05, 0.28, 0.28, 0.05))
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
    sketches = (
        ((_BODY_ABOVE, *_WINGS, _TAIL_ABOVE), "from above", (-1.1, 1.1)),
        ((_BODY_SIDE, _WING_SIDE, _TAIL_SIDE, _FIN), "from the side", (-0.35, 0.6)),
    )
    panels = []
    for k, (outlines, title, height) in enumerate(sketches):
        draws: list[Drawn] = [Area(outlines=outlines, colour=FAINT, edge=QUIET)]
        sensors = {part.name: _NOSE for part in verdict.parts if part.name.endswith("sensor")}  # or a vane beside it
        marked = [o for part in verdict.parts for o in {**sensors, **_REGIONS}.get(part.name, ((), ()))[k]]
        draws.append(Area(outlines=marked, colour=_MARK, edge=_MARK, width=1.0, order=2.0))
        if any(part.name == "air" for part in verdict.parts):  # three gusts ahead of the nose
            x = np.linspace(-0.32, -0.08, 40)
            wave = 0.025 * np.sin(2.0 * np.pi * (x + 0.32) / 0.12)
            draws += [Curve(x=x, y=y + wave, colour=_MARK, width=1.6) for y in (-0.15, 0.0, 0.15)]
        panels.append(Panel(draws=draws, title=title, bare=True, x_range=(-0.35, 1.1), y_range=height, tall_in=1.9))
    caption = f"A sketch, not this aircraft. Filled: {verdict.where}. Probability: {percent(verdict.probability)}."
    return Plate("part", "Where to look", caption, Chart([panels], narrow=2))


# --- what was found ---------------------------------------------------------------------------------------------------


def gap_plates(result: GapResult) -> list[Plate]:
    """Return the figures of a gap case: where to look, maps, ranking, and before and after on held-out manoeuvres."""
    finding = result.finding
    where = None if finding.verdict is None else part_plate(finding.verdict)
    out = [_answer_plate(result)] if finding.shrink and finding.changed else []
    out += [] if where is None else [where]
    out += [_map_plate(result), _region_plate(result)] if finding.regions else [_map_plate(result)]
    if any(one.kappa > 0.0 for one in finding.lacks):
        out.append(_lacking_plate(result))
    if finding.naming.ranking:
        out.append(_ranking_plate(result))
    if finding.changed:
        for k, shrink in enumerate(finding.shrink, 1):
            out += [_history_plate(result, shrink, k), _spectrum_plate(result, shrink, k)]
    return out


def _flown(shrink: Shrink, i: int, name: str) -> list[Curve]:
    """Return the i-th output of a held-out manoeuvre: measured, and as both models predict it."""
    factor, t = shown_unit(name)[0], shrink.record.t_s
    return [
        Curve(x=t, y=factor * shrink.record[name], name="measured", colour=MEASURED, width=1.0),
        Curve(x=t, y=factor * shrink.before[:, i], **_BEFORE),
        Curve(x=t, y=factor * shrink.after[:, i], **_AFTER),
    ]


def _answer_plate(result: GapResult) -> Plate:
    """Return the one figure that shows the answer: the worst held-out channel, and all channels' energies."""
    shrink = max(result.finding.shrink, key=lambda s: float(s.energy_before.max()))
    outputs = result.finding.believed.outputs
    k = int(np.argmax(shrink.energy_before))
    history = Panel(
        draws=_flown(shrink, k, outputs[k]), title=shrink.manoeuvre, x="t, s", y=axis_label(outputs[k]), tall_in=2.1,
        broad=1.6,
    )  # fmt: skip
    at, low = np.arange(len(outputs)), 0.5
    draws: list[Drawn] = [
        bars(at - 0.19, low, np.maximum(shrink.energy_before, low), 0.34, colour="white", edge=COLOURS[1]),
        bars(at + 0.19, low, np.maximum(shrink.energy_after, low), 0.34, colour=COLOURS[0]),
        Rule(at=1.0, colour=INK, dash=_FLOOR),
    ]
    energies = Panel(
        draws=draws, x="mean squared residual, noise = 1", log_x=True,
        x_range=(low, max(2.0, 1.5 * float(shrink.energy_before.max()))),
        **rows([symbol(o) for o in outputs], 0.28),
    )  # fmt: skip
    caption = (
        f"The manoeuvre '{shrink.manoeuvre}' was used neither for the search nor for the fit. Left: "
        f"{symbol(outputs[k])}, which has the largest error of the a-priori model. Right: residuals of all channels. "
        "Open bars are those of the a-priori model, full bars those of the amended one; the dashed line is the noise "
        "floor."
    )
    title = "The amended model on a held-out flight"
    return Plate("answer", title, caption, Chart([[history, energies]]))


def _energy(channels: Sequence[str], energy: FloatArray) -> dict[str, Any]:
    """Return the settings of a panel that shows the energy (n, channels) of residuals as colours."""
    image = Image(
        values=energy.T, low=1.0, high=_TOP_ENERGY, log=True, title="residual energy, noise = 1",
        ticks=[(at, f"{'≥' * (at >= _TOP_ENERGY)}{at}") for at in (1, 3, 10, 30, 100)],
    )  # fmt: skip
    return {
        "draws": [image], "y_ticks": [(k, symbol(c)) for k, c in enumerate(channels)],
        "tall_in": 0.19 * len(channels) + 0.3,
    }  # fmt: skip


def _region_plate(result: GapResult) -> Plate:
    """Return maps of residual energy over the flight region: one quantity per panel, channel by bin."""
    panels = []
    for region in result.finding.regions:
        factor = shown_unit(region.quantity)[0]
        ticks = [
            (k - 0.5, number(factor * region.edges[k])) for k in (0, len(region.edges) // 2, len(region.edges) - 1)
        ]
        shown = _energy(region.channels, region.energy)
        panels.append(Panel(x=axis_label(region.quantity), x_ticks=ticks, **shown))
    caption = (
        "The same residuals over angle of attack, airspeed, pitch rate and the commands, all manoeuvres together. A "
        "gap at one end of a quantity depends on that quantity. Grey: too few samples."
    )
    title = "Residual over the flight region"
    return Plate("residual_regions", title, caption, grid(panels, min(3, len(panels))))


def _map_plate(result: GapResult) -> Plate:
    """Return two maps per manoeuvre: by frequency band and by time."""
    bands = [(k, f"{low:g}–{high:g}") for k, (low, high) in enumerate(BANDS_HZ)]
    maps = [
        [
            Panel(title=m.manoeuvre, x="frequency, Hz", x_ticks=bands, **_energy(m.channels, m.by_band)),
            Panel(x=f"t, windows of {m.window_s:g} s", whole="x", broad=1.6, **_energy(m.channels, m.by_time)),
        ]
        for m in result.finding.maps
    ]
    caption = (
        "Energy of measured minus predicted, in units of the noise energy, in the manoeuvres of the search: each "
        "channel over frequency bands and over time. The left end of the colour bar is noise, the right end is "
        "unexplained by the model."
    )
    return Plate("residual_maps", "Residual by channel, frequency and time", caption, Chart(maps))


def _lacking_plate(result: GapResult) -> Plate:
    """Return what the believed model lacks over time: a row for each state, a column for each manoeuvre."""
    lacks = result.finding.lacks

    def told(a: FloatArray, std: FloatArray) -> float:  # of a state that nothing moved both are zero
        return _largest(np.divide(a, std, out=np.zeros_like(a), where=std > 0.0))

    ratio = {s: max(told(one.accelerations[s], one.std[s]) for one in lacks) for s in lacks[0].accelerations}
    states = [s for s in ratio if ratio[s] > _TOLD] or [max(ratio, key=lambda s: ratio[s])]
    panels = []
    for state in states:
        factor, unit = shown_unit(state)
        per_s = f"{unit.removesuffix('/s')}/s²" if unit.endswith("/s") else f"{unit}/s"
        top = 1.05 * factor * max(_largest(np.abs(one.accelerations[state]) + 2.0 * one.std[state]) for one in lacks)
        row = []
        for one in lacks:
            x = np.repeat(one.t_s, 2)[1:-1]  # edges of the stretches, in which the values hold
            value, half = np.repeat(factor * one.accelerations[state], 2), np.repeat(2.0 * factor * one.std[state], 2)
            draws: list[Drawn] = [
                band(x, value - half, value + half, BAND, alpha=None),
                Curve(x=x, y=value, colour=COLOURS[0], width=1.2),
                Rule(at=0.0, of="y", colour=INK, width=0.6),
            ]
            row.append(
                Panel(draws=draws, title=one.manoeuvre, x="t, s", y=f"d{symbol(state)}/dt, {per_s}",
                      y_range=(-top, top), tall_in=1.05)
            )  # fmt: skip
        panels.append(row)
    caption = (
        "Accelerations that an unknown motion would have to add to the a-priori model, in stretches of half a second, "
        "of the manoeuvres with the largest residuals. Grey: two standard errors. States in which they are zero "
        "within these limits are left out."
    )
    chart = Chart(panels, share_x=True, share_y=True)
    return Plate("lacking", "Missing acceleration over time", caption, chart)


def _largest(x: FloatArray) -> float:
    return float(np.max(np.abs(x)))


def _ranking_plate(result: GapResult) -> Plate:
    """Return one bar per effect, the best on top."""
    fits, weighed = result.finding.naming.ranking, result.finding.naming.weighed
    at, whole = range(len(fits)), [100.0 * f.probability for f in fits]
    both = [a + 100.0 * f.imitates for a, f in zip(whole, fits, strict=True)]
    draws = [bars(at, 0.0, whole, 0.55, colour=COLOURS[0]), bars(at, whole, both, 0.55)]
    panel = Panel(draws=draws, x="probability, %", x_range=(0.0, 100.0), **rows([f.effect.title for f in fits], 0.36))
    caption = (
        "Blue: probability that this is all that the model lacks. Grey: probability that it only resembles something "
        f"which the library lacks. Nothing is missing: {percent(weighed.nothing)}; something is, and nothing is near "
        f"it: {percent(weighed.imitates('nothing'))}."
    )
    return Plate("ranking", "Which effect explains it", caption, Chart([[panel]]))


# --- before and after -------------------------------------------------------------------------------------------------


def _history_plate(result: GapResult, shrink: Shrink, nth: int) -> Plate:
    panels = [
        Panel(
            draws=_flown(shrink, i, name), x="t, s", y=axis_label(name), tall_in=1.0,
            notes=[(f"{number(shrink.energy_before[i])} → {number(shrink.energy_after[i])}", QUIET)],
        )
        for i, name in enumerate(result.finding.believed.outputs)
    ]  # fmt: skip
    caption = (
        "This manoeuvre was used neither for the search nor for the fit. Numbers above a panel: mean squared residual "
        "before and after, the noise being 1. Predictions are shifted to the mean of the measurement, as sensor "
        "biases are unknown."
    )

    views = [View(name=shrink.manoeuvre, panels=panels, reference="measured")]
    title = f"Before and after on a held-out manoeuvre: {shrink.manoeuvre}"
    return Plate(f"held_out_{nth}", title, caption, grid(panels, 1, share_x=True), views)


def _spectrum_plate(result: GapResult, shrink: Shrink, nth: int) -> Plate:
    believed = result.finding.believed
    measured, share = shrink.record.columns(believed.outputs), shrink.taken / len(shrink.record)
    sides = [believed.in_noise_units(shrink.record, measured - y) for y in (shrink.before, shrink.after)]
    panels = []
    for i, name in enumerate(believed.outputs):
        found = [_spectrum(side[:, i], shrink.record.dt_s) for side in sides]
        draws = [
            Curve(x=f, y=density / max(float(share[i]), 1e-9), **look)
            for (f, density), look in zip(found, (_BEFORE, _AFTER), strict=True)
        ]
        f = found[0][0]
        floor = Curve(x=f, y=np.ones_like(f), name="noise floor", width=0.9, dash=_FLOOR)
        panels.append(
            Panel(draws=[*draws, floor], title=symbol(name), x="f, Hz", y="residual, noise = 1", log_x=True, log_y=True,
                  tall_in=1.3, name=f"{symbol(name)}, noise = 1", hidden=i > 3)
        )  # fmt: skip
    caption = "Spectrum of the residual in units of the noise density, averaged over overlapping segments."
    if result.finding.air.moves:
        caption += " Turbulence is removed by the Kalman filter of the search."
    return Plate(
        f"held_out_{nth}_spectrum",
        f"The residual by frequency: {shrink.manoeuvre}",
        caption,
        grid(panels, 3, share_x=True),
        [View(name="spectra", panels=panels)],
    )


def _spectrum(residual: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies, Hz, and the power of ``residual`` (n,) relative to unit white noise (Welch's method)."""
    from scipy.signal import welch

    length = 2 * residual.size // (_SEGMENTS + 1)
    f, density = welch(residual, fs=1.0 / dt_s, nperseg=length, detrend="constant")
    return f[1:-1], density[1:-1] / (2.0 * dt_s)
