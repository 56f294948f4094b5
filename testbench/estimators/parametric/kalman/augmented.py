"""What EKF and UKF share: the state with the parameters beside it, the data, and the result.

    z = (x, free parameters),   dz = (f(x, u, params), 0) dt + F dw,   y[i] = h(x[i], u[i], params) + G e[i]

Between samples inputs run linearly or are held; the mean runs by classical Runge-Kutta steps. The process noise of a
sample, F F' dt, comes in half before and half after the step (the trapezoidal rule, exact to the second order in dt).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from testbench.errors import EstimationError
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import correlations, whiteness
from testbench.estimators.parametric.kalman.advice import advise_filter
from testbench.estimators.parametric.model import ParametricModel, named
from testbench.estimators.parametric.output_error import held_inputs
from testbench.estimators.parametric.response import delayed, respond, runge_kutta
from testbench.estimators.parametric.structure import AnyArray, ModelStructure
from testbench.record import FlightRecord, FloatArray

_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # a smooth signal all but vanishes in it, noise does not


class Gaussian(NamedTuple):
    """Mean (s,) and covariance (s, s)."""

    mean: FloatArray
    covariance: FloatArray


class Prediction(NamedTuple):
    """The next sample's Gaussian, and the covariance (s, s) of the state before with the one after."""

    state: Gaussian
    cross: FloatArray


class Correction(NamedTuple):
    """Gaussian after a measurement, the innovations (o,) and their covariance (o, o)."""

    state: Gaussian
    innovation: FloatArray
    expected: FloatArray


