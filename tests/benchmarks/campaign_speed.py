"""Cost of a campaign against bare JSBSim loops and bare estimator calls, and how well two workers share it.

Run with ``make benchmarks``, or with a number of runs behind the file's name. Taurus flights of 25 s, sensed at 8 Hz,
identified by three estimators. Bare: for every run one loaded model put at trim, its loop of frames, and the three
estimators on a prepared record; no trim, no sensors, no evaluation, no table.

Law 1: the processor time of a run in a campaign, evaluation, client, scheduler and store included, is at most 1.5 times
the bare work's. Processor time, not wall time: machines are shared. Where only inputs and sensors vary, trim and truth
are made once; where the aircraft varies they are made in every run, with truth (a linearisation) or without.
Law 2: two workers are used to 0.9 at least. The efficiency is the share of the wall time that they spend in runs and do
not wait, times the processor time of a run with one worker over that of worker and client with two; on an idle machine
this is the ratio of the rates, which is printed too and says nothing on a busy one.
"""

import json
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since, some
from smallest import sized

from testbench.estimators import estimate
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim
from testbench.line import trim_for
from testbench.questions.campaign.ask import fly_campaign
from testbench.questions.campaign.draws import nominal_inputs
from testbench.questions.campaign.flying import Job, Outcome, fly_batch
from testbench.questions.campaign.load import apply, load_campaign, versions
from testbench.questions.campaign.store import Store
from testbench.questions.run.ask import Prepared, run

RUNS = int(sys.argv[1]) if len(sys.argv) > 1 else sized(120, 4)
ROUNDS = sized(3, 1)
FEW, MORE = sized((10, 20), (2, 2))  # runs that are timed alone
AIRCRAFT = """
"aircraft.mass_percent" = { kind = "normal", mean = 0.0, std = 2.0 }
"coefficient.Cm_alpha" = { kind = "normal", mean = 1.0, std = 0.05 }
"""
INPUTS = """
"manoeuvre.0.input.0.amplitude_deg" = { kind = "uniform", low = 1.8, high = 2.0 }
"sensor.q.scale" = { kind = "normal", mean = 1.0, std = 0.01 }
"""
CAMPAIGN = """
title = "Speed"
seed = 3
runs = {runs}
truth = {truth}
[vary]
{vary}
[scenario]
title = "Taurus, 25 s"
aircraft = "taurus"
suites = ["taurus_8hz"]
condition = {{ V_m_s = 13.0, h_m = 100.0 }}
simulation = {{ log_rate_hz = 40.0 }}
preparation = {{ bias = "trim", lowpass_hz = 1.5 }}
[[scenario.manoeuvre]]
name = "doublets"
use = "split"
duration_s = 23.0
input = [{{ signal = "doublet", control = "de", amplitude_deg = 2.0, period_s = 2.0, repeats = 3, spacing_s = 7.0 }}]
[scenario.identification]
inputs = ["de_cmd"]
outputs = ["theta", "q", "u", "h"]
estimators = [
  {{ method = "transfer_function", poles = 4, zeros = [0, 1, 2, 3] }},
  {{ method = "transfer_function", label = "two poles", poles = 2, zeros = [0, 1] }},
  {{ method = "transfer_function", label = "three poles", poles = 3, zeros = [0, 1, 2] }},
]
"""


def campaign(folder: Path, runs: int, truth: bool, vary: str = AIRCRAFT):
    file = folder / "speed.toml"
    file.write_text(CAMPAIGN.format(runs=runs, truth=str(truth).lower(), vary=vary), encoding="utf-8")
    return load_campaign(file)


def bare(folder: Path, runs: int) -> float:
    """Return the processor seconds of the bare work of one run."""
    loaded = campaign(folder, runs, False)
    scenario = loaded.base
    aircraft, suites = apply(scenario, nominal_inputs(loaded.spec))
    trimmed = trim_for(scenario, aircraft)
    (case, *_) = run(scenario, 1, prepared=Prepared(aircraft, suites, trimmed), causes=False).cases
    frames = round(25.0 * trimmed.rate_hz)
    start = time.process_time()
    for _ in range(runs):
        fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        place_at_trim(fdm, trimmed)
        step = fdm.fdm.run
        for _ in range(frames):
            step()
        for spec in scenario.identification.estimators:
            estimate(spec, case.identification, ("de_cmd",), case.model.outputs, case.validation)
    return since(start) / runs


