"""Execution: the same table whoever flies it, and whatever is killed on the way."""

import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from clusters import ENVIRONMENT, WAIT_S, wait_until
from short_campaigns import SHORT
from threadpoolctl import threadpool_info, threadpool_limits

from testbench.core import processes
from testbench.core.errors import CampaignError, EstimationError
from testbench.core.record import load_record
from testbench.questions.campaign import ask as execute
from testbench.questions.campaign.ask import DIED, fly_campaign
from testbench.questions.campaign.flying import Job, Outcome, fly_batch
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.page import runs_csv
from testbench.questions.campaign.store import Row, Store
from testbench.questions.campaign.summary import summarise
from testbench.questions.campaign.workers import Died, Lost, Workers


def table(folder: Path) -> str:
    with Store.read(folder) as store:
        return runs_csv(summarise(store.rows()))


def finished(folder: Path) -> int:
    try:
        with Store.read(folder) as store:
            return store.counts().finished
    except CampaignError:
        return 0


def rows(folder: Path) -> list[Row]:
    with Store.read(folder) as store:
        return list(store.rows())


def behind(folder: Path) -> int:
    with Store.read(folder) as store:
        return 1 + max(row.run for row in store.rows())


def command(*arguments: object, cwd: Path) -> subprocess.Popen[str]:
    # What a shell runs in the background ignores the interrupt, and all that it starts; a user's command does not.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    code += "from testbench.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=cwd,
        env=ENVIRONMENT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.fixture(scope="module")
def reference_store(tmp_path_factory):
    """The table of the short campaign from one worker, not interrupted; the same file as ``written`` gives."""
    folder = tmp_path_factory.mktemp("reference")
    file = folder / "short.toml"
    file.write_text(SHORT.format(head="runs = 24", vary=""), encoding="utf-8")
    ending = fly_campaign(load_campaign(file), folder / "store", workers=1)
    assert ending.counts.finished == 24
    assert ending.counts.done >= 22
    return folder / "store"


@pytest.fixture(scope="module")
def reference(reference_store):
    return table(reference_store)


@pytest.mark.slow
def test_eight_workers_give_the_same_table(short, tmp_path, reference):
    seen = []
    fly_campaign(short("runs = 24"), tmp_path / "s", workers=8, progress=seen.append)
    assert table(tmp_path / "s") == reference
    assert seen[-1].counts.finished == 24
    assert seen[-1].rate > 0.0
    assert seen[-1].left_s == 0.0


@pytest.mark.slow
def test_nothing_is_lost_or_counted_twice_when_it_is_interrupted_and_then_killed(written, tmp_path, reference_store):
    """Of 1000 runs it cannot end by itself; then it is cut behind its last finished run, and the gaps are flown."""
    file = written("runs = 1000")
    store = tmp_path / "results" / "campaign_short"
    running = command("campaign", "run", file, "--workers", 1, cwd=tmp_path)
    wait_until(lambda: finished(store) >= 1, "the first run")
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=WAIT_S)
    assert running.returncode == 130
    assert "continue with: testbench campaign resume" in err
    assert "Traceback" not in err
    with Store.read(store) as read:
        interrupted = read.counts()
    assert interrupted.running == 0
    assert 1 <= interrupted.finished < 1000
    resumed = command("campaign", "resume", file, "--workers", 2, cwd=tmp_path)
    wait_until(lambda: finished(store) > interrupted.finished, "the first runs of the second session")
    resumed.send_signal(signal.SIGKILL)
    resumed.communicate()
    runs = behind(store)
    cut = load_campaign(written(f"runs = {runs}"))
    assert fly_campaign(cut, store, resume=True, workers=2).counts.finished == runs
    assert rows(store)[:24] == rows(reference_store)[:runs]


