"""Low-order equivalent models with delay, fitted to frequency responses; one denominator for several outputs if wanted.

M. B. Tischler and R. K. Remple, "Aircraft and Rotorcraft System Identification", 2nd ed., AIAA 2012, chapter 11 (cost
and weights of NAVFIT); MIL-STD-1797, low-order equivalent systems; C. K. Sanathanan and J. Koerner, IEEE
Transactions on Automatic Control 8(1), 1963 (starts). Numbers of the first two from memory.

The weighted misfit of a low-order model with delay to measured frequency responses, and its slopes.

Cost and weights as in :mod:`testbench.estimators.frequency.equivalent`, which fits by them.

The response from held inputs to samples of a transfer function with delay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

from testbench.core.advice import Advice, AdviceList
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.continuous import ContinuousTransferModel, Hold, holds
from testbench.estimators.coverage import approximate
from testbench.estimators.frequency.response import FrequencyResponse, estimate_frequency_response
from testbench.estimators.hold import said_of_hold
from testbench.estimators.model import ComplexArray
from testbench.estimators.settings import Equivalent, LowOrder

# --- the response from held inputs to samples of a transfer function with delay ---------------------------------------


_WHOLE = 1e-9  # of a sample: a delay this near to whole samples is whole


def sampled_response(
    b: FloatArray, a: FloatArray, s: ComplexArray, dt_s: float, delay_s: float, unit: float
) -> ComplexArray:
    """Return the response (k,) from a held input to samples of B(s)/A(s) exp(-s tau): with all that folds down.

    x[k+1] = e^(A dt) x[k] + e^(A r) F(dt - r) B u[k-d-1] + F(r) B u[k-d],    F(t) = integral of e^(A v) dv up to t

    for tau = (d + 1) dt - r, 0 < r <= dt (K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., 1997,
    section 2.3).

    Args:
        b: (n + 1,) numerator, highest power first.
        a: (n + 1,) denominator, a[0] = 1.
        s: j omega.
        dt_s: sample time, s.
        delay_s: tau, s.
        unit: a frequency, rad/s, in which the poles are of the order of 1.

    A response that has no digits left, as of a pole that grows beyond all numbers in a sample, is NaN.
    """
    scale = unit ** -np.arange(a.size + 0.0)
    a, b = a * scale, b * scale
    x, later, whole = _held(a.tobytes(), s.tobytes(), dt_s, delay_s, unit)
    return np.asarray((x @ (b[1:] - b[0] * a[1:]) + b[0] * later) * whole, np.complex128)


@lru_cache(maxsize=64)
def _held(
    a: bytes, s: bytes, dt_s: float, delay_s: float, unit: float
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return what a sampled response has of its denominator and delay, which all numerators share: its states (k, n).

    With them what the input's passing through is later by (k,), and the delay in whole samples (k,).
    """
    below, omega = np.frombuffer(a), np.frombuffer(s, np.complex128)
    n = below.size - 1
    A = np.zeros((n + 1, n + 1))  # companion form, then the input that stays
    A[0, :n], A[0, n] = -below[1:], 1.0
    A[1:n, : n - 1] = np.eye(n - 1)
    whole = int(np.floor(delay_s / dt_s + _WHOLE))
    late = min(max(delay_s / dt_s - whole, 0.0), 1.0)
    with np.errstate(all="ignore"):
        early, rest = (expm(A * (unit * dt_s * part)) for part in (1.0 - late, late))
    z = np.exp(omega * dt_s)
    drive = early[:n, n] + (early[:n, :n] @ rest[:n, n]) / z[:, None]
    try:
        x = np.linalg.solve(z[:, None, None] * np.eye(n) - early[:n, :n] @ rest[:n, :n], drive[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:  # a pole far outside: the exponential has no digits left, and a search turns away
        x = np.full((z.size, n), np.nan, np.complex128)
    later = np.ones(z.size) if late <= _WHOLE else 1.0 / z
    return np.asarray(x, np.complex128), np.asarray(later, np.complex128), np.asarray(z**-whole, np.complex128)


# --- the low-order equivalent -----------------------------------------------------------------------------------------


Weighting = Literal["loes", "likelihood"]
DB = 20.0 / np.log(10.0)
DEGREE = 180.0 / np.pi
PHASE = 0.01745  # a degree of phase weighs as 0.13 dB of gain
_FLOOR = 1e-2  # random errors below this share of the median count as that: no value outweighs all others


class Problem(NamedTuple):
    """The values of some outputs: s (k,), H (k, p, m), the hold (k, m), weights and random errors (k, p, m).

    ``zoh`` (m,): which inputs are held for ``dt_s``; ``held`` is the response of that hold below the folding
    frequencies.
    """

    s: ComplexArray
    H: ComplexArray
    held: ComplexArray
    zoh: tuple[bool, ...]
    dt_s: float
    weight: FloatArray
    error: FloatArray
    n: int
    zeros: tuple[int, ...]
    delay: bool
    weighting: Weighting
    crowding: float  # values within one resolution: they count as one


def problem_of(
    part: FrequencyResponse, group: list[int], zeros: Mapping[str, int], settings: LowOrder, words: tuple[Hold, ...]
) -> Problem:
    """Return what is fitted: the outputs ``group`` of ``part``, with so many ``zeros`` per output.

    Args:
        part: the response in the band that counts.
        group: indices of the outputs that share a denominator.
        zeros: output -> number of zeros.
        settings: number of poles, delays and weights.
        words: per input, what it does between samples.

    Raises:
        EstimationError: fewer values than unknowns, or a response of exactly zero.
    """
    n, delay, weighting = settings.poles, settings.delay, settings.weighting
    s = np.asarray(1j * part.omega_rad_s, np.complex128)
    half = 0.5 * part.omega_rad_s * part.dt_s
    held = np.ones((s.size, len(words)), np.complex128)
    for j, word in enumerate(words):
        if word == "zoh":
            held[:, j] = np.sinc(half / np.pi) * np.exp(-1j * half)
    H, error = part.H[:, group], part.random_error[:, group]
    nzs = tuple(zeros[part.outputs[i]] for i in group)
    unknowns = n + sum(len(words) * (nz + 1 + delay) for nz in nzs)
    if 2 * H.size < unknowns + 1:
        raise EstimationError(
            f"a fit of {unknowns} unknowns needs at least {(unknowns + 1) // 2 + 1} complex values, got {H.size}; "
            "widen the band or lower the order"
        )
    if np.any(H == 0.0):
        raise EstimationError("a response of exactly zero has no phase to fit; leave that output or band out")
    if weighting == "loes":
        weight = 1.58 * (1.0 - np.exp(-part.partial_coherence[:, group])) * np.sqrt(20.0 / s.size)
    else:
        middle = float(np.median(error))
        weight = 1.0 / np.maximum(error, _FLOOR * middle) if middle > 0.0 else np.ones(error.shape)
    spacing = np.gradient(part.omega_rad_s) if s.size > 1 else part.resolution_rad_s
    crowding = max(1.0, float(np.mean(part.resolution_rad_s / spacing)))
    return Problem(
        s, H, held, tuple(w == "zoh" for w in words), part.dt_s, weight, error, n, nzs, delay, weighting, crowding
    )


def unpack(problem: Problem, x: FloatArray, w0: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a (n + 1,), b (p, m, n + 1) and tau (p, m) from unknowns in units of w0."""
    n, (_, p, m) = problem.n, problem.H.shape
    scale = w0 ** np.arange(n + 1.0)
    a = np.concatenate([[1.0], x[:n]]) * scale
    b, at = np.zeros((p, m, n + 1)), n
    for i, nz in enumerate(problem.zeros):
        b[i, :, n - nz :] = x[at : at + m * (nz + 1)].reshape(m, nz + 1)
        at += m * (nz + 1)
    tau = x[at:].reshape(p, m) / w0 if problem.delay else np.zeros((p, m))
    return a, b * scale, tau


def packed(problem: Problem, a: FloatArray, b: FloatArray, tau: FloatArray, w0: float) -> FloatArray:
    """Return the unknowns of a (n + 1,), b (p, m, n + 1) and tau (p, m): :func:`unpack` the other way."""
    n, scale = problem.n, w0 ** np.arange(problem.n + 1.0)
    above = [(b[i, :, n - nz :] / scale[n - nz :]).ravel() for i, nz in enumerate(problem.zeros)]
    return np.concatenate([a[1:] / scale[1:], *above, *([tau.ravel() * w0] if problem.delay else [])])


def model_of(problem: Problem, x: FloatArray, w0: float) -> ComplexArray:
    """Return the response (k, p, m) of unknowns in units of w0."""
    a, b, tau = unpack(problem, x, w0)
    s = problem.s
    powers = s[:, None] ** np.arange(problem.n, -1.0, -1.0)
    above = np.einsum("kn,pmn->kpm", powers, b)
    below = powers @ a
    out = np.asarray(
        above / below[:, None, None] * np.exp(-s[:, None, None] * tau) * problem.held[:, None, :], np.complex128
    )
    for i, j in np.ndindex(*tau.shape):
        if problem.zoh[j]:
            sampled = sampled_response(b[i, j], a, s, problem.dt_s, float(tau[i, j]), w0)
            if np.all(np.isfinite(sampled)):
                out[:, i, j] = sampled
    return out


def residuals(problem: Problem, G: ComplexArray, weighting: Weighting | None = None) -> FloatArray:
    """Return the two weighted residuals of every value, (2, k, p, m)."""
    if (weighting or problem.weighting) == "likelihood":
        miss = problem.weight * (G - problem.H) / np.abs(problem.H)
        return np.stack([miss.real, miss.imag])
    with np.errstate(divide="ignore"):
        gain = DB * np.log(np.maximum(np.abs(G / problem.H), 1e-12))
    phase = DEGREE * np.angle(G / problem.H)
    return problem.weight * np.stack([gain, np.sqrt(PHASE) * phase])


def slopes_of(problem: Problem, x: FloatArray, w0: float) -> FloatArray:
    """Return the derivatives (2 k p m, unknowns) of the residuals where no input is held between samples."""
    n, G, tau = problem.n, model_of(problem, x, w0), unpack(problem, x, w0)[2]
    powers = (problem.s[:, None] / w0) ** np.arange(n, -1.0, -1.0)
    below = (powers @ np.concatenate([[1.0], x[:n]]))[:, None, None]
    slopes = np.zeros((*G.shape, x.size), np.complex128)
    slopes[..., :n] = -(G / below)[..., None] * powers[:, None, None, 1:]
    across = np.exp(-problem.s[:, None, None] * tau) * problem.held[:, None, :] / below
    at = n
    for i, nz in enumerate(problem.zeros):
        for j in range(G.shape[2]):
            slopes[:, i, j, at : at + nz + 1] = across[:, i, j, None] * powers[:, n - nz :]
            at += nz + 1
    if problem.delay:
        pairs = slopes.reshape(len(G), -1, x.size)
        own = np.arange(pairs.shape[1])
        pairs[:, own, at + own] = -(problem.s[:, None] / w0) * G.reshape(len(G), -1)
    if problem.weighting == "likelihood":
        slopes *= (problem.weight / np.abs(problem.H))[..., None]
        return np.stack([slopes.real, slopes.imag]).reshape(-1, x.size)
    there = G[..., None]  # where it is zero the logarithm is cut off, and flat
    slopes = np.divide(slopes, there, out=np.zeros_like(slopes), where=there != 0.0)
    parts = np.stack([DB * slopes.real, np.sqrt(PHASE) * DEGREE * slopes.imag])
    return (problem.weight[..., None] * parts).reshape(-1, x.size)


_EXPLAINED = 4.0  # misfit over what the random error of the responses explains, beyond which the structure is at fault
_POOR = 100.0  # mean cost above which a low-order equivalent is not acceptable (Tischler and Remple, section 11.2)
_DELAYS = 13  # starts of each delay, up to a whole turn at the highest frequency
_EXACT = 1e-9  # random errors below this are rounding
_NEAR, _LAST = 1e-6, 1e-14  # relative tolerances of searches from several starts, and of the one that is kept


def estimate(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], settings: Equivalent
) -> ContinuousTransferModel:
    """Fit a low-order equivalent to the frequency response of the records.

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        settings: lengths of the windows, s; see :func:`fit_equivalent`, as for the rest.

    Raises:
        EstimationError: as of the frequency response or of :func:`fit_equivalent`.
        ChannelError: a record lacks a channel.
    """
    response = estimate_frequency_response(records, inputs, outputs, window_s=settings.window_s)
    words, recognised = holds(inputs, settings.hold, records)
    model = fit_equivalent(response, settings.model_copy(update={"hold": dict(zip(inputs, words, strict=True))}))
    return replace(model, settings={**model.settings, **said_of_hold(recognised)}) if recognised else model


def fit_equivalent(
    response: FrequencyResponse, settings: LowOrder, start: ContinuousTransferModel | None = None
) -> ContinuousTransferModel:
    """Fit H_ij(jw) = B_ij(jw)/A(jw) exp(-jw tau_ij) to a frequency response.

    "loes" minimises, over n_w frequencies of each pair of output and input,

        J = 20/n_w sum W [ (gain mismatch, dB)^2 + 0.01745 (phase mismatch, deg)^2 ],    W = [1.58 (1 - exp(-g^2))]^2

    with the partial coherence g^2; "likelihood" minimises sum |H - model|^2 / E|dH|^2 with the random error of the
    response. Starts come from iterated linear least squares (Sanathanan and Koerner) over a grid of delays.

    Args:
        response: what is fitted.
        settings: order, delays, weights and band. For inputs that are held what is fitted is the response of the
            sampled model, exactly: the hold, whose half sample of delay would end in tau otherwise, and what folds down
            from beyond the Nyquist frequency.
        start: a fit of nearly the same response with the same settings, which is refined; no other start is sought.

    Returns:
        The model. Covariance: the random errors of the response, carried through the weighted fit; values closer
        than the response's resolution count as one; where the misfit exceeds what the random errors explain, the
        covariance is raised by it. Diagnostics, by denominator: ``cost`` (mean J over the pairs, whichever weighting),
        ``misfit_ratio`` (misfit over what the random error explains), ``condition``.

    Raises:
        EstimationError: settings against the laws above, fewer values than unknowns, or no start converges.
    """
    inputs, outputs = response.inputs, response.outputs
    poles, delay, band = settings.poles, settings.delay, settings.band_hz
    table = _zeros(settings.zeros, outputs)
    words, _ = holds(inputs, settings.hold)
    part = response if band is None else response.between(2.0 * np.pi * band[0], 2.0 * np.pi * band[1])
    groups = [list(range(len(outputs)))] if settings.common else [[i] for i in range(len(outputs))]
    shared = settings.common and len(outputs) > 1
    fits = [_solve(problem_of(part, g, table, settings, words), start, g) for g in groups]
    names, values, blocks, advice = [], [], [], []
    p, m = len(outputs), len(inputs)
    numerators, denominators, delays = np.zeros((p, m, poles + 1)), np.zeros((p, poles + 1)), np.zeros((p, m))
    notes: dict[str, Any] = {"cost": {}, "misfit_ratio": {}, "condition": {}}
    for group, (a, b, tau, covariance, note) in zip(groups, fits, strict=True):
        members = [outputs[i] for i in group]
        name = ", ".join(members)
        names += [f"a{k}" if shared else f"{name}: a{k}" for k in range(1, poles + 1)]
        names += [f"{o}/{u}: b{k}" for o in members for u in inputs for k in range(table[o], -1, -1)]
        values += [*a[1:], *(v for i, o in enumerate(members) for v in b[i, :, poles - table[o] :].ravel())]
        if delay:
            names += [f"{o}/{u}: delay_s" for o in members for u in inputs]
            values += list(tau.ravel())
        denominators[group], numerators[group], delays[group] = a, b, tau
        blocks.append(covariance)
        for key, value in note.items():
            notes[key][name] = value
        advice += _advice(name, note, a, part)
    if np.any(response.random_error > _EXACT):
        advice += approximate("equivalent, windowed")
    covariance = np.zeros((len(names), len(names)))
    at = 0
    for block in blocks:
        covariance[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return ContinuousTransferModel(
        method="equivalent",
        inputs=inputs,
        outputs=outputs,
        dt_s=response.dt_s,
        settings={
            "poles": poles,
            "zeros": table,
            "delay": delay,
            "common": settings.common,
            "weighting": settings.weighting,
            "band_rad_s": [float(part.omega_rad_s[0]), float(part.omega_rad_s[-1])],
        },
        diagnostics=notes,
        advice=tuple(advice),
        numerators=numerators,
        denominators=denominators,
        delays_s=delays,
        hold=words,
        parameter_names=tuple(names),
        parameters=np.array(values),
        covariance=covariance,
    )


def _zeros(zeros: int | Mapping[str, int], outputs: tuple[str, ...]) -> dict[str, int]:
    table = dict.fromkeys(outputs, zeros) if isinstance(zeros, int) else dict(zeros)
    for name in table:
        if name not in outputs:
            raise EstimationError(f"zeros must name outputs of the response, got '{name}'{nearest(name, outputs)}")
    if set(table) != set(outputs):
        raise EstimationError(f"zeros must name every output ({', '.join(outputs)}), got {table}")
    return {name: table[name] for name in outputs}


def _start(problem: Problem, w0: float, tau: FloatArray) -> tuple[FloatArray, float]:
    """Return unknowns from iterated linear least squares for given delays (p, m), and their cost."""
    n, s = problem.n, problem.s / w0
    k, m = len(s), problem.H.shape[2]
    H = problem.H / problem.held[:, None, :] * np.exp(problem.s[:, None, None] * tau)
    powers = s[:, None] ** np.arange(n, -1.0, -1.0)
    weight = problem.weight / np.abs(problem.H)
    below = np.ones(k, np.complex128) * np.abs(1.0 + s) ** n
    best, lowest = np.zeros(0), np.inf
    width = n + m * sum(nz + 1 for nz in problem.zeros)
    for _ in range(8):
        rows, right = [], []
        at = n
        for i, nz in enumerate(problem.zeros):
            for j in range(m):
                factor = (weight[:, i, j] / np.abs(below))[:, None]
                block = np.zeros((k, width), np.complex128)
                block[:, :n] = -factor * H[:, i, j, None] * powers[:, 1:]
                block[:, at : at + nz + 1] = factor * powers[:, n - nz :]
                rows.append(block)
                right.append(factor[:, 0] * H[:, i, j] * powers[:, 0])
                at += nz + 1
        M, r = np.vstack(rows), np.concatenate(right)
        M, r = np.vstack([M.real, M.imag]), np.concatenate([r.real, r.imag])
        size = np.sqrt(np.sum(M**2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        x = np.linalg.lstsq(M / size, r, rcond=1e-13)[0] / size
        below = powers @ np.concatenate([[1.0], x[:n]])
        if not np.all(np.abs(below) > 0.0):
            break
        full = np.concatenate([x, tau.ravel() * w0]) if problem.delay else x
        cost = float(np.sum(residuals(problem, model_of(problem, full, w0)) ** 2))
        if cost < lowest:
            best, lowest = full, cost
    return best, lowest


def _search(problem: Problem, w0: float) -> list[FloatArray]:
    """Return the starts: equal delays over the grid, then each delay by itself from the best of them."""
    _, p, m = problem.H.shape
    grid = np.linspace(0.0, 2.0 * np.pi / np.abs(problem.s[-1]), _DELAYS) if problem.delay else np.zeros(1)
    trials = sorted(((*_start(problem, w0, np.full((p, m), t)), t) for t in grid), key=lambda c: c[1])
    trials = [trial for trial in trials if np.isfinite(trial[1])]
    if not trials:
        raise EstimationError("no start of the fit is finite; lower the order or leave out values near zero")
    starts = [trial[0] for trial in trials[:3]]
    if problem.delay and p * m > 1:
        tau, lowest = np.full((p, m), trials[0][2]), trials[0][1]
        for i, j in np.ndindex(p, m):
            for t in grid:
                other = tau.copy()
                other[i, j] = t
                x, cost = _start(problem, w0, other)
                if cost < lowest:
                    tau, lowest = other, cost
                    starts[0] = x
    return starts


def _solve(
    problem: Problem, start: ContinuousTransferModel | None, outputs: list[int]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, dict[str, float]]:
    """Return a, b, tau, the covariance of the unknowns in SI units, and notes; ``outputs`` are those of the start."""
    w = np.abs(problem.s)
    w0 = float(np.exp(np.mean(np.log(w))))
    pairs = problem.H.shape[1] * problem.H.shape[2]
    # What holds does to a response at the samples is differentiated by numbers.
    jacobian: Any = "3-point" if any(problem.zoh) else lambda x: slopes_of(problem, x, w0)
    if start is None:
        starts = _search(problem, w0)
    else:
        of_outputs = start.denominators[outputs[0]], start.numerators[outputs], start.delays_s[outputs]
        starts = [packed(problem, *of_outputs, w0)]
    low = np.full(starts[0].size, -np.inf)
    if problem.delay:
        low[-pairs:] = 0.0

    def misfit(x: FloatArray) -> FloatArray:
        return residuals(problem, model_of(problem, x, w0)).ravel()

    def fitted(x0: FloatArray, to: float) -> Any:
        ends = {"xtol": to, "ftol": to, "gtol": to, "max_nfev": 300}
        return least_squares(misfit, x0, jac=jacobian, bounds=(low, np.inf), x_scale="jac", **ends)

    if len(starts) > 1:  # that which comes lowest is followed to the last digits
        starts = [min((fitted(x0, _NEAR) for x0 in starts), key=lambda found: float(found.cost)).x]
    best = fitted(starts[0], _LAST)
    a, b, tau = unpack(problem, best.x, w0)
    covariance, notes = _errors(problem, best.x, np.asarray(best.jac), w0)
    return a, b, tau, covariance, notes


def _errors(problem: Problem, x: FloatArray, J: FloatArray, w0: float) -> tuple[FloatArray, dict[str, float]]:
    """Return the covariance of the unknowns in SI units, and what the misfit says."""
    G = model_of(problem, x, w0)
    r = residuals(problem, G)
    if problem.weighting == "likelihood":
        spread = np.stack([problem.weight * problem.error] * 2)
    else:
        spread = (
            problem.weight * problem.error * np.stack([np.full(G.shape, DB), np.full(G.shape, DEGREE * PHASE**0.5)])
        )
    size = np.sqrt(np.sum(J**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    P = np.linalg.pinv(J / size, rcond=1e-12)
    s = np.linalg.svd(J / size, compute_uv=False)
    expected = float(np.sum(spread**2)) * (1.0 - x.size / r.size)
    ratio = float(np.sum(r**2)) / expected if expected > 0.0 else (np.inf if np.sum(r**2) > 1e-16 * r.size else 1.0)
    covariance = (P * spread.ravel() ** 2) @ P.T / np.outer(size, size)
    if np.isinf(ratio):
        covariance = P @ P.T / np.outer(size, size) * float(np.sum(r**2)) / max(r.size - x.size, 1)
    elif ratio > 1.0:
        covariance = covariance * ratio
    covariance = covariance * problem.crowding
    units = [w0 ** np.arange(1.0, problem.n + 1.0)]
    m = problem.H.shape[2]
    units += [np.tile(w0 ** np.arange(problem.n - nz, problem.n + 1.0), m) for nz in problem.zeros]
    if problem.delay:
        units.append(np.full(m * len(problem.zeros), 1.0 / w0))
    unit = np.concatenate(units)
    loes = problem._replace(
        weight=problem.weight if problem.weighting == "loes" else np.full(G.shape, np.sqrt(20.0 / len(G)))
    )
    cost = float(np.sum(residuals(loes, G, "loes") ** 2)) / (G.shape[1] * m)
    notes = {"cost": cost, "misfit_ratio": ratio, "condition": float(s[0] / s[-1]) if s[-1] > 0.0 else np.inf}
    return covariance * np.outer(unit, unit), notes


def _advice(name: str, note: Mapping[str, float], a: FloatArray, part: FrequencyResponse) -> list[Advice]:
    out = AdviceList()
    low, high = float(part.omega_rad_s[0]), float(part.omega_rad_s[-1])
    if note["cost"] > _POOR and note["misfit_ratio"] > _EXPLAINED:  # else the responses are noisy, and the fit is right
        out.wrong(
            "no_fit",
            f"{name}: the mean cost {note['cost']:.0f} exceeds {_POOR:.0f}: no equivalent of this order fits; "
            "raise the order, narrow the band, or allow a delay",
        )
    elif _EXPLAINED < note["misfit_ratio"] < np.inf:
        out.doubt(
            "structure_lacks",
            f"{name}: the misfit is {note['misfit_ratio']:.1f} times what the random error explains, and standard "
            "errors were raised accordingly: the structure lacks a property of the data",
        )
    if note["condition"] > 1e7:
        out.doubt(
            "not_told_apart",
            f"{name}: the unknowns cannot be separated (condition {note['condition']:.1e}): use fewer poles, zeros or "
            "delays",
        )
    sizes = np.abs(np.roots(a))
    outside = sizes[(sizes < low) | (sizes > high)]
    if outside.size and note["misfit_ratio"] != 1.0:
        out.doubt(
            "outside_band",
            f"{name}: poles at {', '.join(f'{w:.2f}' for w in outside)} rad/s lie outside the fitted band "
            f"{low:.2f} to {high:.2f} rad/s: the fit extrapolates; widen the band or fix the order lower",
        )
    return out
