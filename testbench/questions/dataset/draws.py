"""What is drawn for each draw, as a function of the seed, its number and the attempt alone; and its split, by hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.generators import keyed_generator
from testbench.effects import catalogue
from testbench.flight import load_aircraft
from testbench.questions.campaign.draws import draw_value
from testbench.questions.dataset.kinds import draw_sizes
from testbench.questions.dataset.scenario import DatasetScenario, Level
from testbench.sensors import load_suite

MOST_HIDDEN = 2
"""Effects that act together at most."""


@dataclass(frozen=True)
class Draw:
    """One draw: everything that its flights share.

    Attributes:
        number: of the draw.
        attempt: 0, or how many draws of this number could not fly.
        level: its level.
        aircraft: its name.
        V_m_s, h_m: condition of its trim.
        turbulence_rms_m_s: of the air.
        scale: of the inputs.
        values: key of a campaign -> what was drawn for it.
        kinds: names of the hidden effects.
        sizes: parameter -> value (SI), of each.
        seed: of noise and air; flight k has ``seed + k``.
    """

    number: int
    attempt: int
    level: Level
    aircraft: str
    V_m_s: float
    h_m: float
    turbulence_rms_m_s: float
    scale: float
    values: Mapping[str, Any]
    kinds: tuple[str, ...]
    sizes: tuple[Mapping[str, float], ...]
    seed: int

    @property
    def share(self) -> float:
        """Hash of what was drawn, 0 to 1: equal draws have one hash, whatever their number and noise."""
        return hash_share(
            [self.aircraft, self.level.wings, self.V_m_s, self.h_m, dict(self.values), self.kinds, list(self.sizes)]
        )


def hash_share(drawn: Any) -> float:
    """Return a number from 0 to 1 by the SHA-256 of what was drawn, as JSON."""
    text = json.dumps(drawn, sort_keys=True, default=dict)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") / 2.0**64


@lru_cache(maxsize=32)
def aircraft_of(name: str, wings: str) -> Aircraft:
    """Return an aircraft, loaded once per process."""
    return load_aircraft(name, wings)


def draw(scenario: DatasetScenario, number: int, attempt: int) -> Draw:
    """Return draw ``number`` of a data set; its level does not depend on the attempt."""

    def generator(what: str) -> np.random.Generator:
        return keyed_generator(scenario.seed, number, f"{what}/{attempt}")

    shares = np.array([level.share for level in scenario.level])
    chosen = int(keyed_generator(scenario.seed, number, "level").choice(len(shares), p=shares / shares.sum()))
    level = scenario.level[chosen]
    name = str(generator("aircraft").choice(list(level.aircraft)))
    ratio, h, scale, rms = (
        float(generator(key).uniform(*getattr(level, key)))
        for key in ("speed_ratio", "h_m", "scale", "turbulence_rms_m_s")
    )
    hidden = generator("hidden")
    kinds = tuple(str(hidden.choice(list(level.hidden))).split(" + ")) if level.hidden else ()
    known = catalogue(load_suite(scenario.suite)) if kinds else {}
    return Draw(
        number=number,
        attempt=attempt,
        level=level,
        aircraft=name,
        V_m_s=ratio * aircraft_of(name, level.wings).design_V_m_s,
        h_m=h,
        turbulence_rms_m_s=rms,
        scale=scale,
        values={key: draw_value(law, scenario.seed, number, f"{key}/{attempt}") for key, law in level.vary.items()},
        kinds=kinds,
        sizes=tuple(draw_sizes(known[kind], hidden) for kind in kinds),
        seed=int(generator("seed").integers(1, 2**31 - 10**6)),
    )
