from __future__ import annotations

import os

# Before numpy is imported: several test processes with several BLAS threads each stand in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from browsers import chromium

from testbench.flight import FlightCondition, load_aircraft, trim

EOLO_CONDITION = FlightCondition(16.0, 547.0)
TAURUS_CONDITION = FlightCondition(12.0, 100.0)


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


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running
