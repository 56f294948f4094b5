"""The linearised aircraft as a suite shows it, and the experiment of a manoeuvre with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.core.errors import ChannelError, ScenarioError, nearest
from testbench.core.record import FloatArray
from testbench.core.scenario.base import Manoeuvre
from testbench.evaluation.modes import roots_of
from testbench.flight import LinearModel, TrimmedFlight
from testbench.information.aircraft_structure import AircraftStructure, Plane, aircraft_structure, held_accelerations
from testbench.information.fisher import Experiment
from testbench.information.modes import elastic_modes
from testbench.information.targets import Targets, needed_parameters, targets
from testbench.inputs import build
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import ACCELEROMETERS, whole_ratio

_LEAST_INPUT_RATE_HZ = 40.0


@dataclass(frozen=True, eq=False)
class Known:
    """What is compared, of one aircraft at one condition.

    Attributes:
        aircraft, trimmed, linear: what flies.
        plane: which motion.
        modes: name -> pole of all modes of the plane, rad/s.
        wanted_modes: names of the target modes, split roots by themselves.
        wanted: names of the target parameters.
        free: all parameters that are unknown.
    """

    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    plane: Plane
    modes: Mapping[str, complex]
    wanted_modes: tuple[str, ...]
    wanted: tuple[str, ...]
    free: tuple[str, ...]

    @property
    def trim(self) -> dict[str, float]:
        """Value of every channel of the linear model in trimmed flight, SI; zero where it is not kept."""
        c = self.trimmed.condition
        known = {"V": c.V_m_s, "alpha": self.trimmed.alpha, "qbar": c.qbar_Pa}
        return dict.fromkeys(self.linear.outputs, 0.0) | dict(self.trimmed.state) | dict(self.trimmed.controls) | known


def unknowns(
    aircraft: Aircraft, plane: Plane, controls: Sequence[str], modes: Sequence[str], parameters: Sequence[str]
) -> tuple[str, ...]:
    """Return the parameters that must be free for modes and parameters to be found."""
    numbers = [
        i
        for i, name in elastic_modes(aircraft, plane).items()
        if name in modes or any(f"_{i}" in p or f"Q{i}_" in p for p in parameters)
    ]
    moved = [c for c in CONTROLS if c in controls]
    return tuple(dict.fromkeys([*needed_parameters(plane, moved, "phugoid" in modes, numbers), *parameters]))


def structure_seen(known: Known, sensors: Sequence[Sensor], inputs: Sequence[str]) -> AircraftStructure:
    """Return the linearised aircraft with what the sensors feel, lags and delays apart, as its outputs.

    Raises:
        ChannelError: a sensor's channel is not in the linear model.
        EstimationError: an accelerometer feels more than accelerations.
    """
    model = model_seen(known.linear, sensors, known.trim)
    felt = [s.channel for s in sensors if s.channel in ACCELEROMETERS or s.channel.startswith("az_wing_")]
    return aircraft_structure(
        model,
        known.trimmed.condition.V_m_s,
        known.trimmed.alpha,
        known.plane,
        list(elastic_modes(known.aircraft, known.plane)),
        list(inputs),
        [s.channel for s in sensors],
        known.free,
        {name: held_accelerations(model, name) for name in felt},
    )


def model_seen(linear: LinearModel, sensors: Sequence[Sensor], trim: Mapping[str, float]) -> LinearModel:
    """Return the linear model with the rows of the sensors' channels as the sensors feel them.

    Raises:
        ChannelError: the linear model lacks a channel.
    """
    C, D = linear.C.copy(), linear.D.copy()
    for sensor in sensors:
        for name in sensor.needs:
            if name not in linear.outputs:
                raise ChannelError(
                    f"the linear model has no channel '{name}', which sensor '{sensor.channel}' needs"
                    + nearest(name, linear.outputs)
                )
        weights = sensor.weights(trim)
        rows, w = [linear.outputs.index(n) for n in weights], np.array([*weights.values()])
        k = linear.outputs.index(sensor.channel)
        C[k], D[k] = w @ linear.C[rows], w @ linear.D[rows]
    return replace(linear, C=C, D=D)


def targets_of(known: Known, structure: AircraftStructure, accuracies: tuple[float, float] = (0.02, 0.02)) -> Targets:
    """Return the target parameters and modes, as functions of the structure's parameters.

    Parameters whose true value is zero are left out, because they have no relative error.
    """
    true = dict(zip(structure.parameter_names, structure.true.tolist(), strict=True))
    parameters = {name: 1.0 for name in known.wanted if true[name] != 0.0}
    return targets(structure, parameters, {n: known.modes[n] for n in known.wanted_modes}, accuracies)


def wanted_modes(modes: Mapping[str, complex], asked: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the poles of the wanted modes: two for a mode that has split."""
    return tuple(name for mode in asked for name in roots_of(modes, mode))


