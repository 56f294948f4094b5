"""The tables: their figures, their units, and that page, CSV and JSON say the same."""

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from questions.conftest import MODES
from rich.console import Console

from testbench.core.advice import doubt, note, wrong
from testbench.evaluation.derivatives import ParameterEstimate
from testbench.evaluation.modes import match_poles
from testbench.page.labels import axis_label, file_stem, number, ratio_unit, shown_unit, symbol, unique
from testbench.page.tables import Column, Table
from testbench.page.terminal import print_answer
from testbench.questions.run.answer import run_answer
from testbench.questions.run.labels import case_names
from testbench.questions.run.page import run_page
from testbench.questions.run.tables import (
    bode_table,
    condition_table,
    excitation_table,
    flown_tables,
    manoeuvre_table,
    mode_table,
    mrse_table,
    pole_table,
    polynomial,
    polynomials,
    reference_tables,
    result_tables,
    sensor_table,
    transfer_function_table,
)

pytestmark = pytest.mark.drawn
FOUND = {"claimed": {"q": [s for pole in MODES.values() for s in (pole, pole.conjugate())]}}
"""Poles of a model that has every mode."""


def column(table: Table, key: str) -> list:
    k = [c.key for c in table.columns].index(key)
    return [row[k] for row in table.rows]


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (12.345, 3, "12.3"),
        (-0.04567, 2, "−0.046"),
        (99999.0, 3, "99999"),
        (1.234e-7, 3, "1.23·10⁻⁷"),
        (-2.5e8, 2, "−2.5·10⁸"),
        (math.inf, 3, "inf"),
    ],
)
def test_numbers_read_well(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_angles_are_shown_in_degrees_and_the_throttle_in_percent() -> None:
    assert shown_unit("q") == (pytest.approx(180.0 / math.pi), "deg/s")
    assert shown_unit("qdot")[1] == "deg/s²"
    assert shown_unit("az") == (1.0, "m/s²")
    assert shown_unit("thr") == (pytest.approx(100.0), "%")
    assert axis_label("alpha", deviation=True) == "Δα, deg"
    assert axis_label("eta_1") == "η1"
    assert ratio_unit("V", "de") == (pytest.approx(math.pi / 180.0), "(m/s)/deg")
    assert ratio_unit("q", "de") == (pytest.approx(1.0), "(deg/s)/deg")


@pytest.mark.parametrize(
    ("name", "stem"),
    [("a b/c", "a_b_c"), ("../../etc", "etc"), ("", "unnamed"), ("ok-1.2_x", "ok-1.2_x"), ("x" * 300, "x" * 120)],
)
def test_file_names_are_safe(name: str, stem: str) -> None:
    assert file_stem(name) == stem


def test_names_of_cases_say_what_differs(result) -> None:
    assert case_names(result.cases) == ["eolo_no_alpha", "eolo_alpha"]
    assert case_names(result.cases[:1] * 2) == ["eolo_no_alpha, n = 2", "eolo_no_alpha, n = 2 (2)"]
    assert unique(["a", "b", "a"]) == ["a", "b", "a (2)"]


def test_mrse_stands_side_by_side_with_a_dash_for_what_is_not_sensed(result) -> None:
    table = mrse_table(result)
    assert column(table, "output") == ["α", "q", "θ", "mean"]
    assert column(table, "eolo_no_alpha validation") == [None, *[pytest.approx(25.0)] * 3]
    assert column(table, "eolo_alpha identification") == [pytest.approx(10.0)] * 4
    assert table.groups() == [("", 1), ("eolo_no_alpha", 2), ("eolo_alpha", 2)]
    assert table.cells()[0][1] == ("–", True)
    assert table.cells()[1][1] == ("25.00", True)


def test_csv_and_json_hold_the_figures_of_the_page_with_all_digits(result) -> None:
    table = mrse_table(result)
    head, *rows = csv.reader(io.StringIO(table.to_csv()))
    assert head[1] == "eolo_no_alpha identification [%]"
    assert rows[0][1] == ""
    assert float(rows[1][1]) == table.rows[1][1]
    content = json.loads(table.to_json())
    assert content["rows"][0]["eolo_no_alpha identification"] is None
    assert content["rows"][1]["eolo_no_alpha identification"] == table.rows[1][1]
    assert content["units"]["eolo_alpha validation"] == "%"


def test_what_is_not_finite_is_null_in_json_and_shown_on_the_page() -> None:
    table = Table("t", "T", "C.", (Column("a", "a"), Column("b", "b")), ((math.nan, math.inf),))
    assert json.loads(table.to_json())["rows"] == [{"a": None, "b": None}]
    assert [text for text, _ in table.cells()[0]] == ["–", "inf"]
    assert table.to_csv() == "a,b\n,inf\n"


def test_every_table_has_a_caption_and_rows_of_its_width(result) -> None:
    tables = [*flown_tables(result), *result_tables(result)]
    assert len({t.name for t in tables}) == len(tables)
    for table in tables:
        assert table.caption.endswith(".")
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert len({c.key for c in table.columns}) == len(table.columns)


def test_modes_found_stand_beside_the_true_ones(result) -> None:
    table = mode_table(result)
    assert column(table, "mode") == ["phugoid", "short period", "1st symmetric wing bending"]
    found = abs(-2.0 + 4.2j)
    assert column(table, "eolo_alpha wn")[1] == pytest.approx(found)
    assert column(table, "eolo_alpha wn error")[1] == pytest.approx(100.0 * (found / abs(-2.0 + 4.0j) - 1.0))
    assert column(table, "eolo_alpha wn")[2] is None


def test_a_mode_has_a_row_for_each_model_that_found_it_and_one_if_none_did(result) -> None:
    def matched(case, outputs, found):
        true = {"phugoid": -0.02 + 0.5j, "short period": -2.0 + 4.0j}
        return replace(case, evaluation=replace(case.evaluation, poles=tuple(match_poles(found, true, outputs))))

    first, second = result.cases
    none, some = matched(first, "q", [-90.0]), matched(second, "alpha, q, theta", [-0.02 + 0.6j])
    table = mode_table(replace(result, cases=(none, some)))
    assert column(table, "mode") == ["phugoid", "short period"]
    assert table.rows[0][1] == "all outputs"
    assert all(value is None for value in table.rows[1][4:])


def test_printed_derivatives_stand_beside_those_found(result) -> None:
    def known(case):
        found = ParameterEstimate("M_q", -1.9, 0.1, 0.1, True, None)
        return replace(case, evaluation=replace(case.evaluation, parameters=(found,)))

    printed = {"source": "a book", "M_q": -2.0, "Z_q": 0.1}
    (table,) = reference_tables(replace(result, reference=printed, cases=(result.cases[0], known(result.cases[1]))))
    assert [c.group for c in table.columns[2:]] == ["eolo_alpha"] * 2
    assert table.rows == (("M_q", -2.0, -1.9, 0.1), ("Z_q", 0.1, None, None))
    assert "not derivatives" not in table.caption
    (bare,) = reference_tables(replace(result, reference=printed))
    assert "not derivatives" in bare.caption


def test_every_pole_is_listed_once_with_frequency_and_damping(result) -> None:
    table = pole_table(result)
    assert column(table, "real") == [-0.3, -2.0, -0.3, -2.0]
    assert column(table, "zeta")[:2] == [None, pytest.approx(2.0 / abs(-2.0 + 4.2j))]
    assert column(table, "outputs")[0] == "q, θ"


def test_bode_errors_are_those_of_the_evaluation(result) -> None:
    table = bode_table(result)
    assert column(table, "eolo_no_alpha magnitude")[1:] == [pytest.approx(20.0 * math.log10(1.25))] * 2
    assert column(table, "eolo_alpha complex") == [pytest.approx(10.0)] * 3
    assert "0.500 to 2.00 rad/s" in table.caption


def test_excitation_gives_the_verdict_per_mode(result) -> None:
    table = excitation_table(result)
    assert column(table, "verdict") == ["excited", "excited", "NOT excited"]
    assert column(table, "input share") == [pytest.approx(10.0)] * 3
    assert excitation_table(replace(result, truth=None)) is None


def test_the_trim_is_shown_in_degrees_and_percent(result) -> None:
    table = condition_table(result.truth)
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["trim α"] == (pytest.approx(math.degrees(0.05)), "deg")
    assert rows["trim δt"] == (pytest.approx(40.0), "%")


def test_inputs_are_said_in_words_without_what_is_left_at_its_default(result) -> None:
    assert column(manoeuvre_table(result), "inputs") == [
        "doublet on δe, 2 deg, period 2 s",
        "doublet on δe, 2 deg, period 1 s",
    ]


def test_sensors_of_both_suites_are_listed_once_in_shown_units(result) -> None:
    table = sensor_table(result.suites)
    shared = len(result.suites[0].sensors)
    assert column(table, "suites") == ["all"] * shared + ["eolo_alpha"]
    alpha = next(s for s in result.suites[1].sensors if s.channel == "alpha")
    assert column(table, "noise std")[-1] == pytest.approx(math.degrees(alpha.noise_std))
    assert column(table, "source")[-1] == alpha.source


def test_polynomials_of_a_state_space_model_have_its_response() -> None:
    rng = np.random.default_rng(5)
    A, B, C, D = (
        0.4 * rng.standard_normal((3, 3)),
        rng.standard_normal((3, 2)),
        rng.standard_normal((2, 3)),
        np.ones((2, 2)),
    )
    model = {"inputs": ["de", "thr"], "outputs": ["q", "V"]} | {
        k: m.tolist() for k, m in zip("ABCD", (A, B, C, D), strict=True)
    }
    z = np.exp(0.7j)
    H = C @ np.linalg.solve(z * np.eye(3) - A, B) + D
    for output, given, above, below in polynomials(model):
        powers = z ** -np.arange(4.0)
        value = np.dot(above, powers) / np.dot(below, powers)
        expected = H[model["outputs"].index(output), model["inputs"].index(given)]
        assert value == pytest.approx(expected, rel=1e-9)  # conditioning of a 3rd-order characteristic polynomial


def test_transfer_functions_begin_after_one_delay(make_case, result) -> None:
    model = {"numerators": {"q": [0.5, 0.0]}, "denominators": {"q": [1.0, -1.5, 0.7]}}
    case = make_case("eolo_no_alpha", ("q",), result.flights, 0.0, claimed={"q": [-1.0 + 2.0j]}, polynomials=model)
    table = transfer_function_table(replace(result, cases=(case,)))
    assert table.rows == (("eolo_no_alpha", "q / δe", "0.5 z⁻¹", "1 − 1.5 z⁻¹ + 0.7 z⁻²"),)


@pytest.mark.parametrize(
    ("coefficients", "text"),
    [([1.0, -1.0], "1 − z⁻¹"), ([0.0, 0.0], "0"), ([0.0, -0.25, 1e-20, 3.0], "−0.25 z⁻¹ + 3 z⁻³"), ([], "0")],
)
def test_polynomials_are_printed_as_one_reads_them(coefficients: list[float], text: str) -> None:
    assert polynomial(coefficients) == text


def test_printed_values_stand_beside_the_nearest_pole(result) -> None:
    printed = {
        "source": "a book",
        "wn_rad_s": 4.6,
        "zeta": 0.4,
        "wn_phugoid_rad_s": 0.01,
        "zeta_phugoid": 0.1,
        "M_q": -2.0,
    }
    reference, others = reference_tables(replace(result, reference=printed))
    assert column(reference, "printed") == ["short period"] * 2 + ["phugoid"] * 2
    wn = abs(-2.0 + 4.2j)
    assert column(reference, "wn")[:2] == [pytest.approx(wn)] * 2
    assert column(reference, "zeta difference")[0] == pytest.approx(2.0 / wn - 0.4)
    assert column(reference, "wn")[2:] == [None, None]  # nothing lies within a factor of e of 0.01 rad/s
    assert others.rows == (("M_q", -2.0),)
    assert "a book" in reference.caption


def test_a_recorded_flight_answers_against_the_printed_values(result) -> None:
    lines = run_answer(replace(result, truth=None, reference={"source": "a book", "wn_rad_s": 4.6, "zeta": 0.4}))
    assert lines[0].kind == "lead"
    assert lines[0].text.startswith(
        "Short period (printed wn 4.60\u00a0rad/s, zeta 0.400): eolo_no_alpha finds wn 4.65"
    )


def test_doubts_come_last_and_apart(result) -> None:
    lines = run_answer(result)
    assert [line.kind for line in lines].index("doubt") == len(lines) - 1
    assert "eolo_alpha, dsr_e: doubt this." in lines[-1].text
    assert "adding alpha" in lines[0].text.lower()


def test_many_doubts_are_counted_instead_of_listed(make_case, result) -> None:
    many = make_case("eolo_alpha", ("q",), result.flights, 0.1, advice=tuple(f"doubt {i}" for i in range(9)), **FOUND)
    lines = run_answer(replace(result, cases=(many,)), most_doubts=3)
    doubts = [line.text for line in lines if line.kind == "doubt"]
    assert len(doubts) == 4
    assert doubts[-1] == "6 more doubts in the report, with the models."


def test_what_must_not_be_used_stands_first_and_notes_leave_the_answer(make_case, result) -> None:
    advice = (note("structure_not_judged", "give more."), doubt("delay", "it is late."), wrong("on_bound", "a bound."))
    cases = tuple(
        make_case(name, ("q",), result.flights, 0.1, advice=advice, **FOUND) for name in ("eolo_no_alpha", "eolo_alpha")
    )
    found = replace(result, cases=cases)
    lines = run_answer(found)
    kinds = [line.kind for line in lines]
    assert kinds[:3] == ["lead", "wrong", "wrong"]  # the verdict, and the first reason with it
    assert kinds.count("wrong") == 3  # in one sentence, and the reason of each
    assert kinds[-3:] == ["doubt", "doubt", "note"]
    assert lines[1].text == "Do not use any of the 2 models: the reasons follow."
    assert "Do not use: eolo_no_alpha, dsr_e: a bound." in [line.text for line in lines]
    assert lines[-1].text == "Give more."  # once: it holds for both models
    assert all("give more" not in text for text in found.findings)
    screen = Console(file=io.StringIO(), width=200)
    print_answer(screen, lines)
    assert "a bound" in screen.file.getvalue()
    assert "Give more" not in screen.file.getvalue()
    page = run_page(found).html([])
    assert page.count("Give more.") == 1
    assert page.index("Give more.") > page.index('<h2 id="notes">Notes</h2>') > page.index('id="models"')
    assert '<span class="status-wrong">do not use</span>' in page


def test_where_the_truth_is_known_it_says_what_is_wrong(make_case, result) -> None:
    bent = (wrong("bend", "the response is nonlinear in q, and it shifts a pole by some 94 %."),)
    right = make_case("eolo_alpha", ("q",), result.flights, 0.1, advice=bent, **FOUND)
    assert [(a.severity, a.code) for a in right.advice] == [("doubt", "bend")]
    slow = [*FOUND["claimed"]["q"][2:], -0.02 + 0.8j, -0.02 - 0.8j]
    lost = make_case("eolo_no_alpha", ("q",), result.flights, 0.1, advice=bent, claimed={"q": slow})
    assert (lost.advice[0].severity, str(lost.advice[0])) == ("wrong", "the phugoid is 60 % off")
    assert lost.advice[1].severity == "doubt"
    alone = replace(right, evaluation=replace(right.evaluation, poles=()))  # a recorded flight has residuals alone
    assert alone.advice == right.model.advice
    lines = run_answer(replace(result, cases=(right, lost)))
    assert any("Do not use: eolo_no_alpha, dsr_e: the phugoid is 60" in line.text for line in lines)
    assert not any("Do not use: eolo_alpha" in line.text for line in lines)


def test_without_findings_the_verdicts_answer(make_result) -> None:
    one = make_result(truth=None)
    lines = run_answer(replace(one, cases=one.cases[:1]))
    assert lines[0].text.startswith("eolo_no_alpha: identification: MRSE 25")


def test_symbols_are_those_of_the_channel_table() -> None:
    assert symbol("de") == "δe"
