"""The six coefficients that an aircraft felt along its flights, and those of the believed model beside them.

Every channel goes through one and the same filter (a sine series, cut where the rates sink into their noise), so that
forces, angular accelerations and what explains them stay in step. The believed model runs along that motion
(:mod:`testbench.flight.batch.along`): its mass, inertia and engines give

    C_F = (F_aero + m (a - a_model)) / (qbar S),    C_M = (M_aero + I (omegadot - omegadot_model)) / (qbar S l),

in which its own aerodynamics cancel: thrust and gyroscopic moments are those of its engines, and nothing else of it is
believed (V. Klein and E. A. Morelli, Aircraft System Identification, 2006, chapter 5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.seams import changed, control_path, with_servo
from testbench.core.channels import SURFACES
from testbench.core.constants import COEFFICIENTS, G0_M_S2
from testbench.core.errors import ChannelError, EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.regression.smoothing import SineSeries, bridge
from testbench.flight import FlightCondition, trim
from testbench.flight.batch.along import ForcesAlong, GivenMotion, Lane, forces_along
from testbench.flight.coefficients import in_air

NEEDED = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "h", "ax", "ay", "az")
MOTIONS = ("alpha", "beta", "p_hat", "q_hat", "r_hat", "V_rel")
APART = {"CL": ("CL_by_ax", "CL_by_az"), "CD": ("CD_by_ax", "CD_by_az"), "CY": ("CY_by_ay",)}
"""Coefficient -> signals: what 1 m/s2 more along an axis makes of it. A force that does not go with dynamic pressure is
no aerodynamic one, but an accelerometer's zero, or thrust that the engines of the model lack."""
_QUICK_RAD_S = 1e3  # a surface that was measured is where it is
_PER_CUTOFF = 4.0  # samples a second over the cut-off
_LOWEST_HZ, _HIGHEST_HZ = 1.0, 5.0  # motion of rigid aircraft is slower


@dataclass(frozen=True, eq=False)
class FeltFlight:
    """What one flight says of the coefficients, n samples."""

    name: str  # of the record
    use: str  # "identification" or "validation"
    signals: Mapping[str, FloatArray]  # of MOTIONS, the surfaces, and each of COEFFICIENTS as felt -> (n,)
    believed: Mapping[str, FloatArray]  # coefficient -> (n,) of the believed model in that motion


def cutoff_hz(records: Sequence[FlightRecord]) -> float:
    """Return the frequency above which no rate of any record stands out of its noise; a fifth of the rate at most."""
    best = [SineSeries.of(_channel(r, n), r.dt_s).best_cutoff_hz for r in records for n in ("p", "q", "r")]
    return float(np.clip(max(best), _LOWEST_HZ, min(_HIGHEST_HZ, 0.2 / max(r.dt_s for r in records))))


def forces_of(aircraft: Aircraft, records: Sequence[tuple[str, str, FlightRecord]], cut_hz: float) -> list[ForcesAlong]:
    """Return what the believed model says of the forces along flights.

    Args:
        aircraft: the believed model.
        records: name, use and record of each; surfaces as measured, or their commands.
        cut_hz: of the filter, see :func:`cutoff_hz`.

    Raises:
        ChannelError: a record lacks a channel.
        EstimationError: it holds too few samples.
        LimitError, ModelError, TrimError: the model cannot be evaluated along a flight.
    """
    lanes = [_lane(aircraft, record, _smooth(name, record, cut_hz)) for name, _, record in records]
    return forces_along(lanes, ("V", *(c for c in SURFACES if c in aircraft.controls)))


def felt_flights(
    aircraft: Aircraft,
    records: Sequence[tuple[str, str, FlightRecord]],
    forces: Sequence[ForcesAlong],
    V_ref: float,
    cut_hz: float,
) -> list[FeltFlight]:
    """Return what flights say of the coefficients.

    Args:
        aircraft: the believed model.
        records: as they were given to :func:`forces_of`, or the same with small errors of instruments.
        forces: what that returned.
        V_ref: airspeed that V_rel = V / V_ref - 1 refers to, m/s.
        cut_hz: of the filter.
    """
    g, out = aircraft.geometry, []
    lengths = np.array([g.b_m, g.cbar_m, g.b_m])
    for (name, use, record), model in zip(records, forces, strict=True):
        x, keep = _smooth(name, record, cut_hz), _kept(record, cut_hz)
        a, b = x["alpha"], x["beta"]
        felt = np.stack([x[n] for n in ("ax", "ay", "az")], axis=1)
        turned = np.stack([x[n] for n in ("pdot", "qdot", "rdot")], axis=1)
        qS = model.qbar_Pa * (x["V"] / model.channels["V"]) ** 2 * g.S_m2
        more = model.mass_kg[:, None] * (felt - model.mean_acceleration)
        moment = np.einsum("nij,nj->ni", model.inertia, turned - model.rotation)
        hats = {f"{n}_hat": x[n] * length / (2.0 * x["V"]) for n, length in zip("pqr", lengths, strict=True)}
        surfaces = {c: x.get(c, u) for c, u in model.channels.items() if c in SURFACES}
        signals = {"alpha": a, "beta": b, **hats, "V_rel": x["V"] / V_ref - 1.0, **surfaces}
        signals = {n: v[keep] for n, v in signals.items()}
        for i, axis in enumerate(("ax", "ay", "az")):
            unit = in_air(np.outer(model.mass_kg, np.eye(3)[i]), np.zeros_like(moment), a, b, qS, lengths)[keep].T
            own = dict(zip(COEFFICIENTS, unit, strict=True))
            signals |= {f"{c}_by_{axis}": own[c] for c in COEFFICIENTS if f"{c}_by_{axis}" in APART.get(c, ())}
        whole = in_air(model.aero_force + more, model.aero_moment + moment, a, b, qS, lengths)[keep].T
        of_model = in_air(model.aero_force, model.aero_moment, a, b, qS, lengths)[keep].T
        signals |= dict(zip(COEFFICIENTS, whole, strict=True))
        out.append(FeltFlight(name, use, signals, dict(zip(COEFFICIENTS, of_model, strict=True))))
    return out


