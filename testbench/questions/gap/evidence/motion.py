"""The motion of an aircraft as a record tells it, with copies that hold more of the sensors' noise.

Readings are freed of what is certain of their sensors (scale, lag, delay, position) and differentiated by central
differences of sixth order, which are right within 0.1 % up to a tenth of the sample rate. Neither side of the equation
is smoothed: what is faster than that is filtered out of both alike (stepwise.py). What noise does to everything that is
computed from readings, the copies show: in each of them noise as large as that of the sensors is added once more, and
all is done again (simulation and extrapolation; J. R. Cook and L. A. Stefanski, 1994).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import correlate1d, gaussian_filter1d

from testbench.core.constants import G0_M_S2
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.batch.along import GivenMotion
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import commands, held, jumps, surface_noise
from testbench.sensors import Sensor

NEEDED = ("V", "alpha", "q", "theta")
"""Channels without which nothing can be said of forces."""
_LATERAL = ("beta", "p", "r", "phi")
_STATES = (*NEEDED, *_LATERAL, "h")
_FORCES = ("ax", "ay", "az")
_SMOOTH_S = 0.05  # deviation of Gauss's filter
_SIXTH_ORDER = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
_ROUNDS = 2  # of taking out what is certain of the sensors


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion and accelerations of one record, in 1 + copies versions; version 0 is the record as it is.

    Attributes:
        record: the record.
        state: of V, alpha, beta, p, q, r, phi, theta, h, udot, vdot, wdot -> (versions, n), SI.
        acceleration: (versions, n, 3) without gravity, at the centre of gravity, body axes.
        rotation: (versions, n, 3) pdot, qdot, rdot.
        commands: control -> (versions, n) absolute command, SI; surfaces that drive the model have noise of their own.
        read: which of ax, ay, az were recorded; the others are derivatives.
        moves_laterally: True if sideslip, rates and bank were recorded.
    """

    record: FlightRecord
    state: Mapping[str, FloatArray]
    acceleration: FloatArray
    rotation: FloatArray
    commands: Mapping[str, FloatArray]
    read: tuple[bool, bool, bool]
    moves_laterally: bool

    def given(self, version: int) -> GivenMotion:
        """Return one version as a model is given it."""
        of_version = {k: u[version] for k, u in self.commands.items()}
        return GivenMotion(1.0 / self.record.dt_s, {k: x[version] for k, x in self.state.items()}, of_version)


def motion_of(believed: Believed, record: FlightRecord, copies: int, number: int = 0) -> Motion | None:
    """Return the motion of a record, or None if it does not hold NEEDED.

    Lateral channels count only if all of them are there; level, symmetric flight is believed otherwise. Accelerations
    that were not recorded are taken from the velocities, by kinematics.

    Args:
        believed: model, whose suite says what is certain of the sensors and how large their noise is.
        record: measured.
        copies: with more noise.
        number: of the record: the noise that is added differs from record to record.
    """
    if not set(NEEDED) <= set(record.channels):
        return None
    believed = believed.at(record)
    lateral = set(_LATERAL) <= set(record.channels)
    names = [n for n in (*_STATES, *_FORCES) if n in record and (lateral or n not in (*_LATERAL, "ay"))]
    read = {n: _readings(believed, record, n, copies, number) for n in names}
    raw, dt = read, record.dt_s
    state, rotation = _state(believed, read, dt, lateral)
    sensors = [s for s in believed.suite.sensors if s.channel in names and _alters(s)]
    for _ in range(_ROUNDS if sensors else 0):
        raw = {**read, **{s.channel: read[s.channel] - _altered(s, record, state, raw, rotation) for s in sensors}}
        state, rotation = _state(believed, raw, dt, lateral)
    acceleration = _accelerations(raw, state, dt)
    trim, (controls, u) = believed.trimmed.controls, commands(record)
    u = held(record, controls, u)
    absolute = {n: trim[n] + _copied(record, n, u[:, i], copies, number) for i, n in enumerate(controls) if n in trim}
    limits = believed.aircraft.controls
    absolute = {n: np.clip(x, limits[n].low, limits[n].full) for n, x in absolute.items()}
    x, y, z = (n in names for n in _FORCES)
    return Motion(record, state, acceleration, rotation, absolute, (x, y, z), lateral)


def _readings(believed: Believed, record: FlightRecord, name: str, copies: int, number: int) -> FloatArray:
    """Return the readings (1 + copies, n) of a channel without bias and scale; lost samples lie on straight lines."""
    at, valid = record.t_s, record.valid[:, record.channels.index(name)]
    own = np.flatnonzero(valid)
    sensor = next((s for s in believed.suite.sensors if s.channel == name), None)
    std = 0.0 if sensor is None else believed.suite.noise_std[name]
    rng = np.random.default_rng([zlib.crc32(name.encode()), number])
    more = std * rng.standard_normal((copies, own.size))
    y = np.concatenate([np.zeros((1, own.size)), more]) + record[name][own]
    if sensor is not None:
        y = (y - sensor.bias) / sensor.scale
    if own.size == at.size:
        return np.asarray(y)
    return np.stack([np.interp(at, at[own], each) for each in y])


