"""Which kind of question a file is, told by its keys: every packaged file, and files with faults."""

from pathlib import Path

import pytest

from testbench.core.errors import ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS, PACKAGE, SCENARIOS
from testbench.questions import QUESTIONS
from testbench.questions.brought import laws_of
from testbench.questions.files import FAMILIES, WITH_FILES, check_file, find, kinds_of

PACKAGED = sorted(p for q in WITH_FILES for p in (SCENARIOS / q.folder).glob("*.toml"))


@pytest.mark.parametrize("path", PACKAGED, ids=lambda p: str(p.relative_to(SCENARIOS)))
def test_every_packaged_file_is_of_the_question_whose_folder_it_lies_in(path):
    folder = "" if path.parent == SCENARIOS else path.parent.name
    found = [q.folder for q in kinds_of(path)]
    assert found[0] == folder
    assert found[1:] in ([], ["compare"]), "a scenario to run can be compared, too; nothing else is two things"


def test_every_packaged_file_is_listed_with_its_command():
    listed = {row[0]: row[1] for row in FAMILIES["scenarios"]()[1:]}
    assert len(listed) == len(PACKAGED)
    assert listed["compare/eolo_wing"] == "compare"
    assert listed["eolo_alpha"] == "run"


@pytest.mark.parametrize(
    ("example", "old", "new", "kind"),
    [
        ("compare/eolo_alpha", "seeds =", "seedz =", "comparison"),
        ("plan/taurus_63", "flown_by =", "flownby =", "flight plan"),
        ("design/eolo_modes", "controls =", "control =", "design scenario"),
        ("modes/eolo_turbulence", "[[flight]]", "[[fligth]]", "scenario of flight in turbulence"),
        ("campaign/taurus_scatter", "[vary]", "[varry]", "campaign"),
        ("gap/slow_servo", "[hidden]", "[hiden]", "gap scenario"),
        ("records/attas_full", "[[channel]]", "[[chanel]]", "description of recorded flights"),
        ("eolo_alpha", "[[manoeuvre]]", "[[maneuver]]", "scenario"),
    ],
)
def test_a_misspelt_key_does_not_change_the_kind(tmp_path, example, old, new, kind):
    text = (SCENARIOS / f"{example}.toml").read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "mine.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    assert kinds_of(file)[0].kind == kind
    with pytest.raises(ScenarioError, match=new.strip(" =[]")):
        check_file(file)


def test_a_file_without_any_known_key_is_of_no_question(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("x = 1\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"must have the keys of a question, but no question has a key like x;"):
        check_file(file)


def test_a_file_that_is_just_begun_is_a_scenario_to_run(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('title = "Mine"\naircraft = "taurus"\n', encoding="utf-8")
    assert kinds_of(file)[0].command == "run"


BROUGHT = {
    "geometry": AIRCRAFT_MODELS / "eolo" / "geometry.toml",
    "writer": PACKAGE / "logs" / "writers" / "garmin.toml",
    "masses beside AVL": Path(__file__).parents[1] / "aircraft" / "geometry" / "plans" / "trainer_mass.toml",
    "aircraft": AIRCRAFT_MODELS / "b1" / "aircraft.toml",
}


@pytest.mark.parametrize(("kind", "file"), BROUGHT.items(), ids=BROUGHT)
def test_what_users_bring_is_checked_as_what_it_is(tmp_path, kind, file):
    text = file.read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    found = laws_of(tmp_path / "mine.toml")
    assert found is not None
    assert (found[0], [law.holds for law in found[1]]) == (kind, [True])
    (tmp_path / "mine.toml").write_text(f"{text}\n[nonsense]\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="unknown key 'nonsense'"):
        laws_of(tmp_path / "mine.toml")


def test_a_file_of_another_question_names_the_command_that_takes_it():
    with pytest.raises(ScenarioError, match=r"is a comparison: use testbench compare"):
        find(SCENARIOS / "compare" / "eolo_alpha.toml", "run")


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda q: q.command)
def test_every_row_names_what_there_is(question):
    assert callable(question.part(question.function))
    assert question.part(question.function).__doc__
    if question.kind:
        assert {"title", "question"} <= question.keys
        assert (SCENARIOS / question.folder).is_dir()
