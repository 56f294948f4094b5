"""Tables of the blind test: confusion, rates with Wilson intervals, sizes, and a page that reads them out."""

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scipy.stats import chi2
from studies.blind.cases import COUNTS, SHORT, WITHOUT, Case
from studies.blind.parts import called
from studies.blind.score import FEWEST, ByEffect, Rate, Score, by_effect, judge, rates, removed, set_size, sizes
from tables import write_rows

from testbench.core.proportion import proportion_interval

_NOISE = 1e-3  # probability below which what a name leaves is told from noise
_CASES = (
    "case", "manoeuvres", "aircraft", "hidden", "right", "verdict", "said", "best", "share", "runner_up", "removed",
    "cpu_s",
)  # fmt: skip
_CONFUSION = ("manoeuvres", "hidden", "said", "cases")
_EFFECTS = (
    "hidden", "in_library", "manoeuvres", "air", "cases", "right", "right_low", "right_high", "in_set", "wrong",
    "wrong_low", "wrong_high", "no_gap", "unexplained", "size_error_median",
)  # fmt: skip
_RATES = ("manoeuvres", "rate", "count", "of", "value", "wilson_low", "wilson_high", "bar", "met")
_WITHOUT = ("case", "hidden", "taken_out", "outcome", "said", "chi2_left", "samples")
_PARTS = ("call", "right_part", "part_low", "part_high", "right_effect", "cases")
_SIZES = ("case", "manoeuvres", "hidden", "true", "estimate", "standard_error", "relative_error")


def write_report(
    folder: Path, cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]], digest: str, seed: int
) -> dict[str, tuple[int, int, int]]:
    """Write the tables of the cases that have a row, and README.md; return the counts of calls, see :func:`called`.

    cases.csv, confusion.csv, effects.csv, parts.csv, rates.csv, sizes.csv, without.csv.
    """
    failed = [n for n, r in rows.items() if r["outcome"] == "failed"]
    flown = [c for c in cases if c.name in rows and c.name not in failed]
    six = [judge(c, {**rows[c.name], "without": rows.get(c.name + WITHOUT)}) for c in flown]
    again = [c for c in cases if c.name + SHORT in rows and c.name + SHORT not in failed]
    two = [judge(c, rows[c.name + SHORT]) for c in again]
    sets = {"six": six, "two": two}
    scored = [(n, s) for n, scores in sets.items() for s in scores]
    effects = [(n, e) for n, scores in sets.items() for e in by_effect(scores)]
    table = Counter((n, _hidden(s), s.named) for n, s in scored if not s.case.turbulence_rms_m_s)
    found = [("six", r) for r in rates(six)] + [("two", r) for r in rates(two, bars=False)]
    compared = [(n, *row) for n, scores in sets.items() for row in sizes(scores)]
    write_rows(folder / "cases.csv", _CASES, (_case(n, s) for n, s in scored))
    write_rows(folder / "confusion.csv", _CONFUSION, ((*k, c) for k, c in sorted(table.items())))
    write_rows(folder / "effects.csv", _EFFECTS, (_effect(n, e) for n, e in effects))
    calls = called(cases, rows)
    write_rows(folder / "parts.csv", _PARTS, ((c, p, *_interval(p, n), e, n) for c, (p, e, n) in calls.items()))
    write_rows(folder / "rates.csv", _RATES, (_rate(n, r) for n, r in found))
    write_rows(folder / "sizes.csv", _SIZES, (_size(*row) for row in compared))
    write_rows(folder / "without.csv", _WITHOUT, (_without(s) for s in six if _flew_without(s)))
    (folder / "README.md").write_text(_page(six, two, cases, failed, digest, seed, calls), encoding="utf-8")
    return calls


def _case(manoeuvres: str, s: Score) -> tuple[object, ...]:
    hidden, right = " + ".join(s.case.kinds), " + ".join("/".join(r) for r in s.case.right)
    said = s.verdict, s.named, s.row["best"], _number(s.row["share"]), s.row["runner_up"], _number(s.row["removed"])
    return s.case.name, manoeuvres, s.case.aircraft, hidden, right, *said, f"{s.row['seconds']:.1f}"


def _flew_without(s: Score) -> bool:
    return bool(s.row["without"]) and s.row["without"]["outcome"] != "failed"