@dataclass(frozen=True, eq=False)
class Plant:
    """A structure whose free parameters are states.

    Attributes:
        structure: the equations.
        chosen: (f,) indices of the parameters that are states.
        values: (k,) of all parameters; only the fixed ones are used.
        dt_s: sample time, s.
        substeps: Runge-Kutta steps per sample.
        Q: (n + f,) variance of the process noise of one sample.
        R: (p,) variance of the measurement noise.
    """

    structure: ModelStructure
    chosen: NDArray[np.intp]
    values: FloatArray
    dt_s: float
    substeps: int
    Q: FloatArray
    R: FloatArray

    @property
    def states(self) -> int:
        """Number of states without parameters."""
        return len(self.structure.states)

    def split(self, z: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return states (..., n) and all parameters (..., k) of augmented states (..., n + f)."""
        params = np.array(np.broadcast_to(self.values, (*z.shape[:-1], self.values.size)), z.dtype)
        params[..., self.chosen] = z[..., self.states :]
        return z[..., : self.states], params

    def step(self, z: AnyArray, u: FloatArray, du: FloatArray) -> AnyArray:
        """Return augmented states (..., n + f) one sample later; the parameters stay."""
        x, params = self.split(z)
        U, dU = (np.broadcast_to(part, (*z.shape[:-1], part.size)) for part in (u, du))
        x = runge_kutta(self.structure, x, U, dU, params, self.dt_s, self.substeps)
        return np.concatenate([x, z[..., self.states :]], axis=-1)

    def output(self, z: AnyArray, u: FloatArray) -> AnyArray:
        """Return the outputs (..., p)."""
        x, params = self.split(z)
        return self.structure.output(x, np.broadcast_to(u, (*z.shape[:-1], u.size)), params)


class Filter(Protocol):
    """One kind of Kalman filter."""

    def predict(self, plant: Plant, state: Gaussian, u: FloatArray, du: FloatArray) -> Prediction:
        """Return the state one sample later."""
        ...

    def correct(
        self, plant: Plant, state: Gaussian, u: FloatArray, y: FloatArray, valid: NDArray[np.bool_]
    ) -> Correction:
        """Return the state after the valid ones of the measurements y (p,)."""
        ...


@dataclass(frozen=True, eq=False)
class Track:
    """Estimates along one record.

    Attributes:
        t_s: (N,) times.
        states: (N, n) filtered, with ``states_std`` (N, n).
        parameters: (N, f) of the free parameters, with ``parameters_std`` (N, f).
        covariance: (N, n + f, n + f) of states and parameters together.
        innovations: (N, p), zero where not measured.
        innovations_std: (N, p) that the filter expects, nan-free: zero where not measured.
        smoothed: (N, n + f) states and parameters given the whole record, or None.
        smoothed_covariance: (N, n + f, n + f), or None.
    """

    t_s: FloatArray
    states: FloatArray
    states_std: FloatArray
    parameters: FloatArray
    parameters_std: FloatArray
    covariance: FloatArray
    innovations: FloatArray
    innovations_std: FloatArray
    smoothed: FloatArray | None = None
    smoothed_covariance: FloatArray | None = None


def run(
    kind: Filter,
    plant: Plant,
    start: Gaussian,
    record: FlightRecord,
    u: FloatArray,
    held: NDArray[np.bool_],
    smooth: bool = False,
) -> tuple[Track, Gaussian]:
    """Filter one record from ``start``, which is believed before its first sample, and return its last Gaussian too.

    Raises:
        EstimationError: the estimate diverges, or its covariance stops being one.
    """
    part = record.select(plant.structure.outputs)
    N, s, n, p = len(u), start.mean.size, plant.states, len(plant.structure.outputs)
    du = np.where(held, 0.0, np.diff(u, axis=0, append=u[-1:]))
    mean, covariance = np.zeros((N, s)), np.zeros((N, s, s))
    before: list[Prediction] = []
    innovation, expected = np.zeros((N, p)), np.zeros((N, p))
    state = start
    for k in range(N):
        if k:
            before.append(kind.predict(plant, state, u[k - 1], du[k - 1]))
            state = before[-1].state
        valid = part.valid[k]
        if valid.any():
            state, innovation[k, valid], S = kind.correct(plant, state, u[k], part.data[k], valid)
            expected[k, valid] = np.sqrt(np.diag(S))
        if not np.all(np.isfinite(state.mean)) or np.any(np.diag(state.covariance) < 0.0):
            raise EstimationError(
                f"the filter diverges at t = {record.t_s[k]:g} s; start from better values or smaller deviations, or "
                "raise substeps"
            )
        mean[k], covariance[k] = state
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    back = _smooth(mean, covariance, before) if smooth else (None, None)
    track = Track(record.t_s, mean[:, :n], std[:, :n], mean[:, n:], std[:, n:], covariance, innovation, expected, *back)
    return track, state


def _smooth(mean: FloatArray, covariance: FloatArray, before: Sequence[Prediction]) -> tuple[FloatArray, FloatArray]:
    """Return means and covariances given the whole record (Rauch, Tung and Striebel, AIAA Journal 3, 1965)."""
    m, P = mean.copy(), covariance.copy()
    for k in range(len(mean) - 2, -1, -1):
        ahead = before[k]
        size = np.sqrt(np.maximum(np.diag(ahead.state.covariance), 1e-300))
        # Constant parameters that the data have fixed make the covariance nearly singular: solve for what it holds.
        scaled = ahead.state.covariance / np.outer(size, size)
        gain = ahead.cross / size @ np.linalg.pinv(scaled, rcond=1e-13, hermitian=True) / size
        m[k] = mean[k] + gain @ (m[k + 1] - ahead.state.mean)
        P[k] = covariance[k] + gain @ (P[k + 1] - ahead.state.covariance) @ gain.T
    return m, P


def estimate_by(
    kind: Filter,
    method: str,
    records: Sequence[FlightRecord],
    structure: ModelStructure,
    *,
    measurement_noise: Mapping[str, float] | None,
    process_noise: Mapping[str, float] | None,
    parameter_drift: Mapping[str, float] | None,
    initial_std: Mapping[str, float] | None,
    delays_s: Mapping[str, float] | None,
    held: Sequence[str] | None,
    substeps: int,
    smooth: bool,
    settings: Mapping[str, Any],
) -> ParametricModel:
    """Run one kind of filter over the records, one after the other; parameters carry over, states start anew."""
    check_records(records, structure.inputs, structure.outputs)
    hold = held_inputs(structure.inputs, held)
    delays = named(delays_s, structure.inputs, "a delay")
    free = [p.name for p in structure.parameters if p.free]
    F = _values(process_noise, structure.states, "process noise", "a state")
    drift = _values(parameter_drift, free, "a drift", "a free parameter")
    G = _measurement_noise(records, structure.outputs, measurement_noise)
    dt = records[0].dt_s
    chosen = np.flatnonzero(structure.free)
    taken = sum(int(r.select(structure.outputs).valid.sum()) for r in records)
    unknowns = chosen.size + len(records) * len(structure.states)
    if taken <= unknowns:
        raise EstimationError(
            f"a filter for {unknowns} unknown parameters and initial states needs more output samples than that, got "
            f"{taken}; give more data or fix some parameters"
        )
    noise = np.concatenate([F, drift]) ** 2 * dt
    plant = Plant(structure, chosen, structure.values, dt, substeps, noise, G**2)
    inputs = [delayed(r.columns(structure.inputs), r.dt_s, delays) for r in records]
    std = _initial_std(plant, records[0], inputs[0], hold, initial_std)
    beliefs = Gaussian(structure.values[chosen], np.diag(std[plant.states :] ** 2))
    tracks = []
    for record, u in zip(records, inputs, strict=True):
        track, last = run(kind, plant, _start(plant, record, beliefs, std), record, u, hold, smooth)
        beliefs = Gaussian(last.mean[plant.states :], last.covariance[plant.states :, plant.states :])
        tracks.append(track)
    covariance = np.zeros((structure.values.size,) * 2)
    covariance[np.ix_(chosen, chosen)] = beliefs.covariance
    valid = [r.select(structure.outputs).valid for r in records]
    v = np.vstack([t.innovations for t in tracks])
    good = np.vstack(valid)
    expected = np.where(good, np.vstack([t.innovations_std for t in tracks]), 1.0)
    params = structure.values
    params[chosen] = beliefs.mean
    R = np.sum(v**2, axis=0) / np.maximum(good.sum(axis=0), 1)
    model = ParametricModel(
        method=method,
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=dt,
        settings={
            "structure": structure.name,
            "measurement_noise": dict(zip(structure.outputs, G.tolist(), strict=True)),
            "process_noise": dict(process_noise or {}),
            "parameter_drift": dict(parameter_drift or {}),
            "initial_std": dict(initial_std or {}),
            "smooth": smooth,
            **settings,
        },
        diagnostics={
            "tracks": tracks,
            "initial_std": std[plant.states :],
            "residual_std": np.sqrt(R),
            "normalised_innovations": np.sum((v / expected) ** 2, axis=0) / np.maximum(good.sum(axis=0), 1),
            "whiteness_p": whiteness(
                [t.innovations for t in tracks], valid, np.maximum(np.std(v, axis=0), G), np.diag(R)
            ),
            "correlation": correlations(beliefs.covariance),
        },
        structure=structure,
        params=params,
        covariance=covariance,
        covariance_plain=covariance.copy(),
        noise_covariance=np.diag(G**2),
        held=tuple(hold.tolist()),
        delays_s=tuple(delays.tolist()),
        operating_point=(
            np.mean(np.vstack([t.states for t in tracks]), axis=0),
            np.mean(np.vstack(inputs), axis=0),
        ),
        substeps=substeps,
    )
    return advise_filter(model)


def _values(given: Mapping[str, float] | None, names: Sequence[str], what: str, of: str) -> FloatArray:
    for name, value in (given or {}).items():
        if name not in names:
            raise EstimationError(f"{what} belongs to {of} ({', '.join(names)}), got '{name}'")
        if not 0.0 <= value < np.inf:
            raise EstimationError(f"{what} >= 0 must hold, got {value:g} for '{name}'")
    return np.array([float((given or {}).get(name, 0.0)) for name in names])


def _measurement_noise(
    records: Sequence[FlightRecord], outputs: Sequence[str], given: Mapping[str, float] | None
) -> FloatArray:
    """Return (p,) standard deviations: those given, others from third differences of the valid samples.

    Third differences of white noise have 20 times its variance.
    """
    known = _values(given, outputs, "measurement noise", "an output")
    out = np.zeros(len(outputs))
    for j, name in enumerate(outputs):
        if name in (given or {}):
            out[j] = known[j]
        else:
            parts = [np.convolve(r[name][r.select([name]).valid[:, 0]], _DIFFERENCE, "valid") for r in records]
            every = np.concatenate([part for part in parts if part.size] or [np.zeros(1)])
            out[j] = np.sqrt(np.mean(every**2) / np.sum(_DIFFERENCE**2))
        if not out[j] > 0.0:
            raise EstimationError(
                f"measurement noise > 0 must hold for '{name}', got {out[j]:g}; name it in measurement_noise"
            )
    return out


def _initial_std(
    plant: Plant, record: FlightRecord, u: FloatArray, held: NDArray[np.bool_], given: Mapping[str, float] | None
) -> FloatArray:
    """Return (n + f,) initial standard deviations of states and free parameters.

    Those given; else, for a parameter, its prior's; else what moves some output by as much as the outputs move (or the
    value itself, if larger); else, for a state that is an output, its noise; for others what moves the outputs so.
    """
    structure, chosen = plant.structure, plant.chosen
    names = (*structure.states, *(structure.parameter_names[i] for i in chosen))
    for name, value in (given or {}).items():
        if name not in names or not value > 0.0:
            raise EstimationError(
                f"an initial deviation > 0 belongs to a state or free parameter ({', '.join(names)}), got {value:g} "
                f"for '{name}'"
            )
    x0 = np.array([record[s][0] if s in record else 0.0 for s in structure.states])
    r = respond(structure, plant.values, chosen.tolist(), u, plant.dt_s, held, x0, substeps=plant.substeps)
    part = record.select(structure.outputs)
    size = np.array([part.data[ok, j].std() if ok.any() else 0.0 for j, ok in enumerate(part.valid.T)])
    size = np.maximum(size, np.sqrt(plant.R))
    out = np.empty(len(names))
    for i, name in enumerate(names):
        prior = structure.parameters[chosen[i - plant.states]].prior_std if i >= plant.states else None
        if name in (given or {}):
            out[i] = (given or {})[name]
        elif prior is not None:
            out[i] = prior
        elif name in structure.outputs:
            out[i] = 3.0 * np.sqrt(plant.R[structure.outputs.index(name)])
        else:
            effect = r.dparams[:, :, i - plant.states] if i >= plant.states else r.dx0[:, :, i]
            sensitivity = float(np.max(np.sqrt(np.mean(effect**2, axis=0)) / size))
            if not 0.0 < sensitivity < np.inf:
                raise EstimationError(
                    f"no initial deviation can be told for '{name}': from its start value the model diverges or no "
                    "output feels it; name it in initial_std"
                )
            value = abs(plant.values[chosen[i - plant.states]]) if i >= plant.states else 0.0
            out[i] = max(value, 1.0 / sensitivity)
    return out


def _start(plant: Plant, record: FlightRecord, beliefs: Gaussian, std: FloatArray) -> Gaussian:
    """Return what is believed before the first sample: states from their channels, parameters from the last record."""
    n = plant.states
    x0 = [record[s][0] if s in record else 0.0 for s in plant.structure.states]
    covariance = np.zeros((std.size, std.size))
    covariance[:n, :n] = np.diag(std[:n] ** 2)
    covariance[n:, n:] = beliefs.covariance
    return Gaussian(np.concatenate([x0, beliefs.mean]), covariance)
