"""What ``as_jax_alone.py`` tests, in a process of its own: JAX runs threads, and other tests fork their processes."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ALONE = Path(__file__).with_name("as_jax_alone.py")


@pytest.mark.skipif(find_spec("jax") is None, reason="jax is not installed")
@pytest.mark.parametrize("which", ["not slow", pytest.param("slow", marks=pytest.mark.slow)])
def test_jax_flies_and_differentiates(which):
    options = ("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-o", "addopts=", "-m", which)
    ran = subprocess.run([sys.executable, "-m", "pytest", *options, ALONE], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert " passed" in ran.stdout
