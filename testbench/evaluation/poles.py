"""Which identified pole is which mode, and how far off it lies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

_FARTHEST = 1.0  # a pole farther than this is not the mode: a factor e in frequency, or 57 deg in the s-plane


@dataclass(frozen=True)
class PoleMatch:
    """One mode and the pole that was found for it.

    Attributes:
        name: the mode.
        true: its pole, rad/s, imaginary part not negative.
        found: the identified pole, or None if none lies near.
        wn_error_percent: 100 (|found| / |true| - 1), or None.
        zeta_error: damping ratio found minus true, or None.
        outputs: the outputs whose poles were searched.
    """

    name: str
    true: complex
    found: complex | None
    wn_error_percent: float | None
    zeta_error: float | None
    outputs: str = ""


def match_poles(found: ArrayLike, true: Mapping[str, complex], outputs: str = "") -> list[PoleMatch]:
    """Return for every mode the pole that matches it; no pole matches two modes.

    The distance of two poles of the upper half plane is |ln(found / true)|: relative in frequency and in damping alike,
    for slow and fast modes alike. The assignment of least total distance is chosen; a mode stays unmatched where
    that costs less than a distance of 1 (a factor e in frequency, or 57 deg of angle in the s-plane).

    Args:
        found: identified continuous poles, rad/s; conjugates count once.
        true: mode name -> pole, rad/s, either of a conjugate pair.
        outputs: written into the matches.

    Returns:
        One match per mode, in the order of ``true``.
    """
    poles = np.atleast_1d(np.asarray(found, dtype=np.complex128))
    poles = poles[poles.imag >= 0.0]
    modes = {name: complex(s.real, abs(s.imag)) for name, s in true.items()}
    if not modes:
        return []
    target = np.array(list(modes.values()))
    cost = np.full((target.size, poles.size + target.size), _FARTHEST)
    cost[:, : poles.size] = np.abs(_log(poles)[None, :] - _log(target)[:, None])
    rows, columns = linear_sum_assignment(cost)
    out = []
    for row, column in zip(rows, columns, strict=True):
        name, s = list(modes.items())[row]
        if column >= poles.size or cost[row, column] > _FARTHEST:
            out.append(PoleMatch(name, s, None, None, None, outputs))
            continue
        p = complex(poles[column])
        wn = 100.0 * (abs(p) / abs(s) - 1.0) if s else None
        out.append(PoleMatch(name, s, p, wn, damping(p) - damping(s), outputs))
    return out


def damping(pole: complex) -> float:
    """Return the damping ratio -Re(s) / |s| of a pole; 0 for a pole at the origin."""
    return -pole.real / abs(pole) if pole else 0.0


def _log(s: np.ndarray) -> np.ndarray:
    """Return ln(s); a pole at the origin stands at a millionth of a rad/s, which keeps an integrator comparable."""
    return np.log(np.where(np.abs(s) < 1e-6, 1e-6 + 0j, s))
