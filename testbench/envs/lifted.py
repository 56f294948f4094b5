"""The linearised aircraft, its sensors and its sensitivities as one exact discrete system, lifted to whole decisions.

At the rate of the inputs

    z[k+1] = F z[k] + G u[k],    z = (x, dx/dparams, lags and delays of the sensors),

exact for held inputs (C. F. Van Loan, IEEE Trans. Automatic Control 23, 1978). A decision holds u for R samples; what
the sensors show, its sensitivities and the limited channels over these samples are then one matrix times (z, u).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.design.problem import Problem
from testbench.estimators.parametric.response import discretise
from testbench.estimators.parametric.structure import STEP
from testbench.sensors import Sensor
from testbench.sensors.sensor import lag_weights


@dataclass(frozen=True, eq=False)
class Lifted:
    """One decision of the linear aircraft as a matrix; all deviations from trim."""

    # (nz + r p + r p k + 2 R c, nz + m): next state, r samples of p sensed outputs, their sensitivities by the k
    # parameters, and R samples of the c limited channels over their upper and over their lower limits
    matrix: FloatArray
    nz: int  # size of the state, 0 at trim
    # r, p, k, R, c: see above; r samples of the fastest sensors and R of the inputs per decision
    r: int
    p: int
    k: int
    R: int
    c: int


def lift(problem: Problem, samples: int) -> Lifted:
    """Return the lifted system of a problem for decisions of ``samples`` samples of the fastest sensors each.

    Raises:
        EstimationError: fewer than one sample per decision.
    """
    if samples < 1:
        raise EstimationError(f"a decision must last at least one sample of the sensors, got {samples}")
    experiment, structure = problem.experiment, problem.experiment.structure
    n, m, k = len(structure.states), len(structure.inputs), len(structure.parameters)
    p, R = len(structure.outputs), samples * experiment.stride
    F, G, H, J = _sensed_system(problem)
    L, N = _limit_rows(problem, n)
    nz, c = len(F), len(L) // 2
    state, forced = np.eye(nz), np.zeros((nz, m))
    seen, limited = [], []
    for i in range(R):
        if i % experiment.stride == 0:
            seen.append(np.hstack([H @ state, H @ forced + J]).reshape(p, 1 + k, nz + m))
        limited.append(np.hstack([L @ state[:n], L @ forced[:n] + N]))
        state, forced = F @ state, F @ forced + G
    both = np.stack(seen)
    matrix = np.vstack(
        [
            np.hstack([state, forced]),
            both[:, :, 0].reshape(samples * p, -1),
            both[:, :, 1:].reshape(samples * p * k, -1),
            np.vstack(limited),
        ]
    )
    return Lifted(np.ascontiguousarray(matrix), nz, samples, p, k, R, c)


def _sensed_system(problem: Problem) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return F, G, H (p (1 + k), nz) and J of outputs and sensitivities as the sensors show them."""
    experiment, structure = problem.experiment, problem.experiment.structure
    n, m, k = len(structure.states), len(structure.inputs), len(structure.parameters)
    z = np.tile(structure.true.astype(complex), (k + 1, 1))
    z[np.arange(k), np.arange(k)] += 1j * STEP
    s = structure.matrices(z)
    d = discretise(s, experiment.dt_s, np.ones(m, bool))
    A, B = d.A[-1].real, d.G[-1].real
    F, G = np.kron(np.eye(1 + k), A), np.zeros((n * (1 + k), m))
    G[:n] = B
    for j in range(k):
        F[n * (j + 1) : n * (j + 2), :n] = d.A[j].imag / STEP
        G[n * (j + 1) : n * (j + 2)] = d.G[j].imag / STEP
    rows_H, rows_J = [], []
    for i, sensor in enumerate(experiment.sensors):
        H, J = np.zeros((1 + k, len(F))), np.zeros((1 + k, m))
        for j in range(1 + k):
            H[j, n * j : n * (j + 1)] = s.C[-1, i].real
        J[0] = s.D[-1, i].real
        H[1:, :n] += s.C[:-1, i].imag / STEP
        J[1:] = s.D[:-1, i].imag / STEP
        F, G, H, J = _through(sensor, experiment.dt_s, F, G, sensor.scale * H, sensor.scale * J)
        rows_H.append(H)
        rows_J.append(J)
    wide = np.zeros((len(experiment.sensors), 1 + k, len(F)))
    for i, H in enumerate(rows_H):
        wide[i, :, : H.shape[1]] = H
    return F, G, wide.reshape(-1, len(F)), np.concatenate(rows_J)


def _through(
    sensor: Sensor, dt_s: float, F: FloatArray, G: FloatArray, H: FloatArray, J: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Append lag and delay of a sensor to the system; H and J become what it shows.

    The lag is that of :func:`testbench.sensors.sensor.first_order_lag`, the delay interpolates between samples.
    """
    if sensor.lag_s > 0.0:
        a, b0, b1 = lag_weights(dt_s, sensor.lag_s)
        F, G = _appended(F, G, (b0 + a * b1) * H, (b0 + a * b1) * J, a)
        H, J = np.hstack([b1 * H, np.eye(len(H))]), b1 * J
    if sensor.delay_s > 0.0:
        whole, part = divmod(sensor.delay_s / dt_s, 1.0)
        if part < 1e-9 or part > 1.0 - 1e-9:
            whole, part = round(sensor.delay_s / dt_s), 0.0
        taps = [(H, J)]
        for _ in range(int(whole) + (part > 0.0)):
            size = len(F)
            F, G = _appended(F, G, *taps[-1], 0.0)
            taps = [(np.hstack([h, np.zeros((len(h), len(F) - size))]), j) for h, j in taps]
            taps.append((np.hstack([np.zeros((len(H), size)), np.eye(len(H))]), np.zeros_like(J)))
        late, later = taps[int(whole)], taps[-1]
        H, J = (1.0 - part) * late[0] + part * later[0], (1.0 - part) * late[1] + part * later[1]
    return F, G, H, J


def _appended(F: FloatArray, G: FloatArray, H: FloatArray, J: FloatArray, a: float) -> tuple[FloatArray, FloatArray]:
    """Return the system with further states v[k+1] = H z[k] + J u[k] + a v[k]."""
    more = len(H)
    return np.block([[F, np.zeros((len(F), more))], [H, a * np.eye(more)]]), np.vstack([G, J])


def _limit_rows(problem: Problem, n: int) -> tuple[FloatArray, FloatArray]:
    """Return rows (2 c, n) and (2 c, m) of the limited channels over their upper, then over their lower limits."""
    prediction, structure = problem.prediction, problem.experiment.structure
    model = prediction.model
    at = [model.states.index(s) for s in structure.states]
    columns = [model.inputs.index(i) for i in structure.inputs]
    L, N = np.zeros((len(prediction.names), n)), np.zeros((len(prediction.names), len(columns)))
    for i, name in enumerate(prediction.names):
        if name.startswith("command of "):
            N[i, problem.controls.index(name.removeprefix("command of "))] = 1.0
        elif name.startswith("rate of "):
            row = model.states.index(f"servo_{name.removeprefix('rate of ')}")
            L[i], N[i] = model.A[row, at], model.B[row, columns]
        else:
            row = model.outputs.index(name)
            L[i], N[i] = model.C[row, at], model.D[row, columns]
    high, low = prediction.high[:, None], prediction.low[:, None]
    return np.vstack([L / high, L / low]), np.vstack([N / high, N / low])
