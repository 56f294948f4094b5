"""The signal table: every channel that a record may hold, with its symbol, unit, sign and JSBSim property.

Sign convention, said once: body axes x forward, y right, z down. Rates p, q, r are positive right wing down, nose up,
nose right. Elevator ``de`` is positive trailing edge down, which pitches the nose **down**; aileron ``da`` is positive
when it rolls the aircraft left wing up, right wing down (p > 0); rudder ``dr`` is positive trailing edge left, which
yaws the nose left (r < 0). ax, ay, az are specific forces, as an accelerometer at the centre of gravity reads them
(az = -9.81 m/s2 in level flight).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, KT_M_S, LBF_N, PERCENT, PSF_PA, RPM_RAD_S
from testbench.core.errors import ChannelError, nearest


@dataclass(frozen=True)
class Channel:
    """One signal: SI unit inside, and how to get it from JSBSim (``value = factor * property``)."""

    name: str
    symbol: str
    unit: str
    description: str
    jsbsim_property: str | None = None
    factor: float = 1.0
    per_mass: bool = False  # the property is a force; divided by the mass it is this channel


_TABLE = (
    Channel("V", "V", "m/s", "true airspeed", "velocities/vt-fps", FT_M),
    Channel("alpha", "α", "rad", "angle of attack", "aero/alpha-rad"),
    Channel("beta", "β", "rad", "angle of sideslip", "aero/beta-rad"),
    Channel("u", "u", "m/s", "airspeed along body x", "velocities/u-aero-fps", FT_M),
    Channel("v", "v", "m/s", "airspeed along body y", "velocities/v-aero-fps", FT_M),
    Channel("w", "w", "m/s", "airspeed along body z", "velocities/w-aero-fps", FT_M),
    Channel("p", "p", "rad/s", "roll rate", "velocities/p-rad_sec"),
    Channel("q", "q", "rad/s", "pitch rate", "velocities/q-rad_sec"),
    Channel("r", "r", "rad/s", "yaw rate", "velocities/r-rad_sec"),
    Channel("pdot", "ṗ", "rad/s2", "roll acceleration", "accelerations/pdot-rad_sec2"),
    Channel("qdot", "q̇", "rad/s2", "pitch acceleration", "accelerations/qdot-rad_sec2"),
    Channel("rdot", "ṙ", "rad/s2", "yaw acceleration", "accelerations/rdot-rad_sec2"),
    Channel("phi", "φ", "rad", "bank angle", "attitude/phi-rad"),
    Channel("theta", "θ", "rad", "pitch angle", "attitude/theta-rad"),
    Channel("psi", "ψ", "rad", "heading", "attitude/psi-rad"),
    *(
        Channel(
            f"a{x}",
            f"a{x}",
            "m/s2",
            f"specific force along body {x} at the centre of gravity",
            f"forces/fb{x}-total-lbs",
            LBF_N,
            True,
        )
        for x in "xyz"
    ),
    Channel("h", "h", "m", "altitude above sea level", "position/h-sl-ft", FT_M),
    Channel("hdot", "ḣ", "m/s", "climb rate", "velocities/h-dot-fps", FT_M),
    Channel("Vg", "Vg", "m/s", "ground speed", "velocities/vg-fps", FT_M),
    Channel("v_north", "V_N", "m/s", "velocity over ground towards north", "velocities/v-north-fps", FT_M),
    Channel("v_east", "V_E", "m/s", "velocity over ground towards east", "velocities/v-east-fps", FT_M),
    Channel("north", "x_N", "m", "distance flown towards north", "position/from-start-neu-n-ft", FT_M),
    Channel("east", "x_E", "m", "distance flown towards east", "position/from-start-neu-e-ft", FT_M),
    Channel("wind_north", "W_N", "m/s", "velocity of the air towards north", "atmosphere/total-wind-north-fps", FT_M),
    Channel("wind_east", "W_E", "m/s", "velocity of the air towards east", "atmosphere/total-wind-east-fps", FT_M),
    Channel("wind_down", "W_D", "m/s", "velocity of the air downwards", "atmosphere/total-wind-down-fps", FT_M),
    Channel("qbar", "q̄", "Pa", "dynamic pressure", "aero/qbar-psf", PSF_PA),
    Channel("thrust", "T", "N", "thrust", "propulsion/engine/thrust-lbs", LBF_N),
    Channel("motor_speed", "ω_m", "rad/s", "rotation of the propeller", "propulsion/engine/propeller-rpm", RPM_RAD_S),
    Channel("de", "δe", "rad", "elevator deflection, trailing edge down positive", "fcs/elevator-pos-rad"),
    Channel("da", "δa", "rad", "aileron deflection, right wing down positive", "fcs/left-aileron-pos-rad"),
    Channel("dr", "δr", "rad", "rudder deflection, trailing edge left positive", "fcs/rudder-pos-rad"),
    Channel("thr", "δt", "1", "throttle, 0 to 1", "fcs/throttle-pos-norm"),
    Channel("de_cmd", "δe,c", "rad", "elevator command", "fcs/elevator-command-rad"),
    Channel("da_cmd", "δa,c", "rad", "aileron command", "fcs/aileron-command-rad"),
    Channel("dr_cmd", "δr,c", "rad", "rudder command", "fcs/rudder-command-rad"),
    Channel("thr_cmd", "δt,c", "1", "throttle command, 0 to 1", "fcs/throttle-cmd-norm"),
)
CHANNELS = {channel.name: channel for channel in _TABLE}

_MODAL = ("eta", "etadot", "etaddot")
_NUMBERED = {
    "eta": ("η", "1", "displacement of elastic mode"),
    "etadot": ("η̇", "1/s", "velocity of elastic mode"),
    "etaddot": ("η̈", "1/s2", "acceleration of elastic mode"),
    "az_wing": ("az,w", "m/s2", "specific force along body z at wing station"),
    "strain_wing": ("ε", "1", "bending strain of the upper skin at wing station"),
}
_NUMBERED_NAME = re.compile(rf"({'|'.join(_NUMBERED)})_(\d+)")

CONTROLS = ("de", "da", "dr", "thr")
"""The control channels, in the order used throughout."""
SURFACES = CONTROLS[:3]
"""Those of them that are deflections."""

UNITS: dict[str, dict[str, float]] = {
    "rad": {"rad": 1.0, "deg": DEG_RAD},
    "rad/s": {"rad/s": 1.0, "deg/s": DEG_RAD, "rpm": RPM_RAD_S},
    "rad/s2": {"rad/s2": 1.0, "deg/s2": DEG_RAD},
    "m": {"m": 1.0, "cm": 0.01, "ft": FT_M, "km": 1000.0},
    "m/s": {"m/s": 1.0, "cm/s": 0.01, "ft/s": FT_M, "ft/min": FT_M / 60.0, "kt": KT_M_S, "km/h": 1.0 / 3.6},
    "m/s2": {"m/s2": 1.0, "cm/s2": 0.01, "ft/s2": FT_M, "g": G0_M_S2},
    "N": {"N": 1.0, "lbf": LBF_N, "kN": 1000.0},
    "Pa": {"Pa": 1.0, "hPa": 100.0, "psf": PSF_PA},
    "1": {"1": 1.0, "%": PERCENT},
}
"""Units that files may use at the edge: SI unit -> {unit: factor to SI}."""


def channel(name: str) -> Channel:
    """Return the channel called ``name``.

    Modal channels are ``eta_1``, ``etadot_1``, ``etaddot_1`` and so on; those of the wing stations that an aircraft
    lists are ``az_wing_1``, ``strain_wing_1`` and so on.

    Raises:
        ChannelError: the name is not in the table.
    """
    if name in CHANNELS:
        return CHANNELS[name]
    match = _NUMBERED_NAME.fullmatch(name)
    if match is None:
        raise ChannelError(f"a channel must be in the channel table, got '{name}'{nearest(name, CHANNELS)}")
    kind, number = match.groups()
    symbol, unit, description = _NUMBERED[kind]
    source = f"modal/{kind}-{number}" if kind in _MODAL else None
    return Channel(name, f"{symbol}{number}", unit, f"{description} {number}", source)


def modal_channels(count: int) -> tuple[str, ...]:
    """Return the names of the displacement, velocity and acceleration channels of ``count`` elastic modes."""
    return tuple(f"{kind}_{i}" for kind in _MODAL for i in range(1, count + 1))


def station_channels(count: int, flexible: bool) -> tuple[str, ...]:
    """Return the names of the channels of ``count`` wing stations; rigid wings show no strain."""
    kinds = ("az_wing", "strain_wing") if flexible else ("az_wing",)
    return tuple(f"{kind}_{i}" for kind in kinds for i in range(1, count + 1))


def unit_factor(name: str, unit: str) -> float:
    """Return the factor that takes a value of channel ``name`` given in ``unit`` to SI.

    Raises:
        ChannelError: the channel is unknown or the unit does not measure it.
    """
    si = channel(name).unit
    table = UNITS.get(si, {si: 1.0})
    if unit not in table:
        raise ChannelError(f"channel '{name}' is measured in {' or '.join(table)}, got unit '{unit}'")
    return table[unit]


def require(names: Iterable[str], available: Iterable[str], what: str) -> None:
    """Check that every one of ``names`` is among ``available``.

    Raises:
        ChannelError: names the first channel that is missing, and what it was needed for.
    """
    have = tuple(available)
    for name in names:
        channel(name)
        if name not in have:
            raise ChannelError(f"{what} needs channel '{name}', but the record holds only {', '.join(have)}")
