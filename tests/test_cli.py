"""The command line as a user meets it: a process, its exit status, one message, and never a traceback."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer.main
from commands import Done, command

import testbench as tb
from testbench.cli import _below, app
from testbench.core.paths import SCENARIOS, aircraft_names
from testbench.questions import QUESTIONS
from testbench.questions.files import json_schemas

ROOT = Path(__file__).resolve().parents[1]


def assert_fails(done: Done, status: int, *texts: str) -> None:
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    for text in texts:
        assert text in done.stderr


def altered(tmp_path: Path, name: str, old: str, new: str) -> Path:
    text = (SCENARIOS / f"{name}.toml").read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "changed.toml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    return file


def test_help_teaches():
    done = command("--help")
    assert done.returncode == 0
    for word in ("run", "identify", "gap", "check", "list", "Start here", "Exit status"):
        assert word in done.stdout


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from testbench.cli import app; import typer.main; typer.main.get_command(app);"
        "heavy = {'numpy', 'scipy', 'pydantic', 'xarray', 'jsbsim', 'matplotlib', 'pandas'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("kind", ["aircraft", "inputs", "sensors", "estimators", "scenarios", "effects"])
def test_list_names_the_members(kind):
    expected = {
        "aircraft": "eolo",
        "inputs": "3211",
        "sensors": "taurus_8hz",
        "estimators": "dsr_e",
        "scenarios": "records/attas_short_period",
        "effects": "wing_bending",
    }
    done = command("list", kind)
    assert done.returncode == 0
    assert expected[kind] in done.stdout


def test_check_accepts_every_packaged_file():
    files = [p for folder in ("", "records", "gap", "design") for p in (SCENARIOS / folder).glob("*.toml")]
    done = command("check", *files)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("a valid") == len(files)


def test_trim_that_does_not_exist(tmp_path):
    done = command("run", altered(tmp_path, "eolo_alpha", "V_m_s = 16.0", "V_m_s = 8.0"), "-o", tmp_path)
    assert_fails(done, 3, "needs alpha", "fly faster", "changed.toml, condition")


def test_an_input_that_makes_the_aircraft_leave_its_envelope_keeps_the_record(tmp_path):
    file = altered(tmp_path, "eolo_alpha", "amplitude_deg = 5.0", "amplitude_deg = 20.0")
    done = command("run", file, "-o", tmp_path / "out")
    assert_fails(done, 3, "left its limits at t =", "changed.toml, manoeuvre[0]")
    assert [p.name for p in (tmp_path / "out").rglob("*.nc")] == ["3-2-1-1_aborted.nc"]


def test_a_campaign_flies_says_how_far_it_is_and_is_summarised_again(tmp_path):
    """Three runs of the packaged campaign; two workers' start is most of the time."""
    text = (SCENARIOS / "campaign" / "taurus_scatter.toml").read_text(encoding="utf-8")
    assert "runs = 24" in text
    file = tmp_path / "three.toml"
    file.write_text(text.replace("runs = 24", "runs = 3"), encoding="utf-8")
    assert_fails(command("campaign", "status", file, cwd=tmp_path), 3, "must have a store, got none")
    both = command("campaign", "run", file, "--workers", 1, "--scheduler", "tcp://127.0.0.1:9", cwd=tmp_path)
    assert both.returncode == 2
    assert "either --workers or --scheduler" in both.stderr
    done = command("campaign", "run", file, "--workers", 1, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "estimates show no bias beyond chance" in " ".join(done.stdout.split())
    assert "3 of 3 runs are done, none failed" in done.stdout
    assert "... 3 of 3 runs" in done.stderr
    folder = tmp_path / "results" / "campaign_three"
    table = (folder / "tables" / "runs.csv").read_bytes()
    (folder / "report.html").unlink()
    status = command("campaign", "status", file, cwd=tmp_path)
    assert "a million like it" in status.stdout
    assert command("campaign", "summarise", file, cwd=tmp_path).returncode == 0
    assert (folder / "report.html").is_file()
    assert (folder / "tables" / "runs.csv").read_bytes() == table
    assert_fails(command("campaign", "run", file, cwd=tmp_path), 3, "go on with `testbench campaign resume`")
    assert_fails(command("run", file, cwd=tmp_path), 2, "is a campaign: use testbench campaign")
    assert "a valid campaign" in command("check", "campaign/taurus_scatter", cwd=tmp_path).stdout


def test_an_exercise_is_listed_started_and_checked(tmp_path):
    listed = command("exercise", "list")
    assert listed.returncode == 0, listed.stderr
    assert "doublet_length" in listed.stdout
    begun = command("exercise", "start", "doublet_length", "--student", "anna", cwd=tmp_path)
    assert begun.returncode == 0, begun.stderr
    folder = tmp_path / "doublet_length_anna"
    assert {p.name for p in folder.iterdir()} >= {"README.md", "answers.toml", "exercise.toml", "records"}
    unanswered = command("exercise", "check", folder)
    assert unanswered.returncode == 1
    assert "0 of 3 right, 3 not answered yet" in unanswered.stdout
    answers = folder / "answers.toml"
    answers.write_text(answers.read_text(encoding="utf-8").replace("step_s", "steps_s"), encoding="utf-8")
    several = command("exercise", "check", folder, tmp_path)
    assert several.returncode == 1
    for words in ("no question has this key", "name that"):
        assert words in " ".join(several.stdout.split())


def test_every_command_says_the_version_and_a_schema_is_that_of_the_api(tmp_path):
    for words in ((), ("run",), ("plan", "new")):
        done = command(*words, "--version")
        assert (done.returncode, done.stdout) == (0, f"testbench {tb.__version__}\n")
    shown = command("schema", "design")
    assert json.loads(shown.stdout) == json_schemas()["design scenario"]
    assert command("schema", "design_scenario", "--json").stdout == shown.stdout
    assert_fails(command("schema", "desing"), 2, "did you mean 'design'?")
    assert command("new", "mine", "--aircraft", "taurus", "--sensors", "eolo_alpha", cwd=tmp_path).returncode == 0
    for file in (tmp_path / "mine").glob("*.toml"):
        mark, _, name = file.read_text(encoding="utf-8").partition("\n")[0].partition(" ")
        assert mark == "#:schema"
        assert "title" in json.loads((tmp_path / "mine" / name).read_text(encoding="utf-8"))["properties"]


def test_testbench_alone_says_in_twelve_lines_what_may_be_wanted():
    done = command()
    lines = done.stdout.splitlines()
    assert (done.returncode, done.stderr, len(lines)) == (0, "", 12)
    assert max(map(len, lines)) <= 60
    known = {q.command for q in QUESTIONS} | {"check"}
    assert {line.split("testbench ")[1].split()[0] for line in lines[1:-1]} <= known


def test_every_command_takes_how_it_answers_and_a_short_help():
    leaves = [c for c in _below(typer.main.get_command(app)) if not hasattr(c, "commands")]
    assert len(leaves) > 25
    for leaf in leaves:
        options = {option for parameter in leaf.params for option in parameter.opts}
        assert {"-q", "--quiet", "-v", "--verbose", "--json"} <= options, leaf.name
    assert "Fly a scenario" in command("run", "-h").stdout


def test_json_is_the_result_as_the_api_has_it(tmp_path):
    words = ("run", "taurus_doublet", "-o", str(tmp_path))
    done = command(*words, "--json")
    said = json.loads(done.stdout)
    assert said.pop("places") == {"Report": f"{tmp_path}/taurus_doublet/report.html"}
    assert said == tb.run("taurus_doublet").to_dict()
    quiet = command(*words, "-q")
    assert (quiet.returncode, quiet.stderr) == (0, "")
    assert quiet.stdout.splitlines()[-1] == f"Report: {tmp_path}/taurus_doublet/report.html"
    assert len(quiet.stdout.splitlines()) <= 20
    folder = tmp_path / "taurus_doublet"
    page = (folder / "report.html").read_text(encoding="utf-8")
    for text in ("Frequency responses", "Measured and predicted", "energy", "MRSE"):
        assert text in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    for part in (
        "records/doublets_truth.nc",
        "tables/mrse.csv",
        "tables/mrse.json",
        "models/taurus_8hz_transfer_function.json",
    ):
        assert (folder / part).stat().st_size > 100
    assert (folder / "figures" / "bode_de_cmd.png").is_file()
    assert not list(folder.rglob("*.part"))
    whole = command(*words, "-v")
    assert all(" s  " in line for line in whole.stderr.splitlines())
    flat = " ".join(whole.stdout.replace("- ", "").split())
    assert all(" ".join(line["text"].replace("- ", "").split()) in flat for line in said["answer"])


def test_json_of_a_list_has_a_row_for_each_member():
    rows = json.loads(command("list", "aircraft", "--json").stdout)["rows"]
    assert [row["aircraft"] for row in rows] == aircraft_names()
    refused = command("aircraft", "nosuch", "--json")
    assert (refused.returncode, refused.stdout) == (2, "")


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("testbench run eolo_al", "eolo_alpha"),
        ("testbench plan ", "eolo_envelope"),
        ("testbench design x --aircraft jsbsim:c172p", "jsbsim:c172p"),
        ("testbench ru", "run"),
    ],
)
def test_a_shell_completes_commands_and_names(words, offered):
    environment = {"_TESTBENCH_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = subprocess.run(
        [sys.executable, "-m", "testbench"], env=os.environ | environment, capture_output=True, text=True, check=True
    )
    assert offered in done.stdout.split()
