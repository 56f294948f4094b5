"""A place to fly an identification experiment before the aircraft does.

In three lines::

    import testbench as tb

    result = tb.run(tb.load_scenario("scenarios/eolo_alpha.toml"))
    print(result.table)

Names are imported when they are first used, so that ``import testbench`` and the command line start at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testbench.aircraft import load_aircraft
    from testbench.designer import load_design, run_design
    from testbench.flight import FlightCondition, Manoeuvre, fly, linearise, trim
    from testbench.gap.case import run_gap
    from testbench.logs import load_description
    from testbench.pipeline import identify, load_scenario, run
    from testbench.record import FlightRecord, load_record
    from testbench.report import write_results
    from testbench.sensors import load_suite

__version__ = "0.1.0"

_HOME = {
    "FlightCondition": "testbench.flight",
    "FlightRecord": "testbench.record",
    "Manoeuvre": "testbench.flight",
    "fly": "testbench.flight",
    "identify": "testbench.pipeline",
    "linearise": "testbench.flight",
    "load_aircraft": "testbench.aircraft",
    "load_design": "testbench.designer",
    "load_description": "testbench.logs",
    "load_record": "testbench.record",
    "load_scenario": "testbench.pipeline",
    "load_suite": "testbench.sensors",
    "run": "testbench.pipeline",
    "run_design": "testbench.designer",
    "run_gap": "testbench.gap.case",
    "trim": "testbench.flight",
    "write_results": "testbench.report",
}

__all__ = [
    "FlightCondition",
    "FlightRecord",
    "Manoeuvre",
    "fly",
    "identify",
    "linearise",
    "load_aircraft",
    "load_description",
    "load_design",
    "load_record",
    "load_scenario",
    "load_suite",
    "run",
    "run_design",
    "run_gap",
    "trim",
    "write_results",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'testbench' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)
