"""Taurus in a folder of the tests, with what it is said to be known of its coefficients."""

import shutil
from collections.abc import Mapping
from pathlib import Path

from testbench.core.paths import AIRCRAFT_MODELS


def believed_taurus(folder: Path, deviations: Mapping[str, float], name: str = "mine") -> Path:
    """Write a copy of Taurus with [uncertainty] into ``folder``/aircraft and return its folder."""
    out = folder / "aircraft" / name
    shutil.copytree(AIRCRAFT_MODELS / "taurus", out)
    lines = "\n".join(f"{coefficient} = {std}" for coefficient, std in deviations.items())
    toml = out / "aircraft.toml"
    toml.write_text(f"{toml.read_text(encoding='utf-8')}\n[uncertainty]\n{lines}\n", encoding="utf-8")
    return out
