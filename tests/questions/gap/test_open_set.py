"""The open set: terms that no effect of the library holds come near by their signatures, and are named when flown."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from open_flights import believe, lacking, measured, prop, truths

from testbench.aircraft import Amendment, ScaleCoefficient
from testbench.effects import EFFECTS
from testbench.questions.gap import workflow
from testbench.questions.gap.name import TERMS, Sought, _Asker, name_effect
from testbench.questions.gap.open_set import Factor, OpenTerm, Term, along, effect_of, increments, response, title_of
from testbench.questions.gap.search.point import changes
from testbench.questions.gap.workflow import GapSearch

THR, ALPHA, DR = Factor("thr"), Factor("alpha"), Factor("dr", modulus=True)
LIBRARY = {n: EFFECTS[n] for n in ("drag_increment", "alpha_dot")}
AT, BETA = "<property>aero/alpha-rad</property>", "<property>aero/beta-rad</property>"
HIDDEN = {
    "throttle in Cl": ("Cl by thr", 0.012),
    "alpha in Cl": ("Cl by alpha", 0.03),
    "|dr| in Cm": ("Cm by |dr|", -0.1),
    "beta^3 in Cn": ("Cn by beta^3", 4.0),
}


@cache
def flown(name: str, hidden: str):
    """Return the flights of an aircraft with something hidden."""
    believed = believe(name)
    made = {
        "nothing": lambda: believed.aircraft,
        "throttle in Cl": lambda: lacking(believed, "Cl", "<value>0.012</value>", prop(believed, "thr")),
        "alpha in Cl": lambda: lacking(believed, "Cl", "<value>0.03</value>", AT),
        "|dr| in Cm": lambda: lacking(believed, "Cm", "<value>-0.1</value>", f"<abs>{prop(believed, 'dr')}</abs>"),
        "beta^3 in Cn": lambda: lacking(believed, "Cn", "<value>4.0</value>", BETA, BETA, BETA),
        "half as much Cm_q again": lambda: believed.aircraft.amended(
            Amendment("hidden", "hidden", (ScaleCoefficient("Cm_q", 1.5),))
        ),
    }
    return truths(name, made[hidden]())


def weighed(name: str, hidden: str, seed: int = 3, noise: float = 1.0) -> tuple[tuple[OpenTerm, ...], int]:
    """Return the terms that come nearest, the sensors' noise being so many times what is stated, and how many are."""
    believed = believe(name)
    sensors = tuple(replace(s, noise_std=s.noise_std / noise) for s in believed.suite.sensors)
    stated = replace(believed, suite=replace(believed.suite, sensors=sensors))
    return _Asker(stated, tuple(measured(name, flown(name, hidden), seed).values()), "measured").open_terms()


@pytest.mark.parametrize(
    ("name", "hidden"),
    [
        ("taurus", "|dr| in Cm"),
        *(
            pytest.param(name, hidden, marks=pytest.mark.slow)
            for name, hidden in [
                *(("taurus", other) for other in ("throttle in Cl", "alpha in Cl", "beta^3 in Cn")),
                *(("eolo", each) for each in HIDDEN),
                *(("b1", each) for each in ("throttle in Cl", "alpha in Cl")),  # beta^3 is far beyond first order there
                *(("c172p", each) for each in HIDDEN),
                *(("f16", each) for each in ("throttle in Cl", "alpha in Cl")),  # its sideslip is small
            ]
        ),
    ],
)
def test_a_hidden_term_is_among_those_that_are_flown_and_begins_near_its_size(name, hidden):
    """To first order: what changes the motion as much as it was itself is told to within a third or so."""
    label, size = HIDDEN[hidden]
    terms, tried = weighed(name, hidden, noise=1.2)
    (found,) = (t for t in terms[:TERMS] if t.name == label)
    assert found.size == pytest.approx(size, rel=0.5)
    assert tried > 500


EACH = [(name, seed) for name in ("taurus", "eolo", "f16") for seed in range(6)]


