"""How near each estimator comes to the Cramer-Rao bound, and whether its intervals hold the truth.

Run with ``make estimator-study``; the tables go to results/estimators/. Simulated flights of both aircraft
(``estimator_cases``), of which only the noise differs from seed to seed, are given to every method that the field has
(``estimator_methods``).

scatter_<aircraft>.csv: frequency and damping of the short period against the bound of the parametric structure, which
knows the equations; black boxes know less and cannot reach it. Methods that know the equations are judged by all their
derivatives, too: the errors, whitened by the bound's covariance (root mean square 1 at the bound).

intervals.csv: every method that gives standard errors, and by quantity the share of its 95 % intervals, estimate plus
and minus 1.96 standard errors, that held the truth. EOLO's short period is two real poles: who gives errors of single
poles is judged by each of them. Quantities of one kind (derivatives, lines, instruments) are pooled; the row of the
worst of them stands below. ``low`` and ``high`` are limits that a right interval leaves by chance once in a thousand
(some hundred rows stand in the table).

Estimates are kept seed by seed in build/estimator_study/, from which an interrupted study resumes.
"""

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import build, results, sized
from tables import write_rows

sys.path.insert(0, str(Path(__file__).resolve().parent))

from estimator_cases import CONDITIONS, ROOT, Case, prepare_instruments, prepare_longitudinal, prepare_multisine
from estimator_methods import INSTRUMENTS, LONGITUDINAL, METHODS, MULTISINE
from rich.progress import Progress

from testbench.core.errors import EstimationError

RESULTS = results("estimators")
HELD_TABLE = ROOT / "testbench" / "estimators" / "coverage_table.py"
RAW = build("estimator_study")
SEEDS = sized(400, 2)
KINDS = ((LONGITUDINAL, prepare_longitudinal), (MULTISINE, prepare_multisine), (INSTRUMENTS, prepare_instruments))
SCATTER = (
    "aircraft",
    "method",
    "seeds",
    "refused",
    "warned",
    "rms_over_bound_wn",
    "rms_over_bound_zeta",
    "bias_percent_wn",
    "bias_percent_zeta",
    "rms_percent_wn",
    "rms_percent_zeta",
    "rms_over_bound_derivatives",
)
INTERVALS = ("aircraft", "method", "quantity", "seeds", "held", "low", "high", "within", "told_over_scatter")


def run_seed(case: Case, method: str, seed: int) -> dict[str, Any]:
    """Return what a method makes of a seed, as JSON values."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            found = METHODS[method](case, case.draw(seed))
    except EstimationError:
        return {"seed": seed, "refused": True}
    return {"seed": seed, "refused": False, "warned": found.warned, "values": found.values}


def _raw(case: Case, method: str, folder: Path) -> Path:
    return folder / f"{case.name}_{''.join(c if c.isalnum() else '_' for c in method)}.jsonl"


def kept(case: Case, method: str, folder: Path) -> list[dict[str, Any]]:
    """Return the estimates that are kept."""
    file = _raw(case, method, folder)
    if not file.is_file():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line.endswith("}")]


def estimates(
    case: Case, method: str, seeds: int, folder: Path, resume: bool, step: Callable[[], Any]
) -> list[dict[str, Any]]:
    """Return what a method makes of every seed; those of an interrupted study are read."""
    folder.mkdir(parents=True, exist_ok=True)
    done = kept(case, method, folder) if resume else []
    file = _raw(case, method, folder)
    with file.open("w", encoding="utf-8") as stream:
        stream.writelines(json.dumps(row) + "\n" for row in done)
        stream.flush()
        for seed in range(seeds):
            if seed == len(done):
                done.append(run_seed(case, method, seed))
                stream.write(json.dumps(done[seed]) + "\n")
                stream.flush()
            step()
    return done[:seeds]


def scatter_row(case: Case, method: str, done: list[dict[str, Any]]) -> dict[str, Any]:
    """Return one row of the table of scatter."""
    row: dict[str, Any] = dict.fromkeys(SCATTER, "")
    found = [d["values"] for d in done if not d["refused"]]
    row |= {"aircraft": case.name, "method": method, "seeds": len(done), "refused": len(done) - len(found)}
    if not found:
        return row
    row["warned"] = sum(d["warned"] for d in done if not d["refused"])
    for q in ("wn", "zeta"):
        error, true = np.array([v[q][0] for v in found if q in v]) - case.true[q], case.true[q]
        if not error.size:
            continue
        rms = float(np.sqrt(np.mean(error**2)))
        row[f"rms_over_bound_{q}"] = f"{rms / case.bound[q]:.2f}"
        row[f"bias_percent_{q}"] = f"{100.0 * error.mean() / true:+.2f}"
        row[f"rms_percent_{q}"] = f"{100.0 * rms / true:.2f}"
    names = [q for q in case.true if q.startswith("derivatives: ")]
    if all(name in v for v in found for name in names):
        errors = np.array([[v[name][0] - case.true[name] for name in names] for v in found])
        row["rms_over_bound_derivatives"] = f"{np.sqrt(np.mean((errors @ case.whiten.T) ** 2)):.3f}"
    return row


def interval_rows(case: Case, method: str, done: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the table of intervals, one for each quantity that half of the seeds or more tell."""
    held: dict[str, list[tuple[float, float]]] = {}
    for d in done:
        for q, (value, std) in ({} if d["refused"] else d["values"]).items():
            if std is not None:
                held.setdefault(q, []).append((value - case.true[q], std))
    held = {q: pairs for q, pairs in held.items() if len(pairs) >= 0.5 * len(done)}
    kinds: dict[str, list[str]] = {}
    for q in held:
        kinds.setdefault(q.split(": ")[0], []).append(q)
    rows = []
    for kind, members in kinds.items():
        shares = {q: float(np.mean([abs(e) < 1.96 * s for e, s in held[q]])) for q in members}
        if members == [kind]:
            rows.append(_interval(case, method, kind, held[kind]))
            continue
        rows.append(_interval(case, method, f"{kind}, pooled", [pair for q in members for pair in held[q]], len(done)))
        worst = min(members, key=lambda q: (-abs(shares[q] - 0.95), q))
        rows.append(_interval(case, method, f"{kind}, worst: {worst.split(': ')[1]}", held[worst]))
    return rows


