"""The verdicts follow from what was computed, and the words from the verdicts."""

import numpy as np
import pytest

from testbench.questions.reproduce import (
    b1_alpha,
    eolo_air_data,
    eolo_bode,
    eolo_lost_pole,
    eolo_model,
    taurus_causes,
    taurus_model,
)
from testbench.questions.reproduce.bench import TABLE_3, TABLE_4, A
from testbench.questions.reproduce.section import Why, Written, claim_row, judge_claim, judge_number, number_row, tally

WHY = Why("same", "similar", "other")


@pytest.mark.parametrize(
    ("printed", "ours", "verdict"),
    [
        (10.0, 10.0, "agrees"),
        (10.0, 10.9, "agrees"),
        (10.0, 11.1, "agrees in kind"),
        (10.0, 5.1, "agrees in kind"),
        (10.0, 20.1, "differs"),
        (10.0, 4.9, "differs"),
        (-4.3, 4.3, "differs"),
        (0.0, 0.0, "agrees"),
        (0.0, 1.0, "differs"),
        (10.0, float("nan"), "differs"),
    ],
)
def test_a_number_is_judged_by_its_ratio(printed, ours, verdict):
    assert judge_number(printed, ours) == verdict


def test_a_row_changes_verdict_and_reason_with_what_was_computed():
    rows = [number_row("x", "Table 1", 10.0, v, Written("%"), WHY) for v in (10.0, 15.0, 50.0)]
    assert [(r.verdict, r.why) for r in rows] == [
        ("agrees", "same"),
        ("agrees in kind", "similar"),
        ("differs", "other"),
    ]
    claims = [
        claim_row("x", "here", "yes", "?", judge_claim(*case), WHY) for case in ((True,), (False, True), (False,))
    ]
    assert [c.verdict for c in claims] == ["agrees", "agrees in kind", "differs"]
    assert tally((*rows, *claims[:1])) == "2 agree, 1 agrees in kind, 1 differs"


def own_table(mean: float) -> dict[int, dict[str, tuple[float, float, float, float]]]:
    return {n: dict.fromkeys(("q", "V", "theta", "mean"), (mean, mean, mean, mean)) for n in (4, 5)}


def test_table_3_agrees_only_where_our_errors_are_the_printed_ones():
    z, values = np.linalg.eigvals(A), np.array([50.0, 20.0, 9.0, 0.9])
    as_printed = {n: {k: (0.0, 0.0, *v) for k, v in rows.items()} for n, rows in TABLE_3.items()}
    same = [c for c in eolo_model.comparisons(as_printed, z, values) if c.where.startswith("Table 3")]
    assert len(same) == 16
    assert {c.verdict for c in same} == {"agrees"}
    other = [c for c in eolo_model.comparisons(own_table(1.0), z, values) if c.where.startswith("Table 3")]
    assert {c.verdict for c in other} == {"differs"}


def test_the_poles_of_the_printed_matrix_agree_with_themselves_and_others_do_not():
    values = np.array([50.0, 20.0, 9.0, 5.0])
    rows = {c.what: c.verdict for c in eolo_model.comparisons(own_table(50.0), np.linalg.eigvals(A), values)}
    assert rows["model order 4 from the singular values"] == "agrees"
    assert rows["frequency of the slow pair"] == rows["positive real pole"] == rows["z3: a real pole z < 0"] == "agrees"
    damped = np.array([0.9 + 0.1j, 0.9 - 0.1j, 0.5, 0.2])
    rows = {c.what: c.verdict for c in eolo_model.comparisons(own_table(50.0), damped, values)}
    assert rows["frequency of the slow pair"] == rows["z3: a real pole z < 0"] == "differs"
    assert rows["unstable prediction"] == "differs"


def test_words_on_table_3_follow_the_errors():
    z, values = np.linalg.eigvals(A), np.array([50.0, 20.0, 9.0, 0.9])
    still = " ".join(eolo_model.findings(own_table(100.0), z, values, 800, 1051))
    moves = " ".join(eolo_model.findings(own_table(40.0), z, values, 100, 1051))
    assert "no motion gets" in still
    assert "nearly interpolates" in still
    assert "no motion gets" not in moves
    assert "nearly interpolates" not in moves


