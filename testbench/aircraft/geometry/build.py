"""From the plan of an aircraft to the files of its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from testbench.aircraft.geometry.aerodynamics import Aerodynamics, aerodynamics, aerosandbox, check_sign
from testbench.aircraft.geometry.coefficients import Coefficient, coefficients
from testbench.aircraft.geometry.describe import aircraft_toml, limits_of, sources_md
from testbench.aircraft.geometry.model_xml import Polar, engine_files, model_xml
from testbench.aircraft.geometry.propulsion import Thrust, thrust_law
from testbench.aircraft.geometry.read import Plan
from testbench.core.constants import G0_M_S2
from testbench.core.door import read_bytes
from testbench.core.errors import ScenarioError, located
from testbench.core.files import write_file


@dataclass(frozen=True)
class Made:
    """An aircraft that was made from its geometry.

    Attributes:
        name: of its folder and its model.
        plan: what it was made from.
        found: what both methods find.
        coefficients: those of the model.
        polar: of the drag.
        thrust: law of the motor; None for a glider.
        files: path in the folder -> text.
        copies: path in the folder -> file that is copied there as it is.
        remarks: what somebody who flies it should know, as sentences.
    """

    name: str
    plan: Plan
    found: Aerodynamics
    coefficients: Mapping[str, Coefficient]
    polar: Polar
    thrust: Thrust | None
    files: Mapping[str, str]
    copies: Mapping[str, Path]
    remarks: tuple[str, ...]

    def write(self, folder: Path) -> list[Path]:
        """Write the folder and return the paths; aircraft.toml, which makes it an aircraft, comes last.

        Raises:
            WriteError: the folder cannot be written to.
        """
        copied = {name: read_bytes(path, "geometry") for name, path in self.copies.items()}
        out = [write_file(folder / name, content) for name, content in copied.items()]
        return [*out, *(write_file(folder / name, text) for name, text in self.files.items())]


def model_from_plan(plan: Plan, name: str) -> Made:
    """Return the aircraft that a plan describes.

    Args:
        plan: what was read.
        name: of the folder and the model.

    Raises:
        MissingPackage: AeroSandbox is not installed.
        ModelError: the aircraft cannot carry its weight, or a control works against its convention.
        ScenarioError: the propeller gives no thrust.
    """
    said, plane = plan.said, plan.plane
    x, _, z = plan.balance.cg_m  # across it lies in the plane of symmetry, but for what the schema lets pass
    centred = plane.about(x, z)
    with located(plan.file, "design_V_m_s"):
        found = aerodynamics(centred, plan.balance.mass_kg, said.design_V_m_s, said.design_h_m)
    for control in plane.controls:
        with located(plan.file, f"control.{control}"):
            check_sign(control, found)
    values = coefficients(found, said.drag.CD0_added)
    polar = Polar(found.CD0 + said.drag.CD0_added, found.buildup.k, found.CL_least_drag)
    limits = limits_of(plan, found, values)
    density = float(aerosandbox().Atmosphere(altitude=said.design_h_m).density())
    thrust = None
    if said.motor is not None:
        try:
            thrust = thrust_law(said.motor, density, (limits.V_m_s[0], limits.V_m_s[1]))
        except ScenarioError as error:
            raise ScenarioError([f"{plan.file}, {fault}" for fault in error.faults]) from error
    remarks = _remarks(plan, found.CL, values, polar, thrust)
    note = (
        f"Coefficients computed from the geometry by strips and by a vortex lattice at {said.design_V_m_s:g} "
        "m/s (SOURCES.md); "
        "not validated against any flight."
    )
    reference = (plane.S_m2, plane.b_m, plane.cbar_m)
    xml = model_xml(name, plan.title, note, reference, plan.balance, plan.servos, values, polar, said.motor, thrust)
    files = {f"{name}.xml": xml}
    if thrust is not None:
        files |= {f"Engines/{file}": text for file, text in engine_files(thrust).items()}
    files["SOURCES.md"] = sources_md(name, plan, found, values, polar, thrust, limits, remarks)
    files["aircraft.toml"] = aircraft_toml(name, plan, centred, found, values, limits)
    copies = {
        (at if not Path(at).is_absolute() and ".." not in Path(at).parts else Path(at).name): path
        for at, path in plan.sources.items()
    }
    return Made(name, plan, found, values, polar, thrust, files, copies, remarks)


def _remarks(
    plan: Plan, CL: float, values: Mapping[str, Coefficient], polar: Polar, thrust: Thrust | None
) -> tuple[str, ...]:
    out = list(plan.plane.notes)
    margin = -values["Cm_alpha"].used / values["CL_alpha"].used
    if margin < 0.0:
        out.append(
            f"the centre of gravity lies {-100.0 * margin:.0f} % of the mean chord behind the neutral point: it "
            "diverges in pitch"
        )
    if "Cn_beta" not in values or values["Cn_beta"].used < 0.0:
        out.append("it has no weathercock stability (Cn_beta <= 0): give it a fin, or more of one")
    V = plan.said.design_V_m_s
    drag = (polar.CD0 + polar.k * (CL - polar.CL_least_drag) ** 2) / CL * plan.balance.mass_kg * G0_M_S2
    if thrust is not None and thrust.at(1.0, V) < drag:
        out.append(f"full throttle gives {thrust.at(1.0, V):.3g} N at {V:g} m/s, but level flight takes {drag:.3g} N")
    Cm = values["Cm0"].used if "Cm0" in values else 0.0
    if "Cm_de" in values:
        CL0 = values["CL0"].used if "CL0" in values else 0.0
        alpha = (CL - CL0) / values["CL_alpha"].used
        de = -(Cm + values["Cm_alpha"].used * alpha) / values["Cm_de"].used
        throw = math.radians(plan.servos["de"].throw_deg)
        if abs(de) > 0.8 * throw:
            out.append(
                f"trim at {V:g} m/s takes {math.degrees(de):.0f} deg of elevator, of "
                f"{plan.servos['de'].throw_deg:g}: check "
                "incidence of the tail and centre of gravity"
            )
    else:
        out.append("no elevator: it cannot be trimmed")
    ahead = [s.name for s in plan.plane.of("tail") if s.quarter_chord_m[0] < plan.balance.cg_m[0]]
    if ahead:
        out.append(
            f"{ahead[0]} lies ahead of the centre of gravity: a positive elevator, which pitches the nose down, "
            "moves up there"
        )
    missing = [n for n in ("da", "dr") if n not in plan.servos] + ([] if thrust is not None else ["thr"])
    if missing:
        out.append(f"it has no {', '.join(missing)}")
    return tuple(out)
