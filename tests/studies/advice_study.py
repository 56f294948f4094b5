"""Is the cause named? Drawn aircraft, one thing wrong with each flight, every method: results/estimators/advice.csv.

    python tests/studies/advice_study.py [--seeds N] [--slow-seeds N] [--first-seed N] [--cases CASE...]

Seed after seed is judged and kept in build/advice_study.jsonl; after an interruption the command goes on where it
stopped, and the table holds what is there. Delete that file after a change of the estimators or of their advice.
Methods of ``SLOW`` take more than twice as long as all others together and get fewer seeds. Every seed is another
aircraft at another speed and rate. What decides was set on seeds below ``FIRST_SEED``; the study measures from there.

An estimate is wrong if a derivative is more than four of its errors off, or, for methods without derivatives, if the
pole nearest to the truth is more than ``TOLERANCE`` off in frequency, relative, or in damping ratio.
"""

import argparse
import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import build, results, sized
from studies.advice_cases import CASES, INPUTS, OUTPUTS, Drawn, fly
from tables import write_rows

from testbench.core.errors import EstimationError
from testbench.estimators import estimate
from testbench.inference.causes import with_causes

TABLE = results("estimators", "advice.csv")
KEPT = build("advice_study.jsonl")
SLOW = ("equivalent", "filter_error", "ekf", "ukf")
FIRST_SEED = 1000
ERRORS, TOLERANCE = 4.0, 0.05
COLUMNS = ("case", "method", "seeds", "refused", "wrong", "wrong_flagged", "wrong_named", "flagged", "named")
SUBSPACE = ("dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt")
STRUCTURED = ("equation_error", "output_error", "filter_error", "ekf", "ukf")


def methods(case: str, aircraft: Drawn) -> dict[str, dict[str, Any]]:
    """Return the settings of every method for a case; a structure has the order that it has."""
    n, short, held = CASES[case].order, case == "short", case == "held"
    horizons = {"past_horizon": 3, "future_horizon": 3} if short else {"past_horizon": 12, "future_horizon": 15}
    zeros, hold = min(1, n - 1), "foh" if held else "zoh"
    out: dict[str, dict[str, Any]] = {m: {"order": n, **horizons} for m in (*SUBSPACE, "prediction_error")}
    out["transfer_function"] = {"poles": n, "zeros": [zeros]}
    out["srivc"] = {"poles": [n], "zeros": [zeros], "hold": hold}
    window = (1.3 if short else 26.0) / aircraft.wn
    out["equivalent"] = {"poles": n, "zeros": zeros, "hold": hold, "window_s": [window]}
    if n == 2:
        out |= {m: {"structure": "short_period", "held": [] if held else ["de"]} for m in STRUCTURED}
    return {m: s for m, s in out.items() if not held or m in (*STRUCTURED, "srivc", "equivalent")}


def is_wrong(model: Any, aircraft: Drawn) -> bool:
    """Return whether the estimates of a model are wrong."""
    if hasattr(model, "values"):
        true, errors = aircraft.truth, model.standard_errors
        return any(abs(model.values[k] - v) > ERRORS * errors[k] for k, v in true.items() if errors.get(k, 0.0) > 0.0)
    poles = np.concatenate([np.ravel(s) for s in model.poles().values()])
    if not poles.size:
        return True
    wn, zeta = aircraft.wn, aircraft.zeta
    truth = wn * complex(-zeta, np.sqrt(1.0 - zeta**2))
    s = complex(poles[np.argmin(np.abs(poles - truth))])
    return abs(abs(s) / wn - 1.0) > TOLERANCE or abs(-s.real / abs(s) - zeta) > TOLERANCE


flown = cache(fly)


def judge(case: str, method: str, seed: int) -> tuple[bool, bool, bool] | None:
    """Return whether an estimate is wrong, flagged, and flagged with its cause among the first two; None if refused."""
    aircraft = Drawn(seed)
    try:
        record = flown(case, seed)
        settings = methods(case, aircraft)[method]
        model = estimate(method, [record], INPUTS, OUTPUTS, [flown(case, seed, True)], **settings)
        model = with_causes(model, [record])
    except EstimationError:
        return None
    serious = [a.code for a in model.advice if a.severity != "note"]
    return is_wrong(model, aircraft), bool(serious), bool(set(serious[:2]) & set(CASES[case].names))


def row(case: str, method: str, got: list[tuple[bool, bool, bool] | None]) -> dict[str, Any]:
    """Return counts over what :func:`judge` gave for the seeds of one method on one case."""
    kept = [g for g in got if g is not None]
    wrong = [g for g in kept if g[0]]
    counts = (len(wrong), sum(g[1] for g in wrong), sum(g[2] for g in wrong), sum(g[1] for g in kept))
    values = (case, method, len(got), len(got) - len(kept), *counts, sum(g[2] for g in kept))
    return dict(zip(COLUMNS, values, strict=True))


def main(arguments: list[str] | None = None) -> None:
    """Judge what is missing and write the table after every seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=sized(40, 1))
    parser.add_argument("--slow-seeds", type=int, default=sized(10, 0))
    parser.add_argument("--table", type=Path, default=TABLE)
    parser.add_argument("--kept", type=Path, default=KEPT)
    parser.add_argument("--methods", nargs="*", help="only these")
    parser.add_argument("--cases", nargs="*", choices=CASES, default=[*CASES][: sized(None, 1)])
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    given = parser.parse_args(arguments)
    done: dict[tuple[str, str], dict[int, Any]] = {}
    if given.kept.exists():
        for line in given.kept.read_text(encoding="utf-8").splitlines():
            case, method, seed, got = json.loads(line)
            done.setdefault((case, method), {})[seed] = got
    given.kept.parent.mkdir(parents=True, exist_ok=True)
    for i in range(given.seeds):
        for case, method in ((c, m) for c in given.cases for m in methods(c, Drawn(0))):
            seed, kept = given.first_seed + i, done.setdefault((case, method), {})
            wanted = i < given.slow_seeds or method not in SLOW
            if seed not in kept and wanted and (not given.methods or method in given.methods):
                kept[seed] = judge(case, method, seed)
                with given.kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([case, method, seed, kept[seed]]) + "\n")
        write_rows(given.table, COLUMNS, (row(*key, list(kept.values())) for key, kept in done.items() if kept))
        print(f"seed {given.first_seed + i}", flush=True)


if __name__ == "__main__":
    main()
