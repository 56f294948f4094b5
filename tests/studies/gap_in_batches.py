"""The gap workflow in batches against JSBSim: the same names, the same sizes, how long each takes.

``python tests/studies/gap_in_batches.py --cases 12`` runs the first cases of the last blind draw both ways;
``--cases 60`` those of all strata more than six times over. It ends with 1 if a name differs, or if a size differs by
more than a twentieth of its standard error, which is less than the page prints.
"""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from smallest import sized
from studies.blind.cases import opened
from studies.blind.rows import run_case

ALIKE = 0.05  # of a standard error: sizes are printed to two digits of it
_RESULTS = Path(__file__).resolve().parents[2] / "results" / "gap"


def main(arguments: list[str] | None = None) -> int:
    """Run the cases both ways and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=sized(12, 1), help="run so many cases")
    parser.add_argument("--results", type=Path, default=_RESULTS, help="folder of the blind test")
    asked = parser.parse_args(arguments)
    cases = opened((asked.results / "answers.json").read_text(encoding="utf-8").removesuffix("\n"))
    seconds, differ = [], 0
    for case in cases[: asked.cases]:
        batch, alone = run_case(case), run_case(case, simulator="jsbsim")
        seconds.append((alone["seconds"], batch["seconds"]))
        apart, same = _apart(batch, alone), (batch["outcome"], batch["names"]) == (alone["outcome"], alone["names"])
        differ += not same or apart > ALIKE
        print(
            f"{case.name}, {case.aircraft}: {alone['outcome']} {' | '.join(alone['names'])}; "
            f"{'the same' if same else 'in batches ' + batch['outcome'] + ' ' + ' | '.join(batch['names'])}; sizes "
            f"differ by {apart:.1g} standard errors; {alone['seconds']:.1f} s by JSBSim, {batch['seconds']:.1f} s",
            flush=True,
        )
    alone, batch = np.median(seconds, axis=0)
    print(
        f"{len(seconds)} cases, {differ} differ; median {alone:.1f} s of one core by JSBSim, {batch:.1f} s in batches"
    )
    return int(differ > 0)


def _apart(a: dict[str, Any], b: dict[str, Any]) -> float:
    """Return by how many standard errors the sizes of what is named differ at most; infinite for other effects."""
    if not (a["names"] or b["names"]):
        return 0.0
    if a["best"] != b["best"]:
        return float("inf")
    return max(abs(a["values"][n] - b["values"][n]) / b["errors"][n] for n in b["values"])


if __name__ == "__main__":
    raise SystemExit(main())
