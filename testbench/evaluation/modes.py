"""Poles of the true linear model by the field's names of modes, at one condition and followed to the next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eig
from scipy.optimize import linear_sum_assignment

from testbench.aircraft import Aircraft
from testbench.core.errors import ModelError
from testbench.core.record import FloatArray
from testbench.flight.linear_model import LAW, SERVO, LinearModel

RIGID_MODES = {"longitudinal": ("phugoid", "short period"), "lateral": ("Dutch roll", "roll", "spiral")}
"""Plane -> names of its rigid modes."""
_FARTHEST = 1.0  # a pole farther than this is not the mode: a factor e in frequency, or 57 deg in the s-plane
_RIGID = ("u", "w", "q", "theta")
_LATERAL = ("v", "p", "r", "phi")
_LAW_STEPS = 20  # from no law to all of it, in which poles are followed


def longitudinal_modes(model: LinearModel, elastic_names: Mapping[int, str]) -> dict[str, complex]:
    """Return name -> pole (rad/s, the one of a pair with positive imaginary part) of the longitudinal motion.

    Args:
        model: linearised aircraft; its state h is left out (the atmosphere is frozen, which moves the poles by some
            1e-3 rad/s and takes a pole at zero away).
        elastic_names: number of each symmetric elastic mode -> its name.

    Modes are told by their shape, the participation factors of Perez-Arriaga, Verghese and Schweppe (IEEE Trans.
    PAS-101(9), 1982): an elastic mode by eta and etadot, the short period by w and q, and the phugoid is what remains.
    A mode that has split into two real roots is listed root by root, as in "short period, slow root" and "short period,
    fast root".
    """
    return _by_root(spectrum(model, "longitudinal", elastic_names), elastic_names)


def lateral_modes(model: LinearModel, elastic_names: Mapping[int, str]) -> dict[str, complex]:
    """Return name -> pole (rad/s, the one of a pair with positive imaginary part) of the lateral-directional motion.

    Args:
        model: linearised aircraft.
        elastic_names: number of each antisymmetric elastic mode -> its name.

    Names are those of :func:`name_modes`; two real roots of one mode are listed root by root, and roll and spiral that
    have joined are one pair, "lateral phugoid".
    """
    modes = _by_root(spectrum(model, "lateral-directional", elastic_names), elastic_names)
    if modes["roll"].imag > 1e-9:
        modes["lateral phugoid"] = modes.pop("roll")
        del modes["spiral"]
    return dict(sorted(modes.items(), key=lambda item: abs(item[1])))


def _by_root(found: Spectrum, elastic: Mapping[int, str]) -> dict[str, complex]:
    """Return name -> pole by magnitude; a mode that has split into two real roots is listed root by root."""
    modes: dict[str, complex] = {}
    for mode, owned in name_modes(found, elastic).items():
        poles = poles_of(found, owned)
        roots = (mode,) if len(poles) == 1 else (f"{mode}, slow root", f"{mode}, fast root")
        modes |= dict(zip(roots, poles, strict=True))
    return dict(sorted(modes.items(), key=lambda item: abs(item[1])))


def roots_of(modes: Mapping[str, complex], mode: str) -> dict[str, complex]:
    """Return name -> pole of a mode among ``modes``: itself, or the two real roots that it has split into."""
    return {name: s for name, s in modes.items() if name == mode or name.startswith(f"{mode}, ")}


def frequency_of(modes: Mapping[str, complex], mode: str) -> float | None:
    """Return the natural frequency of a mode, rad/s: |s|, or sqrt(s1 s2) of two real roots; None if it is not there."""
    roots = list(roots_of(modes, mode).values())
    if not roots:
        return None
    return abs(roots[0]) if len(roots) == 1 else float(np.sqrt(abs(roots[0] * roots[1])))


def frequency_and_damping(pole: complex) -> tuple[float, float]:
    """Return natural frequency |s| in rad/s and damping ratio -Re(s)/|s| of a pole."""
    wn = abs(pole)
    return wn, -pole.real / wn if wn else 1.0


# --- all motions by name, followed over speed -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues and eigenvectors of one motion."""

    states: tuple[str, ...]  # (n,) names
    poles: NDArray[np.complex128]  # (n,) eigenvalues, rad/s; both of a conjugate pair
    # right, left: (n, n) eigenvectors in columns; the left ones scaled to left^H right = 1
    right: NDArray[np.complex128]
    left: NDArray[np.complex128]

    @property
    def participation(self) -> FloatArray:
        """(n, n) share of each state (row) in each eigenvalue (column); columns add up to 1."""
        share = np.abs(self.left.conj() * self.right)
        return np.asarray(share / share.sum(axis=0), np.float64)


Owners = Mapping[str, tuple[int, ...]]
"""Mode -> the numbers of its eigenvalues in a spectrum: two for a pair or the two real roots that it split into."""


