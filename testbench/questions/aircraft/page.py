"""The page on an aircraft: tables and figures of trim, modes over speed, shapes and responses."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.channels import CHANNELS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.evaluation.derivatives import dimensional_derivatives, lift_per_rad
from testbench.evaluation.modes import frequency_and_damping
from testbench.flight.limits import steady_sideslip
from testbench.flight.thrust import full_thrust_N
from testbench.page import figure as fig
from testbench.page.labels import axis_label, ratio_unit, shown_unit, symbol
from testbench.page.page import Page
from testbench.page.tables import Column, Table, Value
from testbench.questions.aircraft.adopt import found_table
from testbench.questions.aircraft.answer import aircraft_answer, shapes_missing
from testbench.questions.aircraft.three_view_figures import three_view_plates

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.aircraft.elastic import ElasticMode
    from testbench.core.record import FloatArray
    from testbench.evaluation.envelope import Envelope
    from testbench.flight.adopt import Adopted
    from testbench.questions.aircraft.ask import Survey


_UNSTABLE = "#fbe9e0"
_RESPONSES = ("V", "q", "alpha", "theta")
_NO_CLEARANCE = " The curves are for the quasi-steady aerodynamics of the flights; they are no flutter clearance."


def aircraft_page(survey: Survey) -> Page:
    """Return the page of a survey; the modes at all speeds are only in a file."""
    aircraft = survey.envelope.aircraft
    return Page(
        kicker=f"Aircraft: {aircraft.name}",
        title=aircraft.title,
        heading="In short",
        answer=aircraft_answer(survey),
        tables=aircraft_tables(survey),
        more_tables=[modes_over_speed(survey)],
        plates=aircraft_plates(survey),
        template="questions/aircraft/page.html.j2",
        context={"envelope": survey.envelope, "aircraft": aircraft, "shapes_missing": shapes_missing(survey)},
        terminal=[
            trim_table(survey).without("qbar"),
            mode_table(survey).without("motion"),
            *([law_table(survey).without("motion")] if survey.by_law else []),
        ],
    )


def adopted_page(adopted: Adopted, survey: Survey, folder: Path) -> Page:
    """Return the page of an adopted model: that of its survey, with what was found and what was assumed before it."""
    page, table = aircraft_page(survey), found_table(adopted)
    name = survey.envelope.aircraft.name
    return replace(
        page,
        kicker=f"Aircraft adopted: {name}",
        tables=[table, *page.tables],
        terminal=[table, *page.terminal],
        notes=[*page.notes, f"edit {folder}/aircraft.toml as you like: it is checked when it is loaded"],
        closing=[("Aircraft", f'{folder}, in a scenario: aircraft = "{name}"'), *page.closing],
    )


def folder_name(aircraft: Aircraft, name: str) -> str:
    """Return the name of the folder of results: the aircraft's name, with rigid wings told from flexible ones."""
    return f"aircraft_{name}" + ("_rigid" if "rigid" in aircraft.name.removeprefix(name) else "")


# --- tables -----------------------------------------------------------------------------------------------------------


def aircraft_tables(survey: Survey) -> list[Table]:
    """Return the tables of the page that there is something to fill with."""
    made = [
        trim_table(survey),
        untrimmed_table(survey),
        limit_table(survey),
        mode_table(survey),
        law_table(survey),
        elastic_table(survey),
        derivative_table(survey),
        coefficient_table(survey.envelope.aircraft),
    ]
    return [table for table in made if table.rows]


