"""A window of a record that does not begin at trim: what its start is made of, and what is left once that is unknown.

The start of a window is a nuisance of that window alone. With r residuals in units of the noise, G what the start
parameters change in them per standard deviation of their priors, and z how far they lie from the centres,

    min over z of |r - G z|^2 + |z|^2 = r' Q r,   Q = I - G (G'G + I)^-1 G',

so that Q^(1/2) r are the residuals of a window whose start is unknown. They lack trace(I - Q) degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from testbench.core.record import FloatArray
from testbench.flight import Start

MOST = 4.0
"""Prior standard deviations that a start parameter may lie from the centre."""
FARTHEST = 5.0
"""Prior standard deviations that a start is moved at once."""
STATES = ("V_m_s", "alpha", "beta", "p", "q", "r", "phi", "theta", "h_m")
"""Of a start, in the order of :class:`testbench.flight.Start`; what else a start has are offsets of commands, and where
surfaces and engines began."""
BEGAN = "_began"
"""End of the names of the latter: by how much the command that held a surface or an engine where it begins differs from
the first one recorded. A slow servo is not where it is commanded, and its record may begin while it moves."""


@dataclass(frozen=True, eq=False)
class FreeStart:
    """The start of one window: k parameters with Gaussian priors.

    Attributes:
        names: of STATES (deviations from trim), controls whose commands are off by a constant, and controls that begin
            elsewhere, with BEGAN.
        centre: (k,) of their priors, SI.
        std: (k,) standard deviations of the priors, SI.
        origin: (k,) values at which ``columns`` were taken, SI; the start of the believed model.
        columns: (n, outputs, k) change of the readings per ``std`` of each, SI.
    """

    names: tuple[str, ...]
    centre: FloatArray
    std: FloatArray
    origin: FloatArray
    columns: FloatArray
    known: dict[object, Directions] = field(default_factory=dict, repr=False)

    def start(self, x: FloatArray) -> Start:
        """Return where a flight with parameters ``x`` (k,) begins."""
        return Start(**{n: v for n, v in zip(self.names, x.tolist(), strict=True) if n in STATES})

    def offsets(self, x: FloatArray) -> dict[str, float]:
        """Return control -> constant that its commands are off by."""
        own = zip(self.names, x.tolist(), strict=True)
        return {n: v for n, v in own if n not in STATES and not n.endswith(BEGAN)}

    def began(self, x: FloatArray) -> dict[str, float]:
        """Return control -> by how much the command that held it as the flight began differs from the first one."""
        own = zip(self.names, x.tolist(), strict=True)
        return {n.removesuffix(BEGAN): v for n, v in own if n.endswith(BEGAN)}

    def shift(self, x: FloatArray) -> FloatArray:
        """Return what readings (n, outputs) from ``x`` (k,) have more than from the centre, to first order, SI."""
        return np.asarray(self.columns @ ((x - self.centre) / self.std))

    def moved(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """Return the parameters (k,) that lie ``z`` (k,) from the centre, or on the way from ``x``, FARTHEST off."""
        step = self.centre + self.std * z - x
        return np.asarray(x + step * min(1.0, FARTHEST / max(float(np.max(np.abs(step / self.std))), 1e-12)))

    def directions(self, whitened: Callable[[FloatArray], FloatArray], key: tuple[object, Any]) -> Directions:
        """Return what the start does to residuals that are ``whitened`` (n, outputs), kept by ``key``."""
        if key not in self.known:
            G = np.stack([whitened(c) for c in np.moveaxis(self.columns, 2, 0)], axis=-1)
            U, s, Vt = np.linalg.svd(G.reshape(-1, G.shape[-1]), full_matrices=False)
            self.known[key] = Directions(U, s, Vt)
        return self.known[key]


@dataclass(frozen=True, eq=False)
class Directions:
    """What a start changes in residuals: G = U s V', U (samples, k), s (k,), Vt (k, k)."""

    U: FloatArray
    s: FloatArray
    Vt: FloatArray

    @cached_property
    def lost(self) -> float:
        """Degrees of freedom that the start takes: trace(I - Q)."""
        return float(np.sum(self.s**2 / (1.0 + self.s**2)))

    def taken_out(self, r: FloatArray) -> FloatArray:
        """Return Q^(1/2) r of residuals (n, outputs)."""
        flat = r.ravel()
        share = 1.0 - 1.0 / np.sqrt(1.0 + self.s**2)
        return np.asarray(flat - self.U @ (share * (self.U.T @ flat))).reshape(r.shape)

    def best(self, r: FloatArray) -> FloatArray:
        """Return the z (k,) that fits residuals r (n, outputs) from the centre best: (G'G + I)^-1 G' r.

        No entry is larger than MOST: a model that fits badly is not to be flown from where nobody believes it began.
        """
        onto = self.U.T @ r.ravel()
        z = self.Vt.T @ (self.s / (1.0 + self.s**2) * onto)
        if np.max(np.abs(z), initial=0.0) > MOST:
            A = np.vstack([self.s[:, None] * self.Vt, np.eye(self.s.size)])
            z = lsq_linear(A, np.concatenate([onto, np.zeros(self.s.size)]), (-MOST, MOST), method="bvls").x
        return np.asarray(z)
