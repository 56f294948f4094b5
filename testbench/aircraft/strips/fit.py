"""The strips of an aircraft: plan form from its outline, lift slopes from its own derivatives or Helmbold's formula.

Every rigid derivative that strips give is linear in one constant of theirs. Where the aircraft's own derivative is
known, that constant is chosen so that the strips give it:

    CL_alpha -> lift slope of the wing in symmetric motion      Cl_p  -> the same in asymmetric motion
    CL_0     -> zero-lift angle of the wing                     Cl_beta -> dihedral
    Cm_de    -> effectiveness of the elevator                   Cl_da -> of the ailerons
                                                                Cn_dr -> of the rudder

The two lift slopes differ, as strips do not know that lift falls off towards the tips.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from testbench.aircraft.model import Aircraft
from testbench.aircraft.outline import Outline, Surface
from testbench.aircraft.strips.ground_test import GroundTestFile, StripSettings
from testbench.aircraft.strips.loads import MOTIONS, StripModel, Tail, Wing
from testbench.core.constants import DEG_RAD
from testbench.core.errors import ModelError

_ELASTIC_AXIS = 0.35  # behind the leading edge, in chords: where main spars lie
_AILERON = (0.60, 0.95, 0.4)  # of the half span; d alpha / d da
_EFFECTIVENESS = 0.5  # of elevator and rudder
_MIRRORED = 2.0  # a fin that ends on a tailplane or boom acts as one of twice its aspect ratio
_NOWHERE = 1e-9  # area of a surface that is not there, m2


@dataclass(frozen=True)
class Constant:
    """One constant of the strips: what it is, its value, and where it comes from."""

    name: str
    value: float
    unit: str
    source: str


@dataclass(frozen=True)
class Compared:
    """A rigid derivative of the aircraft and the same by strips; ``own`` is None if it is not known."""

    name: str
    own: float | None
    strips: float


@dataclass(frozen=True, eq=False)
class FittedStrips:
    """The strips of an aircraft, and how they were found."""

    # symmetric, asymmetric: strips of either kind of motion
    symmetric: StripModel
    asymmetric: StripModel
    plan_forms: str  # where those of wing, tail and fin come from, in words
    constants: tuple[Constant, ...]  # every constant with its source
    compared: tuple[Compared, ...]  # rigid derivatives, the aircraft's own beside the strips'


def helmbold(aspect_ratio: float) -> float:
    """Return the lift slope of an unswept wing, per rad: 2 pi A / (2 + sqrt(A^2 + 4)).

    H. B. Helmbold, Jahrbuch der Deutschen Luftfahrtforschung, 1942; J. D. Anderson, Fundamentals of Aerodynamics,
    section 5.3, for a section slope of 2 pi.
    """
    return 2.0 * math.pi * aspect_ratio / (2.0 + math.sqrt(aspect_ratio**2 + 4.0))


def drawn_of(aircraft: Aircraft) -> Outline | None:
    """Return the drawing of an aircraft, if it is more than a sketch."""
    outline = aircraft.outline
    return outline if outline is not None and not outline.sketched else None


def fit_strips(aircraft: Aircraft, test: GroundTestFile, own: Mapping[str, float]) -> FittedStrips:
    """Return the strips of an aircraft.

    Args:
        aircraft: gives reference quantities and, if it has a drawing, plan forms.
        test: plan forms and constants that it gives come first.
        own: the aircraft's derivatives, "CL_alpha", "Cl_p" ..., and "CL" at its design condition; what is missing is
            estimated.

    Raises:
        ModelError: neither drawing nor file gives the wing, or a derivative asks for strips that cannot be.
    """
    fit = _Constants(aircraft.name, test.strips, own if test.strips.own_derivatives else {})
    wing, tail, fin = _surfaces(aircraft, test)
    first = _unfitted(fit, aircraft, test, wing, tail, fin)
    symmetric = fit.lift_slope(first, "alpha", "CL", "symmetric", wing.aspect_ratio)
    asymmetric = fit.lift_slope(first, "p", "Cl", "asymmetric", wing.aspect_ratio)
    zero, dihedral = _wing_angles(fit, symmetric, asymmetric, wing)
    elevator, turned, rudder = _effectiveness(fit, symmetric, asymmetric)
    symmetric, asymmetric = (
        replace(
            _with_tail(model, elevator=elevator, rudder=rudder),
            zero_lift_rad=zero * DEG_RAD,
            dihedral_rad=dihedral * DEG_RAD,
            aileron=(*model.aileron[:2], turned),
        )
        for model in (symmetric, asymmetric)
    )
    return FittedStrips(
        symmetric, asymmetric, _plan_forms(aircraft, test), tuple(fit.told), _compared(symmetric, asymmetric, own)
    )


@dataclass(frozen=True)
class _Constants:
    """Constants as chosen: those given, then those that give the aircraft's own derivatives, then estimates."""

    name: str  # of the aircraft
    settings: StripSettings  # what is given
    known: Mapping[str, float]  # the aircraft's own derivatives
    told: list[Constant] = field(default_factory=list)  # what was chosen, with its source

    def choose(self, name: str, unit: str, *options: tuple[float | None, str]) -> float:
        """Return the first option that has a value, and tell where it comes from."""
        value, source = next((v, s) for v, s in options if v is not None)
        self.told.append(Constant(name, value, unit, source))
        return value

    def matched(
        self, make: Callable[[float], StripModel], motion: str, coefficient: str, target: str
    ) -> tuple[float | None, str]:
        """Return the constant with which the strips give the aircraft's own derivative, as an option."""
        if target not in self.known:
            return None, ""
        own = self.known[target]
        return _matched(make, motion, coefficient, own), f"the aircraft's own {target} = {own:.4g}"

    def lift_slope(self, first: StripModel, motion: str, coefficient: str, word: str, ratio: float) -> StripModel:
        """Return the strips whose wing gives the aircraft's own derivative, or has Helmbold's slope."""
        name, given = f"{coefficient}_{motion}", self.settings.lift_slope_1_rad
        fitted = None
        if given is None and name in self.known:
            fitted = _matched(lambda v: _with_slope(first, v), motion, coefficient, self.known[name])
            if fitted is None or fitted <= 0.0:
                raise ModelError(
                    f"a lift slope of the wing must be found that gives {self.name} its own {name} = "
                    f"{self.known[name]:.4g}, but with this tail it would be {0.0 if fitted is None else fitted:.3g}; "
                    "correct [tail], or give strips.lift_slope_1_rad"
                )
        value = self.choose(
            f"lift slope of the wing, {word} motion",
            "1/rad",
            (given, "given"),
            (fitted, f"the aircraft's own {name} = {self.known.get(name, 0.0):.4g}"),
            (helmbold(ratio), f"Helmbold's formula, aspect ratio {ratio:.3g}"),
        )
        return _with_slope(first, value)