def trim_table(survey: Survey) -> Table:
    """Return attitude, controls and static deflections at the tabled speeds."""
    envelope = survey.envelope
    channels = ["alpha", *(n for n in ("de", "thr") if n in envelope.aircraft.controls)]
    modal = [f"eta_{envelope.elastic[n]}" for n in envelope.names("longitudinal", elastic=True)]
    columns = [Column("V", "V", "m/s", given=True, digits=5), Column("qbar", "q̄", "Pa", decimals=0)]
    columns += [Column(c, symbol(c), shown_unit(c)[1], decimals=2) for c in channels]
    columns.insert(3, Column("gamma", "γ", "deg", "flight path", decimals=2))
    if "de" in channels:
        columns += [
            Column(f"de_{way}", f"{symbol('de')} {way}", "deg", "left for an input", decimals=1)
            for way in ("up", "down")
        ]
    columns += [Column(c, symbol(c), "", "static deflection", digits=3) for c in modal]
    rows: list[tuple[Value, ...]] = []
    for V in survey.tabled:
        t = envelope.trims[envelope.nearest(V)]
        held = {"alpha": t.alpha / DEG_RAD, "de": t.controls.get("de", 0.0) / DEG_RAD}
        held["thr"] = t.controls.get("thr", 0.0) / PERCENT
        left = [a / DEG_RAD for a in survey.elevator_left(V)] if "de" in channels else []
        alpha, *commands = (held[c] for c in channels)
        path = t.condition.gamma_rad / DEG_RAD
        rows.append((V, t.state["qbar"], alpha, path, *commands, *left, *(t.state[c] for c in modal)))
    flight = "level flight" if "thr" in channels else "descent, without thrust,"
    caption = f"Steady {flight} at {envelope.h_m:g} m in the standard atmosphere; controls as commanded."
    if "de" in channels:
        caption += " Left for an input: how far the elevator turns from trim to its stops, trailing edge up and down."
    if modal:
        caption += " Deflections are those of the symmetric modes, each in its own unit (table of elastic modes)."
    return Table("trim", "Trim over speed", caption, tuple(columns), tuple(rows))


def untrimmed_table(survey: Survey) -> Table:
    """Return the speeds that cannot be flown, and why."""
    caption = (
        "Speeds just outside the range, and others that were asked for. The ends of the range are known to "
        f"{survey.range.step_m_s:g} m/s."
    )
    columns = (Column("V", "V", "m/s", given=True, digits=5, get="V_m_s"), Column("reason", "reason"))
    return Table.of("untrimmed", "Speeds that cannot be trimmed", caption, columns, survey.untrimmed)


def limit_table(survey: Survey) -> Table:
    """Return the limits of flights, and what controls and engines can do at the design speed, with their sources."""
    envelope = survey.envelope
    aircraft, trimmed, model = envelope.aircraft, envelope.trims[envelope.design], envelope.models[envelope.design]
    V = envelope.speeds[envelope.design]
    rows: list[tuple[Value, ...]] = []
    for channel, (low, high) in aircraft.limits.items():
        factor, unit = shown_unit(channel) if channel in CHANNELS else (1.0, "")  # a deflection in its mode's own unit
        name = symbol(channel) if channel in CHANNELS else channel
        rows.append((name, low * factor, high * factor, unit, aircraft.limit_source(channel)))
    rows.append(("level flight", survey.range.slowest, survey.range.fastest, "m/s", "found by trimming"))
    if "alpha" in aircraft.limits:
        lift = lift_per_rad(model, V)
        n = [math.cos(trimmed.condition.gamma_rad) + lift * (a - trimmed.alpha) for a in aircraft.limits["alpha"]]
        rows.append(("load factor", *n, "", f"lift at the limits of alpha and {V:g} m/s, linear about trim"))
    for control, axis in (("de", "q"), ("da", "p"), ("dr", "r")):
        if control not in aircraft.controls:
            continue
        i, j = model.states.index(axis), model.inputs.index(control)
        ends = (aircraft.controls[control].low, aircraft.controls[control].full)
        moved = sorted(float(model.B[i, j]) * (end - trimmed.controls[control]) / DEG_RAD for end in ends)
        said = f"{control} from trim to its stops at {V:g} m/s, linear"
        rows.append((symbol(f"{axis}dot"), *moved, "deg/s²", said))
        if control == "da" and model.A[i, i] < 0.0:
            rolls = [float(-x / model.A[i, i]) for x in moved]
            rows.append((symbol("p"), *rolls, "deg/s", f"full aileron in steady roll at {V:g} m/s: L_da da / L_p"))
    held = steady_sideslip(aircraft.commanded_at("surface"), trimmed)
    if held is not None:
        said = f"full rudder in steady straight flight at {V:g} m/s, found by trimming"
        rows.append((symbol("beta"), -held / DEG_RAD, held / DEG_RAD, "deg", said))
    if "thr" in aircraft.controls:
        most = full_thrust_N(aircraft.commanded_at("surface"), trimmed)
        rows.append(("thrust", 0.0, most, "N", f"engines at full throttle and {V:g} m/s"))
    columns = (
        Column("of", "of"),
        Column("lowest", "lowest", digits=4),
        Column("highest", "highest", digits=4),
        Column("unit", "unit"),
        Column("source", "where it comes from"),
    )
    caption = (
        "First the limits at which a flight is stopped, then those of trim, surfaces and engines. Limits assumed by "
        "the testbench are not limits of the aircraft: state your own in [limits] of aircraft.toml."
    )
    return Table("limits", "Limits, and where they come from", caption, columns, tuple(rows), wide=True)


