"""What is known of a simulated aircraft: its linear model, its modes, and what an input does to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.structured import STRUCTURE_NAMES
from testbench.evaluation import TrueSystem
from testbench.evaluation.derivatives import dimensional_derivatives, true_parameters
from testbench.evaluation.excitation import ModeExcitation, excitation
from testbench.evaluation.metrics import zero_order_hold
from testbench.evaluation.modes import lateral_modes, longitudinal_modes
from testbench.flight import LinearModel, TrimmedFlight, linearise
from testbench.inputs.signal import energy_spectrum
from testbench.sensors import SensorSuite


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of a simulated aircraft: its linear model at trim, its modes, and what the input does to them.

    ``modes`` are those of the motions that the inputs of an identification drive.
    """

    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    modes: Mapping[str, complex]
    excitation: tuple[ModeExcitation, ...]

    def response(
        self,
        omega_rad_s: FloatArray,
        outputs: Sequence[str],
        inputs: Sequence[str],
        dt_s: float,
        continuous: bool = False,
    ) -> Any:
        """Return the true response (k, p, m) as a discrete or a ``continuous`` model should have it.

        A command is held from sample to sample, and the hold is part of a discrete model; a measured deflection has
        passed the servo and is smooth between its samples, so no hold belongs to it.
        """
        H = self.linear.frequency_response(omega_rad_s, outputs, inputs)
        if continuous:
            return H
        held = np.array([name.endswith("_cmd") for name in inputs])
        hold = zero_order_hold(omega_rad_s, dt_s)
        return np.where(held, hold[:, None, None] * H, H)


def true_model(aircraft: Aircraft, trimmed: TrimmedFlight, inputs: Sequence[str] = ()) -> Truth:
    """Return the linear model and modes of an aircraft at trim, without the excitation by an input.

    Args:
        aircraft: what flies.
        trimmed: where.
        inputs: input channels of the identification. Aileron and rudder drive the lateral-directional motion, whose
            modes come last; all others, or none, the longitudinal one.
    """
    linear = linearise(aircraft, trimmed)
    modes: dict[str, complex] = {}
    if _longitudinal(inputs):
        modes |= longitudinal_modes(linear, _symmetric(aircraft))
    if _lateral(inputs):
        modes |= lateral_modes(linear, _antisymmetric(aircraft))
    return Truth(aircraft, trimmed, linear, modes, ())


def _lateral(inputs: Sequence[str]) -> bool:
    return any(n.removesuffix("_cmd") in ("da", "dr") for n in inputs)


def _longitudinal(inputs: Sequence[str]) -> bool:
    return not inputs or any(n.removesuffix("_cmd") not in ("da", "dr") for n in inputs)


def excited(known: Truth, flight: FlightRecord, inputs: Sequence[str], suites: Sequence[SensorSuite]) -> Truth:
    """Return the truth with what the inputs of a flight do to each mode.

    Args:
        known: of :func:`true_model`.
        flight: the truth of the flight.
        inputs: (m,) input channels of the identification.
        suites: their sensors, without those of the inputs, should show the modes above their noise.
    """
    controls = [n.removesuffix("_cmd") for n in inputs]
    u = flight.columns(controls)
    sensors = {s.channel: s.noise_std for suite in suites for s in suite.sensors if s.channel not in inputs}
    dt_s = 1.0 / suites[0].rate_hz
    used = {n: (s, dt_s) for n, s in sensors.items() if s > 0.0 and n in known.linear.outputs}
    motions = []
    if _longitudinal(inputs):
        motions.append((known.linear.longitudinal(tuple(_symmetric(known.aircraft))), False))
    if _lateral(inputs):
        motions.append((known.linear.lateral(tuple(_antisymmetric(known.aircraft))), True))
    sideways = _lateral_names(known)
    found = []
    for motion, lateral in motions:
        found += excitation(
            motion,
            {name: pole for name, pole in known.modes.items() if (name in sideways) == lateral},
            controls,
            u - u[0],
            flight.dt_s,
            used,
            flight.duration_s,
        )
    return replace(known, excitation=tuple(found))


