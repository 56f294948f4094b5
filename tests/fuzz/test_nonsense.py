"""Nonsense is refused in one line, at once and without memory: none of sixty values and files is accepted."""

import pytest
from fuzz.nonsense import cases
from fuzz.survive import broken

from testbench.core.errors import TestbenchError

COUNT = 60


class Accepted(Exception):
    """A case was not refused."""


def refused(case, folder):
    try:
        case(folder)
    except TestbenchError as error:
        if len(str(error)) > 2000 or "Traceback" in str(error):
            raise Accepted(f"refused at length: {error}") from error
        if not any(word in str(error) for word in ("must", "got")):
            raise Accepted(f"refused without a law: {error}") from error
    else:
        raise Accepted("it was accepted")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("valid")


def test_none_of_sixty_is_accepted(place):
    found = cases(place)
    assert len(found) >= COUNT
    assert broken({name: lambda folder, c=case: refused(c, folder) for name, case in found.items()}) == []
