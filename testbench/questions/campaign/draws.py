"""The values and the seed of each run: functions of the campaign's seed and the run's number alone.

Draws by the aircraft's own uncertainty, with the numbers that it states put in their place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import KEY, stated_deviations
from testbench.core.errors import Faults, ModelError, ScenarioError, nearest
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
