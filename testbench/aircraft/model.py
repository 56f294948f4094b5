"""Aircraft: a folder of aircraft_models/ read into one frozen object that writes itself out as JSBSim XML."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from testbench.aircraft.adapter import SURFACES, THROTTLE, Adapter, CommandedAt, Drive, Law, Link
from testbench.aircraft.airframe import WingStation
from testbench.aircraft.amend import Amendment, Memory
from testbench.aircraft.elastic import ElasticMode, ElasticModel, WingShape, add_modes
from testbench.aircraft.outline import Outline
from testbench.aircraft.source import read_source
from testbench.core.channels import channel as channel_of
from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, JSBSIM_AREA_M2, JSBSIM_LENGTH_M, LBF_N, SLUG_KG
from testbench.core.door import read_toml
from testbench.core.errors import Faults, ModelError, ScenarioError, nearest
from testbench.core.schema import NonNegative, Pair, Positive, Strict, parse

_MOST = 1e9  # m2, m, kg, kg m2: of a geometry or a mass
_KEPT = 8
_ADAPTED: OrderedDict[tuple[str, int], tuple[Adapter | None, ET.Element]] = OrderedDict()

_MASS_KG = {"KG": 1.0, "LBS": LBF_N / G0_M_S2, "SLUG": SLUG_KG}
_INERTIA = {"KG*M2": 1.0, "SLUG*FT2": SLUG_KG * FT_M**2}


SCALES = ("airspeed", "mass", "Ixx", "Iyy", "Izz", "Ixz")
"""What coefficients are made of derivatives with, and whose errors ``[uncertainty]`` may state: the airspeed as it is
measured, mass and inertia."""


@dataclass(frozen=True)
class Geometry:
    """Reference area S (m2), span b (m) and mean aerodynamic chord cbar (m)."""

    S_m2: float
    b_m: float
    cbar_m: float


@dataclass(frozen=True)
class MassProperties:
    """Mass (kg) and moments of inertia about the centre of gravity (kg m2); Ixz positive as in JSBSim's file."""

    mass_kg: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float


@dataclass(frozen=True)
class Control:
    """A control channel and the JSBSim property that commands it."""

    name: str  #: "de", "da", "dr" or "thr"
    command: str  #: JSBSim property
    full: float  #: highest admissible value: rad, or 1 for the throttle
    #: lowest admissible value of a surface that moves less far to that side; -full if not given
    least: float | None = None
    unit: float | None = None  #: what 1 of the property means in SI; ``full`` if not given

    @property
    def low(self) -> float:
        """Lowest admissible value: rad, or 0 for the throttle."""
        return 0.0 if self.name == "thr" else -self.full if self.least is None else self.least

    @property
    def scale(self) -> float:
        """What 1 of the property means in SI."""
        return self.full if self.unit is None else self.unit


ASSUMED = "assumed by the testbench"
"""Where a limit comes from that neither a model, nor its trims, nor its owner states."""


def source_at(source: str, end: str) -> str:
    """Return what the source of a limit says of its "lowest" or "highest" end: all of it, if it holds for both."""
    return next((x.removeprefix(f"{end}: ") for x in source.split("; ") if x.startswith(f"{end}: ")), source)


