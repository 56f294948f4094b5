"""What the kinematics say about the instruments of records: each error with its significance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from testbench.core.advice import Advised, as_json
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.kinematics import (
    KinematicStructure,
)

INSTRUMENT_ERROR = "instrument_error"
"""The code of the advice that names one error."""


@dataclass(frozen=True)
class InstrumentError:
    """One error of an instrument, or one component of the wind.

    Attributes:
        name: channel and kind, e.g. ``alpha_scale``.
        estimate: SI; a scale is 1 for none, everything else 0.
        standard_error: corrected for residuals that are not white.
        significance: deviation from none over standard error.
        words: what it means.
        alternatives: other errors that would explain the data as well, in words.
    """

    name: str
    estimate: float
    standard_error: float
    significance: float
    words: str
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class DataCompatibility(Advised):
    """What the kinematics say about the instruments of one or several records.

    Attributes:
        structure: the kinematics with which the records were compared.
        errors: those that are significant; ``covariance`` (k, k) in their order.
        tested: every error that the data can tell, all estimated together.
        not_identifiable: error -> why these data do not tell it.
        reconstructed: the records as the kinematics rebuild them from the corrected rates and accelerations; channels
            that the kinematics do not know are as they were.
        residual_before, residual_after: output -> rms of measured minus rebuilt, SI, all records; before with no error
            allowed for, after with ``errors``.
        settings, diagnostics: the settings, and how the search went.
        advice: the errors found and what is doubtful, see :mod:`testbench.core.advice`; ``status`` follows from it.
    """

    structure: KinematicStructure
    errors: tuple[InstrumentError, ...]
    covariance: FloatArray
    tested: tuple[InstrumentError, ...]
    not_identifiable: Mapping[str, str]
    reconstructed: tuple[FlightRecord, ...]
    residual_before: Mapping[str, float]
    residual_after: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    advice: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Significant error -> estimate, SI."""
        return {e.name: e.estimate for e in self.errors}

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the records as JSON values."""

        def table(rows: Sequence[InstrumentError]) -> list[dict[str, Any]]:
            return [{**vars(e), "alternatives": list(e.alternatives)} for e in rows]

        return {
            "motion": self.structure.motion,
            "inputs": list(self.structure.inputs),
            "outputs": list(self.structure.outputs),
            "errors": table(self.errors),
            "covariance": self.covariance.tolist(),
            "tested": table(self.tested),
            "not_identifiable": dict(self.not_identifiable),
            "residual_before": dict(self.residual_before),
            "residual_after": dict(self.residual_after),
            "settings": dict(self.settings),
            "diagnostics": dict(self.diagnostics),
            "status": self.status,
            "advice": as_json(self.advice),
        }
