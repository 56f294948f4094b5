"""How verdicts are reached: from what was computed, by laws that the page states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from testbench.page.labels import number
from testbench.questions.reproduce.section import VERDICTS, Comparison, Verdict

SAME = 0.10
"""Relative distance up to which a number agrees."""
FACTOR = 2.0
"""Ratio up to which a number agrees in kind."""

LAWS = (
    f"A number “agrees” if ours lies within {100 * SAME:.0f} % of the printed one, “agrees in kind” if within a factor "
    f"of {FACTOR:g}, else it “differs”. A statement “agrees” if the test that its row names is passed by what was "
    "computed, “agrees in kind” if a weaker test named there is, else it “differs”. “Cannot be compared” stands where "
    "the paper gives nothing to compare with, “taken over” where its number is a setting of our experiment and no "
    "result."
)


class Why(NamedTuple):
    """The reason to give, by verdict."""

    agrees: str
    in_kind: str
    differs: str

    def of(self, verdict: Verdict) -> str:
        """Return the reason for ``verdict``."""
        return {"agrees": self.agrees, "agrees in kind": self.in_kind, "differs": self.differs}[verdict]


def judge_number(printed: float, ours: float) -> Verdict:
    """Return the verdict on a number: |ours / printed - 1| <= SAME, then 1 / FACTOR <= ours / printed <= FACTOR."""
    if not (math.isfinite(printed) and math.isfinite(ours)):
        return "differs"
    if math.isclose(printed, ours, rel_tol=1e-9, abs_tol=1e-12):
        return "agrees"
    if printed == 0.0 or printed * ours <= 0.0:
        return "differs"
    ratio = ours / printed
    if abs(ratio - 1.0) <= SAME:
        return "agrees"
    return "agrees in kind" if 1.0 / FACTOR <= ratio <= FACTOR else "differs"


def judge_claim(holds: bool, partly: bool = False) -> Verdict:
    """Return the verdict on a statement: its test passed, a weaker one passed, or none."""
    return "agrees" if holds else "agrees in kind" if partly else "differs"


def number_row(
    what: str,
    where: str,
    printed: float,
    ours: float,
    unit: str,
    why: Why,
    decimals: tuple[int, int] = (2, 1),
    note: str = "",
    headline: bool = False,
) -> Comparison:
    """Return a printed number beside ours, judged; ``decimals`` of both, ``note`` follows ours."""
    verdict = judge_number(printed, ours)
    left = f"{printed:.{decimals[0]}f} {unit}".strip().replace("-", "−")
    right = f"{ours:.{decimals[1]}f} {unit}".strip().replace("-", "−") if math.isfinite(ours) else "none"
    return Comparison(what, where, left, right + note, verdict, why.of(verdict), headline)


def claim_row(
    what: str,
    where: str,
    printed: str,
    ours: str,
    holds: bool,
    why: Why,
    partly: bool = False,
    headline: bool = True,
) -> Comparison:
    """Return a printed statement beside what was found, judged by ``holds`` and ``partly``."""
    verdict = judge_claim(holds, partly)
    return Comparison(what, where, printed, ours, verdict, why.of(verdict), headline)


def taken_over(
    what: str, where: str, printed: str, ours: str, note: str = "A setting of the experiment."
) -> Comparison:
    """Return a number that the experiment takes from the paper."""
    return Comparison(what, where, printed, ours, "taken over", note)


def not_printed(what: str, where: str, printed: str, ours: str, why: str, headline: bool = False) -> Comparison:
    """Return what was found where the paper gives nothing to compare with."""
    return Comparison(what, where, printed, ours, "cannot be compared", why, headline)


def tally(comparisons: tuple[Comparison, ...]) -> str:
    """Return "3 agree, 2 agree in kind, 1 differs" over the verdicts that judge, in the order of VERDICTS."""
    counts = {v: sum(c.verdict == v for c in comparisons) for v in VERDICTS}
    return ", ".join(f"{n} {plural(v, n)}" for v, n in counts.items() if n)


def plural(verdict: str, n: int) -> str:
    """Return the verdict as the predicate of ``n`` things."""
    many: Mapping[str, str] = {"agrees": "agree", "agrees in kind": "agree in kind", "differs": "differ"}
    return verdict if n == 1 else many.get(verdict, verdict)


def span(values: list[float], unit: str = "", decimals: int | None = None) -> str:
    """Return "3 to 5 %", or one value where both ends read the same."""
    texts = [number(v) if decimals is None else f"{v:.{decimals}f}" for v in (min(values), max(values))]
    body = texts[0] if texts[0] == texts[1] else f"{texts[0]} to {texts[1]}"
    return f"{body} {unit}".strip().replace("-", "−")