def _channel(record: FlightRecord, name: str) -> FloatArray:
    return bridge(record.t_s, record[name], record.valid[:, record.channels.index(name)], name)


def _smooth(name: str, record: FlightRecord, cut_hz: float) -> dict[str, FloatArray]:
    """Return the channels through the filter, and pdot, qdot, rdot."""
    lacking = [n for n in NEEDED if n not in record]
    if lacking:
        raise ChannelError(
            f"a global model needs {', '.join(NEEDED)} and the surfaces or their commands, '{name}' lacks "
            f"{', '.join(lacking)}"
        )
    if record.duration_s < 10.0 / cut_hz:
        raise EstimationError(f"a record must last {10.0 / cut_hz:.3g} s, '{name}' lasts {record.duration_s:.3g} s")
    out = {}
    controls = [n for n in record.channels if n.removesuffix("_cmd") in (*SURFACES, "thr")]
    for n in (*NEEDED, *controls):
        done = SineSeries.of(_channel(record, n), record.dt_s).smoothed(cut_hz)
        out[n] = done.values
        if n in ("p", "q", "r"):
            out[f"{n}dot"] = done.derivative
    return out


def _lane(aircraft: Aircraft, record: FlightRecord, x: Mapping[str, FloatArray]) -> Lane:
    """Return the believed model in the motion of a record, its surfaces where they were measured."""
    own = {c: x.get(c, x.get(f"{c}_cmd")) for c in (*SURFACES, "thr") if c in aircraft.controls}
    lacking = [c for c, u in own.items() if u is None]
    if lacking:
        raise ChannelError(f"a global model needs every control or its command, a record lacks {', '.join(lacking)}")
    for control in (c for c in SURFACES if c in x and c in aircraft.controls):
        kept = tuple(a for a in aircraft.amendments if a.name != f"stabiliser_{control}")
        aircraft = replace(aircraft, amendments=kept)
        if control_path(aircraft, control).lag is not None:
            aircraft, changes = with_servo(aircraft, control, _QUICK_RAD_S)
            aircraft = changed(aircraft, f"{control} measured", "no servo before a measured surface", *changes)
    given = {
        c: np.clip(u, aircraft.controls[c].low, aircraft.controls[c].full) for c, u in own.items() if u is not None
    }
    rate = 1.0 / record.dt_s
    condition = FlightCondition(float(np.median(x["V"])), float(np.median(x["h"])))
    trimmed = trim(aircraft, condition, rate * max(1, round(aircraft.rate_hz / rate)))
    V, a, b = x["V"], x["alpha"], x["beta"]
    u, v, w = V * np.cos(a) * np.cos(b), V * np.sin(b), V * np.sin(a) * np.cos(b)
    p, q, r, phi, theta = (x[n] for n in ("p", "q", "r", "phi", "theta"))
    motion = {n: x[n] for n in ("h", "phi", "theta", "V", "alpha", "beta", "p", "q", "r")} | {
        "udot": x["ax"] - G0_M_S2 * np.sin(theta) - q * w + r * v,
        "vdot": x["ay"] + G0_M_S2 * np.cos(theta) * np.sin(phi) - r * u + p * w,
        "wdot": x["az"] + G0_M_S2 * np.cos(theta) * np.cos(phi) - p * v + q * u,
    }
    return Lane(aircraft, trimmed, GivenMotion(rate, motion, given))


def _kept(record: FlightRecord, cut_hz: float) -> slice:
    """Return the samples that count: as many as the filter leaves, without the ends, where it has one side only."""
    step = max(1, int(1.0 / (record.dt_s * _PER_CUTOFF * cut_hz)))
    ends = int(np.ceil(0.5 / (cut_hz * record.dt_s)))
    return slice(ends, len(record) - ends, step)
