"""The folder of an amended aircraft: the model with its new coefficients, aircraft.toml, and where all comes from."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.core.door import read_text
from testbench.core.errors import ScenarioError
from testbench.core.escape import quoted, real
from testbench.core.files import write_file
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, STOCK, aircraft_names, resolve
from testbench.core.store import ResultFolder
from testbench.flight.load import adopted_at, by_stick, stock
from testbench.questions.aircraft.adopt import described
from testbench.questions.aircraft.new import check_name

SOURCES = "SOURCES.md"


def folder_of(name: str, base: str) -> Path:
    """Return the folder that an amended aircraft goes to: ``aircraft/NAME``, or a path as it is.

    Args:
        name: of the amended aircraft.
        base: name of the one that is amended.

    Raises:
        ScenarioError: the name is that of a packaged aircraft, of the one that is amended, or none that a model may
            have.
        BusyError: another process writes into the folder.
        WriteError: an aircraft that the testbench did not write lies there, or the folder cannot be written to.
    """
    folder = Path(name) if len(Path(name).parts) > 1 else Path("aircraft") / name
    check_name(folder)
    if folder.name in aircraft_names():
        raise ScenarioError(
            f"an amended aircraft must have a name of its own, got '{folder.name}', which is packaged: give another"
        )
    if folder.resolve() == Path(resolve(base, AIRCRAFT)).resolve():
        raise ScenarioError(
            f"an amended aircraft must go to a folder of its own, got '{folder}', which is amended: give another name"
        )
    place = ResultFolder(folder)
    try:
        place.check("aircraft.toml")
    finally:
        place.leave()
    return folder


def base_texts(named: str) -> tuple[str, str]:
    """Return aircraft.toml and SOURCES.md ("" without one) of what a description names, adopted if it must be.

    Args:
        named: packaged, a path, a name in the user's ``aircraft/``, or ``jsbsim:NAME``.
    """
    named = resolve(named, AIRCRAFT)
    home = AIRCRAFT_MODELS / named if named in aircraft_names() else Path(named)
    if named.startswith(STOCK):
        return described(by_stick(stock(named.removeprefix(STOCK))), ""), ""
    if not (home / "aircraft.toml").is_file():
        return described(by_stick(adopted_at(home)), ""), ""
    sources = home / SOURCES
    return read_text(home / "aircraft.toml", "aircraft"), (read_text(sources, "text") if sources.is_file() else "")


def aircraft_files(
    aircraft: Aircraft,
    name: str,
    base: str,
    title: str,
    origin: str,
    lags_s: Mapping[str, float],
    uncertainty: Mapping[str, float],
) -> dict[str, str]:
    """Return path -> text of the folder; aircraft.toml, which makes it an aircraft, comes last.

    Args:
        aircraft: with its model changed.
        name: of the folder and the model.
        base: aircraft.toml of what it was made from.
        title: what is said behind its title.
        origin: SOURCES.md.
        lags_s: control -> time constant of a servo that aircraft.toml has to say, as a foreign model's.
        uncertainty: coefficient -> relative standard deviation, in place of what is stated.
    """
    tree = ET.fromstring(aircraft.xml)
    ET.indent(tree)
    head = f'<?xml version="1.0"?>\n<!-- Amended by identified derivatives: see {SOURCES}. -->\n'
    out = {f"{name}.xml": head + ET.tostring(tree, encoding="unicode") + "\n"}
    out |= {f"Engines/{file}": text for file, text in aircraft.engine_files.items()}
    text = (
        f"# Amended by `testbench identify ... --amend {name}`: what changed, and by which flight, is in {SOURCES}.\n"
    )
    text += re.sub(
        r'^title\s*=\s*"(.*)"', lambda m: f'title = "{m[1]}; {quoted(title)[1:-1]}"', base, count=1, flags=re.MULTILINE
    )
    text = with_key(text, "", "model", quoted(f"{name}.xml"))
    for control, lag in lags_s.items():
        text = with_key(text, f"controls.{control}", "servo_lag_rad_s", real(1.0 / lag, 12))
    for coefficient, deviation in uncertainty.items():
        text = with_key(text, "uncertainty", coefficient, real(deviation, 3))
    return {**out, SOURCES: origin, "aircraft.toml": text}


def with_key(text: str, table: str, key: str, value: str) -> str:
    """Return TOML text with another value of a key, which is added at the head of its table if it is not there.

    Args:
        text: of a file.
        table: its name as the header has it; "" for what stands before the first.
        key: on a line of its own.
        value: as TOML.
    """
    lines = text.splitlines()
    heads = [i for i, line in enumerate(lines) if line.lstrip().startswith("[")]
    start, end = -1, heads[0] if heads else len(lines)
    if table:
        start = next(i for i in heads if re.match(rf"\s*\[\s*{re.escape(table)}\s*\]", lines[i]))
        end = next((i for i in heads if i > start), len(lines))
    for i in range(start + 1, end):
        if re.match(rf"\s*\"?{re.escape(key)}\"?\s*=", lines[i]):
            lines[i] = f"{key} = {value}"
            return "\n".join(lines) + "\n"
    lines.insert(start + 1, f"{key} = {value}")
    return "\n".join(lines) + "\n"


def write_folder(files: Mapping[str, str], folder: Path) -> None:
    """Write the files of an aircraft.

    Raises:
        BusyError: another process writes into the folder.
        WriteError: the folder cannot be written to, or holds an aircraft that the testbench did not write.
    """
    with ResultFolder(folder) as place:
        for name, text in files.items():
            write_file(place.new / name, text)
