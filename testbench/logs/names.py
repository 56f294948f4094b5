"""What the names and units in the header of a table mean: channels, units and columns of times.

A header names a channel by its symbol (``q``, ``α``, ``δe``), a common word (``pitch rate``), a property of JSBSim
(``velocities/q-rad_sec``) or as JSBSim, X-Plane and FlightGear write it (``V_{Total}``, ``__Q,rad/s``), and gives the
unit in brackets, after a slash or as a suffix (``alpha [deg]``, ``alpha/deg``, ``alpha_deg``). Words may be joined by
capitals (``PitchRate``). Nothing else is guessed.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from testbench.core.channels import CHANNELS, SURFACES, UNITS, channel, unit_factor
from testbench.core.constants import PERCENT
from testbench.core.record import FloatArray

LARGEST = 1e100
"""No sample of any flight is larger in its unit; the squares of much larger numbers are infinite."""
MISSING = ("", "nan", "na", "n/a", "null", "none", "-")
"""Cells of a text file, in lower case, that say that a sample was not taken."""
THROWS = {"norm": 1.0, "%": PERCENT}
"""Units of a surface or its command that are parts of full throw, and their factors."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
"""Units of time that files may use, in s."""

_TIME_WORDS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "millis": "ms",
    "millisecond": "ms", "milliseconds": "ms", "usec": "us", "µs": "us", "μs": "us", "micros": "us",
    "microsecond": "us", "microseconds": "us", "nsec": "ns", "nanos": "ns", "nanosecond": "ns", "nanoseconds": "ns",
    "minute": "min", "minutes": "min", "mins": "min", "hr": "h", "hrs": "h", "hour": "h", "hours": "h", "day": "d",
    "days": "d",
}  # fmt: skip
_CLOCKS = {
    "t", "time", "times", "timestamp", "timestamps", "datetime", "date_time", "elapsed", "elapsed_time", "time_elapsed",
    "sim_time", "real_time", "utc", "utc_time", "time_utc", "gps_time", "zulu_time", "boot_time", "time_boot",
    "lcl_time", "local_time", "time_stamp", "zeit", "temps", "tiempo", "tempo", "simulation/sim_time",
    "sim/time/elapsed", "real,time", "totl,time",
}  # fmt: skip
_SINCE = re.compile(r"(?:(\w+?)_)?since_\w+|elapsed_(\w+)")  # seconds_since_launch
_FUSED = {"timeus": ("time", "us"), "timems": ("time", "ms"), "timens": ("time", "ns"), "times": ("time", "")}

