"""Aircraft: a folder of aircraft_models/ read into one frozen object that writes itself out as JSBSim XML."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from testbench.aircraft.airframe import WingStation
from testbench.aircraft.amend import Amendment, Memory
from testbench.aircraft.elastic import ElasticMode, ElasticModel, WingShape, add_modes
from testbench.aircraft.outline import Outline
from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, JSBSIM_LENGTH_M, LBF_N, SLUG_KG
from testbench.core.errors import ModelError, ScenarioError, nearest
from testbench.core.paths import AIRCRAFT, AIRCRAFT_MODELS, aircraft_names, resolve
from testbench.core.schema import NonNegative, Positive, Strict, parse, read_toml

_AREA_M2 = {"M2": 1.0, "FT2": FT_M**2}
_MASS_KG = {"KG": 1.0, "LBS": LBF_N / G0_M_S2, "SLUG": SLUG_KG}
_INERTIA = {"KG*M2": 1.0, "SLUG*FT2": SLUG_KG * FT_M**2}


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
    """A control channel: the JSBSim property that commands it (-1 to 1, or 0 to 1) and what 1 means in SI."""

    name: str
    command: str
    full: float

    @property
    def low(self) -> float:
        """Lowest admissible value: rad, or 0 for the throttle."""
        return 0.0 if self.name == "thr" else -self.full


@dataclass(frozen=True)
class Aircraft:
    """One aircraft: JSBSim XML of the rigid airframe, elastic modes, limits and what was amended.

    Attributes:
        name: folder name, with what was changed ("eolo, rigid wings").
        title: one line for people.
        geometry, mass: read from the XML.
        controls: by channel name.
        limits: channel -> (low, high) in SI; a flight that leaves them is aborted.
        rate_hz: default simulation rate.
        design_V_m_s, design_h_m: condition that elastic equations are generated for if none is given.
        xml: the rigid aircraft as JSBSim XML.
        engine_files: file name -> XML text of Engines/.
        elastic: modes, or None for rigid wings.
        amendments: changes applied to ``xml``, from the forces up to the command, otherwise in order.
        outline: what it looks like, for drawings only, or None if nobody has said.
        wing_stations: places on the wing where instruments may sit.
        uncertainty: coefficient -> relative standard deviation of the believed value; empty if nobody has said.
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
    uncertainty: Mapping[str, float] = field(default_factory=dict)

    def with_rigid_wings(self) -> Aircraft:
        """Return the aircraft with its modes frozen at zero deflection."""
        return replace(self, name=f"{self.name}, rigid wings", elastic=None) if self.elastic else self

    def amended(self, *amendments: Amendment) -> Aircraft:
        """Return the aircraft with further changes; they are applied when the model is written."""
        return replace(self, amendments=(*self.amendments, *amendments))

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
        tree = ET.fromstring(self.xml)
        for amendment in sorted(self.amendments, key=lambda a: a.upstream):
            amendment.apply(tree)
        elastic = self.flown_modes()
        if elastic is not None and len(elastic):
            add_modes(tree, elastic, 1.0 / rate_hz, qbar_Pa, V_m_s)
        return tree

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
        """Return the number of ``aero/coefficient/NAME`` in the XML, e.g. "CL_alpha".

        Raises:
            ModelError: the XML has no such coefficient, or it is not a single number.
        """
        for function in ET.fromstring(self.xml).iter("function"):
            if function.get("name") == f"aero/coefficient/{name}":
                values = function.findall("product/value")
                if len(values) == 1:
                    return float(values[0].text or "nan")
        raise ModelError(f"{self.name} must have a coefficient '{name}' with one value, got none")


class _Controls(Strict):
    command: str
    full_deflection_deg: Positive | None = None


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
    effect_eta: dict[Literal["CL", "CD", "CY", "Cl", "Cm", "Cn"], float] = {}
    effect_etadot: dict[Literal["CL", "CD", "CY", "Cl", "Cm", "Cn"], float] = {}
    shape: _Shape | None = None


class _Elastic(Strict):
    stations_m: Annotated[tuple[float, ...], Field(strict=False)] = ()
    mode: Annotated[tuple[_Mode, ...], Field(strict=False)]


class _WingStation(Strict):
    y_m: float
    x_m: float = 0.0
    height_m: NonNegative


class _SimulationFile(Strict):
    rate_hz: Positive


class _AircraftFile(Strict):
    title: str
    model: str
    design_V_m_s: Positive
    design_h_m: float
    simulation: _SimulationFile
    controls: dict[Literal["de", "da", "dr", "thr"], _Controls]
    limits: dict[str, Annotated[tuple[float, float], Field(strict=False)]]
    elastic: _Elastic | None = None
    drawing: Outline | None = None
    wing_station: Annotated[tuple[_WingStation, ...], Field(strict=False)] = ()
    uncertainty: dict[str, Positive] = {}