def test_table_4_and_its_words_follow_the_errors():
    study = {"25 Hz": [(0.12, 40.0, 10.0), (1.0, 10.0, 10.0)]}
    best = {
        name: {
            w: dict.fromkeys(("q", "V", "theta", "common"), v) for w, v in zip(("without", "with"), pair, strict=True)
        }
        for name, pair in (("DSR_e, L = 3", (40.0, 10.0)), ("other", (9.0, 9.0)))
    }
    rows = b1_alpha.comparisons(TABLE_4, study, best)
    assert {c.verdict for c in rows if c.where.startswith("Table 4")} == {"agrees"}
    assert rows[-1].verdict == "agrees in kind"
    for row in rows:
        if row.where.startswith("Table 4"):
            assert "Tuned: 100 Hz and a tenth of the noise were set because they come nearest" in row.why
        else:  # at the suite's own rate and noise
            assert "Tuned" not in row.why
    without_gain = {w: dict.fromkeys(column, 5.0) for w, column in TABLE_4.items()}
    rows = b1_alpha.comparisons(without_gain, study, best)
    assert next(c for c in rows if c.what.startswith("how many times")).verdict == "differs"
    words = " ".join(b1_alpha.findings(TABLE_4, TABLE_4, study, best, 3.4))
    assert "Table 4 comes out:" in words
    assert "nothing left for α" in words
    words = " ".join(b1_alpha.findings(without_gain, TABLE_4, {"25 Hz": [(0.12, 40.0, 10.0)]}, best, 3.4))
    assert "Table 4 differs" in words
    assert "nothing left for α" not in words


def test_when_alpha_is_needed_is_read_off_the_study():
    assert b1_alpha.enough([(0.1, 40.0, 10.0), (0.5, 11.0, 10.0), (1.0, 10.0, 10.0)]) == 0.5
    assert b1_alpha.enough([(0.1, 40.0, 10.0), (0.5, 40.0, 10.0)]) is None


def trial(label: str, lost: float, fourth: float = 0.9, found: float = 0.0, fast: float = float("nan")):
    return eolo_lost_pole.Trial(label, 0.01 * int(label.rsplit("=", 1)[1]), lost, found, fast, fourth, 12)


def test_what_removes_the_lost_pole_is_read_off_the_trials():
    curve = [trial("L = 4", 0.6), trial("L = 8", 0.0), trial("L = 16", 0.2), trial("L = 24", 0.0), trial("L = 48", 0.0)]
    assert eolo_lost_pole.clear_from(curve).label == "L = 24"
    assert eolo_lost_pole.clear_from([trial("L = 4", 0.6)]) is None
    vane = [trial("L = 4", 0.0)]
    curves = {eolo_lost_pole.PAPER: curve, eolo_lost_pole.PLAIN: curve, eolo_lost_pole.VANE: vane}
    right = trial("DSR_e, L = 40", 0.0, 1.5, 1.0, -7.0)
    rows = {"DSR_e": (trial("DSR_e, L = 4", 0.6), right)}
    words = " ".join(eolo_lost_pole.findings(curves, trial("L = 4", 0.0), {}, rows, [], -7.27))
    assert "a future from 0.24 s on" in words
    assert "α measured" in words
    assert "with DSR_e, L = 40" in words
    assert "below it, its pole is drawn by chance" in words
    assert eolo_lost_pole.comparison(curve[0]).verdict == "agrees"
    assert eolo_lost_pole.comparison(trial("L = 4", 0.0)).verdict == "differs"


def test_the_cause_of_the_taurus_poles_is_the_change_that_helps_most():
    settings = [(p, r, c) for p in (2.0, 0.5) for r in (8.0, 40.0) for c in (0.4, 3.0, None)]
    found = dict.fromkeys(settings, 200.0)
    assert taurus_causes.cause(found | {(2.0, 8.0, None): 30.0})[0] == "no filter"
    assert taurus_causes.cause(found | {(0.5, 8.0, 0.4): 30.0})[0] == "doublets of 0.5 s"
    assert "log has its share" in " ".join(taurus_causes.findings(found))


