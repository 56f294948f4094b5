"""The common part of EKF and UKF: the state with the parameters beside it, and one run over a record.

    z = (x, free parameters),   dz = (f(x, u, params), 0) dt + F dw,   y[i] = h(x[i], u[i], params) + G e[i]

Between samples inputs run linearly or are held; linear structures are solved exactly, others run by classical
Runge-Kutta steps. The process noise of a sample, F F' dt, comes in half before and half after the step (the trapezoidal
rule, exact to the second order in dt).

How EKF and UKF run over records: priors at the start, several passes, and the result.

What is doubtful about estimates of a Kalman filter, in words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import AdviceList
from testbench.core.constants import WHITE
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.estimators.coverage import approximate
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import correlations, whiteness
from testbench.estimators.parametric.likelihood import Driven
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import Sampling, delayed, respond, runge_kutta, taylor
from testbench.estimators.parametric.structure import Affine, AnyArray, LinearStructure, Matrices, ModelStructure
from testbench.estimators.settings import ExtendedFilter

# --- what is doubtful about estimates of a Kalman filter, in words ----------------------------------------------------


_VAGUE = 0.5  # standard error relative to the value
_LITTLE = 0.5  # share of the initial standard deviation that is left where the data say little
_NIS = 1.5  # innovations that are larger or smaller than their covariance by this factor in standard deviation


def advise_filter(model: Any) -> Any:
    """Return the ParametricModel of a Kalman filter with advice on what is doubtful.

    How often intervals held the truth is said where that may differ from 95 %: not of linear equations with innovations
    that are white and of the size that the filter expects.
    """
    found, out = model.diagnostics, AdviceList()
    names = [p.name for p in model.structure.parameters if p.free]
    values, errors = model.params[model.structure.free], np.sqrt(np.diag(model.covariance))[model.structure.free]
    vague = [
        f"{n} {with_error(float(v), float(e))}"
        for n, v, e, start in zip(names, values, errors, found["initial_std"], strict=True)
        if e > _LITTLE * start and e > _VAGUE * abs(v)
    ]
    if vague:
        out.doubt(
            "weakly_identifiable",
            (
                f"these data give little information on {', '.join(vague)}: fix them at prior values, or excite them "
                "more"
            ),
        )
    outside = [
        p.name
        for p, v in zip(model.structure.parameters, model.params, strict=True)
        if p.free and not p.low <= v <= p.high
    ]
    if outside:
        out.wrong(
            "outside_bounds",
            f"{', '.join(outside)} ended outside the bounds, because a Kalman filter does not keep them; estimate "
            "by output or filter error, or start nearer with a smaller initial deviation",
        )
    sizes = np.sqrt(found["normalised_innovations"])
    off = [f"{o} ({s:.2g})" for o, s in zip(model.outputs, sizes, strict=True) if s > _NIS or s * _NIS < 1.0]
    if off:
        out.doubt(
            "innovation_size",
            "the innovations do not have the size that the filter expects (measured over expected deviation): "
            f"{', '.join(off)}; its standard errors are off by about as much; correct measurement_noise or "
            "process_noise",
        )
    coloured = [o for o, p in zip(model.outputs, found["whiteness_p"], strict=True) if p < WHITE]
    if coloured:
        out.doubt(
            "coloured_residuals",
            f"the innovations of {', '.join(coloured)} are not white: process noise, filtered measurements or missing "
            "terms of the model; standard errors are too small",
        )
    if off or coloured or not isinstance(model.structure, LinearStructure):
        out.extend(approximate(model.method))
    return replace(model, advice=tuple(out))


# --- the common part of EKF and UKF -----------------------------------------------------------------------------------


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
    """A structure whose free parameters are states."""

    structure: ModelStructure  # the equations
    chosen: NDArray[np.intp]  # (f,) indices of the parameters that are states
    values: FloatArray  # (k,) of all parameters; only the fixed ones are used
    dt_s: float  # sample time, s
    substeps: int  # Runge-Kutta steps per sample
    Q: FloatArray  # (n + f,) variance of the process noise of one sample
    R: FloatArray  # (p,) variance of the measurement noise
    affine: Affine | None = None  # the matrices of a linear structure as a sum over its parameters, or None

    @property
    def states(self) -> int:
        """Number of states without parameters."""
        return len(self.structure.states)

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of a linear structure, which are cheap where the parameters stand in them linearly."""
        if self.affine is not None:
            return self.affine.at(params)
        return self.structure.matrices(params)  # type: ignore[attr-defined]

    def split(self, z: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return states (..., n) and all parameters (..., k) of augmented states (..., n + f)."""
        params = np.array(np.broadcast_to(self.values, (*z.shape[:-1], self.values.size)), z.dtype)
        params[..., self.chosen] = z[..., self.states :]
        return z[..., : self.states], params

    def step(self, z: AnyArray, u: FloatArray, du: FloatArray) -> AnyArray:
        """Return augmented states (..., n + f) one sample later; the parameters stay."""
        x, params = self.split(z)
        if isinstance(self.structure, LinearStructure):
            x = taylor(self.matrices(params), x, u, du, self.dt_s)
        else:
            U, dU = (np.broadcast_to(part, (*z.shape[:-1], part.size)) for part in (u, du))
            x = runge_kutta(self.structure, x, U, dU, params, self.dt_s, self.substeps)
        return np.concatenate([x, z[..., self.states :]], axis=-1)

    def output(self, z: AnyArray, u: FloatArray) -> AnyArray:
        """Return the outputs (..., p)."""
        x, params = self.split(z)
        if isinstance(self.structure, LinearStructure):
            s = self.matrices(params)
            return np.asarray((s.C @ x[..., None])[..., 0] + s.D @ u + s.by)
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
    """Estimates along one record."""

    t_s: FloatArray  # (N,) times
    states: FloatArray  # (N, n) filtered, with ``states_std`` (N, n)
    states_std: FloatArray
    parameters: FloatArray  # (N, f) of the free parameters, with ``parameters_std`` (N, f)
    parameters_std: FloatArray
    covariance: FloatArray  # (N, n + f, n + f) of states and parameters together
    innovations: FloatArray  # (N, p), zero where not measured
    innovations_std: FloatArray  # (N, p) that the filter expects, nan-free: zero where not measured
    smoothed: FloatArray | None = None  # (N, n + f) states and parameters given the whole record, or None
    smoothed_covariance: FloatArray | None = None  # (N, n + f, n + f), or None


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


# --- how EKF and UKF run over records ---------------------------------------------------------------------------------


_ENOUGH = 20  # innovations that tell a variance
_LEAST = 1e-4  # of the variance before, that records free of noise are taken to have
_WIDER = 10.0  # of the errors, to start another pass from
_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # a smooth signal all but vanishes in it, noise does not


def estimate_by(
    kind: Filter, records: Sequence[FlightRecord], structure: ModelStructure, settings: ExtendedFilter
) -> ParametricModel:
    """Run one kind of filter over the records, one after the other; parameters carry over, states start anew."""
    check_records(records, structure.inputs, structure.outputs)
    driven = Driven.of(settings, structure, records)
    delays, hold, _ = driven
    free = [p.name for p in structure.parameters if p.free]
    F = _values(settings.process_noise, structure.states, "process noise", "a state")
    drift = _values(settings.parameter_drift, free, "a drift", "a free parameter")
    G = _measurement_noise(records, structure.outputs, settings.measurement_noise)
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
    affine = Affine.of(structure) if isinstance(structure, LinearStructure) else None
    plant = Plant(structure, chosen, structure.values, dt, settings.substeps, noise, G**2, affine)
    inputs = [delayed(r.columns(structure.inputs), r.dt_s, delays) for r in records]
    std = _initial_std(plant, records[0], inputs[0], hold, settings.initial_std)
    wide = Gaussian(structure.values[chosen], np.diag(std[plant.states :] ** 2))
    told = np.array([n in settings.initial_std or structure.parameters[i].prior_std is not None
                     for n, i in zip(free, chosen, strict=True)], bool)  # fmt: skip
    known = told.all() and set(structure.outputs) <= set(settings.measurement_noise)
    # another pass would be the same, or parameters are not where they ended
    passes = 1 if known or settings.parameter_drift else settings.passes
    beliefs = wide
    tracks: list[Track] = []
    for i in range(passes):
        if i:
            beliefs = _narrowed(wide, beliefs, told)
            plant = replace(plant, R=_measured_noise(plant, tracks, settings.measurement_noise))
        tracks = []
        for record, u in zip(records, inputs, strict=True):
            track, last = run(kind, plant, _start(plant, record, beliefs, std), record, u, hold, settings.smooth)
            beliefs = Gaussian(last.mean[plant.states :], last.covariance[plant.states :, plant.states :])
            tracks.append(track)
    G = np.sqrt(plant.R)
    covariance = np.zeros((structure.values.size,) * 2)
    covariance[np.ix_(chosen, chosen)] = beliefs.covariance
    valid = [r.select(structure.outputs).valid for r in records]
    v = np.vstack([t.innovations for t in tracks])
    good = np.vstack(valid)
    expected = np.where(good, np.vstack([t.innovations_std for t in tracks]), 1.0)
    params = structure.values
    params[chosen] = beliefs.mean
    R = np.sum(v**2, axis=0) / np.maximum(good.sum(axis=0), 1)
    model = driven.model(
        structure,
        {
            "structure": structure.name,
            "measurement_noise": dict(zip(structure.outputs, G.tolist(), strict=True)),
            "process_noise": dict(settings.process_noise),
            "parameter_drift": dict(settings.parameter_drift),
            "initial_std": dict(settings.initial_std),
            "smooth": settings.smooth,
            "passes": passes,
            **settings.model_dump(include={"alpha", "beta", "kappa"}),
        },
        method=settings.method,
        dt_s=dt,
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
        params=params,
        covariance=covariance,
        covariance_plain=covariance.copy(),
        noise_covariance=np.diag(G**2),
        operating_point=(np.mean(np.vstack([t.states for t in tracks]), axis=0), np.mean(np.vstack(inputs), axis=0)),
        substeps=settings.substeps,
    )
    return advise_filter(model)


def _values(given: Mapping[str, float], names: Sequence[str], what: str, of: str) -> FloatArray:
    for name in given:
        if name not in names:
            raise EstimationError(f"{what} belongs to {of} ({', '.join(names)}), got '{name}'")
    return np.array([float(given.get(name, 0.0)) for name in names])


def _measurement_noise(
    records: Sequence[FlightRecord], outputs: Sequence[str], given: Mapping[str, float]
) -> FloatArray:
    """Return (p,) standard deviations: those given, others from third differences of the valid samples.

    Third differences of white noise have 20 times its variance.
    """
    known = _values(given, outputs, "measurement noise", "an output")
    out = np.zeros(len(outputs))
    for j, name in enumerate(outputs):
        if name in given:
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
    plant: Plant, record: FlightRecord, u: FloatArray, held: NDArray[np.bool_], given: Mapping[str, float]
) -> FloatArray:
    """Return (n + f,) initial standard deviations of states and free parameters.

    Those given; else, for a parameter, its prior's; else what moves some output by as much as the outputs move (or the
    value itself, if larger); else, for a state that is an output, its noise; for others what moves the outputs so.
    """
    structure, chosen = plant.structure, plant.chosen
    names = (*structure.states, *(structure.parameter_names[i] for i in chosen))
    _values(given, names, "an initial deviation", "a state or free parameter")
    x0 = structure.initial_state(record)
    sampling = Sampling(plant.dt_s, held, plant.substeps)
    r = respond(structure, plant.values, chosen.tolist(), u, sampling, x0)
    part = record.select(structure.outputs)
    size = np.array([part.data[ok, j].std() if ok.any() else 0.0 for j, ok in enumerate(part.valid.T)])
    size = np.maximum(size, np.sqrt(plant.R))
    out = np.empty(len(names))
    for i, name in enumerate(names):
        prior = structure.parameters[chosen[i - plant.states]].prior_std if i >= plant.states else None
        if name in given:
            out[i] = given[name]
        elif prior is not None:
            out[i] = prior
        elif name in structure.outputs:
            out[i] = 3.0 * np.sqrt(plant.R[structure.outputs.index(name)])
        else:
            effect = r.dparams[:, :, i - plant.states] if i >= plant.states else r.dx0[:, :, i]
            sensitivity = float(np.max(np.sqrt(np.mean(effect**2, axis=0)) / size))
            if not 0.0 < sensitivity < np.inf:
                raise EstimationError(
                    f"no initial deviation can be determined for '{name}': from its start value the model diverges or "
                    "no output depends on it; name it in initial_std"
                )
            value = abs(plant.values[chosen[i - plant.states]]) if i >= plant.states else 0.0
            out[i] = max(value, 1.0 / sensitivity)
    return out


def _measured_noise(plant: Plant, tracks: Sequence[Track], given: Mapping[str, float]) -> FloatArray:
    """Return (p,) the variances of the noise that the innovations show: v^2 = R + what the state's errors add.

    From samples to which the state's errors add no more than the noise; ``given`` deviations stay. Third differences
    count fast motion as noise.
    """
    out = plant.R.copy()
    v = np.vstack([t.innovations for t in tracks])
    added = np.vstack([t.innovations_std for t in tracks]) ** 2 - plant.R
    for j, name in enumerate(plant.structure.outputs):
        settled = (added[:, j] > -plant.R[j]) & (added[:, j] < plant.R[j])
        if name not in given and settled.sum() > _ENOUGH:
            out[j] = max(float(np.mean(v[settled, j] ** 2 - added[settled, j])), _LEAST * plant.R[j])
    return out


def _narrowed(wide: Gaussian, found: Gaussian, told: NDArray[np.bool_]) -> Gaussian:
    """Return what the next pass starts from: parameters where the last one ended, but with errors _WIDER as large.

    A filter linearises where it believes to be. On its way from a wide belief it learns from derivatives at points that
    it has since left, and does not forget that: its errors come out too small. From nearby it does not stray. Data that
    count a second time do so by 1 / _WIDER^2. What the caller believes of a parameter (``told``) stays as it is.
    """
    mean, covariance = np.where(told, wide.mean, found.mean), wide.covariance.copy()
    rest = np.flatnonzero(~told)
    at = np.ix_(rest, rest)
    size = np.sqrt(np.diag(covariance))[rest]
    part = _WIDER**2 * found.covariance[at] / np.outer(size, size)
    near = part - part @ np.linalg.solve(np.eye(rest.size) + part, part)  # the information of both added
    covariance[at] = 0.5 * (near + near.T) * np.outer(size, size)
    return Gaussian(mean, covariance)


def _start(plant: Plant, record: FlightRecord, beliefs: Gaussian, std: FloatArray) -> Gaussian:
    """Return what is believed before the first sample: states from their channels, parameters from the last record."""
    n = plant.states
    x0 = plant.structure.initial_state(record)
    covariance = np.zeros((std.size, std.size))
    covariance[:n, :n] = np.diag(std[:n] ** 2)
    covariance[n:, n:] = beliefs.covariance
    return Gaussian(np.concatenate([x0, beliefs.mean]), covariance)
