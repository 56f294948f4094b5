"""Tables on an aircraft: trims, modes, derivatives, coefficients."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import TYPE_CHECKING

from testbench.core.channels import CHANNELS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.evaluation.derivatives import dimensional_derivatives, lift_per_rad
from testbench.evaluation.modes import frequency_and_damping
from testbench.flight.limits import steady_sideslip
from testbench.flight.thrust import full_thrust_N
from testbench.page.labels import shown_unit, symbol
from testbench.page.tables import Column, Table, Value

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.questions.aircraft.ask import Survey


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
        left = [a / DEG_RAD for a in elevator_left(survey, V)] if "de" in channels else []
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


def elevator_left(survey: Survey, V_m_s: float) -> tuple[float, float]:
    """Return how far the elevator can turn from its trim, trailing edge up and down, rad; both are positive."""
    envelope = survey.envelope
    at, control = envelope.trims[envelope.nearest(V_m_s)].controls["de"], envelope.aircraft.controls["de"]
    return at - control.low, control.full - at


def untrimmed_table(survey: Survey) -> Table:
    """Return the speeds that cannot be flown, and why."""
    caption = (
        "Speeds just outside the range, and others that were asked for. The ends of the range are known to "
        f"{survey.range.step_m_s:g} m/s."
    )
    columns = (Column("V", "V", "m/s", given=True, digits=5), Column("reason", "reason"))
    rows = tuple((u.V_m_s, u.reason) for u in survey.untrimmed)
    return Table("untrimmed", "Speeds that cannot be trimmed", caption, columns, rows)


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
        "First the limits at which a flight is stopped, then what trims, surfaces and engines can do. What the "
        "testbench assumed is no limit of the aircraft: state your own in [limits] of aircraft.toml."
    )
    return Table("limits", "Limits, and where they come from", caption, columns, tuple(rows), wide=True)


_MODE_COLUMNS = (
    Column("re", "Re s", "rad/s", digits=4),
    Column("im", "Im s", "rad/s", digits=4),
    Column("f", "|s|/2π", "Hz", digits=4),
    Column("zeta", "ζ", digits=3),
)


def mode_table(survey: Survey) -> Table:
    """Return all poles at the design speed, by name."""
    envelope = survey.envelope
    rows: list[tuple[Value, ...]] = []
    for name, motion in envelope.motion.items():
        for root, pole in _roots(name, envelope.poles[envelope.design][name]):
            wn, zeta = frequency_and_damping(pole)
            real = pole.real
            half = math.log(2.0) / -real if real else None
            rows.append((root, motion, real, pole.imag, wn / (2.0 * math.pi), zeta, half))
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
                wn, zeta = frequency_and_damping(pole)
                rows.append((root, motion, way, pole.real, pole.imag, wn / (2.0 * math.pi), zeta))
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
                wn, zeta = frequency_and_damping(pole)
                rows.append((V, root, motion, pole.real, pole.imag, wn / (2.0 * math.pi), zeta))
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
    columns = [Column("derivative", ""), Column("meaning", "meaning"), Column("unit", "unit")]
    if flexible:
        columns += [Column("held", "modes held", digits=4), Column("static", "modes following", digits=4)]
    else:
        columns.append(Column("value", "value", digits=4))
    rows = tuple((d.name, d.meaning, d.unit, d.held, *((d.static,) if flexible else ())) for d in found)
    caption = (
        "Accelerations per unit of motion or control, by linearising about trim; angles in rad. Forces along the "
        "stability axes of the trim, without gravity and the accelerations of the turning frame; moments about body "
        "axes, products of inertia included."
    )
    if flexible:
        caption += " Modes held: at their trimmed deflection. Modes following: in static equilibrium with the motion."
    title = f"Dimensional derivatives at {envelope.speeds[envelope.design]:g} m/s"
    return Table("derivatives", title, caption, tuple(columns), rows)


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
        "Values of the JSBSim XML, dimensionless, angles in rad. Where a coefficient is not one number, the table says "
        "what it is made of. The elastic modes add coefficients of their own."
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
