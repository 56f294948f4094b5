"""DSR_e: subspace identification in two steps, innovations first and a deterministic problem after.

D. Di Ruscio, "Closed and Open Loop Subspace System Identification of the Kalman Filter", Modeling, Identification
and Control 30(2), 2009, and the variant of the EOLO paper (section 2.1, equations 1 to 3). Symbols as there: past
horizon J, future horizon L; subscript f marks the block Hankel matrix of L future samples.

Step 1. The row space of the past is W = [U_past; Y_past], J samples of each (with D free, U_k joins it). The signal
part y^d = Y / W is the orthogonal projection of the outputs on it, and e = y - y^d are the innovations.

Step 2. x[k+1] = A x[k] + [B K] [u; e][k], y^d[k] = C x[k] is a deterministic problem. The oblique projection of the
future outputs along the future inputs on the past, P_L = Y^d_f /_[U_f; E_f] W = O_L X, shows the order in its singular
values. Its columns are weighted by the projection on the orthogonal complement of the future inputs:

    P_L Pi = Y^d_f Pi = Z_{J|L},    Pi = I - [U_f; E_f]^+ [U_f; E_f],

where the first equality holds because Y^d_f lies in the row space of W and of the future inputs. Weights from the
right leave the column space alone (Van Overschee and De Moor 1996, unifying theorem); this one makes the EOLO paper's
P_L Di Ruscio's own Z_{J|L}. It is needed: inputs confined to a fraction of the Nyquist frequency are nearly predictable
from their past, the two factors of the oblique projection then cannot be told apart, and P_L unweighted turns a short
period of 3 rad/s, excited by a sweep at 50 Hz with 5 % noise, into poles beyond 100 rad/s.

That is the default, ``variant = "original"``; ``variant = "eolo"`` is the unweighted one (``dsr_e_variant``), which is
compared with it. Steps 1 and 2 do not ask why the inputs moved: with D = 0 they hold in closed loop, and so do their
B and K, while the last step below does not (``closed_loop``).

With P_L Pi = U S V': O_L = U_n S_n^(1/2), C is its first block, A its shift. Given A and C, B and K follow by linear
least squares from the deterministic problem, the initial states eliminated. A last linear least squares then fits B, D
and the initial states to the measured outputs in free run over all records together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.call import with_settings
from testbench.estimators.hankel import BlockHankel, window_starts
from testbench.estimators.model import check_records, continuous_poles
from testbench.estimators.settings import DsrE
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.subspace.data import (
    LEAD,
    Offset,
    Stretch,
    automatic_stride,
    check_horizons,
    check_stride,
    scale,
)
from testbench.estimators.subspace.data import decimate as decimated
from testbench.estimators.subspace.dsr_e_advice import advice_in_words
from testbench.estimators.subspace.dsr_e_steps import (
    Innovations,
    Inputs,
    Realisation,
    innovations,
    input_matrices,
    realise,
)
from testbench.estimators.subspace.dsr_e_variant import realise_unweighted
from testbench.estimators.subspace.tail import lost_poles, pole_distance, reflect, to_rate

Variant = Literal["original", "eolo"]

_LONG = 20  # future horizons from here on are checked against their half, shorter ones against their double


@with_settings(DsrE)
def estimate(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    past_horizon: int,
    future_horizon: int,
    order: int | None,
    direct_feedthrough: bool,
    variant: Variant,
    offset: Offset,
    decimate: int | Literal["auto"],
    stable: bool,
    closed_loop: bool,
) -> StateSpaceModel:
    """Identify an innovations model by DSR_e (module docstring) from one or several records of deviations from trim.

    Hankel columns of all records are put side by side; none reaches across a joint or touches an invalid sample.
    Channels are scaled by their root mean square and outputs by the deviation of their innovations, so that units do
    not matter. Noise on the inputs biases the estimate, as in every method of this family.

    Args:
        records: measured records with one sample time; deviations from trim (see ``prepare``).
        inputs: (m,) channels that drive the model.
        outputs: (p,) channels that it predicts.
        past_horizon: J >= 1 in samples. (A - K C)^J must be negligible, while J (m + p) unknowns per output have to
            stay well below the number of samples.
        future_horizon: L >= 2 in samples. L times the sample time should reach a good part of the fastest mode's time
            constant: over a shorter time the states' contributions differ by less than the noise.
        order: number of states, or None to choose it from the singular values.
        direct_feedthrough: estimate D; zero if not.
        variant: "original", weighted as Di Ruscio's, or "eolo", the EOLO paper's unweighted oblique projection. The
            latter is only for inputs that excite the whole band; it is compared with the original one, and a warning
            says where they part.
        offset: "none", "offset" or "trend": constants, or constants and linear trends, of all channels and records
            that are estimated along; the model itself is of the deviations from them.
        decimate: stride of the low-passed samples that A and C are identified from, or "auto": to ten times the
            bandwidth of the inputs. The horizons of A and C count those samples; the model has the records' rate.
        stable: move poles outside the unit circle to their mirror image 1/z* inside.
        closed_loop: keep B of the deterministic problem, which feedback does not bias (D must be zero), instead of
            that of the free run, whose errors then correlate with the inputs.

    Returns:
        The model, with these diagnostics:
        ``singular_values``: of Z_{J|L}, in multiples of the noise floor that step 1 makes one expect (of noise-free
        data: of the largest); ``order`` and ``order_choice`` in words;
        ``columns`` and ``unknowns`` per output of step 1, ``columns_step_2``;
        ``condition``: of the past W; ``input_excitation``: weakest over strongest singular value of the past inputs;
        ``innovations_std``: (p,) in SI units, 0 for an output free of noise;
        ``output_error_percent``: (p,) 100 ||y - y_free|| / ||y|| of the free run on the records, and
        ``output_error_deterministic_B``, ``output_error_refined_B``: of all outputs before and after the last step;
        ``free_run_over_innovations``: (p,) near 1 if measurement noise is all that the model leaves, 0 without noise;
        ``pole_shift_past``, ``pole_shift_future``: largest relative change of a pole with J halved, and with
        ``other_future_horizon`` (2 L; from L = 20 on L / 2); None without noise;
        ``poles_without_continuous_counterpart``: discrete z.

    Raises:
        EstimationError: settings against the method's laws, too few columns for the unknowns, or records against
            those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    J, L = past_horizon, future_horizon
    check_horizons(J, L, order, len(outputs))
    check_stride(decimate)
    if variant not in get_args(Variant) or (variant == "eolo" and direct_feedthrough):
        raise EstimationError(
            f"variant must be one of {', '.join(get_args(Variant))}, 'eolo' with D = 0, got '{variant}' with "
            f"direct_feedthrough = {direct_feedthrough}"
        )
    check_records(records, inputs, outputs)
    stretches, size_u, size_y = scale(records, inputs, outputs, offset)
    lead = LEAD[offset]
    stride = automatic_stride(stretches, records[0].dt_s) if decimate == "auto" else int(decimate)
    slow, free = decimated(stretches, stride), direct_feedthrough or stride > 1
    other = 2 * L if L < _LONG else L // 2
    low = innovations(slow, _hankel(slow, (J + 1, J + L, J // 2 + 1, J // 2 + L, J + other), lead), J, free)
    step2 = realise(low, L, order)
    parted = None
    if variant == "eolo":
        plain = Realisation(*realise_unweighted(low, L, order))
        if plain.A.shape == step2.A.shape:
            parted = pole_distance(step2.A, plain.A)
        step2 = plain
    shifts = _pole_shifts(low, step2, L, other, free)
    step1 = low
    if stride > 1:
        A, lost = to_rate(step2.A, stride)
        if lost.size:
            raise EstimationError(lost_poles(lost, stride))
        full = _hankel(stretches, (J + 1,), lead)
        step1 = replace(innovations(stretches, full, J, direct_feedthrough), excitation=low.excitation)
        step2 = step2._replace(A=A, C=low.deviation[:, None] * step2.C / step1.deviation[:, None])
    moved = np.zeros(0, np.complex128)
    if stable:
        A, moved = reflect(step2.A)
        step2 = step2._replace(A=A)
    found = input_matrices(step1, step2, direct_feedthrough, closed_loop)
    unit = size_y * step1.deviation  # of the outputs, in SI
    model = StateSpaceModel(
        method="dsr_e",
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        dt_s=records[0].dt_s,
        settings={
            "past_horizon": J,
            "future_horizon": L,
            "order": order,
            "direct_feedthrough": direct_feedthrough,
            "variant": variant,
            "offset": offset,
            "decimate": decimate,
            "stable": stable,
            "closed_loop": closed_loop,
        },
        A=step2.A,
        B=found.B / size_u,
        C=unit[:, None] * step2.C,
        D=unit[:, None] * found.D / size_u,
        K=found.K / unit,
    )
    diagnostics = _diagnostics(step1, step2, found, size_y, shifts, model.dt_s)
    diagnostics |= {
        "decimate": stride,
        "identified_at_dt_s": stride * model.dt_s,
        "moved_poles": moved,
        "pole_shift_variant": parted,
    }
    advice = advice_in_words(diagnostics, outputs, J, L) + _advice_on_variant(variant, parted)
    return replace(model, diagnostics=diagnostics, status="warning" if advice else "good", advice=advice)


def _advice_on_variant(variant: Variant, parted: float | None) -> tuple[str, ...]:
    if variant != "eolo" or (parted is not None and parted <= 0.1):
        return ()
    apart = "of another order" if parted is None else f"{100 * parted:.0f} % away"
    return (
        f"the original DSR_e finds poles {apart}: the unweighted projection divides by what the inputs do not "
        'excite; use variant = "original", excite a wider band or decimate',
    )


def _diagnostics(
    step1: Innovations,
    step2: Realisation,
    inputs: Inputs,
    size_y: FloatArray,
    shifts: dict[str, Any],
    dt_s: float,
) -> dict[str, Any]:
    unit = size_y * step1.deviation
    return {
        "singular_values": step2.singular_values,
        "order": step2.A.shape[0],
        "order_choice": step2.order_choice,
        "columns": step1.columns,
        "unknowns": step1.unknowns,
        "columns_step_2": step2.columns,
        "condition": step1.condition,
        "input_excitation": step1.excitation,
        "innovations_std": np.where(step1.noisy, unit, 0.0),
        "output_error_percent": 100.0 * inputs.residual,
        "free_run_over_innovations": np.where(step1.noisy, inputs.residual / step1.deviation, 0.0),
        "output_error_deterministic_B": inputs.percent[0],
        "output_error_refined_B": inputs.percent[1],
        **shifts,
        "poles_without_continuous_counterpart": continuous_poles(
            np.linalg.eigvals(step2.A).astype(np.complex128), dt_s
        )[1],
    }


def _hankel(stretches: Sequence[Stretch], lengths: Sequence[int], lead: int) -> BlockHankel:
    return BlockHankel([s.both for s in stretches], [s.good for s in stretches], lengths, lead)


def _pole_shifts(step1: Innovations, step2: Realisation, L: int, other: int, direct: bool) -> dict[str, Any]:
    """Return how far, relatively, the poles move with half the past horizon and with another future horizon.

    A past horizon too short to forget the initial state biases the poles, and half of it biases them more; a future
    horizon too short to tell the states apart is seen by doubling it (a long one, by halving it, which costs less).
    None where the other horizon is not possible, or without noise, where the poles are exact.
    """
    n, p, J = step2.A.shape[0], step1.deviation.size, step1.J
    shifts: dict[str, Any] = {"other_future_horizon": other, "pole_shift_past": None, "pole_shift_future": None}
    if not step1.noisy.any():
        return shifts
    if J >= 2:
        half = realise(innovations(step1.stretches, step1.windows, J // 2, direct), L, n)
        shifts["pole_shift_past"] = pole_distance(step2.A, half.A)
    columns = sum(window_starts(known, other).size for known in step1.known)
    if n <= p * (other - 1) and columns >= other * (step1.stretches[0].u.shape[1] + 2 * p):
        shifts["pole_shift_future"] = pole_distance(step2.A, realise(step1, other, n).A)
    return shifts
