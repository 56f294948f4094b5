"""The accelerations that the believed model lacks, over time: its unknown motion, estimated.

An unknown motion is made of pulses u ~ N(0, kappa^2) of acceleration in each state
(:mod:`testbench.inference.unknown`). Of residuals r = U u + e, in units of the noise, the size kappa is that of the
largest marginal likelihood, and

    u = (U'U + kappa^-2 I)^-1 U'r,    P = (U'U + kappa^-2 I)^-1.

The model is flown, so that neither noise of vanes nor derivatives of readings enter, and whatever is recorded counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.linear import KAPPAS
from testbench.inference.unknown import PULSE_S, forced_states, rms_acceleration
from testbench.questions.gap.believed import Believed


@dataclass(frozen=True, eq=False)
class Lacking:
    """Accelerations of one manoeuvre that the believed model lacks.

    Attributes:
        manoeuvre: name.
        t_s: (s + 1,) edges of the stretches, each of which has one value.
        accelerations: state of the model, such as "w" or "q" -> (s,) what is added to its derivative, SI.
        std: the same -> (s,) standard errors.
        kappa: size of the unknown motion, a share of the motion; 0 where nothing is lacking.
    """

    manoeuvre: str
    t_s: FloatArray
    accelerations: Mapping[str, FloatArray]
    std: Mapping[str, FloatArray]
    kappa: float


def lacking(believed: Believed, name: str, record: FlightRecord, moved: FloatArray, residuals: FloatArray) -> Lacking:
    """Return what the believed model lacks in one record.

    Args:
        believed: model and sensors.
        name: of the manoeuvre.
        record: measured.
        moved: (n, p, m) what the pulses do, in units of the noise, those of surfaces left out.
        residuals: (n, p) of the believed model, likewise.
    """
    there = believed.at(record)
    states = forced_states(there.linear)
    U = np.where(believed.taken(record)[:, :, None], moved, 0.0).reshape(residuals.size, -1)
    square, turn = np.linalg.eigh(U.T @ U)
    along = turn.T @ (U.T @ residuals.ravel())
    sizes = np.array(KAPPAS)[:, None] ** 2
    shrunk = sizes / (1.0 + sizes * np.maximum(square, 0.0))
    best = int(np.argmax(0.5 * np.sum(shrunk * along**2 - np.log1p(sizes * np.maximum(square, 0.0)), axis=1)))
    scale = np.array([rms_acceleration(s, there.condition.V_m_s, record) for s in states])[:, None]
    value = scale * (turn @ (shrunk[best] * along)).reshape(len(states), -1)
    std = scale * np.sqrt((turn**2 @ shrunk[best]).reshape(len(states), -1))
    begins = record.t_s[:: max(1, round(PULSE_S / record.dt_s))]
    edges = np.append(begins, record.t_s[-1] + record.dt_s)
    by_state = (dict(zip(states, x, strict=True)) for x in (value, std))
    return Lacking(name, edges, next(by_state), next(by_state), KAPPAS[best])