def _without(s: Score) -> tuple[object, ...]:
    row = s.row["without"]
    out = " + ".join("/".join(r) for r in s.case.right)
    left = f"{row['chi2_left']:.0f}", row["samples"]
    return s.case.name, " + ".join(s.case.kinds), out, row["outcome"], " or ".join(row["names"]), *left


def _effect(manoeuvres: str, e: ByEffect) -> tuple[object, ...]:
    air, right = "turbulence" if e.turbulent else "still", e.verdicts["right"]
    wrong = e.verdicts["in set"], e.wrong, *_interval(e.wrong, e.cases)
    nothing = e.verdicts["none"], e.verdicts["unexplained"]
    sure = right, *_interval(right, e.cases)
    return e.hidden, "yes" if e.held else "no", manoeuvres, air, e.cases, *sure, *wrong, *nothing, _number(e.size_error)


def _rate(manoeuvres: str, r: Rate) -> tuple[object, ...]:
    bar = "" if r.bar is None else f"{'<=' if r.most else '>='} {r.bar:g}"
    value = _number(r.value if r.of else None)
    return manoeuvres, r.name, r.count, r.of, value, *_interval(r.count, r.of), bar, r.met


def _size(manoeuvres: str, case: str, hidden: str, true: float, x: float, error: float) -> tuple[object, ...]:
    return case, manoeuvres, hidden, f"{true:.5g}", f"{x:.5g}", f"{error:.2g}", f"{(x - true) / abs(true):+.3f}"


def _hidden(score: Score) -> str:
    kinds = " + ".join(score.case.kinds) or "nothing"
    return f"{kinds} (tiny)" if score.case.stratum in ("below detectability", "inseparable") else kinds


def _page(
    six: Sequence[Score],
    two: Sequence[Score],
    cases: Sequence[Case],
    failed: Sequence[str],
    digest: str,
    seed: int,
    calls: Mapping[str, tuple[int, int, int]],
) -> str:
    counts = Counter(s.case.stratum for s in six)
    cpu = [s.row["seconds"] for s in six]
    shares, compared = removed(six), sizes(six)
    lines = [
        "# Blind test of the gap workflow",
        "",
        "Made by `make blind-test` (`python -m studies.blind`, which resumes where it stopped; `--report` writes "
        "this page anew). Hidden truths are drawn from one seed and flown by code of their own "
        "(`tests/studies/blind/truths.py`), with every coefficient of the belief off by its prior; the workflow "
        "gets records of six manoeuvres, the believed aircraft and the believed sensors. The hash of the answers was "
        "written before the first case was named.",
        "",
        f"Seed {seed}. SHA-256 of answers.json without its last line break: `{digest}`.",
        "",
        f"{len(six)} of {len(cases)} cases have been run"
        + (f"; failed: {', '.join(failed)}" if failed else "")
        + f". Intervals are Wilson's, 95 %. Of fewer than {FEWEST} cases nothing is said of a bar, and a rate that "
        "keeps its bar is shown to keep it only where the interval does, too.",
        "",
        "| stratum | run | planned |",
        "|---|---|---|",
        *(f"| {name} | {counts.get(name, 0)} | {n} |" for name, n in COUNTS.items()),
        "",
        "| rate | cases | value | interval | bar | met |",
        "|---|---|---|---|---|---|",
        *(_line(r, bars=True) for r in rates(six)),
        "",
        f"Mean number of names where any is given: {set_size(six):.2f} (bar ≤ 1.3).",
        "",
        f"Share of the held-out excess removed where the name is right: median "
        f"{100 * statistics.median(shares):.1f} % of {len(shares)} cases (bar ≥ 90 %)."
        if shares
        else "No right name yet, hence no share of the held-out excess removed.",
        "",
        f"Size recovered, relative error: median magnitude "
        f"{100 * statistics.median(abs((x - t) / t) for _, _, t, x, _ in compared):.1f} % of {len(compared)} cases."
        if compared
        else "No sizes to compare yet.",
        "",
        f"Processor time of a case: median {statistics.median(cpu):.1f} s, largest {max(cpu):.1f} s, in one process; "
        "the bar of 40 s on the clock is for two cores: `make benchmarks`."
        if cpu
        else "",
        "",
        "## Two manoeuvres",
        "",
        "Cases named once more from a 3-2-1-1 and elevator doublets of two sizes alone, and judged on the same held-out"
        " flights. The bars are for six.",
        "",
        "| rate | cases | value | interval |",
        "|---|---|---|---|",
        *(_line(r, bars=False) for r in rates(two, bars=False)),
        "",
        *_names_without(six),
        "## Part",
        "",
        "An effect acts in a part of the aircraft (testbench/questions/gap/parts.py). A call had the right part if the "
        "hidden truth acts in every part that was called, of a set in one of them. Cases of six and of two manoeuvres "
        "and those without the true effect in the library count alike. Where nothing is named, the nearest effect says "
        "little of the part, and no part is called.",
        "",
        "| call | right part | interval | right effect |",
        "|---|---|---|---|",
        *(_call(name, *counts) for name, counts in calls.items()),
        "",
        "## By effect",
        "",
        "One effect hidden: right names of all cases, and wrong ones; of those that the library does not hold, how many"
        " got a name. `effects.csv` has intervals, sets and sizes.",
        "",
        "| hidden | six manoeuvres | in turbulence | two manoeuvres |",
        "|---|---|---|---|",
        *_by_effect(six, two),
        "",
        "`cases.csv`: every case; `confusion.csv`: what was hidden against what was said, in still air; `effects.csv`, "
        "`parts.csv`, `rates.csv`, `sizes.csv`, `without.csv`: the tables above; `rows.jsonl`: all that the workflow "
        "said. `earlier_draws.csv`: what the draws before this one gave; it is kept by hand.",
        "",
    ]
    return "\n".join(lines)


