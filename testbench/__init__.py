"""A place to fly an identification experiment before the aircraft does.

In three lines::

    import testbench as tb

    result = tb.run(tb.load_scenario("eolo_alpha"))
    print(result.table)

``dir(testbench)`` lists what is meant to be used; each name says in its own help what it does, with an example. Names
are imported when they are first used, so that ``import testbench`` and the command line start at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbench.core.lazily import lazily

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord, load_record
    from testbench.estimators import METHODS, estimate
    from testbench.estimators.causes import with_causes
    from testbench.estimators.parametric.structures.written import structure_from_equations
    from testbench.evaluation import evaluate
    from testbench.flight import FlightCondition, Manoeuvre, Start, fly, load_aircraft
    from testbench.flight.batch.fly import fly_many, fly_stream
    from testbench.flight.batch.jobs import Job
    from testbench.flight.batch.trim import trim_many
    from testbench.flight.linearise import linearise
    from testbench.flight.tangents import FlightParameter, tangents
    from testbench.flight.trim import trim
    from testbench.inference.calibrate import calibrate
    from testbench.inference.compare import Hypothesis, Posterior, compare_hypotheses
    from testbench.inference.instruments import agreement
    from testbench.inference.parameters import Noise, Parameter
    from testbench.inference.unknown import pulses
    from testbench.inputs import InputSignal
    from testbench.line import fly_and_measure
    from testbench.logs.read import read_records
    from testbench.questions.aircraft.ask import survey
    from testbench.questions.campaign.ask import fly_campaign
    from testbench.questions.campaign.load import load_campaign
    from testbench.questions.compare.ask import compare
    from testbench.questions.dataset.ask import draw_dataset
    from testbench.questions.dataset.open import FlightSamples, open_dataset
    from testbench.questions.design.ask import run_design
    from testbench.questions.design.known import known_after
    from testbench.questions.files import load
    from testbench.questions.gap.ask import run_gap
    from testbench.questions.gap.open_set import first_look
    from testbench.questions.gap.workflow import find_gap
    from testbench.questions.global_model.ask import global_model
    from testbench.questions.identify.amend.ask import amend
    from testbench.questions.identify.ask import identify, load_description
    from testbench.questions.identify.pool.ask import identify_and_pool
    from testbench.questions.identify.pool.least_squares import LogCoefficients
    from testbench.questions.identify.pool.pooling import pool
    from testbench.questions.identify.pool.prior import Prior
    from testbench.questions.importing.ask import import_log
    from testbench.questions.modes.ask import fly_modes
    from testbench.questions.plan.ask import make_plan
    from testbench.questions.results.ask import compare_results, list_results
    from testbench.questions.results.verify import verify_results
    from testbench.questions.run.ask import load_scenario, run
    from testbench.questions.run.page import write_results
    from testbench.questions.tidy import read_results
    from testbench.sensors import load_suite

__version__ = "0.4.0"

_HOME = {
    "agreement": "testbench.inference.instruments",
    "survey": "testbench.questions.aircraft.ask",
    "structure_from_equations": "testbench.estimators.parametric.structures.written",
    "make_plan": "testbench.questions.plan.ask",
    "fly_modes": "testbench.questions.modes.ask",
    "global_model": "testbench.questions.global_model.ask",
    "fly_many": "testbench.flight.batch.fly",
    "fly_stream": "testbench.flight.batch.fly",
    "Job": "testbench.flight.batch.jobs",
    "FlightParameter": "testbench.flight.tangents",
    "tangents": "testbench.flight.tangents",
    "trim_many": "testbench.flight.batch.trim",
    "InputSignal": "testbench.inputs",
    "METHODS": "testbench.estimators",
    "FlightCondition": "testbench.flight",
    "FlightRecord": "testbench.core.record",
    "Manoeuvre": "testbench.flight",
    "Start": "testbench.flight",
    "amend": "testbench.questions.identify.amend.ask",
    "benchmark": "testbench.questions.compare.benchmark.ask",
    "compare": "testbench.questions.compare.ask",
    "calibrate": "testbench.inference.calibrate",
    "Hypothesis": "testbench.inference.compare",
    "Posterior": "testbench.inference.compare",
    "compare_hypotheses": "testbench.inference.compare",
    "Noise": "testbench.inference.parameters",
    "Parameter": "testbench.inference.parameters",
    "pulses": "testbench.inference.unknown",
    "compare_results": "testbench.questions.results.ask",
    "list_results": "testbench.questions.results.ask",
    "estimate": "testbench.estimators",
    "with_causes": "testbench.estimators.causes",
    "draw_dataset": "testbench.questions.dataset.ask",
    "FlightSamples": "testbench.questions.dataset.open",
    "open_dataset": "testbench.questions.dataset.open",
    "evaluate": "testbench.evaluation",
    "find_gap": "testbench.questions.gap.workflow",
    "first_look": "testbench.questions.gap.open_set",
    "fly": "testbench.flight",
    "fly_and_measure": "testbench.line",
    "fly_campaign": "testbench.questions.campaign.ask",
    "identify": "testbench.questions.identify.ask",
    "identify_and_pool": "testbench.questions.identify.pool.ask",
    "LogCoefficients": "testbench.questions.identify.pool.least_squares",
    "pool": "testbench.questions.identify.pool.pooling",
    "Prior": "testbench.questions.identify.pool.prior",
    "import_log": "testbench.questions.importing.ask",
    "known_after": "testbench.questions.design.known",
    "linearise": "testbench.flight",
    "load": "testbench.questions.files",
    "load_aircraft": "testbench.flight",
    "load_campaign": "testbench.questions.campaign.load",
    "load_description": "testbench.questions.identify.ask",
    "load_record": "testbench.core.record",
    "load_scenario": "testbench.questions.run.ask",
    "load_suite": "testbench.sensors",
    "read_records": "testbench.logs.read",
    "read_results": "testbench.questions.tidy",
    "run": "testbench.questions.run.ask",
    "run_design": "testbench.questions.design.ask",
    "run_gap": "testbench.questions.gap.ask",
    "trim": "testbench.flight",
    "verify_results": "testbench.questions.results.verify",
    "write_results": "testbench.questions.run.page",
}

__all__ = [
    "METHODS",
    "FlightCondition",
    "FlightParameter",
    "FlightRecord",
    "FlightSamples",
    "Hypothesis",
    "InputSignal",
    "Job",
    "LogCoefficients",
    "Manoeuvre",
    "Noise",
    "Parameter",
    "Posterior",
    "Prior",
    "Start",
    "agreement",
    "amend",
    "benchmark",
    "calibrate",
    "compare",
    "compare_hypotheses",
    "compare_results",
    "draw_dataset",
    "estimate",
    "evaluate",
    "find_gap",
    "first_look",
    "fly",
    "fly_and_measure",
    "fly_campaign",
    "fly_many",
    "fly_modes",
    "fly_stream",
    "global_model",
    "identify",
    "identify_and_pool",
    "import_log",
    "known_after",
    "linearise",
    "list_results",
    "load",
    "load_aircraft",
    "load_campaign",
    "load_description",
    "load_record",
    "load_scenario",
    "load_suite",
    "make_plan",
    "open_dataset",
    "pool",
    "pulses",
    "read_records",
    "read_results",
    "run",
    "run_design",
    "run_gap",
    "structure_from_equations",
    "survey",
    "tangents",
    "trim",
    "trim_many",
    "verify_results",
    "with_causes",
    "write_results",
]


__getattr__ = lazily("testbench", **{name: home.removeprefix("testbench.") for name, home in _HOME.items()})


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