_MODE_COLUMNS = (
    Column("re", "Re s", "rad/s", digits=4),
    Column("im", "Im s", "rad/s", digits=4),
    Column("f", "|s|/2π", "Hz", digits=4),
    Column("zeta", "ζ", digits=3),
)


def _of_pole(pole: complex) -> tuple[Value, ...]:
    """Return the values of :data:`_MODE_COLUMNS`: a real root alone has no damping ratio."""
    wn, zeta = frequency_and_damping(pole)
    return pole.real, pole.imag, wn / (2.0 * math.pi), zeta if pole.imag else None


def mode_table(survey: Survey) -> Table:
    """Return all poles at the design speed, by name."""
    envelope = survey.envelope
    rows: list[tuple[Value, ...]] = []
    for name, motion in envelope.motion.items():
        for root, pole in _roots(name, envelope.poles[envelope.design][name]):
            half = math.log(2.0) / -pole.real if pole.real else None
            rows.append((root, motion, *_of_pole(pole), half))
    caption = (
        "Poles of the linearised aircraft without servo lags; longitudinal and lateral-directional motion are taken "
        "separately. T½: time to half amplitude; negative: to double amplitude."
    )
    columns = (Column("mode", "mode"), Column("motion", "motion"), *_MODE_COLUMNS, Column("t_half", "T½", "s"))
    title = f"Modes at {envelope.speeds[envelope.design]:g} m/s"
    return Table("modes", title, caption, columns, tuple(rows))


def law_table(survey: Survey) -> Table:
    """Return the poles at the design speed without the model's own control law and with it."""
    envelope = survey.envelope
    rows: list[tuple[Value, ...]] = []
    for name, motion in (envelope.motion if survey.by_law else {}).items():
        for way, found in (("without", envelope.poles[envelope.design]), ("with", survey.by_law)):
            for root, pole in _roots(name, found[name]):
                rows.append((root, motion, way, *_of_pole(pole)))
    columns = (Column("mode", "mode"), Column("motion", "motion"), Column("law", "control law"), *_MODE_COLUMNS)
    caption = (
        "Poles of the linearised aircraft with its surfaces held, and with the model's own control law, followed by "
        "name while the law's part grows from nothing. The other tables are those of the aircraft without it."
    )
    return Table("law", f"Modes with the control law at {envelope.speeds[envelope.design]:g} m/s", caption, columns,
                 tuple(rows))  # fmt: skip


def _roots(mode: str, poles: Sequence[complex]) -> list[tuple[str, complex]]:
    """Return the poles of a mode with names: its own, or those of the two real roots that it has split into."""
    if len(poles) == 1:
        return [(mode, poles[0])]
    slow, fast = sorted(poles, key=abs)
    return [(f"{mode}, slow root", slow), (f"{mode}, fast root", fast)]


