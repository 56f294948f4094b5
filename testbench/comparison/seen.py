"""The linearised aircraft through a suite: what its sensors tell of parameters and modes, before anything is flown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from testbench.aircraft import Aircraft
from testbench.channels import CONTROLS
from testbench.design.aircraft_structure import AircraftStructure, Plane, aircraft_structure, held_accelerations
from testbench.design.information import Accuracy, Experiment, accuracy
from testbench.design.targets import Targets, needed_parameters, targets
from testbench.designer import elastic_modes
from testbench.errors import ChannelError, ScenarioError, nearest
from testbench.evaluation.modes import roots_of
from testbench.flight import LinearModel, TrimmedFlight
from testbench.inputs import build
from testbench.record import FloatArray
from testbench.scenario import Manoeuvre
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
        wanted_modes: names of the modes that are looked at, split roots by themselves.
        wanted: names of the parameters that are looked at.
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
        ChannelError: a sensor's channel is none of the linear model.
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
    """Return the parameters and modes that are looked at, as functions of the structure's parameters.

    Parameters whose true value is zero are left out: no relative error can be told of them.
    """
    true = dict(zip(structure.parameter_names, structure.true.tolist(), strict=True))
    parameters = {name: 1.0 for name in known.wanted if true[name] != 0.0}
    return targets(structure, parameters, {n: known.modes[n] for n in known.wanted_modes}, accuracies)


def wanted_modes(modes: Mapping[str, complex], asked: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the poles of the modes that are asked for: two of a mode that has split."""
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


@dataclass(frozen=True, eq=False)
class Prediction:
    """What an input tells through a suite.

    Attributes:
        names: (t,) quantities: parameters, "wn of ...", "zeta of ...".
        std: (t,) standard errors: percent of the true value, but absolute for damping ratios.
        without: sensor -> (t,) factor by which the errors grow if that sensor is left out; inf if nothing is left.
        known: standard errors and covariance of the free parameters.
    """

    names: tuple[str, ...]
    std: FloatArray
    without: Mapping[str, FloatArray]
    known: Accuracy

    def of(self, name: str) -> float | None:
        """Return the standard error of a quantity, or None if it is none of this prediction's."""
        return float(self.std[self.names.index(name)]) if name in self.names else None


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


def predict(
    known: Known,
    suite: SensorSuite,
    outputs: Sequence[str],
    manoeuvre: Manoeuvre,
    inputs: Sequence[str],
    bias: str = "trim",
) -> Prediction:
    """Return what a manoeuvre tells through a suite.

    With exactly known inputs this is the Cramer-Rao bound of the linearised aircraft. Noise of a measured input passes
    through the aircraft into the residuals. Output error takes it for noise of the sensors: it weighs each sensor i,
    whose information is M_i, by w_i = sigma_i^2 / (variance of its residual), and its covariance is
    M^-1 (sum_i w_i^2 M_i + sum_j Z_j' Z_j) M^-1 with M = sum_i w_i M_i, Z_j = sum_i w_i Z_ij (N, k) being the effect of
    each sample of the noise of input j, one sigma, on the score.

    Args:
        known: the aircraft, and what is looked at.
        suite: the sensors.
        outputs: those that are used; all if empty.
        manoeuvre: the input that is flown.
        inputs: channels that an estimator takes as inputs.
        bias: how their offsets are taken out, as in the preparation: noise in the undisturbed flight, or in all of it,
            leaves an offset behind.
    """
    sensors = sensors_of(suite, outputs)
    experiment, u = experiment_of(known, sensors, suite.rate_hz, manoeuvre)
    aims = targets_of(known, experiment.structure)
    parts = sensor_parts(experiment, u)
    noise = {name: suite.noise_std[name] for name in inputs if suite.noise_std[name] > 0.0}
    trim_samples = {"trim": round(manoeuvre.settle_s * suite.rate_hz), "mean": experiment.samples}.get(bias, 0)
    scores = _scores(known, experiment, u, noise, trim_samples)
    found = _accuracy(parts, scores)
    std = aims.errors(found)
    without = {}
    for i, sensor in enumerate(sensors):
        rest = [k for k in range(len(sensors)) if k != i]
        less = aims.errors(_accuracy(parts[rest], [Scores(s.effect[rest], s.variance[rest]) for s in scores]))
        with np.errstate(invalid="ignore"):
            without[sensor.channel] = less / std
    return Prediction(aims.names, std * in_percent(aims), without, found)


def sensor_parts(experiment: Experiment, u: FloatArray) -> FloatArray:
    """Return the information (p, k, k) of each sensor: where nothing but offsets is found along, it adds up."""
    W = _by_sensor(experiment, u)
    return np.asarray(np.einsum("tpi,tpj->pij", W, W))


def _by_sensor(experiment: Experiment, u: FloatArray) -> FloatArray:
    W = experiment.weighted(u)
    return W.reshape(-1, len(experiment.sensors), W.shape[1])


class Scores(NamedTuple):
    """What the noise of one measured input does, sensor by sensor.

    Attributes:
        effect: (p, N, k) effect of each of its samples, one sigma, on each sensor's score.
        variance: (p,) variance that it adds to each sensor's residual, in units of the sensor's own.
    """

    effect: FloatArray
    variance: FloatArray


def _scores(
    known: Known, experiment: Experiment, u: FloatArray, noise: Mapping[str, float], trim_samples: int
) -> list[Scores]:
    """Return what the noise of each noisy input does to the sensors' scores and residuals."""
    if not noise:
        return []
    structure = structure_seen(known, experiment.sensors, list(noise))
    moved = Experiment(structure, experiment.sensors, experiment.dt_s, experiment.samples, experiment.stride)
    W = _by_sensor(experiment, u)
    N = len(W)
    size = next_fast_len(2 * N, real=True)
    spectrum = rfft(W, size, axis=0)
    out = []
    for j, sigma in enumerate(noise.values()):
        pulse = np.zeros((N * experiment.stride, len(noise)))
        pulse[: experiment.stride, j] = sigma  # a sample that the recorder holds
        h = moved.response(pulse)[0] / experiment.sigma
        Z = irfft(np.conj(rfft(h, size, axis=0))[:, :, None] * spectrum, size, axis=0)[:N].transpose(1, 0, 2)
        if trim_samples:
            Z[:, :trim_samples] -= Z.sum(axis=1, keepdims=True) / trim_samples
        out.append(Scores(Z, np.sum(h**2, axis=0)))
    return out


def _accuracy(parts: FloatArray, scores: Sequence[Scores]) -> Accuracy:
    """Return what output error reaches through sensors of information ``parts`` (p, k, k) with noisy inputs."""
    if not scores:
        return accuracy(parts.sum(axis=0))
    weight = 1.0 / (1.0 + np.sum([s.variance for s in scores], axis=0))
    exact = accuracy(np.einsum("p,pij->ij", weight, parts))
    effects = [np.einsum("p,pnk->nk", weight, s.effect) for s in scores]
    middle = np.einsum("p,pij->ij", weight**2, parts) + np.sum([Z.T @ Z for Z in effects], axis=0)
    covariance = exact.covariance @ middle @ exact.covariance
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Accuracy(np.where(np.isinf(exact.std), np.inf, std), covariance)


def in_percent(aims: Targets) -> FloatArray:
    """Return the factors (t,) from errors of targets to percent of the true value; 1 for damping ratios."""
    ratio = np.array([name.startswith("zeta of ") for name in aims.names])
    return np.where(ratio, 1.0, 100.0 / np.abs(aims.values))
