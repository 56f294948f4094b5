"""The pages of the gap workflow, of a case and of manoeuvres that are only planned, and their tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from testbench.core.door import read_text
from testbench.inference.calibrate import Reliability
from testbench.page.labels import symbol
from testbench.page.page import Page, source_of
from testbench.page.tables import Column, Table, Value
from testbench.questions.compatibility.page import fault_table
from testbench.questions.gap.drive import SurfacePath, driven_by
from testbench.questions.gap.explain import Naming
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.figures import gap_plates, plan_plates
from testbench.questions.gap.open_set import title_of
from testbench.questions.gap.search.point import STEP
from testbench.questions.gap.starts import start_of
from testbench.questions.identify.instruments import agreement_in_words

if TYPE_CHECKING:
    from testbench.questions.gap.ask import GapResult
    from testbench.questions.gap.plan import GapPlan


_SHOWN = 5  # explanations on the terminal


def gap_page(result: GapResult) -> Page:
    """Return the page of a case, with the amended model, suite or air and its diff in amended/."""
    finding, tables = result.finding, gap_tables(result)
    amended = {f"amended/{path}": text for path, text in amended_files(result).items()}
    check = finding.check
    return Page(
        kicker=f"Gap between simulation and measurement: {result.name}",
        title=result.title,
        question=result.question,
        answer=finding.sentences,
        tables=tables,
        plates=gap_plates(result),
        files=amended,
        template="questions/gap/page.html.j2",
        context={
            "result": result,
            "starts": {n: f", from {s}" if (s := start_of(r)) else "" for n, r in result.records.items()},
            "driven_by": driven_by(list(result.records.values())),
            "data_check": agreement_in_words(check) if check else (),
            "check_tables": [fault_table(check)] if check and check.compared else [],
            "amended": list(amended),
            "diff": "\n".join(text for path, text in amended.items() if path.endswith(".diff")),
        },
        flown=finding.tally,
        provenance=[] if result.seed is None else [("seed", str(result.seed))],
        source=(result.file.name, read_text(result.file, "scenario")) if result.file else None,
        terminal=[tables[0].only("effect", "whole", "size", "share").first(_SHOWN)],
        notes=[f"Assumed: {note}" for note in result.notes],
    )


def gap_plan_page(plan: GapPlan) -> Page:
    """Return the page of what would be stated of planned manoeuvres, and what to add."""
    tables = plan_tables(plan)
    return Page(
        kicker=f"Which effects could be named: {plan.scenario.name}",
        title=f"{plan.scenario.title}: which effects would these manoeuvres name?",
        answer=plan.sentences,
        tables=tables,
        plates=plan_plates(plan),
        source=source_of(plan.scenario),
        terminal=[t for t in tables if t.name in ("additions", "again")],
    )


def _path_table(paths: Sequence[SurfacePath]) -> Table:
    """Return what is known of the paths from commands to recorded surfaces."""

    def seen(path: SurfacePath, value: float) -> float | None:
        """Return a value, or None where nothing is seen."""
        return None if path.why else value

    return Table.of(
        "control_paths",
        "Control paths",
        "A surface that is recorded in addition to its command is a channel like all others. Probability: that "
        "something is missing between command and surface. Left: rms residual of the surface, over its noise.",
        (
            Column("control", "control"),
            Column("probability", "probability", "%", decimals=1, get=lambda p: seen(p, 100.0 * p.probability)),
            Column("believed", "left by the a-priori model", decimals=2, get=lambda p: seen(p, p.believed)),
            Column("nearest", "left by the nearest explanation", decimals=2, get=lambda p: seen(p, p.nearest)),
            Column("why", "why it is not observable"),
        ),
        paths,
        wide=True,
    )


def _ranking(naming: Naming) -> Table:
    """Return the explanations by their probabilities."""
    rows = {row.name: row for row in naming.weighed.table.rows}
    best = naming.weighed.table.best.log_evidence
    fits = {f.effect.name: f for f in naming.ranking}

    def fit(name: str, key: str, none: Value = "") -> Value:
        """Return what an effect's fit holds; of nothing, which has no fit, another value."""
        return Column(key, "", get=key).of(fits[name]) if name in fits else none

    def share(name: str) -> float | None:
        """Return the share of the excess over noise that is explained."""
        found = fits.get(name)
        return None if found is None or math.isnan(found.share) else 100.0 * found.share

    return Table.of(
        "ranking",
        "Explanations by their probabilities",
        "No effect, the nearest effects, pairs of them and wrong coefficients, by one likelihood in which noise, "
        "coefficients and sizes are unknown. Whole: probability that the explanation is complete. Imitates: "
        "probability that it only resembles something which the library lacks. Gain: reduction of chi-square by it; "
        f"without it, chi-square of the a-priori model is {naming.chi2_tuned:.0f} with its coefficients re-tuned and "
        f"{naming.chi2_believed:.0f} before, over {naming.samples} samples. Share: of the excess over noise. Left: "
        "unknown motion that is still needed, as a share of the motion; a thousandth or less with a complete "
        "explanation. White: probability that noise would look as coloured as the residual. Strain: squares of the "
        "distances from the priors, about one for each parameter if the priors are right. Held out: ln p of a sample "
        "of the held-out manoeuvres, less that without any effect.",
        (
            Column("effect", "explanation", get=lambda n: fit(n, "effect.title", "nothing")),
            Column("size", "size, with standard error", get=lambda n: fit(n, "size")),
            Column("whole", "whole", "%", decimals=1, get=lambda n: 100.0 * naming.weighed[n]),
            Column("imitates", "imitates", "%", decimals=1, get=lambda n: 100.0 * naming.weighed.imitates(n)),
            Column("evidence", "ln evidence, less the best", decimals=1,
                   get=lambda n: rows[n].posterior.log_evidence - best),
            Column("error", "its error", decimals=1, get=lambda n: rows[n].difference_error),
            Column("gain", "gain", decimals=1, get=lambda n: fit(n, "gain", 0.0)),
            Column("share", "share explained", "%", decimals=1, get=share),
            Column("kappa", "left", decimals=4, get=lambda n: rows[n].posterior.kappa),
            Column("whiteness", "white", decimals=3, get=lambda n: rows[n].posterior.whiteness),
            Column("strain", "strain", decimals=1, get=lambda n: rows[n].posterior.strain),
            Column("held_out", "held out", decimals=3, get=lambda n: rows[n].held_out),
            Column("separated", "how to separate it", get=lambda n: fit(n, "effect.separated_by")),
        ),
        sorted(rows, key=lambda n: -naming.weighed[n]),
        wide=True,
    )  # fmt: skip


