"""Doubts about modes that were found from outputs alone, in words."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.advice import Advice, doubt, note
from testbench.estimators.operational.likeness import mac

if TYPE_CHECKING:
    from testbench.estimators.operational.result import OperationalMode

ASSUMPTION = (
    "the method assumes that the air is white noise and excites every mode alike. Turbulence is coloured: poles of its "
    "spectrum and of the rigid motion can come out as modes, and the outputs alone cannot tell them apart"
)
"""The assumptions of every result; reports state them."""
_HEAVY = 0.2  # damping ratio from which on a pole is rarely a structural mode alone
_FEW_BLOCKS = 30
_WANDER = 0.03  # of the airspeed: 6 % in dynamic pressure
_CLOSE = 0.1  # relative distance of two frequencies, within which
_SAME_SHAPE = 0.9  # a larger MAC of their shapes makes two modes doubtful
_LINE = 0.003  # damping ratios below this are rarely those of a structure in flight (estimate)


def remarks(mode: OperationalMode) -> tuple[Advice, ...]:
    """Return what is doubtful about one mode."""
    out = []
    if mode.damping > _HEAVY:
        out.append(
            doubt("heavily_damped", "heavily damped: rigid motion or the shaping of the excitation may be in it")
        )
    if mode.damping < _LINE:
        out.append(doubt("hardly_damped", "hardly any damping: a rotating part gives such a line"))
    if _complexity(mode) > 0.5:
        out.append(
            doubt("complex_shape", "shape far from real: two modes close to each other, or strong damping by the air")
        )
    return tuple(out)


def advise(modes: Sequence[OperationalMode], blocks: int, short: int, wander: float) -> tuple[Advice, ...]:
    """Return what is doubtful about a result, and what to do about it.

    Args:
        modes: found.
        blocks: of data that the errors come from.
        short: number of records that were shorter than the lags.
        wander: standard deviation of the airspeed over its mean, 0 if not known.
    """
    out = [said.about(f"mode at {m.frequency_hz:.3g} Hz") for m in modes for said in m.remarks]
    for one, other in combinations(modes, 2):
        close = abs(one.frequency_hz - other.frequency_hz) < _CLOSE * other.frequency_hz
        if close and mac(one.scaled_shape, other.scaled_shape) > _SAME_SHAPE:
            out.append(
                doubt(
                    "same_shape",
                    f"modes at {one.frequency_hz:.4g} and {other.frequency_hz:.4g} Hz have the same shape: they are "
                    "one mode split in two (it may have changed during the flight), or two that these sensors cannot "
                    "tell apart; add sensors",
                )
            )
    if blocks < _FEW_BLOCKS:
        out.append(
            doubt("few_data", f"the errors come from only {blocks} blocks of data and are rough; give more data")
        )
    if wander > _WANDER:
        out.append(
            doubt(
                "airspeed_wandered",
                f"airspeed wandered by {100.0 * wander:.1f} % (one standard deviation): modes that change with "
                "airspeed are means over it, and their intervals count chance alone; fly in calmer air or give records "
                "of one speed",
            )
        )
    if short:
        out.append(
            note(
                "records_left_out",
                f"records shorter than the lags did not count: {short}; raise the lowest frequency of the band",
            )
        )
    return tuple(out)


def _complexity(mode: OperationalMode) -> float:
    """Return 1 - |sum of c^2| / sum of |c|^2 of the shape: 0 if all outputs move in phase or against it, 1 at most."""
    c = mode.scaled_shape
    return float(1.0 - abs(np.sum(c**2)) / np.sum(np.abs(c) ** 2))
