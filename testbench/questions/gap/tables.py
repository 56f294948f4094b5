"""Tables of the gap workflow: the ranking, forces, controls and re-tuning; and what planned manoeuvres could show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.words import with_error
from testbench.inference.calibrate import Reliability
from testbench.page.labels import symbol
from testbench.page.tables import Column, Table
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.control_path import SurfacePath
from testbench.questions.gap.evidence.forces import follows
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.open_set import FirstLook, title_of
from testbench.questions.gap.plan import ALIKE, NEEDED
from testbench.questions.gap.search.hypothesis import FLOWN_STEP, LINEAR_STEP

if TYPE_CHECKING:
    from testbench.questions.gap.ask import GapResult
    from testbench.questions.gap.plan import GapPlan

_MOST_PAIRS = 40
_MOST_INSTEAD = 6


def _path_table(paths: Sequence[SurfacePath]) -> Table:
    """Return what is known of the paths from commands to recorded surfaces."""
    return Table(
        "control_paths",
        "Control paths",
        "A surface that is recorded beside its command is a channel as all others are. Probability: that something is "
        "missing between command and surface. Left: rms of what the model leaves of the surface, over its noise.",
        (
            Column("control", "control"),
            Column("probability", "probability", "%", decimals=1),
            Column("believed", "left by the believed model", decimals=2),
            Column("nearest", "left by what comes nearest", decimals=2),
            Column("why", "why it is not seen"),
        ),
        tuple(
            (p.control, *((None,) * 3 if p.why else (100.0 * p.probability, p.believed, p.nearest)), p.why)
            for p in paths
        ),
        wide=True,
    )


def _ranking(naming: Naming) -> Table:
    """Return the explanations by their probabilities."""
    rows = {row.name: row for row in naming.weighed.table.rows}
    best = naming.weighed.table.best.log_evidence
    fits = {f.effect.name: f for f in naming.ranking}
    order = sorted(rows, key=lambda n: -naming.weighed[n])

    def line(name: str) -> tuple[str | float | None, ...]:
        """Return one explanation."""
        row, fit = rows[name], fits.get(name)
        found = row.posterior
        return (
            "nothing" if fit is None else fit.effect.title,
            "" if fit is None else fit.size,
            100.0 * naming.weighed[name],
            100.0 * naming.weighed.imitates(name),
            found.log_evidence - best,
            row.difference_error,
            0.0 if fit is None else fit.gain,
            None if fit is None or math.isnan(fit.share) else 100.0 * fit.share,
            found.kappa,
            found.whiteness,
            found.strain,
            row.held_out,
            "" if fit is None else fit.effect.separated_by,
        )

    return Table(
        "ranking",
        "Explanations by their probabilities",
        "Nothing, the effects that come nearest, pairs of them and wrong coefficients, by one likelihood in which "
        "noise, coefficients and sizes are unknown. Whole: probability that this is all. Imitates: that something "
        "which the library lacks does nearly this. Gain: fall of chi-square by it; without it, chi-square of the "
        f"believed model is {naming.chi2_tuned:.0f} with its coefficients re-tuned and {naming.chi2_believed:.0f} "
        f"before, over {naming.samples} samples. Share: of the excess over noise. Left: share of the motion that an "
        "unknown motion still needs; a thousandth or less beside the whole story. White: probability that noise would "
        "look as coloured as what is left. Strain: squares of the distances from the priors, one a parameter if they "
        "hold. Held out: ln p of a sample of the manoeuvres held out, less that without any effect.",
        (
            Column("effect", "explanation"),
            Column("size", "size, with standard error"),
            Column("whole", "whole", "%", decimals=1),
            Column("imitates", "imitates", "%", decimals=1),
            Column("evidence", "ln evidence, less the best", decimals=1),
            Column("error", "its error", decimals=1),
            Column("gain", "gain", decimals=1),
            Column("share", "share explained", "%", decimals=1),
            Column("kappa", "left", decimals=4),
            Column("whiteness", "white", decimals=3),
            Column("strain", "strain", decimals=1),
            Column("held_out", "held out", decimals=3),
            Column("separated", "what separates it"),
        ),
        tuple(line(name) for name in order),
        wide=True,
    )


def gap_tables(result: GapResult) -> list[Table]:
    """Return the explanations, the coefficients re-tuned beside the best one, and before and after."""
    naming = result.finding.naming
    out = [_ranking(naming)]
    if result.finding.paths:
        out.append(_path_table(result.finding.paths))
    if result.finding.forces:
        shares = follows(result.finding.forces)
        quantities = list(dict.fromkeys(q for row in shares.values() for q in row))
        out.append(
            Table(
                "equation_errors",
                "Which quantities the equation errors follow",
                "Share of the energy of each equation error that is proportional to one quantity alone, all manoeuvres "
                "together. The quantities move together, so the shares do not add up to 100 %.",
                (
                    Column("coefficient", "error of"),
                    *(Column(q, "dα/dt" if q == "alphadot" else symbol(q), "%", decimals=0) for q in quantities),
                ),
                tuple((c, *(100.0 * row.get(q, 0.0) for q in quantities)) for c, row in shares.items()),
            )
        )
    first = result.finding.first
    if first is not None and first.terms:
        out.append(_term_table(first))
    if result.finding.again is not None:
        out.append(_again_table(result.finding.again))
    if result.finding.changed:
        best = naming.best
        out.append(
            Table(
                "tuning",
                "Coefficients re-tuned" + (" together with the effect" if best else ""),
                "Factors on the believed coefficients. Differences by them: of linear predictions with steps "
                f"of {100.0 * LINEAR_STEP:g} %, of flights with steps of {100.0 * FLOWN_STEP:g} %."
                + (" A factor far from 1 means that the effect is not the whole story." if best else ""),
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
                    "In units of the noise: 1 is the noise floor. The manoeuvre was used neither to name nor to fit.",
                    (
                        Column("output", "output"),
                        Column("before", "before", decimals=3),
                        Column("after", "after", decimals=3),
                    ),
                    tuple((symbol(o), float(b), float(a)) for o, b, a in rows),
                )
            )
    return out


def _term_table(first: FirstLook) -> Table:
    """Return what forces and moments follow."""
    assert first.found is not None
    return Table(
        "terms",
        "What forces and moments follow",
        f"Of {first.found.tried} terms of motion, controls and time, those that the coefficients felt at every sample "
        "follow beyond those of the model; nothing is flown for that. Angles in rad, rates times b/2V or c/2V, the "
        f"throttle from 0 to 1. Expected share of false terms: below {100.0 * CRITERIA.false_terms:g} %.",
        (
            Column("coefficient", "coefficient"),
            Column("term", "term"),
            Column("size", "size, with standard error"),
            Column("words", "in words"),
            Column("instead", "could as well be"),
        ),
        tuple(
            (
                f.coefficient,
                f.term.label,
                with_error(f.size, f.error),
                title_of(f.coefficient, f.term),
                ", ".join(t.label for t, _ in f.instead[:_MOST_INSTEAD]) or "no other term",
            )
            for f in first.terms
        ),
        wide=True,
    )


def _again_table(found: Reliability) -> Table:
    """Return what stated probabilities were worth in flights again."""
    return Table(
        "again",
        "What stated probabilities are worth in these flights",
        f"The flights were flown {len(found.trials)} times again, with nothing or an effect drawn from the priors in "
        "them, and asked about likewise. Of all probabilities that were stated in a class, the share that was right, "
        f"with its 95 % interval. Expected calibration error of the answer: {found.calibration_error:.2g}.",
        (
            Column("stated", "stated", "%"),
            Column("count", "how many"),
            Column("mean", "their mean", "%", decimals=1),
            Column("right", "right", "%", decimals=1),
            Column("lowest", "from", "%", decimals=1),
            Column("highest", "to", "%", decimals=1),
        ),
        tuple(
            (
                f"{100.0 * c.low:g} to {100.0 * c.high:g}",
                c.count,
                *(100.0 * x for x in (c.mean, c.right, c.lowest, c.highest)),
            )
            for c in found.curve()
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
            "Best first. Seen: would be found at its usual size. Told apart: seen, and not to be mistaken for any "
            "other effect. Confusions: ordered pairs of which the first is seen and may be mistaken for the second."
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
            "Which effects would be mistaken for which",
            f"Told apart: noncentrality of the test between the two. It must reach {NEEDED:.0f} to name the right one "
            "with a probability of 0.9, at one false name in 1000. Pairs that are alike by more than "
            f"{100 * ALIKE:.0f} % are listed even if they reach it: there the form of the effect decides, and no form "
            "is quite right." + more,
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
            "Each effect at its usual size, uncertain coefficients re-tuned. The smallest size to be found "
            f"(noncentrality {NEEDED:.0f}) is given in multiples of the usual one.",
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
