"""What flights in batches cost: over their number, their frames, elastic modes and operations, and in memory.

Run with ``python tests/benchmarks/batch_cost.py``; writes results/benchmarks/batch_cost.csv and batch_cost.png; with
``memory`` behind it batch_memory.csv, the memory of flights that are streamed, which takes some minutes. One
core, processor time, medians of several rounds in one run, the points of a line taking turns; straight lines fitted by
least squares. The flight in 200 that JSBSim flies as well is left out: it adds 1/200 of what it takes, but more to some
points of a line than to others. The machine's speed enters every number: compare ratios within one run.
"""

import gc
import os
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from statistics import median

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import psutil
from clock import since
from smallest import results, sized
from tables import write_rows

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.flight.batch import fly as batch
from testbench.flight.batch.check import judged
from testbench.flight.condition import TrimmedFlight
from testbench.page.figure import COLOURS, Curve, Panel, Plate, grid

ROUNDS, FLIGHTS, SECONDS = sized((7, 64, 10.0), (1, 4, 2.0))
NUMBERS, LENGTHS_S = sized(((32, 64, 128, 256, 512), (2.5, 5.0, 10.0, 20.0)), ((2, 4), (1.0, 2.0)))
MODES = sized((1, 2, 3, 4, 6, 8), (1, 2))
MODELS = {
    "taurus": (13.0, 100.0),
    "b1": (200.0, 3000.0),
    "jsbsim:c172p": (43.0, 1000.0),
    "jsbsim:f16": (180.0, 3000.0),
    "jsbsim:J3Cub": (30.0, 500.0),
}
STREAMED, VARIED = sized(((1_000, 10_000, 100_000), (1_000, 10_000, 20_000)), ((20, 40), (2, 4)))
KEPT = sized(512, 4)
CHANNELS = ("V", "alpha", "q", "theta", "az", "de", "h", "p")
OUT = results("benchmarks")
Case = tuple[Aircraft, TrimmedFlight]


@dataclass(frozen=True)
class Line:
    """One cost over what it grows with: points, and the straight line through them."""

    what: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    unit: str
    per: str

    @property
    def fit(self) -> tuple[float, float]:
        """Slope and value at zero."""
        slope, start = np.polyfit(self.x, self.y, 1)
        return float(slope), float(start)


def jobs(case: Case, seconds: float, channels: tuple[str, ...] | None = ("q",)) -> Iterator[tb.Job]:
    """Make flights without end, all different, logged at some 50 Hz."""
    aircraft, trimmed = case
    rate = trimmed.rate_hz
    t = np.arange(round(seconds * rate)) / rate
    k = 0
    while True:
        u = np.deg2rad(0.2) * (1.0 + k % 97) / 97.0 * ((t > 0.2) & (t < 0.6))
        signal = tb.InputSignal(t, u[:, None], ("de",))
        yield tb.Job(aircraft, trimmed, tb.Manoeuvre(f"{k}", signal, 0.0), rate / max(1, round(rate / 50.0)), channels)
        k += 1


def turns(work: Mapping[float, Callable[[], object]]) -> dict[float, float]:
    """Return the median processor time of each, s, all taking turns."""
    taken: dict[float, list[float]] = {x: [] for x in work}
    for _ in range(ROUNDS + 1):  # the first round warms up
        for x, call in work.items():
            start = time.process_time()
            call()
            taken[x].append(since(start))
    return {x: median(of[1:]) for x, of in taken.items()}


def flying(case: Case, seconds: float, flights: int) -> Callable[[], object]:
    """Return a call that flies so many flights, their inputs made before."""
    some = list(islice(jobs(case, seconds), flights))
    return lambda: sum(1 for _ in tb.fly_stream(some, "batch"))


def case_of(name: str, V_m_s: float, h_m: float, modes: int | None = None) -> Case:
    """Return an aircraft and its trim, with the first so many of its modes."""
    aircraft = tb.load_aircraft(name, commanded_at="surface")  # one cost of an airframe
    if modes is not None and aircraft.elastic is not None:
        kept = tuple(
            replace(
                m,
                force_eta={j: c for j, c in m.force_eta.items() if j <= modes},
                force_etadot={j: c for j, c in m.force_etadot.items() if j <= modes},
            )
            for m in aircraft.elastic.modes[:modes]
        )
        aircraft = replace(aircraft, elastic=replace(aircraft.elastic, modes=kept))
    return aircraft, tb.trim(aircraft, tb.FlightCondition(V_m_s, h_m))


def lines() -> list[Line]:
    """Measure cost over flights, frames, modes and operations."""
    taurus = case_of("taurus", *MODELS["taurus"])
    rate = taurus[1].rate_hz
    over_flights = turns({n: flying(taurus, SECONDS, n) for n in NUMBERS})
    over_frames = turns({s * rate: flying(taurus, s, FLIGHTS) for s in LENGTHS_S})
    elastic = {k: case_of("eolo", 16.0, 547.0, k) for k in MODES}
    over_modes = turns({k: flying(case, SECONDS, FLIGHTS) for k, case in elastic.items()})
    frames = {k: SECONDS * case[1].rate_hz * FLIGHTS for k, case in elastic.items()}
    models = {name: case_of(name, *at) for name, at in list(MODELS.items())[: sized(None, 1)]} | {
        f"eolo, {k} modes": elastic[k] for k in (MODES[0], MODES[-1])
    }
    per_frame: dict[float, float] = {}
    known = {}
    for name, case in models.items():
        model = judged(*case).model
        if model is None:
            print(f"{name} is left out: {judged(*case).reason}")
        else:
            known[float(len(model.program.frame))] = case
    for operations, seconds in turns({n: flying(case, SECONDS, FLIGHTS) for n, case in known.items()}).items():
        per_frame[operations] = 1e6 * seconds / (FLIGHTS * SECONDS * known[operations][1].rate_hz)
    return [
        line("flights", {n: 1e3 * s for n, s in over_flights.items()}, "ms", f"flight of {SECONDS:g} s, taurus"),
        line("frames", {n: 1e6 * s / FLIGHTS for n, s in over_frames.items()}, "us", "frame of a flight, taurus"),
        line("modes", {k: 1e6 * s / frames[k] for k, s in over_modes.items()}, "us", "mode and frame, eolo"),
        line("operations", per_frame, "us", "operation and frame, seven models"),
    ]