def _surfaces(aircraft: Aircraft, test: GroundTestFile) -> tuple[Surface, Surface | None, Surface | None]:
    """Return the plan forms of wing, tail and fin: those of the file, else those of the aircraft's drawing."""
    outline = drawn_of(aircraft)
    wing, tail, fin = (
        getattr(test, name) or (getattr(outline, name) if outline else None) for name in ("wing", "tail", "fin")
    )
    if wing is None:
        raise ModelError(
            f"the plan form of the wing must be known, but {aircraft.name} has no [drawing] in its aircraft.toml; "
            "give [wing], and [tail] and [fin], in the file of the modes"
        )
    return wing, tail, fin


def _unfitted(
    fit: _Constants, aircraft: Aircraft, test: GroundTestFile, wing: Surface, tail: Surface | None, fin: Surface | None
) -> StripModel:
    """Return the strips before any constant is fitted to a derivative: deflections act in full, angles are zero."""
    outline, settings, ratio = drawn_of(aircraft), fit.settings, wing.aspect_ratio
    axis = fit.choose(
        "elastic axis",
        "chords",
        (settings.elastic_axis, "given"),
        (outline.elastic_axis if outline else None, "the aircraft's drawing"),
        (_ELASTIC_AXIS, "assumed: where main spars lie"),
    )
    slope = settings.lift_slope_1_rad or helmbold(ratio)
    surfaces = _wing(wing, test, axis, slope), _tail(tail, fin, test, fit.choose, slope, ratio)
    CL = fit.choose(
        "lift coefficient", "", (settings.CL, "given"), (fit.known.get("CL"), "the aircraft's trim"), (0.5, "assumed")
    )
    given, half, g = settings.aileron, 0.5 * wing.span_m, aircraft.geometry
    place = (_AILERON[0] * half, _AILERON[1] * half) if given is None else (given.inner_m, given.outer_m)
    return StripModel(*surfaces, g.S_m2, g.cbar_m, 0.0, CL, 0.0, (*place, 1.0), g.b_m)