def _lateral_names(known: Truth) -> set[str]:
    elastic = set(_antisymmetric(known.aircraft).values())
    rigid = {"Dutch roll", "roll", "spiral", "lateral phugoid"}
    return {name for name in known.modes if name.partition(",")[0] in rigid | elastic}


def _symmetric(aircraft: Aircraft) -> dict[int, str]:
    elastic = aircraft.flown_modes()
    return {i: m.name for i, m in enumerate(elastic.modes if elastic else (), 1) if m.symmetry == "symmetric"}


def _antisymmetric(aircraft: Aircraft) -> dict[int, str]:
    elastic = aircraft.flown_modes()
    return {i: m.name for i, m in enumerate(elastic.modes if elastic else (), 1) if m.symmetry != "symmetric"}


def told_of(truth: Truth, model: IdentifiedModel, records: Sequence[FlightRecord]) -> TrueSystem:
    """Return what evaluation may use of the truth: poles, and the response over the band that the input excites."""
    omega = excited_band(records, model.inputs)
    response = truth.response(omega, model.outputs, model.inputs, model.dt_s, model.continuous)
    structure = getattr(model, "structure", None)
    known = None
    if structure is not None:
        derivatives = dimensional_derivatives(truth.linear, truth.trimmed)
        known = true_parameters(structure.meaning, derivatives, truth.trimmed.condition.V_m_s)
    shown = {e.mode for e in truth.excitation if e.excited} if truth.excitation else None
    return TrueSystem(_possible(truth, structure), response, omega, known, shown)


def _possible(truth: Truth, structure: Any) -> dict[str, complex]:
    """Return the true modes that a model can have: a packaged structure has those of its states, another model all.

    Without airspeed and pitch angle there is no phugoid, without bank angle no spiral, and without elastic states no
    elastic mode; a structure of one motion has no mode of the other. That they are not found is no news.
    """
    if structure is None or structure.name not in STRUCTURE_NAMES:
        return dict(truth.modes)
    states, without = set(structure.states), set()
    if "q" not in states:
        without |= {"phugoid", "short period"}
    if not {"V", "theta"} <= states:
        without.add("phugoid")
    if "p" not in states:
        without |= {"Dutch roll", "roll", "spiral", "lateral phugoid"}
    if "phi" not in states:
        without |= {"spiral", "lateral phugoid"}
    if not {"beta", "v"} & states:
        without.add("Dutch roll")
    if not any(s.startswith("eta_") for s in structure.states):
        without |= {*_symmetric(truth.aircraft).values(), *_antisymmetric(truth.aircraft).values()}
    return {name: pole for name, pole in truth.modes.items() if name.partition(",")[0] not in without}


@lru_cache(maxsize=4)  # every method and suite is judged over the same inputs, one after the other
def _density(u: bytes, columns: int, dt_s: float, omega: bytes) -> FloatArray:
    """Return the energy density of all inputs together, of which the arrays' bytes are given."""
    density = energy_spectrum(np.frombuffer(u).reshape(-1, columns), dt_s, np.frombuffer(omega)).sum(axis=1)
    density.setflags(write=False)
    return density


def excited_band(records: Sequence[FlightRecord], inputs: Sequence[str], floor: float = 0.01) -> FloatArray:
    """Return 60 frequencies, rad/s, over the band where the inputs' energy density exceeds ``floor`` of its peak."""
    dt = records[0].dt_s
    omega = np.geomspace(0.1, 0.8 * np.pi / dt, 400)
    driven = [np.ascontiguousarray(r.columns(inputs), float) for r in records]
    density = np.sum([_density(u.tobytes(), len(inputs), dt, omega.tobytes()) for u in driven], axis=0)
    inside = omega[density >= floor * density.max()]
    return np.geomspace(inside[0], inside[-1], 60)
