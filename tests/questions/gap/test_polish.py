"""Fits that compete for the first place come to rest as flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.blind.flights import fly_truth
from studies.blind.run import believe
from studies.blind.truths import TRUTHS

from testbench.effects import EFFECTS
from testbench.questions.gap.search.fit import fit
from testbench.questions.gap.search.hypothesis import Hypothesis, Signature
from testbench.questions.gap.search.polish import polished
from testbench.questions.gap.search.screening import screen


@pytest.fixture(scope="module")
def damped():
    """A base in flights of an aircraft with a pitch damper, and the fits of the damper and of a filtered one."""
    plan = TRUTHS["rate feedback"]({"gain_s": 0.11}, "eolo")
    believed = believe("eolo")
    base = Hypothesis.at(believed, believed, tuple(fly_truth("eolo", plan, "short", 11).values()))
    return base, [fit(screen(base, EFFECTS[n]), base.chi2, 0.0, 2) for n in ("pitch_damper", "filtered_pitch_damper")]


def moved(base: Hypothesis, found, share: float):
    """The fit a share of its standard errors beside where it came to rest, with the chi-square flown there."""
    values = {n: v + share * found.errors[n] for n, v in found.values.items()}
    there = base.moved(Signature(base, found.effect).model(array(values)), array(found.nuisances))
    return replace(found, values=values, chi2=there.chi2, gain=base.chi2 - there.chi2)


def array(values):
    return np.array(list(values.values()))


def test_polishing_brings_a_fit_that_rests_too_high_down_again(damped):
    base, (plain, filtered) = damped
    off = moved(base, plain, 0.1)
    assert off.chi2 > plain.chi2 + 1.0
    down, other = polished(base, [off, filtered], base.chi2)
    assert down.chi2 <= plain.chi2 + 0.1
    assert down.gain == pytest.approx(base.chi2 - down.chi2, abs=1e-9)
    flown = base.moved(Signature(base, down.effect).model(array(down.values)), array(down.nuisances))
    assert flown.chi2 == pytest.approx(down.chi2, abs=1e-9)  # what is said was flown
    assert other.chi2 <= filtered.chi2


def test_a_general_form_that_is_its_special_case_gains_no_more_once_both_rest(damped):
    """The filter is none in truth: what one parameter gains from noise exceeds 10.8 with probability 1e-3."""
    base, fits = damped
    plain, filtered = polished(base, fits, base.chi2)
    assert -0.2 < filtered.gain - plain.gain < 10.8


def test_fits_that_are_far_behind_or_without_a_rival_stay_as_they_are(damped):
    base, (plain, filtered) = damped
    far = replace(filtered, gain=plain.gain - 100.0)
    assert polished(base, [plain, far], base.chi2) == [plain, far]
    assert polished(base, [plain], base.chi2) == [plain]


def test_a_fit_that_leads_alone_is_brought_to_rest_before_it_is_refused_for_what_it_strains(damped):
    base, (plain, _) = damped
    (down,) = polished(base, [replace(moved(base, plain, 0.1), within=1e-4)], base.chi2)
    assert down.chi2 <= plain.chi2 + 0.1
    assert down.within > 0.01
