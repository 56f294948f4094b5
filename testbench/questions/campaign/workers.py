"""Where runs are flown: by processes of this machine, or by workers of a cluster. The importer of dask."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count as numbers
from multiprocessing import connection
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from testbench.core.errors import CampaignError, missing
from testbench.core.processes import Child, answer_to

if TYPE_CHECKING:
    from distributed import Client, Future

    from testbench.questions.campaign.flying import Job, Outcome


Task = Callable[["Job", Sequence[int]], "list[Outcome]"]
_CONNECT_S = 15.0


class Died(Exception):
    """The process that flew a batch died; ``times`` counts the attempts of the scheduler."""

    def __init__(self, times: int) -> None:
        super().__init__(times)
        self.times = times


class Lost(Exception):
    """The outcome of a batch was lost with the process that held it, before it was collected."""


@dataclass(frozen=True)
class _Worker:
    child: Child
    hand: deque[int] = field(default_factory=deque)


class LocalWorkers:
    """Processes of this machine, each with one thread of linear algebra: batches in, outcomes out.

    Batches are known by their numbers. A process that dies is replaced.

    Args:
        count: of processes; fewer where the machine does not start so many.
        task: what each does with a batch.
        job: of all batches.

    Raises:
        CampaignError: no process can be started.
    """

    def __init__(self, count: int, task: Task, job: Job) -> None:
        self._most = count
        self._work = partial(_serve, task, job)
        self._numbers = numbers()
        self._workers: list[_Worker] = []
        self._answers: dict[int, tuple[bool, Any]] = {}
        self._start()

    def count(self) -> int:
        """Return how many processes there are now."""
        return len(self._workers)

    def submit(self, runs: Sequence[int]) -> int:
        """Hand out one batch."""
        worker, batch = min(self._workers, key=lambda w: len(w.hand)), next(self._numbers)
        worker.hand.append(batch)
        with suppress(OSError):  # it has died, as the next wait finds
            worker.child.pipe.send(runs)
        return batch

    def wait(self, timeout_s: float) -> list[int]:
        """Return the batches that have ended since the last call, after waiting for at least one; none after a while.

        Raises:
            CampaignError: all processes have died, and no other can be started.
        """
        out = []
        ready = connection.wait([w.child.pipe for w in self._workers], timeout_s)
        for worker in [w for w in self._workers if w.child.pipe in ready]:
            try:
                self._answers[worker.hand[0]] = worker.child.pipe.recv()
                out.append(worker.hand.popleft())
            except (EOFError, OSError):
                self._workers.remove(worker)
                worker.child.kill()
                # The first of its batches killed it; what it had not begun is lost.
                self._answers |= {batch: (False, Lost() if k else Died(1)) for k, batch in enumerate(worker.hand)}
                out += worker.hand
        self._start()
        return out

    def collect(self, batch: int) -> list[Outcome]:
        """Return the outcomes of an ended batch.

        Raises:
            Died: its process died over it.
            Lost: its process died before it began.
            TestbenchError: whatever the batch raised.
        """
        done, found = self._answers.pop(batch)
        if not done:
            raise found
        outcomes: list[Outcome] = found
        return outcomes

    def cancel(self, batches: Sequence[int]) -> None:
        """Give up batches: the processes end with the block."""

    def _start(self) -> None:
        """Start the processes that are missing; fewer will do."""
        try:
            while len(self._workers) < self._most:
                self._workers.append(_Worker(Child.start(self._work)))
        except OSError as error:
            if not self._workers:
                raise CampaignError(
                    "a campaign needs worker processes, but this machine starts none "
                    f"({error.strerror or error}); what is finished is kept. End other programs, or raise the limits "
                    "of processes and memory (ulimit -u, ulimit -v), and go on with `testbench campaign resume`"
                ) from error

    def close(self) -> None:
        """End all processes."""
        while self._workers:
            self._workers.pop().child.kill()


def _serve(task: Task, job: Job, pipe: connection.Connection) -> None:
    """Answer batches until whoever hands them out is gone.

    A batch is flown in a thread: a user's estimator then works in a process aside, which can be ended also while it
    computes in compiled code, which hears no signal (see :func:`testbench.estimators.cells.aside_for`).
    """
    import scipy.linalg  # noqa: F401  # brings a library of its own, which must be there to be limited
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"), suppress(EOFError, OSError), ThreadPoolExecutor(1) as thread:
        while True:
            runs = pipe.recv()
            pipe.send(thread.submit(answer_to, partial(task, job, runs)).result())


class Workers:
    """Workers of a scheduler as campaigns see them: batches in, outcomes out.

    Args:
        client: of dask.distributed.
        place: where the scheduler is, in words.
        task: what a worker does with a batch.
        job: of all batches.
    """

    def __init__(self, client: Client, place: str, task: Task, job: Job) -> None:
        self._client, self._task, self._job = client, task, job
        self.place = place
        self._finished: SimpleQueue[Future] = SimpleQueue()

    def count(self) -> int:
        """Return how many threads of workers there are now.

        Raises:
            CampaignError: the scheduler is gone.
        """
        self._check()
        return sum(int(w["nthreads"]) for w in self._client.scheduler_info(n_workers=-1)["workers"].values())

    def submit(self, runs: Sequence[int]) -> Future:
        """Hand out one batch."""
        future = self._client.submit(self._task, self._job, tuple(runs), pure=False)
        future.add_done_callback(self._finished.put)
        return future

    def wait(self, timeout_s: float) -> list[Future]:
        """Return the batches that have ended since the last call, after waiting for at least one; none after a while.

        Raises:
            CampaignError: the scheduler is gone.
        """
        try:
            out = [self._finished.get(timeout=timeout_s)]
        except Empty:
            self._check()
            return []
        while True:
            try:
                out.append(self._finished.get_nowait())
            except Empty:
                return out

    def collect(self, future: Future) -> list[Outcome]:
        """Return the outcomes of an ended batch.

        Raises:
            Died: its worker process died over it, so often as the exception says.
            Lost: it ended, but its process died before it was collected.
            CampaignError: the scheduler is gone, or the worker cannot import the testbench.
            TestbenchError: whatever the batch raised.
        """
        from concurrent.futures import CancelledError

        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            outcomes: list[Outcome] = future.result()
        except KilledWorker as error:
            raise Died(error.allowed_failures + 1) from error
        except (CancelledError, FutureCancelledError) as error:
            self._check()
            raise Lost from error
        except OSError as error:  # the scheduler may go while it is asked, before its client knows
            if future.status == "error":
                raise
            raise self._gone() from error
        except ImportError as error:
            raise CampaignError(
                f"workers must have the testbench and what it needs installed, but one of {self.place} says: {error}; "
                "install it there and go on with `testbench campaign resume`"
            ) from error
        return outcomes

    def cancel(self, futures: Sequence[Future]) -> None:
        """Give up batches that have been handed out; a scheduler that is gone has given them up itself."""
        if futures and self._client.status == "running":
            self._client.cancel(list(futures), force=True)

    def _check(self) -> None:
        if self._client.status != "running":
            raise self._gone()

    def _gone(self) -> CampaignError:
        return CampaignError(
            f"the scheduler of the workers must be reachable, but {self.place} has gone; what is finished is kept. "
            "Start it again and go on with `testbench campaign resume`"
        )


@contextmanager
def remote_workers(address: str, task: Task, job: Job) -> Iterator[Workers]:
    """Give the workers of the scheduler at ``address``, such as tcp://host:8786; they stay when the block ends.

    Raises:
        CampaignError: dask.distributed is not installed, or no scheduler answers.
    """
    try:
        import dask
        from distributed import Client
        from distributed.comm import parse_address, parse_host_port
    except ImportError as error:
        raise CampaignError(
            f"{missing('a --scheduler needs dask.distributed', 'campaign')}, or leave it out to fly on this machine"
        ) from error

    with dask.config.set({"distributed.comm.timeouts.connect": _CONNECT_S}), _quiet():
        try:
            parse_host_port(parse_address(address)[1])  # a client that fails over it would wait 30 s for its own end
            client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise CampaignError(
                f"a scheduler of dask.distributed must answer at '{address}', got: {error}; start one with `dask "
                "scheduler` and workers with `dask worker`, or leave out --scheduler"
            ) from error
        try:
            yield Workers(client, f"the scheduler at {address}", task, job)
        finally:
            with suppress(OSError, TimeoutError, RuntimeError):  # one that is gone cannot be taken leave of
                client.close(timeout=5.0)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep dask's own log of lost connections from the terminal: what matters of them is said in our words."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
