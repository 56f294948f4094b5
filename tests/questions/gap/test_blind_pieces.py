"""The blind test of pieces without quiet start: what is cut, what is sealed, and how rows become rates."""

from __future__ import annotations

from pathlib import Path

from studies.blind.cases import Case, opened, seal
from studies.blind.flights import fly_truth
from studies.blind.pieces import SEED, STRATA, page, piece, rates
from studies.blind.truth import Truth

from testbench.questions.gap.evidence.commanded import begins_quietly

SEALED = Path(__file__).resolve().parents[3] / "results" / "gap" / "pieces"


def test_a_piece_begins_within_its_manoeuvre():
    for name, record in fly_truth("taurus", Truth(), "short", 3).items():
        assert begins_quietly(record)
        assert not begins_quietly(piece(record)), name


def test_the_answers_are_those_that_were_sealed():
    cases = opened((SEALED / "answers.json").read_text(encoding="utf-8").removesuffix("\n"))
    assert {s: sum(c.stratum == s for c in cases) for s in STRATA} == dict(STRATA)
    assert (SEALED / "sealed.sha256").read_text(encoding="utf-8").startswith(seal(cases)[1])
    assert (SEALED / "sealed.sha256").read_text(encoding="utf-8").endswith(f"seed {SEED}\n")


def test_rows_become_rates():
    lag = ("slow servo",), ({"lag_rad_s": 10.0},), {"Cm_q": 1.2}, (("actuator_lag",),)
    cases = [Case(f"library form {i}", "library form", "eolo", *lag) for i in (1, 2, 3)]
    cases.append(Case("nothing 1", "nothing", "eolo", (), (), {}, ()))
    said = {
        "library form 1": ("named", ["actuator_lag"], []),
        "library form 2": ("named", ["alpha_scale"], [["Cm_q", 1.21, 0.01]]),  # the wrong part, the right coefficient
        "library form 3": ("unexplained", [], [["Cm_q", 1.5, 0.01]]),
        "nothing 1": ("unexplained", [], []),
    }
    rows = {n: {"case": n, "outcome": o, "names": names, "accused": a} for n, (o, names, a) in said.items()}
    found = {(s, rate): (count, of) for s, rate, count, of in rates(cases, rows)}
    assert found["library form", "right effect"] == (1, 3)
    assert found["library form", "right part"] == (1, 3)  # of all cases: silence is not the right part
    assert found["library form", "wrong part"] == (1, 3)
    assert found["library form", "unexplained"] == (1, 3)
    assert found["library form", "a coefficient accused by a wrong size"] == (1, 3)
    assert found["nothing", "false gap"] == (1, 1)
    text = page(cases, {n: r | {"seconds": 30.0} for n, r in list(rows.items())[:3]})
    assert "**3 of 4 planned cases have been run**" in text
    assert "| library form | right effect | 1 of 3 | 6 to 79 % |" in text
    assert "| library form 2 | slow servo | named | alpha_scale |" in text
    assert "| library form 1 | slow servo |" not in text  # what is right is not told
