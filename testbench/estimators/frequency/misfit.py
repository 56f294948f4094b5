"""The weighted misfit of a low-order model with delay to measured frequency responses, and its slopes.

Cost and weights as in :mod:`testbench.estimators.frequency.equivalent`, which fits by them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.estimators.frequency.response import FrequencyResponse
from testbench.estimators.frequency.sampled import sampled_response
from testbench.estimators.model import ComplexArray
from testbench.estimators.state_variable import Hold

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
    part: FrequencyResponse,
    group: list[int],
    zeros: Mapping[str, int],
    n: int,
    delay: bool,
    weighting: Weighting,
    words: tuple[Hold, ...],
) -> Problem:
    """Return what is fitted: the outputs ``group`` of ``part`` by ``n`` poles and, per output, so many ``zeros``.

    Args:
        part: the response in the band that counts.
        group: indices of the outputs that share a denominator.
        zeros: output -> number of zeros.
        n: number of poles.
        delay: whether each pair has a delay.
        weighting: "loes" or "likelihood".
        words: per input, what it does between samples.

    Raises:
        EstimationError: fewer values than unknowns, or a response of exactly zero.
    """
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