def gap_tables(result: GapResult) -> list[Table]:
    """Return the explanations, the coefficients re-tuned beside the best one, and before and after."""
    naming = result.finding.naming
    out = [_ranking(naming)]
    if result.finding.paths:
        out.append(_path_table(result.finding.paths))
    if naming.terms:
        out.append(_term_table(naming))
    if result.finding.again is not None:
        how = (
            f"The flights were flown {len(result.finding.again.trials)} times again, with no effect or one drawn from "
            "the priors, and analysed in the same way."
        )
        out.append(_again_table(result.finding.again, how))
    if result.finding.changed:
        best = naming.best
        out.append(
            Table(
                "tuning",
                "Coefficients re-tuned" + (" together with the effect" if best else ""),
                f"Factors on the a-priori coefficients; tangents are of flights with steps of {100.0 * STEP:g} %."
                + (" A factor far from 1 means that the effect is not a complete explanation." if best else ""),
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
                    (
                        "In units of the noise: 1 is the noise floor. The manoeuvre was used neither for the search "
                        "nor for the fit."
                    ),
                    (
                        Column("output", "output"),
                        Column("before", "before", decimals=3),
                        Column("after", "after", decimals=3),
                    ),
                    tuple((symbol(o), float(b), float(a)) for o, b, a in rows),
                )
            )
    return out


