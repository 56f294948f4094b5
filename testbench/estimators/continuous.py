"""ContinuousTransferModel: transfer functions in continuous time with delays, and their covariance.

The estimators ``srivc`` (time domain) and ``frequency.equivalent`` (frequency responses) both return it.

State-variable filters: s^k / A(s) of sampled signals in continuous time, exact for held or ramped inputs and delays.

Between its samples an input is held ("zoh") or joined by straight lines ("foh"). Commands of a computer are held;
measured deflections are smooth, and straight lines are nearer to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.hold import held
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.settings import Hold
from testbench.estimators.state_space import Trajectories, description

# --- state-variable filters -------------------------------------------------------------------------------------------


_ON_SAMPLE = 1e-9  # fractions of a sample below this are rounding


def holds(
    inputs: Sequence[str], given: Mapping[str, Hold] | Hold | None, records: Sequence[FlightRecord] = ()
) -> tuple[tuple[Hold, ...], tuple[str, ...]]:
    """Return how each input runs between its samples, and the names of those of which only the records say so.

    As ``given``, else "zoh" for commands and for what the records show to be held, and "foh" for the rest.

    Args:
        inputs: (m,) channel names; those that end in ``_cmd`` are commands.
        given: one word for all inputs, or input -> word; None for the default.
        records: what is identified from.

    Raises:
        EstimationError: an input is unknown.
    """
    asked: Mapping[str, Hold] = dict.fromkeys(inputs, given) if isinstance(given, str) else given or {}
    for name in asked:
        if name not in inputs:
            raise EstimationError(f"hold must name inputs only, got '{name}'{nearest(name, inputs)}")
    found, recognised = held(inputs, [asked[n] == "zoh" if n in asked else None for n in inputs], records)
    table: dict[str, Hold] = {n: asked.get(n, "zoh" if h else "foh") for n, h in zip(inputs, found, strict=True)}
    return tuple(table[name] for name in inputs), recognised


def shifted(v: FloatArray, samples: int) -> FloatArray:
    """Return v[k - samples] (N,); before the first and after the last sample these hold."""
    return v[np.clip(np.arange(v.size) - samples, 0, v.size - 1)]


def _split(delay_samples: float) -> tuple[int, float]:
    """Return a delay as whole samples and a rest in [0, 1)."""
    whole = int(np.floor(delay_samples + _ON_SAMPLE))
    rest = delay_samples - whole
    return whole, rest if rest > _ON_SAMPLE else 0.0


def delayed(v: FloatArray, hold: Hold, delay_samples: float) -> FloatArray:
    """Return v(t_k - delay) (N,) of a signal between samples as ``hold`` says."""
    d, f = _split(delay_samples)
    now, before = shifted(v, d), shifted(v, d + 1)
    if f == 0.0:
        return now
    return before if hold == "zoh" else now + f * (before - now)


def _exponential(M: FloatArray) -> FloatArray:
    """Return exp(M) of a small matrix: Taylor series after halving, squared back.

    scipy's routine hands matrices of this size to threaded BLAS, which takes a hundred times as long.
    """
    norm = float(np.max(np.sum(np.abs(M), axis=0)))
    halvings = max(0, int(np.ceil(np.log2(norm / 0.5)))) if norm > 0.0 else 0
    M = M / 2.0**halvings
    term = out = np.eye(len(M))
    for k in range(1, 15):  # 0.5^15 / 15! lies below rounding
        term = term @ M / k
        out = out + term
    for _ in range(halvings):
        out = out @ out
    return out


class StateVariableFilter:
    """The filters s^(n-1)/A(s), ..., s/A(s), 1/A(s) on a grid of ``samples`` samples, from rest.

    Controllable canonical form dx/dt = F x + e1 v, x_i = s^(n-i)/A v, in time scaled by the geometric mean of the
    poles so that the states are of one size; stepped by matrix exponentials (Van Loan 1978), so that nothing but
    the course of v between samples is assumed.

    Args:
        a: (n + 1,) coefficients 1, a1 ... an of A(s), highest power first, n >= 1.
        dt_s: sample time, s.
        samples: number of samples N.

    Raises:
        EstimationError: a pole grows beyond all numbers within one sample.
    """

    def __init__(self, a: FloatArray, dt_s: float, samples: int) -> None:
        n = a.size - 1
        sizes = np.abs(np.roots(a))
        sizes = sizes[sizes > 1e-6 / dt_s / max(samples, 1)]
        self._scale = float(np.exp(np.mean(np.log(sizes)))) if sizes.size else 1.0 / dt_s
        self._powers = self._scale ** -np.arange(1.0, n + 1.0)
        self._F = np.diag(np.ones(n - 1), -1)
        self._F[0] = -a[1:] * self._powers
        self._e = np.eye(n, 1)
        self._h = dt_s * self._scale
        self._known: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = {}
        self.a, self.order, self.samples = a, n, samples
        with np.errstate(all="ignore"):
            step = self._moments(1.0)[0]
        if not np.all(np.isfinite(step)):
            fastest = float(np.max(np.roots(a).real))
            raise EstimationError(
                f"a pole must not grow beyond all numbers within a sample of {dt_s:g} s, got one at {fastest:.3g} 1/s"
            )
        self._paths = Trajectories(step, samples)

    def _moments(self, part: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return exp(F h), the response to v = 1 and to a v that rises from 0 to 1 over h = part of a sample."""
        if part in self._known:
            return self._known[part]
        n, h = self.order, part * self._h
        M = np.zeros((n + 2, n + 2))
        M[:n, :n], M[:n, n], M[n, n + 1] = self._F * h, self._e[:, 0] * h, 1.0
        out = _exponential(M)
        self._known[part] = out[:n, :n], out[:n, n], out[:n, n + 1]
        return self._known[part]

    def _forcing(self, v: FloatArray, hold: Hold, delay_samples: float) -> FloatArray:
        """Return what v adds to the state over each sample, (N, n)."""
        d, f = _split(delay_samples)
        knot = shifted(v, d)
        _, flat, ramp = self._moments(1.0 - f)
        if hold == "zoh":
            out = np.outer(knot, flat)
            if f > 0.0:
                across = self._moments(1.0 - f)[0]
                out += np.outer(shifted(v, d + 1), across @ self._moments(f)[1])
            return out
        begin = delayed(v, hold, delay_samples)
        end = delayed(v, hold, delay_samples - 1.0)
        out = np.outer(knot, flat) + np.outer(end - knot, ramp)
        if f > 0.0:
            across = self._moments(1.0 - f)[0]
            _, flat, ramp = self._moments(f)
            out += (np.outer(begin, flat) + np.outer(knot - begin, ramp)) @ across.T
        return out

    def states(self, v: FloatArray, hold: Sequence[Hold], delay_samples: Sequence[float]) -> FloatArray:
        """Return s^(n-i)/A v for i = 1 ... n of the columns of v (N, b), shape (N, n, b).

        For poles that grow by more than a factor 1000 over the grid they are those from another initial state (see
        :class:`~testbench.estimators.state_space.Trajectories`).
        """
        forcing = [self._forcing(column, word, d) for column, word, d in zip(v.T, hold, delay_samples, strict=True)]
        x = self._paths.forced(np.stack(forcing, axis=2))
        return np.asarray(x * self._powers[:, None])

    def free(self) -> FloatArray:
        """Return a basis (N, n) of the free responses: the solutions of A(d/dt) y = 0."""
        return self._paths.free()[:, -1]

    def output(self, b: FloatArray, states: FloatArray, v: FloatArray) -> FloatArray:
        """Return B(s)/A(s) v (N,) from the states (N, n) of v and v itself, delayed alike.

        Args:
            b: (n + 1,) coefficients of s^n ... 1.
            states: (N, n) of :meth:`states`.
            v: (N,) of :func:`delayed`.
        """
        return np.asarray(states @ (b[1:] - b[0] * self.a[1:]) + b[0] * v)


# --- the continuous model ---------------------------------------------------------------------------------------------


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
