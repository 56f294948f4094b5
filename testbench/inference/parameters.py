"""The one vector of all that is uncertain about a flight: its entries, in blocks, each with a prior.

A hypothesis about a record is a list of :class:`Parameter`. What is not known of the noise stands beside it as
:class:`Noise`: a scale of each channel, with a prior as wide as the source of the stated number deserves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

Block = Literal["start", "instrument", "servo", "aircraft", "effect", "air"]
Source = Literal["simulated", "measured", "stated", "guessed"]

NOISE_SPREAD: Mapping[str, float] = {"simulated": 0.0, "measured": 0.05, "stated": 0.3, "guessed": 1.0}
"""Prior standard deviation of ln(true noise / stated noise) by where the stated number comes from.

Simulated here: it is exact. Measured in quiet flight: some 200 independent samples, 1 / sqrt(2 n). A datasheet: the
same part differs by a third from one aeroplane to the next. Guessed: a factor of e either way.
"""


@dataclass(frozen=True)
class Parameter:
    """One entry of the vector.

    Attributes:
        name: of the entry.
        block: what it belongs to.
        value: mean of its Gaussian prior, and where a fit begins.
        prior_std: standard deviation of the prior.
        unit: of both; "1" if it has none.
        low, high: what is possible.
        step: of the difference that a tangent is taken with; a hundredth of ``prior_std`` if 0.

    Raises:
        EstimationError: the prior has no width, or ``value`` is not possible.

    Example:
        >>> import testbench as tb
        >>> tb.Parameter("delay_s", "servo", 0.05, 0.05, "s", low=0.0, high=0.3).difference
        0.0005
    """

    name: str
    block: Block
    value: float
    prior_std: float
    unit: str = "1"
    low: float = -math.inf
    high: float = math.inf
    step: float = 0.0

    def __post_init__(self) -> None:
        if not (self.prior_std > 0.0 and math.isfinite(self.prior_std)):
            raise EstimationError(f"prior_std of '{self.name}' must be above 0 and finite, got {self.prior_std:g}")
        if not self.low <= self.value <= self.high:
            raise EstimationError(
                f"low <= value <= high must hold for '{self.name}', got {self.low:g}, {self.value:g}, {self.high:g}"
            )

    @property
    def difference(self) -> float:
        """Step of the difference that its tangent is taken with."""
        return self.step or 1e-2 * self.prior_std


@dataclass(frozen=True)
class Noise:
    """What is believed of the noise of the channels.

    Attributes:
        std: channel -> stated standard deviation of one sample, SI.
        source: where these numbers come from, see :data:`NOISE_SPREAD`; of single channels in ``sources``.
        sources: channel -> source, where it differs.

    Raises:
        EstimationError: a channel has no noise, or a source is of a channel without any.

    Example:
        >>> import testbench as tb
        >>> tb.Noise({"q": 0.005, "alpha": 0.003}, "stated", {"alpha": "measured"}).spread.tolist()
        [0.3, 0.05]
    """

    std: Mapping[str, float]
    source: Source = "stated"
    sources: Mapping[str, Source] = field(default_factory=dict)

    def __post_init__(self) -> None:
        wrong = {c: s for c, s in self.std.items() if not (s > 0.0 and math.isfinite(s))}
        if wrong or not self.std:
            raise EstimationError(f"the noise of every channel must be above 0 and finite, got {wrong or 'no channel'}")
        strange = [c for c in self.sources if c not in self.std]
        if strange:
            raise EstimationError(f"sources must be of channels that have noise, got {strange[0]}")

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels, in order."""
        return tuple(self.std)

    @property
    def spread(self) -> FloatArray:
        """Prior standard deviations (channels,) of the ln of each channel's scale."""
        return np.array([NOISE_SPREAD[self.sources.get(c, self.source)] for c in self.std])


def deviations_of(parameters: Sequence[Parameter]) -> FloatArray:
    """Return the standard deviations (k,) of the priors."""
    return np.array([p.prior_std for p in parameters])
