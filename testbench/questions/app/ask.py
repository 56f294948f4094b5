"""The workbench: commands that a page starts, what they print as it comes, and the results that they leave."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import re
import secrets
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from http import HTTPStatus
from pathlib import Path
from threading import Condition, Lock, Thread
from types import TracebackType
from typing import Any, Self

from testbench.core.door import read_json, read_text
from testbench.core.errors import RecordError, TestbenchError, WriteError
from testbench.core.files import kept_in, not_written, write_file
from testbench.core.paths import not_found
from testbench.core.project import FILE
from testbench.core.store import entry_of, is_plain
from testbench.page.serve import Answer
from testbench.questions import QUESTIONS
from testbench.questions.app.campaigns import campaign_told, list_campaigns
from testbench.questions.app.drawn import amended_words, design_text, design_told, input_told, list_designs, plan_words
from testbench.questions.app.exercises import answer_exercise, list_exercises, page_of
from testbench.questions.app.page import app_page
from testbench.questions.app.records import (
    channels_figure,
    inside,
    list_records,
    motion_told,
    record_told,
    settings_told,
    spectra_figure,
)
from testbench.questions.files import kinds_of
from testbench.questions.results.ask import list_results
from testbench.questions.results.page import files_of

LOGS, RESULTS = "logs", "results"
"""Folders in that of a workbench: of the logs that were dropped, and of results."""
SERVERS = ("app", "studio", "live", "sitl")
"""Questions that do not end by themselves: a terminal asks them."""
ASKED = {q.command: q for q in QUESTIONS if q.command not in SERVERS}
"""What a page may ask: command -> question of the table; and ``check``, of a file that it has written."""
_MOST_KEPT, _MOST_LINES = 50, 200  # commands and folders that are kept for the server that comes after, and lines
_TOKEN = re.compile(r"[\w-]{22}")
_MOST_WORDS = 1_000_000  # bytes of a question
_JSON, _EVENTS = "application/json", "text/event-stream"
_WIDE = "1000"  # columns: the browser breaks lines


@dataclass(eq=False)
class Job:
    """A command that runs or ran.

    Attributes:
        words: after ``testbench``.
        lines: that it printed, each with the seconds since it began.
        begun: when, s of the clock.
        ended: the same at its end.
        status: its exit status; None while it runs.
        process: that runs it.
    """

    words: tuple[str, ...]
    lines: list[tuple[float, str]] = field(default_factory=list)
    begun: float = field(default_factory=time.time)
    ended: float | None = None
    status: int | None = None
    process: subprocess.Popen[str] | None = None

    def told(self, number: int) -> dict[str, Any]:
        """Return what a page shows of it; its pages are those that it says it wrote."""
        heads = ("Report: ", "Written: ")
        said = [line.partition(": ")[2] for _, line in self.lines if line.startswith(heads)]
        return {
            "number": number,
            "words": list(self.words),
            "command": shlex.join(("testbench", *self.words)),
            "begun": self.begun,
            "lasted": (self.ended or time.time()) - self.begun,
            "status": self.status,
            "pages": [page for page in said if page.endswith(".html")],
        }


class Workbench:
    """What a page in a browser works with: the logs, commands and results of one folder.

    Every path begins with a token, so that nobody else on this machine can ask. Below it lie the page; the lists
    ``board``, ``records``, ``campaigns``, ``designs``, ``exercises`` and ``jobs``; ``jobs/N``, the events of the Nth;
    ``exercises/...``, the text of one; and ``results/...``.
    ``logs/NAME`` takes a log, ``ask`` the words of a command as a JSON list; ``stop/N`` ends the Nth;
    ``show/WHAT`` takes a JSON object that says of which records, campaign or design it is, ``save`` one with the new
    text of a TOML file, ``save/design`` one with what was drawn, ``save/answers`` those to an exercise.

    Args:
        folder: to work in.

    Raises:
        RecordError: it is not there.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise RecordError(f"a folder to work in must exist, got {not_found(folder, files=Path.is_dir)}")
        self.folder = folder.resolve()
        self._changed = Condition()
        self._flies = Lock()  # JSBSim loads one model at a time: two threads at once end the process
        home, name = kept_in("app"), hashlib.sha256(os.fsencode(self.folder)).hexdigest()[:16]
        self._kept_in = None if home is None else home / f"{name}.json"
        token, self.jobs = self._kept_before()
        self.home = f"/{token}/"
        self._keep()
        self._page = app_page(self.folder.name, list(ASKED.values())).encode()
        self._results = results = self.folder / RESULTS
        self._files = files_of(results)

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
        if what == "jobs" and rest.isdecimal() and int(rest) < len(self.jobs):
            return Answer(self._events(int(rest)), _EVENTS)
        if what == "exercises" and rest:
            page = page_of(self.folder, rest)
            return None if page is None else Answer(read_text(page, "answers").encode())
        lists = {
            "jobs": lambda: [job.told(k) for k, job in enumerate(self.jobs)],
            "records": lambda: list_records(self.folder),
            "campaigns": lambda: list_campaigns(self.folder, self._results),
            "designs": lambda: list_designs(self.folder),
            "exercises": lambda: list_exercises(self.folder),
            "board": self._board,
        }
        if what in lists and not rest:
            return _as_json(lists[what]())
        return Answer(self._page) if not what else None

    def take(self, path: str, body: Iterator[bytes]) -> Answer | None:
        """Return what POST to a path gives: the name that a log got, the command that was started, what is shown."""
        if not path.startswith(self.home):
            return None
        what, _, rest = path.removeprefix(self.home).partition("/")
        if what == LOGS and is_plain(rest) and not rest.startswith((".", "-")) and rest.isprintable():
            try:
                return _as_json({"log": self._kept(rest, body)})
            except WriteError as error:
                return _as_json({"error": str(error)}, HTTPStatus.INSUFFICIENT_STORAGE)
        if what == "ask" and not rest:
            return self._asked(_content(body))
        if what == "stop" and rest.isdecimal() and int(rest) < len(self.jobs):
            job = self.jobs[int(rest)]
            if job.process is not None and job.status is None:
                job.process.terminate()  # the command keeps what is finished, as after Ctrl-C
            return _as_json(job.told(int(rest)))
        if what in ("show", "save"):
            given = _content(body)
            try:
                with self._flies:
                    return self._shown(rest if what == "show" else f"save {rest}".strip(), given)
            except TestbenchError as error:
                return _as_json({"error": str(error)}, HTTPStatus.BAD_REQUEST)
        return None

    def _shown(self, what: str, given: Any) -> Answer | None:
        """Return what is shown of records, a campaign or a design; or the text of a TOML file that may be saved."""
        figures = {"channels": channels_figure, "spectra": spectra_figure}
        told = {"record": record_told, "settings": settings_told, "motion": motion_told}
        told |= {"design": design_told, "input": input_told}
        if not isinstance(given, dict):
            return _as_json({"error": "what is to be shown must be a JSON object"}, HTTPStatus.BAD_REQUEST)
        if what in figures:
            return Answer(figures[what](self.folder, given).encode(), _JSON)
        if what == "campaign":
            return _as_json(campaign_told(self.folder, self._results, given))
        if what == "save design":
            name, text = design_text(self.folder, given)
            write_file(self.folder / name, text)
            return _as_json({"file": name})
        if what == "save answers":
            return _as_json(answer_exercise(self.folder, given))
        if what == "plan":
            return _as_json({"words": plan_words(self.folder, given)})
        if what == "amended":
            return _as_json({"words": amended_words(self.folder, given)})
        if what in ("text", "save"):
            file = inside(self.folder, given.get("file"), ".toml")
            if what == "save":
                write_file(file, str(given.get("text", "")))
            return _as_json({"text": read_text(file, "scenario")})
        return _as_json(told[what](self.folder, given)) if what in told else None

    def _kept_before(self) -> tuple[str, list[Job]]:
        """Return the token and the commands of the server before, or new ones; what ran then was interrupted."""
        with contextlib.suppress(RecordError, KeyError, TypeError, ValueError):
            kept = {} if self._kept_in is None else read_json(self._kept_in, "journal")
            if _TOKEN.fullmatch(kept["token"]):
                return kept["token"], [_again(**job) for job in kept["jobs"]]
        return secrets.token_urlsafe(16), []

    def _keep(self) -> None:
        """Write the token and the commands for the next server, for the user's eyes alone."""
        jobs = [asdict(replace(job, process=None, lines=job.lines[-_MOST_LINES:])) for job in self.jobs[-_MOST_KEPT:]]
        text = json.dumps({"token": self.home.strip("/"), "jobs": jobs})

        def fill(part: Path) -> None:
            """Write it to a file that nobody else may read."""
            part.chmod(0o600)
            part.write_text(text, encoding="utf-8")

        if self._kept_in is not None:
            with contextlib.suppress(WriteError, OSError), self._changed:  # what cannot be kept is lost with the server
                write_file(self._kept_in, fill)
                every = sorted(self._kept_in.parent.glob("*.json"), key=lambda file: file.stat().st_mtime)
                for old in every[:-_MOST_KEPT]:
                    old.unlink()

    def _listed(self) -> list[Any]:
        with contextlib.suppress(RecordError):  # there are none yet
            return list_results(self._results)
        return []

    def _board(self) -> dict[str, Any]:
        """Return every result by its question, the newest first, and where the campaign of the folder stands."""
        words, stands = [sys.executable, "-m", "testbench"], b""
        if (self.folder / FILE).is_file():
            stands = subprocess.run(
                words, check=False, cwd=self.folder, capture_output=True, env=_surroundings()
            ).stdout
        results = [
            {
                "folder": f"{RESULTS}/{r.folder.resolve().relative_to(self._results).as_posix()}",
                "page": r.page, "kind": r.kind, "title": r.title, "answer": r.answer,
                "written": f"{r.written:%Y-%m-%d %H:%M}",
            }
            for r in self._listed()
        ]  # fmt: skip
        return {"stands": stands.decode("utf-8", "replace").strip(), "results": results, "files": self._files_to_ask()}

    def _files_to_ask(self) -> list[list[str]]:
        """Return the words of a command for each file of a question that lies in the folder."""
        found = []
        for file in sorted(self.folder.glob("*.toml")):
            with contextlib.suppress(TestbenchError):
                command = kinds_of(file)[0].command
                if file.name != FILE and command in ASKED:
                    out = ["--out", f"{RESULTS}/{file.stem}"] if command == "dataset" else []
                    found.append([command, *(["run"] if command == "campaign" else []), file.name, *out])
        return found

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
                if entry_of(path) == entry_of(new):  # a pipe or a device has none
                    break
        except OSError as error:
            raise not_written(folder / name, error) from error
        finally:
            new.unlink()
        return f"{LOGS}/{path.name}"

    def _asked(self, words: Any) -> Answer:
        """Start a command."""
        if not (isinstance(words, list) and words and all(isinstance(w, str) and w and "\0" not in w for w in words)):
            return _as_json({"error": "a command must be a JSON list of words"}, HTTPStatus.BAD_REQUEST)
        if words[0] not in (*ASKED, "check"):
            law = f"a command must be one of check, {', '.join(sorted(ASKED))}, got '{words[0][:80]}'"
            return _as_json({"error": law}, HTTPStatus.BAD_REQUEST)
        self.jobs.append(Job(tuple(words)))
        number = len(self.jobs) - 1
        self._keep()
        Thread(target=self._run, args=(self.jobs[number],), daemon=True).start()
        return _as_json(self.jobs[number].told(number))

    def _run(self, job: Job) -> None:
        """Run a command and keep what it prints, line by line."""
        status = 3
        try:
            job.process = subprocess.Popen(
                [sys.executable, "-m", "testbench", *job.words], cwd=self.folder, text=True, encoding="utf-8",
                errors="replace", stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                env=_surroundings(),
            )  # fmt: skip
            assert job.process.stdout is not None
            for line in job.process.stdout:
                with self._changed:
                    job.lines.append((round(time.time() - job.begun, 1), line.strip()))
                    self._changed.notify_all()
            status = job.process.wait()
        except (OSError, ValueError) as error:  # more words than the system takes, none of a word's signs, no memory
            job.lines.append((0.0, f"error: the command cannot be started: {error}"))
        with self._changed:
            job.status, job.ended = status, time.time()
            self._changed.notify_all()
        self._keep()

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


def _again(words: Any, lines: Any, begun: float, ended: float | None, status: int | None, process: None) -> Job:
    """Return a command of an earlier server; one that ran when it ended was interrupted with it."""
    said = [(float(second), str(line)) for second, line in lines]
    if status is None:
        said.append((said[-1][0] if said else 0.0, "interrupted, for the server ended: what was finished is kept"))
        ended, status = begun + said[-1][0], 1
    return Job(tuple(map(str, words)), said, begun, ended, status)


def _surroundings() -> dict[str, str]:
    return os.environ | {"COLUMNS": _WIDE, "PYTHONUTF8": "1"}


def _content(body: Iterator[bytes]) -> Any:
    """Return what a body holds as JSON; None for what is none, or too long."""
    content = b""
    for part in body:
        content += part
        if len(content) > _MOST_WORDS:
            return None
    try:
        return json.loads(content)
    except (ValueError, RecursionError):
        return None


def _as_json(content: Any, status: HTTPStatus = HTTPStatus.OK) -> Answer:
    return Answer(json.dumps(content).encode(), _JSON, status)
