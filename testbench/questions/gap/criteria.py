"""All thresholds that decide whether something is named, each with where it is from.

derived: it follows from a probability or a definition. calibrated: the value stands since a draw of the blind test was
opened, by the seed of that draw (results/README.md says what each draw showed). judged: somebody's judgement.

Thresholds that decide how long is searched stand where the search is: what is followed, what is given up.
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
        visible: standard deviations of the noise's chi-square that an excess must stand above it to be shared out.
            Judged.
        moving_air: share of the samples by which chi-square may be larger in turbulence, whose model is not exact.
            Calibrated, seed 20261125.
        least: gain below which nothing is named: noise reaches it less often than any threshold. Calibrated, seed
            20261208.
        weak: the same of a second effect, or of moving air, beside an effect that leaves noise already. Calibrated,
            seed 20261124.
        strained: probability of nuisances as far off, drawn from their priors, from which on they are strained. Without
            any effect that, or more than noise left, means that something the model lacks has pulled at them: effects
            are sought from the believed values, too. An effect that strains them does not fit what is believed and is
            not named. Judged: a true effect does so once in a hundred.
        end_of_range: share of a parameter's range from whose end a size is taken to lie at it. Judged.
        form: share of what an effect gains to which no form is right: what gains no more beside it is no other effect.
            Calibrated, seed 20261122.
        form_in_place: the same where a second effect acts in the same place. Calibrated, seed 20261128.
        form_of_whole: the same where the first one alone leaves noise: what more a second one finds there is form, too.
            Calibrated, seed 20261130.
        second: share of what a first effect leaves above the noise that a second one must gain. Judged.
        rare: probability of the least that noise is thought to leave. Judged.
        enough: share of the excess that a named effect must explain, unless it leaves noise, Calibrated, seed 20261128,
        enough_alone: or this share where nothing but its own other forms. Calibrated, seed 20261128.
        near: gains as much as this share of what it gains: its form may be off, but it is the only one of its kind.
            Calibrated, seed 20261128.
        too_close: a runner-up with this share of the best gain is not told apart while more than noise is left, judged,
        twice: unless it leaves so many times what the best one leaves above the noise. Calibrated, seed 20261130.
        many: more names than these are no answer. Judged.
        remainder: what leaves more than so many standard deviations of the noise's chi-square,
        remaining_share: and this share of what it gains, is not the whole: a relative of it, or an effect beside it,
            leaves as much. Both calibrated, seed 20261208.
        gust_after_s: the answer to a command lasts about a short period beyond it. Judged.
        gust_rings_s: and so does the answer to a gust. Judged.
        gust_proven: share of its gain that a gust beside a command may leave: other pulses leave more. Calibrated, seed
            20261127,
        gust_left: at an upper bound that holds but with this probability. Judged.
        scatter_left: a delay that leaves what noise exceeds with this probability is asked whether it scatters. Judged.
        scatter_leads: share of the excess that its mean alone explains at least. Judged.
        scatter_most: share of the delay that its scatter may be: commands would overtake each other, or another effect
            is the truth. Calibrated, seed 20261206.
        scatter_form: share of what both gain that they may leave: lateness is linear only within a sample. Calibrated,
            seed 20261206.
        off, far: a nuisance is off, or wrong, by more than so many times what is believed of it. Judged,
        sure: and by more than so many standard errors, which must be smaller than what is believed of it. Judged.
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
    gust_after_s: float = 1.0
    gust_rings_s: float = 2.0
    gust_proven: float = 0.02
    gust_left: float = 0.1
    scatter_left: float = 0.02
    scatter_leads: float = 0.7
    scatter_most: float = 0.4
    scatter_form: float = 0.01
    off: float = 1.0
    far: float = 2.0
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
