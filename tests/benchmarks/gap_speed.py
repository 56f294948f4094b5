"""How long the gap workflow takes over one case of six manoeuvres; run with ``make benchmarks``.

The law, on two cores: the median case is named within 40 s of the clock. The same cases in one process, in the same
run, tell what the second one is worth; both say the same.
"""

from __future__ import annotations

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

from testbench.questions.gap.search.parallel import cores, processes

if __name__ == "__main__":
    cases = draw(1, sized({"library form": 2, "other form": 2, "nothing": 2}, {"nothing": 1}))
    both = min(2, cores())
    clocks: dict[int, list[float]] = {1: [], both: []}
    for case in cases:
        said = []
        for count, clock in clocks.items():
            start = time.perf_counter()
            with processes(count):
                row = run_case(case)
            clock.append(since(start, time.perf_counter))
            said.append({k: v for k, v in row.items() if k != "seconds"})
        alike = "the same answer" if all(s == said[0] for s in said) else "DIFFERENT ANSWERS"
        times = " and ".join(f"{clock[-1]:.1f} s in {count}" for count, clock in clocks.items())
        print(f"{case.name} ({case.aircraft}): {times} processes, {alike}: {said[0]['outcome']}", flush=True)
    medians = {count: statistics.median(clock) for count, clock in clocks.items()}
    print(f"median {medians[both]:.1f} s in {both} processes, {medians[1] / medians[both]:.2f} times as fast as in one")
