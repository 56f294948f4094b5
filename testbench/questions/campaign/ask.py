"""Fly a campaign: send batches of runs to workers and store outcomes, until all runs or enough of them are finished.

results/campaign/README.md says what a million runs cost, and where the limit is; ``make campaign-cost`` measures it.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from testbench.core.blas import on_one_thread
from testbench.core.errors import CampaignError
from testbench.core.files import write_file
from testbench.core.named import Named, obtain
from testbench.core.processes import cores
from testbench.flight.batch.jobs import Simulator
from testbench.questions.campaign.draws import run_inputs, run_seed
from testbench.questions.campaign.flying import Job, Outcome, fly_batch
from testbench.questions.campaign.load import Campaign, versions
from testbench.questions.campaign.scenario import Watch
from testbench.questions.campaign.store import RECORDS, Counts, Store
from testbench.questions.campaign.workers import Died, LocalWorkers, Lost, Task, Workers, remote_workers

MOST_PER_BATCH = 64  # what flies as one block
BATCH_S = 3.0  # work in a batch: little is lost with one, and what SQLite takes for it is less than 1 %
_FIRST_BATCH = 4  # before the first run has said how long it takes
DEATHS = 3  # a run that is alone with a process when it dies may have been unlucky; three times it was not
DIED = f"the worker process died while it flew this run and no other, {DEATHS} times or more"
_PER_WORKER = 2  # batches in hand or on the way, so that no worker waits
_NO_WORKERS_S = 60.0
_LOOK_S = 0.5


@dataclass(frozen=True)
class Progress:
    """How far a campaign is: runs finished before and now, failures, and runs per second since the start."""

    counts: Counts
    flown: int
    elapsed_s: float
    workers: int

    @property
    def rate(self) -> float:
        """Runs per second."""
        return self.flown / self.elapsed_s if self.elapsed_s > 0.0 else 0.0

    @property
    def left_s(self) -> float | None:
        """Seconds until the last run is finished, if the rate stays; None before the first."""
        return (self.counts.total - self.counts.finished) * self.elapsed_s / self.flown if self.flown else None


@dataclass(frozen=True)
class Ending:
    """How a campaign ended: the counts, and after how many runs the stopping rule was met (None if it was not)."""

    counts: Counts
    stopped: int | None
    elapsed_s: float


@dataclass(frozen=True)
class _Batch:
    runs: tuple[int, ...]
    deaths: int = 0


@on_one_thread
def fly_campaign(
    campaign: Named[Campaign],
    folder: Path | str,
    *,
    resume: bool = False,
    workers: int | str | None = None,
    progress: Callable[[Progress], None] | None = None,
    task: Task = fly_batch,
    simulator: Simulator = "auto",
) -> Ending:
    """Fly all runs of a campaign that are not finished yet.

    Args:
        campaign: what to fly.
        folder: holds the store, and the time histories if they are kept.
        resume: continue with the store in ``folder`` instead of making one.
        workers: processes on this machine, one per processor if not given; or the address of a dask scheduler, to use
            the workers that it has.
        progress: called about twice a second.
        task: what a worker does with a batch.
        simulator: "jsbsim" flies every flight by JSBSim; else runs of a model that has been found equal to it are flown
            together.

    Raises:
        CampaignError: the store cannot be written or the workers are gone; ``resume`` goes on.
        TestbenchError: what makes every run impossible.

    Example:
        >>> import testbench as tb
        >>> campaign = tb.load_campaign("campaign/taurus_scatter")
        >>> tb.fly_campaign(campaign, Path("results/campaign_taurus_scatter"), workers=2)  # doctest: +SKIP
    """
    campaign, folder = obtain(Campaign, campaign), Path(folder)
    job = Job(
        campaign.spec.model_dump_json(),
        json.dumps(campaign.content),
        tuple(versions().items()),
        campaign.spec.records,
        simulator,
        campaign.files,
    )
    with ExitStack() as stack:
        # Without workers no store is left behind; and processes that are forked later would hold its lock.
        found: LocalWorkers | Workers = (
            stack.enter_context(remote_workers(workers, task, job))
            if isinstance(workers, str)
            else stack.enter_context(closing(LocalWorkers(workers or cores(), task, job)))
        )
        opened = Store.resume(folder, campaign) if resume else Store.create(folder, campaign)
        store = stack.enter_context(opened)
        if store.first_unfinished() is None:
            return Ending(store.counts(), None, 0.0)
        watch = Watch(campaign.spec.stop) if campaign.spec.stop else None
        if watch is not None and (stopped := watch.advance(store, campaign.spec.total)) is not None:
            store.stop_at(stopped)
            return Ending(store.counts(), stopped, 0.0)
        return _Session(campaign, store, folder, found, watch, store.counts()).fly(progress)


@dataclass
class _Session:
    """One session: what is in hand, what came back to be flown again, how far the numbers are dealt, what is done."""

    campaign: Campaign
    store: Store
    folder: Path
    workers: LocalWorkers | Workers
    watch: Watch | None
    counts: Counts
    have: int = 0
    flown: int = 0
    seconds: float = 0.0
    stopped: int | None = None
    dealt: int = -1
    started: list[int] = field(default_factory=list)
    hand: dict[Any, _Batch] = field(default_factory=dict)
    again: deque[_Batch] = field(default_factory=deque)

    def fly(self, progress: Callable[[Progress], None] | None) -> Ending:
        """Hand out, collect and write until every run is finished or the stopping rule is met."""
        start = looked = last_seen = time.perf_counter()
        self.have = self.workers.count()
        try:
            while self.stopped is None:
                self.hand_out()
                if not self.hand and not self.again and self.have:
                    break
                self.write(self.collect())
                now = time.perf_counter()
                if now - looked < _LOOK_S:
                    continue
                looked, self.have = now, self.workers.count()
                last_seen = now if self.have else last_seen
                if now - last_seen > _NO_WORKERS_S:
                    raise CampaignError(
                        f"a campaign needs workers, but the scheduler has had none for {_NO_WORKERS_S:g} s; "
                        "start some with `dask worker` and go on with `testbench campaign resume`"
                    )
                if progress is not None:
                    progress(Progress(self.counts, self.flown, now - start, self.have))
        except BaseException:
            self.give_back()
            raise
        if self.stopped is not None:
            self.workers.cancel(list(self.hand))
            self.store.stop_at(self.stopped)
        counts, elapsed = self.store.counts(), time.perf_counter() - start
        if progress is not None:
            progress(Progress(counts, self.flown, elapsed, self.have))
        return Ending(counts, self.stopped, elapsed)

    def hand_out(self) -> None:
        """Hand out batches until every worker has enough."""
        while len(self.hand) < _PER_WORKER * self.have:
            if self.again:
                batch = self.again.popleft()
            else:
                runs = self.store.unfinished(self.dealt, self.batch_size())
                if not runs:
                    break
                batch = _Batch(tuple(runs))
                self.dealt = runs[-1]
                self.started += runs
            self.hand[self.workers.submit(batch.runs)] = batch

    def batch_size(self) -> int:
        """Return how many runs make the next batch: some seconds' work, and less towards the end, which all then reach
        together; it changes nothing of what runs find.
        """
        most = _FIRST_BATCH
        if self.flown:
            most = min(MOST_PER_BATCH, int(BATCH_S * self.flown / max(self.seconds, 1e-9)))
        left = self.counts.total - self.counts.finished
        return max(1, min(most, left // (4 * _PER_WORKER * self.have)))

    def collect(self) -> list[Outcome]:
        """Return the outcomes of the batches that have ended; those whose process died are flown again.

        If a batch killed its process, its halves or its single runs go back, until the run that does it is found.
        """
        out: list[Outcome] = []
        for future in self.workers.wait(_LOOK_S):
            batch = self.hand.pop(future)
            try:
                out += self.workers.collect(future)
            except Lost:
                self.again.append(batch)
            except Died as died:
                if len(batch.runs) > 1:
                    # A scheduler that tries again by itself loses several processes with every batch: no more halving.
                    size = 1 if died.times > 1 else (len(batch.runs) + 1) // 2
                    self.again += [_Batch(batch.runs[k : k + size]) for k in range(0, len(batch.runs), size)]
                elif batch.deaths + died.times < DEATHS:
                    self.again.append(replace(batch, deaths=batch.deaths + died.times))
                else:
                    out.append(_died(self.campaign, batch.runs[0]))
        return out

    def write(self, finished: list[Outcome]) -> None:
        """Write what has been found and begun, in one transaction; count it, and ask the stopping rule."""
        if not finished and not self.started:
            return
        _keep_records(finished, self.folder)
        self.store.exchange(finished, self.started)
        self.started = []
        self.flown += len(finished)
        self.seconds += sum(o.seconds for o in finished)
        failed = sum(1 for o in finished if o.reason)
        done, lost = self.counts.done + len(finished) - failed, self.counts.failed + failed
        self.counts = Counts(0, self.counts.total - done - lost, done, lost)
        if self.watch is not None and finished:
            self.stopped = self.watch.advance(self.store, self.campaign.spec.total)

    def give_back(self) -> None:
        """Note that what was handed out is not being flown any more; a store that cannot be written stays as it is."""
        self.workers.cancel(list(self.hand))
        unfinished = [run for batch in (*self.hand.values(), *self.again) for run in batch.runs]
        try:
            self.store.exchange((), (), unfinished)
        except CampaignError:  # the error that brought us here says so already, and resume does not need the note
            return


def _died(campaign: Campaign, run: int) -> Outcome:
    inputs = json.dumps(run_inputs(campaign.spec, run), separators=(",", ":"))
    return Outcome(run, run_seed(campaign.spec, run), inputs, None, DIED, 0.0)


def _keep_records(finished: list[Outcome], folder: Path) -> None:
    """Write the time histories of finished runs as folder/records/run_NNNNNN_NAME.nc, before their rows."""
    for name, content in _records(finished):
        path = folder / RECORDS / name
        write_file(
            path,
            content,
            "time histories must go to a folder that can be written to",
            "what is finished is kept. Free space, then go on with `testbench campaign resume`",
        )


def _records(finished: list[Outcome]) -> Iterator[tuple[str, bytes]]:
    for outcome in finished:
        for name, content in outcome.records:
            safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in name)
            yield f"run_{outcome.index:06d}_{safe}.nc", content