def _names_without(six: Sequence[Score]) -> list[str]:
    named = [s for s in six if _flew_without(s) and s.row["without"]["names"]]
    if not named:
        return []
    noise = [chi2.sf(s.row["without"]["chi2_left"], s.row["without"]["samples"]) > _NOISE for s in named]
    return [
        "## Names where the true effect is not in the library",
        "",
        f"Of the {len(named)} that were given, {sum(noise)} leave nothing that is told from noise (chi-square, "
        f"probability {_NOISE:g}): these manoeuvres hold nothing against them.",
        "",
        "| hidden, and taken out | said | leaves noise |",
        "|---|---|---|",
        *(
            f"| {' + '.join(s.case.kinds)} | {' or '.join(s.row['without']['names'])} | {'yes' if n else 'no'} |"
            for s, n in zip(named, noise, strict=True)
        ),
        "",
    ]


def _call(name: str, part: int, effect: int, cases: int) -> str:
    low, high = proportion_interval(part, cases)
    called = "nothing, nearest effect" if name == "unexplained" else name
    return f"| {called} | {part} of {cases} | {100 * low:.0f} to {100 * high:.0f} % | {effect} of {cases} |"


def _line(rate: Rate, bars: bool) -> str:
    low, high = proportion_interval(rate.count, rate.of)
    value = f"{100 * rate.value:.0f} %" if rate.of else "not run"
    line = f"| {rate.name} | {rate.count} of {rate.of} | {value} | {100 * low:.0f} to {100 * high:.0f} % |"
    if not bars:
        return line
    bar = "" if rate.bar is None else f"{'≤' if rate.most else '≥'} {100 * rate.bar:g} %"
    return f"{line} {bar} | {rate.met} |"


def _by_effect(six: Sequence[Score], two: Sequence[Score]) -> list[str]:
    told = {}
    for column, scores in enumerate((six, two)):
        for e in by_effect(scores):
            text = f"{e.verdicts['right']} of {e.cases}" + (f", {e.wrong} wrong" if e.wrong else "")
            if not e.held:
                text = f"{e.wrong} of {e.cases} named"
            told[e.hidden, "turbulence" if e.turbulent else ("six", "two")[column]] = text
    kinds = sorted({kind for kind, _ in told})
    return [f"| {k} | " + " | ".join(told.get((k, c), "") for c in ("six", "turbulence", "two")) + " |" for k in kinds]


def _interval(k: int, n: int) -> tuple[str, str]:
    low, high = proportion_interval(k, n)
    return f"{low:.3f}", f"{high:.3f}"


def _number(x: float | None) -> str:
    return "" if x is None else f"{x:.3f}"
