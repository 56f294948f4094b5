"""Score the blind test: what each case hid against what was said, and rates with their intervals."""

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from studies.blind.cases import Case
from studies.blind.kinds import KINDS

from testbench.questions.dataset.score import NO_GAP, UNEXPLAINED, verdict

# --- coefficients that an answer accuses -----------------------------------------------------------------------------


def drawn(case: Case, coefficient: str) -> float:
    """Return what a coefficient was drawn as, times the believed one."""
    return float(case.factors.get(coefficient, 1.0))


def accusations(row: Mapping[str, Any]) -> list[tuple[str, float, float, tuple[str, ...]]]:
    """Return coefficient, factor, standard error, and the effects that the data do not tell from it."""
    return [(name, f, e, tuple(more[0]) if more else ()) for name, f, e, *more in row.get("accused", ())]


def answer(case: Case, row: Mapping[str, Any]) -> tuple[str, list[str]]:
    """Return the outcome of a row and its names.

    "No gap, but a coefficient is wrong, or one of these effects" is a set of that coefficient and these. A coefficient
    that was drawn as far off is told rightly, whatever else is hidden: it is none of the names.
    """
    names = list(row["names"])
    if names or row["outcome"] != NO_GAP:
        return row["outcome"], names
    for name, f, e, rivals in accusations(row):
        if abs(f - drawn(case, name)) > 4.0 * e:
            names += [n for n in (name, *rivals) if n not in names]
    return "set" if names else NO_GAP, names


# --- one case, and rates of many --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Score:
    """One case and what was said of it.

    Attributes:
        verdict: "right", "in set", "one of two", "wrong", "wrong set", "none" or "unexplained".
        named: what was said: the names, or the outcome.
        row: the row of the case.
    """

    case: Case
    verdict: str
    named: str
    row: Mapping[str, Any]


def judge(case: Case, row: Mapping[str, Any]) -> Score:
    """Score one case: see :func:`testbench.questions.dataset.score.verdict`."""
    outcome, names = answer(case, row)
    said = outcome if outcome in (NO_GAP, UNEXPLAINED) else " | ".join(names)
    return Score(case, verdict(case.right, outcome, names), said, row)


FEWEST = 20  # cases, below which nothing is said of a bar


@dataclass(frozen=True)
class Rate:
    """A rate of the test against its bar."""

    name: str
    count: int
    of: int
    bar: float | None = None
    most: bool = False

    @property
    def value(self) -> float:
        """The rate; NaN of no cases."""
        return self.count / self.of if self.of else float("nan")

    @property
    def met(self) -> str:
        """Whether the observed rate keeps the bar: "yes", "no", "too few cases", or "" without a bar."""
        if self.bar is None:
            return ""
        if self.of < FEWEST:
            return "too few cases"
        return "yes" if (self.value <= self.bar if self.most else self.value >= self.bar) else "no"


