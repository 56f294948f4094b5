"""Rates and tables of the draws with library forms, other forms, the true effect taken out, and nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from studies.blind.cases import STRATA, Case, seal
from studies.blind.parts import parts_said, parts_true
from studies.blind.score import NO_GAP, accusations, answer, drawn, judge, of_wrong_size
from studies.blind.sealed_draw import counted, rated

_RATIOS = {"elevator linkage ratio": "_de", "aileron linkage ratio": "_da", "rudder linkage ratio": "_dr"}


def in_part(case: Case, row: Mapping[str, Any]) -> bool:
    """Return whether something is named, and all of it acts where the hidden truth does."""
    names = answer(case, row)[1]
    return bool(names) and parts_said(names) <= parts_true(case)


def right(case: Case, row: Mapping[str, Any]) -> bool:
    """Return whether the answer is right: of a library without the true effect, silence or the part it acts in."""
    if not case.row.hides:
        return bool(row["outcome"] == "no gap")
    if case.row.taken_out:
        return row["outcome"] == "unexplained" or in_part(case, row)
    return judge(case, row).verdict == "right"


def flown_factor(case: Case, coefficient: str) -> float:
    """Return what a coefficient is times the believed one, as it flies: a linkage's ratio is one of its control's."""
    out = drawn(case, coefficient)
    for kind, sizes in zip(case.kinds, case.sizes, strict=True):
        if coefficient.endswith(_RATIOS.get(kind, "none")):
            out *= sizes["gain"]
    return out


def rates(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str, int, int]]:
    """Return (stratum, rate, count, of) of the rows."""
    out = []
    for stratum in dict.fromkeys(c.stratum for c in cases):
        of = [(c, rows[c.name]) for c in cases if c.stratum == stratum and c.name in rows]
        n = len(of)

        def said(*outcomes: str, of: Sequence[tuple[Case, Mapping[str, Any]]] = of) -> int:
            return sum(r["outcome"] in outcomes for _, r in of)

        parts, named = sum(in_part(c, r) for c, r in of), sum(bool(answer(c, r)[1]) for c, r in of)
        silent = sum(answer(c, r)[0] == NO_GAP for c, r in of)
        if not STRATA[stratum].hides:
            out.append((stratum, "false gap", n - said("no gap", "failed"), n))
        elif STRATA[stratum].taken_out:
            out.append((stratum, "unexplained or right part", sum(right(c, r) for c, r in of), n))
            out.append((stratum, "unexplained", said("unexplained"), n))
            out.append((stratum, "wrong part", named - parts, n))
            out.append((stratum, "no gap, and no coefficient is wrong", silent, n))
        else:
            verdicts = [judge(c, r).verdict for c, r in of]
            out.append((stratum, "right effect", verdicts.count("right"), n))
            out.append((stratum, "right or in the set", sum(v in ("right", "in set") for v in verdicts), n))
            out.append((stratum, "right part", parts, n))
            out.append((stratum, "wrong part", named - parts, n))
            out.append((stratum, "unexplained", said("unexplained"), n))
            out.append((stratum, "no gap, and no coefficient is wrong", silent, n))
        out.append((stratum, "failed", said("failed"), n))
        wrong = sum(of_wrong_size(c, r, flown_factor) for c, r in of)
        out.append((stratum, "a coefficient accused by a wrong size", wrong, n))
    return out


def page_of(words: Sequence[str], seed: int, cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page of a draw that is judged as that in roll and yaw: ``words`` first, then what the rows say."""
    out = [
        *words,
        "",
        "How answers are judged is said in the [draw in roll and yaw](../lateral/README.md).",
        "",
        f"Seed {seed}. SHA-256 of answers.json without its last line break: `{seal(tuple(cases))[1]}`.",
        "",
        *results(cases, rows),
    ]
    return "\n".join(out) + "\n"


def results(cases: Sequence[Case], rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the lines of a page that say what was run, its rates, accusations, and all that is not right."""
    run = [(c, rows[c.name]) for c in cases if c.name in rows]
    strata = dict.fromkeys(c.stratum for c in cases)
    out = [
        *counted(cases, run, {s: sum(c.stratum == s for c in cases) for s in strata}),
        *rated(rates(cases, rows), [r for _, r in run]),
    ]
    accused = [(c, r) for c, r in run if r["accused"]]
    if accused:
        out += [
            "",
            "Coefficients accused, with four of their errors, and what flew, as multiples of what is believed:",
            "",
        ]
        out += ["| case | hidden | outcome | accused | flown |", "|---|---|---|---|---|"]
        for c, r in accused:
            said = ", ".join(f"{p} {f:.3f} ± {4.0 * e:.3f}" for p, f, e, _ in accusations(r))
            flew = ", ".join(f"{p} {flown_factor(c, p):.3f}" for p, *_ in accusations(r))
            out.append(f"| {c.name} | {', '.join(c.kinds) or 'nothing'} | {r['outcome']} | {said} | {flew} |")
    missed = [(c, r) for c, r in run if not right(c, r)]
    if missed:
        out += ["", "Not right:", "", "| case | aircraft | hidden | outcome | said | came nearest |"]
        out.append("|---|---|---|---|---|---|")
        for c, r in missed:
            hidden = ", ".join(f"{k} ({_sizes(s)})" for k, s in zip(c.kinds, c.sizes, strict=True)) or "nothing"
            said = ", ".join(r["names"]) or r.get("why", "")
            out.append(f"| {c.name} | {c.aircraft} | {hidden} | {r['outcome']} | {said} | {r.get('best', '')} |")
    return out


def _sizes(sizes: Mapping[str, float]) -> str:
    return ", ".join(f"{n} {x:.3g}" for n, x in sizes.items())
