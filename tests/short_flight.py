"""A short flight as numbers, that tests write in many formats, and the inputs that failed once."""

import os
from pathlib import Path

import numpy as np
import pytest

T = 0.02 * np.arange(800)
DE = 3.0 * ((T >= 5.0) & (T < 6.0)) - 3.0 * ((T >= 6.0) & (T < 7.0))  # deg
Q = 2.0 * np.sin(T)  # deg/s


def case(name: str) -> Path:
    """An input that failed once, kept outside the project; the test is skipped where it is absent."""
    beside = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", Path(__file__).resolve().parents[2] / "shared/flight_data"))
    path = beside.parent / "cases" / name
    if not path.is_file():
        pytest.skip(f"no case at {path}")
    return path
