"""What a newcomer gets wrong: a wrong name, file or number is answered with one line and a status that is not 0.

A refusal quotes at most 200 letters of what it got, wherever that came from.
"""

import numpy as np
import pytest
from commands import ends

from testbench.core.errors import QUOTED, ScenarioError, TestbenchError, WriteError, brief
from testbench.core.record import FlightRecord

ASKED_BY_FILE = (
    "run", "identify", "compatibility", "response", "gap", "design", "compare", "plan", "check",
    "modes", "campaign run", "campaign resume", "campaign status", "campaign summarise",
)  # fmt: skip
TABLE = "t [s],de [deg],q [deg/s]\n" + "".join(f"{0.1 * k:.1f},{k % 3},{k % 5}\n" for k in range(200))
DESCRIPTION = """title = "t"
source = "s"
rights = "r"
time = { column = "t" }
record = [{ name = "a", file = "a.csv", use = "split" }]
channel = [{ name = "de", column = "de", unit = "deg" }, { name = "q", column = "q", unit = "deg/s" }]
[identification]
inputs = ["de"]
[[identification.estimators]]
method = "dsr_e"
order = 1
past_horizon = 3
future_horizon = 3
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with the wrong kinds of file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dir").mkdir()
    for name in ("empty.toml", "empty.csv", "empty.nc", "empty.json", "empty.mat", "empty.ulg"):
        (tmp_path / name).touch()
    for name in ("junk.toml", "junk.csv", "junk.nc", "junk.json", "junk.mat"):
        (tmp_path / name).write_bytes(bytes(range(255, 0, -1)))
    (tmp_path / "a.csv").write_text(TABLE)
    (tmp_path / "a.toml").write_text(DESCRIPTION)
    t = 0.1 * np.arange(50)
    FlightRecord(t, ("q", "de_cmd"), np.column_stack([np.sin(t), np.cos(t)]), "measured").save(tmp_path / "a.nc")
    return tmp_path


@pytest.fixture
def refused(folder, monkeypatch, capsys):
    """Run a command in that folder, which must end in one line; return the line."""

    def run(*words):
        status, said = ends(monkeypatch, capsys, *words)
        assert status in (2, 3), (words, status, said)
        assert len(said) == 1, (words, said)
        assert said[0].startswith("error: "), said
        return said[0]

    return run


@pytest.mark.parametrize("command", ASKED_BY_FILE)
def test_files_that_are_none_are_refused(refused, command):
    words = command.split()
    for name in ("mispelt", "none.toml", "dir"):
        assert f"got '{name}'" in refused(*words, name)
    assert "it is empty" in refused(*words, "empty.toml")
    assert "not UTF-8 text" in refused(*words, "junk.toml")
    if command not in ("compare", "gap", "plan"):  # groups of commands, which show their help
        assert "Missing argument" in refused(*words)


@pytest.mark.parametrize("name", ["none.ulg", "dir", "empty.csv", "empty.ulg", "junk.csv", "junk.nc", "junk.mat"])
def test_logs_that_are_none_are_refused(refused, name):
    assert f"'{name}'" in refused("import", name)


@pytest.mark.parametrize("to", ["csv", "mat", "netcdf", "json", "jsbsim", "control"])
def test_records_and_models_that_are_none_are_refused(refused, to):
    for name in ("none.nc", "dir", "empty.nc", "junk.nc", "none.json", "empty.json", "junk.json"):
        assert f"'{name}'" in refused("export", name, "--to", to)


@pytest.mark.parametrize(
    ("words", "law"),
    [
        ("fyl", "No such command 'fyl'"),
        ("idetify x", "Did you mean 'identify'?; see `testbench --help`"),
        ("campaign rnu", "Did you mean 'run'?"),
        ("adopt plane.xml", "No such command 'adopt'; did you mean `testbench aircraft adopt`?; see"),
        ("campaign adopt", "did you mean `testbench aircraft adopt`?"),
        ("campaign identify", "did you mean `testbench identify`?"),
        *(
            (w, f"No such command '{w}'; did you mean `testbench --{w}`?; see `testbench --help`")
            for w in ("version", "help")
        ),
        ("run gap/flexible_wings", "is a gap scenario: use testbench gap"),
        ("run design/eolo_modes", "use testbench design"),
        ("run eolo_alfa", "did you mean 'eolo_alpha'?"),
        ("run taurus_doublet --aircraft eolo", "flown by eolo"),
        ("run taurus_doublet --aircraft tauruss", "got 'tauruss'"),
        ("run taurus_doublet -o empty.csv", "must go to a folder that can be written to"),
        ("design eolo_mode", "did you mean 'eolo_modes'"),
        ("identify records/../eolo_alpha", "is a scenario: use testbench run"),
        ("gap eolo_alpha", "is a scenario: use testbench run"),
        ("gap slow_servos", "did you mean 'slow_servo'?"),
        ("--foo", "No such option: --foo; see `testbench --help`"),
        ("gap --windows 4", "must be given with its records"),
        ("gap eolo", "measured records of eolo must be given"),
        ("gap jsbsim:J3Cub", "measured records of jsbsim:J3Cub must be given"),
        ("gap eolo none.nc", "got 'none.nc'"),
        ("gap eolo empty.nc", "'empty.nc'"),
        ("gap eolo a.nc --hold-out none.nc", "got 'none.nc'"),
        ("gap --plan dir", "got 'dir'"),
        ("gap flexible_wings -o empty.csv", "empty.csv"),
        ("aircraft eol", "did you mean 'eolo'?"),
        ("aircraft taurus --wings stiff", "'stiff' is not one of"),
        ("studio eol", "did you mean 'eolo'?"),
        ("studio taurus --port x", "valid integer"),
        ("studio taurus --write dir", "got the folder 'dir'; name a file in it"),
        ("list aircrafts", "'aircrafts' is not one of"),
        ("reproduce tauru", "did you mean 'taurus'?"),
        ("reproduce taurus -o empty.csv", "empty.csv"),
        ("exercise start shortperiod --student a", "did you mean 'short_period'?"),
        ("exercise start short_period", "Missing option '--student'"),
        ("exercise start short_period --student a -o empty.csv", "got 'empty.csv'"),
        ("exercise start short_period --student a --key-file none", "none"),
        ("exercise check dir", "'dir'"),
        ("export a.nc --to pdf", "records go to csv, mat, mcap, netcdf or parquet, got pdf"),
        ("export a.nc --to netcdf -o a.nc", "over itself"),
        ("export a.nc --to csv -o dir", "'dir'"),
        ("check eolo_alpah", "did you mean 'eolo_alpha'?"),
        ("identify a.toml --data none", "'none'"),
    ],
)
def test_wrong_names_and_places_are_refused(refused, words, law):
    assert law in refused(*words.split())


@pytest.mark.parametrize(
    ("words", "law"),
    [
        *((f"{c} eolo_alpha --seed -1", "greater than or equal to 0") for c in ("run", "design", "compare", "plan")),
        ("campaign run taurus_scatter --workers -1", "greater than or equal to 1"),
        ("response a.toml --window -3", "windows of at least 8 samples"),
        *((f"response a.toml --window {x}", "windows must fit into a record") for x in ("nan", "inf", "1e9")),
        *(
            (f"import a.csv --rate {x}", "rate of a record must be > 0 Hz and finite")
            for x in ("-5", "0", "nan", "inf")
        ),
        *(
            (f"import a.csv --{o} {x}", "at least 0.5 s and finite")
            for o in ("lead", "tail")
            for x in ("-1", "nan", "inf")
        ),
        *((f"import a.csv --throw de={x}", "de, da or dr = degrees up to 90") for x in ("-91", "nan", "x")),
        ("studio taurus --port -1", "cannot be served: not a port"),
    ],
)
def test_numbers_out_of_range_are_refused(refused, words, law):
    assert law in refused(*words.split())


def test_gravity_is_positive(refused):
    from pathlib import Path

    t = 0.02 * np.arange(2000)
    names = ("q", "ax", "az", "V", "theta", "alpha")
    Path("c.csv").write_text("\n".join([",".join(("t", *names)), *(",".join([f"{x:.2f}"] + ["1.0"] * 6) for x in t)]))
    entries = ", ".join(
        f'{{ name = "{n}", column = "{n}", unit = "{u}" }}'
        for n, u in zip(names, ("rad/s", "m/s2", "m/s2", "m/s", "rad", "rad"), strict=True)
    )
    text = DESCRIPTION.replace("a.csv", "c.csv").replace('["de"]', '["q"]')
    lines = [f"channel = [{entries}]" if line.startswith("channel") else line for line in text.splitlines()]
    Path("c.toml").write_text("\n".join(lines))
    for value in ("-9.8", "0", "nan", "inf"):
        assert "gravity must be > 0 m/s2" in refused("compatibility", "c.toml", "--gravity", value)


def test_help_is_no_error_and_a_bare_group_shows_its_help(folder, monkeypatch, capsys):
    assert ends(monkeypatch, capsys) == (0, [])
    for words in (("campaign",), ("exercise",)):
        assert ends(monkeypatch, capsys, *words) == (2, [])
    for words in (("--help",), ("import", "--help"), ("campaign", "run", "--help")):
        assert ends(monkeypatch, capsys, *words) == (0, [])


@pytest.mark.parametrize(
    ("words", "refused_option"),
    [
        ("gap eolo --plan eolo_alpha", "CASE"),
        ("gap --plan eolo_alpha --sensors eolo_gap", "--sensors"),
        ("gap --plan eolo_alpha --wings rigid", "--wings"),
        ("gap --plan eolo_alpha --again 3", "--again"),
        ("gap flexible_wings --draws 30", "--draws"),
        ("gap flexible_wings --V 15", "--V"),
        ("gap flexible_wings --hold-out a.nc", "--hold-out"),
        ("gap eolo a.nc --seed 3", "--seed"),
        ("import a.csv --describe b.toml -o records", "--out"),
        ("modes eolo_turbulence --data dir", "--data"),
        ("modes a.nc --seed 3", "--seed"),
    ],
)
def test_options_that_nothing_would_heed_are_refused(refused, words, refused_option):
    assert refused(*words.split()).startswith(f"error: {refused_option} has no use with ")


SIGN = "\N{SECTION SIGN}"
TEXTS = {
    "unbroken": SIGN * 6000,
    "with blanks": f"{SIGN * 20} " * 300,
    "with quotes": f"{SIGN * 9}'s \"{SIGN * 9} " * 300,
}
TEXT = pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)


@pytest.mark.parametrize(
    ("text", "letters"),
    [
        ("a value must be > 0, got '{}'; give another", 200),
        ('a value must be > 0, got "{}"; give another', 200),
        ("no file {}; give another", 200),
        ("{}", 200),
        ("'{}' and '{}' differ", 400),
        ("a\n{}\nb", 200),
    ],
)
def test_what_is_quoted_is_cut_in_the_middle(text, letters):
    for value in ("x" * 5000, "/".join(["folder"] * 900)):
        short = brief(text.format(value, value))
        ours = len(text.format("", ""))
        assert ours < len(short) <= ours + letters + 8
    assert brief(f"no '{'a' * 300}/end.toml'").endswith("a/end.toml'")


def test_our_own_words_are_left_alone():
    lists = "valid: " + ", ".join(f"name_{k}" for k in range(150))
    assert brief(lists) == lists
    words = f"'a.' is {'a long sentence of ours, ' * 20}and 'b' too; the aircraft's law and the sensors' law hold"
    assert brief(words) == words
    assert brief("x" * QUOTED) == "x" * QUOTED


def test_errors_of_every_kind_are_brief_however_they_are_made():
    kinds = [TestbenchError]
    for kind in kinds:
        kinds += kind.__subclasses__()
        if kind.__init__ in (TestbenchError.__init__, WriteError.__init__):
            error = kind("got " + "x" * 5000)
            error.place = "y" * 5000
            assert len(str(error)) < 450
    many = ScenarioError(f"key_{k}: unknown" for k in range(10_000))
    assert str(many).startswith("10000 faults:\n  key_0")
    assert str(many).endswith("and 9950 more")
    assert len(many.faults) == 10_000


def quoted(monkeypatch, capsys, words) -> int:
    """Run a command that must be refused, and return how many letters of the hostile text a line of it holds."""
    status, lines = ends(monkeypatch, capsys, *words)
    assert status != 0, words
    assert lines[0].startswith("error: ")
    return max(line.count(SIGN) for line in lines)


SCENARIO = {
    "a key": 'title = "t"\n{} = 1\n',
    "a title": "title = {}\n",
    "an aircraft": 'title = "t"\naircraft = {}\n',
    "a nested key": 'title = "t"\n[condition]\n{} = 3\n',
    "a value of the wrong kind": 'title = "t"\nduration_s = {}\n',
    "an estimator": "[[estimators]]\nmethod = {}\n",
    "broken TOML": "title = {} {}\n",
}


@TEXT
@pytest.mark.parametrize("name", SCENARIO)
def test_scenarios(tmp_path, monkeypatch, capsys, name, text):
    monkeypatch.chdir(tmp_path)
    value = '"' + text.replace('"', '\\"') + '"'
    (tmp_path / "s.toml").write_text(SCENARIO[name].replace("{}", value), encoding="utf-8")
    for command in (["run", "s.toml"], ["check", "s.toml"]):
        assert quoted(monkeypatch, capsys, command) <= QUOTED


@TEXT
@pytest.mark.parametrize(
    "command",
    [
        ["run", "{}"], ["run", "eolo_alpha", "{}"], ["run", "--{}"], ["{}"], ["list", "{}"], ["studio", "{}"],
        ["report", "{}"], ["new", "aircraft", "{}"], ["import", "{}"], ["check", "{}"], ["export", "{}"],
        ["plan", "new", "{}"], ["run", "eolo_alpha", "--out", "{}"], ["aircraft", "{}"], ["gap", "{}"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_arguments(tmp_path, monkeypatch, capsys, command, text):
    monkeypatch.chdir(tmp_path)
    assert quoted(monkeypatch, capsys, [part.format(text) for part in command]) <= QUOTED


@TEXT
@pytest.mark.parametrize("table", ["{},b\n1,2\n", "t [{}],q [deg]\n0,1\n1,2\n", "t [s],q [deg]\n0,{}\n1,{}\n", "{}\n"])
def test_headers_and_cells_of_tables(tmp_path, monkeypatch, capsys, table, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(table.format(text, text) * 1, encoding="utf-8")
    for command in (["import", "a.csv"], ["export", "a.csv", "--to", "b.csv"], ["modes", "a.csv"]):
        assert quoted(monkeypatch, capsys, command) <= QUOTED


@pytest.mark.parametrize("control", ["\x1b[31m", "\x1b]0;title\x07", "\x08\x08", "\r", "\x9b2J", "\u202e", "\udc9b"])
def test_no_control_of_a_terminal_reaches_it_from_a_name(monkeypatch, capsys, control):
    name = f"a{control}b<script>.toml"
    for text in (name, name + "x" * 3000):
        assert [c for c in brief(f"no file '{text}'\nis here") if not c.isprintable()] == ["\n"]
    status, lines = ends(monkeypatch, capsys, "check", name)
    assert status == 2
    assert all(line.isprintable() for line in lines)
