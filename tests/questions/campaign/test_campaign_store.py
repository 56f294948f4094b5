"""The store: one writer, nothing lost, nothing counted twice, and refusals in words."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from testbench.core.errors import BusyError, CampaignError, WriteError
from testbench.core.store import ResultFolder, manifest_of
from testbench.questions.campaign.flying import Outcome
from testbench.questions.campaign.result import read_campaign
from testbench.questions.campaign.store import FILE, RECORDS, Counts, Store
from testbench.questions.campaign.tidy import tidy_store

ROOT = Path(__file__).resolve().parents[3]
HOLD = """
import sys, time
from pathlib import Path
from testbench.core.store import locked
from testbench.questions.campaign.store import LOCK
lock = locked(Path(sys.argv[1]), LOCK)
print("held", flush=True)
time.sleep(600)
"""


def outcome(run: int, value: float = 1.0, reason: str = "") -> Outcome:
    results = json.dumps({"figures": {"s, e": {"x": value}}, "poles": {}})
    return Outcome(run, run, "{}", None if reason else results, reason, 0.1)


def test_rows_are_counted_once_and_keep_what_was_first(short, tmp_path):
    with Store.create(tmp_path / "s", short()) as store:
        assert store.counts() == Counts(pending=24)
        store.exchange([outcome(0), outcome(3, reason="TrimError: no")], started=[1, 2])
        store.exchange([outcome(0, 7.0), outcome(3)], started=[0], returned=[3])
        assert store.counts() == Counts(20, 2, 1, 1)
        assert [json.loads(r.results)["figures"]["s, e"]["x"] for r in store.rows() if r.results] == [1.0]
        assert store.first_unfinished() == 1
        assert store.unfinished(-1, 3) == [4, 5, 6]
    with Store.resume(tmp_path / "s", short()) as store:
        assert store.counts() == Counts(22, 0, 1, 1)
        assert store.unfinished(-1, 3) == [1, 2, 4]


def test_a_campaign_may_grow_but_not_shrink_below_what_is_finished(short, tmp_path):
    with Store.create(tmp_path / "s", short()) as store:
        store.exchange([outcome(20)])
    with Store.resume(tmp_path / "s", short("runs = 30")) as store:
        assert store.counts() == Counts(pending=29, done=1)
    with pytest.raises(CampaignError, match="not shrink below what is finished, got 10 runs"):
        Store.resume(tmp_path / "s", short("runs = 10"))
    with Store.resume(tmp_path / "s", short("runs = 21")) as store:
        assert store.counts().total == 21


def test_another_campaign_version_or_no_store_is_refused(short, tmp_path):
    with pytest.raises(CampaignError, match="must have a store, got none"):
        Store.resume(tmp_path / "s", short())
    with pytest.raises(CampaignError, match="must have a store, got none"):
        Store.read(tmp_path / "s")
    Store.create(tmp_path / "s", short()).close()
    with pytest.raises(CampaignError, match="without a store"):
        Store.create(tmp_path / "s", short())
    with pytest.raises(CampaignError, match="belongs to another campaign"):
        Store.resume(tmp_path / "s", short(old="std = 0.3", new="std = 0.4"))
    db = sqlite3.connect(tmp_path / "s" / FILE)
    db.execute("UPDATE meta SET value = '0.0' WHERE key = 'version jsbsim'")
    db.commit()
    with pytest.raises(CampaignError, match=r"was made with jsbsim 0\.0"):
        Store.resume(tmp_path / "s", short())
    db.execute("UPDATE meta SET value = '99' WHERE key = 'version'")
    db.commit()
    db.close()
    for opened in (lambda: Store.resume(tmp_path / "s", short()), lambda: Store.read(tmp_path / "s")):
        with pytest.raises(CampaignError, match="must be of version 1, which this testbench writes, got 99"):
            opened()


def test_a_file_that_is_no_store_is_refused(short, tmp_path):
    (tmp_path / FILE).write_bytes(b"no database at all, but long enough to be read as one" * 100)
    with pytest.raises(CampaignError, match="must be a campaign's store"):
        Store.read(tmp_path)


def test_a_second_writer_is_refused_until_the_first_is_gone(short, tmp_path):
    Store.create(tmp_path, short()).close()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with pytest.raises(BusyError, match=f"one writer at a time, but process {holder.pid} is"):
        Store.resume(tmp_path, short())
    with Store.read(tmp_path) as store:  # reading is free
        assert store.counts().total == 24
    with ResultFolder(tmp_path) as place:  # as a page of the runs so far is written
        (place.new / "report.html").write_text("page")
    assert {*manifest_of(tmp_path).files} == {"report.html", FILE}
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    with Store.resume(tmp_path, short()) as store:
        assert store.counts().total == 24


@pytest.mark.parametrize("name", [FILE, RECORDS])
def test_what_is_not_the_campaigns_is_not_replaced(short, tmp_path, name):
    (tmp_path / name).mkdir() if name == RECORDS else (tmp_path / name).write_bytes(b"")
    with pytest.raises(WriteError, match=f"no manifest lists '.*{name}'"):
        Store.create(tmp_path, short())
    assert (tmp_path / name).exists()
    assert not (tmp_path / name).is_file() or (tmp_path / name).read_bytes() == b""


KILLED = """
import os, signal, sys
from pathlib import Path
from testbench.questions.campaign import store
from testbench.questions.campaign.load import load_campaign
def killed(db, first, end):
    os.kill(os.getpid(), signal.SIGKILL)