def in_campaign(folder: Path, first: int, runs: int, truth: bool, vary: str) -> float:
    """Return the processor seconds of a run as a worker flies it."""
    loaded = campaign(folder, first + runs, truth, vary)
    job = Job(loaded.spec.model_dump_json(), json.dumps(loaded.content), tuple(versions().items()))
    start = time.process_time()
    out = fly_batch(job, range(first, first + runs))
    assert not any(o.reason for o in out)
    return since(start) / runs


def of_client(folder: Path, runs: int) -> tuple[float, float]:
    """Return the processor seconds per run of client, scheduler and store, and bytes of store per run."""
    loaded = campaign(folder, runs, True)
    job = Job(loaded.spec.model_dump_json(), json.dumps(loaded.content), tuple(versions().items()))
    results = fly_batch(job, [0])[0].results

    def task(job, indices):
        return [Outcome(i, i, "{}", results, "", 0.1) for i in indices]

    with tempfile.TemporaryDirectory() as place:
        small = campaign(folder, 1, True)
        fly_campaign(small, Path(place) / "start", workers=1, task=task)  # imports and their like
        begun = time.process_time()
        fly_campaign(small, Path(place) / "again", workers=1, task=task)
        start_up = since(begun)
        begun = time.process_time()
        fly_campaign(loaded, Path(place) / "all", workers=1, task=task)
        spent = some(since(begun) - start_up)
        with Store.read(Path(place) / "all") as store:
            return spent / runs, store.seconds()[1] / runs


def watched(folder: Path):
    """Return a task that flies and notes when, and what processor time its process has had; by value."""

    def task(job, runs):
        begun, spent = time.time(), time.process_time()
        out = fly_batch(job, runs)
        with (folder / f"{os.getpid()}.txt").open("a") as file:
            print(begun, time.time(), spent, time.process_time(), file=file)
        return out

    return task


def flown(folder: Path, runs: int, workers: int, truth: bool, vary: str) -> tuple[float, float, float, float]:
    """Return runs per second of a real campaign, start-up left out, the share of the time that workers are in runs, and
    processor seconds per run of workers and client.
    """
    with tempfile.TemporaryDirectory() as place:
        loaded, notes = campaign(folder, runs, truth, vary), Path(place) / "notes"
        notes.mkdir()
        spent = time.process_time()
        ending = fly_campaign(loaded, Path(place) / "store", workers=workers, task=watched(notes))
        spent = since(spent) / runs
        lines = [[list(map(float, x.split())) for x in f.read_text().splitlines()] for f in notes.iterdir()]
    assert ending.counts.done == runs
    every = [x for found in lines for x in found]
    inside = sum(end - begun for begun, end, _, _ in every)
    lasted = some(max(x[1] for x in every) - min(x[0] for x in every))
    of_workers = sum(found[-1][3] - found[0][2] for found in lines) / runs
    return runs / some(ending.elapsed_s), inside / (workers * lasted), of_workers, spent


def main() -> None:
    """Print every round, since machines are shared and noisy."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        client, size = of_client(folder, sized(5000, 50))
        print(f"client, scheduler and store: {1e3 * client:.2f} ms of processor and {size:.0f} bytes per run")
        in_campaign(folder, 0, 2, True, AIRCRAFT)
        for k in range(ROUNDS):
            plain = bare(folder, FEW)
            line = f"bare work of a run {1e3 * plain:.1f} ms; in a campaign"
            for what, truth, vary in (
                ("inputs and sensors varied, with truth", True, INPUTS),
                ("aircraft varied, without truth", False, AIRCRAFT),
                ("aircraft varied, with truth", True, AIRCRAFT),
            ):
                spent = in_campaign(folder, 100 * (k + 1), FEW, truth, vary) + client
                line += f" {1e3 * spent:.1f} ms ({what}: ratio {spent / plain:.2f}),"
            print(line.rstrip(","))
        plain = min(bare(folder, MORE) for _ in range(ROUNDS))
        for what, truth, vary in (("inputs and sensors", True, INPUTS), ("the aircraft", True, AIRCRAFT)):
            one, _, alone, _ = flown(folder, max(RUNS // 4, MORE), 1, truth, vary)
            two, busy, both, mine = flown(folder, RUNS, 2, truth, vary)
            print(
                f"{RUNS} runs by two workers, {what} varied: {1e3 * (both + mine):.1f} ms of processor a run in all, "
                f"{(both + mine) / plain:.2f} times the bare {1e3 * plain:.1f} ms; in runs {100 * busy:.0f} % of the "
                f"time, efficiency {busy * alone / (both + mine):.2f} (rate {two:.1f} runs/s, one worker {one:.1f})",
                flush=True,
            )


if __name__ == "__main__":
    main()