def rates(scores: Sequence[Score], bars: bool = True) -> list[Rate]:
    """Return the rates that the test is judged by, and others that help to read them.

    Bars hold for the rich set of manoeuvres: without ``bars`` none is set, and rates of no cases are left out.
    """
    by: dict[str, list[Score]] = {}
    for s in scores:
        by.setdefault(s.case.stratum, []).append(s)

    def count(stratum: str, *verdicts: str) -> int:
        return sum(s.verdict in verdicts for s in by.get(stratum, ()))

    def n(stratum: str) -> int:
        return len(by.get(stratum, ()))

    out = []
    for stratum in ("library form", "other form", "turbulence"):
        air = stratum == "turbulence"
        out += [
            Rate(f"{stratum}: right name", count(stratum, "right"), n(stratum), 0.75 if air else 0.92),
            Rate(
                f"{stratum}: wrong name", count(stratum, "wrong", "wrong set"), n(stratum), 0.04 if air else 0.02, True
            ),
            Rate(f"{stratum}: no gap", count(stratum, "none"), n(stratum)),
            Rate(f"{stratum}: unexplained", count(stratum, "unexplained"), n(stratum)),
        ]
        told = count(stratum, "right", "in set", "wrong", "wrong set")
        out.append(
            Rate(
                f"{stratum}: right or in the set, where something is said",
                count(stratum, "right", "in set"),
                told,
                None if air else 0.97,
            )
        )
    for stratum, bar in (("nothing", 0.02), ("nothing in turbulence", 0.04)):
        out.append(Rate(f"{stratum}: false gap", n(stratum) - count(stratum, "none"), n(stratum), bar, True))
        out.append(Rate(f"{stratum}: false name", count(stratum, "wrong", "wrong set"), n(stratum)))
    for near in (True, False):
        cases = [s for s in by.get("unseen", ()) if s.case.near is near]
        wrong = sum(s.verdict in ("wrong", "wrong set") for s in cases)
        out.append(Rate(f"unseen, {'near' if near else 'far'}: false name", wrong, len(cases)))
    out.append(Rate("unseen: false name", count("unseen", "wrong", "wrong set"), n("unseen"), 0.04, True))
    out += [
        Rate("two at once: both found", count("two at once", "right"), n("two at once"), 0.85),
        Rate(
            "two at once: no false name",
            n("two at once") - count("two at once", "wrong", "wrong set"),
            n("two at once"),
            0.95,
        ),
        Rate(
            "below detectability: wrong name",
            count("below detectability", "wrong", "wrong set"),
            n("below detectability"),
            0.02,
            True,
        ),
        Rate("inseparable: wrong name", count("inseparable", "wrong", "wrong set"), n("inseparable"), 0.02, True),
    ]
    without = [s.row["without"] for s in scores if s.row.get("without") and s.row["without"]["outcome"] != "failed"]
    out.append(
        Rate(
            "true effect taken out of the library: false name",
            sum(bool(w["names"]) for w in without),
            len(without),
            0.04,
            True,
        )
    )
    return out if bars else [replace(r, bar=None) for r in out if r.of]


@dataclass(frozen=True)
class ByEffect:
    """What was said where one effect was hidden: verdicts, and the median magnitude of the sizes' relative errors.

    ``held`` is False where the library holds no such effect: there every name is wrong.
    """

    hidden: str
    turbulent: bool
    held: bool
    verdicts: Counter[str]
    size_error: float | None

    @property
    def cases(self) -> int:
        """How many there are."""
        return self.verdicts.total()

    @property
    def wrong(self) -> int:
        """Wrong names and sets without the right one."""
        return self.verdicts["wrong"] + self.verdicts["wrong set"]


def by_effect(scores: Sequence[Score]) -> list[ByEffect]:
    """Return one line for each kind of truth that is hidden alone, not too small to be seen, by name and air."""
    strata = ("library form", "other form", "unseen", "turbulence")
    alone = [s for s in scores if s.case.stratum in strata and len(s.case.kinds) == 1]
    errors = {name: abs((x - true) / true) for name, _, true, x, _ in sizes(alone)}
    out = []
    for kind, turbulent in sorted({(s.case.kinds[0], s.case.turbulence_rms_m_s > 0.0) for s in alone}):
        own = [s for s in alone if s.case.kinds[0] == kind and (s.case.turbulence_rms_m_s > 0.0) is turbulent]
        compared = [errors[s.case.name] for s in own if s.case.name in errors]
        median = statistics.median(compared) if compared else None
        held = KINDS[kind].form != "unseen"
        out.append(ByEffect(kind, turbulent, held, Counter(s.verdict for s in own), median))
    return out


def set_size(scores: Sequence[Score]) -> float:
    """Return the mean number of names where any is given in still air and one library effect flies."""
    sizes = [len(s.row["names"]) for s in scores if s.case.stratum in ("library form", "other form") and s.row["names"]]
    return sum(sizes) / len(sizes) if sizes else float("nan")


def removed(scores: Sequence[Score]) -> list[float]:
    """Return the shares of the held-out excess removed where the name is right, in still air."""
    return sorted(
        s.row["removed"]
        for s in scores
        if s.verdict == "right" and s.row["removed"] is not None and s.case.turbulence_rms_m_s == 0.0
    )


def sizes(scores: Sequence[Score]) -> list[tuple[str, str, float, float, float]]:
    """Return (case, kind, true size, estimate, standard error) where one effect is named rightly and sizes compare."""
    out = []
    for s in scores:
        if s.verdict != "right" or len(s.case.kinds) != 1:
            continue
        pair = KINDS[s.case.kinds[0]].size
        if pair is not None and pair[1] in s.row["values"]:
            own, parameter = pair
            true = float(s.case.sizes[0][own])
            out.append((s.case.name, s.case.kinds[0], true, s.row["values"][parameter], s.row["errors"][parameter]))
    return out
