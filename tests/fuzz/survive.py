"""Run many cases in a process of their own and say which ended in anything but a sentence: it may not outlive one."""

import multiprocessing
import os
import resource
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

from testbench.core.errors import TestbenchError

LONGEST_S = 20
MOST_KB = 1_000_000  # 1 GB of memory


def broken(cases: Mapping[str, Callable[[Path], object]]) -> list[str]:
    """Run every case, each given an empty folder; return a line for each that was broken.

    Broken is a case that raises what is no error of the testbench, takes longer than 20 s of wall clock, makes the
    process take more than 1 GB of memory, or ends it. A warning is none.
    """
    out, left = [], dict(cases)
    while left:
        with tempfile.TemporaryDirectory(prefix="fuzz_") as place:
            told = Path(place, "told")
            told.touch()
            process = multiprocessing.get_context("fork").Process(target=_run, args=(left, told, Path(place)))
            process.start()
            while process.is_alive():
                process.join(1.0)
                if time.time() - told.stat().st_mtime > LONGEST_S + 5.0:  # in a library that lets no signal through
                    process.kill()
                    process.join()
            lines = told.read_text(encoding="utf-8").splitlines()
        begun = [line.removeprefix("begin ") for line in lines if line.startswith("begin ")]
        out += [line.removeprefix("broken ") for line in lines if line.startswith("broken ")]
        if process.exitcode == 0:
            return out
        last = begun[-1]
        out.append(f"{last}: the process ended or hung ({process.exitcode})")
        left = {name: case for name, case in left.items() if name not in begun}
    return out


def _run(cases: Mapping[str, Callable[[Path], object]], told: Path, place: Path) -> None:
    signal.signal(signal.SIGALRM, _too_long)
    warnings.simplefilter("ignore")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with told.open("a", encoding="utf-8", buffering=1) as say:
        for k, (name, case) in enumerate(cases.items()):
            say.write(f"begin {name}\n")
            folder = place / str(k)
            folder.mkdir()
            signal.alarm(LONGEST_S)
            try:
                case(folder)
            except TestbenchError as error:
                if "Traceback" in str(error):
                    say.write(f"broken {name}: a traceback in the message\n")
            except BaseException as error:
                where = traceback.extract_tb(error.__traceback__)[-1]
                own = [f for f in traceback.extract_tb(error.__traceback__) if "/testbench/" in f.filename]
                at = " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in [where, *own[::-1]][:4])
                text = " ".join(str(error).split())[:120]
                say.write(f"broken {name}: {type(error).__name__}: {text} ({at})\n")
            signal.alarm(0)
            now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            if now > max(MOST_KB, before):
                say.write(f"broken {name}: {now / 1e6:.2f} GB of memory\n")
                before = now
    os._exit(0)


class TooLong(BaseException):
    """A case took too long."""


def _too_long(*_: object) -> None:
    raise TooLong(f"longer than {LONGEST_S} s")
