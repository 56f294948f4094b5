"""What lies between the command of a control and its servo: links, lags, limits and dead bands, for every control.

A row of the table is written once and made for every control that it suits. Effects of the elevator have plain names,
those of others have the control before it: rate_limit, aileron_rate_limit. The throttle has no servo and no surface in
a model: what surfaces have there acts on its command.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from testbench.aircraft import Aircraft, Amendment, Insert, SetProperty
from testbench.aircraft.elastic import first_order_hold
from testbench.aircraft.paths import ControlPath
from testbench.aircraft.seams import control_path, moving, product, prop, remember, reroute, value, with_servo
from testbench.core.errors import ModelError
from testbench.core.keyed import Keyed
from testbench.effects.base import LINK, SERVO, Effect, Parameter, Values, on_path
from testbench.sensors import SensorSuite

CONTROLS = ("de", "da", "dr", "thr")
SURFACES = CONTROLS[:3]
WORDS = {"de": "elevator", "da": "aileron", "dr": "rudder", "thr": "throttle"}
PLACES = {**WORDS, "thr": "thrust"}  # control -> the place of effects between its command and its surface
COEFFICIENTS = {"de": ("Cm_de", "CL_de"), "da": ("Cl_da", "Cn_da"), "dr": ("Cn_dr", "CY_dr")}
"""Control -> the coefficients that its effectiveness consists of, the first of them the moment that it is there for."""
BAND = 0.05  # form error of play and dead bands
SHORTEST_S = 1e-6  # below any frame time: what is late by less is not late


def named(control: str, name: str) -> str:
    """Return the name of an effect for a control."""
    if control == "de":
        return "actuator_lag" if name == "lag" else name
    return f"{WORDS[control]}_{name}"


def labelled(control: str, label: str) -> str:
    """Return the label of an effect's properties for a control."""
    return label if control == "de" else f"{WORDS[control]}-{label}"


@dataclass(frozen=True)
class Kind:
    """A row of the table of effects between command and surface: one effect for each of its controls.

    Attributes:
        kind: what it is, whatever the control.
        name: of its effects, see :func:`named`.
        controls: that it suits.
        searched: those of them whose effects stand in the library. In the library the others would be two dozen further
            things that a record of these controls may be mistaken for, each of which costs a search, while most records
            hold no input that tells one servo effect from another of its kind.
        amend: control, aircraft, suite, values -> aircraft and suite; of a law ``partial(on_path, law)``.
        contains: kinds that are special cases; of the throttle the names of effects.
        title, physics, mistaken_for, separated_by: words in which {word}, {follower}, {moment} and {coefficients} are
            those of the control.
        parameters, upstream, ground_check, form_error: see :class:`Effect`.
    """

    kind: str
    name: str
    controls: Sequence[str]
    amend: Callable[[str, Aircraft, SensorSuite, Values], tuple[Aircraft, SensorSuite]]
    title: str
    physics: str
    parameters: tuple[Parameter, ...]
    mistaken_for: str
    separated_by: str
    searched: Sequence[str] = ("de",)
    contains: tuple[str, ...] = ()
    upstream: int = Effect.upstream
    ground_check: str = ""
    form_error: float = Effect.form_error

    def effect(self, control: str) -> Effect:
        """Return the effect for a control."""
        of = COEFFICIENTS.get(control, ("", ""))
        words = {
            "word": WORDS[control],
            "follower": "engine" if control == "thr" else "servo",
            "moment": of[0].partition("_")[0],
            "coefficients": " and ".join(of),
        }
        return Effect(
            name=named(control, self.name),
            title=self.title.format(**words),
            place=PLACES[control],
            physics=self.physics.format(**words),
            parameters=self.parameters,
            amend=partial(self.amend, control),
            mistaken_for=self.mistaken_for.format(**words),
            separated_by=self.separated_by.format(**words),
            lateral=control in ("da", "dr"),
            contains=self.contains if control == "thr" else tuple(named(control, c) for c in self.contains),
            upstream=self.upstream,
            ground_check=self.ground_check,
            form_error=self.form_error,
        )


def made(kinds: Sequence[Kind]) -> tuple[dict[tuple[str, str], Effect], tuple[Effect, ...], tuple[Effect, ...]]:
    """Return the effects of a table by (kind, control), those of the library, and those that are asked for by name."""
    effects = {(k.kind, control): k.effect(control) for k in kinds for control in k.controls}
    searched = {named(control, k.name) for k in kinds for control in k.searched}
    inside = tuple(e for e in effects.values() if e.name in searched)
    return effects, inside, tuple(e for e in effects.values() if e.name not in searched)


