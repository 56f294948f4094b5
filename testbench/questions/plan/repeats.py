"""How many runs give a wanted accuracy, from the Fisher information of one: repeats = ceil((std / wanted)^2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Input
from testbench.flight import LinearModel
from testbench.information.aircraft_structure import Plane, aircraft_structure, parameter_names
from testbench.information.fisher import Experiment, accuracy
from testbench.information.targets import needed_parameters
from testbench.questions.plan.result import Point, Reached
from testbench.questions.plan.scenario import PlannedManoeuvre, commanded
from testbench.sensors import SensorSuite

_USABLE = {
    "longitudinal": ("V", "u", "w", "alpha", "q", "theta", "ax", "az", "qdot", "h"),
    "lateral": ("v", "beta", "p", "r", "phi", "ay", "pdot", "rdot"),
}
_FINE_HZ = 50.0  # the input is sampled at least this finely however slow the sensors are


def known_parameters(aircraft: Aircraft, plane: Plane, modes: Sequence[int]) -> tuple[str, ...]:
    """Return every name that ``accuracy_percent`` may hold for manoeuvres in a plane."""
    return parameter_names(tuple(aircraft.controls), plane, modes)


def plane_modes(aircraft: Aircraft, plane: Plane) -> tuple[int, ...]:
    """Return the numbers (from 1) of the elastic modes that take part in a motion."""
    flown = aircraft.flown_modes()
    symmetry = "symmetric" if plane == "longitudinal" else "asymmetric"
    return tuple(i for i, m in enumerate(flown.modes if flown else (), 1) if m.symmetry == symmetry)


def command_names(model: LinearModel, controls: Sequence[str]) -> tuple[str, ...]:
    """Return the inputs of the linear model that are commanded: through the servo if there is one."""
    return tuple(f"{c}_cmd" if f"{c}_cmd" in model.inputs else c for c in controls)


def reach(
    point: Point,
    spec: PlannedManoeuvre,
    inputs: Sequence[Input],
    suite: SensorSuite,
    modes: Sequence[int],
    period_ms: int | None = None,
) -> tuple[int, tuple[Reached, ...]]:
    """Return the repeats of a manoeuvre at a point, and the accuracy of every parameter of ``accuracy_percent``.

    The wanted parameters are estimated together with those of ``estimated``, and offsets of the sensors are unknown.
    Sensors of other motions, off the centre of gravity or without noise are left out. With n runs of the same input the
    information is n times that of one. A script holds each command for ``period_ms``.

    Raises:
        EstimationError: no sensor of the suite shows this motion, or the linearised aircraft diverges.
    """
    wanted = {name: percent / 100.0 for name, percent in spec.accuracy_percent.items()}
    plane = spec.plane
    elastic = sorted({int(n.rsplit("_", 1)[0][1:]) for n in wanted if n[0] == "Q"} | _numbers(wanted))
    along = spec.estimated or needed_parameters(plane, spec.controls, plane == "longitudinal", elastic)
    free = tuple(dict.fromkeys((*along, *wanted)))
    sensors = tuple(
        s
        for s in suite.sensors
        if s.channel in _USABLE[plane] and not any(s.position_m) and (s.noise_std > 0.0 or s.quantum > 0.0)
    )
    if not sensors:
        raise EstimationError(
            f"suite '{suite.name}' has no sensor of the {plane} motion with noise of its own; give repeats instead of "
            "accuracy_percent, or another suite"
        )
    structure = aircraft_structure(
        point.model,
        point.V_m_s,
        point.trimmed.alpha,
        plane,
        modes,
        command_names(point.model, spec.controls),
        [s.channel for s in sensors],
        free,
    )
    stride = max(1, math.ceil(_FINE_HZ / suite.rate_hz))
    rate = suite.rate_hz * stride
    samples = int((spec.settle_s + spec.duration_s) * suite.rate_hz)
    u = _sampled(spec, inputs, rate, samples * stride, period_ms)
    std = accuracy(Experiment(structure, sensors, 1.0 / rate, samples, stride).information(u)).std
    return repeats_for(free, std / np.maximum(np.abs(structure.true), 1e-300), wanted, spec.most_repeats)


def repeats_for(
    names: Sequence[str], relative: FloatArray, wanted: dict[str, float], most: int
) -> tuple[int, tuple[Reached, ...]]:
    """Return the repeats, at most ``most``, and their accuracy, from relative standard errors (k,) of one run."""
    one = {name: float(relative[list(names).index(name)]) for name in wanted}
    needed = {
        name: math.ceil((one[name] / wanted[name]) ** 2 - 1e-9) if math.isfinite(one[name]) else None for name in wanted
    }
    repeats = min(most, max(1, *(n for n in needed.values() if n is not None))) if any(needed.values()) else 1
    found = tuple(
        Reached(name, wanted[name], one[name], one[name] / math.sqrt(repeats), needed[name]) for name in wanted
    )
    return repeats, found


def _numbers(names: dict[str, float]) -> set[int]:
    """Return the modes that frequencies, damping ratios and couplings of these names belong to."""
    out = set()
    for name in names:
        head, tail = name.rsplit("_", 1)
        if head in ("omega", "zeta"):
            out.add(int(tail))
        if tail.startswith("eta"):
            out.add(int(tail[3:]))
    return out


def _sampled(
    spec: PlannedManoeuvre, inputs: Sequence[Input], rate_hz: float, samples: int, period_ms: int | None
) -> FloatArray:
    """Return the input (samples, m) after its settling time, in the order of ``spec.controls``."""
    signal = commanded(inputs, spec.duration_s, rate_hz, period_ms)
    u = np.zeros((samples, len(spec.controls)))
    start = round(spec.settle_s * rate_hz)
    rows = min(samples - start, len(signal.u))
    for j, name in enumerate(spec.controls):
        u[start : start + rows, j] = signal.u[:rows, signal.channels.index(name)]
    return u
