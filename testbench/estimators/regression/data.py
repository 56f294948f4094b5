"""The data of a regression: signals of one record with their validity, and terms as products of their powers.

Nondimensional aerodynamic force and moment coefficients and regressors from a measured record.

Equations of V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, chapters 3 and 5.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import combinations_with_replacement
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import ChannelError, EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.regression.smoothing import bridge, fourier_smooth, local_polynomial

BIAS = "1"
"""Name of the constant term."""

Differentiation = Literal["fourier", "local"]
_FACTOR = re.compile(r"([A-Za-z_]\w*)(?:\^([1-9]\d*))?")


@dataclass(frozen=True, kw_only=True)
class MassProperties:
    """Mass, reference geometry and inertia, about the centre of gravity in body axes.

    Attributes:
        mass_kg: m.
        area_m2: reference area S.
        span_m: b.
        chord_m: mean aerodynamic chord, c_bar.
        Ixx, Iyy, Izz, Ixz: kg m2.
        thrust_angle_rad: inclination of the thrust line to the body x axis, positive nose up: Fz = -T sin(angle).
        thrust_arm_m: distance of the thrust line below the centre of gravity: pitching moment T arm, nose up.
    """

    mass_kg: float
    area_m2: float
    span_m: float
    chord_m: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float = 0.0
    thrust_angle_rad: float = 0.0
    thrust_arm_m: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            positive = f.name not in ("Ixz", "thrust_angle_rad", "thrust_arm_m")
            if not np.isfinite(value) or (positive and value <= 0.0):
                raise EstimationError(f"{f.name} must be {'positive' if positive else 'finite'}, got {value}")


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How signals are made from a record; see :func:`coefficients.regression_data`."""

    mass: MassProperties | None = None
    density_kg_m3: float | None = None
    unpowered: bool = False
    symmetric: bool = False
    differentiation: Differentiation = "fourier"


@dataclass(frozen=True, eq=False)
class RegressionData:
    """Signals of one record, ready for regression.

    Attributes:
        t_s: (n,) times, s.
        names: (k,) names of the signals: channels of the record, and what was made from them.
        values: (n, k) samples, gaps interpolated.
        valid: (n, k) True where all channels that entered were sampled.
        absent: signals that could not be made -> the channels that they need.
        recipe: how the signals were made.
    """

    t_s: FloatArray
    names: tuple[str, ...]
    values: FloatArray
    valid: NDArray[np.bool_]
    absent: Mapping[str, str]
    recipe: Recipe

    def __post_init__(self) -> None:
        shape = (np.size(self.t_s), len(self.names))
        for key, kind in (("t_s", np.float64), ("values", np.float64), ("valid", np.bool_)):
            array = np.array(getattr(self, key), dtype=kind)
            array.setflags(write=False)
            object.__setattr__(self, key, array)
        if self.values.shape != shape or self.valid.shape != shape or not np.all(np.isfinite(self.values)):
            raise EstimationError(f"values and valid must be finite and of shape {shape}, got {self.values.shape}")
        object.__setattr__(self, "absent", MappingProxyType(dict(self.absent)))

    def __len__(self) -> int:
        return self.t_s.size

    def __getitem__(self, name: str) -> FloatArray:
        return self.values[:, self._index(name)]

    def _index(self, name: str) -> int:
        if name in self.names:
            return self.names.index(name)
        if name in self.absent:
            raise ChannelError(f"signal '{name}' needs {self.absent[name]}")
        raise ChannelError(
            f"a signal must be one of the record or made from it, got '{name}'{nearest(name, self.names)}"
        )

    @property
    def dt_s(self) -> float:
        """Sample time, s.

        Raises:
            EstimationError: fewer than 2 samples, or samples not uniform to 1 % of the step.
        """
        steps = np.diff(self.t_s)
        if not steps.size or np.ptp(steps) > 0.01 * float(np.mean(steps)):
            raise EstimationError(
                "samples must be uniform in time for autocorrelation and Fourier transforms; cut or resample the record"
            )
        return float(np.mean(steps))

    def matrix(self, terms: Sequence[str]) -> FloatArray:
        """Return the terms as columns (n, len(terms)): "1", "alpha", "alpha^2", "alpha*q_hat" and so on.

        Raises:
            EstimationError: a term cannot be read.
            ChannelError: a signal is not there.
        """
        out = np.ones((len(self), len(terms)))
        for i, term in enumerate(terms):
            for name, power in factors(term):
                out[:, i] *= self[name] ** power
        return out

    def sampled(self, terms: Sequence[str]) -> NDArray[np.bool_]:
        """Return (n,) True where every signal in ``terms`` was really sampled."""
        used = sorted({name for term in terms for name, _ in factors(term)})
        return np.asarray(np.all(self.valid[:, [self._index(name) for name in used]], axis=1))


