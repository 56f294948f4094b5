"""An aircraft over its speed range: trims, linear models, modes followed by name, onset of instability, derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from testbench.aircraft import Aircraft
from testbench.aircraft.elastic import UNSTEADY, ElasticModel, reduced_frequency, with_wake
from testbench.aircraft.geometry.coefficients import ROWS
from testbench.core.atmosphere import air_density
from testbench.core.errors import TrimError
from testbench.core.record import FloatArray
from testbench.evaluation.modes import Spectrum, follow, frequency_and_damping, name_modes, poles_of, spectrum
from testbench.flight import FlightCondition, LinearModel, TrimmedFlight, linearise, trim

MOTIONS = ("longitudinal", "lateral-directional")
_SCAN = 15  # speeds tried over the limits before the ends of the trimmable range are searched for
_INTERVALS = 40  # of the speeds that modes are followed over
_TABLED = 10  # speeds of a table, at least


@dataclass(frozen=True)
class Untrimmed:
    """A speed at which no trim was found, and why."""

    V_m_s: float
    reason: str


@dataclass(frozen=True)
class Onset:
    """Where an elastic mode becomes unstable with rising speed."""

    name: str  # the mode
    # interpolated speed of zero damping; the slowest speed if it is unstable there already; None if it is stable at
    # every speed
    V_m_s: float | None
    f_hz: float  # frequency there; 0 for divergence
    kind: str  # "flutter" (an oscillatory pole), "divergence" (a real one) or "none"
    V_last_m_s: float  # fastest speed that was examined
    at_start: bool = False  # it is unstable at the slowest speed already
    std_m_s: float | None = None  # standard deviation of the speed by :data:`PRIORS`; None where it is not known
    # the same in air that lags, for a mode whose reduced frequency at the design speed exceeds 0.1; else None
    wake: Onset | None = None

    @property
    def sentence(self) -> str:
        """The finding in words."""
        said = f"{self.name}: {self._words}"
        if self.wake is not None and (self.V_m_s is not None or self.wake.V_m_s is not None):
            said += f", in the quasi-steady air that flies; in air that lags {self.wake._words}"
        return said

    @property
    def _words(self) -> str:
        if self.V_m_s is None:
            return f"none up to {self.V_last_m_s:g} m/s"
        where = f"unstable already at {self.V_m_s:.4g} m/s, the slowest speed" if self.at_start else (
            f"unstable from {self.V_m_s:.3g}{f' ± {self.std_m_s:.2g}' if self.std_m_s is not None else ''} m/s"
        )  # fmt: skip
        how = f"flutter at {self.f_hz:.2f} Hz" if self.kind == "flutter" else "divergence"
        return f"{where} ({how})"


@dataclass(frozen=True, eq=False)
class Envelope:
    """Trims, linear models and modes at each speed that could be trimmed, in order of speed."""

    aircraft: Aircraft  # what was flown
    h_m: float  # altitude above sea level, m
    speeds: tuple[float, ...]  # (n,) true airspeeds, m/s, ascending
    # trims, models: (n,) trimmed flights and linear models
    trims: tuple[TrimmedFlight, ...]
    models: tuple[LinearModel, ...]
    # (n,) mode -> its poles, rad/s: one with imaginary part not negative, or the two roots it has split into
    poles: tuple[Mapping[str, tuple[complex, ...]], ...]
    motion: Mapping[str, str]  # mode -> "longitudinal" or "lateral-directional"
    elastic: Mapping[str, int]  # elastic mode -> its number
    untrimmed: tuple[Untrimmed, ...] = ()  # speeds that were asked for and cannot be flown
    # elastic mode -> its poles (n, 1 + m), after the nominal ones those with each of :data:`PRIORS` one deviation up;
    # first in quasi-steady air and then, where its reduced frequency at the design speed exceeds 0.1, in air that lags
    varied: Mapping[str, tuple[NDArray[np.complex128], ...]] = field(default_factory=dict)

    def nearest(self, V_m_s: float) -> int:
        """Return the index of the trimmed speed nearest to ``V_m_s``."""
        return int(np.argmin(np.abs(np.array(self.speeds) - V_m_s)))

    @property
    def design(self) -> int:
        """Place of the trimmed speed nearest to the design speed."""
        return self.nearest(self.aircraft.design_V_m_s)

    def names(self, motion: str, elastic: bool) -> list[str]:
        """Return the elastic, or the rigid, modes of a motion."""
        return [n for n, m in self.motion.items() if m == motion and (n in self.elastic) == elastic]

    def history(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return natural frequency |s| / 2 pi in Hz and damping ratio of a mode, each (n, 2).

        The second column is NaN except where the mode has split into two roots.
        """
        f, zeta = np.full((len(self.speeds), 2), np.nan), np.full((len(self.speeds), 2), np.nan)
        for k, found in enumerate(self.poles):
            for j, pole in enumerate(found[name]):
                wn, zeta[k, j] = frequency_and_damping(pole)
                f[k, j] = wn / (2.0 * np.pi)
        return f, zeta

    def onset(self, name: str) -> Onset:
        """Return where the elastic mode ``name`` becomes unstable, damping interpolated linearly between speeds."""
        if name not in self.varied:
            return _onset(name, self.speeds, [max(found[name], key=lambda s: s.real) for found in self.poles])
        flown, *lagging = (_with_band(name, self.speeds, poles) for poles in self.varied[name])
        return replace(flown, wake=lagging[0] if lagging else None)


