"""The careful estimate of a run, beside the flight: maximum likelihood, in a process of its own.

Least squares in flight takes the readings of a vane for the flow angle, whose noise draws what is weak towards zero.
Filter error (:mod:`testbench.estimators.parametric.filter_error`) fits the same equations to the same samples with
noise of every reading, gusts in every equation of a force or a moment, and an offset of every reading in each run. What
turns the states beside linear equations, the frame and the airspeed, is flown at the estimate so far and taken out of
the readings:

    y - x_k,    dx_k/dt = A x_k + k(t) + (what the airspeed changes of A x + B u).

Up to four runs at one point of the plan are fitted together.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import connection
from types import TracebackType
from typing import Any, Self, cast

import numpy as np
from scipy.signal import cont2discrete

from testbench.core.blas import on_one_thread
from testbench.core.errors import Refusal
from testbench.core.processes import Child, answer_to
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.filter_error import estimate
from testbench.estimators.settings import FilterError
from testbench.questions.live.belief import ATTITUDES, Expected, by_airspeed, structure_of

TOGETHER = 4
"""Runs that are fitted together: what they say adds up, and the time that a fit takes stays what it is."""
_ROUNDS = 2  # of what turns the states beside linear equations, each at the estimate before
_NICE = 10
_NOTHING = 1e6  # standard errors over the value of a derivative whose control has not moved
_FEW = 5  # samples in which a control that is at rest may seem to move


@dataclass(frozen=True, eq=False)
class Run:
    """A run that was flown."""

    number: int  # of the records of its plane
    begun_s: float  # first sample, on the clock of the source
    V_m_s: float  # airspeed before it
    record: FlightRecord  # states and inputs, deviations from trim
    known: FloatArray  # (b, n) what turns the states beside the linear equations
    ratio: FloatArray  # (b,) airspeed over that of the trim that derivatives are given at
    doubted: bool  # whether it was not answered as believed

    @property
    def moved(self) -> tuple[str, ...]:
        """Inputs that moved: beyond what noise alone gives a few samples of."""
        inputs = [n for n in self.record.channels if np.count_nonzero(self.record[n]) > _FEW]
        return tuple(inputs)


@dataclass(frozen=True)
class Careful:
    """What runs say, by the careful estimate."""

    plane: str  # of motion
    numbers: tuple[int, ...]  # of the runs that were fitted together
    begun_s: float  # of the last of them
    names: tuple[str, ...] = ()  # of derivatives, at the trim that those in flight are given at; none if there are none
    values: tuple[float, ...] = ()  # of them, SI
    covariance: tuple[tuple[float, ...], ...] = ()  # of them
    why: str = ""  # there are none, in words

    @classmethod
    def read(cls, told: dict[str, Any]) -> Self:
        """Return one from what ``dataclasses.asdict`` made of it, by way of JSON."""
        rows = tuple(tuple(float(x) for x in row) for row in told.pop("covariance"))
        lists: dict[str, Any] = {name: tuple(told.pop(name)) for name in ("numbers", "names", "values")}
        return cls(covariance=rows, **lists, **told)


@on_one_thread
def identified(expected: Expected, runs: Sequence[Run], said: Careful) -> Careful:
    """Return what runs of a plane say together.

    Args:
        expected: where the search begins.
        runs: at about one speed.
        said: takes what is found.
    """
    full, params = expected.structure, expected.params
    moved = {name for run in runs for name in run.moved}
    structure = structure_of(said.plane, cast(Any, full).trim, [n for n in full.inputs if n in moved])
    own = structure.parameter_names
    structure = structure.with_parameters(fixed=[n for n in own if n.endswith("_0")])
    at = [full.parameter_names.index(n) for n in own]
    mean = float(np.mean(np.concatenate([run.ratio for run in runs])))
    power = by_airspeed(full.parameter_names) - [n[0] in "YZ" for n in full.parameter_names]  # flow: force over speed
    settings = FilterError(
        process_noise=tuple(n for n in full.states if n not in ATTITUDES), process_noise_model="diagonal",
        against_none=False, output_biases=full.states,
    )  # fmt: skip
    here = np.zeros(params.size)
    here[at] = (params * mean**power)[at]
    try:
        for _ in range(_ROUNDS):
            left = [without_known(replace(expected, params=here), run, run.ratio / mean) for run in runs]
            model = estimate(left, structure.with_parameters(dict(zip(own, here[at].tolist(), strict=True))), settings)
            here[at] = model.params
    except Refusal as error:
        return replace(said, why=error.message)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        return replace(said, why=str(error))
    bound = model.diagnostics["at_bound"]
    if not model.diagnostics["converged"] or bound:
        return replace(said, why=f"the search ended {'at a bound of ' + ', '.join(bound) if bound else 'too early'}")
    P = np.diag((_NOTHING * np.maximum(np.abs(params), 1.0)) ** 2)
    P[np.ix_(at, at)] = model.covariance / np.outer(mean**power, mean**power)[np.ix_(at, at)]
    told = [k for k, p in enumerate(full.parameters) if p.free and not p.name.endswith("_0")]
    rows = tuple(tuple(row) for row in P[np.ix_(told, told)].tolist())
    names = tuple(full.parameter_names[k] for k in told)
    return replace(said, names=names, values=tuple((here / mean**power)[told].tolist()), covariance=rows)


def without_known(expected: Expected, run: Run, ratio: FloatArray) -> FlightRecord:
    """Return the record of a run, with what turns the states beside the linear equations taken out of the readings."""
    n = len(expected.structure.states)
    states, inputs = run.record.data[:, :n], run.record.data[:, n:]
    A = expected.structure.matrices(expected.params).A
    none = np.zeros((0, n))
    Ad, Bd = cont2discrete((A, np.eye(n), none, none), run.record.dt_s)[:2]
    turned = run.known - run.known[0] + expected.by_speed(states, inputs, ratio)
    push = 0.5 * (turned[1:] + turned[:-1]) @ Bd.T
    x, out = np.zeros(n), np.zeros_like(states)
    for k, more in enumerate(push):
        x = Ad @ x + more
        out[k + 1] = x
    return replace(run.record, data=np.hstack([states - out, inputs]))


class Beside:
    """One careful estimate at a time, in a process of low priority that goes with the block."""

    def __init__(self) -> None:
        self._child: Child | None = None
        self._waiting: dict[Any, Callable[[], Careful]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._child is not None:
            self._child.kill()

    def begin(self, key: Any, task: Callable[[], Careful]) -> None:
        """Do a task next, in place of one of the same key that still waits."""
        self._waiting[key] = task

    def take(self, wait: bool) -> Careful | None:
        """Return what is done; None if nothing is yet. ``wait`` for it if there is something to do."""
        while True:
            if self._child is None:
                if not self._waiting:
                    return None
                self._child = Child.start(partial(_aside, self._waiting.pop(next(iter(self._waiting)))))
            if not wait and not self._child.pipe.poll():
                return None
            child, self._child = self._child, None
            try:
                done, found = child.pipe.recv()
            except (EOFError, OSError):  # ended from outside, for want of memory: what was found in flight stays
                done, found = False, None
            except BaseException:
                child.kill()
                raise
            child.end()
            if done:
                out: Careful = found
                return out


def _aside(task: Callable[[], Careful], pipe: connection.Connection) -> None:
    if hasattr(os, "nice"):
        os.nice(_NICE)
    pipe.send(answer_to(task))