_NAMES = {
    "airspeed": "V", "tas": "V", "true_airspeed": "V", "v_tas": "V", "vtas": "V", "vtrue": "V", "v_total": "V",
    "aoa": "alpha", "angle_of_attack": "alpha", "alfa": "alpha", "aos": "beta", "sideslip": "beta", "side_slip": "beta",
    "angle_of_sideslip": "beta", "sideslip_angle": "beta",
    "roll_rate": "p", "pitch_rate": "q", "yaw_rate": "r", "body_roll_rate": "p", "body_pitch_rate": "q",
    "body_yaw_rate": "r", "rollrate": "p", "pitchrate": "q", "yawrate": "r", "p_dot": "pdot", "q_dot": "qdot",
    "r_dot": "rdot",
    "roll_acceleration": "pdot", "pitch_acceleration": "qdot", "yaw_acceleration": "rdot",
    "roll": "phi", "bank": "phi", "bank_angle": "phi", "roll_angle": "phi", "pitch": "theta", "pitch_angle": "theta",
    "roll_attitude": "phi", "bank_attitude": "phi", "pitch_attitude": "theta",
    "yaw": "psi", "yaw_angle": "psi", "heading": "psi", "true_heading": "psi", "heading_true": "psi",
    "altitude": "h", "altitude_asl": "h", "altitude_msl": "h", "alt": "h", "alt_msl": "h", "alt_asl": "h",
    "pressure_altitude": "h", "altitude_amsl": "h", "alt_amsl": "h", "baro_altitude": "h", "baro_alt": "h",
    "barometric_altitude": "h",
    "hdg": "psi", "altmsl": "h", "gndspd": "Vg", "vspd": "hdot",
    "xaccel": "ax", "yaccel": "ay", "zaccel": "az", "vnorth": "v_north", "veast": "v_east",
    "groundspeed": "Vg", "ground_speed": "Vg", "gps_speed": "Vg", "gspeed": "Vg",
    "climb": "hdot", "climb_rate": "hdot", "vertical_speed": "hdot", "rate_of_climb": "hdot",
    "elevator": "de", "aileron": "da", "rudder": "dr", "throttle": "thr",
    "elevator_position": "de", "elevator_deflection": "de", "elevator_angle": "de", "delta_e": "de", "d_e": "de",
    "left_aileron_position": "da", "aileron_position": "da", "aileron_deflection": "da",
    "aileron_angle": "da", "delta_a": "da", "d_a": "da", "d_r": "dr",
    "rudder_position": "dr", "rudder_deflection": "dr", "rudder_angle": "dr", "delta_r": "dr",
    "dynamic_pressure": "qbar", "q_bar": "qbar",
    "aero_v_x_body": "u", "aero_v_y_body": "v", "aero_v_z_body": "w", "v_north": "v_north", "v_east": "v_east",
    "wind_v_north": "wind_north", "wind_v_east": "wind_east", "wind_v_down": "wind_down",
    "rollspeed": "p", "pitchspeed": "q", "yawspeed": "r", "roll_speed": "p", "pitch_speed": "q", "yaw_speed": "r",
    **{name: channels[i] for words, channels in (
           ("acc accel acceleration accelerometer", ("ax", "ay", "az")),
           ("gyro gyr gyroscope angular_rate omega", ("p", "q", "r")),
       ) for word in words.split() for i, axis in enumerate("xyz") for name in (f"{word}_{axis}", f"{axis}_{word}")},
    # as DLR's records and the book of R. V. Jategaonkar name them
    "tascg": "V", "alfcg": "alpha", "betcg": "beta", "the": "theta", "delv": "de", "dail": "da", "drud": "dr",
    "pdyn": "qbar", "axcg": "ax", "aycg": "ay", "azcg": "az",
}  # fmt: skip
INDICATED = "true airspeed is the airspeed logged, which is indicated: right at sea level, 5 % too low at 1000 m"
"""What is assumed of an airspeed that a pitot tube indicates."""
_INDICATED = ("ias", "kias", "indicated_airspeed", "airspeed_indicated", "cas", "kcas", "calibrated_airspeed")
_DOWN = ("vdown", "v_down", "velocity_down")
"""Names of velocities that count downwards."""
# Only with a unit of theirs: without one, commands are numbers of a transmitter or of JSBSim, from -1 to 1, and an
# abbreviation may be another word.
_COMMAND_WORDS = ("command", "cmd", "commanded", "demand", "setpoint", "sp")
_WHOLE = {"dynamic": "qbar"}
_SHORT = {"elev": "de", "elv": "de", "ail": "da", "rud": "dr", "rudd": "dr", "thr": "thr"}
_SURFACES = {"elevator": "de", "aileron": "da", "rudder": "dr", "throttle": "thr", **_SHORT}
_WITH_UNIT = {
    **{f"{surface}_{word}": f"{control}_cmd" for surface, control in _SURFACES.items() for word in _COMMAND_WORDS},
    **{
        surface + word: control
        for surface, control in _SHORT.items()
        for word in ("", "_pos", "_position", "_defl", "_deflection", "_angle")
    },
    **_WHOLE,
}
_ANY_CASE = {name.lower(): name for name in CHANNELS if name.lower() not in ("u", "v", "h")}  # V and v are two channels
# Properties of JSBSim and FlightGear, without their unit: those of the channel table, and those in other units.
_PROPERTIES = {
    **{
        re.sub(r"-(rad|rad_sec|rad_sec2|fps|ft|psf|rpm|norm)$", "", c.jsbsim_property): c.name
        for c in CHANNELS.values()
        if c.jsbsim_property and not c.per_mass and c.name != "thrust"
    },
    **{f"fcs/{word}-cmd": f"{name}_cmd" for word, name in (("elevator", "de"), ("aileron", "da"), ("rudder", "dr"))},
    "velocities/vtrue": "V", "orientation/alpha": "alpha", "orientation/side-slip": "beta", "orientation/roll": "phi",
    "orientation/pitch": "theta", "orientation/heading": "psi", "orientation/roll-rate": "p",
    "orientation/pitch-rate": "q", "orientation/yaw-rate": "r", "position/altitude": "h",
    "velocities/vertical-speed": "hdot",
}  # fmt: skip