def _with_band(name: str, speeds: Sequence[float], poles: NDArray[np.complex128]) -> Onset:
    """Return the onset of the first column of poles, its deviation the root of the sum of squares of what moves it."""
    first = _onset(name, speeds, list(poles[:, 0]))
    if first.V_m_s is None or first.at_start:
        return first
    moved = [_onset(name, speeds, list(column)).V_m_s for column in poles.T[1:]]
    return replace(first, std_m_s=float(np.sqrt(sum(((V or speeds[-1]) - first.V_m_s) ** 2 for V in moved))))


def _onset(name: str, speeds: Sequence[float], worst: Sequence[complex]) -> Onset:
    """Return where the poles of a mode, one at each speed, become unstable."""
    last = speeds[-1]
    for k, pole in enumerate(worst):
        if pole.real <= 0.0:
            continue
        kind = "flutter" if pole.imag > 1e-9 else "divergence"
        wn, zeta = frequency_and_damping(pole)
        f = wn / (2.0 * np.pi) if kind == "flutter" else 0.0
        if k == 0:
            return Onset(name, speeds[0], f, kind, last, at_start=True)
        wn_before, zeta_before = frequency_and_damping(worst[k - 1])
        if kind == "divergence" or worst[k - 1].imag <= 1e-9:  # a real root's damping ratio jumps from 1 to -1
            share = worst[k - 1].real / (worst[k - 1].real - pole.real)
        else:
            share = zeta_before / (zeta_before - zeta)
            f = (wn_before + share * (wn - wn_before)) / (2.0 * np.pi)
        before = speeds[k - 1]
        return Onset(name, before + share * (speeds[k] - before), f, kind, last)
    return Onset(name, None, 0.0, "none", last)


PRIORS = {"f_hz": 0.02, "zeta": 0.3, "mass_kg_m2": 0.1, "lift": ROWS["CL_alpha"].spread}
"""Relative standard deviations of a mode's numbers and of the lift on it; all judged but that of lift."""
_STEPS = 12  # from no lag to all of it, in which a pole is followed


def _varied_poles(
    aircraft: Aircraft,
    h_m: float,
    models: Sequence[LinearModel],
    speeds: Sequence[float],
    states: tuple[str, ...],
    poles: Sequence[Mapping[str, tuple[complex, ...]]],
    members: Mapping[int, str],
) -> dict[str, tuple[NDArray[np.complex128], ...]]:
    """Return what :class:`Envelope` calls ``varied``, of the modes of one motion.

    Each pole is followed from the quasi-steady one while the lag grows, and from either to each varied aircraft, of
    which there are none where all is stable.
    """
    elastic, names = aircraft.flown_modes(), list(members.values())
    if elastic is None or not names:
        return {}
    at = [(m.subsystem(states).A, 0.5 * air_density(h_m) * V**2, V) for m, V in zip(models, speeds, strict=True)]
    found = np.array([[max(one[n], key=lambda s: s.real) for n in names] for one in poles])
    columns = []
    for share in np.linspace(0.0, 1.0, _STEPS + 1):
        found = np.array([
            _nearest(with_wake(A, states, elastic, q, V, share), row)
            for (A, q, V), row in zip(at, found, strict=True)
        ])  # fmt: skip
        if share in (0.0, 1.0):
            rows = [
                [row, *(_nearest(with_wake(*one, q, V, share), row) for one in _varied(A, states, elastic))]
                if np.any(found.real > 0.0) else [row]
                for (A, q, V), row in zip(at, found, strict=True)
            ]  # fmt: skip
            columns.append(np.moveaxis(np.array(rows), 2, 0))
    lagging = {n for i, n in members.items() if reduced_frequency(elastic, i, aircraft.design_V_m_s) > UNSTEADY}
    return {n: tuple(c[k] for c in columns[: 2 if n in lagging else 1]) for k, n in enumerate(names)}


