"""The recorded flight through both aircraft: JSBSim from trim with the recorded inputs, in still air.

A record neither begins in equilibrium nor does it say where the equilibrium is. What is fitted to it, of both aircraft
alike, is the state that it begins with, a constant offset of each input and one of each output:

    y = y_JSBSim(u) + C Phi(t) x0 + C (integral Phi B + D) b + c,

by least squares, each output over its own size. Phi, B, C and D are of the linear model about trim of the same
aircraft, so that the nonlinear flight is right to first order in what is fitted. Nothing else is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.aircraft import Aircraft, SetProperty
from testbench.aircraft.seams import changed, control_path
from testbench.core.channels import CONTROLS
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.response import delayed
from testbench.flight import FlightCondition, LinearModel, Manoeuvre, TrimmedFlight, fly, linearise, trim
from testbench.inputs.signal import InputSignal
from testbench.line import Case
from testbench.questions.identify.amend.result import Replay

_LONGITUDINAL = ("u", "w", "q", "theta")
_LATERAL = ("v", "p", "r", "phi")
_OUTPUTS_LATERAL = {"beta", "v", "p", "r", "phi", "psi", "pdot", "rdot", "ay"}
_LEVERS = {"ax": ((1, "qdot", 1.0),), "az": ((0, "qdot", -1.0),), "ay": ((0, "rdot", 1.0), (1, "pdot", -1.0))}
"""Accelerometer -> (index in (forward, down), angular acceleration, sign) of what it reads away from the centre of
gravity."""
_SAME_RATE = 0.01
_QUICK_RAD_S = 1e4
_LONGEST = 100_000  # samples; an hour flown without a pilot says nothing more


def replays(
    case: Case, names: Sequence[tuple[str, str]], old: Aircraft, new: Aircraft, condition: FlightCondition
) -> tuple[Replay, ...]:
    """Return every record of a case through both aircraft.

    Args:
        case: its prepared records, the model's inputs and outputs.
        names: (name, use) of its identification and validation records, in this order.
        old: the aircraft as it was.
        new: the amended one.
        condition: that both are trimmed at.
    """
    records = (*case.identification, *case.validation)
    flyers: dict[tuple[str, float], _Flyer | str] = {}
    out = []
    for (name, use), whole in zip(names, records, strict=True):
        record = whole
        flown: dict[str, FloatArray | None] = {}
        notes: list[str] = []
        if len(record) > _LONGEST:
            record = record.between(float(record.t_s[0]), float(record.t_s[_LONGEST]))
            notes.append(f"{name}: the first {_LONGEST} samples are flown")
        for which, aircraft in (("before", old), ("after", new)):
            key = (which, round(record.dt_s, 12))
            if key not in flyers:
                flyers[key] = _flyer(case, aircraft, condition, record.dt_s)
            flyer = flyers[key]
            found = flyer if isinstance(flyer, str) else flyer.through(record)
            flown[which] = None if isinstance(found, str) else found
            if isinstance(found, str):
                notes.append(f"{name}: {aircraft.name} {found}")
        channels = case.model.outputs
        valid = record.valid[:, [record.channels.index(n) for n in channels]]
        measured = record.columns(channels)
        out.append(
            Replay(
                name, use, record.t_s - record.t_s[0], channels, measured, valid, flown["before"], flown["after"],
                tuple(notes),
            )
        )  # fmt: skip
    return tuple(out)


class _Flyer:
    """One aircraft at trim, ready to fly records of one sample time."""

    def __init__(self, case: Case, aircraft: Aircraft, condition: FlightCondition, dt_s: float) -> None:
        model = case.model
        self._inputs = tuple(n for n in model.inputs if n.removesuffix("_cmd") in CONTROLS)
        self._controls = tuple(n.removesuffix("_cmd") for n in self._inputs)
        held = getattr(model, "held", ())
        self._held = tuple(bool(h) for n, h in zip(model.inputs, held, strict=False) if n in self._inputs)
        self._late = np.array([_delay(case, n) for n in self._inputs])
        self._outputs = model.outputs
        self._lever = getattr(case.estimator, "accelerometer_m", (0.0, 0.0))
        self._steps = max(1, math.ceil(aircraft.rate_hz * dt_s - _SAME_RATE))
        bare = [n for n in self._inputs if not n.endswith("_cmd") and n != "thr"]
        self._aircraft = replace(_without_servos(aircraft, bare), limits={})
        self._trimmed: TrimmedFlight = trim(self._aircraft, condition, self._steps / dt_s)
        self._linear: LinearModel = linearise(self._aircraft, self._trimmed)

    def through(self, record: FlightRecord) -> FloatArray | str:
        """Return the outputs (n, p) as deviations, or why the flight ended before its time."""
        u = delayed(record.columns(self._inputs), record.dt_s, self._late)
        if record.provenance.get("prepared", {}).get("bias", "none") == "none":
            u = u - u.mean(axis=0)  # nobody has said where the equilibrium is; what is left of it is fitted
        frames = np.arange((len(record) - 1) * self._steps) / self._steps
        at = np.arange(len(record))
        held = np.column_stack(
            [
                u[frames.astype(int), i] if self._held[i] else np.interp(frames, at, u[:, i])
                for i in range(len(self._inputs))
            ]
        )
        of = [(self._aircraft.controls[n], self._trimmed.controls[n]) for n in self._controls]
        held = np.clip(held, [c.low - x for c, x in of], [c.full - x for c, x in of])
        signal = InputSignal(np.arange(len(held)) / self._trimmed.rate_hz, held, self._controls)
        needed = [n for c in self._outputs for n in (c, *(a for _, a, _ in _LEVERS.get(c, ())))]
        try:
            flown = fly(
                self._aircraft,
                self._trimmed,
                Manoeuvre("recorded inputs", signal, 0.0),
                1.0 / record.dt_s,
                list(dict.fromkeys(needed)),
            )
        except Refusal as error:
            return f"does not fly it to the end: {error.message}"
        y = np.column_stack([self._read(c, lambda n: flown[n] - self._trimmed.state[n]) for c in self._outputs])
        taken = record.valid[:, [record.channels.index(n) for n in self._outputs]]
        measured = record.columns(self._outputs)
        size = np.array([np.std(measured[taken[:, i], i]) if taken[:, i].any() else 0.0 for i in range(y.shape[1])])
        weight = taken / np.where(size > 0.0, size, 1.0)
        return np.asarray(y + self._fitted(measured - y, weight, record.dt_s))

    def _read(self, channel: str, of: Callable[[str], FloatArray]) -> FloatArray:
        """Return what an instrument reads: an accelerometer away from the centre of gravity feels the rotation."""
        out = of(channel)
        for index, name, sign in _LEVERS.get(channel, ()):
            if self._lever[index]:
                out = out + sign * self._lever[index] * of(name)
        return np.asarray(out)

    def _fitted(self, error: FloatArray, weight: FloatArray, dt_s: float) -> FloatArray:
        """Return (n, p) what initial state and constants explain of an error (n, p), with weights (n, p)."""
        from scipy.linalg import expm

        linear = self._linear
        n, size = len(error), len(linear.states)
        lateral = {name in _OUTPUTS_LATERAL for name in self._outputs}
        began = [s for k, group in ((False, _LONGITUDINAL), (True, _LATERAL)) if k in lateral for s in group]
        rows = {name: linear.C[i] for i, name in enumerate(linear.outputs)}
        fed = {name: linear.D[i] for i, name in enumerate(linear.outputs)}
        columns = [linear.inputs.index(name) for name in self._linear_inputs()]
        C = np.array([self._read(c, rows.__getitem__) for c in self._outputs])
        D = np.array([self._read(c, fed.__getitem__) for c in self._outputs])[:, columns]
        m = len(columns)
        whole = np.zeros((size + m, size + m))
        whole[:size, :size], whole[:size, size:] = linear.A, linear.B[:, columns]
        step = expm(whole * dt_s)
        x = np.zeros((size + m, len(began) + m))
        for k, name in enumerate(began):
            x[linear.states.index(name), k] = 1.0
        x[size:, len(began) :] = np.eye(m)
        read = np.hstack([C, D])
        parts = np.empty((n, len(self._outputs), x.shape[1]))
        for i in range(n):
            parts[i] = read @ x
            x = step @ x
        constants = np.broadcast_to(np.eye(len(self._outputs)), (n, len(self._outputs), len(self._outputs)))
        J = np.concatenate([parts, constants], axis=2)
        left = (J * weight[:, :, None]).reshape(-1, J.shape[2])
        norm = np.linalg.norm(left, axis=0)
        norm[norm == 0.0] = 1.0
        found = np.linalg.lstsq(left / norm, (error * weight).ravel(), rcond=1e-9)[0] / norm
        return np.asarray(J @ found)

    def _linear_inputs(self) -> tuple[str, ...]:
        return tuple(n if n in self._linear.inputs else n.removesuffix("_cmd") for n in self._inputs)


def _flyer(case: Case, aircraft: Aircraft, condition: FlightCondition, dt_s: float) -> _Flyer | str:
    try:
        return _Flyer(case, aircraft, condition, dt_s)
    except Refusal as error:
        return f"cannot be flown there: {error.message}"


def _delay(case: Case, name: str) -> float:
    """Return the delay of an input that its estimate was made with, s."""
    estimator, model = case.estimator, case.model
    servo = getattr(estimator, "servo", {}).get(name)
    said = 0.0 if servo is None or servo.ignore else servo.delay_s
    if said == "estimate":
        values: Mapping[str, float] = getattr(model, "values", {})
        said = values.get(f"T_{name.removesuffix('_cmd')}", 0.0)
    return float(getattr(estimator, "delays_s", {}).get(name, 0.0)) + float(said)


def _without_servos(aircraft: Aircraft, controls: Sequence[str]) -> Aircraft:
    """Return the aircraft with surfaces that are where their commands are: these were measured."""
    for control in controls:
        if control not in aircraft.controls:
            continue
        path = control_path(aircraft, control)
        if aircraft.adapter is not None:
            links = tuple(
                replace(x, lag_rad_s=None, rate_limit_rad_s=None) if x.control == control else x
                for x in aircraft.adapter.links
            )
            aircraft = replace(aircraft, adapter=replace(aircraft.adapter, links=links))
        elif path.lag is not None and path.rate_limit is not None:
            quick = (SetProperty(path.lag, _QUICK_RAD_S), SetProperty(path.rate_limit, _QUICK_RAD_S))
            aircraft = changed(aircraft, f"{control} measured", "no servo before a measured surface", *quick)
    return aircraft
