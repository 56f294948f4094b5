"""Candidate inputs: every signal family over its free quantities, at unit amplitude."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import (
    BinaryNoise,
    Control,
    Doublet,
    Input,
    Multisine,
    Multistep,
    Prbs,
    Pulse,
    StandardMultistep,
    Sweep,
)
from testbench.inputs import build

UNIT_DEG = 1.0 / DEG_RAD
"""An amplitude of 1 rad: candidates are scaled afterwards."""

_SPACINGS: tuple[Literal["linear"], Literal["exponential"]] = ("linear", "exponential")
_UNITS: dict[Literal["3211", "211", "123"], float] = {"3211": 7.0, "211": 4.0, "123": 6.0}


@dataclass(frozen=True, eq=False)
class Candidate:
    """One input at unit amplitude.

    Attributes:
        family: name of the signal.
        words: its free quantities in words.
        specs: entries of a scenario that make it, amplitude 1 (rad or 1).
        u: (samples, m) its samples at the design's rate, one column per control.
    """

    family: str
    words: str
    specs: tuple[Input, ...]
    u: FloatArray

    def scaled(self, factor: float) -> tuple[Input, ...]:
        """Return the scenario entries at ``factor`` times the amplitude."""
        return tuple(_scaled(spec, factor) for spec in self.specs)


def _scaled(spec: Input, factor: float) -> Input:
    key = "amplitude_percent" if spec.control == "thr" else "amplitude_deg"
    return spec.model_copy(update={key: round(float(getattr(spec, key)) * float(factor), 6)})


def amplitude_key(control: Control) -> dict[str, float]:
    """Return the keyword that gives a control unit amplitude."""
    return {"amplitude_percent": 100.0} if control == "thr" else {"amplitude_deg": UNIT_DEG}


def families(
    control: Control,
    duration_s: float,
    shortest_s: float,
    band_hz: tuple[float, float],
    rate_hz: float,
    by_hand: bool,
    start_s: float = 0.0,
) -> Iterator[tuple[str, str, Input]]:
    """Yield (family, words, entry) of every signal family over its free quantities.

    Args:
        control: the control that moves.
        duration_s: longest manoeuvre.
        shortest_s: shortest step that can be held, or shortest half period of a sine.
        band_hz: band of the targets, for sweeps and multisines.
        rate_hz: of the design.
        by_hand: leave out inputs that a pilot cannot fly (multisines and binary noise).
        start_s: when the input starts.
    """
    common: dict[str, Any] = {"control": control, "start_s": start_s, **amplitude_key(control)}
    left = duration_s - start_s

    def steps(units: float, count: int = 16) -> FloatArray:
        longest = left / units
        return np.geomspace(shortest_s, longest, count) if longest >= shortest_s else np.zeros(0)

    for width in steps(1.0, 10):
        if width < 0.9 * left:
            yield "pulse", f"{_tidy(width):.4g} s", Pulse(signal="pulse", width_s=_tidy(width), **common)
    for half in steps(2.0):
        yield (
            "doublet",
            f"period {2.0 * _tidy(half):.4g} s",
            Doublet(signal="doublet", period_s=2.0 * _tidy(half), **common),
        )
        repeats = int(left / (2.0 * half))
        if repeats >= 2:
            period = 2.0 * _tidy(half)
            entry = Doublet(signal="doublet", period_s=period, repeats=repeats, spacing_s=period, **common)
            yield "doublets", f"{repeats} of period {period:.4g} s", entry
    for name, units in _UNITS.items():
        for step in steps(units):
            yield name, f"step {_tidy(step):.4g} s", StandardMultistep(signal=name, step_s=_tidy(step), **common)
    fastest = min(band_hz[1], rate_hz / 10.0, 0.5 / shortest_s)
    slowest = max(min(band_hz[0], 0.5 * fastest), 1.0 / left)
    for low in np.geomspace(slowest, 0.5 * fastest, 4) if slowest < 0.5 * fastest else ():
        for high in np.geomspace(2.0 * low, fastest, 3):
            for spacing in _SPACINGS:
                yield (
                    "sweep",
                    f"{low:.3g} to {high:.3g} Hz, {spacing}",
                    Sweep(
                        signal="sweep",
                        f_start_hz=float(low),
                        f_end_hz=float(high),
                        sweep_s=left,
                        spacing=spacing,
                        **common,
                    ),
                )
    if by_hand:
        return
    period = np.floor(left * rate_hz + 1e-9) / rate_hz
    for low in np.geomspace(max(band_hz[0], 1.0 / period), max(0.7 * fastest, 1.0 / period), 3):
        for high in np.geomspace(min(low + 2.0 / period, fastest), fastest, 3):
            sines = Multisine(signal="multisine", f_min_hz=float(low), f_max_hz=float(high), period_s=period, **common)
            yield "multisine", f"{low:.3g} to {high:.3g} Hz", sines
    for step in np.geomspace(shortest_s, max(shortest_s, left / 15.0), 5):
        for seed in (1, 2, 3):
            yield (
                "prbs",
                f"step {_tidy(step):.4g} s, seed {seed}",
                Prbs(signal="prbs", step_s=_tidy(step), prbs_s=left, bits=7, seed=seed, **common),
            )
            yield (
                "gbn",
                f"step {_tidy(step):.4g} s, seed {seed}",
                BinaryNoise(signal="gbn", step_s=_tidy(step), gbn_s=left, switching=0.5, seed=seed, **common),
            )


def _tidy(seconds: float) -> float:
    """Return a time with no more digits than a person would write; never shorter."""
    return float(np.ceil(seconds * 1000.0 - 1e-6) / 1000.0)


def candidates(
    controls: Sequence[Control],
    duration_s: float,
    shortest_s: float,
    band_hz: tuple[float, float],
    rate_hz: float,
    by_hand: bool,
    start_s: float = 0.0,
) -> Iterator[Candidate]:
    """Yield every member of :func:`families` on each control, as samples, without those that the rate cannot represent.

    Several controls move one after the other in equal parts of the time, each with the same signal.
    """
    m = len(controls)
    part = (duration_s - start_s) / m
    per_control = [
        families(c, start_s + (i + 1) * part, shortest_s, band_hz, rate_hz, by_hand, start_s + i * part)
        for i, c in enumerate(controls)
    ]
    for members in zip(*per_control, strict=True):
        specs = tuple(entry for _, _, entry in members)
        try:
            u = sampled(specs, controls, duration_s, rate_hz)
        except ScenarioError:  # a step of this length ends after the manoeuvre once it is rounded to samples
            continue
        yield Candidate(members[0][0], members[0][1], specs, u)


def sampled(specs: Sequence[Input], controls: Sequence[Control], duration_s: float, rate_hz: float) -> FloatArray:
    """Return the samples (n, m) of entries, columns in the order of ``controls``.

    Raises:
        ScenarioError: an entry breaks a law of its family.
    """
    signal = build(specs, duration_s, rate_hz)
    u = np.zeros((len(signal.t_s), len(controls)))
    for i, name in enumerate(signal.channels):
        u[:, list(controls).index(name)] = signal.u[:, i]  # type: ignore[arg-type]
    return u


def switching(signs: Sequence[float], control: Control, step_s: float, start_s: float) -> tuple[Input, ...]:
    """Return a multistep whose successive steps have the given signs (0: at rest), as scenario entries.

    Equal neighbours join into one longer step; a rest splits the signal into entries.
    """
    out: list[Input] = []
    pattern: list[float] = []
    begin, time = start_s, start_s
    for sign in [*signs, 0.0]:
        if sign == 0.0:
            if pattern:
                out.append(
                    Multistep(
                        signal="multistep",
                        control=control,
                        start_s=begin,
                        step_s=step_s,
                        pattern=tuple(pattern),
                        **amplitude_key(control),  # type: ignore[arg-type]
                    )
                )
                pattern = []
            time += step_s
            begin = time
            continue
        if pattern and np.sign(pattern[-1]) == sign:
            pattern[-1] += sign
        else:
            pattern.append(float(sign))
        time += step_s
    return tuple(out)
