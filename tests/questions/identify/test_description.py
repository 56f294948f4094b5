"""Descriptions of recorded flights: what they may say, and how they say what is wrong."""

import pytest

from testbench.core.errors import RecordError, ScenarioError
from testbench.core.paths import SCENARIOS
from testbench.logs.layout import ENVIRONMENT, find_data_folder
from testbench.questions.identify.scenario import RecordDescription

GOOD = """
title = "A flight"
source = "a report"
rights = "free"
folder = "data"
[time]
column = "t"
[[record]]
name = "one"
file = "one.csv"
use = "identification"
[[record]]
name = "two"
file = "two.txt"
use = "validation"
segments = [[0, 9.5], [20.0, 30.0]]
[[channel]]
name = "de"
column = 2
unit = "deg"
[[channel]]
name = "da"
column = 3
minus_column = 4
scale = 0.5
unit = "deg"
[[channel]]
name = "q"
column = "rate"
unit = "rad/s"
missing = "mask"
[identification]
inputs = ["de"]
[[identification.estimators]]
method = "dsr_e"
past_horizon = 5
future_horizon = 5
"""


def write(tmp_path, text=GOOD):
    path = tmp_path / "flight.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults(tmp_path, *changes):
    text = GOOD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(ScenarioError) as error:
        RecordDescription.load(write(tmp_path, text))
    assert all("flight.toml" in fault for fault in error.value.faults)
    return error.value.faults


def test_a_good_description_is_read_as_written(tmp_path):
    path = write(tmp_path)
    description = RecordDescription.load(path)
    assert description.name == "flight"
    assert description.file == path
    assert description.channels == ("de", "da", "q")
    assert description.outputs == ("da", "q")
    assert [record.kind_of_file for record in description.record] == ["csv", "text"]
    assert [record.parts for record in description.record] == [("one",), ("two_1", "two_2")]
    assert description.record[1].segments == ((0.0, 9.5), (20.0, 30.0))
    assert description.preparation.bias == "mean"
    assert description.reference_values == {}
    assert description.trim_s == 0.0


def test_all_faults_are_reported_at_once_with_file_and_key(tmp_path):
    found = faults(
        tmp_path,
        ('title = "A flight"', 'title = ""'),
        ('rights = "free"\n', ""),
        ('folder = "data"', 'foldr = "data"'),
        ('use = "identification"', 'use = "both"'),
        ("segments = [[0, 9.5]", "segments = [[9.5, 0]"),
        ('unit = "deg"', 'unit = "degrees"'),
        ("column = 3", "column = 0"),
        ('name = "q"', 'name = "qq"'),
        ('method = "dsr_e"', 'method = "dsr_f"'),
    )
    text = "\n".join(found)
    assert len(found) == 9
    for part in (
        "title: string should have",
        "rights: the key is required and missing",
        "foldr: unknown key 'foldr'; did you mean 'folder'?",
        "record[0].use: must be one of identification, validation, split, got 'both'",
        "record[1]: a segment must be [first, last] with first < last, got [9.5, 0]",
        "channel[0]: channel 'de' is measured in rad or deg, got unit 'degrees'",
        "channel[1].column: must be a column's name, or its number counted from 1, got 0",
        "channel[2].name: a channel must be in the channel table, got 'qq'",
        "identification.estimators[0]: unknown method 'dsr_f'; did you mean 'dsr_e'?",
    ):
        assert part in text, part


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('column = "t"', ""), "time: give either column"),
        (('column = "t"', 'column = "t"\nrate_hz = 50.0'), "time: give either column"),
        (('column = "t"', "rate_hz = 0.0"), "time.rate_hz: must be 1e-05 to 20000 Hz, got 0"),
        (
            ('file = "one.csv"', 'file = "one.dat.gz"'),
            "record[0]: the suffix of 'one.dat.gz' must be one of .csv, .tsv, .txt",
        ),
        (('file = "one.csv"', 'file = "one.csv"\nvariable = "x"'), "record[0]: the key variable is for format mat"),
        (('file = "one.csv"', 'file = "one.mat"\nskip_rows = 2'), "the key skip_rows is for format csv or text"),
        (('use = "identification"', 'use = "validation"'), "record: records must include use = 'identification'"),
        (('name = "one"', 'name = "two_2"'), "record: names must differ"),
        (('name = "da"', 'name = "de"'), "channel: names must differ"),
        (("segments = [[0, 9.5], [20.0", "segments = [[0, 9.5], [9.5"), "no sample may be used twice"),
        (
            ('inputs = ["de"]', 'inputs = ["dr"]'),
            "identification.inputs: must be among the channels described, got 'dr'",
        ),
        (('inputs = ["de"]', 'inputs = ["de"]\noutputs = ["q", "de"]'), "an input cannot be an output too, got de"),
        (('inputs = ["de"]', 'inputs = ["de", "da", "q"]'), "there must be an output"),
        (("[identification]", '[preparation]\nbias = "trim"\n[identification]'), "trim_s: must be > 0"),
        (("scale = 0.5", "scale = 0"), "channel[1]: scale must differ from 0"),
        (("scale = 0.5", 'scale = "0.5"'), "channel[1].scale"),
        (("[identification]", '[reference]\nsource = "x"\nvalues = {}\n[identification]'), "reference.values"),
    ],
)
def test_each_law(tmp_path, change, message):
    assert any(message in fault for fault in faults(tmp_path, change))


