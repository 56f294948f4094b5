"""How long the gap workflow takes over one case of six manoeuvres; run with ``make benchmarks``.

The law: the median case is named within 40 s of the clock, in one process.
"""

import os
import statistics
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import sized
from studies.blind.cases import draw
from studies.blind.rows import run_case

if __name__ == "__main__":
    clock = []
    for case in draw(1, sized({"library form": 2, "other form": 2, "nothing": 2}, {"nothing": 1})):
        start = time.perf_counter()
        row = run_case(case)
        clock.append(since(start, time.perf_counter))
        print(
            f"{case.name} ({case.aircraft}): {clock[-1]:.1f} s: {row['outcome']} {', '.join(row['names'])}", flush=True
        )
    print(f"median {statistics.median(clock):.1f} s, largest {max(clock):.1f} s")
