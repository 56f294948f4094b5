"""The data of a regression: signals of one record with their validity, and terms as products of their powers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations_with_replacement
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import ChannelError, EstimationError, nearest
from testbench.core.record import FloatArray

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