def test_records_may_all_identify_but_for_a_method_that_chooses_by_others(tmp_path):
    alone = ('use = "validation"', 'use = "identification"')
    assert len(RecordDescription.load(write(tmp_path, GOOD.replace(*alone))).record) == 2
    settings = 'method = "dsr_e"\npast_horizon = 5\nfuture_horizon = 5\n'
    told = faults(tmp_path, alone, (settings, 'method = "srivc"\npoles = [2]\nzeros = [1]\n'))
    assert any("record: srivc chooses by records that are kept back: records must include" in fault for fault in told)


def test_validation_never_sees_what_was_identified_on(tmp_path):
    second = ('file = "two.txt"', 'file = "one.csv"')
    whole = faults(tmp_path, second)
    assert any("'one' (identification) and 'two' (validation) overlap in one.csv" in fault for fault in whole)
    apart = GOOD.replace(*second).replace('use = "identification"', 'use = "identification"\nsegments = [[10, 19]]')
    assert len(RecordDescription.load(write(tmp_path, apart)).record) == 2


def test_what_is_no_description(tmp_path):
    with pytest.raises(RecordError, match=r"none\.toml"):
        RecordDescription.load(tmp_path / "none.toml")
    with pytest.raises(ScenarioError, match="must be TOML"):
        RecordDescription.load(write(tmp_path, "title = "))


def test_the_data_folder_is_the_option_else_the_environment_else_the_description_s_own(tmp_path, monkeypatch):
    monkeypatch.delenv(ENVIRONMENT, raising=False)
    description = RecordDescription.load(write(tmp_path))
    for name in ("data", "variable", "option"):
        (tmp_path / name).mkdir()
    assert find_data_folder(description) == tmp_path / "data"
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path / "variable"))
    assert find_data_folder(description) == tmp_path / "variable"
    assert find_data_folder(description, tmp_path / "option") == tmp_path / "option"


def test_an_absent_data_folder_says_what_is_missing_and_how_to_set_it(tmp_path, monkeypatch):
    monkeypatch.delenv(ENVIRONMENT, raising=False)
    description = RecordDescription.load(write(tmp_path))
    with pytest.raises(RecordError) as error:
        find_data_folder(description)
    for part in (str(tmp_path / "data"), "one.csv, two.txt", "--data", ENVIRONMENT, "folder = 'data'", "free"):
        assert part in str(error.value)
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path / "elsewhere"))
    with pytest.raises(RecordError, match=f"elsewhere' from the environment variable {ENVIRONMENT}"):
        find_data_folder(description)


@pytest.mark.parametrize("path", sorted((SCENARIOS / "records").glob("*.toml")), ids=lambda path: path.stem)
def test_packaged_descriptions_are_valid_and_found_by_name(path):
    assert RecordDescription.load(path.stem).file == path


@pytest.mark.parametrize("name", ["attas_short_period", "hfb320_longitudinal", "twin_otter_longitudinal"])
def test_our_descriptions_cite_printed_results_and_look_beside_the_checkout(name):
    description = RecordDescription.load(name)
    assert {"wn_rad_s", "zeta", "source"} <= set(description.reference_values)
    assert "not for redistribution" in description.rights
    assert description.folder == "../../../shared/flight_data"
