"""A frame of one flight by JSBSim, in a batch, in C, in a unit for co-simulation and in JAX.

Run with ``make benchmarks``; writes results/benchmarks/export.csv. Processor time of one core, microseconds a frame and
flight, medians of several rounds in which all take turns. By JSBSim and in C the frame alone, inputs held; a unit flies
many frames in a step of a master, and one frame in a step of fmpy; JAX one flight, and 64 side by side.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import fmpy
import jax
import numpy as np
from clock import since
from smallest import results, sized
from tables import write_rows

import testbench as tb
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

FRAMES, ROUNDS = sized((20000, 7), (100, 1))
CASES = (
    ("taurus, rigid", "taurus", 12.0, 100.0),
    ("eolo, eight modes", "eolo", 16.0, 547.0),
    ("c172p", "jsbsim:c172p", 43.0, 1000.0),
)
ABREAST = 64
MAIN = """
#include <stdio.h>
#include <time.h>
#include "{stem}.h"
int main(void)
{{
    {stem}_state m;
    double y[{great}_OUTPUTS];
    clock_t begun;
    int i;
    {stem}_init(&m);
    begun = clock();
    for (i = 0; i < {frames}; i++) {stem}_step(&m, {stem}_trim);
    begun = clock() - begun;
    {stem}_outputs(&m, y);
    printf("%.9g %.9g\\n", 1e6 * begun / CLOCKS_PER_SEC / {frames}, y[0]);
    return 0;
}}
"""


def microseconds(work: Callable[[], object], frames: int) -> float:
    """Return the processor time of a call per frame, us."""
    start = time.process_time()
    work()
    return 1e6 * since(start) / frames


def in_c(folder: Path, stem: str) -> Callable[[], float]:
    """Return what flies in C and says what a frame took, us."""
    (folder / "main.c").write_text(MAIN.format(stem=stem, great=stem.upper(), frames=FRAMES))
    subprocess.run(["cc", "-O2", "main.c", f"{stem}.c", "-lm", "-o", "flight"], cwd=folder, check=True)
    return lambda: float(subprocess.run([folder / "flight"], capture_output=True, check=True).stdout.split()[0])


def measured(name: str, V_m_s: float, h_m: float) -> dict[str, float]:
    """Return what a frame takes of one aircraft, us, and what JAX takes to compile, s."""
    aircraft, condition = tb.load_aircraft(name), tb.FlightCondition(V_m_s, h_m)
    trimmed = tb.trim(aircraft, condition)
    fdm = Executive(aircraft, trimmed.rate_hz, condition)
    t = np.arange(FRAMES) / trimmed.rate_hz
    still = tb.Manoeuvre("still", tb.InputSignal(t, np.zeros((FRAMES, 1)), ("de",)), 0.0)
    log = trimmed.rate_hz / round(trimmed.rate_hz / 50.0)
    many = [still] * sized(64, 8)
    place = Path(tempfile.mkdtemp())
    code, _ = tb.export_aircraft(aircraft, "c", place, condition)
    (unit,) = tb.export_aircraft(aircraft, "fmu3", place, condition)
    flown = in_c(code.parent, code.stem)
    described = fmpy.read_model_description(str(unit))
    slave = fmpy.instantiate_fmu(fmpy.extract(str(unit), str(place / "unit")), described, "CoSimulation")
    plane, dt = tb.as_jax(aircraft, trimmed), 1.0 / trimmed.rate_hz

    def held(state: jax.Array) -> jax.Array:
        return jax.lax.scan(lambda s, _: (plane.step(s, plane.inputs), None), state, None, FRAMES // 10)[0]

    def steps(count: int, frames: int) -> None:
        slave.reset()
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        for k in range(count):
            slave.doStep(currentCommunicationPoint=k * frames * dt, communicationStepSize=frames * dt)

    started = time.process_time()
    one = jax.jit(held).lower(plane.state).compile()
    compiled = since(started)
    abreast = jax.jit(jax.vmap(held)).lower(jax.numpy.tile(plane.state, (ABREAST, 1))).compile()
    beside = jax.numpy.tile(plane.state, (ABREAST, 1))
    rows = []
    for _ in range(ROUNDS):
        place_at_trim(fdm, trimmed)
        rows.append({
            "jsbsim_us": microseconds(lambda: [fdm.fdm.run() for _ in range(FRAMES)], FRAMES),
            "batch_us": microseconds(
                lambda: tb.fly_many([tb.Job(aircraft, trimmed, m, log, ("q",)) for m in many], "batch"),
                FRAMES * len(many),
            ),
            "c_us": flown(),
            "fmu_us": microseconds(lambda: steps(1, FRAMES), FRAMES),
            "fmpy_us": microseconds(lambda: steps(FRAMES // 10, 1), FRAMES // 10),
            "jax_us": microseconds(lambda: jax.block_until_ready(one(plane.state)), FRAMES // 10),
            "jax_64_us": microseconds(lambda: jax.block_until_ready(abreast(beside)), FRAMES // 10 * ABREAST),
        })  # fmt: skip
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(place)
    return {key: median(row[key] for row in rows) for key in rows[0]} | {"jax_compile_s": compiled}


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    rows = []
    for words, *case in CASES[: sized(None, 1)]:
        rows.append({"aircraft": words} | {k: f"{v:.3g}" for k, v in measured(*case).items()})
        print(", ".join(f"{k} {v}" for k, v in rows[-1].items()))
    write_rows(results("benchmarks", "export.csv"), rows[0], rows)
