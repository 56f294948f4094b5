"""JSBSim models as people have them: what JSBSim refuses of them is said with its place, and mended if asked."""

import re
from pathlib import Path

import pytest

from testbench.aircraft.source import read_source
from testbench.core.errors import ModelError
from testbench.core.paths import stock_root
from testbench.flight.load import adopted_at

ROOT = stock_root()
pytestmark = pytest.mark.skipif(ROOT is None, reason="the jsbsim package brings no models")


@pytest.fixture
def sailplane(tmp_path):
    """The path of a copy of SGS, and what changes its text."""
    text = (ROOT / "aircraft" / "SGS" / "SGS.xml").read_text()
    path = tmp_path / "SGS.xml"

    def write(change) -> Path:
        path.write_text(change(text))
        return path

    return write


def _twice(text: str) -> str:
    function = re.search(
        r'<function name="aero/coefficient/CLDf".*?</function>|<function name="aero/.*?</function>', text, re.S
    )
    return text.replace(function.group(), f"{function.group()}\n{function.group()}", 1)


def test_two_functions_of_one_name_are_told_with_their_lines_and_mended_if_asked(sailplane):
    path = sailplane(_twice)
    lines = [i for i, line in enumerate(path.read_text().splitlines(), 1) if "<function" in line]
    with pytest.raises(ModelError, match=r"stands in SGS.xml, line \d+ and SGS.xml, line \d+; .* --repair") as refused:
        adopted_at(path)
    told = [int(n) for n in re.findall(r"line (\d+)", str(refused.value))]
    assert set(told) <= set(lines)
    assert len(set(told)) == 2
    mended = adopted_at(path, repair=True)
    assert any(words.startswith("repaired: ") for words in mended.found)


def test_a_system_whose_file_is_missing_is_left_out_if_asked(sailplane):
    path = sailplane(lambda text: text.replace("<aerodynamics>", '<system file="NoSuchSystem"/>\n<aerodynamics>', 1))
    with pytest.raises(ModelError, match=r"'NoSuchSystem' .* must exist, .* --repair, which leaves it out"):
        read_source(path)
    assert read_source(path, repair=True).repaired == (
        "repaired: <system file='NoSuchSystem'> is left out, as there is no such file",
    )


def test_a_model_of_flightgear_is_commanded_by_its_controls(sailplane):
    path = sailplane(
        lambda text: re.sub(
            r"<input>\s*fcs/(elevator)-cmd-norm\s*</input>", r"<input>/controls/flight/\1</input>", text
        )
    )
    found = adopted_at(path)
    assert "de" in found.aircraft.controls
    assert any("/controls/flight/elevator moves" in words for words in found.found)
