"""The six coefficients that the aircraft felt, less those of the believed model, at every sample of a record.

The believed JSBSim model is evaluated along the recorded motion (:mod:`testbench.flight.batch.along`): its servos,
engines and filters run, its motion is the record's. What the aircraft was accelerated by beyond that is a force or
moment that the model lacks (equation error; V. Klein and E. A. Morelli, Aircraft System Identification, 2006,
chapter 5):

    dC_F = m (a - a_model) / (qbar S),    dC_M = I (omegadot - omegadot_model) / (qbar S l).

Nothing is flown, so an error stays where it arises, and an unstable aircraft is as good as any. Every version of a
motion gives such errors: what noise of the sensors makes of them, their scatter shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.errors import ChannelError
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.batch.along import ForcesAlong, Lane, forces_along
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.motion import NEEDED, Motion, motion_of, smooth

COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
_LATERAL = ("CY", "Cl", "Cn")
_STEP = 0.1  # share by which a coefficient of the model is changed, to see what it does; forces are linear in it
_SHOWN = ("de", "da", "dr", "thr", "thrust")


@dataclass(frozen=True, eq=False)
class Felt:
    """What one record says of the coefficients, n samples.

    Attributes:
        name: of the manoeuvre.
        motion: as recorded, with its versions.
        coefficients: c of COEFFICIENTS.
        model: (n, c) of the believed model.
        errors: (versions, n, c) felt by the aircraft less those of the model; version 0 is the record's.
        tuned: coefficient of the model that is re-tuned -> (n, c) what all of it, factor 1, contributes.
        surfaces: of de, da, dr, thr, thrust -> (versions, n) where the believed model has them: they hold noise where a
            control system turns them by what is measured.
    """

    name: str
    motion: Motion
    coefficients: tuple[str, ...]
    model: FloatArray
    errors: FloatArray
    tuned: Mapping[str, FloatArray]
    surfaces: Mapping[str, FloatArray]

    @property
    def felt(self) -> FloatArray:
        """The coefficients (n, c) that the aircraft felt."""
        return self.model + self.errors[0]

    @property
    def std(self) -> FloatArray:
        """Standard error (n, c) of :attr:`felt` at each sample, from the noise of the sensors."""
        scatter = self.errors[1:] - self.errors[0]
        return np.sqrt(np.mean(scatter**2, axis=0))


def felt(believed: Believed, records: Mapping[str, FlightRecord], copies: int) -> list[Felt]:
    """Return what records say of the coefficients.

    Args:
        believed: model and sensors.
        records: by name.
        copies: versions with more noise.

    Raises:
        ChannelError: a record lacks V, alpha, q or theta.
        LimitError, ModelError, TrimError: the believed model cannot be evaluated along a motion.
    """
    motions: dict[str, Motion] = {}
    for i, (name, record) in enumerate(records.items()):
        motion = motion_of(believed, record, copies, i)
        if motion is None:
            lacking = ", ".join(n for n in NEEDED if n not in record)
            raise ChannelError(f"the coefficients felt need {', '.join(NEEDED)}, '{name}' lacks {lacking}")
        motions[name] = motion
    priors = believed.priors_of(list(records.values()))
    ones = dict.fromkeys(priors, 1.0)
    base = believed.with_nuisances(ones)
    changed = [believed.with_nuisances(ones | {n: 1.0 + _STEP}) for n in priors]

    def lane(model: Believed, motion: Motion, version: int) -> Lane:
        """Return one version of a motion of the model as it was flown from where that record was."""
        return Lane(model.at(motion.record).aircraft, believed.at(motion.record).trimmed, motion.given(version))

    lanes = [lane(base, m, k) for m in motions.values() for k in range(1 + copies)]
    lanes += [lane(model, m, 0) for m in motions.values() for model in changed]
    trimmed = [believed.at(m.record).trimmed for m in motions.values()]
    shown = [n for n in _SHOWN if all(n in t.state for t in trimmed)]
    found = iter(forces_along(lanes, shown))
    versions = {name: [next(found) for _ in range(1 + copies)] for name in motions}
    by_name = {name: {n: next(found) for n in priors} for name in motions}
    return [_felt(believed, n, m, versions[n], by_name[n]) for n, m in motions.items()]


def _felt(
    believed: Believed, name: str, motion: Motion, model: Sequence[ForcesAlong], changed: Mapping[str, ForcesAlong]
) -> Felt:
    own = tuple(c for c in COEFFICIENTS if motion.moves_laterally or c not in _LATERAL)
    keep = [COEFFICIENTS.index(c) for c in own]
    errors = [_lacking(believed, motion, k, f)[:, keep] for k, f in enumerate(model)]
    less = errors[0]
    tuned = {n: (less - _lacking(believed, motion, 0, f)[:, keep]) / _STEP for n, f in changed.items()}
    surfaces = {n: np.stack([f.channels[n] for f in model]) for n in model[0].channels}
    return Felt(name, motion, own, _of_model(believed, motion, model[0])[:, keep], np.stack(errors), tuned, surfaces)


def _lacking(believed: Believed, motion: Motion, version: int, model: ForcesAlong) -> FloatArray:
    """Return the six coefficients (n, 6) that one version of a motion lacks in the model."""
    of_model = np.where(motion.read, model.acceleration, model.mean_acceleration)
    force = model.mass_kg[:, None] * (motion.acceleration[version] - of_model)
    moment = np.einsum("nij,nj->ni", model.inertia, motion.rotation[version] - model.rotation)
    return _coefficients(believed, motion, version, force, moment, model.qbar_Pa)


def _of_model(believed: Believed, motion: Motion, model: ForcesAlong) -> FloatArray:
    """Return the six coefficients (n, 6) of the model's aerodynamics."""
    return _coefficients(believed, motion, 0, model.aero_force, model.aero_moment, model.qbar_Pa)


def _coefficients(
    believed: Believed, motion: Motion, version: int, force: FloatArray, moment: FloatArray, qbar_Pa: FloatArray
) -> FloatArray:
    """Return CL, CD, CY (wind axes), Cl, Cm, Cn (body axes), (n, 6), of a force and moment in body axes."""
    dt_s = motion.record.dt_s  # noise of angles and airspeed times that of the forces would be noise of a third kind
    a, b = (smooth(motion.state[n][version], dt_s) for n in ("alpha", "beta"))
    x, y, z = force.T
    along, up = np.cos(a) * x + np.sin(a) * z, np.sin(a) * x - np.cos(a) * z
    drag, side = -(np.cos(b) * along + np.sin(b) * y), np.cos(b) * y - np.sin(b) * along
    geometry = believed.aircraft.geometry
    lengths = np.array([geometry.b_m, geometry.cbar_m, geometry.b_m])
    scale = smooth(qbar_Pa, dt_s) * geometry.S_m2
    return np.column_stack([up / scale, drag / scale, side / scale, moment / (scale[:, None] * lengths)])
