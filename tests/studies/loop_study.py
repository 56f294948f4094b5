"""Does the loop close? Eight aircraft, each with coefficients drawn from its priors: results/plan/loop.csv.

Run ``python tests/studies/loop_study.py [--only NAME ...]``; rows that are there are kept, so that it goes on where it
stopped. Every aircraft goes through the commands of docs/guides/one_campaign.md, each in a process of its own, and no
file is edited. What flies is drawn with a seed: `plan rehearse --drawn`. A loop is closed where every command ends
well, and the amended aircraft misses no channel of the flight that the gap workflow holds out by more than ``AT_NOISE``
times the noise of its sensor. Derivatives that were identified are held against those of the drawn aircraft.
"""

import argparse
import contextlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import ROOT, results, sized
from tables import read_rows, write_rows

from testbench.flight import FlightCondition, trim
from testbench.questions.identify.amend.choose import derivatives_of
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.rehearse import as_drawn
from testbench.questions.plan.result import Plan
from testbench.questions.plan.scenario import PlanScenario

TABLE = results("plan", "loop.csv")
AT_NOISE = 1.25
INTERVAL = 1.96  # standard errors
PLANS = ROOT / "tests/aircraft/geometry/plans"
COLUMNS = (
    "aircraft",
    "seed",
    "commands",
    "closed",
    "worst_over_noise",
    "found",
    "inside",
    "outside",
    "minutes",
    "says",
)
STRUCTURES = ("short_period", "lateral_directional")


@dataclass(frozen=True)
class Loop:
    """An aircraft, and the seed of what flies."""

    aircraft: str
    seed: int
    plan: str = ""
    sensors: str = "eolo_alpha_beta"

    @property
    def named(self) -> str:
        """The aircraft as commands take it."""
        return self.aircraft if self.plan else f"jsbsim:{self.aircraft}" if self.aircraft not in OWN else self.aircraft


OWN = ("taurus", "eolo")
LOOPS = (
    Loop("c172p", 1),
    Loop("f16", 2),
    Loop("T38", 3),
    Loop("sgs233", 4),
    Loop("wing", 5, plan="flying_wing.toml"),
    Loop("vtail", 6, plan="vtail.toml"),
    Loop("eolo", 7),
    Loop("taurus", 8),
)


class Stopped(Exception):
    """A command did not end well."""


def commands(loop: Loop, folder: Path, done: list[str]) -> None:
    """Run the loop in an empty folder, and add the commands that ended well.

    Raises:
        Stopped: one did not; its last line.
    """

    def run(where: Path, *words: str) -> None:
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        ended = subprocess.run(
            [sys.executable, "-m", "testbench", *words], cwd=where, env=env, capture_output=True, text=True, check=False
        )
        if ended.returncode:
            said = [line for line in ended.stderr.splitlines() if line.strip()]
            raise Stopped(f"{' '.join(words[:2])}: {' '.join(said)[-300:]}")
        done.append(" ".join(words[:2]))
        print(f"  {' '.join(words)[:100]}", flush=True)

    if loop.plan:
        (folder / f"{loop.aircraft}.toml").write_bytes((PLANS / loop.plan).read_bytes())
        run(folder, "aircraft", "new", f"{loop.aircraft}.toml")
    run(folder, "new", "mine", "--aircraft", loop.named, "--sensors", loop.sensors)
    mine = folder / "mine"
    for motion in ("longitudinal", "lateral"):
        if (mine / f"{motion}.toml").exists():
            run(mine, "design", f"{motion}.toml")
    designs = sorted(mine.glob("results/design_*"), key=lambda d: "lateral" in d.name)
    run(mine, "plan", *[word for d in designs for word in ("--from", str(d.relative_to(mine)))])
    (plan,) = (p.relative_to(mine) for p in mine.glob("results/plan_*/*.toml"))
    run(mine, "plan", "rehearse", str(plan), "--drawn", str(loop.seed))
    run(mine, "plan", "close", str(plan), *_some(mine, "logs/*.csv"))
    if any(row["good"] < row["wanted"] for row in _rows(mine, "close_*/tables/cards.json")):  # it says: fly it again
        run(mine, "plan", "rehearse", str(plan), "--drawn", str(loop.seed), "--seed", "2", "-o", "logs/again")
        run(mine, "plan", "close", str(plan), *_some(mine, "logs/**/*.csv"))
    run(mine, "identify", *_some(mine, "results/close_*/identify/*.toml"), "--amend", "flown", "--again", "0")
    run(mine, "gap", "flown", *_some(mine, "results/close_*/records/*.nc"), "--sensors", loop.sensors)


