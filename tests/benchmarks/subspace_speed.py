"""Time of a subspace estimate: every method here, and the peers that are installed, on the same data.

Run as a script: 100 000 samples (and 5000 for peers whose memory grows with the square of that), 2 inputs, 5 outputs,
order 4, horizons 20, one thread of BLAS. Peers: SLICOT's moen4 through GNU Octave, SIPPY, nfoursid; those that are
absent are left out and named. Times are the processor's: other work on the machine does not count, but for what it
takes of the caches; moen4 is therefore timed before and after ours in the same run. The laws: no slower than moen4, and
ten times as fast as the other two, for the family and for DSR_e in both variants with their self-checks at other
horizons, which moen4 has none of. Memory: the peak beyond the record itself, in multiples of the record's 56 bytes per
sample, which must not rise with its length and stay below eight.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import importlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since, some
from smallest import sized

from testbench.core.record import FlightRecord
from testbench.estimators.settings import DsrE, Subspace
from testbench.estimators.subspace import dsr_e
from testbench.estimators.subspace.family import PREDICTORS, PROJECTIONS, estimate

ROUNDS, LONG, SHORT, GROWING = sized((5, 100_000, 5000, (25_000, 100_000)), (1, 3000, 1000, (2000, 4000)))
HORIZON, ORDER = 20, 4
VARIANTS = {"dsr_e": "original", "dsr_e eolo": "eolo"}
INPUTS, OUTPUTS = ("de", "da"), ("alpha", "q", "beta", "p", "r")
LIMITS = {"moen4": 1.0, "SIPPY": 0.1, "nfoursid": 0.1}  # of our time over the peer's
MOST_MEMORY = 8.0
OCTAVE = """
pkg load control
z = csvread ("{file}");
data = iddata (z(:, 3:end), z(:, 1:2), 0.02);
for k = 1:{rounds}
  t = cputime; moen4 (data, "n", {order}, "s", {horizon}); printf ("%.6f\\n", cputime - t);
endfor
"""


def simulated(samples: int) -> np.ndarray:
    """Return inputs and outputs (samples, 7) of a fourth-order system, white inputs, 5 % noise."""
    rng = np.random.default_rng(1)
    A = np.array([[0.95, 0.1, 0.0, 0.0], [-0.1, 0.95, 0.0, 0.0], [0.0, 0.0, 0.99, 0.05], [0.0, 0.0, -0.05, 0.98]])
    B, C = rng.standard_normal((4, 2)), rng.standard_normal((5, 4))
    u = rng.choice([-1.0, 1.0], size=(samples, 2))
    x = np.zeros((samples, 4))
    for k in range(samples - 1):
        x[k + 1] = A @ x[k] + B @ u[k]
    y = x @ C.T
    return np.hstack([u, y + 0.05 * y.std(axis=0) * rng.standard_normal(y.shape)])


def median_seconds(action: Callable[[], object], rounds: int = ROUNDS) -> float:
    """Return the median time of an action."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        action()
        times.append(since(start))
    return statistics.median(times)


def ours(z: np.ndarray) -> dict[str, float]:
    """Return the time of each method."""
    record = FlightRecord(np.arange(len(z)) * 0.02, (*INPUTS, *OUTPUTS), z, "measured")
    settings = {"past_horizon": HORIZON, "future_horizon": HORIZON, "order": ORDER}
    times = {
        name: median_seconds(lambda name=name: estimate([record], INPUTS, OUTPUTS, Subspace(method=name, **settings)))
        for name in (*PROJECTIONS, *PREDICTORS)
    }
    for name, variant in VARIANTS.items():
        times[name] = median_seconds(
            lambda variant=variant: dsr_e.estimate([record], INPUTS, OUTPUTS, DsrE(variant=variant, **settings))
        )
    return times