def factors(term: str) -> tuple[tuple[str, int], ...]:
    """Return a term as (signal, power) pairs; the constant term "1" has none.

    Raises:
        EstimationError: the term is not of the form "a", "a^2", "a*b" ...
    """
    if term == BIAS:
        return ()
    out = []
    for part in term.replace(" ", "").split("*"):
        match = _FACTOR.fullmatch(part)
        if match is None:
            raise EstimationError(
                f"a term must be a product of powers of signals, as 'alpha', 'alpha^2' or 'alpha*q_hat', got '{term}'"
            )
        out.append((match[1], int(match[2] or 1)))
    return tuple(out)


def check_terms(terms: Sequence[str]) -> tuple[str, ...]:
    """Return the terms as a tuple after checking that there are some and that they differ as products.

    Raises:
        EstimationError: no term, one that cannot be read, or two that are the same product.
    """
    seen: dict[tuple[tuple[str, int], ...], str] = {}
    for term in terms:
        powers: dict[str, int] = {}
        for name, power in factors(term):
            powers[name] = powers.get(name, 0) + power
        key = tuple(sorted(powers.items()))
        if key in seen:
            raise EstimationError(f"terms must differ, got '{seen[key]}' and '{term}', which are the same product")
        seen[key] = term
    if not seen:
        raise EstimationError("a regression needs at least one term, got none")
    return tuple(terms)


def polynomial_terms(signals: Sequence[str], order: int) -> tuple[str, ...]:
    """Return all products of ``signals`` of degree 1 to ``order``, lowest degree first.

    Raises:
        EstimationError: order below 1.
    """
    if order < 1:
        raise EstimationError(f"order >= 1 must hold, got {order}")
    out = []
    for degree in range(1, order + 1):
        for chosen in combinations_with_replacement(range(len(signals)), degree):
            counts = {i: chosen.count(i) for i in chosen}
            out.append("*".join(signals[i] + (f"^{c}" if c > 1 else "") for i, c in counts.items()))
    return tuple(out)


# --- nondimensional aerodynamic force and moment coefficients and regressors from a measured record -------------------


_NONDIMENSIONAL = (
    *("p_hat", "q_hat", "r_hat", "alphadot_hat", "betadot_hat"),
    *("CX", "CY", "CZ", "CL", "CD", "Cl", "Cm", "Cn"),
)
_RATES = {"pdot": "p", "qdot": "q", "rdot": "r", "alphadot": "alpha", "betadot": "beta"}