def modes_over_speed(survey: Survey) -> Table:
    """Return the poles of all modes at all speeds, one per row."""
    envelope = survey.envelope
    rows: list[tuple[Value, ...]] = []
    for V, found in zip(envelope.speeds, envelope.poles, strict=True):
        for name, motion in envelope.motion.items():
            for root, pole in _roots(name, found[name]):
                rows.append((V, root, motion, *_of_pole(pole)))
    columns = (Column("V", "V", "m/s"), Column("mode", "mode"), Column("motion", "motion"), *_MODE_COLUMNS)
    return Table("modes_over_speed", "Modes over speed", "Each mode at each speed.", columns, tuple(rows))


def elastic_table(survey: Survey) -> Table:
    """Return each elastic mode in vacuo, and coupled with the air at the design speed."""
    envelope = survey.envelope
    flown = envelope.aircraft.flown_modes()
    rows: list[tuple[Value, ...]] = []
    for name, i in envelope.elastic.items():
        mode = flown.modes[i - 1] if flown else None
        wn, zeta = frequency_and_damping(envelope.poles[envelope.design][name][-1])
        onset = envelope.onset(name)
        said = onset.sentence.removeprefix(f"{name}: ")
        if mode is not None:
            given = (mode.f_hz, mode.zeta, mode.mass_kg_m2)
            rows.append((f"η{i}", name, mode.symmetry, *given, wn / (2.0 * math.pi), zeta, said))
    columns = (
        Column("number", ""),
        Column("mode", "mode"),
        Column("symmetry", "symmetry"),
        Column("f_gvt", "f", "Hz", "ground vibration", given=True),
        Column("zeta_gvt", "ζ", "", "ground vibration", given=True),
        Column("mass", "mass", "kg m²", "ground vibration", given=True),
        Column("f", "f", "Hz", "coupled", decimals=2),
        Column("zeta", "ζ", "", "coupled", digits=3),
        Column("onset", "onset of instability"),
    )
    caption = (
        "Left: as a ground vibration test finds them. Right: the same modes coupled with the air and the rigid motion "
        f"at {envelope.speeds[envelope.design]:g} m/s, and the speed at which the damping of a mode becomes negative."
    )
    return Table("elastic_modes", "Elastic modes", caption, columns, tuple(rows), wide=True)


def derivative_table(survey: Survey) -> Table:
    """Return the dimensional derivatives at the design speed."""
    envelope = survey.envelope
    found = dimensional_derivatives(envelope.models[envelope.design], envelope.trims[envelope.design])
    flexible = any(d.static is not None for d in found)
    columns = [Column("derivative", "", get="name"), Column("meaning", "meaning"), Column("unit", "unit")]
    if flexible:
        columns += [Column("held", "modes held", digits=4), Column("static", "modes following", digits=4)]
    else:
        columns.append(Column("value", "value", digits=4, get="held"))
    caption = (
        "Accelerations per unit of motion or control, by linearising about trim; angles in rad. Forces along the "
        "stability axes of the trim, without gravity and the accelerations of the turning frame; moments about body "
        "axes, products of inertia included."
    )
    if flexible:
        caption += " Modes held: at their trimmed deflection. Modes following: in static equilibrium with the motion."
    title = f"Dimensional derivatives at {envelope.speeds[envelope.design]:g} m/s"
    return Table.of("derivatives", title, caption, columns, found)


def coefficient_table(aircraft: Aircraft) -> Table:
    """Return every aerodynamic coefficient of the JSBSim model, amendments included, with value and description."""
    tree = ET.fromstring(aircraft.xml)
    if aircraft.adapter is not None and aircraft.amendments:
        aircraft.adapter.apply(tree)  # amendments of a foreign model act on what it brings
    for amendment in aircraft.amendments:
        amendment.apply(tree, aircraft)
    rows: list[tuple[Value, ...]] = []
    for axis in tree.findall("aerodynamics/axis"):
        for function in axis.findall("function"):
            name = (function.get("name") or "").removeprefix("aero/coefficient/")
            value, made_of = _coefficient(function)
            said = " ".join((function.findtext("description") or "").split())
            rows.append((name, (axis.get("name") or "").lower(), value, made_of, said))
    columns = (
        Column("coefficient", "coefficient"),
        Column("axis", "axis"),
        Column("value", "value", given=True, digits=6),
        Column("made_of", "if not one number"),
        Column("description", "description"),
    )
    caption = (
        "Values of the JSBSim XML, dimensionless, angles in rad. Where a coefficient is not one number, the table "
        "gives its terms. The elastic modes add coefficients of their own."
    )
    return Table("coefficients", "Aerodynamic coefficients", caption, columns, tuple(rows), wide=True)


