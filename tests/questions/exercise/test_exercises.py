"""Every exercise of the list: two students differ, nothing handed out holds the truth, the worked solution passes."""

import math
import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from testbench.core.record import load_record
from testbench.questions.exercise.ask import Started, case_of, start
from testbench.questions.exercise.check import Result, judge
from testbench.questions.exercise.exercise import Choice, Number
from testbench.questions.exercise.seal import CATALOGUE, NAMES, PUBLIC_KEY, load_exercise, seal

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_FOLDERS: dict[tuple[str, str], Started] = {}


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """Return a function that starts an exercise for a student, once."""

    def begin(name: str, student: str) -> Started:
        if (name, student) not in _FOLDERS:
            folder = tmp_path_factory.mktemp("exercises") / f"{name}_{student}"
            _FOLDERS[name, student] = start(name, student, PUBLIC_KEY, folder)
        return _FOLDERS[name, student]

    yield begin
    _FOLDERS.clear()


@cache
def solution(folder: Path, name: str) -> dict[str, float | str]:
    return load_exercise(name).solve(folder)


def wrong(result: Result) -> list[str]:
    return [f"{v.question.key} = {v.given}: {v.words}" for v in result.verdicts if v.outcome != "right"]


def same(a: float | str, b: float | str) -> bool:
    return a == b if isinstance(a, str) or isinstance(b, str) else math.isclose(a, b, rel_tol=1e-6)


def data(begun: Started) -> dict[str, np.ndarray]:
    """Return what was measured: records, and tables of numbers beside them."""
    tables = {p.name: np.loadtxt(p, delimiter=",", skiprows=1) for p in sorted(begun.folder.glob("*.csv"))}
    return tables | {p.name: load_record(p).data for p in sorted((begun.folder / "records").glob("*.nc"))}


def texts(folder: Path) -> dict[str, str]:
    """Return the text of everything handed out that can be read, the provenance of the records included."""
    found = {
        p.name: p.read_text(encoding="utf-8") for p in folder.rglob("*") if p.suffix not in (".nc", "") and p.is_file()
    }
    for p in folder.rglob("*.nc"):
        found[p.name] = repr(load_record(p).provenance)
    return found


def numbers(values: object) -> list[float]:
    """Return all numbers of a nested case, other than those too common to mean anything (0, 1, whole ones)."""
    if isinstance(values, dict):
        return [x for v in values.values() for x in numbers(v)]
    if isinstance(values, (list, tuple)):
        return [x for v in values for x in numbers(v)]
    if isinstance(values, float) and values != round(values):
        return [values]
    return []


@pytest.mark.parametrize("name", NAMES)
def test_an_exercise_is_complete(name):
    exercise = load_exercise(name)
    text = (CATALOGUE / f"{name}.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {exercise.title}\n"), "the text begins with the title that is listed"
    assert "What is asked" in text
    assert "\n    " in text, "the text holds equations"
    keys = [q.key for q in exercise.questions]
    assert len(set(keys)) == len(keys)
    assert 5 <= exercise.minutes <= 120
    case = case_of(exercise, seal(PUBLIC_KEY, name, "anna"))
    answers = exercise.answer(case)
    assert set(answers) == set(keys)
    for question in exercise.questions:
        right = answers[question.key]
        if isinstance(question, Choice):
            assert right.value in question.options
            assert {m.value for m in right.mistakes} <= set(question.options) - {right.value}
        else:
            assert isinstance(question, Number)
            assert math.isfinite(float(right.value))
            assert question.band(float(right.value)) > 0.0
            assert all(math.isfinite(float(m.value)) for m in right.mistakes)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", NAMES)
def test_two_students_get_two_aircraft(name, started):
    anna, ben = started(name, "anna"), started(name, "ben")
    assert dict(anna.case.hidden) != dict(ben.case.hidden)
    first, second = data(anna), data(ben)
    assert first.keys() == second.keys()
    assert first, "something is measured"
    equal = [n for n in first if first[n].shape == second[n].shape and np.array_equal(first[n], second[n])]
    assert not equal
    assert "@" not in (anna.folder / "README.md").read_text(encoding="utf-8"), "a number of the text was not filled in"
    template = tomllib.loads((anna.folder / "answers.toml").read_text(encoding="utf-8"))
    assert set(template.values()) == {"?"}
    assert list(template) == [q.key for q in anna.exercise.questions]