@dataclass(frozen=True)
class Aircraft:
    """One aircraft: JSBSim XML of the rigid airframe, elastic modes, limits and what was amended.

    Attributes:
        name: folder name, with what was changed ("eolo, rigid wings").
        title: one line for people.
        geometry, mass: read from the XML.
        controls: by channel name.
        limits: channel -> (low, high) in SI; a flight that leaves them is aborted.
        limit_sources: channel -> where its limit comes from, in words; whoever wrote aircraft.toml, if not said.
        level_V_m_s: slowest and fastest level flight found by trimming at the design altitude; None if not sought.
        rate_hz: default simulation rate.
        design_V_m_s, design_h_m: condition that elastic equations are generated for if none is given.
        xml: the rigid aircraft as JSBSim XML.
        engine_files: file name -> XML text of Engines/.
        elastic: modes, or None for rigid wings.
        amendments: changes applied to ``xml``, from the forces up to the command, otherwise in order.
        outline: what it looks like, for drawings only, or None if nobody has said.
        wing_stations: places on the wing where instruments may sit.
        adapter: how a model that somebody else wrote is commanded and started; None for one in the testbench's own
            form.
        perturbed: its aerodynamic coefficients at the design condition, as they are found by perturbing the model.
        notes: what whoever flies it should know: what was found odd when it was loaded.
        stabiliser: control -> motion -> gain of the feedback that it is always flown with.
        uncertainty: coefficient -> relative standard deviation of the believed value; empty if nobody has said.
        scale_uncertainty: quantity of :data:`SCALES` -> its relative standard deviation, of those that are stated.
    """

    name: str
    title: str
    geometry: Geometry
    mass: MassProperties
    controls: Mapping[str, Control]
    limits: Mapping[str, tuple[float, float]]
    rate_hz: float
    design_V_m_s: float
    design_h_m: float
    xml: str
    engine_files: Mapping[str, str] = field(default_factory=dict)
    elastic: ElasticModel | None = None
    amendments: tuple[Amendment, ...] = ()
    outline: Outline | None = None
    wing_stations: tuple[WingStation, ...] = ()
    adapter: Adapter | None = None
    limit_sources: Mapping[str, str] = field(default_factory=dict)
    level_V_m_s: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()
    perturbed: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    scale_uncertainty: Mapping[str, float] = field(default_factory=dict)
    stabiliser: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def with_rigid_wings(self) -> Aircraft:
        """Return the aircraft with its modes frozen at zero deflection."""
        return replace(self, name=f"{self.name}, rigid wings", elastic=None) if self.elastic else self

    def amended(self, *amendments: Amendment) -> Aircraft:
        """Return the aircraft with further changes; they are applied when the model is written."""
        return replace(self, amendments=(*self.amendments, *amendments))

    @cached_property
    def engines(self) -> tuple[tuple[str, str], ...]:
        """Name and text of every file of Engines/."""
        return tuple(sorted(self.engine_files.items()))

    @cached_property
    def contents(self) -> tuple[object, ...]:
        """All that its JSBSim model is made of, hashable."""
        return self.xml, repr(self.adapter), repr(self.elastic), repr(self.amendments), self.engines

    @property
    def memories(self) -> tuple[Memory, ...]:
        """States that amendments bring with them, elastic modes left out."""
        return tuple(m for a in self.amendments for m in a.memories)

    def model_xml(self, rate_hz: float, qbar_Pa: float, V_m_s: float) -> str:
        """Return the complete JSBSim model for one frame rate and design condition, as text for people.

        Raises:
            ModelError: an amendment does not fit the model.
        """
        tree = self.model_tree(rate_hz, qbar_Pa, V_m_s)
        ET.indent(tree)
        return '<?xml version="1.0"?>\n' + ET.tostring(tree, encoding="unicode") + "\n"

    def model_tree(self, rate_hz: float, qbar_Pa: float, V_m_s: float) -> ET.Element:
        """Return the same as the root of a tree of its own.

        Raises:
            ModelError: an amendment does not fit the model.
        """
        tree = self.rigid_tree()
        elastic = self.flown_modes()
        if elastic is not None and len(elastic):
            add_modes(tree, elastic, 1.0 / rate_hz, qbar_Pa, V_m_s, self.adapter)
        return tree

    def rigid_tree(self) -> ET.Element:
        """Return the root of the model, adapter and amendments included, before its elastic modes are added.

        Raises:
            ModelError: an amendment does not fit the model.
        """
        tree = _adapted(self.xml, self.adapter)
        for amendment in sorted(self.amendments, key=lambda a: a.upstream):
            amendment.apply(tree, self)
        return tree

    @property
    def under_law(self) -> tuple[str, ...]:
        """The controls whose command is the stick of the model's own control law, which flies."""
        return () if self.adapter is None else tuple(x.control for x in self.adapter.links if x.by_stick)

    def commanded_at(self, point: CommandedAt) -> Aircraft:
        """Return the aircraft commanded at the "stick", its own control law flying, or at the "surface", without it.

        An aircraft that has no control law of its own stays as it is.
        """
        return self if self.adapter is None else replace(self, adapter=self.adapter.commanded_at(point))

    def source_of(self, channel: str) -> tuple[str | None, float]:
        """Return the JSBSim property that a channel of the table is read from, and the factor to SI."""
        c = channel_of(channel)
        if self.adapter is not None:
            link = self.adapter.link(channel.removesuffix("_cmd"))
            if link is not None:
                return (link.command if channel.endswith("_cmd") else link.surface), 1.0
            if channel in {"de", "da", "dr", "de_cmd", "da_cmd", "dr_cmd"}:
                return None, 1.0
            if channel in {"thr", "thr_cmd"}:
                return (THROTTLE if self.adapter.throttles else None), 1.0
            if channel == "thrust":
                return "forces/fbx-prop-lbs", LBF_N  # of all engines
        return c.jsbsim_property, c.factor / self.mass.mass_kg if c.per_mass else c.factor

    def has_servo(self, control: str) -> bool:
        """Return whether a servo moves a control: a surface without one is where its command is."""
        name = self.servo_of(control) if control in SURFACES else None
        return name is not None and (self.adapter is not None or name in self.xml)

    def servo_of(self, control: str) -> str | None:
        """Return the JSBSim property that holds the corner frequency of a servo, rad/s; None if there is none."""
        if self.adapter is None:
            return f"fcs/{SURFACES[control]}-lag-rad_sec"
        link = self.adapter.link(control)
        return link.lag if link is not None and link.lag_rad_s is not None else None

    def limit_source(self, channel: str) -> str:
        """Return in words where the limit of a channel comes from."""
        return self.limit_sources.get(channel, f"limits of {self.name}")

    def flown_modes(self) -> ElasticModel | None:
        """Return the modes that the written model carries, those added by amendments included."""
        elastic = self.elastic
        for amendment in self.amendments:
            elastic = amendment.modes_added(elastic, self.geometry.S_m2, self.geometry.cbar_m)
        return elastic

    def flown_stations(self) -> tuple[WingStation, ...]:
        """Return the wing stations; none if a mode that is flown has no shape, so that their motion is not known."""
        elastic = self.flown_modes()
        return self.wing_stations if elastic is None or all(m.shape for m in elastic.modes) else ()

    def coefficient(self, name: str) -> float:
        """Return an aerodynamic coefficient, e.g. "CL_alpha", amendments left out.

        It is the number of ``aero/coefficient/NAME`` in the XML, where it has one; of any other model the derivative
        that perturbing it at its design condition gives, see :mod:`testbench.flight.coefficients`.

        Raises:
            ModelError: there is no such coefficient, or the model does not trim at its design condition.
        """
        written = _written_coefficients(self.xml)
        if name in written:
            return written[name]
        try:
            return self.perturbed[name]
        except KeyError as error:
            why = str(error.args[0]).partition(": ")[2]
            raise ModelError(
                f"{self.name} must have a coefficient '{name}', got none{f': {why}' if why else nearest(name, ())}"
            ) from error