def _coefficient(function: ET.Element) -> tuple[float | None, str]:
    """Return the number of a coefficient, or None and the numbers or tables that it is made of."""
    product = function.find("product")
    direct = [] if product is None else product.findall("value")
    every = [float(e.text or "nan") for e in function.iter("value")]
    tables = sum(1 for _ in function.iter("table"))
    if len(direct) == len(every) == 1 and not tables:
        return every[0], ""
    parts = [f"numbers {', '.join(f'{v:g}' for v in every)}"] if every else []
    parts += [f"{tables} table{'s' if tables > 1 else ''}"] if tables else []
    return None, "; ".join(parts) or "properties only"


# --- figures ----------------------------------------------------------------------------------------------------------


def aircraft_plates(survey: Survey) -> list[fig.Plate]:
    """Return the figures of a survey; the first shows the onset of instability, or trims of a rigid one."""
    modes, trims = _mode_plate(survey, "longitudinal"), _trim_plate(survey)
    lead, second = (modes, trims) if survey.envelope.elastic else (trims, modes)
    out = [lead, *three_view_plates(survey), second, _mode_plate(survey, "lateral-directional")]
    if survey.shaped:
        out.append(_shape_plate(survey))
    if survey.responses and "de" in survey.envelope.aircraft.controls:
        out.append(_response_plate(survey))
    return out


def _elastic_looks(envelope: Envelope, motion: str) -> dict[str, dict[str, Any]]:
    """Return mode -> its name in the legend, colour and dash."""
    return {
        n: {
            "name": f"{symbol(f'eta_{envelope.elastic[n]}')} {n}",
            "colour": fig.COLOURS[k % 6],
            "dash": fig.DASHES[k % 6],
        }
        for k, n in enumerate(envelope.names(motion, elastic=True))
    }


def _over_speed(envelope: Envelope, draws: Sequence[fig.Drawn], **settings: Any) -> fig.Panel:
    """Return a panel over the speeds of an envelope, with the design speed dotted."""
    low, high = envelope.speeds[0], envelope.speeds[-1]
    pad = 0.5 if high == low else 0.0
    design = fig.Rule(at=envelope.speeds[envelope.design], dash=fig.DOTTED, width=0.8)
    return fig.Panel(draws=[*draws, design], x="V, m/s", x_range=(low - pad, high + pad), **settings)


# --- trim -------------------------------------------------------------------------------------------------------------


def _trim_plate(survey: Survey) -> fig.Plate:
    """Return one panel per trimmed quantity, and one for all static deflections."""
    envelope = survey.envelope
    V = np.array(envelope.speeds)
    marked = [envelope.nearest(v) for v in survey.tabled]
    curves = {"alpha": np.array([t.alpha for t in envelope.trims]) / DEG_RAD}
    for name, unit in (("de", DEG_RAD), ("thr", PERCENT)):
        if name in envelope.aircraft.controls:
            curves[name] = np.array([t.controls[name] for t in envelope.trims]) / unit
    panels = []
    for name, y in curves.items():
        draws = [fig.Curve(x=V, y=y), fig.Curve(x=V[marked], y=y[marked], marker="o", size=3.0, clip=False)]
        panels.append(_over_speed(envelope, [*draws, *_zero(y)], y=axis_label(name), tall_in=1.6))
    looks = _elastic_looks(envelope, "longitudinal")
    if looks:
        eta = {n: np.array([t.state[f"eta_{envelope.elastic[n]}"] for t in envelope.trims]) for n in looks}
        lines = [fig.Curve(x=V, y=eta[n], **look) for n, look in looks.items()]
        zero = _zero(np.concatenate(list(eta.values())))
        panels.append(_over_speed(envelope, [*lines, *zero], y="static deflection η", tall_in=1.6))
    caption = (
        f"Steady level flight at {envelope.h_m:g} m; dots: the speeds of the table. Dotted: the design speed."
        f"{' Deflections of the symmetric modes, in the unit of each mode.' if looks else ''}"
    )
    columns = 2 if len(panels) == 4 else len(panels)
    return fig.Plate("trim", "Trim over speed", caption, fig.grid(panels, columns, share_x=True))


