"""Load any aircraft: packaged, the user's own, or one that comes with JSBSim; and check it as it is loaded."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import astuple, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft, Control, read_aircraft
from testbench.aircraft.adapter import CHANNEL, CommandedAt
from testbench.aircraft.model import MassProperties
from testbench.aircraft.seams import stabilised
from testbench.aircraft.source import Source, find_model, read_source
from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError, TrimError
from testbench.core.keyed import Keyed
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, STOCK, aircraft_names, resolve, stock_root
from testbench.core.record import FlightAborted
from testbench.flight.adopt import Adopted, adopt
from testbench.flight.coefficients import Perturbed
from testbench.flight.condition import FlightCondition
from testbench.flight.executive import Executive
from testbench.flight.mass import mass_flown
from testbench.flight.probe import TURNS, probe
from testbench.flight.simulate import Manoeuvre, fly
from testbench.flight.trim import trim
from testbench.inputs.signal import InputSignal

_FAR = 0.02  # relative difference of a deflection that is a mistake and no rounding
_STEP = 0.1  # of the full deflection, for the sign
_FRAMES = 60
_SAME = 1e-3  # of mass and inertia: JSBSim converts units with five digits
_SECONDS = 1.0
DEPARTED = {"V": 1.0, "theta": 5.0 * DEG_RAD, "phi": 5.0 * DEG_RAD}  # changes in a second that are no trim any more
_WAYS = {
    "de": ("nose down", "trailing edge down"),
    "da": ("right wing down", "rolling right"),
    "dr": ("nose left", "trailing edge left"),
}


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
        commanded_at: "stick", with the model's own control law, or "surface", without it; if not given, what
            aircraft.toml says, and for a model without one the stick where it has a law that holds the trim.

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
            return _whole(_model_at(stock(named.removeprefix(STOCK)), commanded_at))
        folder = AIRCRAFT_MODELS / named if named in aircraft_names() else Path(named)
    if not (folder / "aircraft.toml").is_file():
        return _whole(_model_at(adopted_at(folder), commanded_at))
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


def _model_at(adopted: Adopted, point: CommandedAt | None) -> Aircraft:
    """Return a model without an aircraft.toml commanded there; as `aircraft adopt` writes it, if that is not given."""
    return by_stick(adopted).aircraft if point is None else _at(adopted.aircraft, point)


def by_stick(adopted: Adopted) -> Adopted:
    """Return an adopted model commanded at the stick, its own control law flying, if it has one that holds the trim."""
    return _by_stick(Keyed(adopted, (id(adopted),)))  # which lives as long as the key


@lru_cache(maxsize=64)
def _by_stick(key: Keyed[Adopted]) -> Adopted:
    adopted = key.it
    aircraft = adopted.aircraft.commanded_at("stick")
    if not aircraft.under_law:
        return adopted
    away = departs(aircraft, adopted.trimmed.condition)
    if away and not departs(adopted.aircraft, adopted.trimmed.condition):
        said = f"control law: it does not hold the trim ({away[0]}): the surfaces are commanded, without it"
        return replace(adopted, found=(*adopted.found, said))
    said = (
        "control law: that of the model is included, and the commands are the stick; adapter.commanded_at can exclude "
        "it"
    )
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
    return _adopted(Keyed(source, (main, source.xml, tuple(source.engine_files.items()))), V_m_s, h_m)


@lru_cache(maxsize=64)
def _adopted(read: Keyed[Source], V_m_s: float | None, h_m: float | None) -> Adopted:
    return adopt(read.it, V_m_s, h_m)


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


# --- checked as it is loaded ------------------------------------------------------------------------------------------


def checked(aircraft: Aircraft, file: Path) -> Aircraft:
    """Return the aircraft, its mass as flown, if every control moves as aircraft.toml says.

    What is odd but can be flown stands in its notes: an aileron that is read on one side only, no trim at the design
    condition, a flight from trim that diverges within a second although nothing moves.

    Args:
        aircraft: as read.
        file: its aircraft.toml, for messages.

    Raises:
        ModelError: a command moves no surface, moves it by another angle than is said, or turns the aircraft the wrong
            way; JSBSim refuses the model.
    """
    contents = (file, *aircraft.contents, repr(aircraft.controls), repr(aircraft.stabiliser))
    mass, notes = _check(Keyed((aircraft, file), contents))
    return replace(aircraft, mass=mass, notes=notes)


@lru_cache(maxsize=256)
def _check(key: Keyed[tuple[Aircraft, Path]]) -> tuple[MassProperties, tuple[str, ...]]:
    aircraft, file = key.it
    condition = FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)
    fdm = Executive(aircraft.with_rigid_wings(), aircraft.rate_hz, condition)
    mass = mass_flown(fdm, file)
    pairs = list(zip(astuple(mass), astuple(aircraft.mass), strict=True))
    small = _SAME * mass.Izz  # a product of inertia is small against the moments
    if math.isclose(*pairs[0], rel_tol=_SAME) and all(
        math.isclose(*p, rel_tol=_SAME, abs_tol=small) for p in pairs[1:]
    ):
        mass = aircraft.mass
    notes = _check_drives(aircraft, condition, file) if aircraft.adapter is not None else []
    for name, control in aircraft.controls.items():
        if name == "thr":
            continue
        _check_throw(fdm, control, condition, file)
        _check_sign(fdm, control, condition, file)
    return mass, (*notes, *departs(stabilised(replace(aircraft, mass=mass)), condition))


def _check_drives(aircraft: Aircraft, condition: FlightCondition, file: Path) -> list[str]:
    """Return what a new probe notes; raise ModelError if a control moves a property otherwise than aircraft.toml says.

    A throw may be less than the model's own; what a surface does within it may not differ.
    """
    assert aircraft.adapter is not None
    bare = replace(aircraft, adapter=replace(aircraft.adapter, links=(), throttles=()), controls={}, limits={})
    found = probe(bare, condition, 0.05)
    for link in found.links:
        said = aircraft.adapter.link(link.control)
        if said is None or link.control in found.augmented:
            continue
        drives = {d.name: d for d in link.drives}
        for drive in said.drives:
            own = drives.get(drive.name)
            key = f"controls.{link.control}.drives"
            if own is None:
                raise ModelError(
                    f"{key} must name what {link.control} moves in the model ({', '.join(drives)}), got '{drive.name}' "
                    f"({file})"
                )
            d, v = np.array(own.points).T
            for deflection, value in drive.points:
                got = float(np.interp(deflection, d, v))
                if abs(got - value) > _FAR * float(np.ptp(v)):
                    raise ModelError(
                        f"{key} must agree with the model: at {link.control} = {deflection / DEG_RAD:.4g} deg, "
                        f"{drive.name} is {got:.4g}, but {value:.4g} is said ({file})"
                    )
    return [n for n in found.found if "one side does not move" in n]


def departs(aircraft: Aircraft, condition: FlightCondition) -> list[str]:
    """Return why an aircraft cannot be flown from its design condition for a second, if it cannot."""
    try:
        trimmed = trim(aircraft, condition)
    except TrimError as error:
        return [f"{aircraft.name} does not trim at its design condition: {error.message}"]
    n = round(_SECONDS * trimmed.rate_hz)
    signal = InputSignal(np.arange(n) / trimmed.rate_hz, np.zeros((n, 1)), (next(iter(aircraft.controls)),))
    names = ("V", "alpha", "theta", "phi")
    try:
        flown = fly(aircraft, trimmed, Manoeuvre("nothing", signal, 0.0), trimmed.rate_hz, names)
    except FlightAborted as error:
        return [
            f"{aircraft.name} diverges within {_SECONDS:g} s with fixed controls: {error.reason} after "
            f"{error.time_s:.2f} s"
        ]
    away = {c: float(np.abs(flown[c] - flown[c][0]).max()) for c in names}
    for channel, most in DEPARTED.items():
        if away[channel] > most:
            scale, unit = (1.0, "m/s") if channel == "V" else (1.0 / DEG_RAD, "deg")
            return [
                f"{aircraft.name} leaves its trim within {_SECONDS:g} s with fixed controls: {channel} by "
                f"{away[channel] * scale:.3g} {unit}"
            ]
    return []


def _placed(fdm: Executive, condition: FlightCondition, commands: Mapping[str, float]) -> None:
    fdm.command(dict(commands))
    fdm.place_at(condition, 0.03)
    fdm.evaluate(held=True)


def _check_throw(fdm: Executive, control: Control, condition: FlightCondition, file: Path) -> None:
    """Raise ModelError if the surface is not where its command says."""
    name = control.name
    if name not in fdm.channels:
        raise ModelError(
            f"the model of {fdm.aircraft.name} must say where {name} stands in {fdm.aircraft.source_of(name)[0]}, it "
            f"has no such property ({file}, controls.{name}); adopt it (testbench aircraft adopt) to have it probed"
        )
    i = fdm.channels.index(name)
    for said in (control.low, control.full):
        _placed(fdm, condition, {name: said})
        got = fdm.channel_nodes[i].get_double_value() * fdm.factors[i]
        for _ in range(_FRAMES):  # a servo that goes on while time stands still is on its way
            if abs(got - said) <= _FAR * abs(said):
                break
            fdm.fdm.run_ic()
            got = fdm.channel_nodes[i].get_double_value() * fdm.factors[i]
        if not abs(got - said) <= _FAR * abs(said):
            is_key = fdm.aircraft.adapter is None
            key = "full_deflection_deg" if is_key else "throw_deg"
            words = f"{abs(got) / DEG_RAD:.4g}" if got else "0 (the command moves nothing)"
            _placed(fdm, condition, {name: 0.0})
            raise ModelError(
                f"{key} of {name} must agree with the model: {control.command} = {said / control.scale:g} moves "
                f"{fdm.aircraft.source_of(name)[0]} by {words} deg, but {abs(said) / DEG_RAD:.4g} is said ({file}, "
                f"controls.{name}.{key})"
            )
    _placed(fdm, condition, {name: 0.0})


def _check_sign(fdm: Executive, control: Control, condition: FlightCondition, file: Path) -> None:
    """Raise ModelError if a positive deflection turns the aircraft the wrong way, or not at all."""
    axis, wanted = TURNS[control.name]
    way, meaning = _WAYS[control.name]
    got = []
    for sign in (-1.0, 1.0):
        _placed(fdm, condition, {control.name: sign * _STEP * min(control.full, -control.low)})
        got.append(fdm.get(f"moments/{axis}-total-lbsft"))
    _placed(fdm, condition, {control.name: 0.0})
    change = got[1] - got[0]
    if not np.isfinite(change) or change == 0.0:
        raise ModelError(
            f"{control.name} must turn {fdm.aircraft.name}, but a deflection changes no moment about its axis: the "
            f"aerodynamics does not read {fdm.aircraft.source_of(control.name)[0]} ({file}, controls.{control.name})"
        )
    if wanted * change < 0.0:
        raise ModelError(
            f"a positive {control.name} ({meaning}) must turn {fdm.aircraft.name} {way}, but turns it in the opposite "
            f"direction: change the sign in the model, or adopt it (testbench aircraft adopt) ({file}, "
            f"controls.{control.name})"
        )
