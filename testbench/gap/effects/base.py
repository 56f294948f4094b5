"""What an effect of the library is: physics in words, bounded parameters, and how it changes aircraft or sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.record import FloatArray
from testbench.sensors import SensorSuite


@dataclass(frozen=True)
class Parameter:
    """One free quantity of an effect, within physical bounds, with the values that a fit starts from.

    ``prior`` is (value, relative standard deviation) where handbook knowledge bounds what flight data cannot separate.
    """

    name: str
    unit: str
    low: float
    high: float
    starts: tuple[float, ...]
    prior: tuple[float, float] | None = None


Amend = Callable[[Aircraft, SensorSuite, Mapping[str, float]], tuple[Aircraft, SensorSuite]]


@dataclass(frozen=True)
class Effect:
    """One physical effect that a believed model may lack.

    Attributes:
        name: short name, as in results.
        title: name for people.
        physics: what happens, in two sentences.
        parameters: what a fit estimates.
        amend: returns aircraft and suite with the effect added; neither argument is changed.
        separated_by: what it may be mistaken for, and what flight tells them apart.
    """

    name: str
    title: str
    physics: str
    parameters: tuple[Parameter, ...]
    amend: Amend
    separated_by: str

    def prior_residuals(self, x: FloatArray) -> FloatArray:
        """Return ln(x / value) / deviation of every parameter that has a prior."""
        priors = [(v, p.prior) for v, p in zip(x, self.parameters, strict=True) if p.prior]
        return np.array([np.log(v / value) / deviation for v, (value, deviation) in priors])