def _zero(y: FloatArray) -> list[fig.Drawn]:
    """Return the line at zero where curves pass it."""
    return [fig.Rule(at=0.0, of="y", colour=fig.AXIS, width=0.7)] if y.min() < 0.0 < y.max() else []


# --- modes over speed -------------------------------------------------------------------------------------------------


def _mode_plate(survey: Survey, motion: str) -> fig.Plate:
    """Return damping ratio above frequency, rigid modes beside elastic ones; those of a rigid aircraft in one row."""
    envelope = survey.envelope
    dashes = (fig.DASHES[0], fig.DASHES[1], fig.DASHES[4])
    rigid = {n: {"name": n, "dash": d} for n, d in zip(envelope.names(motion, elastic=False), dashes, strict=False)}
    elastic = _elastic_looks(envelope, motion)
    pairs = [_damping_and_frequency(envelope, "rigid modes", rigid, {})]
    onsets = [envelope.onset(n) for n in elastic]
    unstable = [o for o in onsets if o.V_m_s is not None]
    if elastic:
        found = {n: o.V_m_s for n, o in zip(elastic, onsets, strict=True) if o.V_m_s is not None}
        pairs.append(_damping_and_frequency(envelope, "elastic modes", elastic, found))
    rows = list(zip(*pairs, strict=True)) if elastic else pairs
    said = "; ".join(o.sentence for o in unstable) or (
        f"none up to {envelope.speeds[-1]:g} m/s" if elastic else "no elastic modes in this motion"
    )
    caption = (
        "Damping ratio (above) and frequency (below) of all poles over speed, each mode followed by the similarity of "
        "its eigenvector. A real root has ratio 1 if it decays, −1 if it grows; a mode that splits into two real "
        "roots is drawn as two lines. Shaded: unstable. Onset of instability of an elastic mode: "
        f"{said}.{_NO_CLEARANCE if elastic else ''}"
    )
    name = f"modes_{motion.replace('-', '_')}"
    return fig.Plate(name, f"{motion.capitalize()} modes over speed", caption, fig.Chart(rows, share_x=bool(elastic)))


