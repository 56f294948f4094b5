"""Schedulers and workers of the tests, as processes of their own."""

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200", "OPENBLAS_NUM_THREADS": "1"}
WAIT_S = 120.0  # for what takes seconds on an idle machine


def wait_until(done, what: str) -> None:
    end = time.monotonic() + WAIT_S
    while not done():
        assert time.monotonic() < end, f"{what} takes too long"
        time.sleep(0.05)


class Cluster:
    """A scheduler and workers as processes of their own, as on other machines."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[str]] = []

    def start(self, *arguments: str, cwd: Path | None = None) -> subprocess.Popen[str]:
        self.processes.append(
            subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments],
                cwd=cwd or self.folder,
                env=ENVIRONMENT,
                text=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        return self.processes[-1]

    def scheduler(self, number: int) -> tuple[subprocess.Popen[str], str]:
        file = self.folder / f"scheduler{number}.json"
        process = self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                             "--scheduler-file", str(file))  # fmt: skip

        def written() -> bool:
            with contextlib.suppress(ValueError, OSError, KeyError):
                return bool(json.loads(file.read_text())["address"])
            return False

        wait_until(written, "the scheduler")
        return process, str(json.loads(file.read_text())["address"])

    def worker(self, address: str, folder: Path | None = None) -> subprocess.Popen[str]:
        return self.start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard", cwd=folder)

    def stop(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
