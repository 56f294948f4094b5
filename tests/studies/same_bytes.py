"""Does a change of the code change a result? Each packaged scenario is run by two versions, the bytes compared.

    python tests/studies/same_bytes.py REVISION

runs every packaged scenario, description and question twice with the same seeds: with the package of REVISION, in a
work tree of its own, and with the package as it lies here. It then compares the bytes of every record, table and model
that the commands write. Pages, figures, titles and captions are counted apart or left out: words may be mended where
numbers may not.

What has been run is kept in build/same_bytes and is not run again; the version that lies here is named by the state of
its files. Recorded flights are taken from TESTBENCH_FLIGHT_DATA, and left out where there are none.
Exit status: 0 if records, tables and models are equal, 1 if any differs.
"""

import argparse
import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import build, sized
from tables import write_rows

from testbench.core.store import OWN

ROOT = Path(__file__).resolve().parents[2]
KEPT = build("same_bytes")
NUMBERS = {".nc": "records", ".csv": "tables", ".json": "tables and models", ".jsonl": "rows", ".toml": "scenarios"}
SHOWN = {".html": "pages", ".png": "figures", ".svg": "figures", ".pdf": "cards", ".txt": "texts", ".lua": "scripts"}
WORDS = ("title", "caption", "advice")
# Folder of scenarios -> the command that answers them.
COMMANDS = {
    "": ["run"],
    "reproduction": ["run"],
    "gap": ["gap"],
    "design": ["design"],
    "plan": ["plan"],
    "campaign": ["campaign", "run"],
    "compare": ["compare"],
    "modes": ["modes"],
    "records": ["identify"],
}


@dataclass(frozen=True)
class Job:
    """One command: words of the command line, and what its results folder is told apart by."""

    words: tuple[str, ...]

    @property
    def name(self) -> str:
        """Names the folder of its results."""
        return "_".join(w.strip("-").replace("/", ".") for w in self.words if "/" not in w or "scenarios" not in w)


def jobs(data: Path | None) -> list[Job]:
    """Return the commands, one for each packaged scenario and each other question."""
    out = []
    for folder, command in COMMANDS.items():
        for file in sorted((ROOT / "scenarios" / folder).glob("*.toml")):
            name = f"{folder}/{file.stem}".lstrip("/")
            if folder != "records":
                out.append(Job((*command, name)))
            elif data is not None:
                out.append(Job((*command, name, "--data", str(data))))
    out.append(Job(("gap", "--plan", "eolo_alpha")))
    out += [Job(("aircraft", name)) for name in ("b1", "eolo", "taurus")]
    if data is not None:
        out.append(Job(("compatibility", "records/attas_full", "--data", str(data))))
        out.append(Job(("response", "records/attas_short_period", "--window", "5", "--data", str(data))))
    for name in sorted(p.stem for p in (ROOT / "testbench").rglob("catalogue/*.md")):
        out.append(Job(("exercise", "start", name, "--student", "anna")))
    out.append(Job(("reproduce", "all")))
    return out


