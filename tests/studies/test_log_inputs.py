"""The committed table of inputs: it has every input of the study, and nine in ten are right."""

from collections import Counter

from tables import read_rows

from tests.studies import log_inputs


def test_the_table_has_every_input_and_nine_in_ten_are_right():
    rows = read_rows(log_inputs.TABLE)
    assert set(rows[0]) == set(log_inputs.COLUMNS)
    kinds = Counter(row["kind"] for row in rows)
    assert kinds["written"] == len(log_inputs.WRITERS) + len(log_inputs.OTHERS)
    assert kinds["foreign"] == len(log_inputs.FOREIGN)
    assert kinds["case"] == len(log_inputs.CASES)
    public = {row["file"]: row["wanted"] for row in read_rows(log_inputs.PUBLIC)}
    assert {row["input"]: row["wanted"] for row in rows if row["kind"] == "public"} == public
    for kind, count in kinds.items():
        assert sum(row["kind"] == kind and row["right"] == "yes" for row in rows) >= 0.9 * count, kind


def test_what_is_wanted_of_a_log_is_judged(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,q\n" + "\n".join(f"{0.02 * i},{0.01 * (i % 7)}" for i in range(300)))
    _, wrong = log_inputs.judged("channels q; not w; flies; quiet; no recipe", lambda: log_inputs.import_log(path))
    assert wrong == []
    _, wrong = log_inputs.judged("channels p; vehicle rotorcraft; cuts 1", lambda: log_inputs.import_log(path))
    assert wrong == ["channels p", "vehicle rotorcraft", "cuts 1"]
    came, wrong = log_inputs.judged("refused exists", lambda: log_inputs.import_log(tmp_path / "b.csv"))
    assert came.startswith("refused: ")
    assert wrong == []


def test_knots_and_feet_without_a_word_are_asked_together(tmp_path):
    """An airspeed in knots alone, or a height in feet alone, would be two kinds of unit in one table."""
    writer = next(w for w in log_inputs.WRITERS if "knots and feet" in w.name)
    asked = log_inputs.import_log(log_inputs.write(writer, log_inputs.flight(), tmp_path)).asked
    given = log_inputs.answered(asked)
    assert given["told"].units == {"V": "kt", "h": "ft"}