def input_of(manoeuvre: Manoeuvre, controls: Sequence[str], rate_hz: float) -> FloatArray:
    """Return the commands (n, m) of a manoeuvre as deviations from trim, held at ``rate_hz``, settling included."""
    signal = build(manoeuvre.input, manoeuvre.duration_s, rate_hz)
    settle = round(manoeuvre.settle_s * rate_hz)
    u = np.zeros((settle + signal.t_s.size, len(controls)))
    for j, name in enumerate(controls):
        if name in signal.channels:
            u[settle:, j] = signal.u[:, signal.channels.index(name)]
    return u


def sensors_of(suite: SensorSuite, outputs: Sequence[str]) -> tuple[Sensor, ...]:
    """Return the sensors of the motion that are used: those of ``outputs``, or all if that is empty."""
    return tuple(s for s in suite.sensors if s.channel in suite.outputs and (not outputs or s.channel in outputs))


def experiment_of(
    known: Known, sensors: Sequence[Sensor], suite_rate_hz: float, manoeuvre: Manoeuvre
) -> tuple[Experiment, FloatArray]:
    """Return the experiment of one manoeuvre through sensors, and its input (samples, m).

    The commands move the aircraft through its servos; sensors have an unknown offset each; the flight begins in trim.
    A recorder whose clock is late delays its sensors; one that is ahead of the others is taken as in time.
    """
    controls = [c for c in CONTROLS if any(i.control == c for i in manoeuvre.input)]
    inputs = [f"{c}_cmd" if f"{c}_cmd" in known.linear.inputs else c for c in controls]
    structure = structure_seen(known, sensors, inputs)
    stride, u = _sampled(manoeuvre, controls, suite_rate_hz, known.trimmed.rate_hz)
    rate = stride * suite_rate_hz
    samples = len(u) // stride
    late = tuple(replace(s, delay_s=max(s.delay_s + s.clock_offset_s, 0.0)) for s in sensors)
    return Experiment(structure, late, 1.0 / rate, samples, stride), u[: samples * stride]


def _sampled(
    manoeuvre: Manoeuvre, controls: Sequence[str], suite_rate_hz: float, simulation_rate_hz: float
) -> tuple[int, FloatArray]:
    """Return the input at the lowest multiple of the suite's rate that shows it, and that multiple.

    Raises:
        ScenarioError: not even the simulation's rate does.
    """
    most = whole_ratio(simulation_rate_hz, suite_rate_hz) or 1
    strides = [k for k in range(1, most + 1) if most % k == 0 and (k * suite_rate_hz >= _LEAST_INPUT_RATE_HZ)]
    for k in strides[:-1]:
        try:
            return k, input_of(manoeuvre, controls, k * suite_rate_hz)
        except ScenarioError:
            continue  # too coarse for this signal
    k = (strides or [most])[-1]
    return k, input_of(manoeuvre, controls, k * suite_rate_hz)


def sensor_parts(experiment: Experiment, u: FloatArray) -> FloatArray:
    """Return the information (p, k, k) of each sensor: where nothing but offsets is found along, it adds up."""
    W = experiment.weighted(u)
    W = W.reshape(-1, len(experiment.sensors), W.shape[1])
    return np.asarray(np.einsum("tpi,tpj->pij", W, W))


def in_percent(aims: Targets) -> FloatArray:
    """Return the factors (t,) from errors of targets to percent of the true value; 1 for damping ratios."""
    ratio = np.array([name.startswith("zeta of ") for name in aims.names])
    return np.where(ratio, 1.0, 100.0 / np.abs(aims.values))
