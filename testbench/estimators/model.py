"""The identified model that every estimator returns: it simulates, and has poles and a frequency response."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advised
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedModel(Advised, ABC):
    """A model of deviations from trim, inputs u to outputs y, identified from records.

    Attributes:
        method: the estimator's name in the scenario, e.g. "dsr_e".
        inputs: (m,) names of the input channels.
        outputs: (p,) names of the output channels.
        dt_s: sample time of the records that it was identified from, s.
        settings: the estimator's settings, as JSON values.
        diagnostics: intermediate results (singular values, condition numbers), arrays or JSON values.
        advice: what is wrong or doubtful and what to do about it; ``status`` follows from it.
        provenance: whose code made it, as JSON values: file and SHA-256 of a user's code; empty for packaged code.

    ``continuous`` is True for models of continuous time: their frequency response is that of the aircraft; the response
    of a discrete model includes the hold of sampled inputs.
    """

    continuous: ClassVar[bool] = False
    method: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt_s: float
    settings: Mapping[str, Any] = field(default_factory=dict)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    advice: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @abstractmethod
    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the outputs (n, p) that the model predicts from the record's inputs alone.

        The initial state is estimated from the record by least squares; nothing else of its outputs is used.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
        """

    def predict(self, record: FlightRecord) -> FloatArray:
        """Return the same of a record that the model was not identified from, whose own trim may be another."""
        return self.simulate(record)

    @abstractmethod
    def poles(self) -> dict[str, ComplexArray]:
        """Return the continuous-time poles in rad/s, by the outputs they belong to.

        A state-space model has one set under all outputs' names joined by ", "; transfer functions one set per output.
        Poles without a continuous counterpart (real z <= 0) are left out here and listed in ``diagnostics``.
        """

    @abstractmethod
    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return the response at ``omega_rad_s`` (k,), shape (k, p, m), in SI units per SI unit."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the model as JSON values: names, sample time, matrices or polynomials, status and advice."""

    def written(self) -> dict[str, Any]:
        """Return :meth:`to_dict`, and whose code made the model, which a user's class may leave out."""
        return self.to_dict() | ({"provenance": dict(self.provenance)} if self.provenance else {})

    @abstractmethod
    def to_control(self) -> Any:
        """Return the model as a python-control system with named inputs and outputs."""


def check_records(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str]
) -> list[tuple[FloatArray, FloatArray]]:
    """Return (u, y) of shapes (n, m) and (n, p) per record, after checking that an estimator may use them.

    Raises:
        EstimationError: no record, a record of kind "truth", different sample times, or an input that never moves.
        ChannelError: a record lacks a channel.
    """
    if not records:
        raise EstimationError("an estimate needs at least one record, got none")
    for record in records:
        if record.kind != "measured":
            raise EstimationError(f"estimators take measured records only, got one of kind '{record.kind}'")
    steps = [record.dt_s for record in records]
    if max(steps) - min(steps) > 0.01 * min(steps):
        raise EstimationError(
            f"records must share one sample time, got {min(steps):g} to {max(steps):g} s; resample them"
        )
    data = [(record.columns(inputs), record.columns(outputs)) for record in records]
    spread = np.max([np.ptp(u, axis=0) for u, _ in data], axis=0)
    for name, moved in zip(inputs, spread, strict=True):
        if moved == 0.0:
            raise EstimationError(f"input '{name}' never moves in these records: its effect is not identifiable")
    return data


def continuous_poles(z: ComplexArray, dt_s: float) -> tuple[ComplexArray, ComplexArray]:
    """Return the continuous poles ln(z)/dt of the discrete poles that have one, and the discrete poles that have none.

    A real z <= 0 has no real continuous counterpart (its logarithm sits at the Nyquist frequency without a conjugate).
    """
    z = np.asarray(z, np.complex128)
    none = (np.abs(z.imag) <= 1e-12 * np.maximum(np.abs(z), 1e-300)) & (z.real <= 0.0)
    return np.asarray(np.log(z[~none]) / dt_s, np.complex128), z[none]
