"""The checker's words: units, signs, halves, what is missing, what is misspelt; keys and folders."""

import math

import pytest

from testbench.core.errors import RecordError, ScenarioError
from testbench.questions.exercise.answers import write_answers
from testbench.questions.exercise.ask import case_of, start
from testbench.questions.exercise.check import check, check_class, off_by, verdict
from testbench.questions.exercise.exercise import Answer, Choice, Mistake, Number
from testbench.questions.exercise.seal import PUBLIC_KEY, VARIABLE, load_exercise, read_key, seal

ROUND = Number("x", "rad/s", "a frequency", 0.05)


@pytest.mark.parametrize(
    ("unit", "truth", "given", "words"),
    [
        ("rad/s", 6.0, 6.0 / (2 * math.pi), "in Hz"),
        ("rad/s", 6.0, 6.0 * 2 * math.pi, "once too often"),
        ("rad/s", 3.0, 2 * math.pi / 3.0, "period"),
        ("Hz", 2.0, 4 * math.pi, "in rad/s"),
        ("Hz", 4.0, 0.25, "period"),
        ("rad", 0.1, math.degrees(0.1), "degrees"),
        ("1/s2", -50.0, -50.0 * 57.3, "degrees"),
        ("1/s2", -50.0, 50.0, "sign"),
        ("deg", 5.0, math.radians(5.0), "radians"),
        ("%", 12.0, 0.12, "fraction"),
        ("1", 0.12, 12.0, "percent"),
        ("s", 0.5, 1.0, "twice"),
        ("s", 0.5, 0.25, "half"),
    ],
)
def test_slips_of_units_and_signs_are_named(unit, truth, given, words):
    found = verdict(Number("x", unit, "", 0.05), given, Answer(truth))
    assert found.outcome == "wrong"
    assert words in found.words


def test_outcomes_of_a_number():
    assert verdict(ROUND, 6.2, Answer(6.0)).outcome == "right"
    near = verdict(ROUND, 6.5, Answer(6.0))
    assert near.outcome == "near"
    assert "too large by 8 %" in near.words
    far = verdict(ROUND, 20.0, Answer(6.0, hint="look again"))
    assert far.outcome == "wrong"
    assert "factor of 3.33" in far.words
    assert "look again" in far.words
    assert verdict(ROUND, 6, Answer(6.0)).outcome == "right", "whole numbers are numbers"
    for bad in ("6.1", True, math.nan, [6.0]):
        assert "must be a finite number in rad/s" in verdict(ROUND, bad, Answer(6.0)).words


def test_a_known_mistake_goes_before_a_slip_and_before_near():
    right = Answer(6.0, (Mistake(5.6, "that is the damped one"),))
    assert "damped" in verdict(ROUND, 5.6, right).words
    assert verdict(Number("x", "rad/s", "", 0.2), 5.6, right).outcome == "right", "within the band it is no mistake"


def test_off_by():
    assert off_by(1.2, 1.0, "s") == "too large by 20 %"
    assert off_by(0.1, 1.0, "s") == "too small by a factor of 10"
    assert off_by(0.0, 1.0, "s") == "too small: the value is not zero"
    assert off_by(0.5, 0.0, "s") == "an error of +0.5 s"
    assert off_by(-0.5, 1.0, "s") == "of the wrong sign"


def test_choices():
    question = Choice("cause", "why", {"noise": "", "delay": "", "order": ""})
    right = Answer("delay", (Mistake("noise", "the noise is the same in both"),), "look at the phase")
    assert verdict(question, "delay", right).outcome == "right"
    assert "same in both" in verdict(question, "noise", right).words
    assert verdict(question, "order", right).words == "look at the phase"
    assert "did you mean 'delay'?" in verdict(question, "delays", right).words


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return start("doublet_length", "anna", PUBLIC_KEY, tmp_path_factory.mktemp("check") / "anna").folder


def write(folder, text):
    (folder / "answers.toml").write_text(text, encoding="utf-8")


def test_missing_answers_do_not_lose_the_others(folder):
    exercise = load_exercise("doublet_length")
    truth = exercise.answer(case_of(exercise, seal(PUBLIC_KEY, "doublet_length", "anna")))
    write(folder, f'omega_n_rad_s = {truth["omega_n_rad_s"].value}\nstep_s = "?"\n')
    result = check(folder, PUBLIC_KEY)
    assert [v.outcome for v in result.verdicts] == ["right", "missing", "missing"]
    assert (result.right, result.passed) == (1, False)


def test_a_misspelt_key_is_named_with_the_nearest(folder):
    write(folder, "omega_n_rads = 3.0\nstep = 1.0\n")
    with pytest.raises(ScenarioError) as caught:
        check(folder, PUBLIC_KEY)
    assert len(caught.value.faults) == 2
    assert "did you mean 'omega_n_rad_s'?" in caught.value.faults[0]
    assert "did you mean 'step_s'?" in caught.value.faults[1]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("omega_n_rad_s = 1,234,567", "thousands go without commas"),
        ("omega_n_rad_s = 3.5 rad/s", "without its unit"),
        ("omega_n_rad_s = unknown", "must stand in quotes"),
        ("omega_n_rad_s = ", "must be TOML"),
    ],
)
def test_what_is_not_toml_is_explained(folder, line, words):
    write(folder, f"{line}\n")
    with pytest.raises(ScenarioError, match=words):
        check(folder, PUBLIC_KEY)


