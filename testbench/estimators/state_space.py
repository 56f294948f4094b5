"""StateSpaceModel: a discrete innovations model, simulated from its inputs with the initial state estimated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import as_json
from testbench.core.errors import EstimationError, RecordError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.driven import Series, output_rows, released
from testbench.estimators.hankel import fold, triangle
from testbench.estimators.model import ComplexArray, IdentifiedModel, continuous_poles
from testbench.estimators.trajectories import Modes, Trajectories, read_out

_RCOND = 1e-12
_CHUNK = 5000  # samples folded into a triangle at once


class Rows(NamedTuple):
    """R factors of one series' regressions, and their sizes.

    Attributes:
        R: per output (r, own + count + 1), see :func:`fit_inputs`: own unknowns of the series, B and D, y.
        own: number of unknowns of this series alone.
        counts: (p,) valid samples per output.
    """

    R: list[FloatArray]
    own: int
    counts: NDArray[np.int_]


class InputFit(NamedTuple):
    """What :func:`fit_inputs` found: B (n, m), D (p, m) and R, with || R [parameters; -1] || the output error.

    ``rows`` holds the same per series and output, initial states not yet eliminated.
    """

    B: FloatArray
    D: FloatArray
    R: FloatArray
    rows: list[Rows]

    def error(self, B: FloatArray, D: FloatArray, direct: NDArray[np.bool_]) -> float:
        """Return the summed squared output error of other matrices B, D on the same data, initial states re-fitted."""
        return float(np.sum((self.R @ _parameters(B, D, direct)) ** 2))

    def free_run_errors(self, B: FloatArray, D: FloatArray, direct: NDArray[np.bool_]) -> FloatArray:
        """Return the squared errors (p,) that :func:`free_run` leaves with other B, D, summed over all series."""
        out = np.zeros(len(D))
        for R, own, counts in self.rows:
            left = [r[:, own:] @ _parameters(B, D, direct) for r in R]
            size = np.array([np.sqrt(np.sum(r[:, -1] ** 2) / max(n, 1)) for r, n in zip(R, counts, strict=True)])
            weight = 1.0 / np.where(size > 0.0, size, 1.0)
            free = np.vstack([r[:, :own] * w for r, w in zip(R, weight, strict=True)])
            target = np.concatenate([e * w for e, w in zip(left, weight, strict=True)])
            start = np.linalg.lstsq(free, -target, rcond=_RCOND)[0]
            out += [np.sum((e + r[:, :own] @ start) ** 2) for e, r in zip(left, R, strict=True)]
        return out


def _parameters(B: FloatArray, D: FloatArray, direct: NDArray[np.bool_]) -> FloatArray:
    return np.concatenate([B.T.ravel(), D[:, direct].T.ravel(), [-1.0]])


def trend_columns(samples: int, p: int, lead: int) -> FloatArray:
    """Return (N, p, lead p): a constant (lead = 1) and a line from -1 to 1 (lead = 2) of each output's own."""
    terms = np.stack([np.ones(samples), np.linspace(-1.0, 1.0, samples)], axis=1)[:, :lead]
    return np.einsum("kl,ij->kilj", terms, np.eye(p)).reshape(samples, p, lead * p)


def fit_inputs(
    A: FloatArray, C: FloatArray, series: Sequence[Series], direct: NDArray[np.bool_], lead: int = 0
) -> InputFit:
    """Return B and D that minimise the output error for given A and C, the initial states of all series eliminated.

    Linear least squares of y[k] = C A^k x0 + C sum_j A^(k-1-j) B u[j] + D u[k] over all valid samples of all series.

    Args:
        A: (n, n) state matrix.
        C: (p, n) output matrix.
        series: the data; outputs weigh as they are scaled.
        direct: (m,) True for the inputs that have a column in D; the other columns of D are zero.
        lead: 1 if each series has an offset of its own in every output, 2 if it has a linear trend too.

    Raises:
        EstimationError: fewer valid output samples than unknowns.
    """
    n, p, m = A.shape[0], C.shape[0], direct.size
    through = np.flatnonzero(direct)
    count = n * m + p * through.size
    own = n + lead * p  # unknowns of each series alone
    R, found, samples = np.zeros((0, count + 1)), [], 0
    for part in series:
        valid, modes = part.valid, Modes(A, len(part.u))
        rows = output_rows(A, C, modes, part, through, lead) if modes.usable else _plain_rows(A, C, part, through, lead)
        found.append(Rows(rows, own, valid.sum(axis=0)))
        if valid.sum() > own:
            samples += int(valid.sum()) - own
            R = triangle(R, triangle(np.zeros((0, own + count + 1)), np.vstack(rows))[own:, own:])
    if samples < count:
        raise EstimationError(
            f"B and D need at least {count} samples beyond the initial states, got {samples}; give more data"
        )
    parameters = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=_RCOND)[0]
    B = parameters[: n * m].reshape(m, n).T
    D = np.zeros((p, m))
    D[:, through] = parameters[n * m :].reshape(through.size, p).T
    return InputFit(B, D, R, found)