def spectrum(model: LinearModel, motion: str, elastic: Mapping[int, str]) -> Spectrum:
    """Return the spectrum of the "longitudinal" motion or of the "lateral-directional" one, with its elastic modes.

    States: u, w, q, theta, or v, p, r, phi, and eta, etadot of the modes numbered in ``elastic``; what couples the two
    motions, and the change of the atmosphere with height, is left out.
    """
    rigid = _RIGID if motion == "longitudinal" else _LATERAL
    states = (*rigid, *(f"eta_{i}" for i in elastic), *(f"etadot_{i}" for i in elastic))
    return _spectrum(states, model.subsystem(states).A)


def _spectrum(states: tuple[str, ...], A: FloatArray) -> Spectrum:
    poles, left, right = eig(A, left=True, right=True)
    product = np.sum(left.conj() * right, axis=0)
    scale = np.where(np.abs(product) > 1e-12, product, 1e-12)  # zero where two eigenvalues meet in one eigenvector
    return Spectrum(states, np.asarray(poles, np.complex128), right, left / scale.conj())


def modes_by_law(model: LinearModel, motion: str, elastic: Mapping[int, str]) -> dict[str, tuple[complex, ...]]:
    """Return mode -> its poles where the aircraft flies by its own control law.

    They are followed by name from those without the law while what the law demands of the servos grows from nothing.

    Args:
        model: with states of the law, or of servos that it moves at once.
        motion: "longitudinal" or "lateral-directional".
        elastic: number -> name of the elastic modes of that motion.
    """
    alone = spectrum(model, motion, elastic)
    plane, surfaces = ("longitudinal", ("de",)) if motion == "longitudinal" else ("lateral", ("da", "dr"))
    law = [s for s in model.states if s.startswith(f"{LAW}{plane}") or s.removeprefix(SERVO) in surfaces]
    states = (*alone.states, *law)
    A = model.subsystem(states).A
    fed = np.zeros_like(A)
    for i, name in enumerate(states):
        if name.startswith(SERVO):
            fed[i] = np.where(np.arange(len(A)) == i, 0.0, A[i])
    before = _spectrum(states, A - fed)
    names = {n: [alone.poles[k] for k in owned] for n, owned in name_modes(alone, elastic).items()}
    owners: Owners = {n: tuple(int(np.argmin(np.abs(before.poles - s))) for s in own) for n, own in names.items()}
    for share in np.linspace(0.0, 1.0, _LAW_STEPS + 1)[1:]:
        after = _spectrum(states, A - (1.0 - share) * fed)
        owners, before = follow(before, owners, after), after
    return {name: poles_of(before, owned) for name, owned in owners.items()}


