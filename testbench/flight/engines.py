"""Propellers and piston engines as states of a linear model.

Their speed and manifold pressure cannot be set, only moved: a frame in which nothing else moves takes them somewhere
near, see :mod:`testbench.flight.propellers`. Two such places, reached by another throttle and by another airspeed,
span the plane of both states; what changes from trim to there, over how far it is, gives the derivatives by them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.errors import ModelError
from testbench.core.record import FloatArray
from testbench.flight.executive import ACCELERATIONS
from testbench.flight.linear_model import ENGINE, LinearModel

if TYPE_CHECKING:
    from testbench.flight.condition import TrimmedFlight
    from testbench.flight.executive import Executive

_MANIFOLD = "propulsion/engine/map-pa"
_THROTTLE, _AIRSPEED = 0.02, 0.01  # kicks: of full throttle, and of the speed
_FRAME_S = 0.02
_STEP = {"u": 0.05, "v": 0.05, "w": 0.05, "p": 1e-2, "q": 1e-2, "r": 1e-2, "thr": 1e-3}


def with_engine(model: LinearModel, fdm: Executive, trimmed: TrimmedFlight, at: Mapping[str, float]) -> LinearModel:
    """Return a linear model with the states of the propellers, all engines alike, after its own.

    Args:
        model: with the propellers held.
        fdm: where it was made.
        trimmed: about which it was made.
        at: states and inputs there.

    Raises:
        ModelError: the engine is at rest and nothing moves it.
    """
    bench = _Engine(fdm, trimmed, at)
    names = ENGINE if fdm.has(_MANIFOLD) else ENGINE[:1]
    k = len(names)
    by_engine, rows, C = bench.by_itself(k, model.outputs)
    n = len(model.states)
    A = np.zeros((n + k, n + k))
    A[:n, :n], A[n:, n:] = model.A, by_engine
    A[[model.states.index(s) for s in ("u", "v", "w", "p", "q", "r")], n:] = rows
    B = np.vstack([model.B, np.zeros((k, model.B.shape[1]))])
    for name in ("u", "v", "w", "p", "q", "r"):
        A[n:, model.states.index(name)] = bench.by(name, k)
    if "thr" in model.inputs:
        B[n:, model.inputs.index("thr")] = bench.by("thr", k)
    return LinearModel(A, B, np.hstack([model.C, C]), model.D, (*model.states, *names), model.inputs, model.outputs)


class _Engine:
    """The engines of an executive at trim, moved and brought back."""

    def __init__(self, fdm: Executive, trimmed: TrimmedFlight, at: Mapping[str, float]) -> None:
        self._fdm, self._trimmed, self._at = fdm, trimmed, dict(at)
        self._manifold = fdm.node(_MANIFOLD) if fdm.has(_MANIFOLD) else None

    def _place(self, change: Mapping[str, float] | None = None) -> None:
        at = {**self._at, **{n: self._at[n] + d for n, d in (change or {}).items()}}
        fdm = self._fdm
        fdm.command({n: at[n] for n in fdm.command_nodes})
        fdm.place(at["h"], at["theta"], at["phi"], (at["u"], at["v"], at["w"]), (at["p"], at["q"], at["r"]))
        fdm.evaluate(held=True)

    def _state(self, k: int) -> FloatArray:
        speed = float(self._fdm.propellers.speeds().mean())
        pressure = self._manifold.get_double_value() if self._manifold is not None else 0.0
        return np.array([speed, pressure][:k])

    def _rate(self, k: int) -> FloatArray:
        """Return the rates of change of the states (k,), from a frame so short that they hardly move."""
        before = self._state(k)
        self._fdm.propellers.glance()
        return (self._state(k) - before) / self._fdm.propellers.GLANCE_S

    def _home(self) -> None:
        """Bring the engines back to their equilibrium at trim."""
        self._place()
        self._fdm.propellers.settle()

    def by(self, name: str, k: int) -> FloatArray:
        """Return the derivative (k,) of the engines' rates by a state or input of the aircraft."""
        step, rates = _STEP[name], []
        for sign in (1.0, -1.0):
            self._home()
            self._place({name: sign * step})
            rates.append(self._rate(k))
        self._home()
        return np.asarray((rates[0] - rates[1]) / (2.0 * step))

    def by_itself(self, k: int, outputs: tuple[str, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the derivatives by the states of the engines: of their rates (k, k), of the six accelerations
        (6, k), and of the outputs (p, k)."""
        kicks = ({"u": _AIRSPEED * self._at["u"]}, {"thr": _THROTTLE if self._at["thr"] < 0.5 else -_THROTTLE})[:k]
        columns: list[list[FloatArray]] = [[], [], [], []]
        for kick in kicks:
            pair = []
            for sign in (1.0, -1.0):
                self._home()
                self._place({n: sign * d for n, d in kick.items()})
                self._fdm.propellers.glance(_FRAME_S)
                self._place()
                channels = self._fdm.read() | {"psi": 0.0}
                forces = np.array([self._fdm.get(n) * f for n, f in ACCELERATIONS])
                state = self._state(k)
                pair.append((state, self._rate(k), forces, np.array([channels.get(o, 0.0) for o in outputs])))
            up, down = pair
            for kept, higher, lower in zip(columns, up, down, strict=True):
                kept.append(higher - lower)
        self._home()
        Z, rates, accelerations, read = (np.column_stack(c) for c in columns)
        scale = np.abs(Z).max(axis=1)
        if not np.all(scale > 0.0) or np.linalg.cond(Z / scale[:, None]) > 1e8:
            raise ModelError(
                f"the engine of {self._fdm.aircraft.name} must answer to throttle and airspeed, but its speed stays; "
                "it is not running"
            )
        inverse = np.linalg.inv(Z)
        return rates @ inverse, accelerations @ inverse, read @ inverse
