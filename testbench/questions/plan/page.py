"""The report of a flight plan: cards to print, signals and scripts, its page, and its answer in a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.plan.card_text import beyond_limits, card_stem
from testbench.questions.plan.tables import (
    cards_table,
    flights_table,
    modes_table,
    plan_tables,
    points_table,
    runs_table,
)

if TYPE_CHECKING:
    from rich.console import Console

    from testbench.questions.plan.result import Card, Plan

_HAND_PERIOD_MS = 20
_STYLES = {"lead": "bold", "finding": "", "doubt": "yellow"}


def write_plan(plan: Plan, folder: Path | str) -> list[Path]:
    """Write plan.csv and .json, tables, cards as HTML and PDF, signals, scripts and report.html; return the paths.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from importlib.metadata import version

    from testbench import __version__
    from testbench.page.html import render
    from testbench.questions.plan.figures import plan_plates

    folder = Path(folder)
    tables = plan_tables(plan)
    runs = runs_table(plan)
    out = [write_file(folder / "plan.csv", runs.to_csv()), write_file(folder / "plan.json", runs.to_json())]
    out += write_tables([points_table(plan), cards_table(plan), modes_table(plan)], folder)
    if plan.flights:
        out += write_tables([flights_table(plan)], folder)
    out += write_cards(plan, folder)
    scripts = write_signals(plan, folder)
    out += scripts
    with_script = {p.stem for p in scripts if p.suffix == ".lua"}
    paths, pictures = write_plates(plan_plates(plan), folder)
    out += paths
    file = plan.scenario.file
    page = render(
        "questions/plan/page.html.j2",
        plan=plan,
        answer=plan_answer(plan),
        cards=[(c, card_stem(c), card_stem(c) in with_script) for c in plan.cards],
        pictures=pictures,
        tables=tables,
        versions=[("flight-testbench", __version__), *((n, version(n)) for n in ("numpy", "scipy", "jsbsim"))],
        source_name=file.name if file else "as given",
        source_text=file.read_text(encoding="utf-8") if file else plan.scenario.model_dump_json(indent=1),
    )
    out.append(write_file(folder / PAGE, page))
    return out


def write_cards(plan: Plan, folder: Path) -> list[Path]:
    """Write cards/NAME.html and NAME.pdf, one page A4 each, and cards.pdf with all of them; return the paths."""
    from testbench.page.html import picture, render
    from testbench.questions.plan.card_figures import card_plate, draw_pages, pdf_bytes
    from testbench.questions.plan.card_text import card_text

    out = []
    pages = draw_pages(plan.cards, plan)
    for card, page in pages:
        stem = card_stem(card)
        html = render(
            "questions/plan/card.html.j2",
            card=card,
            count=len(plan.cards),
            title=plan.scenario.title,
            text=card_text(card, plan),
            picture=picture(card_plate(card)),
        )
        out.append(write_file(folder / "cards" / f"{stem}.html", html))
        out.append(write_file(folder / "cards" / f"{stem}.pdf", pdf_bytes([page])))
    out.append(write_file(folder / "cards.pdf", pdf_bytes([page for _, page in pages])))
    return out


def write_signals(plan: Plan, folder: Path) -> list[Path]:
    """Write signals/NAME.csv of every card and, where an autopilot flies it, injection/NAME.lua; return the paths."""
    from testbench.questions.plan.injection import injected_signal, lua_script, signal_csv
    from testbench.questions.plan.injection.lua import injectable

    scenario = plan.scenario
    by_autopilot = scenario.flown_by == "autopilot"
    period = scenario.autopilot.period_ms if by_autopilot else _HAND_PERIOD_MS
    out = []
    for card in plan.cards:
        stem = card_stem(card)
        text = signal_csv(injected_signal(card, period), plan.aircraft)
        out.append(write_file(folder / "signals" / f"{stem}.csv", text))
        if by_autopilot and injectable(card):
            script = lua_script(card, plan.aircraft, scenario.autopilot)
            out.append(write_file(folder / "injection" / f"{stem}.lua", script))
    return out


def plan_answer(plan: Plan) -> list[tuple[str, str]]:
    """Return (kind, sentence) of what matters: flights and time, onset, predicted damping, cards and accuracy."""
    out: list[tuple[str, str]] = []
    kind = "battery" if plan.scenario.energy.kind == "battery" else "tank"
    planes = [sum(r.card.spec.plane == p for r in plan.runs) for p in ("longitudinal", "lateral")]
    if plan.runs:
        minutes = sum(f.time_s for f in plan.flights) / 60.0
        plural = {"battery": "batteries", "tank": "tanks"}[kind] if len(plan.flights) > 1 else kind
        legs = len(plan.flights)
        head = (
            f"{len(plan.runs)} runs ({planes[0]} longitudinal, {planes[1]} lateral) at {len(plan.points)} points take "
            f"{legs} flight{'s' if legs > 1 else ''} on {legs} {plural} and {minutes:.0f} min in the air"
        )
        fullest = max(plan.flights, key=lambda f: f.share)
        out.append(("lead", head))
        out.append(
            (
                "finding",
                f"the fullest flight, no. {fullest.number}, uses {100.0 * fullest.share:.0f} % of the usable energy",
            )
        )
    else:
        out.append(("lead", "nothing can be flown: every card is refused"))
    out += _onset_lines(plan)
    for status, verb in (("refused", "are refused"), ("scaled", "are scaled down")):
        found = [c for c in plan.cards if c.status == status]
        if found:
            named = "; ".join(f"{c.number} ({c.title}: {c.met[0]})" for c in found[:3])
            more = f"; and {len(found) - 3} more" if len(found) > 3 else ""
            out.append(
                (
                    "doubt" if status == "refused" else "finding",
                    f"{len(found)} of {len(plan.cards)} cards {verb}: {named}{more}",
                )
            )
    beyond = [str(c.number) for c in plan.cards if c.status != "refused" and beyond_limits(c)]
    if beyond:
        out.append(
            ("doubt", f"the 95 % band of the expected response reaches beyond a limit on card {', '.join(beyond)}")
        )
    out += _accuracy_lines(plan)
    return out


