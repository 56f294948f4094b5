"""The file of a data set: levels of flights to identify from, or to name effects in."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.scenario.base import AircraftName, Asked, Simulation, SuiteName
from testbench.core.scenario.inputs import Input
from testbench.core.schema import NonNegative, Pair, Positive, Strict
from testbench.questions.campaign.scenario import Distribution

SPLITS = ("train", "validation", "test")


class Flown(Strict):
    """One manoeuvre that every draw flies; ``settle_s`` of trimmed flight precede its inputs."""

    name: Annotated[str, Field(min_length=1)]
    duration_s: Positive
    settle_s: NonNegative = 2.0
    input: Annotated[tuple[Input, ...], Field(min_length=1, strict=False)]


class Split(Strict):
    """Shares of the draws; the split of a draw follows from a hash of the drawn values."""

    train: NonNegative = 0.7
    validation: NonNegative = 0.15
    test: NonNegative = 0.15

    @model_validator(mode="after")
    def _one_in_all(self) -> Split:
        total = self.train + self.validation + self.test
        if not math.isclose(total, 1.0, abs_tol=1e-9):
            raise ValueError(f"train + validation + test = 1 must hold, got {total:g}")
        return self

    def of(self, share: float) -> str:
        """Return the split of a draw whose hash is ``share``, 0 to 1."""
        if share < self.train:
            return "train"
        return "validation" if share < self.train + self.validation else "test"


class Level(Strict):
    """One level of difficulty: how its aircraft, conditions, air, sensors and hidden effects are drawn.

    ``share`` is its weight among the levels. ``speed_ratio`` is the airspeed over the aircraft's design airspeed,
    ``scale`` a factor on all inputs of a draw, ``noise`` one on noise, bias, drift and quantum of the sensors. A pair
    is the range of a uniform draw. ``vary`` takes the keys of a campaign that change the aircraft or a sensor.
    ``hidden`` lists effects of the library, of which each draw has one; "a + b" hides both. Their sizes are drawn from
    the ranges of :mod:`.draws`.
    """

    name: Annotated[str, Field(min_length=1)]
    share: Positive = 1.0
    aircraft: Annotated[tuple[AircraftName, ...], Field(min_length=1, strict=False)]
    wings: Literal["flexible", "rigid"] = "rigid"
    speed_ratio: Pair = (1.0, 1.0)
    h_m: Pair
    scale: Pair = (1.0, 1.0)
    noise: NonNegative = 1.0
    turbulence_rms_m_s: Pair = (0.0, 0.0)
    vary: dict[str, Distribution] = {}
    hidden: Annotated[tuple[str, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _ranges(self) -> Level:
        for key, least in (("speed_ratio", 0.0), ("h_m", -math.inf), ("scale", 0.0), ("turbulence_rms_m_s", 0.0)):
            low, high = getattr(self, key)
            if not least <= low <= high:
                above = f"{least:g} <= " if math.isfinite(least) else ""
                raise ValueError(f"{key}: {above}low <= high must hold, got {low:g} and {high:g}")
        return self


class DatasetScenario(Asked):
    """A data set of flights with known truth.

    Each draw belongs to a ``level`` and flies every ``manoeuvre``, measured by the ``suite``. ``task`` "naming" asks
    for the hidden effect: levels and turbulence are then labels, too, which the test split withholds. ``flights`` are
    drawn in all.
    """

    unnamed: ClassVar[str] = "dataset"
    checked_by: ClassVar[str] = "testbench.questions.dataset.check:dataset_faults"

    seed: Annotated[int, Field(ge=0)] = 0
    flights: Annotated[int, Field(ge=1)]
    licence: Annotated[str, Field(min_length=1)] = "not stated"
    split: Split = Split()
    task: Literal["identification", "naming"] = "identification"
    suite: SuiteName
    samples_hz: Positive | None = None
    simulation: Simulation = Simulation()
    manoeuvre: Annotated[tuple[Flown, ...], Field(min_length=1, strict=False)]
    level: Annotated[tuple[Level, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _names_differ(self) -> DatasetScenario:
        for key in ("level", "manoeuvre"):
            names = [x.name for x in getattr(self, key)]
            if len(set(names)) != len(names):
                raise ValueError(f"names of {key} must differ, got {', '.join(names)}")
        return self
