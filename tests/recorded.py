"""Where the recorded flights are that tests compare with printed results."""

import os
from pathlib import Path

import pytest


def flight_data() -> Path:
    """Folder of real flight records; skips the test with a message where it is absent."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "flight_data"
    folder = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", beside))
    if not folder.is_dir():
        pytest.skip(
            f"no flight records at {folder}; set TESTBENCH_FLIGHT_DATA to the folder that holds attas/, hfb320/"
        )
    return folder


def shared(name: str) -> list[Path]:
    """Files of a folder beside the flight records (logs, cases), below it too; none where it is absent."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "flight_data"
    folder = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", beside)).parent / name
    return sorted(path for path in folder.rglob("*") if path.is_file()) if folder.is_dir() else []
