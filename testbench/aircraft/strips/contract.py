"""The laws of ground tests: what can be tried on their file without an aircraft."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from testbench.aircraft.strips.reading import GroundTest
from testbench.core.contract import Law
from testbench.core.record import FloatArray

ALIKE = 0.9  # modal assurance criterion beyond which two modes of one symmetry are taken for the same
_POINTS = 50


def ground_test_laws(test: GroundTest) -> list[Law]:
    """Return for every pair of modes of one symmetry whether their shapes differ.

    The modal assurance criterion (R. J. Allemang, D. L. Brown, IMAC 1982) of displacement and twist along the wing and
    the motions of the tail, each kind over its largest value in any mode, must be below ``ALIKE``.
    """
    found = np.array([_motions(test, i) for i in range(len(test.shapes))])
    kinds = np.array([*["bend"] * _POINTS, *["twist"] * _POINTS, "up", "pitch", "side", "roll", "yaw"])
    for kind in set(kinds.tolist()):
        largest = np.max(np.abs(found[:, kinds == kind]))
        found[:, kinds == kind] /= largest if largest > 0.0 else 1.0
    laws = []
    for i, j in combinations(range(len(test.shapes)), 2):
        first, second = test.content.mode[i], test.content.mode[j]
        if first.symmetry == second.symmetry:
            mac = float((found[i] @ found[j]) ** 2 / ((found[i] @ found[i]) * (found[j] @ found[j])))
            law = f"'{first.name}' and '{second.name}' have different shapes"
            why = f"their modal assurance criterion is {mac:.2f}: is it one mode, or are stations too few?"
            laws.append(Law(law, mac < ALIKE, why))
    return laws


def _motions(test: GroundTest, i: int) -> FloatArray:
    """Return displacement and twist at points along all that was measured, and the motions of the tail."""
    mode, shape = test.content.mode[i], test.shapes[i]
    y = np.linspace(0.0, max(s.y_m[-1] for s in test.shapes), _POINTS)
    tail = [mode.tail_up_m, mode.tail_pitch_rad, mode.tail_side_m, mode.tail_roll_rad, mode.tail_yaw_rad]
    return np.concatenate([np.interp(y, shape.y_m, shape.bend_m), np.interp(y, shape.y_m, shape.twist_rad), tail])
