"""Campaigns: one scenario flown many times, with values drawn from distributions or taken from a grid."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.errors import CampaignError, nearest
from testbench.core.scenario.base import Asked
from testbench.core.schema import NonNegative, Positive, Strict

if TYPE_CHECKING:
    from testbench.questions.campaign.store import Store


Entry = bool | int | float | str


class Normal(Strict):
    """Gaussian with ``mean`` and standard deviation ``std``."""

    kind: Literal["normal"]
    mean: float
    std: NonNegative


class Uniform(Strict):
    """Equally likely from ``low`` to ``high``."""

    kind: Literal["uniform"]
    low: float
    high: float

    @model_validator(mode="after")
    def _low_below_high(self) -> Uniform:
        if not self.low < self.high:
            raise ValueError(f"low < high must hold for a uniform distribution, got {self.low:g} and {self.high:g}")
        return self


class LogNormal(Strict):
    """exp of a Gaussian: half of the values are below ``median``; ``sigma`` is the deviation of the logarithm."""

    kind: Literal["lognormal"]
    median: Positive
    sigma: NonNegative


class Choice(Strict):
    """One of ``among``, drawn with ``weights`` (equal ones if none are given)."""

    kind: Literal["choice"]
    among: Annotated[tuple[Entry, ...], Field(min_length=1, strict=False)]
    weights: Annotated[tuple[NonNegative, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _one_weight_each(self) -> Choice:
        if self.weights and (len(self.weights) != len(self.among) or sum(self.weights) <= 0.0):
            raise ValueError(
                f"weights: one per entry of among ({len(self.among)}), not all zero, must be given, got "
                f"{list(self.weights)}"
            )
        return self


class Values(Strict):
    """The entries of ``values`` in turn: run i takes entry i, modulo their number."""

    kind: Literal["values"]
    values: Annotated[tuple[Entry, ...], Field(min_length=1, strict=False)]


class Uncertainty(Strict):
    """Of a coefficient, or of all ("coefficient.*"): normal, with the deviation that aircraft.toml states.

    The relative standard deviation is that of ``[uncertainty]``. "coefficient.*" draws every coefficient that stands
    there, each on its own; a key that names one of them goes before it.
    """

    kind: Literal["uncertainty"]


Distribution = Annotated[Normal | Uniform | LogNormal | Choice | Values | Uncertainty, Field(discriminator="kind")]
EVERY = "coefficient.*"
"""The key that stands for every coefficient whose deviation the aircraft states."""


class Stop(Strict):
    """Stop before the last run, as soon as the mean of ``quantity`` is known to ``half_width``.

    The rule is asked after every ``block`` runs in the order of their numbers, from ``minimum`` runs on. So the last
    run does not depend on which worker flew which run when. ``half_width`` is half the width of the confidence interval
    of the mean, in the quantity's unit.
    """

    quantity: Annotated[str, Field(min_length=1)]
    half_width: Positive
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.95
    minimum: Annotated[int, Field(ge=2)] = 20
    block: Annotated[int, Field(ge=1)] = 20


class CampaignSpec(Asked):
    """A campaign: a base scenario, what varies, how many runs.

    Give ``base`` (a file beside the campaign's own, or a packaged one) or ``scenario`` (the scenario itself). Give
    ``runs``, or ``grid`` and ``repeats``: then every combination of the grid's values is flown ``repeats`` times, and
    run i has combination i modulo their number. ``truth`` linearises the aircraft of every run so that estimates have
    true values beside them. ``records`` keeps time histories as NetCDF.
    """

    unnamed: ClassVar[str] = "campaign"
    checked_by: ClassVar[str] = "testbench.questions.campaign.load:campaign_faults"
    noted_by: ClassVar[str] = "testbench.questions.campaign.load:campaign_notes"

    base: Annotated[str, Field(min_length=1)] | None = None
    scenario: dict[str, Any] | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    runs: Annotated[int, Field(ge=1)] | None = None
    repeats: Annotated[int, Field(ge=1)] | None = None
    truth: bool = True
    records: bool = False
    vary: dict[str, Distribution] = {}
    grid: dict[str, Annotated[tuple[Entry, ...], Field(min_length=1, strict=False)]] = {}
    stop: Stop | None = None

    @model_validator(mode="after")
    def _consistent(self) -> CampaignSpec:
        faults = []
        if (self.base is None) == (self.scenario is None):
            faults.append("a campaign takes either base (a scenario file) or scenario (a table), and not both")
        if self.grid and (self.repeats is None or self.runs is not None):
            faults.append("a campaign with a grid takes repeats and not runs")
        if not self.grid and (self.runs is None or self.repeats is not None):
            faults.append("a campaign without a grid takes runs and not repeats")
        both = sorted(set(self.vary) & set(self.grid))
        if both:
            faults.append(f"a key is either varied or on the grid, got both for {', '.join(both)}")
        faults += self._faults_of_uncertainty()
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def _faults_of_uncertainty(self) -> list[str]:
        """Return the laws that the draws by the aircraft's own uncertainty break."""
        own = [key for key, law in self.vary.items() if isinstance(law, Uncertainty)]
        faults = [
            f'kind "uncertainty" is for coefficients, "coefficient.NAME" or "{EVERY}", got it for "{key}"; give a '
            "distribution"
            for key in own
            if not key.startswith("coefficient.")
        ]
        if EVERY in self.grid or (EVERY in self.vary and EVERY not in own):
            faults.append(f'"{EVERY}" takes {{ kind = "uncertainty" }} under [vary] and nothing else')
        if own and "aircraft" in {*self.vary, *self.grid}:
            faults.append(
                'kind "uncertainty" takes the deviations of one aircraft, but aircraft varies; make one campaign of '
                "each, or give distributions"
            )
        return faults

    @property
    def cells(self) -> int:
        """Number of combinations of the grid's values; 1 without a grid."""
        count = 1
        for values in self.grid.values():
            count *= len(values)
        return count

    @property
    def total(self) -> int:
        """Number of runs, unless a rule ends the campaign before."""
        return self.runs if self.runs is not None else self.cells * (self.repeats or 1)


# --- sequential stopping: the campaign ends with the first block of runs after which a mean is known well enough ------


@dataclass
class Watch:
    """Follows the mean of one quantity in the order of the runs, block by block (Welford's update of the variance).

    The interval is that of Student's t. Because it is asked several times it is a little too short: with blocks of 20 a
    nominal 95 % interval covers the mean less often than that. By how much depends on the wanted width; a large
    ``minimum`` helps.
    """

    rule: Stop
    seen: int = 0
    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    def half_width(self) -> float:
        """Return half the width of the confidence interval of the mean; infinite with fewer than two values."""
        if self.count < 2:
            return math.inf
        from scipy.stats import t

        std_of_mean = math.sqrt(self.squares / (self.count - 1) / self.count)
        return float(t.ppf(0.5 + 0.5 * self.rule.confidence, self.count - 1)) * std_of_mean

    def advance(self, store: Store, total: int) -> int | None:
        """Take in every block that is finished, and return the number of runs to stop at, or None to go on.

        Raises:
            CampaignError: after ``minimum`` runs no run has given the quantity.
        """
        first = store.first_unfinished()
        finished = total if first is None else first
        while (end := self.seen + self.rule.block) <= finished:
            known: set[str] = set()
            for row in store.rows(self.seen, end):
                with store.whole():
                    found = json.loads(row.results)["figures"] if row.results else {}
                    known |= {f"{case}: {name}" for case, figures in found.items() for name in figures}
                    case, _, name = self.rule.quantity.partition(": ")
                    value = found.get(case, {}).get(name)
                    if value is not None:
                        self._take(float(value))
            self.seen = end
            if end < self.rule.minimum:
                continue
            if self.count == 0 and known:
                raise CampaignError(
                    f"stop.quantity must be a figure that runs find, got '{self.rule.quantity}'"
                    f"{nearest(self.rule.quantity, known)}"
                )
            if self.half_width() <= self.rule.half_width:
                return end
        return None

    def _take(self, value: float) -> None:
        self.count += 1
        step = value - self.mean
        self.mean += step / self.count
        self.squares += step * (value - self.mean)
