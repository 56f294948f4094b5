"""The result of operational modal analysis: modes with errors, the poles of every order, and doubts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from testbench.core.advice import Advice, Advised, as_json
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.operational.stabilise import OrderView

METHOD = "ssi_cov"


@dataclass(frozen=True, eq=False)
class OperationalMode:
    """One mode that was found at many orders.

    Attributes:
        pole: s = -zeta wn + j wn sqrt(1 - zeta^2), rad/s, the mean over ``orders`` (see stabilise.py).
        frequency_std_hz, damping_std: standard deviations of natural frequency and damping ratio.
        correlation: of the two.
        scaled_shape: (r,) of the outputs over their rms, of unit length, the largest element real and positive.
        shape: (r,) the same in SI units of the channels, 1 at the output where ``scaled_shape`` is largest.
        orders: at which it was stable.
        remarks: what is doubtful about it.
    """

    pole: complex
    frequency_std_hz: float
    damping_std: float
    correlation: float
    shape: ComplexArray
    scaled_shape: ComplexArray
    orders: tuple[int, ...]
    remarks: tuple[Advice, ...] = ()

    @property
    def frequency_hz(self) -> float:
        """Natural frequency |s| / 2 pi."""
        return abs(self.pole) / (2.0 * np.pi)

    @property
    def damping(self) -> float:
        """Damping ratio -Re(s) / |s|."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, eq=False)
class OperationalModes(Advised):
    """Modes of outputs alone, identified without any input.

    Attributes:
        channels: (r,) outputs, in the order of the mode shapes.
        scale: (r,) rms of the outputs, which were divided by it.
        dt_s: sample time that the covariances were taken at, s.
        duration_s: of all records together.
        blocks: of data that the errors were computed from.
        modes: in the order of their frequencies.
        views: poles of every order with the criteria that they meet: the stabilisation diagram.
        singular_values: of the block Hankel matrix.
        spectrum: (k, 2) frequency in Hz, and the mean spectral density of the scaled outputs in 1/Hz.
        settings: as JSON values.
        advice: what is wrong or doubtful and what to do about it; ``status`` follows from it.

    An interval of 95 % is the value plus and minus ``quantile`` standard deviations.
    """

    channels: tuple[str, ...]
    scale: FloatArray
    dt_s: float
    duration_s: float
    blocks: int
    modes: tuple[OperationalMode, ...]
    views: tuple[OrderView, ...]
    singular_values: FloatArray
    spectrum: FloatArray
    settings: Mapping[str, Any] = field(default_factory=dict)
    advice: tuple[str, ...] = ()
    method: str = METHOD

    @property
    def quantile(self) -> float:
        """0.975 quantile of Student's t with one degree of freedom less than there are blocks."""
        from scipy.special import stdtrit

        return float(stdtrit(self.blocks - 1, 0.975))

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON values; complex numbers as [real, imaginary]."""
        return {
            "method": self.method,
            "channels": list(self.channels),
            "scale": self.scale.tolist(),
            "dt_s": self.dt_s,
            "duration_s": self.duration_s,
            "blocks": self.blocks,
            "quantile": self.quantile,
            "settings": dict(self.settings),
            "modes": [
                {
                    "frequency_hz": m.frequency_hz,
                    "frequency_std_hz": m.frequency_std_hz,
                    "damping": m.damping,
                    "damping_std": m.damping_std,
                    "correlation": m.correlation,
                    "pole_rad_s": [m.pole.real, m.pole.imag],
                    "shape": [[float(c.real), float(c.imag)] for c in m.shape],
                    "orders": list(m.orders),
                    "remarks": list(m.remarks),
                }
                for m in self.modes
            ],
            "singular_values": self.singular_values.tolist(),
            "status": self.status,
            "advice": as_json(self.advice),
        }