def regression_data(
    record: FlightRecord,
    mass: MassProperties | None = None,
    *,
    density_kg_m3: float | None = None,
    unpowered: bool = False,
    symmetric: bool = False,
    differentiation: Differentiation = "fourier",
) -> RegressionData:
    """Return all signals that a regression may use, as far as the record allows.

    Every channel of the record under its own name, samples that were not taken interpolated and marked, and:

    - pdot, qdot, rdot, alphadot, betadot: differentiated where the record does not hold them;
    - V and qbar = density V^2 / 2 from each other, where one is missing and the density is given;
    - p_hat = p b / (2 V), q_hat = q c_bar / (2 V), r_hat = r b / (2 V); alphadot_hat, betadot_hat likewise;
    - CX = (m ax - T cos s) / (qbar S), CY = m ay / (qbar S), CZ = (m az + T sin s) / (qbar S), s the thrust angle,
      ax, ay, az the specific forces at the centre of gravity;
    - CL = -CZ cos(alpha) + CX sin(alpha), CD = -CX cos(alpha) - CZ sin(alpha);
    - Cl = (Ixx pdot - Ixz (p q + rdot) + (Izz - Iyy) q r) / (qbar S b);
    - Cm = (Iyy qdot + (Ixx - Izz) p r + Ixz (p^2 - r^2) - T arm) / (qbar S c_bar);
    - Cn = (Izz rdot - Ixz (pdot - q r) + (Iyy - Ixx) p q) / (qbar S b).

    The angular momentum of rotors is neglected. What a record cannot give is never taken as zero unless ``unpowered``
    or ``symmetric`` says so: the signal is absent, and asking for it says why.

    Args:
        record: measured record.
        mass: mass properties; without them there are no coefficients and no q_hat.
        density_kg_m3: air density, where the record lacks V or qbar.
        unpowered: the thrust is zero, so that no channel "thrust" is needed.
        symmetric: the flight is in the plane of symmetry: p and r are zero where the record lacks them.
        differentiation: "fourier" for :func:`fourier_smooth` (the rate itself stays as measured), "local" for
            quadratics through 5 samples.

    Raises:
        EstimationError: the record is of kind "truth" or, for coefficients, of deviations from trim; a channel holds
            no valid sample; V or qbar is not positive; or a setting is against the laws above.
    """
    if record.kind != "measured":
        raise EstimationError(f"estimators take measured records only, got one of kind '{record.kind}'")
    if density_kg_m3 is not None and not 0.0 < density_kg_m3 < np.inf:
        raise EstimationError(f"density_kg_m3 must be positive, got {density_kg_m3}")
    if differentiation not in ("fourier", "local"):
        raise EstimationError(f"differentiation must be 'fourier' or 'local', got '{differentiation}'")
    removed = record.provenance.get("prepared", {}).get("bias", "none")
    if mass is not None and removed != "none":
        raise EstimationError(
            f"coefficients need airspeed and accelerations as measured, but bias '{removed}' was subtracted from this "
            "record; give the record before prepare, or prepare it with bias 'none'"
        )
    recipe = Recipe(
        mass=mass,
        density_kg_m3=density_kg_m3,
        unpowered=unpowered,
        symmetric=symmetric,
        differentiation=differentiation,
    )
    book = _Book(len(record))
    for i, name in enumerate(record.channels):
        valid = record.valid[:, i]
        book.values[name] = bridge(record.t_s, record.data[:, i], valid, name)
        book.valid[name] = valid
    if symmetric:
        for name in ("p", "r"):
            book.add(name, "", lambda: np.zeros(len(record)))
    _derivatives(book, record, differentiation)
    if mass is not None or density_kg_m3 is not None:  # without either, V may be a deviation from trim
        _airdata(book, density_kg_m3)
    _nondimensional(book, recipe)
    return RegressionData(
        record.t_s,
        tuple(book.values),
        np.column_stack(list(book.values.values())),
        np.column_stack(list(book.valid.values())),
        book.absent,
        recipe,
    )


@dataclass
class _Book:
    """Signals made so far, their validity, and those that could not be made."""

    n: int
    values: dict[str, FloatArray] = field(default_factory=dict)
    valid: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, sources: str, make: Callable[..., FloatArray], lacking: str = "") -> None:
        """Make ``name`` from ``sources`` unless it is there; note what is lacking if it cannot be made."""
        if name in self.values:
            return
        needs = sources.split()
        missing = [self.absent.get(s, f"channel '{s}'") for s in needs if s not in self.values]
        missing += [lacking] if lacking else []
        if missing:
            self.absent[name] = ", ".join(dict.fromkeys(missing))
            return
        self.absent.pop(name, None)
        self.values[name] = make(*(self.values[s] for s in needs))
        self.valid[name] = (
            np.asarray(np.all([self.valid[s] for s in needs], axis=0)) if needs else np.ones(self.n, bool)
        )


