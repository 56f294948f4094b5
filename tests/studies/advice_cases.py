"""Flights of drawn aircraft with one thing wrong with each, for the study of advice, and which codes of advice name it.

Every seed draws mass, geometry, speed, sample rate, manoeuvre and noise of another aircraft. Its short period,
dx/dt = A x + B de with x = (alpha, q), is integrated here: what the flights say of an estimator owes nothing to the
simulation of the testbench. A gyro of another scale is no case: alpha and q alone do not show it, since Z_q takes its
place, and instruments_study.py has it with the other instruments.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from testbench.core.constants import G0_M_S2
from testbench.core.record import FlightRecord, FloatArray

INPUTS, OUTPUTS = ("de",), ("alpha", "q")
LONG, SHORT = 900, 30  # samples
_SUBSTEPS = 8
_SLOW = 3  # samples to one of a slow record
_DENSITY = 1.1  # kg/m3


@dataclass(frozen=True)
class Case:
    """What is wrong with a flight, and which codes of advice name it.

    Attributes:
        words: what is wrong.
        names: codes that name the cause. Of the clean flight and of too many states, what noise does to methods that it
            biases; a missing state may be called a lag.
        order: number of states that is asked for; the truth has two.
        loop: surface (rad) that a control law adds, of what its sensors read, (alpha, q, integral of q), all in radians
            per radian of response; gains are in units of what moves alpha by itself.
        gust: rms angle of gusts over that of the motion.
    """

    words: str
    names: tuple[str, ...] = ()
    order: int = 2
    loop: tuple[float, float, float] | None = None
    gust: float = 0.0


_LATE = ("delay", "lag")
CASES = {
    "clean": Case("white measurement noise", ("far_from_best", "noisy_terms")),
    "damper": Case("rate feedback, gusts", ("closed_loop",), loop=(0.0, 0.35, 0.0), gust=0.4),
    "stability": Case("alpha and rate feedback, gusts", ("closed_loop",), loop=(0.5, 0.35, 0.0), gust=0.4),
    "hold": Case("rate and attitude feedback, gusts", ("closed_loop",), loop=(0.0, 0.35, 0.3), gust=0.4),
    "gusts": Case("gusts, inertial alpha", ("coloured_residuals", "far_from_best"), gust=0.15),
    "vane": Case("gusts, alpha of a vane", ("coloured_residuals", "far_from_best"), gust=0.15),
    "colour": Case("noise of the sensors coloured over a period", ("coloured_residuals",)),
    "delay": Case("the surface follows late", _LATE),
    "servo": Case("a servo lies behind the recorded command", (*_LATE, "order_too_low")),
    "rate": Case("a servo that is limited in rate lies behind it", (*_LATE, "rate_limit", "bend")),
    "clock": Case("the clock of the rate gyro is late", (*_LATE, "order_too_low", "coloured_residuals")),
    "held": Case("the input is held, and taken for straight lines between slow samples", ("held", *_LATE)),
    "drift": Case("biases and drifts of the sensors", ("drift",)),
    "stall": Case("lift and stability fall beyond half of the motion", ("bend",)),
    "order4": Case(
        "two states too many",
        ("order_too_high", "not_told_apart", "weak_state", "no_continuous_counterpart", "far_from_best"),
        order=4,
    ),
    "order1": Case("one state too few", ("order_too_low", "lag"), order=1),
    "elastic": Case("an elastic mode moves gyro and vane", ("elastic_mode",)),
    "short": Case("thirty samples", ("few_data",)),
}


@dataclass(frozen=True)
class Drawn:
    """An aircraft of some mass and geometry at some speed: derivatives of its short period, and rate of its log."""

    seed: int

    @cached_property
    def rng(self) -> np.random.Generator:
        """What draws the rest of its flight."""
        return np.random.default_rng([self.seed, 59])

    @property
    def truth(self) -> dict[str, float]:
        """Derivatives, 1/s and 1/s2: of strip theory, with a static margin of 5 to 25 % of the chord."""
        return self._flying[1]

    @property
    def V_m_s(self) -> float:
        """Airspeed, m/s."""
        return self._flying[0]

    @cached_property
    def _flying(self) -> tuple[float, dict[str, float]]:
        """Airspeed and derivatives."""
        r = np.random.default_rng([self.seed, 60])
        mass = float(np.exp(r.uniform(np.log(1.0), np.log(2e4))))
        area = mass ** r.uniform(0.58, 0.68) / r.uniform(3.0, 7.0)  # m2: 2 kg 0.35, 1 t 17, 20 t 120
        aspect, lift = r.uniform(5.0, 14.0), r.uniform(0.3, 0.7)
        chord, V = float(np.sqrt(area / aspect)), float(np.sqrt(2.0 * mass * G0_M_S2 / (_DENSITY * area * lift)))
        slope, margin = 2.0 * np.pi * aspect / (aspect + 2.4), r.uniform(0.05, 0.25)
        pressure, iyy = 0.5 * _DENSITY * V**2 * area, mass * (r.uniform(1.0, 1.5) * chord) ** 2
        per_lift, per_moment = pressure / (mass * V), pressure * chord / iyy
        return V, {
            "Z_alpha": -per_lift * slope,
            "Z_de": -per_lift * r.uniform(0.2, 0.5),
            "M_alpha": -per_moment * slope * margin,
            "M_q": -per_moment * r.uniform(8.0, 20.0) * chord / (2.0 * V),
            "M_de": -per_moment * r.uniform(0.7, 1.5),
        }

    @cached_property
    def matrices(self) -> tuple[FloatArray, FloatArray]:
        """A (2, 2) and b (2,)."""
        t = self.truth
        return np.array([[t["Z_alpha"], 1.0], [t["M_alpha"], t["M_q"]]]), np.array([t["Z_de"], t["M_de"]])

    @property
    def wn(self) -> float:
        """Natural frequency, rad/s."""
        return float(np.sqrt(np.linalg.det(self.matrices[0])))

    @property
    def zeta(self) -> float:
        """Damping ratio."""
        return float(-np.trace(self.matrices[0]) / 2.0 / self.wn)

    @cached_property
    def elastic(self) -> tuple[float, float]:
        """Natural frequency, rad/s, and damping ratio of an elastic mode, two to eight times as fast."""
        r = np.random.default_rng([self.seed, 64])
        return self.wn * float(np.exp(r.uniform(np.log(2.0), np.log(8.0)))), float(r.uniform(0.01, 0.08))

    @cached_property
    def dt(self) -> float:
        """Step of its log, s: the nearest that loggers have to 40 to 100 samples in a radian over twelve periods."""
        usual = 1.0 / np.array([10.0, 12.5, 20.0, 25.0, 40.0, 50.0, 100.0, 200.0])
        wanted = np.random.default_rng([self.seed, 61]).uniform(0.07, 0.12) / self.wn
        return float(usual[np.argmin(np.abs(np.log(usual / wanted)))])

    def inputs(self, samples: int) -> FloatArray:
        """Return 3-2-1-1 inputs, one after the other (samples,), rad, that move alpha by some 3 deg."""
        r = np.random.default_rng([self.seed, 62])
        step = max(2, round(r.uniform(0.8, 1.3) * 1.05 / self.wn / self.dt))
        A, b = self.matrices
        size = r.uniform(0.03, 0.06) / abs(np.linalg.solve(A, b)[0])
        u, k = np.zeros(samples), 25
        while k < samples:
            sign = 1.0
            for n in (3, 2, 1, 1):
                u[k : k + n * step] = size * sign
                sign, k = -sign, k + n * step
            k += 12 * step
        return u


def fly(case: str, seed: int, again: bool = False) -> FlightRecord:
    """Return the measured flight (de, alpha, q) of a case.

    Args:
        case: of :data:`CASES`.
        seed: draws the aircraft and all else.
        again: another flight of that aircraft.
    """
    aircraft, own = Drawn(seed), CASES[case]
    rng = np.random.default_rng([seed, 63 + again])
    dt, slow = aircraft.dt, 1.0 / aircraft.wn
    u = aircraft.inputs(LONG)
    if case == "short":  # through the first 3-2-1-1
        every, begin = max(1, round(0.25 * slow / dt)), int(np.flatnonzero(u)[0])
        u, dt = u[begin - 4 : begin - 4 + SHORT * every : every], every * dt
    if case == "held":
        u, dt = u[::_SLOW], _SLOW * dt
    fine = np.repeat(u, _SUBSTEPS)  # as it is held from sample to sample
    h = dt / _SUBSTEPS
    if case == "delay":
        fine = np.concatenate([np.zeros(k := round(0.25 * slow / h)), fine[:-k]])
    if case == "servo":
        a = float(np.exp(-h / (0.3 * slow)))
        fine = lfilter([0.0, 1.0 - a], [1.0, -a], fine)
    if case == "rate":
        fine = _limited(fine, np.ptp(u) / 2.0 / (0.7 * slow) * h)
    still = _flown(aircraft, fine, h, _linear(aircraft))
    scale = still[::_SUBSTEPS].std(axis=0)
    noise = scale * rng.uniform(0.02, 0.05, 2)
    X, given = still, fine
    gust = np.zeros(len(fine))
    if own.gust:
        a = float(np.exp(-h / (rng.uniform(0.5, 3.0) * slow)))
        white = rng.standard_normal(len(fine))
        gust = own.gust * scale[0] * np.sqrt(1.0 - a * a) * lfilter([1.0], [1.0, -a], white)
    if case == "stall":
        X = _flown(aircraft, fine, h, _stalled(aircraft, 0.6 * np.abs(still[:, 0]).max()))
    elif own.gust or own.loop:
        X, given = _in_air(aircraft, fine, h, gust, own.loop, noise, rng)
    if case == "elastic":
        X = still + _ringing(aircraft, still / scale, fine / fine.std(), h, rng) * scale
    Y, recorded = X[::_SUBSTEPS].copy(), given[::_SUBSTEPS].copy()
    if case in ("delay", "servo", "rate"):
        recorded = u
    if case == "vane":
        Y[:, 0] += gust[::_SUBSTEPS]
    if case == "clock":
        Y[:, 1] = np.interp(np.arange(len(Y)) * dt - 0.3 * slow, np.arange(len(Y)) * dt, Y[:, 1])
    if case == "drift":
        Y = Y + 6.0 * noise * (1.0 + 2.0 * np.linspace(0.0, 1.0, len(Y))[:, None])
    if case == "colour":
        a = float(np.exp(-dt / (3.0 * slow)))
        Y = Y + 3.0 * noise * np.sqrt(1.0 - a * a) * lfilter([1.0], [1.0, -a], rng.standard_normal(Y.shape), axis=0)
    else:
        Y = Y + noise * rng.standard_normal(Y.shape)
    return FlightRecord(np.arange(len(Y)) * dt, (*INPUTS, *OUTPUTS), np.column_stack([recorded, Y]), "measured")


def _limited(u: FloatArray, most: float) -> FloatArray:
    out = u.copy()
    for k in range(1, len(u)):
        out[k] = np.clip(u[k], out[k - 1] - most, out[k - 1] + most)
    return out


def _ringing(aircraft: Drawn, motion: FloatArray, u: FloatArray, h: float, rng: np.random.Generator) -> FloatArray:
    """Return what the rate of its elastic mode adds to alpha and q (n, 2) of unit size: a tenth to a third of q.

    Motion and elevator, likewise of unit size, drive the mode.
    """
    wn, zeta = aircraft.elastic
    s = wn * complex(-zeta, np.sqrt(1.0 - zeta**2))
    force = np.column_stack([motion, u]) @ rng.standard_normal(3)
    rate = (s * lfilter([0.0, h], [1.0, -np.exp(s * h)], force)).imag
    in_q = rng.uniform(0.1, 0.33)
    return np.outer(rate / rate.std(), [in_q * rng.uniform(-0.5, 0.5), in_q])


Law = Callable[[FloatArray, float], FloatArray]


def _linear(aircraft: Drawn) -> Law:
    A, b = aircraft.matrices
    return lambda x, de: A @ x + b * de


def _stalled(aircraft: Drawn, limit: float) -> Law:
    """Return the law of an aircraft whose lift slope halves beyond an angle, and whose stability falls there."""
    A, b = aircraft.matrices

    def law(x: FloatArray, de: float) -> FloatArray:
        beyond = max(abs(x[0]) - limit, 0.0)
        lift = x[0] - 0.5 * np.sign(x[0]) * beyond
        stability = lift * (1.0 - 0.6 * min(beyond / limit, 1.0))
        return np.array([A[0, 0] * lift + x[1] + b[0] * de, A[1, 0] * stability + A[1, 1] * x[1] + b[1] * de])

    return law


def _flown(aircraft: Drawn, u: FloatArray, h: float, law: Law) -> FloatArray:
    """Return the states (n, 2) that a held elevator moves, by the rule of the midpoint."""
    X, x = np.zeros((len(u), 2)), np.zeros(2)
    for k in range(len(u)):
        X[k] = x
        x = x + h * law(x + 0.5 * h * law(x, u[k]), u[k])
    return X


def _in_air(
    aircraft: Drawn,
    u: FloatArray,
    h: float,
    gust: FloatArray,
    loop: tuple[float, float, float] | None,
    noise: FloatArray,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Return states (n, 2) and elevator (n,) in gusts of the flow angle; a computer closes the loop at every sample."""
    A, b = aircraft.matrices
    law = _linear(aircraft)
    X, given, x, turned, added = np.zeros((len(u), 2)), u.copy(), np.zeros(2), 0.0, 0.0
    per = abs(float(np.linalg.solve(A, b)[0]))  # alpha per elevator
    for k in range(len(u)):
        X[k] = x
        if loop is not None and k % _SUBSTEPS == 0:
            sensed = x + noise * rng.standard_normal(2)
            turned += sensed[1] * h * _SUBSTEPS
            added = (loop[0] * sensed[0] + loop[1] * sensed[1] / aircraft.wn + loop[2] * turned) / per
        given[k] = (0.4 * u[k] if loop is not None else u[k]) + added
        x = x + h * (law(x + 0.5 * h * law(x, given[k]), given[k]) + A[:, 0] * gust[k])
    return X, given


