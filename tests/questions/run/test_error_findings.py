"""Whose standard errors hold: as many true values within two of them as chance allows."""

from types import SimpleNamespace

from testbench.evaluation.derivatives import ParameterEstimate
from testbench.page.words import MOST_WORDS
from testbench.questions.run.result import error_findings


def case(name: str, off: list[float]) -> SimpleNamespace:
    estimates = [ParameterEstimate(f"p{k}", d, 1.0, 1.0, True, 0.0) for k, d in enumerate(off)]
    estimator = SimpleNamespace(shown=name)
    return SimpleNamespace(
        suite="s", label=f"s, {name}", estimator=estimator, evaluation=SimpleNamespace(parameters=estimates)
    )


def test_a_method_whose_errors_hold_is_told_from_one_whose_errors_are_too_small() -> None:
    first, told = error_findings([case("good", [0.1] * 10 + [2.5]), case("bad", [0.1] * 5 + [5.0] * 6)])
    assert first.startswith("of 2 methods only good states errors that agree with this flight: 10 of 11")
    assert told.endswith("good 10 of 11, bad 5 of 11")
    assert len(first.split()) <= MOST_WORDS


def test_where_none_holds_the_nearest_is_named() -> None:
    first, _ = error_findings([case("near", [0.1] * 6 + [5.0] * 5), case("far", [5.0] * 11)])
    assert first.startswith("none of 2 methods states correct errors; near is the best, with 6 of 11")


def test_one_method_alone_or_no_truth_is_no_comparison() -> None:
    assert error_findings([case("one", [0.1] * 5)]) == []
    assert error_findings([]) == []
