"""What a wing that rolls, yaws or turns its ailerons does in yaw, by Prandtl's lifting line.

Strips see no induced velocity, and these moments are made of it. With y to the right, W the air that comes up at a
section, U that it meets from ahead, w the downwash of the free vortices and m the lift slope of a section,

    Gamma = m c (W - w) / 2 = 2 b V sum of A_n sin(n theta),    y = b / 2 cos(theta),
    w / V = sum of n A_n sin(n theta) / sin(theta)

(H. Glauert, The Elements of Aerofoil and Airscrew Theory, 1926, chapter 11). A section's force along the flight path is
rho Gamma (W' - w), W' the part of W that comes of rolling: the lift of a wing that goes down leans forward. Its profile
drag is rho U^2 c cd / 2. The series is solved by collocation, for the steady flight and for a small motion about it.
The wake of a yawing wing is taken for straight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray

TERMS = 120  # 60 change no moment by more than 0.3 %


@dataclass(frozen=True, eq=False)
class LiftingLine:
    """An untwisted wing in steady flight at lift coefficient CL.

    Attributes:
        span_m: b.
        chord_m: (TERMS,) at the sections ``y``.
        CL: of the wing.
        profile_drag: drag coefficient cd of a section.
        section_slope: m, per rad.
    """

    span_m: float
    chord_m: FloatArray
    CL: float
    profile_drag: float
    section_slope: float = 2.0 * np.pi

    @property
    def area_m2(self) -> float:
        """Area of the wing, m2."""
        return self._integral(self.chord_m)

    def moments(self, motion: str, aileron: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, float]:
        """Return Cl and Cn of the wing per unit of p b / 2V ("p"), of r b / 2V ("r") or of the aileron ("da").

        Args:
            motion: which.
            aileron: inner y, outer y (m), and effectiveness d alpha / d da.

        Cl is positive right wing down, Cn nose right; a positive aileron takes lift from the right wing.
        """
        b, c, y = self.span_m, self.chord_m, sections(self.span_m)
        gamma0, down0 = self._vortices(self._incidence() * np.ones(TERMS))
        ahead, rolling = np.zeros(TERMS), np.zeros(TERMS)  # changes of U / V and of W' / V
        if motion == "p":
            rolling = 2.0 * y / b
            change = rolling
        elif motion == "r":
            ahead = -2.0 * y / b
            change = self._incidence() * ahead
        else:
            change = -aileron[2] * np.sign(y) * self._share(*aileron[:2])
        gamma, down = self._vortices(change)
        lift = 2.0 * (gamma + gamma0 * ahead)  # per length, over qbar; gamma is over V
        forward = 2.0 * (gamma0 * (rolling - down) - gamma * down0) - 2.0 * c * self.profile_drag * ahead
        size = self.area_m2 * b
        return {"Cl": -self._integral(lift * y) / size, "Cn": -self._integral(forward * y) / size}

    def lift_slope(self) -> float:
        """Return CL per rad of the wing."""
        return self._integral(2.0 * self._vortices(np.ones(TERMS))[0]) / self.area_m2

    def _share(self, inner_m: float, outer_m: float) -> FloatArray:
        """Return the share of each section's piece of span that lies between two distances from the middle."""
        edges = 0.5 * self.span_m * np.cos(np.arange(TERMS + 1) * np.pi / TERMS)
        high, low = np.maximum(abs(edges[:-1]), abs(edges[1:])), np.minimum(abs(edges[:-1]), abs(edges[1:]))
        return np.asarray(np.clip(np.minimum(high, outer_m) - np.maximum(low, inner_m), 0.0, None) / (high - low))

    def _incidence(self) -> float:
        return self.CL / self.lift_slope()

    def _vortices(self, upwash: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return Gamma / V (m) and w / V at the sections, where ``upwash`` is W / V."""
        n, theta = np.arange(1, TERMS + 1), _angles()[:, None]
        sines = np.sin(n * theta)
        induced = n * sines / np.sin(theta)
        half = 0.5 * self.section_slope * self.chord_m
        A = np.linalg.solve(2.0 * self.span_m * sines + half[:, None] * induced, half * upwash)
        return 2.0 * self.span_m * sines @ A, induced @ A

    def _integral(self, per_length: FloatArray) -> float:
        """Return the integral over the span; the midpoint rule in theta is exact for the products of the series."""
        return float(np.sum(per_length * np.sin(_angles())) * 0.5 * self.span_m * np.pi / TERMS)


def _angles() -> FloatArray:
    return np.asarray((np.arange(TERMS) + 0.5) * np.pi / TERMS, dtype=np.float64)


def sections(span_m: float) -> FloatArray:
    """Return y (TERMS,) of the sections of a wing, right ones first, m."""
    return 0.5 * span_m * np.cos(_angles())
