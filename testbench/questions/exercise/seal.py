"""A student's own truth: from the teacher's key, the exercise and the student's name, by a keyed generator.

The key goes through scrypt (C. Percival, RFC 7914), salted with exercise and student, and seeds the generator of the
hidden numbers. Nothing that is handed out holds these numbers or the seed. The public key is used if no other is given.
With it anybody who has this package can compute the numbers, which suits studying alone. With a key of the teacher's
own, only its owner can compute them, and only its owner can check. The handed-out ``key_check`` tells a wrong key from
a wrong answer; it also lets whoever has it try keys, some tens per second and core (estimate), so a key must be long
and random, like one from `openssl rand -hex 16`.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np

from testbench.core.door import read_text
from testbench.core.errors import RecordError, ScenarioError, nearest
from testbench.questions.exercise.exercise import Exercise

CATALOGUE = Path(__file__).parent / "catalogue"
NAMES = (
    "doublet_length",
    "short_period",
    "static_margin",
    "plan_within_limits",
    "sampling_8hz",
    "order_by_singular_values",
    "how_many_repeats",
    "what_alpha_buys",
    "wrong_sign",
    "log_to_derivatives",
    "coloured_residuals",
    "which_sensor_lies",
    "dsr_horizon",
    "flutter_onset",
    "name_missing_effect",
)
"""The exercises, in an order in which they can be taken."""
PUBLIC_KEY = "flight-testbench, for studying alone"
VARIABLE = "TESTBENCH_EXERCISE_KEY"
_SHORTEST = 16


@dataclass(frozen=True)
class Seal:
    """What a key gives for one student and exercise: two independent seeds and the check of the key."""

    hidden_seed: int
    noise_seed: int
    key_check: str

    def generator(self) -> np.random.Generator:
        """Return the generator of the hidden numbers."""
        return np.random.default_rng(self.hidden_seed)


@lru_cache(maxsize=256)  # a key is stretched in some 50 ms, and asked for by all that opens an exercise
def seal(key: str, exercise: str, student: str) -> Seal:
    """Return the seeds of one student's version of an exercise."""
    salt = f"testbench exercise 1\0{exercise}\0{student}".encode()
    digest = hashlib.scrypt(key.encode(), salt=salt, n=2**14, r=8, p=1, dklen=40)
    return Seal(int.from_bytes(digest[:16], "big"), int.from_bytes(digest[16:24], "big") % 2**31, digest[36:].hex())


def read_key(file: Path | None) -> str:
    """Return the key in ``file``, else that in the environment variable TESTBENCH_EXERCISE_KEY, else the public one.

    Raises:
        RecordError: the file cannot be read.
        ScenarioError: the key is too short to protect anything.
    """
    key = read_text(file, "key").strip() if file is not None else os.environ.get(VARIABLE, "").strip() or PUBLIC_KEY
    if len(key) < _SHORTEST:
        raise ScenarioError(
            f"a teacher's key must have at least {_SHORTEST} characters, got {len(key)}; "
            "`openssl rand -hex 16` makes one"
        )
    return key


# --- names ------------------------------------------------------------------------------------------------------------


def load_exercise(name: str) -> Exercise:
    """Return the exercise called ``name``.

    Raises:
        RecordError: there is none of that name.
    """
    if name not in NAMES:
        raise RecordError(f"an exercise must be one of the list, got '{name}'{nearest(name, NAMES)}")
    m = import_module(f"testbench.questions.exercise.catalogue.{name}")
    return Exercise(m.TITLE, m.LEVEL, m.MINUTES, m.QUESTIONS, m.draw, m.hand_out, m.answer, m.solve)
