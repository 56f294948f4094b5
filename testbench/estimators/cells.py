"""One suite and one estimator: whether they can work together, and how one that fails is kept from the others.

A user's estimator in a process of its own, which can be ended whatever it does.

A worker process flies in a thread, and no thread can be ended while it sleeps, waits for another program or computes
in compiled code. Such work would end the worker, and with it all that the other estimators of the run have found.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from testbench.core.bring import is_brought, running, short
from testbench.core.errors import EstimationError, Refusal, WriteError
from testbench.core.interrupts import TimeUp, time_limit
from testbench.core.record import FlightRecord
from testbench.estimators import METHODS
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.settings import Settings
from testbench.estimators.structured import Structured

# --- a user's estimator in a process of its own, which can be ended whatever it does ----------------------------------


_GRACE_S = 2.0  # beyond its limit, before a process that does not notice it ends
_HERE = "here"


class Aside:
    """A process that runs estimators one after the other, and is started again after one that ended it.

    ``processor_s`` is what those took that came back, s.
    """

    def __init__(self) -> None:
        self._one = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self.processor_s = 0.0

    def ready(self) -> None:
        """Start the process if there is none, and wait until it can work: that is not the time of an estimator."""
        with self._one:
            if self._process is None or self._process.poll() is not None:
                path = f"import sys; sys.path[:] = {sys.path!r}; from testbench.estimators.cells import serve; serve()"
                self._process = subprocess.Popen(
                    [sys.executable, "-c", path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
                )
                with contextlib.suppress(EOFError):
                    pickle.load(_stream(self._process.stdout))

    def estimate(
        self,
        entry: Settings,
        records: Sequence[FlightRecord],
        inputs: Sequence[str],
        outputs: Sequence[str],
        validation: Sequence[FlightRecord],
        limit_s: float,
    ) -> IdentifiedModel:
        """Return what :func:`testbench.estimators.estimate` returns for the same, from the process.

        Args:
            entry: of a scenario.
            records: measured records to identify from.
            inputs: (m,) input channels.
            outputs: (p,) output channels.
            validation: measured records by which a method may choose its structure.
            limit_s: of the clock, s.

        Raises:
            EstimationError: the time is up, the process died, or whatever went wrong in it, in its words.
            WriteError: a file could not be written in it.
        """
        from testbench.estimators import estimate

        name, began = short(entry.method), time.monotonic()
        with self._one:
            process, answered = self._process, False
            assert process is not None, "ready() comes first"
            try:
                pickle.dump((entry, records, inputs, outputs, validation, limit_s), _stream(process.stdin))
                _stream(process.stdin).flush()
                kind, found, spent_s = pickle.load(_stream(process.stdout))
                self.processor_s += spent_s
                answered = True
            except (EOFError, OSError, pickle.UnpicklingError):
                kind, found = "died", None
            finally:
                if not answered:  # also where the limit of the thread was noticed first
                    process.kill()
                    process.wait()
                    self._process = None
        if kind == _HERE:  # its model holds what only this process could know
            return estimate(entry, records, inputs, outputs, validation)
        if kind == "died" and time.monotonic() - began >= limit_s:
            raise time_is_up(entry.method, limit_s)
        if kind == "died":
            raise EstimationError(
                f"{name} must return a model, but its process ended with status {process.returncode}: compiled code "
                "that crashes, or too little memory"
            )
        if kind == "error":
            raise EstimationError(found)
        if kind == "unwritten":
            raise found
        model: IdentifiedModel = found
        return model


def time_is_up(method: str, limit_s: float) -> EstimationError:
    """Return the error of an estimator that took too long."""
    return EstimationError(
        f"{short(method)} must end within limit_s = {limit_s:g} s, got no model by then; raise identification.limit_s, "
        "or reduce its work"
    )


_ASIDE = Aside()


def processor_s() -> float:
    """Return the processor's time of this thread and of what worked aside for it, s; differences count."""
    return time.thread_time() + _ASIDE.processor_s


def aside_for(entry: Settings) -> Aside | None:
    """Return the process for an estimator or structure of the user's own, outside the main thread; else None.

    The main thread ends by a signal, also while it sleeps; see :func:`testbench.core.interrupts.time_limit`.
    """
    own = is_brought(entry.method) or is_brought(getattr(entry, "structure", ""))
    in_thread = threading.current_thread() is not threading.main_thread()
    if not own or not in_thread:
        return None
    _ASIDE.ready()
    return _ASIDE