def _derivatives(book: _Book, record: FlightRecord, differentiation: Differentiation) -> None:
    steps = np.diff(record.t_s)
    uniform = steps.size > 0 and float(np.ptp(steps)) <= 0.01 * float(np.mean(steps))
    lacking = "" if uniform and len(record) >= 16 else "at least 16 samples, uniform in time, to be differentiated"
    dt = float(np.mean(steps)) if uniform else np.nan

    def differentiate(y: FloatArray) -> FloatArray:
        return local_polynomial(y, dt) if differentiation == "local" else fourier_smooth(y, dt).derivative

    for rate, source in _RATES.items():
        book.add(rate, source, differentiate, lacking)


def _airdata(book: _Book, density: float | None) -> None:
    no = "" if density is not None else "density_kg_m3"
    rho = density or 1.0
    book.add("qbar", "V", lambda V: 0.5 * rho * V**2, no)
    book.add("V", "qbar", lambda qbar: np.sqrt(2.0 * qbar / rho), no)
    for name in ("V", "qbar"):
        if name in book.values and not np.all(book.values[name] > 0.0):
            raise EstimationError(
                f"'{name}' must be positive to divide by, got {float(np.min(book.values[name])):g}; "
                "cut the record to flight"
            )


def _nondimensional(book: _Book, recipe: Recipe) -> None:
    m = recipe.mass
    if m is None:
        for name in _NONDIMENSIONAL:
            book.absent[name] = "mass properties (mass = ...)"
        return
    b, c, S = m.span_m, m.chord_m, m.area_m2
    for hat, rate, length in (
        ("p_hat", "p", b),
        ("q_hat", "q", c),
        ("r_hat", "r", b),
        ("alphadot_hat", "alphadot", c),
        ("betadot_hat", "betadot", b),
    ):
        book.add(hat, f"{rate} V", lambda x, V, length=length: x * length / (2.0 * V))
    cos, sin, arm = np.cos(m.thrust_angle_rad), np.sin(m.thrust_angle_rad), m.thrust_arm_m
    # only what the thrust enters needs it; else T keeps its default
    x, z, pitch = (" thrust" if need and not recipe.unpowered else "" for need in (True, sin != 0.0, arm != 0.0))
    book.add("CX", "ax qbar" + x, lambda a, Q, T=0.0: (m.mass_kg * a - T * cos) / (Q * S))
    book.add("CY", "ay qbar", lambda a, Q: m.mass_kg * a / (Q * S))
    book.add("CZ", "az qbar" + z, lambda a, Q, T=0.0: (m.mass_kg * a + T * sin) / (Q * S))
    book.add("CL", "alpha CX CZ", lambda a, X, Z: X * np.sin(a) - Z * np.cos(a))
    book.add("CD", "alpha CX CZ", lambda a, X, Z: -X * np.cos(a) - Z * np.sin(a))

    def roll(p: FloatArray, q: FloatArray, r: FloatArray, pd: FloatArray, rd: FloatArray, Q: FloatArray) -> FloatArray:
        return (m.Ixx * pd - m.Ixz * (p * q + rd) + (m.Izz - m.Iyy) * q * r) / (Q * S * b)

    def pitching(
        p: FloatArray, r: FloatArray, qd: FloatArray, Q: FloatArray, T: FloatArray | float = 0.0
    ) -> FloatArray:
        return (m.Iyy * qd + (m.Ixx - m.Izz) * p * r + m.Ixz * (p**2 - r**2) - T * arm) / (Q * S * c)

    def yaw(p: FloatArray, q: FloatArray, r: FloatArray, pd: FloatArray, rd: FloatArray, Q: FloatArray) -> FloatArray:
        return (m.Izz * rd - m.Ixz * (pd - q * r) + (m.Iyy - m.Ixx) * p * q) / (Q * S * b)

    book.add("Cl", "p q r pdot rdot qbar", roll)
    book.add("Cm", "p r qdot qbar" + pitch, pitching)
    book.add("Cn", "p q r pdot rdot qbar", yaw)