def line(what: str, points: Mapping[float, float], unit: str, per: str) -> Line:
    """Return the line through points, from the least on."""
    x = sorted(points)
    return Line(what, tuple(x), tuple(points[k] for k in x), unit, per)


def kept() -> list[Line]:
    """Measure the memory of records that are kept, over their samples, bytes allocated per flight."""
    case = case_of("taurus", *MODELS["taurus"])

    def held(seconds: float) -> tuple[int, float]:
        tracemalloc.start()
        before = tracemalloc.get_traced_memory()[0]
        records = list(islice(tb.fly_stream(jobs(case, seconds, CHANNELS), "batch"), KEPT))
        gc.collect()
        bytes_each = (tracemalloc.get_traced_memory()[0] - before) / len(records)
        tracemalloc.stop()
        assert isinstance(records[0], tb.FlightRecord)
        return records[0].data.size, bytes_each

    for seconds in LENGTHS_S:  # what is used again for every block of that length
        held(seconds)
    return [line("samples kept", dict(map(held, LENGTHS_S)), "bytes", f"sample, of {len(CHANNELS)} channels kept")]


def streamed(varied: bool) -> list[tuple[int, float]]:
    """Return the peak memory, MB, after so many flights that were given away, in a process of its own."""
    out = subprocess.run(
        [sys.executable, __file__, "--stream", "varied" if varied else "one"],
        check=True, capture_output=True, text=True, env={**os.environ},
    ).stdout  # fmt: skip
    return [(int(n), float(mb)) for n, mb in (row.split() for row in out.splitlines())]


def stream(varied: bool) -> None:
    """Fly and forget; print the most memory that the process was seen to have."""
    from testbench.aircraft.believed import varied as changed

    case = case_of("taurus", *MODELS["taurus"])

    def flights() -> Iterator[tb.Job]:
        for k, job in enumerate(jobs(case, 1.0)):
            aircraft = changed(case[0], {"aircraft.mass_percent": 1e-5 * k}, "drawn", "") if varied else case[0]
            yield replace(job, aircraft=aircraft)

    done, last, most = 0, 0.0, 0
    process = psutil.Process()
    found = tb.fly_stream(flights(), "batch")
    for number in VARIED if varied else STREAMED:
        for record in islice(found, number - done):
            assert isinstance(record, tb.FlightRecord)
            last += float(record["q"][-1])
            done += 1
            if done % 250 == 0:
                most = max(most, process.memory_info().rss)
        print(done, most / 2**20, flush=True)
    assert np.isfinite(last)


def plate(lines: Sequence[Line]) -> Plate:
    """Return the figure: one panel per line, points and the straight line through them."""

    panels = []
    for of in lines:
        slope, start = of.fit
        x = np.array([0.0, max(of.x)])
        fitted = Curve(x=x, y=start + slope * x, colour=COLOURS[0])
        panels.append(
            Panel(
                draws=[fitted, Curve(x=of.x, y=of.y, marker="o", colour=COLOURS[1])],
                title=f"{slope:.3g} {of.unit} per {of.per}",
                x=of.what,
                y=of.unit,
                x_range=(0.0, 1.05 * max(of.x)),
                y_range=(0.0, 1.15 * max(of.y)),
                tall_in=1.6,
            )
        )
    caption = "Points: medians. Lines: fitted."
    return Plate("batch_cost", "Cost of flights in batches", caption, grid(panels, 2))


def main() -> None:
    """Measure all, and write table and figure."""
    batch.BOTH = 1 << 40
    found = [*lines(), *kept()]
    rows = []
    for of in found:
        slope, start = of.fit
        fit = (of.unit, f"{slope:.3g}", f"{start:.3g}", of.per)
        rows += [(of.what, f"{x:g}", f"{y:.3g}", *fit) for x, y in zip(of.x, of.y, strict=True)]
        print(f"{of.what}: {slope:.3g} {of.unit} per {of.per}, {start:.3g} {of.unit} at zero")
    heads = ("over", "at", "cost", "unit", "slope", "at zero", "slope is per")
    write_rows(OUT / "batch_cost.csv", heads, rows)
    (OUT / "batch_cost.png").write_bytes(plate(found).draw().png)


def memory() -> None:
    """Measure the memory of flights that are streamed, and write the table."""
    rows = []
    for varied, words in ((False, "one model"), (True, "each with numbers of its own")):
        for number, mb in streamed(varied):
            rows.append((words, number, f"{mb:.0f}"))
            print(f"{number} flights streamed, {words}: {mb:.0f} MB at most")
    write_rows(OUT / "batch_memory.csv", ("streamed", "flights", "MB at most"), rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--stream"]:
        stream(sys.argv[2] == "varied")
    elif sys.argv[1:] == ["memory"]:
        memory()
    else:
        main()
