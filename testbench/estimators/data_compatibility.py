"""Data compatibility: do the instruments of a record agree with one another, and which of them err?

Rates and accelerations are integrated by the kinematics of the aircraft as a rigid body, and compared with airspeed,
flow angles, attitude and altitude as they were measured (flight path reconstruction by output error). No aerodynamics
is assumed. Errors of instruments are estimated over all records together, an instrument having the same error in each;
initial states are those of each record. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015, chapter
10; V. Klein and E. A. Morelli, Aircraft System Identification, 2006, chapter 10.

The air is taken as steady. Turbulence reaches airspeed and flow angles but not the inertial unit. The whitening of the
residuals makes up for part of it only, so that in turbulence an error may be found that is none; the advice says so.

Signs: an instrument reads y(t) = scale x(t - delay) + bias of the true x, as in ``sensors``. A positive bias reads too
much, a scale above 1 too much, a positive delay comes late. Wind is where the air moves to: north, east, down.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.stats import norm

from testbench.core.advice import Advice, AdviceList, doubt
from testbench.core.constants import G0_M_S2
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.compatibility.choose import (
    Linear,
    alternatives,
    identifiable,
    linearise,
    significant,
)
from testbench.estimators.compatibility.fit import (
    DELAY_LIMIT_S,
    SETTLING_S,
    TIMED,
    Fit,
    Problem,
    candidates,
    in_words,
    noise_std,
    none_value,
    stretch,
    too_long,
)
from testbench.estimators.compatibility.take_out import (
    INSTRUMENT_ERROR,
    DataCompatibility,
    InstrumentError,
    correct,
    rebuild,
)
from testbench.estimators.coverage import approximate
from testbench.estimators.model import check_records
from testbench.estimators.parametric.kinematics import (
    ACCELEROMETERS,
    INPUTS,
    OUTPUTS,
    KinematicStructure,
    Motion,
    kinematics,
    motion_of,
)

__all__ = ["DataCompatibility", "InstrumentError", "correct", "estimate"]

_AS_LIKELY = 6.0  # difference of 2 ln likelihood below which lag and delay are not told apart
_WANDERING = 2.0
_LOCAL_GRAVITY = 0.05  # m/s2: gravity at sea level lies between 9.780 and 9.832


def estimate(
    records: Sequence[FlightRecord],
    *,
    motion: Motion | None = None,
    only: Collection[str] | None = None,
    without: Collection[str] = (),
    positions_m: Mapping[str, tuple[float, float, float]] | None = None,
    gravity_m_s2: float = G0_M_S2,
    false_alarm: float = 0.01,
) -> DataCompatibility:
    """Find the errors of the instruments of one or several records.

    All errors that the channels allow are estimated together. An error that the data do not tell is set aside with the
    reason: its standard error, or that of one believed before it, is above a third of what is plausible. Of the rest
    the least significant is dropped until all are significant, and those that are left are estimated again.

    Args:
        records: measured, with one sample time, not as deviations from trim.
        motion: "full", "longitudinal", "vertical" or "lateral" (see ``kinematics``); None takes the fullest.
        only: the errors to look for; None looks for all.
        without: errors that are known not to be there.
        positions_m: accelerometer -> position from the CG (forward, right, down), m; at the CG where not named.
        gravity_m_s2: g at the place of the flight; an error of it shows as a bias of the accelerometers.
        false_alarm: probability of finding any error if there is none.

    Raises:
        EstimationError: no record, a true one, different sample times, an unknown error, a record too short, or a
            motion that diverges.
        ChannelError: a record lacks a channel.
    """
    structure, problem, names = _prepare(records, motion, only, without, positions_m, gravity_m_s2, false_alarm)
    before = problem.residuals(*problem.start(())[:2])
    full = problem.solve(names, *problem.start(names))
    linear = linearise(problem, full, names)
    told, lost = identifiable(linear)
    threshold = float(norm.isf(0.5 * false_alarm / max(len(told), 1)))
    found, fit, linear_end = _reduce(problem, full, linear, told, threshold)
    found, fit, linear_end, timing = _lag_or_delay(problem, fit, linear_end, found)
    others = alternatives(linear_end, found)
    covariance = linear_end.covariance(found)[1]
    errors = tuple(
        _error(
            name,
            fit.values[name],
            float(np.sqrt(covariance[i, i])),
            (*timing.get(name, ()), *(in_words(*other) for other in others[name] if other[0] not in timing)),
        )
        for i, name in enumerate(found)
    )
    tested_values, _ = linear.solve(told)
    tested = tuple(
        _error(n, float(v), float(s)) for n, v, s in zip(told, tested_values, linear.errors(told), strict=True)
    )
    after = problem.residuals(fit.values, fit.x0)
    reconstructed = tuple(
        rebuild(r, s, structure, fit.values, x0) for r, s, x0 in zip(records, problem.stretches, fit.x0, strict=True)
    )
    doubts = _advice(structure, errors, lost, fit, false_alarm)
    doubts += _unsteady_air(problem, _rms(problem, after))
    doubts += too_long(structure, problem.stretches, records[0].dt_s)
    doubts += approximate("data compatibility") if errors else ()
    return DataCompatibility(
        structure=structure,
        errors=errors,
        covariance=covariance,
        tested=tested,
        not_identifiable=lost,
        reconstructed=reconstructed,
        residual_before=_rms(problem, before),
        residual_after=_rms(problem, after),
        settings={
            "motion": structure.motion,
            "candidates": list(names),
            "positions_m": {k: list(v) for k, v in structure.positions_m.items()},
            "gravity_m_s2": gravity_m_s2,
            "false_alarm": false_alarm,
        },
        diagnostics={
            "converged": fit.converged,
            "at_bound": list(fit.at_bound),
            "threshold": threshold,
            "whitening_orders": {n: int(w.a.size) for n, w in zip(structure.outputs, fit.whiteners, strict=True)},
            "initial_states": [x.tolist() for x in fit.x0],
        },
        advice=tuple(doubts),
    )


def _prepare(
    records: Sequence[FlightRecord],
    motion: Motion | None,
    only: Collection[str] | None,
    without: Collection[str],
    positions_m: Mapping[str, tuple[float, float, float]] | None,
    gravity_m_s2: float,
    false_alarm: float,
) -> tuple[KinematicStructure, Problem, tuple[str, ...]]:
    """Return the kinematics, the problem and the errors to look for, after checking what was given."""
    check_records(records, (), ())
    if not 0.0 < false_alarm < 1.0:
        raise EstimationError(f"0 < false_alarm < 1 must hold for a probability, got {false_alarm:g}")
    if not 0.0 < gravity_m_s2 < np.inf:
        raise EstimationError(f"gravity must be > 0 m/s2 and finite, got {gravity_m_s2:g}")
    common = [n for n in records[0].channels if all(n in r for r in records)]
    chosen = motion or motion_of(common)
    wanted = [n for n in common if n in (*INPUTS[chosen], *OUTPUTS[chosen], "pdot", "qdot", "rdot")]
    structure = kinematics(wanted, chosen, positions_m=positions_m, gravity_m_s2=gravity_m_s2)
    for record in records:
        if record.duration_s < 4.0 * (SETTLING_S + DELAY_LIMIT_S):
            raise EstimationError(
                f"data compatibility needs records of at least {4.0 * (SETTLING_S + DELAY_LIMIT_S):g} s, got "
                f"{record.duration_s:g} s"
            )
    possible = candidates(structure)
    for name in (*(only or ()), *without):
        if name not in possible:
            raise EstimationError(
                f"an error of {chosen} kinematics must be one of {', '.join(possible)}, got '{name}'"
                f"{nearest(name, possible)}"
            )
    names = tuple(n for n in possible if (only is None or n in only) and n not in without)
    return structure, Problem(structure, [stretch(r, structure) for r in records], records[0].dt_s), names


def _reduce(
    problem: Problem, full: Fit, linear: Linear, told: Sequence[str], threshold: float
) -> tuple[tuple[str, ...], Fit, Linear]:
    """Return the significant errors, their own fit, and the problem linear around it, whitened by its residuals."""
    found, fit = significant(linear, told, threshold), full
    while True:
        guess = dict(zip(found, linear.solve(found)[0].tolist(), strict=True))
        fit = problem.solve(found, guess, full.x0, full.whiteners)
        linear = linearise(problem, fit, linear.names)
        left = significant(linear, found, threshold)
        if left == tuple(found):
            return left, fit, linear
        found = left


def _lag_or_delay(
    problem: Problem, fit: Fit, linear: Linear, found: tuple[str, ...]
) -> tuple[tuple[str, ...], Fit, Linear, dict[str, tuple[str, ...]]]:
    """Put a lag in the place of each positive delay where that fits better; return also what fits as well, in words."""
    timing: dict[str, tuple[str, ...]] = {}
    for delay in [n for n in found if n.endswith("_delay") and fit.values[n] > 0.0]:
        lag = delay.replace("_delay", "_lag")
        names = tuple(lag if n == delay else n for n in found)
        other = problem.instead(fit, lag, delay)
        gain = _cost(problem, fit, fit) - _cost(problem, fit, other)
        candidates_now = tuple(lag if n == delay else n for n in linear.names)
        other_linear = linearise(problem, other, candidates_now)
        better, worse = (lag, delay) if gain > 0.0 else (delay, lag)
        there = (linear, fit, found) if worse == delay else (other_linear, other, names)
        if abs(gain) < _AS_LIKELY:
            error = float(there[0].errors(there[2])[there[2].index(worse)])
            timing[better] = (in_words(worse, there[1].values[worse], error),)
        if better == lag:
            fit = problem.solve(names, other.values, other.x0, other.whiteners)
            found, linear = names, linearise(problem, fit, candidates_now)
    return found, fit, linear, timing


def _cost(problem: Problem, whitened_by: Fit, at: Fit) -> float:
    parts = problem.whitened(whitened_by.whiteners, at.values, at.x0, ())
    return float(sum(np.sum(r**2) for r, _ in parts))


def _error(name: str, value: float, error: float, others: tuple[str, ...] = ()) -> InstrumentError:
    significance = abs(value - none_value(name)) / max(error, 1e-300)
    return InstrumentError(name, float(value), error, significance, in_words(name, value, error), others)


def _rms(problem: Problem, residuals: Sequence[FloatArray]) -> dict[str, float]:
    total = np.sum([np.sum(r**2, axis=0) for r in residuals], axis=0)
    rms = np.sqrt(total / np.maximum(problem.counts, 1))
    return dict(zip(problem.structure.outputs, rms.tolist(), strict=True))


def _unsteady_air(problem: Problem, rms: Mapping[str, float]) -> list[Advice]:
    """Return in words which air data wander far beyond the noise of their samples."""
    outputs = problem.structure.outputs
    noise = {n: noise_std(problem.stretches, outputs.index(n), False) for n in TIMED if n in outputs}
    wandering = [n for n, std in noise.items() if std > 0.0 and rms[n] > _WANDERING * std]
    if not wandering:
        return []
    said = (
        f"the residuals of {', '.join(wandering)} are more than {_WANDERING:g} times the noise of their samples: the "
        "air was not steady (turbulence), or something else is missing; some errors named may then be false, above all "
        "those of these channels; repeat in calm air, or believe only what several records agree on"
    )
    return [doubt("unsteady_air", said)]


def _advice(
    structure: KinematicStructure,
    errors: Sequence[InstrumentError],
    lost: Mapping[str, str],
    fit: Fit,
    false_alarm: float,
) -> list[Advice]:
    out = AdviceList()
    for e in errors:
        others = f"; these data also result if {', or if '.join(e.alternatives)}" if e.alternatives else ""
        out.doubt(INSTRUMENT_ERROR, f"{e.words} ({e.significance:.1f} standard errors){others}")
    if errors:
        out.note(
            "remove_first",
            "remove these errors before you estimate the aerodynamics; on records without errors this search names "
            f"one with probability {false_alarm:g}",
        )
        hidden = [n for n in lost if any(e.name in lost[n] for e in errors)]
        if hidden:
            out.doubt(
                "not_told_apart",
                f"these data cannot tell {', '.join(hidden)} from the errors named, which stand for both; "
                "manoeuvres that change attitude, speed and heading more would tell them apart",
            )
    small = [e.name for e in errors if e.name[:2] in ACCELEROMETERS and abs(e.estimate) < _LOCAL_GRAVITY]
    if small:
        out.doubt(
            "gravity",
            f"{', '.join(small)} may be gravity: {structure.gravity_m_s2:g} m/s2 was assumed, and gravity varies "
            "by 0.05 m/s2 over the earth; give the local value",
        )
    if not fit.converged:
        out.wrong(
            "not_converged",
            "the search did not converge: its values are rough; use shorter records or look for fewer errors",
        )
    if fit.at_bound:
        out.wrong("on_bound", f"{', '.join(fit.at_bound)} ended on a bound: the bound sets the value, not the data")
    return out
