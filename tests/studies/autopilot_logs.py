"""From an autopilot's log to derivatives: how often the intervals that identify tells hold the truth.

Run with ``python tests/studies/autopilot_logs.py [SEEDS]`` (100): the flights of :mod:`flown_logs` are written as logs,
imported, and identified with the recipe that import proposes, as a user would. Every seed is kept as soon as it is done
in autopilot_logs_seeds.csv, and a run goes on where the last one stopped; delete that file after a change of the
product. The table is results/estimators/autopilot_logs.csv.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from flown_logs import LOGS, THROWS, fly, truth
from smallest import results, sized
from tables import read_rows, write_rows

from testbench.core.errors import Refusal
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log, write_import

FOLDER = results("estimators")
KEPT = ("format", "axis", "seed", "derivative", "value", "std", "believed", "advice")


def of_seed(seed: int, axes: tuple[str, ...] = ("longitudinal", "lateral")) -> list[dict[str, object]]:
    """Return a row per format, axis and derivative of one flight; one with the error where there is no estimate."""
    flown, rows = fly(seed), []
    for kind, (name, make) in LOGS.items():
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / name
            log.write_bytes(make(seed, flown))
            written = write_import(import_log(log, throw_rad=THROWS), Path(folder) / "records")
            for axis in axes:
                found = next(path for path in written if path.stem.endswith(axis))
                head = {"format": kind, "axis": axis, "seed": seed}
                try:
                    result = identify(RecordDescription.load(found))
                except Refusal as error:
                    rows.append({**head, "derivative": "", "advice": str(error)})
                    continue
                for d in result.derivatives:
                    said = [f"{a.severity} {a.code}" for a in result.cases[d.case].model.advice]
                    own = {"derivative": d.name, "value": d.value, "std": d.std, "believed": d.believed}
                    rows.append({**head, **own, "advice": "; ".join(dict.fromkeys(said))})
    return rows


def table(rows: list[dict[str, str]]) -> list[dict[str, object]]:
    """Return a row per format and derivative: coverage of the 95 % interval, all and only those that are not wrong."""
    out = []
    known = truth()
    groups: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows:
        if row["derivative"] in known:
            groups.setdefault((row["format"], row["derivative"]), []).append(row)
    for (kind, name), found in groups.items():
        x, s = (np.array([float(row[key]) for row in found]) for key in ("value", "std"))
        true = known[name]
        held = np.abs(x - true) <= 1.96 * s
        fit = np.array(["wrong " not in row["advice"] for row in found])
        believed = np.array([row["believed"] == "determined" for row in found])
        missed = sorted(
            {code for row, h in zip(found, held, strict=True) if not h for code in row["advice"].split("; ")}
        )
        out.append(
            {
                "format": kind,
                "derivative": name,
                "true": round(true, 4),
                "median": round(float(np.median(x)), 4),
                "scatter": round(float(1.4826 * np.median(np.abs(x - np.median(x)))), 4),
                "claimed": round(float(np.median(s)), 4),
                "seeds": len(found),
                "held_percent": round(100.0 * float(held.mean()), 1),
                "not_wrong": int(fit.sum()),
                "held_of_not_wrong_percent": round(100.0 * float(held[fit].mean()), 1) if fit.any() else "",
                "determined": int(believed.sum()),
                "held_of_determined_percent": round(100.0 * float(held[believed].mean()), 1) if believed.any() else "",
                "advice_where_missed": "; ".join(missed),
            }
        )
    return out


def pooled(rows: list[dict[str, str]]) -> list[str]:
    """Return per format and axis the share of all intervals that held, and its 95 % interval over flights resampled."""
    known, out = truth(), []
    flights: dict[tuple[str, str], dict[str, list[bool]]] = {}
    for row in rows:
        if row["derivative"] in known:
            held = abs(float(row["value"]) - known[row["derivative"]]) <= 1.96 * float(row["std"])
            for axis in (row["axis"], "both"):
                flights.setdefault((row["format"], axis), {}).setdefault(row["seed"], []).append(held)
    rng = np.random.default_rng(1)
    for (kind, axis), of in flights.items():
        counts = np.array([(sum(held), len(held)) for held in of.values()])
        drawn = counts[rng.integers(len(counts), size=(2000, len(counts)))].sum(axis=1)
        low, high = np.percentile(100.0 * drawn[:, 0] / drawn[:, 1], [2.5, 97.5])
        share = 100.0 * counts[:, 0].sum() / counts[:, 1].sum()
        out.append(f"{kind}, {axis}: {share:.1f} % held ({low:.1f} to {high:.1f}) in {len(counts)} flights")
    return out


def main() -> None:
    """Go on with the seeds that are missing, then write the table of all that are there."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else sized(100, 1)
    kept = FOLDER / "autopilot_logs_seeds.csv"
    rows = read_rows(kept)
    done = {row["seed"] for row in rows}
    for seed in range(seeds):
        if str(seed) in done:
            continue
        began = time.monotonic()
        new = of_seed(seed)
        rows += [{key: str(value) for key, value in row.items()} for row in new]
        write_rows(kept, KEPT, rows)
        print(f"seed {seed} of {seeds}: {since(began, time.monotonic):.1f} s", flush=True)
        found = table(rows)
        write_rows(FOLDER / "autopilot_logs.csv", found[0], found)
    print("\n".join(pooled(rows)))


if __name__ == "__main__":
    main()
