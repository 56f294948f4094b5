"""What a manoeuvre tells through a suite, before anything is flown: the linear aircraft, noise of all instruments.

Can a bound be believed that takes the model as linear in its parameters over the errors that it predicts?

Along each principal direction d_i of the predicted covariance, one standard error long, the response and the targets
bend by

    c_i = (y(p + d_i) + y(p - d_i)) / 2 - y(p),

which moves an estimate by e_i z^2, z standard normal, e_i being the estimator's answer to c_i: terms of second order,
as of M. J. Box, Journal of the Royal Statistical Society B 33(2), 1971. Their share of the standard error,
(2 sum e_i^2)^1/2 over it, says how far it can be believed. Terms of two directions at once are left out.

The best case: maximum likelihood that knows the aircraft's equations and instruments, started at the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.core.errors import ScenarioError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import Manoeuvre
from testbench.estimators.parametric import input_noise
from testbench.estimators.parametric.input_noise import Whitening
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices
from testbench.evaluation.modes import roots_of
from testbench.flight import LinearModel, TrimmedFlight
from testbench.information.aircraft_structure import AircraftStructure, Plane, seen_by
from testbench.information.fisher import Accuracy, Experiment, accuracy
from testbench.information.targets import Targets, targets
from testbench.inputs import build
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import whole_ratio

_LEAST_INPUT_RATE_HZ = 40.0
_MOST_ITERATIONS = 30  # some ten are enough from the truth, unless the sensors do not tell the parameters


@dataclass(frozen=True, eq=False, kw_only=True)
class LaggedStructure(LinearStructure):
    """The linearised aircraft through first-order lags: tau y' + y = C x + D u where tau > 0."""

    base: AircraftStructure  # the aircraft
    lags_s: FloatArray  # (p,) time constants, 0 for none

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        m = self.base.matrices(params)
        late = np.flatnonzero(self.lags_s > 0.0)
        shape, n, k = m.A.shape[:-2], m.A.shape[-1], late.size
        rate = 1.0 / self.lags_s[late][:, None]
        A = np.zeros((*shape, n + k, n + k), m.A.dtype)
        A[..., :n, :n] = m.A
        A[..., n:, :n] = m.C[..., late, :] * rate
        A[..., n:, n:] = -np.diag(rate[:, 0])
        B = np.concatenate([m.B, m.D[..., late, :] * rate], axis=-2)
        C = np.concatenate([m.C, np.zeros((*m.C.shape[:-1], k), m.C.dtype)], axis=-1)
        D = m.D.copy()
        C[..., late, :], D[..., late, :] = 0.0, 0.0
        C[..., late, n + np.arange(k)] = 1.0
        bx = np.concatenate([m.bx, np.zeros((*shape, k), m.bx.dtype)], axis=-1)
        return Matrices(A, B, C, D, bx, m.by)

    @property
    def true(self) -> FloatArray:
        """(k,) true values of the parameters."""
        return self.base.true


def lagged_structure(known: Known, sensors: tuple[Sensor, ...], inputs: tuple[str, ...]) -> LaggedStructure:
    """Return the aircraft as the sensors show it, delays apart."""
    base = known.seen_by(sensors, inputs)
    lags = np.array([s.lag_s for s in sensors])
    return LaggedStructure(
        name="linearised aircraft through its sensors",
        states=(*base.states, *(f"lag_{s.channel}" for s in sensors if s.lag_s > 0.0)),
        inputs=base.inputs,
        outputs=base.outputs,
        parameters=base.parameters,
        base=base,
        lags_s=lags,
    )


def best_estimate(record: FlightRecord, structure: LaggedStructure, suite: SensorSuite) -> ParametricModel:
    """Return the maximum-likelihood estimate from a prepared record, with known noise of outputs and inputs.

    Offsets of the sensors and of noisy inputs are estimated with the parameters.

    Raises:
        EstimationError: the record does not tell them.
    """
    outputs = {name: suite.noise_std[name] for name in structure.outputs}
    noise = noisy_inputs(suite, structure.inputs)
    return input_noise.estimate(record, structure, outputs, noise, max_iterations=_MOST_ITERATIONS)


def noisy_inputs(suite: SensorSuite, inputs: Sequence[str]) -> dict[str, float]:
    """Return the standard deviations of those inputs that have noise."""
    return {name: suite.noise_std[name] for name in inputs if suite.noise_std[name] > 0.0}


def aircraft_poles(model: ParametricModel) -> np.ndarray:
    """Return the poles of the aircraft alone, rad/s, without those of its sensors."""
    structure = model.structure
    assert isinstance(structure, LaggedStructure)
    return np.asarray(np.linalg.eigvals(structure.base.matrices(model.params).A), np.complex128)


Answer = Callable[[FloatArray], FloatArray]


