"""What is drawn for each draw, as a function of the seed, its number and the attempt alone; and its split, by hash.

The true figures of a flight: derivatives and modes of the aircraft that flew, at the condition that it flew at.

THE table of what a data set hides: effects of the library, and the range that the sizes of each are drawn from.

Levels name them in ``hidden``. Of effects without a row, each size is drawn about one that the library starts from.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.generators import keyed_generator
from testbench.effects import Effect, catalogue
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.modes import frequency_and_damping, longitudinal_modes
from testbench.flight import LinearModel, TrimmedFlight, load_aircraft
from testbench.questions.campaign.draws import draw_value
from testbench.questions.dataset.scenario import DatasetScenario, Level
from testbench.sensors import load_suite

Ranges = tuple[float, ...]
"""Low, high; or low, high, low, high of two intervals, of which each draw takes one."""
_ABOUT = 0.7, 1.4  # times a size that the library starts from, counted from where the effect vanishes


@dataclass(frozen=True)
class Kind:
    """One row."""

    sizes: Mapping[str, Ranges]  # parameter of the effect -> range of its values (SI), uniform
    also: tuple[str, ...] = ()  # names that are as right as the effect's own, as such flights do not tell them apart


def _row(also: str = "", **sizes: Ranges) -> Kind:
    return Kind(sizes, tuple(also.split()))


KINDS: Mapping[str, Kind] = {
    "actuator_lag": _row(lag_rad_s=(7.0, 22.0)),
    "second_order_actuator": _row(omega_rad_s=(10.0, 30.0), zeta=(0.4, 1.1)),
    "rate_limit": _row(limit_rad_s=(0.12, 0.35)),
    "asymmetric_rate_limit": _row(down_rad_s=(0.2, 0.28), up_rad_s=(0.35, 0.55)),
    "transport_delay": _row(delay_s=(0.03, 0.12)),
    "free_play": _row(width_rad=(0.012, 0.035)),
    "dead_band": _row(half_width_rad=(0.005, 0.015)),
    "surface_scale": _row(scale=(0.45, 0.65, 1.3, 1.5)),
    "thrust_line": _row(z_m=(-0.06, -0.015, 0.015, 0.06)),
    "thrust_lag": _row(lag_s=(0.3, 1.5)),
    "thrust_scale": _row(scale=(0.6, 0.75, 1.35, 1.6)),
    "throttle_scale": _row(scale=(0.6, 0.75, 1.35, 1.6)),
    "thrust_lapse": _row(scale=(0.95, 1.05), k=(0.5, 1.0)),
    "slipstream": _row(k=(1.5, 4.0)),
    "cg_shift": _row(aft_chords=(0.02, 0.06)),
    "mass_error": _row("payload", factor=(1.15, 1.5)),
    "drag_increment": _row(CD=(0.02, 0.06)),
    "alpha_dot": _row("wake_lag", Cm_alphadot=(-14.0, -6.0)),
    "pitch_damper": _row(gain_s=(0.08, 0.3)),
    "washed_pitch_damper": _row("pitch_damper", gain_s=(0.1, 0.3), washout_rad_s=(0.5, 1.0)),
    "filtered_pitch_damper": _row("pitch_damper", gain_s=(0.1, 0.3), lag_s=(0.05, 0.12)),
    "stall": _row("stall_hysteresis", alpha_rad=(0.11, 0.15), sharpness=(12.0, 30.0), CD=(0.01, 0.03)),
    "nonlinear_lift": _row(CL_alpha2=(-8.0, -3.0)),
    "curved_moment": _row(Cm_alpha2=(-1.5, -0.5)),
    "speed_effectiveness": _row(k=(-1.2, -0.4, 0.4, 1.2), curve=(-0.1, 0.1)),
    "elevator_mode": _row(f_hz=(3.0, 8.0), Cm_eta=(0.1, 0.3)),
    "alpha_scale": _row(scale=(0.8, 0.9, 1.1, 1.25)),
    "alpha_lag": _row(lag_s=(0.06, 0.25)),
    "q_scale": _row(scale=(0.8, 0.93, 1.07, 1.25)),
    "theta_delay": _row(delay_s=(0.05, 0.2)),
    "V_lag": _row(lag_s=(0.2, 0.9)),
    "V_scale": _row(scale=(0.8, 0.9, 1.1, 1.25)),
    "az_position": _row(ahead_m=(-0.5, -0.15, 0.15, 0.5)),
    "gust": _row(amplitude_m_s=(-4.0, -1.5, 1.5, 4.0), start_s=(1.0, 4.0), duration_s=(0.6, 2.0)),
}


def right_names(effect: str) -> tuple[str, ...]:
    """Return the names that are right where an effect is hidden, its own first."""
    return effect, *(KINDS[effect].also if effect in KINDS else ())


def draw_sizes(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Return a value (SI) of every parameter of an effect, by its row or about one that the library starts from."""
    row, out = KINDS.get(effect.name, Kind({})).sizes, {}
    for p in effect.parameters:
        if p.name not in row:
            zero, start = p.none or 0.0, float(rng.choice(p.starts))
            x = zero + float(rng.uniform(*_ABOUT)) * (start - zero)
        else:
            ranges = row[p.name]
            low, high = ranges[:2] if len(ranges) == 2 or rng.random() < 0.5 else ranges[2:]
            x = float(rng.uniform(low, high))
        out[p.name] = min(max(x, p.low), p.high)
    return out


