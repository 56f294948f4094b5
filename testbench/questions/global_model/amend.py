"""Write the functions into an aircraft: they take the place of its coefficients where it was flown.

Beyond the flown domain nobody knows them. There the believed coefficients stay, and in between, over half of the size
of the domain, one becomes the other in proportion.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from testbench.aircraft import Aircraft, Insert
from testbench.aircraft.adapter import PREFIX, declare
from testbench.aircraft.amend import Change, ReplaceCoefficient
from testbench.aircraft.reactions import MOTIONS
from testbench.aircraft.seams import product, prop, value
from testbench.core.constants import FT_M
from testbench.core.errors import ModelError
from testbench.core.escape import markdown_cell, markdown_table
from testbench.core.words import with_error
from testbench.estimators.regression.global_model import BAND_RAD, BIAS, FlownDomain, factors
from testbench.flight import FlightCondition, load_aircraft
from testbench.flight.executive import Executive
from testbench.questions.global_model.result import GlobalFound
from testbench.questions.identify.amend.folder import aircraft_files, base_texts, folder_of, write_folder

BLEND = 0.5
"""Distance beyond the edge of the domain, in its own size, over which functions become the believed coefficients."""
_PLACE = "aero/global/"


def amend(found: GlobalFound, name: str, base: str) -> GlobalFound:
    """Return what was found with an aircraft that has its functions, written to ``aircraft/NAME``.

    Args:
        found: the global model.
        name: of the new aircraft, or a path.
        base: how the believed aircraft was named.

    Raises:
        ScenarioError, WriteError: the name is not free, or cannot be written to.
        ModelError: the aircraft cannot take the functions.
    """
    folder = folder_of(name, base)
    new = with_functions(found)
    text, sources = base_texts(base)
    title = f"coefficients over its flown domain from {len(found.of_use('identification'))} flights"
    files = aircraft_files(new, folder.name, text, title, _origin(found, folder.name, sources), {}, {})
    with tempfile.TemporaryDirectory() as place:
        write_folder(files, Path(place) / folder.name)
        loaded = load_aircraft(Path(place) / folder.name)
    write_folder(files, folder)
    return replace(found, new=(loaded, folder))


def with_functions(found: GlobalFound) -> Aircraft:
    """Return the believed aircraft with the functions in its model itself, before its adapter and amendments."""
    aircraft, model = found.aircraft, found.model
    fdm = Executive(aircraft, aircraft.rate_hz, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    x, y, z = (fdm.get(f"inertia/cg-{axis}-in") for axis in "xyz")
    written = [_function(n, xml) for n, xml in _signals(found).items()]
    hinges = {n: knot for f in model.functions.values() for n, knot in f.hinges.items()}
    for n, (of, knot) in hinges.items():
        written.append(_function(n, f"<max> <difference> {_read(of)} {value(knot)} </difference> {value(0.0)} </max>"))
    for c, f in model.functions.items():
        terms = [_term(t, p) for t, p in zip(f.terms, f.params.tolist(), strict=True)]
        written.append(_function(c, f"<sum> {' '.join(terms)} {value(0.0)} </sum>"))
    written += [_function(n, xml) for n, xml in _share(model.domain).items()]
    changes: list[Change] = [Insert("aerodynamics", xml, k) for k, xml in enumerate(written)]
    changes += [ReplaceCoefficient(c, f"{_PLACE}{c}", f"{_PLACE}share", (x, y, z)) for c in model.functions]
    tree = ET.fromstring(aircraft.xml)
    for change in changes:
        change.apply(tree, aircraft)
    if aircraft.adapter is not None:
        read = {(e.text or "").strip() for e in tree.findall("aerodynamics//property")}
        declare(tree, {n: 0.0 for n in sorted(read) if n.startswith(PREFIX)})
    return replace(aircraft, xml=ET.tostring(tree, encoding="unicode"))


def _function(name: str, xml: str) -> str:
    return f'<function name="{_PLACE}{name}"> {xml} </function>'


def _read(name: str) -> str:
    return prop(f"{_PLACE}{name}")


def _signals(found: GlobalFound) -> dict[str, str]:
    """Return signal -> XML."""
    out = {}
    for s in ("alpha", *found.model.domain.signals):
        if s == "V_rel":
            per = product(value(FT_M / found.V_ref_m_s), prop("velocities/vt-fps"))
            out[s] = f"<difference> {per} {value(1.0)} </difference>"
            continue
        names: Sequence[str | None] = MOTIONS.get(s.removesuffix("_hat"), ())
        if s in found.aircraft.controls:
            names = [found.aircraft.source_of(s)[0]]
        if not names or None in names:
            raise ModelError(f"{found.aircraft.name} has no property that tells {s}")
        out[s] = product(value(1.0), *(prop(str(n)) for n in names))
    return out


def _term(term: str, size: float) -> str:
    if term == BIAS:
        return value(size)
    return product(value(size), *(_read(name) for name, power in factors(term) for _ in range(power)))


def _table(x: Sequence[float], y: Sequence[float]) -> str:
    rows = "\n".join(f"{a!r} {b!r}" for a, b in zip(x, y, strict=True))
    row = f'<independentVar lookup="row">{_PLACE}alpha</independentVar>'
    return f"<table> {row} <tableData>\n{rows}\n</tableData> </table>"


def _share(domain: FlownDomain) -> dict[str, str]:
    """Return the functions of the distance from the middle of the domain, as FlownDomain.distance has it, and of the
    share of the functions in the coefficients: 1 inside, 0 beyond ``BLEND``."""
    at, out = domain.alpha.tolist(), {}
    for i, s in enumerate(domain.signals):
        off = f"<difference> {_read(s)} {_table(at, domain.middle[:, i].tolist())} </difference>"
        out[f"off-{s}"] = f"<abs> <quotient> {off} {_table(at, domain.half[:, i].tolist())} </quotient> </abs>"
    every = [_read(f"off-{s}") for s in domain.signals]
    square = "<sum> " + " ".join(product(e, e) for e in every) + f" {value(0.0)} </sum>"
    round_ = f"<quotient> <pow> {square} {value(0.5)} </pow> {_table(at, domain.radius.tolist())} </quotient>"
    below = f"<difference> {value(domain.low)} {_read('alpha')} </difference>"
    above = f"<difference> {_read('alpha')} {value(domain.high)} </difference>"
    beyond = f"<quotient> <max> {below} {above} </max> {value(BAND_RAD)} </quotient>"
    ends = f"<ifthen> <gt> {beyond} {value(0.0)} </gt> <sum> {value(1.0)} {beyond} </sum> {value(0.0)} </ifthen>"
    out["distance"] = f"<max> {round_} {ends} {' '.join(every)} </max>"
    left = f"<difference> {value(1.0 + BLEND)} {_read('distance')} </difference>"
    out["share"] = f"<min> {value(1.0)} <max> {value(0.0)} <quotient> {left} {value(BLEND)} </quotient> </max> </min>"
    return out


def _origin(found: GlobalFound, name: str, sources: str) -> str:
    lines = [
        f"# {markdown_cell(name)}: sources",
        "",
        f"{found.aircraft.name}, whose six coefficients are functions from recorded flights inside of the flown domain "
        f"({_PLACE}share is 1 there) and its own beyond (0 there). Signals: angles and deflections in rad, p b/2V, "
        f"q c/2V, r b/2V, V_rel = V/({found.V_ref_m_s:.6g} m/s) - 1; alpha_over_8deg = max(alpha - 8 deg, 0).",
        "",
        "Flights: " + ", ".join(f"{f.name} ({f.use})" for f in found.flights) + ".",
        "",
        *markdown_table(
            ("coefficient", "term", "value"),
            [
                (f.name, t, with_error(p, s))
                for f in found.model.functions.values()
                for t, p, s in zip(f.terms, f.params.tolist(), f.std.tolist(), strict=True)
            ],
        ),
    ]
    if sources:
        lines += ["", f"# {found.aircraft.name}: sources, as they were", "", sources.replace("\n#", "\n##")]
    return "\n".join(lines).rstrip() + "\n"
