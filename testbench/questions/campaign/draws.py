"""The values and the seed of each run: functions of the campaign's seed and the run's number alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from testbench.core.generators import keyed_generator
from testbench.questions.campaign.scenario import (
    CampaignSpec,
    Choice,
    Distribution,
    LogNormal,
    Normal,
    Uncertainty,
    Uniform,
)


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
