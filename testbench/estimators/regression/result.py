"""The result of a regression: parameters with errors that count the colour of the residuals, and doubts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from testbench.core.advice import Advised, as_json
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.regression.data import Recipe, RegressionData, regression_data

Domain = Literal["time", "frequency"]


@dataclass(frozen=True, eq=False, kw_only=True)
class RegressionResult(Advised):
    """target = sum of params x terms + residual.

    Attributes:
        target: signal that was explained.
        terms: (k,) names; the constant, where there is one, is the last and called "1".
        params: (k,) estimates, SI units of target per term.
        covariance: (k, k) of the estimates, corrected for coloured residuals.
        std_plain: (k,) standard errors as if residuals were white; with coloured residuals they are too small.
        std_corrected: (k,) square roots of the diagonal of ``covariance``: the ones to use.
        r2: coefficient of determination, 1 - residual energy / energy of the target about its mean.
        residual_rms: root mean square of the residuals (of the transform per frequency, in the frequency domain).
        autocorrelation: (lags,) of the residuals, divided by its value at lag 0; empty in the frequency domain.
        vif: (k,) variance inflation factors 1 / (1 - R_j^2), R_j^2 of a term on all others; 1 for "1".
        correlation: (k', k') correlation of the terms without "1", in their order.
        condition: condition number of the terms without "1", centred and scaled to unit length.
        samples: samples (or real and imaginary parts of frequencies) that were used.
        dt_s: sample time, s.
        domain: "time" or "frequency", the latter with ``band_hz``.
        recipe: how the signals were made from the record.
        settings: settings of the method, as JSON values.
        advice: what is wrong or doubtful and what to do about it; ``status`` follows from it.
    """

    target: str
    terms: tuple[str, ...]
    params: FloatArray
    covariance: FloatArray
    std_plain: FloatArray
    std_corrected: FloatArray
    r2: float
    residual_rms: float
    autocorrelation: FloatArray
    vif: FloatArray
    correlation: FloatArray
    condition: float
    samples: int
    dt_s: float
    domain: Domain = "time"
    band_hz: tuple[float, float] | None = None
    recipe: Recipe = field(default_factory=Recipe)
    settings: Mapping[str, Any] = field(default_factory=dict)
    advice: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k = len(self.terms)
        shapes = {"params": (k,), "covariance": (k, k), "std_plain": (k,), "std_corrected": (k,), "vif": (k,)}
        for name in (*shapes, "autocorrelation", "correlation"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.all(np.isfinite(array)) or array.shape != shapes.get(name, array.shape):
                raise EstimationError(f"{name} must be finite and of shape {shapes.get(name)}, got {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "settings", MappingProxyType(dict(self.settings)))

    def __getitem__(self, term: str) -> float:
        return float(self.params[self.index(term)])

    def index(self, term: str) -> int:
        """Return the position of ``term``.

        Raises:
            EstimationError: the result has no such term.
        """
        if term not in self.terms:
            raise EstimationError(f"a term must be one of {', '.join(self.terms)}, got '{term}'")
        return self.terms.index(term)

    def std(self, term: str) -> float:
        """Return the corrected standard error of one term."""
        return float(self.std_corrected[self.index(term)])

    @property
    def t_statistics(self) -> FloatArray:
        """Estimates divided by their corrected standard errors, (k,); infinite where the error is zero."""
        out = np.where(self.params == 0.0, 0.0, np.copysign(np.inf, self.params))
        np.divide(self.params, self.std_corrected, out=out, where=self.std_corrected > 0.0)
        return out

    def predict(self, data: FlightRecord | RegressionData) -> FloatArray:
        """Return the target (n,) that the terms of a record give; a result without "1" predicts about an unknown level.

        Raises:
            ChannelError: a signal is not there and cannot be made.
            EstimationError: the record is of kind "truth".
        """
        if isinstance(data, FlightRecord):
            r = self.recipe
            data = regression_data(
                data,
                r.mass,
                density_kg_m3=r.density_kg_m3,
                unpowered=r.unpowered,
                symmetric=r.symmetric,
                differentiation=r.differentiation,
            )
        return np.asarray(data.matrix(self.terms) @ self.params)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON values."""

        def by_term(values: FloatArray) -> dict[str, float]:
            return dict(zip(self.terms, values.tolist(), strict=True))

        return {
            "target": self.target,
            "domain": self.domain,
            "band_hz": None if self.band_hz is None else list(self.band_hz),
            "params": by_term(self.params),
            "std_corrected": by_term(self.std_corrected),
            "std_plain": by_term(self.std_plain),
            "vif": by_term(self.vif),
            "covariance": self.covariance.tolist(),
            "r2": self.r2,
            "residual_rms": self.residual_rms,
            "condition": self.condition,
            "samples": self.samples,
            "dt_s": self.dt_s,
            "recipe": asdict(self.recipe),
            "settings": dict(self.settings),
            "status": self.status,
            "advice": as_json(self.advice),
        }
