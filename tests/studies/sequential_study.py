"""What does sequential design save if the model is wrong by 30 %? results/design/sequential.csv.

The model of each trial has coefficients of the short period drawn about those of the aircraft that flies. Three flights
of one length, all inside the limits as the model predicts them, are made in three ways: every next input is designed
with what is known then (sequential), the first design is flown three times (one-shot), or the best 3-2-1-1 of the first
model is. Estimates of flights are combined by their stated covariances. Errors are those of the combined estimates
about the derivatives of the aircraft that flies.

Run ``python tests/studies/sequential_study.py [--trials N]``. Trials that are done are kept in
results/design/sequential_trials.csv, so that it goes on where it stopped.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized
from studies.promise_study import DESIGNS
from studies.robust_study import STATED
from tables import read_rows, write_rows

from testbench.core.errors import Refusal
from testbench.core.scenario.base import Preparation
from testbench.core.schema import parse
from testbench.design.amplitude import BIAS, Ensemble
from testbench.design.ensemble import Flier, Member
from testbench.design.limits import Envelope
from testbench.design.problem import Design
from testbench.design.realise import Range
from testbench.design.search import screen, search
from testbench.estimators.prepare import prepared
from testbench.flight import load_aircraft
from testbench.pooling.prior import Prior
from testbench.questions.design.known import AllKnown, believe, together
from testbench.questions.design.pose import pose, range_of
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.identify.amend.choose import with_increments
from testbench.questions.identify.amend.folder import aircraft_files, base_texts, write_folder
from testbench.sensors import load_suite

RESULTS = results("design")
TABLE, TRIALS = RESULTS / "sequential.csv", RESULTS / "sequential_trials.csv"
NAMES = ("b1 longitudinal", "eolo longitudinal")
WAYS = ("sequential", "one-shot", "3-2-1-1")
FLIGHTS = 3
WANTED = 1.0
"""Wanted standard errors, percent of the true values: more than three flights give, so that no design stops."""
_FLOWN = 4  # designs that are flown, besides the best 3-2-1-1
COLUMNS = ("design", "trial", "way", "flights", "target", "error_percent", "limit_met")
SUMMARY = (
    "design", "way", "flights", "trials", "flown", "worst_target_rms_percent", "rms_percent", "median_worst_percent",
    "over_one_shot", "limits_met_percent",
)  # fmt: skip


def wrong(name: str, trial: int, folder: Path) -> Path:
    """Write the model of one trial: the packaged aircraft with wrong coefficients; return its folder."""
    asked = DESIGNS[name]
    aircraft = load_aircraft(asked["aircraft"])
    scenario = scenario_of(name, asked["aircraft"])
    posed = pose(scenario, aircraft, load_suite(scenario.suites[0]))
    rng = np.random.default_rng([20_000, trial])
    off = {key: float(share * rng.standard_normal()) for key, share in STATED.items()}
    added = {key: share * aircraft.coefficient(key) for key, share in off.items()}
    changed = with_increments(aircraft, added, posed.trimmed)
    text, _ = base_texts(asked["aircraft"])
    home = folder / f"wrong_{trial}"
    write_folder(aircraft_files(changed, home.name, text, "a wrong model", "", {}, {}), home)
    return home


def scenario_of(name: str, aircraft: str) -> DesignScenario:
    """Return the scenario of a design with another aircraft; its information is that of the turbulence."""
    targets = {"parameters": dict.fromkeys(DESIGNS[name]["targets"]["parameters"], WANTED)}
    asked = {"title": name, **DESIGNS[name], "targets": targets, "aircraft": aircraft, "realise": 5, "draws": 0}
    scenario, faults = parse(DesignScenario, asked, None)
    assert scenario is not None, faults
    return scenario


def design(scenario: DesignScenario, posed: Member, family: str | None = None) -> tuple[Design, Range]:
    """Return the best design, or that of one family, as it is flown with the believed aircraft, and its range.

    It keeps limits in still air, at the amplitude that misleads least, as ``testbench design`` does before margins.
    """
    problem, suite = posed.problem, load_suite(scenario.suites[0])
    found = search(problem, None, screen(problem))
    taken = [d for d in found if d.family == family] if family else found[:_FLOWN]
    ensemble = Ensemble(range_of(scenario, posed, suite, Flier()), flights=scenario.realise)
    told = ensemble.chosen([f for f in ensemble.started(taken) if f.admissible], BIAS)
    return min((f.design for f in told), key=lambda d: d.cost), ensemble.range_


def flown(truth: Range, envelope: Envelope, designed: Design, by: Range, number: int) -> tuple[Prior, bool]:
    """Fly a design with the true aircraft; return what its estimator finds, and whether a limit was met."""
    ((record,),) = truth.fly([designed], truth.airs(number, 1), envelope.channels)
    if isinstance(record, str):
        raise Refusal(record)
    met = bool(np.max(envelope.shares(record)) > 1.0)
    measured = prepared(truth.suite.measure(record, truth.seed + number), by.member.problem.start_s, Preparation())
    with np.errstate(all="ignore"):
        params, P = by.identified.estimate(measured)
    return Prior(by.identified.structure.parameter_names, params, 0.5 * (P + P.T), f"flight {number}"), met


def rows_of(name: str, trial: int) -> list[dict[str, Any]]:
    """Return the errors of one trial after each flight, for each way."""
    true_scenario = scenario_of(name, DESIGNS[name]["aircraft"])
    suite = load_suite(true_scenario.suites[0])
    real = pose(true_scenario, load_aircraft(true_scenario.aircraft), suite)
    truth = range_of(true_scenario, real, suite, Flier())
    envelope, targets = real.problem.envelope, real.problem.targets
    values = dict(zip(targets.names, targets.values.tolist(), strict=True))
    out: list[dict[str, Any]] = []
    with TemporaryDirectory() as folder:
        scenario = scenario_of(name, str(wrong(name, trial, Path(folder))))
        first = pose(scenario, load_aircraft(scenario.aircraft), suite)
        begin = {"sequential": None, "one-shot": None, "3-2-1-1": "3211"}
        shared = design(scenario, first)
        for way, family in begin.items():
            best, range_ = shared if family is None else design(scenario, first, family)
            found: list[Prior] = []
            for k in range(FLIGHTS):
                if way == "sequential" and k:
                    try:
                        posed, _ = believe(scenario, first, suite, together(found))
                    except AllKnown:
                        break
                    best, range_ = design(scenario, posed)
                part, met = flown(truth, envelope, best, range_, 1000 * trial + k)
                found.append(part)
                known = together(found)
                for target, value in values.items():
                    error = 100.0 * (known.values[known.names.index(target)] / value - 1.0)
                    cells = (name, trial, way, k + 1, target, f"{error:.4f}", int(met))
                    out.append(dict(zip(COLUMNS, cells, strict=True)))
    return out


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the errors over the trials in which all ways gave all estimates."""
    out: list[dict[str, Any]] = []
    for name in dict.fromkeys(r["design"] for r in rows):
        own = [r for r in rows if r["design"] == name and r["target"]]
        targets = list(dict.fromkeys(r["target"] for r in own))
        trials = sorted({int(r["trial"]) for r in own})
        once: dict[int, np.ndarray] = {}
        for way in ("one-shot", "sequential", "3-2-1-1"):
            for k in range(1, FLIGHTS + 1):
                of = [r for r in own if r["way"] == way and int(r["flights"]) == k]
                # a sequential design that finds everything known stops: its last estimate stands
                before = [r for r in own if r["way"] == way and int(r["flights"]) < k]
                at = {(int(r["trial"]), r["target"]): float(r["error_percent"]) for r in (*before, *of)}
                flown = len({r["trial"] for r in of})
                e = np.array([[at[t, n] for n in targets] for t in trials])
                rms = np.sqrt(np.mean(e**2, axis=0))
                once.setdefault(k, rms)
                met = 100.0 * np.mean([int(r["limit_met"]) for r in of])
                numbers = (rms.max(), np.sqrt(np.mean(rms**2)), np.median(np.abs(e).max(axis=1)))
                ratio = float(np.exp(np.mean(np.log(rms / once[k]))))
                cells = (name, way, k, len(trials), flown, *(f"{x:.3g}" for x in (*numbers, ratio, met)))
                out.append(dict(zip(SUMMARY, cells, strict=True)))
    return out


def main() -> None:
    """Run the trials that are missing, and write both tables after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=sized(40, 1), help="wrong models of each aircraft")
    parser.add_argument("--only", nargs="*", default=list(NAMES)[: sized(None, 1)], help="names of designs")
    parser.add_argument("--out", type=Path, default=TRIALS)
    asked = parser.parse_args()
    rows = read_rows(asked.out)
    for name in asked.only:
        for trial in range(asked.trials):
            if any(r["design"] == name and int(r["trial"]) == trial for r in rows):
                continue
            try:
                rows += rows_of(name, trial)
            except Refusal as error:  # no flight, or no estimate: the trial is lost for all ways
                rows.append({**dict.fromkeys(COLUMNS, ""), "design": name, "trial": trial, "way": f"lost: {error}"})
            print(name, trial, rows[-1]["way"], flush=True)
            write_rows(asked.out, COLUMNS, rows)
    if asked.out == TRIALS:
        write_rows(TABLE, SUMMARY, summary(rows))
    for row in summary(rows):
        print(*row.values())


if __name__ == "__main__":
    main()
