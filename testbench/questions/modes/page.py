"""The page of modes found without an input: tables, stabilisation, spectra, shapes, trends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.estimators.operational.onset import CLEARANCE, tracked
from testbench.page import figure as fig
from testbench.page.labels import number
from testbench.page.page import COMPUTED, FLOWN, Page, json_text
from testbench.page.tables import Column, Table, Value
from testbench.questions.modes.answer import modes_answer

if TYPE_CHECKING:
    from testbench.estimators.model import ComplexArray
    from testbench.estimators.operational import Onset
    from testbench.evaluation.operational import ModeMatch, TrueMode
    from testbench.questions.modes.result import ModesResult

_DECADES = 5.0  # of the spectrum that are shown
_FEWEST = 3  # stations along the wing from which on a shape is drawn


def modes_page(result: ModesResult) -> Page:
    """Return the page of operational modes: of a flight in turbulence, or of records."""
    return Page(
        kicker=f"Operational modes: {result.name}",
        title=result.title,
        question=result.question,
        answer=modes_answer(result),
        tables=modes_tables(result),
        plates=modes_plates(result),
        files={"models/modes.json": json_text(result.found.to_dict()), **_clearance(result)},
        packages=FLOWN if result.true else COMPUTED,
        source=(f"{result.name}.toml", result.source) if result.source else ("records", "\n".join(result.records)),
        terminal=[modes_table(result).without("remarks")],
    )


def _clearance(result: ModesResult) -> dict[str, str]:
    """Return the file that `testbench plan --after` reads; none for records of one speed."""
    if not result.at:
        return {}
    told = [(p, result.onset.quantile(p)) for p in (0.01, 0.05, 0.5, 0.95)] if result.onset is not None else []
    found = {f"{p:g}": V for p, V in told if math.isfinite(V)}
    said = {"flown_m_s": list(result.at), "cleared_m_s": result.cleared_m_s, "risk": result.risk, "onset_m_s": found}
    return {CLEARANCE: json_text(said)}


# --- tables -----------------------------------------------------------------------------------------------------------


def modes_tables(result: ModesResult) -> list[Table]:
    """Return the modes, their comparison with the linear model if there is one, and their shapes."""
    out = [*([trend_table(result)] if result.at else []), modes_table(result)]
    if result.true:
        out.append(_comparison_table(result))
    return [*out, _shape_table(result)]


def modes_table(result: ModesResult) -> Table:
    """Return frequency and damping of every mode with their errors."""
    columns = (
        Column("mode", "mode", get=lambda x: x[0]),
        Column("frequency", "frequency", "Hz", digits=4, get=lambda x: x[1].frequency_hz),
        Column("frequency_std", "its std", "Hz", digits=2, get=lambda x: x[1].frequency_std_hz),
        Column("damping", "damping ratio", digits=3, get=lambda x: x[1].damping),
        Column("damping_std", "its std", digits=2, get=lambda x: x[1].damping_std),
        Column("orders", "orders", get=lambda x: len(x[1].orders)),
        Column("remarks", "doubts", get=lambda x: "; ".join(x[1].remarks) or None),
    )
    criteria = result.found.settings["criteria"]
    caption = (
        f"Standard deviations come from {result.found.blocks} blocks of data; a 95 % interval reaches "
        f"{result.found.quantile:.2f} of them either way. Orders: at how many of {len(result.found.views)} "
        f"orders the mode was stable (frequency within {100 * criteria['frequency']:g} %, damping within "
        f"{100 * criteria['damping']:g} %, MAC at least {criteria['mac']:g} from order to order). A mode is reported "
        f"if it was stable at {criteria['least_orders']} orders or more and its standard deviations are at most "
        f"{100 * criteria['frequency_error']:g} % in frequency and {100 * criteria['damping_error']:g} % in damping."
    )
    return Table.of("modes", "Modes found", caption, columns, enumerate(result.found.modes, 1), wide=True)


def trend_table(result: ModesResult) -> Table:
    """Return frequency and damping of each mode at each speed of a build-up."""
    tracks = result.onset.tracks if result.onset is not None else tracked(list(result.at.values()))
    columns = [Column("V", "V", "m/s", digits=4)]
    for k in range(1, len(tracks) + 1):
        columns.append(Column(f"frequency_{k}", "frequency", "Hz", f"mode {k}", digits=4))
        columns.append(Column(f"frequency_std_{k}", "its std", "Hz", f"mode {k}", digits=2))
        columns.append(Column(f"damping_{k}", "damping ratio", "", f"mode {k}", digits=3))
        columns.append(Column(f"damping_std_{k}", "its std", "", f"mode {k}", digits=2))
    rows: list[tuple[Value, ...]] = []
    for i, V in enumerate(result.at):
        here = [t[i] for t in tracks]
        cells = [(m.frequency_hz, m.frequency_std_hz, m.damping, m.damping_std) if m else (None,) * 4 for m in here]
        rows.append((V, *(x for four in cells for x in four)))
    caption = (
        "Modes followed from speed to speed by pole and shape; where one has no figures it was not found. Damping "
        "alone may rise until shortly before the onset; frequencies that come together are the earlier sign."
    )
    return Table("trend", "Modes over speed", caption, tuple(columns), tuple(rows), wide=True)


def _comparison_table(result: ModesResult) -> Table:
    f, z = "frequency", "damping ratio"
    columns = (
        Column("mode", "mode", get=lambda m: m.true.name if m.true else "none of the linear model"),
        Column("true_frequency", "model", "Hz", f, digits=4, get="true.frequency_hz"),
        Column("frequency", "found", "Hz", f, digits=4, get="found.frequency_hz"),
        Column("frequency_error", "error", "%", f, decimals=1, get=_off_percent),
        Column("frequency_error_std", "error / std", "", f, decimals=1,
               get=lambda m: m.off("frequency_hz", "frequency_std_hz")),
        Column("true_damping", "model", "", z, digits=3, get="true.damping"),
        Column("damping", "found", "", z, digits=3, get="found.damping"),
        Column("damping_error_std", "error / std", "", z, decimals=1, get=lambda m: m.off("damping", "damping_std")),
        Column("mac", "MAC", decimals=3),
    )  # fmt: skip
    caption = (
        "Oscillatory modes of the aircraft linearised at trim, with those found. MAC: similarity of the shapes at the "
        "sensors, outputs divided by their rms."
    )
    title = "Modes found and those of the linear model"
    return Table.of("modes_and_model", title, caption, columns, result.matches)


def _off_percent(match: ModeMatch) -> float | None:
    if match.true is None or match.found is None:
        return None
    return 100.0 * (match.found.frequency_hz / match.true.frequency_hz - 1.0)


def _shape_table(result: ModesResult) -> Table:
    modes = result.found.modes
    columns = [Column("channel", "channel")]
    for k in range(1, len(modes) + 1):
        columns.append(Column(f"magnitude_{k}", "magnitude", "", f"mode {k}", digits=3))
        columns.append(Column(f"phase_{k}", "phase", "deg", f"mode {k}", decimals=0))
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (name, *(x for m in modes for x in (float(abs(m.shape[i])), float(np.degrees(np.angle(m.shape[i]))))))
        for i, name in enumerate(result.found.channels)
    )
    caption = (
        "SI units of the channels, divided by the output that moves most for its rms. Phases near 0 or 180 deg mean a "
        "real shape."
    )
    return Table("shapes", "Mode shapes", caption, tuple(columns), rows)


# --- figures ----------------------------------------------------------------------------------------------------------


def modes_plates(result: ModesResult) -> list[fig.Plate]:
    """Return the trend over speed, the stabilisation diagram, and shapes where at least three sensors have a place."""
    places = [y for y in result.stations_m if y is not None]
    trend = [_trend(result, result.onset)] if result.onset is not None else []
    return [*trend, _stabilisation(result), *([_shapes(result)] if len(set(places)) >= _FEWEST else [])]


def _trend(result: ModesResult, onset: Onset) -> fig.Plate:
    caption = (
        "Natural frequency and damping ratio of each mode over speed with 95 % intervals, and the probability that "
        "flutter begins at or below a speed. Dashed: the speed that is cleared."
    )
    V, cleared = onset.V_m_s, fig.Rule(at=result.cleared_m_s, colour=fig.INK, dash=fig.DASHED, name="cleared")
    reach = (float(V[0]) * 0.97, max(min(onset.quantile(0.95), 1.5 * float(V[-1])), 1.1 * float(V[-1])))
    rows: list[list[fig.Drawn]] = [[cleared], [cleared]]
    for k, track in enumerate(onset.tracks):
        seen = [(v, m) for v, m in zip(V, track, strict=True) if m is not None]
        x = np.array([v for v, _ in seen])
        figures = [(m.frequency_hz, m.frequency_std_hz, m.damping, m.damping_std) for _, m in seen]
        f, f_std, zeta, zeta_std = np.array(figures).T
        look: dict[str, Any] = {"colour": fig.COLOURS[k % 6], "marker": fig.MARKERS[k % 6], "joined": True}
        rows[0].append(fig.Curve(x=x, y=f, y_error=1.96 * f_std, name=f"mode {k + 1}", **look))
        rows[1].append(fig.Curve(x=x, y=zeta, y_error=1.96 * zeta_std, **look))
    ahead = np.linspace(*reach, 200)
    risk = fig.Curve(x=ahead, y=np.array([onset.risk(v) for v in ahead]), colour=fig.WARN)
    axes: list[tuple[str, list[fig.Drawn]]] = [
        ("natural frequency, Hz", rows[0]),
        ("damping ratio", rows[1]),
        ("probability of flutter", [risk, cleared]),
    ]
    panels = [
        fig.Panel(draws=draws, x="airspeed, m/s" if y.startswith("prob") else "", y=y, x_range=reach,
              y_range=(0.0, None), tall_in=1.9)
        for y, draws in axes
    ]  # fmt: skip
    return fig.Plate("trend", "Towards the onset of flutter", caption, fig.grid(panels, 1))


def _stabilisation(result: ModesResult) -> fig.Plate:
    truth = " Ticks at the upper edge: modes of the linear model." if result.true else ""
    caption = (
        "Every pole of every model order over its frequency. Coloured: modes, which recur at order after order, with "
        "their 95 % intervals shaded. Rings: stable from one order to the next, but at too few orders or with too "
        f"large errors. Dots: the rest, which is noise. Grey line: mean spectrum of the outputs.{truth}"
    )
    found, draws = result.found, list[fig.Drawn]()
    low, high = found.settings["band_hz"]
    f = np.concatenate([v.frequency_hz for v in found.views])
    order = np.concatenate([np.full(v.frequency_hz.size, v.order) for v in found.views])
    stable, mode = (np.concatenate([getattr(v, what) for v in found.views]) for what in ("stable", "mode"))
    looks: list[tuple[Any, dict[str, Any]]] = [
        (mode == k, {"marker": fig.MARKERS[k % 6], "colour": fig.COLOURS[k % 6], "order": 3.0,
                     "name": f"{number(m.frequency_hz)} Hz, ζ {number(m.damping, 2)}"})
        for k, m in enumerate(found.modes)
    ]  # fmt: skip
    looks.append((stable & (mode < 0), {"marker": "o", "size": 4.5, "hollow": "white", "name": "stable, no mode"}))
    looks.append((~stable, {"marker": ".", "size": 3.5, "name": "not stable"}))
    draws += [fig.Curve(x=f[these], y=order[these], **{"colour": fig.QUIET} | look) for these, look in looks]
    for k, m in enumerate(found.modes):
        half = found.quantile * m.frequency_std_hz
        draws.append(
            fig.Span(low=m.frequency_hz - half, high=m.frequency_hz + half, colour=fig.COLOURS[k % 6], alpha=0.16)
        )
    top = found.views[-1].order + 2.0
    if result.true:
        x = np.array([t.frequency_hz for t in result.true])
        draws.append(fig.Curve(x=x, y=np.full(x.size, top), marker="|", size=20.0, name="linear model"))
    panel = fig.Panel(
        draws=draws, x="frequency, Hz", y="model order", x_range=(low, high), y_range=(0.0, top), tall_in=3.6,
        right=_spectrum(found.spectrum, low, high),
    )  # fmt: skip
    return fig.Plate("stabilisation", "Stabilisation diagram", caption, fig.Chart([[panel]]))


def _spectrum(spectrum: Any, low: float, high: float) -> fig.Panel | None:
    """Return the mean spectrum of the outputs, to lie behind the poles; None if it is nothing."""
    f, density = spectrum.T
    shown = (f >= low) & (f <= high)
    peak = float(density[shown].max(initial=0.0))
    if peak <= 0.0:
        return None
    line = fig.Curve(x=f[shown], y=density[shown], colour=fig.MEASURED, width=1.1)
    return fig.Panel(draws=[line], log_y=True, y_range=(peak * 10.0**-_DECADES, peak * 10.0**0.4), behind=True)


def _shapes(result: ModesResult) -> fig.Plate:
    caption = (
        "Motion of each mode at the sensors along the span, turned to the phase in which it is largest and divided by "
        "the largest. Circles: accelerometers; squares: strain gauges. Line without colour: the matching mode of the "
        "linear model, with the MAC of the two. A sensor off the elastic axis measures twist as well as bending."
    )
    true = {m.index: m for m in result.matches if m.index is not None}
    panels = []
    for k, mode in enumerate(result.found.modes):
        match = true.get(k)
        likeness = f", MAC {match.mac:.3f}" if match is not None and match.mac is not None else ""
        draws = _shape(result, mode.shape, match.true if match else None, fig.COLOURS[k % 6])
        panels.append(
            fig.Panel(draws=draws, title=f"{number(mode.frequency_hz)} Hz{likeness}", x="y along the span, m",
                  y="motion over the largest", y_range=(-1.15, 1.15), tall_in=1.7)
        )  # fmt: skip
    columns = min(len(panels), 3)
    chart = fig.grid(panels, columns, share_y=True, share=1.0 if columns == 3 else columns / 3.0 + 0.1)
    return fig.Plate("shapes", "Mode shapes at the sensors", caption, chart)


def _shape(result: ModesResult, shape: ComplexArray, true: TrueMode | None, colour: str) -> list[fig.Drawn]:
    out: list[fig.Drawn] = [fig.Rule(at=0.0, of="y", colour=fig.FAINT)]
    for kind, marker in (("az_wing_", "o"), ("strain_wing_", "s")):
        here = [
            (y, i)
            for i, (name, y) in enumerate(zip(result.found.channels, result.stations_m, strict=True))
            if y is not None and name.startswith(kind)
        ]
        if not here:
            continue
        y, rows = (np.array(x) for x in zip(*sorted(here), strict=True))
        found = _real(shape[rows])
        if true is not None:
            line = _real(true.shape[rows])
            sign = np.sign(found @ line) or 1.0
            out.append(fig.Curve(x=y, y=sign * line, colour=fig.INK, width=1.0))
        out.append(fig.Curve(x=y, y=found, marker=marker, colour=colour, size=5.5))
    return out


def _real(shape: ComplexArray) -> Any:
    """Return the real part of a shape (r,) in the phase in which its energy is largest, over its largest element."""
    turned = (shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))).real
    return turned / max(float(np.abs(turned).max()), 1e-300)
