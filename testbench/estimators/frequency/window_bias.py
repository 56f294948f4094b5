"""What windows do to a frequency response: computed, stated beside its random error, and made small by longer windows.

A window that is short against the memory of a system sees its answers without their beginnings: spectra are smoothed
by the window's own, peaks are low and wide, and a delay tau takes a share of about tau / window (J. S. Bendat and A. G.
Piersol, "Random Data", 4th ed., Wiley 2010, section 8.3). How much depends on the system, on the inputs and on where in
the records they move, so it is computed by doing it again: a rational law with delays drives the recorded inputs, and
the same estimator sees its answers. The law is that whose windowed response is the measured one (indirect inference: C.
Gourieroux, A. Monfort and E. Renault, Journal of Applied Econometrics 8(S1), 1993), found from the longest windows that
the records allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from testbench.core.advice import Advice, AdviceList, ranked
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.frequency.equivalent import fit_equivalent
from testbench.estimators.frequency.response import COHERENT, FrequencyResponse, bridged, estimate_frequency_response
from testbench.estimators.model import ComplexArray
from testbench.estimators.settings import LowOrder

_POLES = 4  # most poles of the law
_ROUNDS = 3  # of fitting the response and taking the law's own bias out of it: the third moves it below random errors
_LINES = 90
_MATTERS = 0.05  # allowance for the windows that is worth a remedy, where it exceeds the random error (judgement)
_HELPS = 0.8  # what a remedy must leave of the mean total error (judgement)
_NEIGHBOURS = 5  # lines over which what the law leaves unexplained is averaged
_TAIL = 8.0  # record lengths after which an answer of the law has died away, or is a drift that windows do not see


def response_with_bias(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], *, window_s: Sequence[float]
) -> FrequencyResponse:
    """Return the windowed response with delays taken out and put back, and what its windows do to it.

    ``window_bias`` is W[G u]/G - 1, with W the estimator, G the law and u the recorded inputs. ``window_allowance`` is
    its size, and besides the part of |W[y] - W[G u]|/|H| that the random error does not explain, averaged over
    neighbouring lines. H itself is as it was measured: only delays are taken out. An output of which no law is found
    (nowhere coherent, or no fit) has an allowance of 1, so it is nowhere usable.

    Where the allowance matters (more than 5 %, and more than the random error, in the median of the coherent lines),
    windows twice, four times, ... as long are tried on the records, and advice names what they gave.

    Args:
        records: measured records with one sample time, as deviations from trim.
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        window_s: lengths of the windows, s.

    Raises:
        EstimationError: as of :func:`.spectra.estimate_frequency_response`.
        ChannelError: a record lacks a channel.
    """
    laws = [law_through_windows(records, inputs, output) for output in outputs]
    found = biased_response(records, inputs, outputs, laws, window_s)
    others = [a for a in ranked(found.advice) if a.code != "approximate_intervals"]  # of the random error alone
    return replace(found, advice=(*_advice(records, found, laws, window_s), *others))


def law_through_windows(
    records: Sequence[FlightRecord], inputs: Sequence[str], output: str
) -> ContinuousTransferModel | None:
    """Return the rational law with delays whose windowed response, driven by the recorded inputs, is the measured one.

    Of 1 to 4 poles, strictly proper or not, that with the least misfit for its number of unknowns (Schwarz's criterion
    over the lines that windows leave independent). None if there is none.
    """
    dt, total = records[0].dt_s, sum(record.duration_s for record in records)
    longest = min(max(record.duration_s for record in records), total / 4.0)
    windows = [longest / share for share in (1.0, 2.0, 4.0)]
    omega = np.geomspace(2.0 * np.pi / longest, 0.8 * np.pi / dt, _LINES)
    try:
        measured = estimate_frequency_response(records, inputs, (output,), window_s=windows, omega_rad_s=omega)
    except EstimationError:  # too little data for long windows: nothing is known of what short ones do
        return None
    measured = _rows(measured, measured.coherence[:, 0] >= COHERENT)
    omega = measured.omega_rad_s
    if omega.size < 3:
        return None
    spacing = np.gradient(omega)
    apart = float(np.sum(spacing / np.maximum(spacing, measured.resolution_rad_s))) * measured.H.shape[2]
    best, least = None, np.inf
    for poles, zeros in ((n, z) for n in range(1, _POLES + 1) for z in (n - 1, n)):
        part, order, laws = measured, LowOrder(poles=poles, zeros=zeros, hold="foh"), list[ContinuousTransferModel]()
        try:
            for _ in range(_ROUNDS):
                laws.append(law := fit_equivalent(part, order, *laws[-1:]))
                answer = _through(records, inputs, (output,), [law], windows, omega)
                part = replace(measured, H=measured.H * law.frequency_response(omega) / answer.H)
        except EstimationError:  # more unknowns than lines, or no start: a law of this order is not there
            continue
        miss = np.abs(answer.H - measured.H) / np.abs(measured.H) / np.maximum(measured.random_error, 1e-4)
        cost = apart * float(np.mean(miss**2)) + len(law.parameters) * np.log(2.0 * apart)
        if cost < least:
            best, least = law, cost
    return best


def _rows(response: FrequencyResponse, kept: NDArray[np.bool_]) -> FrequencyResponse:
    names = ("omega_rad_s", "H", "coherence", "partial_coherence", "random_error", "averages", "resolution_rad_s")
    return replace(response, **{name: getattr(response, name)[kept] for name in names})


def _through(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    laws: Sequence[ContinuousTransferModel],
    window_s: Sequence[float],
    omega: FloatArray,
    delay_s: FloatArray | None = None,
) -> FrequencyResponse:
    """Return what the estimator sees of the answers of the laws to the recorded inputs."""
    flown = []
    for record in records:
        u = bridged(record, inputs, record.columns(inputs), np.empty((len(record), 0)))[0]
        answers = {name: _answer(law, u, record.dt_s) for name, law in zip(outputs, laws, strict=True)}
        flown.append(record.with_columns(answers))
    return estimate_frequency_response(flown, inputs, outputs, window_s=window_s, omega_rad_s=omega, delay_s=delay_s)


def _answer(law: ContinuousTransferModel, u: FloatArray, dt_s: float) -> FloatArray:
    """Return y (n,) = inverse transform of G U, inputs (n, m) from rest at their first values.

    Samples of the law itself, without a hold: what is compared with G at the lines is then G and nothing else. A pole
    that grows is answered backwards in time, with the same response.
    """
    n = len(u)
    slowest = max(float(np.min(np.abs(np.roots(law.denominators[0]).real))), 1e-9)
    size = next_fast_len(n + int(min(10.0 / slowest / dt_s, _TAIL * n) + law.delays_s.max() / dt_s), real=True)
    omega = 2.0 * np.pi * np.fft.rfftfreq(size, dt_s)
    omega[0] = 1e-3 * omega[1]  # a pole at zero has no answer there
    G: ComplexArray = law.frequency_response(np.asarray(omega, np.float64))[:, 0]
    return np.asarray(np.fft.irfft(np.sum(G * np.fft.rfft(u - u[0], size, axis=0), axis=1), size)[:n])


def biased_response(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    laws: Sequence[ContinuousTransferModel | None],
    window_s: Sequence[float],
    omega_rad_s: FloatArray | None = None,
) -> FrequencyResponse:
    """Return the response from these windows, aligned by the delays of the laws, with its bias and allowance.

    Args:
        records: as of :func:`response_with_bias`, as are inputs and outputs.
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        laws: (p,) of :func:`law_through_windows`.
        window_s: lengths of the windows, s.
        omega_rad_s: (k,) frequencies; see :func:`.spectra.estimate_frequency_response`.

    Raises:
        EstimationError: as of :func:`.spectra.estimate_frequency_response`.
    """
    none = np.zeros(len(inputs))
    late = np.array([none if law is None else law.delays_s[0] for law in laws])
    late = np.minimum(late, 0.5 * min(window_s))  # beyond, it is no delay that these windows see
    found = estimate_frequency_response(
        records, inputs, outputs, window_s=window_s, omega_rad_s=omega_rad_s, delay_s=late
    )
    bias, allowance = np.zeros(found.H.shape, np.complex128), np.ones(found.H.shape)
    for i, law in enumerate(laws):
        if law is None:
            continue
        answer = _through(records, inputs, (outputs[i],), [law], window_s, found.omega_rad_s, late[[i]])
        bias[:, i] = answer.H[:, 0] / law.frequency_response(found.omega_rad_s)[:, 0] - 1.0
        left = np.abs(found.H[:, i] - answer.H[:, 0]) ** 2 / np.abs(found.H[:, i]) ** 2
        left = left - 2.0 * found.random_error[:, i] ** 2
        width = np.ones(min(_NEIGHBOURS, len(left)))
        mean = [
            np.convolve(column, width, "same") / np.convolve(np.ones(len(left)), width, "same") for column in left.T
        ]
        allowance[:, i] = np.abs(bias[:, i]) + np.sqrt(np.maximum(np.column_stack(mean), 0.0))
    return replace(found, window_bias=bias, window_allowance=allowance)


def _advice(
    records: Sequence[FlightRecord],
    found: FrequencyResponse,
    laws: Sequence[ContinuousTransferModel | None],
    window_s: Sequence[float],
) -> list[Advice]:
    """Return, by output, what the windows do where it matters, and the longer ones that were tried."""
    assert found.window_allowance is not None
    at_fault = []
    for i, law in enumerate(laws):
        good = found.partial_coherence[:, i].max(axis=1) >= COHERENT
        size, chance = (np.median(e[good, i].min(axis=1)) if good.any() else 1.0
                        for e in (found.window_allowance, found.random_error))  # fmt: skip
        if law is not None and (not good.any() or size > max(_MATTERS, float(chance))):
            at_fault.append(i)
    if not at_fault:
        return []
    longest = max(record.duration_s for record in records)
    omega = np.geomspace(found.omega_rad_s[0], found.omega_rad_s[-1], _LINES)  # near enough for the longest windows
    seen = biased_response(records, found.inputs, found.outputs, laws, window_s, omega)
    tried: dict[float, FrequencyResponse] = {}
    window = 2.0 * max(window_s)
    while window <= longest:
        try:
            tried[window] = biased_response(records, found.inputs, found.outputs, laws, (window,), omega)
        except EstimationError:  # too few windows of this length
            break
        window *= 2.0
    out = AdviceList()
    for i in at_fault:
        whole = [seen, *tried.values()]
        band = np.any([r.partial_coherence[:, i].max(axis=1) >= COHERENT for r in whole], axis=0)
        if not band.any():
            continue
        errors = np.array([np.minimum(r.total_error[:, i].min(axis=1), 1.0) for r in whole])
        chosen = int(np.argmin(errors[:, band].mean(axis=1)))
        usable = whole[chosen].usable[:, i].any(axis=1)
        lines = usable if usable.any() else band
        before, after = 100.0 * errors[[0, chosen]][:, lines].mean(axis=1)
        assert seen.window_bias is not None
        change = 100.0 * (np.abs(1.0 + seen.window_bias[:, i])[lines].min(axis=1) - 1.0)
        low, high = np.quantile(change, (0.1, 0.9))
        lengths, names = (", ".join(f"{w:g}" for w in each) for each in (window_s, tried))
        said = (
            f"{found.outputs[i]}: windows of {lengths} s change the response by more than its random error (its "
            f"magnitude by {low:+.0f} to {high:+.0f} % at most lines from {omega[lines][0]:.3g} to "
            f"{omega[lines][-1]:.3g} rad/s)"
        )
        if chosen and usable.any() and after <= _HELPS * before:
            said += (
                f"; with windows of {[*tried][chosen - 1]:g} s, tried on these records, the total error there falls "
                f"from {before:.0f} to {after:.0f} % (means): use those"
            )
        else:
            said += f"; longer ones do not help here (tried: {names or 'none fits'}): use it where it is usable"
        out.doubt("short_windows", said)
    return out
