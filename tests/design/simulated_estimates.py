"""A test of the prediction: the scatter of output-error estimates from simulated records of one design."""

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.response import Sampling, respond
from testbench.estimators.settings import OutputError
from testbench.information.fisher import Experiment


def estimates(experiment: Experiment, u: FloatArray, runs: int, seed: int) -> FloatArray:
    """Return output-error estimates (runs, k), one from each record of the same input with fresh noise.

    The linearised aircraft flies, sensors add noise and an unknown offset; the estimator starts from the truth and
    knows that the flight began at trim.

    Args:
        experiment: inputs at the sensors' rate (stride 1), sensors without lag and delay.
        u: (N, m) samples.
        runs: number of records.
        seed: of the noise.

    Raises:
        EstimationError: an estimate fails.
    """
    s, N, p = experiment.structure, experiment.samples, len(experiment.sensors)
    held = np.ones(u.shape[1], bool)
    y = respond(s, s.true, (), u, Sampling(experiment.dt_s, held), np.zeros(len(s.states))).y
    valid = np.ones((N, u.shape[1] + p), bool)
    for i, sensor in enumerate(experiment.sensors):
        stride = round(1.0 / (experiment.dt_s * (sensor.rate_hz or 1.0 / experiment.dt_s)))
        valid[:, u.shape[1] + i] = np.arange(N) % stride == 0
    rng = np.random.default_rng(seed)
    t = np.arange(N, dtype=np.float64) * experiment.dt_s
    out = np.empty((runs, len(s.parameters)))
    for r in range(runs):
        measured = y + rng.standard_normal(y.shape) * experiment.sigma
        record = FlightRecord(t, (*s.inputs, *s.outputs), np.hstack([u, measured]), "measured", valid=valid)
        model = output_error.estimate(
            [record], s, OutputError(initial_states="zero", output_biases=s.outputs, held=s.inputs)
        )
        out[r] = model.params
    return out