@lru_cache(maxsize=16)
def _written_coefficients(xml: str) -> dict[str, float]:
    """Return the coefficients that a model has as one number in a function ``aero/coefficient/NAME``."""
    found: dict[str, float] = {}
    for function in ET.fromstring(xml).iter("function"):
        head, _, name = (function.get("name") or "").rpartition("/")
        values = function.findall("product/value")
        if head == "aero/coefficient" and len(values) == 1 and name not in found:
            found[name] = float(values[0].text or "nan")
    return found


def _rising(stations: tuple[float, ...]) -> tuple[float, ...]:
    if any(b <= a for a, b in pairwise((-1e-9, *stations))):
        raise ValueError(f"stations along the right wing must rise from 0 or more, got {list(stations)}")
    return stations


def _property(name: str) -> str:
    """Return a name that reaches JSBSim: its parser takes no other letters."""
    if not re.fullmatch(r"/?[A-Za-z_][A-Za-z0-9_.\-]*(\[[0-9]+\])?(/[A-Za-z0-9_.\-]+(\[[0-9]+\])?)*", name):
        raise ValueError(f"must be a property of JSBSim, such as fcs/elevator-cmd-norm, in ASCII letters, got '{name}'")
    return name


_Property = Annotated[str, AfterValidator(_property)]
_Points = dict[_Property, Annotated[tuple[Pair, ...], Field(strict=False)]]


