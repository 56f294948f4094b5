"""FrequencyResponse: a measured frequency response with its coherences and its random error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advised, as_json
from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray
from testbench.core.words import array_found
from testbench.estimators.model import ComplexArray

COHERENT = 0.6  # the bound of flight test below which a response is not believed (Tischler and Remple, section 7.5)
USABLE = 0.2  # and the total error up to which it is used: 1.7 dB and 11 deg (custom)
_OPTIONAL = ("window_bias", "window_allowance", "noise_variance", "distortion_variance")
_COMPLEX = ("H", "window_bias")


@dataclass(frozen=True, eq=False, kw_only=True)
class FrequencyResponse(Advised):
    """H(jw) from inputs to outputs at some frequencies, and how well each value is known.

    Attributes:
        omega_rad_s: (k,) frequencies, increasing.
        H: (k, p, m) complex responses, SI unit per SI unit.
        coherence: (k, p) multiple coherence: share of each output's power that all inputs explain together.
        partial_coherence: (k, p, m) coherence of output and input, freed of what the other inputs explain of both.
        random_error: (k, p, m) standard deviation of |H| over |H|, which is that of the phase in rad.
        averages: (k,) number of independent averages (periods, for multisines).
        resolution_rad_s: (k,) width that one value stands for: values closer than this are not independent.
        window_bias: (k, p, m) complex, computed: H is 1 + window_bias times what it would be without windows; None
            where nothing computed it (see :mod:`testbench.estimators.frequency.window_bias`).
        window_allowance: (k, p, m) size of that bias with what the computation leaves open, over |H|; None else.
        delay_s: (p, m) pure delays that were taken out before windowing and put back, s; None where none was.
        noise_variance: (k, p, m) E|dH|^2 from noise, where it was measured apart; None else.
        distortion_variance: (k, p, m) E|dH|^2 from nonlinear distortion, where it was measured apart; None else.
        inputs: (m,) names.
        outputs: (p,) names.
        dt_s: sample time of the records, s.
        method: the function that made it.
        diagnostics: what it saw on the way.
        advice: what is wrong or doubtful and what to do about it; ``status`` follows from it.
    """

    omega_rad_s: FloatArray
    H: ComplexArray
    coherence: FloatArray
    partial_coherence: FloatArray
    random_error: FloatArray
    averages: FloatArray
    resolution_rad_s: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt_s: float
    method: str
    window_bias: ComplexArray | None = None
    window_allowance: FloatArray | None = None
    delay_s: FloatArray | None = None
    noise_variance: FloatArray | None = None
    distortion_variance: FloatArray | None = None
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    advice: tuple[str, ...] = ()

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

    @property
    def variance(self) -> FloatArray:
        """E|dH|^2, shape (k, p, m): twice the square of the random error times |H|."""
        return np.asarray(2.0 * (self.random_error * np.abs(self.H)) ** 2)

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
        for name in ("window_allowance", "delay_s", "noise_variance", "distortion_variance"):
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