def _plain_rows(A: FloatArray, C: FloatArray, series: Series, through: NDArray[np.intp], lead: int) -> list[FloatArray]:
    """Return what :func:`output_rows` does, for an A whose modes cannot be told apart: every state on its own."""
    u, y, valid = series
    n, p, m = A.shape[0], C.shape[0], u.shape[1]
    own, count = n + lead * p, n * m + p * through.size
    paths = Trajectories(A, len(u))
    driven = [paths.free()] + [paths.forced(u[:, j, None, None] * np.eye(n)) for j in range(m)]
    out = [np.zeros((0, own + count + 1))] * p
    line = trend_columns(len(u), p, lead)
    for k in range(0, len(u), _CHUNK):
        part = slice(k, min(k + _CHUNK, len(u)))
        block = np.zeros((part.stop - k, p, own + count + 1))
        block[:, :, n:own] = line[part]
        for j in range(m + 1):
            at = own + n * (j - 1) if j else 0
            block[:, :, at : at + n] = read_out(C, driven[j][part])
        for i, column in enumerate(through):
            at = own + n * m + p * i
            block[:, range(p), range(at, at + p)] = u[part, column, None]
        block[:, :, -1] = y[part]
        out = [fold(R, block[valid[part, i], i]) for i, R in enumerate(out)]
    return out


def free_run(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, series: Series, lead: int = 0) -> FloatArray:
    """Return the outputs (N, p) driven by the inputs, from the initial state that fits the valid outputs best.

    Linear least squares; each output weighted by the inverse of its root mean square. ``lead`` as in
    :func:`fit_inputs`: offsets and trends of the outputs that are fitted along.
    """
    u, y, valid = series
    modes, p = Modes(A, len(u)), len(C)
    none, silent = np.zeros(0, np.intp), np.zeros((len(u), 0))
    if modes.usable:
        forced = (C @ modes.V @ modes.run(modes.drive(np.linalg.solve(modes.V, B) @ u.T))).T + u @ D.T
        rows = output_rows(A, C, modes, Series(silent, y - forced, valid), none, lead)
    else:
        paths = Trajectories(A, len(u))
        forced = paths.forced((u @ B.T)[:, :, None])[:, :, 0] @ C.T + u @ D.T
        rows = _plain_rows(A, C, Series(silent, y - forced, valid), none, lead)
    counts = np.maximum(valid.sum(axis=0), 1)
    size = np.sqrt(np.sum(y**2, axis=0, where=valid) / counts)
    both = np.vstack([R / (s if s > 0.0 else 1.0) for R, s in zip(rows, size, strict=True)])
    start = np.linalg.lstsq(both[:, :-1], both[:, -1], rcond=_RCOND)[0]
    if modes.usable:
        forced += released(A, C, modes, len(u), start[: len(A)])
    else:
        forced += paths.free() @ start[: len(A)] @ C.T
    if lead:
        forced += trend_columns(len(u), p, lead) @ start[len(A) :]
    return forced


