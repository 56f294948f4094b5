from __future__ import annotations

import os
from pathlib import Path

# Before numpy is imported: several test processes with several BLAS threads each stand in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from testbench.aircraft import load_aircraft
from testbench.flight import FlightCondition, trim

ROOT = Path(__file__).resolve().parents[1]
EOLO_CONDITION = FlightCondition(16.0, 547.0)
TAURUS_CONDITION = FlightCondition(12.0, 100.0)


def flight_data() -> Path:
    """Folder of real flight records; skips the test with a message where it is absent."""
    folder = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", ROOT.parent / "shared" / "flight_data"))
    if not folder.is_dir():
        pytest.skip(
            f"no flight records at {folder}; set TESTBENCH_FLIGHT_DATA to the folder that holds attas/, hfb320/"
        )
    return folder


@pytest.fixture(scope="session")
def eolo():
    return load_aircraft("eolo")


@pytest.fixture(scope="session")
def taurus():
    return load_aircraft("taurus")


@pytest.fixture(scope="session")
def eolo_trim(eolo):
    return trim(eolo, EOLO_CONDITION)


@pytest.fixture(scope="session")
def taurus_trim(taurus):
    return trim(taurus, TAURUS_CONDITION)
