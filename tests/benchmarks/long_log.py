"""Time and memory of an hour at 400 Hz through import and identify: 180 manoeuvres of a small aircraft.

Run as a script; writes results/benchmarks/long_log.csv. The log is a NetCDF file of nine channels (127 MB) from the
linear longitudinal equations with white noise. Import and identify run as a user runs them, each in a process of its
own. The time is the processor's, because machines are shared. The laws: identify below 30 s and three times the memory
of the record.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from scipy.signal import cont2discrete, dlsim
from smallest import results, sized
from tables import write_rows

from testbench.core.record import FlightRecord

OUT = results("benchmarks", "long_log.csv")
RATE_HZ = 400
HOUR_S, MOST_S, MOST_TIMES = sized((3600, 30.0, 3.0), (60, np.inf, np.inf))
A = np.array([[-0.05, 4.0, 0.0, -9.81], [-0.04, -3.0, 0.97, 0.0], [0.0, -40.0, -4.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
B = np.array([[0.0], [-0.2], [-50.0], [0.0]])


def hour() -> FlightRecord:
    """Return the record: a 3-2-1-1 every 20 s, at 22 m/s."""
    n = RATE_HZ * HOUR_S
    t, rng = np.arange(n) / RATE_HZ, np.random.default_rng(0)
    since = np.mod(t - 5.0, 20.0)
    de = 0.04 * np.select([since < 0.9, since < 1.5, since < 1.8, since < 2.1], [1.0, -1.0, 1.0, -1.0], 0.0)
    discrete = (*cont2discrete((A, B, np.eye(4), np.zeros((4, 1))), 1.0 / RATE_HZ)[:4], 1.0 / RATE_HZ)
    x = dlsim(discrete, de[:, None])[1]
    clean = {"V": 22.0 + x[:, 0], "alpha": 0.05 + x[:, 1], "q": x[:, 2], "theta": 0.05 + x[:, 3], "ax": 0.3 + 0 * t,
             "p": 0 * t, "r": 0 * t, "h": 300.0 + 0 * t}  # fmt: skip
    noise = {"V": 0.2, "alpha": 0.002, "ax": 0.1, "h": 0.5}
    data = [y + noise.get(name, 0.003) * rng.standard_normal(n) for name, y in clean.items()]
    return FlightRecord(t, (*clean, "de"), np.column_stack([*data, de]), "measured")


def make(path: Path | str) -> float:
    """Write the record to a file; return its size in memory, MB."""
    record = hour()
    record.save(path)
    return (record.data.nbytes + record.t_s.nbytes + record.valid.nbytes) / 1e6


def cost(*words: object) -> tuple[float, float]:
    """Run a command of the package in a process of its own; return the processor's time, s, and its peak, MB."""
    script = (
        "import resource, sys\nfrom testbench.cli import main\n"
        "try:\n    code = main()\nexcept SystemExit as end:\n    code = end.code\n"
        "used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print(f'COST {used.ru_utime + used.ru_stime} {used.ru_maxrss / 1024.0} {code or 0}')\n"
    )
    done = subprocess.run([sys.executable, "-c", script, *map(str, words)], capture_output=True, text=True, check=True)
    seconds, peak, code = next(line for line in done.stdout.splitlines() if line.startswith("COST")).split()[1:]
    assert code == "0", done.stderr
    return float(seconds), float(peak)


def main() -> None:
    """Measure and write the table."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "hour.nc"
        # In a process of its own: those that it starts would begin with its peak.
        made = [sys.executable, "-c", "import long_log, sys; print(long_log.make(sys.argv[1]))", str(log)]
        told = subprocess.run(made, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
        size = float(told.stdout)
        imported = cost("import", log, "--out", Path(folder) / "out")
        identified = cost("identify", Path(folder) / "out" / "hour_longitudinal.toml", "--out", Path(folder) / "r")
    rows = [("import", *imported), ("identify", *identified)]
    heads = ("command", "record_MB", "processor_s", "peak_MB", "peak_over_record")
    write_rows(OUT, heads, ([n, f"{size:.0f}", f"{s:.1f}", f"{mb:.0f}", f"{mb / size:.2f}"] for n, s, mb in rows))
    print(OUT.read_text(encoding="utf-8"))
    assert identified[0] < MOST_S
    assert identified[1] < MOST_TIMES * size


if __name__ == "__main__":
    main()
