"""Couple a ground test to an aircraft, write the flexible aircraft into a folder of its own, and survey it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.aircraft.strips.flexible import Flexible, flexible_toml, make_flexible
from testbench.aircraft.strips.ground_test import GroundTest, read_ground_test
from testbench.core.door import read_bytes, read_text
from testbench.core.errors import RecordError, ScenarioError
from testbench.core.files import write_file
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, STOCK, aircraft_names, find_scenario, resolve
from testbench.core.store import OWN, ResultFolder
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.adopt import Adopted
from testbench.flight.coefficients import coefficients
from testbench.flight.load import adopted_at, by_stick, stock
from testbench.questions.aircraft.adopt import write_adopted
from testbench.questions.aircraft.ask import Survey, survey

_FILE = "aircraft.toml"
_TEST = "ground_test"  # folder of the copy of what was measured


@dataclass(frozen=True, eq=False)
class FlexibleAnswer:
    """The flexible aircraft, and what its modes do in flight."""

    rigid: str  # name of the aircraft that it was made from
    test: GroundTest  # the modes as they were given
    made: Flexible  # the aircraft and the strips that couple its modes
    folder: Path  # where it was written
    survey: Survey  # of the aircraft as the loader reads it there


def add_ground_test(
    name: str | Path, modes: Path, out: Path | None = None, say: Callable[[str], None] = lambda text: None
) -> FlexibleAnswer:
    """Return an aircraft with the modes of a ground vibration test, written to a folder that flies.

    Args:
        name: of the rigid aircraft, as :func:`testbench.flight.load.load_aircraft` takes it.
        modes: file of the ground test; see :class:`testbench.aircraft.strips.ground_test.GroundTestFile`.
        out: folder of the flexible aircraft; ``aircraft/NAME_flexible`` if not given.
        say: told what is being done.

    Raises:
        ModelError: the aircraft's model cannot take the modes.
        BusyError: another process writes into the folder.
        RecordError: a file cannot be read.
        WriteError: one cannot be written, or the folder holds another aircraft.
        ScenarioError: the file breaks a law, the aircraft is flexible already, or the folder is its own.
        TrimError: the aircraft cannot be trimmed.
    """
    folder, found = _source(str(name))
    aircraft = found.aircraft if found is not None else load_aircraft(folder)
    if aircraft.elastic is not None:
        raise ScenarioError(
            f"{folder / _FILE}, elastic: an aircraft that is made flexible must be rigid, got {aircraft.name} with "
             f"{len(aircraft.elastic)} elastic modes; take them out first"
        )  # fmt: skip
    test = read_ground_test(find_scenario(modes))
    out = Path("aircraft") / f"{aircraft.name}_flexible" if out is None else out
    if out.resolve() == folder.resolve():
        raise ScenarioError(f"the flexible aircraft must go to a folder of its own, got '{out}', the rigid one's")
    own: dict[str, float] = {}
    with ResultFolder(out) as place:
        place.check(_FILE)
        if test.content.strips.own_derivatives:
            say("read off the aircraft's own derivatives")
            own = own_derivatives(aircraft)
        made = make_flexible(aircraft, test, own)
        _write(made, test, folder, found, place)
    say("trim and linearise over speed")
    return FlexibleAnswer(aircraft.name, test, made, out, survey(load_aircraft(out), out.name))


def _source(name: str) -> tuple[Path, Adopted | None]:
    """Return the folder of an aircraft; of a JSBSim model without an aircraft.toml also what was found in it."""
    named = resolve(name, AIRCRAFT)
    if named.startswith(STOCK):
        return Path(named), by_stick(stock(named.removeprefix(STOCK)))
    folder = AIRCRAFT_MODELS / named if named in aircraft_names() else Path(named)
    return folder, None if (folder / _FILE).is_file() else by_stick(adopted_at(folder))


def _write(made: Flexible, test: GroundTest, folder: Path, found: Adopted | None, place: ResultFolder) -> None:
    out = place.new
    if found is not None:
        write_adopted(found, place)
        text = read_text(out / _FILE, "aircraft")
    else:
        text = read_text(folder / _FILE, "aircraft")
    told = flexible_toml(text, made, test, made.aircraft.name)
    if found is None:
        try:
            shutil.copytree(
                folder, out, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.py", "__pycache__", _FILE, _TEST, OWN)
            )
        except (OSError, shutil.Error) as error:
            law = "the flexible aircraft must go to a folder that can be written to"
            raise RecordError(f"{law}, got '{place.path}': {error}") from error
    names = [test.content.shapes, *(m.csv for m in test.content.mode)]
    for path in [test.path, *(test.path.parent / n for n in dict.fromkeys(names) if n)]:
        write_file(out / _TEST / path.name, read_bytes(path, "shapes"))
    write_file(out / _FILE, told)


# --- the derivatives of an aircraft as it flies, for the strips of its modes ------------------------------------------


_NOISE = 1e-9  # what differences of forces leave of a zero


def own_derivatives(aircraft: Aircraft) -> dict[str, float]:
    """Return the aerodynamic coefficients of an aircraft at its design condition, and "CL_0".

    They are those of :func:`testbench.flight.coefficients.coefficients`; CL_0 is what is left of the lift coefficient
    at zero alpha and elevator, CL - CL_alpha alpha - CL_de de.

    Raises:
        TrimError: the aircraft cannot be trimmed there.
    """
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    own = coefficients(aircraft, trimmed)
    own = {name: value if abs(value) > _NOISE else 0.0 for name, value in own.items()}
    turned = own.get("CL_de", 0.0) * trimmed.controls.get("de", 0.0)
    return {**own, "CL_0": own["CL"] - own["CL_alpha"] * trimmed.alpha - turned}
