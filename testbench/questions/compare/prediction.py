"""What a manoeuvre tells through a suite, before anything is flown: noise of outputs and of measured inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray
from testbench.core.scenario.base import Manoeuvre
from testbench.estimators.parametric.input_noise import Whitening
from testbench.estimators.parametric.response import respond
from testbench.information.fisher import Accuracy, Experiment, accuracy
from testbench.questions.compare.best_case import lagged_structure, noisy_inputs
from testbench.questions.compare.curvature import Answer, second_order_share
from testbench.questions.compare.seen import Known, experiment_of, in_percent, sensors_of, targets_of
from testbench.sensors import Sensor, SensorSuite

FAR = 0.5
"""Share of second order up to which a standard error is believed: its square adds a quarter to the variance."""
_LEAST_HZ = 40.0  # rate at which commands are looked at, at least
_LOST = 1e-10  # singular values of the offsets' information below this share of the largest are none


@dataclass(frozen=True, eq=False)
class Prediction:
    """What an input tells through a suite.

    Attributes:
        names: (t,) quantities: parameters, "wn of ...", "zeta of ...".
        values: (t,) their true values, SI.
        std: (t,) standard errors in ``units``.
        units: (t,) "%" of the true value; "" of damping ratios; SI where the truth is near zero (:mod:`.near_zero`).
        beyond: (t,) terms of second order over those errors (:mod:`.curvature`); above :data:`FAR` the errors are too
            large, or the model too far from linear over them, to be believed.
        without: sensor -> (t,) factor by which the errors grow if that sensor is left out; inf if nothing is left.
        known: standard errors and covariance of the free parameters.
    """

    names: tuple[str, ...]
    values: FloatArray
    std: FloatArray
    units: tuple[str, ...]
    beyond: FloatArray
    without: Mapping[str, FloatArray]
    known: Accuracy

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
    sensors = sensors_of(suite, outputs)
    experiment, u = experiment_of(known, sensors, suite.rate_hz, manoeuvre)
    aims = targets_of(known, experiment.structure)
    S, taken, sigma = experiment.sensitivities(u), experiment.taken * experiment.sigma, experiment.sigma
    noise = noisy_inputs(suite, inputs)
    held = np.array([name.endswith("_cmd") for name in noise], bool)
    structure = lagged_structure(known, sensors, tuple(noise) or tuple(inputs))
    steps = np.zeros((*taken.shape, 0))  # what an offset of a noisy input does
    if noise:
        still, trim = np.zeros((len(taken), len(noise))), np.zeros(len(structure.states))
        r = respond(structure, structure.true, (), still, 1.0 / suite.rate_hz, held, trim, range(len(noise)))
        steps = r.dbias / sigma[:, None] * taken[:, :, None]

    def reached(rest: list[int]) -> tuple[Accuracy, Answer]:
        whiten = _whitening(known, [sensors[k] for k in rest], suite, noise, taken[:, rest])
        return _accuracy(S[:, rest], steps[:, rest], taken[:, rest], whiten)

    found, answer = reached(list(range(len(sensors))))
    poles = {name: known.modes[name] for name in known.wanted_modes}
    beyond = second_order_share(_response(known, experiment, u), experiment.structure, aims, poles, found, answer)
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
        y = respond(structure, params, (), u[::coarse], coarse * experiment.dt_s, held, trim).y
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
    return Whitening(structure, structure.true, 1.0 / suite.rate_hz, held, of_inputs, of_outputs, taken)


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
