"""What a comparison found: errors of every case, what each suite buys, and what information predicted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from testbench.core.record import FloatArray
from testbench.evaluation.statistics import (
    Interval,
    Paired,
    chance_of_scatter,
    holm,
    mean_interval,
    paired,
    paired_misses,
    root_mean_square,
    scatter_interval,
    seeds_needed,
)
from testbench.flight.batch.jobs import Tally
from testbench.page.shown import Shown
from testbench.questions.compare.placement import Placed
from testbench.questions.compare.prediction import Known, Prediction
from testbench.questions.compare.scenario import BEST_CASE, CompareScenario
from testbench.sensors import SensorSuite

_WN = "wn of "


class CaseKey(NamedTuple):
    """One input, suite and estimator."""

    manoeuvre: str
    suite: str
    estimator: str


class Quantity(NamedTuple):
    """The quantity that an error belongs to.

    ``kind`` is "prediction", "mode", "parameter" or, among gains, "missed": how often a mode is not found at all;
    ``unit`` is "%", "" (damping ratios), or that of a quantity whose true value is near zero (:mod:`.near_zero`).
    """

    kind: str
    name: str
    unit: str = "%"


class Agreement(NamedTuple):
    """How many scatters of the best case have the predicted scatter ``inside`` their 95 % interval.

    They are counted out of ``total``. For ``far`` more the predicted errors are too large, and nothing is said.
    ``apart``: how many differ from the predicted one by more than chance, all of them taken together (Holm) at the
    comparison's level. ``ratios``: least, median and largest scatter found over the predicted one.
    """

    inside: int
    apart: int
    total: int
    far: int
    ratios: tuple[float, float, float]


@dataclass(frozen=True)
class Failure:
    """One identification that gave no model."""

    case: CaseKey
    repetition: int
    reason: str


@dataclass(frozen=True)
class Summary:
    """Errors of one quantity in one case over the repetitions."""

    case: CaseKey
    quantity: Quantity
    found: int  # in how many repetitions there is such a figure (a mode was found, a prediction stayed finite)
    of: int  # repetitions
    rms: Interval | None  # root mean square error with its 95 % interval; None for fewer than two
    # mean, scatter: mean error with its 95 % interval and standard deviation; None for predictions, whose errors have
    # no sign
    mean: Interval | None
    scatter: float | None
    predicted: float | None  # standard error by information; None if information predicts another quantity
    # scatter over predicted with its 95 % interval, of the best case alone; None where it is not ``near``
    ratio: Interval | None
    # error of the best case from the flight without noise; None for other estimators, or if it is unknown
    of_flight: float | None
    near: bool  # whether the model is linear in its parameters over the predicted errors, see :mod:`.prediction`


@dataclass(frozen=True)
class Gain:
    """What a suite buys over the first one: how much smaller the size of an error is, pair by pair."""

    case: CaseKey  # of the suite
    quantity: Quantity  # what the error is of
    # before, after: median size of the error with the first suite and with this one; share of repetitions that miss a
    # mode
    before: float
    after: float
    paired: Paired  # size of the error with the first suite minus that with this one
    # probability of this gain by chance, corrected for all gains of the comparison; None: too few pairs
    p_holm: float | None
    # ratio of the standard errors by information, this suite over the first; None: not predicted
    predicted: float | None

    def significant(self, level: float) -> bool:
        """Say whether the difference is more than chance at a level for the whole comparison."""
        return self.p_holm is not None and self.p_holm <= level


@dataclass(frozen=True, eq=False)
class CompareResult(Shown, page="testbench.questions.compare.page:compare_page"):
    """Everything a comparison found.

    Attributes:
        scenario, known: what was asked, of which aircraft.
        suites: the first is what the others are compared with.
        seed: of the first repetition.
        errors: case -> quantity -> errors (repetitions,), NaN where there is none.
        failures: identifications without a model.
        predictions: (manoeuvre, suite) -> what information predicts.
        of_flight: (manoeuvre, suite) -> errors of the best case from the flight without any noise: what is not chance;
            empty in turbulence.
        placed: best stations, if they were asked for.
        flights: how many flights were simulated.
        tally: by what.
    """

    scenario: CompareScenario
    known: Known
    suites: tuple[SensorSuite, ...]
    seed: int
    errors: Mapping[CaseKey, Mapping[Quantity, FloatArray]]
    failures: tuple[Failure, ...]
    predictions: Mapping[tuple[str, str], Prediction]
    of_flight: Mapping[tuple[str, str], Mapping[Quantity, float]]
    placed: Placed | None
    flights: int
    tally: Tally

    @property
    def name(self) -> str:
        """Names the results folder."""
        return self.scenario.name

    @property
    def manoeuvres(self) -> tuple[str, ...]:
        """Names of the inputs that are compared."""
        return tuple(m.name for m in self.scenario.manoeuvre if m.use == "identification")

    @cached_property
    def summaries(self) -> tuple[Summary, ...]:
        """One entry per case and quantity."""
        out = []
        for case, quantities in self.errors.items():
            for quantity, errors in quantities.items():
                found = errors[np.isfinite(errors)]
                signed = quantity.kind != "prediction" and found.size >= 2
                scatter = float(np.std(found, ddof=1)) if signed else None
                predicted, near = self._predicted(case, quantity), self._near(case, quantity)
                compared = near and case.estimator == BEST_CASE and found.size > 2
                out.append(
                    Summary(
                        case,
                        quantity,
                        found.size,
                        errors.size,
                        root_mean_square(found),
                        mean_interval(found) if signed else None,
                        scatter,
                        predicted,
                        _ratio_interval(scatter, predicted, found.size) if compared else None,
                        self._of_flight(case, quantity) if signed else None,
                        near,
                    )
                )
        return tuple(out)

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """One entry per suite but the first, input, estimator and quantity that both suites give.

        Errors of a mode can be compared only where both suites find it; where one of them misses it, how often is
        compared too.
        """
        out: list[Gain] = []
        for case, quantities in self.errors.items():
            base = case._replace(suite=self.suites[0].name)
            if case == base:
                continue
            for quantity, errors in quantities.items():
                before = self.errors.get(base, {}).get(quantity)
                if before is None:
                    continue
                both = np.isfinite(before) & np.isfinite(errors)
                differences = np.abs(before[both]) - np.abs(errors[both])
                first, this = (float(np.median(np.abs(e[both]))) if both.any() else np.nan for e in (before, errors))
                found = paired(differences, self.scenario.test)
                out.append(Gain(case, quantity, first, this, found, None, self._ratio(case, base, quantity)))
                if quantity.kind == "mode" and quantity.name.startswith(_WN) and not both.all():
                    lost = ~np.isfinite(before), ~np.isfinite(errors)
                    share = [100.0 * float(np.mean(m)) for m in lost]
                    missed = Quantity("missed", quantity.name.removeprefix(_WN))
                    out.append(Gain(case, missed, share[0], share[1], paired_misses(*lost), None, None))
        tested = [k for k, g in enumerate(out) if g.paired.p is not None]
        corrected = holm([out[k].paired.p or 0.0 for k in tested])
        for k, p in zip(tested, corrected, strict=True):
            out[k] = replace(out[k], p_holm=p)
        return tuple(out)

    @property
    def too_few(self) -> int | None:
        """The number of repetitions that the test needs to find anything, if there are fewer; else None."""
        needed = seeds_needed(len(self.gains), self.scenario.level)
        return needed if self.gains and self.scenario.test == "wilcoxon" and self.scenario.seeds < needed else None

    def _predicted(self, case: CaseKey, quantity: Quantity) -> float | None:
        prediction = self.predictions.get((case.manoeuvre, case.suite))
        return None if prediction is None or quantity.kind == "prediction" else prediction.of(quantity.name)

    def _of_flight(self, case: CaseKey, quantity: Quantity) -> float | None:
        error = self.of_flight.get((case.manoeuvre, case.suite), {}).get(quantity)
        return error if case.estimator == BEST_CASE and error is not None and np.isfinite(error) else None

    def _near(self, case: CaseKey, quantity: Quantity) -> bool:
        prediction = self.predictions.get((case.manoeuvre, case.suite))
        return quantity.kind != "prediction" and prediction is not None and prediction.near(quantity.name)

    def _ratio(self, case: CaseKey, base: CaseKey, quantity: Quantity) -> float | None:
        after, before = self._predicted(case, quantity), self._predicted(base, quantity)
        if after is None or before is None or not (np.isfinite(after) and np.isfinite(before)):
            return None
        return after / before

    @property
    def agreement(self) -> Agreement:
        """Compare the scatter of the best case with the predicted one.

        A sample standard deviation of n normal errors scatters as sqrt(chi2 / (n - 1)). Where the model is
        not linear in its parameters over the predicted errors, the bound says little (:mod:`.prediction`).
        """
        asked = [s for s in self.summaries if s.case.estimator == BEST_CASE and s.predicted is not None and s.found > 2]
        near = [(s.ratio, s.found) for s in asked if s.ratio is not None]
        ratios = [r.value for r, _ in near]
        corrected = holm([chance_of_scatter(r.value, n) for r, n in near])
        return Agreement(
            sum(r.low <= 1.0 <= r.high for r, _ in near),
            sum(p <= self.scenario.level for p in corrected),
            len(near),
            sum(not s.near for s in asked),
            tuple(np.quantile(ratios, [0.0, 0.5, 1.0]).tolist()) if ratios else (np.nan,) * 3,
        )


def _ratio_interval(scatter: float | None, predicted: float | None, found: int) -> Interval | None:
    """Return scatter over predicted with its 95 % interval; None where one of them is not known."""
    if scatter is None or predicted is None or not 0.0 < predicted < np.inf:
        return None
    low, high = scatter_interval(scatter, found)
    return Interval(scatter / predicted, low / predicted, high / predicted)
