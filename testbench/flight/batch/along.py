"""Forces and moments of a model along motions that are given: nothing is integrated but what is inside the model.

A frame takes attitude, velocity and rates from a record in place of integrating them. Servos, engines, filters and
elastic modes run as in flight, driven by the commands and by the motion. What the model would then accelerate by is
what it says of the forces in that very motion. It holds for unstable aircraft, and for models that are far from right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import FT_M, LBF_N, PSF_PA, SLUG_KG
from testbench.core.errors import LimitError
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged
from testbench.flight.batch.fly import placed
from testbench.flight.batch.machine import Driven, Logged, Watched, aligned
from testbench.flight.batch.model import BatchModel, filled
from testbench.flight.batch.program import Op, Program
from testbench.flight.batch.vector import LANES
from testbench.flight.condition import TrimmedFlight
from testbench.flight.simulate import stride
from testbench.flight.start import Beginning

MOTION = ("h", "phi", "theta", "V", "alpha", "beta", "p", "q", "r", "udot", "vdot", "wdot")
"""What a motion consists of, SI; udot, vdot, wdot are the rates of change of the velocity in body axes."""
_GIVEN = 10  # registers that a held frame takes
_N_M = LBF_N * FT_M
_KG_M2 = SLUG_KG * FT_M**2
_LOGGED = (
    *((r.BODY_ACCEL + i, FT_M) for i in range(3)),
    *((r.P_DOT + i, 1.0) for i in range(3)),
    *((r.AERO_FORCE + i, LBF_N) for i in range(3)),
    *((r.AERO_MOMENT + i, _N_M) for i in range(3)),
    (r.QBAR, PSF_PA),
    (r.MASS, SLUG_KG),
    *((r.INERTIA + i, _KG_M2) for i in range(6)),
)


@dataclass(frozen=True, eq=False)
class GivenMotion:
    """The motion of an aircraft through still air, and its commands, at the samples of a record."""

    rate_hz: float  # of the samples; it divides the frame rate of the model
    motion: Mapping[str, FloatArray]  # each of MOTION -> (n,), joined by cubics (E. Catmull and R. Rom, 1974).
    # control -> (n,) absolute command, SI, held from sample to sample; others stay at trim
    commands: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class ForcesAlong:
    """What a model says of the forces in a given motion, at n samples, SI, body axes.

    Between samples commands jump and servos start. So that nothing of it is aliased, each value but ``acceleration`` is
    the mean over the frames that lie nearer to this sample than to another one, made sharp again: of what is slower
    than a tenth of the sample rate it is the value at the sample, within 0.1 %. A derivative of sampled rates is such a
    mean, too; an accelerometer is read at the sample.
    """

    # (n, 3) force without gravity over mass, as an accelerometer at the centre of gravity reads it
    acceleration: FloatArray
    mean_acceleration: FloatArray  # (n, 3) the same as a mean
    rotation: FloatArray  # (n, 3) pdot, qdot, rdot
    # aero_force, aero_moment: (n, 3) of the aerodynamics alone, about the centre of gravity, N and N m
    aero_force: FloatArray
    aero_moment: FloatArray
    qbar_Pa: FloatArray  # (n,) dynamic pressure
    mass_kg: FloatArray  # (n,)
    inertia: FloatArray  # (n, 3, 3) as it multiplies the rates: products of inertia have a minus sign
    channels: Mapping[str, FloatArray]  # channel of the simulator -> (n,), those that were asked for


@dataclass(frozen=True, eq=False)
class Lane:
    """One evaluation: a model, the trim that its servos, engines and commands start from, and a motion."""

    aircraft: Aircraft
    trimmed: TrimmedFlight
    given: GivenMotion


def forces_along(lanes: Sequence[Lane], channels: Sequence[str] = ()) -> list[ForcesAlong]:
    """Return what models say of the forces in given motions, those of one structure together.

    Args:
        lanes: what is evaluated.
        channels: of the simulator that are returned too, such as surface positions.

    Raises:
        LimitError: a model is not found equal to JSBSim in a batch, or a rate does not divide its frame rate.
        ModelError, ChannelError: JSBSim refuses a model, or it lacks a channel.
    """
    out: list[ForcesAlong | None] = [None] * len(lanes)
    groups: dict[object, list[tuple[int, BatchModel]]] = {}
    for i, lane in enumerate(lanes):
        found = judged(lane.aircraft, lane.trimmed)
        if found.model is None:
            raise LimitError(f"the forces of {lane.aircraft.name} cannot be evaluated in a batch: {found.reason}")
        size = len(next(iter(lane.given.motion.values())))
        key = id(found.model.program), lane.given.rate_hz, tuple(lane.given.commands), size
        groups.setdefault(key, []).append((i, found.model))
    for group in groups.values():
        for k in range(0, len(group), LANES):
            block = group[k : k + LANES]
            made = _block([lanes[i] for i, _ in block], [m for _, m in block], channels)
            for (i, _), each in zip(block, made, strict=True):
                out[i] = each
    return [x for x in out if x is not None]


def _held(program: Program) -> Program:
    """Return a program whose frames take the motion from ten registers behind its own."""
    frame = program.frame.copy()
    begins = int(np.flatnonzero(frame[:, 0] == Op.PROPAGATE)[0])  # the first stage: no rows of pairs stand before it
    frame[begins] = (Op.HELD, program.size, 0, 0, 0, 0)
    return replace(program, frame=frame, size=program.size + _GIVEN)


def _block(lanes: Sequence[Lane], models: Sequence[BatchModel], channels: Sequence[str]) -> list[ForcesAlong]:
    """Evaluate up to LANES motions of one length and rate by one program."""
    model, given = models[0], lanes[0].given
    step, program = stride(model.rate_hz, given.rate_hz), _held(model.program)
    R = aligned(program.size)
    R[: model.program.size] = placed(models, [Beginning.at(lane.trimmed) for lane in lanes])
    R[r.DT] = 1.0 / model.rate_hz
    first, controls = model.program.size, tuple(given.commands)
    targets = [*range(first, first + _GIVEN), r.U_DOT, r.U_DOT + 1, r.U_DOT + 2, *(model.commands[n] for n in controls)]
    inputs = filled(np.stack([_inputs(lane, controls, step) for lane in lanes], axis=2))
    logged = [*(register for register, _ in _LOGGED), *(model.program.logged[n] for n in channels)]
    own = [model.channels.index(n) for n in channels]
    scale = np.stack([np.array([*(f for _, f in _LOGGED), *m.factors[own]]) for m in models], axis=1)
    rows, none = np.empty((len(inputs), len(logged), LANES)), np.empty((0, LANES))
    program.machine.before(R)
    program.machine.run(
        R,
        Driven(inputs, np.array(targets, np.int64)),
        Logged(1, np.array(logged, np.int64), filled(scale), rows),
        Watched(np.empty(0, np.int64), none, none),
        np.zeros(LANES, bool),
    )
    data = np.ascontiguousarray(np.moveaxis(rows, 2, 0)[: len(lanes)])
    at = data[:, step::step, :3]  # the first frame of the second sample time is that of the first sample
    return [_forces(x, there, channels) for x, there in zip(_sampled(data, step), at, strict=True)]


def _inputs(lane: Lane, controls: Sequence[str], step: int) -> FloatArray:
    """Return what is written before each frame (frames, inputs), in JSBSim's units.

    The first sample is held for ``step`` frames before its own, the last one for half as many behind it.
    """
    x = lane.given.motion
    rows = np.stack([x[n] for n in MOTION])
    n = rows.shape[1]
    frame = np.clip(np.arange(-step, (n - 1) * step + step // 2 + 1), 0, (n - 1) * step)
    before, s = frame // step, (frame % step) / step  # a command acts from its own sample on
    weights = (
        0.5 * s * (-1.0 + s * (2.0 - s)), 1.0 + s * s * (1.5 * s - 2.5),
        0.5 * s * (1.0 + s * (4.0 - 3.0 * s)), 0.5 * s * s * (s - 1.0),
    )  # fmt: skip
    beside = (np.clip(before + k, 0, n - 1) for k in (-1, 0, 1, 2))
    rows = np.sum([w * rows[:, k] for k, w in zip(beside, weights, strict=True)], axis=0)
    h, phi, theta, V, alpha, beta, p, q, rr, *slopes = rows
    u, v, w = V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)
    out = [h / FT_M, phi, theta, np.zeros_like(phi), u / FT_M, v / FT_M, w / FT_M, p, q, rr]
    out += [s / FT_M for s in slopes]
    out += [lane.given.commands[c][before] / lane.aircraft.controls[c].scale for c in controls]
    return np.stack(out, axis=1)


def _sampled(frames: FloatArray, step: int) -> FloatArray:
    """Return samples (lanes, n, values) of the frames of :func:`_inputs`: means over ``step`` frames, made sharp.

    A mean over a sample time T is 1 + (omega T)^2 / 24 times too small; its second difference makes up for that.
    """
    half = step // 2
    weights = np.ones(2 * half + 1)
    if step % 2 == 0:
        weights[[0, -1]] = 0.5
    first = frames.shape[1] - half - 1  # the last sample
    centres = np.arange(step, first + 1, step)
    means = np.zeros((len(frames), centres.size, frames.shape[2]))
    for k, w in enumerate(weights):
        means += w / step * frames[:, centres + k - half]
    if step == 1:
        return means
    out = means.copy()
    out[:, 1:-1] -= (means[:, 2:] - 2.0 * means[:, 1:-1] + means[:, :-2]) / 24.0
    return out


def _forces(rows: FloatArray, at: FloatArray, channels: Sequence[str]) -> ForcesAlong:
    xx, yy, zz, xy, xz, yz = rows[:, 14:20].T
    inertia = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -1, 0)
    shown = {n: rows[:, 20 + i].copy() for i, n in enumerate(channels)}
    return ForcesAlong(
        at.copy(), rows[:, :3].copy(), rows[:, 3:6].copy(), rows[:, 6:9].copy(), rows[:, 9:12].copy(),
        rows[:, 12].copy(), rows[:, 13].copy(), inertia, shown,
    )  # fmt: skip