def _wing_angles(fit: _Constants, symmetric: StripModel, asymmetric: StripModel, wing: Surface) -> tuple[float, float]:
    """Return the angle of the wing from zero lift and its dihedral, deg."""
    zero = fit.choose(
        "angle of the wing from zero lift, at zero alpha",
        "deg",
        (fit.settings.zero_lift_deg, "given"),
        _in_degrees(fit.matched(lambda v: replace(symmetric, zero_lift_rad=v), "zero", "CL", "CL_0")),
        (0.0, "assumed"),
    )
    dihedral = fit.choose(
        "dihedral",
        "deg",
        (fit.settings.dihedral_deg, "given"),
        _in_degrees(fit.matched(lambda v: replace(asymmetric, dihedral_rad=v), "beta", "Cl", "Cl_beta")),
        (wing.dihedral_deg, "plan form"),
    )
    return zero, dihedral


def _effectiveness(fit: _Constants, symmetric: StripModel, asymmetric: StripModel) -> tuple[float, float, float]:
    """Return the effectiveness of elevator, ailerons and rudder."""
    settings, aileron = fit.settings, fit.settings.aileron
    inner, outer, _ = asymmetric.aileron
    elevator = fit.choose(
        "effectiveness of the elevator",
        "",
        (settings.elevator_effectiveness, "given"),
        fit.matched(lambda v: _with_tail(symmetric, elevator=v), "de", "Cm", "Cm_de"),
        (_EFFECTIVENESS, "assumed"),
    )
    turned = fit.choose(
        "effectiveness of the ailerons",
        "",
        (None if aileron is None else aileron.effectiveness, "given"),
        fit.matched(lambda v: replace(asymmetric, aileron=(inner, outer, v)), "da", "Cl", "Cl_da"),
        (_AILERON[2], "assumed"),
    )
    fit.told.append(Constant("ailerons from", inner, "m", "given" if aileron else "assumed: 60 % of the half span"))
    fit.told.append(Constant("ailerons to", outer, "m", "given" if aileron else "assumed: 95 % of the half span"))
    rudder = fit.choose(
        "effectiveness of the rudder",
        "",
        (settings.rudder_effectiveness, "given"),
        fit.matched(lambda v: _with_tail(asymmetric, rudder=v), "dr", "Cn", "Cn_dr"),
        (_EFFECTIVENESS, "assumed"),
    )
    return elevator, turned, rudder


def _plan_forms(aircraft: Aircraft, test: GroundTestFile) -> str:
    """Return where the plan forms come from, in words."""
    given = [n for n in ("wing", "tail", "fin") if getattr(test, n) is not None]
    drawn = [n for n in ("wing", "tail", "fin") if n not in given and drawn_of(aircraft) is not None]
    parts = [f"{', '.join(given)} from the file of the modes"] if given else []
    outline = drawn_of(aircraft)
    if drawn and outline is not None:
        parts.append(f"{', '.join(drawn)} from the aircraft's drawing: {outline.note}")
    return "; ".join(parts)


def _wing(surface: Surface, test: GroundTestFile, axis: float, slope: float) -> Wing:
    mass = test.mass
    points: tuple[tuple[float, float], ...] = ()
    if mass is not None and mass.wing_kg_per_m is not None:
        points = tuple(zip(mass.stations_m or (), mass.wing_kg_per_m, strict=True))
    wing = Wing(
        surface.span_m,
        surface.root_chord_m,
        surface.tip_chord_m / surface.root_chord_m,
        1.0 if mass is None or mass.wing_kg is None else mass.wing_kg,
        axis,
        axis if mass is None else mass.centre_of_mass,
        0.25 if mass is None else mass.gyration,
        slope,
        surface.x_m,
        surface.sweep_deg * DEG_RAD,
        points,
    )
    return replace(wing, mass_kg=wing.both_sides(wing.mass_per_length)) if points else wing


