"""How long does a plan take that shortens itself? results/live/courses.csv, of simulated campaigns that are followed.

Each plan is the one that ``testbench plan new`` writes for an aircraft, with wanted errors of 5 % of the static and
control derivatives and 10 % of dampings; a campaign flies an aircraft drawn from the priors, in light gusts, with the
sensors of an air data boom as they are sold, one run after the other, each time the card that `testbench live` names,
until it says that nothing is left. One row a campaign: time in the air over that of the plan as printed, and how many
of the wanted derivatives, at every point of the plan, lie as near to the truth as was claimed: within 1.96 wanted
errors.

Run ``python tests/studies/course_study.py [--campaigns N] [--first K]``; it goes on where it stopped.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized
from tables import read_rows, write_rows

import testbench as tb
from testbench.core.errors import Refusal
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import linearise
from testbench.questions.live.ask import Session, fly_along
from testbench.questions.live.stream import Sample, Source
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.new import plan_text
from testbench.questions.plan.rehearse import as_drawn, fly_run
from testbench.questions.plan.result import Plan, Run
from testbench.questions.plan.scenario import PlanScenario

TABLE = results("live") / "courses.csv"
COLUMNS = ("campaign", "aircraft", "runs", "runs_printed", "air_s", "printed_s", "ratio", "said", "wanted", "met",
           "not_met")  # fmt: skip
AIRCRAFT = ("taurus", "jsbsim:c172p", "b1", "jsbsim:J3Cub", "eolo", "jsbsim:pa28")
SUITE = "eolo_alpha_beta"
WANTED = {"de": "{ M_alpha = 5.0, M_q = 10.0, M_de = 5.0 }", "da": "{ L_p = 10.0, L_da = 5.0 }",
          "dr": "{ N_beta = 5.0, N_r = 10.0, N_dr = 5.0 }"}  # fmt: skip
SEED, BETWEEN_S = 89, 10.0


@cache
def plan_of(name: str) -> Plan:
    """Return the plan that the bench writes for an aircraft, three runs of each card, with what is wanted of them."""
    head, *manoeuvres = plan_text(tb.load_aircraft(name, "rigid"), name, "ardupilot", SUITE).split("[[manoeuvre]]")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "plan.toml"
        parts = []
        for part in manoeuvres:
            (control,) = re.findall(r'control = "(\w+)"', part)
            parts.append(re.sub(r"(repeats = 3) .*", rf"\1\naccuracy_percent = {WANTED[control]}", part))
        file.write_text("[[manoeuvre]]".join([head, *parts]))
        return make_plan(PlanScenario.load(file))


def fly(number: int) -> dict[str, Any]:
    """Fly one campaign by what live names, and return its row."""
    name = AIRCRAFT[number % len(AIRCRAFT)]
    plan = plan_of(name)
    true = as_drawn(plan, plan.aircraft, SEED + 100 * number)
    session = Session(name, plan.aircraft, plan)
    seconds = {c.number: c.length_s + plan.scenario.timing.turn_s for c in plan.cards}
    printed = sum(seconds[c.number] * c.repeats for c in plan.cards)
    flown: list[int] = []
    first = min((c for c in plan.cards if c.repeats), key=lambda c: c.number)

    def arriving() -> Iterator[Sample]:
        zero, card = 0.0, first
        while sum(seconds[n] for n in flown) < printed:  # nobody flies longer than that, whatever has gone wrong
            flown.append(card.number)
            run = Run(len(flown), card, 1, 1, 0.0, 0.0)
            try:
                record = fly_run(plan, run, true, 1000 * number + len(flown))
            except Refusal as refused:
                session.notes.append(refused.message)
                return
            rows = list(zip(record.t_s.tolist(), record.data.tolist(), record.valid.tolist(), strict=True))
            for t, row, valid in rows:
                values = {n: x for n, x, ok in zip(record.channels, row, valid, strict=True) if ok}
                yield Sample(zero + t, values, zero + t)
            zero += float(record.t_s[-1]) + BETWEEN_S
            if session.outlook is None:  # the plane of motion that it is has not been told of yet
                continue
            following = session.next_card
            if following is None:
                return
            card = following

    for _ in fly_along(Source(name, arriving(), careful="awaited"), plan.aircraft, plan, session=session, draws=0):
        pass
    air = sum(seconds[n] for n in flown)
    wanted, off = judged(session, plan, true)
    said = "" if session.outlook is None else ("left" if session.outlook.card else "open" if session.outlook.open
                                               else "enough")  # fmt: skip
    return dict(zip(COLUMNS, (
        number, name, len(flown), sum(c.repeats for c in plan.cards), f"{air:.0f}", f"{printed:.0f}",
        f"{air / printed:.3f}", said, wanted, wanted - len(off), json.dumps(off),
    ), strict=True))  # fmt: skip


def judged(session: Session, plan: Plan, true: tb.Aircraft) -> tuple[int, dict[str, float]]:
    """Return how many derivatives are wanted, and by how many wanted errors those are off that are not met."""
    assert session.course is not None
    off, count = {}, 0
    for point in plan.points:
        there = tb.trim(true, tb.FlightCondition(point.V_m_s, point.h_m))
        truth = {d.name: d.held if d.static is None else d.static for d in
                 dimensional_derivatives(linearise(true, there), there)}  # fmt: skip
        for name, (value, aim) in session.course.claimed(point).items():
            count += 1
            error = (value - truth[name]) / aim
            if not abs(error) <= 1.96:
                off[f"{name} at {point.V_m_s:g}"] = round(float(error), 2)
    return count, off


def main() -> None:
    """Fly the campaigns that are missing, and write the table after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=sized(100, 1), help="number of them")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    asked = parser.parse_args()
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(TABLE)
    for number in range(asked.first, asked.first + asked.campaigns):
        if not any(int(r["campaign"]) == number for r in rows):
            rows.append(fly(number))
            write_rows(TABLE, COLUMNS, rows)
    said(rows)


def said(rows: list[dict[str, Any]]) -> None:
    """Print what the rows say."""
    ratio = np.array([float(r["ratio"]) for r in rows])
    wanted, met = (sum(int(r[k]) for r in rows) for k in ("wanted", "met"))
    enough = [r for r in rows if r["said"] == "enough"]
    print(
        f"{len(rows)} campaigns: time in the air {ratio.mean():.2f} of that as printed, median {np.median(ratio):.2f}"
    )
    print(f"nothing left in {len(enough)}; {100.0 * met / max(wanted, 1):.1f} % of {wanted} derivatives as claimed")
    whole = sum(int(r["wanted"]) == int(r["met"]) for r in enough)
    print(f"all of them in {whole} of {len(enough)}")


if __name__ == "__main__":
    main()