_WORDS = {
    "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "rads": "rad",
    "dps": "deg/s", "degps": "deg/s", "deg_s": "deg/s", "rad_s": "rad/s", "radps": "rad/s",
    "deg_s2": "deg/s2", "rad_s2": "rad/s2",
    "metre": "m", "metres": "m", "meter": "m", "meters": "m", "feet": "ft", "foot": "ft", "mps": "m/s", "m_s": "m/s",
    "fpm": "ft/min", "ftmsl": "ft", "ft msl": "ft", "ft baro": "ft",
    "fps": "ft/s", "ft_s": "ft/s", "feet/s": "ft/s", "kts": "kt", "knot": "kt", "knots": "kt", "ktas": "kt",
    "kn": "kt", "kph": "km/h", "kmh": "km/h", "km_h": "km/h", "kmph": "km/h", "m_s2": "m/s2", "mps2": "m/s2",
    "ft_s2": "ft/s2", "fps2": "ft/s2", "g's": "g",
    "gs": "g", "newton": "N", "lb": "lbf", "lbs": "lbf", "pascal": "Pa", "mbar": "hPa", "lb/ft2": "psf",
    "lbf/ft2": "psf", "lbs/ft2": "psf", "percent": "%", "pct": "%", "norm": "1", "none": "1",
}  # fmt: skip
# Without their stroke they mean what fits the channel: degs is deg/s of a rate and deg of an angle.
_FUSED_UNITS = {
    "degs": ("deg/s", "deg"), "rads": ("rad/s", "rad"), "degs2": ("deg/s2",), "rads2": ("rad/s2",),
    "dps2": ("deg/s2",), "ms": ("m/s",), "fts": ("ft/s",), "mss": ("m/s2",), "ms2": ("m/s2",), "fts2": ("ft/s2",),
}  # fmt: skip
_KNOWN = {unit.lower(): unit for units in UNITS.values() for unit in units}
_GREEK = str.maketrans(
    {"α": "alpha", "β": "beta", "φ": "phi", "ϕ": "phi", "θ": "theta", "ϑ": "theta", "ψ": "psi", "δ": "d"}
)
_CAPITALS = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")  # where words are joined: PitchRate
_BRACKETS = re.compile(r"(.*?)\s*(?:\[([^\]]*)\]|\(([^)]*)\))\s*", re.DOTALL)


class Meaning(NamedTuple):
    """The channel that a column is called by, its unit as the channel table writes it, or one of :data:`THROWS`.

    The unit is "" if none is stated. A value in it is scale * column + offset; the scale is -1 where the writer counts
    the other way. ``assumed`` says what the file does not.
    """

    channel: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    assumed: str = ""

    @property
    def factor(self) -> float:
        """What turns a value in the unit into SI units, or into a part of full throw."""
        return THROWS[self.unit] if self.of_throw else unit_factor(self.channel, self.unit)

    def convert(self, column: FloatArray) -> FloatArray:
        """Return a column in SI units, or in parts of full throw."""
        return self.factor * (self.scale * column + self.offset)

    @property
    def said(self) -> str:
        """The conversion in words."""
        value = {1.0: "", -1.0: "minus "}.get(self.scale, f"{self.scale:g} times ")
        more = f"{self.offset:+g} " if self.offset else ""
        return f"{value}{more}{self.unit}{' times full throw' if self.of_throw else ''}"

    @property
    def of_throw(self) -> bool:
        """Whether the unit is a part of full throw."""
        return self.unit in THROWS and channel(self.channel).unit == "rad"


