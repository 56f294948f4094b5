"""The true figures of a flight: derivatives and modes of the aircraft that flew, at the condition that it flew at."""

from __future__ import annotations

import math
from collections.abc import Mapping

from testbench.aircraft import Aircraft
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.modes import frequency_and_damping, longitudinal_modes
from testbench.flight import LinearModel, TrimmedFlight


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
