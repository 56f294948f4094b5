"""Which instrument errs, on aircraft that are not ours: a few draws here, all kinds where there are minutes."""

import pytest
from studies.instruments_study import KINDS, measured, row_of

from testbench.inference.instruments import agreement


@pytest.mark.sampled(3)  # of each channel: tests/inference/test_instruments.py
@pytest.mark.parametrize(("kind", "seed"), [("q x 0.85", 2), ("alpha lag 0.1 s", 1), ("theta lag 0.1 s", 4)])
def test_a_drawn_aircraft_shows_its_instrument(kind, seed):
    channel, what, size = KINDS[kind]
    fault = agreement([measured(kind, seed)]).fault
    assert fault is not None
    assert (fault.channel, abs(fault.estimate - size) < 0.3 * abs(size)) == (channel, True), what


@pytest.mark.parametrize("kind", [pytest.param("clean", marks=pytest.mark.slow), "clean in gusts"])
def test_a_drawn_aircraft_with_sound_instruments_is_not_accused(kind):
    for seed in (0, 3):
        assert not agreement([measured(kind, seed)]).contradicted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "least"),
    [("q x 0.85", 18), ("q x 1.15", 18), ("alpha lag 0.1 s", 16), ("theta lag 0.1 s", 18), ("clean", 0)],
)
def test_twenty_draws_of_a_kind(kind, least):
    row = row_of(kind, range(3000, 3020))
    assert row["instrument_named"] >= least
    assert row["named_wrong"] <= 1
    assert kind != "clean" or row["flagged"] <= 1