def split_unit(name: str) -> tuple[str, str]:
    """Return name and unit of a heading such as ``q [rad/s]`` or ``q (deg/s)``; the unit is "" where none is there.

    Digits in brackets are no unit: ``Q(1)`` and ``q[0]`` are the first of several; but a throttle may be in [1].
    """
    match = _BRACKETS.fullmatch(name)
    if match is None or not match[1]:
        return name, ""
    inside = (match[2] or match[3] or "").strip()
    if inside.isdigit() and not (inside == "1" and match[2] and match[1] in CHANNELS and channel(match[1]).unit == "1"):
        return name, ""
    return match[1], match[2] if match[2] is not None else match[3]


def plain_unit(stated: str) -> str:
    """Return a unit in the spelling of the channel table ("deg/s" for "°/sec"); "" if it is none of the table's."""
    plain = stated.strip().strip("[]()").strip().lower().replace("²", "2").replace("°", "deg").replace("º", "deg")
    plain = re.sub(r"\^|\*\*", "", plain)
    plain = re.sub(r"\s*[·*\s]\s*s(?:ec)?-([12])$", lambda m: "/s" + m[1].replace("1", ""), plain)  # rad s-1
    plain = re.sub(r"\s+per\s+|\s*/\s*", "/", plain)
    plain = re.sub(r"(?<=[/_])(?:seconds?|sec)(?=\W|\d|_|$)", "s", plain)
    plain = re.sub(r"[/_]s[/_]s$|/\(s2\)$", "/s2", plain)
    head, slash, tail = plain.partition("/")
    head = _WORDS.get(head, head)
    plain = (head if head != "lbf" or not tail else "lb") + slash + tail
    return _KNOWN.get(plain, _WORDS.get(plain, ""))


def time_unit(stated: str) -> str:
    """Return a unit of time as :data:`TIME_UNITS` names it ("ns" for "nanoseconds since 2024-05-01"); "" if none."""
    plain = stated.strip().strip("[]()").strip().lower().split(" since ")[0].strip()
    plain = _TIME_WORDS.get(plain, plain)
    return plain if plain in TIME_UNITS else ""


def clock_called(name: str, stated: str = "") -> tuple[bool, str]:
    """Say whether a column is called a time, and in which unit its name says that it is ("" if it does not).

    A ``clock`` is one only in a unit of time, which the file may have ``stated``. ``TimeUS``, ``time_us``,
    ``t_ms``, ``timestamp (ms)``, ``sim-time-sec`` and the like are times; ``t_alpha`` is not.
    """
    label, inside = label_of(name), time_unit(split_unit(name)[1])
    if label == "clock":
        return bool(inside or time_unit(stated)), inside
    if (since := _SINCE.fullmatch(label)) is not None:
        unit = time_unit(since[1] or since[2] or "")
        return bool(unit) or since[1] in _CLOCKS, unit or inside
    for short in (label, label.rsplit(".", 1)[-1]):
        if short in _FUSED:
            return True, inside or _FUSED[short][1]
        if short in _CLOCKS:
            return True, inside
        base, unit = [*re.split(r"[_/,](?=[^_/,]*$)", short, maxsplit=1), ""][:2]
        if base in _CLOCKS and time_unit(unit):
            return True, time_unit(unit)
    return False, ""


