"""ContinuousTransferModel: transfer functions in continuous time with delays, and their covariance.

The estimators ``srivc`` (time domain) and ``frequency.equivalent`` (frequency responses) both return it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.state_space import description
from testbench.estimators.state_variable import Hold, StateVariableFilter, delayed

_RCOND = 1e-12


class Mode(NamedTuple):
    """A pole with its standard errors: frequency wn in rad/s and damping ratio, NaN errors where there are none."""

    pole: complex
    wn_rad_s: float
    zeta: float
    wn_error_rad_s: float
    zeta_error: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ContinuousTransferModel(IdentifiedModel):
    """y_i(t) = sum_j B_ij(s) / A_i(s) u_j(t - tau_ij) (+ a constant per record where ``offset`` says so).

    Attributes:
        numerators: (p, m, n + 1) coefficients of s^n ... 1 of B_ij, zeros first where its degree is lower.
        denominators: (p, n + 1) coefficients of A_i, zeros first where its degree is lower, then 1, a1, ...
        delays_s: (p, m) delays tau, s.
        hold: (m,) "zoh" or "foh": how each input runs between its samples.
        offset: True if a constant per record and output, a wrong trim value, is fitted with the initial state.
        parameter_names: (q,) "q: a1", "q/de: b0", "q/de: delay_s"; without the output, "a1", where all share A.
            b0 belongs to s^0, b1 to s^1; a_i to s^(n-i).
        parameters: (q,) their values.
        covariance: (q, q), or shape (0, 0) if there is none.
    """

    continuous: ClassVar[bool] = True
    numerators: FloatArray
    denominators: FloatArray
    delays_s: FloatArray
    hold: tuple[Hold, ...]
    offset: bool = False
    parameter_names: tuple[str, ...] = ()
    parameters: FloatArray = None  # type: ignore[assignment]
    covariance: FloatArray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        p, m, n = len(self.outputs), len(self.inputs), np.shape(self.denominators)[-1] - 1
        q = len(self.parameter_names)
        for name, value in (("parameters", np.zeros(0)), ("covariance", np.zeros((0, 0)))):
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        shapes = {"numerators": (p, m, n + 1), "denominators": (p, n + 1), "delays_s": (p, m), "parameters": (q,)}
        if np.size(self.covariance):
            shapes["covariance"] = (q, q)
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got {array_found(array)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if len(self.hold) != m or np.any(self.delays_s < 0.0):
            raise EstimationError(
                f"a model needs one hold per input and delays >= 0, got {len(self.hold)} holds for {m} inputs and "
                f"delays from {np.min(self.delays_s, initial=0.0):g} s"
            )

    def _denominator(self, i: int) -> FloatArray:
        return np.asarray(np.trim_zeros(self.denominators[i], "f"))

    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the free-run outputs (N, p); the initial state of each output fits its valid samples best.

        The model lives in continuous time: any sample time will do. Before the record the inputs hold their first
        values.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            EstimationError: a pole grows beyond all numbers within a sample of the record.
        """
        u, part = record.columns(self.inputs), record.select(self.outputs)
        out = np.zeros(part.data.shape)
        for i in range(len(self.outputs)):
            a = self._denominator(i)
            filters = StateVariableFilter(a, record.dt_s, len(record))
            samples = self.delays_s[i] / record.dt_s
            x = filters.states(u, self.hold, samples)
            forced = np.zeros(len(record))
            for j, word in enumerate(self.hold):
                b = self.numerators[i, j, -a.size :]
                forced += filters.output(b, x[:, :, j], delayed(u[:, j], word, samples[j]))
            free = free_basis(filters, self.offset)
            out[:, i] = forced + free @ fit_free(free, part.data[:, i] - forced, part.valid[:, i])
        return out

    def poles(self) -> dict[str, ComplexArray]:
        """Return the poles in rad/s: one set per output, or one under all names joined by ", " where all share A."""
        names = [", ".join(self.outputs)] if self.common else list(self.outputs)
        return {name: np.roots(self._denominator(i)).astype(np.complex128) for i, name in enumerate(names)}

    @property
    def common(self) -> bool:
        """True if several outputs share one denominator, estimated once."""
        return len(self.outputs) > 1 and "a1" in self.parameter_names

    def zeros(self, output: str, given: str) -> ComplexArray:
        """Return the zeros in rad/s from input ``given`` to ``output``."""
        b = self.numerators[self.outputs.index(output), self.inputs.index(given)]
        return np.roots(b).astype(np.complex128)

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return B(jw) / A(jw) exp(-jw tau), shape (k, p, m): without the hold of the inputs.

        Raises:
            EstimationError: a frequency lies on a pole of the model.
        """
        s = 1j * np.atleast_1d(np.asarray(omega_rad_s, dtype=np.float64))
        out = np.empty((s.size, len(self.outputs), len(self.inputs)), np.complex128)
        for i in range(len(self.outputs)):
            below = np.polyval(self.denominators[i], s)
            if np.any(below == 0.0):
                raise EstimationError("the frequency response is infinite at a pole; choose frequencies off the poles")
            for j in range(len(self.inputs)):
                out[:, i, j] = np.polyval(self.numerators[i, j], s) / below * np.exp(-s * self.delays_s[i, j])
        return out

    @property
    def standard_errors(self) -> dict[str, float]:
        """Parameter name -> standard error; empty where there is no covariance."""
        if not self.covariance.size:
            return {}
        return dict(zip(self.parameter_names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def modes(self) -> dict[str, tuple[Mode, ...]]:
        """Return the poles with the standard errors of wn and zeta, real poles and one of each pair, by output.

        To first order: A(s) = 0 gives ds/da_i = -s^(n-i) / A'(s), the rest is the chain rule.
        """
        out = {}
        for i, (name, poles) in enumerate(self.poles().items()):
            a = self._denominator(i)
            n = a.size - 1
            prefix = "" if self.common else f"{name}: "
            rows = (
                [self.parameter_names.index(f"{prefix}a{k}") for k in range(1, n + 1)] if self.covariance.size else []
            )
            found = []
            for s in sorted((s for s in poles if s.imag >= 0.0), key=abs):
                wn = abs(s)
                slope = np.polyval(np.polyder(a), s)
                errors = [np.nan, np.nan]
                if rows and slope != 0.0 and wn > 0.0:
                    ds = -(s ** np.arange(n - 1.0, -1.0, -1.0)) / slope
                    dwn = np.real(np.conj(s) * ds) / wn
                    dzeta = -ds.real / wn + s.real * dwn / wn**2
                    P = self.covariance[np.ix_(rows, rows)]
                    errors = [float(np.sqrt(max(g @ P @ g, 0.0))) for g in (dwn, dzeta)]
                found.append(Mode(complex(s), float(wn), float(-s.real / wn) if wn else np.nan, *errors))
            out[name] = tuple(found)
        return out

    def to_dict(self) -> dict[str, Any]:
        """Return names, coefficients, delays, parameters and covariance, settings, status and advice as JSON values."""
        return {
            **description(self),
            "numerators": self.numerators.tolist(),
            "denominators": self.denominators.tolist(),
            "delays_s": self.delays_s.tolist(),
            "hold": list(self.hold),
            "offset": self.offset,
            "parameters": dict(zip(self.parameter_names, self.parameters.tolist(), strict=True)),
            "covariance": self.covariance.tolist(),
        }

    def to_control(self, pade_order: int = 4) -> Any:
        """Return the model as ``control.TransferFunction`` with signal names; delays as Pade approximations.

        Args:
            pade_order: order of the approximation of each delay; the phase is right to 1 deg up to w tau = 4.5 for
                order 4, 7.7 for order 6.
        """
        import control

        above: list[list[Any]] = []
        below: list[list[Any]] = []
        for i in range(len(self.outputs)):
            above.append([])
            below.append([])
            for j, tau in enumerate(self.delays_s[i]):
                num, den = control.pade(tau, pade_order) if tau > 0.0 else ([1.0], [1.0])
                b = np.trim_zeros(self.numerators[i, j], "f")
                above[i].append(np.polymul(b if b.size else [0.0], num))
                below[i].append(np.polymul(self._denominator(i), den))
        return control.tf(above, below, inputs=list(self.inputs), outputs=list(self.outputs))


def free_basis(filters: StateVariableFilter, offset: bool) -> FloatArray:
    """Return what may be added to the forced response: free responses and, if ``offset``, a constant; (N, n + 1)."""
    free = filters.free()
    return np.column_stack([free, np.ones(len(free))]) if offset else free


def fit_free(basis: FloatArray, rest: FloatArray, valid: Any) -> FloatArray:
    """Return the coefficients of ``basis`` (N, k) that fit the valid samples of ``rest`` (N,) best."""
    size = np.sqrt(np.sum(basis[valid] ** 2, axis=0))
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(basis[valid] / size, rest[valid], rcond=_RCOND)[0] / size)
