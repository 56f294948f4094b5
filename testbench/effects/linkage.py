"""What lies between a servo and its surface, and how much of a command that is: play, gearing, rigging."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from testbench.aircraft import Aircraft, Amendment, Insert
from testbench.aircraft.adapter import PREFIX
from testbench.aircraft.paths import ControlPath
from testbench.aircraft.seams import Reroute, component, moving, product, prop, remember, reroute, value
from testbench.core.errors import ModelError
from testbench.effects.aerodynamics import CURVED
from testbench.effects.base import GEARING, LINKAGE, Parameter, Values, on_path
from testbench.effects.servo import (
    BAND,
    CONTROLS,
    PLAY_CHECK,
    SURFACES,
    WIDEST,
    WIDEST_RAD,
    Kind,
    labelled,
    made,
    named,
)

_READING = ("property", "input", "independentVar")

# --- edits of a model -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BehindServo(Insert):
    """Let the aerodynamics, and elastic modes, read a component's output instead of the servo's position.

    The component ends in the surface of the path, which is declared with value 0.
    """

    path: ControlPath | None = None

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if no channel moves the surface."""
        assert self.path is not None
        position, surface = self.path.servo, self.path.surface
        control = tree.find("flight_control")
        for channel in [] if control is None else control.findall("channel"):
            if control is not None and any((e.text or "").strip() == position for e in channel.iter("output")):
                parts = [*tree.findall("aerodynamics"), *tree.findall("external_reactions")]
                driven = [c for c in channel if c.get("name", "").startswith(f"{PREFIX}drive-")]
                for p in (e for part in (*parts, *driven) for e in part.iter() if e.tag in _READING):
                    if (p.text or "").strip() == position:
                        p.text = surface
                place = list(channel).index(driven[0]) if driven else len(channel)
                channel.insert(place, ET.fromstring(self.xml))
                remember(tree, aircraft, {surface: 0.0})
                return
        raise ModelError(f"a component behind the servo needs a channel that ends in {position}, the model has none")


def about_trim(path: ControlPath, label: str, law: Callable[[str], str]) -> Reroute:
    """Return the edit that hands on the trim of a command and the ``law`` of its deviation from it, XML of XML.

    The trim is kept from where time stands still.
    """
    kept, c = prop(f"gap/{label}-trim"), prop(path.command)
    body = f"<sum> {kept} {law(f'<difference> {c} {kept} </difference>')} </sum>"
    return reroute(path.command, label, body, (("trim", moving(kept, c)),))


# --- laws: gearing ----------------------------------------------------------------------------------------------------


