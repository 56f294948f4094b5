"""What import prints is true of the log: columns as they were combined, ranges that tell their ends apart, rotors."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.logs.layout import ChannelColumn
from testbench.logs.px4 import _rotary
from testbench.questions.importing.ask import _column_in_words, import_log
from testbench.questions.importing.page import channel_rows


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "column 29, deg"),
        ({"scale": -1.0}, "-1 column 29, deg"),
        ({"minus_column": 28}, "column 29 - column 28, deg"),
        ({"minus_column": 28, "scale": 0.5}, "0.5 (column 29 - column 28), deg"),
        ({"scale": 2.0, "offset": -3.0}, "2 column 29 -3, deg"),
    ],
)
def test_a_column_is_shown_as_it_was_combined(more, said):
    assert _column_in_words(ChannelColumn(name="da", column=29, unit="deg", **more)) == said


def test_a_range_has_as_many_digits_as_tell_its_ends_apart(tmp_path):
    t = 0.02 * np.arange(500)
    columns = np.column_stack([t, 0.05 * np.sin(t), np.sin(2.0 * t), 488.0 + 0.04 * np.sin(t), np.full(t.size, 40.0)])
    np.savetxt(tmp_path / "level.csv", columns, delimiter=",", header="t,de,q,h,V", comments="", fmt="%.8g")
    found = import_log(tmp_path / "level.csv")
    ranges = {row[0]: row[1] for row in channel_rows(found)}
    assert ranges["h"] == "487.96 to 488.04 m"
    assert ranges["V"] == "40.0 to 40.0 m/s"


def test_a_multicopter_is_said_to_have_no_surfaces():
    (said,) = _rotary(SimpleNamespace(parameters={"MAV_TYPE": 2.0}))
    assert said.startswith("the log is of a quadrotor (MAV_TYPE 2): no fixed-wing control surface was found")
    for kind in (0.0, 1.0, 22.0):
        assert not list(_rotary(SimpleNamespace(parameters={"MAV_TYPE": kind})))
    assert not list(_rotary(SimpleNamespace(parameters={})))
