"""The air of a flight: steady wind, Dryden turbulence and a 1-cosine gust.

Turbulence is generated here and not by JSBSim: JSBSim's own (type 3) ties its strength to a wind at 20 ft or to a
severity, so that no rms can be given. Only the translation of the air acts: the rotation that a gust field has across
the span (p_g, q_g, r_g of the specification) is left out; it matters where the wavelength comes down to the size of the
aircraft.

JSBSim forms alphadot from the acceleration over the ground: in a gust the air's share is missing, in a steady head wind
W it is off by q W / V. Coefficients of alphadot feel that. Elevator pulses measured it: in a head wind of 8 m/s the
Taurus, which has such a coefficient, departs from its motion in still air at 12 m/s by 2 % (rms over standard
deviation); an aircraft without one departs by 4e-5.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from testbench.core.constants import FT_M
from testbench.core.errors import LimitError, nearest
from testbench.core.record import FloatArray
from testbench.core.scenario.air import LOWEST_M, AirSpec
from testbench.flight.condition import FlightCondition

AXES = ("north", "east", "down")
ONSET_S = 1.0  # turbulence rises from the trim's calm over this time, as a half cosine; a jump would ring every mode
_LOW_FT, _HIGH_FT, _HIGH_LENGTH_FT = 1000.0, 2000.0, 1750.0


@dataclass(frozen=True)
class Gust:
    """One 1-cosine gust, w(t) = amplitude / 2 (1 - cos(2 pi (t - start) / duration)) while it lasts, else 0.

    Args:
        axis: "north" (along the heading at trim), "east" or "down": where positive air moves to.
        amplitude_m_s: peak, m/s; a rising gust has a negative amplitude along "down".
        start_s: on the clock of the inputs, which starts after the settling time.
        duration_s: from calm to calm.
        length_m: instead of ``duration_s``, the distance flown at the trim's airspeed.

    Raises:
        LimitError: a value breaks its law.
    """

    axis: Literal["north", "east", "down"]
    amplitude_m_s: float
    start_s: float = 0.0
    duration_s: float | None = None
    length_m: float | None = None

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise LimitError(f"a gust must blow along north, east or down, got '{self.axis}'{nearest(self.axis, AXES)}")
        if not math.isfinite(self.amplitude_m_s):
            raise LimitError(f"the amplitude of a gust must be finite, got {self.amplitude_m_s:g} m/s")
        if not 0.0 <= self.start_s < math.inf:
            raise LimitError(f"0 <= start_s must hold for a gust, got {self.start_s:g}")
        if (self.duration_s is None) == (self.length_m is None):
            got = "neither" if self.duration_s is None else "both"
            raise LimitError(f"a gust takes either duration_s or length_m, got {got}")
        size = self.duration_s if self.duration_s is not None else self.length_m
        if size is None or not 0.0 < size < math.inf:
            raise LimitError(f"duration_s > 0 or length_m > 0 must hold for a gust, got {size:g}")

    def lasts_s(self, V_m_s: float) -> float:
        """Return the duration, s, at airspeed ``V_m_s``."""
        return self.duration_s if self.duration_s is not None else float(self.length_m or 0.0) / V_m_s

    def velocity(self, t_s: FloatArray, V_m_s: float) -> FloatArray:
        """Return the velocity of the air along the axis, m/s, at times ``t_s`` (n,) on the clock of the inputs."""
        phase = (np.asarray(t_s, float) - self.start_s) / self.lasts_s(V_m_s)
        shape = 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
        return np.where((phase > 0.0) & (phase < 1.0), self.amplitude_m_s * shape, 0.0)


@dataclass(frozen=True)
class Air:
    """Motion of the air over the ground: where positive, it moves north, east or down. Heading is north at trim.

    Args:
        wind_north_m_s, wind_east_m_s, wind_down_m_s: steady wind; a positive north component is a tail wind.
        turbulence_rms_m_s: rms of u, v, w: along the heading at trim, to the right of it, and down; see
            ``turbulence_rms`` for the proportion that the specification gives them.
        height_m: above ground, sets the scale lengths; the altitude of the flight condition if not given.
        gust: one discrete gust.
        seed: of the turbulence.

    Raises:
        LimitError: a value breaks its law.
    """

    wind_north_m_s: float = 0.0
    wind_east_m_s: float = 0.0
    wind_down_m_s: float = 0.0
    turbulence_rms_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    height_m: float | None = None
    gust: Gust | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in self.wind_m_s):
            raise LimitError(f"every component of a wind must be finite, got {self.wind_m_s} m/s")
        object.__setattr__(self, "turbulence_rms_m_s", tuple(float(s) for s in self.turbulence_rms_m_s))
        rms = self.turbulence_rms_m_s
        if len(rms) != 3 or not all(0.0 <= s < math.inf for s in rms):
            raise LimitError(f"turbulence_rms_m_s must be three finite values >= 0 (u, v, w), got {rms}")
        if self.height_m is not None:
            scale_lengths(self.height_m)
        if self.seed < 0:
            raise LimitError(f"seed >= 0 must hold, got {self.seed}")

    @property
    def wind_m_s(self) -> tuple[float, float, float]:
        """The steady wind: north, east, down, m/s."""
        return self.wind_north_m_s, self.wind_east_m_s, self.wind_down_m_s

    @property
    def is_steady(self) -> bool:
        """Whether there is neither turbulence nor a gust."""
        return not any(self.turbulence_rms_m_s) and self.gust is None

    def velocities(self, n: int, rate_hz: float, condition: FlightCondition, settle_s: float = 0.0) -> FloatArray:
        """Return the velocity of the air (n, 3), north, east, down, m/s, every 1/``rate_hz`` s from the trim at t = 0.

        The turbulence is stationary after ``ONSET_S``, and the same whatever the length of the flight. The generator
        is ``SeedSequence([seed, crc32("turbulence")])``.

        Raises:
            LimitError: the height is below the law of the scale lengths.
        """
        t = np.arange(n) / rate_hz
        out = np.tile(np.array(self.wind_m_s, float), (n, 1))
        if any(self.turbulence_rms_m_s):
            lengths = scale_lengths(self.height_m if self.height_m is not None else condition.h_m)
            rng = np.random.default_rng(np.random.SeedSequence([self.seed, zlib.crc32(b"turbulence")]))
            onset = 0.5 * (1.0 - np.cos(np.pi * np.minimum(t / ONSET_S, 1.0)))
            out += onset[:, None] * turbulence(n, rate_hz, condition.V_m_s, self.turbulence_rms_m_s, lengths, rng)
        if self.gust is not None:
            out[:, AXES.index(self.gust.axis)] += self.gust.velocity(t - settle_s, condition.V_m_s)
        return out

    def as_provenance(self) -> dict[str, Any]:
        """Return the air as JSON values."""
        return asdict(self)


def scale_lengths(height_m: float) -> tuple[float, float, float]:
    """Return the scale lengths (L_u, L_v, L_w) of Dryden turbulence, m, at a height above ground.

    MIL-F-8785C, 3.7.3: below 1000 ft L_w = h and L_u = L_v = h / (0.177 + 0.000823 h)^1.2, h in feet; above 2000 ft
    all 1750 ft. Between them the specification is silent and the lengths are interpolated linearly. (MIL-HDBK-1797
    writes L_v and L_w half as long, and twice the length in its spectra: the same turbulence.)

    Raises:
        LimitError: the height is below 10 ft, where the law begins.
    """
    if not LOWEST_M * (1.0 - 1e-9) <= height_m < math.inf:
        raise LimitError(
            f"height_m >= {LOWEST_M:g} (10 ft) must hold for the scale lengths of turbulence, got {height_m:g}; "
            "give the height above ground"
        )
    h = height_m / FT_M
    if h < _LOW_FT:
        horizontal = h / (0.177 + 0.000823 * h) ** 1.2 * FT_M
        return horizontal, horizontal, height_m
    share = min((h - _LOW_FT) / (_HIGH_FT - _LOW_FT), 1.0)
    length = (_LOW_FT + share * (_HIGH_LENGTH_FT - _LOW_FT)) * FT_M
    return length, length, length


def turbulence_rms(vertical_m_s: float, height_m: float) -> tuple[float, float, float]:
    """Return the rms (u, v, w), m/s, that belong to the vertical one at a height above ground.

    MIL-F-8785C, 3.7.3.2: sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4 below 1000 ft, h in feet; isotropic
    above.

    Raises:
        LimitError: the height is below 10 ft, where the law begins.
    """
    scale_lengths(height_m)
    h = min(height_m / FT_M, _LOW_FT)
    horizontal = vertical_m_s / (0.177 + 0.000823 * h) ** 0.4
    return horizontal, horizontal, vertical_m_s


def air_of(spec: AirSpec, h_m: float, seed: int) -> Air | None:
    """Return the air that a scenario's table asks for, or None where it is still.

    Args:
        spec: the table ``[air]``.
        h_m: height of the flight, at which turbulence is taken unless the table gives another.
        seed: of the turbulence.
    """
    if spec == AirSpec():
        return None
    height = h_m if spec.height_m is None else spec.height_m
    rms = turbulence_rms(spec.turbulence_rms_m_s, height) if spec.turbulence_rms_m_s else (0.0, 0.0, 0.0)
    gust = Gust(**spec.gust.model_dump()) if spec.gust else None
    return Air(spec.wind_north_m_s, spec.wind_east_m_s, spec.wind_down_m_s, rms, spec.height_m, gust, seed)


def turbulence(
    n: int,
    rate_hz: float,
    V_m_s: float,
    rms_m_s: tuple[float, float, float],
    lengths_m: tuple[float, float, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Return stationary Dryden turbulence (n, 3), m/s: u, v, w, sampled at ``rate_hz`` when flown through at ``V_m_s``.

    The forming filters of MIL-F-8785C's spectra, driven by white noise of unit intensity, with a = V / L:

        H_u = rms sqrt(2 a) / (s + a),   H_v = H_w = rms sqrt(a) (a + sqrt(3) s) / (s + a)^2.

    The samples are those of the continuous process, whatever the rate: state transition and covariance of the driving
    noise over one interval are exact (Van Loan 1978 gives the integral; here in closed form), and the first state is
    drawn from the stationary distribution. The generator is drawn from interval by interval, so that a longer series
    begins with the shorter one.
    """
    normal = rng.standard_normal((n, 5))
    u = _first_order(normal[:, :1], V_m_s / lengths_m[0] / rate_hz)
    v = _second_order(normal[:, 1:3], V_m_s / lengths_m[1] / rate_hz)
    w = _second_order(normal[:, 3:], V_m_s / lengths_m[2] / rate_hz)
    return np.column_stack([u, v, w]) * np.array(rms_m_s)


