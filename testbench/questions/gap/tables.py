"""Tables of the gap workflow: the ranking, forces, controls and re-tuning; and what planned manoeuvres could show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.labels import symbol
from testbench.page.tables import Column, Table
from testbench.questions.gap.criteria import FALSE_ALARM
from testbench.questions.gap.evidence.forces import follows
from testbench.questions.gap.plan import ALIKE, NEEDED

if TYPE_CHECKING:
    from testbench.questions.gap.ask import GapResult
    from testbench.questions.gap.controls import Controls
    from testbench.questions.gap.plan import GapPlan

_MOST_PAIRS = 40


def gap_tables(result: GapResult) -> list[Table]:
    """Return the ranking of the effects, the coefficients re-tuned beside the best one, and before and after."""
    naming = result.finding.naming
    ranking = Table(
        "ranking",
        "The library of effects, ranked",
        f"Gain: fall of chi-square ({naming.samples} samples) against the believed model with its uncertain "
        f"coefficients re-tuned ({naming.chi2_tuned:.0f}; {naming.chi2_believed:.0f} before re-tuning). Significant: "
        f"above what noise reaches with probability {FALSE_ALARM:g} for the whole library, in still air. Share: of the "
        "excess over noise.",
        (
            Column("effect", "effect"),
            Column("size", "size, with standard error"),
            Column("gain", "gain", decimals=1),
            Column("threshold", "threshold", decimals=1),
            Column("share", "share explained", "%", decimals=1),
            Column("verdict", "verdict"),
            Column("separated", "what separates it"),
        ),
        tuple(
            (
                f.effect.title,
                f.size if f.gain > 0.0 else "not pursued",
                f.gain,
                f.threshold,
                100.0 * f.share,
                "named" if f.effect.name in naming.names else "significant" if f.significant else "as noise",
                f.effect.separated_by,
            )
            for f in naming.ranking
        ),
        wide=True,
    )
    out = [ranking]
    if result.finding.forces:
        shares = follows(result.finding.forces)
        quantities = list(dict.fromkeys(q for row in shares.values() for q in row))
        out.append(
            Table(
                "equation_errors",
                "What the forces and moments without a cause follow",
                "Share of the energy of each equation error, all manoeuvres together, that is in proportion to one "
                "quantity alone; quantities move together, so that shares do not add up.",
                (
                    Column("coefficient", "error of"),
                    *(Column(q, "dα/dt" if q == "alphadot" else symbol(q), "%", decimals=0) for q in quantities),
                ),
                tuple((c, *(100.0 * row.get(q, 0.0) for q in quantities)) for c, row in shares.items()),
            )
        )
    if result.finding.controls is not None:
        out.append(_control_table(result.finding.controls))
    if result.finding.changed:
        best = naming.best
        out.append(
            Table(
                "tuning",
                "Coefficients re-tuned" + (" together with the effect" if best else ""),
                "Factors on the believed coefficients"
                + ("; far from 1 means that the effect is not the whole story." if best else "."),
                (Column("coefficient", "coefficient"), Column("factor", "factor", decimals=3)),
                tuple((best.nuisances if best else naming.nuisances).items()),
            )
        )
        for k, shrink in enumerate(result.finding.shrink, 1):
            rows = zip(result.finding.believed.outputs, shrink.energy_before, shrink.energy_after, strict=True)
            out.append(
                Table(
                    f"held_out_{k}",
                    f"Mean squared residual on the held-out manoeuvre: {shrink.manoeuvre}",
                    "In units of the noise: 1 is the noise floor. Used neither to name nor to fit.",
                    (
                        Column("output", "output"),
                        Column("before", "before", decimals=3),
                        Column("after", "after", decimals=3),
                    ),
                    tuple((symbol(o), float(b), float(a)) for o, b, a in rows),
                )
            )
    return out


def _control_table(controls: Controls) -> Table:
    said = {"no gap": "no gap, which is right", "not flown": "could not be flown"}
    return Table(
        "controls",
        "Control flights without any effect",
        "The believed aircraft, coefficients drawn from their priors, through the same commands and air, measured with "
        "the same sensors and searched in the same way. Gain: largest fall of chi-square by any effect.",
        (
            Column("number", "flight"),
            Column("outcome", "what was said"),
            Column("gain", "gain", decimals=1),
            Column("chi2", "chi-square, re-tuned", decimals=0),
        ),
        (
            *((str(c.number), said.get(c.outcome, c.outcome), c.gain, c.chi2) for c in controls.flights),
            ("measured", "", controls.gain, controls.chi2),
        ),
    )


def plan_tables(plan: GapPlan) -> list[Table]:
    """Return what could be added, what would be confused, and how well each effect would show."""
    found = plan.planned
    confused = found.confused()
    shown = confused[:_MOST_PAIRS]
    more = f" The {_MOST_PAIRS} closest of {len(confused)} pairs." if len(confused) > _MOST_PAIRS else ""
    seen = zip(found.effects, found.noncentrality, strict=True)
    out = [
        Table(
            "additions",
            "What one more manoeuvre would change",
            "Best first. Seen: enough to be found at the usual size. Told apart: seen, and not to be taken for any "
            "other effect. Confusions: ordered pairs of which the first is seen and may be taken for the second."
            + "".join(f" Not flown: {words} ({why})." for words, why in plan.skipped.items()),
            (
                Column("manoeuvre", "manoeuvre"),
                Column("seen", "effects seen"),
                Column("nameable", "told apart"),
                Column("confused", "confusions"),
            ),
            tuple(
                (words, len(i.effects) - len(i.unseen), len(i.nameable), i.inseparable)
                for words, i in (("as planned", found), *((a.words, a.with_it) for a in plan.additions))
            ),
            wide=True,
        ),
        Table(
            "confused",
            "What would be taken for what",
            f"Told apart: noncentrality of the test between the two, which needs {NEEDED:.0f} to name the right one "
            f"with a probability of 0.9 at a false name in 1000. Pairs alike by more than {100 * ALIKE:.0f} % are "
            "listed even where that is reached: there the form of the effect decides, and no form is quite right."
            + more,
            (
                Column("effect", "effect"),
                Column("other", "taken for"),
                Column("share", "alike", "%", decimals=1),
                Column("left", "told apart", digits=3),
                Column("separated", "what separates the first"),
            ),
            tuple((a.title, b.title, 100.0 * share, left, a.separated_by) for a, b, share, left in shown),
            wide=True,
        ),
        Table(
            "visible",
            "How well each effect would show",
            f"At its usual size, in multiples of which the smallest to be found is given (noncentrality {NEEDED:.0f}, "
            "uncertain coefficients re-tuned).",
            (
                Column("effect", "effect"),
                Column("size", "usual size"),
                Column("noncentrality", "noncentrality", digits=3),
                Column("smallest", "smallest to be found", "of usual", digits=2),
            ),
            tuple(
                (
                    e.title,
                    ", ".join(
                        f"{p.name} = {p.starts[0]:g}" + (f" {p.unit}" if p.unit != "1" else "") for p in e.parameters
                    ),
                    float(n),
                    float(np.sqrt(NEEDED / n)) if n > 1e-6 else None,
                )
                for e, n in sorted(seen, key=lambda row: -row[1])
            ),
            wide=True,
        ),
    ]
    return [table for table in out if table.rows]
