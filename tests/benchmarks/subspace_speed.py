"""Time of a subspace estimate: every method here, and the peers that are installed, on the same data.

Run as a script: 100 000 samples (and 5000 for peers whose memory grows with the square of that), 2 inputs, 5 outputs,
order 4, horizons 20, one thread of BLAS. Peers: SLICOT's moen4 through GNU Octave, SIPPY, nfoursid; those that are
absent are left out and named. Times are the processor's: other work on the machine does not count. The laws: no slower
than moen4, and ten times as fast as the other two. DSR_e solves two problems one after the other; it takes three times
as long as the family and is not held to moen4. Memory: the peak beyond the record itself, in multiples of the record's
56 bytes per sample, which must not rise with its length.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import importlib.util
import shutil
import statistics
import subprocess
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np

from testbench.estimators.subspace import dsr_e
from testbench.estimators.subspace.family import FAMILY, estimate
from testbench.record import FlightRecord

ROUNDS = 5
HORIZON, ORDER = 20, 4
INPUTS, OUTPUTS = ("de", "da"), ("alpha", "q", "beta", "p", "r")
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
        times.append(time.process_time() - start)
    return statistics.median(times)


def ours(z: np.ndarray) -> dict[str, float]:
    """Return the time of each method."""
    record = FlightRecord(np.arange(len(z)) * 0.02, (*INPUTS, *OUTPUTS), z, "measured")
    settings = {"past_horizon": HORIZON, "future_horizon": HORIZON, "order": ORDER}
    times = {
        name: median_seconds(lambda name=name: estimate([record], INPUTS, OUTPUTS, method=name, **settings))
        for name in FAMILY
    }
    times["dsr_e"] = median_seconds(lambda: dsr_e.estimate([record], INPUTS, OUTPUTS, **settings), rounds=3)
    return times


def peak_over_record(samples: int, method: str) -> float:
    """Return the peak of the memory that an estimate takes, over the size of its record."""
    z = simulated(samples)
    record = FlightRecord(np.arange(len(z)) * 0.02, (*INPUTS, *OUTPUTS), z, "measured")
    settings = {"past_horizon": HORIZON, "future_horizon": HORIZON, "order": ORDER}
    tracemalloc.start()
    if method == "dsr_e":
        dsr_e.estimate([record], INPUTS, OUTPUTS, **settings)
    else:
        estimate([record], INPUTS, OUTPUTS, method=method, **settings)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / z.nbytes


def octave(z: np.ndarray) -> float | None:
    """Return the time of moen4, without starting Octave and reading the data; None without Octave."""
    if shutil.which("octave-cli") is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "data.csv"
        np.savetxt(file, z, delimiter=",")
        code = OCTAVE.format(file=file, rounds=ROUNDS, order=ORDER, horizon=HORIZON)
        done = subprocess.run(["octave-cli", "--eval", code], capture_output=True, text=True, check=False)
    times = [float(line) for line in done.stdout.split()]
    return statistics.median(times) if times else None


def python_peers(z: np.ndarray) -> dict[str, float | None]:
    """Return the times of SIPPY's MOESP and of nfoursid, None for one that is absent."""
    times: dict[str, float | None] = {"SIPPY": None, "nfoursid": None}
    if importlib.util.find_spec("sippy_unipi") is not None:
        sippy = importlib.import_module("sippy_unipi")
        settings = {"SS_fixed_order": ORDER, "SS_f": HORIZON, "SS_p": HORIZON}
        times["SIPPY"] = median_seconds(
            lambda: sippy.system_identification(z[:, 2:].T, z[:, :2].T, "MOESP", **settings), rounds=1
        )
    if importlib.util.find_spec("nfoursid") is not None:
        import pandas as pd
        from nfoursid.nfoursid import NFourSID

        table = pd.DataFrame(z, columns=[*INPUTS, *OUTPUTS])

        def run() -> None:
            peer = NFourSID(table, output_columns=list(OUTPUTS), input_columns=list(INPUTS), num_block_rows=HORIZON)
            peer.subspace_identification()
            peer.system_identification(rank=ORDER)

        times["nfoursid"] = median_seconds(run, rounds=1)
    return times


def show(title: str, times: dict[str, float | None]) -> None:
    """Print one line per method."""
    print(title)
    for name, seconds in times.items():
        print(f"  {name:10s} " + ("absent" if seconds is None else f"{1e3 * seconds:8.1f} ms"))


def main() -> None:
    """Print times and memory; end with an error where a law is broken."""
    long, short = simulated(100_000), simulated(5000)
    fast, peer = ours(long), octave(long)
    show("100 000 samples", {"moen4": peer, **fast})
    broken = [
        f"{name} is slower than moen4" for name, seconds in fast.items() if peer and name in FAMILY and seconds > peer
    ]
    fast, peers = ours(short), python_peers(short)
    show("5000 samples", {**peers, **fast})
    broken += [
        f"{name} is only {theirs / seconds:.1f} times as fast as {other}"
        for other, theirs in peers.items()
        for name, seconds in fast.items()
        if theirs is not None and theirs < 10.0 * seconds
    ]
    print("peak of memory over the record, 25 000 and 100 000 samples")
    for method in ("moesp", "pbsid_opt", "dsr_e"):
        low, high = (peak_over_record(samples, method) for samples in (25_000, 100_000))
        print(f"  {method:10s} {low:6.2f} {high:6.2f}")
        if high > 1.1 * low:
            broken.append(f"the memory of {method} rises faster than the number of samples")
    if broken:
        raise SystemExit("; ".join(broken))


if __name__ == "__main__":
    main()
