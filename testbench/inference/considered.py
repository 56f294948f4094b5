"""What errors of instruments do to estimated parameters: a consider analysis.

An estimator takes its records as they are read. Every instrument has errors that it knows nothing of: scale, clock,
lag, place. To first order the estimates move by

    theta(e) = theta(0) + K e,     K = P sum S' R^-1 d(y - model)/de,

with the sensitivities S of the outputs, the covariance R of the residuals and P = (sum S' R^-1 S)^-1. With the errors'
covariance the covariance of the estimates becomes P + K P_e K' (S. F. Schmidt, "Application of state-space methods to
navigation problems", Advances in Control Systems 3, 1966; B. D. Tapley, B. E. Schutz and G. H. Born, Statistical Orbit
Determination, 2004, section 6.5, "consider covariance").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.model import ParametricModel
from testbench.inference.instruments import Agreement, sound, without_errors

_LINEAR = 1e-3  # of its effect, to which what an error does is linear
_STEP = 0.1  # of an error's standard deviation, over which its effect is taken


@dataclass(frozen=True, eq=False)
class Considered:
    """Errors of instruments and what they do to the parameters of a model.

    Attributes:
        errors: (e,) names, CHANNEL_KIND.
        moments: (e, e) second moments about what was taken for them.
        gain: (k, e) by how much the parameters are read wrong, by each; zero for those that are not free.
    """

    errors: tuple[str, ...]
    moments: FloatArray
    gain: FloatArray

    @property
    def parameters_covariance(self) -> FloatArray:
        """(k, k), of the parameters, by the errors of instruments alone."""
        added = self.gain @ self.moments @ self.gain.T
        return np.asarray(added + _LINEAR**2 * np.diag(np.diag(added)))  # few errors, many parameters: not singular


def considered(
    model: ParametricModel,
    records: Sequence[FlightRecord],
    found: Agreement,
    taken: Mapping[str, float],
    known_std: Mapping[str, float],
) -> Considered:
    """Return what the errors of instruments do to the parameters of a model.

    Args:
        model: what was identified.
        records: prepared, that it was identified from.
        found: what kinematics say of the instruments; channels that they do not foretell have the errors of sound ones.
        taken: errors that were taken out of the records; what is left of them is not known to be anything.
        known_std: CHANNEL_KIND -> standard deviation of that error of a sound instrument, where it is known.

    Raises:
        EstimationError: the records do not decide the parameters.
    """
    channels = [c for c in (*model.inputs, *model.outputs) if all(c in r for r in records)]
    late = [f"{name}_late" for name in model.settings.get("late_std_s", {})]  # which the model estimates
    names, moments = _second_moments(channels, found, taken, known_std, records[0].dt_s, late)
    plain = Likelihood.of(model, records)
    R = model.noise_covariance if np.all(np.diag(model.noise_covariance) > 0.0) else np.diag(plain.size**2)
    whiten = np.linalg.inv(np.linalg.cholesky(R))
    point, (left, slopes) = at_rest(plain, model.params, whiten)
    pseudo = np.linalg.pinv(slopes, rcond=1e-10)
    gain = np.zeros((model.params.size, len(names)))
    for i, (name, std) in enumerate(zip(names, np.sqrt(np.diag(moments)), strict=True)):
        step = _STEP * float(std)
        if step == 0.0:
            continue
        # The sample at an end that a moved clock has no value for still counts, as it does in the sensitivities.
        read = [replace(without_errors(r, {name: -step}), valid=r.valid) for r in records]
        moved = Likelihood.of(model, read)
        residuals = np.concatenate([(v @ whiten.T).ravel() for v in moved.residuals(point, model.params)])
        shift = -pseudo @ (residuals - left) / step
        gain[plain.layout.chosen, i] = shift[: plain.layout.chosen.size]
    return Considered(names, moments, gain)


def _second_moments(
    channels: Sequence[str],
    found: Agreement,
    taken: Mapping[str, float],
    known_std: Mapping[str, float],
    dt_s: float,
    estimated: Sequence[str],
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the errors that these channels may have, and their second moments about what was taken out."""
    known = [i for i, n in enumerate(found.errors) if _moves(n, channels) and n not in estimated]
    names = [found.errors[i] for i in known]
    sounds = {n: known_std.get(n, s) for c in channels for n, s in sound(c, dt_s).items()}
    priors = {n: s for n, s in sounds.items() if n not in names and n not in estimated}
    left = found.errors_mean[known] - np.array([taken.get(n, 0.0) for n in names])
    moments = np.diag([*np.zeros(len(known)), *(s**2 for s in priors.values())])
    moments[: len(known), : len(known)] = found.errors_covariance[np.ix_(known, known)] + np.outer(left, left)
    return (*names, *priors), moments


def _moves(name: str, channels: Sequence[str]) -> bool:
    """Return whether an error moves what is identified from: a zero is taken out with the trim."""
    channel, _, kind = name.rpartition("_")
    return channel in channels and kind in ("scale", "late", "lag", "place")


def at_rest(
    likelihood: Likelihood, params: FloatArray, whiten: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """Return the point with the nuisances that fit best, white residuals there (n,), and sensitivities (n, u)."""
    point = likelihood.start(params)
    f = likelihood.layout.chosen.size
    left, slopes = _white(likelihood, point, params, whiten)
    step = np.linalg.lstsq(slopes[:, f:], -left, rcond=1e-10)[0]
    point = np.concatenate([point[:f], point[f:] + step])
    return point, _white(likelihood, point, params, whiten)


def _white(
    likelihood: Likelihood, point: FloatArray, params: FloatArray, whiten: FloatArray
) -> tuple[FloatArray, FloatArray]:
    residuals, rows = [], []
    for v, s in likelihood.evaluate(point, params):
        wide = np.zeros((v.size, likelihood.unknowns))
        wide[:, s.columns] = (whiten @ s.values).reshape(v.size, -1)
        residuals.append((v @ whiten.T).ravel())
        rows.append(wide)
    return np.concatenate(residuals), np.vstack(rows)
