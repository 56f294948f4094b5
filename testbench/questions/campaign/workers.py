"""Where runs are flown: worker processes of an embedded cluster, or of one that runs already. The importer of dask."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from testbench.core.blas import SETTINGS
from testbench.core.errors import CampaignError
from testbench.core.interrupts import held_back

if TYPE_CHECKING:
    from distributed import Client, Future

    from testbench.questions.campaign.flying import Job, Outcome


Task = Callable[["Job", Sequence[int]], "list[Outcome]"]
_EXTRA = (
    "campaigns need dask.distributed, which is not installed; install it with: pip install 'flight-testbench[campaign]'"
)
_CONNECT_S = 15.0
_THREADS = dict.fromkeys(SETTINGS, "1")
_UNSAID = "ignore::UserWarning:multiprocessing.resource_tracker"
"""What Python takes away after a process that was killed is no news for who killed it."""


class Died(Exception):
    """The process that flew a batch died; ``times`` counts the attempts of the scheduler."""

    def __init__(self, times: int) -> None:
        super().__init__(times)
        self.times = times


class Lost(Exception):
    """The outcome of a batch was lost with the process that held it, before it was collected."""


class Workers:
    """Worker processes as campaigns see them: batches in, outcomes out.

    Args:
        client: of dask.distributed.
        place: where the scheduler is, in words.
        again: starts scheduler and workers once more, where they are ours.
    """

    def __init__(self, client: Client, place: str, again: Callable[[], Client] | None = None) -> None:
        self._client = client
        self.place = place
        self._again = again
        self._finished: SimpleQueue[Future] = SimpleQueue()

    def count(self) -> int:
        """Return how many threads of workers there are now.

        Raises:
            CampaignError: the scheduler is gone.
        """
        self._check()
        return sum(int(w["nthreads"]) for w in self._client.scheduler_info(n_workers=-1)["workers"].values())

    @property
    def ours(self) -> bool:
        """Whether the scheduler and its workers belong to this campaign, so that :meth:`restart` can be called."""
        return self._again is not None

    def restart(self) -> None:
        """Start scheduler and workers once more; what was handed out is lost.

        dask starts a worker again whose process dies, but gives it up where no process can be made for a while, or
        where the server that processes are forked from is killed.

        Raises:
            CampaignError: no worker process can be started; it says why.
        """
        assert self._again is not None
        self._finished = SimpleQueue()
        self._client = self._again()

    def submit(self, task: Task, job: Job, runs: Sequence[int]) -> Future:
        """Hand out one batch."""
        future = self._client.submit(task, job, tuple(runs), pure=False)
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


def require_dask() -> None:
    """Do nothing where dask.distributed is installed.

    Raises:
        CampaignError: it is not.
    """
    try:
        import dask  # noqa: F401
        import distributed  # noqa: F401
    except ImportError as error:
        raise CampaignError(_EXTRA) from error


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """Give ``count`` worker processes of this machine, each with one thread; they end with the block, or with us.

    Raises:
        CampaignError: dask.distributed is not installed, or no worker process can be started.
    """
    require_dask()
    import dask

    settings = {
        "distributed.worker.multiprocessing-method": _start_method(),
        # A batch whose process dies comes back at once, to be halved; dask itself would let it kill three more.
        "distributed.scheduler.allowed-failures": 0,
        "distributed.scheduler.work-stealing": False,  # batches are handed out one by one, there is nothing to steal
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.worker.daemon": True,
        "distributed.worker.preload": [FLYING],  # imported before the first batch comes
        "distributed.nanny.environ": _THREADS,
        "distributed.nanny.pre-spawn-environ": _THREADS,
        "distributed.worker.profile.enabled": False,  # it would look at every thread each 10 ms
        "distributed.admin.system-monitor.interval": "10s",
        "distributed.admin.tick.interval": "1s",
    }
    with dask.config.set(settings), _quiet():
        embedded = _Embedded(count)
        try:
            yield Workers(embedded.open(), "the embedded scheduler", embedded.again)
        finally:
            embedded.close()


class _Embedded:
    """A scheduler in this process with workers on this machine, which can be closed and opened again."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._client: Any = None
        self._cluster: Any = None

    def open(self) -> Client:
        """Start all of it.

        Raises:
            CampaignError: no worker process can be started; it says why.
        """
        from distributed import Client, LocalCluster

        _start_method()  # whatever the processes are forked from may have been killed
        try:
            with held_back():  # half-made, it cannot be closed
                self._cluster = LocalCluster(
                    n_workers=self.count,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",  # any free port; without one dask insists on one of its own
                    memory_limit=0,
                    silence_logs=logging.CRITICAL,
                )
        except (RuntimeError, OSError, TimeoutError) as error:
            raise CampaignError(
                f"a campaign needs worker processes, but none could be started: {why_none()}"
            ) from error
        self._client = Client(self._cluster, set_as_default=False)
        return self._client

    def again(self) -> Client:
        """Close what is left, which may be half dead, and start all of it once more."""
        with suppress(OSError, TimeoutError, RuntimeError):
            self.close()
        return self.open()

    def close(self) -> None:
        """End the workers and the scheduler."""
        client, cluster, self._client, self._cluster = self._client, self._cluster, None, None
        if client is not None:
            _close(client)
        if cluster is not None:
            cluster.close(timeout=10.0)


