"""The linear model of an aircraft with its own control law, which feels the motion between stick and surface.

The law is somebody's components. It is found as a black box: what it feels, and the stick, are stepped one by one while
the aircraft does not move, and its step responses are realised by the eigensystem realisation algorithm (Juang and
Pappa, J. Guidance 8(5), 1985): the Hankel matrix of the pulse responses, H0 = U S V', gives

    Ad = S^-1/2 U' H1 V S^-1/2,    Bd = S^1/2 V',    Cd = U S^1/2,

and continuous states by the logarithm of Ad and Bd. What the law demands reaches the surface through its servo; without
one through the hold of a frame, which is half a frame late: a lag of 2 / dt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, logm

from testbench.aircraft.adapter import BIAS
from testbench.core.record import FloatArray
from testbench.flight.condition import TrimmedFlight
from testbench.flight.executive import Executive
from testbench.flight.linear_model import LAW, PLANE_CONTROLS, PLANE_STATES, SERVO, LinearModel
from testbench.flight.trim import place_at_trim

_STEP = {"u": 1e-3, "v": 1e-3, "w": 1e-3, "h": 1.0}
"""Size of a step: of the airspeed for velocities, m; 1e-3 rad and rad/s otherwise."""
_FRAMES, _EVERY, _STILL = 600, 2, 40  # of a response; frames of a sample; after which it has come to rest
_NOTHING = 1e-9  # of a response, per unit of a step
_SMALL = 1e-5  # of a response: what comes later is rounding
_RANK, _MOST_STATES = 1e-4, 8  # of the largest singular value; of a realisation
HOLD = 2.0
"""Corner frequency of the hold of a frame, per frame."""
_GONE = 0.02  # size of an eigenvalue of Ad that has decayed within a sample


@dataclass(frozen=True, eq=False)
class Law:
    """A law linear about a trim: dz/dt = A z + B v, demand = C z + D v, v what the aircraft feels and sticks."""

    surfaces: tuple[str, ...]  # controls whose surface it moves, s of them
    states: tuple[str, ...]  # names of z, k of them
    felt: tuple[str, ...]  # states of the aircraft, then commands: names of v, m of them
    # A, B, C, D: (k, k), (k, m), (s, k), (s, m), rad
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray

    @classmethod
    def of(cls, fdm: Executive, trimmed: TrimmedFlight) -> Law:
        """Find the law of an aircraft that flies with it, in a fresh executive."""
        surfaces = fdm.aircraft.under_law
        bench = _Bench(fdm, trimmed)
        parts = []
        for motion, felt in PLANE_STATES.items():
            names = (*felt, *(c for c in PLANE_CONTROLS[motion] if c in surfaces))
            parts.append((motion, names, *_realised([bench.response(n) for n in names], trimmed.rate_hz)))
        states = tuple(f"{LAW}{motion}_{i + 1}" for motion, _, A, *_ in parts for i in range(len(A)))
        felt = tuple(n if n not in surfaces else f"{n}_cmd" for _, names, *_ in parts for n in names)
        A, B = (block_diag(*(part[k] for part in parts)) for k in (2, 3))
        C, D = (np.hstack([part[k] for part in parts]) for k in (4, 5))
        return cls(surfaces, states, felt, A, B, C, D)


def with_law(model: LinearModel, law: Law) -> LinearModel:
    """Return the linear model with the states of the law, which moves the servos.

    The inputs de, da and dr are deflections added behind it, and de_cmd, da_cmd and dr_cmd the stick, in rad of the
    surface.

    Args:
        model: of the aircraft, its servos included, without its law.
        law: about the same trim.
    """
    n, k = len(model.states), len(law.states)
    A, B = _joined(model.A, model.states, law), np.vstack([model.B, np.zeros((k, len(model.inputs)))])
    moved = [i for i, x in enumerate(law.felt) if x not in model.states]
    inputs = [model.inputs.index(law.felt[i]) for i in moved]
    B[n:, inputs] = law.B[:, moved]
    for control, d in zip(law.surfaces, law.D, strict=True):
        row = model.states.index(f"{SERVO}{control}")
        B[row] = 0.0
        B[row, inputs] = -A[row, row] * d[moved]
    C = np.hstack([model.C, np.zeros((len(model.C), k))])
    return replace(model, A=A, B=B, C=C, states=(*model.states, *law.states))


def _joined(A: FloatArray, own: Sequence[str], law: Law) -> FloatArray:
    """Return A (..., n, n) of ``own`` states with those of the law behind them; what it demands moves the servos."""
    n, k = len(own), len(own) + len(law.states)
    wide = np.zeros((*A.shape[:-2], k, k))
    wide[..., :n, :n], wide[..., n:, n:] = A, law.A
    at = [i for i, x in enumerate(law.felt) if x in own]
    felt = [own.index(law.felt[i]) for i in at]
    wide[..., n:, felt] = law.B[:, at]
    for control, c, d in zip(law.surfaces, law.C, law.D, strict=True):
        if f"{SERVO}{control}" in own:
            row = own.index(f"{SERVO}{control}")
            lag = -A[..., row, row, None]
            wide[..., row, felt], wide[..., row, n:] = lag * d[at], lag * c
    return wide


def law_along(A: FloatArray, C: FloatArray, states: Sequence[str], law: Law) -> tuple[FloatArray, FloatArray]:
    """Return linear models along a flight, A (n, k, k) and C (n, p, k), with the law as it is about the trim.

    Args:
        A: without it, in the order of ``states`` without those of the law.
        C: the same.
        states: those wanted; where any of the law is wanted, all are.
        law: of the aircraft.
    """
    own = [s for s in states if not s.startswith(LAW)]
    place = [[*own, *law.states].index(s) for s in states]
    shown = np.concatenate([C, np.zeros((*C.shape[:2], len(law.states)))], axis=2)
    return _joined(A, own, law)[:, place][:, :, place], shown[:, :, place]


class _Bench:
    """An aircraft held at its trim while its law runs."""

    def __init__(self, fdm: Executive, trimmed: TrimmedFlight) -> None:
        self._fdm, self._trimmed = fdm, trimmed
        adapter = fdm.aircraft.adapter
        laws = [x.law for x in (adapter.links if adapter else ()) if x.law is not None and x.by_stick]
        self._own = [(fdm.node(law.own), law.factor) for law in laws]
        self._biases = [fdm.node(n) for n in sorted(fdm.read_by_functions) if n.endswith(BIAS)]
        self._rest: FloatArray | None = None

    def response(self, name: str) -> FloatArray:
        """Return what the law demands (frames, surfaces), rad per unit, after a step of a state, or of a stick."""
        if self._rest is None:
            self._rest = self._run("")
        found = self._run(name)
        last = min(len(found), len(self._rest)) - 1
        n = max(len(found), len(self._rest))
        moved = [x[np.minimum(np.arange(n), len(x) - 1)] for x in (found, self._rest)]
        out = (moved[0] - moved[1]) / self._size(name)
        return np.where(np.abs(out) < _NOTHING, 0.0, out)[: max(last, _STILL)]

    def _size(self, name: str) -> float:
        return _STEP.get(name, 1e-3) * (self._trimmed.condition.V_m_s if name in ("u", "v", "w") else 1.0)

    def _run(self, name: str) -> FloatArray:
        fdm, at = self._fdm, dict(self._trimmed.state)
        place_at_trim(fdm, self._trimmed)
        held = [node.get_double_value() for node in self._biases]
        if name in at and name not in self._trimmed.controls:
            at[name] += self._size(name)
            fdm.place_state(at)
            fdm.fdm.run_ic()
            for node, value in zip(self._biases, held, strict=True):
                node.set_double_value(value)
        elif name:
            fdm.command({name: self._trimmed.controls[name] + self._size(name)})
        rows = []
        with fdm.still():
            for frame in range(_FRAMES):
                fdm.fdm.run()
                rows.append([factor * node.get_double_value() for node, factor in self._own])
                if frame > 2 * _STILL and rows[-1] == rows[-_STILL]:
                    break
        return np.array(rows)


def _realised(found: Sequence[FloatArray], rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A, B, C, D of the system that has the step responses (frames, surfaces) of each input."""
    n = max(len(x) for x in found)
    steps = np.stack([x[np.minimum(np.arange(n), len(x) - 1)] for x in found], axis=2)[1::_EVERY]
    D, pulses = steps[0], np.diff(steps, axis=0)  # (surfaces, inputs), (samples - 1, surfaces, inputs)
    p, m = D.shape
    used = np.flatnonzero(np.abs(pulses).max(axis=(0, 1)) > _SMALL * np.abs(steps).max(axis=(0, 1)))
    if not used.size:
        return np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), D
    rows = len(pulses) // 2
    size = np.abs(pulses[:, :, used]).max(axis=(0, 1))
    place = np.add.outer(np.arange(rows), np.arange(rows))
    h = pulses[:, :, used] / size
    hankel, later = (h[place + k].transpose(0, 2, 1, 3).reshape(rows * p, rows * used.size) for k in (0, 1))
    U, s, V = np.linalg.svd(hankel, full_matrices=False)
    k = min(int(np.count_nonzero(s > _RANK * s[0])), _MOST_STATES)
    U, root, V = U[:, :k], np.sqrt(s[:k]), V[:k]
    Ad = (U.T @ later @ V.T) / root[:, None] / root
    Ad, Bd, C, D[:, used] = _lasting(Ad, root[:, None] * V[:, : used.size] * size, U[:p] * root, D[:, used])
    k = len(Ad)
    held = np.block([[Ad, Bd], [np.zeros((used.size, k)), np.eye(used.size)]])
    continuous = np.real(logm(held)) * rate_hz / _EVERY
    B = np.zeros((k, m))
    B[:, used] = continuous[:k, k:]
    return continuous[:k, :k], B, C, D


def _lasting(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return a discrete system without the states that decay within a sample, which take their equilibrium at once."""
    poles, V = np.linalg.eig(A)
    W = np.linalg.inv(V)
    gone = np.abs(poles) < _GONE
    at_once = (C @ V[:, gone] / (1.0 - poles[gone])) @ (W[gone] @ B)
    kept = np.flatnonzero(~gone & (poles.imag >= 0.0))
    columns = [part for k in kept for part in ((V[:, k].real, V[:, k].imag) if poles[k].imag else (V[:, k].real,))]
    if not columns:
        return np.zeros((0, 0)), np.zeros((0, B.shape[1])), np.zeros((len(C), 0)), D + at_once.real
    T = np.column_stack(columns)
    back = np.linalg.pinv(np.column_stack([T, V[:, gone].real, V[:, gone].imag]))[: T.shape[1]]
    return back @ A @ T, back @ B, C @ T, D + at_once.real
