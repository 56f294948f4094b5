"""The workbench: commands that a page starts, what they print as it comes, and the results that they leave."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import secrets
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from threading import Condition, Thread
from types import TracebackType
from typing import Any, Self

from testbench.core.door import sha256
from testbench.core.errors import RecordError, WriteError
from testbench.core.files import write_file
from testbench.core.paths import not_found
from testbench.page.serve import Answer
from testbench.questions.app.page import app_page
from testbench.questions.results.ask import list_results
from testbench.questions.results.page import files_of, index_html

LOGS, RESULTS = "logs", "results"
"""Folders in that of a workbench: of the logs that were dropped, and of results."""
ASKED = {
    "identify": ("identify", "{}", "--out", RESULTS),
    "look": ("import", "{}", "--out", f"{RESULTS}/{{name}}_log"),
}
"""What a page may ask of logs -> words of the command; ``{}`` stands for the logs, ``{name}`` for the first's."""
_MOST_WORDS = 1_000_000  # bytes of a question
_JSON, _EVENTS = "application/json", "text/event-stream"
_WIDE = "1000"  # columns: the browser breaks lines


@dataclass(eq=False)
class Job:
    """A command that runs or ran.

    Attributes:
        words: after ``testbench``.
        lines: that it printed.
        status: its exit status; None while it runs.
        process: that runs it.
    """

    words: tuple[str, ...]
    lines: list[str] = field(default_factory=list)
    status: int | None = None
    process: subprocess.Popen[str] | None = None

    def told(self, number: int) -> dict[str, Any]:
        """Return what a page shows of it."""
        pages = [line.removeprefix("Report: ") for line in self.lines if line.startswith("Report: ")]
        folders = [word for word in self.words if word.endswith("_log")]
        if self.status == 0 and not pages:
            pages = [f"{folder}/report.html" for folder in folders]
        command = shlex.join(("testbench", *self.words))
        return {"number": number, "command": command, "status": self.status, "pages": pages}


class Workbench:
    """What a page in a browser works with: the logs, commands and results of one folder.

    Every path begins with a token, so that nobody else on this machine can ask. Below it lie the page, ``jobs`` (a
    list), ``jobs/N`` (events of the Nth), ``results/...``; ``logs/NAME`` takes a log and ``ask/identify`` or
    ``ask/look`` the names of logs, as a JSON list.

    Args:
        folder: to work in.

    Raises:
        RecordError: it is not there.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise RecordError(f"a folder to work in must exist, got {not_found(folder, files=Path.is_dir)}")
        self.folder = folder.resolve()
        self.home = f"/{secrets.token_urlsafe(16)}/"
        self.jobs: list[Job] = []
        self._changed = Condition()
        results = self.folder / RESULTS
        self._files = files_of(results, lambda: index_html(list_results(results) if results.is_dir() else [], results))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for job in self.jobs:
            if job.process is not None and job.status is None:
                job.process.terminate()

    def answer(self, path: str) -> Answer | None:
        """Return what GET of a path gives."""
        if not path.startswith(self.home):
            return None
        what, _, rest = path.removeprefix(self.home).partition("/")
        if what == RESULTS:
            return self._files(rest)
        if what == "jobs" and not rest:
            return _as_json([job.told(k) for k, job in enumerate(self.jobs)])
        if what == "jobs" and rest.isdecimal() and int(rest) < len(self.jobs):
            return Answer(self._events(int(rest)), _EVENTS)
        return Answer(app_page(self.folder.name).encode()) if not what else None

    def take(self, path: str, body: Iterator[bytes]) -> Answer | None:
        """Return what POST to a path gives: the name that a log got, or the command that was started."""
        if not path.startswith(self.home):
            return None
        what, _, rest = path.removeprefix(self.home).partition("/")
        if what == LOGS and rest and Path(rest).name == rest and not rest.startswith((".", "-")) and rest.isprintable():
            try:
                return _as_json({"log": self._kept(rest, body)})
            except WriteError as error:
                return _as_json({"error": str(error)}, HTTPStatus.INSUFFICIENT_STORAGE)
        if what == "ask" and rest in ASKED:
            return self._asked(rest, body)
        return None

    def _kept(self, name: str, body: Iterator[bytes]) -> str:
        """Write a log and return its path in the folder: never over one of another content."""

        def fill(part: Path) -> None:
            """Write what comes."""
            with part.open("wb") as file:
                file.writelines(body)

        folder = self.folder / LOGS
        new = write_file(folder / f".{secrets.token_hex(8)}", fill, "a log must go to a folder that can be written to")
        try:
            for k in itertools.count(1):
                path = folder / (name if k == 1 else f"{Path(name).stem}_{k}{Path(name).suffix}")
                with contextlib.suppress(FileExistsError):
                    os.link(new, path)
                    break
                if sha256(path, "log") == sha256(new, "log"):
                    break
        finally:
            new.unlink()
        return f"{LOGS}/{path.name}"

    def _asked(self, what: str, body: Iterator[bytes]) -> Answer:
        """Start what is asked of logs."""
        content = b""
        for part in body:
            content += part
            if len(content) > _MOST_WORDS:
                break
        try:
            logs = json.loads(content)
        except ValueError:
            logs = None
        if not (isinstance(logs, list) and logs and all(isinstance(log, str) and log for log in logs)):
            return _as_json({"error": "logs must be a JSON list of names"}, HTTPStatus.BAD_REQUEST)
        paths = [f"./{log}" if log.startswith("-") else log for log in logs]
        words: list[str] = []
        for word in ASKED[what]:
            words += paths if word == "{}" else [word.format(name=Path(paths[0]).stem)]
        self.jobs.append(Job(tuple(words)))
        number = len(self.jobs) - 1
        Thread(target=self._run, args=(self.jobs[number],), daemon=True).start()
        return _as_json(self.jobs[number].told(number))

    def _run(self, job: Job) -> None:
        """Run a command and keep what it prints, line by line."""
        job.process = subprocess.Popen(
            [sys.executable, "-m", "testbench", *job.words], cwd=self.folder, text=True, encoding="utf-8",
            errors="replace", stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env=os.environ | {"COLUMNS": _WIDE, "PYTHONUTF8": "1"},
        )  # fmt: skip
        assert job.process.stdout is not None
        for line in job.process.stdout:
            with self._changed:
                job.lines.append(line.strip())
                self._changed.notify_all()
        status = job.process.wait()
        with self._changed:
            job.status = status
            self._changed.notify_all()

    def _events(self, number: int) -> Iterator[bytes]:
        """Yield the lines of a command as server-sent events, and at last an event "end" with what became of it."""
        job, sent = self.jobs[number], 0
        while True:
            with self._changed:
                if len(job.lines) == sent and job.status is None:
                    self._changed.wait(1.0)
                new, ended = job.lines[sent:], job.status is not None
            sent += len(new)
            yield b"".join(f"data: {json.dumps(line)}\n\n".encode() for line in new) or b": still at work\n\n"
            if ended and sent == len(job.lines):
                yield f"event: end\ndata: {json.dumps(job.told(number))}\n\n".encode()
                return


def _as_json(content: Any, status: HTTPStatus = HTTPStatus.OK) -> Answer:
    return Answer(json.dumps(content).encode(), _JSON, status)
