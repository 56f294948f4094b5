"""The report on an aircraft: files of a survey, its page, its answer in a terminal, and its export as JSBSim XML."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.modes import frequency_and_damping
from testbench.page.labels import number, shown_unit, symbol
from testbench.page.tables import Column, Table, Value
from testbench.page.write import PAGE, write_file, write_plates, write_tables

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.aircraft import Aircraft
    from testbench.questions.aircraft.ask import Survey


def write_aircraft(survey: Survey, folder: Path | str) -> list[Path]:
    """Write tables/*.csv and *.json, figures/*.png and report.html; return the paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from importlib.metadata import version

    from testbench import __version__
    from testbench.page.html import render
    from testbench.questions.aircraft.figures import aircraft_plates

    folder = Path(folder)
    tables = aircraft_tables(survey)
    out = write_tables([*tables, modes_over_speed(survey)], folder)
    paths, pictures = write_plates(aircraft_plates(survey), folder)
    out += paths
    page = render(
        "questions/aircraft/page.html.j2",
        survey=survey,
        aircraft=survey.envelope.aircraft,
        answer=aircraft_answer(survey),
        shapes_missing=shapes_missing(survey),
        tables=tables,
        pictures=pictures,
        versions=[("flight-testbench", __version__), *((n, version(n)) for n in ("numpy", "scipy", "jsbsim"))],
    )
    out.append(write_file(folder / PAGE, page))
    return out


def folder_name(aircraft: Aircraft, name: str) -> str:
    """Return the name of the folder of results: that of the aircraft, rigid wings apart from flexible ones."""
    return f"aircraft_{name}" + ("_rigid" if "rigid" in aircraft.name.removeprefix(name) else "")


# --- the answer -------------------------------------------------------------------------------------------------------


def aircraft_answer(survey: Survey) -> list[str]:
    """Return the findings as sentences: speed range, onset of instability, modes at the design speed."""
    envelope, found = survey.envelope, survey.range
    ends = [u.reason for u in found.beyond]
    out = [
        f"trims from {found.slowest:g} to {found.fastest:g} m/s at {envelope.h_m:g} m"
        + ("" if ends else ", all its limits allow")
    ]
    out += [f"beyond that: {reason}" for reason in ends]
    if envelope.elastic:
        onsets = [envelope.onset(name) for name in envelope.elastic]
        unstable = sorted((o for o in onsets if o.V_m_s is not None), key=lambda o: o.V_m_s or 0.0)
        out += [f"elastic instability, {o.sentence}" for o in unstable]
        if not unstable:
            out.append(f"onset of instability of an elastic mode: none up to {envelope.speeds[-1]:g} m/s")
    out += [sentence for name in envelope.motion if (sentence := _rigid_instability(survey, name))]
    at = envelope.poles[envelope.design]
    said = []
    for name in (n for n in envelope.motion if n not in envelope.elastic):
        for pole in at[name]:
            wn, zeta = frequency_and_damping(pole)
            said.append(f"{name} {_motion_words(pole, wn, zeta)}")
    out.append(f"at {envelope.speeds[envelope.design]:g} m/s: {'; '.join(said)}")
    return out


def _motion_words(pole: complex, wn: float, zeta: float) -> str:
    if pole.imag > 1e-9:
        return f"{number(wn / (2.0 * math.pi))} Hz with damping ratio {number(zeta)}"
    if abs(pole.real) < 1e-9:
        return "neutral"
    return f"{'doubling' if pole.real > 0.0 else 'halving'} in {number(math.log(2.0) / abs(pole.real))} s"


def _rigid_instability(survey: Survey, name: str) -> str:
    """Return where a rigid mode is unstable, in words; empty if nowhere."""
    envelope = survey.envelope
    if name in envelope.elastic:
        return ""
    growth = [max(s.real for s in found[name]) for found in envelope.poles]
    speeds = [V for V, g in zip(envelope.speeds, growth, strict=True) if g > 1e-9]
    if not speeds:
        return ""
    where = "at every speed" if len(speeds) == len(growth) else (
        f"at {speeds[0]:.3g} m/s" if len(speeds) == 1 else f"between {speeds[0]:.3g} and {speeds[-1]:.3g} m/s"
    )  # fmt: skip
    return f"the {name} is unstable {where}, doubling in {number(math.log(2.0) / max(growth))} s at worst"


def shapes_missing(survey: Survey) -> str:
    """Return which mode shapes cannot be drawn, and why, as a sentence; empty if all are drawn."""
    from testbench.questions.aircraft.figures import shaped_modes

    envelope = survey.envelope
    if not envelope.elastic:
        return "No mode shapes are drawn: this aircraft has no elastic modes."
    shaped = shaped_modes(envelope)
    if not shaped:
        return "No mode shapes are drawn: the elastic modes of this aircraft are given without shapes along the wing."
    without = [name for name, i in envelope.elastic.items() if i not in shaped]
    return f"Given without a shape along the wing, hence not drawn: {'; '.join(without)}." if without else ""


# --- tables -----------------------------------------------------------------------------------------------------------


def aircraft_tables(survey: Survey) -> list[Table]:
    """Return the tables of the page that there is something to fill with."""
    made = [
        trim_table(survey),
        untrimmed_table(survey),
        mode_table(survey),
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
    columns += [Column(c, symbol(c), "", "static deflection", digits=3) for c in modal]
    rows: list[tuple[Value, ...]] = []
    for V in survey.tabled:
        t = envelope.trims[envelope.nearest(V)]
        held = {"alpha": t.alpha / DEG_RAD, "de": t.controls.get("de", 0.0) / DEG_RAD}
        held["thr"] = t.controls.get("thr", 0.0) / PERCENT
        rows.append((V, t.state["qbar"], *(held[c] for c in channels), *(t.state[c] for c in modal)))
    caption = f"Steady level flight at {envelope.h_m:g} m in the standard atmosphere; controls as commanded."
    if modal:
        caption += " Deflections in the mode's own unit (table of elastic modes), only of symmetric modes."
    return Table("trim", "Trim over speed", caption, tuple(columns), tuple(rows))


def untrimmed_table(survey: Survey) -> Table:
    """Return the speeds that cannot be flown, and why."""
    caption = (
        "Speeds just beyond the range, and others that were asked for; the range was searched to "
        f"{survey.range.step_m_s:g} m/s."
    )
    columns = (Column("V", "V", "m/s", given=True, digits=5), Column("reason", "reason"))
    rows = tuple((u.V_m_s, u.reason) for u in survey.untrimmed)
    return Table("untrimmed", "Speeds that cannot be trimmed", caption, columns, rows)


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
        "Poles of the linearised aircraft, longitudinal and lateral-directional motion apart, servo lags left out. T½: "
        "time to half amplitude; negative: to double amplitude."
    )
    columns = (Column("mode", "mode"), Column("motion", "motion"), *_MODE_COLUMNS, Column("t_half", "T½", "s"))
    title = f"Modes at {envelope.speeds[envelope.design]:g} m/s"
    return Table("modes", title, caption, columns, tuple(rows))


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
        "Left: as a ground vibration test finds them. Right: the same modes coupled with air and flight at "
        f"{envelope.speeds[envelope.design]:g} m/s, and the speed at which the damping of one becomes negative."
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
    for amendment in aircraft.amendments:
        amendment.apply(tree)
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
        "As they stand in the JSBSim XML, without unit, angles in rad; where a coefficient is not one number, what it "
        "is made of. The elastic modes add theirs."
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


# --- terminal and export ----------------------------------------------------------------------------------------------


def print_aircraft(survey: Survey, console: Console, folder: Path | str | None = None) -> None:
    """Print the answer, trims, modes, and where the files are."""
    from rich.table import Table as RichTable
    from rich.text import Text

    console.print(Text(survey.envelope.aircraft.title, style="bold underline"))
    answer = RichTable.grid(padding=(0, 1))
    for i, sentence in enumerate(aircraft_answer(survey)):
        answer.add_row("-", Text(sentence, style="bold" if i == 0 else ""))
    console.print(answer)
    for table in (trim_table(survey), mode_table(survey)):
        console.print()
        console.print(Text(table.title, style="bold"))
        shown = RichTable(box=None, pad_edge=False)
        kept = [k for k, column in enumerate(table.columns) if column.key not in {"motion", "qbar"}]
        for k in kept:
            head = ", ".join(filter(None, (table.columns[k].head, table.columns[k].unit)))
            shown.add_column(head, justify="right" if table.numeric()[k] else "left")
        for row in table.cells():
            shown.add_row(*(Text(row[k][0]) for k in kept))
        console.print(shown)
    if folder is not None:
        console.print()
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)


def export_aircraft(survey: Survey, folder: Path | str) -> list[Path]:
    """Write NAME/NAME.xml, NAME/Engines/ and NAME/README.md: a model that stock JSBSim loads from ``folder``.

    The elastic equations are made for the design condition (the trimmed speed nearest to it) and the aircraft's own
    frame rate.

    Raises:
        RecordError: the folder cannot be written to.
    """
    envelope, name = survey.envelope, survey.name
    aircraft = envelope.aircraft
    condition = envelope.trims[envelope.design].condition
    place = Path(folder) / name
    rate = aircraft.rate_hz
    note = (
        f"# {name}\n\n{aircraft.title}. Plain JSBSim model, for the `aircraft/` folder of a JSBSim root directory.\n\n"
    )
    if envelope.elastic:
        note += (
            f"The elastic equations are made for {rate:g} frames per second: set the frame time to 1/{rate:g} s before "
            f"the model is loaded, as any other gives wrong modes. They are exact at {condition}, and close at other "
            "speeds.\n"
        )
    else:
        note += f"The model has no elastic equations and flies at any frame rate; {rate:g} per second is its own.\n"
    out = [write_file(place / f"{name}.xml", aircraft.model_xml(rate, condition.qbar_Pa, condition.V_m_s))]
    out += [write_file(place / "Engines" / file, text) for file, text in aircraft.engine_files.items()]
    return [*out, write_file(place / "README.md", note)]
