"""An aircraft over its speed range: trims, linear models, modes followed by name, onset of instability, derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import TrimError
from testbench.core.record import FloatArray
from testbench.evaluation.modes import (
    Spectrum,
    follow,
    frequency_and_damping,
    name_modes,
    poles_of,
    spectrum,
)
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
    """Where an elastic mode becomes unstable with rising speed.

    Attributes:
        name: the mode.
        V_m_s: interpolated speed of zero damping; the slowest speed if it is unstable there already; None if it is
            stable at every speed.
        f_hz: frequency there; 0 for divergence.
        kind: "flutter" (an oscillatory pole), "divergence" (a real one) or "none".
        V_last_m_s: fastest speed that was examined.
        at_start: it is unstable at the slowest speed already.
    """

    name: str
    V_m_s: float | None
    f_hz: float
    kind: str
    V_last_m_s: float
    at_start: bool = False

    @property
    def sentence(self) -> str:
        """The finding in words."""
        if self.V_m_s is None:
            return f"{self.name}: none up to {self.V_last_m_s:g} m/s"
        where = f"unstable already at {self.V_m_s:.4g} m/s, the slowest speed" if self.at_start else (
            f"unstable from {self.V_m_s:.3g} m/s"
        )  # fmt: skip
        how = f"flutter at {self.f_hz:.2f} Hz" if self.kind == "flutter" else "divergence"
        return f"{self.name}: {where} ({how})"


@dataclass(frozen=True, eq=False)
class Envelope:
    """Trims, linear models and modes at each speed that could be trimmed, in order of speed.

    Attributes:
        aircraft: what was flown.
        h_m: altitude above sea level, m.
        speeds: (n,) true airspeeds, m/s, ascending.
        trims, models: (n,) trimmed flights and linear models.
        poles: (n,) mode -> its poles, rad/s: one with imaginary part not negative, or the two roots it has split into.
        motion: mode -> "longitudinal" or "lateral-directional".
        elastic: elastic mode -> its number.
        untrimmed: speeds that were asked for and cannot be flown.
    """

    aircraft: Aircraft
    h_m: float
    speeds: tuple[float, ...]
    trims: tuple[TrimmedFlight, ...]
    models: tuple[LinearModel, ...]
    poles: tuple[Mapping[str, tuple[complex, ...]], ...]
    motion: Mapping[str, str]
    elastic: Mapping[str, int]
    untrimmed: tuple[Untrimmed, ...] = ()

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
        worst = [max(found[name], key=lambda s: s.real) for found in self.poles]
        last = self.speeds[-1]
        for k, pole in enumerate(worst):
            if pole.real <= 0.0:
                continue
            kind = "flutter" if pole.imag > 1e-9 else "divergence"
            wn, zeta = frequency_and_damping(pole)
            f = wn / (2.0 * np.pi) if kind == "flutter" else 0.0
            if k == 0:
                return Onset(name, self.speeds[0], f, kind, last, at_start=True)
            wn_before, zeta_before = frequency_and_damping(worst[k - 1])
            if kind == "divergence" or worst[k - 1].imag <= 1e-9:  # a real root's damping ratio jumps from 1 to -1
                share = worst[k - 1].real / (worst[k - 1].real - pole.real)
            else:
                share = zeta_before / (zeta_before - zeta)
                f = (wn_before + share * (wn - wn_before)) / (2.0 * np.pi)
            before = self.speeds[k - 1]
            return Onset(name, before + share * (self.speeds[k] - before), f, kind, last)
        return Onset(name, None, 0.0, "none", last)


def fly_envelope(aircraft: Aircraft, speeds: Sequence[float], h_m: float | None = None) -> Envelope:
    """Trim and linearise at every speed, and follow the modes by name from the design speed to both ends.

    Args:
        aircraft: what is flown.
        speeds: true airspeeds, m/s; order and repetition do not matter.
        h_m: altitude, m; the design altitude if none is given.

    Raises:
        TrimError: not one of the speeds can be trimmed.
    """
    height = aircraft.design_h_m if h_m is None else h_m
    trims: list[TrimmedFlight] = []
    untrimmed: list[Untrimmed] = []
    for V in sorted(set(map(float, speeds))):
        try:
            trims.append(trim(aircraft, FlightCondition(V, height)))
        except TrimError as error:
            untrimmed.append(Untrimmed(V, error.message))
    if not trims:
        raise TrimError(
            f"{aircraft.name} must trim at one speed at least, got none of {len(untrimmed)} at {height:g} m; "
            f"{untrimmed[0].reason if untrimmed else 'give a speed'}"
        )
    models = tuple(linearise(aircraft, t) for t in trims)
    flown = tuple(t.condition.V_m_s for t in trims)
    start = int(np.argmin(np.abs(np.array(flown) - aircraft.design_V_m_s)))
    poles: list[dict[str, tuple[complex, ...]]] = [{} for _ in flown]
    motion: dict[str, str] = {}
    named = _elastic_names(aircraft)
    for which, symmetry in zip(MOTIONS, ("symmetric", "asymmetric"), strict=True):
        members = {i: name for i, (name, s) in named.items() if s == symmetry}
        found = [spectrum(m, which, members) for m in models]
        for k, owners in enumerate(_followed(found, members, start)):
            poles[k] |= {name: poles_of(found[k], owned) for name, owned in owners.items()}
            motion |= dict.fromkeys(owners, which)
    elastic = {name: i for i, (name, _) in named.items()}
    return Envelope(aircraft, height, flown, tuple(trims), models, tuple(poles), motion, elastic, tuple(untrimmed))


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
