"""What ``import testbench as tb`` offers: every name says what it does, with an example, and the examples are right."""

from __future__ import annotations

import doctest
import inspect

import pytest

import testbench as tb


def test_dir_shows_the_public_names_alone():
    assert dir(tb) == sorted([*tb.__all__, "__version__"])
    assert {
        "run",
        "load_scenario",
        "load_aircraft",
        "load_suite",
        "read_records",
        "estimate",
        "METHODS",
        "find_gap",
    } <= {*dir(tb)}


@pytest.mark.parametrize("name", tb.__all__)
def test_every_name_has_an_example_that_is_right(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = getattr(tb, name)
    text = inspect.getdoc(thing)
    assert text
    assert f"tb.{name}" in text.split("Example:")[-1], "an example calls it by its public name"
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example).failed == 0
