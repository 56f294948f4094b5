"""What a campaign may vary, by key, and how a value reaches the scenario, the aircraft and the sensors.

    aircraft.mass_percent, .Ixx_percent, .Iyy_percent, .Izz_percent, .Ixz_percent, .inertia_percent
                                  change of the mass, of one moment of inertia, of all of them, percent
    aircraft.cg_x_m, .cg_y_m, .cg_z_m
                                  shift of the centre of gravity forward, right, down
    coefficient.NAME              factor on an aerodynamic coefficient: aero/coefficient/NAME of a model in the
                                  testbench's own form; of any other CL, CD, CY, Cl, Cm, Cn or a derivative, Cm_alpha
    coefficient.*                 every coefficient whose deviation the aircraft states, by kind "uncertainty"
    property.NAME                 value of a property that the model declares, or that a foreign model is told before
                                  it flies, in its own unit
    sensor.CHANNEL.FIELD          figure of that sensor in every suite: noise_std, bias, scale, lag_s, delay_s, quantum,
                                  dropout, in SI; or with the unit behind it: bias_deg, noise_std_deg_s
    anything else                 a key of the scenario: condition.V_m_s, air.turbulence_rms_m_s, wings,
                                  manoeuvre.0.input.0.pilot.jitter_s (lists count from 0)

The centre of gravity moves against the aerodynamic reference and against the accelerometers, which stay where they are
mounted; alpha, airspeed and the wing stations are taken at the centre of gravity wherever it is.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from testbench.aircraft import Aircraft
from testbench.aircraft.vary import varied
from testbench.core.channels import channel, unit_factor
from testbench.core.errors import ChannelError, ModelError, ScenarioError, nearest
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import ACCELEROMETERS

ROOMS = ("aircraft", "coefficient", "property", "sensor")
SENSOR_FIELDS = ("noise_std", "bias", "scale", "lag_s", "delay_s", "quantum", "dropout")
_IN_UNIT = ("noise_std", "bias", "quantum")
_UNITS = {"deg": "deg", "deg_s": "deg/s", "deg_s2": "deg/s2", "m": "m", "m_s": "m/s", "m_s2": "m/s2", "percent": "%"}


def is_scenario_key(key: str) -> bool:
    """Say whether ``key`` is one of the scenario file itself."""
    head, _, rest = key.partition(".")
    return head not in ROOMS or not rest


def set_keys(content: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scenario ``content`` with the keys of the scenario among ``inputs`` given their values.

    Raises:
        ScenarioError: a key leads through something that is neither a table nor an entry of a list.
    """
    out = copy.deepcopy(dict(content))
    for key, value in inputs.items():
        if is_scenario_key(key):
            _set(out, key, value)
    return out


def _set(content: dict[str, Any], key: str, value: Any) -> None:
    place: Any = content
    parts = key.split(".")
    for k, part in enumerate(parts):
        here = ".".join(parts[: k + 1])
        if isinstance(place, list):
            if not part.isdigit() or int(part) >= len(place):
                raise ScenarioError(
                    f"'{here}' must be an entry of a list of {len(place)} (0 to {len(place) - 1}), got '{part}'"
                )
            index: Any = int(part)
        elif isinstance(place, dict):
            index = part
        else:
            raise ScenarioError(f"'{here}' must lead to a key of the scenario, but what stands before it is a value")
        if k == len(parts) - 1:
            place[index] = value
        else:
            place = place.setdefault(index, {}) if isinstance(place, dict) else place[index]


def check_target(key: str, value: Any, aircraft: Aircraft, suites: tuple[SensorSuite, ...]) -> list[str]:
    """Return every law that a key outside the scenario, with one of its values, breaks; scenario keys pass."""
    if is_scenario_key(key):
        return []
    if isinstance(value, (str, bool)):
        return [f"a number must be given, got {value!r}"]
    try:
        change_aircraft(aircraft, {key: value}).model_xml(
            aircraft.rate_hz, 100.0, aircraft.design_V_m_s
        )  # applies the amendments; the dynamic pressure does not matter to them
        change_suites(suites, {key: value})
    except ScenarioError as error:
        return list(error.faults)
    except (ModelError, ChannelError) as error:
        return [error.message]
    return []


def change_aircraft(aircraft: Aircraft, inputs: Mapping[str, Any]) -> Aircraft:
    """Return the aircraft with the changes of mass, inertia, centre of gravity, coefficients and properties.

    Raises:
        ModelError: the aircraft has no such coefficient or property, or a change that it cannot take.
    """
    return varied(aircraft, inputs, "campaign", "values of one run of a campaign")


def change_suites(suites: tuple[SensorSuite, ...], inputs: Mapping[str, Any]) -> tuple[SensorSuite, ...]:
    """Return the suites with the sensor figures among ``inputs``, and accelerometers seen from the moved centre.

    Raises:
        ChannelError: no suite has a sensor of that channel.
        ScenarioError: no such figure of a sensor, or a value that breaks its law.
    """
    shift = tuple(float(inputs.get(f"aircraft.cg_{axis}_m", 0.0)) for axis in "xyz")
    figures: dict[str, dict[str, float]] = {}
    for key, value in inputs.items():
        head, _, rest = key.partition(".")
        if head == "sensor" and rest:
            name, _, figure = rest.partition(".")
            sensed = [s.channel for suite in suites for s in suite.sensors]
            if name not in sensed:
                raise ChannelError(f"a varied sensor must be in a suite, got '{name}'{nearest(name, sensed)}")
            field, factor = _figure(name, figure)
            figures.setdefault(name, {})[field] = float(value) * factor
    if not figures and not any(shift):
        return suites
    return tuple(
        replace(suite, sensors=tuple(_changed(s, figures.get(s.channel, {}), shift) for s in suite.sensors))
        for suite in suites
    )


def _figure(name: str, figure: str) -> tuple[str, float]:
    """Return the field of Sensor that a figure means, and the factor to SI."""
    known = [f for f in SENSOR_FIELDS if f in {x.name for x in fields(Sensor)}]
    if figure in known:
        return figure, 1.0
    for field in _IN_UNIT:
        unit = figure.removeprefix(f"{field}_")
        if figure != unit and unit in _UNITS:
            try:
                return field, unit_factor(name, _UNITS[unit])
            except ChannelError as error:
                raise ScenarioError(f"sensor.{name}.{figure}: {error.message}") from error
    raise ScenarioError(
        f"unknown figure '{figure}' of sensor '{name}' (SI unit {channel(name).unit}){nearest(figure, known)}"
    )


def _changed(sensor: Sensor, figures: Mapping[str, float], shift: tuple[float, ...]) -> Sensor:
    values: dict[str, Any] = dict(figures)
    if any(shift) and sensor.channel in ACCELEROMETERS:
        values["position_m"] = tuple(r - s for r, s in zip(sensor.position_m, shift, strict=True))
    return replace(sensor, **values) if values else sensor