def second_order_share(
    response: Callable[[FloatArray], FloatArray],
    structure: AircraftStructure,
    aims: Targets,
    known: Accuracy,
    answer: Answer,
) -> FloatArray:
    """Return the terms of second order over the standard errors (t,) of the targets; inf where nothing is known.

    Args:
        response: parameters (k,) -> outputs (N, p) in units of the sensors' noise; not finite where the aircraft
            diverges.
        structure: the aircraft.
        aims: the targets.
        known: predicted errors of the parameters.
        answer: what the estimator makes of residuals (N, p, r) in units of the sensors' noise: errors (k, r).
    """
    std = aims.errors(known)
    if not np.all(np.isfinite(known.std)):
        return np.full(std.size, np.inf)
    size = known.std
    values, vectors = np.linalg.eigh(known.covariance / np.outer(size, size))
    directions = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    true = structure.true
    y0 = response(true)
    bends, turns = [], []
    for d in directions.T:
        bends.append(0.5 * (response(true + d) + response(true - d)) - y0)
        if not np.all(np.isfinite(bends[-1])):  # within its errors the aircraft may diverge
            return np.full(std.size, np.inf)
        f0, up, down = (aims.at(structure, p) for p in (true, true + d, true - d))
        turns.append(0.5 * (up + down) - f0)
    moved = answer(np.stack(bends, axis=2))
    squares = np.sum((aims.jacobian @ moved + np.stack(turns, axis=1)) ** 2, axis=1)
    return np.asarray(np.sqrt(2.0 * squares) / std)


FAR = 0.5
"""Share of second order up to which a standard error is believed: its square adds a quarter to the variance."""
_LEAST_HZ = 40.0  # rate at which commands are looked at, at least
_LOST = 1e-10  # singular values of the offsets' information below this share of the largest are none


@dataclass(frozen=True, eq=False)
class Prediction:
    """What an input tells through a suite."""

    names: tuple[str, ...]  # (t,) quantities: parameters, "wn of ...", "zeta of ..."
    values: FloatArray  # (t,) their true values, SI
    std: FloatArray  # (t,) standard errors in ``units``
    # (t,) "%" of the true value; "" of damping ratios; SI where the truth is near zero (:mod:`.near_zero`)
    units: tuple[str, ...]
    # (t,) terms of second order over those errors (:mod:`.prediction`); above :data:`FAR` the errors are too large, or
    # the model too far from linear over them, to be believed
    beyond: FloatArray
    # sensor -> (t,) factor by which the errors grow if that sensor is left out; inf if nothing is left
    without: Mapping[str, FloatArray]
    known: Accuracy  # standard errors and covariance of the free parameters

    def of(self, name: str) -> float | None:
        """Return the standard error of a quantity, or None if it is not one of this prediction's."""
        return float(self.std[self.names.index(name)]) if name in self.names else None

    def near(self, name: str) -> bool:
        """Say whether the standard error of a quantity is one of this prediction's, and can be believed."""
        return name in self.names and bool(self.beyond[self.names.index(name)] <= FAR)


def predict(
    known: Known, suite: SensorSuite, outputs: Sequence[str], manoeuvre: Manoeuvre, inputs: Sequence[str]
) -> Prediction:
    """Return what a manoeuvre tells through a suite.

    With exactly known inputs this is the Cramer-Rao bound of the linearised aircraft. Noise of a measured input passes
    through the aircraft into all outputs at once: their covariance, in units of the sensors' noise, is Omega^-1 =
    I + H H' (``estimators.parametric.input_noise``), and the information W' Omega W, W being the sensitivities (N p, k)
    with offsets of sensors and of noisy inputs projected out. What the noise itself says of the parameters is left out.

    Args:
        known: the aircraft and the targets.
        suite: the sensors.
        outputs: those that are used; all if empty.
        manoeuvre: the input that is flown.
        inputs: channels that an estimator takes as inputs.
    """
    sensors = suite.sensing(outputs)
    experiment, u = experiment_of(known, sensors, suite.rate_hz, manoeuvre)
    aims = targets_of(known, experiment.structure)
    S, taken, sigma = experiment.sensitivities(u), experiment.taken * experiment.sigma, experiment.sigma
    noise = noisy_inputs(suite, inputs)
    held = np.array([name.endswith("_cmd") for name in noise], bool)
    structure = lagged_structure(known, sensors, tuple(noise) or tuple(inputs))
    steps = np.zeros((*taken.shape, 0))  # what an offset of a noisy input does
    if noise:
        still, trim = np.zeros((len(taken), len(noise))), np.zeros(len(structure.states))
        r = respond(structure, structure.true, (), still, Sampling(1.0 / suite.rate_hz, held), trim, range(len(noise)))
        steps = r.dbias / sigma[:, None] * taken[:, :, None]

    def reached(rest: list[int]) -> tuple[Accuracy, Answer]:
        whiten = _whitening(known, [sensors[k] for k in rest], suite, noise, taken[:, rest])
        return _accuracy(S[:, rest], steps[:, rest], taken[:, rest], whiten)

    found, answer = reached(list(range(len(sensors))))
    beyond = second_order_share(_response(known, experiment, u), experiment.structure, aims, found, answer)
    std = aims.errors(found)
    without = {}
    for i, sensor in enumerate(sensors):
        rest = [k for k in range(len(sensors)) if k != i]
        less = aims.errors(reached(rest)[0]) if rest else np.full(len(std), np.inf)
        with np.errstate(invalid="ignore"):
            without[sensor.channel] = less / std
    units = tuple("" if name.startswith("zeta of ") else "%" for name in aims.names)
    return Prediction(aims.names, aims.values, std * in_percent(aims), units, beyond, without, found)


