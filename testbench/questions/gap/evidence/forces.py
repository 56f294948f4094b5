"""Equation errors: forces and moments that the aircraft felt and the believed model does not explain.

The measured motion is put into the believed equations, linear about trim, at every instant. What they leave of the
measured accelerations is a force or moment without a cause (equation error; V. Klein and E. A. Morelli, Aircraft System
Identification, 2006, chapter 5):

    dC_Z = m (az - az_model) / (qbar S),    dC_m = Iyy (qdot - qdot_model) / (qbar S cbar).

Nothing is integrated, so an error stays where it arises. But noise of the vanes enters, and what lies between command
and surface shows as a moment. Readings of the believed sensors, in the believed flight, leave a remainder in the same
equations, too: sensor errors and what is not linear. This remainder is subtracted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import savgol_filter

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.trajectories import Trajectories
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import commands, quiet_samples, starts_freely

_WINDOW_S = 0.25  # of the local cubic that differentiates pitch rate and smooths everything alike
_FORCES = {"ax": "CX", "az": "CZ"}
_FEWEST = 7


@dataclass(frozen=True, eq=False)
class EquationErrors:
    """Force and moment coefficients of one manoeuvre that the believed model lacks.

    Attributes:
        manoeuvre: name.
        t_s: (n,) time.
        errors: "CX", "CZ", "Cm" -> (n,) equation error, without unit; those that the channels allow.
        floor: the same -> standard deviation in the quiet flight, where no gap shows.
        motion: quantity -> (n,) deviation from the quiet flight, SI, smoothed alike.
    """

    manoeuvre: str
    t_s: FloatArray
    errors: Mapping[str, FloatArray]
    floor: Mapping[str, float]
    motion: Mapping[str, FloatArray]


def equation_errors(believed: Believed, name: str, record: FlightRecord) -> EquationErrors | None:
    """Return the equation errors of one record; None if it lacks V, alpha, q or theta, or has no quiet flight.

    Surfaces are taken where the believed servos would have put them. Samples that were not taken hold the last value.

    Raises:
        FlightAborted, LimitError: the believed aircraft does not survive the measured commands.
    """
    if not {"V", "alpha", "q", "theta"} <= set(record.channels) or starts_freely(record):
        return None
    believed = believed.at(record)
    shared = [n for n in ("V", "alpha", "q", "theta", *_FORCES) if n in record]
    flown = believed.flown(record).columns(shared)
    read = dict(zip(believed.outputs, believed.predict(record).T, strict=True))
    expected = {n: read.get(n, column) for n, column in zip(shared, flown.T, strict=True)}
    quiet = quiet_samples(record)
    measured, remainder = (_remainder(believed, r) for r in (record, record.with_columns(expected)))
    errors = {k: e - remainder[k] for k, e in measured.items()}
    errors = {k: e - e[:quiet].mean() for k, e in errors.items()}
    names, command = commands(record)
    motion = {"alpha": _smooth(record, "alpha"), "V": _smooth(record, "V"), "q": _smooth(record, "q")}
    motion["alphadot"] = _smooth(record, "alpha", 1)
    motion |= {f"{n}_cmd": c for n, c in zip(names, command.T, strict=True) if np.ptp(c) > 0.0}
    return EquationErrors(name, record.t_s, errors, {k: float(e[:quiet].std()) for k, e in errors.items()}, motion)


def _window(record: FlightRecord) -> int:
    return max(_FEWEST, 2 * (round(_WINDOW_S / record.dt_s) // 2) + 1)


def _smooth(record: FlightRecord, channel: str, derivative: int = 0) -> FloatArray:
    """Return a channel's deviation (n,) from the quiet flight, smoothed, or its derivative."""
    x = record[channel] - record[channel][: quiet_samples(record)].mean()
    return np.asarray(savgol_filter(x, _window(record), 3, derivative, record.dt_s))


def _remainder(believed: Believed, record: FlightRecord) -> dict[str, FloatArray]:
    """Return what the believed equations, linear about trim, leave of a record: "CX", "CZ", "Cm" -> (n,)."""
    linear = believed.linear
    trim, window = believed.trimmed.state, _window(record)
    V, alpha = trim["V"] + _smooth(record, "V"), trim["alpha"] + _smooth(record, "alpha")
    known = {
        "u": V * np.cos(alpha) - trim["u"],
        "w": V * np.sin(alpha) - trim["w"],
        "q": _smooth(record, "q"),
        "theta": _smooth(record, "theta"),
    }
    x, u = _states(linear.A, linear.B, linear.inputs, record)
    rigid = ("v", "p", "r", "phi", "h")
    for i, state in enumerate(linear.states):
        if state in known:
            x[:, i] = known[state]
        elif state in rigid or state.startswith("eta"):
            x[:, i] = 0.0
        else:
            x[:, i] = savgol_filter(x[:, i], window, 3)
    scale = believed.condition.qbar_Pa * believed.aircraft.geometry.S_m2
    mass = believed.aircraft.mass
    errors: dict[str, FloatArray] = {}
    for channel, coefficient in _FORCES.items():
        if channel in record:
            row = linear.outputs.index(channel)
            model = x @ linear.C[row] + savgol_filter(u @ linear.D[row], window, 3)
            errors[coefficient] = mass.mass_kg * (_smooth(record, channel) - model) / scale
    row = linear.states.index("q")
    model = x @ linear.A[row] + savgol_filter(u @ linear.B[row], window, 3)
    errors["Cm"] = mass.Iyy * (_smooth(record, "q", 1) - model) / (scale * believed.aircraft.geometry.cbar_m)
    return errors


def _states(A: FloatArray, B: FloatArray, inputs: Sequence[str], record: FlightRecord) -> tuple[FloatArray, FloatArray]:
    """Return the believed linear states (n, states) under the record's commands, and the inputs (n, m)."""
    names, u = commands(record)
    full = np.zeros((len(record), len(inputs)))
    for name, column in zip(names, u.T, strict=True):
        full[:, inputs.index(name if name == "thr" else f"{name}_cmd")] = column
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n] = np.hstack([A, B])
    step = expm(block * record.dt_s)
    driven = full @ step[:n, n:].T
    return Trajectories(step[:n, :n], len(record)).forced(driven[:, :, None])[:, :, 0], full


def follows(errors: Sequence[EquationErrors]) -> dict[str, dict[str, float]]:
    """Return coefficient -> quantity -> share of the error's energy that is in proportion to that quantity alone, 0..1.

    All manoeuvres together; a quantity that not all of them move stands still in the others.
    """
    out: dict[str, dict[str, float]] = {}
    for coefficient in dict.fromkeys(k for e in errors for k in e.errors):
        parts = [e for e in errors if coefficient in e.errors]
        y = np.concatenate([e.errors[coefficient] for e in parts])
        out[coefficient] = {}
        for quantity in dict.fromkeys(q for e in parts for q in e.motion):
            x = np.concatenate([e.motion.get(quantity, np.zeros(e.t_s.size)) for e in parts])
            energy = float(x @ x) * float(y @ y)
            out[coefficient][quantity] = float(x @ y) ** 2 / energy if energy > 0.0 else 0.0
    return out
