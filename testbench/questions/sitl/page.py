"""The answer and the page of flights that an autopilot's own simulator flew."""

from __future__ import annotations

from testbench.core.constants import DEG_RAD
from testbench.page.figure import COLOURS, Chart, Curve, Panel, Plate
from testbench.page.page import FLOWN, Page
from testbench.page.tables import Column, Table
from testbench.page.words import counted
from testbench.questions.sitl.ask import Flown, Served

STAND_INS = (
    "the interface was tested against stand-ins that follow the published protocol to the byte; no real autopilot was "
    "run when it was made"
)
_SHOWN = (("V", "V, m/s", 1.0), ("h", "h, m", 1.0), ("phi", "φ, deg", DEG_RAD), ("theta", "θ, deg", DEG_RAD),
          ("de_cmd", "δe command, deg", DEG_RAD), ("da_cmd", "δa command, deg", DEG_RAD))  # fmt: skip


def sitl_page(served: Served, autopilot: str) -> Page:
    """Return the page of all flights that were served."""
    flights = served.tally.flights
    records = {f"records/flight_{k}.nc": f.truth.save for k, f in enumerate(flights, 1)}
    suite = served.suite
    if suite is not None:
        records |= {
            f"records/flight_{k}_{suite.name}.nc": f.measured.save for k, f in enumerate(flights, 1) if f.measured
        }
    return Page(
        kicker=f"Served to {autopilot}",
        title=f"{served.aircraft.name} as the autopilot flew it",
        answer=answer(served),
        tables=[_flights(served)],
        plates=[_history(k, flight) for k, flight in enumerate(flights, 1)],
        files=records,
        packages=FLOWN,
    )


def answer(served: Served) -> list[str | tuple[str, str]]:
    """Return what was served, what was lost and why flights ended, in sentences."""
    tally = served.tally
    total = sum(f.duration_s for f in tally.flights)
    out: list[str | tuple[str, str]] = [
        ("lead", f"{counted(len(tally.flights), 'flight')}, {total:.1f} s in {counted(tally.steps, 'step')}")
    ]
    for k, flight in enumerate(tally.flights, 1):
        if flight.reason:
            out.append(("doubt", f"flight {k} left the limits at {flight.duration_s:.2f} s: {flight.reason}"))
    lost = [
        (tally.missed, "packets of the autopilot were lost"),
        (tally.unanswered, "frames were not answered in time"),
        (tally.late, "packets came late and were left out"),
        (tally.repeated, "packets were sent again"),
        (tally.foreign, "packets were of no known form"),
    ]
    said = ", ".join(f"{n} {what}" for n, what in lost if n)
    return [*out, ("finding", said or "no step was lost"), ("finding", STAND_INS)]


def _flights(served: Served) -> Table:
    columns = (
        Column("flight", "flight", get=lambda x: x[0]),
        Column("duration_s", "duration", "s", decimals=2, get=lambda x: x[1].duration_s),
        Column("end", "ended by", get=lambda x: x[1].reason or "the autopilot or the user"),
    )
    caption = "Each begins at the trim; an autopilot that starts anew begins another."
    return Table.of("flights", "Flights", caption, columns, enumerate(served.tally.flights, 1))


def _history(k: int, flight: Flown) -> Plate:
    record = flight.truth
    panels = [
        Panel(draws=[Curve(x=record.t_s, y=record[name] / unit, colour=COLOURS[0])], y=label, x="time, s", tall_in=1.1)
        for name, label, unit in _SHOWN
        if name in record
    ]
    rows = [panels[i : i + 2] for i in range(0, len(panels), 2)]
    return Plate(f"flight_{k}", f"Flight {k}", "What was flown, and what was commanded.", Chart(rows, aligned=True))
