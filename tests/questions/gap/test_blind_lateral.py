"""The blind test in roll and yaw: what flies, what is sealed, and how rows become rates."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from studies.blind.cases import Case, counts_of, opened, seal
from studies.blind.flights import CONTROLS, fly_lateral, suite
from studies.blind.kinds import LATERAL_ERRORS, LATERAL_KINDS
from studies.blind.lateral import SEED, page
from studies.blind.lateral_truths import LATERAL
from studies.blind.parts import parts_said
from studies.blind.rates import flown_factor, in_part, rates, right
from studies.blind.run import believe, searched
from studies.blind.score import answer, judge
from studies.blind.truth import Truth

from testbench.core.record import FlightRecord
from testbench.questions.gap.priors import LATERAL_PRIORS, PRIORS

STRATA = counts_of("lateral")
TAKEN_OUT, NOTHING = "lateral with the true effect taken out", "lateral nothing"
SEALED = Path(__file__).resolve().parents[3] / "results" / "gap" / "lateral"
# Least sum of squares, in units of the noise, by which a kind must change the six records; noise alone changes none.
SEEN = 200.0


@cache
def flown(kind: str, which: str = "rich") -> dict[str, FlightRecord]:
    """Return the flights of the taurus with one kind in the middle of its sizes."""
    draws = [LATERAL_KINDS[kind].draw(np.random.default_rng(i)) for i in range(8)] if kind else []
    sizes = {n: sorted(d[n] for d in draws)[4] for n in draws[0]} if draws else {}
    return fly_lateral("taurus", LATERAL[kind](sizes, "taurus") if kind else Truth(), which, 5)


def difference(a: FlightRecord, b: FlightRecord) -> float:
    noise = suite("lateral").noise_std
    names = [n for n in a.channels if noise.get(n, 0.0) > 0.0]
    d = (a.columns(names) - b.columns(names)) / np.array([noise[n] for n in names])
    return float(np.sum((d - d.mean(axis=0)) ** 2))


@pytest.mark.parametrize("kind", LATERAL_KINDS)
def test_a_kind_flies_shows_in_the_readings_and_not_in_the_commands(kind):
    plain, records = flown(""), flown(kind)
    assert sum(difference(r, plain[n]) for n, r in records.items()) > SEEN
    for name, record in records.items():
        for control in CONTROLS:
            moved = record[f"{control}_cmd"] - record[f"{control}_cmd"][0]
            assert moved == pytest.approx(plain[name][f"{control}_cmd"] - plain[name][f"{control}_cmd"][0], abs=1e-8)
        assert set(record.provenance) == {"manoeuvre"}, "what was hidden is not told"


def test_kinds_have_right_names_and_coefficients_are_off_by_the_priors_of_the_workflow():
    assert set(LATERAL_KINDS) == set(LATERAL)
    known, further = searched(believe("eolo", draw="lateral"))
    assert {n for k in LATERAL_KINDS.values() for n in k.names} <= {*known, *further}
    assert {k.names[0] for k in LATERAL_KINDS.values() if k.form == "library"} <= set(known)
    assert LATERAL_ERRORS == {**PRIORS, **LATERAL_PRIORS}


def test_what_is_taken_out_is_not_searched():
    case = Case("x 1", TAKEN_OUT, "taurus", ("slow aileron servo",), ({},), {}, (("aileron_lag",),))
    assert case.without == ("aileron_lag",)
    left, further = searched(believe("taurus", draw="lateral"), case.without)
    assert "aileron_lag" not in left
    assert not any("aileron_lag" in e.contains for e in (*left.values(), *further.values()))
    assert "rudder_lag" in left
    assert replace(case, stratum="lateral library form").without == ()


def test_a_term_that_no_library_holds_acts_where_its_controls_or_its_coefficient_do():
    lagged = "Cn by (dr lagged by 0.1 s - dr) + Cl by (dr lagged by 0.1 s - dr)"
    assert parts_said([lagged]) == {"rudder path"}
    assert parts_said(["Cn by beta^3"]) == {"fin"}
    assert parts_said(["Cl by alpha*|da|"]) == {"aileron path"}
    assert parts_said(["rudder_lag", "lost_wing"]) == {"rudder path", "wing"}


def test_the_answers_are_those_that_were_sealed():
    cases = opened((SEALED / "answers.json").read_text(encoding="utf-8").removesuffix("\n"))
    assert {s: sum(c.stratum == s for c in cases) for s in STRATA} == dict(STRATA)
    assert (SEALED / "sealed.sha256").read_text(encoding="utf-8").startswith(seal(cases)[1])
    assert (SEALED / "sealed.sha256").read_text(encoding="utf-8").endswith(f"seed {SEED}\n")
    assert {c.kinds for c in cases if c.stratum == NOTHING} == {()}
    for stratum, form in (("lateral library form", "library"), ("lateral other form", "other"), (TAKEN_OUT, "library")):
        kinds = [LATERAL_KINDS[c.kinds[0]] for c in cases if c.stratum == stratum]
        assert {k.form for k in kinds} == {form}
        assert len({k.names for k in kinds}) > 10


def test_a_linkage_s_ratio_is_one_of_the_coefficients_of_its_control():
    kind = ("aileron linkage ratio",), ({"gain": 1.5},), {"Cl_da": 0.9, "Cn_dr": 1.1}
    case = Case("x 1", TAKEN_OUT, "taurus", *kind, (("aileron_surface_scale",),))
    flown = [flown_factor(case, n) for n in ("Cl_da", "Cn_da", "Cn_dr", "Cl_p")]
    assert flown == pytest.approx([1.35, 1.5, 1.1, 1.0])


def test_a_wrong_coefficient_and_what_is_not_told_from_it_are_a_set():
    ratio = ("aileron linkage ratio",), ({"gain": 1.5},), {"Cl_da": 0.9}, (("aileron_surface_scale",),)
    case = Case("lateral library form 1", "lateral library form", "taurus", *ratio)
    row = {"outcome": "no gap", "names": [], "accused": [["Cl_da", 1.35, 0.01, ["aileron_surface_scale"]]]}
    assert answer(case, row) == ("set", ["Cl_da", "aileron_surface_scale"])
    assert judge(case, row).verdict == "in set"
    assert in_part(case, row)
    stranger = row | {"accused": [["Cl_da", 1.35, 0.01, ["beta_scale"]]]}
    assert judge(case, stranger).verdict == "wrong set"
    assert not in_part(case, stranger)
    as_drawn = row | {"accused": [["Cl_da", 0.91, 0.01, ["aileron_surface_scale"]]]}
    assert answer(case, as_drawn) == ("no gap", [])
    assert answer(case, row | {"outcome": "unexplained"}) == ("unexplained", [])


def test_rows_become_rates():
    lag = ("slow aileron servo",), ({"lag_rad_s": 8.0},), {"Cl_p": 1.2}, (("aileron_lag",),)
    cases = [Case(f"lateral library form {i}", "lateral library form", "eolo", *lag) for i in (1, 2, 3)]
    cases += [Case(f"{TAKEN_OUT} {i}", TAKEN_OUT, "taurus", *lag) for i in range(1, 7)]
    cases.append(Case(f"{NOTHING} 1", NOTHING, "eolo", (), (), {}, ()))
    said = {
        "lateral library form 1": ("named", ["aileron_lag"], []),
        "lateral library form 2": ("named", ["beta_scale"], [["Cl_p", 1.21, 0.01]]),  # the coefficient is right
        "lateral library form 3": ("unexplained", [], [["Cl_p", 1.5, 0.01]]),
        f"{TAKEN_OUT} 1": ("named", ["aileron_transport_delay"], []),  # the part of what was taken out
        f"{TAKEN_OUT} 2": ("unexplained", [], []),
        f"{TAKEN_OUT} 3": ("set", ["aileron_transport_delay", "p_lag"], []),
        f"{TAKEN_OUT} 4": ("no gap", [], []),
        f"{TAKEN_OUT} 5": ("no gap", [], [["Cl_p", 1.2, 0.01, []], ["Cl_da", 0.6, 0.01, []]]),  # the part, at any rate
        f"{TAKEN_OUT} 6": ("no gap", [], [["Cl_p", 1.2, 0.01, ["beta_scale"]]]),  # drawn so
        f"{NOTHING} 1": ("named", ["r_scale"], []),
    }
    rows = {n: {"case": n, "outcome": o, "names": names, "accused": a} for n, (o, names, a) in said.items()}
    found = {(s, rate): (count, of) for s, rate, count, of in rates(cases, rows)}
    assert found["lateral library form", "right effect"] == (1, 3)
    assert found["lateral library form", "right part"] == (1, 3)  # of all cases: silence is not the right part
    assert found["lateral library form", "wrong part"] == (1, 3)
    assert found["lateral library form", "unexplained"] == (1, 3)
    assert found["lateral library form", "a coefficient accused by a wrong size"] == (1, 3)
    assert found[TAKEN_OUT, "unexplained or right part"] == (3, 6)
    assert found[TAKEN_OUT, "wrong part"] == (1, 6)
    assert found[TAKEN_OUT, "no gap, and no coefficient is wrong"] == (2, 6)
    assert found[NOTHING, "false gap"] == (1, 1)
    assert [right(c, rows[c.name]) for c in cases] == [True, False, False, True, True, False, False, True, False, False]
    assert not in_part(cases[1], rows[cases[1].name])
    text = page(cases, {n: r | {"seconds": 30.0} for n, r in list(rows.items())[:9]})
    assert "**9 of 10 planned cases have been run**" in text
    assert "| lateral library form | right effect | 1 of 3 | 6 to 79 % |" in text
    assert "| lateral library form 2 | eolo | slow aileron servo (lag_rad_s 8) | named | beta_scale |" in text
    assert "| lateral library form 2 | slow aileron servo | named | Cl_p 1.210 ± 0.040 | Cl_p 1.200 |" in text
    assert "| lateral library form 1 |" not in text  # what is right is not told
