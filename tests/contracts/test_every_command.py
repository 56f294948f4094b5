"""Every command, found by walking the application, has a small case and bears a sample of `make reliability`."""

import pytest
from commands import in_warm_process
from studies.reliability.sample import QUICK, sampled
from studies.reliability.small import CASES, leaves


def test_every_command_has_a_small_case():
    """A new row of QUESTIONS, or a new command of a group, needs a case in tests/studies/reliability/small.py."""
    assert {name.partition(",")[0] for name in CASES} - {"blind test"} == set(leaves())


# What takes more than a second to begin with is tried by the slow suite, and by `make reliability`.
SAMPLED = [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in CASES]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", SAMPLED)
def test_a_command_bears_a_sample(name, tmp_path):
    told = tmp_path / "told"
    assert in_warm_process(sampled, name, told) == 0
    assert told.read_text(encoding="utf-8") == ""
