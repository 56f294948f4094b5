"""Responses of a structure to sampled inputs, and their exact sensitivities to parameters, initial state and biases."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import STEP, AnyArray, LinearStructure, Matrices, ModelStructure
from testbench.estimators.trajectories import Trajectories, carried

_SWEEPS = 12  # Newton sweeps over a whole trajectory before it is run sample by sample
_TRAJECTORY = 1e-13  # defect of a trajectory relative to its size
_OVERFLOW = 300.0  # logarithm of the growth over a record beyond which a response counts as diverged
_TAYLOR_SIZE, _TAYLOR_LEFT, _TAYLOR_TERMS = 4.0, 1e-20, 60  # norm of A dt per substep, last term, most terms
_RUNAWAY = 1e6  # growth of a state in one sample beyond which a response counts as diverged


class Response(NamedTuple):
    """Outputs y (N, p) and states x (N, n) of one stretch, and sensitivities of y.

    ``dparams`` (N, p, f) by the f chosen parameters, ``dx0`` (N, p, n) by the initial state and ``dbias`` (N, p, b) by
    constants added to the chosen inputs. A response that diverges holds numbers that are not finite.
    """

    y: FloatArray
    x: FloatArray
    dparams: FloatArray
    dx0: FloatArray
    dbias: FloatArray


class Sampling(NamedTuple):
    """How a structure is driven by samples: sample time, s, the inputs that are held between them, (m,); the others run
    linearly; and the Runge-Kutta steps per sample of a nonlinear structure."""

    dt_s: float
    held: NDArray[np.bool_]
    substeps: int = 1


class Discrete(NamedTuple):
    """x[k+1] = A x[k] + G u[k] + H (u[k+1] - u[k]) + g, exact for inputs held or linear between samples."""

    A: NDArray[Any]
    G: NDArray[Any]
    H: NDArray[Any]
    g: NDArray[Any]


def discretise(s: Matrices, dt_s: float, held: NDArray[np.bool_]) -> Discrete:
    """Return the exact discrete form; leading axes of the matrices are kept.

    The exponential of [[A, B, bx, 0], [0, 0, 0, I], 0] dt holds the responses to a step and to a ramp of one sample
    (C. F. Van Loan, IEEE Trans. Automatic Control 23, 1978).

    Args:
        s: continuous matrices, real or complex.
        dt_s: sample time, s.
        held: (m,) True for inputs held from sample to sample; the others run linearly.
    """
    n, m = s.A.shape[-1], s.B.shape[-1]
    M = np.zeros((*s.A.shape[:-2], n + 2 * m + 1, n + 2 * m + 1), s.A.dtype)
    M[..., :n, :n], M[..., :n, n : n + m], M[..., :n, n + m] = s.A, s.B, s.bx
    M *= dt_s
    M[..., n : n + m, n + m + 1 :] = np.eye(m)
    E = expm(M)[..., :n, :]
    return Discrete(E[..., :n], E[..., n : n + m], np.where(held, 0.0, E[..., n + m + 1 :]), E[..., n + m])


def respond(
    structure: ModelStructure,
    params: FloatArray,
    chosen: Sequence[int],
    u: FloatArray,
    sampling: Sampling,
    x0: FloatArray,
    biased: Sequence[int] = (),
) -> Response:
    """Return the response to ``u`` (N, m) from ``x0`` and its sensitivities; see :func:`responses`."""
    return next(responses(structure, params, chosen, [u], sampling, [x0], biased))


def responses(
    structure: ModelStructure,
    params: FloatArray,
    chosen: Sequence[int],
    inputs: Sequence[FloatArray],
    sampling: Sampling,
    starts: Sequence[FloatArray],
    biased: Sequence[int] = (),
) -> Iterator[Response]:
    """Yield the responses to several inputs, each (N, m), from as many initial states.

    Linear structures are solved exactly: sensitivities obey the same recursion, driven by the derivatives of its
    matrices. Nonlinear ones run by the classical Runge-Kutta method, their sensitivities by its exact derivative.

    Args:
        structure: the equations.
        params: (k,) parameter vector.
        chosen: indices of the f parameters whose sensitivities are wanted.
        inputs: at the samples, of different lengths if need be.
        sampling: of all of them.
        starts: initial states, each (n,); or (N, n), the states of a response like it, which begins with the initial
            state: a nonlinear one is then found sooner.
        biased: indices of the inputs whose bias sensitivities are wanted.
    """
    one: Callable[[FloatArray, FloatArray], Response]
    if isinstance(structure, LinearStructure):
        one = _of_linear(structure, params, list(chosen), sampling, list(biased))
    else:

        def one(u: FloatArray, x0: FloatArray) -> Response:
            return _nonlinear(structure, params, list(chosen), u, sampling, x0, list(biased))

    for u, x0 in zip(inputs, starts, strict=True):
        with np.errstate(all="ignore"):  # a trial step may diverge; whoever asked sees that the result is not finite
            found = one(u, x0)
        yield found


def _of_linear(
    structure: LinearStructure, params: FloatArray, chosen: list[int], sampling: Sampling, biased: list[int]
) -> Callable[[FloatArray, FloatArray], Response]:
    """Return the response of a linear structure as a function of input and initial state."""
    sizes = len(structure.states), len(structure.outputs), len(chosen), len(biased)
    with np.errstate(all="ignore"):
        s = structure.matrices(_stepped(params, chosen))
        if not all(np.all(np.isfinite(part)) for part in s):
            return lambda u, x0: _diverged(len(u), *sizes)
        d = discretise(s, sampling.dt_s, sampling.held)
        if not np.all(np.isfinite(d.A)) or np.abs(d.A[-1].real).max() > _RUNAWAY:
            return lambda u, x0: _diverged(len(u), *sizes)
        growth = np.log(max(np.abs(np.linalg.eigvals(d.A[-1].real)).max(), 1.0))

    def one(u: FloatArray, x0: FloatArray) -> Response:
        return (
            _diverged(len(u), *sizes) if growth * len(u) > _OVERFLOW else _linear(s, d, u, np.atleast_2d(x0)[0], biased)
        )

    return one


def _stepped(params: FloatArray, chosen: list[int]) -> NDArray[np.complex128]:
    """Return parameters (f + 1, k) with a complex step in each that is chosen; the last row is the nominal point."""
    z = np.tile(params.astype(np.complex128), (len(chosen) + 1, 1))
    z[np.arange(len(chosen)), chosen] += 1j * STEP
    return z


def scheduled(
    structure: LinearStructure,
    params: FloatArray,
    chosen: Sequence[int],
    u: FloatArray,
    sampling: Sampling,
    x0: FloatArray,
    schedules: FloatArray,
) -> FloatArray:
    """Return how outputs move, to first order, if parameters follow schedules: p(t) = p + c s(t).

    Args:
        structure: linear equations.
        params: (k,) parameter vector.
        chosen: indices of the f parameters.
        u: (N, m) inputs at the samples.
        sampling: of them.
        x0: (n,) initial state.
        schedules: (N, q) s(t) at the samples, slow against them.

    Returns:
        (N, p, f, q) derivatives of the outputs by c of each parameter and schedule.
    """
    s = structure.matrices(_stepped(params, list(chosen)))
    return _linear(s, discretise(s, sampling.dt_s, sampling.held), u, x0, [], schedules).dparams.reshape(
        len(u), -1, len(chosen), schedules.shape[1]
    )


def _linear(
    s: Matrices, d: Discrete, u: FloatArray, x0: FloatArray, biased: list[int], schedules: FloatArray | None = None
) -> Response:
    """Return the response of matrices whose leading axis holds a complex step for each parameter, then none."""
    N, (p, n), f = len(u), s.C.shape[-2:], len(d.A) - 1
    A, G, H, g = (part[-1].real for part in d)
    dA, dG, dH, dg = (part[:-1].imag / STEP for part in d)
    du = np.diff(u, axis=0, append=u[-1:])
    paths = Trajectories(A, N)
    free = paths.free()
    try:
        free = free @ np.linalg.inv(free[0])
    except np.linalg.LinAlgError:  # modes so unstable that the end of the record says nothing of its start
        return _diverged(N, n, p, f, len(biased))

    def path(forcing: FloatArray) -> FloatArray:
        out = paths.forced(forcing)
        if np.any(out[0]):  # modes that run backwards in time do not start from zero
            out = out - (free.reshape(-1, n) @ out[0]).reshape(out.shape)
        return np.asarray(out)

    x = path((u @ G.T + du @ H.T + g)[:, :, None])[:, :, 0] + free @ x0
    C, D = s.C[-1].real, s.D[-1].real
    y = x @ C.T + u @ D.T + s.by[-1].real
    rows = np.concatenate([x, u, du, np.ones((N, 1))], axis=1)  # what the derivatives of the matrices multiply
    force = np.empty((N, n, f + len(biased)))
    by_parameter = np.concatenate([dA, dG, dH, dg[:, :, None]], axis=2).reshape(f * n, rows.shape[1])
    force[:, :, :f] = (rows @ by_parameter.T).reshape(N, f, n).transpose(0, 2, 1)
    force[:, :, f:] = G[:, biased]
    if schedules is not None:
        force = (force[:, :, :, None] * schedules[:, None, None, :]).reshape(N, n, -1)
    sensitivities = np.matmul(C, path(force)) if force.shape[2] else np.zeros((N, p, 0))
    if not f:
        return Response(y, x, sensitivities[:, :, :0], np.matmul(C, free), sensitivities + D[:, biased])
    dC, dD, dby = (part[:-1].imag / STEP for part in (s.C, s.D, s.by))
    sensitivities[:, :, sensitivities.shape[2] - len(biased) :] += D[:, biased]
    if np.any(dC) or np.any(dD) or np.any(dby):
        direct = np.concatenate([dC, dD, np.zeros_like(dD), dby[:, :, None]], axis=2)
        moved = (rows @ direct.reshape(f * p, -1).T).reshape(N, f, p).transpose(0, 2, 1)
        if schedules is not None:
            moved = (moved[:, :, :, None] * schedules[:, None, None, :]).reshape(N, p, -1)
        sensitivities[:, :, : moved.shape[2]] += moved
    if schedules is not None:
        return Response(y, x, sensitivities, np.matmul(C, free), sensitivities[:, :, :0])
    return Response(y, x, sensitivities[:, :, :f], np.matmul(C, free), sensitivities[:, :, f:])


def _diverged(N: int, n: int, p: int, f: int, b: int) -> Response:
    shapes = ((N, p), (N, n), (N, p, f), (N, p, n), (N, p, b))
    return Response(*(np.full(shape, np.inf) for shape in shapes))


def runge_kutta(
    structure: ModelStructure, x: AnyArray, u: AnyArray, du: AnyArray, params: AnyArray, dt_s: float, substeps: int = 1
) -> AnyArray:
    """Return the state one sample later by the classical Runge-Kutta method.

    Args:
        structure: the equations.
        x: states (..., n).
        u: inputs (..., m) at the start of the sample.
        du: their change over the sample, (..., m); zero for inputs that are held.
        params: (..., k).
        dt_s: sample time, s.
        substeps: equal steps per sample.
    """
    h, du = dt_s / substeps, du / substeps
    for i in range(substeps):
        start = u + i * du
        middle, end = start + 0.5 * du, start + du
        k1 = structure.derivative(x, start, params)
        k2 = structure.derivative(x + 0.5 * h * k1, middle, params)
        k3 = structure.derivative(x + 0.5 * h * k2, middle, params)
        k4 = structure.derivative(x + h * k3, end, params)
        x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return x


def taylor(s: Matrices, x: AnyArray, u: AnyArray, du: AnyArray, dt_s: float) -> AnyArray:
    """Return the states (..., n) one sample later, by as many Taylor terms as rounding can tell.

    Args:
        s: matrices with the leading axes of the states.
        x: states (..., n).
        u: inputs (m,) at the start of the sample.
        du: their change over the sample, (m,); zero for inputs that are held.
        dt_s: sample time, s.
    """
    A = s.A.real[(-1,) * (s.A.ndim - 2)]
    square = A @ A
    growth = dt_s * float(np.sum((square @ square) ** 2)) ** 0.125  # norm of A^4, near the largest pole's power
    substeps = int(np.ceil(growth / _TAYLOR_SIZE)) if 1.0 < growth < _RUNAWAY else 1
    h, a = dt_s / substeps, growth / substeps
    A, du = s.A * h, (s.B @ (du / substeps)) * h
    x, drive = x[..., None], (s.B @ u + s.bx) * h
    for i in range(substeps):
        term = A @ x
        term += (drive + i * du)[..., None]
        x, left, order = x + term, a, 1
        while left > _TAYLOR_LEFT and order < _TAYLOR_TERMS:
            order += 1
            left *= a / order
            term = A @ term
            if order == 2:
                term += du[..., None]
            term /= order
            x = x + term
    return np.asarray(x[..., 0])


def _nonlinear(
    structure: ModelStructure,
    params: FloatArray,
    chosen: list[int],
    u: FloatArray,
    sampling: Sampling,
    x0: FloatArray,
    biased: list[int],
) -> Response:
    N, n, p, f, b = len(u), len(structure.states), len(structure.outputs), len(chosen), len(biased)
    du = np.where(sampling.held, 0.0, np.diff(u, axis=0, append=u[-1:]))
    x, transition = _trajectory(structure, params, u, du, sampling, x0)
    if not np.all(np.isfinite(x)):
        return _diverged(N, n, p, f, b)
    P = np.tile(params.astype(complex), (f + b, 1))
    P[np.arange(f), chosen] += 1j * STEP
    shift = np.zeros((f + b, u.shape[1]), complex)
    shift[f + np.arange(b), biased] += 1j * STEP
    shape = (N, f + b)
    P_all, u_all = np.broadcast_to(P, (*shape, params.size)), u[:, None, :] + shift
    x_all, du_all = np.broadcast_to(x[:, None, :], (*shape, n)), np.broadcast_to(du[:, None, :], u_all.shape)
    force = (
        runge_kutta(structure, x_all, u_all, du_all, P_all, sampling.dt_s, sampling.substeps).imag / STEP
    )  # (N, f + b, n)
    # sensitivities of the states: by the initial state first
    force = np.concatenate([np.zeros((N, n, n)), force.transpose(0, 2, 1)], axis=2)
    S = carried(transition, force, np.eye(n, n + f + b))
    direct = structure.output(x_all, u_all, P_all).imag.transpose(0, 2, 1) / STEP
    y, hx = _output(structure, params, u, x)
    d = np.matmul(hx, S)
    return Response(y, x, d[:, :, n : n + f] + direct[:, :, :f], d[:, :, :n], d[:, :, n + f :] + direct[:, :, f:])


def _output(
    structure: ModelStructure, params: FloatArray, u: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the outputs (N, p) and their derivatives by the state (N, p, n)."""
    N, n = x.shape
    shape = (N, n, u.shape[1])
    z = x[:, None, :] + 1j * STEP * np.eye(n)
    h = structure.output(z, np.broadcast_to(u[:, None, :], shape), np.broadcast_to(params, (N, n, params.size)))
    return h[:, 0].real, h.imag.transpose(0, 2, 1) / STEP


