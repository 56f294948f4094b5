"""FrequencyResponse: a measured frequency response with its coherences and its random error.

Frequency responses from windowed spectra: several inputs and outputs, several records, one or several windows.

J. S. Bendat and A. G. Piersol, "Random Data", 4th ed., Wiley 2010, chapters 7 and 9; M. B. Tischler and R. K. Remple,
"Aircraft and Rotorcraft System Identification", 2nd ed., AIAA 2012, chapters 7 to 10 (chirp-z,
MISO, composite windows).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, AdviceList, Advised, as_json
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import array_found
from testbench.estimators.coverage import approximate
from testbench.estimators.hankel import window_starts
from testbench.estimators.model import ComplexArray, check_records

COHERENT = 0.6  # the bound of flight test below which a response is not believed (Tischler and Remple, section 7.5)
USABLE = 0.2  # and the total error up to which it is used: 1.7 dB and 11 deg (custom)
_OPTIONAL = ("window_bias", "window_allowance")
_COMPLEX = ("H", "window_bias")


@dataclass(frozen=True, eq=False, kw_only=True)
class FrequencyResponse(Advised):
    """H(jw) from inputs to outputs at some frequencies, and how well each value is known."""

    omega_rad_s: FloatArray  # (k,) frequencies, increasing
    H: ComplexArray  # (k, p, m) complex responses, SI unit per SI unit
    coherence: FloatArray  # (k, p) multiple coherence: share of each output's power that all inputs explain together
    # (k, p, m) coherence of output and input, freed of what the other inputs explain of both
    partial_coherence: FloatArray
    random_error: FloatArray  # (k, p, m) standard deviation of |H| over |H|, which is that of the phase in rad
    averages: FloatArray  # (k,) number of independent averages
    resolution_rad_s: FloatArray  # (k,) width that one value stands for: values closer than this are not independent
    inputs: tuple[str, ...]  # (m,) names
    outputs: tuple[str, ...]  # (p,) names
    dt_s: float  # sample time of the records, s
    method: str  # the function that made it
    # (k, p, m) complex, computed: H is 1 + window_bias times what it would be without windows; None where nothing
    # computed it (see :mod:`testbench.estimators.frequency.window_bias`)
    window_bias: ComplexArray | None = None
    # (k, p, m) size of that bias with what the computation leaves open, over |H|; None else
    window_allowance: FloatArray | None = None
    # (p, m) pure delays that were taken out before windowing and put back, s; None where none was
    delay_s: FloatArray | None = None
    diagnostics: Mapping[str, Any] = field(default_factory=dict)  # what it saw on the way
    advice: tuple[str, ...] = ()  # what is wrong or doubtful and what to do about it; ``status`` follows from it

    def __post_init__(self) -> None:
        k, p, m = np.size(self.omega_rad_s), len(self.outputs), len(self.inputs)
        shapes: dict[str, tuple[int, ...]] = {
            "omega_rad_s": (k,),
            "H": (k, p, m),
            "coherence": (k, p),
            "partial_coherence": (k, p, m),
            "random_error": (k, p, m),
            "averages": (k,),
            "resolution_rad_s": (k,),
        }
        optional = dict.fromkeys(_OPTIONAL, (k, p, m)) | {"delay_s": (p, m)}
        shapes |= {name: shape for name, shape in optional.items() if getattr(self, name) is not None}
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.complex128 if name in _COMPLEX else np.float64)
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise EstimationError(f"{name} must be finite and of shape {shape}, got {array_found(array)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if np.any(np.diff(self.omega_rad_s) <= 0.0):
            raise EstimationError("frequencies of a response must increase; sort them and leave out doubles")

    @property
    def total_error(self) -> FloatArray:
        """Random error and allowance for the windows together, sqrt(sum of squares), over |H|; shape (k, p, m)."""
        return (
            self.random_error if self.window_allowance is None else np.hypot(self.random_error, self.window_allowance)
        )

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Where a response may be used, (k, p, m): partial coherence of at least 0.6, total error of at most 20 %."""
        return np.asarray((self.partial_coherence >= COHERENT) & (self.total_error <= USABLE), bool)

    def between(self, low_rad_s: float, high_rad_s: float) -> FrequencyResponse:
        """Return the values with low <= w <= high.

        Raises:
            EstimationError: there is none.
        """
        from dataclasses import replace

        rows = (self.omega_rad_s >= low_rad_s) & (self.omega_rad_s <= high_rad_s)
        if not rows.any():
            raise EstimationError(
                f"a band must hold frequencies of the response, got {low_rad_s:g} to {high_rad_s:g} rad/s and a "
                f"response from {self.omega_rad_s[0]:g} to {self.omega_rad_s[-1]:g} rad/s"
            )
        names = ("omega_rad_s", "H", "coherence", "partial_coherence", "random_error", "averages", "resolution_rad_s")
        parts: dict[str, Any] = {name: getattr(self, name)[rows] for name in names}
        for name in _OPTIONAL:
            value = getattr(self, name)
            parts[name] = None if value is None else value[rows]
        return replace(self, **parts)

    def to_control(self) -> Any:
        """Return the response as ``control.FRD`` with signal names."""
        import control

        return control.frd(
            np.moveaxis(self.H, 0, 2), self.omega_rad_s, inputs=list(self.inputs), outputs=list(self.outputs)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as JSON values; complex numbers as pairs of lists under "real" and "imag"."""
        out: dict[str, Any] = {
            name: getattr(self, name).tolist()
            for name in (
                "omega_rad_s", "coherence", "partial_coherence", "random_error", "averages", "resolution_rad_s",
            )
        }  # fmt: skip
        for name in ("window_allowance", "delay_s"):
            value = getattr(self, name)
            out[name] = None if value is None else value.tolist()
        bias = self.window_bias
        return out | {
            "window_bias": None if bias is None else {"real": bias.real.tolist(), "imag": bias.imag.tolist()},
            "method": self.method,
            "inputs": list(self.inputs),
            "outputs": list(self.outputs),
            "dt_s": self.dt_s,
            "H": {"real": self.H.real.tolist(), "imag": self.H.imag.tolist()},
            "status": self.status,
            "advice": as_json(self.advice),
        }


def interval_factor(freedoms: float) -> float:
    """Return how many random errors to either side hold the truth with 95 %: Student's t, not 1.96.

    A noise power that few periods or averages tell, each with a real and an imaginary part, is itself uncertain.
    """
    from scipy.stats import t

    return float(t.ppf(0.975, max(freedoms, 1.0)))


# --- frequency responses from windowed spectra ------------------------------------------------------------------------


_CHUNK = 2_000_000  # complex exponentials held at once
_TAKEN = 0.9  # a segment with fewer samples really taken, in any channel, is left out
_CORRELATED = 0.9  # coherence among inputs beyond which they are hard to tell apart (section 9.5, from memory)


class _Spectra(NamedTuple):
    """Cross spectra of z = [u, y] summed over segments, S (k, d, d) = sum conj(Z_i) Z_j / window energy, and counts."""

    S: ComplexArray
    averages: float
    resolution: float


def estimate_frequency_response(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    window_s: float | Sequence[float],
    omega_rad_s: FloatArray | None = None,
    overlap: float = 0.5,
    delay_s: FloatArray | None = None,
) -> FrequencyResponse:
    """Return H = S_yu S_uu^-1 from overlapping Hann windows, freed of the correlation among inputs, with its error.

    The Fourier transforms of the segments, means removed, are taken at any frequencies (a chirp-z transform gives
    the same numbers on a uniform grid). The random error is Bendat and Piersol's, with partial coherence g_p^2:

        s(|H|) / |H| = s(phase) = sqrt(1 - g_p^2) / (|g_p| sqrt(2 n_d)),    n_d = n_e - (m - 1)

    with n_e the number of independent averages in overlapping Hann windows (P. D. Welch, IEEE Transactions on Audio and
    Electroacoustics 15(2), 1967) and one average lost per further input. It holds for noise on the outputs; noise on
    the inputs, and leakage where the response turns within one resolution, bias H towards zero.

    Several windows are combined (composite windowing): the spectra of window i weigh as (error_min / error_i)^4, by
    frequency and output, so that long windows serve low frequencies and short ones high frequencies. The windows look
    at the same data: their averages do not add up.

    Args:
        records: measured records with one sample time; the segments of all are averaged, none reaches across two.
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        window_s: length of the segments, s, or several lengths for composite windowing.
        omega_rad_s: (k,) increasing frequencies up to Nyquist; by default the multiples of 1/window (the longest) from
            the first on.
        overlap: 0 <= overlap < 1.
        delay_s: (p, m) delays >= 0 of each output behind each input, taken out to whole samples before windowing and
            put back: a delay of d seconds biases H by about d / window (Bendat and Piersol, section 8.3).

    Returns:
        The response. Its diagnostics hold ``input_coherence`` (k,), the largest multiple coherence of an input with the
        others, ``averages`` by window, and ``interval_factor``: random errors to either side that hold 95 %.

    Raises:
        EstimationError: settings against the laws above, no more averages than inputs, gaps in all segments, inputs
            that cannot be told apart, or records against those of :func:`check_records`.
        ChannelError: a record lacks a channel.
    """
    data = check_records(records, inputs, outputs)
    dt, m = records[0].dt_s, len(inputs)
    windows = np.atleast_1d(np.asarray(window_s, np.float64))
    longest = max(record.duration_s for record in records) + dt
    if not np.all(windows <= longest):  # not a number neither
        raise EstimationError(
            f"windows must fit into a record, the longest of which lasts {longest:g} s, got "
            f"{', '.join(f'{w:g} s' for w in windows)}; take shorter windows or a longer record"
        )
    lengths = sorted({round(w / dt) for w in windows}, reverse=True)
    if not 0.0 <= overlap < 1.0 or lengths[-1] < 8:
        raise EstimationError(
            f"0 <= overlap < 1 and windows of at least 8 samples ({8 * dt:g} s) must hold, got overlap {overlap:g} and "
            f"window_s = {window_s}"
        )
    omega = _grid(omega_rad_s, lengths[0], dt)
    late = np.zeros((len(outputs), m), int) if delay_s is None else np.rint(np.asarray(delay_s) / dt).astype(int)
    if late.shape != (len(outputs), m) or late.min() < 0:
        raise EstimationError(
            f"delay_s must be a table of delays >= 0, ({len(outputs)}, {m}) by output and input, got {delay_s}"
        )
    joined = [bridged(record, [*inputs, *outputs], u, y) for record, (u, y) in zip(records, data, strict=True)]
    scale = np.sqrt(np.mean(np.concatenate([(z - z.mean(axis=0)) ** 2 for z, _ in joined]), axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    joined = [(z / scale, valid) for z, valid in joined]
    parts: list[list[_Spectra]] = [[]] * len(outputs)  # of each output
    for row in np.unique(late, axis=0):
        group = np.flatnonzero((late == row).all(axis=1))
        aligned = [(_aligned(z, row, m + group), _aligned(valid, row, m + group)) for z, valid in joined]
        for n in lengths:
            S, *rest = _spectra(aligned, n, overlap, omega, dt, m)
            for place, i in enumerate(group):
                own = [*range(m), m + place]
                parts[i] = [*parts[i], _Spectra(S[:, own][:, :, own], *rest)]
    response = _combine(parts, omega, tuple(inputs), tuple(outputs), scale, dt, lengths)
    if delay_s is None:
        return response
    back = np.exp(-1j * omega[:, None, None] * (late * dt))
    return replace(response, H=response.H * back, delay_s=late * dt)


def _aligned(z: FloatArray, late: NDArray[np.int_], outputs: NDArray[np.int_]) -> FloatArray:
    """Return the inputs of z (n, d) moved ``late`` (m,) samples towards the later, beside some outputs."""
    longest, m = int(late.max()), late.size
    moved = [z[longest - d : len(z) - d, j] for j, d in enumerate(late)]
    return np.column_stack([*moved, z[longest:, outputs]]) if longest else z[:, [*range(m), *outputs]]


def _grid(omega_rad_s: FloatArray | None, longest: int, dt_s: float) -> FloatArray:
    nyquist = np.pi / dt_s
    if omega_rad_s is None:
        return np.asarray(2.0 * np.pi / (longest * dt_s) * np.arange(1, (longest - 1) // 2 + 1), np.float64)
    omega = np.atleast_1d(np.asarray(omega_rad_s, np.float64))
    if not (omega.size and np.all(np.diff(omega) > 0.0) and omega[0] > 0.0 and omega[-1] <= nyquist * (1 + 1e-9)):
        raise EstimationError(
            f"frequencies must increase between 0 and the Nyquist frequency {nyquist:.4g} rad/s, got "
            f"{omega.size} from {np.min(omega, initial=np.inf):.4g} to {np.max(omega, initial=-np.inf):.4g} rad/s"
        )
    return omega


def bridged(record: FlightRecord, names: Sequence[str], u: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the channels (n, d), samples that were not taken interpolated, and which were taken (n, d) as 0 and 1."""
    z, valid = np.hstack([u, y]), record.select(names).valid
    for i in range(z.shape[1]):
        took = valid[:, i]
        if took.any() and not took.all():
            z[~took, i] = np.interp(record.t_s[~took], record.t_s[took], z[took, i])
    return z, valid.astype(np.float64)


def _spectra(
    joined: list[tuple[FloatArray, FloatArray]], length: int, overlap: float, omega: FloatArray, dt_s: float, m: int
) -> _Spectra:
    """Return the summed cross spectra of all segments of ``length`` samples."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    hop = max(1, length - int(np.floor(overlap * length)))
    segments, counts = [], []
    for z, valid in joined:
        starts = window_starts(np.ones(len(z), bool), length)[::hop]
        kept = [z[s : s + length] for s in starts if np.all(valid[s : s + length].mean(axis=0) >= _TAKEN)]
        segments += [window[:, None] * (part - part.mean(axis=0)) for part in kept]
        counts.append(len(kept))
    averages = _independent(window, hop, counts)
    if averages <= m:
        raise EstimationError(
            f"a response from {m} inputs needs more than {m} independent segments, got {averages:.1f} of "
            f"{length * dt_s:g} s free of gaps (at least {100 * _TAKEN:.0f} % of the samples taken); shorten window_s, "
            "give more data, or decimate to the rate of the slowest sensor"
        )
    Z = np.stack(segments)  # (segments, n, d)
    t = np.arange(length) * dt_s
    S = np.empty((omega.size, Z.shape[2], Z.shape[2]), np.complex128)
    size = max(1, _CHUNK // length)
    for start in range(0, omega.size, size):
        turn = np.exp(-1j * np.outer(omega[start : start + size], t))
        F = np.einsum("kn,snd->skd", turn, Z, optimize=True)
        S[start : start + size] = np.einsum("ska,skb->kab", np.conj(F), F, optimize=True)
    energy = np.sum(window**2)
    # Equivalent noise bandwidth of the Hann window: 1.5 lines
    return _Spectra(S / (energy * len(segments)), averages, 1.5 * 2.0 * np.pi / (length * dt_s))


def _independent(window: FloatArray, hop: int, counts: list[int]) -> float:
    """Return the number of independent averages in overlapping windows: n / (1 + 2 sum (1 - k/n) r_k^2), by record."""
    total = 0.0
    energy = np.sum(window**2)
    for n in counts:
        if n == 0:
            continue
        lags = np.arange(1, min(n, (window.size - 1) // hop + 1))
        r = np.array([np.sum(window[k * hop :] * window[: window.size - k * hop]) / energy for k in lags])
        total += n / (1.0 + 2.0 * np.sum((1.0 - lags / n) * r**2))
    return total


def _conditioned(S: ComplexArray, m: int) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Return H (k, m), multiple coherence (k,) and partial coherences (k, m) from S (k, m + 1, m + 1), output last."""
    Suu, Suy, Syy = S[:, :m, :m], S[:, :m, m], S[:, m, m].real
    H = np.linalg.solve(Suu, Suy[:, :, None])[:, :, 0]
    explained = np.real(np.einsum("km,km->k", np.conj(Suy), H))
    power = np.where(Syy > 0.0, Syy, 1.0)
    multiple = np.clip(explained / power, 0.0, 1.0)
    # Freed of the other inputs, input j has the power 1 / (Suu^-1)_jj; it adds |H_j|^2 of it to the output.
    alone = 1.0 / np.real(np.einsum("kjj->kj", np.linalg.inv(Suu)))
    added = np.abs(H) ** 2 * alone
    rest = np.maximum(Syy - explained, 0.0)[:, None]
    partial = np.clip(added / np.where(added + rest > 0.0, added + rest, 1.0), 0.0, 1.0)
    return np.asarray(H, np.complex128), np.asarray(multiple, np.float64), np.asarray(partial, np.float64)


def random_error(partial_coherence: FloatArray, averages: FloatArray) -> FloatArray:
    """Return sqrt(1 - g^2) / (g sqrt(2 n_d)) (Bendat and Piersol, equation 9.90); at most 1e6 where g vanishes."""
    g = np.maximum(np.sqrt(partial_coherence), 1e-6)
    return np.asarray(np.sqrt(1.0 - np.minimum(g, 1.0) ** 2) / (g * np.sqrt(2.0 * averages)))


def _few_averages(free: float) -> float:
    """Return ``interval_factor`` for ``free`` averages less inputs, times what the fit took out of the noise."""
    free = max(free, 0.5)
    return interval_factor(2.0 * free) * float(np.sqrt((free + 1.0) / free))


def _combine(
    parts: list[list[_Spectra]],
    omega: FloatArray,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    scale: FloatArray,
    dt_s: float,
    lengths: list[int],
) -> FrequencyResponse:
    k, p, m = omega.size, len(outputs), len(inputs)
    H, partial, error = np.empty((k, p, m), np.complex128), np.empty((k, p, m)), np.empty((k, p, m))
    coherence, counts, widths = np.empty((k, p)), np.empty((k, p)), np.empty((k, p))
    among, worst = _among_inputs(parts[0][0].S[:, :m, :m])
    if worst < 1e-10:
        raise EstimationError(
            f"inputs {', '.join(inputs)} must move independently at all frequencies, but they are one signal at "
            f"{omega[int(np.argmax(among))]:.3g} rad/s; excite them apart or leave one out"
        )
    for i, own in enumerate(parts):
        errors = []
        for part in own:
            each = random_error(_conditioned(part.S, m)[2], np.full((k, 1), part.averages - (m - 1)))
            errors.append(np.maximum(each.mean(axis=1), 1e-12))
        weights = (np.min(errors, axis=0) / np.array(errors)) ** 4  # (windows, k)
        weights /= weights.sum(axis=0)
        S = np.einsum("wk,wkab->kab", weights, np.array([part.S for part in own]))
        H[:, i], coherence[:, i], partial[:, i] = _conditioned(S, m)
        counts[:, i] = weights.T @ [part.averages for part in own]
        widths[:, i] = weights.T @ [part.resolution for part in own]
        error[:, i] = random_error(partial[:, i], counts[:, [i]] - (m - 1))
    H *= scale[m:, None] / scale[:m]
    advice = _advice(outputs, inputs, coherence, among, omega, parts[0])
    return FrequencyResponse(
        omega_rad_s=omega,
        H=H,
        coherence=coherence,
        partial_coherence=partial,
        random_error=error,
        averages=counts.mean(axis=1) - (m - 1),
        resolution_rad_s=widths.mean(axis=1),
        inputs=inputs,
        outputs=outputs,
        dt_s=dt_s,
        method="composite" if len(lengths) > 1 else "windowed",
        diagnostics={
            "input_coherence": among,
            "interval_factor": _few_averages(float(counts.mean()) - m),
            "averages": {f"{n * dt_s:g}": part.averages for n, part in zip(lengths, parts[0], strict=True)},
        },
        advice=advice,
    )


def _among_inputs(Suu: ComplexArray) -> tuple[FloatArray, float]:
    """Return the largest multiple coherence (k,) of an input with the others, and the smallest share left alone."""
    if Suu.shape[1] == 1:
        return np.zeros(len(Suu)), 1.0
    power = np.real(np.einsum("kjj->kj", Suu))
    size = np.sqrt(np.where(power > 0.0, power, 1.0))
    values = np.linalg.eigvalsh(Suu / (size[:, :, None] * size[:, None, :]))[:, 0]
    if np.min(values) < 1e-10:
        return 1.0 - values, float(np.min(values))
    alone = 1.0 / np.real(np.einsum("kjj->kj", np.linalg.inv(Suu)))
    return np.asarray(1.0 - np.min(alone / power, axis=1)), 1.0


def _advice(
    outputs: tuple[str, ...],
    inputs: tuple[str, ...],
    coherence: FloatArray,
    among: FloatArray,
    omega: FloatArray,
    parts: list[_Spectra],
) -> tuple[Advice, ...]:
    out = AdviceList()
    m = len(inputs)
    for i, name in enumerate(outputs):
        low = coherence[:, i] < COHERENT
        if low.any():
            out.doubt(
                "low_coherence",
                f"{name}: coherence lies below {COHERENT:g} at {100 * low.mean():.0f} % of the frequencies "
                f"({omega[low][0]:.3g} to {omega[low][-1]:.3g} rad/s): noise, an input that is not named, or "
                "nonlinearity; use the response elsewhere, or excite that band",
            )
    if (among > _CORRELATED).any():
        out.doubt(
            "correlated_inputs",
            f"inputs {', '.join(inputs)} are correlated (coherence above {_CORRELATED:g} at "
            f"{100 * np.mean(among > _CORRELATED):.0f} % of the frequencies): their responses are hard to separate; "
            "excite them one after the other",
        )
    few = min(part.averages for part in parts)
    if few < 2.0 * m + 3.0:
        out.doubt(
            "few_data",
            f"the spectra are means of only {few:.1f} independent averages: coherence is too high by up to about "
            f"{min(1.0, m / few):.2f} and the random error too small; shorten the window or give more data",
        )
    return (*out, *approximate("frequency response, windowed"))
