"""Sequential stopping: the campaign ends with the first block of runs after which a mean is known well enough."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from testbench.core.errors import CampaignError, nearest
from testbench.questions.campaign.scenario import Stop

if TYPE_CHECKING:
    from testbench.questions.campaign.store import Store


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