def fatal(marks: Path):
    """Return a task that kills its process in run 5 always, and in run 11 once."""

    def task(job, runs):
        for run in runs:
            once = marks / f"{run}"
            if run == 5 or (run == 11 and not once.exists()):
                once.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        threads = max(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        found = json.dumps({"figures": {}, "poles": {}, "threads": threads})
        return [Outcome(run, run, "{}", found, "", 0.0) for run in runs]

    return task


def test_a_run_that_kills_its_process_is_recorded_and_the_campaign_goes_on(short, tmp_path):
    with threadpool_limits(2, user_api="blas"):
        ending = fly_campaign(short("runs = 16"), tmp_path / "s", workers=2, task=fatal(tmp_path))
    assert ending.counts.done == 15
    assert ending.counts.failed == 1
    with Store.read(tmp_path / "s") as store:
        rows = list(store.rows())
    (failed,) = [row for row in rows if row.state == "failed"]
    assert {json.loads(row.results)["threads"] for row in rows if row.results} == {1}
    assert failed.run == 5
    assert failed.reason == DIED
    assert "condition.V_m_s" in failed.inputs
    assert (tmp_path / "11").exists()


class Deadly:
    """Workers in this process: a batch with run 5 kills them ``times`` times, the third batch is lost once."""

    def __init__(self, times: int) -> None:
        self.times, self.deaths, self.batches = times, 0, []

    def count(self) -> int:
        return 1

    def submit(self, runs):
        self.batches.append(runs)
        return len(self.batches) - 1

    def wait(self, timeout_s):
        return [len(self.batches) - 1]

    def collect(self, future):
        runs = self.batches[future]
        if future == 2:
            raise Lost
        if 5 in runs:
            self.deaths += self.times
            raise Died(self.times)
        return [Outcome(run, run, "{}", '{"figures": {}, "poles": {}}', "", 1.0) for run in runs]

    def cancel(self, futures):
        pass

    def close(self):
        pass


@pytest.mark.parametrize(("times", "deaths"), [(1, 5), (4, 8)])
def test_the_fatal_run_of_a_batch_is_found_with_few_deaths(short, tmp_path, monkeypatch, times, deaths):
    """A batch of four, its half of two, and three times alone; or the batch and the run, four times each."""
    deadly = Deadly(times)
    monkeypatch.setattr(execute, "LocalWorkers", lambda *_: deadly)
    monkeypatch.setattr(execute, "_PER_WORKER", 1)
    ending = fly_campaign(short("runs = 32"), tmp_path / "s", workers=1)
    assert (ending.counts.done, ending.counts.failed) == (31, 1)
    assert deadly.deaths == deaths
    with Store.read(tmp_path / "s") as store:
        assert [(row.run, row.reason) for row in store.rows() if row.state == "failed"] == [(5, DIED)]


def test_a_full_disk_ends_the_session_and_the_next_one_finishes(short, tmp_path, monkeypatch):
    """SQLite's own limit on the size of the file stands for the disk's; every run finds 20 kB."""
    from testbench.questions.campaign import store

    def task(job, runs):
        found = json.dumps({"figures": {}, "poles": {}, "x": "y" * 20_000})
        return [Outcome(run, run, "{}", found, "", 1.0) for run in runs]

    connect = store._connect

    def small(path: Path):
        db = connect(path)
        db.execute("PRAGMA max_page_count = 16")  # of 16 kB
        return db

    loaded = short("runs = 30")
    monkeypatch.setattr(store, "_connect", small)
    with pytest.raises(CampaignError, match=r"disk is full; what is finished is kept. Free space, then go on"):
        fly_campaign(loaded, tmp_path / "s", workers=1, task=task)
    monkeypatch.undo()
    before = finished(tmp_path / "s")
    assert 0 < before < 30
    ending = fly_campaign(loaded, tmp_path / "s", resume=True, workers=1, task=task)
    assert ending.counts.done == 30


def test_a_fault_of_the_program_in_one_run_is_a_row_with_its_place(short, tmp_path, monkeypatch):
    from testbench.questions.campaign import flying

    loaded = short("runs = 2")
    job = Job(loaded.spec.model_dump_json(), json.dumps(loaded.content), ())
    monkeypatch.setattr(flying, "run", lambda *args, **kwargs: 1 / 0)
    (out,) = fly_batch(job, [1])
    assert re.fullmatch(r"unexpected ZeroDivisionError: division by zero \(test_execute.py, line \d+\)", out.reason)
    monkeypatch.setattr(flying, "run", lambda *args, **kwargs: (_ for _ in ()).throw(EstimationError("too few")))
    (out,) = fly_batch(job, [1])
    assert out.reason == "EstimationError: too few"
    assert out.results is None


def test_a_stopping_rule_ends_with_the_same_run_whoever_flies(short, tmp_path):
    stop = '[stop]\nquantity = "{}"\nhalf_width = {}\nminimum = 8\nblock = 4'
    quantity = "taurus_8hz, transfer_function: identification MRSE, %"
    tables = []
    for workers in (1, 2):
        ending = fly_campaign(short("runs = 400", stop.format(quantity, 4.0)), tmp_path / f"{workers}", workers=workers)
        assert ending.stopped is not None
        assert 8 <= ending.stopped < 400
        assert ending.stopped % 4 == 0
        assert ending.counts.total == ending.counts.finished == ending.stopped
        tables.append(table(tmp_path / f"{workers}"))
    assert tables[0] == tables[1]
    ending = fly_campaign(short("runs = 400", stop.format(quantity, 4.0)), tmp_path / "1", resume=True)
    assert ending.counts.total == ending.stopped  # found in the store: nothing is flown
    with pytest.raises(CampaignError, match=r"got '.*: MRSE'; did you mean"):
        fly_campaign(
            short("runs = 400", stop.format("taurus_8hz, transfer_function: MRSE", 4.0)),
            tmp_path / "1",
            resume=True,
            workers=1,
        )


def test_time_histories_are_kept_as_netcdf(short, tmp_path):
    fly_campaign(short("runs = 1\nrecords = true"), tmp_path / "s", workers=1)
    names = sorted(p.name for p in (tmp_path / "s" / "records").iterdir())
    assert names == ["run_000000_doublet_taurus_8hz.nc", "run_000000_doublet_truth.nc"]
    record = load_record(tmp_path / "s" / "records" / names[0])
    assert record.kind == "measured"
    assert record.duration_s == pytest.approx(6.0, abs=0.2)


@pytest.mark.slow
def test_a_cluster_of_separate_processes_gives_the_same_table_whatever_is_killed(
    short, tmp_path, cluster, reference_store
):
    """A worker is killed, then the scheduler; what is finished stays, and a new cluster finishes the same table."""
    loaded = short("runs = 1000")
    process, address = cluster.scheduler(1)
    workers = [cluster.worker(address) for _ in range(2)]
    failure: list[BaseException] = []

    def fly() -> None:
        try:
            fly_campaign(loaded, tmp_path / "s", workers=address)
        except CampaignError as error:
            failure.append(error)

    flying = threading.Thread(target=fly)
    flying.start()
    wait_until(lambda: finished(tmp_path / "s") >= 1, "the first runs")
    workers[0].kill()
    at = finished(tmp_path / "s")
    wait_until(lambda: finished(tmp_path / "s") > at, "the runs after the worker's death")
    process.kill()
    flying.join(WAIT_S)
    assert not flying.is_alive()
    (error,) = failure
    assert f"the scheduler at {address} has gone; what is finished is kept" in str(error)
    assert 2 <= finished(tmp_path / "s") < 1000
    runs = behind(tmp_path / "s")
    _, address = cluster.scheduler(2)
    cluster.worker(address)
    ending = fly_campaign(short(f"runs = {runs}"), tmp_path / "s", resume=True, workers=address)
    assert ending.counts.finished == runs
    assert rows(tmp_path / "s")[:24] == rows(reference_store)[:runs]


def test_a_scheduler_that_does_not_answer_is_named(short, tmp_path, monkeypatch):
    from testbench.questions.campaign import workers

    monkeypatch.setattr(workers, "_CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense"):
        with pytest.raises(CampaignError, match=f"must answer at '{address}'"):
            fly_campaign(short(), tmp_path / "s", workers=address)
    assert not (tmp_path / "s").exists()


def test_only_a_scheduler_needs_dask(short, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CampaignError, match=r"; pip install '[^']+\[campaign\]', or leave it out"):
        fly_campaign(short(), tmp_path / "s", workers="tcp://127.0.0.1:9")
    assert not (tmp_path / "s").exists()
    assert fly_campaign(short("runs = 2"), tmp_path / "s", workers=1).counts.done == 2


@pytest.mark.slow
def test_where_no_process_can_be_forked_others_give_the_same_table(short, tmp_path, monkeypatch, reference):
    monkeypatch.setattr(processes, "_CONTEXT", multiprocessing.get_context("spawn"))
    fly_campaign(short("runs = 24"), tmp_path / "s", workers=2)
    assert table(tmp_path / "s") == reference


@pytest.fixture
def no_process(monkeypatch):
    """Return what makes every further process fail to start, as a limit of processes does."""

    def refuse(self):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    return lambda: monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)


