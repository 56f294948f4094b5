"""Campaigns: one scenario flown many times, with values drawn from distributions or taken from a grid."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.scenario.base import Asked
from testbench.core.schema import NonNegative, Positive, Strict

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
    """exp of a Gaussian: half of the values lie below ``median``; ``sigma`` belongs to the logarithm."""

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
    """Of a coefficient, or of all ("coefficient.*"): normal about the believed value, by what aircraft.toml states.

    The relative standard deviation is that of ``[uncertainty]``. "coefficient.*" draws every coefficient that stands
    there, each on its own; a key that names one of them goes before it.
    """

    kind: Literal["uncertainty"]


Distribution = Annotated[Normal | Uniform | LogNormal | Choice | Values | Uncertainty, Field(discriminator="kind")]
EVERY = "coefficient.*"
"""The key that stands for every coefficient whose deviation the aircraft states."""


class Stop(Strict):
    """End before the last run: as soon as the mean of ``quantity`` is known to ``half_width``.

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
