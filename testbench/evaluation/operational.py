"""Compare modes found without an input with those of the linearised aircraft: frequency, damping and shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from testbench.core.channels import require
from testbench.estimators.model import ComplexArray
from testbench.estimators.operational.realise import mac
from testbench.estimators.operational.result import OperationalMode, OperationalModes
from testbench.evaluation.modes import name_modes, spectrum
from testbench.flight.linear_model import LinearModel

_FARTHEST = 0.6  # |ln(s / s')| + 1 - MAC from which on a found mode stands for no true one


@dataclass(frozen=True, eq=False)
class TrueMode:
    """An oscillatory mode of the linear model: its name, pole in rad/s (Im s > 0), and shape (r,) at the sensors."""

    name: str
    pole: complex
    shape: ComplexArray

    @property
    def frequency_hz(self) -> float:
        """Natural frequency |s| / 2 pi, Hz."""
        return abs(self.pole) / (2.0 * np.pi)

    @property
    def damping(self) -> float:
        """Damping ratio."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, eq=False)
class ModeMatch:
    """A true mode, a found mode, or a matched pair with the MAC of their scaled shapes.

    ``index`` is the number of the found mode in its result.
    """

    true: TrueMode | None
    found: OperationalMode | None
    index: int | None
    mac: float | None

    def off(self, of: str, std: str) -> float | None:
        """Return found less true of a figure, in standard deviations; None without a pair, or where they are zero."""
        if self.true is None or self.found is None or getattr(self.found, std) == 0.0:
            return None
        return float((getattr(self.found, of) - getattr(self.true, of)) / getattr(self.found, std))


def true_modes(
    linear: LinearModel, symmetric: Mapping[int, str], asymmetric: Mapping[int, str], channels: Sequence[str]
) -> list[TrueMode]:
    """Return every oscillatory mode of the linear model with its shape C v at ``channels``, by frequency.

    Args:
        linear: with outputs that include ``channels``.
        symmetric: number of each symmetric elastic mode -> its name.
        asymmetric: the same of the others.
        channels: measured.

    Raises:
        ChannelError: the linear model has no such output.
    """
    require(channels, linear.outputs, "the comparison with the linear model")
    rows = [linear.outputs.index(name) for name in channels]
    out = []
    for motion, elastic in (("longitudinal", symmetric), ("lateral-directional", asymmetric)):
        found = spectrum(linear, motion, elastic)
        C = linear.subsystem(found.states).C[rows]
        for name, owned in name_modes(found, elastic).items():
            for k in owned:
                if found.poles[k].imag > 1e-9:
                    shape = np.asarray(C @ found.right[:, k], np.complex128)
                    out.append(TrueMode(name, complex(found.poles[k]), shape))
    return sorted(out, key=lambda m: abs(m.pole))


def match_modes(result: OperationalModes, true: Sequence[TrueMode]) -> list[ModeMatch]:
    """Return every true and every found mode once, in the order of their frequencies.

    The distance of two modes is |ln(s / s')| + 1 - MAC; the assignment of least total distance is chosen, and two modes
    farther apart than 0.6 are not matched.
    """
    likeness = np.array([[mac(m.scaled_shape, t.shape / result.scale) for m in result.modes] for t in true])
    likeness = likeness.reshape(len(true), len(result.modes))
    cost = np.full((len(true), len(result.modes) + len(true)), _FARTHEST)
    for i, t in enumerate(true):
        for k, m in enumerate(result.modes):
            cost[i, k] = abs(np.log(m.pole / t.pole)) + 1.0 - likeness[i, k]
    rows, columns = linear_sum_assignment(cost)
    pairs = {
        int(i): int(k) for i, k in zip(rows, columns, strict=True) if k < len(result.modes) and cost[i, k] <= _FARTHEST
    }
    out = []
    for i, t in enumerate(true):
        found = pairs.get(i)
        if found is None:
            out.append(ModeMatch(t, None, None, None))
        else:
            out.append(ModeMatch(t, result.modes[found], found, float(likeness[i, found])))
    out += [ModeMatch(None, m, k, None) for k, m in enumerate(result.modes) if k not in pairs.values()]
    return sorted(out, key=_frequency)


def _frequency(match: ModeMatch) -> float:
    if match.true is not None:
        return abs(match.true.pole)
    assert match.found is not None
    return abs(match.found.pole)