def _trajectory(
    structure: ModelStructure, params: FloatArray, u: FloatArray, du: FloatArray, sampling: Sampling, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states (N, n) and the derivatives (N, n, n) of each by the one before.

    Newton's method on all samples at once: every sweep takes one Runge-Kutta step from every sample side by side and
    carries the defects x[k+1] - F(x[k]) through the linearised recursion (multiple shooting with one sample per
    interval), from ``start`` (N, n) where more than the initial state is given. Trajectories that it does not settle
    run sample by sample.
    """
    dt_s, substeps = sampling.dt_s, sampling.substeps
    x0 = np.atleast_2d(start)[0]
    N, n = len(u), x0.size
    steps = 1j * STEP * np.eye(n)
    wide_u, wide_du = (np.broadcast_to(part[:, None, :], (N, n, u.shape[1])) for part in (u, du))
    wide_p = np.broadcast_to(params, (N, n, params.size))

    def forward(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        out = runge_kutta(structure, x[:, None, :] + steps, wide_u, wide_du, wide_p, dt_s, substeps)
        return out[:, 0].real, out.imag.transpose(0, 2, 1) / STEP

    x = start if start.ndim == 2 and np.all(np.isfinite(start)) else np.tile(x0, (N, 1))
    for _ in range(_SWEEPS):
        ahead, transition = forward(x)
        if not np.all(np.isfinite(transition)):
            break
        defect = ahead[:-1] - x[1:]
        if np.all(np.abs(defect) <= _TRAJECTORY * np.max(np.abs(x), axis=0)):
            return x, transition
        force = np.concatenate([defect, np.zeros((1, n))])
        x = x + carried(transition, force[:, :, None], np.zeros((n, 1)))[:, :, 0]
    x = np.tile(x0, (N, 1))
    for k in range(N - 1):
        x[k + 1] = runge_kutta(structure, x[k], u[k], du[k], params, dt_s, substeps)
        if not np.all(np.isfinite(x[k + 1])):
            return np.full((N, n), np.inf), np.zeros((N, n, n))
    return x, forward(x)[1]


def delayed(u: FloatArray, dt_s: float, delays_s: FloatArray) -> FloatArray:
    """Return the inputs (N, m) as they were ``delays_s`` (m,) earlier, linear between samples, before: held."""
    if not np.any(delays_s):
        return u
    t = dt_s * np.arange(len(u))
    return np.column_stack([np.interp(t - delay, t, u[:, j]) for j, delay in enumerate(delays_s)])


def later(u: FloatArray, dt_s: float, late_s: FloatArray) -> FloatArray:
    """Return the inputs (N, m) as they were ``late_s`` (m,) earlier, before and after: held.

    By cubic convolution (R. G. Keys, IEEE Trans. Acoustics, Speech, and Signal Processing 29, 1981): unlike straight
    lines between samples, this is smooth in the time that is sought.
    """
    out, k = u.copy(), np.arange(len(u))
    for j in np.flatnonzero(late_s):
        whole, f = divmod(-late_s[j] / dt_s, 1.0)
        at = [np.clip(k + int(whole) + i, 0, len(u) - 1) for i in (-1, 0, 1, 2)]
        weights = (
            -0.5 * f + f**2 - 0.5 * f**3,
            1.0 - 2.5 * f**2 + 1.5 * f**3,
            0.5 * f + 2.0 * f**2 - 1.5 * f**3,
            -0.5 * f**2 + 0.5 * f**3,
        )
        out[:, j] = sum(w * u[i, j] for w, i in zip(weights, at, strict=True))
    return out
