"""How EKF and UKF run over records: priors at the start, several passes, and the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.hold import said_of_hold
from testbench.estimators.model import check_records
from testbench.estimators.parametric.accuracy import correlations, whiteness
from testbench.estimators.parametric.kalman.advice import advise_filter
from testbench.estimators.parametric.kalman.augmented import Filter, Gaussian, Plant, Track, run
from testbench.estimators.parametric.likelihood import Driven
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import Sampling, delayed, respond
from testbench.estimators.parametric.structure import Affine, LinearStructure, ModelStructure
from testbench.estimators.settings import ExtendedFilter

_ENOUGH = 20  # innovations that tell a variance
_LEAST = 1e-4  # of the variance before, that records free of noise are taken to have
_WIDER = 10.0  # of the errors, to start another pass from
_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # a smooth signal all but vanishes in it, noise does not


def estimate_by(
    kind: Filter, records: Sequence[FlightRecord], structure: ModelStructure, settings: ExtendedFilter
) -> ParametricModel:
    """Run one kind of filter over the records, one after the other; parameters carry over, states start anew."""
    check_records(records, structure.inputs, structure.outputs)
    delays, hold, recognised = Driven.of(settings, structure, records)
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
    model = ParametricModel(
        method=settings.method,
        inputs=structure.inputs,
        outputs=structure.outputs,
        dt_s=dt,
        settings={
            "structure": structure.name,
            "measurement_noise": dict(zip(structure.outputs, G.tolist(), strict=True)),
            "process_noise": dict(settings.process_noise),
            "parameter_drift": dict(settings.parameter_drift),
            "initial_std": dict(settings.initial_std),
            "smooth": settings.smooth,
            "passes": passes,
            **settings.model_dump(include={"alpha", "beta", "kappa"}),
            **said_of_hold(recognised),
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
                    f"no initial deviation can be told for '{name}': from its start value the model diverges or no "
                    "output feels it; name it in initial_std"
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
