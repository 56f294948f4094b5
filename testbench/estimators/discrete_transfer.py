"""TransferFunctionModel: transfer functions in discrete time, one per output, from one input, each with its delay."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import ComplexArray, IdentifiedModel, continuous_poles
from testbench.estimators.state_space import check_sample_time, description, free_run, unit_circle
from testbench.estimators.state_variable import shifted


@dataclass(frozen=True, eq=False, kw_only=True)
class TransferFunctionModel(IdentifiedModel):
    """y[k] = - a1 y[k-1] ... - an y[k-n] + b1 u[k-1-d] + ... + bn u[k-n-d], for each output by itself.

    Attributes:
        numerators: (p, n) coefficients b1 ... bn; those after the zeros that were asked for are zero.
        denominators: (p, n + 1) coefficients 1, a1 ... an; zeros last where an output has fewer poles than others.
        delays: (p,) whole samples d beyond the one that every output is late; none if not given.
    """

    numerators: FloatArray
    denominators: FloatArray
    delays: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "delays", tuple(int(d) for d in self.delays) or (0,) * len(self.outputs))
        if len(self.delays) != len(self.outputs) or min(self.delays, default=0) < 0:
            raise EstimationError(f"delays must be one whole number >= 0 per output, got {self.delays}")
        p, n = len(self.outputs), np.shape(self.denominators)[-1] - 1
        for name, shape in (("numerators", (p, n)), ("denominators", (p, n + 1))):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got shape {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the free-run outputs (N, p); the initial conditions of each output fit its valid samples best.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
        """
        check_sample_time(record, self.dt_s)
        u, part = record.columns(self.inputs), record.select(self.outputs)
        columns = [
            simulate_one(b, a, d, u, part.data[:, [i]], part.valid[:, [i]])
            for i, (b, a, d) in enumerate(zip(self.numerators, self.denominators, self.delays, strict=True))
        ]
        return np.hstack(columns)

    def poles(self) -> dict[str, ComplexArray]:
        """Return the continuous-time poles ln(z)/dt in rad/s of each output's transfer function."""
        return {
            name: continuous_poles(discrete_poles(a), self.dt_s)[0]
            for name, a in zip(self.outputs, self.denominators, strict=True)
        }

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return B(z) / A(z) z^-d at z = exp(j w dt), shape (k, p, 1).

        Raises:
            EstimationError: a frequency lies above the Nyquist frequency pi/dt, or on a pole of the model.
        """
        z = unit_circle(omega_rad_s, self.dt_s)
        below = np.stack([np.polyval(a, z) for a in self.denominators], axis=1)
        if np.any(below == 0.0):
            raise EstimationError("the frequency response is infinite at a pole; choose frequencies off the poles")
        above = np.stack([np.polyval(b, z) / z**d for b, d in zip(self.numerators, self.delays, strict=True)], axis=1)
        return np.asarray((above / below)[:, :, None], dtype=np.complex128)

    def to_dict(self) -> dict[str, Any]:
        """Return names, sample time, coefficients by output, settings, status and advice as JSON values."""
        return {
            **description(self),
            "numerators": dict(zip(self.outputs, self.numerators.tolist(), strict=True)),
            "denominators": dict(zip(self.outputs, self.denominators.tolist(), strict=True)),
            "delays": dict(zip(self.outputs, self.delays, strict=True)),
        }

    def to_control(self) -> Any:
        """Return the model as ``control.TransferFunction`` (p outputs, one input) with signal names."""
        import control

        above = [[b.tolist()] for b in self.numerators]
        below = [[[*a.tolist(), *[0.0] * d]] for a, d in zip(self.denominators, self.delays, strict=True)]
        return control.tf(above, below, self.dt_s, inputs=list(self.inputs), outputs=list(self.outputs))


def discrete_poles(a: FloatArray) -> ComplexArray:
    """Return the roots of 1 + a1 / z + ... + an / z^n, without zeros that only fill up the array."""
    return np.roots(np.trim_zeros(a, "b")).astype(np.complex128)


def simulate_one(b: FloatArray, a: FloatArray, delay: int, u: FloatArray, y: FloatArray, valid: Any) -> FloatArray:
    """Return the free run (N, 1) of one transfer function, in observer form: x[k+1] = A x + B u, y = x_1.

    The input (N, 1) comes ``delay`` samples late; before the record it holds its first value.
    """
    n = b.size
    A = np.zeros((n, n))
    A[:, 0] = -a[1:]
    A[:-1, 1:] = np.eye(n - 1)
    late = shifted(u[:, 0], delay)[:, None]
    return free_run(A, b[:, None], np.eye(1, n), np.zeros((1, 1)), late, y, valid)
