"""The aircraft.toml of an aircraft that was made flexible: that of the rigid one, with its modes and their sources."""

from __future__ import annotations

import re
import textwrap

from testbench.aircraft.strips.coupling import elastic_toml
from testbench.aircraft.strips.flexible import ETA_LIMIT, FRAMES, Flexible
from testbench.aircraft.strips.reading import GroundTest
from testbench.core.errors import ModelError
from testbench.core.escape import one_line, quoted

_WIDTH = 118


def flexible_toml(rigid: str, made: Flexible, test: GroundTest, name: str) -> str:
    """Return the text of aircraft.toml.

    Args:
        rigid: text of the rigid aircraft's file; what is not changed keeps its comments.
        made: the flexible aircraft.
        test: its modes.
        name: of the rigid aircraft.

    Raises:
        ModelError: the rigid aircraft's file does not have its keys where they can be changed.
    """
    text = rigid if rigid.endswith("\n") else rigid + "\n"
    text = _replaced(text, r"^title\s*=.*$", f"title = {quoted(made.aircraft.title)}", "title")
    if made.raised:
        rate = (
            f"rate_hz = {made.aircraft.rate_hz!r}           # {FRAMES:g} frames or more per period of the fastest mode"
        )
        text = _replaced(text, r"^rate_hz\s*=.*$", rate, "simulation.rate_hz")
    if not re.search(r"^eta\s*=", text, flags=re.MULTILINE):
        limit = f"eta = [{-ETA_LIMIT!r}, {ETA_LIMIT!r}]         # of every mode, in its own unit; see below"
        text = _replaced(text, r"^\[limits\][^\n]*$", f"[limits]\n{limit}", "limits")
    if made.new_stations:
        rows = "".join(
            f"    {{ y_m = {s.y_m!r}, x_m = {s.x_m!r}, height_m = {s.height_m!r} }},\n"
            for s in made.aircraft.wing_stations
        )
        said = _comment(
            "Where instruments may sit on the wing, on its elastic axis: station, and height of the upper skin above "
            "the neutral axis."
        )
        table = re.search(r"^\[", text, flags=re.MULTILINE)
        place = table.start() if table else len(text)
        attached = not text[:place].endswith("\n\n")  # a comment right above the first table belongs to it
        before = text[:place].rstrip("\n")
        *head, last = before.split("\n\n") if "\n\n" in before else ("", before)
        comments = last if attached and head and all(line.startswith("#") for line in last.splitlines()) else ""
        before = "\n\n".join(head) if comments else before
        text = f"{before}\n\n{said}wing_station = [\n{rows}]\n\n{comments}{chr(10) if comments else ''}{text[place:]}"
    of = one_line(f"{name} and {test.path.name}")
    first = f"# Made by `testbench aircraft flexible` from {of}; made anew each time.\n"
    return f"{first}{text.rstrip()}\n\n{_sources(made, test)}\n{_elastic(made, test)}"


def _elastic(made: Flexible, test: GroundTest) -> str:
    elastic = made.aircraft.elastic
    assert elastic is not None
    comments = [
        _comment(
            f"Frequency, damping and shape {test.content.evidence}; generalised mass {origin.mass}. One unit of eta: "
            f"{origin.unit}. All coefficients derived."
        )
        for origin in made.origins
    ]
    return elastic_toml(elastic.modes, made.stations_m, comments)


def _sources(made: Flexible, test: GroundTest) -> str:
    """Return what is measured, derived and assumed, as comments."""
    out = _comment(f"Elastic modes of {test.path.name}: {test.content.source}")
    out += _comment(
        "Derived: the coefficients below, by quasi-steady strips over the shapes (testbench/aircraft/strips), with"
    )
    out += _comment(f"  plan forms: {made.strips.plan_forms}")
    for c in made.strips.constants:
        out += _comment(f"  {c.name}: {c.value:.5g}{f' {c.unit}' if c.unit else ''} ({c.source})")
    out += _comment("Rigid derivatives, the aircraft's own and those of the strips:")
    for d in made.strips.compared:
        out += _comment(f"  {d.name}: {'not known' if d.own is None else f'{d.own:.4g}'} and {d.strips:.4g}")
    for note in made.notes:
        out += _comment(f"Note: {note}.")
    return out


def _comment(text: str) -> str:
    indent = "#   " if text.startswith("  ") else "# "
    lines = textwrap.wrap(one_line(text), _WIDTH, initial_indent=indent, subsequent_indent=indent)
    return "".join(f"{line}\n" for line in lines)


def _replaced(text: str, pattern: str, by: str, key: str) -> str:
    found, count = re.subn(pattern, lambda _: by, text, count=1, flags=re.MULTILINE)
    if count != 1:
        raise ModelError(f"aircraft.toml must have {key} at the beginning of a line of its own, got none")
    return found