@pytest.mark.parametrize(("name", "seed"), [EACH[0], *(pytest.param(*e, marks=pytest.mark.slow) for e in EACH[1:])])
def test_where_nothing_is_hidden_no_term_is_named(name, seed):
    records = list(measured(name, flown(name, "nothing"), seed).values())
    assert name_effect(believe(name), records, Sought({}, open_terms=True)).outcome == "no gap"


@pytest.mark.slow
def test_where_nothing_is_hidden_no_term_comes_near():
    """A term needs a gain of ln(0.4 / (0.05 / 574)) = 8.4 to be as probable as nothing."""
    assert weighed("taurus", "nothing", 0)[0][0].gain < 8.4


def test_a_factor_of_a_believed_coefficient_is_no_term():
    """Its prior decides of it."""
    terms, _ = weighed("taurus", "half as much Cm_q again")
    assert all(t.name not in ("Cm by q", "Cm by alpha", "CL by de") for t in terms)


@pytest.mark.slow
def test_a_term_that_no_effect_of_the_library_holds_is_named_and_the_gap_shrinks_elsewhere():
    every = measured("taurus", flown("taurus", "throttle in Cl"), 3)
    naming, held = ({n: every[n] for n in names} for names in (("m0", "m1", "m3"), ("m4",)))
    finding = workflow.find_gap(believe("taurus"), naming, held, GapSearch(effects=LIBRARY))
    assert finding.naming.outcome == "named"
    assert finding.naming.names == ("Cl by thr",)
    assert finding.verdict is None  # a term is in no part
    best = finding.naming.best
    assert abs(best.values["size"] - 0.012) < 4.0 * best.errors["size"]
    assert finding.sentences[0].startswith("a rolling moment that grows with throttle")
    assert all(s.removed > 0.99 for s in finding.shrink)
    assert "gap/cl-thr" in finding.amended.aircraft.model_xml(believe("taurus").rate_hz, 1.0, 1.0)


def test_words():
    assert title_of("Cm", Term((DR,))) == "a pitching moment that grows with the size of rudder"
    assert title_of("CD", Term((THR,))) == "a drag (or lack of thrust) that grows with throttle"
    assert title_of("Cn", Term((Factor("beta"),) * 3)) == "a yawing moment that grows with the cube of sideslip"
    assert OpenTerm("Cl", Term((THR, ALPHA)), 0.01, 0.1, -1.0, 9.0).name == "Cl by thr*alpha"


@pytest.mark.parametrize("name", ["taurus", pytest.param("f16", marks=pytest.mark.slow)])
def test_what_is_added_to_the_model_is_what_was_weighed(name):
    """A term of each kind: what it changes in flights of the amended model is its signature, in flights near trim."""
    believed = believe(name)
    ideal = believed.suite.without_errors()
    records = tuple(ideal.measure(truth, 0) for truth in truths(name, believed.aircraft)[2::2])
    base = _Asker(believed, records, "simulated").start
    kinds = {"Cl": ("thr",), "Cm": ("alpha",), "CY": ("beta",), "Cn": ("p", "alpha"), "CL": ("q",)}
    of = [(c, Term(tuple(Factor(n) for n in names))) for c, names in kinds.items()]
    of += [("Cm", Term((Factor("beta", modulus=True),))), ("Cm", Term((Factor("de", lag_s=0.2),)))]
    for coefficient, term in of:
        size = 1e-4 / max(float(np.std(increments((term,), along(believed, r), r.dt_s))) for r in records)
        effect = effect_of(coefficient, term, 1.0, size)
        (flown_change,) = changes(base, [(effect, np.array([size]))])
        signature = np.concatenate(
            [
                believed.in_noise_units(
                    r,
                    response(believed, r, coefficient, size * increments((term,), along(believed, r), r.dt_s))[..., 0],
                ).ravel()
                for r in records
            ]
        )
        alike = float(signature @ -flown_change / np.sqrt((signature @ signature) * (flown_change @ flown_change)))
        assert alike > 0.9, (coefficient, term.label, alike)
    lagged = believed.with_effect(effect_of("Cm", of[-1][1], 1.0, 1.0), {"size": 0.1})
    assert len(lagged.aircraft.memories) == len(believed.aircraft.memories) + 1