@dataclass(frozen=True, eq=False, kw_only=True)
class StateSpaceModel(IdentifiedModel):
    """x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k] (EOLO paper, equation 2, with D).

    Inputs and outputs are deviations from trim in SI units; the states have no physical meaning of their own.

    Attributes:
        A: (n, n) state matrix.
        B: (n, m) input matrix.
        C: (p, n) output matrix.
        D: (p, m) direct feedthrough.
        K: (n, p) gain of the innovations e; zeros if the estimator gives none.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    K: FloatArray = field(default=None)  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        n, m, p = np.atleast_2d(self.A).shape[0], len(self.inputs), len(self.outputs)
        if self.K is None:
            object.__setattr__(self, "K", np.zeros((n, p)))
        for name, shape in (("A", (n, n)), ("B", (n, m)), ("C", (p, n)), ("D", (p, m)), ("K", (n, p))):
            matrix = np.array(getattr(self, name), dtype=np.float64)
            if matrix.shape != shape or not np.all(np.isfinite(matrix)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got {array_found(matrix)}")
            matrix.setflags(write=False)
            object.__setattr__(self, name, matrix)

    @property
    def order(self) -> int:
        """Number of states n."""
        return self.A.shape[0]

    def simulate(self, record: FlightRecord) -> FloatArray:
        """Return the free-run outputs (N, p): the record's inputs, and the initial state that fits its outputs best.

        The initial state is a linear least-squares estimate over all valid output samples. For a model with unstable
        modes it is carried by the end of the record (see :class:`Trajectories`), which is the same estimate in
        numbers that do not overflow.

        Raises:
            ChannelError: the record lacks an input or output of the model.
            RecordError: its sample time differs from the model's by more than 1 %.
        """
        check_sample_time(record, self.dt_s)
        u, y = record.columns(self.inputs), record.columns(self.outputs)
        series = Series(u, y, np.asarray(record.select(self.outputs).valid))
        return free_run(self.A, self.B, self.C, self.D, series)

    def poles(self) -> dict[str, ComplexArray]:
        """Return the continuous-time poles ln(z)/dt in rad/s under all outputs' names joined by ", "."""
        return {
            ", ".join(self.outputs): continuous_poles(np.linalg.eigvals(self.A).astype(np.complex128), self.dt_s)[0]
        }

    def frequency_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Return C (zI - A)^-1 B + D at z = exp(j w dt), shape (k, p, m).

        Raises:
            EstimationError: a frequency lies above the Nyquist frequency pi/dt, or on a pole of the model.
        """
        z = unit_circle(omega_rad_s, self.dt_s)
        try:
            inner = np.linalg.solve(z[:, None, None] * np.eye(self.order) - self.A, self.B.astype(complex))
        except np.linalg.LinAlgError as error:
            raise EstimationError(
                "the frequency response is infinite at a pole; choose frequencies off the poles"
            ) from error
        return np.asarray(self.C @ inner + self.D, dtype=np.complex128)

    def to_dict(self) -> dict[str, Any]:
        """Return names, sample time, matrices (lists of rows), settings, status and advice as JSON values."""
        matrices = {name: getattr(self, name).tolist() for name in "ABCDK"}
        return {**description(self), **matrices}

    def to_control(self) -> Any:
        """Return the model from inputs to outputs as ``control.StateSpace`` with signal names."""
        import control

        return control.ss(
            self.A, self.B, self.C, self.D, self.dt_s, inputs=list(self.inputs), outputs=list(self.outputs)
        )


def description(model: IdentifiedModel) -> dict[str, Any]:
    """Return what every model's ``to_dict`` begins with, as JSON values."""
    return {
        "method": model.method,
        "time": "continuous" if model.continuous else "discrete",
        "inputs": list(model.inputs),
        "outputs": list(model.outputs),
        "dt_s": model.dt_s,
        "settings": dict(model.settings),
        "status": model.status,
        "advice": as_json(model.advice),
    }


def check_sample_time(record: FlightRecord, dt_s: float) -> None:
    """Check that a record can drive a model of sample time ``dt_s``.

    Raises:
        RecordError: the sample times differ by more than 1 %.
    """
    if abs(record.dt_s - dt_s) > 0.01 * dt_s:
        raise RecordError(
            f"record and model must share their sample time, got {record.dt_s:g} s and {dt_s:g} s; "
            "resample the record or identify at its rate"
        )


def unit_circle(omega_rad_s: FloatArray, dt_s: float) -> ComplexArray:
    """Return exp(j w dt) for frequencies (k,) up to the Nyquist frequency.

    Raises:
        EstimationError: a frequency lies above pi/dt, where a discrete model says nothing.
    """
    omega = np.atleast_1d(np.asarray(omega_rad_s, dtype=np.float64))
    if omega.size and np.max(np.abs(omega)) > np.pi / dt_s * (1.0 + 1e-9):
        raise EstimationError(
            f"a discrete model answers up to its Nyquist frequency {np.pi / dt_s:.4g} rad/s, "
            f"got {np.max(np.abs(omega)):.4g} rad/s; shorten the frequency grid"
        )
    return np.exp(1j * omega * dt_s)
