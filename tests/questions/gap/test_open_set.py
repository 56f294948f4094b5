"""The open set: what forces and moments propose is flown, and named only where the library explains nothing."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from open_flights import believe, lacking, measured, prop, truths

from testbench.effects import EFFECTS
from testbench.questions.gap import workflow
from testbench.questions.gap.evidence.felt import felt
from testbench.questions.gap.evidence.stepwise import Factor, FoundTerm, Regression, Term, columns, quantities
from testbench.questions.gap.open_set import FirstLook, effect_of, first_look, proposals, title_of, told_of

THR, ALPHA, DR = Factor("thr"), Factor("alpha"), Factor("dr", modulus=True)
LIBRARY = {n: EFFECTS[n] for n in ("drag_increment", "alpha_dot")}


@cache
def records(hidden: bool = True):
    """Return flights of the taurus whose throttle rolls it, or not."""
    believed = believe("taurus")
    more = lacking(believed, "Cl", "<value>0.012</value>", prop(believed, "thr"))
    return measured("taurus", truths("taurus", more if hidden else believed.aircraft), 3)


def named_from(which=("m0", "m1", "m3"), held_out=("m4",), effects=LIBRARY):
    every = records()
    naming, held = ({n: every[n] for n in names} for names in (which, held_out))
    return workflow.find_gap(believe("taurus"), naming, held, effects=effects)


@pytest.mark.slow
def test_a_term_that_no_effect_of_the_library_holds_is_named_and_the_gap_shrinks_elsewhere():
    finding = named_from()
    assert finding.naming.outcome == "named"
    assert finding.naming.names == ("Cl by thr",)
    assert finding.verdict is None  # a term is in no part
    best = finding.naming.best
    assert abs(best.values["size"] - 0.012) < 4.0 * best.errors["size"]
    assert finding.sentences[0].startswith("a rolling moment that grows with throttle")
    assert all(s.removed > 0.99 for s in finding.shrink)
    assert "gap/cl-thr" in finding.amended.aircraft.model_xml(believe("taurus").rate_hz, 1.0, 1.0)


def test_records_without_the_channels_say_why_nothing_was_looked_at():
    few = {n: r.select([c for c in r.channels if c != "q"]) for n, r in list(records().items())[:1]}
    said = first_look(believe("taurus"), few)
    assert said.terms == ()
    assert "need V, alpha, q, theta, 'm0' lacks q" in said.sentences[0]


def test_words():
    assert title_of("Cm", Term((DR,))) == "a pitching moment that grows with the size of rudder"
    assert title_of("CD", Term((THR,))) == "a drag (or lack of thrust) that grows with throttle"
    assert title_of("Cn", Term((Factor("beta"),) * 3)) == "a yawing moment that grows with the cube of sideslip"
    found = FoundTerm("Cl", Term((THR, ALPHA)), 0.0121, 0.001, 1.0, ((Term((THR, THR)), 0.02),))
    assert told_of(found) == (
        "a rolling moment that grows with throttle times angle of attack (Cl 0.0121 ± 0.0010 per thr*alpha), or thr^2 "
        "in its place: these flights do not tell them apart"
    )


def test_a_proposal_brings_what_may_stand_in_its_place_with_a_size_of_its_own():
    found = FoundTerm("Cm", Term((DR,)), -0.1, 0.01, 1.0, ((Term((Factor("dr"),) * 2), -2.5),))
    said = proposals(FirstLook((), Regression((found,), 9, {}, {}, {})), believe("taurus"))
    assert {n: e.parameters[0].starts for n, e in said.items()} == {"Cm by |dr|": (-0.1,), "Cm by dr^2": (-2.5,)}


@pytest.mark.parametrize("name", ["taurus", pytest.param("f16", marks=pytest.mark.slow)])
def test_what_is_added_to_the_model_is_what_was_regressed_on(name):
    """All kinds of factors at once: the moment that the amended model has more is the sum of the terms' values."""
    believed = believe(name)
    record = measured(name, truths(name, believed.aircraft)[5:], 1)
    of = [("t",), ("V",), ("alpha", "beta"), ("p", "q"), ("r", "alphadot"), ("de", "thr"), ("da", "dr")]
    terms = [Term(tuple(Factor(n) for n in names)) for names in of]
    terms += [Term((Factor("beta", modulus=True),)), Term((Factor("dr", lag_s=0.2),))]
    sizes = dict(zip(terms, 1e-4 * (1.0 + np.arange(len(terms))), strict=True))
    amended = believed
    for term, size in sizes.items():
        amended = amended.with_effect(effect_of("Cm", term, size), {"size": size})
    (plain,), (more,) = felt(believed, record, 1), felt(amended, record, 1)
    c = plain.coefficients.index("Cm")
    lacks = plain.errors[0, :, c] - more.errors[0, :, c]
    expected = columns(tuple(terms), quantities(believed, plain), plain.motion.record.dt_s)[0] @ list(sizes.values())
    slow = np.hanning(15) / np.hanning(15).sum()
    lacks, expected = (np.convolve(x - x.mean(), slow, "valid")[20:-20] for x in (lacks, expected))
    assert np.max(np.abs(lacks - expected)) < 0.01 * np.ptp(expected)
    assert len(amended.aircraft.memories) == len(believed.aircraft.memories) + 1