store._add_runs = killed
store.Store.create(Path(sys.argv[2]), load_campaign(sys.argv[1]))
"""


def test_a_store_whose_making_was_killed_is_made_again(short, tmp_path):
    """Its file is there, and the manifest says whose it is."""
    campaign = short()
    words = [sys.executable, "-c", KILLED, str(campaign.spec.file), str(tmp_path / "s")]
    done = subprocess.run(words, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "s" / FILE).exists()
    with Store.create(tmp_path / "s", campaign) as store:
        assert store.counts() == Counts(pending=24)


def test_a_full_disk_stops_with_a_clear_error_and_loses_nothing(short, tmp_path):
    with Store.create(tmp_path, short()) as store:
        store.exchange([outcome(i) for i in range(5)])
        # SQLite's own limit on the file gives the error that a full disk gives
        pages = store._db.execute("PRAGMA page_count").fetchone()[0]
        store._db.execute(f"PRAGMA max_page_count = {pages}")
        long = [Outcome(i, i, "{}", json.dumps({"x": "y" * 100_000}), "", 0.1) for i in range(5, 10)]
        with pytest.raises(CampaignError, match=r"disk is full; what is finished is kept. Free space, then go on"):
            store.exchange(long)
    with Store.resume(tmp_path, short()) as store:
        assert store.counts() == Counts(pending=19, done=5)


def test_a_store_with_changed_bytes_is_read_or_refused_in_one_line(short, tmp_path):
    """40 of 90 such files ended in a traceback."""
    campaign, refused = short(), []
    with Store.create(tmp_path / "s", campaign) as store:
        store.exchange([outcome(run) for run in range(20)])
    whole, rng = (tmp_path / "s" / FILE).read_bytes(), np.random.default_rng(5)
    for count in [*range(1, 51)] * 2:
        content = np.frombuffer(whole, np.uint8).copy()
        content[rng.integers(0, content.size, count)] = rng.integers(0, 256, count, np.uint8)
        (tmp_path / "s" / FILE).write_bytes(content.tobytes())
        for leftover in (tmp_path / "s").glob(f"{FILE}-*"):
            leftover.unlink()
        try:
            with Store.read(tmp_path / "s") as store:
                read_campaign(campaign, store)
            list(tidy_store(tmp_path / "s"))
            Store.resume(tmp_path / "s", campaign).close()
        except CampaignError as error:
            refused.append(str(error))
    assert len(refused) > 20
    assert not any("\n" in text for text in refused)


@pytest.mark.parametrize(
    "row", ["results = 'x'", "results = '[1]'", "results = '{}'", "inputs = 'null'", "results = 5"]
)
def test_a_row_whose_text_is_damaged_is_named(short, tmp_path, row):
    with Store.create(tmp_path / "s", short()) as store:
        store.exchange([outcome(0)])
        store._db.execute(f"UPDATE runs SET {row} WHERE run = 0")
    with Store.read(tmp_path / "s") as store, pytest.raises(CampaignError, match=f"{FILE}' must be .* damaged"):
        read_campaign(short(), store)
