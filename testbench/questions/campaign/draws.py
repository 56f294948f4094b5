"""The values and the seed of each run: functions of the campaign's seed and the run's number alone.

Draws by the aircraft's own uncertainty, with the numbers that it states put in their place.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import KEY, stated_deviations, varied
from testbench.core.channels import channel, unit_factor
from testbench.core.errors import ChannelError, Faults, ModelError, ScenarioError, nearest
from testbench.core.generators import keyed_generator
from testbench.questions.campaign.scenario import (
    EVERY,
    CampaignSpec,
    Choice,
    Distribution,
    LogNormal,
    Normal,
    Uncertainty,
    Uniform,
)
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import ACCELEROMETERS

ROOMS = ("aircraft", "coefficient", "property", "sensor")
SENSOR_FIELDS = ("noise_std", "bias", "scale", "lag_s", "delay_s", "quantum", "dropout")
_IN_UNIT = ("noise_std", "bias", "quantum")
_UNITS = {"deg": "deg", "deg_s": "deg/s", "deg_s2": "deg/s2", "m": "m", "m_s": "m/s", "m_s2": "m/s2", "percent": "%"}


def with_own_laws(spec: CampaignSpec, aircraft: Aircraft) -> CampaignSpec:
    """Return the campaign with a normal law for every coefficient that is drawn by the aircraft's own uncertainty.

    The drawn factor has the mean 1 and the stated relative standard deviation. The coefficients of "coefficient.*"
    stand in the order of aircraft.toml; those that another key varies are left to it.

    Args:
        spec: as in the file.
        aircraft: of its base scenario.

    Raises:
        ScenarioError: the aircraft states no deviations, or not that of a coefficient which is asked for.
    """
    own = [key for key, law in spec.vary.items() if isinstance(law, Uncertainty)]
    if not own:
        return spec
    faults = Faults(spec.file)
    try:
        stated = {
            f"{KEY}{name}": Normal(kind="normal", mean=1.0, std=std)
            for name, std in stated_deviations(aircraft).items()
        }
    except ModelError as error:
        faults.note(f'vary."{own[0]}"', error.message)
        raise ScenarioError(faults) from error
    vary: dict[str, Distribution] = {}
    for key, law in spec.vary.items():
        if key == EVERY:
            vary |= {k: normal for k, normal in stated.items() if k not in spec.vary and k not in spec.grid}
        elif not isinstance(law, Uncertainty):
            vary[key] = law
        elif key in stated:
            vary[key] = stated[key]
        else:
            names = [k.removeprefix(KEY) for k in stated]
            name = key.removeprefix(KEY)
            faults.note(
                f'vary."{key}"',
                f"[uncertainty] of {aircraft.name} must state the deviation of the coefficient, got '{name}'"
                f"{nearest(name, names)}",
            )
    if faults:
        raise ScenarioError(faults)
    return spec.changed(vary=vary)


def own_keys(spec: CampaignSpec, resolved: CampaignSpec) -> tuple[str, ...]:
    """Return the keys that are drawn by the aircraft's own uncertainty.

    Args:
        spec: as in the file.
        resolved: what :func:`with_own_laws` returned for it.
    """
    given = {key for key, law in spec.vary.items() if not isinstance(law, Uncertainty)}
    return tuple(key for key in resolved.vary if key not in given)


def run_seed(spec: CampaignSpec, index: int) -> int:
    """Return the seed of run ``index``: the first word of SeedSequence([campaign seed, index])."""
    return int(np.random.SeedSequence([spec.seed, index]).generate_state(1)[0])


def run_inputs(spec: CampaignSpec, index: int) -> dict[str, Any]:
    """Return key -> value of run ``index``: its point of the grid, then its random draws.

    Every key draws from its own child of SeedSequence([campaign seed, index]), by the crc32 of the key, so that neither
    further keys nor their order change the values of the others.
    """
    out: dict[str, Any] = {}
    cell = index % spec.cells
    for key in reversed(spec.grid):  # the last key runs fastest
        values = spec.grid[key]
        out[key] = values[cell % len(values)]
        cell //= len(values)
    out = {key: out[key] for key in spec.grid}
    for key, law in spec.vary.items():
        out[key] = draw_value(law, spec.seed, index, key)
    return out


def nominal_inputs(spec: CampaignSpec) -> dict[str, Any]:
    """Return key -> the middle of its distribution (the first of choices and values); for the grid, its first point."""
    return {key: values[0] for key, values in spec.grid.items()} | {k: middle(law) for k, law in spec.vary.items()}


def middle(law: Distribution) -> Any:
    """Return mean, midpoint or median of a distribution; the first entry of choices and values."""
    assert not isinstance(law, Uncertainty), "with_own_laws puts a normal law in its place"
    if isinstance(law, Normal):
        return law.mean
    if isinstance(law, Uniform):
        return 0.5 * (law.low + law.high)
    if isinstance(law, LogNormal):
        return law.median
    return law.among[0] if isinstance(law, Choice) else law.values[0]


def draw_value(law: Distribution, seed: int, index: int, key: str) -> Any:
    """Return the value of one key in draw ``index``."""
    assert not isinstance(law, Uncertainty), "with_own_laws puts a normal law in its place"
    if not isinstance(law, (Normal, Uniform, LogNormal, Choice)):
        return law.values[index % len(law.values)]
    rng = keyed_generator(seed, index, key)
    if isinstance(law, Normal):
        return law.mean + law.std * float(rng.standard_normal())
    if isinstance(law, Uniform):
        return float(rng.uniform(law.low, law.high))
    if isinstance(law, LogNormal):
        return float(law.median * np.exp(law.sigma * rng.standard_normal()))
    weights = np.array(law.weights or [1.0] * len(law.among))
    return law.among[int(rng.choice(len(law.among), p=weights / weights.sum()))]


# --- how a value reaches what it varies -------------------------------------------------------------------------------


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
