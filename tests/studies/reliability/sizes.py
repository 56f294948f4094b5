"""Large campaigns: how long 100 000 rows take to summarise, and whether 20 000 short runs need more and more memory."""

import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from clock import since
from questions.campaign.short_campaigns import SHORT
from studies.reliability.cases import Row, go_on

from testbench.questions.campaign.ask import MOST_PER_BATCH, fly_campaign
from testbench.questions.campaign.flying import Outcome, fly_batch
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.store import Store
from testbench.questions.campaign.summary import summarise

ROWS, RUNS, LONGEST_S, MOST_KB_PER_1000 = 100_000, 20_000, 20.0, 500.0


def _campaign(place: str, runs: int) -> Path:
    file = Path(place, "short.toml")
    file.write_text(SHORT.format(head=f"runs = {runs}", vary=""), encoding="utf-8")
    return file


def summarised(rows: int) -> tuple[str, str]:
    """Return whether so many rows, copies of runs really flown, are summarised in time (processor seconds)."""
    with TemporaryDirectory() as place:
        few = load_campaign(_campaign(place, 8))
        fly_campaign(few, Path(place, "few"), workers=1)
        with Store.read(Path(place, "few")) as store:
            flown = list(store.rows())
        many = load_campaign(_campaign(place, rows))
        with Store.create(Path(place, "many"), many) as store:
            for at in range(0, rows, 1000):
                some = range(at, min(at + 1000, rows))
                copies = [flown[run % len(flown)] for run in some]
                store.exchange(
                    [Outcome(run, c.seed, c.inputs, c.results or "", c.reason or "", 1.0)
                     for run, c in zip(some, copies, strict=True)], ())  # fmt: skip
            start, wall = time.process_time(), time.monotonic()
            summarise(store.rows())
            took, waited = since(start), since(wall, time.monotonic)
    said = f"{rows} rows: {took:.1f} s of processor, {waited:.1f} s by the clock"
    return ("in time" if took < LONGEST_S else "too slow"), said


def memory(runs: int) -> tuple[str, str]:
    """Return whether the memory of the process that flies, a worker, stays flat over so many short runs."""
    from testbench.questions.campaign.ask import Job, json, versions

    with TemporaryDirectory() as place:
        campaign = load_campaign(_campaign(place, runs))
        job = Job(campaign.spec.model_dump_json(), json.dumps(campaign.content), tuple(versions().items()))
        seen = []
        for at in range(0, runs, MOST_PER_BATCH):
            fly_batch(job, range(at, min(at + MOST_PER_BATCH, runs)))
            seen.append((at, _resident_kb()))
    at, kb = np.array(seen[len(seen) // 3 :], float).T  # caches of trims are filled in the first third
    slope = float(np.polyfit(at, kb, 1)[0]) * 1000.0
    said = (
        f"{runs} runs: {kb[0] / 1e3:.0f} MB after a third, {kb[-1] / 1e3:.0f} MB at the end, {slope:+.0f} kB per 1000"
    )
    return ("flat" if slope < MOST_KB_PER_1000 else "growing"), said


def _resident_kb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1024.0


def sizes(rows: int = ROWS, runs: int = RUNS) -> list[Row]:
    """Summarise many rows, and fly many runs."""

    def run(due: Sequence[str]) -> Iterator[tuple[str, str, str]]:
        for name in due:
            yield (name, *(summarised(rows) if name.startswith("summary") else memory(runs)))

    return go_on("sizes", (f"summary {rows}", f"memory {runs}"), run)