@pytest.mark.parametrize("name", NAMES)
def test_the_truth_is_not_in_what_is_handed_out(name, started):
    """No hidden number and no right answer stands in any text, to six digits, or among the samples, to nine.

    What is given, or commanded (the amplitude of a doublet), is known.
    """
    anna = started(name, "anna")
    handed = texts(anna.folder)
    given = tomllib.loads(handed["given.toml"]) if "given.toml" in handed else {}
    answers = anna.exercise.answer(anna.case)
    secret = numbers(dict(anna.case.hidden)) + numbers([a.value for a in answers.values()])
    secret = [s for s in secret if not any(math.isclose(s, g, rel_tol=1e-6) for g in given.values())]
    readable = [f for f in handed if not f.endswith(".csv")]
    shown = np.array([float(x) for f in readable for x in NUMBER.findall(handed[f])])
    for s in secret:
        assert not np.any(np.isclose(shown, s, rtol=1e-6, atol=0.0)), f"{name}: {s} can be read"
    records = [load_record(p) for p in (anna.folder / "records").glob("*.nc")]
    samples = np.concatenate([r[c] for r in records for c in r.channels if not c.endswith("_cmd")] or [np.zeros(1)])
    for s in secret:
        assert not np.any(np.isclose(samples, s, rtol=1e-9, atol=0.0)), f"{name}: {s} is a sample"
    for f, text in handed.items():
        assert str(anna.case.seed) not in text, f"the seed of the noise stands in {f}"
        for word in ("factor", "amendment", "hidden"):
            assert word not in text or not f.endswith(".nc"), f"the provenance of {f} says more than it should"


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("student", ["anna", pytest.param("ben", marks=pytest.mark.slow)])
def test_the_worked_solution_passes(name, student, started):
    """Seeds are fixed; a whole class is solved by the test marked slow."""
    begun = started(name, student)
    assert wrong(judge(begun, solution(begun.folder, name))) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_worked_solution_passes_for_a_whole_class(name, tmp_path):
    """Of 20 students at most one may meet noise that takes an answer of the worked solution out of its band."""
    failed = []
    for i in range(20):
        begun = start(name, f"student {i}", PUBLIC_KEY, tmp_path / str(i))
        if wrong(judge(begun, begun.exercise.solve(begun.folder))):
            failed.append(i)
    assert len(failed) <= 1, failed


def test_the_same_student_gets_the_same_bytes(tmp_path):
    for name in ("doublet_length", "short_period"):
        folders = [start(name, "anna", PUBLIC_KEY, tmp_path / f"{name}{k}").folder for k in range(2)]
        files = [{p.relative_to(f): p.read_bytes() for p in f.rglob("*") if p.is_file()} for f in folders]
        assert files[0] == files[1]


def test_every_known_mistake_is_recognised():
    """Each mistake that an exercise lists is answered by its reason (or that of one just as near to what was given)."""
    known = 0
    for name in NAMES:
        exercise = load_exercise(name)
        case = case_of(exercise, seal(PUBLIC_KEY, name, "anna"))
        begun = Started(Path(), name, "anna", exercise, case)
        for key, right in exercise.answer(case).items():
            question = next(q for q in exercise.questions if q.key == key)
            for mistake in right.mistakes:
                verdict = next(v for v in judge(begun, {key: mistake.value}).verdicts if v.question.key == key)
                if isinstance(question, Number) and abs(float(mistake.value) - float(right.value)) <= question.band(
                    float(right.value)
                ):
                    continue
                assert verdict.outcome == "wrong", f"{name}.{key} = {mistake.value}"
                reasons = [m.why for m in right.mistakes if same(m.value, mistake.value)]
                assert any(why in verdict.words for why in reasons), f"{name}.{key} = {mistake.value}: {verdict.words}"
                known += 1
    assert known > 2 * len(NAMES)