def _nearest(A: FloatArray, poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the eigenvalue that is nearest to each pole."""
    found = np.linalg.eigvals(A)
    return np.asarray(found[np.argmin(np.abs(found[:, None] - poles), axis=0)])


def _varied(
    A: FloatArray, states: tuple[str, ...], elastic: ElasticModel
) -> Iterator[tuple[FloatArray, tuple[str, ...], ElasticModel]]:
    """Yield the linear model and its modes with each of PRIORS one deviation up, mode by mode, the lift for all."""
    numbers = [int(s.removeprefix("etadot_")) for s in states if s.startswith("etadot_")]
    for key, d in PRIORS.items():
        for moved in [numbers] if key == "lift" else [[i] for i in numbers]:
            modes, out = list(elastic.modes), A.copy()
            for i in moved:
                was = modes[i - 1]
                now = was if key == "lift" else replace(was, **{key: (1.0 + d) * getattr(was, key)})
                row, columns = states.index(f"etadot_{i}"), [states.index(f"{n}_{i}") for n in ("eta", "etadot")]
                structure = [np.array([-(m.omega_rad_s**2), -2.0 * m.zeta * m.omega_rad_s]) for m in (was, now)]
                out[row, columns] -= structure[0]
                out[row] *= was.mass_kg_m2 / now.mass_kg_m2 * (1.0 + d if key == "lift" else 1.0)
                out[row, columns] += structure[1]
                modes[i - 1] = now
            size = elastic.S_m2 * (1.0 + d if key == "lift" else 1.0)
            yield out, states, replace(elastic, modes=tuple(modes), S_m2=size)


def fly_envelope(aircraft: Aircraft, speeds: Sequence[float], h_m: float | None = None) -> Envelope:
    """Trim and linearise at every speed, and follow the modes by name from the design speed to both ends.

    Args:
        aircraft: what is flown.
        speeds: true airspeeds, m/s; order and repetition do not matter.
        h_m: altitude, m; the design altitude if none is given.

    Trims and models are those of the airframe: a control law of the model's own changes no trim, and is left out.

    Raises:
        TrimError: not one of the speeds can be trimmed.
    """
    height, airframe = aircraft.design_h_m if h_m is None else h_m, aircraft.commanded_at("surface")
    trims: list[TrimmedFlight] = []
    untrimmed: list[Untrimmed] = []
    for V in sorted(set(map(float, speeds))):
        try:
            trims.append(trim(airframe, FlightCondition(V, height)))
        except TrimError as error:
            untrimmed.append(Untrimmed(V, error.message))
    if not trims:
        raise TrimError(
            f"{aircraft.name} must trim at one speed at least, got none of {len(untrimmed)} at {height:g} m; "
            f"{untrimmed[0].reason if untrimmed else 'give a speed'}"
        )
    models = tuple(linearise(airframe, t) for t in trims)
    flown = tuple(t.condition.V_m_s for t in trims)
    start = int(np.argmin(np.abs(np.array(flown) - aircraft.design_V_m_s)))
    poles: list[dict[str, tuple[complex, ...]]] = [{} for _ in flown]
    motion: dict[str, str] = {}
    varied: dict[str, tuple[NDArray[np.complex128], ...]] = {}
    named = _elastic_names(aircraft)
    for which, symmetry in zip(MOTIONS, ("symmetric", "asymmetric"), strict=True):
        members = {i: name for i, (name, s) in named.items() if s == symmetry}
        found = [spectrum(m, which, members) for m in models]
        for k, owners in enumerate(_followed(found, members, start)):
            poles[k] |= {name: poles_of(found[k], owned) for name, owned in owners.items()}
            motion |= dict.fromkeys(owners, which)
        varied |= _varied_poles(aircraft, height, models, flown, found[0].states, poles, members)
    elastic = {name: i for i, (name, _) in named.items()}
    return Envelope(
        aircraft, height, flown, tuple(trims), models, tuple(poles), motion, elastic, tuple(untrimmed), varied
    )


def _elastic_names(aircraft: Aircraft) -> dict[int, tuple[str, str]]:
    """Return number -> (name, symmetry) of the modes; equal names are told apart by their number."""
    flown = aircraft.flown_modes()
    modes = flown.modes if flown else ()
    names = [m.name for m in modes]
    return {i: (m.name if names.count(m.name) == 1 else f"{m.name} ({i})", m.symmetry) for i, m in enumerate(modes, 1)}


def _followed(found: Sequence[Spectrum], members: Mapping[int, str], start: int) -> list[Mapping[str, tuple[int, ...]]]:
    owners: list[Mapping[str, tuple[int, ...]]] = [{} for _ in found]
    owners[start] = name_modes(found[start], members)
    for k in range(start + 1, len(found)):
        owners[k] = follow(found[k - 1], owners[k - 1], found[k])
    for k in range(start - 1, -1, -1):
        owners[k] = follow(found[k + 1], owners[k + 1], found[k])
    return owners


# --- which speeds -----------------------------------------------------------------------------------------------------


# --- everything that is said of an aircraft ---------------------------------------------------------------------------

# Speeds of the frequency responses in Barbosa, Goes et al. (2020), figure 8.
_RESPONSE_SPEEDS = {"eolo": (13.0, 16.0, 19.0, 22.0, 25.0)}