def _onset_lines(plan: Plan) -> list[tuple[str, str]]:
    out: list[tuple[str, str]] = []
    fastest = plan.points[-1] if plan.points else None
    if fastest is None:
        return out
    if fastest.margin is None or fastest.onset is None:
        out.append(("finding", "no onset of an elastic instability is predicted in the range"))
        return out
    side = "below" if fastest.margin >= 0.0 else "ABOVE"
    out.append(
        (
            "finding" if fastest.margin >= 0.0 else "doubt",
            f"{fastest.onset.sentence}; the fastest point, {fastest.V_m_s:g} m/s, lies "
            f"{abs(100.0 * fastest.margin):.0f} % {side} it",
        )
    )
    least = plan.scenario.least_damping
    steps = [
        (m.zeta - m.go, p, m) for p in plan.points for m in p.modes if m.go is not None and p.next_V_m_s is not None
    ]
    if steps:
        _, p, m = min(steps, key=lambda step: step[0])
        out.append(
            (
                "finding",
                f"the narrowest step is the one from {p.V_m_s:g} to {p.next_V_m_s:g} m/s: it is a go if {m.name} shows "
                f"a damping ratio of at least {m.go:.3g} at {p.V_m_s:g} m/s ({m.zeta:.3g} predicted)",
            )
        )
    low = [
        (p, m) for p in plan.points for m in p.modes if m.elastic and m.zeta_next is not None and m.zeta_next < least
    ]
    for p, m in low[:2]:
        out.append(
            (
                "doubt",
                f"NO-GO after {p.label}: damping of {m.name} is predicted to be {m.zeta_next:.3g} at the next point",
            )
        )
    return out


def _accuracy_lines(plan: Plan) -> list[tuple[str, str]]:
    """Return whether the wanted accuracy is reached."""
    cards = [c for c in plan.cards if c.reached and c.status != "refused"]
    if not cards:
        return []
    short = [(c, r) for c in cards for r in c.reached if not r.reached <= r.wanted * (1.0 + 1e-9)]
    if not short:
        return [("finding", f"the wanted accuracy is reached on all {len(cards)} cards that ask for one")]
    return [("doubt", f"card {c.number}, {r.sentence}; {_in_the_way(c)}") for c, r in short[:6]] + (
        [("doubt", f"{len(short) - 6} more accuracies are not reached; see the table of cards")]
        if len(short) > 6
        else []
    )


def _in_the_way(card: Card) -> str:
    """Return what keeps a card from telling more, in words."""
    if card.status == "scaled":
        return f"what stands in the way is the limit on its amplitude ({card.met[0]})"
    return (
        f"what stands in the way is the noise of the sensors at this amplitude and duration, {card.spec.duration_s:g} s"
    )


def print_plan(plan: Plan, console: Console, folder: Path | str | None = None) -> None:
    """Print the answer, one table of cards, and where the files are."""
    from rich.table import Table as RichTable
    from rich.text import Text

    console.print(Text(plan.scenario.title, style="bold underline"))
    answer = RichTable.grid(padding=(0, 1))
    for kind, sentence in plan_answer(plan):
        answer.add_row("-", Text(f"{sentence[:1].upper()}{sentence[1:]}.", style=_STYLES[kind]))
    console.print(answer)
    table = RichTable(box=None, pad_edge=False)
    for head in (
        "card",
        "manoeuvre",
        "V, m/s",
        "h, m",
        "below onset",
        "status",
        "runs",
        "flight",
        "least elastic ζ, next",
    ):
        table.add_column(head, justify="left" if head in {"manoeuvre", "status"} else "right")
    for card in plan.cards:
        point = card.point
        status = f"scaled to {100.0 * card.factor:.0f} %" if card.status == "scaled" else card.status
        elastic = [m for m in point.modes if m.elastic]
        worst = min(elastic, key=lambda m: m.zeta if m.zeta_next is None else min(m.zeta, m.zeta_next), default=None)
        later = "–" if worst is None or worst.zeta_next is None else f"{worst.zeta_next:.3f}"
        flights = sorted({r.flight for r in plan.runs if r.card is card})
        table.add_row(
            str(card.number),
            Text(card.spec.name),
            f"{point.V_m_s:g}",
            f"{point.h_m:g}",
            "–" if point.margin is None else f"{100.0 * point.margin:.0f} %",
            Text(status, style="yellow" if card.status != "fly" else ""),
            str(card.repeats),
            ", ".join(map(str, flights)) or "–",
            "–" if worst is None else f"{worst.zeta:.3f}, {later}",
        )
    console.print()
    console.print(table)
    if folder is not None:
        console.print()
        console.print(Text(f"Cards:  {Path(folder) / 'cards.pdf'}"), soft_wrap=True)
        console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)
