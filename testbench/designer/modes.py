"""The modes of one motion by name, and the onset of vibration."""

from __future__ import annotations

import numpy as np

from testbench.aircraft import Aircraft
from testbench.errors import LimitError
from testbench.evaluation.envelope import Onset, fly_envelope
from testbench.evaluation.modes import longitudinal_modes, name_modes, poles_of, spectrum
from testbench.flight import LinearModel
from testbench.scenario.design import DesignScenario

RIGID_MODES = {"longitudinal": ("phugoid", "short period"), "lateral": ("Dutch roll", "roll", "spiral")}
"""Plane -> names of its rigid modes."""

_SPEEDS = 11  # that the onset of vibration is sought over


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


def onsets_of(aircraft: Aircraft, scenario: DesignScenario) -> tuple[Onset, ...]:
    """Return the onsets of elastic modes over the speeds from the condition up.

    Raises:
        LimitError: the condition lies above an onset, or nearer to it than the margin.
    """
    elastic = aircraft.flown_modes()
    if elastic is None or not len(elastic):
        return ()
    V, margin = scenario.condition.V_m_s, scenario.limits.onset_margin_m_s
    fastest = aircraft.limits.get("V", (0.5 * V, 2.0 * V))[1]
    speeds = np.linspace(V, max(fastest, V), _SPEEDS)
    found = fly_envelope(aircraft, speeds.tolist(), scenario.condition.h_m)
    onsets = tuple(found.onset(name) for name in found.elastic)
    for onset in onsets:
        if onset.V_m_s is not None and onset.V_m_s - margin < V and not scenario.allow_above_onset:
            raise LimitError(
                f"V_m_s <= onset - margin = {onset.V_m_s:.3g} - {margin:g} m/s must hold for a design, got {V:g} m/s "
                f"({onset.sentence}); fly slower, or set allow_above_onset = true"
            )
    return onsets