class _Law(Strict):
    stick: _Property
    turned: bool = False
    own: _Property
    rad_per_unit: Annotated[float, Field(ge=-1e3, le=1e3)]


class _Controls(Strict):
    command: _Property | None = None
    full_deflection_deg: Positive | None = None
    throw_deg: Annotated[tuple[float, float], Field(strict=False)] | None = None
    drives: _Points = {}
    servo_lag_rad_s: Positive | None = None
    servo_rate_limit_deg_s: Positive | None = None
    law: _Law | None = None
    engines: Annotated[tuple[_Property, ...], Field(strict=False)] = ()


class _Adapter(Strict):
    commanded_at: CommandedAt = "surface"
    set: dict[_Property, float] = {}
    declare: dict[_Property, float] = {}


class _Shape(Strict):
    bend_m: Annotated[tuple[float, ...], Field(strict=False)]
    twist_rad: Annotated[tuple[float, ...], Field(strict=False)]
    curvature_1_m: Annotated[tuple[float, ...], Field(strict=False)]


class _Mode(Strict):
    name: str
    f_hz: Positive
    zeta: Annotated[float, Field(gt=0.0, lt=1.0)]
    mass_kg_m2: Positive
    symmetry: Literal["symmetric", "asymmetric"]
    force: dict[Literal["zero", "alpha", "q", "de", "beta", "p", "r", "da", "dr"], float] = {}
    force_eta: dict[str, float] = {}
    force_etadot: dict[str, float] = {}
    force_rotary: dict[str, float] = {}
    effect_eta: dict[Literal["CL", "CD", "CY", "Cl", "Cm", "Cn"], float] = {}
    effect_etadot: dict[Literal["CL", "CD", "CY", "Cl", "Cm", "Cn"], float] = {}
    shape: _Shape | None = None


class _Elastic(Strict):
    stations_m: Annotated[tuple[float, ...], Field(strict=False), AfterValidator(_rising)] = ()
    mode: Annotated[tuple[_Mode, ...], Field(strict=False)]


class _WingStation(Strict):
    y_m: float
    x_m: float = 0.0
    height_m: NonNegative


class _SimulationFile(Strict):
    rate_hz: Positive


class AircraftFile(Strict):
    """Data of an aircraft that its JSBSim model does not contain."""

    title: str
    model: str
    design_V_m_s: Positive
    design_h_m: float
    simulation: _SimulationFile
    controls: dict[Literal["de", "da", "dr", "thr"], _Controls]
    limits: dict[str, Annotated[tuple[float, float], Field(strict=False)]]
    limit_sources: dict[str, str] = {}
    level_V_m_s: Annotated[tuple[Positive, Positive], Field(strict=False)] | None = None
    adapter: _Adapter | None = None
    elastic: _Elastic | None = None
    drawing: Outline | None = None
    wing_station: Annotated[tuple[_WingStation, ...], Field(strict=False)] = ()
    uncertainty: dict[str, Positive] = {}
    stabiliser: dict[
        Literal["de", "da", "dr"], dict[Literal["alpha", "beta", "p", "q", "r", "phi", "theta"], float]
    ] = {}