@pytest.mark.parametrize(
    "written", ["{:.6f}", '"{:.6f}"', '" {:.6f} "', "{:.6e}", "{:.6f}  # read off", "+{:.6f}", '"{:.6e}"']
)
@pytest.mark.parametrize("comma", [False, True])
def test_decimal_commas_and_numbers_in_quotes_are_read_as_what_they_are(folder, written, comma):
    exercise = load_exercise("doublet_length")
    truth = float(exercise.answer(case_of(exercise, seal(PUBLIC_KEY, "doublet_length", "anna")))["omega_n_rad_s"].value)
    number = written.format(truth)
    write(folder, f"omega_n_rad_s = {number.replace('.', ',') if comma else number}\nstep_s = 0,5 # guess\n")
    result = check(folder, PUBLIC_KEY)
    assert result.verdicts[0].outcome == "right"
    assert result.verdicts[0].given == pytest.approx(truth, rel=1e-5)
    assert result.verdicts[1].given == 0.5


def test_one_folder_that_cannot_be_judged_does_not_stop_the_others(folder, tmp_path):
    write(folder, 'step_s = "?"\n')
    results = check_class([tmp_path, folder], PUBLIC_KEY)
    assert isinstance(results[tmp_path], RecordError)
    assert results[folder].right == 0


def test_answers_that_are_gone_and_folders_that_are_none(folder, tmp_path):
    (folder / "answers.toml").unlink()
    with pytest.raises(RecordError, match="writes a template"):
        check(folder, PUBLIC_KEY)
    with pytest.raises(RecordError, match="name that folder"):
        check(tmp_path, PUBLIC_KEY)


def test_the_teachers_key_gives_other_truths_and_is_needed_to_check(tmp_path):
    own = "a long and secret key of the teacher"
    begun = start("doublet_length", "anna", own, tmp_path / "own")
    public = case_of(begun.exercise, seal(PUBLIC_KEY, "doublet_length", "anna"))
    assert dict(begun.case.hidden) != dict(public.hidden)
    assert check(begun.folder, own).right == 0
    with pytest.raises(RecordError, match="another key"):
        check(begun.folder, PUBLIC_KEY)


def test_a_changed_name_in_the_card_is_noticed(tmp_path):
    begun = start("doublet_length", "anna", PUBLIC_KEY, tmp_path / "changed")
    card = begun.folder / "exercise.toml"
    card.write_text(card.read_text(encoding="utf-8").replace("anna", "ben"), encoding="utf-8")
    with pytest.raises(RecordError, match="was changed"):
        check(begun.folder, PUBLIC_KEY)


def test_keys_from_file_and_environment(tmp_path, monkeypatch):
    file = tmp_path / "key"
    file.write_text("0123456789abcdef\n", encoding="utf-8")
    monkeypatch.delenv(VARIABLE, raising=False)
    assert read_key(None) == PUBLIC_KEY
    assert read_key(file) == "0123456789abcdef"
    monkeypatch.setenv(VARIABLE, "another key of the teacher")
    assert read_key(None) == "another key of the teacher"
    monkeypatch.setenv(VARIABLE, "short")
    with pytest.raises(ScenarioError, match="at least 16 characters"):
        read_key(None)
    with pytest.raises(RecordError, match="teacher's key"):
        read_key(tmp_path / "nowhere")


def test_folders_in_the_way_and_names_that_are_none(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(RecordError, match="new or empty folder"):
        start("doublet_length", "anna", PUBLIC_KEY, tmp_path / "full")
    with pytest.raises(RecordError, match="did you mean 'doublet_length'"):
        start("doublet_lenght", "anna", PUBLIC_KEY, tmp_path / "new")
    for bad in ("", "  ", "two\nlines", "x" * 200):
        with pytest.raises(ScenarioError, match="printable characters"):
            start("doublet_length", bad, PUBLIC_KEY, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_answers_are_written_into_the_template_and_its_comments_stay(tmp_path):
    begun = start("doublet_length", "anna", PUBLIC_KEY, tmp_path / "written")
    before = (begun.folder / "answers.toml").read_text(encoding="utf-8")
    write_answers(begun.folder, {"step_s": 0.5, "omega_n_rad_s": None})
    after = (begun.folder / "answers.toml").read_text(encoding="utf-8")
    assert after == before.replace('step_s = "?"', "step_s = 0.5")
    write_answers(begun.folder, begun.exercise.solve(begun.folder))
    assert check(begun.folder, PUBLIC_KEY).passed
    with pytest.raises(ScenarioError, match="did you mean 'step_s'"):
        write_answers(begun.folder, {"steps_s": 1.0})
