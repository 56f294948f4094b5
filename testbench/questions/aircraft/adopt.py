"""``testbench aircraft adopt``: a JSBSim model that somebody else wrote becomes a folder of one's own.

The folder holds the model in one piece, its engines, and an aircraft.toml that says what was found and what was
assumed.
"""

from __future__ import annotations

import textwrap
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.constants import DEG_RAD
from testbench.core.escape import one_line, quoted, real
from testbench.core.files import write_file
from testbench.core.store import ResultFolder
from testbench.page.tables import Column, Table

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.aircraft.adapter import Link
    from testbench.flight.adopt import Adopted

_WIDE = 110
_UNITS = {"V": ("_m_s", 1.0), "h": ("_m", 1.0)}


def write_adopted(adopted: Adopted, folder: Path | ResultFolder) -> list[Path]:
    """Write an adopted model as a folder that the testbench loads: NAME.xml, Engines/ and aircraft.toml.

    Raises:
        BusyError: another process writes into the folder.
        WriteError: it has an aircraft.toml that the testbench did not write, or cannot be written to.
    """
    if not isinstance(folder, ResultFolder):
        with ResultFolder(folder) as place:
            return write_adopted(adopted, place)
    folder.check("aircraft.toml")
    new, name = folder.new, folder.path.resolve().name
    aircraft = adopted.aircraft
    tree = ET.fromstring(aircraft.xml)
    ET.indent(tree)
    text = '<?xml version="1.0"?>\n' + ET.tostring(tree, encoding="unicode") + "\n"
    out = [write_file(new / f"{name}.xml", text)]
    out += [write_file(new / "Engines" / file, xml) for file, xml in aircraft.engine_files.items()]
    out += [write_file(new / "aircraft.toml", described(adopted, f"{name}.xml"))]
    return [folder.path / path.relative_to(new) for path in out]


def described(adopted: Adopted, model: str) -> str:
    """Return aircraft.toml of an adopted model, with comments on where every number comes from.

    Args:
        adopted: what was found.
        model: name of its XML file.
    """
    aircraft, g, m = adopted.aircraft, adopted.aircraft.geometry, adopted.aircraft.mass
    adapter = aircraft.adapter
    assert adapter is not None
    t = adopted.trimmed
    lines = [
        *_comment(
            f"{aircraft.title}. Made by `testbench aircraft adopt` from the model's own files: everything below was "
            "found by probing it in JSBSim unless it says assumed. It is checked against the model when it is loaded."
        ),
        f"title = {quoted(aircraft.title)}",
        f"model = {quoted(model)}",
        f"design_V_m_s = {aircraft.design_V_m_s!r}",
        f"design_h_m = {aircraft.design_h_m!r}",
        f"level_V_m_s = [{adopted.slowest!r}, {adopted.fastest!r}]   # found by trimming at that altitude",
        "",
        *_comment(
            f"As flown: {m.mass_kg:.6g} kg, Ixx {m.Ixx:.5g}, Iyy {m.Iyy:.5g}, Izz {m.Izz:.5g}, Ixz {m.Ixz:.4g} kg m2, "
            f"fuel and point masses included; S {g.S_m2:.5g} m2, b {g.b_m:.5g} m, cbar {g.cbar_m:.5g} m."
        ),
    ]
    if adopted.tanks_kg:
        fuel = ", ".join(f"{x:.4g}" for x in adopted.tanks_kg)
        lines += _comment(f"Fuel in the tanks: {fuel} kg. It does not burn: the mass stays.")
    if adopted.engines:
        lines += _comment(f"Engines: {'; '.join(adopted.engines)}.")
    lines += _comment(
        f"It trims from {adopted.slowest:g} to {adopted.fastest:g} m/s at {t.condition.h_m:g} m; "
        f"slower: {adopted.ends[0]}; faster: {adopted.ends[1]}."
    )
    lines += _comment(
        f"At {t.condition.V_m_s:g} m/s: alpha {t.alpha / DEG_RAD:.2f} deg, "
        + ", ".join(_held(n, v) for n, v in t.controls.items())
        + (f", flight path {t.condition.gamma_rad / DEG_RAD:.2f} deg" if t.condition.gamma_rad else "")
        + "."
    )
    lines += ["", *_listed("Found:", adopted.found), *_listed("Assumed:", adopted.assumed), ""]
    lines += ["[simulation]", f"rate_hz = {aircraft.rate_hz!r}", ""]
    for link in adapter.links:
        lines += _control(link, aircraft)
    if adapter.throttles:
        throttles = ", ".join(quoted(x) for x in adapter.throttles)
        lines += ["[controls.thr]             # one command for all engines", f"engines = [{throttles}]", ""]
    if any(link.law is not None for link in adapter.links):
        lines += [
            *_comment(
                'Where commands enter: at the "stick", with the control law of the model, or at the "surface", without.'
            ),
            "[adapter]",
            f"commanded_at = {quoted('stick' if aircraft.under_law else 'surface')}",
            "",
        ]
    lines += ["# Properties that are set before the flight.", "[adapter.set]"]
    lines += [f"{quoted(n)} = {v!r}" for n, v in adapter.settings.items()]
    if adapter.neutral:
        lines += ["", "# Properties that the model reads and does not define.", "[adapter.declare]"]
        lines += [f"{quoted(n)} = {v!r}" for n, v in adapter.neutral.items()]
    lines += ["", "# A flight that leaves them is stopped.", "[limits]"]
    for channel, (low, high) in aircraft.limits.items():
        suffix, unit = _UNITS.get(channel, ("_deg", DEG_RAD))
        lines.append(f"{channel}{suffix} = [{real(low / unit, 6)}, {real(high / unit, 6)}]")
    lines += ["", "# Where they come from.", "[limit_sources]"]
    lines += [f"{channel} = {quoted(words)}" for channel, words in aircraft.limit_sources.items()]
    if aircraft.outline is not None:
        lines += ["", "# For the drawing only; nothing here enters a flight.", *aircraft.outline.toml(6)]
    return "\n".join(lines) + "\n"


