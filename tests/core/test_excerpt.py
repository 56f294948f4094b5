"""A user's prose in a message."""

from __future__ import annotations

from testbench.core.errors import excerpt


def test_prose_is_quoted_as_one_line_of_200_letters_without_controls():
    said = excerpt("ask\n\x1b[31m Mr. Smith " + 500 * "x")
    assert "\n" not in said
    assert "\x1b" not in said
    assert len(said) <= 202
