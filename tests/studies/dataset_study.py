"""Score methods on the two packaged data sets as anybody else's would be: ``make dataset-study``.

Writes results/dataset: ``identification.csv`` (stepwise regression, output error) and ``naming.csv`` (a small neural
classifier, and the gap workflow on the first cases of the test split, as each takes it a minute). Data sets are drawn
into --work and gone on with if they are there.
"""

import argparse
import csv
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from dataset_methods import Classifier, by_output_error, by_stepwise
from smallest import build, results, sized
from tables import write_rows

import testbench as tb
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.questions.dataset.score import UNEXPLAINED, score_predictions
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.workflow import find_gap

ROOT = Path(__file__).resolve().parents[2]
RESULTS = results("dataset")
CASES = 20  # that the workflow is asked
FLIGHTS = sized(1600, 40)
COMPONENTS, THIN = 60, 5
WRONG = 0.05  # share of wrong names on validation cases from which the classifier says "unexplained" instead


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, answer and score."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=build("dataset"), help="folder of data sets and answers")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    parser.add_argument("--flights", type=int, default=FLIGHTS, help="of the identification set")
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    _score(asked, "identification", identify(asked.work, asked.flights))
    if sized(True, False):  # the naming set is one of a thousand cases, or none
        _score(asked, "naming", name(asked.work))
    return 0


def _score(asked: argparse.Namespace, task: str, answers: dict[str, Path]) -> None:
    rows: list[Sequence[str]] = []
    heads: Sequence[str] = ()
    for method, path in answers.items():
        heads, scored, _ = score_predictions(asked.work / task, path)
        rows += [(method, *row) for row in scored]
    write_rows(asked.out / f"{task}.csv", ("method", *heads), rows)
    print(f"{asked.out / task}.csv: {', '.join(answers)}", flush=True)


