"""The steps after A and C: the innovations gain, a stable A, and how far poles lie apart.

What is doubtful about a subspace estimate, and what to do about it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from scipy.linalg import fractional_matrix_power
from scipy.optimize import linear_sum_assignment

from testbench.core.advice import Advice, AdviceList
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.core.relative import percent_in_words, share_in_words
from testbench.estimators.model import ComplexArray, continuous_poles
from testbench.estimators.settings import Subspace
from testbench.estimators.subspace.projections import Factor

# --- what is doubtful about a subspace estimate, and what to do about it ----------------------------------------------


_EXCITED = 1e-6  # weaker directions of the past inputs, relative to the strongest, count as not excited
_WEAK = 5.0  # states below this many noise floors are found, but their poles are not to be trusted
_MOVED = 0.1  # relative change of a pole under another horizon that is worth a warning
_RESTLESS = 2.0  # free-run over one-step errors beyond which something is missing in the model
_POOR = 50.0  # free-run error in percent of the output beyond which a model does not predict
_FEEDBACK = 0.02  # share of the innovations explained by later inputs from which on a loop is suspected


def doubts(found: Mapping[str, Any], outputs: Sequence[str], J: int, L: int) -> tuple[Advice, ...]:
    """Return one sentence per doubt that the diagnostics ``found`` of an estimate with horizons J and L give rise to.

    The thresholds are judgement, set on simulated short periods and phugoids with measurement noise, 10 to 100 Hz:
    there every estimate with a pole off by more than 10 % broke at least one. They err on the side of warning.
    """
    out = AdviceList()
    n, values = found["order"], found["singular_values"]
    noisy = bool(np.any(found["innovations_std"] > 0.0))
    other = found["other_future_horizon"]
    if found["unknowns"] > found["columns"] / 2:
        out.doubt(
            "few_data",
            f"step 1 nearly interpolates: {found['unknowns']} unknowns per output from {found['columns']} columns; "
            "shorten past_horizon, give more data or decimate",
        )
    if found["input_excitation"] < _EXCITED:
        out.doubt(
            "weak_excitation",
            f"the inputs do not excite past_horizon = {J} samples (weakest over strongest direction "
            f"{found['input_excitation']:.1e}): the response is determined only where the input has energy; "
            "decimate, shorten past_horizon or excite a wider band",
        )
    if noisy and values[n - 1] < _WEAK:
        out.doubt(
            "weak_state",
            f"state {n} is only {values[n - 1]:.2g} times above the noise floor: poles are unreliable; lengthen "
            "future_horizon, decimate, add a sensor or lower the order",
        )
    if noisy and n < values.size and values[n] > max(_WEAK, 0.1 * values[n - 1]):
        out.doubt(
            "order_too_low",
            f"order {n} discards a state that is {values[n]:.2g} times above the noise floor (turbulence, sensor "
            "dynamics, nonlinearity or a structural mode): try a higher order",
        )
    if found["pole_shift_past"] is not None and found["pole_shift_past"] > _MOVED:
        out.doubt(
            "past_horizon",
            f"with past_horizon = {J // 2} a pole moves by {share_in_words(found['pole_shift_past'])}: past_horizon = "
            f"{J} is too short, or the data do not contain that pole; lengthen it or give more data",
        )
    if found["pole_shift_future"] is not None and found["pole_shift_future"] > _MOVED:
        out.doubt(
            "future_horizon",
            f"with future_horizon = {other} a pole moves by {share_in_words(found['pole_shift_future'])}: "
            f"future_horizon = {L} is too short to separate the states, or the data do not contain that pole; lengthen "
            "it or decimate",
        )
    if found["poles_without_continuous_counterpart"].size:
        z = ", ".join(f"{z.real:.3g}" for z in found["poles_without_continuous_counterpart"])
        out.doubt(
            "no_continuous_counterpart",
            f"discrete poles at {z} have no continuous counterpart: they model noise, not the aircraft; "
            f"lengthen future_horizon = {L}, lower the order or decimate",
        )
    restless = [
        f"{name} {ratio:.1f}"
        for name, ratio in zip(outputs, found["free_run_over_innovations"], strict=True)
        if ratio > _RESTLESS
    ]
    if restless:
        out.doubt(
            "free_run",
            f"the errors of the free run exceed the innovations by factors of {', '.join(restless)}: turbulence, "
            "drift, nonlinearity, noise coloured by a low-pass filter, or a missing state; compare a higher order and "
            "a longer future_horizon",
        )
    poor = [
        f"{name} {percent_in_words(error)}"
        for name, error in zip(outputs, found["output_error_percent"], strict=True)
        if error > _POOR
    ]
    if poor:
        out.wrong(
            "does_not_predict",
            "in free run the model leaves much of the records that it was fitted to unexplained "
            f"({', '.join(poor)}): do not use it to predict",
        )
    if found["moved_poles"].size:
        z = ", ".join(f"{abs(z):.4g}" for z in found["moved_poles"])
        out.doubt(
            "poles_moved",
            f"poles of modulus {z} were moved inside the unit circle (stable = true): their damping is not reliable",
        )
    return tuple(out)


def advice_in_words(found: Mapping[str, Any], outputs: Sequence[str], given: Subspace) -> tuple[Advice, ...]:
    """Return one sentence per doubt: those of DSR_e, whose thresholds are the same, and those of the family.

    The threshold of feedback is judgement: simulated pitch dampers with turbulence give 0.05 and more, open loops with
    noise on the outputs less than 0.01 beyond chance.
    """
    out = AdviceList(doubts(found, outputs, given.past_horizon, given.future_horizon))
    robust = given.method in ("ssarx", "pbsid_opt")
    if found["feedback"] > _FEEDBACK and not (robust and given.closed_loop):
        out.doubt(
            "closed_loop",
            f"later inputs explain {100 * found['feedback']:.0f} % of the innovations: the inputs react to the "
            "outputs (closed loop), which biases "
            + ("B and D; set closed_loop" if robust else f"{given.method}; use ssarx, pbsid_opt or dsr_e"),
        )
    if found["predictor_radius"] >= 1.0 and np.any(found["innovations_std"] > 0.0):
        out.doubt(
            "unstable_predictor",
            f"the one-step predictor A - K C is unstable (spectral radius {found['predictor_radius']:.3g}): "
            "do not filter with K; lengthen past_horizon or give more data",
        )
    return tuple(out)


# --- the steps after A and C ------------------------------------------------------------------------------------------


_LONG = 20  # future horizons from here on are checked against their half, shorter ones against their double
_OTHER_HORIZONS: ContextVar[bool] = ContextVar("other_horizons", default=True)
_DEFECTIVE = 1e10  # condition of the eigenvectors beyond which a pole cannot be moved alone


def gain(A: FloatArray, C: FloatArray, f: Factor) -> FloatArray:
    """Return K (n, p) in the factor's units, by least squares of the VARX predictor's response to the innovations.

    With VARX coefficients Y_j of y[k - j], that response is H_i = sum_(j=1..i) Y_j H_(i-j), H_0 = I; for the
    innovations model it is C A^(i-1) K. Noise-free outputs have none.
    """
    d, p, n = f.m + f.p, f.p, A.shape[0]
    K = np.zeros((n, p))
    if f.exact:
        return K
    lags = [f.theta[(f.J - j) * d + f.m : (f.J - j + 1) * d].T for j in range(1, f.J + 1)]
    H = [np.eye(p)]
    O_L = [C]
    for i in range(1, f.J + 1):
        H.append(sum((lags[j - 1] @ H[i - j] for j in range(1, i + 1)), np.zeros((p, p))))
        O_L.append(O_L[-1] @ A)
    K[:] = np.linalg.lstsq(np.vstack(O_L[:-1]), np.vstack(H[1:]), rcond=1e-10)[0]
    K[:, ~f.noisy] = 0.0
    return K


def reflect(A: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Return A with its poles outside the unit circle at 1/z*, and those poles; poles on the circle stay.

    Frequency and eigenvectors stay, damping changes its sign.

    Raises:
        EstimationError: A is defective, so that its poles cannot be moved one by one.
    """
    z, V = np.linalg.eig(A)
    outside = np.abs(z) > 1.0
    if not outside.any():
        return A, np.zeros(0, np.complex128)
    if np.linalg.cond(V) > _DEFECTIVE:
        raise EstimationError("stable = true needs distinct poles, got repeated ones; lower the order")
    moved = np.where(outside, 1.0 / np.conj(np.where(outside, z, 1.0)), z)
    return np.real(V @ np.diag(moved) @ np.linalg.inv(V)), np.asarray(z[outside], np.complex128)