def _interval(
    case: Case, method: str, quantity: str, pairs: list[tuple[float, float]], seeds: int | None = None
) -> dict[str, Any]:
    seeds = len(pairs) if seeds is None else seeds
    errors, told = np.array(pairs).T
    share = float(np.mean(np.abs(errors) < 1.96 * told))
    low, high = (float(x) for x in binom.ppf([0.0005, 0.9995], seeds, 0.95) / seeds)
    ratio = np.sqrt(np.mean((errors / np.maximum(told, 1e-300)) ** 2)) if np.all(told > 0.0) else np.inf
    values = (
        case.name,
        method,
        quantity,
        seeds,
        f"{share:.3f}",
        f"{low:.3f}",
        f"{high:.3f}",
        "yes" if low <= share <= high else "no",
        f"{1.0 / ratio:.2f}",
    )
    return dict(zip(INTERVALS, values, strict=True))


def product(method: str) -> str:
    """Return what the package calls a method of the study; methods that share intervals share a name."""
    for start in ("prediction_error", "equivalent"):
        if method.startswith(start):
            return start + (", windowed" if method.endswith("windowed") else "")
    return "bootstrap" if method.endswith("bootstrap") else method.removesuffix(" (q)")


def held_table(rows: list[dict[str, Any]]) -> dict[str, tuple[int, int, int]]:
    """Return method -> lowest and highest share, %, and seeds, of those whose intervals leave the limits somewhere.

    The worst of several quantities enters only where it leaves them: chance makes one of many the worst.
    """
    out = {}
    for name in sorted({product(r["method"]) for r in rows}):
        mine = [r for r in rows if product(r["method"]) == name]
        mine = [r for r in mine if "worst" not in r["quantity"] or r["within"] == "no"]
        if any(r["within"] == "no" for r in mine):
            shares = [round(100.0 * float(r["held"])) for r in mine]
            out[name] = (min(shares), max(shares), min(int(r["seeds"]) for r in mine))
    return out


def write_held(rows: list[dict[str, Any]], file: Path) -> None:
    """Write what the estimators' advice says of intervals that are only approximate."""
    lines = [f'    "{name}": {values},' for name, values in held_table(rows).items()]
    text = (
        '"""Written by tests/studies/estimator_study.py from results/estimators/intervals.csv."""\n\n'
        "HELD: dict[str, tuple[int, int, int]] = {\n" + "\n".join(lines) + "\n}\n"
        '"""Method -> least and largest share of its 95 % intervals that held the truth, %, and number of seeds."""\n'
    )
    file.write_text(text, encoding="utf-8")


def main(arguments: list[str] | None = None) -> None:
    """Run the study and write scatter_<aircraft>.csv and intervals.csv."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", choices=list(CONDITIONS), nargs="*", default=list(CONDITIONS)[: sized(None, 1)])
    parser.add_argument("--methods", choices=list(METHODS), nargs="*", default=list(METHODS)[: sized(None, 2)])
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of noise, for every method")
    parser.add_argument("--folder", type=Path, default=RESULTS)
    parser.add_argument("--raw", type=Path, default=RAW, help="where the estimates are kept seed by seed")
    parser.add_argument("--resume", action="store_true", help="keep the estimates that an interrupted study has left")
    parser.add_argument("--have", action="store_true", help="tables of what is kept, whatever it is; estimate nothing")
    given = parser.parse_args(arguments)
    given.folder.mkdir(parents=True, exist_ok=True)
    intervals: list[dict[str, Any]] = []
    with Progress() as progress:
        for name in given.aircraft:
            scatter = []
            for methods, prepare in KINDS:
                chosen = [m for m in methods if m in given.methods]
                case = prepare(name) if chosen else None
                for method in chosen:
                    assert case is not None
                    task = progress.add_task(f"{name} {method}", total=given.seeds)
                    if given.have:
                        done = kept(case, method, given.raw)[: given.seeds]
                        if len(done) < 2:
                            continue
                    else:
                        done = estimates(
                            case, method, given.seeds, given.raw, given.resume, lambda task=task: progress.advance(task)
                        )
                    if methods is LONGITUDINAL and "bootstrap" not in method:
                        scatter.append(scatter_row(case, method, done))
                    intervals += interval_rows(case, method, done)
                    progress.remove_task(task)
            write_rows(given.folder / f"scatter_{name}.csv", SCATTER, scatter)
    write_rows(given.folder / "intervals.csv", INTERVALS, intervals)
    if given.folder == RESULTS and set(given.methods) == set(METHODS) and set(given.aircraft) == set(CONDITIONS):
        write_held(intervals, HELD_TABLE)


if __name__ == "__main__":
    main()
