"""The result of operational modal analysis: modes with errors, the poles of every order, and doubts.

Doubts about modes that were found from outputs alone, in words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from testbench.core.advice import Advice, Advised, as_json, doubt, note
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.operational.realise import mac
from testbench.estimators.operational.stabilise import OrderView

ASSUMPTION = (
    "the method assumes that the air is white noise and excites every mode alike. Turbulence is coloured: poles of its "
    "spectrum and of the rigid motion can come out as modes, and the outputs alone cannot tell them apart"
)
"""The assumptions of every result; reports state them."""
_HEAVY = 0.2  # damping ratio from which on a pole is rarely a structural mode alone
_FEW_BLOCKS = 30
_WANDER = 0.03  # of the airspeed: 6 % in dynamic pressure
_CLOSE = 0.1  # relative distance of two frequencies, within which
_SAME_SHAPE = 0.9  # a larger MAC of their shapes makes two modes doubtful
_LINE = 0.003  # damping ratios below this are rarely those of a structure in flight (estimate)


def remarks(mode: OperationalMode) -> tuple[Advice, ...]:
    """Return what is doubtful about one mode."""
    out = []
    if mode.damping > _HEAVY:
        out.append(
            doubt("heavily_damped", "heavily damped: rigid motion or the shaping of the excitation may be in it")
        )
    if mode.damping < _LINE:
        out.append(doubt("hardly_damped", "hardly any damping: a rotating part gives such a line"))
    if _complexity(mode) > 0.5:
        out.append(
            doubt("complex_shape", "shape far from real: two modes close to each other, or strong damping by the air")
        )
    return tuple(out)


def advise(modes: Sequence[OperationalMode], blocks: int, short: int, wander: float) -> tuple[Advice, ...]:
    """Return what is doubtful about a result, and what to do about it.

    Args:
        modes: found.
        blocks: of data that the errors come from.
        short: number of records that were shorter than the lags.
        wander: standard deviation of the airspeed over its mean, 0 if not known.
    """
    out = [said.about(f"mode at {m.frequency_hz:.3g} Hz") for m in modes for said in m.remarks]
    for one, other in combinations(modes, 2):
        close = abs(one.frequency_hz - other.frequency_hz) < _CLOSE * other.frequency_hz
        if close and mac(one.scaled_shape, other.scaled_shape) > _SAME_SHAPE:
            out.append(
                doubt(
                    "same_shape",
                    f"modes at {one.frequency_hz:.4g} and {other.frequency_hz:.4g} Hz have the same shape: they are "
                    "one mode split in two (it may have changed during the flight), or two that these sensors cannot "
                    "tell apart; add sensors",
                )
            )
    if blocks < _FEW_BLOCKS:
        out.append(
            doubt("few_data", f"the errors come from only {blocks} blocks of data and are rough; give more data")
        )
    if wander > _WANDER:
        out.append(
            doubt(
                "airspeed_wandered",
                f"airspeed wandered by {100.0 * wander:.1f} % (one standard deviation): modes that change with "
                "airspeed are means over it, and their intervals count chance alone; fly in calmer air or give records "
                "of one speed",
            )
        )
    if short:
        out.append(
            note(
                "records_left_out",
                f"records shorter than the lags did not count: {short}; raise the lowest frequency of the band",
            )
        )
    return tuple(out)


def _complexity(mode: OperationalMode) -> float:
    """Return 1 - |sum of c^2| / sum of |c|^2 of the shape: 0 if all outputs move in phase or against it, 1 at most."""
    c = mode.scaled_shape
    return float(1.0 - abs(np.sum(c**2)) / np.sum(np.abs(c) ** 2))


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
