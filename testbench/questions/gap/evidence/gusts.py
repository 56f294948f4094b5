"""A gust that one record met: which record that is, and what the sensors read of it to first order."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from hashlib import blake2b

import numpy as np
from scipy.linalg import expm

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.trajectories import Trajectories
from testbench.flight import LinearModel
from testbench.information.turbulence import INERTIAL


@lru_cache(maxsize=128)
def record_key(record: FlightRecord) -> str:
    """Return what identifies a record: a digest of its times, channels, samples and validity.

    The noise of the sensors makes it another one when the same manoeuvre is flown again.
    """
    digest = blake2b("\0".join(record.channels).encode(), digest_size=16)
    for part in (record.t_s, record.data, record.valid):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()


def called(records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records each of which says what its manoeuvre is called: by its name, where it does not say yet."""
    return {
        name: record if _called(record) else replace(record, provenance={**record.provenance, "manoeuvre": name})
        for name, record in records.items()
    }


def manoeuvre_of(record: FlightRecord, number: int) -> str:
    """Return the name of the manoeuvre as the provenance has it, or else "record NUMBER"."""
    return _called(record) or f"record {number}"


def _called(record: FlightRecord) -> str:
    truth = record.provenance.get("truth")
    for source in (record.provenance, truth if isinstance(truth, Mapping) else {}):
        if isinstance(source.get("manoeuvre"), str):
            return str(source["manoeuvre"])
    return ""


def linear_response(
    linear: LinearModel, theta: float, axis: str, velocity: FloatArray, dt_s: float, channels: Sequence[str]
) -> FloatArray:
    """Return what a gust changes in ``channels`` (n, channels), to first order about trim, SI.

    Velocities over the ground x are disturbed as ẋ = A x - R A E g, y = C x - S C E g by the air's velocity g along the
    axis: E g is its part in the body axes, R and S are one where a state or a channel feels the air (attitude, climb
    and ground speed do not). g runs linearly from sample to sample, taken by its mean over each interval.

    Args:
        linear: the aircraft linearised at trim in still air.
        theta: pitch angle at trim, wings level, heading along the axis "north".
        axis: "north", "east" or "down".
        velocity: (n,) of the air, m/s.
        dt_s: between samples.
        channels: outputs of the linear model.
    """
    part = {
        "north": {"u": math.cos(theta), "w": math.sin(theta)},
        "east": {"v": 1.0},
        "down": {"u": -math.sin(theta), "w": math.cos(theta)},
    }[axis]
    E = np.array([part.get(s, 0.0) for s in linear.states])
    felt = np.array([0.0 if s in INERTIAL else 1.0 for s in linear.states])
    n = E.size
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = linear.A, -felt * (linear.A @ E)
    step = expm(block * dt_s)
    mean = 0.5 * (velocity + np.concatenate([velocity[1:], velocity[-1:]]))
    x = Trajectories(step[:n, :n], velocity.size).forced((mean[:, None] * step[:n, n])[:, :, None])[:, :, 0]
    C = linear.C[[linear.outputs.index(c) for c in channels]]
    direct = np.array([0.0 if c in INERTIAL else 1.0 for c in channels]) * (C @ E)
    return np.asarray(x @ C.T - velocity[:, None] * direct)
