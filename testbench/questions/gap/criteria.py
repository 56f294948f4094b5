"""All thresholds that decide whether something is named, each with its source.

Derived: it follows from a probability or a definition. Calibrated: it was set after a draw of the blind test was
opened; the seed is that of the draw (results/README.md says what each draw showed). Judged: somebody's judgement.

Thresholds that decide how long the search goes on stand in search/: what is followed, what is given up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FALSE_ALARM = 1e-3
"""Probability of naming any effect where there is none, all effects of the library together; judged."""


@dataclass(frozen=True)
class Criteria:
    """What decides a name. Chi-square: weighted sum of squares, nuisances re-tuned; gain: its fall by an effect.

    Attributes:
        false_alarm: probability of naming any effect where there is none, all effects of the library together. Judged.
        air_false_alarm: probability of hearing turbulence in still air. Judged.
        instrument_false_alarm: probability of finding any error of an instrument where there is none. Judged.
        visible: an excess is shared out only if it stands so many standard deviations of the noise's chi-square above
            the noise. Judged.
        moving_air: share of the samples by which chi-square may be larger in turbulence, whose model is not exact.
            Calibrated, seed 20261125.
        least: gain below which nothing is named; noise reaches it less often than any threshold. Calibrated, seed
            20261208.
        weak: the same for a second effect, or for moving air, beside an effect that already leaves noise. Calibrated,
            seed 20261124.
        strained: nuisances are strained if values drawn from their priors lie as far off with less than this
            probability. If they are strained without any effect, or more than noise is left, something that the model
            lacks has pulled at them; effects are then sought from the believed values, too. An effect that strains them
            is not named. Judged: a true effect does so once in a hundred.
        end_of_range: a size lies at the end of its range if it is nearer to it than this share of the range. Judged.
        form: no form is quite right: another effect must gain more than this share of the first one's gain. Calibrated,
            seed 20261122.
        form_in_place: the same for an effect that acts in the same place as the first. Calibrated, seed 20261128.
        form_of_whole: the same beside a first effect that alone leaves noise; what a second one gains there is mostly
            form. Calibrated, seed 20261130.
        imitated: re-tuned coefficients imitate an effect if it gains less than this share of what it does beside its
            own. Calibrated, seed 20270216: a yaw damper with a filter gains 0.002 of it, a linkage that loses 0.0015; a
            slow servo that a second effect stood beside, 0.025.
        second: share of what a first effect leaves above the noise that a second one must gain. Judged.
        rare: chi-square that noise falls short of with this probability is the least that noise leaves. Judged.
        enough: share of the excess that a named effect must explain, unless it leaves noise. Calibrated, seed 20261128.
        enough_alone: the same if the effect is the only one of its kind: its form may be off, but no effect of another
            kind comes ``near``. Calibrated, seed 20261128.
        near: an effect comes near if it gains more than this share of the best gain. Calibrated, seed 20261128.
        too_close: a runner-up with this share of the best gain is not told apart while more than noise is left. Judged.
        twice: it is told apart all the same if it leaves so many times what the best one leaves above the noise.
            Calibrated, seed 20261130.
        many: so many effects that come close to the best are no answer. Judged.
        remainder: an effect is not the whole if it leaves more than so many standard deviations of the noise's
            chi-square, and more than ``remaining_share``. Calibrated, seed 20261208.
        remaining_share: share of its gain that an effect may leave above the noise; a relative of the true effect, or
            one of two effects, leaves more. Calibrated, seed 20261208.
        structured: share of its gain that an effect may leave above the noise in one band of one channel. A relative of
            the true effect that explains little leaves more, where all of chi-square would not show it. Judged.
        gust_after_s: time by which the answer to a command outlasts it, about a short period. Judged.
        gust_rings_s: time by which the answer to a gust outlasts it. Judged.
        gust_proven: share of its gain that a gust beside a command may leave; other pulses leave more. Calibrated, seed
            20261127.
        gust_left: probability with which the upper bound of what a gust leaves fails. Judged.
        scatter_left: a delay is tried with scatter if noise alone leaves as much with less than this probability.
            Judged.
        scatter_leads: share of the excess that the mean delay alone must explain. Judged.
        scatter_most: largest scatter, as a share of the delay; beyond it commands would overtake each other, or another
            effect is the true one. Calibrated, seed 20261206.
        scatter_form: share of their common gain that delay and scatter may leave; lateness is linear only within a
            sample. Calibrated, seed 20261206.
        false_terms: share of false terms among those that forces and moments are said to follow. Judged.
        path_form: share of what one kind of error gains in a path by which it must lead another, as no form of a servo
            is quite right. Judged.
        seconded: gain in the motion that an effect which a recorded surface shows needs to be named where the motion
            shows no gap: two standard errors. Judged.
        turned_rad: a surface that moves by more with other coefficients is turned by what the believed model measures.
            Derived: a thousand times what rounding leaves.
        faintest_rad: noise of a surface that is said to have none. Derived: no servo is simulated better between
            samples.
        offset_rad: a surface that stands by less from its command is not said to. Judged.
        stirs: a recorded surface that drives the model stirs if it moves by so many standard deviations of its noise.
            Derived: noise does so once in a million samples.
        shift: before it stirs, it moves once it lies off by more than so many standard deviations of its noise on the
            whole. Judged.
        jumps: it jumps if it moves so many times as far within a sample as in the two beside it together. Derived: no
            servo does that settles by less than 80 % within a sample, which is one below 80 rad/s at 50 Hz.
        off: a nuisance is off if it lies more than so many standard deviations of its prior from 1. Judged.
        far: a nuisance is wrong if it lies more than so many standard deviations of its prior from 1. Judged.
        proves: coefficients prove something if re-tuning them leaves no more than this share of what stands above the
            noise without, and no effect explains more than this share of what it leaves. Judged: a wrong derivative in
            turbulence leaves 0.53, turbulence that coefficients stand in for 0.79.
        at_once: so many coefficients may be wrong at once while more than noise is left; more say that something else
            pulled at them. Judged: a slow aileron servo, taken out of the library, accused six.
        reversed: a control whose moment is less than so many times the believed one, and ``sure`` to be negative, is
            counted the other way. Judged: no linkage, servo or feedback turns a moment about.
        sure: both need a distance from 1 of so many standard errors, which must be smaller than the prior's. Judged.
    """

    false_alarm: float = FALSE_ALARM
    air_false_alarm: float = 1e-3
    instrument_false_alarm: float = 0.01
    visible: float = 4.0
    moving_air: float = 0.02
    least: float = 25.0
    weak: float = 40.0
    strained: float = 0.01
    end_of_range: float = 1e-3
    form: float = 5e-4
    form_in_place: float = 0.05
    form_of_whole: float = 0.02
    imitated: float = 0.01
    second: float = 0.35
    rare: float = 1e-4
    enough: float = 0.95
    enough_alone: float = 0.80
    near: float = 0.5
    too_close: float = 0.85
    twice: float = 2.0
    many: int = 4
    remainder: float = 10.0
    remaining_share: float = 2e-3
    structured: float = 0.25
    gust_after_s: float = 1.0
    gust_rings_s: float = 2.0
    gust_proven: float = 0.02
    gust_left: float = 0.1
    scatter_left: float = 0.02
    scatter_leads: float = 0.7
    scatter_most: float = 0.4
    scatter_form: float = 0.01
    false_terms: float = 0.01
    path_form: float = 0.02
    seconded: float = 4.0
    turned_rad: float = 1e-6
    faintest_rad: float = 2e-5
    offset_rad: float = 1e-3
    stirs: float = 5.0
    shift: float = 1.5
    jumps: float = 4.0
    off: float = 1.0
    far: float = 2.0
    proves: float = 2.0 / 3.0
    at_once: int = 2
    reversed: float = -0.5
    sure: float = 4.0

    @property
    def told_apart(self) -> float:
        """Gain by which one of two effects must lead to exclude the other. Derived: 2 ln(1 / false_alarm).

        A wrong effect leads the true one by as much with a probability of ``false_alarm`` at most (Markov's bound on a
        likelihood ratio).
        """
        return float(2.0 * np.log(1.0 / self.false_alarm))

    @property
    def air_refuted(self) -> float:
        """Fall of twice the log-likelihood of the quiet flight that turbulence does not survive. Derived, likewise."""
        return float(2.0 * np.log(1.0 / self.air_false_alarm))


CRITERIA = Criteria()