def _tail(
    surface: Surface | None,
    fin: Surface | None,
    test: GroundTestFile,
    choose: Callable[..., float],
    slope: float,
    wing_ratio: float,
) -> Tail:
    """Return the tail; a surface that nobody describes has no area."""
    settings, mass = test.strips, test.mass
    area, span, arm, a, downwash = _NOWHERE, 0.0, 1.0, 1.0, 0.0
    if surface is None:
        choose("area of the tail", "m2", (0.0, "assumed: nothing says that there is one"))
    else:
        area, span, arm = surface.area_m2, surface.span_m, -surface.mean_quarter_m(0.5 * surface.span_m)
        ratio = surface.aspect_ratio
        a = choose(
            "lift slope of the tail",
            "1/rad",
            (settings.tail_lift_slope_1_rad, "given"),
            (helmbold(ratio), f"Helmbold's formula, aspect ratio {ratio:.3g}"),
        )
        downwash = choose(
            "downwash at the tail",
            "",
            (settings.downwash, "given"),
            (2.0 * slope / (math.pi * wing_ratio), "far behind an elliptic wing, 2 a / (pi A)"),
        )
    fin_area, fin_slope, height, fin_arm = _NOWHERE, 1.0, 0.0, arm
    if fin is None:
        choose("area of the fin", "m2", (0.0, "assumed: nothing says that there is one"))
    else:
        fin_area, fin_arm = fin.area_m2, -fin.mean_quarter_m(fin.span_m)
        ratio = _MIRRORED * fin.aspect_ratio
        fin_slope = choose(
            "lift slope of the fin",
            "1/rad",
            (settings.fin_lift_slope_1_rad, "given"),
            (helmbold(ratio), f"Helmbold's formula, twice its aspect ratio, {ratio:.3g}"),
        )
        height = choose(
            "height of the fin",
            "m",
            (settings.fin_height_m, "given"),
            (fin.z_m + fin.span_m * fin.centroid, "centre of its area above the centre of gravity"),
        )
    return Tail(
        arm_m=arm,
        mass_kg=0.0 if mass is None else mass.tail_kg,
        area_m2=area,
        lift_slope=a,
        downwash=downwash,
        elevator=1.0,
        fin_area_m2=fin_area,
        fin_slope=fin_slope,
        fin_height_m=height,
        rudder=1.0,
        span_m=span,
        roll_inertia_kg_m2=0.0 if mass is None else mass.tail_roll_inertia_kg_m2,
        mass_height_m=0.0 if mass is None else mass.tail_mass_height_m,
        fin_arm_m=fin_arm,
    )


def _with_slope(model: StripModel, slope: float) -> StripModel:
    return replace(model, wing=replace(model.wing, lift_slope=slope))


def _with_tail(model: StripModel, **changes: float) -> StripModel:
    return replace(model, tail=replace(model.tail, **changes))


def _matched(make: Callable[[float], StripModel], motion: str, coefficient: str, target: float) -> float | None:
    """Return the constant with which strips give ``target``, which is linear in it; None if it has no part in it."""
    low, high = (make(v).effect(make(v).flow(motion))[coefficient] for v in (1.0, 2.0))
    return None if abs(high - low) < 1e-12 else 1.0 + (target - low) / (high - low)


def _in_degrees(option: tuple[float | None, str]) -> tuple[float | None, str]:
    value, source = option
    return None if value is None else value / DEG_RAD, source


def _compared(symmetric: StripModel, asymmetric: StripModel, own: Mapping[str, float]) -> tuple[Compared, ...]:
    out = []
    for model, is_symmetric in ((symmetric, True), (asymmetric, False)):
        for motion in MOTIONS[is_symmetric]:
            for coefficient, value in model.effect(model.flow(motion)).items():
                name = f"{coefficient}_{'0' if motion == 'zero' else motion}"
                if (name in own or abs(value) > 1e-9) and name not in _UNSEEN:
                    out.append(Compared(name, own.get(name), value))
    return tuple(out)


# A strip sees no tilt of its lift, so nothing of the yawing moment of a wing that rolls; nor a tail's zero lift.
_UNSEEN = {"Cn_p", "Cn_da", "CY_da", "Cm_0"}