NONE = r"this machine starts none \(Resource temporarily unavailable\).*campaign resume"


def test_no_process_at_the_start_is_said_and_no_store_is_left(short, tmp_path, no_process):
    no_process()
    with pytest.raises(CampaignError, match=NONE):
        fly_campaign(short("runs = 24"), tmp_path / "s", workers=1)
    assert not (tmp_path / "s").exists()


def test_workers_that_cannot_come_back_end_the_session_and_resume_finishes(short, tmp_path, no_process):
    fatal_once = fatal(tmp_path)
    (tmp_path / "11").touch()

    def seen(progress):
        no_process()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(execute, "_LOOK_S", 0.0)
        with pytest.raises(CampaignError, match=NONE):
            fly_campaign(short("runs = 24"), tmp_path / "s", workers=2, task=fatal_once, progress=seen)
    assert 0 < finished(tmp_path / "s") < 24


def test_workers_without_the_testbench_are_told():
    class Bare:
        def result(self):
            raise ModuleNotFoundError("No module named 'testbench'")

    with pytest.raises(CampaignError, match=r"workers must have the testbench .* one of the cluster says: No module"):
        Workers(None, "the cluster", fly_batch, None).collect(Bare())


@pytest.mark.parametrize(
    ("status", "error", "words"), [("finished", CampaignError, "the cluster has gone"), ("error", OSError, "disk full")]
)
def test_a_scheduler_that_goes_while_it_is_asked_is_told_from_a_batch_that_failed(status, error, words):
    class Asked:
        def result(self):
            raise OSError("disk full")

    asked = Asked()
    asked.status = status
    with pytest.raises(error, match=words):
        Workers(None, "the cluster", fly_batch, None).collect(asked)


def test_workers_of_other_versions_are_refused(short):
    loaded = short("runs = 1")
    job = Job(loaded.spec.model_dump_json(), json.dumps(loaded.content), (("jsbsim", "0.0"),))
    with pytest.raises(CampaignError, match=r"got jsbsim \d.* \(campaign: 0\.0\)"):
        fly_batch(job, [0])
