"""The store of a campaign: one SQLite file, one row per run, one writer.

A batch of finished runs is one transaction in write-ahead mode, synchronised to the disk: a committed batch survives
the death of any process and of the machine; other runs are flown again. A run is counted once because its number is the
key of its row, and because a row once finished is never written again. Who flies holds a lock of the store alone, so
that a page can be written of the runs so far.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from testbench.core.door import checked
from testbench.core.errors import CampaignError, TestbenchError
from testbench.core.escape import one_line
from testbench.core.files import reason_of
from testbench.core.store import OWN, ResultFolder, locked
from testbench.questions.campaign.load import versions

if TYPE_CHECKING:
    from filelock import FileLock

    from testbench.questions.campaign.flying import Outcome
    from testbench.questions.campaign.load import Campaign

VERSION = "1"
FILE, RECORDS, LOCK = "campaign.sqlite", "records", "campaign.lock"
_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE runs (
    run INTEGER PRIMARY KEY,
    state TEXT NOT NULL CHECK (state IN ('pending', 'running', 'done', 'failed')),
    seed INTEGER, inputs TEXT, results TEXT, reason TEXT, seconds REAL
);
CREATE INDEX unfinished ON runs (run) WHERE state IN ('pending', 'running');
"""


class Counts(NamedTuple):
    """How many runs are in which state."""

    pending: int = 0
    running: int = 0
    done: int = 0
    failed: int = 0

    @property
    def total(self) -> int:
        """All runs."""
        return sum(self)

    @property
    def finished(self) -> int:
        """Runs that are done or failed."""
        return self.done + self.failed


@dataclass(frozen=True)
class Row:
    """One finished run as it stands in the store; inputs and results are JSON."""

    run: int
    state: str
    seed: int
    inputs: str
    results: str | None
    reason: str | None


