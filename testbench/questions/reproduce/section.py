"""The parts of a reproduction: sections with findings in words, printed numbers beside ours, tables and figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

from testbench.page.figure import COLOURS, DASHES, INK, MEASURED, QUIET, Curve, Panel, Plate, grid
from testbench.page.labels import number
from testbench.page.tables import Column, Table

if TYPE_CHECKING:
    from testbench.core.record import FloatArray


SAME = 0.10  # relative distance up to which a number agrees
FACTOR = 2.0  # ratio up to which a number agrees in kind

LAWS = (
    f"A number “agrees” if ours lies within {100 * SAME:.0f} % of the printed one, “agrees in kind” if within a factor "
    f"of {FACTOR:g}, else it “differs”. A statement “agrees” if the test that its row names is passed by what was "
    "computed, “agrees in kind” if a weaker test named there is, else it “differs”. “Cannot be compared” stands where "
    "the paper gives nothing to compare with, “taken over” where its number is a setting of our experiment and no "
    "result."
)
_NAMED = {"ink": INK, "measured": MEASURED, "quiet": QUIET}
Verdict = Literal["agrees", "agrees in kind", "differs", "cannot be compared", "taken over"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
Say = Callable[[str], None]


@dataclass(frozen=True)
class Comparison:
    """One thing that a paper prints beside what was found here.

    Attributes:
        what: the quantity or the claim.
        where: equation, table, figure or section of the paper.
        printed: as the paper has it.
        ours: as found here.
        verdict: how the two compare; "agrees in kind" where the sense agrees and the figure cannot.
        why: in plain words.
        headline: it is one of the results that the first screen lists.
    """

    what: str
    where: str
    printed: str
    ours: str
    verdict: Verdict
    why: str
    headline: bool = False


@dataclass(frozen=True)
class Equation:
    """One equation of a paper."""

    number: str  # as in the paper
    mathml: str  # the inside of a MathML element ``math``, which browsers show without any script or network
    text: str  # the same in one line of plain text
    words: str  # what it is, and where it is used here


@dataclass(frozen=True)
class Section:
    """One part of a paper's results, or one of its open questions."""

    name: str  # short, fit for a file name
    title: str  # what it is about
    findings: tuple[str, ...]  # sentences, the most important first
    comparisons: tuple[Comparison, ...] = ()  # printed beside ours
    # tables, plates: the data behind the findings; their names carry the section's, so that files do not collide
    tables: tuple[Table, ...] = ()
    plates: tuple[Plate, ...] = ()
    checks: tuple[Comparison, ...] = ()  # printed numbers beside those that follow from other printed numbers
    equations: tuple[Equation, ...] = ()  # of the paper, as this section uses or checks them
    # the finding in one sentence of 25 words at most, if it stands on the first screen; the section's first plate shows
    # it
    head: str = ""

    @property
    def heads(self) -> tuple[Table, ...]:
        """Printed beside ours, and the printed numbers against each other, as tables of the page."""
        out = []
        if self.comparisons:
            out.append(comparison_table(f"{self.name}_printed_and_ours", self.comparisons))
        if self.checks:
            out.append(check_table(f"{self.name}_checks", self.checks))
        return tuple(out)


@dataclass(frozen=True)
class Chapter:
    """One aircraft of the papers."""

    name: str
    title: str
    source: str
    sections: tuple[Section, ...]

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Every printed number beside ours."""
        return tuple(c for s in self.sections for c in s.comparisons)


def comparison_table(name: str, comparisons: Sequence[Comparison]) -> Table:
    """Return printed and own figures as one table."""
    return _table(name, "Printed and ours", "One row per number or statement of the paper.", "ours", comparisons)


def check_table(name: str, checks: Sequence[Comparison]) -> Table:
    """Return printed figures beside what other printed figures make of them."""
    caption = "No simulation: one row per number that follows from others."
    return _table(name, "The printed numbers against each other", caption, "from the others", checks)


def _table(name: str, title: str, caption: str, other: str, rows: Sequence[Comparison]) -> Table:
    heads = {"what": "what", "where": "where in the paper", "printed": "printed", "ours": other}
    columns = [Column(key, head) for key, head in (heads | {"verdict": "verdict", "why": "why"}).items()]
    return Table.of(name, title, caption, columns, rows, wide=True)


# --- figures ----------------------------------------------------------------------------------------------------------


def line(x: FloatArray, y: FloatArray, name: str, colour: int | str, **more: Any) -> Curve:
    """Return one curve or, not ``joined``, one set of signs.

    Args:
        x: points (n,).
        y: the same.
        name: of the legend; it looks the same in every panel.
        colour: number of the palette, or "ink", "measured" or "quiet".
        more: of :class:`testbench.page.figure.Curve`.
    """
    joined = more.pop("joined", True)
    numbered = isinstance(colour, int)
    look: dict[str, Any] = {"colour": COLOURS[int(colour) % 6] if numbered else _NAMED[str(colour)]}
    if joined and numbered:
        look["dash"] = DASHES[int(colour) % 6]
    if more.get("marker"):
        look |= {"size": 4.0 if joined else 4.5, "hollow": not joined and more["marker"] in "osD^v"}
    return Curve(x=x, y=y, name=name, joined=joined, **look | more)


def plate(
    name: str, title: str, caption: str, panels: Sequence[Panel], columns: int = 2, height_in: float = 1.7
) -> Plate:
    """Return a figure of ``panels``, row by row in so many columns, under one legend of all names."""
    return Plate(name, title, caption, grid([replace(p, tall_in=height_in) for p in panels], columns))


# --- verdicts ---------------------------------------------------------------------------------------------------------


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


class Written(NamedTuple):
    """How a number and ours are written: unit, decimals of both, and what follows ours."""

    unit: str
    printed: int = 2
    ours: int = 1
    note: str = ""

    def text(self, value: float, decimals: int) -> str:
        """Return a number with its unit, or "none"."""
        return f"{value:.{decimals}f} {self.unit}".strip().replace("-", "−") if math.isfinite(value) else "none"


def number_row(
    what: str, where: str, printed: float, ours: float, written: Written, why: Why, headline: bool = False
) -> Comparison:
    """Return a printed number beside ours, judged."""
    verdict = judge_number(printed, ours)
    left, right = written.text(printed, written.printed), written.text(ours, written.ours) + written.note
    return Comparison(what, where, left, right, verdict, why.of(verdict), headline)


def claim_row(
    what: str, where: str, printed: str, ours: str, verdict: Verdict, why: Why, headline: bool = True
) -> Comparison:
    """Return a printed statement beside what was found."""
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