def _term_table(naming: Naming) -> Table:
    """Return the terms of motion, controls and time that missing forces and moments may follow."""
    return Table.of(
        "terms",
        "Terms of missing forces and moments",
        "Terms that no effect of the library contains, the most probable first, by their signatures alone; the first "
        "ones are flown and listed among the explanations. Gain: increase of ln p of the records by the term, with an "
        "unknown motion in both cases. Angles in rad, rates times b/2V or c/2V, the throttle from 0 to 1.",
        (
            Column("coefficient", "coefficient"),
            Column("term", "term", get="term.label"),
            Column("size", "size"),
            Column("gain", "gain", decimals=1),
            Column("words", "in words", get=lambda t: title_of(t.coefficient, t.term)),
        ),
        naming.terms,
        wide=True,
    )


def _again_table(found: Reliability, how: str) -> Table:
    """Return what stated probabilities were worth in flights again, and how these were flown."""
    return Table.of(
        "again",
        "Calibration of stated probabilities in these flights",
        f"{how} Of all probabilities that were stated in a class, the share that was right, "
        f"with its 95 % interval. Expected calibration error of the answer: {found.calibration_error:.2g}.",
        (
            Column("stated", "stated", "%", get=lambda c: f"{100.0 * c.low:g} to {100.0 * c.high:g}"),
            Column("count", "how many"),
            Column("mean", "their mean", "%", decimals=1, get=lambda c: 100.0 * c.mean),
            Column("right", "right", "%", decimals=1, get=lambda c: 100.0 * c.right),
            Column("lowest", "from", "%", decimals=1, get=lambda c: 100.0 * c.lowest),
            Column("highest", "to", "%", decimals=1, get=lambda c: 100.0 * c.highest),
        ),
        found.curve(),
    )


def plan_tables(plan: GapPlan) -> list[Table]:
    """Return what could be added, how often each effect would be named, and what stated probabilities are worth."""
    power = plan.power
    out = [
        Table.of(
            "additions",
            "Gain of one more manoeuvre",
            "Best first. Shown: visible at the usual size. Named: with 90 % or more, without noise and with a-priori "
            "coefficients, to first order. Right: sum of the probabilities of the right effects."
            + "".join(f" Not flown: {words} ({why})." for words, why in plan.skipped.items()),
            (
                Column("manoeuvre", "manoeuvre", get="words"),
                Column("shown", "effects shown", get=lambda a: len(a.given)),
                Column("named", "named", get=lambda a: len(a.named)),
                Column("right", "right", decimals=1, get=lambda a: sum(a.given.values())),
            ),
            [a for a in (plan.planned, *plan.additions) if a.given],
            wide=True,
        ),
        Table.of(
            "power",
            "Rate at which each effect would be named",
            "Flights with sizes, coefficients and noise drawn from their priors. Named: stated with 90 % or more. In "
            "the set: among the smallest set with 95 % together, whose median size is given. Taken for: the most "
            "probable other explanation, by its mean probability.",
            (
                Column("effect", "effect", get=plan.title),
                Column("flights", "flights", get=lambda n: power[n].flights),
                Column("sure", "named", "%", decimals=0, get=lambda n: 100.0 * power[n].sure),
                Column("held", "in the set", "%", decimals=0, get=lambda n: 100.0 * power[n].held),
                Column("size", "names in the set", decimals=1, get=lambda n: power[n].size),
                Column("given", "given", "%", decimals=0, get=lambda n: 100.0 * power[n].given.get(n, 0.0)),
                Column("other", "taken for", get=lambda n: plan.title(plan.taken_for(n)[0])),
                Column("instead", "given instead", "%", decimals=0, get=lambda n: 100.0 * plan.taken_for(n)[1]),
                Column("separated", "how to separate it", get=lambda n: plan.effects[n].separated_by),
            ),
            power,
            wide=True,
        ),
        Table(
            "unseen",
            "Effects that these manoeuvres would not reveal",
            "",
            (Column("effect", "effect"), Column("why", "why")),
            tuple((plan.title(name), why) for name, why in plan.unseen.items()),
        ),
    ]
    if plan.drawn.trials:
        how = (
            f"{len(plan.drawn.trials)} flights with no effect, an effect, a wrong coefficient or an unknown motion, in "
            "proportion to their priors, analysed to first order."
        )
        out.append(_again_table(plan.drawn, how))
    return [table for table in out if table.rows]