def read_aircraft(folder: Path, wings: str = "flexible") -> Aircraft:
    """Read an aircraft from a folder with aircraft.toml; nothing is flown.

    Args:
        folder: its name is the aircraft's.
        wings: "flexible", or "rigid" to hold the elastic modes at zero.

    Raises:
        ModelError: the XML is damaged, or a file that it includes is missing.
        ScenarioError: aircraft.toml breaks its schema.
    """
    path = folder / "aircraft.toml"
    described, faults = parse(AircraftFile, read_toml(path, "aircraft"), path)
    if described is None or faults:
        raise ScenarioError(faults)
    xml_path = folder / described.model
    source = read_source(xml_path)
    xml, tree = source.xml, ET.fromstring(source.xml)
    geometry = Geometry(
        _quantity(tree, "metrics/wingarea", JSBSIM_AREA_M2, xml_path),
        _quantity(tree, "metrics/wingspan", JSBSIM_LENGTH_M, xml_path),
        _quantity(tree, "metrics/chord", JSBSIM_LENGTH_M, xml_path),
    )
    mass = MassProperties(
        _quantity(tree, "mass_balance/emptywt", _MASS_KG, xml_path),
        *(_quantity(tree, f"mass_balance/{axis}", _INERTIA, xml_path, 0.0) for axis in ("ixx", "iyy", "izz", "ixz")),
    )
    controls = _controls(described, path)
    absent = [c for c in described.stabiliser if c not in controls]
    if absent:
        raise ScenarioError([f"{path}, stabiliser.{c}: the aircraft has no such control" for c in absent])
    limits = {}
    for key, (low, high) in described.limits.items():
        channel, factor = (key.removesuffix("_deg"), DEG_RAD) if key.endswith("_deg") else (key, 1.0)
        limits[channel.removesuffix("_m_s").removesuffix("_m")] = (low * factor, high * factor)
    stray = [c for c in described.limit_sources if c not in limits]
    if stray:
        raise ScenarioError(
            [f"{path}, limit_sources.{c}: must be one of the limits{nearest(c, limits)}" for c in stray]
        )
    modes = tuple(_mode(m) for m in described.elastic.mode) if described.elastic else ()
    stations = described.elastic.stations_m if described.elastic else ()
    for i, m in enumerate(modes):
        if m.shape and {len(m.shape.bend_m), len(m.shape.twist_rad), len(m.shape.curvature_1_m)} != {len(stations)}:
            raise ScenarioError(
                f"{path}, elastic.mode[{i}].shape: each list must have one entry per station, that is {len(stations)}"
            )
    known = [n.removeprefix("aero/coefficient/") for f in tree.iter("function") if (n := f.get("name"))]
    strange = [n for n in described.uncertainty if n not in (*known, *SCALES)] if described.adapter is None else []
    if strange:
        raise ScenarioError(
            [f"{path}, uncertainty.{n}: the model must have this coefficient{nearest(n, known)}" for n in strange]
        )
    aircraft = Aircraft(
        name=folder.resolve().name,
        title=described.title,
        geometry=geometry,
        mass=mass,
        controls=controls,
        limits=limits,
        limit_sources=described.limit_sources,
        level_V_m_s=described.level_V_m_s,
        rate_hz=described.simulation.rate_hz,
        design_V_m_s=described.design_V_m_s,
        design_h_m=described.design_h_m,
        xml=xml,
        engine_files=source.engine_files,
        elastic=ElasticModel(modes, geometry.S_m2, geometry.cbar_m, stations) if modes else None,
        outline=described.drawing,
        wing_stations=tuple(WingStation(s.y_m, s.x_m, s.height_m) for s in described.wing_station),
        adapter=_adapter(described),
        uncertainty={n: s for n, s in described.uncertainty.items() if n not in SCALES},
        scale_uncertainty={n: s for n, s in described.uncertainty.items() if n in SCALES},
        stabiliser={control: dict(gains.items()) for control, gains in described.stabiliser.items()},
    )
    return aircraft.with_rigid_wings() if wings == "rigid" else aircraft


def _mode(m: _Mode) -> ElasticMode:
    return ElasticMode(
        m.name,
        m.f_hz,
        m.zeta,
        m.mass_kg_m2,
        m.symmetry,
        dict(m.force.items()),
        {int(j): c for j, c in m.force_eta.items()},
        {int(j): c for j, c in m.force_etadot.items()},
        dict(m.effect_eta.items()),
        dict(m.effect_etadot.items()),
        WingShape(m.shape.bend_m, m.shape.twist_rad, m.shape.curvature_1_m) if m.shape else None,
        {int(j): c for j, c in m.force_rotary.items()},
    )


