"""The example of the guide on own questions runs as it stands there, and is right: some hundred flights."""

from __future__ import annotations

from pathlib import Path

import pytest

GUIDE = Path(__file__).parents[2] / "docs" / "guides" / "ask_your_own_question.md"


def test_the_example_names_the_late_elevator_and_sizes_delay_and_noise(capsys):
    code = GUIDE.read_text("utf-8").split("```python\n")[1].split("```")[0]
    names: dict = {}
    exec(compile(code, str(GUIDE), "exec"), names)
    found = names["found"]
    assert found.best.name == "elevator late"
    assert found.best.probability > 0.95
    assert found.best.posterior.p_whole > 0.5
    delay, error = found.best.posterior["delay_s"]
    assert delay == pytest.approx(0.06, abs=4.0 * error)
    assert error < 0.01
    for value, deviation in found.noise.values():
        assert value == pytest.approx(1.3, abs=4.0 * deviation)
    assert "elevator late" in capsys.readouterr().out