def scaled(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Multiply what the servo is told, as a deviation from what it was told in trim.

    The surface stands at trim where the aircraft needs it, whatever the command for it was; scaled from its zero, the
    command of a weak surface would run into the throw of the one that is believed.
    """
    scale = values["scale"]
    edit = about_trim(path, labelled(path.control, "surface-scale"), lambda x: product(value(scale), x))
    text = f"{path.word} turns {scale:.4g} times the command, counted from trim"
    return Amendment(named(path.control, "surface_scale"), text, (edit,))


def offset(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Add a constant to what the servo is told."""
    off = values["offset_rad"]
    edit = reroute(
        path.command, labelled(path.control, "surface-offset"), f"<sum> {prop(path.command)} {value(off)} </sum>"
    )
    return Amendment(named(path.control, "surface_offset"), f"{path.word} rigged {off:+.4g} rad off", (edit,))


def one_sided(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Multiply the positive part of what the servo is told, as a deviation from what it was told in trim."""
    scale = values["scale"]

    def weaker(x: str) -> str:
        return f"<sum> {x} {product(value(scale - 1.0), f'<max> {x} {value(0.0)} </max>')} </sum>"

    edit = about_trim(path, labelled(path.control, "one-sided"), weaker)
    text = f"{path.word} turns {scale:.4g} times the command where that is positive, counted from trim"
    return Amendment(named(path.control, "one_sided_linkage"), text, (edit,))


_LEAST = 0.1  # of what is under the root of a curved linkage: a ratio that grows is followed no farther


def curved(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Turn the surface by scale x / sqrt(1 + 2 loss x^2), x what the servo, or the engine, is told as a deviation from
    trim."""
    scale, loss = values["scale"], values["loss"] if "loss" in values else values["loss_per_rad2"]

    def bent(x: str) -> str:
        under = f"<max> <sum> {value(1.0)} {product(value(2.0 * loss), x, x)} </sum> {value(_LEAST)} </max>"
        return f"<quotient> {product(value(scale), x)} <pow> {under} {value(0.5)} </pow> </quotient>"

    edit = about_trim(path, labelled(path.control, "curved"), bent)
    of = "" if path.control == "thr" else " rad^-2"
    text = f"{path.word} turns {scale:.4g} times the command near trim, and loses {loss:.3g}{of} of its square"
    return Amendment(named(path.control, "curved_linkage"), text, (edit,))


# --- laws: play -------------------------------------------------------------------------------------------------------

_LEAST_HALF_RAD = 1e-9  # a play of this width is none


def play(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Put a play of the given width between servo and surface; in the middle of it at trim.

    With "creep_1_s", the surface creeps to the middle of the play, which is where the servo stands. With b the distance
    from the middle over half the play, b' = -creep b^power (Norton's law).
    """
    width_rad, last = values["width_rad"], prop(path.surface)
    text = f"{path.word} linkage with a play of {width_rad:.3g} rad"
    if "creep_1_s" not in values:
        return Amendment(named(path.control, "free_play"), text, (_within(path, last, width_rad),))
    creep_1_s, power, half = values["creep_1_s"], values["power"], max(0.5 * width_rad, _LEAST_HALF_RAD)
    off = f"<difference> {prop(path.servo)} {last} </difference>"
    near = f"<min> <value>1</value> {product(f'<abs> {off} </abs>', value(1.0 / half))} </min>"
    slowed = f"<pow> {near} {value(power - 1.0)} </pow>"
    left = f"<exp> {product(value(-creep_1_s / aircraft.rate_hz), slowed)} </exp>"
    crept = f"<sum> {last} {product(f'<difference> <value>1</value> {left} </difference>', off)} </sum>"
    text += f", crept through at {creep_1_s:.3g} 1/s, power {power:.3g}"
    edit = _within(path, crept, width_rad)
    return Amendment(named(path.control, "creeping_free_play"), text, (edit,), rate_hz=aircraft.rate_hz)


def _within(path: ControlPath, drawn: str, width_rad: float) -> BehindServo:
    """Return the edit that lets the surface stand where ``drawn`` (XML) says, within a play about the servo."""
    return BehindServo(".", component(path.surface, _beside(drawn, prop(path.servo), width_rad)), None, path)


def _beside(drawn: str, middle: str, width: float) -> str:
    """Return the XML of where a play of that width about ``middle`` leaves what stands where ``drawn`` says."""
    low, high = (f"<sum> {middle} {value(s * 0.5 * width)} </sum>" for s in (-1.0, 1.0))
    return moving(f"<min> <max> {drawn} {low} </max> {high} </min>", middle)


def throttle_play(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Put a play of the given width between what is commanded and what the engine is told; in its middle at trim."""
    width = values["width"]
    edit = reroute(path.command, "throttle-play", _beside(prop("gap/throttle-play"), prop(path.command), width))
    text = f"throttle linkage with a play of {width:.3g} of full throttle"
    return Amendment("throttle_free_play", text, (edit,))


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

_GAIN = Parameter("scale", "1", 0.0, 3.0, (0.8, 1.25), none=1.0)
_KINDS = (
    Kind(
        "free play", "free_play", SURFACES, partial(on_path, play),
        title="free play of the {word}",
        physics="Worn hinges or rods let the servo move by a certain angle before the surface follows. Every reversal "
        "loses the play: small inputs vanish in it, large ones arrive late and reduced by half of it.",
        parameters=(Parameter("width_rad", "rad", 0.0, WIDEST_RAD, (0.01, 0.03), none=0.0),),
        mistaken_for="a dead band of the servo; a lower {word} effectiveness if all inputs are of one size",
        separated_by="two amplitudes of the same input; a measured deflection, which only the dead band moves",
        upstream=LINKAGE, form_error=BAND),
    Kind(
        "free play", "free_play", ("thr",), partial(on_path, throttle_play),
        title="free play of the throttle",
        physics="Worn rods, a slack cable or a servo that ignores small errors let the command move by a certain share "
        "before the engine follows. Every reversal loses the play: small throttle inputs vanish in it, large ones come "
        "short by half of it.",
        parameters=(Parameter("width", "1", 0.0, WIDEST, (0.04, 0.12), none=0.0),),
        mistaken_for="a lower thrust per throttle if all inputs are of one size; the dead band of a quick throttle "
        "servo, which does the same",
        separated_by="throttle steps of two sizes; for the servo, the motion of its arm on the ground",
        searched=(), upstream=LINKAGE, ground_check=PLAY_CHECK, form_error=BAND),
    Kind(
        "creeping free play", "creeping_free_play", SURFACES, partial(on_path, play),
        title="free play of the {word} with a surface that creeps",
        physics="The servo takes up the play of worn hinges or rods. Air load or elastic rods then draw the surface "
        "through it, more slowly the less of it is left (Norton's power law of creep). Quick inputs lose the play, "
        "slow ones less.",
        parameters=(Parameter("width_rad", "rad", 0.0, WIDEST_RAD, (0.01, 0.03), none=0.0),
                    Parameter("creep_1_s", "1/s", 0.0, 50.0, (0.5, 3.0)),
                    Parameter("power", "1", 1.0, 8.0, (1.5,))),
        mistaken_for="play without creep, where no input is held for long",
        separated_by="a step held for seconds, of the size of the play",
        contains=("free_play",), upstream=LINKAGE, form_error=BAND),
    Kind(
        "gain", "surface_scale", SURFACES, partial(on_path, scaled),
        title="scale of the {word}'s deflection or effectiveness",
        physics="The linkage turns the {word} by a multiple of the command, or it is more or less effective than in "
                "the model. Force and moment due to the command change by the same factor at every frequency.",
        parameters=(Parameter("scale", "1", 0.2, 3.0, (0.8, 1.3), none=1.0),),
        mistaken_for="an error of {coefficients} together, exactly, so that only what exceeds their prior can be named",
        separated_by="a measured deflection: a linkage error shows in it, a wrong effectiveness does not",
        searched=SURFACES,
        upstream=GEARING, form_error=0.01),
    Kind(
        "offset", "surface_offset", SURFACES, partial(on_path, offset),
        title="offset of the {word}'s zero",
        physics="The {word} stands at an angle when its command is zero. Trim needs another command, and the motion "
        "about trim stays what it was.",
        parameters=(Parameter("offset_rad", "rad", -0.2, 0.2, (0.02, -0.02), none=0.0),),
        mistaken_for="an error of {moment}0, exactly; it does not show where commands are deviations from trim",
        separated_by="the absolute command at trim at several speeds, beside a weighed centre of gravity",
        upstream=GEARING, form_error=0.01),
    Kind(
        "one-sided linkage", "one_sided_linkage", CONTROLS, partial(on_path, one_sided),
        title="{word} linkage that is less effective in one direction",
        physics="A cable that slackens, a horn off its angle or a lost aileron on one side turns the {word} by a "
                "different angle in each direction. Positive commands give a multiple of what negative ones give.",
        parameters=(Parameter("scale", "1", 0.0, 3.0, (0.8, 1.2), none=1.0),),
        mistaken_for="a scale of the deflection where all inputs are of one sign; a curved moment",
        separated_by="inputs of both signs; turning the control to both stops on the ground",
        searched=(), upstream=GEARING, form_error=CURVED),
    Kind(
        "curved linkage", "curved_linkage", SURFACES, partial(on_path, curved),
        title="{word} linkage, or effectiveness, that changes with the deflection",
        physics="A rod on a horn pulls less the farther the horn has turned, and air that separates at the hinge "
                "makes large deflections of the {word} less effective. A deflection x from trim has the effect of "
                "scale x / sqrt(1 + 2 loss x^2).",
        parameters=(_GAIN, Parameter("loss_per_rad2", "1/rad^2", -4.0, 40.0, (3.0,), none=0.0)),
        mistaken_for="a scale of the deflection where all inputs are of one size; a rate limit where they differ",
        separated_by="inputs of two sizes; measuring the deflection for several commands on the ground",
        searched=(), contains=("surface_scale",), upstream=GEARING, form_error=CURVED),
    Kind(
        "curved linkage", "curved_linkage", ("thr",), partial(on_path, curved),
        title="{word} linkage, or effectiveness, that changes with the deflection",
        physics="Thrust over throttle is no straight line: a carburettor or a speed controller gives most of it over "
                "a part of the range. A deviation x from the trimmed throttle has the effect of scale x / sqrt(1 + 2 "
                "loss x^2).",
        parameters=(_GAIN, Parameter("loss", "1", -4.0, 40.0, (1.0,), none=0.0)),
        mistaken_for="a scale of the deflection where all inputs are of one size; a rate limit where they differ",
        separated_by="inputs of two sizes; measuring the deflection for several commands on the ground",
        searched=(), contains=("thrust_scale", "throttle_scale"), upstream=GEARING,
        form_error=CURVED),
)
SERVOS, EFFECTS, ON_REQUEST = made(_KINDS)
