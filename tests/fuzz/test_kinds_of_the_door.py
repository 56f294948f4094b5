"""Each kind of file that the door knows has an example, which is damaged: a new kind cannot escape."""

from __future__ import annotations

from functools import partial

import pytest
from fuzz.kinds import examples
from fuzz.mutations import damaged, mistyped, of_text
from fuzz.survive import broken
from fuzz.test_mutated_files import rng_of, seeds

from testbench.core.door import KINDS

FEW = 4  # of each kind in the normal suite


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("valid")


def test_every_kind_has_an_example_that_is_read(place, tmp_path):
    found = examples(place)
    assert found.keys() == KINDS.keys()
    for number, example in enumerate(found.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert example.tried(example.content, folder) is not None, example.name


def mutant(example, kind, seed):
    """Return the damaged content of an example: bytes, values of another kind, or text."""
    rng = rng_of(kind, seed)
    if kind in ("campaign store", "record"):
        return damaged(example.content, rng)
    if example.name.endswith(".toml") and seed % 3:
        return mistyped(example.content.decode(), rng).encode("utf-8", "surrogateescape")
    return of_text(example.content, rng)


def test_damaged_files_of_every_kind(place):
    def case(kind, seed, folder):
        example = examples(place)[kind]
        example.tried(mutant(example, kind, seed), folder)

    examples(place)
    cases = {f"{kind} {seed}": partial(case, kind, seed) for seed in seeds(FEW) for kind in KINDS}
    assert broken(cases) == []
