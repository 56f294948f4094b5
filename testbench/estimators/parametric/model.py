"""ParametricModel: a structure with estimated parameters, their covariance, and what it predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric.response import Sampling, delayed, respond
from testbench.estimators.parametric.structure import LinearStructure, Matrices, ModelStructure
from testbench.estimators.state_space import check_sample_time, description

_STATE_ITERATIONS = 20


class Mode(NamedTuple):
    """Natural frequency, rad/s, and damping ratio of a pole with standard errors from the parameter covariance."""

    pole: complex
    wn_rad_s: float
    zeta: float
    wn_std: float
    zeta_std: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ParametricModel(IdentifiedModel):
    """dx/dt = f(x, u, params), y = h(x, u, params) + noise, with estimated parameters."""

    continuous: ClassVar[bool] = True
    structure: ModelStructure  # the equations, with the settings of every parameter
    params: FloatArray  # (k,) estimates, fixed values among them
    covariance: FloatArray  # (k, k) of the estimates, corrected for coloured residuals; zero for fixed parameters
    covariance_plain: FloatArray  # (k, k) for residuals taken as white: the Cramer-Rao bound with the estimated noise
    noise_covariance: FloatArray  # (p, p) of the output residuals
    held: tuple[bool, ...]  # (m,) inputs that are held between samples; the others run linearly
    # (m,) delay of each input, s: known, with the mean over records of what was estimated besides
    delays_s: tuple[float, ...]
    # biased, trended: outputs that have a constant, and a line, of their own in every record
    biased: tuple[str, ...] = ()
    trended: tuple[str, ...] = ()
    biased_inputs: tuple[str, ...] = ()  # inputs that have a constant error of their own in every record
    # state (n,) and input (m,) that a nonlinear structure is linearised at
    operating_point: tuple[FloatArray, FloatArray]
    substeps: int = 1  # Runge-Kutta steps per sample of a nonlinear structure

    @property
    def values(self) -> dict[str, float]:
        """Parameter name -> estimate."""
        return dict(zip(self.structure.parameter_names, self.params.tolist(), strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Parameter name -> standard error, corrected for coloured residuals; 0 for fixed parameters."""
        return dict(zip(self.structure.parameter_names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the outputs (N, p) driven by the record's inputs.

        Initial state, constants and lines of ``biased`` and ``trended`` outputs and constants of ``biased_inputs`` are
        estimated from the record by least squares, each output weighted by its noise.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
            EstimationError: the model diverges over the record.
        """
        return self._simulated(record, (), self.biased)

    def predict(self, record: FlightRecord) -> FloatArray:
        """Return the outputs (N, p) of a record that the model was not identified from.

        As :meth:`simulate` does; and if what is left of trim was estimated, that of this record is, too, with a
        constant of every output: which trim was taken from a record is no property of the model.
        """
        names = self.structure.trim_constants
        trims = [i for i, p in enumerate(self.structure.parameters) if p.name in names and p.free]
        return self._simulated(record, trims, self.outputs if trims else self.biased)

    def _simulated(self, record: FlightRecord, trims: Sequence[int], biased: tuple[str, ...]) -> FloatArray:
        """Return the outputs driven by a record's inputs, with what is its own and parameters ``trims`` estimated."""
        check_sample_time(record, self.dt_s)
        part = record.select(self.outputs)
        u = delayed(record.columns(self.inputs), record.dt_s, np.array(self.delays_s))
        weight = part.valid / np.sqrt(np.diag(self.noise_covariance))
        shifted = [self.inputs.index(name) for name in self.biased_inputs]
        extra = output_offsets(self.outputs, biased, self.trended, record.t_s - record.t_s[0])
        n, b = len(self.structure.states), len(shifted)
        found = np.concatenate([self._start(record), np.zeros(b)])  # what the response is not linear in
        sampling = Sampling(record.dt_s, np.array(self.held), self.substeps)
        best, cost = None, np.inf
        for _ in range(_STATE_ITERATIONS):
            moved = u.copy()
            moved[:, shifted] += found[n:]
            r = respond(self.structure, self.params, trims, moved, sampling, found[:n], shifted)
            if not np.all(np.isfinite(r.y)):
                break
            J = np.concatenate([r.dx0, r.dbias, extra, r.dparams], axis=2)
            left, right = (J * weight[:, :, None]).reshape(-1, J.shape[2]), ((part.data - r.y) * weight).ravel()
            step = np.linalg.lstsq(left, right, rcond=1e-12)[0]
            if isinstance(self.structure, LinearStructure):
                return np.asarray(r.y + J @ step)
            constants = np.linalg.lstsq(left[:, n + b :], right, rcond=1e-12)[0]
            remaining = float(np.sum((right - left[:, n + b :] @ constants) ** 2))
            if remaining >= cost:
                break
            best, improved, cost = r.y + extra @ constants, cost - remaining, remaining
            if improved <= 1e-9 * cost:
                break
            found = found + step[: n + b]
        if best is None:
            raise EstimationError(
                f"the model diverges over a record of {record.duration_s:g} s; predict shorter stretches, or estimate "
                "a stable model"
            )
        return np.asarray(best)

    def _start(self, record: FlightRecord) -> FloatArray:
        at = self.operating_point[0]
        return np.array([record[s][0] if s in record else at[i] for i, s in enumerate(self.structure.states)])

    def linear(self, params: FloatArray | None = None) -> Matrices:
        """Return the continuous matrices, of a nonlinear structure those at the operating point."""
        params = self.params if params is None else params
        if isinstance(self.structure, LinearStructure):
            return self.structure.matrices(params)
        return self.structure.linearise(*self.operating_point, params)

    def poles(self) -> dict[str, ComplexArray]:
        """Return the eigenvalues of A in rad/s under all outputs' names joined by ", "."""
        return {", ".join(self.outputs): np.linalg.eigvals(self.linear().A).astype(np.complex128)}

    def modes(self) -> tuple[Mode, ...]:
        """Return the poles of the upper half plane with standard errors, propagated linearly from the covariance."""
        nominal = np.linalg.eigvals(self.linear().A)
        steps = 1e-6 * np.maximum(np.abs(self.params), np.sqrt(np.diag(self.covariance)))
        slope = np.zeros((nominal.size, self.params.size), complex)
        for j in np.flatnonzero(np.diag(self.covariance) > 0.0):
            shifted = self.params.copy()
            shifted[j] += steps[j]
            other = np.linalg.eigvals(self.linear(shifted).A)
            nearest = np.argmin(np.abs(nominal[:, None] - other), axis=1)
            slope[:, j] = (other[nearest] - nominal) / steps[j]
        out = []
        for pole, d in zip(nominal, slope, strict=True):
            if pole.imag < 0.0:
                continue
            wn = max(abs(pole), 1e-300)
            d_wn = (np.conj(pole) * d).real / wn
            d_zeta = -d.real / wn + pole.real * d_wn / wn**2
            std = [float(np.sqrt(max(g @ self.covariance @ g, 0.0))) for g in (d_wn, d_zeta)]
            out.append(Mode(complex(pole), float(wn), float(-pole.real / wn), *std))
        return tuple(sorted(out, key=lambda mode: mode.wn_rad_s))

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return C (jw I - A)^-1 B + D times the delays, shape (k, p, m); the hold of held inputs is not part of it.

        Raises:
            EstimationError: a frequency lies on an undamped pole.
        """
        s = self.linear()
        w = np.atleast_1d(np.asarray(omega_rad_s, float))
        try:
            inner = np.linalg.solve(1j * w[:, None, None] * np.eye(s.A.shape[0]) - s.A, s.B.astype(complex))
        except np.linalg.LinAlgError as error:
            raise EstimationError("the frequency response is infinite at a pole; choose other frequencies") from error
        return np.asarray((s.C @ inner + s.D) * np.exp(-1j * w[:, None, None] * np.array(self.delays_s)), np.complex128)

    def to_dict(self) -> dict[str, Any]:
        """Return names, parameters with errors, covariance, continuous matrices, status and advice as JSON values."""
        s = self.linear()
        plain = np.sqrt(np.diag(self.covariance_plain))
        return {
            **description(self),
            "structure": self.structure.name,
            "states": list(self.structure.states),
            "parameters": {
                p.name: {
                    "value": float(v),
                    "standard_error": float(e),
                    "standard_error_white": float(w),
                    "free": p.free,
                }
                for p, v, e, w in zip(
                    self.structure.parameters, self.params, np.sqrt(np.diag(self.covariance)), plain, strict=True
                )
            },
            "covariance": self.covariance.tolist(),
            "noise_covariance": self.noise_covariance.tolist(),
            "delays_s": list(self.delays_s),
            **{name: getattr(s, name).tolist() for name in "ABCD"},
        }

    def to_control(self) -> Any:
        """Return the continuous linear model as ``control.StateSpace`` with signal names; delays are left out."""
        import control

        s = self.linear()
        return control.ss(s.A, s.B, s.C, s.D, inputs=list(self.inputs), outputs=list(self.outputs))


def output_offsets(
    outputs: tuple[str, ...], biased: tuple[str, ...], trended: tuple[str, ...], t_s: FloatArray
) -> FloatArray:
    """Return the sensitivities (N, p, b) of the outputs by their constants and by their slopes per second."""
    columns = [(name, np.ones(t_s.size)) for name in biased] + [(name, t_s - t_s.mean()) for name in trended]
    out = np.zeros((t_s.size, len(outputs), len(columns)))
    for j, (name, column) in enumerate(columns):
        out[:, outputs.index(name), j] = column
    return out


def named(names: Mapping[str, float] | None, inputs: tuple[str, ...], what: str) -> FloatArray:
    """Return the values of ``names`` in the order of ``inputs``, 0 where not named.

    Raises:
        EstimationError: a name is not one of the inputs.
    """
    for name in names or {}:
        if name not in inputs:
            raise EstimationError(f"{what} belongs to an input of the structure ({', '.join(inputs)}), got '{name}'")
    return np.array([(names or {}).get(name, 0.0) for name in inputs])
