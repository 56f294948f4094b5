"""Write the amendment as files: a suite, an aircraft folder with a model that stock JSBSim loads, or the air."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from difflib import unified_diff
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.door import read_text
from testbench.core.escape import markdown_cell, one_line, real
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, STOCK, resolve
from testbench.effects.base import MetGust
from testbench.flight import FlightCondition
from testbench.page.labels import file_stem
from testbench.questions.gap.drive import as_it_is
from testbench.questions.gap.starts import times_of
from testbench.sensors import suite_toml

if TYPE_CHECKING:
    from testbench.questions.gap.ask import GapResult

AIRFRAME = "airframe.xml"  # of a folder whose modes are in aircraft.toml: the same model without their equations
_HEADER = re.compile(r"^\s*\[\[?([^\]]+)\]\]?", re.MULTILINE)


def amended_files(result: GapResult) -> dict[str, str]:
    """Return path -> text of what was named and re-tuned: the sensor suite, and the aircraft's folder.

    For a gust it is the air of the manoeuvre that met it, and no aircraft; for an airspeed or a density other than
    believed, the condition that was flown. Only what changed is returned, each with a diff; nothing is returned if
    nothing was named and no parameter is wrong. What grows during the flight stands as far as it had grown in the
    latest record.
    """
    old, new = result.finding.believed, result.finding.amended
    if new.over_time:
        new = new.after(max(times_of(result.records.values())))
    new = new.begun_later()
    if not result.finding.changed:
        return {}
    out: dict[str, str] = {}
    suites = [suite_toml(b.suite) for b in (old, new)]
    if suites[0] != suites[1]:
        out[f"{file_stem(new.suite.name)}.toml"] = suites[1]
        out["suite.diff"] = _diff(suites[0], suites[1], "assumed suite", "amended suite")
    if new.condition != old.condition:
        at, height = new.condition, "" if new.condition.h_m == old.condition.h_m else "  # where the air is as dense"
        out["condition.toml"] = f"[condition]\nV_m_s = {real(at.V_m_s, 5)}\nh_m = {real(at.h_m, 5)}{height}\n"
    air = {f"air_{file_stem(g.manoeuvre)}.toml": air_text(g) for g in new.gusts if g not in old.gusts}
    if air:
        out |= air
        out["air.diff"] = _diff("", "\n".join(air.values()), "assumed air (still)", "amended air")
    best = result.finding.naming.best
    if best is not None and best.effect.met is not None:
        return out
    home = Path(result.aircraft.removeprefix(STOCK))  # of a brought aircraft its whole path
    name = file_stem(home.stem if home.suffix == ".xml" else home.name)
    models = [aircraft_files(as_it_is(b.aircraft), name, b.rate_hz, old.condition, home) for b in (old, new)]
    if models[0] == models[1]:
        return out
    out |= {f"{name}/{path}": text for path, text in models[1].items()}
    before, after = (m[f"{name}.xml"] for m in models)
    out["model.diff"] = _diff(before, after, "a-priori model", "amended model", context=2)
    return out


def _diff(before: str, after: str, old: str, new: str, context: int = 3) -> str:
    return "\n".join(unified_diff(before.splitlines(), after.splitlines(), old, new, lineterm="", n=context)) + "\n"


def aircraft_files(
    aircraft: Aircraft, name: str, rate_hz: float, condition: FlightCondition, home: Path | None = None
) -> dict[str, str]:
    """Return path -> text of the folder of ``aircraft``, amendments included.

    NAME.xml is the whole model, which stock JSBSim loads. It must fly at ``rate_hz`` frames per second, as delays,
    servos of second order, memories of the flow and elastic modes count frames. Equations of elastic modes are made for
    ``condition``. With aircraft.toml the folder is an aircraft of the testbench; a foreign model gets none, and has to
    be told what the adapter tells it. If there are modes, aircraft.toml lists them and names airframe.xml. That model
    lacks their equations, as these are written anew for every rate and condition. ``home`` is the folder that it was
    made from, or its name in aircraft_models/; ``name`` if not given.
    """
    modes = aircraft.flown_modes()
    note = f"<!-- Made for {rate_hz:g} frames a second: delays and filters in it count frames. -->\n"
    out = {f"{name}.xml": _one_factor(aircraft.model_xml(rate_hz, condition.qbar_Pa, condition.V_m_s), note)}
    if modes is not None and len(modes):
        bare = tuple(replace(a, modes=()) for a in aircraft.amendments)
        rigid = replace(aircraft, elastic=None, amendments=bare)
        out[AIRFRAME] = _one_factor(rigid.model_xml(rate_hz, condition.qbar_Pa, condition.V_m_s), note)
    if aircraft.adapter is not None:
        out["README.md"] = _how_to_command(aircraft, rate_hz)
        return out | {f"Engines/{file}": text for file, text in aircraft.engine_files.items()}
    out["aircraft.toml"] = _description(
        read_text(AIRCRAFT_MODELS / Path(resolve(str(home or name), AIRCRAFT)) / "aircraft.toml", "aircraft"),
        aircraft,
        AIRFRAME if AIRFRAME in out else f"{name}.xml",
        rate_hz,
    )
    return out | {f"Engines/{file}": text for file, text in aircraft.engine_files.items()}


def _how_to_command(aircraft: Aircraft, rate_hz: float) -> str:
    """Return what whoever flies an amended foreign model in JSBSim must know."""
    assert aircraft.adapter is not None
    commands = "\n".join(
        f"- {c.command}: {c.low:.4g} to {c.full:.4g}{'' if n == 'thr' else ' rad'}"
        for n, c in aircraft.controls.items()
    )
    told = "\n".join(f"- {n} = {v:g}" for n, v in aircraft.adapter.settings.items())
    return (
        f"# {markdown_cell(aircraft.name)}, amended\n\nA JSBSim model with the channels that the testbench adds to it; "
        f"it flies at {rate_hz:g} frames a second and cannot be adopted again. It is commanded by\n\n{commands}\n\n"
        + (f"and is told, once it is loaded,\n\n{told}\n" if told else "")
    )


def air_text(met: MetGust) -> str:
    """Return the air that one manoeuvre met as the table of a scenario that flies it."""
    gust = met.gust
    size = {"duration_s": gust.duration_s} if gust.duration_s is not None else {"length_m": gust.length_m}
    values = {"amplitude_m_s": gust.amplitude_m_s, "start_s": gust.start_s, **size}
    lines = [
        f"# Written by the gap workflow. The air that manoeuvre {json.dumps(met.manoeuvre)} met, and no other one.",
        "# start_s counts from the first sample of its record; a scenario counts from the end of its settling time.",
        "[air.gust]",
        f"axis = {json.dumps(gust.axis)}",
        *(f"{name} = {float(value or 0.0)!r}" for name, value in values.items()),
    ]
    return "\n".join(lines) + "\n"


def _one_factor(xml: str, note: str) -> str:
    """Return a model, with a note, whose coefficients have one number each again: re-tuning multiplies by a second."""
    tree = ET.fromstring(xml)
    for function in tree.iter("function"):
        product = function.find("product")
        if product is None or not (function.get("name") or "").startswith("aero/coefficient/"):
            continue
        values = product.findall("value")
        if len(values) < 2:
            continue
        values[0].text = repr(float(np.prod([float(v.text or "nan") for v in values])))
        for v in values[1:]:
            product.remove(v)
    ET.indent(tree)
    return '<?xml version="1.0"?>\n' + note + ET.tostring(tree, encoding="unicode") + "\n"


def _description(text: str, aircraft: Aircraft, model: str, rate_hz: float) -> str:
    """Return the text of an aircraft.toml with another model and rate, and with the modes that ``aircraft`` flies."""
    headers = list(_HEADER.finditer(text))
    ends = [*(h.start() for h in headers[1:]), len(text)]
    kept = text[: headers[0].start()] if headers else text
    for header, end in zip(headers, ends, strict=False):
        if header[1].split(".")[0].strip() != "elastic":
            kept += text[header.start() : end]
    amended = "; ".join(a.description for a in aircraft.amendments if a.description)
    if amended:
        kept = re.sub(r'^title = "(.*)"', lambda m: f'title = "{m[1]}; amended"', kept, count=1, flags=re.MULTILINE)
    kept = re.sub(r"^model = .*$", f"model = {json.dumps(model)}", kept, count=1, flags=re.MULTILINE)
    kept = re.sub(
        r"^rate_hz = ([\d.]+).*$",  # what a comment says is said of the rate that it stands beside
        lambda m: m[0] if float(m[1]) == rate_hz else f"rate_hz = {rate_hz!r}",
        kept,
        count=1,
        flags=re.MULTILINE,
    )
    head = f"# Written by the gap workflow. Amended: {one_line(amended)}.\n" if amended else ""
    modes = aircraft.flown_modes()
    if modes is None or not len(modes):
        return head + kept.rstrip() + "\n"
    return f"{head}{kept.rstrip()}\n\n{modes.toml()}"