def _control(link: Link, aircraft: Aircraft) -> list[str]:
    control = aircraft.controls[link.control]
    out = [
        f"[controls.{link.control}]              # {link.word}: deg of {link.control} -> value of what the model reads",
        f"throw_deg = [{_degrees(control.low)}, {_degrees(control.full)}]",
    ]
    drives = (f"{quoted(d.name)} = [{', '.join(f'[{_degrees(a)}, {v!r}]' for a, v in d.points)}]" for d in link.drives)
    out.append(f"drives = {{ {', '.join(drives)} }}")
    surface, law = link.commanded_at("surface"), link.law
    if surface.lag_rad_s is not None:
        out.append(f"servo_lag_rad_s = {real(surface.lag_rad_s, 6)}")
    if surface.rate_limit_rad_s is not None:
        out.append(f"servo_rate_limit_deg_s = {real(surface.rate_limit_rad_s / DEG_RAD, 6)}")
    if law is not None:
        said = f"stick = {quoted(law.stick)}, own = {quoted(law.own)}, rad_per_unit = {law.factor!r}"
        out.append(f"law = {{ {said}{', turned = true' if law.sign < 0.0 else ''} }}")
    return [*out, ""]


def _held(name: str, value: float) -> str:
    return f"throttle {100.0 * value:.1f} %" if name == "thr" else f"{name} {value / DEG_RAD:.2f} deg"


def _comment(words: str) -> list[str]:
    return textwrap.wrap(one_line(words), _WIDE, initial_indent="# ", subsequent_indent="# ", break_long_words=False)


def _listed(head: str, sentences: Iterable[str]) -> list[str]:
    out = [
        line
        for s in sentences
        for line in textwrap.wrap(one_line(s), _WIDE, initial_indent="# - ", subsequent_indent="#   ")
    ]
    return [f"# {head}", *out] if out else []


def _degrees(rad: float) -> str:
    """Return an angle in degrees that gives the same rad again to 1e-12."""
    return real(rad / DEG_RAD, 12)


def found_table(adopted: Adopted) -> Table:
    """Return what was found and what was assumed, one sentence per row."""
    rows = [("found", s) for s in adopted.found]
    rows += [("found", f"engine {i}: {s}") for i, s in enumerate(adopted.engines, 1)]
    if adopted.tanks_kg:
        rows.append(("found", f"fuel in {len(adopted.tanks_kg)} tanks: {sum(adopted.tanks_kg):.4g} kg in all"))
    rows.append(("found", f"trims from {adopted.slowest:g} to {adopted.fastest:g} m/s; slower: {adopted.ends[0]}; "
                          f"faster: {adopted.ends[1]}"))  # fmt: skip
    rows += [("assumed", s) for s in adopted.assumed]
    return Table(
        "adopted",
        "What was found in the model, and what was assumed",
        "Found by moving every command of the model in JSBSim and recording the response.",
        (Column("kind", ""), Column("sentence", "")),
        tuple(rows),
        wide=True,
    )