def _response(known: Known, experiment: Experiment, u: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the response (N, p) in units of the sensors' noise as a function of the parameters.

    The commands are taken as coarsely as will do: what is asked is how much the response bends.
    """
    most = experiment.stride
    coarse = max(k for k in range(1, most + 1) if (most % k == 0 and k * experiment.dt_s * _LEAST_HZ <= 1.0) or k == 1)
    structure = lagged_structure(known, experiment.sensors, experiment.structure.inputs)
    held, trim = np.ones(u.shape[1], bool), np.zeros(len(structure.states))

    def response(params: FloatArray) -> FloatArray:
        y = respond(structure, params, (), u[::coarse], Sampling(coarse * experiment.dt_s, held), trim).y
        return np.asarray(y[:: most // coarse] / experiment.sigma)

    return response


def _whitening(
    known: Known, sensors: Sequence[Sensor], suite: SensorSuite, noise: Mapping[str, float], taken: FloatArray
) -> Whitening | None:
    """Return what makes residuals through some of a suite's sensors white; None: they are so already."""
    if not noise:
        return None
    structure = lagged_structure(known, tuple(sensors), tuple(noise))
    held = np.array([name.endswith("_cmd") for name in noise])
    of_inputs, of_outputs = np.array([*noise.values()]), np.array([suite.noise_std[s.channel] for s in sensors])
    return Whitening(structure, structure.true, Sampling(1.0 / suite.rate_hz, held), of_inputs, of_outputs, taken)


def _accuracy(S: FloatArray, steps: FloatArray, taken: FloatArray, whiten: Whitening | None) -> tuple[Accuracy, Answer]:
    """Return what sensitivities S (N, p, k) tell beside ``steps`` (N, p, m) and offsets of samples ``taken`` (N, p).

    Then what the estimator makes of residuals (N, p, r) in units of the sensors' noise: errors (k, r).
    """
    N, p, k = S.shape
    offsets = np.eye(p)[None] * taken[:, :, None]
    both = np.concatenate([S, offsets, steps], axis=2)
    W = (both if whiten is None else whiten.apply(both)).reshape(N * p, -1)
    U, s, _ = np.linalg.svd(W[:, k:] / np.maximum(np.linalg.norm(W[:, k:], axis=0), 1e-300), full_matrices=False)
    basis = U[:, s > _LOST * s[0]]
    own = W[:, :k] - basis @ (basis.T @ W[:, :k])
    found = accuracy(own.T @ own)

    def answer(v: FloatArray) -> FloatArray:
        scaled = v * taken[:, :, None]
        rows = (scaled if whiten is None else whiten.apply(scaled)).reshape(N * p, -1)
        return np.asarray(found.covariance @ (own.T @ rows))

    return found, answer


# --- the linearised aircraft as a suite shows it ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Known:
    """What is compared, of one aircraft at one condition."""

    # aircraft, trimmed, linear: what flies
    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    plane: Plane  # which motion
    modes: Mapping[str, complex]  # name -> pole of all modes of the plane, rad/s
    wanted_modes: tuple[str, ...]  # names of the target modes, split roots by themselves
    wanted: tuple[str, ...]  # names of the target parameters
    free: tuple[str, ...]  # all parameters that are unknown

    def seen_by(self, sensors: Sequence[Sensor], inputs: Sequence[str]) -> AircraftStructure:
        """Return the linearised aircraft as sensors show it, lags and delays apart; errors as :func:`seen_by`."""
        return seen_by(sensors, self.aircraft, self.trimmed, self.linear, self.plane, inputs, self.free)


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
    u = build(manoeuvre.input, manoeuvre.duration_s, rate_hz).columns(controls)
    return np.pad(u, ((round(manoeuvre.settle_s * rate_hz), 0), (0, 0)))


def experiment_of(
    known: Known, sensors: Sequence[Sensor], suite_rate_hz: float, manoeuvre: Manoeuvre
) -> tuple[Experiment, FloatArray]:
    """Return the experiment of one manoeuvre through sensors, and its input (samples, m).

    The commands move the aircraft through its servos; sensors have an unknown offset each; the flight begins in trim.
    A recorder whose clock is late delays its sensors; one that is ahead of the others is taken as in time.
    """
    controls = [c for c in CONTROLS if any(i.control == c for i in manoeuvre.input)]
    structure = known.seen_by(sensors, known.linear.commands(controls))
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