def _damping_and_frequency(
    envelope: Envelope, title: str, looks: Mapping[str, dict[str, Any]], onsets: Mapping[str, float]
) -> tuple[fig.Panel, fig.Panel]:
    """Return damping ratio and frequency of modes over speed; ``onsets`` are the speeds at which they lose damping."""
    V, zetas, sizes = np.array(envelope.speeds), list[fig.Curve](), list[fig.Curve]()
    for name, look in looks.items():
        f, zeta = envelope.history(name)
        for j in (0, 1):
            x, y = _broken(V, zeta[:, j])
            zetas.append(fig.Curve(x=x, y=y, width=1.4, **look))
            sizes.append(fig.Curve(x=V, y=f[:, j], width=1.4, **look))
    every = [np.concatenate([np.asarray(c.y) for c in curves] or [np.ones(1)]) for curves in (zetas, sizes)]
    shown, values = (y[np.isfinite(y)] for y in every)
    low, high = float(shown.min(initial=0.0)), float(shown.max(initial=0.02))
    low, high = low - 0.06 * (high - low), high + 0.05 * (high - low)
    marks: list[fig.Drawn] = [fig.Rule(at=at, colour=looks[n]["colour"], dash=(2, 2)) for n, at in onsets.items()]
    dots = [fig.Curve(x=[at], y=[0.0], colour=looks[n]["colour"], marker="o", order=5.0) for n, at in onsets.items()]
    notes = [("onset", fig.QUIET), *((f"{at:.3g} m/s", looks[n]["colour"]) for n, at in onsets.items())]
    if title.startswith("elastic") and not onsets:
        notes = [(f"onset: none up to {envelope.speeds[-1]:g} m/s", fig.QUIET)]
    damping = _over_speed(
        envelope, [*zetas, *dots, *marks, fig.Span(low=low, high=0.0, of="y", colour=_UNSTABLE),
                   fig.Rule(at=0.0, of="y", colour=fig.AXIS)],
        title=title, y="damping ratio ζ", y_range=(low, high), tall_in=2.1, notes=notes if title[0] == "e" else (),
    )  # fmt: skip
    positive = values[values > 1e-6]
    far = positive.size > 0 and positive.max() > 8.0 * positive.min()
    # A root that crosses zero goes down without end.
    ends = (
        (max(0.8 * positive.min(), 1e-4 * positive.max()), 1.25 * positive.max()) if far else (0.0, 1.1 * values.max())
    )
    frequency = _over_speed(envelope, [*sizes, *marks], y="|s|/2π, Hz", log_y=far, y_range=ends, tall_in=2.1)
    return damping, frequency


