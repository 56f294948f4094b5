"""Does a design keep its promise? Six designs, their headline errors against fresh flights: results/design/promise.csv.

Run ``python tests/studies/promise_study.py [--seeds N]``. Designs whose rows have as many flights are kept, so that it
goes on where it stopped. The headline is what ``testbench design`` prints; it comes from the flights of the design's
own seed. The fresh flights have other noise and other turbulence.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized
from tables import read_rows, write_rows

from testbench.core.schema import parse
from testbench.questions.design.ask import run_design
from testbench.questions.design.scenario import DesignScenario

TABLE = results("design", "promise.csv")
FIRST = 10_000
"""Number of the first fresh flight, after the design's seed."""
WITHIN = 0.25
BLOCK = 20
COLUMNS = (
    "design", "target", "unit", "promised", "realised", "flights", "headline",
    "fresh", "fresh_flights", "without_estimate", "fresh_over_headline", "within_25_percent",
)  # fmt: skip
AIR = {"turbulence_rms_m_s": 0.3}
SHORT_PERIOD = {"Z_alpha": 5.0, "M_alpha": 5.0, "M_q": 5.0, "M_de": 5.0}
LATERAL = {"L_p": 5.0, "L_da": 5.0, "N_beta": 5.0, "N_r": 5.0, "N_dr": 5.0}


def _longitudinal(aircraft: str, suite: str, V: float, h: float, seconds: float, **limits: Any) -> dict[str, Any]:
    return {
        "aircraft": aircraft,
        "suites": [suite],
        "controls": ["de"],
        "duration_s": seconds,
        "condition": {"V_m_s": V, "h_m": h},
        "air": AIR,
        "targets": {"parameters": SHORT_PERIOD},
        "limits": {"load_factor": [0.3, 1.8], "alpha_deg": [-6.0, 12.0], "speed_change_m_s": 3.0, **limits},
    }


def _lateral(aircraft: str, suite: str, V: float, h: float, seconds: float) -> dict[str, Any]:
    return {
        "aircraft": aircraft,
        "suites": [suite],
        "controls": ["da", "dr"],
        "duration_s": seconds,
        "condition": {"V_m_s": V, "h_m": h},
        "air": AIR,
        "simulation": {"rate_hz": 500.0},
        "targets": {"parameters": LATERAL},
        "limits": {"bank_deg": 30.0, "beta_deg": 8.0},
    }


DESIGNS: dict[str, dict[str, Any]] = {
    "taurus longitudinal": {
        **_longitudinal("taurus", "taurus_8hz", 12.0, 100.0, 30.0, pitch_change_deg=30.0),
        "by": "pilot",
        "shortest_step_s": 2.0,
        "targets": {"parameters": {"M_alpha": 5.0, "M_q": 5.0, "M_de": 5.0}},
    },
    "b1 longitudinal": _longitudinal("b1", "b1_alpha", 200.6, 1524.0, 15.0, speed_change_m_s=10.0),
    "eolo longitudinal": _longitudinal("eolo", "eolo_alpha", 16.0, 547.0, 12.0),
    "taurus lateral": _lateral("taurus", "eolo_gap_lateral", 12.0, 100.0, 12.0),
    "c172p lateral": _lateral("c172p", "eolo_gap_lateral", 50.0, 1000.0, 12.0),
    "eolo lateral": _lateral("eolo", "eolo_alpha_beta", 16.0, 547.0, 10.0),
}


def scenario_of(name: str) -> DesignScenario:
    """Return the scenario of one design."""
    scenario, faults = parse(DesignScenario, {"title": name, **DESIGNS[name]}, None)
    assert scenario is not None, faults
    return scenario


def rows_of(name: str, seeds: int) -> list[dict[str, Any]]:
    """Return the rows of one design: what it prints, and what as many fresh flights give."""
    scenario = scenario_of(name)
    result = run_design(scenario)
    best, t = result.best, result.problem.targets
    range_ = result.ensemble.range_
    fresh = None
    for first in range(FIRST, FIRST + seeds, BLOCK):
        n = min(BLOCK, FIRST + seeds - first)
        block = range_.errors(best.design, first, n)
        fresh = block if fresh is None else fresh.and_(block)
        print(f"  {name}: {first - FIRST + n} of {seeds} fresh flights", flush=True)
    assert fresh is not None
    assert best.realised is not None
    out = []
    for k, target in enumerate(t.names):
        share = 100.0 / abs(t.values[k])
        ratio = float(fresh.rms[k] / best.errors[k])
        numbers = (best.realised.promised[k], best.realised.found.rms[k], best.errors[k], fresh.rms[k])
        promised, realised, headline, again = (f"{share * x:.4g}" for x in numbers)
        within = "yes" if abs(ratio - 1.0) <= WITHIN else "no"
        flights = (best.realised.found.n, headline, again, fresh.n, len(fresh.failed))
        cells = (name, target, "%", promised, realised, *flights, f"{ratio:.3f}", within)
        out.append(dict(zip(COLUMNS, cells, strict=True)))
    return out


def main() -> None:
    """Run the designs that are missing, and write the table after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=sized(200, 2), help="fresh flights of each design")
    parser.add_argument("--only", nargs="*", default=list(DESIGNS)[: sized(None, 1)], help="names of designs")
    parser.add_argument("--out", type=Path, default=TABLE)
    asked = parser.parse_args()
    rows = read_rows(asked.out)
    for name in asked.only:
        own = [r for r in rows if r["design"] == name]
        if own and all(int(r["fresh_flights"]) + int(r["without_estimate"]) >= asked.seeds for r in own):
            continue
        print(name, flush=True)
        rows = [r for r in rows if r["design"] != name] + rows_of(name, asked.seeds)
        write_rows(asked.out, COLUMNS, rows)
    ratios = np.array([float(r["fresh_over_headline"]) for r in rows])
    share = 100.0 * float(np.mean(np.abs(ratios - 1.0) <= WITHIN))
    print(f"{share:.0f} % of {ratios.size} headline errors lie within {100 * WITHIN:.0f} % of fresh flights")


if __name__ == "__main__":
    main()
