"""What the open set makes of blind cases that the library leaves unexplained.

    python tests/studies/open_set.py 20

reads results/gap, takes so many cases of the blind draw whose row is "unexplained" (kinds that no library holds, and
effects that were taken out of it), looks at their forces and moments, flies what they propose, and prints what was
hidden beside what is named. A name counts only if the instruments agree with each other.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since
from smallest import sized
from studies.blind.cases import SHORT, opened
from studies.blind.run import believe

from testbench.questions.gap.decide import Naming
from testbench.questions.gap.evidence.check import check_data
from testbench.questions.gap.open_set import first_look, named_openly

FOLDER = Path(__file__).parents[2] / "results" / "gap"


def main(count: int) -> None:
    """Print a line for each of ``count`` cases."""
    cases = {c.name: c for c in opened((FOLDER / "answers.json").read_text(encoding="utf-8"))}
    rows = [json.loads(line) for line in (FOLDER / "rows.jsonl").read_text(encoding="utf-8").splitlines()]
    left = [r["case"] for r in rows if r["outcome"] == "unexplained" and not r["case"].endswith(SHORT)]
    for name in np.random.default_rng(1).permutation(left)[:count]:
        case, began = cases[name.split(",")[0]], time.process_time()
        believed, records, held = believe(case.aircraft), case.fly("rich"), list(case.fly("held_out").values())
        first = first_look(believed, records)
        unexplained = Naming("unexplained", (), (), 0.0, 0.0, {}, 1, "")
        naming = named_openly(unexplained, first, believed, list(records.values()), held, lambda stage: None)
        doubt = bool(naming.names) and bool(check_data(believed, list(records.values())).news)
        said = "unexplained, the instruments disagree" if doubt else " | ".join(naming.names) or naming.outcome
        print(f"{name} ({case.aircraft}): {', '.join(case.kinds)} -> {said} ({since(began):.0f} s)")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else sized(20, 1))
