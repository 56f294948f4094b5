"""The report of the gap workflow: files of a case, its page, and its answer in a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from testbench.page.labels import file_stem, symbol
from testbench.page.tables import Column, Table
from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.gap.criteria import FALSE_ALARM
from testbench.questions.gap.evidence.forces import follows
from testbench.questions.gap.export import air_text, aircraft_files

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.gap.case import GapResult
    from testbench.questions.gap.controls import Controls


def write_gap(result: GapResult, folder: Path | str) -> list[Path]:
    """Write tables, figures, the amended model or suite with its diff, and report.html; return the paths, page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.page.html import render
    from testbench.questions.compatibility.page import compatibility_tables
    from testbench.questions.gap.figures import gap_plates

    folder, check = Path(folder), result.finding.check
    tables = gap_tables(result)
    out = write_tables(tables, folder)
    paths, pictures = write_plates(gap_plates(result), folder)
    out += paths
    amended = write_amended(result, folder / "amended")
    out += amended
    page = render(
        "questions/gap/page.html.j2",
        result=result,
        answer=result.finding.sentences,
        tables=tables,
        pictures=pictures,
        air=result.finding.air.sentence,
        data_check=check.sentences if check else (),
        check_tables=compatibility_tables(check.result) if check and check.result else [],
        amended=[str(path.relative_to(folder)) for path in amended],
        diff="\n".join(p.read_text(encoding="utf-8") for p in amended if p.suffix == ".diff"),
        false_alarm=FALSE_ALARM,
        source_text=result.file.read_text(encoding="utf-8") if result.file else "",
    )
    out.append(write_file(folder / PAGE, page))
    return out


def write_amended(result: GapResult, folder: Path) -> list[Path]:
    """Write what was named and re-tuned: the sensor suite, and the aircraft's folder with a model for stock JSBSim.

    Of a gust it is the air of the manoeuvre that met it, and no aircraft.

    Each comes with a diff, and only if it changed; nothing is written if nothing was named and no parameter is wrong.
    """
    import difflib

    from testbench.sensors import suite_toml

    old, new = result.finding.believed, result.finding.amended
    if not result.finding.changed:
        return []
    out: list[Path] = []
    suites = [suite_toml(b.suite) for b in (old, new)]
    if suites[0] != suites[1]:
        before, after = (s.splitlines() for s in suites)
        diff = difflib.unified_diff(before, after, "believed suite", "amended suite", lineterm="")
        out.append(write_file(folder / f"{file_stem(new.suite.name)}.toml", suites[1]))
        out.append(write_file(folder / "suite.diff", "\n".join(diff) + "\n"))
    air = [(f"air_{file_stem(g.manoeuvre)}.toml", air_text(g)) for g in new.gusts if g not in old.gusts]
    if air:
        out += [write_file(folder / path, text) for path, text in air]
        after = "\n".join(text for _, text in air).splitlines()
        lines = difflib.unified_diff([], after, "believed air (still)", "amended air", lineterm="")
        out.append(write_file(folder / "air.diff", "\n".join(lines) + "\n"))
    best = result.finding.naming.best
    if best is not None and best.effect.met is not None:
        return out
    name = result.aircraft
    models = [aircraft_files(b.aircraft, name, b.rate_hz, b.condition) for b in (old, new)]
    if models[0] == models[1]:
        return out
    for path, text in models[1].items():
        out.append(write_file(folder / name / path, text))
    before, after = (m[f"{name}.xml"].splitlines() for m in models)
    lines = difflib.unified_diff(before, after, "believed model", "amended model", lineterm="", n=2)
    out.append(write_file(folder / "model.diff", "\n".join(lines) + "\n"))
    return out


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


def print_gap(result: GapResult, console: Console, folder: Path | str | None = None) -> None:
    """Print the answer, the ranking, what was assumed, and where the files are."""
    from rich.table import Table as RichTable
    from rich.text import Text

    console.print(Text(result.title, style="bold underline"))
    answer = RichTable.grid(padding=(0, 1))
    for i, sentence in enumerate(result.finding.sentences):
        answer.add_row("-", Text(sentence, style="bold" if i == 0 else ""))
    console.print(answer)
    ranking = RichTable(box=None, pad_edge=False)
    for head in ("effect", "gain", "threshold", "share"):
        ranking.add_column(head, justify="left" if head == "effect" else "right")
    for f in result.finding.naming.ranking:
        ranking.add_row(
            f.effect.title,
            f"{f.gain:.1f}",
            f"{f.threshold:.1f}",
            f"{100 * f.share:.1f} %" if f.share == f.share else "–",
        )
    console.print()
    console.print(ranking)
    if result.notes:
        console.print()
    for note in result.notes:
        console.print(Text(f"Assumed: {note}", style="dim"))
    if folder is not None:
        console.print()
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)
