"""TransferFunctionModel: transfer functions in discrete time, one per output, from one input, each with its delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.model import ComplexArray, IdentifiedModel, continuous_poles
from testbench.estimators.state_space import Series, check_sample_time, description, free_run, unit_circle
from testbench.estimators.state_variable import shifted

_TURNS = 12  # of least squares and filter: short periods settle in six


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
                raise EstimationError(f"{name} must be finite and of shape {shape}, got {array_found(array)}")
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


def in_free_run(model: TransferFunctionModel, records: Sequence[FlightRecord]) -> TransferFunctionModel:
    """Return the model whose coefficients minimise the errors of the free run, where the search converges.

    Least squares of the equation on data filtered by 1 / A, in turns with A (K. Steiglitz and L. E. McBride, IEEE
    Transactions on Automatic Control 10, 1965): noise on the outputs does not bias its end. Poles outside the unit
    circle are mirrored into it. Initial states are left to the filter, samples that are not valid to their last value.
    """
    above, below = model.numerators.copy(), model.denominators.copy()
    for i, output in enumerate(model.outputs):
        num, den = np.flatnonzero(above[i]), 1 + np.flatnonzero(below[i, 1:])
        a = below[i]
        for _ in range(_TURNS):
            a = _inside(a)
            rows, right = [], []
            for record in records:
                u, y = record[model.inputs[0]], record[output]
                u, y = (lfilter([1.0], a, x - x[0]) for x in (shifted(u, model.delays[i]), y))
                one = lfilter([1.0], a, np.ones(len(y)))
                first = len(a) - 1
                late = [np.concatenate([np.zeros(k), -y[:-k]])[first:] for k in den]
                given = [np.concatenate([np.zeros(k + 1), u[: -(k + 1)]])[first:] for k in num]
                rows.append(np.stack([*late, *given, one[first:]], axis=1))
                right.append(y[first:])
            X = np.vstack(rows)
            size = np.maximum(np.sqrt(np.sum(X**2, axis=0)), 1e-300)
            found = np.linalg.lstsq(X / size, np.concatenate(right), rcond=1e-10)[0] / size
            a = np.zeros_like(a)
            a[0], a[den] = 1.0, found[: len(den)]
        below[i] = _inside(a)
        above[i, num] = found[len(den) : len(den) + len(num)]
    return replace(model, numerators=above, denominators=below)


def _inside(a: FloatArray) -> FloatArray:
    """Return the polynomial with roots outside the unit circle mirrored into it."""
    z = discrete_poles(a)
    z = np.where(np.abs(z) > 1.0, 1.0 / np.conj(np.where(z == 0.0, 1.0, z)), z)
    out = np.zeros_like(a)
    out[: len(z) + 1] = np.real(np.poly(z))
    return out


def simulate_one(b: FloatArray, a: FloatArray, delay: int, u: FloatArray, y: FloatArray, valid: Any) -> FloatArray:
    """Return the free run (N, 1) of one transfer function, in observer form: x[k+1] = A x + B u, y = x_1.

    The input (N, 1) comes ``delay`` samples late; before the record it holds its first value.
    """
    n = b.size
    A = np.zeros((n, n))
    A[:, 0] = -a[1:]
    A[:-1, 1:] = np.eye(n - 1)
    late = shifted(u[:, 0], delay)[:, None]
    return free_run(A, b[:, None], np.eye(1, n), np.zeros((1, 1)), Series(late, y, valid))
