"""Cost of a whole recorded flight against the bare JSBSim loop of the same model and length.

Run with ``make benchmarks``. Each round times both, one after the other, in one process; the ratio of each round is
taken and the median printed, of processor time, since machines are shared and noisy. The law: at most 1.25. A flight
also loads its model, which the loop does not: 3 to 7 % of 25 s; reads of the channels take as much again.
"""

import statistics
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since
from smallest import sized

from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim
from testbench.inputs.signal import InputSignal

ROUNDS, DURATION_S = sized((25, 25.0), (1, 2.0))


def seconds(action, clock=time.process_time) -> float:
    start = clock()
    action()
    return since(start, clock)


def compare(name: str, wings: str, condition: FlightCondition, log_rate_hz: float) -> None:
    """Print the median ratio over the rounds."""
    aircraft = load_aircraft(name, wings)
    trimmed = trim(aircraft, condition)
    rate = trimmed.rate_hz
    n = round(DURATION_S * rate)
    u = np.zeros((n, 1))
    u[: round(rate)] = 0.02
    manoeuvre = Manoeuvre("step", InputSignal(np.arange(n) / rate, u, ("de",)), settle_s=0.0)

    def bare() -> None:
        run = fdm.fdm.run
        for _ in range(n):
            run()

    ratios, flights, loops = [], [], []
    for _ in range(ROUNDS):
        fdm = Executive(aircraft, rate, condition)
        place_at_trim(fdm, trimmed)
        loops.append(seconds(bare))
        flights.append(seconds(lambda: fly(aircraft, trimmed, manoeuvre, log_rate_hz)))
        ratios.append(flights[-1] / loops[-1])
    print(
        f"{aircraft.name}: {DURATION_S:g} s at {rate:g} Hz, all channels at {log_rate_hz:g} Hz: "
        f"bare loop {1e3 * statistics.median(loops):.0f} ms, "
        f"recorded flight {1e3 * statistics.median(flights):.0f} ms, "
        f"ratio {statistics.median(ratios):.3f} (from {min(ratios):.3f} to {max(ratios):.3f})"
    )
    preparation = [seconds(lambda: trim(aircraft, condition)) for _ in range(ROUNDS)]
    linear = [seconds(lambda: linearise(aircraft, trimmed)) for _ in range(ROUNDS)]
    print(f"  trim {1e3 * statistics.median(preparation):.1f} ms, linearise {1e3 * statistics.median(linear):.1f} ms")


def start_up() -> None:
    """Print how long the command line takes to show its help."""
    command = [
        sys.executable,
        "-c",
        "import sys; sys.argv = ['testbench', '--help']; from testbench.cli import main; main()",
    ]
    show = partial(subprocess.run, command, capture_output=True, check=True)
    times = [seconds(show, time.perf_counter) for _ in range(ROUNDS)]
    low, middle, high = (1e3 * f(times) for f in (min, statistics.median, max))
    print(f"testbench --help: {middle:.0f} ms (from {low:.0f} to {high:.0f})")


if __name__ == "__main__":
    compare("eolo", "flexible", FlightCondition(16.0, 547.0), 100.0)
    compare("eolo", "rigid", FlightCondition(16.0, 547.0), 100.0)
    compare("taurus", "flexible", FlightCondition(12.0, 100.0), 40.0)
    start_up()