def fly_with_speed(seed: int, size: float = 1.0) -> FlightRecord:
    """Return a measured flight (de, V, alpha, q, theta), deviations from trim, of exact equations of motion.

    Forces and moments go with dynamic pressure, those of rates with speed, drag with the square of lift, and gravity
    with the flight path; the derivatives are those of :class:`Drawn`.

    Args:
        seed: draws the aircraft and all else.
        size: of the inputs.
    """
    aircraft, rng = Drawn(seed), np.random.default_rng([seed, 65])
    t, V0, g = aircraft.truth, aircraft.V_m_s, G0_M_S2
    drag = g / rng.uniform(8.0, 20.0)
    h = aircraft.dt / _SUBSTEPS

    def law(x: FloatArray, de: float) -> FloatArray:
        v, alpha, q, theta = x
        pressure, V, gamma = (1.0 + v / V0) ** 2, V0 + v, theta - alpha
        lift = g - V0 * (t["Z_alpha"] * alpha + t["Z_de"] * de)
        return np.array(
            [
                drag - pressure * 0.5 * drag * (1.0 + (lift / g) ** 2) - g * np.sin(gamma),
                q + (g * np.cos(gamma) - pressure * lift) / V,
                pressure * (t["M_alpha"] * alpha + t["M_de"] * de) + (V / V0) * t["M_q"] * q,
                q,
            ]
        )

    u = np.repeat(size * aircraft.inputs(LONG // 2), _SUBSTEPS)
    X, x = np.zeros((len(u), 4)), np.zeros(4)
    for k in range(len(u)):
        X[k] = x
        x = x + h * law(x + 0.5 * h * law(x, u[k]), u[k])
    Y = X[::_SUBSTEPS]
    Y = Y + Y.std(axis=0) * rng.uniform(0.005, 0.02, 4) * rng.standard_normal(Y.shape)
    data = np.column_stack([u[::_SUBSTEPS], Y])
    return FlightRecord(np.arange(len(Y)) * aircraft.dt, ("de", "V", "alpha", "q", "theta"), data, "measured")
