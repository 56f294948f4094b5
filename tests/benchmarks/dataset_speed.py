"""Speed and size of a data set: 10 000 flights of taurus for 20 s, sensed at 50 Hz by seven channels, by two workers.

Writes results/benchmarks/dataset.csv. ``processor_s`` is what this process and its workers take of a processor, which a
busy machine changes little; ``wall_s`` is the clock's, and ``load`` the number of processes that ran beside it.
"""

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import results, sized
from tables import write_rows

import testbench as tb

FLIGHTS = int(sys.argv[1]) if len(sys.argv) > 1 else sized(10_000, 20)
WORKERS = 2
SET = """
title = "Taurus, 20 s"
flights = 10000
seed = 1
licence = "CC0-1.0"
suite = "eolo_gap"
samples_hz = 50.0
simulation = { rate_hz = 100.0 }

[[manoeuvre]]
name = "doublet"
duration_s = 18.0
input = [{ signal = "doublet", control = "de", start_s = 0.5, amplitude_deg = 1.5, period_s = 0.8 }]

[[manoeuvre]]
name = "3211"
duration_s = 18.0
input = [{ signal = "3211", control = "de", start_s = 0.5, amplitude_deg = 1.2, step_s = 0.3 }]

[[level]]
name = "sensed"
aircraft = ["taurus"]
speed_ratio = [1.0, 1.25]
h_m = [100.0, 600.0]
vary = { "coefficient.Cm_alpha" = { kind = "normal", mean = 1.0, std = 0.1 } }
"""


def processor_s() -> float:
    """Return the seconds of a processor that this process and its ended children have taken."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in used)


def main() -> None:
    """Draw the set and write what it took."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "set.toml")
        file.write_text(SET, encoding="utf-8")
        tb.draw_dataset(file, Path(folder, "warm"), runs=16, workers=1)  # loads the kernels
        before, began = processor_s(), time.perf_counter()
        drawn = tb.draw_dataset(file, Path(folder, "set"), runs=FLIGHTS, workers=WORKERS)
        wall, used = since(began, time.perf_counter), processor_s() - before
        row = {
            "flights": FLIGHTS,
            "workers": WORKERS,
            "processor_s": f"{used:.1f}",
            "wall_s": f"{wall:.1f}",
            "load": f"{os.getloadavg()[0]:.1f}",
            "kB_per_flight": f"{drawn.layout.row_bytes / 1e3:.1f}",
            "MB": f"{drawn.size_bytes / 1e6:.0f}",
        }
    print(row)
    if FLIGHTS == 10_000:
        write_rows(results("benchmarks", "dataset.csv"), row, [row])


if __name__ == "__main__":
    main()