def pair(reference: ComplexArray, other: ComplexArray) -> ComplexArray:
    """Return ``other`` in the order that lies nearest to ``reference``, relatively, at least total cost."""
    apart = np.abs(reference[:, None] - other) / np.maximum(np.abs(reference), 1e-12)[:, None]
    return np.asarray(other[linear_sum_assignment(apart)[1]])


def pole_distance(A: FloatArray, other: FloatArray) -> float:
    """Return the largest distance of the poles ln z of two models, each relative to the first's, paired."""
    s, t = (np.log(np.linalg.eigvals(M).astype(complex) + 1e-300) for M in (A, other))
    return float(np.max(np.abs(s - pair(s, t)) / np.maximum(np.abs(s), 1e-12)))


def other_horizon(L: int) -> int:
    """Return the future horizon with which L is compared: its double or, if L is long, its half, which costs less."""
    return 2 * L if L < _LONG else L // 2


@contextmanager
def without_other_horizons() -> Generator[None, None, None]:
    """Identify inside the block with the given horizons only: models are the same, and no doubt says how far others
    would move their poles. That takes a quarter of the time, which repetitions of one identification need not spend.
    """
    token = _OTHER_HORIZONS.set(False)
    try:
        yield
    finally:
        _OTHER_HORIZONS.reset(token)


