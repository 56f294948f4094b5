"""Blind test in roll and yaw: ``python -m studies.blind.lateral``. Resumes, as the blind test does.

Truths are drawn from a seed of their own, sealed, and flown rigid with sensors of all axes. What names them is given
the library and the further effects that are sought where the search points to the path of their control.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from studies.blind.accused import accusations, answer, of_wrong_size
from studies.blind.lateral_run import name_lateral
from studies.blind.parts import parts_said, parts_true
from studies.blind.score import judge
from studies.blind.sealed_draw import Draw, counted, rated

from testbench.questions.gap.sealed.cases import seal
from testbench.questions.gap.sealed.lateral_cases import NOTHING, STRATA, TAKEN_OUT, LateralCase, draw, opened
from testbench.questions.gap.sealed.lateral_flights import manoeuvres
from testbench.questions.gap.sealed.verdict import NO_GAP

SEED = 20270217


def run_case(case: LateralCase) -> dict[str, Any]:
    """Return what the workflow says of one case, as JSON values."""
    return {
        "case": case.name,
        **name_lateral(case.aircraft, case.fly("rich"), case.fly("held_out"), case.without),
    }


def in_part(case: LateralCase, row: Mapping[str, Any]) -> bool:
    """Return whether something is named, and all of it acts where the hidden truth does."""
    names = answer(case, row)[1]
    return bool(names) and parts_said(names) <= parts_true(case)


def right(case: LateralCase, row: Mapping[str, Any]) -> bool:
    """Return whether the answer is right: of a library without the true effect, silence or the part it acts in."""
    if case.stratum == NOTHING:
        return bool(row["outcome"] == "no gap")
    if case.stratum == TAKEN_OUT:
        return row["outcome"] == "unexplained" or in_part(case, row)
    return judge(case, row).verdict == "right"


def flown_factor(case: LateralCase, coefficient: str) -> float:
    """Return what a coefficient is times the believed one, as it flies: a linkage's ratio is one of its control's."""
    out = float(case.factors.get(coefficient, 1.0))
    for kind, sizes in zip(case.kinds, case.sizes, strict=True):
        if coefficient.endswith({"aileron linkage ratio": "_da", "rudder linkage ratio": "_dr"}.get(kind, "none")):
            out *= sizes["gain"]
    return out


def rates(cases: Sequence[LateralCase], rows: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str, int, int]]:
    """Return (stratum, rate, count, of) of the rows."""
    out = []
    for stratum in STRATA:
        of = [(c, rows[c.name]) for c in cases if c.stratum == stratum and c.name in rows]
        n = len(of)

        def said(*outcomes: str, of: Sequence[tuple[LateralCase, Mapping[str, Any]]] = of) -> int:
            return sum(r["outcome"] in outcomes for _, r in of)

        parts, named = sum(in_part(c, r) for c, r in of), sum(bool(answer(c, r)[1]) for c, r in of)
        silent = sum(answer(c, r)[0] == NO_GAP for c, r in of)
        if stratum == NOTHING:
            out.append((stratum, "false gap", n - said("no gap", "failed"), n))
        elif stratum == TAKEN_OUT:
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


def page(cases: Sequence[LateralCase], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what the rows say, in words and tables: how many of the planned cases were run comes first."""
    run = [(c, rows[c.name]) for c in cases if c.name in rows]
    flown, held = (", ".join(manoeuvres("eolo", which)[1]) for which in ("rich", "held_out"))
    out = [
        "# Blind test in roll and yaw",
        "",
        "Made by `python -m studies.blind.lateral`, which resumes where it stopped; `--minutes 0` writes this page "
        "anew. Hidden truths are drawn from one seed and flown by code of their own "
        "(`testbench/questions/gap/hidden/lateral.py`), with every longitudinal and lateral coefficient of the belief "
        "off by its prior. Eolo and taurus fly rigid; the suite is that of all axes at 50 Hz, with commands and no "
        "surfaces. The hash of the answers was written before the first case was named.",
        "",
        f"Used to name: {flown}. Held out: {held}.",
        "",
        "Where the true effect is taken out, every name that would be right is, with those that contain it, of the "
        "effects that are sought only where the search points to a path, too: right is then silence, or another effect "
        "of the part in which the truth acts. A term of a coefficient that no library holds, as the open set proposes, "
        "is no right effect; it acts in the paths of the controls in it, or else in wing or fin.",
        "",
        "No gap, but a coefficient that is wrong, or one of the effects that these flights do not tell from it: that "
        "answer is a set of the coefficient and those effects. A coefficient that was drawn as far off as that is "
        "told rightly, whatever else is hidden, and counts for nothing.",
        "",
        "The first draw, seed 20270214, was opened after 30 cases: library form 8 of 8 right, other form 5 of 8, true "
        "effect taken out 6 of 7 silent or in the right part, no false gap in 7. Two servos of two stages were named "
        "by a pair of effects or a term, as the library held no servo of second order for aileron and rudder; such "
        "forms are now sought where a search points to their path. Uneven lift was called a lost wing, which counted "
        "as another part, structure; a lost wing is now looked for at the wing.",
        "",
        "The second draw, seed 20270215, was opened after 16 cases: library form 4 of 4 right, other form 1 of 4, true "
        "effect taken out 4 of 4 silent or in the right part, no false gap in 4. A bank hold of little authority and a "
        "load under one wing were unexplained; both are effects of the library now, and count as library forms. A "
        "rudder linkage of ratio 1.53 that loses with deflection was sized 1.53 and left unexplained, as a rate limit "
        "beside it explained what its form does not.",
        "",
        "The third draw, seed 20270216, was opened after 81 cases: library form 20 of 21 right, other form 11 of 20, "
        "true effect taken out 18 of 20 silent or in the right part, no false gap in 20; median 27 s, 95 % below "
        "143 s. A link of aileron or rudder that scatters, linkages that lose with deflection, dampers with a filter "
        "and a soft slew limit (all unexplained), and a springy interconnect (called a cross sensitivity) are named "
        "now.",
        "",
        f"Seed {SEED}, the fourth draw. SHA-256 of answers.json without its last line break: "
        f"`{seal(tuple(cases))[1]}`.",
        "",
        *counted(cases, run, {s: sum(c.stratum == s for c in cases) for s in STRATA}),
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
    return "\n".join(out) + "\n"


def _sizes(sizes: Mapping[str, float]) -> str:
    return ", ".join(f"{n} {x:.3g}" for n, x in sizes.items())


DRAW = Draw("lateral", SEED, lambda: draw(SEED, STRATA), opened, run_case, rates, page)

if __name__ == "__main__":
    raise SystemExit(DRAW.run())
