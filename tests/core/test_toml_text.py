"""Tables written as TOML are read back as they were."""

from __future__ import annotations

import tomllib

from testbench.core.escape import table_lines


def test_a_table_is_read_back_as_it_was_written():
    table = {
        "title": 'a "quoted" text\\ with a line\nend and \x7f',
        "empty": [],
        "numbers": [1.5, -2e-17, 3.0],
        "yes": True,
        "count": 3,
        "odd key, with.dots": "x",
        "inner": {"deep": {"a": 1.0}, "deeper": {"b": {"c": ["p", "q"]}}, "none": {}},
        "list": [{"name": "one", "by": {"de_cmd": {"lag_s": 0.03}}}, {"name": "two"}],
        "last": {"x": [[1.0, 2.0], [3.0, 4.0]]},
    }
    assert tomllib.loads("\n".join(table_lines(table))) == table
    assert tomllib.loads("\n".join(table_lines({"a": 1, "b": None}))) == {"a": 1}
