"""Onsets: the evidence of every time from one factor, against that of each by itself; and times that are found."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.inference.linear import Grams, Linearised, Motion, fewer, reduced
from testbench.inference.onset import _Summed, find_onset

P, WIDTH, N = 2, 10, 120


def record(rng, moving=(), size=1.0):
    """Return a record, its pulses (n, p, m) and where they begin; those that begin at ``moving`` act in it."""
    begins = list(range(0, N, WIDTH))
    U = np.zeros((N, P, len(begins)))
    for j, b in enumerate(begins):
        decay = np.exp(-0.05 * np.arange(N - b))
        U[b:, 0, j], U[b:, 1, j] = 5.0 * decay, 5.0 - 5.0 * decay
    X = rng.standard_normal((N, P, 2))
    y = rng.standard_normal((N, P)) + X @ np.array([0.3, -0.1])
    y += U @ np.array([size * rng.standard_normal() if b in moving else 0.0 for b in begins])
    taken = rng.random((N, P)) > 0.05
    return Linearised(y, X, Motion.none(taken), taken), U, begins


def asked(some, prior=0.1):
    blocks, pulses, begins = zip(*some, strict=True)
    return find_onset(blocks, pulses, begins, np.ones(P), np.zeros(2), np.ones(2), prior)[0]


@pytest.mark.parametrize("kappa", [0.01, 1.0])
def test_one_factor_holds_the_evidence_of_every_time(kappa):
    block, U, begins = record(np.random.default_rng(1), range(40, N))
    scales, mean, std, at = np.array([0.8, 1.3]), np.array([0.1, 0.0]), np.array([0.5, 2.0]), np.array(begins)
    found = _Summed.of(block, U, at, begins, scales).at(kappa)
    for parts, held in ((found.from_, lambda t: at >= t), (found.until, lambda t: at < t)):
        for t, part in zip(begins, parts, strict=True):
            alone = Linearised(block.residual, block.columns, fewer(U[:, :, held(t)], block.taken), block.taken)
            wanted = reduced([Grams.made(alone)], scales, kappa).log_evidence(mean, std)
            assert part.log_evidence(mean, std) == pytest.approx(wanted, abs=1e-3)


def test_a_motion_that_begins_in_a_record_is_found_there():
    rng = np.random.default_rng(2)
    some = [record(rng), record(rng, range(60, N)), record(rng)]
    found = asked(some)
    assert (found.record, found.ends, found.shows) == (1, False, (False, True, False))
    assert abs(found.sample - 60) <= WIDTH
    assert found.probability > 0.95


def test_a_motion_that_ends_in_a_record_and_fills_another_is_found():
    rng = np.random.default_rng(3)
    found = asked([record(rng, range(0, N)), record(rng, range(0, 60)), record(rng)])
    assert (found.record, found.ends, found.shows) == (1, True, (True, True, False))
    assert abs(found.sample - 60) <= WIDTH


def test_a_motion_of_some_records_alone_is_cut_out_of_none():
    rng = np.random.default_rng(4)
    found = asked([record(rng), record(rng, range(0, N)), record(rng)])
    assert (found.record, found.shows) == (-1, (False, True, False))


@pytest.mark.parametrize("ends", [False, True])
def test_a_motion_from_one_record_on_is_found_in_the_order_of_the_records(ends):
    """Whatever re-tuned parameters do of it: they are those of the records that do not show it."""
    rng = np.random.default_rng(5)
    found = asked([record(rng, range(0, N) if (i < 2) == ends else ()) for i in range(4)])
    assert (found.record, found.shows) == (-1, (ends, ends, not ends, not ends))


def test_one_record_alone_may_begin_to_move():
    rng = np.random.default_rng(6)
    found = asked([record(rng, range(60, N))])
    assert (found.record, found.ends) == (0, False)


def test_a_motion_of_all_records_begins_in_none():
    """False alarms among 20 draws; with a prior of 0.1 one is expected to be called at even odds 0 or 1 times."""
    called = 0
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        called += asked([record(rng, range(0, N)) for _ in range(3)]).probability > 0.5
    assert called <= 2
