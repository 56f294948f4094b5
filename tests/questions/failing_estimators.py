"""Estimators that fail in every way, and a scenario that asks all of them beside one that works."""

from pathlib import Path

METHODS = """
import itertools
import sys
import time

import numpy as np

from testbench.estimators import estimate as packaged
from testbench.estimators.brought import stamped


def raises(records, inputs, outputs):
    raise ZeroDivisionError("of my own")


def ends(records, inputs, outputs):
    sys.exit(3)


def hangs(records, inputs, outputs):
    while True:
        pass


def sleeps(records, inputs, outputs):
    time.sleep(100.0)


def in_c(records, inputs, outputs):
    sum(itertools.count())  # hears no signal and takes no exception


def crashes(records, inputs, outputs):
    import os

    os.abort()


def nan(records, inputs, outputs):
    model = packaged("dsr_e", records, inputs, outputs, order=4, past_horizon=10, future_horizon=10)
    return stamped(model, A=model.A * np.nan)


def busy(records, inputs, outputs):
    began = time.process_time()
    while time.process_time() < began + 1.5:
        pass
    return works(records, inputs, outputs)


def works(records, inputs, outputs):
    return packaged("dsr_e", records, inputs, outputs, order=4, past_horizon=10, future_horizon=10)
"""

SCENARIO = """
title = "Cells"
aircraft = "eolo"
wings = "rigid"
suites = [{suites}]
condition = {{ V_m_s = 16.0, h_m = 547.0 }}
[[manoeuvre]]
name = "3-2-1-1"
use = "split"
duration_s = 10.0
input = [{{ signal = "3211", control = "de", amplitude_deg = 3.0, step_s = 0.25 }}]
[identification]
inputs = ["de"]
limit_s = {limit_s}
estimators = [{estimators}]
"""
NEEDS_ALPHA = '{ method = "equation_error", structure = "longitudinal", short = true, V_m_s = 16.0 }'


def own(*names: str) -> str:
    return ", ".join(f'{{ method = "methods.py:{name}" }}' for name in names)


def write(
    folder: Path, estimators: str, limit_s: float = 20.0, name: str = "cells",
    suites: str = '"eolo_no_alpha", "eolo_alpha"',
) -> Path:  # fmt: skip
    """Write the scenario with these estimators, and the methods beside it."""
    (folder / "methods.py").write_text(METHODS, encoding="utf-8")
    file = folder / f"{name}.toml"
    file.write_text(SCENARIO.format(suites=suites, estimators=estimators, limit_s=limit_s), encoding="utf-8")
    return file
