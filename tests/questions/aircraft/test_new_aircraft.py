"""The command aircraft new: the guide's example from an empty folder to a run, and how it refuses."""

import re
from pathlib import Path

import pytest
from any_aircraft import geometry_of_the_guide
from commands import command, ends

AVL = Path(__file__).resolve().parents[2] / "aircraft" / "geometry" / "plans" / "trainer.avl"
SCENARIO = """\
title = "A doublet on my trainer"
aircraft = "trainer"
suites = ["taurus_8hz"]
seed = 1
[condition]
V_m_s = 14.0
h_m = 100.0
[[manoeuvre]]
name = "doublet"
use = "split"
duration_s = 10.0
input = [{ signal = "doublet", control = "de", amplitude_deg = 2.0, period_s = 1.0 }]
[identification]
inputs = ["de_cmd"]
outputs = ["q", "theta"]
estimators = [{ method = "dsr_e", past_horizon = 4, future_horizon = 4 }]
"""


CAMPAIGN = """\
title = "What the geometry leaves open"
runs = 3
seed = 1
[vary]
"coefficient.*" = { kind = "uncertainty" }
"""
DESIGN = """\
title = "The short period of my trainer"
aircraft = "trainer"
suites = ["eolo_alpha"]
controls = ["de"]
duration_s = 8.0
start_s = 1.0
robust = true
draws = 4
[condition]
V_m_s = 14.0
h_m = 100.0
[targets]
parameters = { M_alpha = 5.0, M_q = 5.0, M_de = 5.0 }
[limits]
deflection_deg = { de = 10.0 }
load_factor = [0.0, 2.0]
"""


@pytest.fixture(scope="module")
def plan():
    """The example of the guide."""
    return geometry_of_the_guide()


def test_thirty_lines_become_an_aircraft_that_runs(plan, tmp_path):
    pytest.importorskip("aerosandbox", reason="needs the extra geometry")
    assert plan.count("\n") <= 30
    (tmp_path / "trainer.toml").write_text(plan, encoding="utf-8")
    (tmp_path / "doublet.toml").write_text(SCENARIO, encoding="utf-8")
    made = command("aircraft", "new", "trainer.toml", "-o", "aircraft/trainer", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert re.search(r"Cm_alpha +−\d", made.stdout)
    assert "Next: testbench aircraft aircraft/trainer" in made.stdout
    folder = tmp_path / "aircraft" / "trainer"
    files = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    assert files >= {
        "trainer.xml", "aircraft.toml", "SOURCES.md", "trainer.toml", "Engines/motor.xml", "Engines/direct.xml",
        "from_geometry/report.html", "from_geometry/figures/three_view.png", "from_geometry/tables/coefficients.csv",
    }  # fmt: skip
    assert (folder / "trainer.toml").read_text(encoding="utf-8") == plan
    checked = command("check", "aircraft/trainer", cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    for words in (("aircraft", "aircraft/trainer"), ("run", "doublet.toml")):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    (folder / "aircraft.toml").write_text("edited")
    again = command("aircraft", "new", "aircraft/trainer/trainer.toml", "-o", "aircraft/trainer", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert "had been changed by hand" in again.stderr
    assert (folder / "aircraft.toml.kept").read_text() == "edited"
    kept = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    assert kept == files | {"aircraft.toml.kept"}


@pytest.mark.slow
def test_what_the_geometry_leaves_open_is_drawn_by_campaign_and_design(plan, tmp_path):
    pytest.importorskip("aerosandbox", reason="needs the extra geometry")
    (tmp_path / "trainer.toml").write_text(plan, encoding="utf-8")
    base = SCENARIO.replace("[[manoeuvre]]", "[simulation]\nlog_rate_hz = 40.0\n[[manoeuvre]]")
    (tmp_path / "doublet.toml").write_text(base, encoding="utf-8")
    (tmp_path / "open.toml").write_text(CAMPAIGN.replace("runs", 'base = "doublet.toml"\nruns'), encoding="utf-8")
    (tmp_path / "short.toml").write_text(DESIGN, encoding="utf-8")
    for words in (
        ("aircraft", "new", "trainer.toml", "-o", "aircraft/trainer"),
        ("campaign", "run", "open.toml", "--workers", "1"),
        ("design", "short.toml"),
    ):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    results = tmp_path / "results"
    head, *rows = (results / "campaign_open" / "tables" / "runs.csv").read_text(encoding="utf-8").splitlines()
    stated = re.findall(r"^(C\w+) = ", (tmp_path / "aircraft/trainer/aircraft.toml").read_text(encoding="utf-8"), re.M)
    assert len(stated) > 20
    assert head.startswith("run,state," + ",".join(f"coefficient.{name}" for name in stated))
    assert len({row.split(",")[2] for row in rows}) == 3
    assert "by the stated uncertainty of the aircraft" in (results / "campaign_open/report.html").read_text("utf-8")
    assert (results / "design_short" / "tables" / "draws.csv").read_text(encoding="utf-8").count("\n") == 4
    assert "drawn with the stated uncertainty of trainer" in (results / "design_short/report.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("root_chord_m = 0.30", "root_cord_m = 0.30", "wing.root_cord_m: unknown key 'root_cord_m'; did you mean"),
        ("span_m = 1.6", "span_m = 0", "wing.span_m: must be 0.001 to 1000 m, got 0"),
        ('surface = "tail"', 'surface = "stabiliser"', "control.de.surface: must be one of wing, tail, fin"),
        ("da = {", "de = {", "must be TOML"),
        ("naca2412", "clark.dat", "no such file lies at"),
        ("mass_kg = 2.2", "mass_kg = 220", "the aircraft must carry 220 kg at 14 m/s"),
        ("x_m = 0.85\n[control]", "x_m = -0.85\n[control]", "dr must have Cn_dr < 0"),
    ],
)
def test_one_fault_is_one_line_and_status_two(plan, monkeypatch, capsys, tmp_path, old, new, words):
    pytest.importorskip("aerosandbox", reason="needs the extra geometry")
    path = tmp_path / "plan.toml"
    assert old in plan
    path.write_text(plan.replace(old, new, 1), encoding="utf-8")
    status, said = ends(monkeypatch, capsys, "aircraft", "new", path, "-o", tmp_path / "mine")
    assert (status, len(said)) == (2, 1), said
    assert words in said[0]
    assert not (tmp_path / "mine").exists()


def test_an_avl_file_cut_in_the_middle_and_names_that_are_none(monkeypatch, capsys, tmp_path):
    text = AVL.read_text(encoding="utf-8")
    cut = tmp_path / "cut.avl"
    cut.write_text(text[: text.index("ANGLE") + 6], encoding="utf-8")
    status, said = ends(monkeypatch, capsys, "aircraft", "new", cut, "--mass", AVL.with_name("trainer_mass.toml"))
    assert (status, len(said)) == (2, 1)
    assert re.search(r"cut.avl, line \d+: the file ends where dAinc must follow; it is cut", said[0])
    status, said = ends(monkeypatch, capsys, "aircraft", "new", cut)
    assert status == 2
    assert "give them with --mass" in said[0]
    status, said = ends(monkeypatch, capsys, "aircraft", "new", cut, "-o", tmp_path / "a,b")
    assert status == 2
    assert "an aircraft's name must be of letters" in said[0]
