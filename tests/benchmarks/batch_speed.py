"""Flights per second by batches and by JSBSim, trims, and the first use of a model.

Run with ``make benchmarks``; writes results/benchmarks/batch.csv. Flights of 25 s, one core, processor time, the two
taking turns; medians of several rounds of the ratio. All that a call does is counted: checks of the inputs and records.
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since
from smallest import results, sized
from tables import write_rows

import testbench as tb
from testbench.aircraft import Aircraft
from testbench.flight.batch.check import compared
from testbench.flight.batch.model import batch_model
from testbench.flight.condition import TrimmedFlight
from testbench.questions.campaign.draws import change_aircraft

FLIGHTS, ALONE, ROUNDS, DURATION_S = sized((256, 4, 5, 25.0), (4, 1, 1, 2.0))
CASES = (
    ("taurus, rigid", "taurus", 13.0, 100.0),
    ("eolo, eight modes", "eolo", 16.0, 547.0),
    ("b1, flexible", "b1", 200.0, 3000.0),
    ("c172p", "jsbsim:c172p", 43.0, 1000.0),
)
OUT = results("benchmarks", "batch.csv")


def doublets(aircraft: Aircraft, trimmed: TrimmedFlight) -> list[tb.Manoeuvre]:
    """Return as many inputs as flights, all different."""
    t = np.arange(round(DURATION_S * trimmed.rate_hz)) / trimmed.rate_hz
    out = []
    for k in range(FLIGHTS):
        start = 1.0 + 0.01 * k
        up, down = (t > start) & (t < start + 0.5), (t >= start + 0.5) & (t < start + 1.0)
        u = np.deg2rad(1.0) * (up.astype(float) - down)
        out.append(tb.Manoeuvre(f"doublet {k}", tb.InputSignal(t, u[:, None], ("de",)), settle_s=0.0))
    return out


def seconds(work: Callable[[], object]) -> float:
    """Return the processor time of a call."""
    start = time.process_time()
    work()
    return since(start)


def measured(name: str, V_m_s: float, h_m: float) -> dict[str, float]:
    """Return what one aircraft takes, ms of processor time per flight or trim."""
    aircraft, condition = tb.load_aircraft(name), tb.FlightCondition(V_m_s, h_m)
    trimmed = tb.trim(aircraft, condition)
    inputs, channels = doublets(aircraft, trimmed), ("V", "alpha", "q", "theta", "az", "de", "h")
    log = trimmed.rate_hz / max(1, round(trimmed.rate_hz / 50.0))
    jobs = [tb.Job(aircraft, trimmed, one, log, channels) for one in inputs]
    varied = [change_aircraft(aircraft, {"aircraft.mass_percent": 0.01 * k}) for k in range(sized(64, 4))]

    def together() -> object:
        return tb.fly_many(jobs, "batch")

    def alone() -> object:
        return tb.fly_many(jobs[:ALONE], "jsbsim")

    started = time.perf_counter()
    model = batch_model(aircraft, trimmed.rate_hz, condition)
    translated = since(started, time.perf_counter)
    together()
    compared(model, trimmed)  # compiled by now
    judge = seconds(lambda: compared(model, trimmed))
    tb.trim_many(varied[:2], [condition] * 2)
    rows = []
    for _ in range(ROUNDS):
        one, many = seconds(alone) / ALONE, seconds(together) / FLIGHTS
        trims = seconds(lambda: tb.trim_many(varied, [condition] * len(varied))) / len(varied)
        trim = seconds(lambda: [tb.trim(a, condition) for a in varied[:ALONE]]) / ALONE
        rows.append((one, many, one / many, trim, trims, trim / trims))
    one, many, ratio, trim, trims, of_trims = (median(column) for column in zip(*rows, strict=True))
    return {
        "jsbsim_ms": 1e3 * one, "batch_ms": 1e3 * many, "times": ratio, "trim_ms": 1e3 * trim,
        "batch_trim_ms": 1e3 * trims, "trims_times": of_trims, "translate_ms": 1e3 * translated, "judge_s": judge,
        "operations": float(len(model.program.frame)), "kB_per_flight": 8e-3 * model.program.size,
    }  # fmt: skip


if __name__ == "__main__":
    rows = []
    for words, *case in CASES[: sized(None, 1)]:
        row = measured(*case)
        rows.append({"aircraft": words} | {k: f"{v:.3g}" for k, v in row.items()})
        flights = f"{row['jsbsim_ms']:.1f} ms by JSBSim, {row['batch_ms']:.2f} in a batch, {row['times']:.0f} times"
        print(f"{words}: {flights}; trim {row['trim_ms']:.1f} and {row['batch_trim_ms']:.2f} ms")
    write_rows(OUT, rows[0], rows)
