"""What a million runs cost, and where the scheduler or the store becomes the limit: results/campaign/.

Run with ``make campaign-cost``; a number behind the file's name replaces the 100 000 runs. Real are the flight (Taurus,
25 s, three estimators), what it finds, the executor and the store; in the 100 000 runs a worker answers at once
with what one flight found, so that only what surrounds the flights is left. Processor time throughout, since machines
are shared, but for the store, whose disk is waited for.
"""

import json
import os
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import psutil
from campaign_speed import AIRCRAFT, campaign
from clock import since
from smallest import results, sized
from tables import write_rows

from testbench.questions.campaign.ask import MOST_PER_BATCH, Progress, fly_campaign
from testbench.questions.campaign.flying import Job, Outcome, fly_batch
from testbench.questions.campaign.load import versions
from testbench.questions.campaign.store import Store
from testbench.questions.campaign.summary import summarise
from testbench.questions.campaign.workers import LocalWorkers

RUNS = int(sys.argv[1]) if len(sys.argv) > 1 else sized(100_000, 40)
MILLION = 1_000_000
FLIGHTS, BATCHES = sized((40, 400), (2, 4))
FOLDER = results("campaign")


@dataclass(frozen=True)
class Measured:
    """What was measured; seconds and bytes are per run, memory in bytes."""

    flight_s: float
    answer: int
    client_s: float
    client_wall_s: float
    hand_s: float
    store_s: float
    store_wall_s: float
    row: float
    memory_early: int
    memory_late: int
    summary_s: float
    summary_memory: int


def fly(folder: Path) -> tuple[float, str]:
    """Return the processor seconds of a flight as workers fly it, and what one finds."""
    loaded = campaign(folder, FLIGHTS + 2, True, AIRCRAFT)
    job = Job(loaded.spec.model_dump_json(), json.dumps(loaded.content), tuple(versions().items()))
    fly_batch(job, (0, 1))  # imports and their like
    out = fly_batch(job, range(2, FLIGHTS + 2))
    assert not any(o.reason for o in out)
    return sum(o.seconds for o in out) / len(out), str(out[0].results)


def answering(results: str):
    """Return a task that answers at once."""
    inputs = '{"aircraft.mass_percent":1.2345678901234567,"coefficient.Cm_alpha":1.0123456789012345}'

    def task(job, runs):
        return [Outcome(run, run, inputs, results, "", 0.1) for run in runs]

    return task


def surround(folder: Path, results: str) -> tuple[float, float, int, int, Path]:
    """Return the client's processor and wall seconds per run, its memory at a tenth and at the end, and the store."""
    process, task = psutil.Process(), answering(results)
    loaded = campaign(folder, RUNS, True, AIRCRAFT)
    memory: list[int] = []

    def look(progress: Progress) -> None:
        if progress.counts.finished >= RUNS // 10:
            memory.append(process.memory_info().rss)

    fly_campaign(campaign(folder, 1, True, AIRCRAFT), folder / "start", workers=1, task=task)
    begun = time.process_time()
    ending = fly_campaign(loaded, folder / "all", workers=1, task=task, progress=look)
    return since(begun) / RUNS, ending.elapsed_s / RUNS, memory[0], memory[-1], folder / "all"


def of_handing(results: str) -> float:
    """Return the client's processor seconds per run for handing out batches and collecting them, without a store."""
    waiting, job = 0, Job("", "", ())
    with closing(LocalWorkers(1, answering(results), job)) as workers:
        begun = time.process_time()
        for k in range(BATCHES):
            workers.submit(range(MOST_PER_BATCH * k, MOST_PER_BATCH * (k + 1)))
            waiting += 1
            while waiting >= (2 if k < BATCHES - 1 else 1):
                for future in workers.wait(0.5):
                    workers.collect(future)
                    waiting -= 1
        return since(begun) / (BATCHES * MOST_PER_BATCH)


def of_store(folder: Path, results: str) -> tuple[float, float]:
    """Return processor and wall seconds per run of the store alone, synchronised to the disk once a batch."""
    total = BATCHES * MOST_PER_BATCH
    loaded, task = campaign(folder, total, True, AIRCRAFT), answering(results)
    with Store.create(folder / "alone", loaded) as store:
        begun, wall = time.process_time(), time.perf_counter()
        for k in range(BATCHES):
            runs = store.unfinished(MOST_PER_BATCH * k - 1, MOST_PER_BATCH)
            store.exchange(task(None, runs), runs)
        return since(begun) / total, since(wall, time.perf_counter) / total


def of_summary(folder: Path) -> tuple[float, int, float]:
    """Return the processor seconds to summarise all rows, the memory it takes, and bytes of store per run."""
    process = psutil.Process()
    before, begun = process.memory_info().rss, time.process_time()
    with Store.read(folder) as store:
        found = summarise(store.rows())
        size = store.seconds()[1]
    assert found.runs.size == RUNS
    return since(begun), process.memory_info().rss - before, size / RUNS


