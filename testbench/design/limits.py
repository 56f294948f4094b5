"""What an input may do: deflection, rate, load factor, alpha, speed, height and bank; predicted linearly or flown.

The linear prediction scales an input to the largest admissible amplitude at once. The flight in the simulator that
follows decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import expm

from testbench.aircraft.model import Control
from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2, PERCENT
from testbench.core.errors import LimitError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.base import ManoeuvreLimits
from testbench.flight.linear_model import LinearModel


@dataclass(frozen=True)
class Limits:
    """The envelope of a manoeuvre; None sets no limit. Changes count from trim."""

    deflection: dict[str, float]  # control -> largest deflection either side, rad (1 for the throttle); trim included
    rate: dict[str, float]  # control -> largest rate, rad/s
    load_factor: tuple[float, float] | None = None  # lowest and highest -az / g
    alpha: tuple[float, float] | None = None  # lowest and highest angle of attack, rad
    beta: float | None = None  # largest sideslip either side, rad
    speed_change_m_s: float | None = None  # largest change of airspeed either side
    height_change_m: float | None = None  # largest change of height either side
    pitch_change: float | None = None  # largest change of pitch angle either side, rad
    bank: float | None = None  # largest bank either side, rad
    V_max_m_s: float | None = None  # airspeed that is never exceeded, e.g. the onset of flutter less a margin.
    V_min_m_s: float | None = None  # airspeed that is always kept, e.g. 1.2 times the stall speed.
    # control -> lowest and highest value that the aircraft allows, rad
    throw: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, given: ManoeuvreLimits, controls: Mapping[str, Control], alone: Mapping[str, Any], **more: Any
    ) -> Limits:
        """Return the limits that a scenario gives, in SI, with those of ``alone`` where it has none.

        Raises:
            LimitError: a limit breaks its law.
        """

        def angle(degrees: float | None) -> float | None:
            return None if degrees is None else degrees * DEG_RAD

        deflection = {name: max(c.full, -c.low) for name, c in controls.items()}
        for name, value in given.deflection_deg.items():
            deflection[name] = value * (PERCENT if name == "thr" else DEG_RAD)
        said: dict[str, Any] = {
            "load_factor": given.load_factor,
            "alpha": given.alpha_deg and (given.alpha_deg[0] * DEG_RAD, given.alpha_deg[1] * DEG_RAD),
            "beta": angle(given.beta_deg),
            "speed_change_m_s": given.speed_change_m_s,
            "height_change_m": given.height_change_m,
            "pitch_change": angle(given.pitch_change_deg),
            "bank": angle(given.bank_deg),
        }
        return cls(
            deflection=deflection,
            rate={name: r * DEG_RAD for name, r in given.rate_deg_s.items()},
            throw={name: (c.low, c.full) for name, c in controls.items()},
            **{key: alone.get(key) if value is None else value for key, value in said.items()},
            **more,
        )

    def control_band(self, control: str) -> tuple[float, float]:
        """Return the lowest and highest value of a control that the limits and its own stops allow."""
        most = self.deflection[control]
        low, high = self.throw.get(control, (-most, most))
        return (0.0 if control == "thr" else max(low, -most)), min(high, most)

    def bands(self, trim: dict[str, float]) -> dict[str, tuple[float, float]]:
        """Return channel -> (lowest, highest) absolute value, from the trimmed values of V, h, theta and alpha.

        Raises:
            LimitError: trim itself lies outside a limit.
        """
        out: dict[str, tuple[float, float]] = {}
        if self.load_factor:
            out["az"] = (-G0_M_S2 * self.load_factor[1], -G0_M_S2 * self.load_factor[0])
        if self.alpha:
            out["alpha"] = self.alpha
        for name, half in (("beta", self.beta), ("phi", self.bank)):
            if half is not None:
                out[name] = (-half, half)
        for name, half in (("V", self.speed_change_m_s), ("h", self.height_change_m), ("theta", self.pitch_change)):
            if half is not None:
                out[name] = (trim[name] - half, trim[name] + half)
        if self.V_max_m_s is not None or self.V_min_m_s is not None:
            low, high = out.get("V", (0.0, np.inf))
            out["V"] = (max(low, self.V_min_m_s or 0.0), min(high, self.V_max_m_s or np.inf))
        for name, (low, high) in out.items():
            if name in trim and not low < trim[name] < high:
                unit = channel(name).unit
                raise LimitError(
                    f"trim must lie inside the limits on {name}, {low:.4g} to {high:.4g} {unit}, got "
                    f"{trim[name]:.4g} {unit}; widen the limit or choose another condition"
                )
        return out

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not value > 0.0:
                raise LimitError(f"{item.name} > 0 must hold, got {value:g}")
            if isinstance(value, tuple) and not value[0] < value[1]:
                raise LimitError(f"{item.name}: low < high must hold, got {value[0]:g} and {value[1]:g}")


class Breach(NamedTuple):
    """The first moment at which a limit is broken."""

    channel: str
    t_s: float
    value: float
    limit: float

    @property
    def sentence(self) -> str:
        """The breach in words."""
        unit = channel(self.channel).unit
        if self.channel == "az":
            n, limit = -self.value / G0_M_S2, -self.limit / G0_M_S2
            return f"the load factor passes {limit:.3g} at t = {self.t_s:.2f} s (extreme {n:.3g})"
        if unit == "rad":
            return (
                f"{self.channel} passes {self.limit / DEG_RAD:.4g} deg at t = {self.t_s:.2f} s "
                f"(extreme {self.value / DEG_RAD:.4g} deg)"
            )
        return (
            f"{self.channel} passes {self.limit:.4g} {unit} at t = {self.t_s:.2f} s (extreme {self.value:.4g} {unit})"
        )


def breaches(record: FlightRecord, bands: dict[str, tuple[float, float]]) -> list[Breach]:
    """Return every limit that a flown record breaks, each with its first moment and its extreme value.

    Raises:
        ChannelError: the record lacks a limited channel.
    """
    out = []
    for name, (low, high) in bands.items():
        x = record[name]
        for limit, over in ((low, x < low), (high, x > high)):
            if over.any():
                extreme = float(x.min() if limit == low else x.max())
                out.append(Breach(name, float(record.t_s[np.argmax(over)]), extreme, limit))
    return sorted(out, key=lambda b: b.t_s)


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
    envelope: Envelope = field(init=False)
    names: tuple[str, ...] = field(init=False)
    low: FloatArray = field(init=False)
    high: FloatArray = field(init=False)
    _transforms: NDArray[np.complex128] = field(init=False, repr=False)
    _size: int = field(init=False, repr=False)
    _last: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        envelope = Envelope.of(self.model, self.controls, self.limits, dict(self.trim))
        edges = {
            name: (low - self.trim.get(name, 0.0), high - self.trim.get(name, 0.0))
            for name, (low, high) in envelope.bands.items()
        }
        rows = [self.model.outputs.index(n) for n in edges]
        of_servos = [self.model.states.index(f"servo_{n}") for n in envelope.rates]  # a rate: its state's derivative
        C = np.vstack([self.model.C[rows], self.model.A[of_servos]])
        D = np.vstack([self.model.D[rows], self.model.B[of_servos]])
        edges |= {f"rate of {name}": (-most, most) for name, (_, most) in envelope.rates.items()}
        edges |= {f"command of {name}": edges[name] for name in self.controls}
        for name, (low, high) in edges.items():
            if not low < 0.0 < high:
                raise LimitError(
                    f"trim leaves no room inside the limit on {name}; widen it or choose another condition"
                )
        size = next_fast_len(2 * self.samples, real=True)
        pulses = self._pulses(C, D)
        for name, value in (
            ("envelope", envelope),
            ("names", tuple(edges)),
            ("low", np.array([low for low, _ in edges.values()])),
            ("high", np.array([high for _, high in edges.values()])),
            ("_size", size),
            ("_last", self.samples),
            ("_transforms", np.stack([rfft(p, size, axis=0) for p in pulses])),
        ):
            object.__setattr__(self, name, value)

    def _pulses(self, C: FloatArray, D: FloatArray) -> list[FloatArray]:
        """Return per control the response (samples, c) to one held sample of unit command."""
        n = len(self.model.states)
        out = []
        for name in self.model.commands(self.controls):
            column = self.model.inputs.index(name)
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


class Tightest(NamedTuple):
    """The limit that a flight uses up most: its name, the share of the distance from trim, and the time."""

    name: str
    share: float
    t_s: float


@dataclass(frozen=True, eq=False)
class Envelope:
    """The limits of a design, in the form in which a flown record is compared with them."""

    bands: Mapping[str, tuple[float, float]]  # channel -> (lowest, highest), absolute; deflections included
    rates: Mapping[str, tuple[float, float]]  # control -> (its servo's 1 / lag in 1/s, largest rate in rad/s)
    trim: Mapping[str, float]  # channel -> value at trim

    @classmethod
    def of(cls, model: LinearModel, controls: Sequence[str], limits: Limits, trim: Mapping[str, float]) -> Envelope:
        """Return the limits at a trim of a linearised aircraft, whose states say which controls have a servo."""
        bands = limits.bands(dict(trim)) | {name: limits.control_band(name) for name in controls}
        servos = {c: model.states.index(f"servo_{c}") for c in controls if f"servo_{c}" in model.states}
        rates = {c: (-float(model.A[k, k]), limits.rate[c]) for c, k in servos.items() if c in limits.rate}
        return cls(bands, rates, trim)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the limits, those on rates behind the others."""
        return (*self.bands, *(f"rate of {name}" for name in self.rates))

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that a record must have to be held against the limits."""
        return (*self.bands, *(f"{name}_cmd" for name in self.rates))

    def _used(self, record: FlightRecord) -> list[FloatArray]:
        """Return over time (n,) the share of the distance from trim to each limit, in the order of ``names``."""
        out = []
        for name, (low, high) in self.bands.items():
            x, at = record[name], self.trim.get(name, float(record[name][0]))
            out.append(np.where(x > at, (x - at) / (high - at), (at - x) / (at - low)))
        return [*out, *(self._rate(record, name, lag) / most for name, (lag, most) in self.rates.items())]

    def shares(self, record: FlightRecord) -> FloatArray:
        """Return the largest share that a record uses of each limit, in the order of ``names``."""
        return np.array([float(share.max()) for share in self._used(record)])

    def tightest(self, record: FlightRecord) -> Tightest:
        """Return the limit that a record uses up most."""
        used = self._used(record)
        i = max(range(len(used)), key=lambda i: float(used[i].max()))
        k = int(np.argmax(used[i]))
        return Tightest(self.names[i], float(used[i][k]), float(record.t_s[k]))

    def broken(self, record: FlightRecord) -> list[str]:
        """Return every limit that a record breaks, in words, in order of time."""
        found: list[tuple[float, str]] = [(b.t_s, b.sentence) for b in breaches(record, dict(self.bands))]
        for name, (lag, most) in self.rates.items():
            rate = self._rate(record, name, lag)
            if rate.max() > most:
                t = float(record.t_s[np.argmax(rate > most)])
                text = (
                    f"the rate of {name} passes {most / DEG_RAD:.3g} deg/s at t = {t:.2f} s "
                    f"(extreme {rate.max() / DEG_RAD:.3g} deg/s)"
                )
                found.append((t, text))
        return [text for _, text in sorted(found)]

    @staticmethod
    def _rate(record: FlightRecord, name: str, lag: float) -> FloatArray:
        """Return the rate of a first-order servo (n,), rad/s, from command and deflection."""
        return np.asarray(lag * np.abs(record[f"{name}_cmd"] - record[name]))


def limit_words(name: str) -> str:
    """Return a limit's name in words."""
    for kind in ("rate of ", "command of "):
        if name.startswith(kind):
            return f"the {kind}{channel(name.removeprefix(kind)).description.split(',')[0]}"
    return "the load factor" if name == "az" else f"the {channel(name).description.split(',')[0]}"