def true_figures(aircraft: Aircraft, linear: LinearModel, trimmed: TrimmedFlight) -> dict[str, tuple[float, str]]:
    """Return name -> value and unit of every derivative and of frequency and damping of every longitudinal mode.

    Derivatives are those of :func:`testbench.evaluation.derivatives.dimensional_derivatives`; if elastic modes move,
    with these in static equilibrium. A mode that has split into two real roots s1, s2 has wn = sqrt(s1 s2) and zeta =
    -(s1 + s2) / (2 wn).

    Args:
        aircraft: that flew.
        linear: its linear model about the trim.
        trimmed: its trim.
    """
    out = {d.name: (d.held if d.static is None else d.static, d.unit) for d in dimensional_derivatives(linear, trimmed)}
    elastic = aircraft.flown_modes()
    symmetric = {i: m.name for i, m in enumerate(elastic.modes if elastic else (), 1) if m.symmetry == "symmetric"}
    for name, (wn, zeta) in _modes(longitudinal_modes(linear, symmetric)).items():
        out[f"{name} wn"] = wn, "rad/s"
        out[f"{name} zeta"] = zeta, ""
    return out


def _modes(poles: Mapping[str, complex]) -> dict[str, tuple[float, float]]:
    """Return mode -> natural frequency and damping ratio; NaN for two real roots of different sign."""
    roots: dict[str, list[complex]] = {}
    for name, pole in poles.items():
        roots.setdefault(name.split(", ")[0], []).append(pole)
    out = {}
    for name, of in roots.items():
        if len(of) == 1:
            out[name] = frequency_and_damping(of[0])
            continue
        product = (of[0] * of[1]).real
        wn = math.sqrt(product) if product > 0.0 else math.nan
        out[name] = wn, -(of[0] + of[1]).real / (2.0 * wn)
    return out


MOST_HIDDEN = 2
"""Effects that act together at most."""


@dataclass(frozen=True)
class Draw:
    """One draw: everything that its flights share."""

    number: int  # of the draw
    attempt: int  # 0, or how many draws of this number could not fly
    level: Level  # its level
    aircraft: str  # its name
    # V_m_s, h_m: condition of its trim
    V_m_s: float
    h_m: float
    turbulence_rms_m_s: float  # of the air
    scale: float  # of the inputs
    values: Mapping[str, Any]  # key of a campaign -> what was drawn for it
    kinds: tuple[str, ...]  # names of the hidden effects
    sizes: tuple[Mapping[str, float], ...]  # parameter -> value (SI), of each
    seed: int  # of noise and air; flight k has ``seed + k``

    def told(self) -> dict[str, Any]:
        """Return what was drawn for an attempt, as JSON takes it: number, names, and values by their keys."""
        condition = {k: getattr(self, k) for k in ("V_m_s", "h_m", "turbulence_rms_m_s", "scale")}
        sizes = {f"{k} {n}": x for k, of in zip(self.kinds, self.sizes, strict=True) for n, x in of.items()}
        return {
            "draw": self.number,
            "attempt": self.attempt,
            "level": self.level.name,
            "aircraft": Path(self.aircraft).name,
            "effect": " + ".join(self.kinds),
            "values": {**condition, **self.values, **sizes},
        }

    @property
    def share(self) -> float:
        """Hash of what was drawn, 0 to 1: equal draws have one hash, whatever their number and noise."""
        return hash_share(
            [self.aircraft, self.level.wings, self.V_m_s, self.h_m, dict(self.values), self.kinds, list(self.sizes)]
        )


def hash_share(drawn: Any) -> float:
    """Return a number from 0 to 1 by the SHA-256 of what was drawn, as JSON."""
    text = json.dumps(drawn, sort_keys=True, default=dict)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") / 2.0**64


@lru_cache(maxsize=32)
def aircraft_of(name: str, wings: str) -> Aircraft:
    """Return an aircraft, loaded once per process."""
    return load_aircraft(name, wings)


def draw(scenario: DatasetScenario, number: int, attempt: int) -> Draw:
    """Return draw ``number`` of a data set; its level does not depend on the attempt."""

    def generator(what: str) -> np.random.Generator:
        return keyed_generator(scenario.seed, number, f"{what}/{attempt}")

    shares = np.array([level.share for level in scenario.level])
    chosen = int(keyed_generator(scenario.seed, number, "level").choice(len(shares), p=shares / shares.sum()))
    level = scenario.level[chosen]
    name = str(generator("aircraft").choice(list(level.aircraft)))
    ratio, h, scale, rms = (
        float(generator(key).uniform(*getattr(level, key)))
        for key in ("speed_ratio", "h_m", "scale", "turbulence_rms_m_s")
    )
    hidden = generator("hidden")
    kinds = tuple(str(hidden.choice(list(level.hidden))).split(" + ")) if level.hidden else ()
    known = catalogue(load_suite(scenario.suite)) if kinds else {}
    return Draw(
        number=number,
        attempt=attempt,
        level=level,
        aircraft=name,
        V_m_s=ratio * aircraft_of(name, level.wings).design_V_m_s,
        h_m=h,
        turbulence_rms_m_s=rms,
        scale=scale,
        values={key: draw_value(law, scenario.seed, number, f"{key}/{attempt}") for key, law in level.vary.items()},
        kinds=kinds,
        sizes=tuple(draw_sizes(known[kind], hidden) for kind in kinds),
        seed=int(generator("seed").integers(1, 2**31 - 10**6)),
    )