def serve() -> None:
    """Answer requests until there are none: what an estimator prints goes where errors go."""
    from testbench.estimators import METHODS, estimate

    for row in METHODS.values():  # to read packaged methods, which a user's may call, is not the time of any
        row.load()
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    _send(answers, ("ready", None))
    with open(os.devnull, "w") as nowhere:
        while True:
            try:
                entry, records, inputs, outputs, validation, limit_s = pickle.load(questions)
            except EOFError:
                return
            began = time.process_time()
            faulthandler.dump_traceback_later(limit_s + _GRACE_S, exit=True, file=nowhere)
            answer: tuple[str, Any]
            try:
                with contained(entry.method, limit_s):
                    answer = "model", estimate(entry, records, inputs, outputs, validation)
            except Refusal as error:
                answer = "error", error.message
            except WriteError as error:  # no estimator is at fault
                answer = "unwritten", error
            faulthandler.cancel_dump_traceback_later()
            try:
                _send(answers, (*answer, time.process_time() - began))
            except BrokenPipeError:  # whoever asked is gone
                return


def _send(stream: IO[bytes], answer: tuple[Any, ...]) -> None:
    try:
        data = pickle.dumps(answer)
    except Exception:  # pickle raises whatever the object does
        data = pickle.dumps((_HERE, None, answer[-1]))
    stream.write(data)
    stream.flush()


def _stream(stream: IO[bytes] | None) -> IO[bytes]:
    assert stream is not None
    return stream


# --- one suite and one estimator --------------------------------------------------------------------------------------


_SAMPLES = 8
_MATRICES = ("A", "B", "C", "D", "params")


@dataclass(frozen=True)
class FailedCell:
    """An estimator that gave no model of what a suite measured, and why; ``label`` is that of a case."""

    suite: str
    estimator: str
    reason: str

    @property
    def label(self) -> str:
        """Suite and estimator, in words."""
        return f"{self.suite}, {self.estimator}"


def impossible(entry: Settings, channels: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]) -> str | None:
    """Return why an estimator cannot work on the channels of a suite, from what its method and structure need.

    Users' Python files are not run, and so nothing is known of what they need.

    Args:
        entry: of a scenario.
        channels: that the suite measures.
        inputs: (m,) of the identification.
        outputs: (p,) of the identification that the suite measures.

    Returns:
        One sentence, or None if nothing speaks against it.
    """
    missing = [name for name in inputs if name not in channels]
    if missing:
        return f"the suite does not sense the {'input' if len(missing) == 1 else 'inputs'} {', '.join(missing)}"
    if not outputs:
        return "the suite senses none of the outputs"
    needs = METHODS[entry.method].needs if entry.method in METHODS else ()
    if "one input" in needs and len(inputs) != 1:
        return f"{entry.method} needs a single input, got {', '.join(inputs)}"
    if not isinstance(entry, Structured) or is_brought(entry.structure):
        return None
    return _misfit(entry, channels, inputs, outputs, "all states" in needs)


def _misfit(
    entry: Structured, channels: Sequence[str], inputs: Sequence[str], outputs: Sequence[str], states: bool
) -> str | None:
    """Return why the structure of an entry does not fit the channels, found by making it for a record of ones."""
    from testbench.estimators.parametric.structures.build import build

    data = np.ones((_SAMPLES, len(channels)))
    removed = dict.fromkeys(channels, 1.0)
    record = FlightRecord(
        np.arange(float(_SAMPLES)), tuple(channels), data, "measured", provenance={"prepared": {"removed": removed}}
    )
    try:
        made = build(entry, inputs, outputs, [record] if entry.equations is None else [])
    except EstimationError as error:
        return error.message
    own = made.states[: len(made.states) - len(made.followers)]
    missing = [name for name in own if name not in channels] if states else []
    if missing:
        return (
            f"{getattr(entry, 'method', '')} needs every state of the structure '{short(entry.structure)}', and the "
            f"suite does not sense {', '.join(missing)}"
        )
    return None


@contextmanager
def contained(method: str, limit_s: float) -> Iterator[None]:
    """Turn whatever goes wrong inside the block, or takes longer than its limit, into one error with its reason.

    Args:
        method: whose work the block is.
        limit_s: s; see :func:`testbench.core.interrupts.time_limit`.

    Raises:
        EstimationError: the time is up, or an error that is not one of the testbench, with file and line.
        TestbenchError: as it was raised.
    """
    try:
        with running(None, f"{short(method)} must return a model"), time_limit(limit_s):
            yield
    except TimeUp:
        raise time_is_up(method, limit_s) from None


def need_numbers(model: IdentifiedModel) -> IdentifiedModel:
    """Return a model that holds numbers.

    Raises:
        EstimationError: its matrices, parameters or poles hold NaN.
    """
    for name in _MATRICES:
        values = getattr(model, name, None)
        if isinstance(values, np.ndarray) and values.dtype.kind in "fc" and np.isnan(values).any():
            raise EstimationError(f"{model.method} must return numbers, got NaN in {name}")
    for outputs, poles in model.poles().items():
        if np.isnan(poles).any():
            raise EstimationError(f"{model.method} must return numbers, got NaN in the poles of {outputs}")
    return model
