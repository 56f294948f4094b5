"""Every command, found by walking the application, has a small case and bears a sample of `make reliability`."""

from __future__ import annotations

import pytest
from commands import in_warm_process
from studies.reliability.sample import sampled
from studies.reliability.small import CASES, leaves


def test_every_command_has_a_small_case():
    """A new row of QUESTIONS, or a new command of a group, needs a case in tests/studies/reliability/small.py."""
    assert {name.partition(",")[0] for name in CASES} - {"blind test"} == set(leaves())


SLOW = ("run", "campaign resume", "campaign status", "campaign summarise")  # what they begin with takes long to make


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in CASES])
def test_a_command_bears_a_sample(name, tmp_path):
    told = tmp_path / "told"
    assert in_warm_process(sampled, name, told) == 0
    assert told.read_text(encoding="utf-8") == ""