def _some(folder: Path, pattern: str) -> list[str]:
    return [str(p.relative_to(folder)) for p in sorted(folder.glob(pattern))]


def row_of(loop: Loop, folder: Path) -> dict[str, Any]:
    """Return the row of one loop, flown in an empty folder."""
    began, says, closed, worst = _children_s(), "", False, float("nan")
    done: list[str] = []
    found, inside, outside = 0, 0, ""
    try:
        commands(loop, folder, done)
        mine = folder / "mine"
        held = _rows(mine, "gap_*/tables/held_out_1.json")
        worst = max(row["before"] for row in held)
        closed, says = worst <= AT_NOISE, _history(mine)[-1]["says"]
        found, inside, outside = judged(loop, mine)
    except Stopped as error:
        says = str(error)
    cells = (loop.aircraft, loop.seed, len(done), "yes" if closed else "no", f"{worst:.2f}", found, inside, outside)
    return dict(zip(COLUMNS, (*cells, f"{since(began, _children_s) / 60.0:.1f}", says), strict=True))


def judged(loop: Loop, mine: Path) -> tuple[int, int, str]:
    """Return how many derivatives were identified, how many 95 % intervals hold, and by how many errors others miss."""
    (file,) = mine.glob("results/plan_*/*.toml")
    with contextlib.chdir(mine):
        plan = make_plan(PlanScenario.load(file.relative_to(mine)))
    true = truth(plan, loop.seed)
    rows = _rows(mine, "*/tables/amended.json")
    far = {row["derivative"]: (row["identified"] - true[row["derivative"]]) / row["std"] for row in rows}
    missed = {n: x for n, x in far.items() if abs(x) > INTERVAL}
    return len(far), len(far) - len(missed), "; ".join(f"{n} {x:+.1f}" for n, x in missed.items())


def truth(plan: Plan, seed: int) -> Mapping[str, float]:
    """Return the derivatives of what was flown, 1/s and 1/s2."""
    flown = as_drawn(plan, plan.aircraft, seed)
    trimmed = trim(flown, FlightCondition(plan.points[0].V_m_s, plan.points[0].h_m))
    return {n: v for s in STRUCTURES for n, v in derivatives_of(flown, trimmed, s).items()}


def _rows(mine: Path, pattern: str) -> list[dict[str, Any]]:
    return [row for path in mine.glob(f"results/{pattern}") for row in json.loads(path.read_text("utf-8"))["rows"]]


def _history(mine: Path) -> list[dict[str, Any]]:
    return tomllib.loads((mine / "project.toml").read_text("utf-8"))["history"]


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Run the loops that are missing, and write the table after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[loop.aircraft for loop in LOOPS][: sized(None, 1)])
    parser.add_argument("--folder", type=Path, help="keep what the commands wrote here")
    parser.add_argument("--out", type=Path, default=TABLE)
    asked = parser.parse_args()
    rows = read_rows(asked.out)
    for loop in LOOPS:
        if loop.aircraft not in asked.only or any(row["aircraft"] == loop.aircraft for row in rows):
            continue
        print(loop.aircraft, flush=True)
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) if asked.folder is None else asked.folder / loop.aircraft
            folder.mkdir(parents=True, exist_ok=True)
            rows.append(row_of(loop, folder))
        write_rows(asked.out, COLUMNS, rows)
    closed = sum(row["closed"] == "yes" for row in rows)
    found, inside = (sum(int(row[n]) for row in rows) for n in ("found", "inside"))
    print(f"{closed} of {len(rows)} loops closed; {inside} of {found} derivatives within their 95 % intervals")


if __name__ == "__main__":
    main()