def load_aircraft(name: str | Path, wings: str = "flexible", folder: Path | None = None) -> Aircraft:
    """Read an aircraft from its folder.

    Args:
        name: a packaged aircraft, the path of a folder with aircraft.toml, or a name in the user's ``aircraft/``.
        wings: "flexible", or "rigid" to hold the elastic modes at zero.
        folder: read this folder instead.

    Raises:
        ModelError: the XML is damaged.
        ScenarioError: no such aircraft, or aircraft.toml breaks its schema.

    Example:
        >>> import testbench as tb
        >>> tb.load_aircraft("taurus").geometry.b_m
        1.27
    """
    if folder is None:
        named = resolve(str(name), AIRCRAFT)
        folder = AIRCRAFT_MODELS / named if named in aircraft_names() else Path(named)
        name = folder.name
    path = folder / "aircraft.toml"
    described, faults = parse(_AircraftFile, read_toml(path), path)
    if described is None or faults:
        raise ScenarioError(faults)
    xml_path = folder / described.model
    try:
        xml = xml_path.read_text(encoding="utf-8")
        tree = ET.fromstring(xml)
    except (OSError, ET.ParseError) as error:
        raise ModelError(f"'{xml_path}' must be a JSBSim model, but it cannot be read: {error}") from error
    geometry = Geometry(
        _quantity(tree, "metrics/wingarea", _AREA_M2, xml_path),
        _quantity(tree, "metrics/wingspan", JSBSIM_LENGTH_M, xml_path),
        _quantity(tree, "metrics/chord", JSBSIM_LENGTH_M, xml_path),
    )
    mass = MassProperties(
        _quantity(tree, "mass_balance/emptywt", _MASS_KG, xml_path),
        *(_quantity(tree, f"mass_balance/{axis}", _INERTIA, xml_path) for axis in ("ixx", "iyy", "izz", "ixz")),
    )
    controls: dict[str, Control] = {
        n: Control(n, c.command, 1.0 if c.full_deflection_deg is None else c.full_deflection_deg * DEG_RAD)
        for n, c in described.controls.items()
    }
    limits = {}
    for key, (low, high) in described.limits.items():
        channel, factor = (key.removesuffix("_deg"), DEG_RAD) if key.endswith("_deg") else (key, 1.0)
        limits[channel.removesuffix("_m_s").removesuffix("_m")] = (low * factor, high * factor)
    modes = tuple(_mode(m) for m in described.elastic.mode) if described.elastic else ()
    stations = described.elastic.stations_m if described.elastic else ()
    for i, m in enumerate(modes):
        if m.shape and {len(m.shape.bend_m), len(m.shape.twist_rad), len(m.shape.curvature_1_m)} != {len(stations)}:
            raise ScenarioError(
                [f"{path}, elastic.mode[{i}].shape: each list must have one entry per station, that is {len(stations)}"]
            )
    known = [n.removeprefix("aero/coefficient/") for f in tree.iter("function") if (n := f.get("name"))]
    strange = [n for n in described.uncertainty if n not in known]
    if strange:
        raise ScenarioError(
            [f"{path}, uncertainty.{n}: the model must have this coefficient{nearest(n, known)}" for n in strange]
        )
    aircraft = Aircraft(
        name=str(name),
        title=described.title,
        geometry=geometry,
        mass=mass,
        controls=controls,
        limits=limits,
        rate_hz=described.simulation.rate_hz,
        design_V_m_s=described.design_V_m_s,
        design_h_m=described.design_h_m,
        xml=xml,
        engine_files={p.name: p.read_text(encoding="utf-8") for p in sorted((folder / "Engines").glob("*.xml"))},
        elastic=ElasticModel(modes, geometry.S_m2, geometry.cbar_m, stations) if modes else None,
        outline=described.drawing,
        wing_stations=tuple(WingStation(s.y_m, s.x_m, s.height_m) for s in described.wing_station),
        uncertainty=described.uncertainty,
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
    )


def _quantity(tree: ET.Element, path: str, units: Mapping[str, float], file: Path) -> float:
    element = tree.find(path)
    unit = (element.get("unit") or "").upper() if element is not None else ""
    if element is None or unit not in units:
        raise ModelError(
            f"'{file}' must hold <{path}> in {' or '.join(units)}, got {'nothing' if element is None else repr(unit)}"
        )
    return float(element.text or "nan") * units[unit]
