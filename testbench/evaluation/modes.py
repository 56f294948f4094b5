"""Poles of the true linear model by the names of the field: short period, phugoid, and the elastic modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import eig

from testbench.errors import ModelError
from testbench.flight.linearise import LinearModel

_RIGID = ("u", "w", "q", "theta")


def longitudinal_modes(model: LinearModel, elastic_names: Mapping[int, str]) -> dict[str, complex]:
    """Return name -> pole (rad/s, the one of a pair with positive imaginary part) of the longitudinal motion.

    Args:
        model: linearised aircraft; its state h is left out (the atmosphere is frozen, which moves the poles by some
            1e-3 rad/s and takes a pole at zero away).
        elastic_names: number of each symmetric elastic mode -> its name.

    An elastic mode is the pair whose eigenvector takes part most in eta and etadot of that mode (participation factors
    of Perez-Arriaga, Verghese and Schweppe, IEEE Trans. PAS-101(9), 1982). Of what remains the slow pair is the
    phugoid, the fast one the short period; a mode that has split into two real roots is listed root by root.
    """
    states = [*_RIGID, *(f"eta_{i}" for i in elastic_names), *(f"etadot_{i}" for i in elastic_names)]
    A = model.subsystem(states).A
    poles, left, right = eig(A, left=True, right=True)
    participation = np.abs(left.conj() * right)
    participation /= participation.sum(axis=0)
    upper = [k for k in range(poles.size) if poles[k].imag >= -1e-9]
    modes: dict[str, complex] = {}
    for i, name in elastic_names.items():
        rows = [states.index(f"eta_{i}"), states.index(f"etadot_{i}")]
        best = max(upper, key=lambda k, rows=rows: participation[rows, k].sum())  # type: ignore[misc]
        modes[name] = complex(poles[best])
        upper.remove(best)
    rigid = sorted((complex(poles[k]) for k in upper), key=abs)
    modes |= _rigid_names(rigid)
    return dict(sorted(modes.items(), key=lambda item: abs(item[1])))


def _rigid_names(poles: Sequence[complex]) -> dict[str, complex]:
    pairs = [p for p in poles if p.imag > 1e-9]
    real = [p for p in poles if p.imag <= 1e-9]
    if len(pairs) == 2:
        return {"phugoid": pairs[0], "short period": pairs[1]}
    if len(pairs) == 1 and len(real) == 2:
        split, whole = ("short period", "phugoid") if abs(pairs[0]) < abs(real[0]) else ("phugoid", "short period")
        return {whole: pairs[0], f"{split}, slow root": real[0], f"{split}, fast root": real[1]}
    if len(real) == 4:
        names = ("phugoid, slow root", "phugoid, fast root", "short period, slow root", "short period, fast root")
        return dict(zip(names, real, strict=True))
    raise ModelError(f"the longitudinal motion must have four rigid poles, got {len(pairs)} pairs and {len(real)} real")


def frequency_and_damping(pole: complex) -> tuple[float, float]:
    """Return natural frequency |s| in rad/s and damping ratio -Re(s)/|s| of a pole."""
    wn = abs(pole)
    return wn, -pole.real / wn if wn else 1.0