def run(job: Job, package: Path, folder: Path) -> str:
    """Run one job with the package that lies in ``package``; return its last words if it failed."""
    results = folder / job.name.replace(str(package), "")
    done = results.with_name(f"{results.name}.done")  # a name may hold dots: gap_gap.alpha_vane
    if done.is_file():
        return ""
    shutil.rmtree(results, ignore_errors=True)
    results.mkdir(parents=True)
    words = [*job.words, "--out", str(results / "anna" if job.words[0] == "exercise" else results)]
    if job.words[:2] == ("campaign", "run"):
        words += ["--workers", "1"]
    if job.words[0] == "gap" and "--plan" not in job.words:
        words += ["--workers", "1"]
    environment = os.environ | {"PYTHONPATH": str(package), "OPENBLAS_NUM_THREADS": "1"}
    code = "from testbench.cli import main; main()"
    ended = subprocess.run(
        [sys.executable, "-c", code, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if ended.returncode:
        return f"{' '.join(job.words)}: status {ended.returncode}: {ended.stderr[-400:]}"
    done.write_text(" ".join(words), encoding="utf-8")
    return ""


def hashes(folder: Path) -> dict[str, str]:
    """Return path -> SHA-256 of all files below a folder; of tables and models as JSON without their words."""
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(_numbers(p)).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.suffix != ".done" and OWN not in p.parts  # a manifest tells command and version
    }


def _numbers(path: Path) -> bytes:
    """Return the content of a file without its words: title and caption of a table, advice of a model."""
    content = path.read_bytes()
    said = json.loads(content) if path.suffix == ".json" else None
    if isinstance(said, dict):
        return json.dumps({k: v for k, v in said.items() if k not in WORDS}, sort_keys=True).encode()
    return content


def state_of_files() -> str:
    """Return a name for the package as it lies here: a hash over its files."""
    total = hashlib.sha256()
    for path in sorted(p for d in ("testbench", "aircraft_models", "scenarios") for p in (ROOT / d).rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            total.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return f"here_{total.hexdigest()[:12]}"


def snapshot(name: str) -> Path:
    """Return a copy of the package as it lies here, so that it may change while it is run."""
    tree = KEPT / f"tree_{name}"
    for folder in ("testbench", "aircraft_models", "scenarios"):
        shutil.copytree(ROOT / folder, tree / folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    return tree


def work_tree(revision: str) -> tuple[str, Path]:
    """Return the name of a revision and a folder with its files."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short=12", revision], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    tree = KEPT / f"tree_{commit}"
    if not tree.is_dir():
        tree.mkdir(parents=True)
        packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
        subprocess.run(["tar", "-x", "-C", str(tree)], input=packed, check=True)
    return commit, tree


def run_all(package: Path, name: str, todo: list[Job], workers: int) -> Path:
    """Run the jobs with a package; return the folder of their results."""
    folder = KEPT / name
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(workers) as pool:
        for job, fault in zip(todo, pool.map(lambda j: run(j, package, folder), todo), strict=True):
            print(f"{name}: {' '.join(job.words[:3])}" + (f": FAILED: {fault}" if fault else ""), flush=True)
    return folder


def main() -> None:
    """Run both versions and compare them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revision", help="what the package here is compared with: a commit, tag or branch")
    parser.add_argument("--only", default=sized("", "aircraft taurus"), help="only commands with this text")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--before", action="store_true", help="only run the revision, so that it is ready")
    asked = parser.parse_args()
    beside = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", ROOT.parent / "shared" / "flight_data")).resolve()
    todo = [j for j in jobs(beside if beside.is_dir() else None) if asked.only in " ".join(j.words)]
    commit, tree = work_tree(asked.revision)
    before = run_all(tree, commit, todo, asked.workers)
    if asked.before:
        return
    here = state_of_files()
    after = run_all(snapshot(here), here, todo, asked.workers)
    one = {p: h for j in todo for p, h in under(before, j).items()}
    two = {p: h for j in todo for p, h in under(after, j).items()}
    sys.exit(compare(one, two, (before, after)))


def under(folder: Path, job: Job) -> dict[str, str]:
    """Return path -> hash of the files of one job."""
    return {f"{job.name}/{path}": value for path, value in hashes(folder / job.name).items()}


def compare(one: dict[str, str], two: dict[str, str], folders: tuple[Path, Path]) -> int:
    """Print how many files of each kind are equal, write those that are not; return the exit status."""
    rows, numbers_differ = [], 0
    for suffix, words in {**NUMBERS, **SHOWN}.items():
        paths = sorted(p for p in one.keys() | two.keys() if Path(p).suffix == suffix)
        other = [p for p in paths if one.get(p) != two.get(p)]
        if paths:
            print(f"{words} ({suffix}): {len(paths) - len(other)} of {len(paths)} equal")
        rows += [(p, one.get(p, "missing")[:12], two.get(p, "missing")[:12]) for p in other]
        numbers_differ += len(other) if suffix in NUMBERS else 0
    write_rows(KEPT / "differences.csv", ("file", "before", "after"), rows)
    for path, _, _ in [r for r in rows if Path(r[0]).suffix in NUMBERS][:40]:
        print(f"differs: {path}{_by_how_much(folders, path)}")
    return 1 if numbers_differ else 0


def _by_how_much(folders: tuple[Path, Path], path: str) -> str:
    """Return the largest relative difference of the numbers of two CSV files, in words; "" for other files."""
    if not path.endswith(".csv") or not all((f / path).is_file() for f in folders):
        return ""
    cells = [[c for row in csv.reader((f / path).open(encoding="utf-8")) for c in row] for f in folders]
    if len(cells[0]) != len(cells[1]):
        return ": another number of cells"
    largest = 0.0
    for a, b in zip(*cells, strict=True):
        if a != b:
            try:
                largest = max(largest, abs(float(a) - float(b)) / max(abs(float(a)), abs(float(b))))
            except ValueError:
                return f": '{a}' and '{b}'"
    return f": by {largest:.1e} of the numbers at most"


if __name__ == "__main__":
    main()