def test_the_loop_of_the_taurus_paper_is_judged_by_pitch():
    assert taurus_causes.loop_row({2.0: (20.0, False), 3.0: (60.0, False), 4.0: (120.0, False)}).verdict == "agrees"
    assert taurus_causes.loop_row({2.0: (20.0, False), 3.0: (30.0, False), 4.0: (float("nan"), True)}).verdict == (
        "agrees in kind"
    )
    assert taurus_causes.loop_row({2.0: (20.0, False), 3.0: (20.0, False), 4.0: (20.0, False)}).verdict == "differs"


def test_the_printed_transfer_functions_agree_with_themselves_and_a_modal_fit_changes_the_words():
    printed = taurus_model.printed_poles()
    poles = {o: np.concatenate([s, s[s.imag > 0].conj()]) for o, s in printed.items()}
    fit = dict.fromkeys(poles, 95.0)
    rows = taurus_model.comparisons(poles, fit)
    assert {c.verdict for c in rows if c.where.startswith("equation ")} == {"agrees"}
    short = -6.9 + 6.5j
    words = taurus_model.findings(poles, fit, short, 0.3)
    assert "none of their 4 oscillatory poles" in words[0]
    right = {o: np.array([short, short.conjugate(), -0.1, -0.2]) for o in poles}
    words = taurus_model.findings(right, fit, short, 0.3)
    assert "4 of their 4 oscillatory poles" in words[0]
    assert "nearly the same set" in words[1]


def test_the_printed_model_responds_as_its_matrices_say():
    """At z = 1 the response is C (I - A)^-1 B + D; the pair of poles puts the peak of q near 0.465 rad/s."""
    omega = np.linspace(0.1, 2.0, 400)
    H = np.abs(eolo_bode.printed_response(omega)[:, 0, 0])
    assert omega[np.argmax(H)] == pytest.approx(0.465, abs=0.02)


def test_the_likeness_of_figure_8_is_judged_by_decibels():
    speeds = {13.0: [], 16.0: [], 19.0: [], 22.0: ["torsion"], 25.0: ["torsion"]}

    def verdicts(q: float, V: float) -> list[str]:
        distance = {v: np.array([q + abs(v - 16.0), V, q]) for v in speeds}
        assert eolo_bode.nearest_speed(distance) == 16.0
        return [c.verdict for c in eolo_bode.comparisons(np.array([q, V, q]), distance, speeds)]

    assert verdicts(1.0, 2.0) == ["agrees", "agrees", "agrees"]
    assert verdicts(5.0, 20.0) == ["agrees in kind", "agrees in kind", "agrees"]
    assert verdicts(9.0, 20.0)[:2] == ["differs", "differs"]


def test_what_a_vane_is_worth_needs_paired_noises_and_a_size():
    motion = eolo_air_data.Motion("longitudinal", (), ("de",), ("q",), "alpha", {"mode": -1.0 + 0.0j})
    without = eolo_air_data.Outcome({"mode": np.full(8, 30.0)}, 75.0)
    half = eolo_air_data.Outcome({"mode": np.where(np.arange(8) < 4, 10.0, 40.0)}, 75.0)
    little = eolo_air_data.Outcome({"mode": np.full(8, 29.0)}, 75.0)
    much = eolo_air_data.Outcome({"mode": np.full(8, 10.0)}, 0.0)
    assert eolo_air_data.better(without, much) == ("mode",)
    assert eolo_air_data.better(without, half) == eolo_air_data.better(without, little) == ()

    def verdict(with_: eolo_air_data.Outcome) -> str:
        found = {
            ("longitudinal", label, vane): with_ if vane else without
            for label in eolo_air_data.HORIZONS
            for vane in (False, True)
        }
        return eolo_air_data.comparison(motion, found).verdict

    assert verdict(much) == "agrees"
    assert verdict(little) == "differs"
    worse = eolo_air_data.Outcome({"mode": np.full(8, 60.0)}, 0.0)
    assert verdict(worse) == "agrees in kind"