class Store:
    """An open store; :meth:`create`, :meth:`resume` or :meth:`read` opens one. A context manager that closes it."""

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: FileLock | None = None) -> None:
        self.path = path
        self._db = connection
        self._lock = lock

    @classmethod
    def create(cls, folder: Path, campaign: Campaign) -> Store:
        """Make the store of a campaign in ``folder``, every run pending; the manifest lists it and the time histories.

        Raises:
            BusyError: another process writes to it.
            CampaignError: there is a store already, or the disk is full.
            RecordError: the folder has a file of such a name that is not the testbench's.
        """
        place, path = ResultFolder(folder), folder / FILE
        try:
            lock = locked(folder, LOCK)
            try:
                if path.exists() and _is_whole(path):
                    raise CampaignError(
                        f"a new campaign needs a folder without a store, but there is '{path}'; go on with `testbench "
                        "campaign resume`, or give another folder with --out"
                    )
                place.live(FILE)
                place.live(RECORDS)
            except BaseException:
                lock.release()
                raise
        finally:
            place.leave()
        try:
            for end in ("", "-wal", "-shm"):  # a store whose making was interrupted holds no run
                (folder / f"{FILE}{end}").unlink(missing_ok=True)
            store = cls(path, _connect(path), lock)
        except BaseException:
            lock.release()
            raise
        try:
            with store.transaction() as db:
                for statement in filter(str.strip, _SCHEMA.split(";")):
                    db.execute(statement)
                meta = {"digest": campaign.digest(), "name": campaign.spec.name, "campaign": campaign.text}
                base = campaign.base
                meta |= {"aircraft": base.aircraft, "input": " + ".join(m.name for m in base.manoeuvre)}
                meta |= {f"version {k}": v for k, v in versions().items()}
                db.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
                _add_runs(db, 0, campaign.spec.total)
                db.execute("INSERT INTO meta VALUES ('version', ?)", (VERSION,))
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def resume(cls, folder: Path, campaign: Campaign) -> Store:
        """Open the store of a campaign to continue it: runs that were under way are pending again, finished runs stay.

        Raises:
            BusyError: another process writes to it.
            CampaignError: there is no store, or it is of another campaign or version.
        """
        path = folder / FILE
        if not path.is_file():
            raise CampaignError(f"a campaign to go on with must have a store, got none at '{path}'; use campaign run")
        (folder / OWN).mkdir(exist_ok=True)
        lock = locked(folder, LOCK)
        try:
            store = cls(path, _connect(path), lock)
        except BaseException:
            lock.release()
            raise
        try:
            store._check_version()
            store._check_campaign(campaign)
            total = campaign.spec.total
            with store.transaction() as db:
                db.execute("UPDATE runs SET state = 'pending' WHERE state = 'running'")
                have = int(db.execute("SELECT coalesce(max(run) + 1, 0) FROM runs").fetchone()[0])
                beyond = db.execute("SELECT count(*) FROM runs WHERE run >= ? AND state != 'pending'", (total,))
                if int(beyond.fetchone()[0]):
                    raise CampaignError(
                        f"a campaign may grow but not shrink below what is finished, got {total} runs where the store "
                        f"'{path}' has finished some beyond them; raise runs or repeats to {have} runs at least"
                    )
                db.execute("DELETE FROM runs WHERE run >= ?", (total,))
                _add_runs(db, have, total)
                db.execute("DELETE FROM meta WHERE key = 'stopped'")
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def read(cls, folder: Path) -> Store:
        """Open a store to read it, while another process may write to it.

        Raises:
            CampaignError: there is no store, or it is of another version.
        """
        path = folder / FILE
        if not path.is_file():
            raise CampaignError(f"a campaign to look at must have a store, got none at '{path}'; use campaign run")
        store = cls(path, _connect(path))
        try:
            store._check_version()
        except BaseException:
            store.close()
            raise
        return store

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let another process write."""
        with suppress(sqlite3.Error):  # of a damaged file
            self._db.close()
        if self._lock is not None:
            self._lock.release()

    def _check_version(self) -> None:
        found = self.meta("version")
        if found != VERSION:
            raise CampaignError(
                f"the store '{self.path}' must be of version {VERSION}, which this testbench writes, got "
                f"{one_line(str(found))}; "
                "use the testbench that made it, or give another folder with --out"
            )

    def _check_campaign(self, campaign: Campaign) -> None:
        other = [
            f"{name} {one_line(str(self.meta(f'version {name}')))} (now {now})"
            for name, now in versions().items()
            if self.meta(f"version {name}") != now
        ]
        if other:
            raise CampaignError(
                f"a campaign must be finished with the versions that it was begun with, but '{self.path}' was made "
                f"with {', '.join(other)}; install those, or give another folder with --out"
            )
        if self.meta("digest") != campaign.digest():
            raise CampaignError(
                f"'{self.path}' belongs to another campaign: since then its distributions, seed, scenario, aircraft, "
                "sensors or own estimators have changed; give another folder with --out, or undo the change"
            )

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Commit everything that is done inside, or nothing of it.

        Raises:
            CampaignError: the disk is full or cannot be written; what was committed before stays.
        """
        try:
            self._db.execute("BEGIN IMMEDIATE")
            yield self._db
            self._db.execute("COMMIT")
        except sqlite3.OperationalError as error:
            self._roll_back()
            raise CampaignError(
                f"the store '{self.path}' must be writable, got: {error}; what is finished is kept. Free space, then "
                "go on with `testbench campaign resume`"
            ) from error
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._roll_back()
            raise self._damaged(error) from error
        except BaseException:
            self._roll_back()
            raise

    def _roll_back(self) -> None:
        with suppress(sqlite3.Error):
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def _damaged(self, error: Exception) -> CampaignError:
        return CampaignError(
            f"'{self.path}' must be a campaign's store as the testbench wrote it, but it is damaged or none: "
            f"{one_line(reason_of(error))}; take it from a copy, or begin anew in another folder with --out"
        )

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Turn whatever trips over what the file holds into an error that names it.

        Raises:
            CampaignError: the file is damaged.
        """
        try:
            yield
        except TestbenchError:
            raise
        except Exception as error:
            raise self._damaged(error) from error

    def meta(self, key: str) -> str | None:
        """Return a note of the store, or None."""
        row = self._first("SELECT value FROM meta WHERE key = ?", key)
        return None if row is None else str(row[0])

    def exchange(self, finished: Sequence[Outcome], started: Iterable[int] = (), returned: Iterable[int] = ()) -> None:
        """Write finished runs, and which runs have been handed out or were given back unfinished; one transaction.

        A row that is finished already stays as it is.

        Raises:
            CampaignError: see :meth:`transaction`.
        """
        with self.transaction() as db:
            db.executemany(
                "UPDATE runs SET state = ?, seed = ?, inputs = ?, results = ?, reason = ?, seconds = ? "
                "WHERE run = ? AND state IN ('pending', 'running')",
                [
                    (
                        "failed" if o.reason else "done",
                        o.seed,
                        o.inputs,
                        o.results,
                        o.reason or None,
                        o.seconds,
                        o.index,
                    )
                    for o in finished
                ],
            )
            for state, runs in (("running", started), ("pending", returned)):
                db.executemany(
                    "UPDATE runs SET state = ? WHERE run = ? AND state IN ('pending', 'running')",
                    [(state, run) for run in runs],
                )

    def stop_at(self, count: int) -> None:
        """End the campaign with its first ``count`` runs; what was flown beyond them is dropped."""
        with self.transaction() as db:
            db.execute("DELETE FROM runs WHERE run >= ?", (count,))
            db.execute("INSERT OR REPLACE INTO meta VALUES ('stopped', ?)", (str(count),))

    def unfinished(self, after: int, most: int) -> list[int]:
        """Return the numbers of up to ``most`` pending runs after run ``after``, in order."""
        rows = self.asked(
            "SELECT run FROM runs WHERE run > ? AND state IN ('pending', 'running') AND state = 'pending' "
            "ORDER BY run LIMIT ?",
            (after, most),
        )
        return [int(row[0]) for row in rows]

    def first_unfinished(self) -> int | None:
        """Return the lowest number of a run that is neither done nor failed, or None."""
        (run,) = self._first("SELECT min(run) FROM runs WHERE state IN ('pending', 'running')")
        return None if run is None else int(run)

    def counts(self) -> Counts:
        """Return how many runs are in which state."""
        with self.whole():
            return Counts(**{str(k): int(v) for k, v in self.asked("SELECT state, count(*) FROM runs GROUP BY state")})

    def seconds(self) -> tuple[float, int]:
        """Return the sum of the processor time of finished runs, s, and the size of the store, bytes."""
        (total,) = self._first("SELECT coalesce(sum(seconds), 0.0) FROM runs")
        (pages,), (size,) = self._first("PRAGMA page_count"), self._first("PRAGMA page_size")
        return float(total), int(pages * size)

    def asked(self, query: str, values: Mapping[str, int] | Sequence[object] = ()) -> Iterator[tuple[Any, ...]]:
        """Yield what the store answers to a query, row by row.

        Raises:
            CampaignError: the file is damaged.
        """
        with self.whole():
            for row in self._db.execute(query, values):  # noqa: UP028 - it would close the cursor after the file
                yield row

    def _first(self, query: str, *values: object) -> Any:
        with self.whole():
            return self._db.execute(query, values).fetchone()

    def rows(self, first: int = 0, end: int | None = None) -> Iterator[Row]:
        """Yield the finished runs from ``first`` up to ``end``, in order."""
        found = self.asked(
            "SELECT run, state, seed, inputs, results, reason FROM runs "
            "WHERE run >= ? AND run < ? AND state IN ('done', 'failed') ORDER BY run",
            (first, 1 << 62 if end is None else end),
        )
        for row in found:
            yield Row(*row)


def _connect(path: Path) -> sqlite3.Connection:
    if path.exists():
        checked(path, "campaign store")
    try:
        db = sqlite3.connect(path, timeout=30.0, isolation_level=None)
        db.execute("PRAGMA page_size = 16384")  # of a new file: rows of 2 kB fill pages of 4 kB badly
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise CampaignError(
            f"'{path}' must be a campaign's store that can be opened, got: {one_line(str(error))}; free space, or give "
            "another folder with --out"
        ) from error
    return db


def _is_whole(path: Path) -> bool:
    """Say whether a store was made to its end: its version is written last. A file that is none stays as it is."""
    db = sqlite3.connect(path, timeout=30.0)
    try:
        return db.execute("SELECT value FROM meta WHERE key = 'version'").fetchone() is not None
    except (sqlite3.Error, UnicodeDecodeError):
        return False
    finally:
        db.close()


def _add_runs(db: sqlite3.Connection, first: int, end: int) -> None:
    db.executemany("INSERT INTO runs (run, state) VALUES (?, 'pending')", ((i,) for i in range(first, end)))