def _answers(path: Path, heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([heads, *rows])
    return path


def identify(work: Path, flights: int) -> dict[str, Path]:
    """Return method -> its answers on the test split of the identification set."""
    tb.draw_dataset("dataset/identification", work / "identification", runs=flights)
    test = tb.open_dataset(work / "identification", "test")
    draws = np.unique(test.draw.values).tolist()
    out = {}
    for method, find in (("stepwise regression", by_stepwise), ("output error", by_output_error)):
        rows = [answer for draw in draws for answer in find(test, draw)]
        out[method] = _answers(work / f"{method}.csv", ("draw", "figure", "value", "std"), rows)
    return out


def name(work: Path) -> dict[str, Path]:
    """Return method -> its answers on the test split of the naming set."""
    tb.draw_dataset("dataset/naming", work / "naming")
    said = {"neural classifier": by_classifier(work / "naming"), "workflow": by_workflow(work / "naming")}
    return {
        method: _answers(work / f"{method}.csv", ("draw", "said"), sorted(of.items())) for method, of in said.items()
    }


def by_workflow(folder: Path, cases: int = CASES) -> dict[int, str]:
    """Return draw -> what the gap workflow says of it: the last manoeuvre is held out, the others it names from."""
    flights = tb.open_dataset(folder, "test", truth="")
    suite = replace(tb.load_suite("eolo_gap"), rate_hz=50.0)
    out = {}
    for draw in np.unique(flights.draw.values)[:cases].tolist():
        of = flights.isel(flight=np.flatnonzero(flights.draw.values == draw))
        records = {}
        for k in range(of.sizes["flight"]):
            x = of.isel(flight=k, time=slice(int(of.samples[k])))
            data, t_s = x.readings.values.astype(float), x.time.values
            name = flights.manoeuvre.attrs["names"][int(of.manoeuvre[k])]
            records[name] = FlightRecord(t_s, tuple(map(str, of.channel.values)), data, "measured")
        aircraft = tb.load_aircraft(flights.aircraft.attrs["names"][int(of.aircraft[0])], "rigid")
        believed = Believed(aircraft, suite, tb.FlightCondition(float(of.V_m_s[0]), float(of.h_m[0])), 100.0)
        last = list(records)[-1]
        try:
            naming = find_gap(believed, {n: r for n, r in records.items() if n != last}, {last: records[last]}).naming
        except Refusal:
            continue  # it is not answered
        out[draw] = " | ".join(naming.names) or naming.outcome
        print(f"workflow, draw {draw}: {out[draw]}", flush=True)
    return out


def features_of(flights: Any) -> tuple[Any, Any]:
    """Return draws (n,) and what their manoeuvres show (n, f), thinned; zeros behind the end of a record."""
    draws = np.unique(flights.draw.values)
    readings = np.nan_to_num(flights.readings.values[:, ::THIN, :5])
    rows = np.array([readings[np.flatnonzero(flights.draw.values == d)].ravel() for d in draws])
    return draws, rows


def by_classifier(folder: Path) -> dict[int, str]:
    """Return draw -> what the classifier says of it, "unexplained" where it is not sure."""
    known = tb.open_dataset(folder)
    kinds = known.effect.attrs["names"]
    parts = {split: tb.open_dataset(folder, split) for split in ("train", "validation", "test")}
    raw = {split: features_of(part) for split, part in parts.items()}
    said = {split: [_class(part, d, kinds) for d in raw[split][0]] for split, part in parts.items()
            if split != "test"}  # fmt: skip
    names = sorted({*said["train"]})
    # what a case differs by from the training cases of its aircraft that hide nothing, in units of their spread
    craft = {split: _first(part, raw[split][0], "aircraft") for split, part in parts.items()}
    nothing = np.array([s == "no gap" for s in said["train"]])
    shown = {}
    for split, (_, x) in raw.items():
        z = np.empty_like(x)
        for a in np.unique(craft[split]):
            base = raw["train"][1][nothing & (craft["train"] == a)]
            z[craft[split] == a] = (x[craft[split] == a] - base.mean(axis=0)) / (base.std(axis=0) + 1e-3)
        shown[split] = np.arctan(z / 3.0)
    _, _, axes = np.linalg.svd(shown["train"] - shown["train"].mean(axis=0), full_matrices=False)
    short = {s: (x - shown["train"].mean(axis=0)) @ axes[:COMPONENTS].T for s, x in shown.items()}
    scale = short["train"].std(axis=0) + 1e-9
    short = {s: np.column_stack([x / scale, 2.0 * craft[s] - 1.0]) for s, x in short.items()}
    codes = np.array([names.index(s) for s in said["train"]])
    seen = np.array([s in names for s in said["validation"]])
    held = short["validation"][seen], np.array([names.index(s) for s in said["validation"] if s in names])
    net = Classifier(names, short["train"], codes, held)
    sure = _threshold(net.probabilities(short["validation"]), names, said["validation"])
    p = net.probabilities(short["test"])
    return {
        int(d): names[k] if p[i, k] >= sure else UNEXPLAINED
        for i, (d, k) in enumerate(zip(raw["test"][0], p.argmax(axis=1), strict=True))
    }


def _first(flights: Any, draws: Any, variable: str) -> Any:
    return np.array([flights[variable].values[np.flatnonzero(flights.draw.values == d)[0]] for d in draws])


def _class(flights: Any, draw: int, kinds: list[str]) -> str:
    """Return what should be said of a training case: the name, both of two, or that nothing is there."""
    row = int(np.flatnonzero(flights.draw.values == draw)[0])
    return " + ".join(kinds[k] for k in flights.effect.values[row] if k >= 0) or "no gap"


def _threshold(p: Any, names: list[str], said: list[str]) -> float:
    """Return the least probability from which at most WRONG of the validation cases get a wrong name."""
    best, top = np.array([names[k] for k in p.argmax(axis=1)]), p.max(axis=1)
    named = ~np.isin(best, ("no gap", UNEXPLAINED))
    wrong = named & (best != np.array(said))
    for sure in np.linspace(0.0, 1.0, 101):
        if np.mean(wrong & (top >= sure)) <= WRONG:
            return float(sure)
    return 1.0


if __name__ == "__main__":
    raise SystemExit(main())
