"""Rounds of a search: the parameters for a noise covariance in turns with the covariance of what they leave.

The variances converge linearly, with a ratio that is near one where the model misses more than noise: an output that is
weighed less is followed less well. Steps to where the rounds lead save most of them.
"""

from __future__ import annotations

import numpy as np

from testbench.core.record import FloatArray

_EVERY = 3  # rounds from one step ahead to the next, so that its own change has died away
_FARTHEST, _LARGEST = 6.0, 0.5  # changes that a step goes ahead, and its change of a logarithm, at most


class Rounds:
    """Variances (p,) of a search, round by round."""

    def __init__(self, variances: FloatArray) -> None:
        self.variances, self.done = variances, 0
        self._previous = np.zeros(variances.size)

    def follow(self, found: FloatArray, last: bool) -> FloatArray:
        """Return the variances (p,) of the next round, after those that a round left behind (``found``).

        ``last`` says that nothing must be added any more, as the next round ends the search.
        """
        self.done += 1
        change, previous = np.log(found / self.variances), self._previous
        along = float(change @ previous) / max(float(previous @ previous), 1e-300)
        self._previous = change
        if self.done % _EVERY == 0 and not last and along > 0.0:
            changes = along / (1.0 - along) if along < 1.0 else _FARTHEST
            farthest = min(_FARTHEST, _LARGEST / max(float(np.max(np.abs(change))), 1e-300))
            found = found * np.exp(min(changes, farthest) * change)
            self._previous = np.zeros(change.size)
        self.variances = found
        return found