def name_modes(found: Spectrum, elastic: Mapping[int, str]) -> dict[str, tuple[int, ...]]:
    """Return which eigenvalues are which mode, from participation alone.

    An elastic mode owns the two eigenvalues that its eta and etadot take part in most, all modes taken together. Of the
    four that remain, the longitudinal ones are named as in :func:`longitudinal_modes`; the lateral-directional ones are
    the Dutch roll (the pair, or the two roots with least roll and bank), and, of the others, the roll mode (faster) and
    the spiral mode (slower), which may have joined into one pair.

    Raises:
        ModelError: there are not two eigenvalues for each elastic mode and four for the rigid motion.
    """
    n = found.poles.size
    if n != 4 + 2 * len(elastic):
        raise ModelError(f"a motion must have 4 + 2 x {len(elastic)} eigenvalues, got {n}")
    share = found.participation
    named: dict[str, list[int]] = {name: [] for name in elastic.values()}
    if elastic:
        rows = [[found.states.index(f"{kind}_{i}") for kind in ("eta", "etadot")] for i in elastic for _ in range(2)]
        slots, columns = linear_sum_assignment(-np.array([share[r].sum(axis=0) for r in rows]))
        for slot, k in zip(slots, columns, strict=True):
            list(named.values())[slot // 2].append(int(k))
    taken = {k for owned in named.values() for k in owned}
    rest = sorted((k for k in range(n) if k not in taken), key=lambda k: abs(found.poles[k]))
    rigid = _lateral_owners(found, rest) if "phi" in found.states else _longitudinal_owners(found, rest)
    return {**rigid, **{name: tuple(owned) for name, owned in named.items()}}


def _longitudinal_owners(found: Spectrum, rest: Sequence[int]) -> dict[str, tuple[int, ...]]:
    """Return the owners of four eigenvalues by their shape: of the short period those in which w and q take part."""
    pairs = [k for k in rest if abs(found.poles[k].imag) > 1e-9]
    pitching = found.participation[[found.states.index("w"), found.states.index("q")]].sum(axis=0)
    if len(pairs) == 2:  # neither is torn apart
        real = [k for k in rest if k not in pairs]
        slow, fast = sorted((pairs, real), key=lambda owned: float(pitching[owned].mean()))
        return {"phugoid": tuple(slow), "short period": tuple(fast)}
    # A conjugate has the same shape up to rounding.
    ordered = sorted(rest, key=lambda k: (round(float(pitching[k]), 6), abs(found.poles[k]), k))
    return {"phugoid": tuple(ordered[:2]), "short period": tuple(ordered[2:])}


def _lateral_owners(found: Spectrum, rest: Sequence[int]) -> dict[str, tuple[int, ...]]:
    pairs = [k for k in rest if abs(found.poles[k].imag) > 1e-9]
    if len(pairs) == 2:
        dutch = pairs
    else:  # no pair, or roll and spiral have joined as well
        rolling = found.participation[[found.states.index("p"), found.states.index("phi")]].sum(axis=0)
        dutch = sorted(sorted(rest, key=lambda k: (round(float(rolling[k]), 9), k))[:2])
    others = [k for k in rest if k not in dutch]
    return {"Dutch roll": tuple(dutch), "roll": (others[1],), "spiral": (others[0],)}


def follow(before: Spectrum, owners: Owners, after: Spectrum) -> dict[str, tuple[int, ...]]:
    """Return which eigenvalues of a neighbouring condition continue the modes of this one.

    The eigenvalues are assigned one to one at least total cost 1 - S + 2 |s' - s| / (|s'| + |s|). The similarity
    S = |l^H r'| |l'^H r| of left and right eigenvectors is 1 for the same mode and 0 for another one of the same
    system, whatever the units of the states. So names keep to the motion where frequencies cross, and a pair that
    splits into two real roots keeps its name.
    """
    likeness = np.abs(before.left.conj().T @ after.right) * np.abs(after.left.conj().T @ before.right).T
    s, t = before.poles[:, None], after.poles[None, :]
    away = 2.0 * np.abs(t - s) / np.maximum(np.abs(t) + np.abs(s), 1e-9)
    _, successor = linear_sum_assignment(1.0 - np.minimum(likeness, 1.0) + away)
    return {name: tuple(int(successor[k]) for k in owned) for name, owned in owners.items()}


def poles_of(found: Spectrum, owned: Sequence[int]) -> tuple[complex, ...]:
    """Return the poles of a mode: one (imaginary part not negative) for a pair or a single root, else two."""
    upper = sorted((complex(found.poles[k].real, abs(found.poles[k].imag)) for k in owned), key=abs)
    return (upper[0],) if len(upper) == 2 and abs(upper[0] - upper[1]) <= 1e-9 * abs(upper[1]) else tuple(upper)


# --- which identified pole is which mode ------------------------------------------------------------------------------


@dataclass(frozen=True)
class PoleMatch:
    """One mode and the pole that was found for it."""

    name: str  # the mode
    true: complex  # its pole, rad/s, imaginary part not negative
    found: complex | None  # the identified pole, or None if none lies near
    wn_error_percent: float | None  # 100 (|found| / |true| - 1), or None
    zeta_error: float | None  # damping ratio found minus true, or None
    outputs: str = ""  # the outputs whose poles were searched

    @property
    def off(self) -> float:
        """Distance of the pole that was found from the true one, relative to that; infinite where none was."""
        return math.inf if self.found is None else abs(self.found - self.true) / abs(self.true)


def words_of(quantity: str) -> str:
    """Return "the fast root of the short period", "the phugoid" or "the prediction of V, q"."""
    name, _, root = quantity.partition(", ")
    if root.endswith(" root"):
        return f"the {root} of the {name}"
    return f"the {quantity}" if " " in quantity or quantity == "phugoid" else quantity


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


# --- the modes of one motion by name ----------------------------------------------------------------------------------


def elastic_modes(aircraft: Aircraft, plane: str) -> dict[int, str]:
    """Return number -> name of the elastic modes that belong to a plane; equal names carry their number."""
    elastic = aircraft.flown_modes()
    modes = elastic.modes if elastic else ()
    names = [m.name for m in modes]
    wanted = "symmetric" if plane == "longitudinal" else "asymmetric"
    return {
        i: m.name if names.count(m.name) == 1 else f"{m.name} ({i})"
        for i, m in enumerate(modes, 1)
        if m.symmetry == wanted
    }


def modes_of(linear: LinearModel, aircraft: Aircraft, plane: str) -> dict[str, complex]:
    """Return name -> pole, rad/s, of the motion in one plane, its elastic modes included; slow ones first."""
    elastic = elastic_modes(aircraft, plane)
    if plane == "longitudinal":
        return longitudinal_modes(linear, elastic)
    found = spectrum(linear, "lateral-directional", elastic)
    out: dict[str, complex] = {}
    for name, owned in name_modes(found, elastic).items():
        poles = poles_of(found, owned)
        roots = ("", ", fast root") if len(poles) == 1 else (", slow root", ", fast root")
        out |= {f"{name}{text}": pole for text, pole in zip(roots, poles, strict=False)}
    return dict(sorted(out.items(), key=lambda item: abs(item[1])))