@contextmanager
def remote_workers(address: str) -> Iterator[Workers]:
    """Give the workers of the scheduler at ``address``, such as tcp://host:8786; they stay when the block ends.

    Raises:
        CampaignError: dask.distributed is not installed, or no scheduler answers.
    """
    require_dask()
    import dask
    from distributed import Client
    from distributed.comm import parse_address, parse_host_port

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
            yield Workers(client, f"the scheduler at {address}")
        finally:
            _close(client)


def _start_method() -> str:
    """Return how worker processes are made: forked, where that exists, from a server that has all modules loaded.

    A worker is then there in a tenth of the time that its imports take, also the one after a crash.
    """
    import multiprocessing

    if "forkserver" not in multiprocessing.get_all_start_methods():
        return "spawn"
    from multiprocessing import forkserver, resource_tracker

    unsaid = ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), _UNSAID)))
    settings = {**_THREADS, "PYTHONWARNINGS": unsaid}
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)  # read by the libraries when the server loads them
    try:
        forkserver.set_forkserver_preload(["testbench.questions.campaign.served", "distributed", FLYING])
        resource_tracker.ensure_running()  # which hears interrupts again afterwards
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # a terminal sends it to all of a group
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return "forkserver"


def _close(client: Any) -> None:
    try:
        client.close(timeout=5.0)
    except (OSError, TimeoutError, RuntimeError):  # a scheduler that is gone cannot be taken leave of
        return


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


# --- why there are no worker processes on this machine: one is started for a try --------------------------------------


FLYING = "testbench.questions.campaign.flying"
"""What workers load."""

_TRY_S = 60.0


def why_none() -> str:
    """Start one process that loads what workers load, and return what became of it and what to do, in words."""
    try:
        tried = subprocess.run(
            [sys.executable, "-c", f"import {FLYING}"],
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_TRY_S,
        )
    except OSError as error:
        return (
            f"this machine starts no process ({error.strerror or error}); end other programs, or raise the limits of "
            "processes and memory (ulimit -u, ulimit -v)"
        )
    except subprocess.TimeoutExpired:
        return f"a process does not load the testbench within {_TRY_S:g} s; end other programs, or give fewer --workers"
    if tried.returncode < 0:
        name = signal.Signals(-tried.returncode).name
        return (
            f"a process that loads the testbench is ended by {name}; the memory may be too small: end other programs, "
            "or give fewer --workers"
        )
    if tried.returncode:
        last = (tried.stderr.strip().splitlines() or ["it says nothing"])[-1]
        return f"a process cannot load the testbench ({last}); mend the installation"
    return (
        "a process that loads the testbench lives, so that something ends the workers: memory that runs out (give "
        "fewer --workers), a limit of time, or a program that ends processes"
    )
