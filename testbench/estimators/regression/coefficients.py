"""Nondimensional aerodynamic force and moment coefficients and regressors from a measured record.

Equations of V. Klein, E. A. Morelli, Aircraft System Identification, AIAA 2006, chapters 3 and 5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.regression.data import Differentiation, MassProperties, Recipe, RegressionData
from testbench.estimators.regression.smoothing import bridge, fourier_smooth, local_polynomial

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