def _broken(V: FloatArray, zeta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve with a gap where a real root changes sign, and its damping ratio jumps between 1 and -1."""
    jumps = np.flatnonzero(np.abs(np.diff(zeta)) > 1.5) + 1
    return np.insert(V, jumps, np.nan), np.insert(zeta, jumps, np.nan)


# --- mode shapes ------------------------------------------------------------------------------------------------------


def _shape_plate(survey: Survey) -> fig.Plate:
    """Return one panel per mode: displacement on its left axis, twist on its right one."""
    flown = survey.envelope.aircraft.flown_modes()
    assert flown is not None
    y, deg_m = np.array(flown.stations_m), 1.0 / (flown.cbar_m * DEG_RAD)
    span = np.concatenate([-y[::-1], y])
    names = ("displacement, m per unit of η (left axis)", "twist, deg per unit of η (right axis)")
    looks: list[dict[str, Any]] = [
        {"name": name, "colour": fig.COLOURS[k], "dash": fig.DASHES[k], "width": 1.4} for k, name in enumerate(names)
    ]
    panels = []
    for i, mode in survey.shaped.items():
        bend, twist = _both_wings(mode)
        reach = 1.1 * max(float(np.abs(bend).max()), float(np.abs(twist).max()) * flown.cbar_m) or 1.0
        turn = fig.Curve(x=span, y=twist / DEG_RAD, **looks[1])
        panels.append(
            fig.Panel(
                draws=[fig.Curve(x=span, y=bend, **looks[0]), fig.Rule(at=0.0, of="y", colour=fig.AXIS, width=0.7)],
                title=_shape_title(i, mode), x="y, m (left wing negative)", y="m per η", y_colour=fig.COLOURS[0],
                x_range=(-y[-1], y[-1]), y_range=(-reach, reach), tall_in=1.25,
                right=fig.Panel(draws=[turn], y="deg per η", y_range=(-reach * deg_m, reach * deg_m),
                                y_colour=fig.COLOURS[1]),
            )
        )  # fmt: skip
    caption = (
        "Displacement of the elastic axis, positive up, and twist, positive nose up, along both wings for one unit of "
        "each mode's coordinate, in vacuo; titles give the frequency in vacuo. Symmetric modes move both wings alike, "
        "asymmetric ones oppositely. Panels differ in scale; in each, equal height on both axes is equal displacement "
        f"at one mean chord ({flown.cbar_m:.3g} m) ahead of the elastic axis."
    )
    title = "Shapes of the elastic modes along the wing"
    return fig.Plate("mode_shapes", title, caption, fig.grid(panels, min(2, len(panels)), share_x=True))


def _both_wings(mode: ElasticMode) -> tuple[FloatArray, FloatArray]:
    """Return displacement, m, and twist, rad, per unit of eta from the left tip to the right one."""
    assert mode.shape is not None
    sign = 1.0 if mode.symmetry == "symmetric" else -1.0
    bend, twist = np.array(mode.shape.bend_m), np.array(mode.shape.twist_rad)
    return np.concatenate([sign * bend[::-1], bend]), np.concatenate([sign * twist[::-1], twist])


def _shape_title(i: int, mode: ElasticMode) -> str:
    """Return number, frequency and name; the frequency stands first, as names are cut."""
    name = mode.name.replace("asymmetric", "asym.").replace("symmetric", "sym.").replace(" and ", " + ")
    return f"{symbol(f'eta_{i}')}, {mode.f_hz:.3g} Hz: {name}"


# --- frequency responses ----------------------------------------------------------------------------------------------


def _response_plate(survey: Survey) -> fig.Plate:
    """Return magnitude and phase of each output, one line per speed."""
    envelope = survey.envelope
    omega = np.geomspace(*_band(envelope), 600)
    curves = {V: _response(envelope, V, omega) for V in survey.responses}
    phases = {V: _phases(H, curves[survey.responses[0]]) for V, H in curves.items()}
    looks = {
        V: {"name": f"{V:g} m/s", "colour": colour, "dash": fig.DASHES[k % 6]}
        for k, (V, colour) in enumerate(zip(curves, fig.shades(len(curves)), strict=True))
    }
    panels = []
    for i, output in enumerate(_RESPONSES):
        factor, unit = ratio_unit(output, "de")
        lines = [(omega, factor * np.abs(H[:, i]), phases[V][:, i], looks[V]) for V, H in curves.items()]
        panels.append(fig.bode(f"{symbol(output)} / {symbol('de')}", unit, lines))
    left_out = {u.V_m_s for u in survey.untrimmed if u not in survey.range.beyond}
    missing = (
        f" Speeds that cannot be trimmed are left out: {', '.join(f'{V:g}' for V in sorted(left_out))} m/s."
        if left_out
        else ""
    )
    shaky = [f"{V:g}" for V in survey.responses if envelope.models[envelope.nearest(V)].poles().real.max() > 1e-6]
    unstable = (
        f" The aircraft is unstable at {', '.join(shaky)} m/s; there the response is that of the transfer function, "
        "not of a flight."
        if shaky
        else ""
    )
    caption = (
        f"True airspeed, pitch rate, angle of attack and pitch angle to elevator deflection at {envelope.h_m:g} m, "
        f"rigid and elastic motion together, without servo and sensor lags.{missing}{unstable}"
    )
    return fig.Plate("bode_de", f"Frequency responses to {symbol('de')}", caption, fig.Chart(panels, share_x=True))


def _band(envelope: Envelope) -> tuple[float, float]:
    """Return the band of the responses, rad/s: from below the slowest longitudinal mode to above the fastest."""
    poles: Mapping[str, tuple[complex, ...]] = envelope.poles[envelope.design]
    wn = [abs(s) for n, found in poles.items() if envelope.motion[n] == "longitudinal" for s in found if abs(s) > 1e-3]
    return 0.3 * min(wn), 2.0 * max(wn)


def _response(envelope: Envelope, V: float, omega: FloatArray) -> Any:
    return envelope.models[envelope.nearest(V)].frequency_response(omega, _RESPONSES, ("de",))[:, :, 0]


def _phases(response: Any, first: Any) -> FloatArray:
    """Return the phases in deg without jumps, at the middle frequency on the same sheet as those of ``first``.

    An unstable phugoid turns the phase the other way: without this it would stand a whole turn off.
    """
    turned, goal = fig.unwrapped(response), fig.unwrapped(first)
    middle = len(turned) // 2
    start = goal - 360.0 * np.round(goal[middle] / 360.0)
    return np.asarray(turned + 360.0 * np.round((start[middle] - turned[middle]) / 360.0), np.float64)
