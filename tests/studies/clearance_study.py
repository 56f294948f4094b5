"""How fast may a flexible aircraft fly next? results/plan/clearance.csv: hidden aircraft expanded towards flutter.

Each aircraft (hidden_wings.py) begins at 40 to 55 % of the onset that nobody knows, and at a speed 10 % faster. A card
is a record of 90 s in turbulence of 0.3 to 1 m/s, by six accelerometers as they are sold. Its next speed is

- what :func:`testbench.estimators.operational.onset` clears at a risk of 1 %, at most 10 % faster (posterior), or
- 10 % faster if the damping of every mode, on a straight line through its last three, is 0.015 or more there (trend;
  g = 0.03 is the reserve of MIL-A-8870).

A speed that is not cleared by 2 % is flown once more, its records are taken together, and then the expansion ends. It
overruns if it flies beyond the onset. Linear models fly, as 6000 records of JSBSim would take days. Prior, noise and
form error of the method were chosen on other draws (seed 1).

Run ``python tests/studies/clearance_study.py [--aircraft N]``; it goes on where it stopped.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized
from studies.hidden_wings import Wing, draw
from tables import read_rows, write_rows

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.operational import OperationalModes, estimate, onset
from testbench.estimators.operational.onset import CRITERIA, ORDER, RISK, STEP, tracked
from testbench.sensors import SensorSuite, load_suite

TABLE = results("plan") / "clearance.csv"
COLUMNS = ("aircraft", "kind", "onset_m_s", "damping_at_90_percent", "rule", "cards", "reached", "overrun")
SEED, SECONDS, RATE_HZ = 2, 90.0, 100.0
WORTH = 1.02
LEAST_DAMPING = 0.015
Found = dict[float, OperationalModes | None]


def suite() -> SensorSuite:
    """Return the first six of EOLO's ten accelerometers, as they are sold."""
    whole = load_suite("eolo_ten_accelerometers")
    return SensorSuite(
        "six", "six accelerometers", RATE_HZ, tuple(s for s in whole.sensors if "az_wing" in s.channel)[:6]
    )


def by_posterior(found: Found) -> float:
    """Return the speed that the posterior of the onset clears; the fastest flown if none."""
    try:
        return onset(list(found), list(found.values())).cleared(RISK, STEP)
    except EstimationError:
        return max(found)


def by_trend(found: Found) -> float:
    """Return a speed 10 % faster if straight lines through dampings allow it; the fastest flown if not."""
    V, top, ahead = list(found), max(found), list[float]()
    for track in tracked(list(found.values())):
        last = [(V[k], m.damping) for k, m in enumerate(track) if m is not None][-3:]
        if last[-1][0] == top:
            ahead.append(float(np.polyval(np.polyfit(*np.transpose(last), 1), (1.0 + STEP) * top)))
    return (1.0 + STEP) * top if ahead and min(ahead) >= LEAST_DAMPING else top


def expand(
    wing: Wing, hidden: float, sensors: SensorSuite, rule: Callable[[Found], float], rng: np.random.Generator
) -> tuple[int, float]:
    """Return the number of cards flown and the fastest of their speeds over the onset."""
    ground = np.sqrt(np.diag(wing.K) / np.diag(wing.M)) / (2.0 * np.pi)
    ground = np.sort(ground[ground > 0.0]) * rng.uniform(0.95, 1.05)  # of a test on the ground
    band = (max(0.6 * ground[0], 0.8), min(max(1.7 * ground[1], 1.3 * ground[2]), 0.4 * RATE_HZ))
    start, rms = rng.uniform(0.4, 0.55) * hidden, rng.uniform(0.3, 1.0)
    cards = [start, (1.0 + STEP) * start]
    records: dict[float, list[FlightRecord]] = {}
    found: Found = {}
    for k, V in enumerate(cards):
        if hidden < V:
            break
        y = wing.fly(V, SECONDS, RATE_HZ, rms, rng)
        truth = FlightRecord(np.arange(len(y)) / RATE_HZ, sensors.channels, y, "truth")
        records.setdefault(V, []).append(sensors.measure(truth, int(rng.integers(2**31))))
        try:
            found[V] = estimate(records[V], sensors.channels, band_hz=band, order=ORDER, criteria=CRITERIA)
        except EstimationError:
            found[V] = None
        if k + 1 == len(cards):
            following = rule(found)
            if following >= WORTH * V:
                cards.append(following)
            elif len(records[V]) < 2:
                cards.append(V)
    return len(cards), cards[-1] / hidden


def rows_of(number: int) -> list[dict[str, Any]]:
    """Return what each rule made of one aircraft, and its least damping 10 % below the onset: large if that is hard."""
    wing, hidden = draw(np.random.default_rng([SEED, number]))
    out = []
    for rule, clears in (("posterior", by_posterior), ("trend", by_trend)):
        cards, reached = expand(wing, hidden, suite(), clears, np.random.default_rng([SEED, number, 1]))
        cells = (number, wing.kind, f"{hidden:.4g}", f"{wing.least_damping(0.9 * hidden):.3f}", rule, cards)
        out.append(dict(zip(COLUMNS, (*cells, f"{reached:.4f}", int(reached > 1.0)), strict=True)))
    return out


def main() -> None:
    """Expand the aircraft that are missing, and write the table after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--aircraft", type=int, default=sized(300, 1), help="number of them")
    asked = parser.parse_args()
    rows = read_rows(TABLE)
    for number in range(asked.aircraft):
        if not any(int(r["aircraft"]) == number for r in rows):
            rows += rows_of(number)
            write_rows(TABLE, COLUMNS, rows)
    for rule in ("posterior", "trend"):
        reached = np.array([float(r["reached"]) for r in rows if r["rule"] == rule])
        over = np.mean(reached > 1.0)
        print(f"{rule}: overrun {100.0 * over:.1f} % of {len(reached)}, reached {np.median(reached):.3f} in the median")


if __name__ == "__main__":
    main()