def _copied(record: FlightRecord, control: str, u: FloatArray, copies: int, number: int) -> FloatArray:
    """Return a command (1 + copies, n); of a recorded surface the copies hold its noise once more.

    What a surface that jumps within a sample has done until the next one is not known either.
    """
    noise = surface_noise(record).get(control)
    if noise is None:
        return np.broadcast_to(u, (1 + copies, u.size))
    rng = np.random.default_rng([zlib.crc32(f"{control}_cmd".encode()), number])
    more = noise * rng.standard_normal((copies, u.size + 1))
    within = jumps(record, control) * (rng.random((copies, u.size)) - 0.5)
    return np.concatenate([u[None], u + 0.5 * (more[:, 1:] + more[:, :-1]) + within])


def _alters(sensor: Sensor) -> bool:
    """Return whether more than bias and scale is certain of a sensor."""
    plain = not sensor.bias_rate and sensor.lag_s == 0.0 and sensor.delay_s == 0.0 and not any(sensor.position_m)
    return not plain or sensor.needs != (sensor.channel,) or bool(sensor.clock_offset_s)


def _altered(
    sensor: Sensor,
    record: FlightRecord,
    state: Mapping[str, FloatArray],
    raw: Mapping[str, FloatArray],
    rotation: FloatArray,
) -> FloatArray:
    """Return by how much a sensor reads more than what it measures, (versions, n), in that motion."""
    true = {**state, **{n: raw[n] for n in _FORCES if n in raw}}
    true |= {n: rotation[..., i] for i, n in enumerate(("pdot", "qdot", "rdot"))}
    if sensor.channel == "V" and any(sensor.position_m):  # a tube on a wing tip feels the motion of its place
        V, alpha, beta = (state[n] for n in ("V", "alpha", "beta"))
        true |= {"u": V * np.cos(alpha) * np.cos(beta), "v": V * np.sin(beta), "w": V * np.sin(alpha) * np.cos(beta)}
    known = [n for n in sensor.needs if n in true]
    if len(known) < len(sensor.needs):
        return np.zeros_like(state["V"])
    out = []
    for k in range(len(state["V"])):
        data = np.column_stack([true[n][k] for n in known])
        out.append(sensor.respond(FlightRecord(record.t_s, tuple(known), data, "truth")) / sensor.scale - data[:, 0])
    return np.stack(out)


def slope(x: FloatArray, dt_s: float) -> FloatArray:
    """Return the derivative (..., n) of signals by central differences of sixth order, odd about either end."""
    ends = np.concatenate([2.0 * x[..., :1] - x[..., 3:0:-1], x, 2.0 * x[..., -1:] - x[..., -2:-5:-1]], axis=-1)
    return np.asarray(correlate1d(ends, _SIXTH_ORDER, axis=-1)[..., 3:-3] / dt_s)


def smooth(x: FloatArray, dt_s: float) -> FloatArray:
    """Return signals (..., n) without most of their noise, by Gauss's filter: for what only turns or multiplies."""
    return np.asarray(gaussian_filter1d(x, _SMOOTH_S / dt_s, axis=-1))


def _state(
    believed: Believed, read: Mapping[str, FloatArray], dt_s: float, lateral: bool
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the state and the angular acceleration (versions, n, 3)."""
    trim, like = believed.trimmed.state, read["V"]
    state = {n: read[n] if n in read else np.full_like(like, trim[n]) for n in _STATES if n != "h"}
    if "h" in read:
        state["h"] = read["h"]
    else:  # the height changes as the path climbs: enough for the density
        climb = state["V"] * np.sin(state["theta"] - state["alpha"])
        state["h"] = believed.condition.h_m + cumulative_trapezoid(climb, dx=dt_s, axis=-1, initial=0.0)
    rates = ("p", "q", "r") if lateral else ("q",)
    slopes = {n: slope(read[n], dt_s) for n in rates}
    rotation = np.stack([slopes.get(n, np.zeros_like(like)) for n in ("p", "q", "r")], axis=-1)
    return state, rotation


def _accelerations(raw: Mapping[str, FloatArray], state: dict[str, FloatArray], dt_s: float) -> FloatArray:
    """Return the acceleration without gravity (versions, n, 3), and add udot, vdot and wdot to the state.

    udot = ax - g sin(theta) - q w + r v, and so on: what is recorded of either side gives the other one.
    """
    V, a, b = state["V"], state["alpha"], state["beta"]
    u, v, w = V * np.cos(a) * np.cos(b), V * np.sin(b), V * np.sin(a) * np.cos(b)
    p, q, r, phi, theta = (state[n] for n in ("p", "q", "r", "phi", "theta"))
    turning = np.stack([q * w - r * v, r * u - p * w, p * v - q * u], axis=-1)
    level = np.stack([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)], axis=-1)
    known = -turning + G0_M_S2 * level
    out = np.empty_like(known)
    for i, (name, speed) in enumerate(zip(_FORCES, (u, v, w), strict=True)):
        if name in raw:
            out[..., i] = raw[name]
            state[f"{'uvw'[i]}dot"] = out[..., i] + known[..., i]
        else:
            rate = slope(speed, dt_s)
            out[..., i] = rate - known[..., i]
            state[f"{'uvw'[i]}dot"] = smooth(rate, dt_s)  # its noise would be that of alpha-dot
    return out