def test_description_files_go_into_the_commands_they_are_for(started):
    from testbench.inference.kinematics import Kinematics
    from testbench.logs.read import read_records
    from testbench.questions.identify.ask import identify
    from testbench.questions.identify.scenario import RecordDescription

    for name in ("short_period", "order_by_singular_values", "dsr_horizon"):
        result = identify(RecordDescription.load(started(name, "anna").folder / f"{name}.toml"))
        assert result.cases
        assert all(len(c.identification[0]) > 100 for c in result.cases)
    described = RecordDescription.load(started("which_sensor_lies", "anna").folder / "which_sensor_lies.toml")
    records = [record for _, _, record in read_records(described)]
    assert Kinematics.of(records[0]).compared == ("theta", "alpha", "V")


def _naive(name: str, folder: Path) -> dict[str, tuple[float | str, str]]:
    """Return answers that a hurried student reads off the very records, and a word of the hint that each deserves."""
    good = solution(folder, name)

    def n(key: str) -> float:
        return float(good[key])

    other = {"servo_lag": "delay", "scale": "bias", "bias": "scale"}
    table: dict[str, dict[str, tuple[object, str]]] = {
        "doublet_length": {"step_s": (lambda: math.pi / n("omega_n_rad_s"), "period is that of the mode")},
        "short_period": {
            "omega_n_rad_s": (lambda: n("omega_n_rad_s") * math.sqrt(1.0 - n("zeta") ** 2), "damped"),
            "M_de_1_s2": (lambda: -n("M_de_1_s2"), "sign"),
        },
        "sampling_8hz": {
            "true_hz": (lambda: n("apparent_hz"), "cannot lie there"),
            "cure": (lambda: "filter_after", "once sampled"),
        },
        "static_margin": {"static_margin_percent": (lambda: -100.0 * n("slope"), "multiplied by Cm_de")},
        "order_by_singular_values": {"order": (lambda: 0.5 * n("order"), "two states")},
        "how_many_repeats": {"repeats": (lambda: float(math.ceil(n("amplitude_factor"))), "square the ratio")},
        "what_alpha_buys": {
            "flights_saved_for": (lambda: n("std_without_1_s") / n("std_with_1_s"), "square the ratio")
        },
        "wrong_sign": {"wrong": (lambda: "Cm_q" if good["wrong"] != "Cm_q" else "Cl_p", "its sign is right")},
        "log_to_derivatives": {"servo_ms": (lambda: n("servo_ms") / 1000.0, "in seconds")},
        "plan_within_limits": {
            "largest_deg": (lambda: n("largest_deg") / 0.8, "the margin is missing"),
            "n_peak": (lambda: n("n_peak") - 1.0, "one g of level flight"),
        },
        "coloured_residuals": {"inflation": (lambda: 1.0, "not white"), "cure": (lambda: "faster", "more samples")},
        "which_sensor_lies": {"kind": (lambda: other[str(good["kind"])], "value")},
        "dsr_horizon": {
            "zeta": (lambda: _with_four_samples(folder), "four samples"),
            "cause": (lambda: "order", "order"),
        },
        "flutter_onset": {"onset_m_s": (lambda: n("onset_m_s") ** 2, "take the root")},
        "name_missing_effect": {"effect": (lambda: other.get(str(good["effect"]), "servo_lag"), " ")},
    }
    return {key: (value(), words) for key, (value, words) in table[name].items()}


def _with_four_samples(folder: Path) -> float:
    from testbench.questions.exercise.catalogue.dsr_horizon import estimate

    record = load_record(folder / "records" / "3211.nc")
    found = estimate(record, 4, round(0.8 / record.dt_s))
    assert found is not None, "choose a student for whom DSR_e still finds an oscillation"
    return found[1]


@pytest.mark.parametrize("name", NAMES)
def test_naive_answers_fail_with_the_right_hint(name, started):
    student = "ben" if name == "dsr_horizon" else "anna"
    begun = started(name, student)
    for key, (value, words) in _naive(name, begun.folder).items():
        verdict = next(v for v in judge(begun, {key: value}).verdicts if v.question.key == key)
        assert verdict.outcome in ("wrong", "near"), f"{key} = {value}"
        assert words in verdict.words, f"{key} = {value}: {verdict.words}"