def meaning(name: str, stated: str = "") -> Meaning | None:
    """Return the channel that a column is called by, and its unit; None if the name is that of no channel.

    Args:
        name: heading of the column, or a path in a structure, of which the last name counts.
        stated: unit that the file states for it; else that of the name.
    """
    name, inside = split_unit(name.strip())
    stated = stated.strip().strip("-")  # a dash says that there is nothing to say
    if name in CHANNELS:
        return Meaning(name, stated_unit(name, stated or inside))
    for short in dict.fromkeys((name, name.rsplit(".", 1)[-1])):
        if (found := _named(short)) is not None:
            unit = stated_unit(found.channel, stated or inside)
            return found._replace(unit=unit) if stated or inside else found
    return _with_unit(name.rsplit(".", 1)[-1], stated or inside)


def _with_unit(name: str, stated: str) -> Meaning | None:
    for label in dict.fromkeys((label_of(name), label_of(_CAPITALS.sub("_", name)))):
        ends = [len(label)] if stated else [m.start() for m in re.finditer(r"[/_,]", label)]
        for end in ends:
            found = _WITH_UNIT.get(label[:end], "")
            unit = _fitting(found, stated or label[end + 1 :].strip("_(")) if found else ""
            if unit:
                return Meaning(found, unit)
    return None


def _named(name: str) -> Meaning | None:
    if name in CHANNELS:
        return Meaning(name, "")
    path = re.sub(r"\[0\]", "", name.strip().lower()).removeprefix("/fdm/jsbsim").lstrip("/")
    label = label_of(name)
    if label in _INDICATED:
        return Meaning("V", "kt" if label.startswith("k") else "", assumed=INDICATED)
    if label in _DOWN:
        return Meaning("hdot", "", -1.0)
    base, _, suffix = path.rpartition("-")
    for key in (base, path) if "/" in path else ():
        if key in _PROPERTIES:
            return Meaning(_PROPERTIES[key], _fitting(_PROPERTIES[key], suffix if key == base else ""))
    label = label.removeprefix("imu_").removesuffix("_measured")
    known = _NAMES.get(label) or _ANY_CASE.get(label) or _NAMES.get(label_of(_CAPITALS.sub("_", name)))
    if known:
        return Meaning(known, "")
    for cut in (m.start() for m in re.finditer(r"[/_,]", label)):  # alpha_deg, alpha/deg, q_rad_s, q,rad/s
        base, suffix = label[:cut], label[cut + 1 :].strip("_(")
        first = name.strip()[:cut]
        found = first if first in CHANNELS else _NAMES.get(base) or _ANY_CASE.get(base)
        if found and (unit := _fitting(found, suffix)):
            return Meaning(found, unit)
    return None


def label_of(name: str) -> str:
    """Return a name in lower case, its words joined by _: ``V_{Total}`` is v_total, ``__Q,rad/s`` is q,rad/s."""
    plain = re.sub(r"[{}<>]", "", split_unit(name)[0].strip().strip("\"'").lower()).translate(_GREEK)
    plain = re.sub(r"[\s\-]+", "_", plain).removeprefix("/fdm/jsbsim").strip("_/")
    return re.sub(r"_*([/,])_*", r"\1", plain).strip(",")


def _fitting(name: str, suffix: str) -> str:
    """Return the unit of a suffix if channel ``name`` can be given in it; "" if not."""
    return stated_unit(name, suffix) if suffix and suffix not in ("none",) else ""


def stated_unit(name: str, stated: str) -> str:
    """Return the unit of channel ``name`` that a file states, as the channel table writes it; "" if it is none."""
    si = channel(name).unit
    units = UNITS.get(si, {si: 1.0})
    if name.removesuffix("_cmd") in SURFACES and plain_unit(stated) in ("1", "%") and stated != "none":
        return plain_unit(stated).replace("1", "norm")
    if stated.strip() in units:
        return stated.strip()  # "g" and "G", "Pa" and "pa": as written first
    fused = _FUSED_UNITS.get(stated.strip().lower(), ())
    return next((unit for unit in (plain_unit(stated), *fused) if unit in units), "")
