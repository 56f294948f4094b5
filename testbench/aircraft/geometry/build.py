"""From the plan of an aircraft to the files of its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from testbench.aircraft.geometry.aerodynamics import Aerodynamics, aerodynamics, aerosandbox, check_sign
from testbench.aircraft.geometry.coefficients import ROWS, Coefficient, coefficients
from testbench.aircraft.geometry.model_xml import COMMANDS, Polar, engine_files, model_xml
from testbench.aircraft.geometry.propulsion import Thrust, thrust_law
from testbench.aircraft.geometry.read import Plan
from testbench.aircraft.geometry.shape import LiftingSurface, Plane
from testbench.aircraft.outline import Outline, Surface, centroid
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.door import read_bytes
from testbench.core.errors import ScenarioError, located
from testbench.core.escape import markdown_cell, one_line, quoted, real
from testbench.core.files import write_file

_STEEPEST_DEG = 79.0  # dihedral of a drawing
_BETA_DEG, _THETA_DEG, _PHI_DEG = 20.0, 60.0, 80.0
_FASTEST, _CLIMB_M = 2.0, 1500.0
FlownLimits = dict[str, tuple[tuple[float, float], str]]
"""Key of ``[limits]`` in aircraft.toml -> the lowest and the highest value of a flight, and where they come from."""


@dataclass(frozen=True)
class Made:
    """An aircraft that was made from its geometry."""

    name: str  # of its folder and its model
    plan: Plan  # what it was made from
    found: Aerodynamics  # what both methods find
    coefficients: Mapping[str, Coefficient]  # those of the model
    polar: Polar  # of the drag
    thrust: Thrust | None  # law of the motor; None for a glider
    files: Mapping[str, str]  # path in the folder -> text
    copies: Mapping[str, Path]  # path in the folder -> file that is copied there as it is
    remarks: tuple[str, ...]  # what somebody who flies it should know, as sentences

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
            thrust = thrust_law(said.motor, density, limits["V_m_s"][0])
        except ScenarioError as error:
            raise ScenarioError([f"{plan.file}, {fault}" for fault in error.faults]) from error
    remarks = _remarks(plan, found.CL, values, polar, thrust)
    note = (
        f"Coefficients computed from the geometry by strips and by a vortex lattice at {said.design_V_m_s:g} "
        "m/s (SOURCES.md); "
        "not validated against any flight."
    )
    files = {f"{name}.xml": model_xml(name, note, plan, values, polar, thrust)}
    if thrust is not None:
        files |= {f"Engines/{file}": text for file, text in engine_files(thrust).items()}
    copies = {
        (at if not Path(at).is_absolute() and ".." not in Path(at).parts else Path(at).name): path
        for at, path in plan.sources.items()
    }
    made = Made(name, plan, found, values, polar, thrust, files, copies, remarks)
    files["SOURCES.md"] = sources_md(made, limits)
    files["aircraft.toml"] = aircraft_toml(name, plan, centred, found, values, limits)
    return replace(made, files=files)


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


# --- the files beside a model -----------------------------------------------------------------------------------------


def limits_of(plan: Plan, found: Aerodynamics, values: Mapping[str, Coefficient]) -> FlownLimits:
    """Return the limits that the plan gives, and those that follow for the others."""
    said, V, h = plan.said.limits, plan.said.design_V_m_s, plan.said.design_h_m
    low, high = (round(a / DEG_RAD, 1) for a in found.alpha_limits_rad)
    top = (said.alpha_deg or (low, high))[1]
    CL0 = values["CL0"].used if "CL0" in values else 0.0
    most = CL0 + values["CL_alpha"].used * top * DEG_RAD
    slowest = V * math.sqrt(found.CL / most) if most > 0.0 < found.CL else 0.5 * V
    slowest = math.ceil(10.0 * min(slowest, 0.9 * V)) / 10.0
    derived: FlownLimits = {
        "V_m_s": (
            (slowest, _FASTEST * V),
            f"level flight at the highest alpha; {_FASTEST:g} times the design speed, judged",
        ),
        "alpha_deg": (
            (low, high),
            "where the lift of the build-up leaves a straight line by 0.2, at least 5 deg about the trim",
        ),
        "beta_deg": ((-_BETA_DEG, _BETA_DEG), "judged: where a fin stalls"),
        "theta_deg": ((-_THETA_DEG, _THETA_DEG), "judged"),
        "phi_deg": ((-_PHI_DEG, _PHI_DEG), "judged"),
        "h_m": ((min(10.0, h - 90.0), h + _CLIMB_M), "judged"),
    }
    given = said.model_dump(exclude_none=True)
    return derived | {key: (pair, "given") for key, pair in given.items()}


def aircraft_toml(
    name: str, plan: Plan, centred: Plane, found: Aerodynamics, values: Mapping[str, Coefficient], limits: FlownLimits
) -> str:
    """Return the text of aircraft.toml; ``centred`` is the outside about the centre of gravity."""
    said = plan.said
    out = [
        "# Made from its geometry by `testbench aircraft new`. Sources of every number: SOURCES.md.",
        f"title = {quoted(plan.title)}",
        f"model = {quoted(f'{name}.xml')}",
        f"design_V_m_s = {real(said.design_V_m_s)}  # the coefficients were computed for this condition",
        f"design_h_m = {real(said.design_h_m)}",
        "",
        "[simulation]",
        f"rate_hz = {real(said.rate_hz)}",
        "",
        "# full_deflection_deg is the throw of the geometry file.",
    ]
    for control, servo in plan.servos.items():
        out += [
            f"[controls.{control}]",
            f'command = "{COMMANDS[control]}"',
            f"full_deflection_deg = {real(servo.throw_deg)}",
        ]
    if said.motor is not None:
        out += ["[controls.thr]", 'command = "fcs/throttle-cmd-norm"']
    out += ["", "# A flight that leaves these is aborted.", "[limits]"]
    out += [f"{key} = [{real(low)}, {real(high)}]" for key, ((low, high), _) in limits.items()]
    out += ["", "# Sources of the limits that were not given.", "[limit_sources]"]
    out += [f"{k.split('_')[0]} = {quoted(one_line(words))}" for k, (_, words) in limits.items() if words != "given"]
    out += [
        "",
        "# Relative standard deviation of every coefficient: scatter of published values about computed ones "
        "(coefficients.py).",
        "# It is the prior of every question that needs one.",
        "[uncertainty]",
    ]
    for c in values.values():
        out.append(f"{c.name} = {c.deviation:.3g}")
    out += [
        "",
        "# Data of the drawing in its report; not used in flights. Places are relative to the centre of gravity, "
        "x forward, z up.",
        *outline(centred).toml(),
    ]
    return "\n".join([*out, ""])


def sources_md(made: Made, limits: FlownLimits) -> str:
    """Return the text of SOURCES.md: every number with where it comes from."""
    plan, found, thrust = made.plan, made.found, made.thrust
    plane, b, polar = plan.plane, plan.balance, made.polar
    files = ", ".join(f"`{markdown_cell(n)}`" for n in plan.sources)
    out = [
        f"# {markdown_cell(made.name)}: sources of every number",
        "",
        f"Made by `testbench aircraft new` from {files}. **given** = stands there; **computed**, **estimated** "
        "and **judged** as they",
        "say. Nothing has been validated against flight.",
        "",
        "| number | value | source |",
        "|---|---|---|",
        f"| S, b, cbar | {plane.S_m2:.5g} m2, {plane.b_m:.5g} m, {plane.cbar_m:.5g} m | {_reference(plan)} |",
        f"| mass | {b.mass_kg:.5g} kg | {markdown_cell(b.source)} |",
        f"| centre of gravity | x = {b.cg_m[0]:.5g}, y = {b.cg_m[1]:.5g}, z = {b.cg_m[2]:.5g} m in the file | "
        "as the mass |",
        f"| Ixx, Iyy, Izz, Ixz | {b.Ixx:.4g}, {b.Iyy:.4g}, {b.Izz:.4g}, {b.Ixz:.4g} kg m2 | as the mass |",
    ]
    for control, servo in plan.servos.items():
        out.append(
            f"| {control}: throw, lag, rate limit | {servo.throw_deg:g} deg, {servo.lag_rad_s:g} rad/s, "
            f"{servo.rate_limit_deg_s:g} deg/s | {_given(plan, control)} |"
        )
    if thrust is not None:
        out.append(f"| thrust | {thrust.static_N:.4g} N nominal | {markdown_cell(thrust.words)} |")
        out.append(f"| thrust line | | {_line(plan)} |")
    else:
        out.append("| thrust | none | given: no motor |")
    out.append(
        f"| CD0, k, CL at least drag | {polar.CD0:.4g}, {polar.k:.4g}, {polar.CL_least_drag:.3g} | computed: "
        "build-up, a parabola fitted "
        f"where lift is straight ({found.polar_rms:.2g} rms of CD); CD0 includes {plan.said.drag.CD0_added:g} "
        "given as CD0_added |"
    )
    out += [
        f"| limit of {key} | {low:g} to {high:g} | {markdown_cell(words)} |"
        for key, ((low, high), words) in limits.items()
    ]
    out += [
        "",
        "## Coefficients",
        "",
        f"Computed at the trimmed alpha of {found.alpha_rad / DEG_RAD:.2f} deg (CL = {found.CL:.3f}) by both "
        "methods of "
        "`testbench/aircraft/geometry/aerodynamics.py`,",
        "where formulas and sources stand. Per rad; rates as p b/2V, q cbar/2V, r b/2V, alphadot cbar/2V; "
        "moments about the centre of",
        f"gravity. Gradient of the downwash at the tail: {found.buildup.downwash:.3f} (build-up) and "
        f"{found.lattice.downwash:.3f} (lattice).",
        "",
        "The value used is the lattice's times a bias, the deviation relative, one standard deviation; both come of "
        "published derivatives of",
        "other aircraft (`coefficients.py`). "
        f"That of Cm_alpha holds {ROWS['Cm_alpha'].floor:g} CL_alpha, the doubt about the neutral point.",
        "",
        "| coefficient | build-up | lattice | used | deviation | whose value, and why |",
        "|---|---|---|---|---|---|",
    ]
    for c in made.coefficients.values():
        lattice = "" if c.lattice is None else f"{c.lattice:.4g}"
        build = "" if c.buildup is None else f"{c.buildup:.4g}"
        out.append(
            f"| {c.name} | {build} | {lattice} | {c.used:.4g} | {100.0 * c.deviation:.0f} % | {markdown_cell(c.why)} |"
        )
    out.append("")
    out.append("CD is the drag coefficient at the trimmed alpha; the model carries the polar.")
    absent = [n for n in ROWS if n not in made.coefficients]
    if absent:
        out.append(f"Zero by symmetry, or for want of a surface: {', '.join(absent)}.")
    if {"de", "da"} <= set(plan.servos) and _shared(plan, "de", "da"):
        out.append("Elevons: elevator and aileron have servos of their own in the model; each may use its whole throw.")
    if {"de", "dr"} <= set(plan.servos) and _shared(plan, "de", "dr"):
        out.append("V-tail: elevator and rudder have servos of their own in the model; each may use its whole throw.")
    if made.remarks:
        out += ["", "## Remarks", "", *(f"- {r[0].upper()}{r[1:]}." for r in made.remarks)]
    return "\n".join([*out, ""])


def _reference(plan: Plan) -> str:
    r = plan.said.reference
    given = [k.split("_")[0] for k, v in r.model_dump().items() if v is not None]
    rest = "computed: the wing as seen from above, its span and mean aerodynamic chord"
    if plan.file.name not in plan.sources or any(n.lower().endswith(".avl") for n in plan.sources):
        rest = "given: Sref, Bref, Cref"
    return f"{', '.join(given)} given; others {rest}" if given else rest


def _given(plan: Plan, control: str) -> str:
    servo = plan.servos[control]  # type: ignore[index]
    assumed = [k for k in ("lag_rad_s", "rate_limit_deg_s") if k not in servo.model_fields_set]
    if not assumed:
        return "given"
    return f"given; {' and '.join(assumed)} assumed, those of the Ultra Stick 25e (aircraft_models/taurus)"


def _line(plan: Plan) -> str:
    motor = plan.said.motor
    assert motor is not None
    where = "through the centre of gravity, assumed" if motor.at_m is None else "given"
    return f"{where}; {motor.down_deg:g} deg down, {motor.right_deg:g} deg to the right"


def _shared(plan: Plan, a: str, b: str) -> bool:
    """Say whether two controls move one and the same part of a surface."""
    return any({a, b} <= {f.moves for f in s.flaps} for s in plan.plane.surfaces)


# --- the drawing ------------------------------------------------------------------------------------------------------


def outline(plane: Plane) -> Outline:
    """Return the drawing of an aircraft whose places count from its centre of gravity.

    A surface of several panels is drawn as the trapezoid with its span, area and mean chord.
    """
    tails, fins = plane.of("tail"), plane.of("fin")
    notes = ["Drawn from the geometry that the coefficients were computed from."]
    several = [s.name for s in (plane.wing, *tails[:1], *fins[:1]) if len(s.stations) > 2]
    if several:
        notes.append(f"Drawn as the trapezoid of the same span, area and mean chord: {', '.join(several)}.")
    left_out = [s.name for s in plane.surfaces if s is not plane.wing and s not in (*tails[:1], *fins[:1])]
    if left_out:
        notes.append(f"Not drawn: {', '.join(left_out)}.")
    if plane.body:
        body = [(-h.x_m, 0.5 * h.width_m, h.z_m - 0.5 * h.height_m, h.z_m + 0.5 * h.height_m) for h in plane.body]
    else:
        notes.append("No fuselage was given; the line along the middle is none.")
        roots = [s.stations[0] for s in plane.surfaces]
        middle = [s for s in roots if abs(s.y_m) < 1e-6 * plane.b_m] or roots
        xs = [s.x_m + f * s.chord_m for s in middle for f in (0.0, 1.0)]
        thin = 2e-3 * plane.b_m
        body = [(-x, thin, -thin, thin) for x in (min(xs), max(xs))]
    return Outline(
        note=" ".join(notes),
        wing=_trapezoid(plane.wing),
        tail=_trapezoid(tails[0]) if tails else None,
        fin=_trapezoid(fins[0]) if fins else None,
        body_m=tuple((_r(x), _r(wide), _r(low), _r(high)) for x, wide, low, high in body),
    )


def _trapezoid(surface: LiftingSurface) -> Surface:
    if surface.role == "fin" and not surface.rises:  # a drawing's fin stands on its lower end
        surface = replace(surface, stations=surface.stations[::-1])
    fin = surface.role == "fin"
    root, tip = surface.stations[0], surface.stations[-1]
    across, up = abs(tip.y_m - root.y_m), tip.z_m - root.z_m
    side = abs(up) if fin else across
    span = side if fin else 2.0 * max(abs(s.y_m) for s in surface.stations)
    area = surface.area_m2 / (2.0 if fin and surface.mirrored else 1.0) if fin else surface.projected_m2
    chords = (root.chord_m, tip.chord_m)
    if len(surface.stations) > 2:
        chords = _chords(area / span, surface.mean_chord_m, root.chord_m < tip.chord_m)
    sweep = math.atan2(surface.swept_m, side)
    # The mean chord's quarter chord of the drawing lies where that of the surface does.
    x = surface.quarter_chord_m[0] - centroid(chords[1] / chords[0]) * side * math.tan(sweep)
    dihedral = 0.0 if fin else math.degrees(math.atan2(up, across))
    return Surface(
        span_m=_r(span),
        root_chord_m=_r(chords[0]),
        tip_chord_m=_r(chords[1]),
        x_m=_r(-x),
        z_m=_r(root.z_m),
        sweep_deg=_r(math.degrees(sweep)),
        dihedral_deg=_r(max(-_STEEPEST_DEG, min(_STEEPEST_DEG, dihedral))),
        y_m=_r(abs(root.y_m)) if fin else 0.0,
    )


def _chords(mean_m: float, aerodynamic_m: float, widens: bool) -> tuple[float, float]:
    """Return root and tip chord of the trapezoid with this mean and mean aerodynamic chord.

    Their ratio is (4/3) (1 + t + t^2) / (1 + t)^2 = 1 + u^2/3 with u = (1 - t) / (1 + t).
    """
    u = min(math.sqrt(max(3.0 * (aerodynamic_m / mean_m - 1.0), 0.0)), 0.95)
    return (mean_m * (1.0 - u), mean_m * (1.0 + u)) if widens else (mean_m * (1.0 + u), mean_m * (1.0 - u))


def _r(value: float) -> float:
    return round(float(value), 5) + 0.0
