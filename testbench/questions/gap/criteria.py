"""Thresholds by which air, forces and records are judged before anything is weighed, with their source.

Derived: it follows from a probability or a definition. Calibrated: it was set after a draw of the blind test was
opened; the seed is that of the draw (results/README.md says what each draw showed). Judged: somebody's judgement.

What is named follows from probabilities, whose priors stand in explain.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FALSE_ALARM = 1e-3  #: probability of finding something in one record where there is nothing, all tests together; judged


@dataclass(frozen=True)
class Criteria:
    """What is found. Chi-square: weighted sum of squares, nuisances re-tuned; gain: its fall by what is found."""

    false_alarm: float = FALSE_ALARM  #: see :data:`FALSE_ALARM`; also of hearing turbulence in still air
    #: gain below which nothing is found; noise reaches it less often than any threshold. Calibrated, seed 20261208.
    least: float = 25.0
    #: a surface that moves by more with other coefficients is turned by what the believed model measures. Derived: a
    #: thousand times what rounding leaves.
    turned_rad: float = 1e-6
    #: noise of a surface that is said to have none. Derived: no servo is simulated better between samples.
    faintest_rad: float = 2e-5
    #: a recorded surface that drives the model stirs if it moves by so many standard deviations of its noise. Derived:
    #: noise does so once in a million samples.
    stirs: float = 5.0
    #: before it stirs, it moves once it lies off by more than so many standard deviations of its noise on the whole.
    #: Judged.
    shift: float = 1.5
    #: it jumps if it moves so many times as far within a sample as in the two beside it together. Derived: no servo
    #: does that settles by less than 80 % within a sample, which is one below 80 rad/s at 50 Hz.
    jumps: float = 4.0
    #: a control whose moment is less than so many times the believed one, and ``sure`` to be negative, is counted the
    #: other way. Judged: no linkage, servo or feedback turns a moment about.
    reversed: float = -0.5
    sure: float = 4.0  #: standard errors below zero, likewise. Judged.
    #: standard deviations of the noise's chi-square beyond which there is more than noise. Judged.
    visible: float = 4.0

    @property
    def air_refuted(self) -> float:
        """Fall of twice the log-likelihood of the quiet flight that turbulence does not survive.

        Derived: 2 ln(1 / false_alarm), Markov's bound on a likelihood ratio.
        """
        return float(2.0 * np.log(1.0 / self.false_alarm))


CRITERIA = Criteria()
