"""Candidate inputs: every signal family over its free quantities, at unit amplitude."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from testbench.design.problem import Problem

UNIT_DEG = 1.0 / DEG_RAD
"""An amplitude of 1 rad: candidates are scaled afterwards."""

_UNITS = {"3211": 7.0, "211": 4.0, "123": 6.0}


@dataclass(frozen=True, eq=False)
class Candidate:
    """One input at unit amplitude."""

    family: str  # name of the signal
    words: str  # its free quantities in words
    specs: tuple[Input, ...]  # entries of a scenario that make it, amplitude 1 (rad or 1)
    u: FloatArray  # (samples, m) its samples at the design's rate, one column per control


def scaled(specs: Sequence[Input], factor: float) -> tuple[Input, ...]:
    """Return scenario entries at ``factor`` times their amplitude."""
    keys = ["amplitude_percent" if spec.control == "thr" else "amplitude_deg" for spec in specs]
    return tuple(
        spec.model_copy(update={key: round(float(getattr(spec, key)) * float(factor), 6)})
        for key, spec in zip(keys, specs, strict=True)
    )


def amplitude_key(control: Control) -> dict[str, float]:
    """Return the keyword that gives a control unit amplitude."""
    return {"amplitude_percent": 100.0} if control == "thr" else {"amplitude_deg": UNIT_DEG}


def families(asked: Problem, control: Control, start_s: float, end_s: float) -> Iterator[tuple[str, str, Input]]:
    """Yield (family, words, entry) of every signal family over its free quantities.

    Args:
        asked: gives the shortest step that can be held, or shortest half period of a sine; the band of the targets, for
            sweeps and multisines; the rate; and whether a pilot flies, who can fly no multisine and no binary noise.
        control: the control that moves.
        start_s: when the input starts.
        end_s: when it has ended.
    """
    shortest_s, band_hz, rate_hz = asked.shortest_s, asked.band_hz, asked.rate_hz
    common: dict[str, Any] = {"control": control, "start_s": start_s, **amplitude_key(control)}
    left = end_s - start_s

    def steps(units: float, count: int = 16) -> FloatArray:
        longest = left / units
        return np.geomspace(shortest_s, longest, count) if longest >= shortest_s else np.zeros(0)

    def made(family: str, kind: Callable[..., Input], words: str, **values: Any) -> tuple[str, str, Input]:
        return family, words, kind(**{"signal": family, **values, **common})

    for width in map(_tidy, steps(1.0, 10)):
        if width < 0.9 * left:
            yield made("pulse", Pulse, f"{width:.4g} s", width_s=width)
    for half in steps(2.0):
        period, repeats = 2.0 * _tidy(half), int(left / (2.0 * half))
        yield made("doublet", Doublet, f"period {period:.4g} s", period_s=period)
        if repeats >= 2:
            values = {"signal": "doublet", "period_s": period, "repeats": repeats, "spacing_s": period}
            yield made("doublets", Doublet, f"{repeats} of period {period:.4g} s", **values)
    for name, units in _UNITS.items():
        for step in map(_tidy, steps(units)):
            yield made(name, StandardMultistep, f"step {step:.4g} s", step_s=step)
    fastest = min(band_hz[1], rate_hz / 10.0, 0.5 / shortest_s)
    slowest = max(min(band_hz[0], 0.5 * fastest), 1.0 / left)
    for low in np.geomspace(slowest, 0.5 * fastest, 4).tolist() if slowest < 0.5 * fastest else ():
        for high in np.geomspace(2.0 * low, fastest, 3).tolist():
            for spacing in ("linear", "exponential"):
                values = {"f_start_hz": low, "f_end_hz": high, "sweep_s": left, "spacing": spacing}
                yield made("sweep", Sweep, f"{low:.3g} to {high:.3g} Hz, {spacing}", **values)
    if asked.by_hand:
        return
    period = np.floor(left * rate_hz + 1e-9) / rate_hz
    for low in np.geomspace(max(band_hz[0], 1.0 / period), max(0.7 * fastest, 1.0 / period), 3).tolist():
        for high in np.geomspace(min(low + 2.0 / period, fastest), fastest, 3).tolist():
            values = {"f_min_hz": low, "f_max_hz": high, "period_s": period}
            yield made("multisine", Multisine, f"{low:.3g} to {high:.3g} Hz", **values)
    for step in map(_tidy, np.geomspace(shortest_s, max(shortest_s, left / 15.0), 5)):
        for seed in (1, 2, 3):
            words, values = f"step {step:.4g} s, seed {seed}", {"step_s": step, "seed": seed}
            yield made("prbs", Prbs, words, **values, prbs_s=left, bits=7)
            yield made("gbn", BinaryNoise, words, **values, gbn_s=left, switching=0.5)


def _tidy(seconds: float) -> float:
    """Return a time with no more digits than a person would write; never shorter."""
    return float(np.ceil(seconds * 1000.0 - 1e-6) / 1000.0)


def candidates(problem: Problem) -> Iterator[Candidate]:
    """Yield every member of :func:`families` on each control, as samples, without those that the rate cannot represent.

    Several controls move one after the other in equal parts of the time, each with the same signal.
    """
    controls, start_s = problem.controls, problem.start_s
    part = (problem.duration_s - start_s) / len(controls)
    per_control = [families(problem, c, start_s + i * part, start_s + (i + 1) * part) for i, c in enumerate(controls)]
    for members in zip(*per_control, strict=True):
        specs = tuple(entry for _, _, entry in members)
        try:
            u = problem.sampled(specs)
        except ScenarioError:  # a step of this length ends after the manoeuvre once it is rounded to samples
            continue
        yield Candidate(members[0][0], members[0][1], specs, u)


def sampled(specs: Sequence[Input], controls: Sequence[Control], duration_s: float, rate_hz: float) -> FloatArray:
    """Return the samples (n, m) of entries, columns in the order of ``controls``.

    Raises:
        ScenarioError: an entry breaks a law of its family.
    """
    return build(specs, duration_s, rate_hz).columns(controls)


def switching_specs(signs: Sequence[float], control: Control, step_s: float, start_s: float) -> tuple[Input, ...]:
    """Return a multistep whose successive steps have the given signs (0: at rest), as scenario entries.

    Equal neighbours join into one longer step; a rest splits the signal into entries.
    """
    common: dict[str, Any] = {"signal": "multistep", "control": control, "step_s": step_s, **amplitude_key(control)}
    out: list[Input] = []
    pattern: list[float] = []
    begin, time = start_s, start_s
    for sign in [*signs, 0.0]:
        time += step_s
        if sign == 0.0:
            if pattern:
                out.append(Multistep(start_s=begin, pattern=tuple(pattern), **common))
            pattern, begin = [], time
        elif pattern and np.sign(pattern[-1]) == sign:
            pattern[-1] += sign
        else:
            pattern.append(float(sign))
    return tuple(out)
