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
    """Errors of instruments and what they do to the parameters of a model."""

    errors: tuple[str, ...]  # (e,) names, CHANNEL_KIND
    moments: FloatArray  # (e, e) second moments about what was taken for them
    gain: FloatArray  # (k, e) by how much the parameters are read wrong, by each; zero for those that are not free

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
    """Return what the errors of instruments do to the parameters of a model, identified from prepared records.

    Channels that kinematics do not foretell (``found``) have the errors of sound instruments, of the standard deviation
    ``known_std`` where that is known; what is left of errors that were ``taken`` out is not known to be anything.
    """
    channels = [c for c in (*model.inputs, *model.outputs) if all(c in r for r in records)]
    late = [f"{name}_late" for name in model.settings.get("late_std_s", {})]  # which the model estimates
    each = [(i, n, *n.rpartition("_")[::2]) for i, n in enumerate(found.errors) if n not in late]
    known = [i for i, _, c, kind in each if c in channels and kind in ("scale", "late", "lag", "place")]  # not a zero
    own = [found.errors[i] for i in known]
    sounds = {n: known_std.get(n, s) for c in channels for n, s in sound(c, records[0].dt_s).items()}
    priors = {n: s for n, s in sounds.items() if n not in own and n not in late}
    names, left = (*own, *priors), found.errors_mean[known] - np.array([taken.get(n, 0.0) for n in own])
    moments = np.diag([*np.zeros(len(known)), *(s**2 for s in priors.values())])  # about what was taken out
    moments[: len(known), : len(known)] = found.errors_covariance[np.ix_(known, known)] + np.outer(left, left)
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