def _first_order(normal: FloatArray, d: float) -> FloatArray:
    """Return 1/(s + 1) driven by noise that makes its variance 1, sampled every ``d`` of its time constant."""
    return _recursion(math.exp(-d), np.concatenate([normal[:1, 0], math.sqrt(-math.expm1(-2.0 * d)) * normal[1:, 0]]))


def _second_order(normal: FloatArray, d: float) -> FloatArray:
    """Return (1 + sqrt(3) s)/(s + 1)^2 driven by white noise of unit intensity; its variance is 1.

    Time is in units of L / V. With x1' = -x1 + n and x2' = -x2 + x1 the output is sqrt(3) x1 + (1 - sqrt(3)) x2. Over
    an interval d the noise adds covariances int_0^d (1, s, s^2) exp(-2 s) ds = k! P(k + 1, 2 d) / 2^(k + 1), where P is
    the regularised incomplete gamma function: the closed form loses all digits at small d.
    """
    from scipy.special import gammainc

    q11, q12, q22 = (math.factorial(k) * gammainc(k + 1, 2.0 * d) / 2.0 ** (k + 1) for k in range(3))
    # Cholesky factors of the stationary covariance [[1/2, 1/4], [1/4, 1/4]] and of the one over an interval.
    first = np.linalg.cholesky(np.array([[0.5, 0.25], [0.25, 0.25]])) @ normal[0]
    l11 = math.sqrt(q11)
    l21 = q12 / l11
    l22 = math.sqrt(q22 - l21**2)
    hold = math.exp(-d)
    x1 = _recursion(hold, np.concatenate([first[:1], l11 * normal[1:, 0]]))
    fed = hold * d * x1[:-1] + l21 * normal[1:, 0] + l22 * normal[1:, 1]
    x2 = _recursion(hold, np.concatenate([first[1:], fed]))
    return math.sqrt(3.0) * x1 + (1.0 - math.sqrt(3.0)) * x2


def _recursion(hold: float, driven: FloatArray) -> FloatArray:
    """Return x with x_0 = driven_0 and x_k+1 = hold x_k + driven_k+1."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], [1.0, -hold], driven))