def _controls(described: AircraftFile, path: Path) -> dict[str, Control]:
    """Return the controls, commanded by a property of the model, or through the adapter.

    Raises:
        ScenarioError: a control lacks what its form needs.
    """
    out: dict[str, Control] = {}
    faults = Faults(path)
    for n, c in described.controls.items():
        if described.adapter is None:
            if c.command is None:
                faults.note(f"controls.{n}", "command must be the JSBSim property that commands it, got none")
            for key in ("throw_deg", "drives", "servo_lag_rad_s", "servo_rate_limit_deg_s", "law", "engines"):
                if getattr(c, key):
                    faults.note(f"controls.{n}.{key}", "it is for models with an [adapter] only; leave it out")
            full = 1.0 if c.full_deflection_deg is None else c.full_deflection_deg * DEG_RAD
            out[n] = Control(n, c.command or "", full)
        elif n == "thr":
            if not c.engines:
                faults.note("controls.thr", "engines must list the throttle property of every engine, got none")
            out[n] = Control(n, THROTTLE, 1.0)
        else:
            low, high = c.throw_deg or (0.0, 0.0)
            if not low < high or not c.drives:
                faults.note(f"controls.{n}", "throw_deg = [low, high] with low < high and drives must be given")
            for name, points in c.drives.items():
                if len(points) < 2 or any(b[0] <= a[0] for a, b in pairwise(points)):
                    faults.note(f"controls.{n}.drives", f"deflections of '{name}' must ascend, at least two of them")
            out[n] = Control(n, Link(n, ()).command, high * DEG_RAD, low * DEG_RAD, 1.0)
    if faults:
        raise ScenarioError(faults)
    return out


def _adapter(described: AircraftFile) -> Adapter | None:
    if described.adapter is None:
        return None
    links = []
    for n, c in described.controls.items():
        if n != "thr":
            drives = (Drive(k, tuple((d * DEG_RAD, v) for d, v in points)) for k, points in c.drives.items())
            limit = None if c.servo_rate_limit_deg_s is None else c.servo_rate_limit_deg_s * DEG_RAD
            servo, law = (c.servo_lag_rad_s, limit), None
            if c.law is not None and c.throw_deg is not None:
                ends = (c.throw_deg[0] * DEG_RAD, c.throw_deg[1] * DEG_RAD)
                law = Law(c.law.stick, -1.0 if c.law.turned else 1.0, c.law.own, c.law.rad_per_unit, ends, *servo)
            links.append(Link(n, tuple(drives), *servo, law=law))
    thr = described.controls.get("thr")
    adapter = Adapter(
        tuple(links),
        thr.engines if thr is not None else (),
        dict(described.adapter.set),
        dict(described.adapter.declare),
    )
    return adapter.commanded_at(described.adapter.commanded_at)


def _quantity(
    tree: ET.Element, path: str, units: Mapping[str, float], file: Path, default: float | None = None
) -> float:
    element = tree.find(path)
    if element is None and default is not None:
        return default  # JSBSim, too, takes what is missing as zero
    unit = (element.get("unit") or "").upper() if element is not None else ""
    if element is None or unit not in units:
        raise ModelError(
            f"'{file}' must hold <{path}> in {' or '.join(units)}, got {'nothing' if element is None else repr(unit)}"
        )
    try:
        value = float(element.text or "nan") * units[unit]
    except ValueError:
        value = math.nan
    if not abs(value) <= _MOST:
        raise ModelError(f"<{path}> of '{file}' must be a number below {_MOST:g} in SI units, got {element.text!r}")
    return value


def _adapted(xml: str, adapter: Adapter | None) -> ET.Element:
    """Return a tree of its own of a model with its adapter: a search asks for thousands that differ in amendments."""
    key = xml, id(adapter)
    known = _ADAPTED.get(key)
    if known is None or known[0] is not adapter:
        tree = _copied(_parsed(xml))
        if adapter is not None:
            adapter.apply(tree)
        known = _ADAPTED[key] = adapter, tree
        while len(_ADAPTED) > _KEPT:
            _ADAPTED.popitem(last=False)
    return _copied(known[1])


@lru_cache(maxsize=_KEPT)
def _parsed(xml: str) -> ET.Element:
    return ET.fromstring(xml)


def _copied(element: ET.Element) -> ET.Element:
    """Return a copy in a third of the time of parsing; that of copy.deepcopy takes longer than parsing."""
    out = ET.Element(element.tag, element.attrib)
    out.text, out.tail = element.text, element.tail
    out.extend([_copied(child) for child in element])
    return out