def pole_shifts(
    A: FloatArray, other: int, past: Callable[[], FloatArray] | None, future: Callable[[], FloatArray] | None
) -> dict[str, Any]:
    """Return how far, relatively, the poles move with half the past horizon and with another future horizon.

    A past horizon too short to forget the initial state biases the poles, and half of it biases them more; a future
    horizon too short to tell the states apart is seen by doubling it.

    Args:
        A: (n, n) state matrix of the estimate.
        other: the other future horizon.
        past: makes A with half the past horizon; None where that is not possible, or without noise.
        future: makes A with the other future horizon; None likewise.
    """
    if not _OTHER_HORIZONS.get():
        past = future = None
    return {
        "other_future_horizon": other,
        "pole_shift_past": None if past is None else pole_distance(A, past()),
        "pole_shift_future": None if future is None else pole_distance(A, future()),
    }


def to_rate(A: FloatArray, stride: int) -> tuple[FloatArray, ComplexArray]:
    """Return A^(1/stride), and the eigenvalues without a continuous counterpart, which forbid it (A as it is then)."""
    lost = continuous_poles(np.linalg.eigvals(A).astype(np.complex128), 1.0)[1]
    if stride == 1 or lost.size:
        return A, lost if stride > 1 else lost[:0]
    return np.real(fractional_matrix_power(A, 1.0 / stride)), lost


def lost_poles(lost: ComplexArray, stride: int) -> str:
    """Return the message that A of the lower rate cannot come back to the records' rate."""
    return (
        f"a model identified at every {stride}th sample needs a continuous counterpart of every pole to come back to "
        f"the records' rate, got z = {np.array2string(lost.real, precision=3)}; lower the order or decimate less"
    )
