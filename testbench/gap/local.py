"""A hypothesis flown in JSBSim, and the linear differences around it on which fits run ten times faster."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.errors import LimitError, TrimError
from testbench.gap.believed import NUISANCES, Believed, tuning
from testbench.record import FlightRecord, FloatArray

_TUNING_STEP = 0.02
_MAX_STEP = 0.15  # largest change of a nuisance factor per round, so that thrust and trim stay within reach
_PRIOR = np.array(list(NUISANCES.values()))


@dataclass(frozen=True, eq=False)
class Local:
    """One hypothesis, its residuals as flown, and its neighbourhood.

    Residuals of a neighbour are those flown here plus the difference of the two linear predictions. The difference of
    two linear models is right to second order although neither is; where a fit comes to rest, the neighbour is the
    point itself and the residual is JSBSim's.

    Attributes:
        believed: the believed model without any effect.
        model: the hypothesis (believed, or with an effect), nuisances not tuned.
        records: the naming records.
        factors: (k,) nuisance factors of the point.
        exact: (samples,) residuals flown in JSBSim, in units of the noise.
        linear: (samples,) linear prediction in the same units.
    """

    believed: Believed
    model: Believed
    records: tuple[FlightRecord, ...]
    factors: FloatArray
    exact: FloatArray
    linear: FloatArray

    @classmethod
    def at(cls, believed: Believed, model: Believed, records: tuple[FlightRecord, ...], factors: FloatArray) -> Local:
        """Fly ``model`` with its nuisances at ``factors``.

        Raises:
            FlightAborted, TrimError, LimitError: it cannot fly the measured commands.
        """
        tuned = model.with_tuning(tuning(factors))
        exact = np.concatenate([tuned.residuals(r).ravel() for r in records])
        return cls(believed, model, records, factors, exact, _linear(tuned, records))

    @property
    def chi2(self) -> float:
        """Weighted sum of squares of the flown residuals, plus the price of the nuisances."""
        return float(self.exact @ self.exact + np.sum(((self.factors - 1.0) / _PRIOR) ** 2))

    @property
    def lost(self) -> FloatArray:
        """Residuals that stand for a hypothesis that cannot be flown: ten times those of here."""
        return 10.0 * np.concatenate([self.exact, (self.factors - 1.0) / _PRIOR])

    @cached_property
    def tangents(self) -> FloatArray:
        """Return d residuals / d factors at the point, (samples, k), central differences of the linear predictions."""
        columns = []
        for i in range(_PRIOR.size):
            step = _TUNING_STEP * np.eye(_PRIOR.size)[i]
            up, down = (
                _linear(self.model.with_tuning(tuning(self.factors + s * step)), self.records) for s in (1.0, -1.0)
            )
            columns.append((down - up) / (2.0 * _TUNING_STEP))
        return np.column_stack(columns)

    def residuals(self, model: Believed) -> FloatArray | None:
        """Return the residuals (samples,) of a neighbour at the same factors; None if it cannot be trimmed."""
        try:
            return self.exact + self.linear - _linear(model.with_tuning(tuning(self.factors)), self.records)
        except (TrimError, LimitError):
            return None

    def tuned(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals after re-tuning the nuisances, extended by the price of it, and the new factors (k,).

        Minimises |r + J d|^2 + |(factors + d - 1) / s|^2 over d: maximum a posteriori with Gaussian priors of standard
        deviation s about the believed values.
        """
        J = np.vstack([self.tangents, np.diag(1.0 / _PRIOR)])
        r = np.concatenate([residuals, (self.factors - 1.0) / _PRIOR])
        d = -np.linalg.solve(J.T @ J, J.T @ r)
        return r + J @ d, self.factors + d

    def towards(self, factors: FloatArray) -> FloatArray:
        """Return ``factors``, or as far on the way to them as one round may go."""
        step = factors - self.factors
        return self.factors + step * min(1.0, _MAX_STEP / max(float(np.max(np.abs(step))), 1e-12))

    def cost(self, model: Believed) -> float:
        """Return the sum of squares of a neighbour after re-tuning; infinite if it cannot be trimmed."""
        residuals = self.residuals(model)
        if residuals is None:
            return float("inf")
        left = self.tuned(residuals)[0]
        return float(left @ left)


def _linear(model: Believed, records: tuple[FlightRecord, ...]) -> FloatArray:
    return np.concatenate([model.in_noise_units(r, model.predict_linear(r)).ravel() for r in records])