def peak_over_record(samples: int, method: str) -> float:
    """Return the peak of the memory that an estimate takes, over the size of its record."""
    z = simulated(samples)
    record = FlightRecord(np.arange(len(z)) * 0.02, (*INPUTS, *OUTPUTS), z, "measured")
    settings = {"past_horizon": HORIZON, "future_horizon": HORIZON, "order": ORDER}
    tracemalloc.start()
    if method in VARIANTS:
        dsr_e.estimate([record], INPUTS, OUTPUTS, DsrE(variant=VARIANTS[method], **settings))
    else:
        estimate([record], INPUTS, OUTPUTS, Subspace(method=method, **settings))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / z.nbytes


def octave(z: np.ndarray) -> list[float]:
    """Return the times of moen4, without starting Octave and reading the data; none without Octave."""
    if shutil.which("octave-cli") is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "data.csv"
        np.savetxt(file, z, delimiter=",")
        code = OCTAVE.format(file=file, rounds=ROUNDS, order=ORDER, horizon=HORIZON)
        done = subprocess.run(["octave-cli", "--eval", code], capture_output=True, text=True, check=False)
    return [some(float(line)) for line in done.stdout.split()]


def python_peers(z: np.ndarray) -> dict[str, float | None]:
    """Return the times of SIPPY's MOESP and of nfoursid, None for one that is absent or lacks what it imports."""
    times: dict[str, float | None] = {"SIPPY": None, "nfoursid": None}
    with suppress(ImportError):  # its package does not declare all that it imports
        sippy = importlib.import_module("sippy_unipi")
        settings = {"SS_fixed_order": ORDER, "SS_f": HORIZON, "SS_p": HORIZON}
        times["SIPPY"] = median_seconds(
            lambda: sippy.system_identification(z[:, 2:].T, z[:, :2].T, "MOESP", **settings), rounds=1
        )
    with suppress(ImportError):
        import pandas as pd
        from nfoursid.nfoursid import NFourSID

        table = pd.DataFrame(z, columns=[*INPUTS, *OUTPUTS])

        def run() -> None:
            peer = NFourSID(table, output_columns=list(OUTPUTS), input_columns=list(INPUTS), num_block_rows=HORIZON)
            peer.subspace_identification()
            peer.system_identification(rank=ORDER)

        times["nfoursid"] = median_seconds(run, rounds=1)
    return times


def show(title: str, times: dict[str, float], peers: dict[str, float | None]) -> list[str]:
    """Print one line per method, with its time over each peer's; return the laws that are broken."""
    print(title)
    present = {name: seconds for name, seconds in peers.items() if seconds is not None}
    for name, seconds in peers.items():
        print(f"  {name:10s} " + ("absent" if seconds is None else f"{1e3 * seconds:8.1f} ms"))
    broken = []
    for name, seconds in times.items():
        ratios = "".join(f"  {seconds / theirs:7.3f} of {peer}" for peer, theirs in present.items())
        print(f"  {name:10s} {1e3 * seconds:8.1f} ms{ratios}")
        for peer, theirs in present.items():
            if seconds > LIMITS[peer] * theirs:
                broken.append(f"{name} takes {seconds / theirs:.3f} of the time of {peer}, {LIMITS[peer]} is the law")
    return broken


def main() -> None:
    """Print times and memory; end with an error where a law is broken."""
    long, short = simulated(LONG), simulated(SHORT)
    rounds = octave(long)
    fast = ours(long)
    rounds += octave(long)
    broken = show(f"{LONG} samples", fast, {"moen4": statistics.median(rounds) if rounds else None})
    broken += show(f"{SHORT} samples", ours(short), python_peers(short))
    print(f"peak of memory over the record, {GROWING[0]} and {GROWING[1]} samples")
    for method in ("moesp", "pbsid_opt", *VARIANTS):
        low, high = (peak_over_record(samples, method) for samples in GROWING)
        print(f"  {method:10s} {low:6.2f} {high:6.2f}")
        if high > 1.1 * low:
            broken.append(f"the memory of {method} rises faster than the number of samples")
        if high > MOST_MEMORY:
            broken.append(f"{method} takes {high:.1f} times the record's memory, {MOST_MEMORY:g} is the law")
    if broken and sized(True, False):
        raise SystemExit("; ".join(broken))


if __name__ == "__main__":
    main()
