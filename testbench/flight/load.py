"""Load any aircraft: packaged, the user's own, or one that comes with JSBSim; and check it as it is loaded."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from testbench.aircraft import Aircraft, read_aircraft
from testbench.aircraft.adapter import CHANNEL, CommandedAt
from testbench.aircraft.source import Source, find_model, read_source
from testbench.aircraft.stabiliser import stabilised
from testbench.core.errors import ModelError
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, STOCK, aircraft_names, resolve, stock_root
from testbench.flight.adopt import Adopted, adopt
from testbench.flight.check import checked, departs
from testbench.flight.coefficients import Perturbed
from testbench.flight.condition import FlightCondition
from testbench.flight.executive import Executive


def load_aircraft(
    name: str | Path, wings: str = "flexible", folder: Path | None = None, commanded_at: CommandedAt | None = None
) -> Aircraft:
    """Load an aircraft and check that it does what is said of it.

    A JSBSim model without an aircraft.toml is adopted: probed and trimmed, which takes some tenths of a second, see
    :func:`testbench.flight.adopt.adopt`. What is odd but can be flown stands in ``notes`` of the aircraft.

    Args:
        name: a packaged aircraft; the path of a folder with aircraft.toml, or of a JSBSim model (XML file or folder); a
            name in the user's ``aircraft/``; or a model that comes with JSBSim, "jsbsim:f16", or "f16" alone.
        wings: "flexible", or "rigid" to hold the elastic modes at zero.
        folder: read this folder instead.
        commanded_at: "stick", with the model's own control law, or "surface", without it; what aircraft.toml says, or
            the surface, if not given.

    Raises:
        ModelError: the model is damaged, JSBSim refuses it, or a control does not move as aircraft.toml says.
        TrimError: a model without aircraft.toml trims nowhere.
        ScenarioError: no such aircraft, or aircraft.toml breaks its schema.

    Example:
        >>> import testbench as tb
        >>> tb.load_aircraft("taurus").geometry.b_m
        1.27
        >>> round(tb.load_aircraft("jsbsim:c172p").mass.mass_kg)
        853
    """
    if folder is None:
        named = resolve(str(name), AIRCRAFT)
        if named.startswith(STOCK):
            return _whole(_at(stock(named.removeprefix(STOCK)).aircraft, commanded_at))
        folder = AIRCRAFT_MODELS / named if named in aircraft_names() else Path(named)
    if not (folder / "aircraft.toml").is_file():
        return _whole(_at(adopted_at(folder).aircraft, commanded_at))
    return _whole(checked(_at(read_aircraft(folder, wings), commanded_at), folder / "aircraft.toml"))


def _at(aircraft: Aircraft, point: CommandedAt | None) -> Aircraft:
    """Return the aircraft commanded there.

    Raises:
        ModelError: it has no control law of its own, and the stick is asked for.
    """
    if point == "stick" and not aircraft.commanded_at(point).under_law:
        raise ModelError(
            f"an aircraft must have a control law to be commanded at the stick, but nothing in {aircraft.name} moves a "
            "surface with the motion: command the surface"
        )
    return aircraft if point is None else aircraft.commanded_at(point)


def by_stick(adopted: Adopted) -> Adopted:
    """Return an adopted model commanded at the stick, its own control law flying, if it has one that holds the trim."""
    aircraft = adopted.aircraft.commanded_at("stick")
    if not aircraft.under_law:
        return adopted
    away = departs(aircraft, adopted.trimmed.condition)
    if away and not departs(adopted.aircraft, adopted.trimmed.condition):
        said = f"control law: it does not hold the trim ({away[0]}): the surfaces are commanded, and it is left out"
        return replace(adopted, found=(*adopted.found, said))
    said = "control law: the model's own flies, and the commands are the stick; adapter.commanded_at can leave it out"
    return replace(adopted, aircraft=aircraft, found=(*adopted.found, said))


class AircraftNote(UserWarning):
    """What is odd about an aircraft that can be flown all the same."""


def _whole(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with its coefficients, which are found when they are first asked for; warn of its notes.

    A foreign model gets its centre of gravity, too, which is where forces act that are added to it.
    """
    for note in aircraft.notes:
        warnings.warn(AircraftNote(note), stacklevel=3)
    if aircraft.adapter is not None and aircraft.adapter.cg_in is None:
        fdm = Executive(aircraft, aircraft.rate_hz, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
        x, y, z = (fdm.get(f"inertia/cg-{axis}-in") for axis in "xyz")
        aircraft = replace(aircraft, adapter=replace(aircraft.adapter, cg_in=(x, y, z)))
    return stabilised(replace(aircraft, perturbed=Perturbed(aircraft)))


def adopted_at(path: Path, V_m_s: float | None = None, h_m: float | None = None, repair: bool = False) -> Adopted:
    """Adopt the JSBSim model at a path, an XML file or a folder; once in a process, unless a file of it changes.

    With ``repair``, what JSBSim refuses of it is mended, see :func:`testbench.aircraft.source.read_source`.

    Raises:
        ModelError: there is no JSBSim model, or it cannot be flown.
        TrimError: it trims nowhere.
    """
    main = find_model(path)
    if main is None:
        raise ModelError(
            f"an aircraft must be a folder with aircraft.toml, or a JSBSim model (an XML file that begins with "
            f"<fdm_config>, or a folder with one), got '{path}'"
        )
    source = read_source(main, repair)
    if f'<channel name="{CHANNEL}">' in source.xml:
        raise ModelError(
            f"a model is adopted as its author wrote it, but '{main}' holds the channels that the testbench adds: "
            "load the model that it was made from, or fly this one in JSBSim by its testbench/...-command properties"
        )
    return _adopted(_Read(source, (main, source.xml, tuple(source.engine_files.items()))), V_m_s, h_m)


@dataclass(frozen=True)
class _Read:
    """A model as read now; another if any file of it has changed."""

    source: Source = field(compare=False)
    contents: tuple[object, ...]


@lru_cache(maxsize=64)
def _adopted(read: _Read, V_m_s: float | None, h_m: float | None) -> Adopted:
    return adopt(read.source, V_m_s, h_m)


def stock(name: str) -> Adopted:
    """Adopt a model that comes with JSBSim.

    Raises:
        ModelError: it is no fixed-wing aircraft, or JSBSim refuses it.
        TrimError: it trims nowhere.
    """
    root = stock_root()
    if root is None:
        raise ModelError("models that come with JSBSim need the jsbsim package, which was not found")
    return adopted_at(root / "aircraft" / name)
