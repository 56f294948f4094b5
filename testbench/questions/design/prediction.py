"""What the linearised aircraft does in response to an input, for the limits: channels, deflections and their rates."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import expm

from testbench.core.errors import LimitError
from testbench.core.record import FloatArray
from testbench.flight.linear_model import LinearModel
from testbench.questions.design.limits import Limits

_STILL = 1e-150  # a channel that does not move meets no limit


@dataclass(frozen=True, eq=False)
class Prediction:
    """Largest admissible amplitudes by superposition of the responses to one pulse.

    Args:
        model: linearised aircraft with servos; commands drive it.
        controls: (m,) controls that move.
        limits: the limits of the scenario.
        trim: channel -> value at trim.
        dt_s: sample time of the inputs, s.
        samples: number of them.

    The limited channels are those of the limits, the deflections that the servos reach, their rates, and the commands
    themselves.
    """

    model: LinearModel
    controls: tuple[str, ...]
    limits: Limits
    trim: Mapping[str, float]
    dt_s: float
    samples: int
    names: tuple[str, ...] = field(init=False)
    low: FloatArray = field(init=False)
    high: FloatArray = field(init=False)
    _transforms: NDArray[np.complex128] = field(init=False, repr=False)
    _size: int = field(init=False, repr=False)
    _last: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        bands = self.limits.bands(dict(self.trim))
        for name in self.controls:
            bands[name] = self.limits.control_band(name)
        names = list(bands)
        low = [bands[n][0] - self.trim.get(n, 0.0) for n in names]
        high = [bands[n][1] - self.trim.get(n, 0.0) for n in names]
        rows = [self.model.outputs.index(n) for n in names]
        C, D = self.model.C[rows], self.model.D[rows]
        for name in self.controls:
            if name in self.limits.rate and f"servo_{name}" in self.model.states:  # of the servo: its state derivative
                row = self.model.states.index(f"servo_{name}")
                C, D = np.vstack([C, self.model.A[row]]), np.vstack([D, self.model.B[row]])
                names.append(f"rate of {name}")
                low.append(-self.limits.rate[name])
                high.append(self.limits.rate[name])
        for name in self.controls:
            names.append(f"command of {name}")
            low.append(bands[name][0] - self.trim.get(name, 0.0))
            high.append(bands[name][1] - self.trim.get(name, 0.0))
        if not all(a < 0.0 < b for a, b in zip(low, high, strict=True)):
            at = next(n for n, a, b in zip(names, low, high, strict=True) if not a < 0.0 < b)
            raise LimitError(f"trim leaves no room inside the limit on {at}; widen it or choose another condition")
        size = next_fast_len(2 * self.samples, real=True)
        pulses = self._pulses(C, D)
        for name, value in (
            ("names", tuple(names)),
            ("low", np.array(low)),
            ("high", np.array(high)),
            ("_size", size),
            ("_last", self.samples),
            ("_transforms", np.stack([rfft(p, size, axis=0) for p in pulses])),
        ):
            object.__setattr__(self, name, value)

    def _pulses(self, C: FloatArray, D: FloatArray) -> list[FloatArray]:
        """Return per control the response (samples, c) to one held sample of unit command."""
        n = len(self.model.states)
        out = []
        for name in self.controls:
            column = self.model.inputs.index(f"{name}_cmd" if f"{name}_cmd" in self.model.inputs else name)
            block = np.zeros((n + 1, n + 1))
            block[:n, :n], block[:n, n] = self.model.A * self.dt_s, self.model.B[:, column] * self.dt_s
            step = expm(block)
            x = step[:n, n]
            y = np.empty((self.samples, len(C)))
            y[0] = D[:, column]
            for k in range(1, self.samples):
                y[k] = C @ x
                x = step[:n, :n] @ x
            out.append(y)
        return out

    def response(self, u: FloatArray) -> FloatArray:
        """Return the deviations (samples, c) of the limited channels, in the order of ``names``, for (samples, m)."""
        U = rfft(u, self._size, axis=0)
        Y = np.einsum("fm,mfc->fc", U, self._transforms)
        return np.hstack([irfft(Y, self._size, axis=0)[: self._last], u[: self._last]])

    def until(self, samples: int) -> Prediction:
        """Return the prediction of the first samples only; inputs keep their length."""
        out = copy(self)
        object.__setattr__(out, "_last", samples)
        return out

    def largest_factor(self, u: FloatArray) -> tuple[float, str]:
        """Return the largest factor on an input (samples, m) that keeps all limits, and the limit that it reaches."""
        return self.factor_of(self.response(u))

    def factor_of(self, deviation: FloatArray) -> tuple[float, str]:
        """Return the same for deviations (samples, c) that are predicted already."""
        highest, lowest = np.maximum(deviation.max(axis=0), _STILL), np.minimum(deviation.min(axis=0), -_STILL)
        factors = np.minimum(self.high / highest, self.low / lowest)
        tightest = int(np.argmin(factors))
        return float(factors[tightest]), self.names[tightest]
