"""Time of an output-error fit: eight parameters of the ATTAS short period from two recorded runs.

Run with ``python tests/benchmarks/output_error_speed.py``. The laws: at most 0.3 s for both runs after warm-up, and at
least 50 times faster than the package ``aeroid`` on one run, where that package is installed and the recorded flights
are there (folder in TESTBENCH_FLIGHT_DATA). Times are the processor's: other work on the machine does not count.
"""

import importlib.util
import os
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since
from scipy.io import loadmat
from smallest import sized

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.structures import short_period

ROUNDS, LIMIT_S = sized((15, 0.3), (1, np.inf))
RATIO = 50.0
DT_S = 0.04
FOLDER = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", Path(__file__).resolve().parents[3] / "shared" / "flight_data"))


def records() -> list[FlightRecord]:
    """The two elevator 3-2-1-1 runs."""
    out = []
    for name in ("Elv1", "Elv2"):
        content = loadmat(FOLDER / "attas" / f"fAttas{name}.mat")
        k = next(value for key, value in content.items() if not key.startswith("__"))
        data = DEG_RAD * k[:, [12, 7, 21]]
        out.append(FlightRecord(DT_S * np.arange(len(k)), ("alpha", "q", "de"), data, "measured"))
    return out


def seconds(action) -> float:
    start = time.process_time()
    action()
    return since(start)


def by_aeroid(record: FlightRecord) -> dict[str, float]:
    """Return what aeroid's output error finds from about the same start values, its settings as they come."""
    import aeroid

    structure = short_period()

    def dynamics(t, x, u, p):
        return [
            p["Z_0"] + p["Z_alpha"] * x[0] + (1.0 + p["Z_q"]) * x[1] + p["Z_de"] * u[0],
            p["M_0"] + p["M_alpha"] * x[0] + p["M_q"] * x[1] + p["M_de"] * u[0],
        ]

    # it scales by the start values, which must not be zero therefore
    values = {name: value or 0.1 for name, value in zip(structure.parameter_names, structure.values, strict=True)}
    model = aeroid.Model(("alpha", "q"), ("de",), values, dynamics)
    data = aeroid.FlightData(record.t_s, {name: record[name] for name in ("alpha", "q", "de")})
    return dict(aeroid.identify(model, data, list(values)).parameters)


def main() -> None:
    """Print the times and say whether the laws hold."""
    if not (FOLDER / "attas").is_dir():
        print(f"skipped: no recorded flights in {FOLDER}")
        return
    runs, structure = records(), short_period()
    output_error.estimate(runs, structure)
    both = [seconds(lambda: output_error.estimate(runs, structure)) for _ in range(ROUNDS)]
    one = [seconds(lambda: output_error.estimate(runs[:1], structure)) for _ in range(ROUNDS)]
    print(
        f"ATTAS short period, 8 parameters: both runs {1e3 * statistics.median(both):.0f} ms (from "
        f"{1e3 * min(both):.0f} to {1e3 * max(both):.0f}), one run {1e3 * statistics.median(one):.0f} ms"
    )
    if statistics.median(both) > LIMIT_S:
        raise SystemExit(f"slower than {LIMIT_S:g} s")
    if importlib.util.find_spec("aeroid") is None:
        print("skipped: aeroid is not installed")
        return
    start = time.process_time()
    found = by_aeroid(runs[0])
    theirs = since(start)
    print(f"aeroid finds {', '.join(f'{name} {value:.4g}' for name, value in found.items())}")
    ratio = theirs / statistics.median(one)
    print(f"aeroid on one run: {theirs:.1f} s, {ratio:.0f} times as long")
    if ratio < RATIO:
        raise SystemExit(f"less than {RATIO:g} times faster")


if __name__ == "__main__":
    main()