# --- servos as they are believed --------------------------------------------------------------------------------------


def corner_of(aircraft: Aircraft, control: str) -> float:
    """Return the corner frequency of a servo, rad/s, amendments included; infinite where there is none."""
    path = control_path(aircraft, control)
    return math.inf if path.lag is None else declared(aircraft, path.lag)


def declared(aircraft: Aircraft, name: str) -> float:
    """Return the value of a declared property of the model, amendments included."""
    known = _declared(Keyed(aircraft, aircraft.contents))
    if name not in known:
        raise ModelError(f"{aircraft.name} must declare {name}, it does not")
    return float(known[name])


@lru_cache(maxsize=64)
def _declared(model: Keyed[Aircraft]) -> dict[str, str]:
    """Return the properties that a model declares, and their values."""
    aircraft, known = model.it, dict[str, str]()
    for e in aircraft.model_tree(aircraft.rate_hz, 100.0, aircraft.design_V_m_s).iter("property"):
        if "value" in e.attrib:
            known.setdefault((e.text or "").strip(), e.attrib["value"])
    return known


# --- laws: what is late ----------------------------------------------------------------------------------------------


def lag(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give the servo of a surface another first-order lag; a surface without a servo gets one."""
    corner = values["lag_rad_s"]
    aircraft, changes = with_servo(aircraft, control, corner)
    text = f"{WORDS[control]} servo lag {corner:.3g} rad/s"
    return aircraft.amended(Amendment(named(control, "lag"), text, changes)), suite


def delay(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Let the command of a control wait.

    It is handed from one memory to the next every frame of ``aircraft.rate_hz``, and between two of them the value is
    interpolated, so that a fit sees a smooth function of the delay.
    """
    frames = values["delay_s"] * aircraft.rate_hz
    whole = math.floor(frames)
    share = frames - whole
    label, c = labelled(path.control, "delay"), prop(path.command)
    memories = [(f"{k}", moving(prop(f"gap/{label}-{k - 1}"), c)) for k in range(whole + 1, 0, -1)]
    memories.append(("0", c))
    late = [
        product(value(1.0 - share), prop(f"gap/{label}-{whole}")),
        product(value(share), prop(f"gap/{label}-{whole + 1}")),
    ]
    edit = reroute(path.command, label, f"<sum> {' '.join(late)} </sum>", memories)
    text = f"{path.word} command late by {values['delay_s']:.4g} s"
    return Amendment(named(path.control, "transport_delay"), text, (edit,), rate_hz=aircraft.rate_hz)


def second_order(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Replace the first-order servo by one of second order, d'' + 2 zeta w d' + w^2 d = w^2 c.

    What the believed servo of corner a is told is d + d' / a, with d the position of the second-order servo: that takes
    it to d itself. As the believed servo does, it takes a command that changes from frame to frame as a ramp.
    """
    # Of the step A x + B0 c + B1 c+ of position and rate under a ramp from c to c+.
    w, zeta = values["omega_rad_s"], values["zeta"]
    of, by = np.array([[0.0, 1.0], [-w * w, -2.0 * zeta * w]]), np.array([[0.0], [w * w]])
    A, B0, B1 = first_order_hold(of, by, 1.0 / aircraft.rate_hz)
    label = labelled(path.control, "servo")
    p, v, last = (prop(f"gap/{label}-{name}") for name in ("position", "rate", "last"))
    c, still = prop(path.command), value(0.0)
    rows = [
        f"<sum> {product(value(A[i, 0]), p)} {product(value(A[i, 1]), v)} "
        f"{product(value(B0[i, 0]), last)} {product(value(B1[i, 0]), c)} </sum>"
        for i in (0, 1)
    ]
    before = [
        ("next-rate", moving(rows[1], still)),
        ("position", moving(rows[0], c)),
        ("rate", moving(prop(f"gap/{label}-next-rate"), still)),
        ("last", c),
    ]
    body = f"<sum> {p} {product(value(1.0 / corner_of(aircraft, path.control)), v)} </sum>"
    text = f"{path.word} servo of second order, {values['omega_rad_s']:.3g} rad/s, damping {values['zeta']:.2g}"
    edit = reroute(path.command, label, body, before)
    return Amendment(named(path.control, "second_order_actuator"), text, (edit,), rate_hz=aircraft.rate_hz)


def delayed_servo(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the command wait, and replace the first-order servo by one of second order."""
    return on_path(second_order, control, *on_path(delay, control, aircraft, suite, values), values)


# --- laws: limited rates ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OneSidedLimit(Insert):
    """Give a servo another rate limit in the negative direction."""

    limit: float = 0.0  # rad/s
    path: ControlPath | None = None

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if the servo has no limit to change."""
        assert self.path is not None
        servo = tree.find(f"flight_control/channel/fcs_function[@name='{self.path.actuator}']")
        name = f"gap/{labelled(self.path.control, 'rate-limit-up')}"
        for bound in [] if servo is None else servo.iter("max"):
            for p in bound.findall("product/property"):
                if (p.text or "").strip() == self.path.rate_limit:
                    p.text = name
                    remember(tree, aircraft, {name: self.limit})
                    return
        raise ModelError(f"an asymmetric rate limit needs a servo of the {self.path.word} with a limit, there is none")


def _rates(values: Values) -> tuple[float, float]:
    """Return the limits down (or closing) and up (or opening), which are one if only one is given."""
    if len(both := [values[n] for n in ("limit_rad_s", "limit_1_s") if n in values]):
        return both[0], both[0]
    return (
        (values["down_rad_s"], values["up_rad_s"]) if "up_rad_s" in values else (values["fall_1_s"], values["rise_1_s"])
    )


def rate_limit(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Give the servo another rate limit, or one each way; a surface without a servo follows its command up to it."""
    down, up = _rates(values)
    edit = SetProperty(str(path.rate_limit), down)
    if "limit_rad_s" in values:
        text = f"{path.word} servo turns at {down:.3g} rad/s at most"
        return Amendment(named(path.control, "rate_limit"), text, (edit,))
    text = f"{path.word} servo turns at {down:.3g} rad/s down and {up:.3g} rad/s up at most"
    other = OneSidedLimit(".", "", None, up, path)
    return Amendment(named(path.control, "asymmetric_rate_limit"), text, (other, edit))


def throttle_rate(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Let what the engine is told move no faster than a limit, or one each way, 1/s."""
    fall, rise = _rates(values)
    label = "throttle-rate" if "limit_1_s" in values else "throttle-rates"
    c, last = prop(path.command), prop(f"gap/{label}")
    most, least = (product(value(x), prop("simulation/dt")) for x in (rise, -fall))
    step = f"<max> <min> <difference> {c} {last} </difference> {most} </min> {least} </max>"
    edit = reroute(path.command, label, moving(f"<sum> {last} {step} </sum>", c))
    if "limit_1_s" in values:
        text = f"throttle moves by {rise:.3g} of full throttle a second at most"
        return Amendment("throttle_rate_limit", text, (edit,))
    text = f"throttle opens by {rise:.3g} and closes by {fall:.3g} of full throttle a second at most"
    return Amendment("throttle_asymmetric_rate_limit", text, (edit,))


# --- laws: dead bands -------------------------------------------------------------------------------------------------


def dead_band(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Take a band off the error that moves the servo."""
    half, c = values["half_width_rad"], prop(path.command)
    error = f"<difference> {c} {prop(path.servo)} </difference>"
    within = f"<min> <max> {error} {value(-half)} </max> {value(half)} </min>"
    body = moving(f"<difference> {c} {within} </difference>", c)
    text = f"{path.word} servo with a dead band of {half:.3g} rad to either side"
    edit = reroute(path.command, labelled(path.control, "dead-band"), body)
    return Amendment(named(path.control, "dead_band"), text, (edit,))


def throttle_band(aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
    """Let what the engine is told follow what its error exceeds the band by, as a first-order lag; exact for a command
    held from frame to frame."""
    half, lag_s = values["half_width"], max(values["lag_s"], SHORTEST_S)
    c, last = prop(path.command), prop("gap/throttle-band")
    error = f"<difference> {c} {last} </difference>"
    excess = f"<difference> {error} <min> <max> {error} {value(-half)} </max> {value(half)} </min> </difference>"
    left = f"<exp> {product(value(-1.0 / lag_s), prop('simulation/dt'))} </exp>"
    step = product(f"<difference> <value>1</value> {left} </difference>", excess)
    edit = reroute(path.command, "throttle-band", moving(f"<sum> {last} {step} </sum>", c))
    text = f"throttle servo with a dead band of {half:.3g} of full throttle to either side, late by {lag_s:.3g} s"
    return Amendment("throttle_dead_band", text, (edit,))


# --- the table --------------------------------------------------------------------------------------------------------
# fmt: off

WIDEST_RAD = 0.06  # of a play: some 3 degrees, several times what airworthiness codes let a worn surface have (memory)
WIDEST = 0.4  # of full throttle
PLAY_CHECK = (
    "open the throttle in small steps and close it again: where play or a dead band is, motor speed or throttle arm "
    "stands elsewhere on the way back"
)
_RATE_CHECK = "slam the throttle open and shut on the ground and film the motor's speed or the throttle arm: ramps show"


def _lag_of(control: str, lost: str, mistaken_for: str, separated_by: str) -> Kind:
    return Kind(
        "lag",
        "lag",
        (control,),
        lag,
        title="lag of the {word} servo",
        physics="The {word} follows its command through a first-order lag that is slower than in the model. "
        + lost,
        parameters=(Parameter("lag_rad_s", "rad/s", 2.0, 200.0, (30.0, 8.0)),),
        mistaken_for=mistaken_for,
        separated_by=separated_by,
        searched=(control,),
        form_error=0.02,
    )


_KINDS = (
    _lag_of(
        "de",
        "Fast inputs arrive late and reduced, slow ones almost unchanged.",
        "a transport delay or a rate limit at low frequency",
        "a sweep beyond 6 Hz, which shows the loss of amplitude, at two amplitudes"),
    _lag_of(
        "da",
        "The roll rate builds up late, and fast reversals of the aileron move the aircraft less.",
        "errors of Cl_p and Cl_da together where the ailerons move slowly; a delay of their command",
        "aileron doublets shorter than the roll mode's time constant, at two amplitudes"),
    _lag_of(
        "dr",
        "The yaw rate builds up late, and fast reversals of the rudder move the aircraft less.",
        "an error of Cn_dr where the rudder moves slowly; a delay of its command",
        "rudder doublets much shorter than the Dutch roll's period, at two amplitudes"),
    Kind(
        "second order", "second_order_actuator", SURFACES, partial(on_path, second_order),
        title="{word} servo of second order",
        physics="The servo's motor and the surface have inertia, so the deflection follows the command as a mass on a "
        "spring. Beyond its frequency the amplitude falls twice as fast as behind a first-order lag; near it, it may "
        "overshoot.",
        parameters=(Parameter("omega_rad_s", "rad/s", 4.0, 300.0, (25.0,)), Parameter("zeta", "1", 0.1, 2.0, (0.7,))),
        mistaken_for="a delay with a first-order lag, or a lag in two stages, below its frequency",
        separated_by="a sweep through the servo's frequency; a measured deflection",
        contains=("lag",), upstream=SERVO),
    Kind(
        "rate limit", "rate_limit", SURFACES, partial(on_path, rate_limit),
        title="rate limit of the {word} servo",
        physics="The servo turns no faster than a limit below that of the model. Small or slow commands arrive "
                "unchanged, large fast ones are flattened into ramps and arrive late.",
        parameters=(Parameter("limit_rad_s", "rad/s", 0.02, 10.0, (1.5, 0.5, 0.15)),),
        mistaken_for="a slower servo or a delay if all inputs are of one size; it does not show without fast commands",
        separated_by="two amplitudes of the same input: a lag and a delay scale with it, a rate limit does not",
        searched=SURFACES),
    Kind(
        "rate limit", "rate_limit", ("thr",), partial(on_path, throttle_rate),
        title="rate limit of the throttle",
        physics="A throttle servo, a governor or the acceleration schedule of an engine lets the throttle move no "
        "faster than a limit. Small or slow commands arrive unchanged, large fast ones become ramps.",
        parameters=(Parameter("limit_1_s", "1/s", 0.01, 20.0, (0.5, 0.15, 0.05)),),
        mistaken_for="a lag or a delay of the thrust if all throttle steps are of one size",
        separated_by="throttle steps of two sizes: a lag and a delay scale with them, a rate limit does not",
        searched=(), upstream=SERVO, ground_check=_RATE_CHECK),
    Kind(
        "rate limit, different in each direction", "asymmetric_rate_limit", SURFACES, partial(on_path, rate_limit),
        title="rate limit of the {word} servo, different in each direction",
        physics="The air load helps the servo one way and holds it back the other, so that it turns slower against the "
        "load. Large fast inputs arrive as ramps of two slopes and leave a mean deflection behind.",
        parameters=(Parameter("down_rad_s", "rad/s", 0.02, 10.0, (1.5, 0.15)),
                    Parameter("up_rad_s", "rad/s", 0.02, 10.0, (1.5, 0.15))),
        mistaken_for="a symmetric rate limit, where only one of the two is ever met",
        separated_by="inputs of both signs at two amplitudes, the larger one beyond both limits",
        contains=("rate_limit",)),
    Kind(
        "rate limit, different in each direction", "asymmetric_rate_limit", ("thr",), partial(on_path, throttle_rate),
        title="rate limit of the throttle, different in each direction",
        physics="An engine is accelerated slowly to avoid stall or surge, and a propeller slows down by itself. Large "
                "throttle steps arrive as ramps of two slopes and leave a mean thrust behind.",
        parameters=(Parameter("rise_1_s", "1/s", 0.01, 20.0, (0.5, 0.05)),
                    Parameter("fall_1_s", "1/s", 0.01, 20.0, (0.5, 0.05))),
        mistaken_for="a symmetric rate limit, where only one of the two is ever met",
        separated_by="throttle steps of both signs and two sizes, the larger one beyond both limits",
        searched=(), contains=("throttle_rate_limit",), upstream=SERVO, ground_check=_RATE_CHECK,
    ),
    Kind(
        "delay", "transport_delay", CONTROLS, partial(on_path, delay),
        title="delay of the {word} command",
        physics="The {word} command waits in computers, buses or radio links before the {follower} sees it. Every "
        "frequency arrives with its full amplitude and a phase loss in proportion to frequency.",
        parameters=(Parameter("delay_s", "s", 0.0, 0.5, (0.03, 0.1), none=0.0),),
        mistaken_for="a slower servo at low frequency; a delay common to all sensors, as from a clock offset",
        separated_by="a sweep beyond the servo's corner, where a lag takes amplitude and a delay does not",
        searched=SURFACES, upstream=LINK, form_error=0.02),
    Kind(
        "delay and second order", "delayed_servo", SURFACES, delayed_servo,
        title="{word} servo of second order behind a delay",
        physics="The command waits in links and sampled loops, or passes further stages, before motor and surface "
                "follow it as a mass on a spring. The delay represents all loss of phase beyond that of two orders.",
        parameters=(Parameter("delay_s", "s", 0.0, 0.5, (0.02,)),
                    Parameter("omega_rad_s", "rad/s", 4.0, 300.0, (30.0,)),
                    Parameter("zeta", "1", 0.1, 2.0, (0.8,))),
        mistaken_for="a servo of third order or more; its parts alone, where commands are slow",
        separated_by="a sweep through the servo's frequency; a measured deflection",
        contains=("lag", "second_order_actuator", "transport_delay"), upstream=SERVO),
    Kind(
        "dead band", "dead_band", SURFACES, partial(on_path, dead_band),
        title="dead band of the {word} servo (hysteresis)",
        physics="Friction or a coarse control loop lets the servo rest until its error exceeds a band. The deflection "
        "stops short of every command and where it stops depends on where it came from.",
        parameters=(Parameter("half_width_rad", "rad", 0.0, 0.5 * WIDEST_RAD, (0.005, 0.015), none=0.0),),
        mistaken_for="free play of the linkage",
        separated_by="a measured deflection; small inputs from the rest, in both directions",
        upstream=SERVO, form_error=BAND),
    Kind(
        "dead band", "dead_band", ("thr",), partial(on_path, throttle_band),
        title="dead band of the throttle servo (hysteresis)",
        physics="Friction or a coarse control loop lets a throttle servo or governor rest until its error exceeds a "
        "band, and it takes up the rest late. Thrust stops short of every command, and where it stops depends on where "
        "it came from.",
        parameters=(Parameter("half_width", "1", 0.0, 0.5 * WIDEST, (0.02, 0.06), none=0.0),
                    Parameter("lag_s", "s", 0.0, 5.0, (0.3,), none=0.0)),
        mistaken_for="free play of the throttle with a lag of the thrust; free play alone, where the servo is quick",
        separated_by="small throttle steps from the rest, in both directions; the motion of the servo's arm on the "
        "ground",
        searched=(), contains=("thrust_lag", "throttle_free_play"), upstream=SERVO,
        ground_check=PLAY_CHECK, form_error=BAND),
)
SERVOS, EFFECTS, ON_REQUEST = made(_KINDS)