def lines(m: Measured) -> list[tuple[str, float, str]]:
    """Return what the CSV holds: what was measured, then what follows for a million runs."""
    million = MILLION * m.flight_s / 3600.0
    return [
        ("processor time of a flight in a worker", 1e3 * m.flight_s, "ms"),
        ("what a flight finds, as JSON", m.answer, "bytes"),
        ("processor time of the client", 1e3 * m.client_s, "ms per run"),
        ("of this handing out and collecting", 1e3 * m.hand_s, "ms per run"),
        ("of this the store", 1e3 * m.store_s, "ms per run"),
        ("wall time of the store, disk included", 1e3 * m.store_wall_s, "ms per run"),
        ("wall time of all, one worker answering, on this machine", 1e3 * m.client_wall_s, "ms per run"),
        ("store", m.row, "bytes per run"),
        (f"memory of the client after {RUNS // 10} runs", m.memory_early / 1e6, "MB"),
        (f"memory of the client after {RUNS} runs", m.memory_late / 1e6, "MB"),
        (f"processor time to summarise {RUNS} runs", m.summary_s, "s"),
        (f"memory to summarise {RUNS} runs", m.summary_memory / 1e6, "MB"),
        ("a million runs", million, "processor hours"),
        ("a million runs on 100 processors", million / 100.0 * 60.0, "min"),
        ("runs per second that the client can take", 1.0 / m.client_s, "runs/s"),
        ("processors at which the client is the limit", m.flight_s / m.client_s, "processors"),
        ("processors at which handing out alone would be", m.flight_s / m.hand_s, "processors"),
        ("processors at which the store alone would be", m.flight_s / m.store_wall_s, "processors"),
        ("least time of a million runs, the client at its limit", MILLION * m.client_s / 60.0, "min"),
        ("store of a million runs", MILLION * m.row / 1e9, "GB"),
        ("to summarise a million runs", MILLION / RUNS * m.summary_s, "s"),
        ("memory to summarise a million runs", MILLION / RUNS * m.summary_memory / 1e9, "GB"),
    ]


def page(m: Measured) -> str:
    """Return the page in words; every number of it is measured here or follows from those."""
    rows = "\n".join(f"| {what} | {value:,.3g} | {unit} |" if value < 1e3 else f"| {what} | {value:,.0f} | {unit} |"
                     for what, value, unit in lines(m))  # fmt: skip
    limit, hours = m.flight_s / m.client_s, MILLION * m.flight_s / 3600.0
    early, late = (f"{x / 1e6:.0f} MB" for x in (m.memory_early, m.memory_late))
    client, hand, store, wall, seen = (
        f"{1e3 * x:.2g} ms" for x in (m.client_s, m.hand_s, m.store_s, m.store_wall_s, m.client_wall_s)
    )
    return f"""# What a million runs cost

Measured by `make campaign-cost`, which writes this page and `cost.csv`. The flight is Taurus's of 25 s, sensed at 8 Hz
and identified by three estimators, with the aircraft varied and its truth linearised in every run. Client and SQLite
are measured with {RUNS:,} runs whose workers answer at once with what one such flight found, in
batches of {MOST_PER_BATCH}. Times are of the processor where they do not say wall, since machines are shared.

| | | |
|---|---:|---|
{rows}

**Workers.** A flight takes {1e3 * m.flight_s:.0f} ms of a processor: a million take {hours:.0f} processor hours.
Flights share nothing, and more processors shorten the campaign in proportion until the client is busy all the time.

**The client.** The client takes {client} of its processor a run, {hand} of it for handing out and collecting and
{store} for the store; it passes {1.0 / m.client_s:,.0f} runs a second and holds up more than {limit:,.0f} processors.
Longer flights or slower estimators move the limit in proportion: at ten times the work a run it is at
{10.0 * limit:,.0f} processors.

**The store.** A transaction is synchronised to the disk, so that no death of a process or of the machine takes what is
finished: {wall} of wall time a run at one batch of {MOST_PER_BATCH} a transaction, enough for
{m.flight_s / m.store_wall_s:.0f} processors. It is no hard limit: batches that come in meanwhile share the next
transaction.
Together, on this machine and with the worker beside the client, a run passed in {seen} of wall time.

Beyond these, cut the campaign into parts with seeds of their own, each with its client and its store.

**Memory.** The client holds the batches in hand and no table: {early} after {RUNS // 10:,} runs, {late} after {RUNS:,}.
Only summarising holds all figures at once, as numbers: {m.summary_memory / 1e6:.0f} MB for {RUNS:,} runs, in
{m.summary_s:.1f} s.
"""


def main() -> None:
    """Measure and write results/campaign/cost.csv and README.md."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        flight, results = fly(folder)
        print(f"flight {1e3 * flight:.1f} ms", flush=True)
        hand, (store, wall) = of_handing(results), of_store(folder, results)
        print(f"hand {1e3 * hand:.3f} ms, store {1e3 * store:.3f} ms (wall {1e3 * wall:.3f} ms)", flush=True)
        client, client_wall, early, late, place = surround(folder, results)
        print(f"client {1e3 * client:.3f} ms, memory {early / 1e6:.0f} MB, then {late / 1e6:.0f} MB", flush=True)
        seconds, memory, size = of_summary(place)
    m = Measured(flight, len(results), client, client_wall, hand, store, wall, size, early, late, seconds, memory)
    cells = ((what, f"{value:.4g}", unit) for what, value, unit in lines(m))
    write_rows(FOLDER / "cost.csv", ("what", "value", "unit"), cells)
    (FOLDER / "README.md").write_text(page(m), encoding="utf-8")
    print(page(m))


if __name__ == "__main__":
    main()
